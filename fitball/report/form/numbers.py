"""Numbers and units as a person should see them: rounded to what their uncertainty supports (PDG rule), in handy
multiples of SI; names in sentences.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Context, Decimal

import numpy as np
from uncertainties.formatting import PDG_precision

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results.quantiles import Spread
from fitball.models.specs import SPECS
from fitball.observables import OBSERVABLES

MOST_DECIMALS = 9
# Digits enough for any double.
_WIDE = Context(prec=400)


def decimals(sd: float) -> int:
    """Decimals that a standard deviation supports (negative: tens, hundreds); at most MOST_DECIMALS.

    One or two significant digits of the sd are kept, by the rule of the Particle Data Group.
    """
    if not (math.isfinite(sd) and sd > 0.0):
        return 3
    digits, rounded = PDG_precision(sd)
    return min(int(digits) - 1 - math.floor(math.log10(rounded)), MOST_DECIMALS)


def fixed(value: float | None, places: int) -> str:
    """A number with that many decimals; powers of ten are not used; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    # In decimal, as it is printed: in binary 0.95 lies below itself and would round to 0.9, where the rule says 1.0.
    rounded = Decimal(repr(float(value))).quantize(Decimal(1).scaleb(-places), ROUND_HALF_EVEN, _WIDE)
    text = f"{rounded:.{max(places, 0)}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def interval(low: float | None, high: float | None, places: int) -> str:
    """Two ends with the same decimals."""
    return f"[{fixed(low, places)}, {fixed(high, places)}]"


def plus_minus(value: float, sd: float, places: int | None = None) -> str:
    """A number with its standard deviation, both with the decimals that this supports or that are asked for."""
    places = decimals(sd) if places is None else places
    return f"{fixed(value, places)} +- {fixed(sd, places)}"


def ranged(spread: Spread, factor: float = 1.0, places: int | None = None) -> tuple[str, str]:
    """The best value, times a factor, and its 95 % interval, with the decimals that a quarter of that supports; of a
    point fit a dash for the interval, and as many decimals as are asked for, or four digits.
    """
    if spread.median is None or spread.q025 is None or spread.q975 is None:
        point = factor * spread.point
        return significant(point, 4) if places is None else fixed(point, places), "-"
    places = decimals(0.25 * factor * (spread.q975 - spread.q025))
    return fixed(factor * spread.median, places), interval(factor * spread.q025, factor * spread.q975, places)


def inner(spread: Spread) -> str:
    """The 68 % interval, with the decimals of the 95 % one in `ranged`; a dash where there is none."""
    if spread.q025 is None or spread.q975 is None:
        return "-"
    return interval(spread.q16, spread.q84, decimals(0.25 * (spread.q975 - spread.q025)))


def percent(share: float, fine: bool = False) -> str:
    """A share in whole per cent, or as `fine` as a tenth where it is small; what is neither none nor all is not
    called so.
    """
    least, words = (0.001, ("< 0.1 %", "> 99.9 %")) if fine else (0.005, ("< 1 %", "> 99 %"))
    if 0.0 < share < least:
        return words[0]
    if 1.0 - least < share < 1.0:
        return words[1]
    return f"{100.0 * share:.{1 if fine and share < 0.1 else 0}f} %"


def digits(value: float, count: int) -> str:
    """A number to `count` significant digits, zeros kept, whole digits never dropped: 0.30, 113, 1000."""
    if not (math.isfinite(value) and abs(value) > 0.0):
        return "-" if not math.isfinite(value) else "0"
    return f"{value:.{max(0, count - 1 - math.floor(math.log10(abs(value))))}f}"


def significant(value: float | None, digits: int = 3) -> str:
    """A number without uncertainty to a few significant digits."""
    if value is None or not math.isfinite(value):
        return "-"
    # A zero has no sign.
    return f"{value + 0.0:.{digits}g}"


INCH = 0.0254
POUND_FORCE = 4.4482216152605
POUND = 0.45359237


@dataclass(frozen=True)
class Scale:
    """A unit and the factor that turns an SI value into it; its methods write values in SI as text in the unit."""

    unit: str
    factor: float = 1.0

    def decimals(self, sd: float) -> int:
        """As `decimals`."""
        return decimals(sd * self.factor)

    def fixed(self, value: float | None, places: int) -> str:
        """As `fixed`."""
        return fixed(None if value is None else value * self.factor, places)

    def interval(self, low: float | None, high: float | None, places: int) -> str:
        """As `interval`."""
        return f"[{self.fixed(low, places)}, {self.fixed(high, places)}]"

    def plus_minus(self, value: float, sd: float) -> str:
        """As `plus_minus`."""
        return plus_minus(value * self.factor, sd * self.factor)

    def measured(self, value: float, digits: int = 3) -> str:
        """As `significant`, with the unit."""
        return f"{significant(value * self.factor, digits)} {self.unit}".rstrip()


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


def listed(words: Sequence[str]) -> str:
    """Words with commas and an `and` before the last."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


# Impacts that are listed; data.nc holds the measurements of all.
LISTED = 20_000


def listed_places(count: int) -> list[int]:
    """Which of so many impacts the files list: all, or `LISTED` of them, evenly spread."""
    return [round(place) for place in np.linspace(0, count - 1, min(count, LISTED))]


def file_words(name: str, count: int) -> str:
    """Where so many impacts are listed, and how many of them."""
    return name if count <= LISTED else f"{name}, which lists {LISTED:,} of all {count:,}, evenly spread"
