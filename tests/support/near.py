"""Numbers that agree: within a margin in their own unit, or but for a share of themselves."""

from numpy.testing import assert_allclose


def assert_within(actual, expected, margin):
    """The numbers, of any shape, differ by at most the margin."""
    assert_allclose(actual, expected, rtol=0.0, atol=margin)


def assert_near(actual, expected, share=1e-6):
    """The numbers, of any shape, differ by at most that share of the expected ones."""
    assert_allclose(actual, expected, rtol=share, atol=0.0)
