"""Statistics of chains and weights, against those of ArviZ and known ones."""

import numpy as np
import pytest
from arviz_stats.base.array import array_stats
from numpy.testing import assert_allclose
from scipy.stats import genpareto

from fitball.inference import diagnostics

TAILS = (0.025, 0.975)


def autoregressive(rng, chains, steps, memory):
    """Chains with a memory of one step, from their own equilibrium."""
    noise = rng.standard_normal((chains, steps))
    values = noise.copy()
    fresh = np.sqrt(1.0 - memory**2)
    for k in range(1, steps):
        before = values[:, k - 1]
        values[:, k] = memory * before + fresh * noise[:, k]
    return values


def slow(rng):
    return autoregressive(rng, 12, 400, 0.95)


def alternating(rng):
    return autoregressive(rng, 6, 301, -0.7)


def heavy(rng):
    return rng.standard_cauchy((8, 150))


def apart(rng):
    middles = np.arange(8) / 4.0
    return rng.standard_normal((8, 90)) + middles[:, None]


def drifting(rng):
    drift = np.arange(90) / 30.0
    return rng.standard_normal((8, 90)) + drift


def rounded(rng):
    return autoregressive(rng, 8, 120, 0.5).round(1)


def with_a_gap(rng):
    chains = rng.standard_normal((8, 60))
    chains[:, 7] = np.nan
    return chains


def of_steps(steps):
    """What makes independent chains of so many steps."""

    def independent(rng):
        return rng.standard_normal((4, steps))

    return independent


CHAINS = {
    "independent": of_steps(200),
    "slow": slow,
    "alternating": alternating,
    "heavy": heavy,
    "apart": apart,
    "drifting": drifting,
    "rounded": rounded,
    "odd": of_steps(5),
    "four steps": of_steps(4),
    "three steps": of_steps(3),
    "with a gap": with_a_gap,
}


@pytest.mark.parametrize("name", CHAINS)
def test_statistics_of_chains_are_those_of_arviz(name):
    rng = np.random.default_rng(5)
    chains = CHAINS[name](rng)
    ensembles = np.repeat([0, 1], len(chains) // 2)
    axes = {"chain_axis": 0, "draw_axis": 1}
    pairs = (
        (
            diagnostics.bulk_size(chains),
            array_stats.ess(chains, method="bulk", **axes),
        ),
        (
            diagnostics.tail_size(chains, TAILS),
            array_stats.ess(chains, method="tail", prob=TAILS, **axes),
        ),
        (
            diagnostics.nested_r_hat(chains, 2),
            array_stats.rhat_nested(chains, superchain_ids=ensembles, **axes),
        ),
    )
    for ours, theirs in pairs:
        assert ours == pytest.approx(float(theirs), rel=1e-10, nan_ok=True)


def test_chains_that_never_move():
    still = np.ones((4, 50))
    assert diagnostics.bulk_size(still) == still.size
    assert np.isnan(diagnostics.nested_r_hat(still, 2))
    still[2:] = 2.0
    assert diagnostics.nested_r_hat(still, 2) > 1e6


def test_the_effective_size_of_a_known_memory():
    """Of N steps with the memory a, N (1 - a) / (1 + a) are effective."""
    rng = np.random.default_rng(1)
    chains = autoregressive(rng, 40, 4_000, 0.8)
    size = diagnostics.bulk_size(chains)
    assert size == pytest.approx(chains.size / 9.0, rel=0.1)


def tail_of(shape, count, rng):
    """Log ratios whose tail is a generalised Pareto distribution."""
    excesses = genpareto.rvs(shape, size=count, random_state=rng)
    return np.log(1.0 + excesses)


@pytest.mark.parametrize("shape", [-0.4, 0.0, 0.3, 0.7, 1.2])
@pytest.mark.parametrize("count", [60, 4_000])
def test_smoothed_weights_are_those_of_arviz(shape, count):
    rng = np.random.default_rng(3)
    ratios = tail_of(shape, count, rng)
    # Those that ArviZ takes.
    size = int(min(count / 5.0, 3.0 * np.sqrt(count)))
    ours, k = diagnostics.pareto_smoothed_tail(ratios, size)
    theirs, their_k = array_stats.psislw(-ratios, r_eff=1.0, axis=-1)
    assert_allclose(ours, theirs, rtol=0.0, atol=1e-10)
    assert k == pytest.approx(float(their_k), rel=1e-10)
    total = np.exp(ours).sum()
    assert total == pytest.approx(1.0, abs=1e-12)


def test_the_shape_of_a_known_tail():
    rng = np.random.default_rng(2)
    ratios = tail_of(0.6, 50_000, rng)
    _, k = diagnostics.pareto_smoothed_tail(ratios, 670)
    assert k == pytest.approx(0.6, abs=0.12)


@pytest.mark.parametrize("k", [-0.7, -1e-3, -1e-12, -1e-300, 0.0, 1e-300, 1e-12, 1e-3, 0.4, 1.2])
def test_quantiles_of_the_pareto_tail_are_those_of_scipy(k):
    """Those of the exponential distribution where there is no shape."""
    share = (np.arange(500) + 0.5) / 500
    assert_allclose(diagnostics._pareto_quantiles(k, 500), genpareto.ppf(share, k), rtol=1e-12)
