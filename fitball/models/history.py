"""One impact through time: exact courses of what moves and what pushes, and the phases they pass through.

The bounce is solved once; its pieces are then followed again up to each time, so that a course consists of the closed
forms of the rebound and of nothing else: `y = v S(t)` and its rate (Jafri 2004, Eqs 2 and 4), the twist and what
follows from it (`kernels.equations`), or the impulse law of a ball that turns as one (`kernels.contact`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitball.errors import ParameterError
from fitball.models.kernels.bounce import ROOM, STACK, scratch_in
from fitball.models.kernels.compiled import compiled, inlined, inner
from fitball.models.kernels.contact import (
    BALL_MASS,
    BALL_RADIUS,
    MU,
    SPIN,
    SPIN_SHELL,
    TANGENTIAL,
    TORSION,
    TORSION_RIGID,
    Contact,
    VerticalMotion,
    contact_of,
    impulse_at,
    landed,
    vertical_at,
    vertical_motion,
)
from fitball.models.kernels.equations import (
    State,
    advance,
    coupling_of,
    drive_of,
    free_twist,
    load_of,
    solve_twist,
    swung_to,
)
from fitball.models.kernels.oscillator import Oscillators, Stack, basis_at
from fitball.models.kernels.phases import (
    EVENT,
    FORCE_ENDED,
    PIECE_ENDING,
    PIECE_PHASE,
    PIECE_TIME,
    UNFINISHED,
    Scratch,
    logged_piece,
    rigid_phase,
)
from fitball.models.types import FREE, GRIP, HOLD, SLIDE_FORWARD, Phase, Rebound, regime_name
from fitball.values import FloatArray, Impacts, numbers

# Rows of the courses.
Y, V_Y, V_X, OMEGA_CORE, OMEGA_SHELL, TWIST, SLIP, NORMAL_FORCE, FRICTION_FORCE, COURSES = range(10)
# Halvings that bring a bracket of the size of the contact to the rounding of its ends.
BISECTIONS = 60


@dataclass(frozen=True)
class Motion:
    """Velocities at one instant: `v_x` along the court, `v_y` of the core towards it [m/s] (negative when it
    leaves), `omega_1` of the core and `omega_2` of the shell [rad/s], topspin positive.
    """

    v_x: float
    v_y: float
    omega_1: float
    omega_2: float


@dataclass(frozen=True)
class Jump:
    """What changes at once: motion `before` and `after`, and the impulses of the ground that did it [N s].

    `normal_impulse` pushes the ball away from the court, `friction_impulse` along it (positive: forward).
    """

    before: Motion
    after: Motion
    normal_impulse: float
    friction_impulse: float


@dataclass(frozen=True)
class Span:
    """One phase of the contact, from `start` to `end` [s after landing]; the shares are of the contact time."""

    phase: Phase
    start: float
    end: float
    start_share: float
    end_share: float


@dataclass(frozen=True)
class Peak:
    """The largest `value` of a course and its `time` [s]."""

    value: float
    time: float


@dataclass(frozen=True)
class History:
    """Courses of one impact, arrays of shape (times,) in SI units, from just after landing to just before release.

    `y` compression [m]; `v_y` its rate, the velocity of the core towards the court, `v_x` of the ball along it,
    `slip = v_x - R omega_2` [m/s]; `omega_1` of the core and `omega_2` of the shell [rad/s], `twist` of the core
    against the shell [rad]; `normal_force` of the ground, `friction_force` along the court [N] (negative: it retards
    a ball that flies forward); `phase` codes of `types.Phase` (0: motion along the court is not followed). At a
    transition they are those of the phase that begins.

    `landing` is the jump at time 0: with `normal = momentum` the ground stops the shell at once, with friction;
    otherwise nothing changes. `release` is the jump at `contact_time`: with `normal = momentum` the core picks the
    shell up, and with `spin = mean` core and shell end with their mean spin; its `after` is the rebound. `spans` are
    the phases in order, `regime` their packed sequence. `friction` is the coefficient, `radius` [m] the ball's.
    """

    times: FloatArray
    y: FloatArray
    v_y: FloatArray
    v_x: FloatArray
    omega_1: FloatArray
    omega_2: FloatArray
    twist: FloatArray
    slip: FloatArray
    normal_force: FloatArray
    friction_force: FloatArray
    phase: NDArray[np.int64]
    contact_time: float
    landing: Jump
    release: Jump
    spans: tuple[Span, ...]
    regime: int
    peak_compression: Peak
    peak_force: Peak
    friction: float
    radius: float

    @property
    def transition_shares(self) -> FloatArray:
        """Times at which one phase hands over to the next, as shares of the contact time, (spans - 1,)."""
        return np.array([span.start_share for span in self.spans[1:]])

    @property
    def regime_name(self) -> str:
        """The phases in words, such as `slide-grip`; empty where motion along the court is not followed."""
        return regime_name(self.regime)


def checked_times(times: ArrayLike, contact_time: float) -> FloatArray:
    """Times as an array (times,). Raises ParameterError for NaN, or a time before landing or after release."""
    array = np.array(numbers("times", times), ndmin=1)
    if array.ndim != 1:
        raise ParameterError(f"times have shape {array.shape}: expected a list of times")
    bad = np.flatnonzero(~((array >= 0.0) & (array <= contact_time)))
    if bad.size:
        raise ParameterError(
            f"times[{bad[0]}] = {array[bad[0]]:g} s: expected times within the contact, from 0 to its end at "
            f"{contact_time!r} s"
        )
    return array


class Followed(NamedTuple):
    """The vertical motion, the landing impulse [N s] with the velocity and the spin of the shell it leaves, and the
    number of pieces of the contact; none where the motion along the court is not followed.
    """

    vertical: VerticalMotion[float]
    landing: float
    landed_v_x: float
    landed_omega: float
    pieces: int


@compiled
def follow(
    row: FloatArray,
    codes: NDArray[np.int64],
    v_x: float,
    v_y: float,
    omega: float,
    cor: float,
    times: FloatArray,
    courses: FloatArray,
    phases: NDArray[np.int64],
    phase_log: FloatArray,
    pieces: int,
    room: FloatArray,
    stack: Stack,
) -> Followed:
    """Fill `courses` (COURSES, times) and `phases` (times,) of a contact whose `pieces` are in the `phase_log`; of a
    ball that turns as one it is filled here. Scratch is as in `scratch_in`.

    `times` [s] lie within it, to rounding.
    """
    scratch = scratch_in(room, stack)
    _status, vertical = vertical_motion(row, codes, v_y, cor)
    _status, contact = contact_of(row, codes, vertical, v_x, v_y, omega)
    spring = vertical.spring
    for k in range(times.shape[0]):
        y, y_rate = vertical_at(spring, v_y, times[k])
        courses[Y, k], courses[V_Y, k] = y, y_rate
        courses[V_X, k], courses[OMEGA_CORE, k], courses[OMEGA_SHELL, k] = v_x, omega, omega
        courses[SLIP, k] = v_x - row[BALL_RADIUS] * omega
        # The ground cannot pull: once the force has turned tensile there is none. Where it ends, rounding may have
        # either sign.
        force = vertical.riding_mass * (2.0 * spring.decay * y_rate + spring.natural_squared * y)
        courses[NORMAL_FORCE, k] = 0.0 if times[k] > vertical.t_force else max(force, 0.0)
        # A contact solved in lanes may last a rounding longer.
        times[k] = min(times[k], vertical.t_contact)
    if codes[TANGENTIAL] == 0:
        return Followed(vertical, contact.landing, v_x, omega, 0)
    if codes[TORSION] == TORSION_RIGID:
        for k in range(times.shape[0]):
            put_turning_as_one(contact, times[k], k, courses, phases)
        _phase, friction, acting = rigid_phase(contact, contact.landing)
        landed_omega = omega + (contact.radius * friction - contact.eps * acting) / contact.joint.shell
        pieces = rigid_pieces(contact, phase_log)
        return Followed(vertical, contact.landing, v_x - friction / contact.mass, landed_omega, pieces)
    follow_pieces(contact, times, courses, phases, phase_log, pieces, scratch)
    landed_v_x, landed_omega, _stuck = landed(contact)
    return Followed(vertical, contact.landing, landed_v_x, landed_omega, pieces)


@inlined
def put_turning_as_one(
    contact: Contact[float], t: float, k: int, courses: FloatArray, phases: NDArray[np.int64]
) -> None:
    """Fill in what a ball whose core and shell turn as one does along the court at time `t`.

    Friction follows the impulse that the normal force has given so far, and so does the end of slip.
    """
    mass, radius, inertia, t_force = contact.mass, contact.radius, contact.joint.shell, contact.vertical.t_force
    phase, friction, acting = rigid_phase(contact, impulse_at(contact, min(t, t_force)))
    turned = contact.omega + (radius * friction - contact.eps * acting) / inertia
    v_x = contact.v_x - friction / mass
    courses[V_X, k], courses[OMEGA_CORE, k], courses[OMEGA_SHELL, k] = v_x, turned, turned
    phases[k] = FREE if t > t_force else phase
    courses[SLIP, k] = 0.0 if phases[k] == GRIP or phases[k] == HOLD else v_x - radius * turned
    share = 0.0
    if phases[k] == GRIP:
        share = -radius * contact.eps / (inertia * (1.0 / mass + radius * radius / inertia))
    elif phases[k] != HOLD and phases[k] != FREE:
        share = -contact.mu if phases[k] == SLIDE_FORWARD else contact.mu
    courses[FRICTION_FORCE, k] = share * courses[NORMAL_FORCE, k]


@inner
def rigid_pieces(contact: Contact[float], phase_log: FloatArray) -> int:
    """Write the phases of a contact without twist as pieces into `phase_log`; returns their number, one or two."""
    t_force = contact.vertical.t_force
    first, _friction, _acting = rigid_phase(contact, impulse_at(contact, 0.0))
    last, _friction, _acting = rigid_phase(contact, impulse_at(contact, t_force))
    left, right = 0.0, t_force
    if last != first:
        for _ in range(BISECTIONS):
            t = 0.5 * (left + right)
            if rigid_phase(contact, impulse_at(contact, t))[0] == first:
                left = t
            else:
                right = t
    phase_log[0, PIECE_PHASE], phase_log[0, PIECE_TIME] = first, right
    phase_log[0, PIECE_ENDING] = FORCE_ENDED if last == first else EVENT
    if last == first:
        return 1
    phase_log[1, PIECE_PHASE], phase_log[1, PIECE_TIME] = last, t_force - right
    phase_log[1, PIECE_ENDING] = FORCE_ENDED
    return 2


@inner
def follow_pieces(
    contact: Contact[float],
    times: FloatArray,
    courses: FloatArray,
    phases: NDArray[np.int64],
    phase_log: FloatArray,
    pieces: int,
    scratch: Scratch,
) -> None:
    """Fill in what core and shell on their torsional joint do along the court."""
    joint, vertical, mass, radius = contact.joint, contact.vertical, contact.mass, contact.radius
    gyration = joint.shell + mass * radius * radius
    coupling = coupling_of(contact, gyration, 1.0 / joint.core + 1.0 / joint.shell, 1.0 / joint.core + 1.0 / gyration)
    v_x, omega_2, _stuck = landed(contact)
    spin_sum = joint.core * contact.omega + joint.shell * omega_2
    state = State(0.0, 0.0, contact.v_y, 0.0, contact.omega - omega_2, v_x, spin_sum, 0.0, 0.0)
    for place in range(pieces):
        piece = logged_piece(phase_log, place)
        drive, load = drive_of(contact, coupling, piece.phase), load_of(vertical, state.y, state.y_rate)
        oscillators = Oscillators(drive.torsion, vertical.spring)
        solve_twist(drive, oscillators, state, load, piece.series, scratch.twist, scratch.drive)
        # A time belongs to the last piece that starts at or before it and takes any time; -1 is its end.
        for k in range(-1, times.shape[0]):
            elapsed = piece.time if k < 0 else min(times[k], vertical.t_force) - state.time
            if elapsed < 0.0 or (place > 0 and not piece.time > 0.0 and k >= 0):
                continue
            basis = basis_at(oscillators, elapsed)
            moved = swung_to(oscillators, piece.series, scratch.twist, state, elapsed, basis, True)
            moved = advance(contact, coupling, drive, state, load, moved)
            if k < 0:
                after = moved
                continue
            angle, rate, phases[k] = moved.angle, moved.rate, piece.phase
            if times[k] > vertical.t_force:
                angle, rate = free_twist(coupling.slide, angle, rate, times[k] - vertical.t_force)
                phases[k] = FREE
            turned = (moved.spin_sum - joint.core * rate) / coupling.inertia
            courses[V_X, k], courses[OMEGA_CORE, k], courses[OMEGA_SHELL, k] = moved.v_x, turned + rate, turned
            courses[TWIST, k] = angle
            courses[SLIP, k] = 0.0 if drive.resting and phases[k] != FREE else moved.v_x - radius * turned
            normal, torque = courses[NORMAL_FORCE, k], joint.stiffness * angle + joint.damping * rate
            courses[FRICTION_FORCE, k] = -mass * drive.braking * normal
            if drive.resting and phases[k] != FREE:
                courses[FRICTION_FORCE, k] = coupling.lever * (torque - drive.eps * normal)
        state = after


def two_mass_history(
    row: FloatArray,
    codes: NDArray[np.int64],
    impact: Impacts,
    rebound: Rebound,
    phase_log: FloatArray,
    pieces: int,
    times: ArrayLike,
) -> History:
    """Courses of the impact whose rebound and `pieces` are known; `row` and `codes` as in `bounce`. Raises
    ParameterError.
    """
    contact_time = float(rebound.contact_time[0])
    wanted = checked_times(times, contact_time)
    v_x, v_y, omega = (float(column[0]) for column in (impact.v_x1, impact.v_y1, impact.omega_1))
    cor = float(impact.cor[0]) if impact.cor is not None else math.nan
    # The end is looked at whether it was asked for or not.
    times = np.append(wanted, contact_time)
    courses, phases = np.zeros((COURSES, times.size)), np.zeros(times.size, dtype=np.int64)
    scratch = np.zeros(ROOM), np.zeros(STACK)
    followed = follow(row, codes, v_x, v_y, omega, cor, times, courses, phases, phase_log, pieces, *scratch)
    courses, at_end = courses[:, :-1], courses[:, -1]
    spin = followed.landed_omega
    landed = Motion(followed.landed_v_x, v_y, spin if codes[TORSION] == TORSION_RIGID else omega, spin)
    leaving = Motion(*(float(at_end[k]) for k in (V_X, V_Y, OMEGA_CORE, OMEGA_SHELL)))
    left = _after_release(codes, leaving, rebound)
    peak_compression, peak_force = _peaks(followed.vertical, v_y)
    return History(
        times=wanted,
        y=courses[Y],
        v_y=courses[V_Y],
        v_x=courses[V_X],
        omega_1=courses[OMEGA_CORE],
        omega_2=courses[OMEGA_SHELL],
        twist=courses[TWIST],
        slip=courses[SLIP],
        normal_force=courses[NORMAL_FORCE],
        friction_force=courses[FRICTION_FORCE],
        phase=phases[:-1],
        contact_time=contact_time,
        landing=Jump(
            Motion(v_x, v_y, omega, omega), landed, followed.landing, float(row[BALL_MASS]) * (landed.v_x - v_x)
        ),
        release=Jump(leaving, left, 0.0, 0.0),
        spans=_spans(phase_log[: followed.pieces], followed.vertical, contact_time),
        regime=int(rebound.regime[0]),
        peak_compression=peak_compression,
        peak_force=peak_force,
        friction=float(row[MU]),
        radius=float(row[BALL_RADIUS]),
    )


def _after_release(codes: NDArray[np.int64], leaving: Motion, rebound: Rebound) -> Motion:
    """The ball in flight: one spin where that is the closure, and the core's velocity that of the ball."""
    v_x2, v_y2, omega_2 = (float(column[0]) for column in (rebound.v_x2, rebound.v_y2, rebound.omega_2))
    keeps_twisting = codes[SPIN] == SPIN_SHELL
    return Motion(v_x2, -v_y2, leaving.omega_1 if keeps_twisting else omega_2, omega_2)


def _spans(phase_log: FloatArray, vertical: VerticalMotion[float], contact_time: float) -> tuple[Span, ...]:
    """Phases with their times; what lasts no time is none, and pieces of one phase that a series cut are joined."""
    phases: list[tuple[Phase, float, float]] = []
    start = time = lasted = 0.0
    for phase, ending, elapsed in phase_log[:, [PIECE_PHASE, PIECE_ENDING, PIECE_TIME]]:
        time += float(elapsed)
        lasted += float(elapsed)
        if ending != UNFINISHED:
            if lasted > 0.0:
                phases.append((Phase(int(phase)), start, time))
            start, lasted = time, 0.0
    if phases and vertical.t_contact > vertical.t_force:
        phases.append((Phase.FREE, vertical.t_force, contact_time))
    if phases:
        # The last piece ends with the contact, whatever the rounding of the sum says.
        phases[-1] = (*phases[-1][:2], contact_time)
    return tuple(Span(phase, a, b, a / contact_time, b / contact_time) for phase, a, b in phases)


def _peaks(vertical: VerticalMotion[float], v_y: float) -> tuple[Peak, Peak]:
    """Largest compression and largest normal force, each where its derivative vanishes."""
    spring = vertical.spring
    sigma, w_squared = spring.decay, spring.damped_squared
    # Below a billionth of the decay the frequency changes neither angle over frequency nor its hyperbolic twin.
    w = max(spring.frequency, 1e-9 * sigma)
    # y' = 0 where tan(w t) = w/sigma.
    t_y = math.atan2(w, sigma) / w if w_squared >= 0.0 else math.atanh(w / sigma) / w
    # F = riding (2 sigma y' + omega^2 y) starts at 2 sigma, with slope omega^2 - 4 sigma^2, in units of riding v_y:
    # beyond zeta = 1/2 it only falls. F' = 0 where tan(w t)/w = slope/(w^2 2 sigma + sigma (slope + 2 sigma^2)).
    slope = spring.natural_squared - 4.0 * sigma * sigma
    t_force = 0.0
    if slope > 0.0:
        t_force = math.atan2(w * slope, sigma * (2.0 * w_squared + slope + 2.0 * sigma * sigma)) / w
    y, _rate = vertical_at(spring, v_y, t_y)
    at_force, rate = vertical_at(spring, v_y, t_force)
    largest = vertical.riding_mass * (2.0 * sigma * rate + spring.natural_squared * at_force)
    return Peak(y, t_y), Peak(largest, t_force)
