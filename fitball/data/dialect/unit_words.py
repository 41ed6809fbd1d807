"""The spellings of units: `m s^-1`, `MPH`, `degrees per second` and their like as the symbols of `data.units`.

A small grammar, `A`, `A/B`, `A B^-1` or `A per B`, over words of length, time, angle and turns. Which symbols there
are, and what they are worth, `data.units` alone says: what it does not list stays unknown, however it is spelled.
"""

from __future__ import annotations

import re
from collections.abc import Mapping


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
    "grad": "deg, or gradians, which are not known",
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
