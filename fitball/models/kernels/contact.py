"""What decides a contact: the law of restitution, the vertical motion to its release, the joint,
the landing impulse.

`M1 y'' + C_y y' + K_y y = 0`, `y(0) = 0`, `y'(0) = v` (Jafri 2004, Eqs 1-2; `M` for `M1` with
`normal = total`). The restitution `e` of the core fixes the damping `zeta`; how depends on when the
ball is taken to leave: at `y = 0` (Eq. 5), or when the force has fallen to zero. Of the whole ball
`v_y2 = COR v_y1` (Eq. 7).

Constants of a parameter set are made once (`ball_of`) for all its impacts. Choices are small
integers (`FLAG_CHOICES`).
"""

import math
from typing import NamedTuple, TypeAlias

from fitball.base.values import FloatArray
from fitball.models.kernels.compiled import inlined, kernel
from fitball.models.kernels.motion import Spring, spring_of, swing_at
from fitball.models.types import Status

Flags: TypeAlias = tuple[int, int, int, int, int, int, int]

# Speed at which the law of restitution has the value `cor_10` and the slope `cor_slope` [m/s].
ANCHOR_SPEED = 10.0
# Exponent from which on ln(1 + odds exp(x)) is that of its second term: exp overflows from 709 on.
LARGE = 600.0
# Restitution below which there is no answer: it would take damping without bounds.
LEAST_COR = 1e-12
# Inner radius of the shell in units of the outer one, for the split of inertia (Appendix B).
CORE_RADIUS_RATIO = 0.97

# Statuses as kernels have them: plain integers.
OK = +Status.OK
COR_OUT_OF_RANGE = +Status.COR_OUT_OF_RANGE
COR_EXCEEDS_MASS_RATIO = +Status.COR_EXCEEDS_MASS_RATIO
TORSION_TOO_SOFT = +Status.TORSION_TOO_SOFT
TOO_MANY_PHASES = +Status.TOO_MANY_PHASES
NO_INERTIA = +Status.NO_INERTIA
REBOUND_FALLS = +Status.REBOUND_FALLS
NO_IMPACT = +Status.NO_IMPACT

# Parameters in the order of a kernel's row, and the places of each.
TWO_MASS_COLUMNS = (
    "mass_ratio",
    "k_y",
    "k_theta",
    "mu",
    "eps_10",
    "eps_slope",
    "cor_10",
    "cor_slope",
    "zeta_theta",
    "inertia_split",
    "ball_mass",
    "ball_radius",
    "inertia_ratio",
)
(
    MASS_RATIO,
    K_Y,
    K_THETA,
    MU,
    EPS_10,
    EPS_SLOPE,
    COR_10,
    COR_SLOPE,
    ZETA_THETA,
    INERTIA_SPLIT,
    BALL_MASS,
    BALL_RADIUS,
    INERTIA_RATIO,
) = range(len(TWO_MASS_COLUMNS))

# The choices of a composition in the order of `flags`, each the place of its option here.
FLAG_CHOICES = (
    ("normal", ("inner", "momentum", "total")),
    ("offset", ("grip", "contact")),
    ("torsion", ("matched", "free")),
    ("inertia", ("table", "tied")),
    ("spin", ("shell", "mean")),
    ("release", ("zero_displacement", "zero_force")),
    ("cor", ("saturating", "power", "line", "root")),
)
NORMAL, OFFSET, TORSION, INERTIA, SPIN, RELEASE, COR = range(7)
# normal=momentum: landing stops the shell by an impulse; at release the core picks it up.
NORMAL_MOMENTUM = 1
# normal=total: the whole mass rides on the spring.
NORMAL_TOTAL = 2
# offset=contact: the offset acts during the whole contact, else while gripping only.
OFFSET_CONTACT = 1
# torsion=free: the damping ratio is a parameter; else twist and compression have one damped
# frequency while the ball slides.
TORSION_FREE = 1
# inertia=tied: the inertias of core and shell follow from the mass ratio.
INERTIA_TIED = 1
# spin=shell: the spin after the bounce is that of the shell at release, else the mean of both.
SPIN_SHELL = 0
# release=zero_force: contact ends when the force returns to zero, else when the compression does.
ZERO_FORCE = 1
# cor=...: how restitution goes with the vertical speed.
SATURATING, POWER, LINE, ROOT = range(4)
# Exponent of bodies that yield (Johnson, Contact Mechanics 1985, ch. 11).
YIELDING_POWER = -0.25


class Law(NamedTuple):
    """The law of restitution, `COR = cap e`, with `x = ln(v_y/10)`. Where `odds` is not zero
    `ln(e) = -share ln(1 + odds exp(power x))`; where `slope` is not, COR is a line through `cor_10`
    at 10 m/s; else `ln(e) = log_10 + power x`.
    """

    cap: float
    cor_10: float
    log_10: float
    odds: float
    power: float
    share: float
    slope: float


class Ball(NamedTuple):
    """What all impacts of a parameter set on a ball share, SI.

    `core` and `shell` are moments of inertia, `gyration = shell + M R^2`, `lever = M R/gyration`;
    `slip` and `rest` the compliances of the twist in slip and at zero slip; `riding` the mass on
    the spring, of `frequency` [rad/s] without damping and its square, `landing` the mass that
    landing stops; `law` that of restitution.
    """

    mass: float
    radius: float
    inertia: float
    core: float
    shell: float
    gyration: float
    lever: float
    slip: float
    rest: float
    stiffness: float
    zeta_theta: float
    riding: float
    landing: float
    natural_squared: float
    frequency: float
    mu: float
    eps_10: float
    eps_slope: float
    law: Law


class Contact(NamedTuple):
    """One impact on a ball, SI: the vertical oscillator `spring`, COR of the whole ball; the times
    of the end of the force, of release, and at which the flight after it, followed back, is at the
    height of contact; the oscillators of the twist in `slip` and at zero slip (`rest`), `damping`
    of the joint [N m s], offset `eps` [m], whether it acts in slip too, and the state just before
    landing.
    """

    ball: Ball
    spring: Spring
    cor: float
    t_force: float
    t_contact: float
    t_flight: float
    slip: Spring
    rest: Spring
    damping: float
    eps: float
    eps_in_slide: bool
    v_x: float
    v_y: float
    omega: float


@kernel
def law_of(cor_10: float, cor_slope: float, cap: float, flags: Flags) -> tuple[int, Law]:
    """Status and law of restitution with the value `cor_10` and the slope `cor_slope` at 10 m/s,
    below the limit `cap`. ROOT has a slope of its own.

    With `e = COR/cap` and `w = -10 cor_slope/cor_10` POWER is `e_10 (v/10)^-w`. SATURATING is `(1 +
    (v/v_0)^q)^(-1/q)` for 0 < w < 1; the odds of `e` go as a power of `v` for w < 0; `e` is
    constant where it is 1. All are constant for w = 0.
    """
    kind = flags[COR]
    e = cor_10 / cap
    w = -ANCHOR_SPEED * cor_slope / cor_10
    log_10 = math.log(e)
    odds = 0.0
    power = 0.0
    share = 0.0
    slope = 0.0
    # From w = 1 on the speed after the bounce would not grow with the speed before it.
    status = OK if w < 1.0 or kind == ROOT else REBOUND_FALLS
    if not e > 0.0:
        status = COR_OUT_OF_RANGE
    elif kind == POWER:
        power = -w
    elif kind == LINE:
        slope = cor_slope
    elif kind == ROOT:
        power = YIELDING_POWER
    elif e < 1.0 and w < 0.0:
        odds = (1.0 - e) / e
        power = w / (1.0 - e)
        share = 1.0
    elif e < 1.0 and 0.0 < w < 1.0:
        q = math.log1p(-w) / log_10
        odds = w / (1.0 - w)
        power = q
        share = 1.0 / q
    return status, Law(cap, cor_10, log_10, odds, power, share, slope)


@kernel
def ball_of(row: FloatArray, flags: Flags) -> tuple[int, Ball]:
    """Status and constants of a parameter set `row` under the choices `flags`."""
    ratio = row[MASS_RATIO]
    mass = row[BALL_MASS]
    radius = row[BALL_RADIUS]
    inertia = row[INERTIA_RATIO] * mass * radius * radius
    if flags[INERTIA] == INERTIA_TIED:
        # A solid core in a thin shell (Eqs 67 and 69 with their fractions in the right order).
        solid = 0.4 * CORE_RADIUS_RATIO * CORE_RADIUS_RATIO * ratio
        thin = 2.0 / 3.0 * (1.0 - ratio)
        core = inertia * (solid / (solid + thin))
        shell = inertia * (thin / (solid + thin))
    else:
        core = inertia * row[INERTIA_SPLIT]
        shell = inertia * (1.0 - row[INERTIA_SPLIT])
    momentum = flags[NORMAL] == NORMAL_MOMENTUM
    cap = ratio if momentum else 1.0
    status, law = law_of(row[COR_10], row[COR_SLOPE], cap, flags)
    if not (core > 0.0 and shell > 0.0) and status == OK:
        status = NO_INERTIA
    riding = mass if flags[NORMAL] == NORMAL_TOTAL else ratio * mass
    gyration = shell + mass * radius * radius
    natural_squared = row[K_Y] / riding
    return status, Ball(
        mass,
        radius,
        inertia,
        core,
        shell,
        gyration,
        mass * radius / gyration,
        1.0 / core + 1.0 / shell,
        1.0 / core + 1.0 / gyration,
        row[K_THETA],
        row[ZETA_THETA],
        riding,
        (1.0 - ratio) * mass if momentum else 0.0,
        natural_squared,
        math.sqrt(natural_squared),
        row[MU],
        row[EPS_10],
        row[EPS_SLOPE],
        law,
    )


@inlined
def restitution(law: Law, v_y: float, cor: float) -> tuple[int, float, float]:
    """Status, COR and logarithm of `COR/cap` at the speed `v_y`; `cor` replaces the law unless it
    is NaN.
    """
    if not v_y > 0.0:
        return NO_IMPACT, 0.0, 0.0
    if cor == cor:
        log_e = math.log(cor / law.cap)
    elif law.slope != 0.0:
        cor = law.cor_10 + law.slope * (v_y - ANCHOR_SPEED)
        log_e = math.log(max(cor, LEAST_COR) / law.cap)
    elif law.power == 0.0:
        cor = law.cor_10
        log_e = law.log_10
    elif law.odds == 0.0:
        log_e = law.log_10 + law.power * math.log(v_y / ANCHOR_SPEED)
        cor = law.cap * math.exp(log_e)
    else:
        x = law.power * math.log(v_y / ANCHOR_SPEED)
        log_sum = math.log1p(law.odds * math.exp(x)) if x < LARGE else x + math.log(law.odds)
        log_e = -law.share * log_sum
        cor = law.cap * math.exp(log_e)
    if not LEAST_COR < cor <= 1.0:
        return COR_OUT_OF_RANGE, cor, log_e
    if cor > law.cap:
        return COR_EXCEEDS_MASS_RATIO, cor, log_e
    return OK, cor, log_e


@inlined
def zero_force_release(log_e: float) -> tuple[float, float, float]:
    """`(zeta, 1 - zeta^2, omega_y t)` for which the core's force returns to zero at restitution
    `exp(log_e)`.

    With `zeta = cos(b)` the force vanishes at `omega_y t = 2 b/sin(b)`, and `-log_e = 2 b cot(b)`:
    solved for `b^2`, which is negative beyond critical damping.
    """
    x = -0.5 * log_e
    # A polynomial near z = b^2, to 3e-10 for x below 0.5 (restitution above 0.37): one step of the
    # loop is then enough.
    z = 0.00433787671 - x * (0.00037281493 + x * 0.000170741727)
    z = 2.4674011 - x * (2.0 + x * (0.405284705 + x * (0.0583219842 + x * z)))
    if not x < 1.0:
        z = (1.0 - x) * (2.0 + x)
    # Newton's steps on `b cot(b) = x`, in terms of C and S of an oscillator.
    for _ in range(60):
        swing = swing_at(spring_of(0.0, z, z), 1.0)
        c = 1.0 + swing.c
        s = swing.s
        # Of the slopes by z that of the cosine is -s/2; this is that of s.
        fall = -1.0 / 6.0
        if abs(z) > 1e-4:
            fall = 0.5 * (c - s) / z
        step = (c / s - x) / (0.5 + c * fall / (s * s))
        z += step
        if abs(step) <= 1e-9 * (1.0 + abs(z)):
            break
    # s goes along with the last step.
    s += fall * step
    return x * s, z * s * s, 2.0 / s


@inlined
def contact_of(
    ball: Ball,
    flags: Flags,
    v_x: float,
    v_y: float,
    omega: float,
    cor: float,
) -> tuple[int, Contact]:
    """Status and contact of one impact at this state, SI; `cor` replaces the law of restitution
    unless it is NaN.

    A ball that leaves when its force has gone is still pressed in, by `y = 2 zeta e v_y1/omega_y`:
    its flight, of speed `v_y2 = COR v_y1`, begins `y/v_y2` later.
    """
    status, cor, log_e = restitution(ball.law, v_y, cor)
    if status != OK:
        zeta = 0.0
        share = 1.0
        angle_force = math.pi
        angle = math.pi
        late = 0.0
    elif flags[RELEASE] == ZERO_FORCE:
        zeta, share, angle = zero_force_release(log_e)
        angle_force = angle
        late = 2.0 * zeta / ball.law.cap
    else:
        length = math.hypot(math.pi, log_e)
        zeta = -log_e / length
        root = math.pi / length
        share = root * root
        angle_force = 2.0 * math.atan2(root, zeta) / root
        angle = math.pi / root
        late = 0.0
    natural = ball.slip * ball.stiffness
    per_omega = 1.0 / ball.frequency
    spring = spring_of(zeta * ball.frequency, share * ball.natural_squared, ball.natural_squared)
    if flags[TORSION] == TORSION_FREE:
        zeta = ball.zeta_theta
        decay = zeta * math.sqrt(natural)
        damped = natural * (1.0 - zeta) * (1.0 + zeta)
    else:
        damped = spring.damped_squared
        if natural < damped and status == OK:
            status = TORSION_TOO_SOFT
        decay = math.sqrt(max(natural - damped, 0.0))
    # At zero slip the ground holds the shell: the joint turns more inertia, and swings slower.
    softer = ball.rest / ball.slip
    decay_rest = decay * softer
    natural_rest = natural * softer
    return status, Contact(
        ball,
        spring,
        cor,
        angle_force * per_omega,
        angle * per_omega,
        (angle + late) * per_omega,
        spring_of(decay, damped, natural),
        spring_of(decay_rest, natural_rest - decay_rest * decay_rest, natural_rest),
        2.0 * decay / ball.slip,
        ball.eps_10 + ball.eps_slope * (v_y - ANCHOR_SPEED),
        flags[OFFSET] == OFFSET_CONTACT,
        v_x,
        v_y,
        omega,
    )


@inlined
def landed(contact: Contact) -> tuple[float, float, bool]:
    """`(v_x, omega_2, stuck)` just after the impulse of landing that stops the shell; `stuck` says
    whether that has used up the slip.

    While the impulse grows the slip obeys `du/dJ = -s mu A + R eps/I_s` with the compliance `A =
    1/M + R^2/I_s`: a bounce with constant force ratio, so that Coulomb's law is followed exactly.
    """
    ball = contact.ball
    impulse = ball.landing * contact.v_y
    mu = ball.mu
    radius = ball.radius
    shell = ball.shell
    slip = contact.v_x - radius * contact.omega
    compliance = 1.0 / ball.mass + radius * radius / shell
    # Friction per normal force that balances the offset, at rest and where it acts in slip.
    need = radius * contact.eps / (shell * compliance)
    need_slide = need if contact.eps_in_slide else 0.0
    side = 1.0 if slip > 0.0 else -1.0
    rate = compliance * (mu - side * need_slide)
    stuck = slip == 0.0 or rate * impulse > side * slip
    # The part of the normal impulse during which the contact slips.
    slipping = impulse
    if stuck:
        slipping = 0.0
        if slip != 0.0:
            slipping = side * slip / rate
    friction = side * mu * slipping
    # The part during which an offset acts that acts in grip alone.
    acting = 0.0
    rest = impulse - slipping
    if abs(need) <= mu:
        friction = friction + need * rest
        acting = rest
    elif abs(need_slide) > mu and stuck:
        # The offset overcomes friction: the contact slips on in the direction it drives.
        friction += math.copysign(mu, need_slide) * rest
        stuck = False
    if contact.eps_in_slide:
        acting = impulse
    omega_2 = contact.omega + (radius * friction - contact.eps * acting) / shell
    return contact.v_x - friction / ball.mass, omega_2, stuck
