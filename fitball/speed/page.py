"""The page of `bench`: who is fastest at which error, and the figure."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from fitball.base.display_units import PLAIN
from fitball.base.findings import Findings
from fitball.base.numbers import counted
from fitball.base.values import DataFrame, Figure
from fitball.report.blocks import Block, Picture, Report, Section, Table, Text
from fitball.report.frame_rows import frame_rows
from fitball.report.page import Page
from fitball.report.style import (
    MODEL_COLOUR,
    SERIES_COLOURS,
    SERIES_MARKERS,
    legend_above,
    new_figure,
)
from fitball.speed import HARD, OURS, OURS_SINGLY

# Errors at which the fastest rival is named: those of engineering up to near rounding.
_ERRORS = (1e-3, 1e-6, 1e-9, 1e-12)
# The scene of the summary.
_MAIN = "Wang's 21"
# Where an error of zero is drawn: a logarithmic axis has none.
_DRAWN_ZERO = 1e-17
_CAPTION = "Lower left is better. Errors are relative to the incident speed of the ball's surface."


def report(result: Findings) -> Report:
    """Who is fastest at which error; all numbers."""
    frame = result.frames["bench"]
    main = frame[frame["scene"] == _MAIN]
    hard = frame[frame["scene"] == HARD]
    usual = frame[frame["solver"].isin([OURS, OURS_SINGLY]) & (frame["scene"] != HARD)]
    largest = usual["largest_error"].max()
    fastest = _fastest(main)
    coarse = fastest.rows[0]
    fine = fastest.rows[-1]
    lead = [
        f"fitball computes a bounce in {PLAIN.number(_ours(main))} µs of one core. Its largest "
        f"error is {largest:.0e} of the ball's speed, {hard['largest_error'].max():.0e} on hard "
        "cases.",
        f"The fastest rival takes {coarse['times fitball']} times as long within an error of "
        f"{coarse['error at most']}, {fine['times fitball']} times within {fine['error at most']}.",
    ]
    sections = []
    for name, rows in frame.groupby("scene", sort=False):
        count = f"{counted(len(rows), 'measurement')}."
        sections.append(Section(str(name), [_table(rows)], folded=True, answer=count))
    summary: list[Block] = [
        Text(lead, "lead"),
        fastest,
        Text([note.text for note in result.notes], "quiet"),
        Picture("bench", _CAPTION),
    ]
    return Report("Speed against error of one bounce", summary, sections)


def _ours(rows: DataFrame) -> float:
    """Microseconds a bounce of fitball on a large batch."""
    return float(rows["microseconds"][rows["solver"] == OURS].iloc[0])


def _fastest(rows: DataFrame) -> Table:
    """The fastest rival and setting within each error, with its time over that of fitball."""
    ours = _ours(rows)
    rivals = rows[~rows["solver"].isin([OURS, OURS_SINGLY])]
    cells = []
    for error in _ERRORS:
        good = rivals[rivals["largest_error"] <= error]
        if good.empty:
            continue
        best = frame_rows(good.sort_values("microseconds"))[0]
        cells.append(
            {
                "error at most": f"{error:.0e}",
                "fastest rival": best.text("solver"),
                "setting": best.text("setting"),
                "µs": PLAIN.number(best.number("microseconds")),
                "times fitball": f"{best.number('microseconds') / ours:.1f}",
            }
        )
    title = f"The fastest rival within an error, {_MAIN} impacts"
    return Table(title, cells, left=("fastest rival", "setting"))


def _table(rows: DataFrame) -> Table:
    """All measurements of a scene."""
    cells = [
        {
            "solver": row.text("solver"),
            "setting": row.text("setting"),
            "µs a bounce": PLAIN.number(row.number("microseconds")),
            "largest error": f"{row.number('largest_error'):.1e}",
            "median error": f"{row.number('median_error'):.1e}",
        }
        for row in frame_rows(rows)
    ]
    return Table("", cells, left=("solver", "setting"))


def figures(result: Findings) -> Mapping[str, Callable[[], Figure]]:
    """The figure `bench`: time over error, a panel a scene."""
    return {"bench": lambda: _draw(result.frames["bench"])}


def _draw(frame: DataFrame) -> Figure:
    """Time over error of all solvers, a panel a scene but for the hard cases."""
    shown = frame[frame["scene"] != HARD]
    figure, axes = new_figure(2, 2, high=6.4, wide=8.4, sharex=True, sharey=True)
    styles: dict[str, dict[str, Any]] = {}
    handles = []
    for k, name in enumerate(dict.fromkeys(shown["solver"])):
        colour = SERIES_COLOURS[k % len(SERIES_COLOURS)]
        if name in (OURS, OURS_SINGLY):
            colour = MODEL_COLOUR
        styles[name] = {"color": colour, "marker": SERIES_MARKERS[k % len(SERIES_MARKERS)]}
        handles.append(Line2D([], [], label=name, **styles[name]))
    by_scene = shown.groupby("scene", sort=False)
    for axis, (scene, rows) in zip(axes.ravel(), by_scene, strict=False):
        for name, of_solver in rows.groupby("solver", sort=False):
            error = np.maximum(of_solver["largest_error"], _DRAWN_ZERO)
            time = of_solver["microseconds"]
            axis.loglog(error, time, linewidth=1.2, markersize=5, **styles[str(name)])
        axis.set_title(str(scene))
    for axis in axes[-1]:
        axis.set_xlabel("largest error")
    for axis in axes[:, 0]:
        axis.set_ylabel("µs a bounce")
    legend_above(figure, handles)
    return figure


PAGE = Page(report, figures)
