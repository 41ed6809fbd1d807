"""Tied draws, as of walkers that sat, and constant ones: what ArviZ's fits divide by is then zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arviz_stats.base.array import array_stats
from samples import GRIP_SLIP, problem_of, synthetic
from scipy.special import logsumexp
from scipy.stats import chisquare, kstest, norm, uniform
from test_power_scaling import cumulative_jensen_shannon, drawn

from fitball.errors import FitError
from fitball.inference.comparison.left_out import LeaveOneOut, smoothed_elpd
from fitball.inference.identifiability.examine import POWERS, power_evidence, sensitivities
from fitball.inference.likelihood.posterior import log_likelihood
from fitball.inference.results.results import Posterior, thinned
from fitball.inference.sampling.convergence import convergence, standard_errors
from fitball.inference.sampling.importance import smoothed


def stuck(rng, count, share):
    """Normal draws (count,), the lowest `share` of them one draw over and over, and their log density."""
    draws = np.sort(rng.standard_normal(count))
    draws[: int(share * count)] = draws[0]
    rng.shuffle(draws)
    return draws, norm.logpdf(draws)


def plain_sensitivity(draws, log_density):
    """The published formula with weights as they are."""
    slopes = []
    for power in POWERS:
        weights = np.exp((power - 1.0) * (log_density - log_density.max()))
        slopes.append(cumulative_jensen_shannon(draws, weights / weights.sum()) / abs(np.log2(power)))
    return np.mean(slopes)


# From a tail partly tied to draws of two values only.
@pytest.mark.parametrize("share", [0.02, 0.045, 0.1, 0.3, 0.9, 0.999])
def test_power_scaling_of_tied_draws_is_the_published_formula(share):
    draws, log_density = stuck(np.random.default_rng(3), 4000, share)
    (found,) = sensitivities(draws[:, None], log_density)
    assert found == pytest.approx(plain_sensitivity(draws, log_density), rel=0.05)


def test_draws_that_are_all_repeated_tell_what_they_told_once():
    draws, log_density = stuck(np.random.default_rng(5), 2000, 0.0)
    (once,), (often,) = (
        sensitivities(np.repeat(draws, times)[:, None], np.repeat(log_density, times)) for times in (1, 60)
    )
    assert often == pytest.approx(once, rel=0.05)


@pytest.mark.parametrize("step", [1e-300, 1e-16, 4e-16, 1e-12])
def test_a_density_that_is_all_but_flat_moves_nothing(step):
    """A prior of enormous width: its densities differ in the last digits, or not at all."""
    rng = np.random.default_rng(2)
    found = sensitivities(rng.standard_normal((4000, 1)), -1.0 + step * rng.integers(0, 3, 4000))
    assert 0.0 <= found[0] < 1e-6


def test_no_weights_move_a_column_of_one_value():
    draws, log_density = stuck(np.random.default_rng(7), 4000, 0.0)
    found = sensitivities(np.stack([draws, np.full(4000, 3.0)], axis=1), log_density)
    assert found[0] > 0.05
    assert found[1] == 0.0


def test_every_look_is_a_number_when_walkers_sat():
    problem = synthetic(problem_of("wang_all.csv", "grip-slip"), GRIP_SLIP, 4)
    values, posterior = drawn(problem)
    # The least likely tenth of the draws gives way to the least likely of all.
    score = log_likelihood(problem, values, problem.rebound(values))
    values = values.copy()
    values[np.argsort(score)[:300]] = values[np.argmin(score)]
    for item in power_evidence(problem, replace(posterior, values=values[None, :, None, :])).values():
        assert np.isfinite([item.prior, item.own_prior, item.likelihood]).all()
        assert item.likelihood > 0.1


# --- leave-one-out


def test_tied_ratios_are_used_as_they_are_and_not_trusted():
    _, log_ratios = stuck(np.random.default_rng(8), 4000, 0.2)
    weights, k = smoothed(-log_ratios, 1.0)
    np.testing.assert_allclose(weights, -log_ratios - logsumexp(-log_ratios), rtol=1e-12)
    assert k == np.inf


def test_equal_ratios_are_exact():
    weights, k = smoothed(np.full(50, -7.0), 1.0)
    np.testing.assert_allclose(np.exp(weights), 1.0 / 50.0, rtol=1e-12)
    assert k == -np.inf


def test_a_tail_of_draws_that_depend_on_each_other_is_longer_and_may_be_tied():
    """A hundred distinct ratios above many that are equal: a tail of 94 independent draws, none of 189."""
    log_ratios = np.concatenate([np.zeros(900), np.linspace(0.01, 3.0, 100)])
    assert np.isfinite(smoothed(log_ratios, 1.0)[1])
    assert smoothed(log_ratios, 0.25)[1] == np.inf


@pytest.mark.parametrize("efficiency", [1.0, 0.3, 0.01])
def test_untied_ratios_are_smoothed_as_arviz_does(efficiency):
    log_ratios = 1.5 * np.random.default_rng(9).standard_normal(3000)
    weights, k = smoothed(log_ratios, efficiency)
    expected, its_k = array_stats.psislw(-log_ratios, r_eff=efficiency, axis=-1)
    np.testing.assert_array_equal(weights, expected)
    assert k == its_k
    assert np.any(np.abs(weights - (log_ratios - logsumexp(log_ratios))) > 1e-3)


def test_an_impact_left_out_of_tied_draws_has_a_density_and_is_doubtful():
    rng = np.random.default_rng(11)
    tied, free = stuck(rng, 4000, 0.2)[1], norm.logpdf(rng.standard_normal(4000), 0.0, 3.0)
    terms = np.stack([tied, free, np.full(4000, -2.0)], axis=1)
    elpd, k = smoothed_elpd(terms, terms, 1.0)
    # The identity of importance sampling leave-one-out: the harmonic mean of the likelihood.
    assert elpd[0] == pytest.approx(np.log(4000) - logsumexp(-tied), rel=1e-12)
    assert elpd[2] == pytest.approx(-2.0, rel=1e-12)
    assert np.isfinite(elpd).all()
    assert LeaveOneOut(elpd, k, 0.0, (), ()).doubtful == (0,)


# --- chains


def walk(rng, stuck_walkers):
    """Chains (2 ensembles, 200 steps, 10 walkers, 1), as many walkers of each never moving."""
    chains = rng.standard_normal((2, 200, 10, 1))
    chains[:, :, :stuck_walkers] = chains[:, :1, :stuck_walkers]
    return chains


@pytest.mark.parametrize("walkers", [1, 5, 10])
def test_walkers_that_never_move_are_no_independent_draws(walkers):
    chains = walk(np.random.default_rng(4), walkers)
    found = convergence(("mu",), chains)
    assert np.isfinite([found.min_ess, found.max_r_hat]).all()
    assert found.min_ess < convergence(("mu",), walk(np.random.default_rng(4), 0)).min_ess / 2.0
    assert np.isfinite(list(standard_errors(chains[..., 0]).values())).all()


@pytest.mark.parametrize("steps", [40, 41])
def test_convergence_is_arvizs_for_walkers_that_sat(steps):
    """Bulk and R-hat from one ranking; ArviZ ranks the draws for each of them."""
    rng = np.random.default_rng(3)
    chains = rng.standard_normal((3, steps, 6, 2)).cumsum(axis=1)
    for step in range(1, steps):
        sat = rng.random((3, 6)) < 0.7
        chains[:, step][sat] = chains[:, step - 1][sat]
    found = convergence(("a", "b"), chains)
    owner = np.repeat(np.arange(3), 6)
    for k, name in enumerate(("a", "b")):
        column = chains[..., k].transpose(0, 2, 1).reshape(18, steps)
        assert found.ess_bulk[name] == array_stats.ess(column, chain_axis=0, draw_axis=1, method="bulk")
        assert found.ess_tail[name] == array_stats.ess(
            column, chain_axis=0, draw_axis=1, method="tail", prob=(0.05, 0.95)
        )
        expected = array_stats.rhat_nested(column, superchain_ids=owner, chain_axis=0, draw_axis=1, method="rank")
        assert found.r_hat[name] == expected


def test_a_parameter_that_never_moves_is_refused_in_words():
    chains = np.concatenate([walk(np.random.default_rng(6), 0), np.full((2, 200, 10, 1), 0.5)], axis=-1)
    with pytest.raises(FitError, match="the sampler never moved k_y"):
        convergence(("mu", "k_y"), chains)


@pytest.mark.parametrize(("ensembles", "steps", "walkers"), [(4, 100, 22), (4, 500, 40), (2, 400, 64), (4, 1000, 20)])
def test_thinned_draws_are_of_all_walkers_and_of_the_whole_run(ensembles, steps, walkers):
    """Each draw is named by its walker and its step: none is met much more often than by chance."""
    shape = (ensembles, steps, walkers)
    walker, step = (
        np.arange(ensembles * walkers).reshape(ensembles, 1, walkers),
        np.arange(steps).reshape(1, steps, 1),
    )
    named = np.stack([np.broadcast_to(walker, shape), np.broadcast_to(step, shape)], axis=-1).astype(float)
    posterior = Posterior(("walker", "step"), named, np.zeros(shape), np.zeros((1, 2)))

    def spread(rows):
        met = np.bincount(rows[:, 0].astype(int), minlength=ensembles * walkers)
        return chisquare(met).pvalue, kstest(rows[:, 1], uniform(0, steps).cdf).pvalue

    for count in (400, 1000):
        rows = thinned(posterior, count)
        assert rows.shape == (count, 2) and len(np.unique(rows, axis=0)) == count
        assert min(spread(rows)) > 1e-6
        np.testing.assert_array_equal(rows, thinned(posterior, count))
    assert thinned(posterior, 10**9).shape == (posterior.draws.shape[0], 2)
    # Even spaces are what is not done: 22 walkers, every 22nd draw.
    spacing = posterior.draws[:: walkers * max(1, ensembles * steps // 400)]
    assert spread(spacing)[0] < 1e-6
