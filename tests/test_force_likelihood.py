"""The likelihood of force records against formulas, quadrature and simulated truth written out apart from it."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from samples import problem_of
from scipy.integrate import quad_vec
from scipy.special import logsumexp
from scipy.stats import multivariate_normal
from synthetic_drop import COR, K_Y, MASS, SPEEDS, force_at, write_case

from fitball.data.force_file import load_force
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.errors import FitError
from fitball.inference.assemble import force_notes
from fitball.inference.identifiability.information import fisher_information, information_evidence
from fitball.inference.likelihood.force import (
    aligned,
    force_cost,
    force_information,
    force_log_likelihood,
    force_residuals,
    force_slopes,
    mean_forces,
    noise_held,
)
from fitball.inference.likelihood.posterior import log_likelihood, log_posterior
from fitball.inference.point.maximum_posterior import maximum_posterior
from fitball.inference.problem.priors import parse_prior
from fitball.inference.problem.subsample import thinned_problem, withheld
from fitball.models.kernels.dual import STEP
from fitball.models.registry import model
from fitball.values import Impacts

TRUTH = {"k_y": K_Y, "cor_10": COR, "cor_slope": 1e-6, "velocity_sd": 0.05, "force_sd": 4.0, "force_misfit": 0.03}


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    return problem_of(write_case(tmp_path_factory.mktemp("force"), 1))


def values_of(problem, **moved):
    return np.array([[{**TRUTH, **moved}[name] for name in problem.free_names]])


def error_of(problem, values, name="k_y"):
    """Standard error of the logarithm of a parameter to first order."""
    look = information_evidence(problem, problem.to_coordinates(values)[0])[name]
    return look.error * problem.prior.width[problem.free_names.index(name)]


@pytest.mark.parametrize("normal", ["total", "inner", "momentum"])
def test_integrals_are_those_of_the_force(normal):
    ball = model("two-mass", tangential=False, normal=normal)
    share = 1.0 if normal == "total" else 0.9
    values = {"mass_ratio": share, "k_y": K_Y, "cor_10": COR, "cor_slope": 0.0}
    names = ball.parameter_names
    row = np.array([[values[name] for name in names]])
    impacts = Impacts(np.zeros(1), np.array([7.0]), np.zeros(1))
    step = 3e-4
    impulse, integral, centroid = ball.force_integrals(
        names, row, impacts, np.full((1, 1), -step), np.full(1, step), 20
    )
    times = step * np.arange(-1, 19)
    core = COR / share if normal == "momentum" else COR

    def course(t):
        force = force_at(t, 7.0, e=core, mass=share * MASS)
        return np.array([force, force * t])

    found = [quad_vec(course, 0.0, t, epsrel=1e-12, limit=2000)[0] for t in np.maximum(times, 0.0)]
    first, moment = np.array(found).T
    np.testing.assert_allclose(impulse[0, 0], first, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(integral[0, 0], times * first - moment, rtol=1e-7, atol=1e-14)
    assert centroid[0, 0] == pytest.approx(moment[-1] / first[-1], rel=1e-8)
    # The landing blow is in no record: the impulse is that of the mass on the spring.
    assert impulse[0, 0, -1] == pytest.approx(share * MASS * 7.0 * (1.0 + core), rel=1e-12)


@pytest.mark.parametrize("name", ["k_y", "cor_10", "ball_mass"])
def test_complex_steps_are_derivatives(name):
    ball = model("two-mass", tangential=False, normal="total")
    names = (*ball.parameter_names, "ball_mass")
    base = {"k_y": K_Y, "cor_10": COR, "cor_slope": -0.01, "ball_mass": MASS}
    row = np.array([[base[item] for item in names]])
    impacts = Impacts(np.zeros(2), np.array([5.0, 11.0]), np.zeros(2))

    def integrals(values):
        return ball.force_integrals(names, values, impacts, np.full((1, 2), 1e-4), np.full(2, 2.5e-4), 24)[:2]

    column = names.index(name)
    moved = row.astype(complex)
    moved[0, column] += 1j * STEP
    h = 1e-5 * base[name]
    up, down = row.copy(), row.copy()
    up[0, column] += h
    down[0, column] -= h
    for exact, high, low in zip(integrals(moved), integrals(up), integrals(down), strict=True):
        slope = exact.imag / STEP
        np.testing.assert_allclose(slope, (high - low) / (2.0 * h), atol=1e-7 * np.abs(slope).max())


def test_means_are_those_of_the_course(problem):
    """The predicted means against triangular means of the force formula, sample by sample."""
    records = problem.force
    columns = problem.all_values(values_of(problem, cor_slope=0.0))
    start = 1.7e-3
    force, rate = mean_forces(
        problem, columns, records.rows, np.array([records.first - start]), records.spacing, records.nodes
    )
    offsets = np.linspace(-1.0, 1.0, 4001)
    weights = 1.0 - np.abs(offsets)
    for place, (item, v) in enumerate(zip(records.records, SPEEDS, strict=True)):
        times = item.first - start + item.spacing * np.arange(len(item.means))
        seen = force_at(times[:, None] + item.spacing * offsets, v) @ weights / weights.sum()
        np.testing.assert_allclose(force[0, place, : times.size], seen, atol=3e-4 * item.peak)
        differences = np.gradient(force[0, place, : times.size], item.spacing)
        assert np.corrcoef(differences, rate[0, place, : times.size])[0, 1] > 0.95


def test_the_samples_of_a_record_are_counted(problem, tmp_path):
    """The pulse and a quarter of its length on either side, as far as the record goes."""
    table = write_case(tmp_path, 1)
    force = load_force(table.with_name("drops_force.csv"), load_table(table))
    for record, found in zip(force.records, problem.force.records, strict=True):
        inside = np.flatnonzero(record.force >= 0.05 * record.force.max())
        top = int(np.argmax(record.force))
        gaps = np.flatnonzero(np.diff(inside) > 1)
        first = max([inside[0], *(inside[g + 1] for g in gaps if inside[g] < top)])
        last = min([inside[-1], *(inside[g] for g in gaps if inside[g] >= top)])
        margin = math.ceil(0.25 * (last - first + 1))
        kept = range(max(0, first - margin), min(record.force.size, last + margin + 1))
        assert found.samples == len(kept)


def test_information_of_records_is_the_curvature_they_would_have(problem):
    """Where records follow the model, the expected information is the Hessian of their cost, in the noise too, whose
    prior may be on the value or on its logarithm."""
    flat = replace(
        problem,
        parameters=tuple(
            replace(item, prior=parse_prior(item.name, "uniform(0.001, 1)", 1e-4, 3.0))
            if item.name == "force_misfit"
            else item
            for item in problem.parameters
        ),
    )
    found = {}
    for one in (problem, flat):
        at = one.to_coordinates(values_of(one))[0]
        information = force_information(one, one.force, at)
        k = one.free_names.index("force_misfit")
        found[one is flat] = information[k, k]
    # A coordinate is the logarithm or the value: I(value) = I(log) / value^2.
    assert found[True] == pytest.approx(found[False] / TRUTH["force_misfit"] ** 2, rel=1e-9)
    assert found[False] > 1.0


def test_likelihood_is_the_integral_over_the_start(problem):
    """A dense normal density of the means, from the weights of the samples, integrated over the start on a grid."""
    records = replace(problem.force, records=problem.force.records[2:3])
    item = records.records[0]
    columns = problem.all_values(values_of(problem, k_y=1.02 * K_Y, cor_slope=0.0))
    count, block = len(item.means), item.block
    weights = np.zeros((count, count * block + block))
    for j in range(count):
        for i in range(-block + 1, block):
            weights[j, j * block + block + i] = (1.0 - abs(i) / block) / block
    times = item.first + item.spacing * np.arange(count)
    apart = np.sqrt(3.0) * np.abs(times[:, None] - times) / (0.3 * item.length)
    outside = np.maximum(np.maximum(item.begin - times, times - item.begin - item.length) / item.length, 0.0)
    taper = np.clip(1.0 - outside / 0.2, 0.0, 1.0)
    smooth = np.outer(taper, taper) * (1.0 + apart) * np.exp(-apart)
    covariance = 4.0**2 * weights @ weights.T + (0.03 * item.peak) ** 2 * smooth
    density = multivariate_normal(np.zeros(count), covariance)
    # The prior of the start is wide, a quarter of the contact; the record knows it to some microseconds.
    sd = 0.25 * item.length
    centre = aligned(problem, records, columns)
    best = float(centre.start[0, 0] + centre.move[0, 0])
    grid = best + np.linspace(-2e-4, 2e-4, 2001)
    logs = []
    for start in grid:
        force, _ = mean_forces(
            problem, columns, records.rows, np.array([[item.first - start]]), records.spacing, records.nodes
        )
        logs.append(
            density.logpdf(np.array(item.means) - force[0, 0, :count]) - 0.5 * ((start - item.begin) / sd) ** 2
        )
    integral = logsumexp(logs) + np.log(grid[1] - grid[0]) - np.log(sd * np.sqrt(2.0 * np.pi))
    assert float(force_log_likelihood(problem, records, columns)[0]) == pytest.approx(integral, abs=0.1)
    # To first order in the start: the rest is its third derivative. A term left out would be some whole units.


def test_the_likelihood_is_added_to_that_of_the_table(problem):
    values = values_of(problem)
    rebound = problem.rebound(values)
    alone = log_likelihood(replace(problem, force=None), values, rebound)
    records = force_log_likelihood(problem, problem.force, problem.all_values(values))
    np.testing.assert_allclose(log_likelihood(problem, values, rebound), alone + records, rtol=1e-14)
    # Draws do not see each other: a batch gives what each gives alone.
    many = np.concatenate([values, values_of(problem, k_y=1.1 * K_Y), values])
    batch = force_log_likelihood(problem, problem.force, problem.all_values(many))
    np.testing.assert_allclose(batch[[0, 2]], records[0], rtol=1e-12)
    assert batch[1] < batch[0] - 50.0


def test_slopes_are_those_of_the_cost(problem):
    held = noise_held(problem, TRUTH)
    assert {"force_sd", "force_misfit"}.isdisjoint(held.free_names)
    at = held.to_coordinates(values_of(held, k_y=1.01 * K_Y))
    rows, slopes, _ = force_slopes(held, held.force, at)
    gradient = np.einsum("drn,drnk->k", rows, slopes)
    for k, name in enumerate(held.free_names):
        step = np.zeros(held.dimension)
        step[k] = 1e-5 * held.prior.width[k]
        costs = force_cost(held, held.all_values(held.to_values(np.concatenate([at + step, at - step]))))
        assert gradient[k] == pytest.approx((costs[0] - costs[1]) / (2.0 * step[k]), rel=2e-3, abs=1e-6), name
    residuals = force_residuals(held, held.all_values(held.to_values(at)))
    np.testing.assert_allclose(residuals.ravel(), rows.ravel())


def test_a_known_start_of_contact_holds(problem, tmp_path):
    """Contact that starts at 1 ms and more contradicts a scene that says it starts at 0 within 0.05 ms."""
    table = write_case(tmp_path, 1)
    known = problem_of(table, scene=Scene(force_start_sd=5e-5))
    values = values_of(known)
    found = aligned(known, known.force, known.all_values(values))
    assert np.all(np.abs(found.rows(known.force)[0, :, -1]) > 3.0)
    assert float(log_likelihood(known, values, known.rebound(values))[0]) < -1e3


def test_samples_do_not_count_as_measurements(tmp_path):
    """Five times the samples must not know sqrt(5) times as much; without a misfit they would."""
    errors = {}
    for step in (1e-4, 2e-5):
        folder = tmp_path / f"{step:g}"
        folder.mkdir()
        case = problem_of(write_case(folder, 5, step=step))
        for misfit in (0.03, 1e-4):
            errors[step, misfit] = error_of(case, values_of(case, force_misfit=misfit))
    # From 50 samples in the contact to 250 the sensor's noise still sinks; after that nothing is left to gain.
    assert errors[1e-4, 0.03] / errors[2e-5, 0.03] < 1.7
    assert errors[1e-4, 1e-4] / errors[2e-5, 1e-4] > 2.1
    assert errors[2e-5, 0.03] > 5.0 * errors[2e-5, 1e-4]


def scored(case):
    """How far the k_y of highest posterior density lies from the truth, in standard errors; by Fisher scoring."""
    at = case.to_coordinates(values_of(case))
    steps = 1e-5 * np.diag(case.prior.width)
    for _ in range(8):
        density = log_posterior(case, np.concatenate([at + steps, at - steps]))
        gradient = (density[: case.dimension] - density[case.dimension :]) / 2e-5
        information = fisher_information(case, at[0], scene=False) + np.eye(case.dimension)
        move = np.linalg.solve(information, gradient)
        at = at + np.clip(move, -0.3, 0.3) * case.prior.width
        if np.abs(move).max() < 1e-3:
            break
    assert np.abs(gradient).max() < 0.3 * np.sqrt(np.diag(information)).max()
    values = case.to_values(at)
    k = case.free_names.index("k_y")
    return float(np.log(values[0, k] / K_Y)) / error_of(case, values)


def test_the_truth_is_covered(tmp_path):
    """Over seeds; the negative control takes every sample for independent, and is wrong by many errors."""
    right, wrong = [], []
    for seed in range(8):
        table = write_case(tmp_path, 100 + seed)
        right.append(scored(problem_of(table)))
        if seed < 3:
            wrong.append(scored(problem_of(table, fix={"force_misfit": 1e-4})))
    # A mean square of eight standard normal numbers lies below 1.6^2 with 99 %.
    assert np.sqrt(np.mean(np.square(right))) < 1.6
    assert np.sqrt(np.mean(np.square(wrong))) > 2.5


def test_a_force_of_twice_the_size_is_flagged(tmp_path):
    table = write_case(tmp_path, 3, scale=2.0)
    bad = problem_of(table, scene=Scene(force_sd=4.0))
    assert {item.name: item.fixed for item in bad.parameters}["force_sd"] == 4.0
    flagged = [note for note in force_notes(bad, maximum_posterior(bad, values_of(bad))) if "MISFIT" in note]
    assert any("impulse of the force records is 2." in note for note in flagged)
    assert any("of their peak" in note for note in flagged)
    # With the misfit forbidden the stated noise is seen to be wrong.
    point = SimpleNamespace(values={**TRUTH, "force_misfit": 1e-3})
    assert any("stated noise" in note for note in force_notes(bad, point))
    good = problem_of(write_case(tmp_path, 3), scene=Scene(force_sd=4.0))
    assert not [note for note in force_notes(good, SimpleNamespace(values=TRUTH)) if "MISFIT" in note]


def test_records_follow_their_impacts(problem):
    left = withheld(problem, np.array([1, 3]))
    assert left.force.rows.tolist() == [0, 2, 4]
    with pytest.raises(FitError):
        withheld(problem, np.arange(5))
    # A record is never thinned away, whatever the rows asked for; impacts without one are.
    assert len(thinned_problem(problem, 3).impacts) == 5
    lone = replace(problem, force=problem.force.take(np.arange(1)))
    assert 0 in thinned_problem(lone, 2).force.rows and len(thinned_problem(lone, 2).impacts) < 5
    few = thinned_problem(replace(problem, force=problem.force.without(np.array([1, 3]))), 3)
    values = values_of(problem)
    whole = force_residuals(problem, problem.all_values(values)).reshape(5, -1)
    part = force_residuals(few, few.all_values(values)).reshape(len(few.impacts), -1)
    kept = [problem.table.ids.index(name) for name in few.table.ids]
    np.testing.assert_allclose(np.sum(part**2, axis=1), np.sum(whole[kept] ** 2, axis=1), rtol=1e-10)


def test_levels_have_their_own_force(tmp_path):
    """Two balls of different stiffness: each record is compared with that of its ball."""
    table = write_case(tmp_path, 2)
    rows = table.read_text().splitlines()
    labelled = [rows[0] + ",ball", *(f"{row},{'ab'[k % 2]}" for k, row in enumerate(rows[1:]))]
    table.write_text("\n".join(labelled) + "\n")
    case = problem_of(table, pool={"k_y": "ball"})
    own = {"k_y_spread": 0.5, "k_y_place[a]": 1.0, "k_y_place[b]": -1.0}
    columns = case.all_values(values_of(case, **own))
    soft = case.force_integrals(columns, case.force.rows, np.zeros((1, 5)), case.force.spacing, 3)[2][0]
    # Twice the centroid is roughly the contact, which goes with the root of the stiffness.
    assert soft[1] / soft[0] == pytest.approx(np.exp(0.5), rel=0.02)
    assert soft[2] == pytest.approx(soft[0], rel=0.02)
