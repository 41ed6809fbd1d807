"""The series of a flight, and the fit of two of them.

With K = rho pi R^2/(2 M) and rot(v) = (v_y, -v_x), which turns a ball with topspin that flies to
the right down, dv/dt = g - K C_D |v| v + K C_L |v| rot(v); the spin is constant. C_L is S/(0.981 +
2.022 |S|) + c, S = R omega/|v| (Cross and Lindsey, Sports Eng. 17 (2014) 89).

The unknowns of an impact are place, velocity, offset c of the lift and time of landing and of
release, when the centre is a radius above the court, and the drag of both flights; nothing is
assumed about the contact between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.itf import GRAVITY
from fitball.base.values import BoolArray, FloatArray, IntArray
from fitball.tracks.types import TRACKED, FilmAssumptions, SpinPair, Track, unwrap

# Indices of the unknowns of an impact.
X1, VX1, VY1, LIFT_1, T1, X2, VX2, VY2, LIFT_2, T2, DRAG = range(11)
# Number of these. Behind them comes the bend of the paths by a row delay of the camera [s/m],
# beside the change of the velocities: with it these change as the velocities of the rows say.
FLIGHT_UNKNOWNS = 11
BEND = 11
UNKNOWNS = 12
# In derivatives and information matrices the row delay itself and gravity, which are not fitted,
# come behind the unknowns.
ROW_DELAY, GRAVITY_FITTED = UNKNOWNS, UNKNOWNS + 1
# Precision of a bend that is none.
_NO_BEND = 1e15
# The bend is free by so many sds of the row delay, so that flights do not measure that.
_BEND_WIDTH = 10.0
# Indices of those of `TRACKED` that only marks show.
SPINS = [2, 5, 8]
# Indices of those of `TRACKED` that heights alone show: v_y1 and v_y2.
_VERTICAL = [1, 4]
# Each of `TRACKED` but the spins is a sum of unknowns: index there, unknown, sign.
_MEASURED_BY = (
    (0, VX1, 1),
    (1, VY1, -1),
    (3, VX2, 1),
    (4, VY2, 1),
    (6, T2, 1),
    (6, T1, -1),
    (7, X2, 1),
    (7, X1, -1),
)
# Steps of differences, in the unit of each unknown: far above rounding, far below what bends a
# flight.
_STEPS = np.array([*[1e-4, 1e-3, 1e-3, 1e-3, 1e-6] * 2, 1e-3])
# Frames nearer to the contact than this [s] are of neither flight: the force begins at zero, a
# tenth of a millisecond later the ball is less than 0.01 mm off.
_GUARD_TIME = 1e-4
# Angles wait [s] until the twist of the shell against the core has died out.
_UNTWISTED_TIME = 2.5e-3
# Probability of a pair of spins above which it is sure.
_SURE_PROBABILITY = 0.999
# Fewest frames of a flight: its place and velocity are two unknowns, a third shows the noise.
_FEWEST_SIDE_FRAMES = 3
# Least vertical speed [m/s]: a slower ball rolls, and has no time of contact.
_LEAST_SPEED = 0.3
# Most sweeps of a fit after those with wide errors.
_MOST_SWEEPS = 12
# Sweeps end when no time moves by more than this [s], far below its errors.
_SETTLED_TIME = 1e-7
# A step moves a time by at most this [s], about the duration of a contact.
_MOST_TIME_STEP = 5e-3
# Side of the box, in radii of the ball, in which an outlier is anywhere.
_BOX_RADII = 6.0
# Errors that last have the correlation 1/(1 + (dt/tau)^2/2), tau [s]: about as long as a ball takes
# through a view.
_LASTING_TIME = 0.02
# Offsets of the lift of both sides of a marked ball are correlated: by seams and fluff, less by
# orientation.
_LIFT_CORRELATION = 0.5
# Without marks the spin is unknown, and all of the lift with it: the sd of its coefficient.
_UNMARKED_LIFT_SD = 0.2
# Share of its diagonal that is added to a matrix, to make it regular.
_RIDGE = 1e-10
# Noise of positions [m] before it is measured.
FIRST_NOISE = 2e-3
_NO_FLIGHT = "no flight fits the positions before and after the contact"


class _LinearFlights(NamedTuple):
    """Two flights, linearised at the unknowns of an impact: `residual` (frames, 2) [m], measured
    less expected; `slopes` (14, frames, 2), its negative derivatives by the unknowns, row delay and
    gravity.
    """

    residual: FloatArray
    slopes: FloatArray


class _NormalEquations(NamedTuple):
    """Normal equations of the weighed frames: `info` (2, 14, 14) of x and of y, and by how much the
    residuals and priors pull each unknown, row delay and gravity (14,).
    """

    info: FloatArray
    pull: FloatArray


def lift_of(omega: float, speed: float, radius: float) -> float:
    """Lift coefficient of a ball with a spin [rad/s], a speed [m/s] and a radius [m], by the law of
    Cross and Lindsey (2014); positive for topspin.
    """
    ratio = radius * omega / speed
    return float(ratio / (0.981 + 2.022 * abs(ratio)))


def path(
    v_x: FloatArray | float,
    v_y: FloatArray | float,
    drag: FloatArray | float,
    lift: FloatArray | float,
    k: float,
    d: FloatArray | float,
) -> tuple[FloatArray, FloatArray]:
    """Ways [m] along and up after the times `d` [s], from a velocity [m/s], coefficients of drag
    and lift, and the resistance `k` [1/m]. All arrays broadcast. It is the power series to the
    third order, 0.06 mm off after 0.15 s at 20 m/s.
    """
    speed = np.hypot(v_x, v_y)
    a_x = -k * speed * (drag * v_x - lift * v_y)
    a_y = -GRAVITY - k * speed * (drag * v_y + lift * v_x)
    faster = (v_x * a_x + v_y * a_y) / speed
    j_x = -k * (faster * (drag * v_x - lift * v_y) + speed * (drag * a_x - lift * a_y))
    j_y = -k * (faster * (drag * v_y + lift * v_x) + speed * (drag * a_y + lift * a_x))
    along = d * (v_x + d / 2.0 * (a_x + d / 3.0 * j_x))
    up = d * (v_y + d / 2.0 * (a_y + d / 3.0 * j_y))
    return np.asarray(along), np.asarray(up)


@dataclass(eq=False)
class Impact:
    """Frames of one impact, and what is fitted to them. `rows` are indices of its frames in the
    track, `around` those of both flights from bounce to bounce. `t` [s] counts from `origin`,
    `position` [m] is mirrored where the ball flies to the left (`sign` is then -1), and `phi` [rad]
    grows with topspin.

    The fit moves the unknowns `p`, with their prior, under sds `sigma` [m] of x and y. It sets
    their `covariance`, the `residual` [m] and `weight` of each frame, the probability of being no
    outlier (NaN in contact), the information `info` of x and of y, and `pull`, by which gravity
    would be moved. `pairs` are the spins that marks allow. `failed` says why the
    impact has no fit, "" where it has.
    """

    id: str
    track: Track
    rows: Annotated[IntArray, "frames"]
    around: Annotated[IntArray, "flight_frames"]
    origin: float
    t: Annotated[FloatArray, "frames"]
    position: Annotated[FloatArray, "frames 2"]
    phi: Annotated[FloatArray, "frames"]
    sign: float
    p: Annotated[FloatArray, "12"] = field(default_factory=lambda: np.append(np.ones(11), 0.0))
    prior: Annotated[FloatArray, "12"] = field(default_factory=lambda: np.zeros(UNKNOWNS))
    precision: Annotated[FloatArray, "12 12"] = field(
        default_factory=lambda: np.zeros((UNKNOWNS, UNKNOWNS))
    )
    sigma: Annotated[FloatArray, "2"] = field(default_factory=lambda: np.full(2, FIRST_NOISE))
    covariance: Annotated[FloatArray, "12 12"] = field(init=False)
    residual: Annotated[FloatArray, "frames 2"] = field(init=False)
    weight: Annotated[FloatArray, "frames"] = field(init=False)
    info: Annotated[FloatArray, "2 14 14"] = field(init=False)
    pull: float = 0.0
    pairs: Sequence[SpinPair] = ()
    failed: str = ""

    def sides(self) -> tuple[Annotated[BoolArray, "frames"], Annotated[BoolArray, "frames"]]:
        """Which frames are of the flight before the contact, and which of that after."""
        return self.t < self.p[T1] - _GUARD_TIME, self.t > self.p[T2] + _GUARD_TIME

    @property
    def sure_pair(self) -> SpinPair | None:
        """The most probable spins, if they are sure."""
        if self.pairs and self.pairs[0].probability > _SURE_PROBABILITY:
            return self.pairs[0]
        return None

    def turning(self) -> tuple[Annotated[BoolArray, "frames"], Annotated[BoolArray, "frames"]]:
        """Which frames have angles that show the spin before the contact, and which that after."""
        marked = np.isfinite(self.phi)
        return marked & self.sides()[0], marked & (self.t > self.p[T2] + _UNTWISTED_TIME)

    def angle_residuals(self) -> Annotated[FloatArray, "frames"]:
        """Angles [rad] of the mark less the lines of the most probable spins, NaN where none is."""
        residuals = np.full(self.t.size, np.nan)
        if not self.pairs:
            return residuals
        pair = self.pairs[0]
        spins = (pair.omega_1, pair.omega_2)
        times = self.p[[T1, T2]]
        for use, phi, omega, time in zip(self.turning(), pair.phi, spins, times, strict=True):
            turned = omega * (self.t[use] - time)
            residuals[use] = unwrap(self.phi[use] - phi - turned, self.track.fold)
        return residuals

    def set_prior(self, assumed: FilmAssumptions, drag: float, drag_sd: float) -> None:
        """Set the priors of the unknowns: that of drag as passed, and those of the offsets of the
        lift by whether the spins are sure.
        """
        self.prior[DRAG] = drag
        self.precision[:] = 0.0
        self.precision[DRAG, DRAG] = drag_sd**-2.0
        bend_sd = _BEND_WIDTH * assumed.row_delay_sd
        self.precision[BEND, BEND] = bend_sd**-2.0 if bend_sd else _NO_BEND
        self.prior[[LIFT_1, LIFT_2]] = assumed.lift.value
        if self.sure_pair:
            shared = _LIFT_CORRELATION
            sd = assumed.lift.sd
        else:
            shared = 0.0
            sd = _UNMARKED_LIFT_SD
            # A ball of unknown spin leaves the court nearly rolling.
            v_x = self.p[VX2]
            v_y = self.p[VY2]
            radius = assumed.ball.radius
            self.prior[LIFT_2] += lift_of(v_x / radius, np.hypot(v_x, v_y), radius)
        correlation = np.array([[1.0, shared], [shared, 1.0]])
        block = np.linalg.inv(sd**2 * correlation)
        self.precision[np.ix_([LIFT_1, LIFT_2], [LIFT_1, LIFT_2])] = block

    def lifts(self, radius: float) -> Annotated[FloatArray, "2"]:
        """Lift coefficients before and after the contact, by the law, of spins that are sure; else
        zero.
        """
        pair = self.sure_pair
        if pair is None:
            return np.zeros(2)
        p = self.p
        before = lift_of(pair.omega_1, float(np.hypot(p[VX1], p[VY1])), radius)
        after = lift_of(pair.omega_2, float(np.hypot(p[VX2], p[VY2])), radius)
        return np.array([before, after])


def start(impact: Impact, assumed: FilmAssumptions, height: float) -> None:
    """Set the first unknowns of an impact, by repeated medians of slopes (Siegel 1982) of the
    frames beside the contact, gravity taken off. `height` [m] is that of the centre at contact.
    """
    from scipy.stats import siegelslopes

    usual = assumed.contact.usual
    sides = (impact.t < -usual, impact.t > usual)
    if _too_few(impact, *sides):
        return
    for first, use in zip((X1, X2), sides, strict=True):
        t = impact.t[use]
        straight = impact.position[use] + np.outer(t**2, [0.0, 0.5 * GRAVITY])
        v_x, x = siegelslopes(straight[:, 0], t)
        v_y, y = siegelslopes(straight[:, 1], t)
        time = (height - y) / v_y if abs(v_y) > _LEAST_SPEED else np.nan
        impact.p[first : first + 5] = (x + v_x * time, v_x, v_y - GRAVITY * time, 0.0, time)
    impact.p[DRAG] = assumed.drag.value
    impact.p[BEND] = 0.0
    _check_speeds(impact)


def _too_few(impact: Impact, before: BoolArray, after: BoolArray) -> bool:
    """Whether a flight has too few frames to be fitted; the impact has failed then."""
    few = bool(min(before.sum(), after.sum()) < _FEWEST_SIDE_FRAMES)
    if few:
        words = f"{before.sum()} frames before and {after.sum()} after the contact"
        impact.failed = f"{words}; {_FEWEST_SIDE_FRAMES} on a side are needed"
    return few


def _check_speeds(impact: Impact) -> None:
    """Fail an impact whose flights have no time at which they reach or leave the court."""
    if not np.isfinite(impact.p).all():
        impact.failed = _NO_FLIGHT
    for v_y, does in ((-impact.p[VY1], "reaches"), (impact.p[VY2], "leaves")):
        if not v_y > _LEAST_SPEED and not impact.failed:
            words = f"the ball {does} the court at {v_y:.2g} m/s"
            impact.failed = f"{words}; more than {_LEAST_SPEED} m/s is needed"


# Numbers that are not finite fail the impact, without a warning.
@np.errstate(all="ignore")
def fit(
    impact: Impact,
    assumed: FilmAssumptions,
    height: float,
    outliers: float,
    wide: Sequence[float] = (),
) -> None:
    """Fit the unknowns `p` of an impact by the method of Gauss and Newton. Frames are weighed by
    their probability of being no outlier (EM): errors of x and y are normal, or, with the share
    `outliers`, anywhere in a box of six radii. In the first sweeps sds are multiplied by `wide`.
    The covariance is that of the observed information, which the weights alone overstate. `height`
    [m] is that of the centre at contact.
    """
    lifts = impact.lifts(assumed.ball.radius)
    for sweep in range(_MOST_SWEEPS + len(wide)):
        sds = impact.sigma * (wide[sweep] if sweep < len(wide) else 1.0)
        if impact.p[T2] <= impact.p[T1]:
            # As long as the flights are far from the court.
            half = assumed.contact.usual * np.array([-0.5, 0.5])
            impact.p[[T1, T2]] = impact.p[[T1, T2]].mean() + half
        before, after = impact.sides()
        if _too_few(impact, before, after):
            return
        linear = _linearised(impact, assumed, height, lifts, after)
        z = linear.residual / sds
        square = np.sum(z**2, axis=1)
        good = (1.0 - outliers) * np.exp(-0.5 * square) / (2.0 * np.pi * sds[0] * sds[1])
        box = (_BOX_RADII * assumed.ball.radius) ** 2
        weight = np.where(before | after, good / (good + outliers / box), 0.0)
        normal = _normal_equations(impact, linear, sds, weight, assumed.lasting)
        hessian = normal.info[:, :UNKNOWNS, :UNKNOWNS].sum(axis=0) + impact.precision
        step = _inverse(hessian) @ normal.pull[:UNKNOWNS]
        if not np.isfinite(step).all():
            impact.failed = _NO_FLIGHT
            return
        late = float(np.abs(step[[T1, T2]]).max())
        if sweep >= len(wide) and late < _SETTLED_TIME:
            break
        impact.p = impact.p + step * min(1.0, _MOST_TIME_STEP / max(late, _SETTLED_TIME))
        _check_speeds(impact)
        if impact.failed:
            return
    tail = np.einsum("pfa,fa->pf", linear.slopes[:UNKNOWNS] / sds, z)
    uncertain = np.minimum(1.0 - weight, 1.0 / np.maximum(square, 1e-12))
    lost = tail * (weight * uncertain) @ tail.T
    impact.covariance = _inverse(hessian - lost)
    if not np.all(np.diagonal(impact.covariance) > 0.0):
        impact.failed = _NO_FLIGHT
    impact.residual = linear.residual
    impact.weight = np.where(before | after, weight, np.nan)
    impact.info = normal.info
    impact.pull = normal.pull[GRAVITY_FITTED]


def _linearised(
    impact: Impact,
    assumed: FilmAssumptions,
    height: float,
    lifts: FloatArray,
    after: BoolArray,
) -> _LinearFlights:
    """The flights of an impact at its unknowns; `after` (frames,) says which are of the second."""
    flown = impact.p[:FLIGHT_UNKNOWNS]
    moved = np.vstack([flown, flown + np.diag(_STEPS)])
    first = np.where(after, X2, X1)
    x, v_x, v_y, offset, time = (moved[:, first + k] for k in range(5))
    lift = lifts[np.where(after, 1, 0)] + offset
    along, up = path(v_x, v_y, moved[:, DRAG, None], lift, assumed.k, impact.t - time)
    places = np.stack([x + along, height + up], axis=-1)
    by_unknowns = (places[1:] - places[0]) / _STEPS[:, None, None]
    # A frame in which the ball is higher was read earlier: later contacts move the ball back on
    # its way. To first order velocities change as those of the rows, and paths bend besides.
    back = by_unknowns[T1] + by_unknowns[T2]
    by_delay = back * (impact.position[:, 1:] - height)
    by_bend = by_delay.copy()
    for velocity in ([VX1, VY1], [VX2, VY2]):
        row_velocity = flown[velocity[1]]
        by_bend += row_velocity * np.tensordot(flown[velocity], by_unknowns[velocity], 1)
    # Gravity is not fitted either.
    by_gravity = np.zeros_like(by_delay)
    by_gravity[:, 1] = -0.5 * (impact.t - time[0]) ** 2
    slopes = np.concatenate([by_unknowns, [by_bend, by_delay, by_gravity]])
    expected = places[0] + impact.p[BEND] * by_bend
    return _LinearFlights(impact.position - expected, slopes)


def _normal_equations(
    impact: Impact,
    linear: _LinearFlights,
    sds: FloatArray,
    weight: FloatArray,
    lasting: float,
) -> _NormalEquations:
    """The normal equations of frames with weights (frames,), errors of x and y with sds (2,) [m],
    and errors that last with the sd `lasting` [m].
    """
    root = np.sqrt(weight)
    info = np.zeros((2, len(linear.slopes), len(linear.slopes)))
    pull = np.append(impact.precision @ (impact.prior - impact.p), [0.0, 0.0])
    for axis in (0, 1):
        weighed = linear.slopes[:, :, axis] * (root / sds[axis])
        solved = weighed
        if lasting > 0.0:
            apart = np.subtract.outer(impact.t, impact.t) / _LASTING_TIME
            correlated = lasting**2 / (1.0 + 0.5 * apart**2) * np.multiply.outer(root, root)
            shared = correlated / sds[axis] ** 2
            solved = np.linalg.solve(np.eye(root.size) + shared, weighed.T).T
        info[axis] = weighed @ solved.T
        pull += solved @ (linear.residual[:, axis] / sds[axis] * root)
    return _NormalEquations(info, pull)


def _inverse(matrix: FloatArray) -> FloatArray:
    """The inverse of an information matrix (n, n), whose diagonal differs by many orders of
    magnitude; NaN where it has none.
    """
    scale = 1.0 / np.sqrt(np.diagonal(matrix))
    even = matrix * scale[:, None] * scale + _RIDGE * np.eye(len(scale))
    return np.asarray(np.linalg.inv(even) * scale[:, None] * scale)


def measurement_of(
    impact: Impact,
) -> tuple[Annotated[FloatArray, "9"], Annotated[FloatArray, "9 9"]]:
    """Values of `TRACKED` of a fitted impact and their covariance, SI. Spins and turn are NaN
    without a pair that is sure; of heights alone all are but the vertical velocities.
    """
    jacobian = np.zeros((len(TRACKED), UNKNOWNS))
    for row, column, sign in _MEASURED_BY:
        jacobian[row, column] = sign
    values = jacobian @ impact.p
    if impact.track.vertical:
        others = [k for k in range(len(TRACKED)) if k not in _VERTICAL]
        values[others] = np.nan
        return values, jacobian @ impact.covariance @ jacobian.T
    pair = impact.sure_pair
    if pair is None:
        values[SPINS] = np.nan
        return values, jacobian @ impact.covariance @ jacobian.T
    # The turn in contact, by the spins up to landing and from release.
    jacobian[8, [T1, T2]] = -pair.omega_1, pair.omega_2
    covariance = jacobian @ impact.covariance @ jacobian.T
    values[SPINS] = pair.omega_1, pair.omega_2, pair.turn
    covariance[np.ix_(SPINS, SPINS)] += pair.covariance
    return values, covariance
