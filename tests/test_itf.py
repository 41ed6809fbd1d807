"""Formulas of the ITF against its printed numbers."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fitball.base import itf


def test_the_rating_has_the_values_of_the_guide():
    """CS 01/02: e = 0.81 and mu = 0.60 make 40; ten kelvins colder take 0.03 of restitution, 4.5
    points.
    """
    mu = np.array([0.60, 0.60, 0.55])
    e = np.array([0.81, 0.78, 0.81])
    usual = itf.pace_rating(mu, e, None)
    assert_allclose(usual, [40.0, 44.5, 45.0], rtol=1e-13)
    assert_allclose(itf.pace_rating(mu, e, 23.0), usual, rtol=1e-15)
    colder = itf.pace_rating(mu, e, 13.0)
    assert_allclose(colder, [35.5, 40.0, 40.5], rtol=1e-13)


def test_ratings_are_rounded_before_their_category():
    ratings = np.array([29.4, 29.5, 34.49, 34.5, 39.4, 39.6, 44.5, 60.0, -5.0, 44.4])
    shares = {
        "slow": 0.2,
        "medium-slow": 0.2,
        "medium": 0.2,
        "medium-fast": 0.2,
        "fast": 0.2,
    }
    assert itf.pace_categories(ratings) == pytest.approx(shares, rel=1e-14)
    assert itf.pace_categories(np.array([37.0]))["medium"] == 1.0


def test_types_of_balls_are_those_of_the_rules():
    """Rules of Tennis, Appendix I, in cm."""
    printed = {
        "type-1": (138, 151),
        "type-2": (135, 147),
        "type-3": (135, 147),
        "high-altitude": (122, 135),
        "stage-1": (120, 135),
        "stage-2": (105, 120),
        "stage-3": (90, 105),
        "stage-3-foam": (85, 105),
    }
    in_cm = {}
    for name, (low, high) in itf.BALL_TYPES.items():
        in_cm[name] = (round(100.0 * low, 6), round(100.0 * high, 6))
    assert in_cm == printed
    # 56.0 to 59.4 g, 6.54 to 6.86 cm.
    assert itf.BALL_TOLERANCES == {
        "ball_mass": (0.056, 0.0594),
        "ball_radius": (0.0654 / 2, 0.0686 / 2),
    }
