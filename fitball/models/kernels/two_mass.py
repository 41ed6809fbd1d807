"""The two-mass ball along the court: slide, grip, hold and slip again, in closed form, as kernels.

Shell (2) and core (1) are joined by a torsional spring and damper. In every phase angular momentum makes both spins
algebraic but for the twist between them (see `twist`). What ends a phase is the first zero of a function held in
the basis of `oscillator`.
"""

from __future__ import annotations

import math

import numpy as np

from fitball.models.kernels.compiled import compiled, compiled_allocating
from fitball.models.kernels.events import (
    ALLOWANCE,
    AT_START,
    DEPTH,
    HALVINGS,
    NO_ZERO,
    POLES,
    SIZE,
    VERTICAL,
    basis_at,
    first_zero,
)
from fitball.models.kernels.landing import landed
from fitball.models.kernels.oscillator import SERIES_LENGTH
from fitball.models.kernels.phases import FREE, GRIP, HOLD, TIE, append_phase, cone_margin, slide_phase
from fitball.models.kernels.twist import (
    compose,
    free_twist_rate,
    pin,
    set_torsion,
    twist_at,
    twist_motion,
    vertical_after,
)
from fitball.models.types import Status
from fitball.values import FloatArray

OK = int(Status.OK)
TOO_MANY_PHASES = int(Status.TOO_MANY_PHASES)
TOO_RAPID = int(Status.TOO_RAPID)
# A lightly damped torsional spring can break and renew the grip at each of its periods; each costs well
# under a microsecond, so the bound only stops a contact that will not settle.
MAX_PHASES = 4096

# Share of what is left of the contact below which a zero that follows another at the start may be the work of
# cancellation: it is looked for again in a series.
TOO_SOON = 1e-3
# At the end of the contact the normal force and with it both sides of the cone vanish: a zero this near to it is
# the end itself, to the rounding of the times.
AT_END = 1.0 - 1e-13
# A contact is solved in pieces: phases, or near resonance parts of them. What a piece was, as a row of a record: its
# phase, what ended it and to which side, how long it lasted [s], terms (0: no series) and scale [s] of its series.
PIECE_PHASE, PIECE_ENDING, PIECE_SIDE, PIECE_TIME, PIECE_TERMS, PIECE_SCALE, PIECE_SIZE = range(7)
# Endings: the series reached its length (or nothing at all, where an event comes at once), the normal force ended,
# slip came to zero or friction to the edge of its cone, a hold gave way to grip.
UNFINISHED, FORCE_ENDED, EVENT, RESUMED = range(4)
# Scratch of one thread: contact function, twist, force, poles, and the stack of `first_zero`.
Scratch = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]


@compiled_allocating
def make_scratch() -> Scratch:
    """Scratch for one thread."""
    return (
        np.zeros(max(SERIES_LENGTH, SIZE)),
        np.zeros(SERIES_LENGTH),
        np.zeros(SERIES_LENGTH),
        np.zeros(POLES),
        np.zeros((DEPTH + 1, 5)),
    )


@compiled
def contrary(value: float, rate: float) -> float:
    """-1 where `value` is positive, +1 where negative; where it is zero its rate decides."""
    if value > 0.0:
        return -1.0
    if value < 0.0:
        return 1.0
    return -1.0 if rate > 0.0 else 1.0


@compiled
def two_mass_contact(
    mass: float,
    radius: float,
    inertia_core: float,
    inertia_shell: float,
    stiffness: float,
    damping: float,
    w2_slide: float,
    mu: float,
    eps: float,
    eps_in_slide: bool,
    shell_spin: bool,
    riding_mass: float,
    landing_impulse: float,
    omega2: float,
    sigma: float,
    w2_force: float,
    t_force: float,
    t_contact: float,
    v_x: float,
    v_y: float,
    omega: float,
    scratch: Scratch,
    record: FloatArray | None,
) -> tuple[int, float, float, int, int]:
    """Follow one contact; returns `(status, v_x2, omega_2, regime, pieces)`.

    `stiffness`, `damping` [N m, N m s] of the torsional joint, `w2_slide` its damped frequency squared while
    sliding; `eps` offset of the normal force [m], acting during slip too if `eps_in_slide`; `riding_mass`
    [kg] on the vertical spring; `landing_impulse` [N s] that stops the shell; `omega2, sigma, w2_force`
    the vertical motion; `t_force`, `t_contact` [s] end of compression and release. The pieces of the contact are
    written into `record` (MAX_PHASES, PIECE_SIZE), unless that is None, and counted.
    """
    function, twist, drive, poles, stack = scratch
    inertia = inertia_core + inertia_shell
    gyration = inertia_shell + mass * radius * radius
    relative_slide = 1.0 / inertia_core + 1.0 / inertia_shell
    relative_grip = 1.0 / inertia_core + 1.0 / gyration
    decay_grip = 0.5 * damping * relative_grip
    w2_grip = stiffness * relative_grip - decay_grip * decay_grip
    eps_slide = eps if eps_in_slide else 0.0
    lever = mass * radius / gyration
    poles[VERTICAL], poles[VERTICAL + 1], poles[VERTICAL + 2] = sigma, w2_force, omega2
    poles[VERTICAL + 3] = math.sqrt(abs(w2_force))

    w1 = omega
    w2 = omega
    th = 0.0
    gripped_at_landing = False
    if landing_impulse > 0.0:
        v_x, w2, gripped_at_landing = landed(
            mass, radius, inertia_shell, mu, eps, eps_in_slide, landing_impulse, v_x, omega
        )

    slip = v_x - radius * w2
    direction = 1.0 if slip > 0.0 else -1.0
    order = 0
    # At zero slip, to the rounding of its two terms, the friction cone decides.
    deciding = mu > 0.0 and (gripped_at_landing or abs(slip) <= 4.5e-16 * (abs(v_x) + radius * abs(w2)))
    gripping = False
    holding = False
    broke = False
    entered = 0.0
    moved = False
    careful = False
    start = 0.0
    y = 0.0
    y_rate = v_y
    regime = 0
    count = 0
    pieces = 0
    spin_sum = inertia_core * w1 + inertia_shell * w2
    stack[HALVINGS, 0] = ALLOWANCE

    for _ in range(MAX_PHASES):
        y_accel = -2.0 * sigma * y_rate - omega2 * y
        force = -riding_mass * y_accel
        force_rate = riding_mass * (omega2 * y_rate + 2.0 * sigma * y_accel)
        momentum = riding_mass * y_rate
        span = t_force - start
        rate = w1 - w2

        if deciding:
            torque = stiffness * th + damping * rate
            accel = -2.0 * decay_grip * rate - stiffness * relative_grip * th
            free = lever * torque
            free_rate = lever * (stiffness * rate + damping * accel)
            full = free - lever * eps * force
            full_rate = free_rate + lever * (damping * eps * force / gyration - eps * force_rate)
            limit, limit_rate = mu * force, mu * force_rate
            gripping = not broke and cone_margin(full, full_rate, limit, limit_rate) > 0.0
            holding = not gripping and not eps_in_slide and cone_margin(free, free_rate, limit, limit_rate) > 0.0
            if holding:
                entered = 1.0 if full > 0.0 else -1.0
            elif not gripping:
                needed = full if eps_in_slide else free
                direction = contrary(needed, full_rate if eps_in_slide else free_rate)
                # Slip starts with the acceleration that friction cannot balance; at the very edge of the
                # cone that is zero and grows.
                order = 1 if abs(needed) - limit > TIE * (limit + abs(needed)) else 2
            deciding = False

        if gripping or holding:
            set_torsion(poles, stiffness, damping, relative_grip, w2_grip)
            acting = eps if gripping else 0.0
            n, length = twist_motion(
                th, rate, acting / gyration, force, force_rate, poles, span, careful, twist, drive
            )
            at_end = AT_START if n > 0 else basis_at(poles, length)
            t_event = NO_ZERO
            lost = False
            doubtful = False
            event_side = 0.0
            now = lever * (stiffness * th + damping * rate - acting * force)
            near = 1.0 if now >= 0.0 else -1.0
            end = length
            for attempt in range(2):
                side = near if attempt == 0 else -near
                bound = compose(
                    0.0, -side * lever * stiffness, -side * lever * damping, mu + side * lever * acting, 0.0,
                    force, force_rate, momentum, poles, twist, drive, n, length, function,
                )  # fmt: skip
                at_edge = abs(mu * force - side * now) <= TIE * (mu * force + abs(now))
                order = 1 if at_edge or (gripping and entered * side > 0.0) else 0
                t, there = first_zero(function, poles, n, length, bound, pin(function, n, order), end, at_end, stack)
                lost = lost or math.isnan(t)
                if 0.0 <= t < AT_END * span:
                    t_event, event_side, end, at_end = t, side, t, there
                    doubtful = doubtful or (order > 0 and t < TOO_SOON * span)
            resumed = False
            if holding:
                bound = compose(
                    0.0, entered * lever * stiffness, entered * lever * damping,
                    -mu - entered * lever * eps, 0.0,
                    force, force_rate, momentum, poles, twist, drive, n, length, function,
                )  # fmt: skip
                order = 1 if broke else 0
                t, there = first_zero(function, poles, n, length, bound, pin(function, n, order), end, at_end, stack)
                lost = lost or math.isnan(t)
                if 0.0 <= t < AT_END * span:
                    t_event, resumed, at_end = t, True, there
                    doubtful = doubtful or (order > 0 and t < TOO_SOON * span)
            if lost:
                return TOO_RAPID, math.nan, math.nan, regime, 0
            if doubtful and n == 0:
                careful = True
                continue
            broke = False
            elapsed = length if t_event < 0.0 else t_event
            finished = t_event < 0.0 and length >= span
            y, y_rate = vertical_after(poles, n, y, y_rate, elapsed, at_end)
            impulse = momentum - riding_mass * y_rate
            th, rate_end = twist_at(twist, poles, n, length, elapsed, at_end)
            total = inertia_core * w1 + gyration * w2 - acting * impulse
            w2 = (total - inertia_core * rate_end) / (inertia_core + gyration)
            w1 = w2 + rate_end
            v_x = radius * w2
            spin_sum = inertia_core * w1 + inertia_shell * w2
            phase = GRIP if gripping else HOLD
            side = entered if resumed else event_side
            if t_event >= 0.0:
                if resumed:
                    holding, gripping = False, True
                elif holding or eps_in_slide:
                    gripping, holding = False, False
                    direction, order = -event_side, 2
                else:
                    deciding, broke, gripping = True, True, False
                if not resumed:
                    entered = 0.0
            elif not finished:
                entered = 0.0 if gripping else entered
        else:
            broke = False
            set_torsion(poles, stiffness, damping, relative_slide, w2_slide)
            spinning_up = direction * mu * radius - eps_slide
            n, length = twist_motion(
                th, rate, -spinning_up / inertia_shell, force, force_rate, poles, span, careful, twist, drive
            )
            at_end = AT_START if n > 0 else basis_at(poles, length)
            t_event = NO_ZERO
            if mu > 0.0:
                bound = compose(
                    direction * (v_x - radius * spin_sum / inertia),
                    0.0,
                    direction * radius * inertia_core / inertia,
                    0.0,
                    -mu / mass - direction * radius * spinning_up / inertia,
                    force, force_rate, momentum, poles, twist, drive, n, length, function,
                )  # fmt: skip
                t_event, there = first_zero(
                    function, poles, n, length, bound, pin(function, n, order), length, at_end, stack
                )
                if math.isnan(t_event):
                    return TOO_RAPID, math.nan, math.nan, regime, 0
                if t_event >= AT_END * span:
                    t_event = NO_ZERO
                elif t_event >= 0.0:
                    at_end = there
                if n == 0 and order > 0 and 0.0 <= t_event < TOO_SOON * span:
                    careful = True
                    continue
            elapsed = length if t_event < 0.0 else t_event
            finished = t_event < 0.0 and length >= span
            y, y_rate = vertical_after(poles, n, y, y_rate, elapsed, at_end)
            impulse = momentum - riding_mass * y_rate
            v_x -= direction * mu / mass * impulse
            spin_sum += spinning_up * impulse
            if shell_spin or not finished:
                th, rate_end = twist_at(twist, poles, n, length, elapsed, at_end)
                w2 = (spin_sum - inertia_core * rate_end) / inertia
                w1 = w2 + rate_end
            phase = slide_phase(direction)
            side, resumed = direction, False
            if t_event >= 0.0:
                deciding = True
                w2 = v_x / radius
                w1 = (spin_sum - inertia_shell * w2) / inertia_core
            order = 0

        if record is not None:
            record[pieces, PIECE_PHASE], record[pieces, PIECE_SIDE], record[pieces, PIECE_TIME] = phase, side, elapsed
            record[pieces, PIECE_TERMS], record[pieces, PIECE_SCALE] = n, length
            ending = FORCE_ENDED if finished else UNFINISHED
            if t_event > 0.0:
                ending = RESUMED if resumed else EVENT
            record[pieces, PIECE_ENDING] = ending
            pieces += 1
        careful = False
        start += elapsed
        moved = moved or elapsed > 0.0
        if finished or t_event >= 0.0:
            if moved:
                regime = append_phase(regime, count, phase)
                count += 1
            moved = False
        if finished:
            if t_contact > t_force:
                regime = append_phase(regime, count, FREE)
            if not shell_spin:
                return OK, v_x, spin_sum / inertia, regime, pieces
            rate = free_twist_rate(
                poles, stiffness, damping, relative_slide, w2_slide, th, w1 - w2, t_contact - t_force
            )
            return OK, v_x, (spin_sum - inertia_core * rate) / inertia, regime, pieces
    return TOO_MANY_PHASES, math.nan, math.nan, regime, 0
