"""A camera written in a line, such as `fps=1000, noise=1mm, view=0.8m, mark=2`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import isfinite

from fitball.data.units import Dimension, parse_unit
from fitball.errors import ParameterError, UnitError, suggestion
from fitball.tracks.simulate import Film

# By name in a line: the field of a film, and what its unit measures (None: a number).
KEYS: Mapping[str, tuple[str, Dimension | None]] = {
    "fps": ("fps", None),
    "noise": ("noise", Dimension.LENGTH),
    "angle": ("angle_noise", Dimension.ANGLE),
    "view": ("width", Dimension.LENGTH),
    "height": ("height", Dimension.LENGTH),
    "mark": ("fold", None),
    "outliers": ("outliers", None),
    "lost": ("lost", None),
    "repeated": ("repeated", None),
    "slow": ("slow", None),
    "radius": ("radius_noise", Dimension.LENGTH),
    "jitter": ("jitter", Dimension.TIME),
    "scale": ("scale", None),
    "clock": ("clock", None),
    "tilt": ("tilt", Dimension.ANGLE),
    "court": ("court_height", Dimension.LENGTH),
}
NO_MARK = "none"
EXPECTED = "expected NAME=VALUE, separated by commas, such as fps=1000, noise=1mm, view=0.8m"
_NUMBER = re.compile(r"(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(?P<unit>.*)")


def parse_film(text: str) -> Film:
    """The film of a line; what is not named has the default. Raises ParameterError that quotes the text."""
    given: dict[str, float | int | None] = {}
    for item in text.split(","):
        name, equals, value = (part.strip() for part in item.partition("="))
        if not equals or not name or not value:
            raise ParameterError(f"camera '{text}': read '{item.strip()}', {EXPECTED}")
        if name not in KEYS:
            raise ParameterError(f"camera '{text}': unknown name '{name}': {suggestion(name, KEYS)}")
        field, dimension = KEYS[name]
        if field in given:
            raise ParameterError(f"camera '{text}': {name} is given twice")
        if field == "fold":
            given[field] = _fold(text, value)
            continue
        matched = _NUMBER.fullmatch(value)
        if matched is None or (dimension is None and matched["unit"]):
            what = "a number" if dimension is None else f"a number with a unit of {dimension.value}"
            raise ParameterError(f"camera '{text}': {name}={value}: expected {what}")
        number = float(matched["number"])
        if dimension is not None:
            if not matched["unit"]:
                raise ParameterError(f"camera '{text}': {name}={value}: expected a unit of {dimension.value}")
            try:
                number = float(parse_unit(matched["unit"], dimension).to_si(number))
            except UnitError as error:
                raise ParameterError(f"camera '{text}': {name}={value}: {error}") from None
        if not isfinite(number):
            raise ParameterError(f"camera '{text}': {name}={value}: expected a finite number")
        given[field] = number
    try:
        return Film(**given)  # type: ignore[arg-type]
    except ParameterError as error:
        raise ParameterError(f"camera '{text}': {error}") from None


def _fold(text: str, value: str) -> int | None:
    if value == NO_MARK:
        return None
    if not value.isdecimal() or len(value) > 2:
        raise ParameterError(f"camera '{text}': mark={value}: expected 1 (a dot), 2 (a stripe) or none")
    return int(value)
