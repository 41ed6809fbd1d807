"""The functions of a port around its kernel, in the kernels' own restricted Python: a bounce in the
plane and in three dimensions with an answer for every impact, and what some languages lack.

They are never run here: `source` collects them like kernels. `SOLVED` is then the answer that
FRONTS has for the solver of the model, and `FLAGS` and `GRIP_ONLY` are those of the port. Names and
docstrings of functions stand in the files that users see.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from fitball.base.values import FloatArray
from fitball.exports.ports.ranges import RANGES, beyond
from fitball.models.grip_slip import GripSlip, struck
from fitball.models.kernels.contact import (
    ANCHOR_SPEED,
    NO_IMPACT,
    OFFSET,
    OFFSET_CONTACT,
    OK,
    Flags,
    ball_of,
    law_of,
    restitution,
)
from fitball.models.kernels.phases import FREE, GRIP, Outcome, unsolved
from fitball.models.kernels.phases import rebound as followed
from fitball.models.model import KernelSolver
from fitball.models.travel import FULL_OFFSET, offset_share
from fitball.models.two_mass import TwoMass
from fitball.models.types import PHASE_BITS

# Status of an impact with numbers that are not finite, which no kernel has.
NOT_FINITE = -1
# A contact that is free at once after its first phase, packed.
FREED = FREE << PHASE_BITS
# Slip below this share of its two terms has no direction but that of their rounding.
NO_SLIP = 1e-12


class Parameters(NamedTuple):
    """The parameters that functions here read. A port's own set has all columns of its model."""

    mu: float
    e_x: float
    offset: float
    cor_10: float
    cor_slope: float
    ball_mass: float
    ball_radius: float
    inertia_ratio: float
    v_y1_low: float
    v_y1_high: float
    measured: float


# Values that each port has in place of these, as of SOLVED below. First the choices of its model.
FLAGS: Flags = (0, 0, 0, 0, 0, 0, 0)
# Whether the offset acts in a grip alone: 1, else 0.
GRIP_ONLY = 0


class Rebound(NamedTuple):
    """Velocity [m/s], spin [rad/s]; contact time [s]; time [s], path [m] and turn [rad] between the
    flights; packed regime; status; extrapolated.
    """

    v_x2: float
    v_y2: float
    omega_2: float
    contact_time: float
    gap_time: float
    gap_path: float
    gap_turn: float
    regime: int
    status: int
    extrapolated: bool


class Vector(NamedTuple):
    """A vector in three dimensions."""

    x: float
    y: float
    z: float


class Rebound3(NamedTuple):
    """Velocity and spin in three dimensions, path and turn between the flights; the rest as in the
    plane of the slip.
    """

    velocity: Vector
    spin: Vector
    contact_time: float
    gap_time: float
    gap_path: Vector
    gap_turn: Vector
    regime: int
    status: int
    extrapolated: bool


def possible(cor: float) -> float:
    """The coefficient of restitution that is nearest to the law's: a power law has more than 1 for
    slow balls, a line less than 0 for fast ones. The status says so.
    """
    return min(max(cor, 0.0), 1.0)


def two_mass(row: FloatArray, share: float, v_x: float, v_y: float, omega: float) -> Outcome:
    """The two-mass ball, its offset times `share`; where it has no answer a rigid ball of the same
    restitution, friction and offset that slides or rolls, with the status of the former.
    """
    status, ball = ball_of(row, FLAGS)
    ball = ball._replace(eps_10=share * ball.eps_10, eps_slope=share * ball.eps_slope)
    found = unsolved(status, 0)
    if status == OK:
        found = followed(ball, FLAGS, v_x, v_y, omega, math.nan)
    if found.status == OK:
        return found
    _, cor, _ = restitution(ball.law, v_y, math.nan)
    cor = possible(cor)
    a = ball.inertia / (ball.mass * ball.radius * ball.radius)
    offset = ball.eps_10 + ball.eps_slope * (v_y - ANCHOR_SPEED)
    rigid = struck(ball.mu, 0.0, offset, cor, ball.mass, ball.radius, a, v_x, v_y, omega)
    return rigid._replace(status=found.status)


def grip_slip(row: Parameters, share: float, v_x: float, v_y: float, omega: float) -> Outcome:
    """The rigid ball, its offset times `share`; it has an answer wherever the law of restitution
    has a number.
    """
    status, law = law_of(row.cor_10, row.cor_slope, 1.0, FLAGS)
    bad, cor, _ = restitution(law, v_y, math.nan)
    cor = possible(cor)
    mass = row.ball_mass
    radius = row.ball_radius
    a = row.inertia_ratio
    found = struck(row.mu, row.e_x, share * row.offset, cor, mass, radius, a, v_x, v_y, omega)
    return found._replace(status=bad if status == OK else status)


class Front(NamedTuple):
    """What a port needs for the models of one solver.

    `answer`, called as `two_mass`, has a rebound for every impact with finite numbers. `grip_only`
    says by the choices of a model whether its offset acts in a grip alone.
    """

    answer: Callable[..., Outcome]
    grip_only: Callable[[Flags], bool]


def _never(_flags: Flags) -> bool:
    return False


def _offset_in_grip(flags: Flags) -> bool:
    return flags[OFFSET] != OFFSET_CONTACT


# The front of each solver. A model whose solver has none is exported as numbers, never as source
# code.
FRONTS: Mapping[type[KernelSolver], Front] = {
    TwoMass: Front(two_mass, _offset_in_grip),
    GripSlip: Front(grip_slip, _never),
}
SOLVED: Callable[..., Outcome] = two_mass


def either_way(row: Parameters, share: float, v_x: float, v_y: float, omega: float) -> Outcome:
    """The bounce of a ball that flies either way: with `v_x < 0` the mirror image, its offset ahead
    too. Of a ball that falls straight down the spin is positive.
    """
    if not (v_x < 0.0 or (v_x == 0.0 and omega < 0.0)):
        return SOLVED(row, share, v_x, v_y, omega)
    found = SOLVED(row, share, -v_x, v_y, -omega)
    return found._replace(
        v_x2=-found.v_x2,
        omega_2=-found.omega_2,
        gap_path=-found.gap_path,
        gap_turn=-found.gap_turn,
    )


def rebound(v_x1: float, v_y1: float, omega_1: float, parameters: Parameters) -> Rebound:
    """The rebound of any impact with finite numbers in the plane of the bounce."""
    return answered(v_x1, v_y1, omega_1, share_at(abs(v_x1), v_y1), parameters)


def share_at(travel: float, v_y: float) -> float:
    """The share of the offset that acts on a ball of the speed `travel` along the surface."""
    full = FULL_OFFSET * v_y
    return offset_share(travel / full) if travel < full else 1.0


def answered(v_x1: float, v_y1: float, omega_1: float, share: float, row: Parameters) -> Rebound:
    """The same with the offset times `share`."""
    none = math.nan
    # A parameter that is left out would else decide comparisons without being seen.
    size = abs(v_x1) + abs(v_y1) + abs(omega_1) + abs(sum(row))
    if size < math.inf and v_y1 <= 0.0:
        status = leaving(v_y1) if v_y1 < 0.0 else NO_IMPACT
        return Rebound(v_x1, -v_y1, omega_1, 0.0, 0.0, 0.0, 0.0, 0, status, False)
    if size < math.inf:
        found = either_way(row, share, v_x1, v_y1, omega_1)
        size = abs(found.v_x2) + abs(found.v_y2) + abs(found.omega_2)
        if size < math.inf:
            return Rebound(
                found.v_x2,
                found.v_y2,
                found.omega_2,
                found.contact_time,
                found.gap_time,
                found.gap_path,
                found.gap_turn,
                found.regime,
                found.status,
                is_extrapolated(row, v_x1, v_y1, omega_1),
            )
    return Rebound(none, none, none, none, none, none, none, 0, NOT_FINITE, True)


def leaving(v_y: float) -> int:
    """The status of a ball that moves away from the surface at `-v_y`. Ports write their own, which
    says so where a developer reads it, once.
    """
    return NO_IMPACT if v_y < 0.0 else OK


def is_extrapolated(row: Parameters, v_x: float, v_y: float, omega: float) -> bool:
    """Whether an impact lies outside of what was measured, as `fitball predict` says of it."""
    if not row.v_y1_low <= v_y <= row.v_y1_high:
        return True
    return row.measured >= 0.0 and beyond(RANGES[int(row.measured)], v_x, v_y, omega)


def plus(a: Vector, share: float, b: Vector) -> Vector:
    """`a + share b`."""
    return Vector(a.x + share * b.x, a.y + share * b.y, a.z + share * b.z)


def dot(a: Vector, b: Vector) -> float:
    """The scalar product."""
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return Vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


def along(a: Vector, otherwise: Vector) -> Vector:
    """The unit vector along `a`, or `otherwise` if it has no length."""
    size = math.sqrt(dot(a, a))
    return Vector(a.x / size, a.y / size, a.z / size) if size > 0.0 else otherwise


def rebound_3d(velocity: Vector, spin: Vector, normal: Vector, parameters: Parameters) -> Rebound3:
    """The rebound of any impact in three dimensions, velocities relative to the surface, `normal`
    away from it.
    """
    up = along(normal, Vector(math.nan, math.nan, math.nan))
    v_y = -dot(velocity, up)
    # Velocity and spin as vectors in the surface, spin about the normal.
    v_t = plus(velocity, v_y, up)
    w = cross(spin, up)
    about = dot(spin, up)
    size = math.sqrt(dot(v_t, v_t))
    # The share of the offset that acts, over the speed along the surface: of a part of this speed
    # the same share acts along it.
    acting = share_at(size, v_y) / size if size > 0.0 else 0.0
    slip = plus(v_t, -parameters.ball_radius, w)
    slow = NO_SLIP * (size + parameters.ball_radius * math.sqrt(dot(w, w)))
    # All that moves along the surface lies along the slip; without slip along the travel, without
    # both anywhere.
    side = Vector(1.0, 0.0, 0.0) if abs(up.x) < 0.8 else Vector(0.0, 1.0, 0.0)
    first = along(slip, side) if dot(slip, slip) > slow * slow else along(v_t, side)
    second = along(cross(up, first), side)
    first = cross(second, up)
    v_s = dot(v_t, first)
    v_c = dot(v_t, second)
    omega_c = dot(w, second)
    one = answered(v_s, v_y, dot(w, first), acting * abs(v_s), parameters)
    path = 0.0
    turned = 0.0
    if v_y > 0.0:
        v_c, omega_c, path, turned = across(
            one,
            v_s,
            dot(slip, first),
            v_c,
            v_y,
            omega_c,
            acting * abs(v_c),
            parameters,
        )
    none = Vector(0.0, 0.0, 0.0)
    v_t = plus(plus(plus(none, one.v_x2, first), v_c, second), one.v_y2, up)
    w = plus(plus(none, one.omega_2, first), omega_c, second)
    turn = plus(plus(none, one.gap_turn, first), turned, second)
    return Rebound3(
        v_t,
        plus(cross(up, w), about, up),
        one.contact_time,
        one.gap_time,
        plus(plus(none, one.gap_path, first), path, second),
        plus(cross(up, turn), about * one.gap_time, up),
        one.regime,
        one.status,
        one.extrapolated,
    )


def across(
    one: Rebound,
    v_s: float,
    slip: float,
    v: float,
    v_y: float,
    omega: float,
    share: float,
    parameters: Parameters,
) -> tuple[float, float, float, float]:
    """Velocity and spin across the slip, `v` and `omega`, after the bounce `one` along it, where
    velocity and slip were `v_s` and `slip`, and path and turn between the flights. Only the offset,
    of which a `share` lies across, changes them.

    A slip that dies out does so in all directions, by an impulse across that is that of a grip from
    landing on. One that lasts turns: of a rigid ball with `u' = -A mu u/|u| + b` it ends with `b/(A
    mu) |u| ln(|slip|/|u|)` across.
    """
    mass = parameters.ball_mass
    radius = parameters.ball_radius
    inertia = parameters.inertia_ratio * mass * radius * radius
    compliance = 1.0 / mass + radius * radius / inertia
    braked = mass * abs(v_s - one.v_x2)
    slides = one.regime < GRIP or FREED < one.regime < FREED + GRIP
    if GRIP_ONLY == 1:
        # What is left of the normal impulse once friction has used up the slip of a rigid ball.
        most = compliance * parameters.mu * mass * (v_y + one.v_y2)
        share = 0.0 if slides or abs(slip) >= most else share * (1.0 - abs(slip) / most)
    other = answered(v, v_y, omega, share, parameters)
    left = abs(one.v_x2 - radius * one.omega_2)
    if not (slides and left > 0.0 and braked > 0.0):
        return other.v_x2, other.omega_2, other.gap_path, other.gap_turn
    # By the balance of angular momentum the offset across times the normal impulse; `braked` is
    # `mu` times that.
    turned = mass * radius * (v - other.v_x2) + inertia * (omega - other.omega_2)
    kept = radius * turned / (inertia * compliance * braked) * left * math.log(abs(slip) / left)
    more = (kept - (other.v_x2 - radius * other.omega_2)) / compliance
    faster = more / mass
    slower = radius * more / inertia
    # What it changes comes evenly over the contact.
    half = 0.5 * one.gap_time
    path = other.gap_path + half * faster
    return other.v_x2 + faster, other.omega_2 - slower, path, other.gap_turn - half * slower


def least(a: float, b: float) -> float:
    """The lesser: of equal numbers, and of NaN and a number, the first, as in Python."""
    return b if b < a else a


def greatest(a: float, b: float) -> float:
    """The greater, likewise."""
    return b if b > a else a


def sixth(x: float) -> float:
    """The sixth power."""
    cube = x * x * x
    return cube * cube


def shifted(number: int, places: int) -> int:
    """A number shifted by binary places, for languages whose own shift has 32 of them."""
    for _ in range(places):
        number = 2 * number
    return number


def hypot(a: float, b: float) -> float:
    """The hypotenuse, for languages without one, or with one that is off in its last digits."""
    large = max(abs(a), abs(b))
    small = min(abs(a), abs(b))
    return large * math.sqrt(1.0 + (small / large) * (small / large)) if large > 0.0 else large


def log1p(x: float) -> float:
    """The logarithm of 1 + x, whose rounding is undone (Kahan)."""
    step = (1.0 + x) - 1.0
    return math.log(1.0 + x) * x / step if abs(step) > 0.0 else x


def copysign(size: float, of: float) -> float:
    """The size with the sign of a number that is not zero."""
    return -abs(size) if of < 0.0 else abs(size)
