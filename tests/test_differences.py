"""Central differences against derivatives that are known, and where a side has no answer."""

import numpy as np

from fitball.inference.differences import central

AT = np.array([[0.3, 1.2, -0.7], [1.1, 0.4, 0.2]])
STEP = np.full(3, 6e-6)
OPEN = np.full(3, np.inf)


def curved(x):
    """Two outputs, (rows, 2, 2)."""
    a, b, c = x.T
    return np.stack(
        [[np.exp(a) * np.sin(b), a * b * c], [np.cosh(c) / (1.0 + b), np.hypot(a, c)]]
    ).transpose(2, 0, 1)


def derived(x):
    """Its derivatives by hand, (rows, 3, 2, 2)."""
    a, b, c = x.T
    r = np.hypot(a, c)
    none = 0.0 * a
    by = [
        [[np.exp(a) * np.sin(b), b * c], [none, a / r]],
        [[np.exp(a) * np.cos(b), a * c], [-np.cosh(c) / (1.0 + b) ** 2, none]],
        [[none, a * b], [np.sinh(c) / (1.0 + b), c / r]],
    ]
    return np.array(by).transpose(3, 0, 1, 2)


def test_derivatives_of_an_analytic_function():
    made, slopes = central(curved, AT, STEP, -OPEN, OPEN)
    np.testing.assert_array_equal(made, curved(AT))
    np.testing.assert_allclose(slopes, derived(AT), rtol=1e-9, atol=1e-9)


def test_never_over_a_limit_and_one_sided_there():
    seen = []

    def watched(x):
        seen.append(x)
        return curved(x)

    low = np.array([0.3, -1.0, -0.7])
    high = np.array([1.1, 1.2, 0.2])
    _, slopes = central(watched, AT, STEP, low, high)
    assert np.all(seen[0] >= low)
    assert np.all(seen[0] <= high)
    assert len(seen) == 1
    # Error of a one-sided difference: step f''/2.
    np.testing.assert_allclose(slopes, derived(AT), atol=3e-5)
    _, none = central(curved, AT[:1], STEP, AT[0], AT[0])
    np.testing.assert_array_equal(none, np.zeros((1, 3, 2, 2)))


def test_where_a_side_has_no_answer_the_other_is_taken():
    def walled(x):
        out = curved(x)
        out[x[:, 0] > 0.3] = np.nan
        # A cell of its own wall, of a step down.
        out[x[:, 1] < 1.2, 0, 0] = -np.inf
        return out

    _, slopes = central(walled, AT[:1], STEP, -OPEN, OPEN)
    np.testing.assert_allclose(slopes, derived(AT[:1]), atol=3e-5)


def test_where_neither_side_has_an_answer_it_is_zero():
    def nowhere(x):
        out = curved(x)
        out[x[:, 0] != 0.3] = np.nan
        return out

    _, slopes = central(nowhere, AT[:1], STEP, -OPEN, OPEN)
    np.testing.assert_array_equal(slopes[:, 0], 0.0)
    np.testing.assert_allclose(slopes[:, 1:], derived(AT[:1])[:, 1:], rtol=1e-8, atol=1e-9)
    # An answer on one side, but none at the point itself.
    beside, slopes = central(
        lambda x: np.where(x[:, 0] > 0.3, x[:, 0], np.nan),
        AT[:1],
        STEP,
        -OPEN,
        OPEN,
    )
    assert np.isnan(beside).all()
    assert beside.shape == (1,)
    np.testing.assert_array_equal(slopes, np.zeros((1, 3)))
