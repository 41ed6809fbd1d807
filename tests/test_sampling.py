"""Draws of posteriors: an exact one by chains and by weights, chains that have not converged,
diagnostics.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.density import REBOUND, problem_of, scene_of, table_of
from support.line import exact, line_problem

from fitball.base.errors import FitError
from fitball.inference.effort import Effort
from fitball.inference.sampling import chains
from fitball.inference.sampling import sample as sampling
from fitball.inference.sampling.convergence import Mixing
from fitball.inference.sampling.importance import Student
from fitball.inference.sampling.sample import sample
from fitball.inference.search.best_fit import best_fit
from fitball.inference.search.objective import Objective


def quiet(_stage, _share):
    """Nothing is shown."""


def start_proposals(problem):
    """The normal density that touches the posterior at a maximum."""
    best = best_fit(problem, np.random.default_rng(0)).optima[0]
    q = problem.coordinates(best)
    _, (curvature,) = Objective(problem).linearised(q[None])
    curvature = curvature + np.diag(1e-8 / problem.prior.width**2)
    covariance = np.linalg.inv(curvature)
    return [Student(q, np.linalg.cholesky(covariance))]


def check_moments(problem, posterior, size):
    """The moments of a straight line, within four standard errors of so many draws."""
    centre, covariance = exact(problem)
    values = posterior.values.reshape(-1, 2)
    sds = np.sqrt(np.diagonal(covariance))
    shift = values.mean(axis=0) - centre
    assert np.all(np.abs(shift) < 4.0 * sds / np.sqrt(size))
    assert_allclose(values.std(axis=0) / sds, 1.0, atol=4.0 / np.sqrt(2.0 * size))
    correlation = covariance[0, 1] / sds.prod()
    assert np.corrcoef(values.T)[0, 1] == pytest.approx(correlation, abs=0.02)
    best = values[posterior.log_density.argmax()]
    assert np.all(np.abs(best - centre) < 0.2 * sds)


def test_chains_have_the_moments_of_the_exact_posterior(monkeypatch):
    problem = line_problem()
    stages = []
    shares = []

    def shown(stage, share):
        stages.append(stage)
        shares.append(share)

    posterior, diagnostics = sample(problem, start_proposals(problem), Effort(), shown)
    assert diagnostics.converged
    assert diagnostics.complaints == ()
    assert diagnostics.pareto_k is None
    assert max(diagnostics.r_hat.values()) < 1.01
    assert min(diagnostics.ess_bulk.values()) > 1000.0
    assert min(diagnostics.ess_tail.values()) > 1000.0
    steps = diagnostics.steps - diagnostics.warm_up
    assert posterior.values.shape == (4, steps, 16, 2)
    check_moments(problem, posterior, 1000.0)
    monkeypatch.setattr(sampling, "TARGET_R_HAT", min(diagnostics.r_hat.values()))
    _, worse = sample(problem, start_proposals(problem), Effort(), quiet)
    assert worse.r_hat == diagnostics.r_hat
    assert not worse.converged
    assert len(worse.complaints) == 2
    assert set(stages) == {"sampling"}
    assert min(shares) >= 0.0
    assert max(shares) <= 1.0


def test_weighted_draws_of_a_long_table_have_them_too(monkeypatch):
    problem = line_problem(copies=2)
    monkeypatch.setattr(sampling, "LONG_ROWS", 20)
    posterior, diagnostics = sample(problem, start_proposals(problem), Effort(), quiet)
    assert diagnostics.converged
    assert diagnostics.r_hat is None
    assert diagnostics.pareto_k < 0.7
    ensembles, _, walkers, _ = posterior.values.shape
    assert ensembles == 1
    assert walkers == 1
    check_moments(problem, posterior, min(diagnostics.ess_bulk.values()))
    for name, value in (("RELIABLE_K", diagnostics.pareto_k - 0.01), ("SPARE", 0.3)):
        with monkeypatch.context() as patch:
            patch.setattr(sampling, name, value)
            _, worse = sample(problem, start_proposals(problem), Effort(), quiet)
        assert not worse.converged
        assert len(worse.complaints) == 1


@pytest.mark.parametrize("long", [20, 3000])
def test_the_same_seed_gives_the_same_bytes(long, monkeypatch):
    problem = line_problem(copies=2)
    effort = Effort(seed=7, max_steps=100)
    monkeypatch.setattr(sampling, "LONG_ROWS", long)
    first, _ = sample(problem, start_proposals(problem), effort, quiet)
    again, _ = sample(problem, start_proposals(problem), effort, quiet)
    assert first.values.tobytes() == again.values.tobytes()
    assert first.log_density.tobytes() == again.log_density.tobytes()


def test_chains_that_have_not_converged_are_reported():
    # Twelve hardly determined parameters and a hundred steps.
    problem = problem_of(
        table_of(REBOUND, count=4),
        scene_of(ball=True),
        "two-mass",
        noise="student-t",
    )
    posterior, diagnostics = sample(problem, start_proposals(problem), Effort(max_steps=100), quiet)
    assert not diagnostics.converged
    assert diagnostics.complaints
    assert diagnostics.steps == diagnostics.warm_up + 100
    assert np.isfinite(posterior.values).all()


# Every fourth step is stored, 100 in all, and the first quarter of these is left out. Draws to
# which proposals are fitted do not count.
@pytest.mark.parametrize(("lessons", "stored"), [(0, 75), (2, 100)])
def test_a_long_chain_is_thinned_evenly(lessons, stored, monkeypatch):
    problem = line_problem()
    monkeypatch.setattr(chains, "STORED_STEPS", 100)
    monkeypatch.setattr(chains, "FIRST_CHECK", 100)
    monkeypatch.setattr(chains, "TARGET_ESS", 1e9)
    monkeypatch.setattr(chains, "MOST_LESSONS", lessons)
    rng = np.random.default_rng(0)
    mixed, scores, rates, warm_up, steps = chains.run_chains(
        problem,
        start_proposals(problem),
        rng,
        400,
        lambda _share: None,
    )
    assert warm_up == 160 + 100 * lessons
    assert steps == 160 + 400
    assert mixed.chains.shape[:2] == (4, stored)
    assert scores.shape[:2] == (4, stored)
    assert all(0.2 < rate < 0.9 for rate in rates)
    centre, covariance = exact(problem)
    sds = np.sqrt(np.diagonal(covariance))
    draws = mixed.chains.reshape(-1, 2)
    shift = draws.mean(axis=0) - centre
    assert np.all(np.abs(shift) < 0.1 * sds)
    assert_allclose(draws.std(axis=0) / sds, 1.0, atol=0.1)


def test_a_walker_that_is_stuck_in_a_low_mode():
    rng = np.random.default_rng(0)
    scores = -0.5 * rng.chisquare(5.0, (4, 80, 16))
    assert not chains._stuck_walkers(scores).any()
    scores[1, :, 3] -= 30.0
    # Low for a while is no reason.
    scores[2, :50, 5] -= 30.0
    stuck = np.argwhere(chains._stuck_walkers(scores))
    assert stuck.tolist() == [[1, 3]]


def test_where_no_chain_can_start():
    problem = problem_of(
        table_of(REBOUND),
        scene_of(),
        "two-mass",
        fix={"mass_ratio": 0.4, "cor_10": 0.9},
    )
    nowhere = [Student(problem.prior.location, np.eye(len(problem.free)))]
    with pytest.raises(FitError) as caught:
        sample(problem, nowhere, Effort(), quiet)
    assert caught.value.code == "no-start"


def test_effective_sizes_and_r_hat():
    rng = np.random.default_rng(0)
    white = rng.standard_normal((4, 1000, 4, 4))
    mixing = Mixing(tuple("abcd"), white)
    size = 4 * 1000 * 4
    for name in "abcd":
        assert abs(mixing.ess_bulk[name] / size - 1.0) < 0.15
        assert abs(mixing.ess_tail[name] / size - 1.0) < 0.15
    assert mixing.reached(0.8 * size, 1.01)
    assert not mixing.reached(1.2 * size, 1.01)
    # An autoregression of 0.9 is worth 1/19 of its length; an ensemble elsewhere, or one that never
    # moved, shows.
    correlated = white[..., 0]
    for k in range(1, 1000):
        before = correlated[:, k - 1]
        correlated[:, k] = 0.9 * before + np.sqrt(0.19) * correlated[:, k]
    white[2, :, :, 1] += 1.0
    white[..., 2] = 0.5
    # Walkers of one ensemble may lie apart: ensembles are compared.
    white[..., 3] += np.linspace(-2.0, 2.0, 4)
    mixing = Mixing(tuple("abcd"), white)
    assert mixing.ess_bulk["a"] == pytest.approx(size / 19.0, rel=0.2)
    assert mixing.r_hat["a"] < 1.02
    assert mixing.r_hat["b"] > 1.05
    assert not mixing.reached(1.0, 1.05)
    # Nearly all draws of the tails come from the second half.
    widening = np.repeat([0.2, 1.0], 500)[None, :, None, None]
    wide = Mixing("a", rng.standard_normal((4, 1000, 4, 1)) * widening)
    assert wide.ess_tail["a"] < 0.2 * wide.ess_bulk["a"]
    assert not mixing.r_hat["c"] < np.inf
    assert mixing.r_hat["d"] < 1.02
    assert mixing.ess_bulk["d"] < 0.1 * size
