"""Page of the thin thread: two sections. Gone with it. Imports: blocks, columns, numbers, result."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from fitball.columns import COLUMNS
from fitball.numbers import Unit
from fitball.report.blocks import Report, Section, Table, Text
from fitball.result import Frames
from fitball.values import Figure


def report(result: Frames) -> Report:
    """Parameters, then residuals by column."""
    summary = result.frames["summary"]
    values = [
        {
            "parameter": str(name),
            "value": Unit("").number(row.point) if row.kind == "noise" else Unit("").plus_minus(row.point, row.stderr),
            "unit": row.unit,
            "meaning": row.meaning,
        }
        for name, row in zip(summary.index, summary.itertuples(index=False), strict=True)
    ]
    found = result.frames["predictions"]
    residuals = [
        {
            "column": COLUMNS[str(column)].title,
            "impacts": str(len(rows)),
            "largest residual": Unit("sd").number(float(rows["z"].abs().max()), 2),
            "of impact": str(rows.loc[rows["z"].abs().idxmax(), "id"]),
        }
        for column, rows in found.groupby("column", sort=False)
    ]
    lead = Text([note.text for note in result.notes if note.code == "point-only"], "lead")
    return Report(
        "Point fit",
        [lead, Table("", values, ("unit", "meaning"))],
        [
            Section("Parameters", [Table("Best fit, with standard errors", values, ("unit", "meaning"))]),
            Section("Residuals", [Table("In units of the scatter of the column", residuals, ("of impact",))]),
        ],
    )


def figures(result: Frames) -> Mapping[str, Callable[[], Figure]]:
    """None."""
    return {}


def files(result: Frames) -> Mapping[str, Callable[[], bytes]]:
    """Nothing besides frames and page."""
    return {}
