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
from collections.abc import Callable
from decimal import Decimal, localcontext
from functools import lru_cache
from typing import Any, NamedTuple

SLIDE_FORWARD = 1
SLIDE_BACKWARD = 2
GRIP = 3
HOLD = 4
FREE = 5
Y, V, X, W1, W2, TWIST, PATH, TURN = range(8)
# Fastest pole times the length of a piece; terms that decide what comes next; most phases of a
# contact.
REACH = 2
FIRST = 5
PHASES = 4000
DEFAULT = {
    "normal": "momentum",
    "offset": "contact",
    "torsion": "matched",
    "inertia": "tied",
    "spin": "mean",
    "release": "zero_force",
}
BALL = (0.0576, 0.03302, 0.56)
OUTPUTS = ("v_x2", "v_y2", "omega_2", "contact_time", "gap_time", "gap_path", "gap_turn")


class Numbers(NamedTuple):
    """A kind of number: how one is made, roots, logarithms, and how many `digits` it has."""

    make: Callable[[Any], Any]
    sqrt: Callable[[Any], Any]
    log: Callable[[Any], Any]
    digits: int

    @property
    def rounding(self):
        """Relative size below which a sum of a few terms is zero."""
        return self.make(10) ** (3 - self.digits)

    @property
    def terms(self):
        """Terms after which a series of reach REACH has converged."""
        small = 10 ** (-self.digits - 2)
        return next(n for n in range(999) if REACH**n < math.factorial(n) * small)


DOUBLE = Numbers(float, math.sqrt, math.log, 16)
# Fifty digits of each answer are good.
FIFTY = Numbers(Decimal, Decimal.sqrt, Decimal.ln, 60)


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


def value(c, x):
    """A polynomial and its slope."""
    f = 0 * x
    d = 0 * x
    for coefficient in reversed(c):
        d = d * x + f
        f = f * x + coefficient
    return f, d


def first_fall(c, zero, least):
    """First x in (0, 1] where a polynomial that is positive at first falls to zero, else None:
    intervals are proved free of zeros, or monotonic, by a bound of the second derivative, or
    halved.
    """
    bend = sum(k * (k - 1) * abs(coefficient) for k, coefficient in enumerate(c))
    parts = [(zero, zero + 1)]
    while parts:
        low, high = parts.pop()
        middle = (low + high) / 2
        half = (high - low) / 2
        f, d = value(c, middle)
        free_of_zeros = abs(f) > abs(d) * half + bend * half * half / 2
        monotonic = abs(d) > bend * half
        if free_of_zeros:
            if f < 0:
                return low
        elif monotonic or half < least:
            if d < 0 and value(c, high)[0] <= 0:
                return falling(c, low, high, least)
            if value(c, low)[0] < 0:
                return low
        else:
            parts += [(middle, high), (low, middle)]
    return None


def falling(c, low, high, least):
    """The zero of a falling polynomial between two points, by Newton's steps that stay between
    them.
    """
    x = (low + high) / 2
    old = high
    for _ in range(400):
        if abs(x - old) <= least / 1000:
            break
        f, d = value(c, x)
        if f > 0:
            low = x
        else:
            high = x
        old = x
        x = (low + high) / 2
        if d < 0:
            x = min(max(old - f / d, low), high)
    return x


def total(*parts):
    """A sum of multiples of weights, `(factor, weights)`; weights are mappings from places in the
    state.
    """
    places = sorted({place for _, weights in parts for place in weights})
    sums = {}
    for place in places:
        sums[place] = sum(factor * weights.get(place, 0) for factor, weights in parts)
    return sums


def weighted(weights, state):
    """The weighted sum over a state."""
    return sum([weight * state[place] for place, weight in weights.items()])


def sizes_of(weights):
    return {place: abs(weight) for place, weight in weights.items()}


def series(rates, z, h, count):
    """Terms in t/h of the motion z' = A z that begins at z; `rates` are the rows of A."""
    terms = [z]
    for k in range(1, count):
        share = h / k
        last = terms[-1]
        terms.append([share * weighted(row, last) for row in rates])
    return terms


class Piece:
    """A piece of a motion: its terms, and the size of what is added up in the first of them."""

    def __init__(self, rates, z, h, kind, count=0):
        self.terms = series(rates, z, h, count or kind.terms)
        self.kind = kind
        self.zero = 0 * z[0]
        sizes = [sizes_of(row) for row in rates]
        self.sizes = series(sizes, [abs(number) for number in z], h, FIRST)

    def leading(self, weights):
        """A weighted sum of the state as terms, and the place of the first that is not rounding
        (None: all are).
        """
        c = [weighted(weights, z) for z in self.terms]
        noise = self.kind.rounding
        absolute = sizes_of(weights)
        for k, z in enumerate(self.sizes):
            if abs(c[k]) > noise * weighted(absolute, z):
                return c, k
        return c, None

    def sign(self, weights):
        """Whether a weighted sum is positive just after the start (1), negative (-1) or neither
        (0).
        """
        c, k = self.leading(weights)
        if k is None:
            return 0
        return 1 if c[k] > 0 else -1

    def fall(self, weights):
        """When a weighted sum falls to zero: None if not here, 0 if it is falling from there."""
        c, k = self.leading(weights)
        if k is None:
            return None
        if c[k] < 0:
            return self.zero
        return first_fall(c[k:], self.zero, self.kind.rounding)

    def at(self, x):
        """The state at x."""
        return [value(column, x)[0] for column in zip(*self.terms, strict=True)]


def fastest(decay, natural_squared, sqrt):
    """The larger pole of x'' + 2 decay x' + natural_squared x = 0."""
    rest = decay * decay - natural_squared
    return decay + sqrt(rest) if rest > 0 else sqrt(natural_squared)


def law(cor_10, slope, cap, v, log):
    """The one law of restitution, of this value and slope at 10 m/s; None where the rebound would
    fall with speed.
    """
    e = cor_10 / cap
    w = -10 * slope / cor_10
    if w >= 1:
        return None
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
def damping(kept, by_force, kind):
    """`zeta` with which a swing keeps this share of its speed, by Ridders' method, and the times of
    `swing`.
    """

    def excess(zeta):
        return swing(zeta, by_force, kind)[2] - kept

    low = 0 * kept
    above = 1 - kept
    high = 0 * kept + 1 / kind.make(2)
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

    def pushed(v_x, omega_2, friction, lever, part):
        v_x = v_x + friction * part / mass
        omega_2 = omega_2 - (radius * friction + lever) * part / shell
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


def solve(options, parameters, impact, *, ball=BALL, cor=None, until=None, kind=DOUBLE):
    """The bounce of an impact (v_x1, v_y1, omega_1), SI; `cor` in place of the law, only up to the
    time `until`.
    """
    with localcontext(prec=kind.digits):
        return _bounce({**DEFAULT, **options}, parameters, impact, ball, cor, until, kind)


def _bounce(options, parameters, impact, ball, cor, until, kind):
    p = {name: kind.make(number) for name, number in parameters.items()}
    v_x, v_y, omega = map(kind.make, impact)
    mass, radius, ratio = map(kind.make, ball)
    inertia = ratio * mass * radius * radius
    one = kind.make(1)
    zero = kind.make(0)
    m = p.get("mass_ratio", one)
    mu = p["mu"]
    momentum = options["normal"] == "momentum"
    cap = m if momentum else one
    e = None if cor is None else kind.make(cor)
    if cor is None:
        e = law(p["cor_10"], p["cor_slope"], cap, v_y, kind.log)
    if e is None:
        return Answer("REBOUND_FALLS")
    if cap < e <= 1:
        return Answer("COR_EXCEEDS_MASS_RATIO")
    if not 0 < e <= cap:
        return Answer("COR_OUT_OF_RANGE")
    riding = mass if options["normal"] == "total" else m * mass
    k_y = p["k_y"]
    omega_y = kind.sqrt(p["k_y"] / riding)
    zeta, t_force, t_contact = damping(e / cap, options["release"] == "zero_force", kind)
    c_y = 2 * zeta * omega_y * riding
    t_force = t_force / omega_y
    t_contact = t_contact / omega_y

    solid = one * 2 / 5 * 97 * 97 / 10000 * m
    thin = one * 2 / 3 * (1 - m)
    split = solid / (solid + thin) if options["inertia"] == "tied" else p["inertia_split"]
    core = split * inertia
    shell = (1 - split) * inertia
    if not (core > 0 and shell > 0):
        return Answer("NO_INERTIA")
    k = p["k_theta"]
    compliance = 1 / core + 1 / shell
    squared = 1 - (1 - zeta * zeta) * omega_y * omega_y / (k * compliance)
    if options["torsion"] == "matched" and squared < 0:
        return Answer("TORSION_TOO_SOFT")
    matched = options["torsion"] == "matched"
    zeta_theta = kind.sqrt(squared) if matched else p["zeta_theta"]
    c = 2 * zeta_theta * kind.sqrt(k / compliance)

    eps = p["eps_10"] + p["eps_slope"] * (v_y - 10)
    in_slide = options["offset"] == "contact"
    stopped = (1 - m) * mass * v_y if momentum else zero
    v_x, omega_2 = landed(v_x, omega, stopped, mass, radius, shell, mu, eps, in_slide)

    # Weights of forces over the state, and the equations of motion of each phase: friction, and
    # offset.
    force = {Y: k_y, V: c_y}
    torque = {TWIST: k, W1: c, W2: -c}
    slip = {X: one, W2: -radius}
    gyration = shell + mass * radius * radius
    acting = eps if in_slide else zero

    def at_rest_by(lever):
        """The friction that keeps the contact point at rest."""
        share = mass * radius / gyration
        return total((share, torque), (-share * lever, force))

    def rates_of(friction, lever):
        """Rows of A in a phase with this friction and this offset."""
        return [
            {V: one},
            total((-1 / riding, force)),
            total((1 / mass, friction)),
            total((-1 / core, torque)),
            total((1 / shell, torque), (-radius / shell, friction), (-lever / shell, force)),
            {W1: one, W2: -one},
            {X: one},
            {W1: core / inertia, W2: shell / inertia},
        ]

    full = at_rest_by(eps)
    bare = at_rest_by(zero)
    rates = {
        SLIDE_FORWARD: rates_of(total((-mu, force)), acting),
        SLIDE_BACKWARD: rates_of(total((mu, force)), acting),
        GRIP: rates_of(full, eps),
        HOLD: rates_of(bare, zero),
        FREE: rates_of({}, zero),
    }

    def beginning(phase, z):
        """Whether a phase can begin at z, and what falls through zero where it ends."""
        near = Piece(rates[phase], z, t_contact, kind, FIRST)
        ends = []
        if phase in (GRIP, HOLD):
            friction = full if phase == GRIP else bare
            ends.append(total((mu, force), (-1, friction)))
            ends.append(total((mu, force), (1, friction)))
        elif mu > 0:
            side = 1 if phase == SLIDE_FORWARD else -1
            ends.append(total((side, slip)))
        if phase == HOLD:
            ends.append(total((near.sign(full), full), (-mu, force)))
        can = all(near.sign(end) > 0 for end in ends)
        if phase == HOLD and (in_slide or eps == 0):
            can = False
        return can, ends

    def at_rest(z):
        """The phase that begins at zero slip, and what ends it; an error if every phase
        contradicts itself.
        """
        for phase in (GRIP, HOLD, SLIDE_FORWARD, SLIDE_BACKWARD):
            can, ends = beginning(phase, z)
            if can:
                return phase, ends
        raise ArithmeticError("every phase contradicts itself")

    z = [zero, v_y, v_x, omega, omega_2, zero, zero, zero]
    now = zero
    began = zero
    phases = []
    apart = v_x - radius * omega_2
    size = abs(v_x) + radius * abs(omega_2)
    if mu > 0 and abs(apart) <= kind.rounding * size:
        phase, ends = at_rest(z)
    else:
        phase = SLIDE_FORWARD if apart > 0 else SLIDE_BACKWARD
        _, ends = beginning(phase, z)
    stop = t_contact if until is None else min(kind.make(until), t_contact)
    nearly = kind.rounding * t_contact
    swinging = fastest(zeta * omega_y, omega_y * omega_y, kind.sqrt)
    while len(phases) < PHASES:
        limit = stop if phase == FREE else min(stop, t_force)
        turning = gyration if phase in (GRIP, HOLD) else shell
        yields = 1 / core + 1 / turning
        twisting = fastest(c * yields / 2, k * yields, kind.sqrt)
        h = REACH / max(swinging, twisting)
        left = limit - now
        last = h >= left
        h = left if last else h
        piece = Piece(rates[phase], z, h, kind)
        # At the end of force itself slip and cone are touched by all: no event.
        hits = [x for x in map(piece.fall, ends) if x is not None and x * h < left - nearly]
        x = min(hits, default=one)
        z = piece.at(x)
        now = now + x * h
        if hits or last:
            phases.append((phase, now - began))
            began = now
        if hits:
            phase, ends = at_rest(z)
        elif last and limit < stop and t_contact - t_force > nearly:
            phase = FREE
            ends = []
        elif last:
            break
    else:
        return Answer("TOO_MANY_PHASES")
    spin = z[W2]
    if options["spin"] != "shell":
        spin = (core * z[W1] + shell * z[W2]) / inertia
    v_y2 = -z[V] * (m if momentum else 1)
    late = z[Y] / v_y2
    gaps = (t_contact + late, z[PATH] + z[X] * late, z[TURN] + spin * late)
    return Answer("OK", z[X], v_y2, spin, t_contact, *gaps, tuple(phases), tuple(z))
