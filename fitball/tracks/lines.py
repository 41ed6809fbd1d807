"""What people do without a model of flight: straight lines through five frames on each side of the contact."""

from __future__ import annotations

import numpy as np

from fitball.tracks.frames import AFTER, BEFORE, NINE, TrackedImpact
from fitball.values import FloatArray

FRAMES = 5


def five_frame_lines(impact: TrackedImpact) -> FloatArray:
    """The speeds `v_x1, v_y1, v_x2, v_y2` (4,) [m/s] of straight lines through the last five frames before the
    contact and the first five after it, outliers left out; NaN where a side has fewer than two.
    """
    track, sign = impact.track, -1.0 if impact.mirrored else 1.0
    found = np.full(4, np.nan)
    for side, role in enumerate((BEFORE, AFTER)):
        own = np.flatnonzero((impact.role == role) & (impact.weight > 0.5))
        own = own[-FRAMES:] if role == BEFORE else own[:FRAMES]
        if own.size < 2:
            continue
        for axis, values in enumerate((sign * track.x, track.y)):
            slope = np.polynomial.Polynomial.fit(track.time[own], values[own], 1).deriv()(0.0)
            found[2 * side + axis] = slope if (side, axis) != (0, 1) else -slope
    return found


def line_errors(impacts: tuple[TrackedImpact, ...]) -> FloatArray:
    """By how much such lines differ from the flights, (impacts, 4) [m/s]."""
    places = [NINE.index(name) for name in ("v_x1", "v_y1", "v_x2", "v_y2")]
    return np.array([five_frame_lines(impact) - impact.values[places] for impact in impacts]).reshape(-1, 4)
