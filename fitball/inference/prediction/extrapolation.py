"""Whether new impacts lie where a model was calibrated: in each quantity, and in their combination.

The quantities are vertical speed, incidence angle and spin. The combination is judged among `v_x1`, `v_y1` and the
surface speed `R omega_1`, all in m/s, by the distance to the convex hull of the calibrated impacts: the
least-distance problem of Lawson and Hanson (1974, ch. 23), solved by non-negative least squares.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from fitball.values import FloatArray, Impacts

# Share of a quantity's size below which a difference is rounding of units (38 mph, 18 deg) and nothing else.
ROUNDING = 1e-9
# Distance to the hull, over the median calibrated speed, from which the combination counts as new. The speeds of one
# launcher setting scatter by 3 % (standard deviation of Wang's 21 impacts); closer than twice that is scatter.
SLACK = 0.05
# Lines in `v_y1` by their slope.
LINES = {"cor_slope": "COR", "eps_slope": "eps"}
# Impacts that stand for the range of a longer table, and the directions (and their opposites) in which those furthest
# out are among them. They are a quarter of a radian apart, so that the hull loses 2 % of its radius at most.
SPANNING = 300
DIRECTIONS = 100


@dataclass(frozen=True)
class CalibratedRange:
    """New impacts against calibrated ones.

    `limits` are the smallest and largest calibrated value by quantity (`v_y1` [m/s], `theta_1` [rad], `omega_1`
    [rad/s]; `v_y1` alone for a drop test), `beyond` (impacts,) how far a new value lies above (positive) or below
    (negative) them, zero inside. `hull_distance` (impacts,) [m/s] is None for a drop test; from `slack` [m/s] on it
    counts. `lines` names the lines in `v_y1` (COR, eps) that the model extrapolates outside its limits.
    """

    limits: Mapping[str, tuple[float, float]]
    beyond: Mapping[str, FloatArray]
    hull_distance: FloatArray | None
    slack: float
    lines: tuple[str, ...]

    @property
    def new_combination(self) -> NDArray[np.bool_]:
        """Whether an impact is further than `slack` from every mixture of calibrated impacts, (impacts,)."""
        if self.hull_distance is None:
            return np.zeros(self.beyond["v_y1"].shape, dtype=np.bool_)
        return self.hull_distance > self.slack

    @property
    def outside(self) -> NDArray[np.bool_]:
        """Whether an impact lies outside in any quantity or in their combination, (impacts,)."""
        flags = [self.new_combination, *(np.abs(column) > 0.0 for column in self.beyond.values())]
        outside: NDArray[np.bool_] = np.logical_or.reduce(flags)
        return outside


def lines_of(names: Collection[str]) -> tuple[str, ...]:
    """The lines in `v_y1` of a model with parameters `names`."""
    return tuple(word for name, word in LINES.items() if name in names)


def calibrated_range(
    calibrated: Impacts, new: Impacts, radius: float, tangential: bool, lines: tuple[str, ...]
) -> CalibratedRange:
    """Compare new impacts with the calibrated ones of a ball of that outer radius [m]."""
    names = ("v_y1", "theta_1", "omega_1") if tangential else ("v_y1",)
    limits, beyond = {}, {}
    for name in names:
        known = _quantity(calibrated, name)
        limits[name] = (float(known.min()), float(known.max()))
        beyond[name] = _beyond(_quantity(new, name), *limits[name])
    if not tangential:
        return CalibratedRange(limits, beyond, None, 0.0, lines)
    speed = float(np.median(calibrated.speed))
    distance = hull_distances(_velocities(calibrated, radius), _velocities(new, radius))
    return CalibratedRange(limits, beyond, distance, SLACK * speed, lines)


def spanning_impacts(impacts: Impacts, radius: float) -> Impacts:
    """At most SPANNING of the impacts with the same limits and, all but, the same hull; all where there are no more.

    The impacts furthest in each of many directions, those with the limits of each quantity and of the speed, and
    others spread evenly over incidence angle.
    """
    count = len(impacts)
    if count <= SPANNING:
        return impacts
    points = _velocities(impacts, radius)
    speed, angle = impacts.speed, _quantity(impacts, "theta_1")
    spread = points - points.mean(axis=0)
    scale = spread.std(axis=0)
    # One direction after the other: of many impacts each is large.
    towards = (spread @ one for one in _directions(DIRECTIONS) / np.where(scale > 0.0, scale, 1.0))
    rows = (*points.T, speed, angle)
    corners = {int(k) for column in chain(rows, towards) for k in (column.argmin(), column.argmax())}
    order = np.argsort(angle, kind="stable")
    others = order[np.linspace(0, count - 1, SPANNING - len(corners)).round().astype(np.int64)]
    return impacts.take(np.union1d(np.array(sorted(corners), dtype=np.int64), others))


def _directions(count: int) -> FloatArray:
    """Unit vectors (count, 3) spread over half a sphere; the golden ratio turns each against the one before."""
    place = (np.arange(count) + 0.5) / count
    turn = 2.0 * np.pi * np.modf(np.arange(count) * 0.6180339887498949)[0]
    flat = np.sqrt(1.0 - place**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), place], axis=1)


def _quantity(impacts: Impacts, name: str) -> FloatArray:
    if name == "theta_1":
        angle: FloatArray = impacts.angle
        return angle
    column: FloatArray = getattr(impacts, name)
    return column


def _beyond(values: FloatArray, low: float, high: float) -> FloatArray:
    over = values - np.clip(values, low, high)
    return np.where(np.abs(over) > ROUNDING * max(abs(low), abs(high)), over, 0.0)


def _velocities(impacts: Impacts, radius: float) -> FloatArray:
    """Points (impacts, 3) in m/s."""
    return np.stack([impacts.v_x1, impacts.v_y1, radius * impacts.omega_1], axis=1)


def hull_distances(points: FloatArray, places: FloatArray) -> FloatArray:
    """Euclidean distance (places,) of `places` (places, dimensions) to the convex hull of `points`, in their unit."""
    return np.array([_hull_distance(points - place) for place in places])


def _hull_distance(points: FloatArray) -> float:
    """Distance of the origin to the convex hull of `points` (points, dimensions).

    The mixture w >= 0 that minimises |w' points|^2 + (sum(w) - 1)^2 is, but for its sum, the nearest point's.
    """
    # The hull of a single far point leaves the sum near zero: in units of the points' size it is at least a half.
    size = float(np.linalg.norm(points, axis=1).max())
    if not size > 0.0:
        return 0.0
    system = np.vstack([points.T / size, np.ones(points.shape[0])])
    weights, _ = nnls(system, np.append(np.zeros(points.shape[1]), 1.0))
    return float(np.linalg.norm(weights @ points) / weights.sum())
