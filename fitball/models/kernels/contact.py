"""What decides a contact, as kernels: the vertical motion of the core on its spring and damper, from landing to
release, and its force; the joint of core and shell; the landing impulse.

`M1 y'' + C_y y' + K_y y = 0`, `y(0) = 0`, `y'(0) = v` (Jafri 2004, Eqs 1-2; `M` in place of `M1` with `normal =
total`). The coefficient of restitution `e` fixes the damping ratio `zeta`; which equation does so depends on when the
ball is taken to leave: at `y = 0` (`e = exp(-pi zeta/sqrt(1 - zeta^2))`, Eq. 5), or when the force has fallen to zero
(not in the thesis). Of the whole ball `v_y2 = COR v_y1` (Eq. 7), and COR follows a law in `v_y1`.

A parameter set is a row whose columns are `COLUMNS`; closures are passed as integers so that one compiled kernel
serves every composition.

Landing stops the shell at once and friction acts with it: while the impulse `J` grows from 0 to `J0`, the slip obeys
`du/dJ = -s mu A + R eps/I_s` with the constant compliance `A = 1/M + R^2/I_s`: a bounce with constant force ratio, so
Coulomb's law can be followed exactly. The same law carries the whole contact, without a search in time, when shell
and core turn as one (`I_s = I`): with `K_theta` infinite the friction a grip needs is a constant share of the normal
force. Neither is in the thesis, whose shell has mass but is not stopped, and whose joint is elastic.

Here stand also the line `eps(v_y1)` (Jafri 2004, Eq. 51: `eps = C1 v_y1 + C2`) and the share of the core in the
ball's inertia (Eqs 67 and 69).
"""

from __future__ import annotations

import math
from typing import Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import compiled, inlined, inner
from fitball.models.kernels.dual import Number, NumberArray, carry, cos, cosh, exp, log, log1p, sin, sinh, sqrt
from fitball.models.kernels.oscillator import Oscillator, oscillator, swing_at
from fitball.models.types import Status
from fitball.values import FloatArray

# Speed at which every law has the value `cor_10` and the slope `cor_slope` [m/s].
ANCHOR_SPEED = 10.0
# Where the exponential of a double would overflow.
LARGE = 600.0


@inner
def saturating_restitution(cor_10: Number, cor_slope: Number, cap: Number, v_y: Number) -> Number:
    """A restitution within (0, `cap`) at every speed whose rebound speed `COR v_y` grows at every speed.

    With `e = COR/cap` it is `e = (1 + (v_y/v_0)^q)^(-1/q)`: near `cap` for a slow ball, and `v_y COR` tends to
    `cap v_0` for a fast one. `v_0` and `q` are such that value and slope at 10 m/s are `cor_10` and `cor_slope`. The
    share `w = -10 m/s cor_slope/cor_10` is the power of `1/v_y` as which COR falls at 10 m/s: it must be below 1. For
    a COR that rises, `w <= 0`, the odds of `e` are a power of `v_y`; both agree to first order in the slope.
    NaN where there is no such law: `cor_10 <= 0` or `w >= 1`. With `cor_10 >= cap`, `cor_10`.
    """
    e = cor_10 / cap
    w = -ANCHOR_SPEED * cor_slope / cor_10
    if not (e.real > 0.0 and w.real < 1.0):
        return math.nan + 0.0 * cor_10
    if e.real >= 1.0:
        return cor_10
    stretch = log(v_y / ANCHOR_SPEED)
    if w.real <= 0.0:
        return cap * e / (e + (1.0 - e) * exp(w / (1.0 - e) * stretch))
    q = log1p(-w) / log(e)
    x = q * stretch
    odds = w / (1.0 - w)
    growth = log1p(odds * exp(x)) if x.real < LARGE else x + log(odds)
    return cap * exp(-growth / q)


class VerticalMotion(NamedTuple, Generic[Number]):
    """`cor` of the whole ball, mass on the spring [kg], the spring; end of compression and release [s], and when the
    flight after it, followed back, is at the height of contact.
    """

    cor: Number
    riding_mass: Number
    spring: Oscillator[Number]
    t_force: Number
    t_contact: Number
    t_flight: Number


OK = int(Status.OK)
COR_OUT_OF_RANGE = int(Status.COR_OUT_OF_RANGE)
COR_EXCEEDS_MASS_RATIO = int(Status.COR_EXCEEDS_MASS_RATIO)

# b*cot(b) = x is solved for b near pi/2 below this x, and for b^2 (of either sign) above it.
NEAR_UNDAMPED = 0.9


@inner
def find_angle_complement(x: float) -> float:
    """Solve `(pi/2 - d) tan(d) = x` for d in [0, pi/2), 0 <= x < 0.9, by Halley's method."""
    d = 2.0 * x / math.pi
    d += 2.0 / math.pi * d * d
    for _ in range(30):
        tangent = math.tan(d)
        arm = 0.5 * math.pi - d
        secant_squared = 1.0 + tangent * tangent
        f = arm * tangent - x
        f1 = arm * secant_squared - tangent
        f2 = 2.0 * (arm * tangent - 1.0) * secant_squared
        step = f / (f1 - 0.5 * f * f2 / f1)
        d -= step
        if abs(step) <= 1e-6 * d:
            break
    return d


@inner
def angle_complement(x: Number) -> Number:
    """`find_angle_complement` with what `x` carries."""
    d = find_angle_complement(x.real)
    arm = 0.5 * math.pi - d
    tangent = x.real / arm
    return carry(d, x, 1.0 / (arm * (1.0 + tangent * tangent) - tangent))


@inner
def slope_near_critical(z: float) -> float:
    """Slope of `sqrt(z) cot(sqrt(z))` for |z| below 1e-3."""
    return -(1.0 / 3 + z * (2.0 / 45 + z * (6.0 / 945 + z * 4.0 / 4725)))


@inner
def find_squared_angle(x: float) -> float:
    """Solve `sqrt(z) cot(sqrt(z)) = x` for z, x >= 0.9; z < 0 (hyperbolic) where x > 1."""
    # x = 1 - z/3 - z^2/45 - ... near critical damping; x -> sqrt(-z) far beyond it.
    z = 3.0 * (1.0 - x) if x < 2.0 else -x * x
    for _ in range(60):
        if abs(z) < 1e-3:
            f = 1.0 - z * (1.0 / 3 + z * (1.0 / 45 + z * (2.0 / 945 + z / 4725)))
            slope = slope_near_critical(z)
        elif z > 0.0:
            b = math.sqrt(z)
            cot = 1.0 / math.tan(b)
            f = b * cot
            slope = 0.5 * (cot / b - 1.0 - cot * cot)
        else:
            b = math.sqrt(-z)
            coth = 1.0 / math.tanh(b)
            f = b * coth
            slope = -0.5 * (coth / b + 1.0 - coth * coth)
        step = (f - x) / slope
        z -= step
        if abs(step) <= 1e-15 + 4e-16 * abs(z):
            break
    return z


@inner
def squared_angle(x: Number) -> Number:
    """`find_squared_angle` with what `x` carries."""
    z = find_squared_angle(x.real)
    # The slope of sqrt(z) cot(sqrt(z)) where that is x, on either side of critical damping.
    slope = slope_near_critical(z) if abs(z) < 1e-3 else 0.5 * (x.real * (1.0 - x.real) / z - 1.0)
    return carry(z, x, 1.0 / slope)


@inner
def zero_force_release(e: Number) -> tuple[Number, Number, Number]:
    """Damping for which the core leaves at restitution `e` when its force returns to zero.

    With `zeta = cos(b)` the force vanishes at `omega_y t = 2 b/sin(b)` and `-ln e = 2 b cot(b)`; beyond
    critical damping `b` is imaginary. Returns `(zeta, 1 - zeta^2, omega_y t)`.
    """
    x = -0.5 * log(e)
    if x.real < NEAR_UNDAMPED:
        d = angle_complement(x)
        sine = cos(d)
        return sin(d), sine * sine, (math.pi - 2.0 * d) / sine
    z = squared_angle(x)
    if z.real > 0.0:
        b = sqrt(z)
        sine = sin(b)
        return cos(b), sine * sine, 2.0 * b / sine
    if z.real < 0.0:
        b = sqrt(-z)
        sine = sinh(b)
        return cosh(b), -sine * sine, 2.0 * b / sine
    return 1.0 - 0.5 * z, z, 2.0 + z / 3.0


@inner
def zero_displacement_release(e: Number) -> tuple[Number, Number, Number, Number]:
    """Damping for `e = exp(-pi zeta/sqrt(1-zeta^2))` (Eq. 5): `(zeta, 1-zeta^2, omega_y t_f, omega_y t_c)`.

    The force turns tensile at `t_f`, before the displacement returns to zero at `t_c`.
    """
    log_e = -log(e)
    length = math.hypot(math.pi, log_e.real)
    norm = carry(length, log_e, log_e.real / length)
    zeta = log_e / norm
    root = math.pi / norm
    # zeta = sin(d), root = cos(d): the slope of the angle atan2(root, zeta) with zeta is -1/root.
    angle = carry(math.atan2(root.real, zeta.real), zeta, -1.0 / root.real)
    return zeta, root * root, 2.0 * angle / root, math.pi / root


@inner
def vertical_contact(
    cor: Number, cor_over_e: Number, natural_squared: Number, zero_force: bool
) -> tuple[int, Number, Number, Number, Number, Number]:
    """Vertical motion for a measured or modelled `cor`; `natural_squared = K_y/M_eff` [1/s^2].

    `cor_over_e` is the share of the core's restitution `e` that the whole ball keeps (`M1/M` under
    momentum balance, 1 otherwise). Returns `(status, decay, damped_squared, t_force, t_contact, t_flight)`: decay
    [1/s], damped frequency squared [1/s^2, negative beyond critical damping], end of the compressive force, release,
    start of the flight [s].

    A ball that leaves when its force has gone is still pressed in, by `y = 2 zeta e v_y1/omega_y`: its flight, of
    speed `v_y2 = COR v_y1`, begins `y/v_y2` later.
    """
    if not 0.0 < cor.real <= 1.0:
        return COR_OUT_OF_RANGE, math.nan, math.nan, math.nan, math.nan, math.nan
    e = cor / cor_over_e
    if e.real > 1.0:
        return COR_EXCEEDS_MASS_RATIO, math.nan, math.nan, math.nan, math.nan, math.nan
    omega_y = sqrt(natural_squared)
    if zero_force:
        zeta, share, angle = zero_force_release(e)
        release = angle / omega_y
        late = 2.0 * zeta / (cor_over_e * omega_y)
        return OK, zeta * omega_y, share * natural_squared, release, release, release + late
    zeta, share, angle_force, angle = zero_displacement_release(e)
    release = angle / omega_y
    return OK, zeta * omega_y, share * natural_squared, angle_force / omega_y, release, release


COLUMNS = (
    "mass_ratio", "k_y", "k_theta", "mu", "eps_10", "eps_slope", "cor_10", "cor_slope", "zeta_theta", "inertia_split",
    "ball_mass", "ball_radius", "ball_inertia",
)  # fmt: skip
(
    MASS_RATIO, K_Y, K_THETA, MU, EPS_10, EPS_SLOPE, COR_10, COR_SLOPE, ZETA_THETA, INERTIA_SPLIT,
    BALL_MASS, BALL_RADIUS, BALL_INERTIA,
) = range(len(COLUMNS))  # fmt: skip

# What the integers of `codes` choose, and their values: the places of the options in `models.types`.
RELEASE, NORMAL, OFFSET, SPIN, INERTIA, TORSION, RESTITUTION, TANGENTIAL = range(8)
RELEASE_ZERO_FORCE, OFFSET_CONTACT, SPIN_SHELL, INERTIA_TIED = 1, 1, 0, 1
NORMAL_INNER, NORMAL_MOMENTUM, NORMAL_TOTAL = 0, 1, 2
TORSION_MATCHED, TORSION_FREE, TORSION_RIGID = 0, 1, 2
COR_MEASURED, COR_MEAN, COR_LINE, COR_SATURATING = 0, 1, 2, 3
REBOUND_FALLS = int(Status.REBOUND_FALLS)


@inlined
def vertical_motion(
    row: NumberArray, codes: NDArray[np.int64], v_y: Number, cor_measured: Number
) -> tuple[int, VerticalMotion[Number]]:
    """Status and vertical motion of one impact."""
    mass_ratio, normal = row[MASS_RATIO], codes[NORMAL]
    cor = row[COR_10]
    cap = mass_ratio if normal == NORMAL_MOMENTUM else 1.0 + 0.0 * cor
    if codes[RESTITUTION] == COR_LINE:
        cor += row[COR_SLOPE] * (v_y - ANCHOR_SPEED)
    elif codes[RESTITUTION] == COR_MEASURED:
        cor = cor_measured
    elif codes[RESTITUTION] == COR_SATURATING:
        cor = saturating_restitution(cor, row[COR_SLOPE], cap, v_y)
    riding_mass = row[BALL_MASS] if normal == NORMAL_TOTAL else mass_ratio * row[BALL_MASS]
    natural_squared = row[K_Y] / riding_mass
    status, decay, damped_squared, t_force, t_contact, t_flight = vertical_contact(
        cor,
        cap,
        natural_squared,
        codes[RELEASE] == RELEASE_ZERO_FORCE,
    )
    if codes[RESTITUTION] == COR_SATURATING and ANCHOR_SPEED * row[COR_SLOPE].real <= -row[COR_10].real:
        status = REBOUND_FALLS
    spring = oscillator(decay, damped_squared, natural_squared)
    return status, VerticalMotion(cor, riding_mass, spring, t_force, t_contact, t_flight)


@inner
def vertical_at(spring: Oscillator[float], v_y: float, t: float) -> tuple[float, float]:
    """Compression and its rate `t` seconds after landing at `v_y`."""
    swing = swing_at(spring, t)
    return v_y * swing.sine, v_y * (swing.cosine - spring.decay * swing.sine)


@inner
def spring_integrals(vertical: VerticalMotion[Number], v_y: Number, t: Number) -> tuple[Number, Number]:
    """`(P, Q)` [N s, N s^2] at a time `t` during the contact."""
    swing = swing_at(vertical.spring, t)
    scale = vertical.riding_mass * v_y
    return scale * (1.0 - swing.cosine + vertical.spring.decay * swing.sine), scale * (t - swing.sine)


@compiled
def force_batch(
    rows: NumberArray,
    codes: NDArray[np.int64],
    v_y1: FloatArray,
    cor: FloatArray,
    first: NumberArray,
    spacing: FloatArray,
    out: NumberArray,
    centroid: NumberArray,
) -> None:
    """Fill `out` (2, draws, impacts, times) with P and Q, NaN for an impact without answer.

    The times are `first` (draws, impacts) after landing and every `spacing` (impacts,) from there. `centroid` (draws,
    impacts) is the mean time of the force after landing. `rows` and `codes` as in `batch.bounce_batch`; the number
    of times may be zero.
    """
    for i in range(rows.shape[0]):
        for j in range(v_y1.shape[0]):
            # Real or complex as the row is.
            zero = 0.0 * rows[i, 0]
            v_y = v_y1[j] + zero
            status, vertical = vertical_motion(rows[i], codes, v_y, cor[j] + zero)
            if status != OK:
                out[:, i, j, :] = np.nan
                centroid[i, j] = np.nan
                continue
            t_force = vertical.t_force
            whole, passed = spring_integrals(vertical, v_y, t_force)
            centroid[i, j] = t_force - passed / whole
            for k in range(out.shape[3]):
                t = first[i, j] + k * spacing[j]
                if t.real <= 0.0:
                    out[0, i, j, k], out[1, i, j, k] = zero, zero
                elif t.real >= t_force.real:
                    out[0, i, j, k], out[1, i, j, k] = whole, passed + whole * (t - t_force)
                else:
                    impulse, integral = spring_integrals(vertical, v_y, t + zero)
                    out[0, i, j, k], out[1, i, j, k] = impulse, integral


class Joint(NamedTuple, Generic[Number]):
    """Moments of inertia [kg m^2] and the torsional spring [N m] and damper [N m s] between them;
    `slide_squared` is its damped frequency squared while the contact slides.
    """

    core: Number
    shell: Number
    stiffness: Number
    damping: Number
    slide_squared: Number


class Contact(NamedTuple, Generic[Number]):
    """All that decides one contact: ball, joint, court, and the state just before landing.

    `eps` [m] is the offset of the normal force, acting during slip too if `eps_in_slide`; `landing` [N s] the impulse
    that stops the shell; `shell_spin` whether the shell's spin is the ball's, instead of the mean of both.
    """

    mass: Number
    radius: Number
    joint: Joint[Number]
    mu: Number
    eps: Number
    eps_in_slide: bool
    shell_spin: bool
    landing: Number
    vertical: VerticalMotion[Number]
    v_x: Number
    v_y: Number
    omega: Number


# Inner radius of the shell in units of the outer one, for the split of inertia (Jafri 2004, Appendix B).
CORE_RADIUS_RATIO = 0.97
TORSION_TOO_SOFT = int(Status.TORSION_TOO_SOFT)
NO_INERTIA = int(Status.NO_INERTIA)


@inner
def tied_inertia_split(mass_ratio: Number) -> Number:
    """`I1/I` of a solid core in a thin shell (Eqs 67 and 69 with their fractions in the right order)."""
    core = 0.4 * CORE_RADIUS_RATIO * CORE_RADIUS_RATIO * mass_ratio
    return core / (core + 2.0 / 3.0 * (1.0 - mass_ratio))


@inner
def tied_shell_share(mass_ratio: Number) -> Number:
    """`1 - I1/I` of `tied_inertia_split`, to full precision where the shell is light."""
    shell = 2.0 / 3.0 * (1.0 - mass_ratio)
    return shell / (0.4 * CORE_RADIUS_RATIO * CORE_RADIUS_RATIO * mass_ratio + shell)


@inlined
def joint_of(row: NumberArray, codes: NDArray[np.int64], vertical_squared: Number) -> tuple[int, Joint[Number]]:
    """Status and torsional joint; with `torsion = matched` its damped frequency squared is the vertical one,
    `vertical_squared`, with `rigid` the shell is the whole ball.
    """
    mass_ratio, stiffness, inertia = row[MASS_RATIO], row[K_THETA], row[BALL_INERTIA]
    nothing = 0.0 * inertia
    if codes[TORSION] == TORSION_RIGID:
        return OK, Joint(nothing, inertia, nothing, nothing, nothing)
    tied = codes[INERTIA] == INERTIA_TIED
    core = inertia * (tied_inertia_split(mass_ratio) if tied else row[INERTIA_SPLIT])
    shell = inertia * (tied_shell_share(mass_ratio) if tied else 1.0 - row[INERTIA_SPLIT])
    if not (core.real > 0.0 and shell.real > 0.0):
        return NO_INERTIA, Joint(core, shell, nothing, nothing, nothing)
    compliance = 1.0 / core + 1.0 / shell
    natural_squared = stiffness * compliance
    if codes[TORSION] == TORSION_MATCHED:
        if natural_squared.real < vertical_squared.real:
            return TORSION_TOO_SOFT, Joint(core, shell, nothing, nothing, nothing)
        decay = sqrt(natural_squared - vertical_squared)
        return OK, Joint(core, shell, stiffness, 2.0 * decay / compliance, vertical_squared)
    zeta = row[ZETA_THETA]
    decay = zeta * sqrt(natural_squared)
    slide_squared = natural_squared * (1.0 - zeta) * (1.0 + zeta)
    return OK, Joint(core, shell, stiffness, 2.0 * decay / compliance, slide_squared)


@inlined
def contact_of(
    row: NumberArray,
    codes: NDArray[np.int64],
    vertical: VerticalMotion[Number],
    v_x: Number,
    v_y: Number,
    omega: Number,
) -> tuple[int, Contact[Number]]:
    """Status and contact of one impact whose vertical motion is known."""
    status, joint = joint_of(row, codes, vertical.spring.damped_squared)
    landing = 0.0 * v_y
    if codes[NORMAL] == NORMAL_MOMENTUM:
        landing = (1.0 - row[MASS_RATIO]) * row[BALL_MASS] * v_y
    eps = row[EPS_10] + row[EPS_SLOPE] * (v_y - ANCHOR_SPEED)
    return status, Contact(
        row[BALL_MASS], row[BALL_RADIUS], joint, row[MU], eps, codes[OFFSET] == OFFSET_CONTACT,
        codes[SPIN] == SPIN_SHELL, landing, vertical, v_x, v_y, omega,
    )  # fmt: skip


@inner
def friction_impulse(
    slip: Number, impulse: Number, mu: Number, drive_slide: Number, drive_grip: Number, compliance: Number
) -> tuple[Number, Number, Number, float]:
    """Friction impulse that goes with a normal impulse `impulse` at constant force ratio.

    `drive_slide`, `drive_grip` are `R eps/(I_s A)`: the friction, as a share of the normal force, needed to
    balance the offset while it acts. Returns `(friction, slipped, held, onward)`: the impulse that retards the
    ball [N s], the part of `impulse` spent slipping, the part spent at zero slip without offset (hold), and
    the direction (+1, -1, or 0) in which an overpowered contact slips on from zero slip.
    """
    friction = 0.0 * impulse
    # Slip of zero has nothing to stop but what it may carry.
    stopped = 0.0 * impulse
    left = impulse
    direction = 0.0
    if slip.real > 0.0:
        direction = 1.0
    elif slip.real < 0.0:
        direction = -1.0
    if direction != 0.0:
        # Rate at which the slip, counted in its own direction, is worn down per impulse.
        rate = compliance * (mu - direction * drive_slide)
        if rate.real * impulse.real <= direction * slip.real:
            return direction * mu * impulse, impulse, 0.0, 0.0
        spent = direction * slip / rate
        friction = direction * mu * spent
        left = impulse - spent
    elif mu.real > 0.0:
        stopped = slip / compliance
    if abs(drive_grip.real) <= mu.real:
        return friction + stopped + drive_grip * left, impulse - left, 0.0, 0.0
    if abs(drive_slide.real) <= mu.real:
        return friction + stopped, impulse - left, left, 0.0
    # The offset overcomes friction: the contact slips on in the direction it drives.
    onward = 1.0 if drive_slide.real > 0.0 else -1.0
    return friction + onward * mu * left, impulse, 0.0, onward


@inlined
def impulsive_friction(contact: Contact[Number], impulse: Number) -> tuple[Number, Number, Number, float]:
    """`friction_impulse` of a contact whose shell alone turns with the court."""
    inertia, radius = contact.joint.shell, contact.radius
    compliance = 1.0 / contact.mass + radius * radius / inertia
    need = radius * contact.eps / (inertia * compliance)
    return friction_impulse(
        contact.v_x - radius * contact.omega,
        impulse,
        contact.mu,
        need if contact.eps_in_slide else 0.0 * need,
        need,
        compliance,
    )


@inlined
def landed(contact: Contact[Number]) -> tuple[Number, Number, bool]:
    """`(v_x, omega_2, stuck)` just after the landing impulse: `stuck` if it has used up the slip."""
    impulse = contact.landing
    friction, slipped, held, _onward = impulsive_friction(contact, impulse)
    acting = impulse if contact.eps_in_slide else impulse - slipped - held
    turned = contact.omega + (contact.radius * friction - contact.eps * acting) / contact.joint.shell
    return contact.v_x - friction / contact.mass, turned, slipped.real < impulse.real


@inner
def impulse_at(contact: Contact[float], t: float) -> float:
    """Normal impulse since landing, that of landing included [N s]."""
    _y, y_rate = vertical_at(contact.vertical.spring, contact.v_y, t)
    return contact.landing + contact.vertical.riding_mass * (contact.v_y - y_rate)
