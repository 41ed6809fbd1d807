"""Landing and release of many impacts: two flights through the frames before and after each contact.

The unknowns of one impact are `UNKNOWNS`: at the height of contact, a radius above the court, the state before and
after with the offset of its lift and the line of its angle; and the drag of both flights. Landing and release are
different instants at different places, and nothing is assumed about the contact between them.

Errors of a frame are a mixture, for x and y together: normal, or with a small probability anywhere in a box about the
ball. Gauss and Newton's steps weigh each frame by its probability of being no outlier (EM). The covariance uses the
observed information, which these weights alone overstate: with `z` the standardised residuals of a frame of weight
`g`, the curvature of its log likelihood is `g I - g (1 - g) z z'`. No frame's part is taken below zero.

Frames in contact are left out by iteration. The force on the ball starts at zero: a tenth of a millisecond into the
contact it is less than 0.01 mm from its flight, so that an error of the times of that size does no harm.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import inner
from fitball.tracks.flight import SHORT, acceleration, integrated, lift_of, series
from fitball.tracks.frames import AFTER, BEFORE, CONTACT, NINE, UNUSED
from fitball.tracks.kernels import compiled
from fitball.values import FloatArray

# Of each side, before and after: place, velocity, offset of the lift coefficient, angle and spin; then drag.
SIDE = ("x", "v_x", "y", "v_y", "c", "phi", "omega")
X, V_X, Y, V_Y, C, PHI, OMEGA = range(7)
WIDTH = len(SIDE)
DRAG = 2 * WIDTH
COUNT = DRAG + 1
UNKNOWNS = (*(f"{name}_{side}" for side in (1, 2) for name in SIDE), "drag")
# What the information is made of: x, y and angles of frames, and what outliers take off.
INFO_X, INFO_Y, INFO_ANGLE, INFO_OUTLIERS = range(4)
# Steps of differences: of velocities [m/s], coefficients, and spins [rad/s].
STEP_V, STEP_C, STEP_OMEGA = 1e-3, 1e-3, 1e-2
# Frames nearer to the contact than this [s] are of neither flight. Angles after it wait longer, until the twist of
# the shell against the core, whose time constant is about a millisecond, has died out.
GUARD, TWISTED = 1e-4, 2.5e-3
# Fewest frames on a side, and slowest vertical speed [m/s] at which a flight has a time of contact.
FEWEST, SLOWEST = 3, 0.3
# The offsets of the lift of both sides of one ball are correlated: by seams and fluff, less by orientation.
LIFT_SHARED = 0.5
# Times by which errors are widened in the first sweeps, while outliers are still among the frames.
WIDER = (8.0, 4.0, 2.0, 1.0)
# Frames that are left out about the contact [s], beside half its usual time, before its ends are known.
AWAY = 1e-3
# Sweeps end when no time of contact moves by more than this [s].
SETTLED = 1e-7
# What a state may be without data: it keeps matrices regular and adds nothing to what frames say.
RIDGE = 1e-6
# Added to the diagonal of correlations: frames that do not determine a flight make no singular matrix.
REGULAR = 1e-12


@dataclass
class Batch:
    """Impacts side by side: `t, x, y, phi` (impacts, frames) [s, m, rad, NaN where there is none], times from about
    the contact, angles topspin positive and known modulo a turn over `fold` (impacts,). `height` [m] is that of the
    centre at contact, `k` [1/m] the resistance (`flight.resistance`). Sds `sigma` (impacts, 3) are of x, y, angle;
    `outliers` are the shares of frames and of angles.
    """

    t: FloatArray
    x: FloatArray
    y: FloatArray
    phi: FloatArray
    fold: FloatArray
    height: float
    k: float
    radius: float
    sigma: FloatArray
    outliers: FloatArray
    contact_time: float

    def take(self, rows: NDArray[np.int64]) -> Batch:
        """That of some of the impacts."""
        return Batch(
            self.t[rows], self.x[rows], self.y[rows], self.phi[rows], self.fold[rows], self.height, self.k,
            self.radius, self.sigma[rows], self.outliers, self.contact_time,
        )  # fmt: skip


@dataclass
class Priors:
    """Of coefficients, by impact: `drag` and its sd (impacts,), mean (impacts, 2) and sd (impacts,) of the offset of
    `lift` on both sides, and whether its spin is known (`marked`); offsets are independent where it is not.
    """

    drag: FloatArray
    drag_sd: FloatArray
    lift: FloatArray
    lift_sd: FloatArray
    marked: NDArray[np.bool_]

    def precision(self) -> FloatArray:
        """(impacts, COUNT, COUNT)."""
        made = np.zeros((self.drag.size, COUNT, COUNT))
        made[:, range(COUNT), range(COUNT)] = RIDGE
        made[:, DRAG, DRAG] += self.drag_sd**-2
        shared = np.where(self.marked, LIFT_SHARED, 0.0)
        share = self.lift_sd**-2 / (1.0 - shared**2)
        for one in (C, WIDTH + C):
            made[:, one, one] += share
        made[:, C, WIDTH + C] = made[:, WIDTH + C, C] = -share * shared
        for one in (PHI, OMEGA, WIDTH + PHI, WIDTH + OMEGA):
            made[:, one, one] += np.where(self.marked, 0.0, 1.0)
        return made

    def means(self) -> FloatArray:
        """(impacts, COUNT)."""
        made = np.zeros((self.drag.size, COUNT))
        made[:, DRAG] = self.drag
        made[:, C], made[:, WIDTH + C] = self.lift.T
        return made


@dataclass
class Sides:
    """What is found: `state` (impacts, COUNT) at the `times` (impacts, 2) of landing and release, `role` of frames,
    `weight`, `angle_weight` and residuals `r_x, r_y, r_phi` (impacts, frames); `info` (impacts, 4, COUNT, COUNT),
    `covariance` of the state, and `rows` (impacts, frames, 2, 8), derivatives (see `_row`). `failed` says why an
    impact has none ("" where it has).
    """

    state: FloatArray
    times: FloatArray
    role: NDArray[np.int64]
    weight: FloatArray
    angle_weight: FloatArray
    r_x: FloatArray
    r_y: FloatArray
    r_phi: FloatArray
    info: FloatArray
    gradient: FloatArray
    covariance: FloatArray
    rows: FloatArray
    failed: list[str] = field(default_factory=list)

    @classmethod
    def empty(cls, batch: Batch) -> Sides:
        """Room for a batch."""
        count = batch.t.shape[0]
        nan = np.full(batch.t.shape, np.nan)
        return cls(
            np.zeros((count, COUNT)), np.zeros((count, 2)), np.zeros(batch.t.shape, dtype=np.int64),
            nan.copy(), nan.copy(), nan.copy(), nan.copy(), nan.copy(), np.zeros((count, 4, COUNT, COUNT)),
            np.zeros((count, COUNT)), np.zeros((count, COUNT, COUNT)), np.zeros((*batch.t.shape, 2, WIDTH + 1)),
            [""] * count,
        )  # fmt: skip

    @property
    def good(self) -> NDArray[np.bool_]:
        """Those that have not failed."""
        return np.array([not reason for reason in self.failed], dtype=bool)


@inner
def _moved(v_x: float, v_y: float, drag: float, lift: float, k: float, d: float) -> tuple[float, float]:
    """Path after the time `d`."""
    if abs(d) <= SHORT:
        x, y, _v_x, _v_y = series(v_x, v_y, drag, lift, k, d)
    else:
        x, y, _v_x, _v_y = integrated(v_x, v_y, drag, lift, k, d)
    return x, y


@inner
def _lift(v_x: float, v_y: float, offset: float, omega: float, marked: bool, radius: float) -> float:
    """Lift coefficient of one side; that of a spin which is not known is all offset."""
    if not marked:
        return offset
    return float(lift_of(omega, np.sqrt(v_x * v_x + v_y * v_y), radius) + offset)


@inner
def _row(side: FloatArray, drag: float, marked: bool, radius: float, k: float, d: float, row: FloatArray) -> None:
    """`row` (2, 8): derivatives of x and y at the time `d` by the unknowns of a side and the drag, in the order
    x, v_x, y, v_y, c, phi, omega, drag; under phi, on which no position depends, is the path itself.
    """
    v_x, v_y, omega = side[V_X], side[V_Y], side[OMEGA]
    lift = _lift(v_x, v_y, side[C], omega, marked, radius)
    x, y = _moved(v_x, v_y, drag, lift, k, d)
    more = _lift(v_x + STEP_V, v_y, side[C], omega, marked, radius)
    a_x, a_y = _moved(v_x + STEP_V, v_y, drag, more, k, d)
    more = _lift(v_x, v_y + STEP_V, side[C], omega, marked, radius)
    b_x, b_y = _moved(v_x, v_y + STEP_V, drag, more, k, d)
    c_x, c_y = _moved(v_x, v_y, drag, lift + STEP_C, k, d)
    d_x, d_y = _moved(v_x, v_y, drag + STEP_C, lift, k, d)
    by_omega = (_lift(v_x, v_y, side[C], omega + STEP_OMEGA, marked, radius) - lift) / STEP_OMEGA
    row[0, X], row[1, X] = 1.0, 0.0
    row[0, Y], row[1, Y] = 0.0, 1.0
    row[0, V_X], row[1, V_X] = (a_x - x) / STEP_V, (a_y - y) / STEP_V
    row[0, V_Y], row[1, V_Y] = (b_x - x) / STEP_V, (b_y - y) / STEP_V
    row[0, C], row[1, C] = (c_x - x) / STEP_C, (c_y - y) / STEP_C
    row[0, OMEGA], row[1, OMEGA] = row[0, C] * by_omega, row[1, C] * by_omega
    row[0, WIDTH], row[1, WIDTH] = (d_x - x) / STEP_C, (d_y - y) / STEP_C
    row[0, PHI], row[1, PHI] = x, y


@compiled
def _paths(
    t: FloatArray, role: NDArray[np.int64], times: FloatArray, state: FloatArray, marked: NDArray[np.bool_],
    known: FloatArray, rows: FloatArray,
) -> None:  # fmt: skip
    """`rows` (impacts, frames, 2, 8) of all frames that belong to a flight; `known` begins with k and radius."""
    for i in range(t.shape[0]):
        for f in range(t.shape[1]):
            if role[i, f] != BEFORE and role[i, f] != AFTER:
                continue
            side = 0 if role[i, f] == BEFORE else 1
            own = state[i, side * WIDTH : (side + 1) * WIDTH]
            _row(own, state[i, DRAG], marked[i], known[1], known[0], t[i, f] - times[i, side], rows[i, f])


@compiled
def _normal(
    t: FloatArray, x: FloatArray, y: FloatArray, phi: FloatArray, fold: FloatArray, role: NDArray[np.int64],
    times: FloatArray, state: FloatArray, sigma: FloatArray, marked: NDArray[np.bool_], known: FloatArray,
    rows: FloatArray, info: FloatArray, gradient: FloatArray, weight: FloatArray, angle_weight: FloatArray,
    r_x: FloatArray, r_y: FloatArray, r_phi: FloatArray,
) -> None:  # fmt: skip
    """Information, gradient, weights and residuals at a state; `known` has k, radius, shares of outliers of frames
    and angles, and the area of the box of outliers.
    """
    share, angle_share, box = known[2], known[3], known[4]
    for i in range(t.shape[0]):
        info[i] = 0.0
        gradient[i] = 0.0
        s_x, s_y, s_a = sigma[i, 0], sigma[i, 1], sigma[i, 2]
        for f in range(t.shape[1]):
            weight[i, f] = angle_weight[i, f] = r_x[i, f] = r_y[i, f] = r_phi[i, f] = np.nan
            if role[i, f] != BEFORE and role[i, f] != AFTER:
                continue
            side = 0 if role[i, f] == BEFORE else 1
            o = side * WIDTH
            d = t[i, f] - times[i, side]
            row = rows[i, f]
            a = x[i, f] - state[i, o + X] - row[0, PHI]
            b = y[i, f] - state[i, o + Y] - row[1, PHI]
            z_x, z_y = a / s_x, b / s_y
            q = z_x * z_x + z_y * z_y
            like = (1.0 - share) * np.exp(-0.5 * q) / (2.0 * np.pi * s_x * s_y)
            g = like / (like + share / box)
            r_x[i, f], r_y[i, f], weight[i, f] = a, b, g
            less = g * min(1.0 - g, 1.0 / max(q, 1e-12))
            for m in range(8):
                if m == PHI:
                    continue
                p = o + m if m < WIDTH else DRAG
                u_x, u_y = row[0, m] / s_x, row[1, m] / s_y
                out = u_x * z_x + u_y * z_y
                gradient[i, p] += g * out
                for n in range(8):
                    if n == PHI:
                        continue
                    r = o + n if n < WIDTH else DRAG
                    w_x, w_y = row[0, n] / s_x, row[1, n] / s_y
                    info[i, INFO_X, p, r] += g * u_x * w_x
                    info[i, INFO_Y, p, r] += g * u_y * w_y
                    info[i, INFO_OUTLIERS, p, r] -= less * out * (w_x * z_x + w_y * z_y)
            if marked[i] and not np.isnan(phi[i, f]) and (side == 0 or d >= TWISTED):
                turn = 2.0 * np.pi / fold[i]
                e = phi[i, f] - state[i, o + PHI] - state[i, o + OMEGA] * d
                e -= turn * np.round(e / turn)
                like = (1.0 - angle_share) * np.exp(-0.5 * (e / s_a) ** 2) / (s_a * np.sqrt(2.0 * np.pi))
                g = like / (like + angle_share / turn)
                r_phi[i, f], angle_weight[i, f] = e, g
                # The observed information of an angle, not below zero.
                h = g * max(0.0, 1.0 - (1.0 - g) * (e / s_a) ** 2) / s_a**2
                p, r = o + PHI, o + OMEGA
                gradient[i, p] += g * e / s_a**2
                gradient[i, r] += g * e * d / s_a**2
                info[i, INFO_ANGLE, p, p] += h
                info[i, INFO_ANGLE, p, r] += h * d
                info[i, INFO_ANGLE, r, p] += h * d
                info[i, INFO_ANGLE, r, r] += h * d * d


def evaluate(batch: Batch, sides: Sides, marked: NDArray[np.bool_], wider: float = 1.0) -> None:
    """Fill in weights, residuals, information and gradient at the state of `sides`, errors `wider` than stated."""
    known = np.array([batch.k, batch.radius, *batch.outliers, 36.0 * batch.radius**2])
    _paths(batch.t, sides.role, sides.times, sides.state, marked, known, sides.rows)
    _normal(
        batch.t, batch.x, batch.y, batch.phi, batch.fold, sides.role, sides.times, sides.state, batch.sigma * wider,
        marked, known, sides.rows, sides.info, sides.gradient, sides.weight, sides.angle_weight, sides.r_x, sides.r_y,
        sides.r_phi,
    )  # fmt: skip


def lifts(batch: Batch, sides: Sides, marked: NDArray[np.bool_], side: int) -> FloatArray:
    """Lift coefficients (impacts,) of one side, 0 or 1."""
    state = sides.state[:, side * WIDTH : (side + 1) * WIDTH]
    speed = np.maximum(np.hypot(state[:, V_X], state[:, V_Y]), 1e-3)
    spin = lift_of(state[:, OMEGA], speed, batch.radius)
    return np.where(marked, spin, 0.0) + state[:, C]


def sort_frames(batch: Batch, sides: Sides, margin: float = GUARD) -> None:
    """Say of each frame to which flight it belongs, `margin` [s] away from the contact; impacts with too few fail."""
    with np.errstate(invalid="ignore"):
        # Where the court is too low, or flights are still far from it, release may seem to come before landing.
        middle = sides.times.mean(axis=1, keepdims=True)
        half = np.maximum(0.5 * np.diff(sides.times, axis=1), 0.0)
        half = np.where(half > 0.0, half, 0.5 * batch.contact_time)
        before = batch.t < middle - half - margin
        after = batch.t > middle + half + margin
    sides.role[:] = np.where(before, BEFORE, np.where(after, AFTER, CONTACT))
    sides.role[np.isnan(batch.x) | np.isnan(batch.y) | np.isnan(batch.t)] = UNUSED
    for i, reason in enumerate(sides.failed):
        counts = [int(np.sum(sides.role[i] == one)) for one in (BEFORE, AFTER)]
        if min(counts) < FEWEST and not reason:
            sides.failed[i] = (
                f"{counts[0]} frames before and {counts[1]} after the contact; {FEWEST} on a side are needed"
            )
    # What has failed takes part in nothing.
    sides.role[~sides.good] = UNUSED


def start(batch: Batch, sides: Sides, drag: float, away: float = AWAY) -> None:
    """Robust first states: medians of slopes about the path of the flight found so far, from frames `away` [s] from
    the contact.
    """
    half = 0.5 * batch.contact_time
    sides.times[:] = [-half, half]
    sort_frames(batch, sides, away)
    sides.state[:, DRAG] = drag
    for i in np.flatnonzero(sides.good):
        for side, role in enumerate((BEFORE, AFTER)):
            own = sides.role[i] == role
            state = sides.state[i, side * WIDTH : (side + 1) * WIDTH]
            t, x, y = batch.t[i, own] - sides.times[i, side], batch.x[i, own], batch.y[i, own]
            for repeat in range(4):
                if repeat == 0:
                    dx, dy = x - np.median(x), y + 4.9 * t * t
                else:
                    path = series(state[V_X], state[V_Y], drag, 0.0, batch.k, t)
                    dx, dy = x - state[X] - path[0], y - state[Y] - path[1]
                slope_x, slope_y = (_slope(t, u) for u in (dx, dy))
                base = (np.median(x), 0.0) if repeat == 0 else (state[X], state[Y])
                state[V_X] += slope_x
                state[V_Y] += slope_y
                state[X] = base[0] + np.median(dx - slope_x * t)
                state[Y] = base[1] + np.median(dy - slope_y * t)


def _slope(t: FloatArray, values: FloatArray) -> float:
    """Repeated median of slopes (Siegel 1982), which a minority of outliers does not move."""
    others = ~np.eye(t.size, dtype=bool)
    apart, rise = (np.subtract.outer(one, one)[others].reshape(t.size, -1) for one in (t, values))
    return float(np.median(np.median(rise / apart, axis=1)))


def leave_out_thin(sides: Sides) -> None:
    """Let impacts fail of which fewer than `FEWEST` frames on a side fit their flight."""
    for i in np.flatnonzero(sides.good).tolist():
        for role, where in ((BEFORE, "before"), (AFTER, "after")):
            own = sides.role[i] == role
            fit = int(np.sum(sides.weight[i, own] > 0.5))
            if fit < FEWEST:
                sides.failed[i] = (
                    f"{fit} of {int(own.sum())} frames {where} the contact fit a flight; {FEWEST} are needed"
                )


def to_contact(batch: Batch, sides: Sides, marked: NDArray[np.bool_]) -> FloatArray:
    """Move each state along its flight to where the centre is at the height of contact; how far (impacts, 2) [s].

    A flight that is too slow there to have a time of contact fails.
    """
    moved = np.zeros(sides.times.shape)
    for side in (0, 1):
        state = sides.state[:, side * WIDTH : (side + 1) * WIDTH]
        drag, lift = sides.state[:, DRAG], lifts(batch, sides, marked, side)
        sign = 2.0 * side - 1.0
        for i in np.flatnonzero(~(sign * state[:, V_Y] > SLOWEST)):
            if not sides.failed[i]:
                sides.failed[i] = (
                    f"the ball {'leaves' if side else 'reaches'} the court at {sign * state[i, V_Y]:.2g} m/s: "
                    f"a time of contact needs more than {SLOWEST} m/s"
                )
        use = sides.good
        d = np.zeros(use.size)
        for _ in range(4):
            with np.errstate(all="ignore"):
                _x, y, _v_x, v_y = series(state[:, V_X], state[:, V_Y], drag, lift, batch.k, d)
                step = np.where(use, (batch.height - state[:, Y] - y) / v_y, 0.0)
            d = np.clip(d + np.nan_to_num(step), -0.03, 0.03)
        with np.errstate(all="ignore"):
            x, y, v_x, v_y = series(state[:, V_X], state[:, V_Y], drag, lift, batch.k, d)
        for place, change in ((X, x), (Y, y), (V_X, v_x - state[:, V_X]), (V_Y, v_y - state[:, V_Y])):
            state[:, place] += np.where(use, change, 0.0)
        state[:, PHI] += state[:, OMEGA] * d
        sides.times[:, side] += d
        moved[:, side] = d
    return moved


def refine(batch: Batch, sides: Sides, priors: Priors, first: bool, sweeps: int = 6, inflate: float = 1.0) -> None:
    """Fit all impacts; `first` begins with wide errors. `inflate` is the factor of slow errors of positions.

    A sweep sorts the frames, makes steps of Gauss and Newton with the acceleration renewed, and moves the states to
    the height of contact; sweeps end when nothing moves.
    """
    precision, means = priors.precision(), priors.means()
    widths = WIDER if first else ()
    for sweep in range(sweeps + len(widths)):
        wider = widths[sweep] if sweep < len(widths) else 1.0
        sort_frames(batch, sides, AWAY if first and sweep == 0 else GUARD)
        for _ in range(2):
            evaluate(batch, sides, priors.marked, wider)
            hessian = sides.info[:, :INFO_OUTLIERS].sum(axis=1) + precision
            pull = np.einsum("ipq,iq->ip", precision, means - sides.state)
            steps = np.einsum("ipq,iq->ip", _inverse(hessian), sides.gradient + pull)
            sides.state += np.where(sides.good[:, None] & np.isfinite(steps), steps, 0.0)
        moved = to_contact(batch, sides, priors.marked)
        if sweep >= len(widths) and np.abs(moved[sides.good]).max(initial=0.0) < SETTLED:
            break
    evaluate(batch, sides, priors.marked)
    information = (sides.info[:, INFO_X] + sides.info[:, INFO_Y] + sides.info[:, INFO_OUTLIERS]) / inflate**2
    sides.covariance[:] = _inverse(information + sides.info[:, INFO_ANGLE] + precision)


def _inverse(matrices: FloatArray) -> FloatArray:
    """Of information matrices (impacts, n, n), whose diagonals differ by many orders of magnitude."""
    scale = 1.0 / np.sqrt(np.diagonal(matrices, axis1=1, axis2=2))
    even = matrices * scale[:, :, None] * scale[:, None, :] + REGULAR * np.eye(matrices.shape[1])
    inverse: FloatArray = np.linalg.inv(even) * scale[:, :, None] * scale[:, None, :]
    return inverse


def nine(batch: Batch, sides: Sides, marked: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """The `NINE` (impacts, 9) and their derivatives (impacts, 9, COUNT) by the unknowns.

    A change of height `dy` moves the time of contact by `-dy/v_y`, and with it place, angle and, by the acceleration,
    velocity. The turn is `phi_2 - phi_1`, whole turns as they are.
    """
    count = sides.state.shape[0]
    values, slopes = np.zeros((count, len(NINE))), np.zeros((count, len(NINE), COUNT))
    for side in (0, 1):
        o, sign = side * WIDTH, 2.0 * side - 1.0
        state = sides.state[:, o : o + WIDTH]
        v_x, v_y, omega = state[:, V_X], state[:, V_Y], state[:, OMEGA]
        a_x, a_y = acceleration(v_x, v_y, sides.state[:, DRAG], lifts(batch, sides, marked, side), batch.k)
        later = -1.0 / v_y
        first = 3 * side
        values[:, first : first + 3] = np.column_stack([v_x, sign * v_y, omega])
        slopes[:, first, o + V_X] = 1.0
        slopes[:, first, o + Y] = a_x * later
        slopes[:, first + 1, o + V_Y] = sign
        slopes[:, first + 1, o + Y] = sign * a_y * later
        slopes[:, first + 2, o + OMEGA] = 1.0
        for place, position, rate in ((6, None, 1.0), (7, X, v_x), (8, PHI, omega)):
            values[:, place] += sign * (sides.times[:, side] if position is None else state[:, position])
            if position is not None:
                slopes[:, place, o + position] = sign
            slopes[:, place, o + Y] += sign * rate * later
    return values, slopes


def shares(sides: Sides, axis: int) -> tuple[FloatArray, FloatArray]:
    """Number of frames and of parameters (impacts,) that an axis of the frames has: sums of weights, and the trace of
    the covariance times the axis's information.
    """
    weight = sides.angle_weight if axis == INFO_ANGLE else sides.weight
    used = np.einsum("ipq,iqp->i", sides.covariance, sides.info[:, axis])
    return np.nansum(weight, axis=1), used
