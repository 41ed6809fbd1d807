"""Numbers and units as a person should see them: rounded to what their uncertainty supports (PDG rule), in handy
multiples of SI; names in sentences; parameters, a row each: what terminal, page, paper, certificate and notebook
show; their symbols.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Context, Decimal
from typing import Any

import numpy as np
from markupsafe import Markup, escape
from uncertainties.formatting import PDG_precision

from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results.evidence import Profile
from fitball.inference.results.quantiles import Spread
from fitball.inference.results.results import Estimate, Verdict
from fitball.models.specs import SPECS
from fitball.observables import OBSERVABLES
from fitball.report.form.document import Cell, Row, judged

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
    item.name: Scale(*item.handy)
    for registry in (SPECS, NOISE_SPECS, OBSERVABLES, CAMERA_SPECS)
    for item in registry.values()
    if item.handy is not None
} | {"k_theta/k_y": Scale("cm^2/rad", 1e4)}

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
    """The handy multiple for a parameter or output, SI itself where none is listed; a value "at 2 m/s", or of a level
    in brackets, is read as the parameter is.
    """
    return HANDY.get(name.partition(" at ")[0].partition("[")[0], Scale(unit, 1.0))


def output_scale(name: str) -> Scale:
    """The unit in which people read a column of a rebound."""
    return handy(name, OBSERVABLES[name].unit)


def listed(words: Sequence[str], most: int = 0) -> str:
    """Words with commas and an `and` before the last; of more than `most` those, and how many others."""
    if 0 < most < len(words):
        return f"{', '.join(words[:most])} and {len(words) - most:,} more"
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


# Impacts that are listed; data.nc holds the measurements of all.
LISTED = 20_000


def listed_places(count: int) -> list[int]:
    """Which of so many impacts the files list: all, or `LISTED` of them, evenly spread."""
    return [round(place) for place in np.linspace(0, count - 1, min(count, LISTED))]


def file_words(name: str, count: int) -> str:
    """Where so many impacts are listed, and how many of them."""
    return name if count <= LISTED else f"{name}, which lists {LISTED:,} of all {count:,}, evenly spread"


# Ratio of the ends of an interval from which each has digits of its own.
WIDE = 20.0


@dataclass(frozen=True)
class ParameterRow:
    """One parameter as text, in the unit of its row; "-" for what a run without posterior has not."""

    name: str
    unit: str
    point: str
    median: str = "-"
    sd: str = "-"
    interval_68: str = "-"
    interval_95: str = "-"

    @property
    def best(self) -> str:
        """The median, or the point estimate where there is none."""
        return self.point if self.median == "-" else self.median

    @property
    def within(self) -> str:
        """The best value with its 95 % interval, where there is one."""
        return self.best if self.median == "-" else f"{self.median} {self.interval_95}"

    @property
    def plus_minus(self) -> str:
        """The best value with its sd, where there is one, and its unit."""
        return f"{self.best if self.median == '-' else f'{self.median} +- {self.sd}'} {self.unit}".rstrip()

    def numbers(self, sampled: bool = True) -> Row:
        """Median and intervals, where there is a posterior, and the point estimate, by their heads."""
        spread = {"median": self.median, "68 %": self.interval_68, "95 %": self.interval_95} if sampled else {}
        return spread | {"point": self.point}


def row_of(name: str, numbers: Mapping[str, Any], scale: Scale) -> ParameterRow:
    """Point, median, sd and quantiles in SI as text in that unit, to the places that the sd allows."""
    if numbers["median"] is None or numbers["sd"] is None:
        return ParameterRow(name, scale.unit, significant(numbers["point"] * scale.factor, 4))
    places = scale.decimals(numbers["sd"])
    point, median, sd = (scale.fixed(numbers[it], places) for it in ("point", "median", "sd"))
    ends = (scale.interval(numbers[low], numbers[high], places) for low, high in (("q16", "q84"), ("q025", "q975")))
    return ParameterRow(name, scale.unit, point, median, sd, *ends)


def parameter_row(estimate: Estimate, scale: Scale | None = None) -> ParameterRow:
    """One parameter in handy multiples of SI, or as `scale` has it."""
    return row_of(estimate.name, vars(estimate), scale or handy(estimate.name, estimate.unit))


def verdict_cell(estimate: Estimate) -> Cell:
    """The verdict of a parameter: on a page with what it is given, for which a terminal has no room."""
    return Cell(estimate.verdict, judged(estimate.verdict, estimate.verdict_words, estimate.reason).html)


def parameter_line(estimate: Estimate) -> Cell:
    """What is said of a parameter, in a line: its value if the data determine it, its verdict and the reason."""
    row, known = parameter_row(estimate), ""
    if estimate.verdict in (*DETERMINED, Verdict.FIXED):
        # A unit such as 1e-3 s/m is a factor to a reader.
        unit = f"{' x' * row.unit[:1].isdigit()} {row.unit}".rstrip()
        known = f" = {row.best}{unit}{'' if row.median == '-' else f' {row.interval_95} (95 %)'}"
    verdict, reason = estimate.verdict_words, estimate.reason
    coloured = judged(estimate.verdict, verdict).html
    html = Markup("<b>{}</b>{}: {}; {}").format(row.name, known, coloured, reason.replace("+-", "\u00b1"))
    return Cell(f"{row.name}{known}: {verdict}; {reason}", html)


DETERMINED = (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.UNEXAMINED, Verdict.CONDITIONAL)
NOT_DETERMINED = (Verdict.EXTRAPOLATED, Verdict.ONE_SIDED, Verdict.PRIOR_DOMINATED, Verdict.NOT_JUDGED)


def profile_interval(profile: Profile | None, scale: Scale) -> str:
    """The 95 % interval of a profile with the decimals a quarter of it supports; an open end is said to be open."""
    if profile is None:
        return "-"
    low, high = (None if end is None else end * scale.factor for end in profile.interval_95)
    if low is not None and high is not None:
        text = interval(low, high, decimals(0.25 * (high - low)))
        if high > WIDE * low > 0.0:
            text = f"[{significant(low, 2)}, {significant(high, 2)}]"
    elif low is not None:
        text = f"> {significant(low)}"
    elif high is not None:
        text = f"< {significant(high)}"
    else:
        return "open"
    leaning = sorted({name for names in profile.leans_on for name in names})
    return f"{text} by the bounds of {', '.join(leaning)}" if leaning else text


# A command of mathtext; a group or an index.
_COMMAND = re.compile(r"\\([A-Za-z]+)")
_INDEX = re.compile(r"([_^]?)\{([^{}]*)\}|([_^])([^{}_^])")
# Commands that are not the name of a Greek letter; of the two epsilons figures use the curly one.
_LETTERS = {"mathrm": "", "varepsilon": "\u03b5", "nu": "\u03bd"}


def symbol_html(mathtext: str) -> Markup:
    """Letters, Greek letters, indices and powers of `mathtext` as HTML; the empty text stays empty.

    Raises ValueError for a command it does not know.
    """
    plain = mathtext.replace("$", "").replace(" ", "").replace("'", "\u2032")
    text, before = str(escape(_COMMAND.sub(_letter, plain))), ""
    while text != before:
        text, before = _INDEX.sub(_index, text), text
    if "{" in text or "}" in text:
        raise ValueError(f"{mathtext}: a brace too many")
    return Markup(text)


def _letter(command: re.Match[str]) -> str:
    name = command[1]
    try:
        return _LETTERS[name] if name in _LETTERS else unicodedata.lookup(f"GREEK SMALL LETTER {name.upper()}")
    except KeyError:
        raise ValueError(f"{name}: no such letter") from None


def _index(found: re.Match[str]) -> str:
    tag = {"_": "sub", "^": "sup"}.get(found[1] or found[3])
    inside = found[2] or found[4] or ""
    return f"<{tag}>{inside}</{tag}>" if tag else inside


def symbol_cell(mathtext: str) -> Cell:
    """A symbol for a page; for who has no such letters nothing."""
    return Cell("", symbol_html(mathtext))
