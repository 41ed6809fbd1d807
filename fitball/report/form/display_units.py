"""Units in which a person reads a parameter: handy multiples of SI, and those of the thesis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitball.observables import OBSERVABLES

INCH = 0.0254
POUND_FORCE = 4.4482216152605
POUND = 0.45359237


@dataclass(frozen=True)
class Scale:
    """A unit and the factor that turns an SI value into it."""

    unit: str
    factor: float


# Multiples of SI that keep typical values between 0.1 and 1000.
_MULTIPLES: Mapping[str, Scale] = {
    "k_y": Scale("kN/m", 1e-3),
    "force_misfit": Scale("%", 1e2),
    "eps_10": Scale("mm", 1e3),
    "eps_slope": Scale("mm/(m/s)", 1e3),
    "cor_slope": Scale("1e-3 s/m", 1e3),
    "offset": Scale("mm", 1e3),
    "ball_mass": Scale("g", 1e3),
    "ball_radius": Scale("mm", 1e3),
}
# The noise of a column reads in the unit of the column.
HANDY: Mapping[str, Scale] = {
    **_MULTIPLES,
    **{
        name: Scale(*item.shown)
        for item in OBSERVABLES.values()
        if item.shown is not None
        for name in (item.name, item.noise.name)
    },
}

# Jafri (2004), Appendix B: inch, pound force, second; speeds in metres per second.
THESIS: Mapping[str, Scale] = {
    "k_y": Scale("lb/in", INCH / POUND_FORCE),
    "k_theta": Scale("lb in/rad", 1.0 / (INCH * POUND_FORCE)),
    "eps_10": Scale("in", 1.0 / INCH),
    "eps_slope": Scale("in/(m/s)", 1.0 / INCH),
    "offset": Scale("in", 1.0 / INCH),
    "ball_mass": Scale("lb", 1.0 / POUND),
    "ball_radius": Scale("in", 1.0 / INCH),
}


def handy(name: str, unit: str) -> Scale:
    """The handy multiple for a parameter or output, SI itself where none is listed."""
    return HANDY.get(name, Scale(unit, 1.0))


def output_scale(name: str) -> Scale:
    """The unit in which people read a column of a rebound."""
    return handy(name, OBSERVABLES[name].unit)
