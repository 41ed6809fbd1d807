"""Figs 8 to 28 of Jafri (2004) as data: what each varies, what the thesis states of its inputs, and what it claims.

The figures of Chapter III carry no inputs in their text: only the two examples behind Figs 25 to 28 are stated. What
had to be assumed stands beside each figure, with the reason.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fitball.inference.thesis.inputs import INCH

# Chapter III: 17 m/s with a topspin of 100 rad/s, at 18 and at 42 degrees; components as printed [m/s, m/s, rad/s].
SHALLOW = (16.13, 5.33, 100.0)
STEEP = (12.63, 11.37, 100.0)
BETWEEN = (15.0, 8.0, 100.0)
COR = 0.76


@dataclass(frozen=True)
class Curve:
    """One curve: its label, the impact `(v_x1, v_y1, omega_1)` [m/s, m/s, rad/s], what differs from the base set."""

    label: str
    impact: tuple[float, float, float]
    changed: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Claim:
    """What the thesis says of a curve, numbered from 0: `measure` names the quantity (see `example_claims`).

    `printed` is its number, or None for a statement in words that `holds` or not.
    """

    said: str
    measure: str
    curve: int = 0
    printed: float | None = None
    unit: str = ""


@dataclass(frozen=True)
class Example:
    """One figure: `panels` as in `figure_history`, inputs `stated` and `assumed` in words."""

    name: str
    title: str
    panels: tuple[str, ...]
    curves: tuple[Curve, ...]
    claims: tuple[Claim, ...]
    stated: str
    assumed: tuple[str, ...]


BASE = (
    "parameters: those of the examples of Chapter III (M1 = 2M/3, k_y = 80 lb/in, k_theta = 1000 lb in/rad, mu = "
    "0.55, COR = 0.76, I1 = 0.532 I, offset by Eq. 53), the only set that the chapter states"
)
SHALLOW_TOO = "impact: that of the first example (16.13, 5.33 m/s, 100 rad/s) but for what is varied"
STEEP_TOO = "impact: that of the second example (12.63, 11.37 m/s, 100 rad/s) but for what is varied"
NO_SLIP = (
    "rolling from the first instant is no solution of the thesis's equations: it sets the shell's spin by conserving "
    "energy (Eqs 20 and 21), where friction needs time to stop the slip. Here mu = 5, the largest that the model "
    "takes, so that the ball grips early; rolling begins where the curves show it"
)
NO_OFFSET = "offset: zero, which the text says of Fig. 17"
STATED_BASE = "M1 = 2M/3, k_y = 80 lb/in, k_theta = 1000 lb in/rad, I1 = 0.532 I, mu = 0.55, COR = 0.76"
DAMPING = (
    "c_y: from COR = 0.76 by Eq. (5). The printed c_y = 0.0113 lb s/in is another damping: it returns the core at "
    "(M1/M)/COR = 0.88 of its speed"
)
OFFSET = "offset: Eq. (53), which the text does not say of this figure"
GRIP = {"mu": 5.0, "eps_10": 0.0, "eps_slope": 0.0}
VARIED = "values of what is varied: round numbers; the figure's own are not stated"


def _vary(quantity: str, values: tuple[float, ...], unit: str, place: int, base: tuple[float, float, float],
          changed: Mapping[str, float] | None = None) -> tuple[Curve, ...]:  # fmt: skip
    """Curves along one component of the impact."""
    curves = []
    for value in values:
        impact = [*base]
        impact[place] = value
        curves.append(Curve(f"{quantity} {value:g} {unit}", (impact[0], impact[1], impact[2]), changed or {}))
    return tuple(curves)


def _frictions(values: tuple[float, ...], impact: tuple[float, float, float]) -> tuple[Curve, ...]:
    return tuple(Curve(f"mu {value:g}", impact, {"mu": value}) for value in values)


_SPEEDS = _vary("v_y1", (4.0, 8.0, 12.0), "m/s", 1, (20.0, 8.0, 0.0))
_SPINS = (
    Curve("zero spin", (16.13, 5.33, 0.0)),
    Curve("topspin 100 rad/s", (16.13, 5.33, 100.0)),
    Curve("backspin 100 rad/s", (16.13, 5.33, -100.0)),
)
_GRIP_SPINS = (
    Curve("zero spin", (12.63, 11.37, 0.0), GRIP),
    Curve("topspin 100 rad/s", (12.63, 11.37, 100.0), GRIP),
    Curve("backspin 100 rad/s", (12.63, 11.37, -100.0), GRIP),
)
_TOPSPINS = _vary("spin", (50.0, 100.0, 200.0), "rad/s", 2, STEEP, GRIP)
_LOW_FRICTION = (0.3, 0.4, 0.55)

EXAMPLES: tuple[Example, ...] = (
    Example(
        "fig8", "Vertical displacement, three incident vertical velocities", ("y",), _SPEEDS,
        (
            Claim("the greatest displacement rises with the incident velocity", "rising peak compression"),
            Claim("the curves are not symmetrical", "peak of compression before the middle"),
        ),
        "three incident vertical velocities, the rest fixed; no values", (BASE, VARIED),
    ),
    Example(
        "fig9", "Vertical velocity, three coefficients of restitution", ("v_y",),
        tuple(Curve(f"COR {value:g}", SHALLOW, {"cor_10": value}) for value in (0.6, 0.76, 0.9)),
        (Claim("the higher COR, the higher the rebound velocity", "rising rebound v_y2"),),
        "mass and stiffness the same, only the damping differs; no values", (BASE, SHALLOW_TOO, VARIED),
    ),
    Example(
        "fig10", "Horizontal velocity while sliding, three frictions", ("centre",),
        _frictions(_LOW_FRICTION, SHALLOW),
        (
            Claim("the horizontal velocity decreases", "falling v_x"),
            Claim("the higher the friction, the lower the rebound velocity", "falling rebound v_x2"),
        ),
        "three coefficients of sliding friction, one incident velocity; no values", (BASE, SHALLOW_TOO, VARIED),
    ),
    Example(
        "fig11", "Horizontal velocity while sliding, three incident velocities", ("centre",),
        _vary("v_x1", (14.0, 16.13, 20.0), "m/s", 0, SHALLOW),
        (
            Claim("friction slows the ball", "falling v_x"),
            Claim("friction takes the same from each (Eq. 73)", "equal loss of v_x"),
        ),
        "three incident horizontal velocities, one friction; no values", (BASE, SHALLOW_TOO, VARIED),
    ),
    Example(
        "fig12", "Horizontal velocity while sliding, high topspin", ("centre",),
        _frictions(_LOW_FRICTION, (10.0, 5.33, 800.0)),
        (
            Claim("the horizontal velocity increases", "rising v_x"),
            Claim("the higher the friction, the higher the rebound velocity", "rising rebound v_x2"),
        ),
        "topspin whose surface velocity exceeds the horizontal velocity, three frictions; no values",
        (BASE, "impact: 10 and 5.33 m/s with 800 rad/s, so that the surface is faster throughout", VARIED),
    ),
    Example(
        "fig13", "Spin while sliding: zero spin, topspin, backspin", ("omega_2",), _SPINS,
        (
            Claim("the spin increases in all three cases", "rising spin"),
            Claim("the backspin falls to zero and turns round", "backspin turns", curve=2),
        ),
        "zero spin, topspin and backspin; no values",
        (BASE, SHALLOW_TOO, "spins: 100 rad/s either way, the topspin of the examples"),
    ),
    Example(
        "fig14", "Spin while sliding, three frictions", ("omega_2",), _frictions(_LOW_FRICTION, SHALLOW),
        (Claim("the higher the friction, the more spin", "rising rebound omega_2"),),
        "topspin and three coefficients of sliding friction; no values", (BASE, SHALLOW_TOO, VARIED),
    ),
    Example(
        "fig15", "Normal force, three incident vertical velocities", ("normal_force",), _SPEEDS,
        (
            Claim("the force rises with the incident velocity", "rising peak force"),
            Claim("the maxima lie before n = 0.5", "peak of force before the middle"),
        ),
        "three incident vertical velocities, the rest fixed; no values",
        (BASE, VARIED, "the end: the ground cannot pull, so the force is zero where Eq. (75) turns tensile"),
    ),
    Example(
        "fig16", "Friction while sliding, three frictions", ("friction_force",), _frictions(_LOW_FRICTION, SHALLOW),
        (Claim("friction is the normal force times mu", "friction is mu F"),),
        "three coefficients of sliding friction; no values", (BASE, SHALLOW_TOO, VARIED),
    ),
    Example(
        "fig17", "Spin while rolling, three horizontal velocities, zero spin", ("omega_2",),
        _vary("v_x1", (8.0, 12.63, 16.0), "m/s", 0, (12.63, 11.37, 0.0), GRIP),
        (
            Claim("the higher the incident velocity, the higher the spin", "rising rebound omega_2"),
            Claim("shell spin when rolling begins", "rolling start", curve=1, unit="rad/s"),
            Claim("the spin falls at first, then rises to a steady value", "spin falls, then rises", curve=1),
        ),
        "three horizontal velocities, zero spin, no offset; no values", (BASE, STEEP_TOO, VARIED, NO_SLIP),
    ),
    Example(
        "fig18", "Spin of the shell, special case of topspin", ("omega_2",),
        (Curve("topspin 600 rad/s", (12.63, 11.37, 600.0), GRIP),),
        (
            Claim("the core's spin exceeds that of rolling: the shell is accelerated", "spin rises while gripping"),
            Claim("shell spin when rolling begins", "rolling start", unit="rad/s"),
        ),
        "topspin beyond the shell's spin in rolling; no values",
        (BASE, STEEP_TOO, NO_OFFSET, "spin: 600 rad/s, beyond v_x1/R = 382 rad/s", NO_SLIP),
    ),
    Example(
        "fig19", "Spin of the shell while rolling: zero spin, topspin, backspin", ("omega_2",), _GRIP_SPINS,
        (Claim("topspin turns fastest, backspin slowest", "topspin above zero above backspin"),),
        "three incident spins, one angle and speed; no values", (BASE, STEEP_TOO, NO_OFFSET, NO_SLIP),
    ),
    Example(
        "fig20", "Spin while rolling, three offsets of the normal force", ("omega_2",),
        tuple(
            Curve(f"offset {value:g} in", STEEP, {**GRIP, "eps_10": value * INCH}) for value in (0.0, 0.25, 0.5)
        ),
        (
            Claim("the higher the offset, the lower the spin", "falling rebound omega_2"),
            Claim("without offset the spin is almost steady before the contact ends", "steady at the end"),
        ),
        "three offsets, the rest fixed; no values",
        (BASE, STEEP_TOO, "offsets: 0, 0.25 and 0.5 in, the range of Eq. (53)", NO_SLIP),
    ),
    Example(
        "fig21", "Horizontal velocity while rolling, three incident velocities", ("centre",),
        _vary("v_x1", (8.0, 12.63, 16.0), "m/s", 0, STEEP, GRIP),
        (
            Claim("the horizontal velocity decreases", "falling v_x"),
            Claim("the higher the incident velocity, the higher the rebound velocity", "rising rebound v_x2"),
        ),
        "three incident horizontal velocities, topspin; no values", (BASE, STEEP_TOO, NO_OFFSET, VARIED, NO_SLIP),
    ),
    Example(
        "fig22", "Horizontal velocity while rolling, three topspins", ("centre",), _TOPSPINS,
        (Claim("more topspin, higher rebound velocity", "rising rebound v_x2"),),
        "three topspins, one horizontal velocity; no values", (BASE, STEEP_TOO, NO_OFFSET, VARIED, NO_SLIP),
    ),
    Example(
        "fig23", "Friction while rolling, three spins", ("friction_force",), _TOPSPINS,
        (
            Claim("the less spin, the greater the friction", "less spin, more friction"),
            Claim("friction retards the ball at first", "friction starts negative"),
        ),
        "three incident spins; no values", (BASE, STEEP_TOO, NO_OFFSET, VARIED, NO_SLIP),
    ),
    Example(
        "fig24", "Transition: centre and surface velocity for three spins", ("v_x",),
        (
            Curve("zero spin", (BETWEEN[0], BETWEEN[1], 0.0)),
            Curve("topspin 100 rad/s", BETWEEN),
            Curve("backspin 100 rad/s", (BETWEEN[0], BETWEEN[1], -100.0)),
        ),
        (
            Claim("topspin reaches rolling before zero spin", "topspin rolls first"),
            Claim("backspin does not roll at all", "no rolling", curve=2),
        ),
        "three spins, one friction; no values",
        (BASE, "impact: 15 and 8 m/s, between the two examples, where the three spins differ as the text says"),
    ),
    Example(
        "fig25", "First example: surface and centre velocity", ("v_x",), (Curve("first example", SHALLOW),),
        (
            Claim("rolling does not occur", "no rolling"),
            Claim("v_x2, as read from the graph", "v_x2", printed=12.667, unit="m/s"),
            Claim("v_x2, in the equation below", "v_x2", printed=12.461, unit="m/s"),
            Claim("omega_2", "omega_2", printed=371.586, unit="rad/s"),
            Claim("v_y2", "v_y2", printed=4.053, unit="m/s"),
            Claim("rebound angle", "theta_2", printed=16.644, unit="deg"),
        ),
        f"17 m/s at 18 deg (16.13, 5.33 m/s), topspin 100 rad/s; {STATED_BASE}", (DAMPING, OFFSET),
    ),
    Example(
        "fig26", "First example: normal and tangential force", ("forces",), (Curve("first example", SHALLOW),),
        (
            Claim("mean coefficient of friction, Eq. (65)", "mean friction", printed=0.400),
            Claim("ratio of the impulses of both forces", "impulse ratio"),
        ),
        f"17 m/s at 18 deg (16.13, 5.33 m/s), topspin 100 rad/s; {STATED_BASE}", (DAMPING, OFFSET),
    ),
    Example(
        "fig27", "Second example: surface and centre velocity", ("v_x",), (Curve("second example", STEEP),),
        (
            Claim("rolling begins at n", "rolling begins", printed=0.342),
            Claim("rolling lasts more than half of the contact", "rolls more than half"),
            Claim("v_y2", "v_y2", printed=8.646, unit="m/s"),
        ),
        f"17 m/s at 42 deg (12.63, 11.37 m/s), topspin 100 rad/s; {STATED_BASE}", (DAMPING, OFFSET),
    ),
    Example(
        "fig28", "Second example: velocity and spin, slide and roll", ("v_x", "omega_2"),
        (Curve("second example", STEEP),),
        (
            Claim("v_x2", "v_x2", printed=9.813, unit="m/s"),
            Claim("omega_2", "omega_2", printed=297.181, unit="rad/s"),
            Claim("rebound angle", "theta_2", printed=41.38, unit="deg"),
            Claim("rebound speed", "v_2", printed=15.99, unit="m/s"),
            Claim("mean coefficient of friction, Eq. (65)", "mean friction", printed=0.127),
            Claim("ratio of the impulses of both forces", "impulse ratio"),
        ),
        f"17 m/s at 42 deg (12.63, 11.37 m/s), topspin 100 rad/s; {STATED_BASE}", (DAMPING, OFFSET),
    ),
)  # fmt: skip
