"""An independent solution of one bounce: the equations of motion summed as Taylor series, in any
kind of number.

Nothing comes from the package, and no motion is a closed form. While the contact point slides,
grips or holds, the ball obeys `z' = A z`, z = (y, y', v_x, omega_1, omega_2, twist, path, turn), so
that a term of its series gives the next; what ends a phase is a weighted sum over z, a polynomial
whose first zero is isolated by bounds. With core (1), shell (2), normal force F, friction f on the
ball, torque T of the joint, mass M_r on the spring:

    M_r y'' = -F,         F = K_y y + C_y y'
    I_1 omega_1' = -T,    T = K th + C th',    th' = omega_1 - omega_2
    M v_x' = f,           I_2 omega_2' = T - R f - eps F
    slide: f = -s mu F;   at rest: f such that v_x' = R omega_2'

A contact point at rest takes the first of grip, hold (a grip without the offset), slide forward,
slide back that does not contradict itself just after: the first Taylor term that is more than
rounding decides. Damping is found by
shooting: that with which the core keeps the given share of its speed.
"""

import math
from collections import namedtuple
from decimal import localcontext
from functools import lru_cache
from typing import Any, NamedTuple

from support.taylor_series import DOUBLE, FIRST, REACH, Piece, total

SLIDE_FORWARD = 1
SLIDE_BACKWARD = 2
GRIP = 3
HOLD = 4
FREE = 5
Y, V, X, W1, W2, TWIST, PATH, TURN = range(8)
# Most phases of a contact: far more than any that ends.
PHASES = 4000
DEFAULT = {
    "normal": "momentum",
    "offset": "contact",
    "torsion": "matched",
    "inertia": "tied",
    "spin": "mean",
    "release": "zero_force",
    "cor": "saturating",
}
BALL = (0.0576, 0.03302, 0.56)
OUTPUTS = ("v_x2", "v_y2", "omega_2", "contact_time", "gap_time", "gap_path", "gap_turn")


class Answer(
    namedtuple(
        "Answer",
        ("status", *OUTPUTS, "phases", "state"),
        defaults=[math.nan] * 7 + [()] * 2,
    )
):
    """A bounce; `phases` are pairs of phase and duration, `state` is z at the end. NaN unless
    `status` is OK.
    """

    def regime(self, shortest=0.0):
        """Octal digits of the phases, the first lowest, without those up to a share `shortest` of
        the contact.
        """
        least = shortest * float(self.contact_time)
        phases = [phase for phase, duration in self.phases if duration > least]
        return sum(phase << 3 * k for k, phase in enumerate(phases[:20]))


def fastest(decay, natural_squared, sqrt):
    """The larger pole of x'' + 2 decay x' + natural_squared x = 0."""
    rest = decay * decay - natural_squared
    return decay + sqrt(rest) if rest > 0 else sqrt(natural_squared)


def law(cor_10, slope, cap, v, log, cor="saturating"):
    """A law of restitution, of this value and slope at 10 m/s; None where the rebound would fall
    with speed. A root has a slope of its own.
    """
    if cor == "root":
        return cor_10 * (10 / v) ** (1 / type(v)(4))
    e = cor_10 / cap
    w = -10 * slope / cor_10
    if w >= 1:
        return None
    if cor == "power":
        return cor_10 * (v / 10) ** (10 * slope / cor_10)
    if cor == "line":
        return cor_10 + slope * (v - 10)
    if e >= 1:
        return cor_10
    if w > 0:
        q = log(1 - w) / log(e)
        return cap * (1 + w / (1 - w) * (v / 10) ** q) ** (-1 / q)
    odds = e / (1 - e) * (v / 10) ** (-w / (1 - e))
    return cap * odds / (1 + odds)


def swing(zeta, by_force, kind):
    """The swing y'' + 2 zeta y' + y = 0 from y = 0, y' = 1: when the force ends, when the contact
    ends, and -y'.
    """
    z = [0 * zeta, 0 * zeta + 1]
    t = 0 * zeta
    ends = []
    h = REACH / fastest(zeta, 0 * zeta + 1, kind.sqrt)
    rates = [{1: 1}, {0: -1, 1: -2 * zeta}]
    end_of_force = {0: 1, 1: 2 * zeta}
    end_of_contact = {0: 1}
    events = [end_of_force] if by_force else [end_of_force, end_of_contact]
    for event in events:
        x = None
        while x is None:
            piece = Piece(rates, z, h, kind)
            x = piece.fall(event)
            share = 1 if x is None else x
            z = piece.at(share)
            t = t + h * share
        ends.append(t)
    return ends[0], ends[-1], -z[1]


@lru_cache(maxsize=4096)
def damping(speed_share, by_force, kind):
    """`zeta` with which a swing keeps this share of its speed, by Ridders' method, and the times of
    `swing`.
    """

    def excess(zeta):
        return swing(zeta, by_force, kind)[2] - speed_share

    low = 0 * speed_share
    above = 1 - speed_share
    high = 0 * speed_share + 1 / kind.make(2)
    if above <= 0:
        return low, *swing(low, by_force, kind)[:2]
    while (below := excess(high)) > 0:
        low = high
        above = below
        high = 2 * high if by_force else (1 + high) / 2
    x = high
    old = low
    while abs(x - old) > kind.rounding / 500 * x:
        middle = (low + high) / 2
        old = x
        f = excess(middle)
        x = middle + (middle - low) * f / kind.sqrt(f * f - above * below)
        for at, f_at in sorted(((middle, f), (x, excess(x)))):
            if f_at > 0 and at > low:
                low = at
                above = f_at
            elif f_at < 0 and at < high:
                high = at
                below = f_at
    return x, *swing(x, by_force, kind)[:2]


def landed(v_x, omega_2, impulse, mass, radius, shell, mu, eps, in_slide):
    """Velocity and spin of the shell after the impulse that stops it, while friction obeys
    Coulomb's law.
    """
    yields = 1 / mass + radius * radius / shell
    slip = v_x - radius * omega_2

    def pushed(v_x, omega_2, friction, lever, normal_impulse):
        v_x = v_x + friction * normal_impulse / mass
        omega_2 = omega_2 - (radius * friction + lever) * normal_impulse / shell
        return v_x, omega_2

    # Friction and offset per normal force: in slip, until it is used up.
    friction = -mu if slip > 0 else mu
    lever = eps if in_slide else 0
    rate = yields * friction + radius * lever / shell
    if rate * slip < 0:
        spent = min(impulse, -slip / rate)
    elif slip != 0:
        spent = impulse
    else:
        spent = 0
    v_x, omega_2 = pushed(v_x, omega_2, friction, lever, spent)
    # Then what keeps the contact point at rest, as far as friction can.
    need = -radius * eps / (shell * yields)
    friction = 0
    lever = 0
    if abs(need) <= mu:
        friction = need
        lever = eps
    elif in_slide:
        friction = mu if need > 0 else -mu
        lever = eps
    return pushed(v_x, omega_2, friction, lever, impulse - spent)


class NoBounce(Exception):
    """An impact without a bounce; `status` says why."""

    def __init__(self, status):
        super().__init__(status)
        self.status = status


class Body(NamedTuple):
    """The ball: its mass, its radius, and its moment of inertia, SI."""

    mass: Any
    radius: Any
    inertia: Any


class Normal(NamedTuple):
    """The normal direction: the mass `riding` on spring k and damper c, its natural frequency omega
    and damping ratio zeta, and when the force and the contact end, SI.
    """

    riding: Any
    k: Any
    c: Any
    omega: Any
    zeta: Any
    t_force: Any
    t_contact: Any


class Joint(NamedTuple):
    """The moments of inertia of core and shell, and the spring k and damper c between them, SI."""

    core: Any
    shell: Any
    k: Any
    c: Any


class Surface(NamedTuple):
    """Coulomb's friction mu, the offset eps of the normal force [m], and whether the offset acts
    while the contact point slides, too.
    """

    mu: Any
    eps: Any
    in_slide: bool


def restitution(p, cor, cap, v_y, kind, name):
    """The coefficient of restitution: `cor`, or that of the law of this name where it is None.
    NoBounce is raised where no damping can give it.
    """
    if cor is None:
        e = law(p["cor_10"], p.get("cor_slope", 0), cap, v_y, kind.log, name)
    else:
        e = kind.make(cor)
    if e is None:
        raise NoBounce("REBOUND_FALLS")
    if cap < e <= 1:
        raise NoBounce("COR_EXCEEDS_MASS_RATIO")
    if not 0 < e <= cap:
        raise NoBounce("COR_OUT_OF_RANGE")
    return e


def normal_of(options, p, mass, m, speed_share, kind):
    """The normal direction of a ball of this mass and mass ratio m, whose core keeps this share of
    its speed.
    """
    riding = mass if options["normal"] == "total" else m * mass
    omega = kind.sqrt(p["k_y"] / riding)
    zeta, t_force, t_contact = damping(speed_share, options["release"] == "zero_force", kind)
    return Normal(
        riding,
        p["k_y"],
        2 * zeta * omega * riding,
        omega,
        zeta,
        t_force / omega,
        t_contact / omega,
    )


def joint_of(options, p, inertia, m, normal, kind):
    """The joint of core and shell in a ball of this moment of inertia and mass ratio m. NoBounce is
    raised where either has no inertia, or where no damping matches the joint to the spring.
    """
    unit = kind.make(1)
    solid = unit * 2 / 5 * 97 * 97 / 10000 * m
    thin = unit * 2 / 3 * (1 - m)
    split = solid / (solid + thin) if options["inertia"] == "tied" else p["inertia_split"]
    core = split * inertia
    shell = (1 - split) * inertia
    if not (core > 0 and shell > 0):
        raise NoBounce("NO_INERTIA")
    k = p["k_theta"]
    compliance = 1 / core + 1 / shell
    if options["torsion"] == "matched":
        squared = 1 - (1 - normal.zeta * normal.zeta) * normal.omega * normal.omega / (
            k * compliance
        )
        if squared < 0:
            raise NoBounce("TORSION_TOO_SOFT")
        zeta = kind.sqrt(squared)
    else:
        zeta = p["zeta_theta"]
    return Joint(core, shell, k, 2 * zeta * kind.sqrt(k / compliance))


class Motion:
    """The equations of motion of each phase of a contact, and what ends a phase: weights of forces
    over the state, and rows of A.
    """

    def __init__(self, body, normal, joint, surface, kind):
        self.body = body
        self.normal = normal
        self.joint = joint
        self.surface = surface
        self.kind = kind
        unit = kind.make(1)
        zero = kind.make(0)
        mu, eps, in_slide = surface
        self.force = {Y: normal.k, V: normal.c}
        self.torque = {TWIST: joint.k, W1: joint.c, W2: -joint.c}
        self.slip = {X: unit, W2: -body.radius}
        self.gyration = joint.shell + body.mass * body.radius * body.radius
        self.full = self.at_rest_by(eps)
        self.bare = self.at_rest_by(zero)
        acting = eps if in_slide else zero
        self.rates = {
            SLIDE_FORWARD: self.rates_of(total((-mu, self.force)), acting),
            SLIDE_BACKWARD: self.rates_of(total((mu, self.force)), acting),
            GRIP: self.rates_of(self.full, eps),
            HOLD: self.rates_of(self.bare, zero),
            FREE: self.rates_of({}, zero),
        }

    def at_rest_by(self, lever):
        """The friction that keeps the contact point at rest."""
        share = self.body.mass * self.body.radius / self.gyration
        return total((share, self.torque), (-share * lever, self.force))

    def rates_of(self, friction, lever):
        """Rows of A in a phase with this friction and this offset."""
        unit = self.kind.make(1)
        mass, radius, inertia = self.body
        core = self.joint.core
        shell = self.joint.shell
        turned = total(
            (1 / shell, self.torque),
            (-radius / shell, friction),
            (-lever / shell, self.force),
        )
        return [
            {V: unit},
            total((-1 / self.normal.riding, self.force)),
            total((1 / mass, friction)),
            total((-1 / core, self.torque)),
            turned,
            {W1: unit, W2: -unit},
            {X: unit},
            {W1: core / inertia, W2: shell / inertia},
        ]

    def beginning(self, phase, z):
        """Whether a phase can begin at z, and what falls through zero where it ends."""
        mu, eps, in_slide = self.surface
        near = Piece(self.rates[phase], z, self.normal.t_contact, self.kind, FIRST)
        ends = []
        if phase in (GRIP, HOLD):
            friction = self.full if phase == GRIP else self.bare
            ends.append(total((mu, self.force), (-1, friction)))
            ends.append(total((mu, self.force), (1, friction)))
        elif mu > 0:
            side = 1 if phase == SLIDE_FORWARD else -1
            ends.append(total((side, self.slip)))
        if phase == HOLD:
            ends.append(total((near.sign(self.full), self.full), (-mu, self.force)))
        can = all(near.sign(end) > 0 for end in ends)
        if phase == HOLD and (in_slide or eps == 0):
            can = False
        return can, ends

    def at_rest(self, z):
        """The phase that begins at zero slip, and what ends it; an error if every phase
        contradicts itself.
        """
        for phase in (GRIP, HOLD, SLIDE_FORWARD, SLIDE_BACKWARD):
            can, ends = self.beginning(phase, z)
            if can:
                return phase, ends
        raise ArithmeticError("every phase contradicts itself")

    def first(self, z):
        """The phase in which the contact begins, and what ends it."""
        radius = self.body.radius
        apart = z[X] - radius * z[W2]
        size = abs(z[X]) + radius * abs(z[W2])
        if self.surface.mu > 0 and abs(apart) <= self.kind.rounding * size:
            return self.at_rest(z)
        phase = SLIDE_FORWARD if apart > 0 else SLIDE_BACKWARD
        return phase, self.beginning(phase, z)[1]

    def reach(self, phase):
        """The time of a piece in a phase: that in which its series converges."""
        normal = self.normal
        joint = self.joint
        decay = normal.zeta * normal.omega
        swinging = fastest(decay, normal.omega * normal.omega, self.kind.sqrt)
        turning = self.gyration if phase in (GRIP, HOLD) else joint.shell
        yields = 1 / joint.core + 1 / turning
        twisting = fastest(joint.c * yields / 2, joint.k * yields, self.kind.sqrt)
        return REACH / max(swinging, twisting)

    def walk(self, z, stop):
        """The phases from z at time zero to the time `stop`, each with its duration, and z there.
        NoBounce is raised where there are more than PHASES.
        """
        zero = self.kind.make(0)
        unit = self.kind.make(1)
        now = zero
        began = zero
        phases = []
        phase, ends = self.first(z)
        t_force = self.normal.t_force
        nearly = self.kind.rounding * self.normal.t_contact
        while len(phases) < PHASES:
            limit = stop if phase == FREE else min(stop, t_force)
            h = self.reach(phase)
            remaining = limit - now
            last = h >= remaining
            h = remaining if last else h
            piece = Piece(self.rates[phase], z, h, self.kind)
            # At the end of force itself slip and cone are touched by all: no event.
            falls = [x for x in map(piece.fall, ends) if x is not None]
            hits = [x for x in falls if x * h < remaining - nearly]
            x = min(hits, default=unit)
            z = piece.at(x)
            now = now + x * h
            if hits or last:
                phases.append((phase, now - began))
                began = now
            if hits:
                phase, ends = self.at_rest(z)
            elif last and limit < stop and self.normal.t_contact - t_force > nearly:
                phase = FREE
                ends = []
            elif last:
                return phases, z
        raise NoBounce("TOO_MANY_PHASES")


def solve(options, parameters, impact, *, ball=BALL, cor=None, until=None, kind=DOUBLE):
    """The bounce of an impact (v_x1, v_y1, omega_1), SI; `cor` in place of the law, only up to the
    time `until`.
    """
    with localcontext(prec=kind.digits):
        try:
            return _bounce({**DEFAULT, **options}, parameters, impact, ball, cor, until, kind)
        except NoBounce as why:
            return Answer(why.status)


def _bounce(options, parameters, impact, ball, cor, until, kind):
    p = {name: kind.make(number) for name, number in parameters.items()}
    v_x, v_y, omega = map(kind.make, impact)
    mass, radius, ratio = map(kind.make, ball)
    body = Body(mass, radius, ratio * mass * radius * radius)
    zero = kind.make(0)
    m = p.get("mass_ratio", kind.make(1))
    momentum = options["normal"] == "momentum"
    cap = m if momentum else kind.make(1)
    e = restitution(p, cor, cap, v_y, kind, options["cor"])
    normal = normal_of(options, p, mass, m, e / cap, kind)
    joint = joint_of(options, p, body.inertia, m, normal, kind)
    eps = p["eps_10"] + p["eps_slope"] * (v_y - 10)
    surface = Surface(p["mu"], eps, options["offset"] == "contact")
    stopped = (1 - m) * mass * v_y if momentum else zero
    v_x, omega_2 = landed(v_x, omega, stopped, mass, radius, joint.shell, *surface)

    motion = Motion(body, normal, joint, surface, kind)
    t_contact = normal.t_contact
    stop = t_contact if until is None else min(kind.make(until), t_contact)
    start = [zero, v_y, v_x, omega, omega_2, zero, zero, zero]
    phases, z = motion.walk(start, stop)
    spin = z[W2]
    if options["spin"] != "shell":
        spin = (joint.core * z[W1] + joint.shell * z[W2]) / body.inertia
    v_y2 = -z[V] * (m if momentum else 1)
    late = z[Y] / v_y2
    gaps = (t_contact + late, z[PATH] + z[X] * late, z[TURN] + spin * late)
    return Answer("OK", z[X], v_y2, spin, t_contact, *gaps, tuple(phases), tuple(z))
