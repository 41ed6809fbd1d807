"""Statistics of chains and weights, against those of ArviZ and known ones."""

import numpy as np
import pytest
from arviz_stats.base.array import array_stats
from scipy.stats import genpareto

from fitball.inference import diagnostics

TAILS = (0.025, 0.975)


def autoregressive(rng, chains, steps, memory):
    """Chains with a memory of one step, from their own equilibrium."""
    noise = rng.standard_normal((chains, steps))
    values = np.empty_like(noise)
    values[:, 0] = noise[:, 0]
    for k in range(1, steps):
        values[:, k] = memory * values[:, k - 1] + np.sqrt(1.0 - memory**2) * noise[:, k]
    return values


CHAINS = {
    "independent": lambda rng: rng.standard_normal((8, 200)),
    "slow": lambda rng: autoregressive(rng, 12, 400, 0.95),
    "alternating": lambda rng: autoregressive(rng, 6, 301, -0.7),
    "heavy": lambda rng: rng.standard_cauchy((8, 150)),
    "apart": lambda rng: rng.standard_normal((8, 90)) + np.arange(8)[:, None] / 4.0,
    "drifting": lambda rng: rng.standard_normal((8, 90)) + np.arange(90) / 30.0,
    "rounded": lambda rng: np.round(autoregressive(rng, 8, 120, 0.5), 1),
    "short": lambda rng: rng.standard_normal((4, 5)),
    "four steps": lambda rng: rng.standard_normal((8, 4)),
    "three steps": lambda rng: rng.standard_normal((8, 3)),
    "with a gap": lambda rng: np.where(np.arange(60) == 7, np.nan, rng.standard_normal((8, 60))),
}


@pytest.mark.parametrize("name", CHAINS)
def test_statistics_of_chains_are_those_of_arviz(name):
    chains = CHAINS[name](np.random.default_rng(5))
    axes = {"chain_axis": 0, "draw_axis": 1}
    ensembles = np.repeat(np.arange(2), len(chains) // 2)
    ours = (
        diagnostics.bulk_size(chains),
        diagnostics.tail_size(chains, TAILS),
        diagnostics.nested_r_hat(chains, 2),
    )
    theirs = (
        array_stats.ess(chains, method="bulk", **axes),
        array_stats.ess(chains, method="tail", prob=TAILS, **axes),
        array_stats.rhat_nested(chains, superchain_ids=ensembles, **axes),
    )
    assert ours == pytest.approx([float(value) for value in theirs], rel=1e-10, nan_ok=True)


def test_chains_that_never_move():
    still = np.ones((4, 50))
    assert diagnostics.bulk_size(still) == still.size
    assert np.isnan(diagnostics.nested_r_hat(still, 2))
    apart = np.repeat([1.0, 1.0, 2.0, 2.0], 50).reshape(4, 50)
    assert diagnostics.nested_r_hat(apart, 2) > 1e6


def test_the_effective_size_of_a_known_memory():
    """Of N steps with the memory a, N (1 - a) / (1 + a) are effective."""
    chains = autoregressive(np.random.default_rng(1), 40, 4_000, 0.8)
    assert diagnostics.bulk_size(chains) == pytest.approx(chains.size / 9.0, rel=0.1)


@pytest.mark.parametrize("shape", [-0.4, 0.0, 0.3, 0.7, 1.2])
@pytest.mark.parametrize("count", [60, 4_000])
def test_smoothed_weights_are_those_of_arviz(shape, count):
    rng = np.random.default_rng(3)
    ratios = np.log(genpareto.rvs(shape, size=count, random_state=rng) + 1.0)
    size = int(min(count / 5.0, 3.0 * np.sqrt(count)))
    ours, k = diagnostics.pareto_smoothed_tail(ratios, size)
    theirs, their_k = array_stats.psislw(-ratios, r_eff=1.0, axis=-1)
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-10)
    assert k == pytest.approx(float(their_k), rel=1e-10)
    assert np.exp(ours).sum() == pytest.approx(1.0, abs=1e-12)


def test_the_shape_of_a_known_tail():
    ratios = np.log(genpareto.rvs(0.6, size=50_000, random_state=np.random.default_rng(2)) + 1.0)
    _, k = diagnostics.pareto_smoothed_tail(ratios, 670)
    assert k == pytest.approx(0.6, abs=0.12)
