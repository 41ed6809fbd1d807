"""`batch.html`: many fits as one page that needs nothing but itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitball.inference.population.hyper import Known
from fitball.report.batch.populations import Populated
from fitball.report.batch.rows import DONE, NAME, Row
from fitball.report.batch.series import Series
from fitball.report.batch.words import LEGEND, LEVEL_HEADS, centre_heads, centre_rows, level_rows, told
from fitball.report.figures.embed import embed
from fitball.report.form.display_units import handy
from fitball.report.form.rounding import decimals, fixed, significant
from fitball.report.form.template import render_template

# Tables listed one by one; batch.csv holds them all.
MOST_ROWS = 300
MOST_FAILED = 50
CAPTIONS = {
    "parameters.png": "Each quantity over the tables: median and 95 % interval. Pale where a table does not tell the "
    "value itself and the prior does; dashed the centre of the population, beside each table, unless they crowd, in "
    "purple what it has given all others; grey behind, where tables lie on levels, the value of the level; ringed "
    "what lies outside their bulk.",
    "drift.png": "Quantities that drift: the line over what they drift along, with each table's median and interval.",
}


def batch_page(
    rows: Sequence[Row],
    series: Sequence[Series],
    images: Mapping[str, bytes],
    command: str | None = None,
    populated: Sequence[Populated] = (),
) -> str:
    """The page as text; `images` are PNG files by the names of `CAPTIONS`; `command` is the line that made
    it, None where none did.
    """
    said = told(rows, series, populated)
    return render_template(
        "fitball.report",
        "batch.html.j2",
        said=said,
        failed=said.failed[:MOST_FAILED],
        failed_left=max(0, len(said.failed) - MOST_FAILED),
        heading=f"{len(rows):,} table{'s, each' if len(rows) != 1 else ''} fitted by itself",
        figures=[
            embed(images[name], CAPTIONS[name], f"{CAPTIONS[name]} {said.headline[0].upper()}{said.headline[1:]}")
            for name in CAPTIONS
            if name in images
        ],
        centre_heads=centre_heads(populated),
        centres=centre_rows(series, populated),
        level_heads=LEVEL_HEADS,
        levels=level_rows(populated),
        legend=LEGEND,
        heads=("table", "impacts", "outcome", "describes", *(head(one) for one in series)),
        tables=[cells(row, place, series) for place, row in enumerate(rows[:MOST_ROWS])],
        pooled_heads=("table", *(words for one in populated for words in pooled_heads(one))),
        pooled=[
            pooled_cells(str(row[NAME]), place, series, populated)
            for place, row in enumerate(rows[:MOST_ROWS])
            if row["outcome"] == DONE
        ],
        left=max(0, len(rows) - MOST_ROWS),
        command=command,
    )


def head(series: Series) -> str:
    """Column head with the unit people read."""
    unit = handy(series.quantity, series.unit).unit
    return f"{series.name}{f' [{unit}]' if unit else ''}"


def pooled_heads(populated: Populated) -> tuple[str, str]:
    """Heads of the columns of a quantity: alone, and given the other tables."""
    unit = handy(populated.quantity.name, populated.quantity.unit).unit
    name = f"{populated.name}{f' [{unit}]' if unit else ''}"
    return f"{name} alone", "given all"


def pooled_cells(name: str, place: int, series: Sequence[Series], populated: Sequence[Populated]) -> tuple[str, ...]:
    """One table as text: each quantity alone, and given the other tables; `?` where weights are not to be trusted."""
    columns = {one.quantity: one for one in series}
    shown = [name]
    for one in populated:
        table = next((table for table in one.population.tables if table.name == name), None)
        if table is None:
            shown += ["-"] * len(pooled_heads(one))
            continue
        column = columns.get(one.quantity.name)
        # A ratio is no column of the tables: its draws are all there is.
        alone = cell(column, place) if column is not None else _drawn(one, one.own[name], one.own_sds[name])
        shown += [alone, _drawn(one, table.known, table.sd) + ("" if table.trusted else " ?")]
    return tuple(shown)


def _drawn(populated: Populated, known: Known, sd: float) -> str:
    quantity = populated.quantity
    factor = handy(quantity.name, quantity.unit).factor
    middle = quantity.value(known.median) * factor
    size = sd * (middle if quantity.log else factor)
    return f"{fixed(middle, decimals(size))} ± {fixed(size, decimals(size))}"


def cells(row: Row, place: int, series: Sequence[Series]) -> tuple[str, ...]:
    """One table as text: outcome, adequacy, each quantity with its sd."""
    outcome = str(row["status"]) if row["outcome"] == DONE else "failed"
    shown = (str(row[NAME]), str(row["impacts"] or "-"), outcome, str(row["adequacy"] or "-"))
    return (*shown, *(cell(one, place) for one in series))


def cell(series: Series, place: int) -> str:
    """A quantity of the table at `place` with its sd."""
    if place not in series.rows:
        return "-"
    k = series.rows.index(place)
    factor = handy(series.quantity, series.unit).factor
    middle, sd = float(series.median[k]) * factor, float(series.sd[k]) * factor
    if not np.isfinite(sd):
        return significant(middle, 4)
    return f"{fixed(middle, decimals(sd))} ± {fixed(sd, decimals(sd))}"
