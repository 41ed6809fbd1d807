"""The page of a batch and its figure."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from fitball.base.display_units import CM, PERCENT
from fitball.base.numbers import counted, fixed
from fitball.base.text import listed, one_line, short
from fitball.base.values import Figure
from fitball.batches.batched import Batched
from fitball.batches.control_page import control_figure, control_lines, control_sections
from fitball.batches.passing import passing_lines
from fitball.batches.rows import DONE, ENDS
from fitball.inference.sampling.importance import RELIABLE_K
from fitball.report import style
from fitball.report.blocks import Block, Mark, Picture, Report, Section, Table, Text
from fitball.report.page import Page
from fitball.report.quantities import chance, figure_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import Series

_TONES = {
    "describes": "good",
    "describes except": "part",
    "does not describe": "poor",
    "undecided": "quiet",
}
# Laboratory tests among the columns, of a surface or of all: how a table heads and prints them.
_LABORATORY = re.compile(r"(pace_measured|rebound_measured|mean_passes)(\[.*?\])?(?: \[m\])?")
_LABORATORY_TESTS: Mapping[str, tuple[str, Callable[[float], str]]] = {
    "pace_measured": ("court pace", lambda rating: fixed(rating, 0)),
    "rebound_measured": ("rebound [cm]", lambda height: fixed(CM.factor * height, 1)),
    "mean_passes": ("passes", chance),
}
# Reasons of failures on a first screen.
_MOST_REASONS = 5
# Quantities on a first screen.
_MOST_QUANTITIES = 12
# Panels of the figure.
_MOST_PANELS = 6
# Names of tables along the axis of the figure.
_MOST_NAMES = 24
# Letters of all names that fit side by side.
_LETTERS_BESIDE = 50
# Tables up to which wide intervals are legible.
_MOST_LEGIBLE = 60
# Letters of a reason.
_LETTERS_OF_REASON = 400
_ABOUT = (
    "Mean: centre of a normal population of tables. Spread: its sd, of a positive quantity in "
    "percent. New: a table of which nothing was measured. Every table with a posterior takes part, "
    "also where its data limit a quantity on one side only; the prior of each fit is divided out "
    "(Hogg, Myers and Bovy 2010)."
)
# How tables with each answer on adequacy are counted.
_ANSWERS = {
    "describes": "in {}",
    "describes except": "in {} except for single patterns",
    "does not describe": "not in {}",
}


def report(batch: Batched) -> Report:
    """How many tables were fitted, what failed, each quantity over the tables; then every table."""
    failed = batch.failed
    tables = counted(len(batch.tables), "table")
    done = len(batch.tables) - len(failed)
    lead = [
        Mark(f"{done} of {tables} fitted.", "part" if failed else "good"),
        _described(batch),
    ]
    reasons = [
        f"{name} failed: {one_line(reason, _LETTERS_OF_REASON)}" for name, reason in failed.items()
    ]
    if len(reasons) > _MOST_REASONS:
        more = f"{len(reasons) - _MOST_REASONS} more failed: see `batch.csv`."
        reasons = [*reasons[:_MOST_REASONS], more]
    caption = (
        "Each table: median and 95 % interval; grey where its data alone do not determine it. "
        "Band: 95 % interval of the mean; dashed: of a new table."
    )
    summary: list[Block] = [
        Text(lead, "lead"),
        Text(
            [
                *passing_lines(batch.tables),
                *control_lines(batch.control),
                *(Mark(text, "part") for text in reasons),
            ],
            "list",
        ),
        _population_table(batch),
        Picture("tables", caption),
        Text([note.text for note in batch.notes], "list"),
    ]
    files = (
        "All numbers: `batch.csv`, `population.csv`. Each table has a folder with its fit "
        "(`fit.json`, `fit.nc`)."
    )
    again = "The same command again fits what is not finished, and nothing else."
    sections = [
        *control_sections(batch.control),
        Section("Tables", [_table_of_all(batch)]),
        Section("Method and files", [Text([_ABOUT, files, again])]),
    ]
    return Report(f"Batch of {tables}", summary, sections)


def _described(batch: Batched) -> str:
    """For how many tables the model describes the data."""
    count = Counter(batch.tables["adequacy"].dropna())
    parts = [words.format(count[answer]) for answer, words in _ANSWERS.items() if count[answer]]
    sentences = []
    if parts:
        sentences.append(f"The model describes the data {listed(parts)}.")
    if count["undecided"]:
        undecided = counted(count["undecided"], "data set")
        sentences.append(f"{undecided} too small to test the model.")
    apart = int((batch.tables["status"] == "not converged").sum())
    if apart:
        sentences.append(f"In {apart} sampling did not converge.")
    return " ".join(sentences)


def _population_table(batch: Batched) -> Table:
    """A row a quantity that three tables determine, the first ones."""
    rows = []
    shown = batch.populations.head(_MOST_QUANTITIES)
    for name, population in shown.iterrows():
        unit = batch.of(str(name))[0].display_unit
        cells: dict[str, str] = {
            "quantity": Mark(short(str(name), 28), "name", population["meaning"]),
            "tables": _count(population),
        }
        for head in ("mean", "spread", "new"):
            median, low, high = (float(population[f"{head}{end}"]) for end in ENDS)
            relative = head == "spread" and bool(population["relative"])
            text = (PERCENT if relative else unit).with_interval(median, low, high)
            cells[f"{head}, 95 %"] = f"{text} %" if relative else text
        cells["unit"] = unit.name
        cells[""] = ""
        if population["pareto_k"] > RELIABLE_K:
            hint = f"Pareto k {population['pareto_k']:.2f}"
            cells[""] = Mark("weights unreliable", "part", hint)
        rows.append(cells)
    title = "Over tables"
    if (shown["determine"] < shown["tables"]).any():
        title = "Over tables (in brackets how many of them determine it)"
    return Table(
        title,
        rows,
        ("unit", ""),
        "all are in `population.csv`",
        len(batch.populations),
    )


def _count(population: Series) -> str:
    """How many tables take part, in brackets how many determine the quantity, if not all do."""
    if population["determine"] == population["tables"]:
        return f"{population['tables']}"
    return f"{population['tables']} ({population['determine']})"


def _table_of_all(batch: Batched) -> Table:
    """A row a table: does the model describe it, laboratory tests, why it failed."""
    tables = batch.tables
    several_models = tables["model"].dropna().nunique() > 1
    matches = {str(head): _LABORATORY.fullmatch(str(head)) for head in tables.columns}
    tests = {head: match for head, match in matches.items() if match}
    rows = []
    for name, table in tables.iterrows():
        cells: dict[str, str] = {"table": Mark(short(str(name), 32), "name")}
        if table["outcome"] == DONE:
            cells |= _row_of_fit(table, several_models)
        else:
            cells |= {"impacts": "", "model": "", "fits": Mark("failed", "poor"), "sampling": ""}
        for head, match in tests.items():
            title, text = _LABORATORY_TESTS[match[1]]
            surface = f" on {match[2][1:-1]}" if match[2] else ""
            cells[f"{title}{surface}"] = text(float(table[head]))
        cells["why"] = ""
        if table["outcome"] != DONE:
            cells["why"] = Mark(
                str(table["code"]), "", one_line(str(table["reason"]), _LETTERS_OF_REASON)
            )
        rows.append(cells)
    return Table("", rows, ("model", "fits", "why"))


def _row_of_fit(table: Series, several_models: bool) -> dict[str, str]:
    """Cells of a table that was fitted."""
    adequacy = str(table["adequacy"])
    status = str(table["status"])
    return {
        "impacts": f"{table['impacts']:,}",
        "model": str(table["model"]) if several_models else "",
        "fits": Mark(adequacy, _TONES[adequacy]),
        "sampling": Mark(status, "poor") if status == "not converged" else "",
    }


def figures(batch: Batched) -> Mapping[str, Callable[[], Figure]]:
    """The quantities over the tables, and their control charts, if any."""
    drawn = dict[str, Callable[[], Figure]]()
    if len(batch.populations):
        drawn["tables"] = partial(_figure, batch)
    if batch.control:
        drawn["control"] = partial(control_figure, batch.control)
    return drawn


def _figure(batch: Batched) -> Figure:
    """A panel a quantity: tables in their order, the mean of all and a new one."""
    tables = batch.tables
    populations = batch.populations.head(_MOST_PANELS)
    count = len(populations)
    figure, axes = style.new_figure(count, 1, high=0.9 + 1.25 * count, sharex=True)
    for panel, (name, population) in zip(axes[:, 0], populations.iterrows(), strict=True):
        _draw_quantity(panel, batch, str(name), population)
    step = -(-len(tables) // _MOST_NAMES)
    names = [figure_text(str(name), 20) for name in tables.index[::step]]
    rotation = 90 if len("".join(names)) > _LETTERS_BESIDE else 0
    last = axes[-1, 0]
    last.set_xticks(np.arange(len(tables))[::step], names, rotation=rotation)
    last.set_xlim(-0.6, len(tables) - 0.4)
    return figure


def _draw_quantity(axes: Axes, batch: Batched, name: str, population: Series) -> None:
    """Draw a quantity of all tables, and its population."""
    tables = batch.tables
    first = batch.of(name)[0]
    factor = first.display_unit.factor
    heads = [f"{name}{end}" for end in ENDS]
    if first.unit:
        heads[0] = f"{name} [{first.unit}]"
    middle, low, high = (factor * tables[head].to_numpy(np.float64) for head in heads)
    of_tables = [batch.quantities[table].get(name) for table in tables.index]
    determined = np.array([entry is not None and entry.determined for entry in of_tables])
    width, size = (1.6, 4.0) if len(tables) <= _MOST_LEGIBLE else (0.6, 1.5)
    for group, colour in ((~determined, style.PALE), (determined, style.MODEL_COLOUR)):
        rows = np.flatnonzero(group & np.isfinite(middle))
        axes.vlines(rows, low[rows], high[rows], color=colour, linewidth=width)
        axes.plot(rows, middle[rows], "o", color=colour, markersize=size)
    mean = [factor * population[f"mean{end}"] for end in ENDS[1:]]
    new = [factor * population[f"new{end}"] for end in ENDS[1:]]
    axes.axhspan(*mean, color=style.FAINT, zorder=0)
    for end in new:
        axes.axhline(end, color=style.GUIDE_COLOUR, linewidth=0.8, linestyle="--", zorder=0)
    # Priors of what is not determined may reach far.
    ends = np.array([*low[determined], *high[determined], *middle[np.isfinite(middle)], *new])
    ends = ends[np.isfinite(ends)]
    margin = 0.06 * np.ptp(ends)
    axes.set_ylim(ends.min() - margin, ends.max() + margin)
    axes.set_title(style.axis_label(figure_text(name, 30), first.display_unit))
    axes.grid(axis="x", visible=False)
    style.few_ticks(axes.yaxis)


PAGE = Page(report, figures)
