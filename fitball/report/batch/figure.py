"""Parameters over tables: a panel each, every table a median with its 95 % interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from fitball.inference.population.hyper import Known
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.models.registry import parameter_spec
from fitball.report.batch.populations import Populated
from fitball.report.batch.series import Along, Series
from fitball.report.figures.canvas import log_scale, new_figure, own_style, verbatim
from fitball.report.figures.quantities import ParameterAxis, parameter_axis
from fitball.report.form.palette import FAINT, GUIDE, MODEL, TREND, pale
from fitball.values import FloatArray

WIDTH, HEIGHT = 9.0, 1.75
# Tables whose names are written at the axis; of more every so many-th.
MOST_NAMED = 24
# Medians that a panel shows with intervals of full strength; of more they are thinner.
MANY = 60
# Tables beyond which intervals overlap: they are pale then, and the pooled values are left out.
CROWDED = 150
# Distance of a pooled value from the table's own interval, in tables.
BESIDE = 0.22
# Inches of a row of a figure of populations.
ROW = 0.26


@own_style()
def batch_figure(
    series: Sequence[Series], tables: Sequence[str], along: Along | None = None, populated: Sequence[Populated] = ()
) -> Figure:
    """A panel a quantity over the tables in their order, or along something; `populated` are their populations."""
    known = {one.quantity.name: one for one in populated}
    figure = new_figure(WIDTH, 0.9 + HEIGHT * len(series))
    panels = figure.subplots(len(series), 1, sharex=True, squeeze=False)[:, 0]
    for panel, one in zip(panels, series, strict=True):
        _draw(panel, one, along, known.get(one.quantity))
    if along is None:
        _name_tables(panels[-1], tables)
    else:
        panels[-1].set_xlabel(verbatim(along.name))
        if along.first_day is not None:
            panels[-1].xaxis.set_major_locator(MaxNLocator(8, integer=True))
            panels[-1].xaxis.set_major_formatter(FuncFormatter(lambda value, _place: along.text(value)))
    return figure


@own_style()
def population_figure(populated: Sequence[Populated]) -> Figure:
    """A panel a quantity: tables alone and given all others (unless they are many), levels, the mean of all and a new
    table.
    """
    counts = [len(one.own) * (len(one.own) <= MANY) + len(one.population.levels) for one in populated]
    most = max(counts) + 2
    figure = new_figure(min(WIDTH, 4.5 * len(populated) + 1.0), 1.2 + ROW * most)
    panels = figure.subplots(1, len(populated), squeeze=False)[0]
    for panel, one in zip(panels, populated, strict=True):
        found, shown = one.population, _own_axis(one.name, one.head)
        rows: list[tuple[str, Known | None, Known]] = [
            (table.name, one.own[table.name], table.known) for table in found.tables if len(one.own) <= MANY
        ]
        rows += [(f"{one.over} {level.name}", None, level.known) for level in found.levels]
        rows += [("mean", None, found.centre), ("new table", None, found.new)]
        for place, (_name, alone, known) in enumerate(rows):
            if alone is not None:
                _interval(panel, one, alone, place - BESIDE, shown, FAINT)
            _interval(panel, one, known, place, shown, TREND if alone is not None else MODEL)
        panel.set_yticks(range(len(rows)), [verbatim(name) for name, *_ in rows], fontsize=8)
        panel.set_ylim(len(rows) - 0.4, -0.6)
        panel.set_xlabel(shown.label)
        panel.grid(axis="x")
    return figure


def _interval(
    panel: Axes, populated: Populated, known: Known, place: float, shown: ParameterAxis, colour: str
) -> None:
    middle, low, high = (end * shown.factor for end in populated.ends(known))
    panel.hlines(place, low, high, color=colour, linewidth=1.6)
    panel.plot(middle, place, "o", color=colour, markersize=4.0)


def quantity_axis(series: Series) -> ParameterAxis:
    """The axis of a quantity: as in every other figure for a parameter."""
    return _own_axis(series.quantity, series.name)


def _own_axis(quantity: str, name: str = "") -> ParameterAxis:
    spec = parameter_spec(quantity) or NOISE_SPECS.get(quantity)
    return ParameterAxis(name or quantity, 1.0, False) if spec is None else parameter_axis(spec)


def _draw(panel: Axes, series: Series, along: Along | None, populated: Populated | None) -> None:
    shown = quantity_axis(series)
    places = np.array(series.rows, dtype=float) if along is None else along.values[list(series.rows)]
    width, crowded = 1.6 if len(places) <= MANY else 0.7, len(places) > CROWDED
    outside = dict(series.outside)
    for own in (False, True):
        chosen = np.array(series.determined) == own
        colour = MODEL if own else FAINT
        panel.vlines(
            places[chosen], series.low[chosen] * shown.factor, series.high[chosen] * shown.factor,
            color=pale(colour, 0.35) if crowded else colour, linewidth=width,
        )  # fmt: skip
        panel.plot(
            places[chosen], series.median[chosen] * shown.factor, "o", color=colour,
            markersize=4.0 if len(places) <= MANY else 2.0,
        )  # fmt: skip
    rings = [k for k, row in enumerate(series.rows) if row in outside]
    panel.plot(
        places[rings], series.median[rings] * shown.factor, "o", markersize=11, markerfacecolor="none", color=TREND
    )
    _lines(panel, series, along, places, shown, populated)
    if populated is not None:
        _levels(panel, series, places, shown, populated)
    if populated is not None and not crowded:
        _pooled(panel, series, places, shown, populated)
    _limit(panel, series, np.isfinite(places), shown)
    panel.set_ylabel(shown.label, fontsize=9)
    panel.grid(axis="y")


def _limit(panel: Axes, series: Series, there: NDArray[np.bool_], shown: ParameterAxis) -> None:
    """Show the intervals of tables whose data determine the value, and the medians of all that are `there`: priors
    may reach far.
    """
    own = there & np.array(series.determined) if any(series.determined) else there
    low = np.nanmin([*series.low[own], *series.median[there]]) * shown.factor
    high = np.nanmax([*series.high[own], *series.median[there]]) * shown.factor
    # One value alone spans nothing.
    if shown.logarithmic and 0.0 < low < high:
        log_scale(panel, *shown.margins(float(low), float(high)), "y")
    elif high > low:
        panel.set_ylim(*replace(shown, logarithmic=False).margins(float(low), float(high), 0.08))


def _levels(panel: Axes, series: Series, places: FloatArray, shown: ParameterAxis, populated: Populated) -> None:
    """Behind each table the value of its level with its interval."""
    for level in populated.population.levels:
        here = [k for k, name in enumerate(series.names) if name in level.tables]
        middle, low, high = (end * shown.factor for end in populated.ends(level.known))
        ends = places[here] - 0.5, places[here] + 0.5
        panel.bar(places[here], high - low, 1.0, low, color=pale(GUIDE, 0.15), zorder=0)
        panel.hlines([middle] * len(here), *ends, color=GUIDE, linewidth=0.8)


def _pooled(panel: Axes, series: Series, places: FloatArray, shown: ParameterAxis, populated: Populated) -> None:
    """Beside each table its value given all others."""
    tables = {table.name: populated.ends(table.known) for table in populated.population.tables if table.trusted}
    kept = [k for k, name in enumerate(series.names) if name in tables]
    middle, low, high = (shown.factor * np.array([tables[series.names[k]] for k in kept])).reshape(-1, 3).T
    beside = places[kept] + BESIDE
    panel.vlines(beside, low, high, color=TREND, linewidth=0.8)
    panel.plot(beside, middle, "_", color=TREND, markersize=4.0)


def _lines(
    panel: Axes,
    series: Series,
    along: Along | None,
    places: FloatArray,
    shown: ParameterAxis,
    populated: Populated | None,
) -> None:
    """The centre of all tables, or the line of a drift."""
    line = next((line for label, line in series.drifts if label is along), None)
    if line is not None:
        used = np.array(series.determined) & np.isfinite(places)
        ends = np.linspace(np.min(places[used]), np.max(places[used]), 50)
        heights = line.coefficients[0] + line.coefficients[1] * (ends - np.mean(places[used]))
        heights = np.exp(heights) if series.logarithmic else heights
        panel.plot(ends, heights * shown.factor, color=TREND, linewidth=1.5)
    elif populated is not None:
        panel.axhline(
            populated.ends(populated.population.centre)[0] * shown.factor, color=GUIDE, linewidth=0.8, linestyle="--"
        )
    elif series.middle is not None:
        panel.axhline(series.middle[0] * shown.factor, color=GUIDE, linewidth=0.8, linestyle="--")


def _name_tables(panel: Axes, tables: Sequence[str]) -> None:
    step = -(-len(tables) // MOST_NAMED)
    places = list(range(0, len(tables), step))
    panel.xaxis.set_major_locator(FixedLocator(places))
    panel.set_xticklabels([verbatim(tables[place]) for place in places], rotation=90, fontsize=7)
    panel.set_xlim(-0.7, len(tables) - 0.3)
    panel.set_xlabel("table" if step == 1 else f"table (one in {step} named)")
