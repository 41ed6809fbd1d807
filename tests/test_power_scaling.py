"""Power-scaling against the published formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import GRIP_SLIP, coordinates_of, problem_of, synthetic

from fitball.data.read import load_table
from fitball.inference.calibrate import run
from fitball.inference.effort import Effort
from fitball.inference.identifiability.examine import WEAK, diagnosis, power_evidence, sensitivities
from fitball.inference.identifiability.information import fisher_information
from fitball.inference.identifiability.verdict import CONFLICT
from fitball.inference.likelihood.posterior import log_likelihood
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.results.results import Posterior


def cumulative_jensen_shannon(x, weights):
    """Kallioinen et al. (2023), Eq. (6) and its root, the larger of x and -x, in bits."""
    found = []
    for column in (x, -x):
        order = np.argsort(column)
        width = np.diff(column[order])
        p = np.arange(1, x.size) / x.size
        q = np.cumsum(weights[order])[:-1]
        middle = 0.5 * (p + q)
        one, other = (
            np.sum(width * (a * np.log2(a / middle))) + 0.5 / np.log(2.0) * np.sum(width * (b - a))
            for a, b in ((p, q), (q, p))
        )
        found.append(np.sqrt((one + other) / np.sum(width * (p + q))))
    return max(found)


def normal_draws(problem, truth, seed):
    """Independent draws of a normal posterior made by hand: no sampler has to converge for this."""
    rng = np.random.default_rng(seed)
    at = coordinates_of(problem, truth)
    information = fisher_information(problem, at, scene=True)
    scale = problem.prior.width * np.array([1.0 if item.prior.bell else 12.0**-0.5 for item in problem.free])
    covariance = np.linalg.inv(information + np.eye(at.size)) * np.outer(scale, scale)
    return problem.to_values(rng.multivariate_normal(at, covariance, 3000))


def drawn(problem):
    values = normal_draws(problem, GRIP_SLIP, 5)
    return values, Posterior(problem.free_names, values[None, :, None, :], np.zeros((1, 3000, 1)), values)


def test_where_levels_lie_among_the_others_is_no_prior():
    """Of a pooled parameter the spread is prior; the places are the model's."""
    table = load_table("wang_all.csv")
    table = replace(table, labels={"surface": tuple("ab"[k % 2] for k in range(len(table)))}, redundant=())
    problem = problem_of(table, "grip-slip", pool={"mu": "surface", "cor_10": "none"})
    truth = GRIP_SLIP | {"mu_spread": 0.1, "mu_place[a]": 0.2, "mu_place[b]": -0.2}
    rng = np.random.default_rng(2)
    at = coordinates_of(problem, {name: truth[name] for name in problem.free_names})
    scale = 0.05 * problem.prior.width * np.where(["_place" in name for name in problem.free_names], 10.0, 1.0)
    values = problem.to_values(at + scale * np.abs(rng.standard_normal((2000, at.size))))
    posterior = Posterior(problem.free_names, values[None, :, None, :], np.zeros((1, 2000, 1)), values)
    found = power_evidence(problem, posterior)
    coordinates = problem.to_coordinates(values)
    stated = sum(
        item.prior.log_density(coordinates[:, k]) for k, item in enumerate(problem.free) if "_place" not in item.name
    )
    for k, name in enumerate(problem.free_names):
        assert found[name].prior == pytest.approx(float(sensitivities(coordinates, stated)[k]), abs=1e-7)
        assert (found[name].own_prior == 0.0) == ("_place" in name)


def test_power_scaling_is_the_published_formula():
    problem = synthetic(problem_of("wang_all.csv", "grip-slip"), GRIP_SLIP, 4)
    values, posterior = drawn(problem)
    found = power_evidence(problem, posterior)
    coordinates = problem.to_coordinates(values)
    likelihood = log_likelihood(problem, values, problem.rebound(values))
    own = {name: problem.free[k].prior.log_density(coordinates[:, k]) for k, name in enumerate(problem.free_names)}
    for k, name in enumerate(problem.free_names):
        parts = {"likelihood": likelihood, "prior": sum(own.values()), "own_prior": own[name]}
        for part, density in parts.items():
            slopes = []
            for power in (0.99, 1.01):
                weights = np.exp((power - 1.0) * (density - density.max()))
                distance = cumulative_jensen_shannon(coordinates[:, k], weights / weights.sum())
                slopes.append(distance / abs(np.log2(power)))
            # Smoothing of the largest weights changes little at powers so near one.
            assert getattr(found[name], part) == pytest.approx(np.mean(slopes), rel=0.05), part
    assert sensitivities(values, np.full(3000, 2.0)).tolist() == [0.0] * problem.dimension


def test_a_strong_wrong_prior_is_flagged_and_a_wide_one_is_not():
    problem = synthetic(problem_of("wang_all.csv", "grip-slip"), GRIP_SLIP, 6)
    effort = Effort(seed=1, cores=1, walkers=16, max_steps=600)
    fits = {}
    # 0.85 is seven of its own sds and nine of the table's from the truth, 0.76.
    for prior in ("normal(0.75, 0.15)", "normal(0.85, 0.012)"):
        choices = Choices(model="grip-slip", priors={"cor_10": prior})
        fits[prior] = run(build_problem(problem.table, problem.scene, choices), effort)
    wide, wrong = (fit.identifiability.evidence["cor_10"] for fit in fits.values())
    assert wide.power.diagnosis == ""
    assert wrong.power.diagnosis == CONFLICT
    assert wrong.power.own_prior > 0.05
    reasons = [fit.parameters["cor_10"].reason for fit in fits.values()]
    assert ["prior and data disagree" in reason for reason in reasons] == [False, True]
    # The profile knows no prior: it is the same under both.
    for left, right in zip(wide.profile.interval_95, wrong.profile.interval_95, strict=True):
        assert left == pytest.approx(right, rel=1e-3)
    assert diagnosis(0.2, 0.01) == WEAK
    assert diagnosis(0.04, 0.01) == ""
