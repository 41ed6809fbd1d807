"""The density of many draws, against densities of scipy over rebounds made one by one."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from samples import polar_problem, problem_of
from scipy import stats
from test_missing_cells import GAPPY, WANG

import fitball
from fitball.data.table import Measurement
from fitball.errors import ParameterError
from fitball.inference.likelihood.posterior import densities, log_posterior
from fitball.inference.problem import problem as asked
from fitball.models.kernels.bounce import bounce_batch

SCENE = fitball.load_scene("wang_all.csv")
WEIGHED = replace(SCENE, ball_sd={"mass": 0.002, "inertia_ratio": 0.02})
STATED = 0.2 + 0.01 * np.arange(21)
TIMED = replace(
    GAPPY,
    measurements=(
        *(replace(item, sd=np.where(item.measured, STATED, np.nan)) for item in GAPPY.measurements[:1]),
        *GAPPY.measurements[1:],
        Measurement("contact_time", np.where(np.arange(21) % 2, 4.6e-3, np.nan)),
    ),
)  # fmt: skip
LEVELS = {"pool": {"mu": "group", "cor_10": "group"}, "offsets": "group"}
CASES = {
    "plain": lambda _folder: problem_of(WANG, scene=SCENE),
    "Student-t": lambda _folder: problem_of(WANG, scene=SCENE, noise="student-t"),
    "missing cells, stated sd, contact times": lambda _folder: problem_of(TIMED, scene=SCENE),
    "levels and offsets": lambda _folder: problem_of(GAPPY, scene=SCENE, noise="student-t", **LEVELS),
    "the ball's own": lambda _folder: problem_of(WANG, scene=WEIGHED, fix={"mu": 0.5}),
    "measured restitution": lambda _folder: problem_of(WANG, scene=SCENE, closures={"cor": "measured"}),
    "algebraic": lambda _folder: problem_of(GAPPY, "grip-slip", scene=WEIGHED, pool={"mu": "group"}),
    "speeds and angles": polar_problem,
}
DISTRIBUTIONS = {"uniform": False, "normal": True, "loguniform": False, "lognormal": True}


def log_prior(parameter, value):
    """From the words of the prior, with respect to its coordinate."""
    family, a, b = re.match(r"([\w-]+)\((\S+), (\S+)\)", parameter.prior.text).groups()
    if family == "half-t":
        bell, high = stats.t(float(b), 0.0, float(a)), parameter.spec.upper
        return bell.logpdf(value) - np.log(bell.cdf(high) - bell.cdf(max(parameter.spec.lower, 0.0)))
    low, high, a, b = parameter.spec.lower, parameter.spec.upper, float(a), float(b)
    if family.startswith("log"):
        value, low, high, a = np.log(value), np.log(low) if low > 0.0 else -np.inf, np.log(high), np.log(a)
        b = np.log(b) if family == "loguniform" else b
    if family.endswith("uniform"):
        low, high = max(low, a), min(high, b)
        return stats.uniform(low, high - low).logpdf(value)
    return stats.truncnorm((low - a) / b, (high - a) / b, a, b).logpdf(value)


def at_impact(problem, k, known):
    """The model's parameters at impact `k` of the table, those of its levels among them."""
    own = {name: known[name] for name in problem.model_names}
    for item in problem.pooling:
        label = item.labels[item.index[k]]
        shift = known[f"{item.parameter}_spread"] * known[f"{item.parameter}_place[{label}]"]
        own[item.parameter] = known[item.parameter] * np.exp(shift) if item.log else known[item.parameter] + shift
    return own


def oracle(problem, values):
    """Prior, scene and likelihood of one draw, cell by cell; the last None where an impact has no answer."""
    known = {item.name: item.fixed for item in problem.parameters} | dict(
        zip(problem.free_names, values, strict=True)
    )
    prior = sum(log_prior(item, value) for item, value in zip(problem.free, values, strict=True))
    times, likelihood = [], 0.0
    for k in range(len(problem.impacts)):
        try:
            rebound = problem.model.rebound(at_impact(problem, k, known), problem.impacts.take(np.array([k])))
        except ParameterError:
            return prior, 0.0, None
        times.append(rebound.contact_time[0])
        v_x, v_y = rebound.v_x2[0], rebound.v_y2[0]
        said = {
            "v_x2": v_x, "v_y2": v_y, "omega_2": rebound.omega_2[0], "contact_time": times[-1],
            "v_2": np.sqrt(v_x**2 + v_y**2), "theta_2": np.angle(v_x + 1j * v_y),
        }  # fmt: skip
        for item in problem.observables:
            measured = problem.table.measurement(item.name)
            if np.isnan(measured.values[k]):
                continue
            sd = known[item.noise]
            if item.name == "theta_2" and item.noise == "velocity_sd":
                sd = sd / said["v_2"]
            if measured.sd is not None:
                sd = np.hypot(sd, measured.sd[k])
            bias = 0.0
            if problem.group_bias is not None:
                bias = known[f"{item.name}_offset[{problem.table.labels[problem.group_bias.column][k]}]"]
            noise = stats.norm if problem.noise.name == "normal" else stats.t(known["degrees_of_freedom"])
            likelihood += noise.logpdf((measured.values[k] - bias - said[item.name]) / sd) - np.log(sd)
    scene = 0.0
    if problem.contact_time is not None:
        scene = stats.norm(*problem.contact_time).logpdf(np.mean(times))
    return prior, scene, likelihood


def drawn(problem, count=400):
    values = problem.prior.draw(np.random.default_rng(3), count)
    return values, problem.to_coordinates(values)


@pytest.mark.parametrize("case", CASES)
def test_the_density_is_that_of_scipy_over_single_rebounds(case, tmp_path):
    problem = CASES[case](tmp_path)
    values, coordinates = drawn(problem)
    total, parts, before = log_posterior(problem, coordinates), densities(problem, values), densities(
        problem, values, measured=False
    )  # fmt: skip
    possible, impossible = np.flatnonzero(np.isfinite(total))[:5], np.flatnonzero(np.isinf(total))[:3]
    assert possible.size == 5
    for k in (*possible, *impossible):
        prior, scene, likelihood = oracle(problem, values[k])
        if likelihood is None:
            assert total[k] == -np.inf
            assert not parts.possible[k]
            assert not before.possible[k]
            continue
        assert parts.possible[k]
        assert before.possible[k]
        np.testing.assert_allclose(
            (total[k], parts.scene[k], parts.likelihood[k], before.scene[k], before.likelihood[k]),
            (prior + scene + likelihood, scene, likelihood, scene, 0.0), rtol=1e-10, atol=1e-9,
        )  # fmt: skip
    # Rebounds were asked of the kernel as elsewhere: nothing was compiled twice.
    assert len(bounce_batch.signatures) <= 1


def test_outside_the_bounds_and_without_a_number_there_is_no_density():
    problem = CASES["plain"](None)
    _, coordinates = drawn(problem)
    good = coordinates[np.argmax(log_posterior(problem, coordinates))]
    trials = np.tile(good, (3 * problem.dimension + 1, 1))
    low, high = problem.prior.limits
    for k in range(problem.dimension):
        trials[3 * k : 3 * k + 3, k] = low[k] - 1e-9, high[k] + 1e-9 * abs(high[k]), np.nan
    scores = log_posterior(problem, trials)
    assert np.isfinite(scores[-1])
    np.testing.assert_array_equal(scores[:-1], -np.inf)


def test_levels_beyond_the_bounds_of_their_parameter_have_no_density():
    problem = problem_of(WANG, "grip-slip", scene=SCENE, pool={"mu": "group"})
    values, _ = drawn(problem)
    values[:, problem.free_names.index("mu_spread")] = 2.0
    values[:, problem.free_names.index("mu_place[topspin]")] = np.linspace(-6.0, 6.0, len(values))
    mu = values[:, problem.free_names.index("mu")]
    shift = 2.0 * np.linspace(-6.0, 6.0, len(values))
    level = mu * np.exp(shift) if problem.pooling[0].log else mu + shift
    low, high = problem.pooling[0].bounds
    outside = (level < low) | (level > high)
    assert 0 < np.count_nonzero(outside) < len(values)
    possible = densities(problem, values).possible
    assert possible.any()
    assert not possible[outside].any()


def test_a_draws_density_depends_on_no_other_draw_and_on_no_thread(monkeypatch):
    problem = CASES["levels and offsets"](None)
    _, coordinates = drawn(problem, 800)
    whole = log_posterior(problem, coordinates)
    apart = np.concatenate([log_posterior(problem, part) for part in np.array_split(coordinates, 7)])
    np.testing.assert_array_equal(whole, apart)
    monkeypatch.setattr(asked, "LARGE_BATCH", 10)
    np.testing.assert_array_equal(whole, log_posterior(replace(problem, threads=2), coordinates))
    np.testing.assert_array_equal(whole[:1], log_posterior(replace(problem, threads=2), coordinates[:1]))
