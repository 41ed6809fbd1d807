"""Errors of other forms of restitution, of a moving surface, of peaks and of ratios of heights,
against propagation by hand.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fitball
from fitball.base.errors import InputError

# A row of a racket: sds of v_y1, surface_speed and v_y2 [m/s], and a correlation of the first two.
RACKET_SDS = (0.3, 0.2, 0.1)
CORRELATION = 0.5


def racket(**columns):
    """A table of three balls that meet a moving racket, as it is read."""
    table = {"v_y1": [10.0, 12.0, 14.0], "surface_speed": [20.0, 22.0, 25.0]}
    table |= {"v_y2": [32.0, 35.0, 40.0]}
    return fitball.load_table({**table, **columns})


def test_correlated_errors_of_a_moving_surface():
    first, surface, second = RACKET_SDS
    table = racket(
        v_y1_sd=[first] * 3,
        surface_speed_sd=[surface] * 3,
        v_y2_sd=[second] * 3,
        **{"corr(v_y1,surface_speed)": [CORRELATION] * 3},
    )
    shared = CORRELATION * first * surface
    towards = np.sqrt(first**2 + surface**2 + 2.0 * shared)
    away = np.hypot(second, surface)
    assert_allclose(table.sd["v_y1"], towards, rtol=1e-12)
    assert_allclose(table.sd["v_y2"], away, rtol=1e-12)
    # The speed of the surface is added to the one and taken off the other.
    covariance = -(surface**2) - shared
    assert_allclose(table.corr["v_y1,v_y2"], covariance / (towards * away), rtol=1e-12)


def test_errors_of_peaks_are_those_of_each_height():
    columns = {"bounce": [0, 1, 2], "peak_height": [2.0, 1.1, 0.6]}
    exact = fitball.load_table(columns)
    table = fitball.load_table({**columns, "peak_height_sd": [0.02, 0.01, 0.005]})
    # Heights of 2.0 and 1.1 m that are moved by an sd each, by differences.
    moved = fitball.load_table({**columns, "peak_height": [2.0001, 1.1001, 0.6001]})
    for name, sds in (("v_y1", [0.02, 0.01]), ("v_y2", [0.01, 0.005])):
        slope = (moved.values[name] - exact.values[name]) / 1e-4
        assert_allclose(table.sd[name], slope * sds, rtol=1e-3)


def test_the_error_of_a_ratio_of_heights_is_that_of_the_rebound():
    drop = {"drop_height": [2.54, 2.54, 2.0], "height_ratio": [0.55, 0.56, 0.57]}
    table = fitball.load_table({**drop, "height_ratio_sd": [0.01, 0.01, 0.02]})
    heights = {
        "drop_height": drop["drop_height"],
        "rebound_height": np.multiply(drop["drop_height"], drop["height_ratio"]),
        "rebound_height_sd": np.multiply(drop["drop_height"], [0.01, 0.01, 0.02]),
    }
    same = fitball.load_table(heights)
    for name in ("v_y1", "v_y2"):
        assert_allclose(table.values[name], same.values[name], rtol=1e-12)
    assert_allclose(table.sd["v_y2"], same.sd["v_y2"], rtol=1e-12)


def test_a_ratio_that_contradicts_the_heights_is_refused():
    drop = {"drop_height": [2.54] * 3, "rebound_height": [1.40, 1.41, 1.42]}
    right = fitball.load_table({**drop, "height_ratio": [0.551, 0.555, 0.559]})
    assert_allclose(right.values["v_y2"], fitball.load_table(drop).values["v_y2"], rtol=1e-12)
    with pytest.raises(InputError) as refused:
        fitball.load_table({**drop, "height_ratio": [0.551, 0.70, 0.559]})
    assert "height_ratio" in str(refused.value)
