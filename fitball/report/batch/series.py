"""Columns of a batch as series: each parameter over the tables, along what the tables can be ordered by; and on which
level each table is: by a label that all its rows share, by its folder, or as given.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath

import numpy as np
from numpy.typing import NDArray

from fitball.errors import ParameterError, suggestion
from fitball.inference.population.trend import Line, outliers, random_effects
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results.results import Verdict
from fitball.models.registry import parameter_spec
from fitball.report.batch.rows import DONE, LABEL, NAME, Row
from fitball.report.figures.quantities import axis_label
from fitball.report.form.numbers import Scale, handy, listed
from fitball.values import FloatArray
from fitball.wording import option

PACE = "court_pace"
DETERMINED = (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.CONDITIONAL)
# Chance that a line is called a drift where there is none.
FALSE_DRIFT = 0.05
# Half of a 95 % interval in standard deviations.
REACH = 1.96


@dataclass(frozen=True)
class Along:
    """What tables are set along: numbers or dates of one label column (`values` in its unit or in days, NaN where a
    table has none), or only their order.
    """

    name: str
    values: FloatArray
    first_day: datetime.date | None = None
    ordered: bool = False

    def text(self, value: float) -> str:
        """A value as it was written."""
        if self.first_day is not None:
            return (self.first_day + datetime.timedelta(days=value)).isoformat()
        return f"{value:g}"


@dataclass(frozen=True)
class Series:
    """One quantity over the tables: `names` of those that have it, at `rows`; (tables,) median, sd, ends of the 95 %
    interval, SI (NaN of a point fit, but for the median, its best value); `determined` where the table's data
    determine the value, not its prior alone.

    `centre` is the mean of the `determined` ones and how far they scatter, `drifts` the line along each label (only
    those with a significant slope), `outside` (row, distance in standard deviations). All three are of natural
    logarithms where the quantity is `logarithmic`: one that is known to a factor.
    """

    quantity: str
    unit: str
    names: tuple[str, ...]
    rows: tuple[int, ...]
    median: FloatArray
    sd: FloatArray
    low: FloatArray
    high: FloatArray
    determined: tuple[bool, ...]
    logarithmic: bool
    centre: Line | None
    drifts: tuple[tuple[Along, Line], ...]
    outside: tuple[tuple[int, float], ...]

    @property
    def drawn(self) -> bool:
        """Whether any table has a posterior of it."""
        return bool(np.isfinite(self.sd).any())

    @property
    def name(self) -> str:
        """The quantity as it is called in sentences."""
        return (
            "court pace"
            if self.quantity == PACE
            else self.quantity.replace("cor_at_", "COR at ").replace("_m/s", " m/s")
        )

    @property
    def scale(self) -> Scale:
        """The handy unit of it."""
        return handy(self.quantity, self.unit)

    @property
    def head(self) -> str:
        """Its name with that unit."""
        return axis_label(self.name, self.scale.unit)

    @property
    def middle(self) -> tuple[float, float, float] | None:
        """The centre with the low and the high end of its 95 % interval, SI."""
        if self.centre is None:
            return None
        line = self.centre
        ends = float(line.coefficients[0]), float(line.low[0]), float(line.high[0])
        return (math.exp(ends[0]), math.exp(ends[1]), math.exp(ends[2])) if self.logarithmic else ends


def things_along(rows: Sequence[Row]) -> tuple[Along, ...]:
    """The label columns that are numbers or dates (2026-11-22) in at least three tables, not all the same."""
    found = []
    for column in dict.fromkeys(key for row in rows for key in row if key.startswith(LABEL)):
        along = _along(column.removeprefix(LABEL), [row.get(column) for row in rows])
        if along is not None:
            found.append(along)
    return tuple(found)


def _along(name: str, cells: Sequence[object]) -> Along | None:
    texts = [None if cell is None else str(cell).strip() for cell in cells]
    # Dates first: 20261122 is one.
    for read in (_days, _numbers):
        along = read(name, texts)
        if along is not None and len(np.unique(along.values[np.isfinite(along.values)])) > 2:
            return along
    return None


def _numbers(name: str, texts: Sequence[str | None]) -> Along | None:
    if any("_" in text for text in texts if text is not None):
        # A name such as 1_2, which Python takes for twelve.
        return None
    try:
        values = np.array([np.nan if text is None else float(text) for text in texts])
    except ValueError:
        return None
    return Along(name, values)


def _days(name: str, texts: Sequence[str | None]) -> Along | None:
    try:
        days = [None if text is None else datetime.datetime.fromisoformat(text) for text in texts]
    except ValueError:
        return None
    known = [day for day in days if day is not None]
    if len({day.tzinfo is None for day in known}) != 1:
        # None at all, or some with a time zone and some without: their order is not known.
        return None
    first = min(known)
    start = datetime.datetime.combine(first.date(), datetime.time(), first.tzinfo)
    values = [np.nan if day is None else (day - start).total_seconds() / 86400.0 for day in days]
    return Along(name, np.array(values), first.date())


def all_series(rows: Sequence[Row]) -> tuple[Series, ...]:
    """Every quantity that a table of the batch has, in the order of their columns."""
    done = [row for row in rows if row["outcome"] == DONE]
    along = things_along(rows)
    heads = [key.removesuffix("_q025") for row in done for key in row if key.endswith("_q025")]
    return tuple(series for name in dict.fromkeys(heads) if (series := _series(name, rows, along)) is not None)


def _series(name: str, rows: Sequence[Row], along: Sequence[Along]) -> Series | None:
    head = next((key for row in rows for key in row if key == name or key.startswith(f"{name} [")), None)
    if head is None:
        return None
    found = [(place, row) for place, row in enumerate(rows) if _number(row.get(head)) is not None]
    ends = np.array([[_or_nan(row.get(f"{name}_{end}")) for end in ("q025", "q975")] for _, row in found]).T
    if not found or all(row.get(f"{name}_verdict") == Verdict.FIXED for _, row in found):
        return None
    median = np.array([_or_nan(row[head]) for _, row in found])
    sd = np.array([_or_nan(row.get(f"{name}_sd")) for _, row in found])
    sd = np.where(np.isnan(sd), (ends[1] - ends[0]) / (2.0 * REACH), sd)
    determined = np.array([_determined(row.get(f"{name}_verdict")) for _, row in found])
    places = np.array([place for place, _ in found])
    scaled = _logarithmic(name) and bool(np.all(ends[0] > 0.0))
    values = np.log(median) if scaled else median
    errors = np.log(ends[1] / ends[0]) / (2.0 * REACH) if scaled else sd
    counted = determined & np.isfinite(errors)
    centre = random_effects(values[counted], errors[counted]) if counted.any() else None
    drifts = tuple(
        (label, line) for label in along if (line := _drift(label, places, values, errors, counted)) is not None
    )
    outside: tuple[tuple[int, float], ...] = ()
    if centre is not None:
        distance, limit = outliers(values[counted], errors[counted])
        beyond = np.abs(distance) > limit
        outside = tuple(zip(places[counted][beyond].tolist(), distance[beyond].tolist(), strict=True))
    return Series(
        name, head.partition(" [")[2].removesuffix("]"), tuple(str(row[NAME]) for _, row in found),
        tuple(map(int, places)), median, sd, ends[0], ends[1], tuple(map(bool, determined)), scaled, centre, drifts,
        outside,
    )  # fmt: skip


def _logarithmic(name: str) -> bool:
    """Whether a quantity is known to a factor: sizes of noise, and parameters whose axis is logarithmic."""
    spec = parameter_spec(name)
    return name in NOISE_SPECS or (spec is not None and spec.logarithmic)


def _drift(
    along: Along, places: NDArray[np.int64], values: FloatArray, errors: FloatArray, counted: NDArray[np.bool_]
) -> Line | None:
    """The line along something, if it is surely not level."""
    where = along.values[places]
    used = counted & np.isfinite(where)
    line = random_effects(values[used], errors[used], where[used]) if used.any() else None
    return line if line is not None and line.p[1] < FALSE_DRIFT else None


def _determined(verdict: object) -> bool:
    return verdict is None or str(verdict).startswith(tuple(map(str, DETERMINED)))


def _number(cell: object) -> float | None:
    return float(cell) if isinstance(cell, (int, float)) else None


def _or_nan(cell: object) -> float:
    number = _number(cell)
    return np.nan if number is None else number


# Levels that are the folders of tables, unless tables have a label of that name.
FOLDER = "folder"
# What every table is a level of by itself.
TABLE = "table"
# The name of levels that are given table by table.
LEVEL = "level"
Over = str | Mapping[str, str] | None


@dataclass(frozen=True)
class Grouping:
    """The level of each table that has one, by the label `over`; none where every table is a level by itself.
    `remarks` are on the levels.
    """

    over: str = ""
    levels: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


def grouped(rows: Sequence[Row], over: Over) -> Grouping:
    """Tables grouped `over` a label, over "folder", or by a mapping of tables to levels.

    Numbers or dates of which every table has its own are no levels: drifts along them are reported of any batch.
    Raises ParameterError for a label that no table has, or all have the same.
    """
    if over is None or over == TABLE:
        return Grouping()
    done = {str(row[NAME]): row for row in rows if row["outcome"] == DONE}
    if not isinstance(over, str):
        for table in over.keys() - {str(row[NAME]) for row in rows}:
            raise ParameterError(f"over: no table is called '{table}': {suggestion(str(table), done)}")
        name, levels = LEVEL, {table: str(over[table]) for table in done if table in over}
    else:
        name, levels = over, _labelled(done, over)
    count = len(set(levels.values()))
    if count < 2:
        same = ", ".join(set(levels.values()))
        raise ParameterError(f"{option('over', name)}: one level alone, {same}; expected at least two levels")
    along = next((label for label in things_along(rows) if label.name == name), None)
    kind = "" if along is None else "dates" if along.first_day is not None else "numbers"
    if kind and count == len(levels):
        return Grouping(remarks=(_DRIFT.format(name=name, kind=kind),))
    remarks = [f"{len(levels):,} tables on {count:,} levels of {name}."]
    without = [table for table in done if table not in levels]
    if without:
        remarks.append(f"Left out, without one {name} for all their rows: {listed(without, 5)}.")
    if kind:
        remarks.append(f"{name} holds {kind}. They are used as names of levels; a drift along them is reported too.")
    return Grouping(name, levels, (*remarks, *_weak(name, count, len(levels))))


_DRIFT = "{name} holds {kind}, different in every table: no levels are used. A drift along it is reported."


def _labelled(done: Mapping[str, Row], over: str) -> dict[str, str]:
    labels = {key.removeprefix(LABEL) for row in done.values() for key in row if key.startswith(LABEL)}
    if over in labels:
        cells = {table: row.get(f"{LABEL}{over}") for table, row in done.items()}
        return {table: str(cell) for table, cell in cells.items() if cell is not None}
    if over == FOLDER:
        return {table: PurePosixPath(table).parent.as_posix() for table in done}
    known = sorted({*labels, FOLDER})
    raise ParameterError(
        f"{option('over', over)}: no table has one {over} for all its rows; expected a label that tables have, or "
        f"their folder: {', '.join(known)}"
    )


def _weak(name: str, levels: int, tables: int) -> list[str]:
    """What so few levels and tables hardly determine."""
    sentences = []
    if levels == 2:
        sentences.append(
            f"Two levels of {name} hardly determine the spread between levels: it depends on its prior too."
        )
    if tables == levels:
        sentences.append(
            f"Every {name} has one table. Differences between tables and between levels cannot be separated: the "
            "spread contains both."
        )
    elif tables == levels + 1:
        sentences.append(f"Only one {name} has two tables: the spread within levels depends on its prior too.")
    return sentences
