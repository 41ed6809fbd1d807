"""The two-mass ball along the court: the motion within one phase, and the functions whose first zero ends it.

Shell (2) and core (1) are joined by a torsional spring and damper of torque `T = K th + C th'`. With `P` the impulse
of the normal force since a phase began, `s` the direction of slip, `J = I2 + M R^2` (Jafri 2004):

    slide         M v_x' = -s mu F;  I1 omega_1 + I2 omega_2 = const + (s mu R - eps) P     (Eqs 9, 11, 14, 15, 40)
    grip, hold    v_x = R omega_2;   I1 omega_1 + J omega_2 = const - eps P                 (Eqs 10, 14, 17, 42)

so that both spins are algebraic but for the twist between them; `eps` is zero in a hold, and in slip where it acts
while gripping only. The twist `th = theta_1 - theta_2` (Eq. 18) is driven by the normal force: while sliding

    th'' + C_theta B th' + K_theta B th = -(s mu R - eps) F/I2,    B = 1/I1 + 1/I2    (Eq. 31, there without eps)

and at zero slip `+eps F/J` with `B = 1/I1 + 1/J` (Eqs 19 and 45), each with the initial conditions that continuity
asks for. It is held in the basis of `oscillator`, or near resonance as a Taylor series.

What ends a phase, with `L = I1 omega_1 + I2 omega_2` and `v_x` at its start:

    slide         the slip,  s (v_x - R L/I) + s R I1/I th' - (mu/M + s R (s mu R - eps)/I) P
    grip, hold    the margin of the friction cone,  mu F -+ M R/J (T - eps F), which the thesis does not ask for
    hold          besides, the same with eps, on the side where it is outside: there it gives way to grip
"""

from __future__ import annotations

import math
from typing import Generic, NamedTuple

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.contact import Contact, VerticalMotion
from fitball.models.kernels.dual import Number, NumberArray
from fitball.models.kernels.oscillator import (
    NEAR_RESONANCE,
    SERIES_REACH,
    Basis,
    Oscillator,
    Oscillators,
    Series,
    Swing,
    forced_response,
    oscillator,
    prepare_series,
    prepare_swing,
    resultant,
    series_free,
    series_length,
    series_response,
    series_value,
    swing_at,
)
from fitball.models.types import GRIP, HOLD, SLIDE_FORWARD
from fitball.values import FloatArray


class Coupling(NamedTuple, Generic[Number]):
    """What follows from the constants of a contact: `inertia = I1 + I2`, `gyration = I2 + M R^2`,
    `lever = M R/gyration` (friction per torque at zero slip), the offset while sliding, the twist in either state.
    """

    inertia: Number
    gyration: Number
    lever: Number
    eps_slide: Number
    slide: Oscillator[Number]
    grip: Oscillator[Number]


class Load(NamedTuple, Generic[Number]):
    """Normal force [N], its rate [N/s], and the core's momentum towards the court [N s]."""

    force: Number
    force_rate: Number
    momentum: Number


class State(NamedTuple, Generic[Number]):
    """The ball `time` after landing: compression and its rate, twist angle `theta_1 - theta_2` and its rate, velocity
    along the court, the angular momentum `I1 omega_1 + I2 omega_2` of core and shell, and the time integrals of these
    two since landing: the path, and `I` times the mean angle by which the ball has turned.
    """

    time: Number
    y: Number
    y_rate: Number
    angle: Number
    rate: Number
    v_x: Number
    spin_sum: Number
    path: Number
    turn: Number


class Drive(NamedTuple, Generic[Number]):
    """What the normal force does in one phase: per unit of it the twist is driven by `kappa`, core and shell by
    `spinning_up`, and the ball slowed by `braking`; at rest on the court it acts `eps` ahead of the centre instead of
    the last two.
    """

    resting: bool
    torsion: Oscillator[Number]
    kappa: Number
    eps: Number
    spinning_up: Number
    braking: Number


class Weights(NamedTuple):
    """A contact function: a constant, and what it takes of twist, twist rate, normal force, and impulse since the
    start.
    """

    constant: float
    angle: float
    rate: float
    force: float
    impulse: float


@inner
def coupling_of(
    contact: Contact[Number], gyration: Number, slide_compliance: Number, grip_compliance: Number
) -> Coupling[Number]:
    """What follows from the constants of a contact whose `gyration` and relative compliances `B` are known."""
    joint = contact.joint
    decay = 0.5 * joint.damping * grip_compliance
    natural_squared = joint.stiffness * grip_compliance
    return Coupling(
        joint.core + joint.shell,
        gyration,
        contact.mass * contact.radius / gyration,
        contact.eps if contact.eps_in_slide else 0.0 * contact.eps,
        oscillator(0.5 * joint.damping * slide_compliance, joint.slide_squared, joint.stiffness * slide_compliance),
        oscillator(decay, natural_squared - decay * decay, natural_squared),
    )


@inner
def load_of(vertical: VerticalMotion[Number], y: Number, y_rate: Number) -> Load[Number]:
    """The normal force `F = K_y y + C_y y' = -M1 y''` at a compression and its rate."""
    spring = vertical.spring
    y_accel = -2.0 * spring.decay * y_rate - spring.natural_squared * y
    return Load(
        -vertical.riding_mass * y_accel,
        vertical.riding_mass * (spring.natural_squared * y_rate + 2.0 * spring.decay * y_accel),
        vertical.riding_mass * y_rate,
    )


@inlined
def drive_of(contact: Contact[Number], coupling: Coupling[Number], phase: int) -> Drive[Number]:
    """What the normal force does in a phase."""
    nothing = 0.0 * contact.eps
    if phase == GRIP:
        return Drive(True, coupling.grip, contact.eps / coupling.gyration, contact.eps, nothing, nothing)
    if phase == HOLD:
        return Drive(True, coupling.grip, nothing, nothing, nothing, nothing)
    friction = contact.mu if phase == SLIDE_FORWARD else -contact.mu
    spinning_up = friction * contact.radius - coupling.eps_slide
    return Drive(
        False, coupling.slide, -spinning_up / contact.joint.shell, nothing, spinning_up, friction / contact.mass
    )


@inner
def series_for(oscillators: Oscillators[float], span: float, careful: bool) -> Series:
    """How the functions of a phase that lasts at most `span` are held.

    In the basis of both oscillators the length is `span`; near resonance it may be shorter: the phase is then solved
    in pieces. `careful` asks for a series, which loses nothing to cancellation just after the start.
    """
    span_squared = span * span
    if not careful and resultant(oscillators) * span_squared * span_squared > NEAR_RESONANCE:
        return Series(0, span)
    pole = max(fastest(oscillators.torsion), fastest(oscillators.vertical))
    length = span if pole * span <= SERIES_REACH else SERIES_REACH / pole
    return Series(series_length(pole * length), length)


@inlined
def solve_twist(
    drive: Drive[Number],
    oscillators: Oscillators[Number],
    state: State[Number],
    load: Load[Number],
    series: Series,
    twist: NumberArray,
    force: NumberArray,
) -> None:
    """Fill `twist` with the coefficients of the twist from `state` on: 4 in the basis of both oscillators, or those
    of a Taylor series, with the `force` in the same form.
    """
    force_s = load.force_rate + oscillators.vertical.decay * load.force
    n, length = series.terms, series.length
    if n > 0:
        series_free(load.force, force_s, oscillators.vertical, length, n, force)
        series_response(drive.torsion, drive.kappa, force, state.angle, state.rate, length, n, twist)
    else:
        forced_response(oscillators, drive.kappa, load.force, force_s, state.angle, state.rate, twist)


@inlined
def advance(
    contact: Contact[Number],
    coupling: Coupling[Number],
    drive: Drive[Number],
    start: State[Number],
    load: Load[Number],
    moved: State[Number],
) -> State[Number]:
    """What follows from compression and twist, which are those of `moved` at its time: velocity and spins of a phase
    that began at `start` with `load`, and their integrals.
    """
    core, elapsed = contact.joint.core, moved.time - start.time
    impulse = load.momentum - contact.vertical.riding_mass * moved.y_rate
    # The integral of the impulse over time.
    drift = load.momentum * elapsed - contact.vertical.riding_mass * (moved.y - start.y)
    if drive.resting:
        # About the contact point, and with the momentum of `v_x`: slip of zero that carries something stops too.
        total = start.spin_sum + contact.mass * contact.radius * start.v_x
        omega_2 = (total - drive.eps * impulse - core * moved.rate) / (core + coupling.gyration)
        v_x, spin_sum = contact.radius * omega_2, coupling.inertia * omega_2 + core * moved.rate
        twisted = core * (moved.angle - start.angle)
        turned = (total * elapsed - drive.eps * drift - twisted) / (core + coupling.gyration)
        path, turn = contact.radius * turned, coupling.inertia * turned + twisted
    else:
        v_x, spin_sum = start.v_x - drive.braking * impulse, start.spin_sum + drive.spinning_up * impulse
        path = start.v_x * elapsed - drive.braking * drift
        turn = start.spin_sum * elapsed + drive.spinning_up * drift
    return State(
        moved.time,
        moved.y,
        moved.y_rate,
        moved.angle,
        moved.rate,
        v_x,
        spin_sum,
        start.path + path,
        start.turn + turn,
    )


@inlined
def swung_to(
    oscillators: Oscillators[Number],
    series: Series,
    twist: NumberArray,
    start: State[Number],
    elapsed: Number,
    basis: Basis[Number],
    twisting: bool,
) -> State[Number]:
    """The state at `start` with time, compression and, if it is wanted, twist as they are `elapsed` later; the basis
    there a series does not need.
    """
    spring = oscillators.vertical
    swing = swing_at(spring, elapsed) if series.terms > 0 else basis.vertical
    y, y_rate = swung(spring, swing, start.y, start.y_rate)
    angle, rate = start.angle, start.rate
    if twisting:
        angle, rate = twist_at(twist, oscillators, series, elapsed, basis)
    return State(start.time + elapsed, y, y_rate, angle, rate, start.v_x, start.spin_sum, start.path, start.turn)


@inner
def fastest(o: Oscillator[float]) -> float:
    """Magnitude of the oscillator's larger pole [1/s]."""
    return o.decay + o.frequency if o.damped_squared < 0.0 else math.sqrt(o.natural_squared)


@inner
def twist_at(
    twist: NumberArray, oscillators: Oscillators[Number], series: Series, t: Number, basis: Basis[Number]
) -> tuple[Number, Number]:
    """Twist and its rate at time `t` of the phase, where the basis is `basis` (not needed by a series)."""
    if series.terms > 0:
        angle, rate, _ = series_value(twist, series.terms, t / series.length)
        return angle, rate / series.length
    return twist_in_basis(twist, oscillators, basis)


@inner
def twist_in_basis(
    twist: NumberArray, oscillators: Oscillators[Number], basis: Basis[Number]
) -> tuple[Number, Number]:
    """Twist and its rate where the basis is `basis`."""
    torsion, vertical = oscillators.torsion, oscillators.vertical
    p, q, r, s = basis.torsion.cosine, basis.torsion.sine, basis.vertical.cosine, basis.vertical.sine
    angle = twist[0] * p + twist[1] * q + twist[2] * r + twist[3] * s
    rate = (
        (twist[1] - torsion.decay * twist[0]) * p
        - (torsion.damped_squared * twist[0] + torsion.decay * twist[1]) * q
        + (twist[3] - vertical.decay * twist[2]) * r
        - (vertical.damped_squared * twist[2] + vertical.decay * twist[3]) * s
    )
    return angle, rate


@inner
def swung(spring: Oscillator[Number], swing: Swing[Number], y: Number, y_rate: Number) -> tuple[Number, Number]:
    """Displacement and velocity of the core a `swing` after they were `y`, `y_rate`."""
    c, s, a = swing.cosine, swing.sine, spring.decay
    return y * c + (y_rate + a * y) * s, y_rate * c - (a * y_rate + spring.natural_squared * y) * s


@inner
def compose(
    weights: Weights,
    load: Load[float],
    oscillators: Oscillators[float],
    series: Series,
    twist: FloatArray,
    drive: FloatArray,
    out: FloatArray,
) -> float:
    """Write a contact function of a phase that starts with `load` into `out`.

    Returns the bound of the sixth derivative where the function is a series.
    """
    n, length = series.terms, series.length
    if n > 0:
        for k in range(n):
            value = weights.angle * twist[k] + weights.force * drive[k]
            if k + 1 < n:
                value += weights.rate * (k + 1) * twist[k + 1] / length
            if k > 0:
                value += weights.impulse * drive[k - 1] * length / k
            out[k] = value
        out[0] += weights.constant
        return prepare_series(out, n, length)
    compose_basis(weights, load, oscillators, twist, out)
    prepare_swing(out, 0, oscillators.torsion, length)
    prepare_swing(out, 1, oscillators.vertical, length)
    return 0.0


@inner
def compose_basis(
    weights: Weights, load: Load[Number], oscillators: Oscillators[Number], twist: NumberArray, out: NumberArray
) -> None:
    """Write the coefficients of a contact function in the basis into `out`."""
    torsion, vertical = oscillators.torsion, oscillators.vertical
    out[0] = weights.constant + weights.impulse * load.momentum
    out[1] = weights.angle * twist[0] + weights.rate * (twist[1] - torsion.decay * twist[0])
    out[2] = weights.angle * twist[1] - weights.rate * (torsion.damped_squared * twist[0] + torsion.decay * twist[1])
    out[3] = weights.angle * twist[2] + weights.rate * (twist[3] - vertical.decay * twist[2])
    out[3] += weights.force * load.force - weights.impulse * load.momentum
    out[4] = weights.angle * twist[3] - weights.rate * (
        vertical.damped_squared * twist[2] + vertical.decay * twist[3]
    )
    out[4] += weights.force * (load.force_rate + vertical.decay * load.force) - weights.impulse * (
        vertical.decay * load.momentum - load.force
    )


@inner
def free_twist(torsion: Oscillator[Number], angle: Number, rate: Number, t: Number) -> tuple[Number, Number]:
    """Twist and its rate after `t` seconds without ground force."""
    return swung_freely(torsion, swing_at(torsion, t), angle, rate)


@inner
def swung_freely(
    torsion: Oscillator[Number], swing: Swing[Number], angle: Number, rate: Number
) -> tuple[Number, Number]:
    """Twist and its rate a `swing` of the joint later without ground force."""
    c, s = swing.cosine, swing.sine
    lead = rate + torsion.decay * angle
    return angle * c + lead * s, rate * c - (torsion.damped_squared * angle + torsion.decay * lead) * s


@inlined
def gaps_of(
    contact: Contact[Number], coupling: Coupling[Number], end: State[Number], omega_2: Number
) -> tuple[Number, Number]:
    """Path [m] and turn [rad] between the flights before and after, for the state in which the force ended.

    The shell turns with the ball, but for its share of the twist, which dies out in flight: the angle of the flight
    is the mean angle of core and shell.
    """
    vertical = contact.vertical
    turn = end.turn + end.spin_sum * (vertical.t_contact - vertical.t_force)
    return (
        end.path + end.v_x * (vertical.t_flight - vertical.t_force),
        turn / coupling.inertia + omega_2 * (vertical.t_flight - vertical.t_contact),
    )
