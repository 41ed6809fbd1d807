"""Levels of a pooled parameter are sampled right, and soon: against integration of the hierarchy by quadrature."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import integrate, stats

from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.parameters import JointPrior, build_parameters, parse_prior
from fitball.inference.problem.pooling import Pooling
from fitball.inference.sampling import ensemble as walking
from fitball.inference.sampling import ensembles as sampling
from fitball.inference.sampling.convergence import standard_errors, summaries
from fitball.inference.sampling.ensembles import Schedule, Settings, sample
from fitball.inference.sampling.level_coordinates import (
    LevelCoordinates,
    Straight,
    straight_coordinates,
    taught_level,
)

MU = "lognormal(0.6, 0.3)"
LIKE = {"far apart": ([-0.38, -0.70], [0.014, 0.015]), "alike": ([-0.51, -0.50], [0.011, 0.016]),
        "of unequal weight": ([-0.35, -0.70, -0.45, -0.55, -0.2], [0.01, 0.02, 0.1, 0.4, 2.0])}  # fmt: skip


def hierarchy(measured, errors):
    """As much of a problem as the sampler sees: levels of `mu`, each measured once with a known error."""
    labels = tuple(f"l{k}" for k in range(len(measured)))
    pooling = Pooling("mu", "surface", labels, True, (0.01, 3.0), np.arange(len(labels)))
    specs = {"mu": SimpleNamespace(name="mu", prior=MU, lower=1e-3, upper=1e3, unit="")}
    parameters = build_parameters(["mu"], specs, {}, {}, (), pooling.specs("", parse_prior("mu", MU, 1e-3, 1e3)))
    names = tuple(item.name for item in parameters)
    return SimpleNamespace(
        dimension=len(names), free_names=names, free=parameters, parameters=parameters, pooling=(pooling,),
        prior=JointPrior(tuple(item.prior for item in parameters)), measured=np.array(measured),
        errors=np.array(errors),
    )  # fmt: skip


def density(problem, x):
    levels = x[:, :1] + x[:, 1:2] * x[:, 2:]
    return problem.prior.log_density(x) - 0.5 * np.sum(((levels - problem.measured) / problem.errors) ** 2, axis=1)


def spread_and_common(problem):
    """Distribution functions of the spread and the common value's coordinate, places and the common value being
    integrated out in closed form and the spread by the trapezoidal rule.
    """
    tau = np.geomspace(1e-7, 6.0, 6001)
    a, b = np.log(0.6), 0.3
    variance = problem.errors**2 + tau[:, None] ** 2
    weight = 1.0 / variance
    precision = 1.0 / b**2 + weight.sum(axis=1)
    middle = (a / b**2 + weight @ problem.measured) / precision
    quadratic = a**2 / b**2 + weight @ problem.measured**2 - precision * middle**2
    log = -0.5 * (quadratic + np.log(precision) + np.log(variance).sum(axis=1)) + stats.t(4, 0, 0.2).logpdf(tau)
    mass = np.exp(log - log.max())
    whole = integrate.trapezoid(mass, tau)
    below = integrate.cumulative_trapezoid(mass, tau, initial=0.0) / whole

    def common(value):
        return integrate.trapezoid(mass * stats.norm(middle, precision**-0.5).cdf(value), tau) / whole

    return (lambda value: float(np.interp(value, tau, below))), common


def run(problem, monkeypatch):
    for module in (sampling, walking):
        monkeypatch.setattr(module, "log_posterior", density)
    settings = Settings(24, 2, 900, 1, 3, Schedule(warm_up=300, first_check=900))
    optimum = np.array([[-0.5, 0.2, *((problem.measured + 0.5) / 0.2)]])
    return sample(problem, optimum, settings, None, False, lambda _progress: None)


def misses(problem, found):
    """By how many standard errors the levels that quantiles of spread and common value stand for are missed."""
    exact, far = spread_and_common(problem), []
    for column, distribution in ((1, exact[0]), (0, exact[1])):
        chains = found.kept[..., column]
        errors = standard_errors(chains)
        for name, value in summaries(chains).items():
            if name == "sd":
                continue
            level = {"median": 0.5}.get(name) or float(f"0.{name[1:]}")
            step = errors[name]
            slope = (distribution(value + step) - distribution(value - step)) / 2.0
            far.append(abs(distribution(value) - level) / slope)
    return np.array(far)


@pytest.mark.parametrize("case", LIKE)
def test_spread_and_common_value_agree_with_quadrature(case, monkeypatch):
    problem = hierarchy(*LIKE[case])
    found = run(problem, monkeypatch)
    assert misses(problem, found).max() < 5.0
    assert found.convergence.max_r_hat < 1.02


def test_moves_that_forget_half_of_the_volume_are_noticed(monkeypatch):
    """The control: what the test above compares is then far away."""
    exact = LevelCoordinates.straighten

    def halved(self, coordinates):
        straight, volume = exact(self, coordinates)
        return straight, 0.5 * volume

    monkeypatch.setattr(LevelCoordinates, "straighten", halved)
    problem = hierarchy(*LIKE["alike"])
    assert misses(problem, run(problem, monkeypatch)).max() > 8.0


def test_straight_moves_mix_where_others_do_not(monkeypatch):
    """Two surfaces that are well known: the same steps are worth several times as much."""
    problem = hierarchy(*LIKE["far apart"])
    straight = run(problem, monkeypatch).convergence.min_ess
    monkeypatch.setattr(sampling, "straight_coordinates", lambda _problem, _taught: Straight())
    assert straight > 3.0 * run(problem, monkeypatch).convergence.min_ess


def test_a_fit_without_pooling_moves_as_ever():
    problem = build_problem(load_table("wang_zero_spin.csv"), Scene(), Choices(model="brody"))
    assert straight_coordinates(problem, np.empty((0, problem.dimension))) == Straight()


CASES = {
    "one parameter": Choices(pool={"mu": "surface"}),
    "two parameters": Choices(pool={"mu": "surface", "cor_10": "ball"}),
    "a common value that is held": Choices(pool={"mu": "surface"}, fix={"mu": 0.6}),
    "a level that is held": Choices(pool={"mu": "surface"}, fix={"mu_place[b]": 0.3}),
    "a spread by its logarithm": Choices(pool={"mu": "surface"}, priors={"mu_spread": "lognormal(0.2, 0.5)"}),
    "a spread that is held": Choices(pool={"mu": "surface"}, fix={"mu_spread": 0.2}),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_straight_coordinates_have_an_inverse_and_a_volume(case):
    labels = {"surface": tuple("aabbbcc" * 3), "ball": tuple("xxxxyyy" * 3)}
    table = load_table("wang_all.csv")
    table = type(table)(**{**vars(table), "labels": labels})
    choices = CASES[case]
    problem = build_problem(table, Scene(), replace(choices, pool={"all": "none", **choices.pool}))
    x = problem.to_coordinates(problem.prior.draw(np.random.default_rng(1), 40))
    straight = straight_coordinates(problem, x)
    assert len(straight.levels) == (2 if case == "two parameters" else 0 if case == "a spread that is held" else 1)
    there, volume = straight.straighten(x)
    np.testing.assert_allclose(straight.bend(there), x, rtol=1e-9, atol=1e-9)
    for row in range(0, 40, 13):
        step = 1e-6 * np.maximum(np.abs(x[row]), 1e-3)
        ends = [straight.straighten(x[row] + side * np.diag(step))[0] for side in (1.0, -1.0)]
        jacobian = (ends[0] - ends[1]) / (2.0 * step[:, None])
        assert volume[row] == pytest.approx(np.linalg.slogdet(jacobian)[1], abs=1e-4)


def test_what_a_table_says_of_a_level_is_learnt_from_draws():
    """Draws of a level that was measured at -0.4 +- 0.02, whatever common value and spread."""
    rng = np.random.default_rng(2)
    q, tau = rng.normal(-0.5, 0.2, 4000), np.abs(rng.normal(0.0, 0.3, 4000))
    error = 0.02
    shrunk = 1.0 / (1.0 / error**2 + 1.0 / tau**2)
    level = rng.normal(shrunk * (-0.4 / error**2 + q / tau**2), np.sqrt(shrunk))
    mean, precision = taught_level(level, q, tau)
    assert mean == pytest.approx(-0.4, abs=0.003)
    assert precision**-0.5 == pytest.approx(error, rel=0.1)
    # One that was not measured follows its prior.
    _, precision = taught_level(q + tau * rng.standard_normal(4000), q, tau)
    assert precision < 1.0
