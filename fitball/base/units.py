"""Units as people spell them: exact factors, ambiguity refused with the remedy.

A small grammar, `A`, `A/B`, `A B^-1` or `A per B`, over words of length, time, angle and turns.
What is not in the list of units stays unknown, however it is spelled.
"""

import re
from collections.abc import Mapping
from functools import lru_cache
from math import pi

from fitball.base.errors import ParameterError, suggestion
from fitball.base.text import one_line

# One `symbol` is `numerator / denominator` of the SI unit that begins its line: the exact
# definitions of the international mile, foot, inch and nautical mile, 180 degrees = pi radians.
_UNITS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "m/s": {
        "m/s": (1, 1),
        "cm/s": (1, 100),
        "mm/s": (1, 1000),
        "km/h": (5, 18),
        "mph": (1397, 3125),
        "ft/s": (381, 1250),
        "in/s": (127, 5000),
        "kn": (463, 900),
    },
    "rad/s": {"rad/s": (1, 1), "deg/s": (pi, 180), "rev/s": (2 * pi, 1), "rpm": (pi, 30)},
    "rad": {"deg": (pi, 180), "rad": (1, 1), "mrad": (1, 1000)},
    "s": {"s": (1, 1), "ms": (1, 1000), "us": (1, 1_000_000), "ns": (1, 1_000_000_000)},
    "m": {"m": (1, 1), "cm": (1, 100), "mm": (1, 1000), "in": (127, 5000), "ft": (381, 1250)},
    "": {"": (1, 1), "1": (1, 1), "-": (1, 1), "%": (1, 100)},
}
# Of ratios nothing is here: 1 and - are units only in a column that is known to be one.
_SI = {symbol: si for si, units in _UNITS.items() for symbol in units if si}
_MEASURES = {
    "m/s": "a speed",
    "rad/s": "a spin",
    "rad": "an angle",
    "s": "a time",
    "m": "a length",
    "": "a ratio",
}


def _by_word(words_of: Mapping[str, str]) -> dict[str, str]:
    """The symbol of each word, from the words of each symbol, separated by blanks."""
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
        "ns": "ns nsec nanosecond nanoseconds",
        "min": "min mins minute minutes",
        "h": "h hr hrs hour hours std",
        "rad": "rad rads radian radians",
        "mrad": "mrad milliradian milliradians",
        "deg": "deg degs degree degrees ° º",
        "rev": "rev revs revolution revolutions turn turns rot rotation rotations u umdr "
        "umdrehungen",
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
# Spellings that mean two things, and what to write. `kn` as it stands is the knot, in capitals it
# may be a force.
_AMBIGUOUS = {
    "1/s": "rad/s or rev/s",
    "s^-1": "rad/s or rev/s",
    "grad": "deg (a gradian is 0.9 deg)",
    "gon": "deg (a gon is 0.9 deg)",
    "kn": "kn for knots",
}
# Letters of a unit in a message: any unit is shorter, a cell of a file may be of any length.
_LONGEST_UNIT = 40


def _plain(text: str) -> str:
    """A spelling without what makes no difference: case, blanks, kinds of dots, minus and power
    signs.
    """
    folded = text.strip().casefold().translate(str.maketrans("⁻⁺¹²−–⁄∕", "-+12--//"))
    folded = re.sub(r"\bper\b", "/", folded.replace("**", "^"))
    folded = re.sub(r"[·⋅*.\u00a0_\s]+", " ", folded).strip()
    folded = re.sub(r" ?/ ?", "/", folded)
    return re.sub(r"(?<=[a-z]) ?\^? ?\(?-1\)?$", "^-1", folded)


@lru_cache(10_000)
def symbol_of(text: str) -> str | None:
    """The symbol of the unit that a text spells, `m/s` of `metres per second`; None for any other
    text.
    """
    if text in _SI:
        return text
    spelling = _plain(text)
    symbol = _WHOLE.get(spelling) or _WORDS.get(spelling)
    if symbol is None:
        quotient = re.fullmatch(r"([^/ ]+)/([^/ ]+)", spelling) or re.fullmatch(
            r"(\S+) (\S+)\^-1",
            spelling,
        )
        if quotient is None:
            return None
        above, below = (_WORDS.get(word, "?") for word in quotient.groups())
        symbol = _WHOLE.get(f"{above}/{below}", f"{above}/{below}")
    return symbol if symbol in _SI else None


def assumed_symbol(si: str) -> str:
    """The unit of what states none: degrees of angles, else `si`."""
    return next(iter(_UNITS[si]))


def symbol_within(unit: str, si: str) -> str | None:
    """The symbol of a spelling among the units of `si`, which may be a ratio (empty); of another
    unit its own symbol, None for any other text.
    """
    text = unit.strip()
    return text if text in _UNITS[si] else symbol_of(text)


def factor_of(unit: str | None, si: str) -> float:
    """The factor to `si` (m/s, rad/s, rad, s, m, empty: a ratio), rounded once from the exact
    fraction; without a unit (None) angles are in degrees and all else is in SI.

    Raises:
        ParameterError: the unit is unknown (`unknown-unit`), may be two (`ambiguous-unit`), or
            measures another quantity (`other-quantity`).
    """
    units = _UNITS[si]
    symbol = assumed_symbol(si) if unit is None else symbol_within(unit, si)
    if symbol is not None and symbol in units:
        above, below = units[symbol]
        return above / below
    spelled = one_line(unit or "", _LONGEST_UNIT)
    read = f"read unit '[{spelled}]'"
    choices = f"units of {_MEASURES[si]}: {', '.join(filter(None, units))}"
    if symbol is not None:
        words = f"{read}, which measures {_MEASURES[_SI[symbol]]}; expected one of the {choices}"
        raise ParameterError(words, "other-quantity")
    meant = _AMBIGUOUS.get(_plain(spelled))
    if meant:
        raise ParameterError(f"{read}, which is ambiguous: write {meant}", "ambiguous-unit")
    near = suggestion(spelled.lower(), units)
    hint = f" {near}" if near.startswith("did") else ""
    raise ParameterError(f"{read}, which is unknown;{hint} {choices}", "unknown-unit")
