"""Profiles under heavy tails, uncertain incident states and biases of groups, against the likelihood written out."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from samples import GRIP_SLIP, drop_table, problem_of, synthetic
from scipy.optimize import minimize
from scipy.stats import norm, t

from fitball.data.scene import Scene
from fitball.inference.calibrate import run
from fitball.inference.effort import Effort
from fitball.inference.identifiability import profile as profile_module
from fitball.inference.identifiability.profile import DROP_95, profiles
from fitball.inference.point.surface import Surface, surface_of
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.results.results import Verdict

LINE = {"cor_10": 0.76, "cor_slope": -0.014, "velocity_sd": 0.05, "degrees_of_freedom": 5.0}


def line(table, noise="normal", scene=None, offsets=None, **fix):
    flat = {"cor_10": "uniform(0, 1)", "cor_slope": "uniform(-0.1, 0.1)"}
    return build_problem(
        table, scene or Scene(), Choices(model="brody", priors=flat, noise=noise, fix=fix, offsets=offsets)
    )


def predicted(problem, a, b):
    v = problem.impacts.v_y1
    return (a + b * (v - 10.0)) * v


def lowest(cost, *starts):
    """The smallest value from several starts, by a simplex."""
    options = {"xatol": 1e-7, "fatol": 1e-8, "maxfev": 4000, "adaptive": True}
    return min(minimize(cost, start, method="Nelder-Mead", options=options).fun for start in starts)


def agree(found, name, held_cost, *starts):
    """A profile is the lowest of a cost with the parameter held, at every third of its points."""
    profile = found.by_name[name]
    best = lowest(lambda q: held_cost(q[0], q[1:]), *(np.array([profile.best, *start]) for start in starts))
    assert found.log_likelihood == pytest.approx(-best, abs=2e-3)
    for k in range(0, len(profile.values), 3):
        at = profile.values[k]
        assert profile.drop[k] == pytest.approx(lowest(lambda q, at=at: held_cost(at, q), *starts) - best, abs=5e-3)


@pytest.fixture
def outliers():
    """Twelve drops, two of them far off."""
    rng = np.random.default_rng(4)
    table = drop_table(rng, count=12)
    values = table.measurements[0].values.copy()
    values[[3, 9]] += [0.6, -0.5]
    return replace(table, measurements=(replace(table.measurements[0], values=values),))


def test_heavy_tails_are_profiled_on_students_likelihood(outliers):
    problem = line(outliers, "student-t")
    found = profiles(problem, [LINE])
    y = outliers.measurements[0].values

    def cost(slope, rest):
        a, sd, nu = rest[0], np.exp(rest[1]), np.exp(rest[2])
        if not (2.0 <= nu <= 100.0 and sd >= 1e-4):
            return 1e9
        return -t.logpdf(y - predicted(problem, a, slope), nu, 0.0, sd).sum()

    agree(found, "cor_slope", cost, [0.76, np.log(0.05), np.log(5.0)], [0.75, np.log(0.03), np.log(2.2)])
    heavy, plain = (item.by_name["cor_slope"] for item in (found, profiles(line(outliers), [LINE])))
    # Outliers count for less: that is what heavy tails are for, and the negative control.
    width = [np.diff(item.interval_95)[0] for item in (heavy, plain)]
    assert width[0] < 0.6 * width[1]


def test_uncertain_incidence_is_profiled_with_the_spread_it_gives():
    """A speed known to 0.2 m/s spreads the rebound by 0.2 times the slope of `(a + b (v - 10)) v`."""
    table = drop_table(np.random.default_rng(5), count=12, noise=0.15)
    covariance = np.zeros((12, 3, 3))
    covariance[:, 1, 1] = 0.2**2
    problem = line(replace(table, incident_covariance=covariance, incident_sd={"v_y1": np.full(12, 0.2)}))
    assert problem.errors is not None
    found = profiles(problem, [LINE])
    v, y = table.impacts.v_y1, table.measurements[0].values

    def cost(slope, rest):
        a, sd = rest[0], np.exp(rest[1])
        spread = np.hypot(sd, 0.2 * (a + slope * (2.0 * v - 10.0)))
        return -norm.logpdf(y, predicted(problem, a, slope), spread).sum() if sd >= 1e-4 else 1e9

    agree(found, "cor_slope", cost, [0.76, np.log(0.05)], [0.75, np.log(0.2)])
    exact = profiles(line(table), [LINE]).by_name["velocity_sd"].best
    assert found.by_name["velocity_sd"].best < 0.8 * exact


def test_the_general_surface_is_that_of_exact_noise_where_both_are_known(monkeypatch):
    problem = synthetic(problem_of("wang_all.csv", "grip-slip"), GRIP_SLIP, 4)
    assert surface_of(problem).closed
    expected = profiles(problem, [GRIP_SLIP])
    monkeypatch.setattr(profile_module, "surface_of", partial(Surface, closed=False))
    found = profiles(problem, [GRIP_SLIP])
    assert found.log_likelihood == pytest.approx(expected.log_likelihood, abs=1e-3)
    for name in problem.free_names:
        one, other = found.by_name[name], expected.by_name[name]
        assert one.ends == other.ends
        length = np.diff(other.interval_95)
        np.testing.assert_allclose(one.interval_95, other.interval_95, atol=float(0.01 * length[0]))


def test_biases_of_groups_count_as_the_model_has_them():
    """Biases are normal about zero: with a known noise that is generalised least squares."""
    table = drop_table(np.random.default_rng(6), count=10)
    groups = tuple("ab"[k % 2] for k in range(10))
    table = replace(table, labels={"group": groups})
    problem = line(table, offsets="group", velocity_sd=0.05)
    biases = [item for item in problem.free if "offset" in item.name]
    assert len(biases) == 2
    found = profiles(problem, [LINE | dict.fromkeys((item.name for item in biases), 0.0)]).by_name["cor_10"]
    v, y = table.impacts.v_y1, table.measurements[0].values
    same = np.equal.outer(groups, groups)
    weight = np.linalg.inv(0.05**2 * np.eye(10) + biases[0].prior.b ** 2 * same)
    x = np.stack([v, v * (v - 10.0)], axis=1)
    covariance = np.linalg.inv(x.T @ weight @ x)
    best = (covariance @ x.T @ weight @ y)[0]
    reach = np.sqrt(2.0 * DROP_95 * covariance[0, 0])
    np.testing.assert_allclose(found.interval_95, [best - reach, best + reach], rtol=1e-3)


def test_verdicts_under_heavy_tails_rest_on_profiles_too():
    problem = synthetic(problem_of("wang_all.csv", "grip-slip"), GRIP_SLIP, 4)
    problem = problem_of(problem.table, "grip-slip", noise="student-t")
    fit = run(problem, Effort(seed=2, cores=1, point_only=True))
    assert not fit.identifiability.profiles_missing
    verdicts = {name: item.verdict for name, item in fit.parameters.items()}
    # Normal noise has no heaviness of its tails to find.
    assert verdicts.pop("degrees_of_freedom") is Verdict.PRIOR_DOMINATED
    assert set(verdicts.values()) == {Verdict.IDENTIFIED}
