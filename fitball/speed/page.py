"""Its table and figure."""

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.lines import Line2D

from fitball.base.display_units import PLAIN
from fitball.base.findings import Findings
from fitball.base.numbers import counted
from fitball.base.values import DataFrame, Figure
from fitball.report.blocks import Block, Picture, Report, Section, Table, Text
from fitball.report.page import Page
from fitball.report.quantities import records
from fitball.report.style import MARKERS, MODEL, SERIES, legend_above, new_figure
from fitball.speed import HARD, ONE, OURS

# Errors at which the fastest rival is named; the scene of the summary; an error that is drawn for
# none.
_ERRORS = (1e-3, 1e-6, 1e-9, 1e-12)
_MAIN = "Wang's 21"
_NONE = 1e-17
_CAPTION = "Lower left is better. Errors are relative to the incident speed of the ball's surface."


def report(result: Findings) -> Report:
    """Who is fastest at which error; all numbers."""
    frame = result.frames["bench"]
    main = frame[frame["scene"] == _MAIN]
    hard = frame[frame["scene"] == HARD]
    largest = frame[frame["solver"].isin([OURS, ONE]) & (frame["scene"] != HARD)][
        "largest_error"
    ].max()
    fastest = _fastest(main)
    lead = [
        f"fitball computes a bounce in {PLAIN.number(_ours(main))} µs of one core. Its largest "
        f"error is {largest:.0e} "
        f"of the ball's speed, {hard['largest_error'].max():.0e} on hard cases.",
        f"The fastest rival takes {fastest.rows[0]['times fitball']} times as long within an "
        "error of "
        f"{fastest.rows[0]['error at most']}, {fastest.rows[-1]['times fitball']} times within "
        f"{fastest.rows[-1]['error at most']}.",
    ]
    sections = [
        Section(str(name), [_table(rows)], True, f"{counted(len(rows), 'measurement')}.")
        for name, rows in frame.groupby("scene", sort=False)
    ]
    summary: list[Block] = [
        Text(lead, "lead"),
        fastest,
        Text([note.text for note in result.notes], "quiet"),
        Picture("bench", _CAPTION),
    ]
    return Report("Speed against error of one bounce", summary, sections)


def _ours(rows: DataFrame) -> float:
    return float(rows["microseconds"][rows["solver"] == OURS].iloc[0])


def _fastest(rows: DataFrame) -> Table:
    """Of each rival the fastest setting within an error, over fitball."""
    ours = _ours(rows)
    made = []
    for error in _ERRORS:
        good = rows[(rows["largest_error"] <= error) & ~rows["solver"].isin([OURS, ONE])]
        if len(good):
            best = records(good.sort_values("microseconds"))[0]
            made.append(
                {
                    "error at most": f"{error:.0e}",
                    "fastest rival": best["solver"],
                    "setting": best["setting"],
                    "µs": PLAIN.number(best["microseconds"]),
                    "times fitball": f"{best['microseconds'] / ours:.1f}",
                }
            )
    return Table(
        f"The fastest rival within an error, {_MAIN} impacts",
        made,
        ("fastest rival", "setting"),
    )


def _table(rows: DataFrame) -> Table:
    made = [
        {
            "solver": row["solver"],
            "setting": row["setting"],
            "µs a bounce": PLAIN.number(row["microseconds"]),
            "largest error": f"{row['largest_error']:.1e}",
            "median error": f"{row['median_error']:.1e}",
        }
        for row in records(rows)
    ]
    return Table("", made, ("solver", "setting"))


def figures(result: Findings) -> Mapping[str, Callable[[], Figure]]:
    """Time over error, a panel a scene."""
    return {"bench": lambda: _drawn(result.frames["bench"])}


def _drawn(frame: DataFrame) -> Figure:
    shown = frame[frame["scene"] != HARD]
    figure, axes = new_figure(2, 2, high=6.4, wide=8.4, sharex=True, sharey=True)
    names = list(dict.fromkeys(shown["solver"]))
    colours = {
        name: MODEL if name in (OURS, ONE) else SERIES[k % len(SERIES)]
        for k, name in enumerate(names)
    }
    markers = {name: MARKERS[k % len(MARKERS)] for k, name in enumerate(names)}
    for axis, (scene, rows) in zip(axes.ravel(), shown.groupby("scene", sort=False), strict=False):
        for name, mine in rows.groupby("solver", sort=False):
            error = np.maximum(mine["largest_error"], _NONE)
            axis.loglog(
                error,
                mine["microseconds"],
                marker=markers[str(name)],
                color=colours[str(name)],
                linewidth=1.2,
                markersize=5,
            )
        axis.set_title(str(scene))
    for axis in axes[-1]:
        axis.set_xlabel("largest error")
    for axis in axes[:, 0]:
        axis.set_ylabel("µs a bounce")
    legend_above(
        figure,
        [Line2D([], [], color=colours[name], marker=markers[name], label=name) for name in names],
    )
    return figure


PAGE = Page(report, figures)
