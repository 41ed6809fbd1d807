"""The page of `bench --rows`: what a fit costs by rows, and the figure."""

from collections.abc import Callable, Mapping

import numpy as np

from fitball.base.display_units import PLAIN
from fitball.base.findings import Findings
from fitball.base.values import DataFrame, Figure
from fitball.report.blocks import Block, Picture, Report, Table, Text
from fitball.report.frame_rows import frame_rows
from fitball.report.page import Page
from fitball.report.style import MODEL_COLOUR, SERIES_COLOURS, SERIES_MARKERS, new_figure
from fitball.speed.growth import OURS

_CAPTION = "A fit on one core, from the file to page and figures."


def report(result: Findings) -> Report:
    """What a fit costs by rows."""
    frame = result.frames["growth"]
    ours = frame[frame["fitball"] == OURS]
    largest = frame_rows(ours)[-1]
    lead = (
        f"A fit of {largest.count('rows'):,} rows takes {PLAIN.number(largest.number('seconds'))} "
        f"s of CPU and {largest.number('megabytes'):.0f} MB at most.{_steepest(ours)}"
    )
    summary: list[Block] = [
        Text([lead], "lead"),
        _table(frame),
        Text([note.text for note in result.notes], "quiet"),
        Picture("growth", _CAPTION),
    ]
    return Report("Whole fits by rows", summary, [])


def exponents(frame: DataFrame) -> list[float]:
    """Powers of the rows with which CPU time grows, from each number of rows to the next."""
    rows = np.log(frame["rows"].to_numpy(np.float64))
    seconds = np.log(frame["seconds"].to_numpy(np.float64))
    return [float(power) for power in np.diff(seconds) / np.diff(rows)]


def _steepest(frame: DataFrame) -> str:
    """The sentence on the largest power; none of one number of rows."""
    powers = exponents(frame)
    if not powers:
        return ""
    return f" CPU time grows with the power {max(powers):.2f} of the rows at most."


def _table(frame: DataFrame) -> Table:
    """A row for each number of rows, with the costs of each fitball."""
    cells = dict[int, dict[str, str]]()
    several = frame["fitball"].nunique() > 1
    for row in frame_rows(frame):
        count = row.count("rows")
        of = f", {row.text('fitball')}" if several else ""
        here = cells.setdefault(count, {"rows": f"{count:,}"})
        here[f"CPU [s]{of}"] = PLAIN.number(row.number("seconds"))
        here[f"most memory [MB]{of}"] = f"{row.number('megabytes'):.0f}"
    return Table("", [*cells.values()])


def figures(result: Findings) -> Mapping[str, Callable[[], Figure]]:
    """The figure `growth`: CPU time and memory over rows."""
    return {"growth": lambda: _draw(result.frames["growth"])}


def _draw(frame: DataFrame) -> Figure:
    """CPU time and memory over rows, a panel each, a line a fitball."""
    figure, panels = new_figure(1, 2, high=2.8)
    for k, (name, rows) in enumerate(frame.groupby("fitball", sort=False)):
        colour = MODEL_COLOUR if name == OURS else SERIES_COLOURS[k % len(SERIES_COLOURS)]
        marker = SERIES_MARKERS[k % len(SERIES_MARKERS)]
        for axes, column in zip(panels[0], ("seconds", "megabytes"), strict=True):
            axes.plot(rows["rows"], rows[column], marker, ls="-", color=colour, label=str(name))
    for axes, label in zip(panels[0], ("CPU [s]", "most memory [MB]"), strict=True):
        axes.set_xscale("log")
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("rows")
        axes.set_ylabel(label)
    if frame["fitball"].nunique() > 1:
        panels[0, 0].legend()
    return figure


PAGE = Page(report, figures)
