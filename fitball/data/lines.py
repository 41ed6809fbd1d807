"""Impacts written in a line: one, such as `v=38±1 mph, theta=18 deg, spin=950 rpm top`; a grid of them, such as
`v=10..40 m/s:16, theta=10..60 deg:16, spin=-300..300 rad/s:9`; the window of a map; a range of one quantity, such as
`5:20` or `20:60 mph`. All are items `NAME=VALUE UNIT` of one grammar, of which each use takes what makes sense there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import isfinite, pi

import numpy as np

from fitball.data.columns import COLUMNS, SD_SUFFIX
from fitball.data.kinematics import Uncertain, covariance_matrix, velocity
from fitball.data.numbers import refuse_beyond
from fitball.data.units import Dimension, Unit, parse_unit
from fitball.errors import ParameterError, UnitError, suggestion
from fitball.values import FloatArray, Impacts

# What a quantity may be called; the first name of each is that of the tables.
_NAMES = {
    word: name for name in ("v_1", "theta_1", "v_x1", "v_y1", "omega_1") for word in (name, *COLUMNS[name].short)
}
_SENSES = {"top": 1.0, "topspin": 1.0, "back": -1.0, "backspin": -1.0}
# A point before another belongs to a range: `10..40`.
_SIZE = r"(?:\d+(?:\.(?!\.)\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_VALUE = re.compile(
    rf"(?P<low>[+-]?{_SIZE}) ?(?:(?:±|\+/-|\+-) ?(?P<sd>{_SIZE})|(?:\.\.|:) ?(?P<high>[+-]?{_SIZE}))?"
    r" ?(?:: ?(?P<steps>[0-9]+))? ?(?P<unit>[^:]*?) ?(?:: ?(?P<count>[0-9]+))?"
)
_IMPACT_FORM, _GRID_FORM, _RANGE_FORM = (
    "expected a number and a unit",
    "expected LOW..HIGH UNIT:COUNT, such as theta=10..60 deg:16, or one VALUE UNIT",
    "expected LOW:HIGH, LOW:HIGH:COUNT or one VALUE, with a unit unless it is m/s, deg or rad/s",
)
# Quantities that determine an incident velocity.
VELOCITIES = (("v_1", "theta_1"), ("v_x1", "v_y1"), ("v_y1",))
_STATES = "expected v and theta, or v_x and v_y, or v_y alone for a dropped ball, and spin if there is any"
# Points of a grid that still make a file one can use: some 100 MB.
MOST_POINTS = 1_000_000


@dataclass(frozen=True)
class _Value:
    """One number (`low`), or `low` to `high`, and the stated `sd`, in SI; the `unit` as written; how many points."""

    low: float
    high: float | None
    unit: Unit
    sd: float | None
    count: int | None


@contextmanager
def _quoted(text: str) -> Iterator[None]:
    """What is wrong with a line as ParameterError that begins with the line."""
    try:
        yield
    except (ParameterError, UnitError) as error:
        raise ParameterError(f"{text}: {error}") from None


def _items(text: str, form: str) -> dict[str, tuple[str, str]]:
    """Key and value of the items of a line by the tables' name of the quantity. Raises ParameterError, which says
    what `form` was expected.
    """
    found: dict[str, tuple[str, str]] = {}
    for item in text.split(","):
        # Blanks as one each: patterns try every way to divide a run of them.
        key, _equals, value = (" ".join(part.split()) for part in item.partition("="))
        if not key or not value:
            raise ParameterError(f"read '{item.strip()}', {form}")
        if key not in _NAMES:
            raise ParameterError(f"unknown quantity '{key}': {suggestion(key, _NAMES)}")
        if _NAMES[key] in found:
            raise ParameterError(f"{key} is given twice")
        found[_NAMES[key]] = key, value
    return found


def _value(name: str, text: str, form: str) -> _Value:
    """The value of a quantity. Raises ParameterError for what is none, or beyond all limits, and says what `form`
    was expected; UnitError for its unit.
    """
    matched, dimension, sense = _VALUE.fullmatch(text), COLUMNS[name].dimension, 1.0
    if matched is None or (matched["steps"] and matched["count"]):
        raise ParameterError(f"read '{text}', {form}")
    words = matched["unit"].split()
    if dimension is Dimension.SPIN and words and words[-1].lower() in _SENSES:
        if matched["low"].startswith(("-", "+")):
            raise ParameterError(f"read '{text}', expected either a sign or top/back for the direction of spin")
        sense = _SENSES[words.pop().lower()]
    unit = parse_unit(" ".join(words) or None, dimension)
    numbers = {part: float(matched[part]) for part in ("low", "high", "sd") if matched[part] is not None}
    if not all(map(isfinite, (numbers["low"], numbers.get("high", 0.0)))):
        raise ParameterError(f"read '{text}', expected a finite number")
    low, high, sd = (unit.to_si(numbers[part]) if part in numbers else None for part in ("low", "high", "sd"))
    assert low is not None
    refuse_beyond(name, np.array([low if high is None else high, low]))
    if sd is not None:
        if not (isfinite(sd) and sd > 0.0):
            raise ParameterError(f"read '{text}', expected a positive standard deviation after the sign")
        refuse_beyond(name + SD_SUFFIX, np.array([sd]))
    points = matched["steps"] or matched["count"]
    # Not an integer yet: Python reads none of thousands of digits.
    count = None if points is None else int(min(float(points), 2.0 * MOST_POINTS))
    return _Value(sense * low, None if high is None else sense * high, unit, sd, count)


def _check_state(bounds: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """The quantities that determine the incident velocity. Raises ParameterError for too few, too many or impossible
    ones.
    """
    given = [name for name in bounds if name != "omega_1"]
    names = next((item for item in VELOCITIES if set(item) == set(given)), None)
    if names is None:
        raise ParameterError(f"read {', '.join(sorted(given)) or 'no velocity'}; {_STATES}")
    if "v_1" in names and not bounds["v_1"][0] > 0.0:
        raise ParameterError("expected a positive speed v")
    if "v_y1" in names and not bounds["v_y1"][0] > 0.0:
        raise ParameterError("expected a positive speed v_y towards the court")
    if "theta_1" in names and not 0.0 < bounds["theta_1"][0] <= bounds["theta_1"][1] < pi:
        raise ParameterError("expected an angle theta from the court between 0 and 180 deg")
    return names


def parse_impact(text: str) -> Impacts:
    """One impact as `parse_uncertain_impact` reads it. Raises ParameterError for a stated uncertainty too."""
    impact, covariance = parse_uncertain_impact(text)
    if covariance is not None:
        raise ParameterError(f"impact '{text}': has an uncertainty, which only predict uses: leave it out")
    return impact


def parse_uncertain_impact(text: str) -> tuple[Impacts, FloatArray | None]:
    """One impact from NAME=VALUE UNIT items divided by commas, and its covariance (1, 3, 3) of (v_x1, v_y1, omega_1).

    Names: `v`, `theta`, `v_x`, `v_y`, `spin` or `omega`, or as in tables (`v_x1`, ...). Without a unit a number is in
    m/s, degrees or rad/s. Spin is topspin when positive; `top` or `back` behind the unit says it in words, and
    then the number has no sign. Spin left out is zero. `38±1 mph` (or `38 +/- 1 mph`) states one standard deviation,
    which is propagated to the components to first order; without any the covariance is None. Raises ParameterError
    that quotes the text.
    """
    known = {}
    with _quoted(f"impact '{text}'"):
        for name, (key, written) in _items(text, "expected NAME=VALUE UNIT, such as v=38 mph").items():
            with _quoted(key):
                value = _value(name, written, _IMPACT_FORM)
                if value.high is not None or value.count is not None:
                    raise ParameterError(f"read '{written}', {_IMPACT_FORM}")
            at = np.array([value.low])
            known[name] = Uncertain(at, {} if value.sd is None else {name: np.array([value.sd])})
        _check_state({name: (item.value[0], item.value[0]) for name, item in known.items()})
    nothing, along = Uncertain.exact(np.zeros(1)), velocity(known, "1")
    state = [along.x or nothing, along.y or nothing, known.get("omega_1", nothing)]
    stated = any(item.parts for item in state)
    return Impacts(*(item.value for item in state)), covariance_matrix(state, 1) if stated else None


@dataclass(frozen=True)
class Axis:
    """One axis of a grid by the tables' name: `values` (points,) in SI, rising; `unit` as it was written."""

    name: str
    values: FloatArray
    unit: Unit


def grid_impacts(axes: tuple[Axis, ...], points: FloatArray) -> Impacts:
    """Impacts at `points` (points, axes) in SI."""
    named = {axis.name: points[:, k] for k, axis in enumerate(axes)}
    zeros = np.zeros(len(points))
    spin = named.get("omega_1", zeros)
    if "v_1" in named:
        return Impacts.polar(named["v_1"], named["theta_1"], spin)
    return Impacts(named.get("v_x1", zeros), named["v_y1"], spin)


def parse_grid(text: str) -> tuple[Axis, ...]:
    """The axes that `text` names, velocity first, then spin. Raises ParameterError that quotes the text."""
    found = {}
    with _quoted(f"grid '{text}'"):
        for name, (key, written) in _items(text, _GRID_FORM).items():
            with _quoted(key):
                found[name] = _axis(name, written)
        names = _check_state({name: (axis.values[0], axis.values[-1]) for name, axis in found.items()})
        axes = tuple(found[name] for name in (*names, "omega_1") if name in found)
        size = math.prod(axis.values.size for axis in axes)
        if size > MOST_POINTS:
            raise ParameterError(f"{size:,} points: expected {MOST_POINTS:,} at most")
    return axes


def _axis(name: str, written: str) -> Axis:
    value = _value(name, written, _GRID_FORM)
    if value.sd is not None or (value.high is None) != (value.count is None):
        raise ParameterError(f"read '{written}', {_GRID_FORM}")
    if value.high is None or value.count is None:
        return Axis(name, np.array([value.low]), value.unit)
    if value.count > MOST_POINTS:
        raise ParameterError(f"read '{written}': expected {MOST_POINTS:,} at most")
    if not (value.high > value.low and value.count >= 2):
        raise ParameterError(f"read '{written}', expected an increasing range and at least two points")
    return Axis(name, np.linspace(value.low, value.high, value.count), value.unit)


def parse_window(text: str) -> dict[str, tuple[float, float]]:
    """Low and high of the quantities of a map, by the tables' name in SI, from `v=20, theta=10..80, spin=-300..300`;
    those not named are left out. Raises ParameterError that quotes the text.
    """
    window: dict[str, tuple[float, float]] = {}
    with _quoted(f"map '{text}'"):
        said = ",".join(item for item in text.split(",") if item.strip())
        for name, (key, written) in _items(said, _GRID_FORM).items() if said else ():
            with _quoted(key):
                value = _value(name, written, _GRID_FORM)
            if name not in ("v_1", "theta_1", "omega_1") or value.sd is not None:
                raise ParameterError(f"{key}={written}: expected v (one speed), theta and spin (ranges)")
            high = value.low if value.high is None else value.high
            ranged = value.high is not None
            if ranged == (name == "v_1") or (ranged and high <= value.low) or (value.count and not ranged):
                wanted = "one speed" if name == "v_1" else "an increasing range, such as theta=10..80"
                raise ParameterError(f"{key}={written}: expected {wanted}")
            window[name] = value.low, high
        # Where one of the two is not named, any that can be stands for it.
        _check_state({"v_1": (1.0, 1.0), "theta_1": (0.1, 0.2)} | window)
    return window


def parse_spread(text: str) -> dict[str, tuple[float, float]]:
    """Low and high of the speed, angle and spin of impacts that are drawn, by the tables' name in SI, from
    `v=12..25, theta=16..60, spin=-300..400`; a single value is both. Raises ParameterError that quotes the text.
    """
    spread: dict[str, tuple[float, float]] = {}
    with _quoted(f"'{text}'"):
        for name, (key, written) in _items(text, _GRID_FORM).items():
            with _quoted(key):
                value = _value(name, written, _GRID_FORM)
            high = value.low if value.high is None else value.high
            if name not in ("v_1", "theta_1", "omega_1") or value.sd is not None or value.count or high < value.low:
                raise ParameterError(f"{key}={written}: expected v, theta or spin, an increasing range or a value")
            spread[name] = value.low, high
        _check_state({"v_1": (1.0, 1.0), "theta_1": (0.1, 0.2)} | spread)
    return spread


_QUANTITIES = {"speed": "v_1", "angle": "theta_1", "spin": "omega_1"}


@dataclass(frozen=True)
class Range:
    """`low` to `high` in SI, in so many steps if a `count` was given."""

    low: float
    high: float
    count: int | None = None


def parse_range(quantity: str, text: str) -> Range:
    """The range of a quantity: speed, angle or spin. Numbers without a unit are in m/s, degrees or rad/s.

    Raises ParameterError that quotes the text.
    """
    with _quoted(f"{quantity} '{text}'"):
        value = _value(_QUANTITIES[quantity], " ".join(text.split()), _RANGE_FORM)
        if value.sd is not None:
            raise ParameterError(_RANGE_FORM)
    high = value.low if value.high is None else value.high
    return checked_range(quantity, Range(value.low, high, value.count), f"{quantity} '{text}'")


def checked_range(quantity: str, given: Range, text: str) -> Range:
    """The range, if impacts can have it. Raises ParameterError that begins with the `text`."""
    with _quoted(text):
        if not (isfinite(given.low) and isfinite(given.high)) or given.low > given.high:
            raise ParameterError("expected an increasing range of finite numbers")
        if given.count is not None and (given.count < 2 or given.low == given.high):
            raise ParameterError("expected at least two steps, and LOW below HIGH")
        if quantity == "speed" and not given.low > 0.0:
            raise ParameterError("expected speeds above 0")
        if quantity == "angle" and not 0.0 < given.low <= given.high <= pi / 2.0 * (1.0 + 1e-12):
            raise ParameterError("expected angles from the court above 0 and up to 90 deg")
        refuse_beyond(_QUANTITIES[quantity], np.array([given.low, given.high]))
    return given
