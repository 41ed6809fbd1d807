"""Central differences against derivatives that are known, and where a side has no answer."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from fitball.inference.differences import central

# Two points of three coordinates.
AT = np.array(
    [
        [0.3, 1.2, -0.7],
        [1.1, 0.4, 0.2],
    ]
)
FIRST = AT[:1]
STEP = np.full(3, 6e-6)
OPEN = np.full(3, np.inf)


def curved(x):
    """Two times two outputs, (rows, 2, 2)."""
    a, b, c = x.T
    outputs = [
        [np.exp(a) * np.sin(b), a * b * c],
        [np.cosh(c) / (1.0 + b), np.hypot(a, c)],
    ]
    return np.array(outputs).transpose(2, 0, 1)


def derived(x):
    """Its derivatives by hand, (rows, 3, 2, 2)."""
    a, b, c = x.T
    r = np.hypot(a, c)
    zero = np.zeros(len(x))
    by_a = [
        [np.exp(a) * np.sin(b), b * c],
        [zero, a / r],
    ]
    by_b = [
        [np.exp(a) * np.cos(b), a * c],
        [-np.cosh(c) / (1.0 + b) ** 2, zero],
    ]
    by_c = [
        [zero, a * b],
        [np.sinh(c) / (1.0 + b), c / r],
    ]
    return np.array([by_a, by_b, by_c]).transpose(3, 0, 1, 2)


def test_derivatives_of_an_analytic_function():
    outputs, slopes = central(curved, AT, STEP, -OPEN, OPEN)
    assert_array_equal(outputs, curved(AT))
    assert_allclose(slopes, derived(AT), rtol=1e-9, atol=1e-9)


def test_never_over_a_limit_and_to_a_single_side_there():
    seen = []

    def watched(x):
        seen.append(x)
        return curved(x)

    low = np.array([0.3, -1.0, -0.7])
    high = np.array([1.1, 1.2, 0.2])
    _, slopes = central(watched, AT, STEP, low, high)
    assert len(seen) == 1
    assert np.all(seen[0] >= low)
    assert np.all(seen[0] <= high)
    # Error of a one-sided difference: step f''/2.
    assert_allclose(slopes, derived(AT), atol=3e-5)
    only_point = AT[0]
    _, no_slopes = central(curved, FIRST, STEP, only_point, only_point)
    assert_array_equal(no_slopes, np.zeros((1, 3, 2, 2)))


def test_where_a_side_has_no_answer_the_other_is_taken():
    def walled(x):
        a, b, _ = x.T
        outputs = curved(x)
        outputs[a > 0.3] = np.nan
        # A cell of its own wall, of a step down.
        outputs[b < 1.2, 0, 0] = -np.inf
        return outputs

    _, slopes = central(walled, FIRST, STEP, -OPEN, OPEN)
    assert_allclose(slopes, derived(FIRST), atol=3e-5)


def test_where_neither_side_has_an_answer_it_is_zero():
    def nowhere(x):
        a, _, _ = x.T
        outputs = curved(x)
        outputs[a != 0.3] = np.nan
        return outputs

    _, slopes = central(nowhere, FIRST, STEP, -OPEN, OPEN)
    exact = derived(FIRST)
    assert_array_equal(slopes[:, 0], 0.0)
    assert_allclose(slopes[:, 1:], exact[:, 1:], rtol=1e-8, atol=1e-9)

    # An answer on one side, but none at the point itself.
    def only_beside(x):
        a, _, _ = x.T
        return np.where(a > 0.3, a, np.nan)

    beside, slopes = central(only_beside, FIRST, STEP, -OPEN, OPEN)
    assert np.isnan(beside).all()
    assert beside.shape == (1,)
    assert_array_equal(slopes, np.zeros((1, 3)))
