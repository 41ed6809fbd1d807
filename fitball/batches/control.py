"""Control charts of a batch: tables in order, limits of the first ones, what changed."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fitball.base.errors import ParameterError
from fitball.base.numbers import Unit
from fitball.base.text import column_head
from fitball.base.values import DataFrame
from fitball.batches.charts import Chart, Rule, chart_of, false_alarms, rules_named
from fitball.batches.rows import TableQuantity, is_compared
from fitball.inference.effort import Effort

# Rules of a chart besides its EWMA, which finds small shifts.
USUAL_RULES = "nelson-1-2"
# Tables from which there is a chart.
LEAST_TABLES = 10
# Fewest tables of a baseline that is stated, and how many it has unasked. Their limits are rough:
# of 20 tables their sd is known to a sixth.
LEAST_BASELINE = 5
USUAL_BASELINE = 20
# Quantities that have a chart.
_MOST_CHARTS = 6
# What a laboratory measures, by the beginning of its name; restitution only where there is no
# rebound, which is the same.
_MEASURED = ("rebound_measured", "pace_measured", "cor_measured")
_LABEL = "label:"


class Charting(NamedTuple):
    """How charts are made: tables of the `baseline`, zero for the usual number, and `rules` by
    name.
    """

    baseline: int = 0
    rules: str = USUAL_RULES

    def checked(self, count: int) -> Charting:
        """The same, if it can be done for so many tables.

        Raises:
            ParameterError: there are no such rules (`rules`), or no such baseline (`baseline`).
        """
        rules_named(self.rules)
        if self.baseline and not LEAST_BASELINE <= self.baseline <= count:
            text = (
                f"baseline: read {self.baseline}; expected a number of first tables, from "
                f"{LEAST_BASELINE} to all {count}"
            )
            raise ParameterError(text, "baseline")
        return self


USUAL_CHARTING = Charting()


class Control(NamedTuple):
    """The chart of a quantity over `tables` in order, in SI: the column of dates that orders them,
    "" for names; the rules, and the share of stable series of as many tables that raise an alarm.
    """

    name: str
    meaning: str
    unit: str
    display_unit: Unit
    tables: tuple[str, ...]
    ordered_by: str
    chart: Chart
    rules: tuple[Rule, ...]
    false_alarms: float


def control_charts(
    tables: DataFrame,
    quantities: Mapping[str, Mapping[str, TableQuantity]],
    charting: Charting,
) -> tuple[Control, ...]:
    """Charts of what was measured in laboratory tests, else of quantities that enough tables
    determine, each over the tables that have it; none of fewer than LEAST_TABLES or than the
    baseline, or where that does not vary.
    """
    chosen = rules_named(charting.rules)
    ordered = in_order(tables)
    controls = list[Control]()
    for name, quantity in _charted(quantities):
        values = ordered.tables[column_head(name, quantity.unit)].to_numpy(np.float64)
        has_value = np.isfinite(values)
        count = int(has_value.sum())
        first = charting.baseline or min(USUAL_BASELINE, count)
        if count < max(LEAST_TABLES, first):
            continue
        chart = chart_of(values[has_value], first, chosen)
        if chart is None:
            continue
        share = false_alarms(count, first, chosen, Effort().stream("stable series"))
        controls.append(
            Control(
                name,
                quantity.meaning,
                quantity.unit,
                quantity.display_unit,
                tuple(map(str, ordered.tables.index[has_value])),
                ordered.by,
                chart,
                chosen,
                share,
            )
        )
    return tuple(controls[:_MOST_CHARTS])


def why_no_chart(
    tables: DataFrame,
    quantities: Mapping[str, Mapping[str, TableQuantity]],
) -> str:
    """Why what laboratory tests measured of several `tables` has no chart, in words; "" where
    nothing was measured of two.
    """
    ordered = in_order(tables)
    for name, quantity in _charted(quantities):
        values = ordered.tables[column_head(name, quantity.unit)].to_numpy(np.float64)
        count = int(np.isfinite(values).sum())
        if name.startswith(_MEASURED) and count > 1:
            text = f"No control chart: {count} tables have {name}"
            if count < LEAST_TABLES:
                return f"{text}; limits begin with {LEAST_TABLES}."
            return f"{text}, fewer than the baseline, or all the same."
    return ""


def _charted(
    quantities: Mapping[str, Mapping[str, TableQuantity]],
) -> Iterator[tuple[str, TableQuantity]]:
    """Names of quantities that have a chart, each as one of the tables has it."""
    by_name = dict[str, list[TableQuantity]]()
    for row in quantities.values():
        for name, quantity in row.items():
            by_name.setdefault(name, []).append(quantity)
    measured = [name for name in by_name if name.startswith(_MEASURED)]
    compared = [name for name, found in by_name.items() if is_compared(found)]
    for name in measured or compared:
        if name.replace("cor_", "rebound_", 1) in measured and name.startswith("cor_"):
            continue
        yield name, by_name[name][0]


class Ordered(NamedTuple):
    """Tables that were fitted, in order: `by` is the column of their dates, "" for their names.
    `repeated` is a column of dates that do not order them, with two tables of one date.
    """

    tables: DataFrame
    by: str
    repeated: tuple[str, str, str] | None = None


def in_order(tables: DataFrame) -> Ordered:
    """The tables that were fitted, by the dates of their only column of ISO dates, else by name.
    Dates that tables share which are not neighbours by name are in error for some, or say nothing
    of the order: then names count.
    """
    done = tables[tables["outcome"] == "done"]
    places = sorted(range(len(done)), key=lambda k: _natural(str(done.index[k])))
    named = done.iloc[places]
    dated = {
        str(head).removeprefix(_LABEL): moments
        for head in named.columns
        if str(head).startswith(_LABEL) and (moments := _dates(named[head].tolist()))
    }
    if len(dated) != 1:
        return Ordered(named, "")
    by, moments = dated.popitem()
    by_date = sorted(range(len(named)), key=moments.__getitem__)
    for first, second in pairwise(by_date):
        if moments[first] == moments[second] and second != first + 1:
            pair = str(named.index[first]), str(named.index[second])
            return Ordered(named, "", (by, *pair))
    return Ordered(named.iloc[by_date], by)


def _natural(name: str) -> list[tuple[bool, int, str]]:
    """A key by which `lot 2` comes before `lot 10`."""
    parts = re.split(r"(\d+)", name.casefold())
    return [(part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts if part]


def _dates(cells: Sequence[object]) -> list[float]:
    """Cells as moments [s]; none if one is no date."""
    moments = []
    for cell in cells:
        try:
            moment = datetime.fromisoformat(str(cell))
        except ValueError:
            return []
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        moments.append(moment.timestamp())
    return moments


def control_frame(controls: Sequence[Control]) -> DataFrame:
    """A row a quantity and table in order, in SI: the value, centre and limits, moving range and
    its limit, EWMA and its limits; whether the table is of the baseline, the rules that are broken,
    and which change it belongs to.
    """
    import pandas as pd

    frames = []
    for control in controls:
        chart = control.chart
        spread = 3.0 * chart.sd
        changes = [""] * len(control.tables)
        for change in chart.changes:
            for k in range(change.first, change.last + 1):
                changes[k] = change.kind
        columns = {
            "quantity": control.name,
            "unit": control.unit,
            "table": control.tables,
            "value": chart.values,
            "centre": chart.centre,
            "low_limit": chart.centre - spread,
            "high_limit": chart.centre + spread,
            "moving_range": chart.ranges,
            "range_limit": chart.range_limit,
            "ewma": chart.ewma,
            "ewma_low": chart.centre - chart.ewma_limit,
            "ewma_high": chart.centre + chart.ewma_limit,
            "baseline": np.arange(len(control.tables)) < chart.baseline,
            "rules": ["; ".join(names) for names in chart.broken],
            "change": changes,
        }
        frames.append(pd.DataFrame(columns))
    if not frames:
        return pd.DataFrame()
    return pd.concat(frames, ignore_index=True)
