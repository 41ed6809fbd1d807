"""Stated errors and the scatter beyond them: likelihood, what is found, predictions and plans."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import problem_of
from scipy import stats

import fitball
from fitball.bench.problems import BASE
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.errors import ParameterError
from fitball.inference.design.asked import as_before, parse_sensor
from fitball.inference.identifiability.information import fisher_information
from fitball.inference.likelihood.cells import cells
from fitball.inference.likelihood.posterior import log_likelihood, log_posterior
from fitball.inference.point.point_fit import maximum_posterior
from fitball.inference.point.surface import surface_of
from fitball.inference.prediction.new_impacts import observed_observables
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.observables import expected_prior, noise_by_column
from fitball.inference.problem.problem import Choices
from fitball.inference.results.results import Verdict
from fitball.values import Impacts

TRUTH = {**BASE, "e_x": 0.1, "offset": 2.4e-3}
ERRORS = {"v_x2": 0.02, "v_y2": 0.02, "omega_2": 1.0}
SCATTER = {"v_x2": 0.15, "v_y2": 0.15, "omega_2": 3.0}
NOISES = {"v_x2": "v_x_sd", "v_y2": "v_y_sd", "omega_2": "spin_sd"}


def careful(count, seed, scatter=1.0, stated=tuple(ERRORS)):
    """A table of grip-slip rebounds, measured within `ERRORS`, of balls that scatter by a share of `SCATTER`."""
    rng, chosen = np.random.default_rng(seed), fitball.model("grip-slip")
    theta, speed = np.radians(np.linspace(16.0, 65.0, count)), rng.uniform(14.0, 22.0, count)
    seen = Impacts(speed * np.cos(theta), speed * np.sin(theta), rng.uniform(-150.0, 200.0, count))
    row = np.array([[TRUTH[name] for name in chosen.parameter_names]])
    made, table = chosen.evaluate(chosen.parameter_names, row, seen), load_table("wang_all.csv")
    measured = tuple(
        replace(
            item,
            values=getattr(made, item.name)[0]
            + np.hypot(ERRORS[item.name], scatter * SCATTER[item.name]) * rng.standard_normal(count),
            sd=np.full(count, ERRORS[item.name]) if item.name in stated else None,
        )
        for item in table.measurements
    )
    return replace(
        table, impacts=seen, measurements=measured, redundant=(), labels={}, notices=(),
        ids=tuple(map(str, range(count))), resolution={},
    )  # fmt: skip


def posed(table, scene=None, **choices):
    return build_problem(table, scene or Scene(), Choices(model="grip-slip", **choices))


def at(problem, **noise):
    known = {**TRUTH, "v_x_sd": 0.11, "v_y_sd": 0.17, "spin_sd": 2.2, "velocity_sd": 0.14, **noise}
    return problem.to_coordinates(np.array([[known[name] for name in problem.free_names]]))


def test_stated_errors_and_scatter_add_in_squares():
    problem = posed(careful(20, 1))
    x = at(problem)
    rebound = problem.rebound(problem.to_values(x))
    expected = 0.0
    for item in problem.table.measurements:
        size = np.hypot(ERRORS[item.name], {"v_x2": 0.11, "v_y2": 0.17, "omega_2": 2.2}[item.name])
        expected += stats.norm.logpdf(item.values, getattr(rebound, item.name)[0], size).sum()
    assert log_likelihood(problem, problem.to_values(x), rebound)[0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("noise", ["normal", "student-t"])
@pytest.mark.parametrize("asked", [{}, {"velocity_noise": "tied"}, {"priors": {"v_x_sd": "lognormal(0.1, 0.5)"}}])
def test_derivatives_of_scatter_are_exact(noise, asked):
    """Of angles too, whose scatter falls with the rebound speed where they share that of velocities."""
    tables = [careful(12, 2)]
    if "priors" not in asked:
        polar = careful(12, 2)
        angle = np.arctan2(polar.measurements[1].values, polar.measurements[0].values)
        speed = np.hypot(*(item.values for item in polar.measurements[:2]))
        tables.append(
            replace(
                polar,
                measurements=(
                    replace(polar.measurements[0], name="v_2", values=speed),
                    replace(polar.measurements[1], name="theta_2", values=angle, sd=np.full(12, 0.002)),
                    polar.measurements[2],
                ),
            )
        )
    for table in tables:
        problem = posed(table, noise=noise, **asked)
        x = at(problem, speed_sd=0.1, angle_sd=0.004, degrees_of_freedom=6.0)
        surface = replace(surface_of(problem), closed=False, penalised=True)
        columns = surface.from_values(problem.to_values(x))
        gradient, _ = surface.linearised(columns, surface.free(columns))
        steps = 1e-5 * np.diag(surface.width)
        up, down = (surface.cost(columns + side * steps, surface.free(columns + steps)) for side in (1.0, -1.0))
        slopes = (up - down) / (2e-5 * surface.width)
        np.testing.assert_allclose(gradient[0] * surface.width, slopes * surface.width, rtol=2e-6, atol=2e-5)


def test_information_about_scatter_is_that_of_the_likelihood():
    problem = posed(careful(12, 3), velocity_noise="separate")
    x = at(problem)[0]
    found = fisher_information(problem, x, scene=False)
    for name, column in (("v_x_sd", "v_x2"), ("spin_sd", "omega_2")):
        k = problem.free_names.index(name)
        size = problem.to_values(x[None, :])[0, k]
        # Of n normal deviations with the variance e^2 + s^2, by hand: 2 n s^2/(e^2 + s^2)^2.
        exact = 2.0 * 12 * size**2 / (ERRORS[column] ** 2 + size**2) ** 2
        assert found[k, k] == pytest.approx(exact * problem.prior.width[k] ** 2, rel=1e-9)


def test_a_scatter_that_has_vanished_has_information():
    """About its square, which is known to e^2 sqrt(2/n): so it may go as far as the root of that."""
    problem = posed(careful(50, 4, scatter=0.0))
    x = at(problem, v_x_sd=1e-4, v_y_sd=1e-4, spin_sd=1e-2)[0]
    k = problem.free_names.index("v_x_sd")
    error = problem.prior.width[k] / np.sqrt(fisher_information(problem, x, scene=False)[k, k])
    assert 0.5 * 0.02 * (2.0 / 50) ** 0.25 < error < 2.0 * 0.02 * (2.0 / 50) ** 0.25


def test_what_is_asked_decides_which_noises_are_fitted():
    both, one = careful(20, 5), careful(20, 5, stated=("v_x2", "omega_2"))
    assert posed(both).free_names[-3:] == ("v_x_sd", "v_y_sd", "spin_sd")
    assert not {"v_x_sd", "v_y_sd", "spin_sd"} & {*posed(both, velocity_noise="stated").free_names}
    assert posed(both, velocity_noise="tied").free_names[-2:] == ("velocity_sd", "spin_sd")
    # A column that states none has its own noise, whatever the others do.
    mixed = posed(one)
    assert {item.name: item.noise for item in mixed.observables} == {
        "v_x2": "v_x_sd", "v_y2": "velocity_sd", "omega_2": "spin_sd",
    }  # fmt: skip
    assert [item.noise for item in posed(one, velocity_noise="stated").observables] == [None, "velocity_sd", None]
    # Few rows share a scatter, as they share a noise.
    assert {item.noise for item in posed(careful(7, 5)).observables} == {"velocity_sd", "spin_sd"}
    with pytest.raises(ParameterError, match="states no sd of a rebound column"):
        noise_by_column(load_table("wang_all.csv"), "stated", set(), 0, [])


def test_priors_and_values_of_scatter():
    table = careful(20, 6)
    named = {parameter.name: parameter for parameter in posed(table).parameters}
    for name, text in (("v_x_sd", "half-t(0.25, 4)"), ("spin_sd", "half-t(10, 4)")):
        assert named[name].prior.text == text == expected_prior(name, Scene(), table, scatter=True)
        assert named[name].spec.meaning.startswith("scatter of ")
    known = posed(table, Scene(v_x_sd=0.1))
    assert {item.name: item.fixed for item in known.parameters}["v_x_sd"] == 0.1
    x = at(known)
    made = cells(known, x)
    np.testing.assert_allclose(np.exp(made.log_sd[0, :20]), np.hypot(0.02, 0.1))
    # None at all may be chosen: the stated errors alone.
    fixed = dict.fromkeys(NOISES.values(), 0.0)
    bare, stated = posed(table, fix=fixed), posed(table, velocity_noise="stated")
    assert log_posterior(bare, at(bare))[0] == pytest.approx(log_posterior(stated, at(stated))[0], rel=1e-12)
    with pytest.raises(ParameterError, match="lies outside its bounds"):
        posed(load_table("wang_all.csv"), fix={"v_x_sd": 0.0})


@pytest.mark.parametrize("scatter", [0.0, 1.0])
def test_the_maximum_finds_the_scatter_there_is(scatter):
    problem = posed(careful(200, 7, scatter=scatter))
    starts = problem.to_values(np.concatenate([at(problem), at(problem, v_x_sd=1.0, v_y_sd=0.01, spin_sd=20.0)]))
    point = maximum_posterior(problem, starts)
    for column, name in NOISES.items():
        if scatter:
            assert point.values[name] == pytest.approx(SCATTER[column], rel=0.2)
        else:
            assert point.values[name] < ERRORS[column]
    # Nothing higher is near, by the posterior itself.
    x = problem.to_coordinates(problem.free_rows([point.values]))
    around = x + 1e-3 * problem.prior.width * np.concatenate([np.eye(problem.dimension), -np.eye(problem.dimension)])
    assert np.all(log_posterior(problem, around) <= point.log_posterior + 1e-5)


def test_a_fit_without_scatter_says_so_and_one_with_scatter_finds_it():
    still = fitball.calibrate(careful(20, 8, scatter=0.0), scene=Scene(), model="grip-slip")
    moved = fitball.calibrate(careful(20, 8), scene=Scene(), model="grip-slip")
    for column, name in NOISES.items():
        at_rest, found = (*(next(item for item in fit.reported if item.name == name) for fit in (still, moved)),)
        assert at_rest.verdict is Verdict.ONE_SIDED and at_rest.reason.startswith("no scatter beyond the stated")
        assert found.verdict in (Verdict.IDENTIFIED, Verdict.GIVEN)
        low, high = np.quantile(moved.draws()[name], [0.01, 0.99])
        assert low < SCATTER[column] < high
    for name in ("mu", "cor_10", "e_x"):
        for fit in (still, moved):
            low, high = np.quantile(fit.draws()[name], [0.001, 0.999])
            assert low < TRUTH[name] < high
        widths = [np.std(fit.draws()[name]) for fit in (still, moved)]
        assert widths[1] > 2.0 * widths[0]


def test_predictions_scatter_and_scores_add_the_stated_error():
    fit = fitball.calibrate(careful(20, 9), scene=Scene(), model="grip-slip")
    other = careful(12, 10)
    measured, _ = observed_observables(fit.predicting, other)
    new, scored = fit.predict_interval(other.impacts), fit.predict_interval(other.impacts, measured)
    size = float(np.sqrt(np.mean(fit.draws()["v_x_sd"] ** 2)))
    mine, its = (one.output("v_x2") for one in (new, scored))
    clear = np.ptp(mine.rebound, axis=0) < 0.2
    assert np.median(mine.sd[clear]) == pytest.approx(size, rel=0.2)
    np.testing.assert_allclose(np.median(its.sd**2 - mine.sd**2), 0.02**2, atol=3e-3)


def test_planned_sensors_have_their_own_error_and_the_balls_scatter():
    problem = problem_of(careful(20, 11), "grip-slip")
    columns = problem.all_values(problem.to_values(at(problem)))
    rebound = problem.rebound(problem.to_values(at(problem)))
    for sensor, error in (
        (as_before(problem), 0.02), (parse_sensor(problem, "camera=0.5"), 0.01),
        (parse_sensor(problem, "v_x2=0.3m/s"), 0.3),
    ):  # fmt: skip
        along = next(item for item in sensor.columns if item.name == "v_x2")
        np.testing.assert_allclose(along.sds(columns, rebound), np.hypot(error, 0.11))


def test_a_point_fit_without_scatter_has_profiles():
    """A noise that ends at zero leaves no maximum; scatter beside stated errors may."""
    still = fitball.calibrate(careful(20, 8, scatter=0.0), scene=Scene(), model="grip-slip", point_only=True)
    verdicts = {item.name: item.verdict for item in still.reported}
    assert verdicts["cor_10"] in (Verdict.IDENTIFIED, Verdict.GIVEN)
    assert Verdict.NOT_JUDGED not in verdicts.values()
