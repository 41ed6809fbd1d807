"""Draws of posteriors: an exact one by chains and by weights, chains that have not converged,
diagnostics.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.density import REBOUND, problem_of, scene_of, table_of
from support.line import exact, line_problem

from fitball.base.errors import FitError, ParameterError
from fitball.inference.density import log_posterior
from fitball.inference.effort import Effort
from fitball.inference.sampling import chains
from fitball.inference.sampling import sample as sampling
from fitball.inference.sampling.convergence import Mixing
from fitball.inference.sampling.importance import Student, adaptive_draws
from fitball.inference.sampling.sample import sample, thinning
from fitball.inference.sampling.target import Target
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


def test_weighted_draws_that_chains_confirm_have_the_moments_of_the_exact_posterior():
    problem = line_problem()
    stages = []
    shares = []

    def shown(stage, share):
        stages.append(stage)
        shares.append(share)

    posterior, diagnostics = sample(problem, start_proposals(problem), Effort(), shown)
    assert diagnostics.converged
    assert diagnostics.complaints == ()
    assert diagnostics.in_full == ""
    assert diagnostics.by_weights
    assert diagnostics.warm_up == 0
    assert diagnostics.pareto_k <= sampling.GOOD_K
    assert max(diagnostics.r_hat.values()) < 1.01
    size = min(*diagnostics.ess_bulk.values(), *diagnostics.ess_tail.values())
    # Those of weights alone, and of chains beside them.
    assert size > sampling.MOST_SIZE + 500.0
    ensembles, _, _, _ = posterior.values.shape
    assert ensembles == 4
    assert posterior.log_density.size >= size
    check_moments(problem, posterior, size)
    assert set(stages) == {"sampling"}
    assert min(shares) >= 0.0
    assert max(shares) <= 1.0


def test_emcee_in_full_has_them_too(monkeypatch):
    problem = line_problem()
    effort = Effort(sampler="emcee")
    posterior, diagnostics = sample(problem, start_proposals(problem), effort, quiet)
    assert diagnostics.converged
    assert diagnostics.in_full
    assert not diagnostics.by_weights
    # The ensembles begin in equilibrium.
    assert diagnostics.warm_up == 0
    assert min(*diagnostics.ess_bulk.values(), *diagnostics.ess_tail.values()) > 1000.0
    check_moments(problem, posterior, 1000.0)
    monkeypatch.setattr(sampling, "TARGET_R_HAT", min(diagnostics.r_hat.values()))
    _, worse = sample(problem, start_proposals(problem), effort, quiet)
    assert worse.r_hat == diagnostics.r_hat
    assert not worse.converged
    assert len(worse.complaints) == 2


@pytest.mark.parametrize(
    ("name", "limit"),
    [("GOOD_K", -1.0), ("LEAST_SIZE", 1e5), ("MOST_OF_CENTRE", 0.1)],
)
def test_weights_that_a_guard_refuses_are_not_the_posterior(name, limit, monkeypatch):
    problem = line_problem()
    monkeypatch.setattr(sampling, name, limit)
    monkeypatch.setattr(sampling, "MOST_SIZE", 2000.0)
    posterior, diagnostics = sample(problem, start_proposals(problem), Effort(), quiet)
    assert diagnostics.in_full
    assert diagnostics.converged
    check_moments(problem, posterior, 1000.0)


def test_an_unknown_sampler():
    with pytest.raises(ParameterError) as caught:
        Effort(sampler="nuts")
    assert caught.value.code == "effort"


@pytest.mark.parametrize("sampler", ["weighted", "emcee"])
def test_the_same_seed_gives_the_same_bytes(sampler):
    problem = line_problem(copies=2, noise=None)
    effort = Effort(seed=7, max_steps=100, sampler=sampler)
    first, _ = sample(problem, start_proposals(problem), effort, quiet)
    again, _ = sample(problem, start_proposals(problem), effort, quiet)
    assert first.values.tobytes() == again.values.tobytes()
    assert first.log_density.tobytes() == again.log_density.tobytes()


def test_draws_with_scatter_drawn_again_have_the_density_of_the_posterior():
    problem = line_problem(noise=None)
    posterior, diagnostics = sample(problem, start_proposals(problem), Effort(), quiet)
    assert posterior.names == problem.free
    q = problem.prior.coordinate(posterior.values.reshape(-1, 3))
    assert_allclose(posterior.log_density.ravel(), log_posterior(problem, q), rtol=1e-8)
    assert {*diagnostics.r_hat} == {*problem.free}
    # Weighted draws of the whole posterior, by scatter not integrated.
    plain = adaptive_draws(
        lambda at: log_posterior(problem, at),
        start_proposals(problem),
        np.random.default_rng(5),
        4000.0,
    )
    weights = np.exp(plain.log_weights)
    mean = weights @ plain.x
    sds = np.sqrt(weights @ (plain.x - mean) ** 2)
    # Five standard errors of 4,000 draws on either side.
    assert np.all(np.abs(q.mean(axis=0) - mean) < 0.11 * sds)
    assert_allclose(q.std(axis=0) / sds, 1.0, atol=0.1)


def test_chains_that_have_not_converged_are_reported():
    # Twelve hardly determined parameters and a hundred steps.
    problem = problem_of(
        table_of(REBOUND, count=4),
        scene_of(ball=True),
        "two-mass",
        noise="student-t",
    )
    effort = Effort(max_steps=100, sampler="emcee")
    posterior, diagnostics = sample(problem, start_proposals(problem), effort, quiet)
    assert not diagnostics.converged
    assert diagnostics.complaints
    assert diagnostics.steps == diagnostics.warm_up + 100
    assert np.isfinite(posterior.values).all()


# Every fourth step is stored, 100 in all, and the first quarter of these is left out. Draws to
# which proposals are fitted do not count.
@pytest.mark.parametrize(("lessons", "stored"), [(0, 75), (2, 100)])
@pytest.mark.parametrize("settled", [True, False])
def test_a_long_chain_is_thinned_evenly(settled, lessons, stored, monkeypatch):
    problem = line_problem()
    monkeypatch.setattr(chains, "STORED_STEPS", 100)
    monkeypatch.setattr(chains, "FIRST_CHECK", 100)
    monkeypatch.setattr(chains, "TARGET_ESS", 1e9)
    monkeypatch.setattr(chains, "MOST_LESSONS", lessons)
    monkeypatch.setattr(chains, "LEAST_GAIN", 0.0)
    rng = np.random.default_rng(0)
    target = Target(problem)
    begin = start_proposals(problem)
    x = begin[0].draw(rng, 1000)
    scores = target.evaluate(x)
    log_weights = scores[:, 0] - begin[0].log_density(x)
    run = chains.run_chains(
        target,
        chains.Stock(x, scores, log_weights),
        begin,
        rng,
        400,
        lambda _share: None,
        settled=settled,
    )
    of_starts = 0 if settled else 160
    assert run.warm_up == of_starts + 100 * lessons
    assert run.steps == of_starts + 400
    assert run.mixing.chains.shape[:2] == (4, stored)
    assert run.evaluated.shape[:2] == (4, stored)
    assert all(0.2 < rate < 0.9 for rate in run.rates)
    centre, covariance = exact(problem)
    sds = np.sqrt(np.diagonal(covariance))
    draws = run.mixing.chains.reshape(-1, 2)
    assert_allclose(run.evaluated[..., 0].ravel(), log_posterior(problem, draws))
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


@pytest.mark.parametrize("steps", [8, 32, 500])
def test_so_many_steps_are_stored_that_their_effective_size_is_known(steps):
    rng = np.random.default_rng(3)
    # Walkers that hardly move from where they began: few draws are effective.
    start = rng.standard_normal((4, 1, 12, 2))
    chains = start + 0.01 * rng.standard_normal((4, steps, 12, 2)).cumsum(axis=1)
    mixing = Mixing(("a", "b"), chains)
    stored = chains[:, :: thinning(mixing)]
    assert stored.shape[1] >= 8
    assert np.isfinite(list(Mixing(("a", "b"), stored).ess_bulk.values())).all()
    # Where all are effective every step is stored.
    independent = Mixing(("a",), rng.standard_normal((4, steps, 12, 1)))
    assert thinning(independent) == 1
