"""Whether new impacts lie where a model was calibrated: in each quantity, and in their combination.

The quantities are vertical speed, incidence angle and spin. The combination is judged among `v_x1`, `v_y1` and the
surface speed `R omega_1`, all in m/s, by the distance to the convex hull of the calibrated impacts: the
least-distance problem of Lawson and Hanson (1974, ch. 23), solved by non-negative least squares.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from fitball.errors import ModelError
from fitball.inference.results.fitted_model import FittedModel
from fitball.models.model import ball_columns
from fitball.models.types import STATUS_REASON, Rebound, Status
from fitball.values import FloatArray, Impacts

# The speeds at which a fitted bounce is sound, and a bounce for every other speed. A line of restitution that was
# fitted between 5 and 15 m/s ends somewhere: below it meets `mass_ratio`, above the rebound grows slower, and then
# there is none. The bounce obeys a scaling law: with restitution and offset held, all speeds and spins may be
# multiplied by one number. So the total bounce outside the valid range is that at its nearer end, scaled: restitution
# and offset stay what they are there, and everything else is computed.

# Speeds [m/s] beyond which no range is looked for: a ball at rest, and twice the fastest serve.
LOWEST, HIGHEST = 0.01, 100.0
# Neighbouring speeds that are tried, as a ratio; what is sound at both is taken to be so between.
STEP = 1.04
# How near the end of the range is found, as a ratio, and how far it is moved inwards then.
CLOSE = 1e-12
INWARDS = 1e-9
# Directions and slips in which a speed is tried, as shares of `v_y1`: flat and steep, from strong backspin over
# rolling to strong topspin.
ALONG = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
SLIP = (-40.0, -10.0, -5.0, -2.0, -1.0, -0.3, -0.1, 0.0, 0.1, 0.3, 1.0, 2.0, 5.0, 10.0, 40.0)
# Kinetic energy that rounding may add, as a share.
ENERGY_ROUNDING = 1e-9
# Below this share of the speed along the court and around, `v_y1` moves neither: the ball grazes.
GRAZING = 1e-12
# Below this [m/s] there is nothing to scale.
TINY = 1e-200

LOW_END, HIGH_END = "no limit found: the smallest speed tried", "no limit found: the largest speed tried"
SLOWER = "v_y2 would fall while v_y1 grows"
GAIN = "some bounces would gain kinetic energy"


@dataclass(frozen=True)
class ValidRange:
    """Speeds `v_y1` [m/s] from `low` to `high` at which the fitted bounce is used as it is.

    It holds every calibrated impact that the model solves. It extends from there as far as three conditions hold. The
    model has a rebound for flat and steep impacts with all spins. `v_y2` grows with `v_y1`. No bounce gains energy,
    or none more than at the calibrated end, where `gain` is the largest share. `below` and `above` are what limits
    it.
    """

    low: float
    high: float
    below: str
    above: str
    gain: float

    def outside(self, v_y1: FloatArray) -> NDArray[np.bool_]:
        """Which of the speeds lie outside."""
        return (v_y1 < self.low) | (v_y1 > self.high)


def valid_range(fitted: FittedModel) -> ValidRange:
    """The range of a fitted model at its point estimate; some tenths of a second.

    Raises ModelError when it solves none of the impacts it was calibrated on.
    """
    solved = fitted.rebound(fitted.impacts).status[0] == Status.OK
    if not np.any(solved):
        raise ModelError("the model cannot be evaluated at any calibrated impact, at the point estimate")
    speeds = fitted.impacts.v_y1[solved]
    cor = None if fitted.impacts.cor is None else float(np.median(fitted.impacts.cor[solved]))
    look = _Look(fitted, cor)
    slowest, fastest = float(speeds.min()), float(speeds.max())
    low, below = _end(look, slowest, LOWEST, LOW_END)
    high, above = _end(look, fastest, HIGHEST, HIGH_END)
    return ValidRange(low, high, below, above, max(look.gain(slowest), look.gain(fastest)))


def restitution_range(fitted: FittedModel) -> tuple[float, float]:
    """Of a model that takes each impact's restitution as an input: the smallest and the largest it can evaluate."""
    assert fitted.impacts.cor is not None
    speed = float(np.median(fitted.impacts.v_y1))
    told = float(np.median(fitted.impacts.cor))

    def sound(cor: float) -> bool:
        return not _Look(fitted, cor).fault(speed)

    low, high = (end if sound(end) else _edge(sound, told, end) for end in (1e-3, 1.0))
    return low, high


def total_rebound(fitted: FittedModel, valid: ValidRange, impacts: Impacts) -> tuple[Rebound, NDArray[np.bool_]]:
    """Rebounds (1, impacts) at the point estimate for every speed, and which of them (impacts,) are extrapolated.

    Inside the valid range as `FittedModel.rebound`; outside the bounce at its nearer end, scaled. A ball that grazes
    keeps `v_x` and spin. Statuses are those of single impacts that the model does not solve in its range.
    """
    radius = fitted.ball.radius
    grazes = impacts.v_y1 <= np.maximum(GRAZING * (np.abs(impacts.v_x1) + radius * np.abs(impacts.omega_1)), TINY)
    inside = np.clip(impacts.v_y1, valid.low, valid.high)
    scale = np.where(grazes, 1.0, impacts.v_y1 / inside)
    v_x1, omega_1 = (np.where(grazes, 0.0, column / scale) for column in (impacts.v_x1, impacts.omega_1))
    made = fitted.rebound(replace(impacts, v_x1=v_x1, v_y1=inside, omega_1=omega_1))
    scaled = replace(
        made,
        v_x2=np.where(grazes, impacts.v_x1, made.v_x2 * scale),
        v_y2=np.where(grazes, made.v_y2 * (impacts.v_y1 / inside), made.v_y2 * scale),
        omega_2=np.where(grazes, impacts.omega_1, made.omega_2 * scale),
        gap_path=np.where(grazes, impacts.v_x1 * made.gap_time, made.gap_path * scale),
        gap_turn=np.where(grazes, impacts.omega_1 * made.gap_time, made.gap_turn * scale),
        regime=np.where(grazes, 0, made.regime),
    )
    return scaled, valid.outside(impacts.v_y1)


class _Look:
    """What is wrong with a fitted bounce at a speed."""

    def __init__(self, fitted: FittedModel, cor: float | None) -> None:
        self.fitted, self.cor = fitted, cor
        kept = fitted.model_columns
        row = fitted.point[None, kept]
        mass, radius, inertia = ball_columns(fitted.model.ball, [fitted.names[k] for k in kept], row)
        self.radius, self.spin_weight = float(radius[0]), float(inertia[0] / mass[0])
        along, slip = (ALONG, SLIP) if fitted.tangential else ((0.0,), (0.0,))
        fan = np.stack(np.meshgrid(along, slip, indexing="ij")).reshape(2, -1)
        self.along, self.surface = fan[0], fan[0] - fan[1]

    def fault(self, speed: float, allowed: float = 0.0) -> str:
        """Why a speed is not sound; empty where it is. That `v_y2` grows is asked of a hair of it; of the kinetic
        energy a share `allowed` may be gained.
        """
        faster = speed * (1.0 + 1e-6)
        here, there = self._rebound(speed), self._rebound(faster)
        failed = here.status[0][here.status[0] != Status.OK]
        if failed.size:
            return STATUS_REASON[Status(int(failed[0]))]
        if there.status[0, 0] == Status.OK and there.v_y2[0, 0] <= here.v_y2[0, 0]:
            return SLOWER
        return GAIN if self._gain(here, speed) > allowed + ENERGY_ROUNDING else ""

    def gain(self, speed: float) -> float:
        """The largest share of its kinetic energy that a bounce at this speed gains; 0 where all lose."""
        here = self._rebound(speed)
        return 0.0 if np.any(here.status != Status.OK) else max(0.0, self._gain(here, speed))

    def _gain(self, here: Rebound, speed: float) -> float:
        before = self._energy(self.along * speed, speed, self.surface * speed / self.radius)
        after = self._energy(here.v_x2[0], here.v_y2[0], here.omega_2[0])
        return float(np.max(after / before)) - 1.0

    def _rebound(self, speed: float) -> Rebound:
        v_y1 = np.full(self.along.size, speed)
        cor = None if self.cor is None else np.full(self.along.size, self.cor)
        return self.fitted.rebound(Impacts(self.along * speed, v_y1, self.surface * speed / self.radius, cor))

    def _energy(self, v_x: FloatArray, v_y: FloatArray | float, omega: FloatArray) -> FloatArray:
        return np.asarray(v_x**2 + v_y**2 + self.spin_weight * omega**2)


def _end(look: _Look, start: float, limit: float, unlimited: str) -> tuple[float, str]:
    """How far from `start` towards `limit` every speed is sound, and why not further."""
    count = max(2, int(np.ceil(abs(np.log(limit / start)) / np.log(STEP))) + 1)
    last, allowed = start, look.gain(start)
    for speed in np.geomspace(start, limit, count)[1:].tolist():
        fault = look.fault(speed, allowed)
        if fault:
            if last == start and look.fault(start, allowed):
                # The calibrated impacts are solved, but others at their speed are not.
                return start, fault
            edge = _edge(lambda value: not look.fault(value, allowed), last, speed)
            inwards = edge * (1.0 + (INWARDS if speed < start else -INWARDS))
            return (max(inwards, last) if speed > start else min(inwards, last)), fault
        last = speed
    return limit, unlimited


def _edge(sound: Callable[[float], bool], inside: float, outside: float) -> float:
    """The last sound value between one that is and one that is not."""
    while abs(outside - inside) > CLOSE * abs(inside):
        middle = 0.5 * (inside + outside)
        if middle in (inside, outside):
            break
        inside, outside = (middle, outside) if sound(middle) else (inside, middle)
    return inside


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
