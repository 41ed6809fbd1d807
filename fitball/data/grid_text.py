"""A grid of impacts written in a line, such as `v=10..40 m/s:16, theta=10..60 deg:16, spin=-300..300 rad/s:9`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from math import pi

import numpy as np

from fitball.data.impact_text import SIZE, named_value
from fitball.data.limits import refuse_beyond
from fitball.data.units import Unit, parse_unit
from fitball.errors import ParameterError, UnitError
from fitball.values import FloatArray, Impacts

_NUMBER = rf"[+-]?{SIZE}"
_RANGE = re.compile(rf"^(?P<low>{_NUMBER})\s*\.\.\s*(?P<high>{_NUMBER})\s*(?P<unit>[^:]*?)\s*:\s*(?P<count>[0-9]+)$")
_SINGLE = re.compile(rf"^(?P<low>{_NUMBER})\s*(?P<unit>[^:]*?)$")
_FORM = "expected LOW..HIGH UNIT:COUNT, such as theta=10..60 deg:16, or one VALUE UNIT"
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
    if "v_1" in named:
        v_x, v_y = named["v_1"] * np.cos(named["theta_1"]), named["v_1"] * np.sin(named["theta_1"])
    else:
        v_x, v_y = named.get("v_x1", zeros), named["v_y1"]
    return Impacts(v_x, v_y, named.get("omega_1", zeros))


def parse_grid(text: str) -> tuple[Axis, ...]:
    """The axes that `text` names, velocity first, then spin. Raises ParameterError that quotes the text."""
    try:
        return _ordered([_axis(part) for part in text.split(",")])
    except (ParameterError, UnitError) as error:
        raise ParameterError(f"grid '{text}': {error}") from None


def _axis(item: str) -> Axis:
    key, value, name, dimension = named_value(item, _FORM)
    several, single = _RANGE.match(value), _SINGLE.match(value)
    match = several or single
    if match is None or (several is None and ".." in value):
        raise ParameterError(f"{key}: read '{value}', {_FORM}")
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
