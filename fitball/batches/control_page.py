"""What the page of a batch says and draws of control charts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fitball.base.numbers import counted, percent
from fitball.base.text import listed, short
from fitball.base.values import Figure
from fitball.batches.charts import LIMIT, Change
from fitball.batches.control import USUAL_BASELINE, Control
from fitball.report import style
from fitball.report.blocks import Block, Mark, Picture, Section, Table, Text
from fitball.report.quantities import figure_text

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

# Changes of a quantity on a first screen.
_MOST_CHANGES = 3
# Letters of a table's name.
_LETTERS_OF_NAME = 24
# Names of tables along the axis of a figure, and letters of all that fit side by side.
_MOST_NAMES = 24
_LETTERS_BESIDE = 50
_CAPTION = (
    "Control charts, tables in order. Dots: tables; line: EWMA; solid: centre; dashed: limits at 3 "
    "sd; the baseline is shaded. Out of control: purple. Below each: moving ranges, dashed their "
    "limit."
)


def control_lines(controls: Sequence[Control]) -> Iterator[Mark]:
    """What changed of each quantity, and where nothing did."""
    for control in controls:
        changes = control.chart.changes
        for change in changes[:_MOST_CHANGES]:
            yield Mark(f"{_title(control)}: {_changed(control, change)}.", "part")
        if len(changes) > _MOST_CHANGES:
            more = counted(len(changes) - _MOST_CHANGES, "more change")
            yield Mark(f"{_title(control)}: {more} in `control.csv`.", "part")
        if not changes:
            count = counted(len(control.tables), "table")
            yield Mark(f"{_title(control)}: {count} in control.")


def _title(control: Control) -> str:
    """What a chart is of."""
    return f"Control chart of {control.name}"


def _changed(control: Control, change: Change) -> str:
    """A change in words: which tables, by how much, by which rules."""
    first, last = (short(control.tables[k], _LETTERS_OF_NAME) for k in (change.first, change.last))
    unit = control.display_unit
    by = listed(change.rules)
    if change.kind == "pattern":
        return f"{first} to {last} ({by})"
    if change.kind == "value":
        value = unit.number(float(control.chart.values[change.first]), 4)
        low, high = (control.chart.centre + side * LIMIT * control.chart.sd for side in (-1, 1))
        return f"{first} has {unit.with_unit(value)}, limits {unit.interval(low, high)} ({by})"
    stretch = f"from {first} on" if _reaches_end(control, change) else f"{first} to {last}"
    direction = "higher" if change.size > 0.0 else "lower"
    size = unit.with_unit(unit.plus_minus(abs(change.size), change.sd))
    return f"{stretch} {direction} by {size} ({by})"


def _reaches_end(control: Control, change: Change) -> bool:
    """Whether a change lasts to the last table."""
    return change.last == len(control.tables) - 1


def control_sections(controls: Sequence[Control]) -> list[Section]:
    """How the charts were made, with limits and all changes."""
    if not controls:
        return []
    first = controls[0]
    order = f"dates in the column {first.ordered_by}" if first.ordered_by else "name"
    rules = listed(f"{rule.name} ({rule.text})" for rule in first.rules)
    about = [
        f"Tables are in the order of {order}. Limits: mean ± {LIMIT:g} sd of the baseline, the sd "
        "by its mean moving range. State the baseline with `--baseline N`, the first N tables.",
        f"Rules: {rules}; EWMA with weight 0.2, limits at 2.962 sd. Choose with `--rules`.",
        "A change is the stretch about an alarm whose mean is furthest from the centre in standard "
        "errors. Moving ranges raise no alarm.",
    ]
    rows = []
    changes = []
    for control in controls:
        chart = control.chart
        unit = control.display_unit
        low, high = (chart.centre + side * LIMIT * chart.sd for side in (-1, 1))
        rows.append(
            {
                "quantity": Mark(control.name, "name", control.meaning),
                "tables": f"{len(control.tables)}",
                "baseline": f"{chart.baseline}",
                "centre": unit.estimate(chart.centre, chart.sd),
                "limits": unit.interval(low, high),
                "sd": unit.number(chart.sd, 2),
                "unit": unit.name,
                "false alarms": percent(control.false_alarms),
            }
        )
        changes += [f"{control.name}: {_changed(control, change)}" for change in chart.changes]
    if any(control.chart.baseline < USUAL_BASELINE for control in controls):
        about.append(f"Limits of fewer than {USUAL_BASELINE} tables are rough.")
    note = (
        "False alarms: share of stable series, as long and with limits of as long a baseline, in "
        "which a rule is broken (simulated)."
    )
    table = Table("Limits", rows, ("limits", "unit"))
    blocks: list[Block] = [
        Picture("control", _CAPTION),
        table,
        Text([note, *about]),
        Text(changes, "list"),
    ]
    return [Section("Control charts", blocks)]


def control_figure(controls: Sequence[Control]) -> Figure:
    """Two panels a quantity: values with EWMA and limits, and moving ranges."""
    count = len(controls)
    figure, panels = style.new_figure(2 * count, 1, high=1.4 + 2.6 * count)
    for control, row in zip(controls, range(0, 2 * count, 2), strict=True):
        _draw_values(panels[row, 0], control)
        _draw_ranges(panels[row + 1, 0], control)
    labelled: dict[str, Artist] = {}
    for axes in panels.ravel():
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            labelled.setdefault(label, handle)
    style.legend_above(figure, [*labelled.values()])
    return figure


def _draw_values(axes: Axes, control: Control) -> None:
    """Draw values, EWMA, centre and limits."""
    chart = control.chart
    factor = control.display_unit.factor
    places = np.arange(chart.values.size)
    axes.axvspan(-0.5, chart.baseline - 0.5, color=style.FAINT, zorder=0, label="baseline")
    axes.axhline(factor * chart.centre, color=style.GUIDE_COLOUR, linewidth=0.8, label="centre")
    for side, label in ((-1.0, f"limits, {LIMIT:g} sd"), (1.0, None)):
        limit = factor * (chart.centre + side * LIMIT * chart.sd)
        axes.axhline(limit, color=style.GUIDE_COLOUR, linewidth=0.8, linestyle="--", label=label)
    axes.plot(places, factor * chart.ewma, color=style.MODEL_COLOUR, linewidth=1.2, label="EWMA")
    out = np.zeros(places.size, dtype=np.bool_)
    for change in chart.changes:
        out[change.first : change.last + 1] = True
    groups = (
        (~out, style.MEASURED_COLOUR, "table"),
        (out, style.MOVED_COLOUR, "table out of control"),
    )
    for marked, colour, label in groups:
        if marked.any():
            values = factor * chart.values[marked]
            axes.plot(places[marked], values, "o", color=colour, markersize=3.5, label=label)
    title = style.axis_label(figure_text(control.name, 30), control.display_unit)
    axes.set_title(title)
    _style_axes(axes, control, named=False)


def _draw_ranges(axes: Axes, control: Control) -> None:
    """Draw moving ranges with their limit."""
    chart = control.chart
    factor = control.display_unit.factor
    places = np.arange(chart.values.size)
    axes.axhline(
        factor * chart.range_limit,
        color=style.GUIDE_COLOUR,
        linewidth=0.8,
        linestyle="--",
    )
    axes.plot(places, factor * chart.ranges, "o-", color=style.PALE, markersize=2.5, linewidth=0.8)
    axes.set_ylim(bottom=0.0)
    axes.set_title("moving range")
    _style_axes(axes, control, named=True)


def _style_axes(axes: Axes, control: Control, *, named: bool) -> None:
    """Set the ends and ticks of a panel; names of tables where `named`."""
    count = len(control.tables)
    step = -(-count // _MOST_NAMES)
    names = [figure_text(name, 20) for name in control.tables[::step]] if named else []
    places = np.arange(count)[::step]
    rotation = 90 if len("".join(names)) > _LETTERS_BESIDE else 0
    axes.set_xticks(places, names if named else [""] * places.size, rotation=rotation)
    axes.set_xlim(-0.6, count - 0.4)
    axes.grid(axis="x", visible=False)
    style.few_ticks(axes.yaxis)
