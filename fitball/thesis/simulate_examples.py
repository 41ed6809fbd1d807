"""Figs 8 to 28 of Jafri (2004) as data: what each varies, and what the thesis states of its inputs; what it claims
stands in `datasets/thesis/figure_claims.csv`.

The figures of Chapter III carry no inputs in their text: only the two examples behind Figs 25 to 28 are stated. What
had to be assumed stands beside each figure, with the reason.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fitball.data.published import thesis_rows
from fitball.inference.thesis.published_cases import INCH

Impact = tuple[float, float, float]
# Chapter III: 17 m/s with a topspin of 100 rad/s, at 18 and at 42 degrees; components as printed [m/s, m/s, rad/s].
SHALLOW: Impact = (16.13, 5.33, 100.0)
STEEP: Impact = (12.63, 11.37, 100.0)
COR = 0.76


@dataclass(frozen=True)
class Curve:
    """One curve: its label, the impact `(v_x1, v_y1, omega_1)` [m/s, m/s, rad/s], what differs from the base set."""

    label: str
    impact: Impact
    changed: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Claim:
    """What the thesis says of a curve, numbered from 0: `measure` names the quantity (see `example_claims`).

    `printed` is its number, or None for a statement in words that `holds` or not.
    """

    said: str
    measure: str
    curve: int
    printed: float | None
    unit: str


@dataclass(frozen=True)
class Example:
    """One figure: `panels` as in `figure_history`, inputs `stated` and `assumed` in words."""

    name: str
    title: str
    panels: tuple[str, ...]
    curves: tuple[Curve, ...]
    stated: str
    assumed: tuple[str, ...]

    @property
    def claims(self) -> tuple[Claim, ...]:
        """What the thesis says of it."""
        return tuple(
            Claim(
                row["claim"], row["measure"], int(row["curve"]), float(row["printed"]) if row["printed"] else None,
                row["unit"],
            )
            for row in thesis_rows("figure_claims")
            if row["figure"] == self.name
        )  # fmt: skip


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


def _vary(
    label: str, place: int, base: Impact, values: tuple[float, ...], changed: Mapping[str, float]
) -> tuple[Curve, ...]:
    """Curves along one component of the impact; the label has a `#` for its value."""
    made = [[*base[:place], value, *base[place + 1 :]] for value in values]
    return tuple(
        Curve(label.replace("#", f"{value:g}"), (v_x, v_y, omega), changed)
        for value, (v_x, v_y, omega) in zip(values, made, strict=True)
    )


def _frictions(impact: Impact) -> tuple[Curve, ...]:
    return tuple(Curve(f"mu {value:g}", impact, {"mu": value}) for value in (0.3, 0.4, 0.55))


def _spins(v_x: float, v_y: float, changed: Mapping[str, float]) -> tuple[Curve, ...]:
    spins = {"zero spin": 0.0, "topspin 100 rad/s": 100.0, "backspin 100 rad/s": -100.0}
    return tuple(Curve(label, (v_x, v_y, omega), changed) for label, omega in spins.items())


_SPEEDS = _vary("v_y1 # m/s", 1, (20.0, 8.0, 0.0), (4.0, 8.0, 12.0), {})
_TOPSPINS = _vary("spin # rad/s", 2, STEEP, (50.0, 100.0, 200.0), GRIP)

EXAMPLES: tuple[Example, ...] = (
    Example(
        "fig8", "Vertical displacement, three incident vertical velocities", ("y",), _SPEEDS,
        "three incident vertical velocities, the rest fixed; no values", (BASE, VARIED),
    ),
    Example(
        "fig9", "Vertical velocity, three coefficients of restitution", ("v_y",),
        tuple(Curve(f"COR {value:g}", SHALLOW, {"cor_10": value}) for value in (0.6, 0.76, 0.9)),
        "mass and stiffness the same, only the damping differs; no values", (BASE, SHALLOW_TOO, VARIED),
    ),
    Example(
        "fig10", "Horizontal velocity while sliding, three frictions", ("centre",),
        _frictions(SHALLOW),
        "three coefficients of sliding friction, one incident velocity; no values", (BASE, SHALLOW_TOO, VARIED),
    ),
    Example(
        "fig11", "Horizontal velocity while sliding, three incident velocities", ("centre",),
        _vary("v_x1 # m/s", 0, SHALLOW, (14.0, 16.13, 20.0), {}),
        "three incident horizontal velocities, one friction; no values", (BASE, SHALLOW_TOO, VARIED),
    ),
    Example(
        "fig12", "Horizontal velocity while sliding, high topspin", ("centre",),
        _frictions((10.0, 5.33, 800.0)),
        "topspin whose surface velocity exceeds the horizontal velocity, three frictions; no values",
        (BASE, "impact: 10 and 5.33 m/s with 800 rad/s, so that the surface is faster throughout", VARIED),
    ),
    Example(
        "fig13", "Spin while sliding: zero spin, topspin, backspin", ("omega_2",), _spins(16.13, 5.33, {}),
        "zero spin, topspin and backspin; no values",
        (BASE, SHALLOW_TOO, "spins: 100 rad/s either way, the topspin of the examples"),
    ),
    Example(
        "fig14", "Spin while sliding, three frictions", ("omega_2",), _frictions(SHALLOW),
        "topspin and three coefficients of sliding friction; no values", (BASE, SHALLOW_TOO, VARIED),
    ),
    Example(
        "fig15", "Normal force, three incident vertical velocities", ("normal_force",), _SPEEDS,
        "three incident vertical velocities, the rest fixed; no values",
        (BASE, VARIED, "the end: the ground cannot pull, so the force is zero where Eq. (75) turns tensile"),
    ),
    Example(
        "fig16", "Friction while sliding, three frictions", ("friction_force",), _frictions(SHALLOW),
        "three coefficients of sliding friction; no values", (BASE, SHALLOW_TOO, VARIED),
    ),
    Example(
        "fig17", "Spin while rolling, three horizontal velocities, zero spin", ("omega_2",),
        _vary("v_x1 # m/s", 0, (12.63, 11.37, 0.0), (8.0, 12.63, 16.0), GRIP),
        "three horizontal velocities, zero spin, no offset; no values", (BASE, STEEP_TOO, VARIED, NO_SLIP),
    ),
    Example(
        "fig18", "Spin of the shell, special case of topspin", ("omega_2",),
        (Curve("topspin 600 rad/s", (12.63, 11.37, 600.0), GRIP),),
        "topspin beyond the shell's spin in rolling; no values",
        (BASE, STEEP_TOO, NO_OFFSET, "spin: 600 rad/s, beyond v_x1/R = 382 rad/s", NO_SLIP),
    ),
    Example(
        "fig19", "Spin of the shell while rolling: zero spin, topspin, backspin", ("omega_2",),
        _spins(12.63, 11.37, GRIP),
        "three incident spins, one angle and speed; no values", (BASE, STEEP_TOO, NO_OFFSET, NO_SLIP),
    ),
    Example(
        "fig20", "Spin while rolling, three offsets of the normal force", ("omega_2",),
        tuple(
            Curve(f"offset {value:g} in", STEEP, {**GRIP, "eps_10": value * INCH}) for value in (0.0, 0.25, 0.5)
        ),
        "three offsets, the rest fixed; no values",
        (BASE, STEEP_TOO, "offsets: 0, 0.25 and 0.5 in, the range of Eq. (53)", NO_SLIP),
    ),
    Example(
        "fig21", "Horizontal velocity while rolling, three incident velocities", ("centre",),
        _vary("v_x1 # m/s", 0, STEEP, (8.0, 12.63, 16.0), GRIP),
        "three incident horizontal velocities, topspin; no values", (BASE, STEEP_TOO, NO_OFFSET, VARIED, NO_SLIP),
    ),
    Example(
        "fig22", "Horizontal velocity while rolling, three topspins", ("centre",), _TOPSPINS,
        "three topspins, one horizontal velocity; no values", (BASE, STEEP_TOO, NO_OFFSET, VARIED, NO_SLIP),
    ),
    Example(
        "fig23", "Friction while rolling, three spins", ("friction_force",), _TOPSPINS,
        "three incident spins; no values", (BASE, STEEP_TOO, NO_OFFSET, VARIED, NO_SLIP),
    ),
    Example(
        "fig24", "Transition: centre and surface velocity for three spins", ("v_x",),
        _spins(15.0, 8.0, {}),
        "three spins, one friction; no values",
        (BASE, "impact: 15 and 8 m/s, between the two examples, where the three spins differ as the text says"),
    ),
    Example(
        "fig25", "First example: surface and centre velocity", ("v_x",), (Curve("first example", SHALLOW),),
        f"17 m/s at 18 deg (16.13, 5.33 m/s), topspin 100 rad/s; {STATED_BASE}", (DAMPING, OFFSET),
    ),
    Example(
        "fig26", "First example: normal and tangential force", ("forces",), (Curve("first example", SHALLOW),),
        f"17 m/s at 18 deg (16.13, 5.33 m/s), topspin 100 rad/s; {STATED_BASE}", (DAMPING, OFFSET),
    ),
    Example(
        "fig27", "Second example: surface and centre velocity", ("v_x",), (Curve("second example", STEEP),),
        f"17 m/s at 42 deg (12.63, 11.37 m/s), topspin 100 rad/s; {STATED_BASE}", (DAMPING, OFFSET),
    ),
    Example(
        "fig28", "Second example: velocity and spin, slide and roll", ("v_x", "omega_2"),
        (Curve("second example", STEEP),),
        f"17 m/s at 42 deg (12.63, 11.37 m/s), topspin 100 rad/s; {STATED_BASE}", (DAMPING, OFFSET),
    ),
)  # fmt: skip
