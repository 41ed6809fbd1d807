"""Scales that rest on the radius of the ball in the picture. Programs measure it up to half a pixel
small: the area of a contour of OpenCV is that of the polygon through centres of pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fitball.base.itf import GRAVITY
from fitball.tracks.session import Session

# By so much [px] programs measure radii too small.
HALF_PIXEL = 0.5


class RadiusScale(NamedTuple):
    """A scale by the `radius` [px] of the ball: the `sd` of its factor, and metres a pixel with
    half a pixel more.
    """

    radius: float
    sd: float
    corrected: float


def scale_by_radius(session: Session) -> RadiusScale | None:
    """The scale of a session whose tracks rest on radii; None where it is stated. It may be off by
    half a pixel, or by less, as far as gravity shows.
    """
    radii = [impact.track.radius_px for impact in session.good]
    if not np.isfinite(radii).any():
        return None
    radius = float(np.nanmedian(radii))
    gravity, gravity_sd = session.gravity.value, session.gravity.sd
    by_gravity = np.hypot(gravity - GRAVITY, gravity_sd) / GRAVITY
    sd = float(np.fmin(HALF_PIXEL / radius, by_gravity))
    return RadiusScale(radius, sd, session.assumed.ball.radius / (radius + HALF_PIXEL))


def explains_gravity(scale: RadiusScale, gravity: float, sds: float) -> bool:
    """Whether half a pixel more takes a gravity [m/s^2] to within `sds` [m/s^2] of the standard."""
    corrected = gravity * scale.radius / (scale.radius + HALF_PIXEL)
    return abs(corrected - GRAVITY) < sds
