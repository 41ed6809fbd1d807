"""What an impact means to the oracle: closures and parameters turned into dimensionless numbers.

Units inside: the core's undamped vertical frequency sets the time, the approach speed the velocities,
the ball's mass and radius the rest. Everything is written for any kind of number, so that the same
lines serve double precision and fifty digits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from fitball.errors import ParameterError
from fitball.models.oracle.arithmetic import Arithmetic, Number
from fitball.models.types import Closures, Status
from fitball.values import Ball, Impacts

NEWTON_STEPS = 400
# A COR and a mass_ratio meant to be equal differ by the rounding of the line COR(v) at most.
RATIO_ROUNDING = 1e-14


@dataclass(frozen=True)
class Problem:
    """One impact in dimensionless numbers.

    `zeta` vertical damping ratio; `riding` the mass on the spring over M; `core` and `shell` inertias and
    `stiffness` and `damping` of the torsion over M R^2 (with a `rigid` torsion the shell is the whole
    ball); `eps` over R; `landing` impulse over M v_y1; `travel` v_x1 and `spin` R omega_1 over v_y1;
    `loaded` and `contact` the times at which the ground force and the contact end, apart by a free flight
    if `released_free`; `frequency` [rad/s] the unit of inverse time; `cor` that of the whole ball.
    """

    zeta: Number
    riding: Number
    core: Number
    shell: Number
    stiffness: Number
    damping: Number
    rigid: bool
    mu: Number
    eps: Number
    eps_while_sliding: bool
    landing: Number
    travel: Number
    spin: Number
    loaded: Number
    contact: Number
    released_free: bool
    frequency: Number
    cor: Number


def arrange(
    kind: Arithmetic,
    closures: Closures,
    ball: Ball,
    parameters: Mapping[str, float],
    impacts: Impacts,
    index: int,
) -> Problem | Status:
    """The dimensionless problem of impact `index`, or the status that says why there is none.

    Raises ParameterError when a parameter the closures need is missing or splits the ball into
    nothing, or when `cor = "measured"` finds no measured coefficient of restitution.
    """

    def read(name: str) -> Number:
        if name not in parameters:
            raise ParameterError(f"parameter {name} is missing: these closures need it; given: {sorted(parameters)}")
        return kind.number(float(parameters[name]))

    speed = kind.number(float(impacts.v_y1[index]))
    above_ten = speed - 10
    if closures.cor == "saturating" and 10 * read("cor_slope") <= -read("cor_10"):
        return Status.REBOUND_FALLS
    cor = _coefficient_of_restitution(kind, closures, read, impacts, index, above_ten)
    if not 0 < cor <= 1:
        return Status.COR_OUT_OF_RANGE
    core_return = cor
    riding = kind.number(1.0)
    landing = kind.number(0.0)
    if closures.normal != "total":
        riding = read("mass_ratio")
    if closures.normal == "momentum":
        core_return = cor / riding
        landing = 1 - riding
        if core_return > 1 + RATIO_ROUNDING:
            return Status.COR_EXCEEDS_MASS_RATIO
        core_return = min(core_return, kind.number(1.0))
    zeta, loaded, contact = release(kind, closures, core_return)

    mass, radius = kind.number(ball.mass), kind.number(ball.radius)
    inertia = kind.number(ball.inertia) / (mass * radius * radius)
    frequency = kind.sqrt(read("k_y") / (riding * mass))
    core, shell, stiffness, damping = kind.number(0.0), inertia, kind.number(0.0), kind.number(0.0)
    if closures.torsion != "rigid":
        core, shell = (inertia * share for share in _shares_of_inertia(kind, closures, read))
        if not (core > 0 and shell > 0):
            raise ParameterError(
                "core or shell is left without inertia: mass_ratio or inertia_split must lie in (0, 1)"
            )
        stiffness = read("k_theta") / (mass * radius * radius * frequency * frequency)
        compliance = 1 / core + 1 / shell
        natural_squared = stiffness * compliance
        if closures.torsion == "free":
            zeta_theta = read("zeta_theta")
        else:
            remainder = 1 - (1 - zeta * zeta) / natural_squared
            if remainder < 0:
                return Status.TORSION_TOO_SOFT
            zeta_theta = kind.sqrt(remainder)
        damping = 2 * zeta_theta * kind.sqrt(natural_squared) / compliance
    return Problem(
        zeta=zeta,
        riding=riding,
        core=core,
        shell=shell,
        stiffness=stiffness,
        damping=damping,
        rigid=closures.torsion == "rigid",
        mu=read("mu"),
        eps=(read("eps_10") + read("eps_slope") * above_ten) / radius,
        eps_while_sliding=closures.offset == "contact",
        landing=landing,
        travel=kind.number(float(impacts.v_x1[index])) / speed,
        spin=kind.number(float(impacts.omega_1[index])) * radius / speed,
        loaded=loaded,
        contact=contact,
        released_free=contact - loaded > 8 * kind.unit_roundoff * contact,
        frequency=frequency,
        cor=cor,
    )


def release(kind: Arithmetic, closures: Closures, core_return: Number) -> tuple[Number, Number, Number]:
    """Damping ratio, end of the ground force and end of contact for the core's own restitution.

    The ground force returns to zero at `2 h(zeta)`, `h(z) = acos(z)/sqrt(1 - z^2)`, which as the
    hypergeometric function 2F1(1, 1; 3/2; (1-z)/2) runs smoothly through critical damping.
    """
    loss = -kind.log(core_return)
    if closures.release == "zero_displacement":
        zeta = loss / kind.sqrt(kind.pi**2 + loss * loss)
        contact = kind.pi / kind.sqrt((1 - zeta) * (1 + zeta))
        return zeta, 2 * _angle_over_sine(kind, zeta), contact
    zeta = _damping_for_loss(kind, loss)
    loaded = 2 * _angle_over_sine(kind, zeta)
    return zeta, loaded, loaded


def _damping_for_loss(kind: Arithmetic, loss: Number) -> Number:
    """Root of `2 z h(z) = loss`; concave and rising, so Newton from 0 climbs to it without a bracket."""
    zeta = kind.number(0.0)
    for _ in range(NEWTON_STEPS):
        angle = _angle_over_sine(kind, zeta)
        slope = -kind.hyp2f1(2, 2, kind.number(2.5), (1 - zeta) / 2) / 3
        step = (loss - 2 * zeta * angle) / (2 * (angle + zeta * slope))
        zeta = zeta + step
        if abs(step) <= 8 * kind.unit_roundoff * zeta:
            return zeta
    raise ParameterError(f"no damping ratio returns the core with exp(-{loss}) of its speed")


def _angle_over_sine(kind: Arithmetic, zeta: Number) -> Number:
    return kind.hyp2f1(1, 1, kind.number(1.5), (1 - zeta) / 2)


def _coefficient_of_restitution(
    kind: Arithmetic,
    closures: Closures,
    read: Callable[[str], Number],
    impacts: Impacts,
    index: int,
    above_ten: Number,
) -> Number:
    if closures.cor == "measured":
        if impacts.cor is None:
            raise ParameterError("cor = 'measured' needs each impact's own measured coefficient of restitution")
        return kind.number(float(impacts.cor[index]))
    if closures.cor == "mean":
        return read("cor_10")
    if closures.cor == "saturating":
        cap = read("mass_ratio") if closures.normal == "momentum" else kind.number(1.0)
        return cap * _saturating_share(kind, read("cor_10") / cap, read("cor_10"), read("cor_slope"), above_ten)
    return read("cor_10") + read("cor_slope") * above_ten


def _saturating_share(kind: Arithmetic, share: Number, cor: Number, slope: Number, above_ten: Number) -> Number:
    """COR over its cap, from its value and slope at 10 m/s: by powers of what it is there, or,
    where it rises, by its odds.
    """
    speed = (above_ten + 10) / 10
    fall = -10 * slope / cor
    if fall <= 0:
        odds = share / (1 - share) * speed ** (-fall / (1 - share))
        return odds / (1 + odds)
    if share >= 1:
        return share
    # 1/(1 - fall) = 1 + fall/(1 - fall) at 10 m/s, and the share is a power of what that is at another speed.
    power = kind.log1p(-fall) / kind.log(share)
    return share ** (kind.log1p(fall / (1 - fall) * speed**power) / -kind.log1p(-fall))


def _shares_of_inertia(kind: Arithmetic, closures: Closures, read: Callable[[str], Number]) -> tuple[Number, Number]:
    """I1/I and I2/I: given, or those of a solid core of radius 0.97 R inside a thin shell (Eqs 67 and 69)."""
    if closures.inertia == "table":
        return read("inertia_split"), 1 - read("inertia_split")
    mass_ratio = read("mass_ratio")
    solid = kind.number(2.0) / 5 * (kind.number(97.0) / 100) ** 2 * mass_ratio
    thin = kind.number(2.0) / 3 * (1 - mass_ratio)
    return solid / (solid + thin), thin / (solid + thin)
