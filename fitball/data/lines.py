"""Impacts written in a line: one, such as `v=38 mph, theta=18 deg, spin=950 rpm top`; a grid of them, such as
`v=10..40 m/s:16, theta=10..60 deg:16, spin=-300..300 rad/s:9`; the window of a map; a range of one quantity, such as
`5:20` or `20:60 mph`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from math import isfinite, pi

import numpy as np

from fitball.data.columns import COLUMNS, SD_SUFFIX
from fitball.data.kinematics import Uncertain, covariance_matrix, velocity
from fitball.data.numbers import refuse_beyond
from fitball.data.units import Dimension, Unit, parse_unit
from fitball.errors import ParameterError, UnitError, suggestion
from fitball.values import FloatArray, Impacts

# What a quantity may be called, and what it measures; the first name of each is that of the tables.
_NAMES = {
    said: (name, COLUMNS[name].dimension)
    for name in ("v_1", "theta_1", "v_x1", "v_y1", "omega_1")
    for said in (name, *COLUMNS[name].said)
}
_SENSES = {"top": 1.0, "topspin": 1.0, "back": -1.0, "backspin": -1.0}
SIZE = r"(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_VALUE = re.compile(rf"^(?P<number>[+-]?{SIZE})\s*(?:(?:±|\+/-|\+-)\s*(?P<sd>{SIZE}))?\s*(?P<rest>.*)$")
_FORM = "expected NAME=VALUE UNIT, such as v=38 mph"
_FORMS = "expected v and theta, or v_x and v_y, or v_y alone for a dropped ball; spin where there is any"


def parse_impact(text: str) -> Impacts:
    """One impact as `parse_uncertain_impact` reads it. Raises ParameterError for a stated uncertainty too."""
    impact, covariance = parse_uncertain_impact(text)
    if covariance is not None:
        raise ParameterError(f"impact '{text}': states an uncertainty, which predictions alone take: leave it out")
    return impact


def parse_uncertain_impact(text: str) -> tuple[Impacts, FloatArray | None]:
    """One impact from NAME=VALUE UNIT items divided by commas, and its covariance (1, 3, 3) of (v_x1, v_y1, omega_1).

    Names: `v`, `theta`, `v_x`, `v_y`, `spin` or `omega`, or as in tables (`v_x1`, ...). Without a unit a number is in
    m/s, degrees or rad/s. Spin is topspin when positive; `top` or `back` behind the unit says it in words, and
    then the number has no sign. Spin left out is zero. `38±1 mph` (or `38 +/- 1 mph`) states one standard deviation,
    which is propagated to the components to first order; without any the covariance is None. Raises ParameterError
    that quotes the text.
    """
    try:
        return _impact(_values(text))
    except (ParameterError, UnitError) as error:
        raise ParameterError(f"impact '{text}': {error}") from None


def _values(text: str) -> dict[str, Uncertain]:
    """Quantities by the tables' names, in SI."""
    quantities: dict[str, Uncertain] = {}
    for item in text.split(","):
        key, value, name, dimension = named_value(item, _FORM)
        if name in quantities:
            raise ParameterError(f"{key} is given twice")
        number, sd = _number(key, value, dimension)
        at = np.array([number])
        refuse_beyond(name, at)
        if sd is not None:
            refuse_beyond(name + SD_SUFFIX, np.array([sd]))
        quantities[name] = Uncertain.exact(at) if sd is None else Uncertain.measured(name, at, np.array([sd]))
    return quantities


def named_value(item: str, form: str) -> tuple[str, str, str, Dimension]:
    """Key and value of an item KEY=VALUE, the tables' name of the quantity, and what it measures. Raises
    ParameterError, which says what `form` was expected.
    """
    # Blanks as one each: patterns try every way to divide a run of them.
    key, _equals, value = (" ".join(part.split()) for part in item.partition("="))
    if not key or not value:
        raise ParameterError(f"read '{item.strip()}', {form}")
    if key not in _NAMES:
        raise ParameterError(f"unknown quantity '{key}': {suggestion(key, _NAMES)}")
    return key, value, *_NAMES[key]


def _number(key: str, text: str, dimension: Dimension) -> tuple[float, float | None]:
    """A quantity and its standard deviation, if one is stated, in SI."""
    matched = _VALUE.match(text)
    if matched is None:
        raise ParameterError(f"{key}: read '{text}', expected a number and a unit")
    number, words = float(matched["number"]), matched["rest"].split()
    if not isfinite(number):
        raise ParameterError(f"{key}: read '{text}', expected a finite number")
    if dimension is Dimension.SPIN and words and words[-1].lower() in _SENSES:
        if matched["number"].startswith(("-", "+")):
            raise ParameterError(f"{key}: read '{text}', expected either a sign or a word for the sense of the spin")
        number *= _SENSES[words.pop().lower()]
    try:
        unit = parse_unit(" ".join(words) or None, dimension)
    except UnitError as error:
        raise UnitError(f"{key}: {error}") from None
    if matched["sd"] is None:
        return unit.to_si(number), None
    sd = float(matched["sd"])
    if not (isfinite(sd) and sd > 0.0):
        raise ParameterError(f"{key}: read '{text}', expected a positive standard deviation behind the sign")
    return unit.to_si(number), unit.to_si(sd)


def _impact(quantities: dict[str, Uncertain]) -> tuple[Impacts, FloatArray | None]:
    """Components from what was given. Raises ParameterError for too little, too much or the impossible."""
    given = frozenset(quantities) - {"omega_1"}
    if given == {"v_1", "theta_1"}:
        if not quantities["v_1"].value[0] > 0.0:
            raise ParameterError("expected a positive speed v")
        if not 0.0 < quantities["theta_1"].value[0] < pi:
            raise ParameterError("expected an angle theta to the court between 0 and 180 deg")
    elif given in ({"v_x1", "v_y1"}, {"v_y1"}):
        if not quantities["v_y1"].value[0] > 0.0:
            raise ParameterError("expected a positive speed v_y towards the court")
    else:
        words = ", ".join(sorted(given)) or "no velocity"
        raise ParameterError(f"read {words}; {_FORMS}")
    nothing = Uncertain.exact(np.zeros(1))
    along = velocity(quantities, "1")
    state = [along.x or nothing, along.y or nothing, quantities.get("omega_1", nothing)]
    known = any(item.parts for item in state)
    return Impacts(*(item.value for item in state)), covariance_matrix(state, 1) if known else None


_NUMBER = rf"[+-]?{SIZE}"
_GRID_RANGE = re.compile(
    rf"^(?P<low>{_NUMBER})\s*\.\.\s*(?P<high>{_NUMBER})\s*(?P<unit>[^:]*?)\s*:\s*(?P<count>[0-9]+)$"
)
_SINGLE = re.compile(rf"^(?P<low>{_NUMBER})\s*(?P<unit>[^:]*?)$")
_GRID_FORM = "expected LOW..HIGH UNIT:COUNT, such as theta=10..60 deg:16, or one VALUE UNIT"
VELOCITIES = (("v_1", "theta_1"), ("v_x1", "v_y1"), ("v_y1",))
# Points of a grid that still make a file one can use: some 100 MB.
MOST_POINTS = 1_000_000


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
    try:
        return _ordered([_axis(part) for part in text.split(",")])
    except (ParameterError, UnitError) as error:
        raise ParameterError(f"grid '{text}': {error}") from None


def _axis(item: str) -> Axis:
    key, value, name, dimension = named_value(item, _GRID_FORM)
    several, single = _GRID_RANGE.match(value), _SINGLE.match(value)
    match = several or single
    if match is None or (several is None and ".." in value):
        raise ParameterError(f"{key}: read '{value}', {_GRID_FORM}")
    unit = parse_unit(match["unit"] or None, dimension)
    low = unit.to_si(float(match["low"]))
    high = low if several is None else unit.to_si(float(several["high"]))
    refuse_beyond(name, np.array([low, high]))
    if several is None:
        return Axis(name, np.array([low]), unit)
    # Not an integer yet: Python reads none of thousands of digits.
    points = float(several["count"])
    if points > MOST_POINTS:
        raise ParameterError(f"{key}: {several['count']} points: expected {MOST_POINTS} at most")
    count = int(points)
    if not (high > low and count >= 2):
        raise ParameterError(f"{key}: read '{value}', expected a rising range and two points or more")
    return Axis(name, np.linspace(low, high, count), unit)


def _ordered(listed: list[Axis]) -> tuple[Axis, ...]:
    found = {axis.name: axis for axis in listed}
    if len(found) < len(listed):
        raise ParameterError("a quantity is given twice")
    given = [name for name in found if name != "omega_1"]
    names = next((item for item in VELOCITIES if set(item) == set(given)), None)
    if names is None:
        raise ParameterError("expected v and theta, or v_x and v_y, or v_y alone; spin where there is any")
    axes = tuple(found[name] for name in (*names, "omega_1") if name in found)
    bounds = {axis.name: (float(axis.values[0]), float(axis.values[-1])) for axis in axes}
    for name in ("v_1", "v_y1"):
        if name in bounds and not bounds[name][0] > 0.0:
            raise ParameterError(f"{name}: expected speeds above 0")
    if "theta_1" in bounds and not 0.0 < bounds["theta_1"][0] <= bounds["theta_1"][1] < pi:
        raise ParameterError("theta: expected angles to the court between 0 and 180 deg")
    size = math.prod(axis.values.size for axis in axes)
    if size > MOST_POINTS:
        raise ParameterError(f"{size} points: expected {MOST_POINTS} at most")
    return axes


def parse_window(text: str) -> dict[str, tuple[float, float]]:
    """Low and high of the quantities of a map, by the tables' name in SI, from `v=20, theta=10..80, spin=-300..300`;
    those not named are left out. Raises ParameterError that quotes the text.
    """
    window: dict[str, tuple[float, float]] = {}
    for item in filter(None, (part.strip() for part in text.split(","))):
        try:
            # Of a range the ends count, not the points between them.
            axis = _axis(f"{item}:2" if ".." in item and ":" not in item else item)
        except (ParameterError, UnitError) as error:
            raise ParameterError(f"map '{text}': {error}") from None
        low, high = float(axis.values[0]), float(axis.values[-1])
        if axis.name in window:
            raise ParameterError(f"map '{text}': {axis.name} is given twice")
        if axis.name not in ("v_1", "theta_1", "omega_1"):
            raise ParameterError(f"map '{text}': {item}: expected v (one speed), theta and spin (ranges)")
        if (axis.name == "v_1") != (low == high):
            wanted = "one speed" if axis.name == "v_1" else "a range such as theta=10..80"
            raise ParameterError(f"map '{text}': {item}: expected {wanted}")
        window[axis.name] = (low, high)
    if "v_1" in window and not window["v_1"][0] > 0.0:
        raise ParameterError(f"map '{text}': expected a speed above 0")
    low, high = window.get("theta_1", (0.1, 0.2))
    if not 0.0 < low < high < pi:
        raise ParameterError(f"map '{text}': expected angles to the court between 0 and 180 deg")
    return window


_NUMBER = rf"[+-]?{SIZE}"
_RANGE = re.compile(
    rf"^\s*(?P<low>{_NUMBER})\s*(?::\s*(?P<high>{_NUMBER}))?\s*(?::\s*(?P<count>\d{{1,3}}))?\s*(?P<unit>[^:]*?)\s*$"
)
FORM = "expected LOW:HIGH, LOW:HIGH:COUNT or one VALUE, with a unit behind it if it is not the usual one"
QUANTITIES = {
    "speed": ("v_1", Dimension.SPEED), "angle": ("theta_1", Dimension.ANGLE), "spin": ("omega_1", Dimension.SPIN),
}  # fmt: skip


@dataclass(frozen=True)
class Range:
    """`low` to `high` in SI, in so many steps if a `count` was given."""

    low: float
    high: float
    count: int | None = None


def parse_range(quantity: str, text: str) -> Range:
    """The range of a quantity, one of `QUANTITIES`. Numbers without a unit are in m/s, degrees or rad/s.

    Raises ParameterError that quotes the text.
    """
    matched = _RANGE.match(" ".join(text.split()))
    if matched is None:
        raise ParameterError(f"{quantity} '{text}': {FORM}")
    try:
        unit = parse_unit(matched["unit"] or None, QUANTITIES[quantity][1])
    except UnitError as error:
        raise ParameterError(f"{quantity} '{text}': {error}") from None
    low = unit.to_si(float(matched["low"]))
    high = low if matched["high"] is None else unit.to_si(float(matched["high"]))
    count = None if matched["count"] is None else int(matched["count"])
    return checked_range(quantity, Range(low, high, count), f"{quantity} '{text}'")


def checked_range(quantity: str, given: Range, said: str) -> Range:
    """The range, if impacts can have it. Raises ParameterError that begins with what was `said`."""
    if not (isfinite(given.low) and isfinite(given.high)) or given.low > given.high:
        raise ParameterError(f"{said}: expected a range of finite numbers that rises")
    if given.count is not None and (given.count < 2 or given.low == given.high):
        raise ParameterError(f"{said}: expected two steps or more, from LOW to a HIGH above it")
    if quantity == "speed" and not given.low > 0.0:
        raise ParameterError(f"{said}: expected speeds above 0")
    if quantity == "angle" and not 0.0 < given.low <= given.high <= pi / 2.0 * (1.0 + 1e-12):
        raise ParameterError(f"{said}: expected angles to the court above 0 and up to 90 deg")
    try:
        refuse_beyond(QUANTITIES[quantity][0], np.array([given.low, given.high]))
    except ParameterError as error:
        raise ParameterError(f"{said}: {error}") from None
    return given
