"""One impact through time: exact courses of what moves and what pushes, and the phases they pass through."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitball.errors import ParameterError
from fitball.models.kernels import bounce_history as kernel
from fitball.models.kernels.phases import PIECE_ENDING, PIECE_PHASE, PIECE_TIME, UNFINISHED
from fitball.models.kernels.vertical import (
    BALL_MASS,
    BALL_RADIUS,
    MU,
    SPIN,
    SPIN_SHELL,
    TORSION,
    TORSION_RIGID,
    VerticalMotion,
)
from fitball.models.types import Phase, Rebound, regime_name
from fitball.values import FloatArray, Impacts, numbers


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


def two_mass_history(
    row: FloatArray, codes: NDArray[np.int64], impact: Impacts, rebound: Rebound, times: ArrayLike
) -> History:
    """Courses of the impact whose rebound is known; `row` and `codes` as in `bounce`. Raises ParameterError."""
    contact_time = float(rebound.contact_time[0])
    wanted = checked_times(times, contact_time)
    v_x, v_y, omega = (float(column[0]) for column in (impact.v_x1, impact.v_y1, impact.omega_1))
    cor = float(impact.cor[0]) if impact.cor is not None else math.nan
    # The end is looked at whether it was asked for or not.
    followed = kernel.bounce_history(row, codes, v_x, v_y, omega, cor, np.append(wanted, contact_time))
    courses, at_end = followed.courses[:, :-1], followed.courses[:, -1]
    spin = followed.landed_omega
    landed = Motion(followed.landed_v_x, v_y, spin if codes[TORSION] == TORSION_RIGID else omega, spin)
    leaving = Motion(*(float(at_end[k]) for k in (kernel.V_X, kernel.V_Y, kernel.OMEGA_CORE, kernel.OMEGA_SHELL)))
    left = _after_release(codes, leaving, rebound)
    peak_compression, peak_force = _peaks(followed.vertical, v_y)
    return History(
        times=wanted,
        y=courses[kernel.Y],
        v_y=courses[kernel.V_Y],
        v_x=courses[kernel.V_X],
        omega_1=courses[kernel.OMEGA_CORE],
        omega_2=courses[kernel.OMEGA_SHELL],
        twist=courses[kernel.TWIST],
        slip=courses[kernel.SLIP],
        normal_force=courses[kernel.NORMAL_FORCE],
        friction_force=courses[kernel.FRICTION_FORCE],
        phase=followed.phases[:-1],
        contact_time=contact_time,
        landing=Jump(
            Motion(v_x, v_y, omega, omega), landed, followed.landing, float(row[BALL_MASS]) * (landed.v_x - v_x)
        ),
        release=Jump(leaving, left, 0.0, 0.0),
        spans=_spans(followed.phase_log, followed.vertical, contact_time),
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
    y, _rate = kernel.vertical_at(spring, v_y, t_y)
    at_force, rate = kernel.vertical_at(spring, v_y, t_force)
    largest = vertical.riding_mass * (2.0 * sigma * rate + spring.natural_squared * at_force)
    return Peak(y, t_y), Peak(largest, t_force)
