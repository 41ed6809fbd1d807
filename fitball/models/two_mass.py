"""The two-mass ball along the court: slide, grip, hold and slip again, in closed form, as kernels.

Shell (2) and core (1) are joined by a torsional spring and damper; `th = theta_1 - theta_2`. In every
phase angular momentum makes both spins algebraic but for `th`, which is a damped oscillator driven by the
normal force `F` (Jafri 2004, Eqs 11-19, 31 and 42-45, with the initial conditions that continuity asks
for). What ends a phase is the first zero of a function held in the basis of `oscillator`.
"""

from __future__ import annotations

import math

import numpy as np

from fitball.models.compiled import compiled, compiled_allocating
from fitball.models.dual import Number, NumberArray, size, sqrt
from fitball.models.events import (
    ALLOWANCE,
    AT_START,
    DEPTH,
    HALVINGS,
    NO_ZERO,
    POLES,
    SIZE,
    TORSION,
    VERTICAL,
    Basis,
    basis_at,
    first_zero,
    prepare,
    prepare_series,
)
from fitball.models.landing import landed
from fitball.models.oscillator import (
    NEAR_RESONANCE,
    SERIES_LENGTH,
    SERIES_REACH,
    damped_pair,
    forced_response,
    resultant,
    series_free,
    series_length,
    series_response,
    series_value,
)
from fitball.models.phases import FREE, GRIP, HOLD, TIE, append_phase, cone_margin, slide_phase
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
def twist_motion(
    th: float,
    rate: float,
    kappa: float,
    force: float,
    force_rate: float,
    poles: FloatArray,
    span: float,
    careful: bool,
    twist: FloatArray,
    drive: FloatArray,
) -> tuple[int, float]:
    """Solve for the twist in one phase that lasts at most `span`.

    Returns `(n, length)`. With `n = 0`, `twist[:4]` holds the coefficients in the basis of both pole pairs and
    `length` is `span`. Near resonance `twist[:n]` holds a Taylor series in `t/length`, `drive[:n]` that of the
    force, and `length` may be shorter than `span`: the phase is then solved in pieces. `careful` asks for the
    series, which loses nothing to cancellation just after the start.
    """
    a, w2, b = poles[TORSION], poles[TORSION + 1], poles[TORSION + 2]
    sigma, w2_force, b_force = poles[VERTICAL], poles[VERTICAL + 1], poles[VERTICAL + 2]
    span2 = span * span
    if not careful and resultant(a, w2, sigma, w2_force) * span2 * span2 > NEAR_RESONANCE:
        twist[0], twist[1], twist[2], twist[3] = forced_response(
            a, w2, sigma, w2_force, kappa, force, force_rate + sigma * force, th, rate
        )
        return 0, span
    pole = max(
        a + poles[TORSION + 3] if w2 < 0.0 else math.sqrt(b),
        sigma + poles[VERTICAL + 3] if w2_force < 0.0 else math.sqrt(b_force),
    )
    length = span if pole * span <= SERIES_REACH else SERIES_REACH / pole
    n = series_length(pole * length)
    series_free(force, force_rate + sigma * force, sigma, b_force, length, n, drive)
    series_response(a, b, kappa, drive, th, rate, length, n, twist)
    return n, length


@compiled
def twist_at(
    twist: NumberArray, poles: NumberArray, n: int, length: float, t: Number, basis: Basis[Number]
) -> tuple[Number, Number]:
    """Twist and its rate at time `t` of the phase, where the basis is `basis` (not needed by a series)."""
    if n > 0:
        th, rate, _ = series_value(twist, n, t / length)
        return th, rate / length
    p, q, _e, r, s, _g = basis
    a, w2, sigma, w2_force = poles[0], poles[1], poles[4], poles[5]
    th = twist[0] * p + twist[1] * q + twist[2] * r + twist[3] * s
    rate = (
        (twist[1] - a * twist[0]) * p
        - (w2 * twist[0] + a * twist[1]) * q
        + (twist[3] - sigma * twist[2]) * r
        - (w2_force * twist[2] + sigma * twist[3]) * s
    )
    return th, rate


@compiled
def vertical_after(
    poles: NumberArray, n: int, y: Number, y_rate: Number, elapsed: Number, basis: Basis[Number]
) -> tuple[Number, Number]:
    """Displacement and velocity of the core `elapsed` after they were `y`, `y_rate`."""
    sigma, b = poles[VERTICAL], poles[VERTICAL + 2]
    r, s = basis[3], basis[4]
    if n > 0:
        r, s, _envelope = damped_pair(sigma, poles[VERTICAL + 1], b, poles[VERTICAL + 3], elapsed)
    return y * r + (y_rate + sigma * y) * s, y_rate * r - (sigma * y_rate + b * y) * s


@compiled
def compose(
    constant: float,
    on_twist: float,
    on_rate: float,
    on_force: float,
    on_impulse: float,
    force: float,
    force_rate: float,
    momentum: float,
    poles: FloatArray,
    twist: FloatArray,
    drive: FloatArray,
    n: int,
    length: float,
    out: FloatArray,
) -> float:
    """Write `constant + on_twist th + on_rate th' + on_force F + on_impulse int F dt` into `out`.

    `momentum` is that of the core at the start of the phase, towards the court; the impulse is what it has
    lost since. Returns the bound of the sixth derivative where the function is a series.
    """
    if n > 0:
        for k in range(n):
            value = on_twist * twist[k] + on_force * drive[k]
            if k + 1 < n:
                value += on_rate * (k + 1) * twist[k + 1] / length
            if k > 0:
                value += on_impulse * drive[k - 1] * length / k
            out[k] = value
        out[0] += constant
        return prepare_series(out, n, length)
    a, w2, sigma, w2_force = poles[0], poles[1], poles[4], poles[5]
    out[0] = constant + on_impulse * momentum
    out[1] = on_twist * twist[0] + on_rate * (twist[1] - a * twist[0])
    out[2] = on_twist * twist[1] - on_rate * (w2 * twist[0] + a * twist[1])
    out[3] = on_twist * twist[2] + on_rate * (twist[3] - sigma * twist[2])
    out[3] += on_force * force - on_impulse * momentum
    out[4] = on_twist * twist[3] - on_rate * (w2_force * twist[2] + sigma * twist[3])
    out[4] += on_force * (force_rate + sigma * force) - on_impulse * (sigma * momentum - force)
    prepare(out, poles, length)
    return 0.0


@compiled
def pin(function: FloatArray, n: int, order: int) -> int:
    """Let the function be exactly zero at the start of its phase when `order` zeros are known to be there.

    The rounding of its constant would otherwise outweigh it for a while. Returns `order`.
    """
    if order > 0:
        function[0] = 0.0 if n > 0 else -(function[1] + function[3])
    return order


@compiled
def set_torsion(poles: NumberArray, stiffness: Number, damping: Number, compliance: Number, w2: Number) -> None:
    """Torsional poles for the relative compliance `1/I1 + 1/I_shell`; `w2` as given where it is known."""
    poles[TORSION] = 0.5 * damping * compliance
    poles[TORSION + 1] = w2
    poles[TORSION + 2] = stiffness * compliance
    poles[TORSION + 3] = sqrt(size(w2))


@compiled
def contrary(value: float, rate: float) -> float:
    """-1 where `value` is positive, +1 where negative; where it is zero its rate decides."""
    if value > 0.0:
        return -1.0
    if value < 0.0:
        return 1.0
    return -1.0 if rate > 0.0 else 1.0


@compiled
def free_twist_rate(
    poles: NumberArray,
    stiffness: Number,
    damping: Number,
    compliance: Number,
    w2: Number,
    th: Number,
    rate: Number,
    t: Number,
) -> Number:
    """Rate of the twist after `t` seconds without ground force."""
    set_torsion(poles, stiffness, damping, compliance, w2)
    a = poles[TORSION]
    p, q, _envelope = damped_pair(a, w2, poles[TORSION + 2], poles[TORSION + 3], t)
    swing = rate + a * th
    after: Number = rate * p - (w2 * th + a * swing) * q
    return after


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
