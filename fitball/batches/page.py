"""Its page and figure."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from fitball.base.display_units import CM, PERCENT
from fitball.base.numbers import counted, fixed
from fitball.base.text import listed, one_line, short
from fitball.base.values import Figure
from fitball.batches.batched import Batched
from fitball.batches.rows import DONE, ENDS
from fitball.inference.sampling.importance import RELIABLE
from fitball.report import style
from fitball.report.blocks import Block, Mark, Picture, Report, Section, Table, Text
from fitball.report.page import Page
from fitball.report.quantities import chance, plain

_TONES = {
    "describes": "good",
    "describes except": "part",
    "does not describe": "poor",
    "undecided": "quiet",
}
# Laboratory tests among the columns, of a surface or of all: how a table heads and prints them.
_TEST = re.compile(r"(pace_measured|rebound_measured|mean_passes)(\[.*?\])?(?: \[m\])?")
_TESTS: Mapping[str, tuple[str, Callable[[float], str]]] = {
    "pace_measured": ("court pace", lambda rating: fixed(rating, 0)),
    "rebound_measured": ("rebound [cm]", lambda height: fixed(CM.factor * height, 1)),
    "mean_passes": ("passes", chance),
}
# Reasons and quantities of a first screen, panels of the figure; names along its axis,
# letters of those that fit side by side, and intervals that are legible.
_REASONS = 5
_FIRST = 12
_PANELS = 6
_NAMED = 24
_ROOM = 50
_CROWDED = 60
_ABOUT = (
    "Mean: centre of a normal population of tables. Spread: its sd, of a positive quantity in "
    "percent. New: a table "
    "of which nothing was measured. Tables count whose data determine the quantity; the prior of "
    "each fit is divided "
    "out (Hogg, Myers and Bovy 2010)."
)


def report(batch: Batched) -> Report:
    """How many tables were fitted, what failed, each quantity over the tables; then every table."""
    tables = batch.tables
    failed = batch.failed
    done = len(tables) - len(failed)
    lead = [
        Mark(f"{done} of {counted(len(tables), 'table')} fitted.", "part" if failed else "good"),
        _described(batch),
    ]
    reasons = [f"{name} failed: {one_line(reason, 400)}" for name, reason in failed.items()]
    more = [f"{len(failed) - _REASONS} more failed: see `batch.csv`."] * (len(failed) > _REASONS)
    summary: list[Block] = [
        Text(lead, "lead"),
        Text([Mark(text, "part") for text in [*reasons[:_REASONS], *more]], "list"),
        _population_table(batch),
        Picture(
            "tables",
            "Each table: median and 95 % interval; grey where its data do not determine the "
            "quantity. "
            "Band: 95 % interval of the mean; dashed: of a new table.",
        ),
        Text([note.text for note in batch.notes], "list"),
    ]
    files = (
        "All numbers: `batch.csv`, `population.csv`. Each table has a folder with its fit "
        "(`fit.json`, `fit.nc`)."
    )
    again = "The same command again fits what is not finished, and nothing else."
    return Report(
        f"Batch of {counted(len(tables), 'table')}",
        summary,
        [
            Section("Tables", [_table_of_all(batch)]),
            Section("Method and files", [Text([_ABOUT, files, again])]),
        ],
    )


def _described(batch: Batched) -> str:
    """For how many tables the model describes the data."""
    count = Counter(batch.tables["adequacy"].dropna())
    excepted = "in {} except for single patterns"
    said = {"describes": "in {}", "describes except": excepted, "does not describe": "not in {}"}
    found = [words.format(count[answer]) for answer, words in said.items() if count[answer]]
    parts = [f"The model describes the data {listed(found)}."] * bool(found)
    parts += [f"{counted(count['undecided'], 'data set')} too small to test the model."] * bool(
        count["undecided"]
    )
    apart = int((batch.tables["status"] == "not converged").sum())
    return " ".join([*parts, *[f"In {apart} sampling did not converge."] * bool(apart)])


def _population_table(batch: Batched) -> Table:
    rows = []
    for name, one in batch.populations.head(_FIRST).iterrows():
        unit = batch.of(str(name))[0].display_unit
        relative = bool(one["relative"])
        cells: dict[str, str] = {
            "quantity": Mark(short(str(name), 28), "name", one["meaning"]),
            "tables": f"{one['tables']}",
        }
        for head in ("mean", "spread", "new"):
            middle, low, high = (float(one[f"{head}{end}"]) for end in ENDS)
            shown = PERCENT if head == "spread" and relative else unit
            text = shown.with_interval(middle, low, high)
            cells[f"{head}, 95 %"] = f"{text} %" if shown.name == "%" else text
        doubt = Mark("weights unreliable", "part", f"Pareto k {one['pareto_k']:.2f}")
        rows.append({**cells, "unit": unit.name, "": doubt if one["pareto_k"] > RELIABLE else ""})
    return Table(
        "Over tables",
        rows,
        ("unit", ""),
        "all are in `population.csv`",
        len(batch.populations),
    )


def _table_of_all(batch: Batched) -> Table:
    """A row a table: does the model describe it, laboratory tests, why it failed."""
    tables = batch.tables
    rows = []
    models = tables["model"].dropna().nunique()
    tests = [(str(head), found) for head in tables.columns if (found := _TEST.fullmatch(str(head)))]
    for name, one in tables.iterrows():
        done = one["outcome"] == DONE
        status = str(one["status"])
        cells: dict[str, str] = {
            "table": Mark(short(str(name), 32), "name"),
            "impacts": f"{one['impacts']:,}" if done else "",
            "model": str(one["model"]) if done and models > 1 else "",
            "fits": Mark(str(one["adequacy"]), _TONES[str(one["adequacy"])])
            if done
            else Mark("failed", "poor"),
            "sampling": Mark(status, "poor") if status == "not converged" else "",
        }
        for head, found in tests:
            title, text = _TESTS[found[1]]
            cells[f"{title}{' on ' * bool(found[2])}{(found[2] or '')[1:-1]}"] = text(
                float(one[head])
            )
        cells["why"] = "" if done else Mark(str(one["code"]), "", one_line(str(one["reason"]), 400))
        rows.append(cells)
    return Table("", rows, ("model", "fits", "why"))


def figures(batch: Batched) -> Mapping[str, Callable[[], Figure]]:
    """The quantities over the tables, if any."""
    return {"tables": partial(_figure, batch)} if len(batch.populations) else {}


def _figure(batch: Batched) -> Figure:
    """A panel a quantity: tables in their order, the mean of all and a new one."""
    tables = batch.tables
    shown = batch.populations.head(_PANELS)
    figure, axes = style.new_figure(len(shown), 1, high=0.9 + 1.25 * len(shown), sharex=True)
    places = np.arange(len(tables))
    width, size = (1.6, 4.0) if len(tables) <= _CROWDED else (0.6, 1.5)
    for panel, (name, over) in zip(axes[:, 0], shown.iterrows(), strict=True):
        name = str(name)
        first = batch.of(name)[0]
        column = f"{name} [{first.unit}]" if first.unit else name
        middle, low, high = (
            first.display_unit.factor * tables[head].to_numpy(np.float64)
            for head in (column, *(f"{name}{e}" for e in ENDS[1:]))
        )
        known = np.array([name in batch.quantities[table] for table in tables.index])
        for own, colour in ((False, style.PALE), (True, style.MODEL)):
            rows = np.flatnonzero((known == own) & np.isfinite(middle))
            panel.vlines(places[rows], low[rows], high[rows], color=colour, linewidth=width)
            panel.plot(places[rows], middle[rows], "o", color=colour, markersize=size)
        mean, new = (
            [first.display_unit.factor * over[f"{head}{end}"] for end in ENDS[1:]]
            for head in ("mean", "new")
        )
        panel.axhspan(*mean, color=style.FAINT, zorder=0)
        for end in new:
            panel.axhline(end, color=style.GUIDE, linewidth=0.8, linestyle="--", zorder=0)
        # Priors of what is not determined may reach far.
        ends = np.array([*low[known], *high[known], *middle[np.isfinite(middle)], *new])
        ends = ends[np.isfinite(ends)]
        panel.set_ylim(ends.min() - 0.06 * np.ptp(ends), ends.max() + 0.06 * np.ptp(ends))
        panel.set_title(style.label(plain(name, 30), first.display_unit))
        panel.grid(axis="x", visible=False)
        style.few_ticks(panel.yaxis)
    step = -(-len(tables) // _NAMED)
    named = [plain(str(name), 20) for name in tables.index[::step]]
    axes[-1, 0].set_xticks(places[::step], named, rotation=90 if len("".join(named)) > _ROOM else 0)
    axes[-1, 0].set_xlim(-0.6, len(tables) - 0.4)
    return figure


PAGE = Page(report, figures)
