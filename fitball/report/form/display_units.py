"""Units in which a person reads a parameter: handy multiples of SI, and those of the thesis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.models.specs import SPECS
from fitball.observables import OBSERVABLES

INCH = 0.0254
POUND_FORCE = 4.4482216152605
POUND = 0.45359237


@dataclass(frozen=True)
class Scale:
    """A unit and the factor that turns an SI value into it."""

    unit: str
    factor: float


# Other units than SI in which people read parameters and columns of a rebound, by name.
HANDY: Mapping[str, Scale] = {
    item.name: Scale(*item.shown)
    for registry in (SPECS, NOISE_SPECS, OBSERVABLES)
    for item in registry.values()
    if item.shown is not None
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


# Quantities of an incident state, in the units that people read.
INCIDENT: Mapping[str, Scale] = {
    "v_y1": Scale("m/s", 1.0),
    "theta_1": Scale("deg", 57.29577951308232),
    "omega_1": Scale("rad/s", 1.0),
}


def handy(name: str, unit: str) -> Scale:
    """The handy multiple for a parameter or output, SI itself where none is listed; a value "at 2 m/s" is read as the
    parameter is.
    """
    return HANDY.get(name.partition(" at ")[0], Scale(unit, 1.0))


def output_scale(name: str) -> Scale:
    """The unit in which people read a column of a rebound."""
    return handy(name, OBSERVABLES[name].unit)
