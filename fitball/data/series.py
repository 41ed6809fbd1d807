"""Successive bounces of one ball, a row a bounce: each bounce has the flight before and after it.

Sounds of bounces have times, or intervals from each bounce to the next; a ruler or film shows the
greatest height after each bounce, the drop height as bounce 0. The error of a time is shared by the
intervals before and after it, so these are correlated by -1/2 where all times are known as well.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.columns import COLUMNS, SERIES
from fitball.base.text import listed
from fitball.base.values import FloatArray, IntArray
from fitball.data.cells import TableCells
from fitball.data.heights import flights_of_drops
from fitball.data.kinematics import Columns
from fitball.data.labels import role_of

# What people call columns, by what these say: the number of a bounce in its series, a number of a
# bounce or of a row of the table, the series that a bounce belongs to.
_NAMES = {
    "bounce": "bounce bounces bouncenumber bounceno bouncenr bounce# bouncecount bouncenum "
    "bounceindex bounceid bouncen nbounce impact impactnumber impactno impactnr impact# peak "
    "peaknumber peakno hit hitnumber hitno n aufprall aufprallnr rebond",
    "count": "id no nr # number num index i k count",
    "run": "run runs runno runnumber runid trial trials trialno trialnumber drop dropno dropnumber "
    "dropid series serie experiment exp recording record file track rep repeat repetition "
    "replicate test testno testnumber throw set versuch durchgang messung essai lauf reihe",
}
_NAMED = {kind: frozenset(names.split()) for kind, names in _NAMES.items()}
# What each column of a bounce says of the flights before and after it.
_FLIGHTS: Mapping[str, tuple[str, str]] = {
    "bounce_time": ("flight_time_1", "flight_time_2"),
    "bounce_interval": ("flight_time_1", "flight_time_2"),
    "peak_height": ("drop_height", "rebound_height"),
}
# Incident columns beside which a row is a bounce of its own.
_OWN_INCIDENTS = ("v_y1", "drop_height", "flight_time_1")
# The correlation of neighbouring intervals between times of equal errors.
_SHARED_TIME = -0.5
# The number of a bounce.
_WHOLE = re.compile(r"\s*\+?[0-9]{1,6}(?:\.0*)?\s*")
# The index of a bounce that is not there.
_NONE = -1


class Bounces(NamedTuple):
    """Columns (rows,) in SI with the flights of each bounce, and correlations of their errors by
    pair.
    """

    columns: dict[str, FloatArray]
    corr: dict[str, FloatArray]


class _Series(NamedTuple):
    """By row (rows,) the number of its bounce, NaN where none is stated, and the index of the
    bounce before it, -1 where there is none.
    """

    number: Annotated[FloatArray, "rows"]
    before: Annotated[IntArray, "rows"]


def single_bounces(
    cells: TableCells,
    labels: Mapping[str, int],
    columns: Columns,
    braking: float,
) -> Bounces:
    """The columns with the flights before and after each bounce in place of a series; `labels` are
    places of columns of text among the cells, `braking` [1/m] is that of the ball. A note says how
    many bounces of how many series have both. Faults: `two-series`, `bounce-order`,
    `bounce-number`, `out-of-limits`.
    """
    present = [name for name in SERIES if name in columns]
    rest = dict(columns)
    for name in present:
        rest = _without(rest, name)
    if not present:
        return Bounces(rest, {})
    name = present[0]
    if len(present) > 1:
        words = f"{listed(present)} say the same; keep one of them (--ignore {present[1]})"
        cells.fault("two-series", words, present[1])
    values = columns[name]
    sds = columns.get(f"{name}_sd")
    not_stated = np.full(len(values), np.nan)
    series = _series(cells, labels, name, values, rest.get("drop_height", not_stated))
    own = [incident for incident in _OWN_INCIDENTS if incident in rest]
    in_columns = len({*cells.rows.tolist()}) < len(cells.rows)
    if own and not in_columns and _are_single(series, values, rest[own[0]]):
        return Bounces({**rest, **_after(name, values, sds)}, {})
    corr = dict[str, FloatArray]()
    if name == "peak_height":
        flights = _heights(series, values, sds, rest)
    else:
        flights, corr = _times(name, series, values, sds)
        if "drop_height" in rest:
            corr = _put_drops(flights, corr, series, rest, braking)
            cells.note("series", "drop_height: the first bounce of each series falls from it")
    if name == "bounce_time":
        _check_intervals(cells, flights)
    for incident in own:
        if incident not in ("drop_height", *flights):
            words = f"{incident} is not used: {name} says how fast each bounce came"
            cells.note("not-read", words)
        rest = _without(rest, incident)
    _note(cells, name, series, values, flights)
    return Bounces({**rest, **flights}, corr)


def _without(columns: Columns, name: str) -> dict[str, FloatArray]:
    """The columns without this one and its sds."""
    return {other: values for other, values in columns.items() if other.removesuffix("_sd") != name}


def _are_single(series: _Series, values: FloatArray, incident: FloatArray) -> bool:
    """Whether each row is a bounce of its own, with its `incident` speed or height (rows,): no row
    is a second bounce.
    """
    measured = np.isfinite(values)
    numbers = series.number[measured]
    counted = np.isfinite(numbers)
    if counted.any():
        return bool(np.all(numbers[counted] == numbers[counted][0]))
    return bool(np.isfinite(incident[measured]).all())


def _after(name: str, values: FloatArray, sds: FloatArray | None) -> dict[str, FloatArray]:
    """What follows a bounce of its own: its interval or peak is that after it. Times of single
    bounces say nothing.
    """
    if name == "bounce_time":
        return {}
    after = _FLIGHTS[name][1]
    return {after: values} if sds is None else {after: values, f"{after}_sd": sds}


def _heights(
    series: _Series,
    values: FloatArray,
    sds: FloatArray | None,
    rest: Columns,
) -> dict[str, FloatArray]:
    """Drop and rebound heights of each bounce: its drop is from the peak before it, or from the
    `drop_height` in `rest`, where a series begins with bounce 1.
    """
    drops = _at(values, series.before)
    first = rest.get("drop_height", np.full(len(values), np.nan))
    heights = {"drop_height": np.where(series.before == _NONE, first, drops)}
    heights["rebound_height"] = values
    if sds is not None:
        first_sds = rest.get("drop_height_sd", sds)
        heights["drop_height_sd"] = np.where(
            series.before == _NONE, first_sds, _at(sds, series.before)
        )
        heights["rebound_height_sd"] = sds
    return heights


def _times(
    name: str,
    series: _Series,
    values: FloatArray,
    sds: FloatArray | None,
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Times of the flights before and after each bounce, and the correlation of their errors:
    neighbouring intervals share the time of the bounce between them.
    """
    before, after = _FLIGHTS[name]
    if name == "bounce_interval":
        flights = {before: _at(values, series.before), after: values}
        if sds is None:
            return flights, {}
        flights[f"{before}_sd"] = _at(sds, series.before)
        flights[f"{after}_sd"] = sds
        return flights, {"v_y1,v_y2": np.full(len(values), _SHARED_TIME)}
    following = _following(series.before)
    flights = {
        before: values - _at(values, series.before),
        after: _at(values, following) - values,
    }
    if sds is None:
        return flights, {}
    flights[f"{before}_sd"] = np.hypot(sds, _at(sds, series.before))
    flights[f"{after}_sd"] = np.hypot(sds, _at(sds, following))
    both = flights[f"{before}_sd"] * flights[f"{after}_sd"]
    return flights, {"v_y1,v_y2": np.nan_to_num(-(sds**2) / both)}


def _put_drops(
    flights: dict[str, FloatArray],
    corr: Columns,
    series: _Series,
    rest: Columns,
    braking: float,
) -> dict[str, FloatArray]:
    """Put the flight that lands as fast as the drop before the first bounce of each series, and
    return the correlations without those of its error, which no interval shares.
    """
    before = "flight_time_1"
    first = (series.before == _NONE) & ~(series.number > 1.0) & np.isfinite(rest["drop_height"])
    drops = flights_of_drops(np.abs(rest["drop_height"]), braking)
    flights[before] = np.where(first, drops.time, flights[before])
    not_stated = np.full(len(first), np.nan)
    sds = flights.get(f"{before}_sd", not_stated)
    sds = np.where(first, drops.slope * rest.get("drop_height_sd", not_stated), sds)
    if np.isfinite(sds).any():
        flights[f"{before}_sd"] = sds
    return {pair: np.where(first, 0.0, shared) for pair, shared in corr.items()}


def _at(values: FloatArray, rows: IntArray) -> FloatArray:
    """The values (rows,) of other rows, NaN for none."""
    return np.where(rows == _NONE, np.nan, values[rows])


def _following(before: IntArray) -> IntArray:
    """By row the row of which it is the bounce before."""
    following = np.full(len(before), _NONE)
    rows = np.flatnonzero(before != _NONE)
    following[before[rows]] = rows
    return following


def _check_intervals(cells: TableCells, flights: Columns) -> None:
    """Add faults of times whose intervals are none of a ball that bounces."""
    interval = flights["flight_time_1"]
    low, high = COLUMNS["flight_time_1"].limits
    for row in np.flatnonzero((interval < low) | (interval > high)).tolist():
        words = (
            f"{interval[row]:.4g} s after the bounce before; expected {low:g} to {high:g} s: check "
            "the unit"
        )
        cells.fault("out-of-limits", words, "bounce_time", row)
        for column in flights.values():
            column[row] = np.nan


def _note(
    cells: TableCells,
    name: str,
    series: _Series,
    values: FloatArray,
    flights: Columns,
) -> None:
    """Note how many bounces have a flight before and after them."""
    before, after = _FLIGHTS[name]
    count = int(np.sum(np.isfinite(flights[before]) & np.isfinite(flights[after])))
    measured = np.isfinite(values)
    starts = int(np.sum(measured & (series.before == _NONE)))
    what = {"bounce_time": "times", "bounce_interval": "intervals"}.get(name, "heights")
    runs = "one series" if starts == 1 else f"{starts} series"
    words = (
        f"{name}: {int(measured.sum())} {what} of {runs} are {count} impacts, each between two "
        "flights"
    )
    cells.note("series", words)


# ---- which bounce is before which


def _series(
    cells: TableCells,
    labels: Mapping[str, int],
    name: str,
    values: FloatArray,
    drops: FloatArray,
) -> _Series:
    """The numbers and neighbours of bounces, by their labels, numbers, and order. Of bounces that
    are not numbered one with a drop height (rows,) of its own is the first.
    """
    column, number = _numbers_of_bounces(cells, labels)
    before = np.full(len(values), _NONE)
    for rows in _rows_of_runs(cells, labels):
        measured = [row for row in rows if np.isfinite(values[row])]
        numbers = number[measured]
        pairs = [*zip(measured[1:], measured, strict=False)]
        if np.isfinite(numbers).all():
            pairs = [*_by_number(cells, measured, numbers)]
        for row, earlier in pairs:
            # Where rows are counted, or nothing is, the values show where a series begins.
            dropped_anew = np.isfinite(drops[row]) and drops[row] != drops[earlier]
            continues = _continues(name, values[row], values[earlier]) and not dropped_anew
            if column in _NAMED["bounce"] or continues:
                before[row] = earlier
    return _Series(number, before)


def _numbers_of_bounces(cells: TableCells, labels: Mapping[str, int]) -> tuple[str, FloatArray]:
    """What the column is called that counts, empty where there is none, and the number of each
    row's bounce (rows,), NaN where none is stated. Faults: `bounce-number`.
    """
    none = np.full(len(cells.rows), np.nan)
    by_name = {_bare(label): label for label in labels}
    for name in [name for kind in ("bounce", "count") for name in by_name if name in _NAMED[kind]]:
        texts = cells.text(labels[by_name[name]])
        readable = [bool(_WHOLE.fullmatch(text)) for text in texts]
        if all(readable) and texts:
            return name, np.array([float(text) for text in texts])
        if name in _NAMED["bounce"] and any(readable):
            row = readable.index(False)
            words = f"read '{texts[row]}'; expected the number of the bounce: 1, 2, 3 and so on"
            cells.fault("bounce-number", words, by_name[name], row)
    return "", none


def is_count(name: str, values: FloatArray, in_series: bool) -> bool:
    """Whether a column of this name, with values (rows,), counts the bounces of each series: whole
    numbers from 0 or 1, each one more than that before, or from the start again; in any order where
    quantities of a series are there.
    """
    bare = _bare(name)
    if bare not in _NAMED["bounce"] | _NAMED["count"] or not np.isfinite(values).all():
        return False
    is_whole = bool(np.all(values == np.round(values)))
    if in_series:
        return is_whole
    steps = np.diff(values)
    counts_on = (steps == 1.0) | (steps == 0.0) | (values[1:] == values.min())
    return is_whole and len(values) > 0 and values.min() in {0.0, 1.0} and bool(counts_on.all())


def _rows_of_runs(cells: TableCells, labels: Mapping[str, int]) -> Iterable[list[int]]:
    """The rows of each run, in order: those with the same labels of runs, surfaces, balls and the
    like, and of one row of the file where that has several bounces.
    """
    columns = [cells.text(place) for label, place in labels.items() if _names_runs(label)]
    if len({*cells.rows.tolist()}) < len(cells.rows):
        columns.append(cells.rows.astype(str).tolist())
    runs: dict[tuple[str, ...], list[int]] = {}
    for row in range(len(cells.rows)):
        runs.setdefault(tuple(column[row] for column in columns), []).append(row)
    return runs.values()


def _names_runs(label: str) -> bool:
    """Whether a column of this name says which series a bounce belongs to."""
    return bool(role_of(label)) or _bare(label) in _NAMED["run"]


def _bare(label: str) -> str:
    """A name without case, blanks and signs."""
    return "".join(letter for letter in label.casefold() if letter.isalnum() or letter == "#")


def _by_number(
    cells: TableCells,
    rows: list[int],
    numbers: FloatArray,
) -> Iterator[tuple[int, int]]:
    """Pairs of a row and that of the bounce before, by numbers. Those that repeat are series one
    after the other; a fault (`bounce-order`) where they are not.
    """
    if len({*numbers.tolist()}) == len(numbers):
        row_of = dict(zip(numbers.tolist(), rows, strict=True))
        for number, row in row_of.items():
            if number - 1.0 in row_of:
                yield row, row_of[number - 1.0]
        return
    steps = zip(rows[1:], rows, numbers[1:].tolist(), numbers.tolist(), strict=False)
    for row, earlier, number, number_before in steps:
        if number == number_before + 1.0:
            yield row, earlier
        elif number == number_before and number > numbers.min():
            words = (
                f"bounce {number:.0f} follows bounce {number_before:.0f}; expected one series "
                "after the other, or a column 'run' that says which is which"
            )
            cells.fault("bounce-order", words, None, row)


def _continues(name: str, value: float, before: float) -> bool:
    """Whether a bounce may be the one after another in its series: later, or lower and shorter,
    since a ball that rises higher was dropped anew.
    """
    return value > before if name == "bounce_time" else value < before
