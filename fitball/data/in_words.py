"""Impacts, ranges, sensors in words: `v_1=17, theta_1=10..40:7, omega_1=100±5 rpm`."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, prod
from typing import Annotated, NoReturn

import numpy as np

from fitball.base.air import landing_speed
from fitball.base.columns import COLUMNS, STATE
from fitball.base.errors import ParameterError, suggestion
from fitball.base.text import listed, one_line
from fitball.base.units import assumed_symbol, factor_of
from fitball.base.values import FloatArray, Impacts
from fitball.data.kinematics import AnalyticColumns, propagate, state

# A point before another belongs to a range: `10..40`. Blanks are single ones by then.
_NUMBER = r"[+-]?(?:\d+(?:\.(?!\.)\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
# `17`, `10..40`, with `±0.5`, a unit and `:7`.
_SPAN = re.compile(
    rf"(?P<low>{_NUMBER}) ?(?:\.\. ?(?P<high>{_NUMBER}) ?)?(?:(?:±|\+/?-) ?(?P<sd>{_NUMBER}) ?)?"
    r"(?P<unit>[^:]*?) ?(?:: ?(?P<count>[0-9]{1,9}))?",
    re.ASCII,
)
# Forms that a span may have, by an example each.
_FORMS = {
    "value": "17 m/s",
    "sd": "17±0.5 m/s",
    "range": "10..40 m/s",
    "count": "10..40 m/s:7",
    "error": "0.5 m/s",
}
# Columns that make an incident velocity; spin may be added.
_STATES = ({"v_1", "theta_1"}, {"v_x1", "v_y1"}, {"v_y1"}, {"drop_height"})
# Most points of a grid: some 100 MB.
_MOST_POINTS = 1_000_000


@dataclass(frozen=True)
class Span:
    """A number (`low` = `high`), or a range of `count` points, with an `sd`; SI."""

    low: float
    high: float
    sd: float = 0.0
    count: int = 1


def spans(text: str, takes: str) -> dict[str, Span]:
    """The spans of a text by column; units are as in tables. `takes` says which of value, sd, range
    and count a span may have, or `error`, an sd of the column.

    All of --impact, --speed, --angle, --spin, --sensor and --at are read by this function.

    Raises:
        ParameterError: The text is not of this form, or names no column (`impact`).
    """
    by_column: dict[str, Span] = {}
    for column_text in text.split(","):
        name, _, written = (" ".join(side.split()) for side in column_text.partition("="))
        form = _form(name if written else "v_1", takes)
        if not name or not written:
            _fail(text, f"read '{one_line(column_text.strip())}'; expected {form}")
        if name not in COLUMNS:
            _fail(text, f"unknown column '{one_line(name)}'; {suggestion(name, COLUMNS)}")
        if name in by_column:
            _fail(text, f"{name} is given twice; give it once")
        try:
            by_column[name] = _span(name, written, takes, form)
        except ParameterError as error:
            _fail(text, f"{name}: {one_line(str(error), 400)}")
    return by_column


def _form(name: str, takes: str) -> str:
    """What a span of a column looks like, by examples of the forms that it may have."""
    unit = assumed_symbol(COLUMNS[name].unit) if name in COLUMNS else "m/s"
    examples = [f"{name}={_FORMS[form].replace('m/s', unit)}" for form in takes.split()]
    return listed(examples, last="or")


def _span(name: str, written: str, takes: str, form: str) -> Span:
    """The span that is written for a column. Raises ParameterError."""
    column = COLUMNS[name]
    matched = _SPAN.fullmatch(written)
    if matched is None:
        raise _refusal(written, form)
    parts = {group: text for group, text in matched.groupdict().items() if text}
    is_error = takes == "error"
    used = {"sd", "count"} & parts.keys()
    if "high" in parts:
        used.add("range")
    else:
        used.add("error" if is_error else "value")
    if not used <= {*takes.split()} or {"value", "count"} <= used:
        raise _refusal(written, form)
    factor = factor_of(parts.get("unit"), column.unit)
    low = float(parts["low"]) * factor
    high = float(parts["high"]) * factor if "high" in parts else low
    if is_error:
        if not 0.0 < low < inf:
            raise _refusal(written, "a positive standard deviation")
    else:
        for end in (low, high):
            if not column.limits[0] <= end <= column.limits[1]:
                least, most = (f"{limit / factor:.6g}" for limit in column.limits)
                unit = parts.get("unit", assumed_symbol(column.unit))
                raise _refusal(written, f"{least} to {most} {unit}")
    count = int(parts.get("count", "1"))
    if ("high" in parts and high <= low) or ("count" in used and count < 2):
        raise _refusal(written, "a rising range of at least two points")
    sd = 0.0
    if "sd" in parts:
        sd = float(parts["sd"]) * factor
        if not 0.0 < sd < inf:
            raise _refusal(written, "a positive standard deviation")
    return Span(low, high, sd, count)


def _refusal(written: str, expected: str) -> ParameterError:
    """The error of a text that is no span."""
    return ParameterError(f"read '{one_line(written)}'; expected {expected}", "impact")


def impact_grid(
    by_column: Mapping[str, Span],
    braking: float,
) -> tuple[Impacts, Annotated[FloatArray, "impacts 3 3"] | None]:
    """The grid (impacts,) that spans name, and the covariance of its states in SI, or None. Balls
    of a drop height fall through air with a `braking` [1/m] (`heights.usual_braking`).

    Raises:
        ParameterError: the spans are no impacts (`impact`).
    """
    names = {*by_column} - {"omega_1"}
    text = ", ".join(by_column)
    if names not in _STATES:
        _fail(
            text,
            "expected v_1 and theta_1, or v_x1 and v_y1, or v_y1 or drop_height alone, and omega_1 "
            "if the ball spins",
        )
    order: tuple[str, ...] = STATE
    if "v_1" in names:
        order = ("v_1", "theta_1", "omega_1")
    elif "drop_height" in names:
        order = ("drop_height", "omega_1")
    axes = [by_column.get(name, Span(0.0, 0.0)) for name in order]
    if any(axis.low < axis.high and axis.count < 2 for axis in axes):
        _fail(text, "a range has no number of points; expected LOW..HIGH UNIT:COUNT")
    points = prod(axis.count for axis in axes)
    if points > _MOST_POINTS:
        _fail(text, f"{points:,} impacts; expected at most {_MOST_POINTS:,}")
    coordinates = [np.linspace(axis.low, axis.high, axis.count) for axis in axes]
    grid = np.meshgrid(*coordinates, indexing="ij")
    columns = dict(zip(order, (axis.ravel() for axis in grid), strict=True))
    stated = np.diag([axis.sd**2 for axis in axes])

    def states_of(moved: AnalyticColumns) -> AnalyticColumns:
        fallen = dict(moved)
        if "drop_height" in fallen:
            fallen["v_y1"] = landing_speed(fallen.pop("drop_height"), braking)
        return state(fallen, points)

    states, covariance = propagate(states_of, columns, stated)
    return Impacts(*states.values()), covariance if stated.any() else None


def _fail(text: str, message: str) -> NoReturn:
    """Refuse a text. Raises ParameterError (`impact`)."""
    raise ParameterError(f"'{one_line(text)}': {message}", "impact")
