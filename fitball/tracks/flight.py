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
from typing import Any

import numpy as np

from fitball.base.itf import GRAVITY
from fitball.base.values import BoolArray, FloatArray, IntArray
from fitball.tracks.types import NINE, Filming, SpinPair, Track, unwrapped

X1, VX1, VY1, C1, T1, X2, VX2, VY2, C2, T2, DRAG = range(11)
# Those of the `NINE` that only marks show.
SPINS = [2, 5, 8]
# Steps of differences, in the unit of each unknown: far above rounding, far below what bends a
# flight.
_STEPS = np.array([*[1e-4, 1e-3, 1e-3, 1e-3, 1e-6] * 2, 1e-3])
# Frames nearer to the contact than this [s] are of neither flight: the force begins at zero, a
# tenth of a millisecond later the ball is less than 0.01 mm off. Angles wait until the twist of the
# shell against the core has died out.
_GUARD = 1e-4
_TWISTED = 2.5e-3
# Probability of a pair of spins above which it is sure.
_SURE = 0.999
# Fewest frames on a side, slowest vertical speed [m/s] that has a time of contact.
_FEWEST = 3
_SLOWEST = 0.3
# Most sweeps, when no time moves by more than this [s] they end; the most that a step may move one.
_SWEEPS = 12
_SETTLED = 1e-7
_LEAP = 5e-3
# Errors that last have the correlation 1/(1 + (dt/tau)^2/2), tau [s]: about as long as a ball takes
# through a view.
_LASTING = 0.02
# Offsets of the lift of both sides of a marked ball are correlated: by seams and fluff, less by
# orientation. Without marks the spin is unknown, and all of the lift with it.
_SHARED = 0.5
_UNMARKED = 0.2
# Makes matrices regular, as a share of their diagonal.
_RIDGE = 1e-10
_NO_FLIGHT = "no flight fits the positions before and after the contact"


def lift_of(omega: float, speed: float, radius: float) -> float:
    """Lift coefficient of a spin [rad/s, topspin positive], of its sign."""
    ratio = radius * omega / speed
    return float(ratio / (0.981 + 2.022 * abs(ratio)))


def path(v_x: Any, v_y: Any, drag: Any, lift: Any, k: float, d: Any) -> tuple[Any, Any]:
    """Way after the times `d` by the power series to the third order: 0.06 mm off after 0.15 s at
    20 m/s.
    """
    speed = np.hypot(v_x, v_y)
    a_x = -k * speed * (drag * v_x - lift * v_y)
    a_y = -GRAVITY - k * speed * (drag * v_y + lift * v_x)
    faster = (v_x * a_x + v_y * a_y) / speed
    j_x = -k * (faster * (drag * v_x - lift * v_y) + speed * (drag * a_x - lift * a_y))
    j_y = -k * (faster * (drag * v_y + lift * v_x) + speed * (drag * a_y + lift * a_x))
    return d * (v_x + d / 2.0 * (a_x + d / 3.0 * j_x)), d * (v_y + d / 2.0 * (a_y + d / 3.0 * j_y))


@dataclass(eq=False)
class Impact:
    """Frames of one impact, and what is found of it. `rows` are places in the track, `around` those
    of its whole flights; `t` [s] is from `origin`, `place` (frames, 2) [m] mirrored where the ball
    flies to the left (`sign` -1), `phi` [rad] topspin positive.

    While it is fitted: unknowns `p` (11,) with their prior; sds `sigma` of x and y; then
    `covariance`, `residual` (frames, 2), `weight`, the probability of being no outlier (NaN in
    contact), `info` (2, 12, 12) of x and of y and `pull`, by which gravity, the last there, would
    be moved; `pairs` of spins. `failed` says why there is none.
    """

    id: str
    track: Track
    rows: IntArray
    around: IntArray
    origin: float
    t: FloatArray
    place: FloatArray
    phi: FloatArray
    sign: float
    p: FloatArray = field(default_factory=lambda: np.ones(11))
    prior: FloatArray = field(default_factory=lambda: np.zeros(11))
    precision: FloatArray = field(default_factory=lambda: np.zeros((11, 11)))
    sigma: FloatArray = field(default_factory=lambda: np.full(2, 2e-3))
    covariance: FloatArray = field(init=False)
    residual: FloatArray = field(init=False)
    weight: FloatArray = field(init=False)
    info: FloatArray = field(init=False)
    pull: float = 0.0
    pairs: Sequence[SpinPair] = ()
    failed: str = ""

    def sides(self) -> tuple[BoolArray, BoolArray]:
        """Which frames are of the flight before, and of that after."""
        first = self.p[T1]
        last = self.p[T2]
        return self.t < first - _GUARD, self.t > last + _GUARD

    @property
    def taken(self) -> SpinPair | None:
        """The most probable spins, if they are sure."""
        return self.pairs[0] if self.pairs and self.pairs[0].probability > _SURE else None

    def turning(self) -> tuple[BoolArray, BoolArray]:
        """Which frames have angles that show the spin before, and that after."""
        seen = np.isfinite(self.phi)
        return seen & self.sides()[0], seen & (self.t > self.p[T2] + _TWISTED)

    def angle_residuals(self) -> FloatArray:
        """Angles less the lines of the most probable spins (frames,), NaN where no line is."""
        found = np.full(self.t.size, np.nan)
        if self.pairs:
            pair = self.pairs[0]
            for use, phi, omega, time in zip(
                self.turning(),
                pair.phi,
                pair[:2],
                self.p[[T1, T2]],
                strict=True,
            ):
                found[use] = unwrapped(
                    self.phi[use] - phi - omega * (self.t[use] - time),
                    self.track.fold,
                )
        return found

    def take_prior(self, known: Filming, drag: float, drag_sd: float) -> None:
        """Priors of drag and lift; those of the lift by whether spins are taken."""
        self.prior[DRAG] = drag
        self.precision[:] = 0.0
        self.precision[DRAG, DRAG] = drag_sd**-2.0
        shared, sd = (_SHARED, known.lift[1]) if self.taken else (0.0, _UNMARKED)
        self.prior[[C1, C2]] = known.lift[0]
        if not self.taken:
            # A ball of unknown spin leaves the court nearly rolling.
            v_x = self.p[VX2]
            v_y = self.p[VY2]
            radius = known.ball.radius
            self.prior[C2] += lift_of(v_x / radius, np.hypot(v_x, v_y), radius)
        block = np.linalg.inv(sd**2 * np.array([[1.0, shared], [shared, 1.0]]))
        self.precision[np.ix_([C1, C2], [C1, C2])] = block

    def lifts(self, radius: float) -> FloatArray:
        """Lift coefficients (2,) of the spins that are taken."""
        if self.taken is None:
            return np.zeros(2)
        spins = (self.taken.omega_1, self.taken.omega_2)
        speeds = np.hypot(self.p[[VX1, VX2]], self.p[[VY1, VY2]])
        return np.array([lift_of(*one, radius) for one in zip(spins, speeds.tolist(), strict=True)])


def start(one: Impact, known: Filming, height: float) -> None:
    """First unknowns: repeated medians of slopes (Siegel 1982) of frames beside the contact,
    gravity taken off.
    """
    from scipy.stats import siegelslopes

    sides = one.t < -known.contact[0], one.t > known.contact[0]
    if _too_few(one, *sides):
        return
    for o, use in zip((X1, X2), sides, strict=True):
        place = one.place[use] + np.outer(one.t[use] ** 2, [0.0, 0.5 * GRAVITY])
        (v_x, x), (v_y, y) = (siegelslopes(values, one.t[use]) for values in place.T)
        time = (height - y) / v_y if abs(v_y) > _SLOWEST else np.nan
        one.p[o : o + 5] = x + v_x * time, v_x, v_y - GRAVITY * time, 0.0, time
    one.p[DRAG] = known.drag[0]
    _check(one)


def _too_few(one: Impact, before: BoolArray, after: BoolArray) -> bool:
    if few := min(before.sum(), after.sum()) < _FEWEST:
        words = f"{before.sum()} frames before and {after.sum()} after the contact"
        one.failed = f"{words}; {_FEWEST} on a side are needed"
    return bool(few)


def _check(one: Impact) -> None:
    """A flight needs a time at which it meets the court."""
    if not np.isfinite(one.p).all():
        one.failed = _NO_FLIGHT
    for v_y, does in ((-one.p[VY1], "reaches"), (one.p[VY2], "leaves")):
        if not v_y > _SLOWEST and not one.failed:
            one.failed = (
                f"the ball {does} the court at {v_y:.2g} m/s; more than {_SLOWEST} m/s is needed"
            )


# What is not finite is a failure of the impact.
@np.errstate(all="ignore")
def fit(
    one: Impact,
    known: Filming,
    height: float,
    outliers: float,
    wide: Sequence[float] = (),
) -> None:
    """Gauss and Newton from `p`, frames weighed by their probability of being no outlier (EM):
    errors of x and y are normal, or with the share `outliers` anywhere in a box of six radii. First
    sweeps have errors so many times as `wide`. The covariance is of the observed information, which
    these weights alone overstate.
    """
    box = (6.0 * known.ball.radius) ** 2
    lifts = one.lifts(known.ball.radius)
    precision = one.precision
    for sweep in range(_SWEEPS + len(wide)):
        s = one.sigma * (wide[sweep] if sweep < len(wide) else 1.0)
        if one.p[T2] <= one.p[T1]:
            # As long as the flights are far from the court.
            one.p[[T1, T2]] = one.p[[T1, T2]].mean() + known.contact[0] * np.array([-0.5, 0.5])
        before, after = one.sides()
        use = before | after
        if _too_few(one, before, after):
            return
        moved = np.vstack([one.p, one.p + np.diag(_STEPS)])
        o = np.where(after, X2, X1)
        x, v_x, v_y, c, time = (moved[:, o + k] for k in range(5))
        along, up = path(
            v_x,
            v_y,
            moved[:, DRAG, None],
            lifts[np.where(after, 1, 0)] + c,
            known.k,
            one.t - time,
        )
        places = np.stack([x + along, height + up], axis=-1)
        residual = one.place - places[0]
        slopes = np.concatenate(
            [(places[1:] - places[0]) / _STEPS[:, None, None], np.zeros((1, *one.place.shape))]
        )
        # By gravity, which is not fitted.
        slopes[-1, :, 1] = -0.5 * (one.t - time[0]) ** 2
        z = residual / s
        square = np.sum(z**2, axis=1)
        like = (1.0 - outliers) * np.exp(-0.5 * square) / (2.0 * np.pi * s[0] * s[1])
        weight = np.where(use, like / (like + outliers / box), 0.0)
        root = np.sqrt(weight)
        info = np.zeros((2, 12, 12))
        pull = np.append(precision @ (one.prior - one.p), 0.0)
        for axis in (0, 1):
            u = solved = slopes[:, :, axis] * (root / s[axis])
            if known.lasting > 0.0:
                far = np.subtract.outer(one.t, one.t) / _LASTING
                shared = (
                    known.lasting**2
                    / (1.0 + 0.5 * far**2)
                    * np.multiply.outer(root, root)
                    / s[axis] ** 2
                )
                solved = np.linalg.solve(np.eye(root.size) + shared, u.T).T
            info[axis] = u @ solved.T
            pull += solved @ (z[:, axis] * root)
        hessian = info[:, :-1, :-1].sum(axis=0) + precision
        step = _inverse(hessian) @ pull[:-1]
        late = float(np.abs(step[[T1, T2]]).max())
        if not np.isfinite(step).all():
            one.failed = _NO_FLIGHT
            return
        if sweep >= len(wide) and late < _SETTLED:
            break
        one.p = one.p + step * min(1.0, _LEAP / max(late, _SETTLED))
        _check(one)
        if one.failed:
            return
    tail = np.einsum("pfa,fa->pf", slopes[:-1] / s, z)
    lost = tail * (weight * np.minimum(1.0 - weight, 1.0 / np.maximum(square, 1e-12))) @ tail.T
    one.covariance = _inverse(hessian - lost)
    if not np.all(np.diagonal(one.covariance) > 0.0):
        one.failed = _NO_FLIGHT
    one.residual = residual
    one.weight = np.where(use, weight, np.nan)
    one.info = info
    one.pull = pull[-1]


def _inverse(matrix: FloatArray) -> FloatArray:
    """Of an information matrix, whose diagonal differs by many orders of magnitude; NaN where it
    has none.
    """
    scale = 1.0 / np.sqrt(np.diagonal(matrix))
    even = matrix * scale[:, None] * scale + _RIDGE * np.eye(len(scale))
    return np.asarray(np.linalg.inv(even) * scale[:, None] * scale)


def nine(one: Impact) -> tuple[FloatArray, FloatArray]:
    """Values and covariance of the `NINE`; spins and turn are NaN without a pair that is sure."""
    take = np.zeros((len(NINE), 11))
    signs = (
        (0, VX1, 1),
        (1, VY1, -1),
        (3, VX2, 1),
        (4, VY2, 1),
        (6, T2, 1),
        (6, T1, -1),
        (7, X2, 1),
        (7, X1, -1),
    )
    for row, column, sign in signs:
        take[row, column] = sign
    values = take @ one.p
    pair = one.taken
    if pair:
        take[8, [T1, T2]] = -pair.omega_1, pair.omega_2
    covariance = take @ one.covariance @ take.T
    values[SPINS] = pair[:3] if pair else np.nan
    covariance[np.ix_(SPINS, SPINS)] += pair.covariance if pair else 0.0
    return values, covariance
