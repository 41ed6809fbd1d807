"""Planted modes with shares known by integration, and cases in which weighted draws alone would be
sure of a wrong mode.
"""

import numpy as np
import pytest
from scipy import stats
from support.line import line_problem

from fitball.inference.effort import Effort
from fitball.inference.sampling import sample as sampling
from fitball.inference.sampling.agreement import Sample, disagreement
from fitball.inference.sampling.importance import Student, adaptive_draws
from fitball.inference.sampling.parts import ONE_PART, parts_of
from fitball.inference.sampling.target import Target


class Planted(Target):
    """A target of two coordinates with a density by hand."""

    density = None

    def evaluate(self, q):
        return type(self).density(q)[:, None]


def drawn(density, begin, seed=1, sampler="weighted"):
    """Draws (draws, 2) of a log density as `sample` makes them, and diagnostics."""
    kind = type("Density", (Planted,), {"density": staticmethod(density)})
    result = sampling._drawn(
        kind(line_problem()),
        begin,
        Effort(seed=seed, sampler=sampler),
        np.random.default_rng(seed),
        lambda _stage, _share: None,
    )
    return result.q.reshape(-1, 2), result.diagnostics


def two(share, width, distance=9.0):
    """The log density of two normal distributions of some `width`, the second with a share; and
    proposals at both maxima as a search finds them.
    """
    far = np.array([distance, 0.0])
    first = stats.multivariate_normal(np.zeros(2), np.eye(2))
    second = stats.multivariate_normal(far, width**2 * np.eye(2))

    def density(q):
        one = np.log1p(-share) + first.logpdf(q)
        return np.atleast_1d(np.logaddexp(one, np.log(share) + second.logpdf(q)))

    return density, [Student(np.zeros(2), np.eye(2)), Student(far, width * np.eye(2))]


# Equal modes, one to twenty, and a narrow one that has half of the mass beside a wide one.
@pytest.mark.parametrize(("share", "width"), [(0.5, 1.0), (1.0 / 21.0, 1.0), (0.5, 0.05)])
@pytest.mark.parametrize("sampler", ["weighted", "emcee"])
def test_planted_modes_have_their_shares(share, width, sampler):
    density, begin = two(share, width)
    q, diagnostics = drawn(density, begin, sampler=sampler)
    size = min(*diagnostics.ess_bulk.values(), *diagnostics.ess_tail.values())
    assert diagnostics.converged
    assert size >= 1000.0
    found = np.mean(q[:, 0] > 4.5)
    # Walkers change modes by proposals alone, so that a share is known less well than a median.
    error = np.sqrt(share * (1.0 - share) / 1000.0)
    assert abs(found - share) < 4.0 * error
    inside = q[q[:, 0] > 4.5]
    assert inside[:, 1].std() == pytest.approx(width, rel=0.15)


def ridge(q):
    """A crescent with a tail: the second coordinate is the square of the first, 0.1 wide."""
    along = stats.norm.logpdf(q[:, 0], 0.0, 1.5)
    return along + stats.norm.logpdf(q[:, 1], q[:, 0] ** 2, 0.3)


@pytest.mark.parametrize("sampler", ["weighted", "emcee"])
def test_a_ridge_has_its_shares(sampler):
    begin = [Student(np.zeros(2), np.diag([1.5, 0.3]))]
    q, diagnostics = drawn(ridge, begin, sampler=sampler)
    assert diagnostics.converged
    for limit in (-2.0, 0.0, 2.0):
        expected = stats.norm.cdf(limit, 0.0, 1.5)
        error = np.sqrt(expected * (1.0 - expected) / 1000.0)
        assert abs(np.mean(q[:, 0] < limit) - expected) < 4.0 * error
    assert q[:, 1].mean() == pytest.approx(1.5**2, abs=0.3)


def test_weights_alone_are_sure_of_a_wrong_mode_whose_peak_the_search_knows():
    """The second mode has all but a thousandth of the mass. A search found its peak, whose
    curvature says nothing of its width: it is 10,000 times narrower than its proposal.
    """
    density, begin = two(0.999, 1e-4)
    begin = [begin[0], Student(begin[1].centre, np.eye(2))]
    weighted = adaptive_draws(density, begin, np.random.default_rng(1), 4000.0, sampling.GOOD_K)
    # Both statistics of weights find nothing.
    assert weighted.k <= sampling.GOOD_K
    assert weighted.size >= sampling.LEAST_SIZE
    assert np.all(weighted.x[np.exp(weighted.log_weights) > 1e-6, 0] < 6.0)
    # It is e^25 times as dense there as weights expect, or more.
    assert np.log(weighted.of_centres[1]) > 25.0
    _, diagnostics = drawn(density, begin)
    assert diagnostics.in_full


def normal_sample(rng, count, shift=0.0, width=1.0, second=0.0):
    """Draws of a normal distribution, a share of which are of a `second` one ten sds away."""
    x = shift + width * rng.standard_normal((count, 2))
    x[:, 0] += 10.0 * (rng.uniform(size=count) < second)
    return Sample(x, -0.5 * np.sum(x**2, axis=1), float(count))


# What differs is found in 20 of 20, what is the same in none.
@pytest.mark.parametrize(
    ("there", "word"),
    [
        ({}, ""),
        ({"shift": 0.4}, "medians"),
        ({"width": 1.3}, "widths"),
        ({"second": 0.2}, "share"),
    ],
)
def test_chains_that_differ_from_weights(there, word):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        ours = normal_sample(rng, 4000)
        theirs = normal_sample(rng, 1500, **there)
        pooled = np.concatenate([ours.x, theirs.x])[None, :, None]
        parts = parts_of(pooled, np.array([[0.0, 0.0], [10.0, 0.0]]), 5500.0)
        found = disagreement(("a", "b"), ours, theirs, parts)
        assert (word in found) if word else not found


def test_chains_that_found_a_higher_place():
    rng = np.random.default_rng(0)
    ours = normal_sample(rng, 4000)
    theirs = normal_sample(rng, 1500)
    theirs.scores[7] = 6.0
    assert "density" in disagreement(("a", "b"), ours, theirs, ONE_PART)
