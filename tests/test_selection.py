"""Places of some of many: written out by hand, and shares of weights."""

import numpy as np
import pytest

from fitball.base.selection import evenly_begun, evenly_spread, systematic


def test_evenly_spread_places_have_both_ends():
    # Exactly 0, 10/3, 20/3 and 10.
    assert evenly_spread(11, 4).tolist() == [0, 3, 7, 10]
    assert evenly_spread(11, 4, down=True).tolist() == [0, 3, 6, 10]
    assert evenly_spread(5, 9).tolist() == [0, 1, 2, 3, 4]
    assert evenly_spread(5, 9, down=True).tolist() == [0, 1, 2, 3, 4]
    assert evenly_spread(0, 3).tolist() == []


def test_pieces_begin_as_often_as_asked():
    assert evenly_begun(10, 4).tolist() == [0, 2, 5, 7]
    assert evenly_begun(2, 4).tolist() == [0, 0, 1, 1]


@pytest.mark.parametrize("offset", [0.01, 0.5, 0.99])
def test_each_comes_as_often_as_its_share_rounded_up_or_down(offset):
    weights = np.array([3.0, 0.0, 1.0, 2.5, 0.1])
    counts = np.bincount(systematic(weights, 40, offset), minlength=5)
    assert counts.sum() == 40
    assert np.all(np.abs(counts - 40.0 * weights / weights.sum()) < 1.0)
