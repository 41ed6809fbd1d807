"""Units of measurement: the one place where a number in some unit becomes a number in SI, and how units are spelled.

Factors are the exact definitions (international mile, foot, inch and nautical mile; 180 degrees = pi radians), kept
as numerator and denominator so that 5 ms is exactly 0.005 s. Spellings (`m s^-1`, `MPH`, `degrees per second`) are a
small grammar, `A`, `A/B`, `A B^-1` or `A per B`, over words of length, time, angle and turns: what is not in the list
of units stays unknown, however it is spelled.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from math import pi
from typing import TypeVar

from fitball.errors import UnitError, suggestion
from fitball.values import FloatArray


def _by_word(words_of: Mapping[str, str]) -> dict[str, str]:
    return {word: symbol for symbol, words in words_of.items() for word in words.split()}


_WORDS = _by_word(
    {
        "m": "m meter meters metre metres",
        "cm": "cm centimeter centimeters centimetre centimetres",
        "mm": "mm millimeter millimeters millimetre millimetres",
        "km": "km kilometer kilometers kilometre kilometres kms",
        "in": 'in inch inches " ″',
        "ft": "ft foot feet ' ′",
        "mi": "mi mile miles",
        "s": "s sec secs second seconds sek sekunde sekunden",
        "ms": "ms msec msecs millisecond milliseconds",
        "us": "us usec microsecond microseconds µs μs",
        "min": "min mins minute minutes",
        "h": "h hr hrs hour hours std",
        "rad": "rad rads radian radians",
        "mrad": "mrad milliradian milliradians",
        "deg": "deg degs degree degrees ° º",
        "rev": "rev revs revolution revolutions turn turns rot rotation rotations u umdr umdrehungen",
        "N": "n newton newtons",
        "kN": "kilonewton kilonewtons",
        "lbf": "lbf",
    }
)
# What is one word, or no product of the words above; nobody counts in inverse milliseconds here.
_WHOLE = {"r p m": "rpm"} | _by_word(
    {
        "mph": "mph mi/h",
        "km/h": "kph kmh kmph kmh^-1",
        "m/s": "mps ms^-1",
        "cm/s": "cmps cms^-1",
        "mm/s": "mms^-1",
        "ft/s": "fps",
        "in/s": "ips",
        "kn": "kt kts knot knots",
        "rpm": "rpm rev/min 1/min min^-1",
        "rev/s": "rps hz hertz",
        "rad/s": "rads^-1",
        "deg/s": "dps degs^-1",
    }
)
# Spellings that mean two things, and what to write for each.
AMBIGUOUS: Mapping[str, str] = {
    "1/s": "rad/s or rev/s",
    "s^-1": "rad/s or rev/s",
    "grad": "deg (gradians are not known)",
    "gon": "deg, of which a gon is 0.9",
    # Any case but those of the symbols, `kn` and `kN`.
    "kn": "kn for knots, or kN for kilonewtons",
    "lb": "lbf",
    "lbs": "lbf",
}
_SUPERSCRIPTS = str.maketrans("⁻⁺¹²", "-+12")


def plain(text: str) -> str:
    """A spelling without what makes no difference: case, blanks, kinds of dots, minus and power signs."""
    folded = text.strip().casefold().translate(_SUPERSCRIPTS).replace("\u2212", "-").replace("–", "-")
    folded = re.sub(r"\bper\b", "/", folded.replace("**", "^").replace("⁄", "/").replace("∕", "/"))
    folded = re.sub(r"[·⋅*.\u00a0_\s]+", " ", folded).strip()
    folded = re.sub(r"\s*/\s*", "/", folded).strip()
    return re.sub(r"(?<=[a-z])\s*\^?\s*\(?-1\)?$", "^-1", folded)


def spelled_unit(text: str) -> str:
    """The symbol that a spelling stands for, of a unit that `data.units` may or may not know."""
    spelling = plain(text)
    if spelling in _WHOLE:
        return _WHOLE[spelling]
    if spelling in _WORDS:
        return _WORDS[spelling]
    quotient = re.fullmatch(r"([^/ ]+)/([^/ ]+)", spelling) or re.fullmatch(r"(\S+) (\S+)\^-1", spelling)
    if quotient is None:
        return text.strip()
    above, below = (_WORDS.get(word) for word in quotient.groups())
    if above is None or below is None:
        return text.strip()
    return _WHOLE.get(f"{above}/{below}", f"{above}/{below}")


Number = TypeVar("Number", float, FloatArray)


class Dimension(Enum):
    """What a unit measures."""

    SPEED = "speed"
    SPIN = "spin"
    ANGLE = "angle"
    TIME = "time"
    FORCE = "force"
    LENGTH = "length"


@dataclass(frozen=True)
class Unit:
    """One unit: 1 `symbol` = `numerator / denominator` of the SI unit (m/s, rad/s, rad, s, N, m)."""

    symbol: str
    dimension: Dimension
    numerator: float
    denominator: float = 1.0

    def to_si(self, value: Number) -> Number:
        """`value` in this unit -> in SI."""
        return value * self.numerator / self.denominator

    def from_si(self, value: Number) -> Number:
        """`value` in SI -> in this unit."""
        return value * self.denominator / self.numerator


_UNITS = (
    Unit("m/s", Dimension.SPEED, 1.0),
    Unit("cm/s", Dimension.SPEED, 1.0, 100.0),
    Unit("mm/s", Dimension.SPEED, 1.0, 1000.0),
    Unit("km/h", Dimension.SPEED, 5.0, 18.0),
    Unit("mph", Dimension.SPEED, 1397.0, 3125.0),  # 0.44704 m/s
    Unit("ft/s", Dimension.SPEED, 381.0, 1250.0),  # 0.3048 m/s
    Unit("in/s", Dimension.SPEED, 127.0, 5000.0),  # 0.0254 m/s
    Unit("kn", Dimension.SPEED, 463.0, 900.0),  # 1852 m in 3600 s
    Unit("rad/s", Dimension.SPIN, 1.0),
    Unit("deg/s", Dimension.SPIN, pi, 180.0),
    Unit("rev/s", Dimension.SPIN, 2.0 * pi),
    Unit("rpm", Dimension.SPIN, pi, 30.0),
    Unit("deg", Dimension.ANGLE, pi, 180.0),
    Unit("rad", Dimension.ANGLE, 1.0),
    Unit("mrad", Dimension.ANGLE, 1.0, 1000.0),
    Unit("s", Dimension.TIME, 1.0),
    Unit("ms", Dimension.TIME, 1.0, 1.0e3),
    Unit("us", Dimension.TIME, 1.0, 1.0e6),
    Unit("N", Dimension.FORCE, 1.0),
    Unit("kN", Dimension.FORCE, 1.0e3),
    Unit("lbf", Dimension.FORCE, 8896443230521.0, 2.0e12),  # 4.4482216152605 N
    Unit("m", Dimension.LENGTH, 1.0),
    Unit("cm", Dimension.LENGTH, 1.0, 100.0),
    Unit("mm", Dimension.LENGTH, 1.0, 1000.0),
    Unit("in", Dimension.LENGTH, 127.0, 5000.0),  # 0.0254 m
    Unit("ft", Dimension.LENGTH, 381.0, 1250.0),  # 0.3048 m
)

UNITS = {unit.symbol: unit for unit in _UNITS}

# The unit of a number that stands without one: the first of its dimension.
DEFAULT_UNIT = {unit.dimension: unit for unit in reversed(_UNITS)}


def symbols(dimension: Dimension) -> tuple[str, ...]:
    """The units known for a dimension, by their main spelling."""
    return tuple(unit.symbol for unit in _UNITS if unit.dimension is dimension)


def parse_unit(text: str | None, dimension: Dimension) -> Unit:
    """The unit that `text` (without brackets) names; the default of the dimension when it is None.

    Raises UnitError when the unit is unknown or measures something else; the message names the known ones.
    """
    if text is None:
        return DEFAULT_UNIT[dimension]
    spelling = text.strip()
    unit = unit_of(spelling)
    known = ", ".join(symbols(dimension))
    if unit is None and plain(spelling) in AMBIGUOUS:
        raise UnitError(f"read unit '[{spelling}]', which is ambiguous: write {AMBIGUOUS[plain(spelling)]}")
    if unit is None:
        hint = suggestion(spelling.lower(), symbols(dimension))
        near = f" {hint}" if hint.startswith("did") else ""
        raise UnitError(f"read unit '[{spelling}]', which is unknown;{near} units of {dimension.value}: {known}")
    if unit.dimension is not dimension:
        raise UnitError(
            f"read unit '[{spelling}]', which measures {unit.dimension.value}; "
            f"expected a unit of {dimension.value}: {known}"
        )
    return unit


def unit_of(text: str) -> Unit | None:
    """The unit that `text` spells, whatever it measures; None for any other text."""
    return UNITS.get(text) or UNITS.get(spelled_unit(text))
