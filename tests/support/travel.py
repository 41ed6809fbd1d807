"""The offset of the normal force ahead in the direction of travel, by the manual."""

import numpy as np


def acting(v_x, v_y):
    """The share of the offset that acts towards positive v_x on a ball of these speeds."""
    ratio = np.abs(v_x) / v_y / np.tan(np.radians(2.0))
    near = (15.0 * ratio - 10.0 * ratio**3 + 3.0 * ratio**5) / 8.0
    return np.sign(v_x) * np.where(ratio < 1.0, near, 1.0)
