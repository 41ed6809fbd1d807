"""One contact along the court through its phases: slide, grip, hold and slip again; and one bounce.

Shell (2) and core (1) are joined by a torsional spring and damper of torque `T = K th + C th'`.
With `P` the impulse of the normal force since a phase began, `s` the direction of slip, `J = I2 + M
R^2` (Jafri 2004):

    slide         M v_x' = -s mu F      (Eqs 9, 11, 14, 15, 40)
                  I1 omega_1 + I2 omega_2 = const + (s mu R - eps) P
    grip, hold    v_x = R omega_2       (Eqs 10, 14, 17, 42)
                  I1 omega_1 + J omega_2 = const - eps P

so that both spins are algebraic but for the twist; `eps` is zero in a hold, and in slip where it
acts while gripping only. What ends a phase, with `L = I1 omega_1 + I2 omega_2` and `v_x` at its
start:

    slide         the slip,  s (v_x - R L/I) + s R I1/I th' - (mu/M + s R (s mu R - eps)/I) P
    grip, hold    the margin of the friction cone,  mu F - |M R/J (T - eps F)|,
                  which the thesis does not ask for
    hold          besides, the same with eps, on the side where it is outside:
                  there it gives way to grip
"""

import math
from typing import NamedTuple

from fitball.base.values import FloatArray
from fitball.models.kernels.compiled import inlined, kernel
from fitball.models.kernels.contact import (
    OK,
    SPIN,
    SPIN_SHELL,
    TOO_MANY_PHASES,
    Ball,
    Contact,
    Flags,
    ball_of,
    contact_of,
    landed,
)
from fitball.models.kernels.crossings import FLAT, NO_ZERO, Weights, curve_of, first_fall
from fitball.models.kernels.motion import (
    SERIES_FAR,
    START,
    Piece,
    State,
    Swing,
    fastest,
    load_of,
    motion_at,
    piece_of,
    swing_at,
    swings_anew,
    swung,
)
from fitball.models.types import PHASE_BITS, Phase

# In place of a phase: the friction cone decides which one follows.
UNDECIDED = 0
# Phases as kernels have them: plain integers.
SLIDE_FORWARD, SLIDE_BACKWARD, GRIP, HOLD, FREE = (int(phase) for phase in Phase)
# Phases that a packed regime has room for: 60 bits, below the sign of 64.
MAX_PACKED_PHASES = 20
# Pieces after which a contact is given up (status TOO_MANY_PHASES).
MAX_PIECES = 1000
# Relative distance to the edge of the friction cone that rounding of the forces alone can make.
CONE_ROUNDING = 1e-13
# Slip below this share of its two terms is none: their rounding.
SLIP_ROUNDING = 4.5e-16
# Share of the time until the normal force ends from which on nothing is an event: force and cone
# vanish there.
FORCE_END_SHARE = 1.0 - 1e-13
# Share of the remaining contact within which an event may be the work of cancellation: a series
# looks for it again.
DOUBTFUL_SHARE = 1e-3
# Share of the contact below which a phase takes no time.
NO_TIME = 1e-12
# Phases that may take no time in succession, as friction and its limit agree to rounding with all
# their rates. The next then moves on, whichever it is: that makes a difference of rounding only.
PATIENCE = 8
# Share of the contact for which it moves on.
NUDGE = 1e-9
# How a phase ends: with its piece only.
LASTS = 0
# How a phase ends: by an event.
EVENT = 1
# How a phase ends: as a hold that gives way to grip.
RESUMES = 2


class Outcome(NamedTuple):
    """One impact solved, in SI: velocity, spin, `contact_time`, and time, path and turn between the
    flights before and after it. All but `status` and `regime` are NaN where the status is not OK.
    """

    status: int
    v_x2: float
    v_y2: float
    omega_2: float
    contact_time: float
    gap_time: float
    gap_path: float
    gap_turn: float
    regime: int


@inlined
def cone_margin(friction: float, friction_rate: float, limit: float, limit_rate: float) -> float:
    """A number that is positive when `|friction| <= limit` now and just after; at the edge itself,
    to rounding, the rates decide.
    """
    margin = limit - abs(friction)
    noise = CONE_ROUNDING * (limit + abs(friction))
    if abs(margin) > noise:
        return margin
    if friction > noise:
        return limit_rate - friction_rate
    if friction < -noise:
        return limit_rate + friction_rate
    return limit_rate - abs(friction_rate)


@inlined
def decide(contact: Contact, s: State, broke: bool) -> tuple[int, float, int]:
    """`(phase, side, order)` of what a contact point without slip does next: grip if friction can,
    else hold if it can, else slip, in which the slip has `order` zeros at the start. A grip that
    `broke` does not grip at once.
    """
    ball = contact.ball
    eps = contact.eps
    lever = ball.lever
    force, force_rate = load_of(contact.spring, ball.riding, s.y, s.y_rate)
    accel = -2.0 * contact.rest.decay * s.rate - contact.rest.natural_squared * s.angle
    # Friction that holds without the offset, and the full one with it, each with its rate.
    free = lever * (ball.stiffness * s.angle + contact.damping * s.rate)
    free_rate = lever * (ball.stiffness * s.rate + contact.damping * accel)
    full = free - lever * eps * force
    full_rate = free_rate + lever * eps * (contact.damping * force / ball.gyration - force_rate)
    limit = ball.mu * force
    limit_rate = ball.mu * force_rate
    if not broke and cone_margin(full, full_rate, limit, limit_rate) > 0.0:
        return GRIP, 0.0, 0
    # Without an offset to speak of a hold is the grip that has just broken.
    may_hold = not broke or abs(full - free) > CONE_ROUNDING * (limit + abs(full))
    may_hold = may_hold and not contact.eps_in_slide
    if may_hold and cone_margin(free, free_rate, limit, limit_rate) > 0.0:
        outside = 1.0 if full > 0.0 or (full == 0.0 and full_rate > 0.0) else -1.0
        return HOLD, outside, 0
    needed = free
    rate = free_rate
    if contact.eps_in_slide:
        needed = full
        rate = full_rate
    # Slip starts with what friction cannot balance; at the very edge of the cone that is zero and
    # grows.
    order = 1 if abs(needed) - limit > CONE_ROUNDING * (limit + abs(needed)) else 2
    if needed > 0.0 or (needed == 0.0 and rate > 0.0):
        return SLIDE_BACKWARD, -1.0, order
    return SLIDE_FORWARD, 1.0, order


@inlined
def search(
    contact: Contact,
    piece: Piece,
    phase: int,
    side: float,
    order: int,
    eps: float,
    spinning_up: float,
) -> tuple[float, int, float, Swing, Swing]:
    """When a phase ends: `(time, kind, side, swings there)`. Of kind LASTS it ends with the piece
    only, else by an EVENT on that `side` of the cone, or as a hold that RESUMES its grip. Time is
    NaN if the search does not end.
    """
    ball = contact.ball
    s = piece.start
    k = ball.lever * ball.stiffness
    c = ball.lever * contact.damping
    # At the end of compression force and cone vanish: no event.
    latest = FORCE_END_SHARE * contact.t_force - s.time
    time = piece.length
    kind = LASTS
    at = side
    p = START
    q = START
    for attempt in range(2 if phase == HOLD else 1):
        paired = phase >= GRIP and attempt == 0
        offset = eps if paired else contact.eps
        friction = k * s.angle + c * s.rate - ball.lever * offset * piece.force
        limit = ball.mu * piece.force
        noise = CONE_ROUNDING * (limit + abs(friction))
        if phase < GRIP:
            # The slip, along its direction.
            turn = side * ball.radius / ball.inertia
            slip = side * s.v_x - turn * s.spin_sum
            braked = -(ball.mu / ball.mass + turn * spinning_up)
            wa = wb = Weights(order, slip, 0.0, turn * ball.core, 0.0, braked)
        elif paired:
            # The distances to both sides of the cone.
            a_order = 1 if limit - friction <= noise or (phase == GRIP and side > 0.0) else 0
            b_order = 1 if limit + friction <= noise or (phase == GRIP and side < 0.0) else 0
            wa = Weights(a_order, 0.0, -k, -c, ball.mu + ball.lever * eps, 0.0)
            wb = Weights(b_order, 0.0, k, c, ball.mu - ball.lever * eps, 0.0)
        else:
            # How far the friction of a grip is outside of the cone, on the side of the hold.
            outside = 1 if side * friction - limit <= noise else 0
            per_force = -(ball.mu + side * ball.lever * contact.eps)
            wa = wb = Weights(outside, 0.0, side * k, side * c, per_force, 0.0)
        a = curve_of(piece, wa)
        b = curve_of(piece, wb) if paired else FLAT
        t, second, p1, q1 = first_fall(piece, a, b, paired, time)
        if t != t:
            return t, LASTS, side, p1, q1
        event = t != NO_ZERO and t < latest
        if event or attempt == 0:
            p = p1
            q = q1
        if event:
            time = t
            kind = EVENT if attempt == 0 else RESUMES
            at = side
            if second:
                at = -1.0
            elif paired:
                at = 1.0
    return time, kind, at, p, q


@inlined
def moved(
    contact: Contact,
    piece: Piece,
    resting: bool,
    eps: float,
    braking: float,
    spinning_up: float,
    t: float,
    p: Swing,
    q: Swing,
) -> State:
    """The state at the time `t` of a piece, where the swings are `p` and `q`. The impulse of the
    normal force takes `braking` from `v_x` and adds `spinning_up` to the spin sum.
    """
    ball = contact.ball
    s = piece.start
    y, y_rate, angle, rate = motion_at(piece, t, p, q)
    impulse = ball.riding * (s.y_rate - y_rate)
    # The integral of the impulse over time.
    drift = ball.riding * (s.y_rate * t - (y - s.y))
    if resting:
        total = s.spin_sum + ball.mass * ball.radius * s.v_x
        per = 1.0 / (ball.core + ball.gyration)
        twisted = ball.core * (angle - s.angle)
        omega_2 = (total - eps * impulse - ball.core * rate) * per
        turned = (total * t - eps * drift - twisted) * per
        return State(
            s.time + t,
            y,
            y_rate,
            angle,
            rate,
            ball.radius * omega_2,
            ball.inertia * omega_2 + ball.core * rate,
            s.path + ball.radius * turned,
            s.turn + ball.inertia * turned + twisted,
        )
    return State(
        s.time + t,
        y,
        y_rate,
        angle,
        rate,
        s.v_x - braking * impulse,
        s.spin_sum + spinning_up * impulse,
        s.path + s.v_x * t - braking * drift,
        s.turn + s.spin_sum * t + spinning_up * drift,
    )


# Compiled in one piece: its state is 16 values, which parts would hand to each other.
@inlined
def follow(contact: Contact, until: float) -> tuple[int, State, int, int]:  # noqa: C901
    """`(status, state, regime, phase)` of a contact at the time `until` [s] after landing: `regime`
    packs its phases until then, `phase` is the last of them.
    """
    ball = contact.ball
    spring = contact.spring
    radius = contact.ball.radius
    v_x, omega_2, stuck = landed(contact)
    slip = v_x - radius * omega_2
    spin_sum = ball.core * contact.omega + ball.shell * omega_2
    s = State(0.0, 0.0, contact.v_y, 0.0, contact.omega - omega_2, v_x, spin_sum, 0.0, 0.0)
    phase = SLIDE_BACKWARD
    side = -1.0
    if slip > 0.0:
        phase = SLIDE_FORWARD
        side = 1.0
    order = 0
    broke = False
    no_slip = abs(slip) <= SLIP_ROUNDING * (abs(v_x) + radius * abs(omega_2))
    if ball.mu > 0.0 and (stuck or no_slip):
        phase = UNDECIDED
    regime = 0
    count = 0
    lasted = False
    careful = False
    idle = 0
    status = TOO_MANY_PHASES
    eps_slide = contact.eps if contact.eps_in_slide else 0.0
    end = min(until, contact.t_force)
    for _ in range(MAX_PIECES):
        if phase == UNDECIDED:
            phase, side, order = decide(contact, s, broke)
            broke = broke and phase == HOLD
        if not s.time < end:
            status = OK
            break
        resting = phase >= GRIP
        eps = contact.eps if phase == GRIP else 0.0
        braking = side * ball.mu / ball.mass
        spinning_up = side * ball.mu * radius - eps_slide
        kappa = eps / ball.gyration if resting else -spinning_up / ball.shell
        torsion = contact.rest if resting else contact.slip
        span = end - s.time
        piece = piece_of(torsion, spring, ball.riding, kappa, s, span, contact.t_force, careful)
        t = piece.length
        kind = LASTS
        at = side
        if resting or ball.mu > 0.0:
            t, kind, at, p, q = search(contact, piece, phase, side, order, eps, spinning_up)
        else:
            p, q = swings_anew(piece, t)
        if t != t:
            break
        early = t < DOUBTFUL_SHARE * (contact.t_force - s.time)
        careful = kind != LASTS and piece.terms == 0 and early
        if careful and max(fastest(torsion), fastest(spring)) * t <= SERIES_FAR:
            continue
        careful = False
        idle = idle + 1 if kind != LASTS and t < NO_TIME * contact.t_force else 0
        if idle > PATIENCE:
            t = min(NUDGE * contact.t_force, piece.length)
            kind = LASTS
            idle = 0
            p, q = swings_anew(piece, t)
        s = moved(contact, piece, resting, eps, braking, spinning_up, t, p, q)
        last = kind == LASTS and t >= span
        lasted = lasted or t > NO_TIME * contact.t_force
        if kind != LASTS or last:
            if lasted and count < MAX_PACKED_PHASES:
                regime |= phase << (PHASE_BITS * count)
                count += 1
            lasted = False
        if last:
            status = OK
            break
        if kind == LASTS:
            side = 0.0 if phase == GRIP else side
            order = 0
            broke = False
        elif kind == RESUMES:
            phase = GRIP
            order = 0
            broke = False
        elif not resting:
            # What the search leaves of the slip is rounding.
            omega_2 = s.v_x / radius
            rate = (s.spin_sum - ball.shell * omega_2) / ball.core - omega_2
            s = State(s.time, s.y, s.y_rate, s.angle, rate, s.v_x, s.spin_sum, s.path, s.turn)
            phase = UNDECIDED
            broke = False
        elif phase == GRIP and not contact.eps_in_slide:
            phase = UNDECIDED
            broke = True
        else:
            phase = SLIDE_BACKWARD if at > 0.0 else SLIDE_FORWARD
            side = -at
            order = 2
            broke = False
    if status == OK and min(until, contact.t_contact) > contact.t_force:
        # No force any more: the joint alone swings.
        phase = FREE
        if count < MAX_PACKED_PHASES:
            regime |= FREE << (PHASE_BITS * count)
        t = min(until, contact.t_contact) - s.time
        angle, rate = swung(contact.slip, swing_at(contact.slip, t), s.angle, s.rate)
        y, y_rate = swung(spring, swing_at(spring, t), s.y, s.y_rate)
        s = State(
            s.time + t,
            y,
            y_rate,
            angle,
            rate,
            s.v_x,
            s.spin_sum,
            s.path + s.v_x * t,
            s.turn + s.spin_sum * t,
        )
    return status, s, regime, phase


@inlined
def rebound(ball: Ball, flags: Flags, v_x: float, v_y: float, omega: float, cor: float) -> Outcome:
    """Solve one impact on a ball; `cor` replaces the law of restitution unless it is NaN."""
    status, contact = contact_of(ball, flags, v_x, v_y, omega, cor)
    if status != OK:
        return unsolved(status, 0)
    status, s, regime, _ = follow(contact, contact.t_contact)
    if status != OK:
        return unsolved(status, regime)
    spin = s.spin_sum / ball.inertia
    if flags[SPIN] == SPIN_SHELL:
        spin = (s.spin_sum - ball.core * s.rate) / ball.inertia
    late = contact.t_flight - contact.t_contact
    return Outcome(
        OK,
        s.v_x,
        contact.cor * v_y,
        spin,
        contact.t_contact,
        contact.t_flight,
        s.path + s.v_x * late,
        s.turn / ball.inertia + spin * late,
        regime,
    )


@inlined
def unsolved(status: int, regime: int) -> Outcome:
    """The outcome of an impact that has no answer: NaN, with its status and its regime so far."""
    none = math.nan
    return Outcome(status, none, none, none, none, none, none, none, regime)


@kernel
def bounce(
    row: FloatArray,
    flags: Flags,
    v_x: float,
    v_y: float,
    omega: float,
    cor: float,
) -> Outcome:
    """Solve one impact of a parameter set `row`, in the order of TWO_MASS_COLUMNS, SI, under the
    choices `flags`; `cor` replaces the law of restitution unless it is NaN.
    """
    status, ball = ball_of(row, flags)
    if status != OK:
        return unsolved(status, 0)
    return rebound(ball, flags, v_x, v_y, omega, cor)


class Moment(NamedTuple):
    """The ball at one instant of a contact, SI: compression and its rate, velocity along the court,
    spins, twist, velocity of the contact point, and the forces of the ground.
    """

    y: float
    v_y: float
    v_x: float
    omega_core: float
    omega_shell: float
    twist: float
    slip: float
    normal_force: float
    friction_force: float


@kernel
def moment(
    row: FloatArray,
    flags: Flags,
    v_x: float,
    v_y: float,
    omega: float,
    cor: float,
    time: float,
) -> tuple[int, int, Moment]:
    """Status, phase and the ball at `time` [s] after landing, or at release if that is earlier;
    without meaning where the status is not OK.
    """
    status, ball = ball_of(row, flags)
    contact_status, contact = contact_of(ball, flags, v_x, v_y, omega, cor)
    if status == OK:
        status = contact_status
    s = State(0.0, 0.0, v_y, 0.0, 0.0, v_x, 0.0, 0.0, 0.0)
    phase = UNDECIDED
    if status == OK:
        status, s, _, phase = follow(contact, min(time, contact.t_contact))
    shell = (s.spin_sum - ball.core * s.rate) / ball.inertia
    force, _ = load_of(contact.spring, ball.riding, s.y, s.y_rate)
    friction = 0.0
    torque = ball.stiffness * s.angle + contact.damping * s.rate
    if phase == FREE:
        force = 0.0
    elif phase >= GRIP:
        offset_torque = contact.eps * force if phase == GRIP else 0.0
        friction = ball.lever * (torque - offset_torque)
    elif phase == SLIDE_FORWARD:
        friction = -ball.mu * force
    else:
        friction = ball.mu * force
    slip = s.v_x - ball.radius * shell
    core = shell + s.rate
    at = Moment(s.y, s.y_rate, s.v_x, core, shell, s.angle, slip, force, friction)
    return status, phase, at
