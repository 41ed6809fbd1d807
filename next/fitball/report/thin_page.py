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
    values = []
    for name, row in result.frames["summary"].to_dict("index").items():
        point, error = float(row["point"]), float(row["stderr"])
        text = Unit("").number(point) if row["kind"] == "noise" else Unit("").plus_minus(point, error)
        values.append(
            {"parameter": str(name), "value": text, "unit": str(row["unit"]), "meaning": str(row["meaning"])}
        )
    residuals = []
    for column, rows in result.frames["predictions"].groupby("column", sort=False):
        worst = int(rows["z"].abs().to_numpy().argmax())
        residuals.append(
            {
                "column": COLUMNS[str(column)].title,
                "impacts": str(len(rows)),
                "largest": Unit("").number(float(rows["z"].iloc[worst]), 2),
                "of impact": str(rows["id"].iloc[worst]),
            }
        )
    lead = Text([note.text for note in result.notes if note.code == "point-only"], "lead")
    return Report(
        "Point fit",
        [lead, Table("", values, ("unit", "meaning"))],
        [
            Section("Parameters", [Table("Best fit, with standard errors", values, ("unit", "meaning"))]),
            Section("Residuals", [Table("In units of the scatter of the column", residuals, ("of impact",))]),
        ],
    )


def figures(_result: Frames) -> Mapping[str, Callable[[], Figure]]:
    """None."""
    return {}


def files(_result: Frames) -> Mapping[str, Callable[[], bytes]]:
    """Nothing besides frames and page."""
    return {}
