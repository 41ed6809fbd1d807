"""A batch for a person: one document, for terminal and page, and the files of the whole: CSV, Parquet, figures."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from fitball.inference.population.hyper import Known
from fitball.inference.results.evidence import Answer
from fitball.inference.results.results import RunStatus
from fitball.inference.sampling.importance import K_TRUSTED
from fitball.report.batch.populations import Populated, default_names, populations, write_populations
from fitball.report.batch.rows import CSV_NAME, DONE, FAILED, NAME, Row
from fitball.report.batch.series import REACH, Along, Over, Series, all_series
from fitball.report.form.document import (
    MOST_LINES,
    MOST_ROWS,
    Document,
    Picture,
    Section,
    Table,
    Words,
    as_page,
    on_terminal,
    term,
)
from fitball.report.form.files import remove, write_bytes, write_csv, write_text
from fitball.report.form.numbers import Scale, listed, percent, significant
from fitball.wording import spoken

CENTRE_HEADS = ("quantity", "unit", "told by", "centre", "95 %", "spread", "95 %", "typical sd")
# The same where tables lie on levels.
OVER_HEADS = (*CENTRE_HEADS[:5], "between levels", "95 %", "within levels", "95 %", "typical sd")
LEVEL_HEADS = ("quantity", "unit", "level", "tables", "value", "95 %", "a new table there, 95 %")
LEGEND = (
    "Told by: tables that tell the value themselves, not their prior alone. Centre: about what the tables' true "
    "values scatter, with its 95 % interval; spread: their standard deviation, of the logarithm where it stands in "
    "percent. Both are of the population of all tables with a posterior, their draws weighted so that the prior of "
    "each gives way to the population (Hogg, Myers and Bovy 2010). Quantities whose prior cannot be divided out, "
    "such as court pace, have no interval of the spread: random effects on the medians of the tables that tell them. "
    "Typical sd: median uncertainty of one table."
)

LEVELS = (
    "The value about which the tables of a level scatter, given all tables, and where 95 % of new tables would lie: "
    "on that level, and on a level that is not among these."
)
POOLED = (
    "Median +- standard deviation: alone, with the prior of its own fit, and partially pooled, with the population "
    "in that prior's place: a table that tells little leans on the others. ?: its weights are not to be trusted."
)
TABLES = (
    "Median +- standard deviation, of a point fit the best value. The folder named like the table holds its "
    "`fit.json`."
)
CAPTIONS = {
    "parameters.png": "Each quantity over the tables: median and 95 % interval. Pale where a table does not tell the "
    "value itself and the prior does; dashed the centre of the population, beside each table, unless they crowd, in "
    "purple what it has given all others; grey behind, where tables lie on levels, the value of the level; ringed "
    "what lies outside their bulk.",
    "drift.png": "Quantities that drift: the line over what they drift along, with each table's median and interval.",
}
PAGE_NAME, PARQUET_NAME = "batch.html", "batch.parquet"
PICTURE, DRIFT = "parameters.png", "drift.png"
# Sd that a finite number of draws gives a mean, as a share of the 95 % interval, above which that is told.
MOST_ERROR = 0.1
# Populations with poor weights that are told one by one.
MOST_POOR = 2
# Tables that are practical to fit together.
MOST_TOGETHER = 12


def batch_document(
    rows: Sequence[Row],
    series: Sequence[Series],
    populated: Sequence[Populated] = (),
    pictures: Collection[str] = (),
    command: str | None = None,
    folder: Path | None = None,
) -> Document:
    """All that is said of a batch, with those of the pictures of `CAPTIONS` that there are; `command` is the line
    that made it, None where none did, `folder` where its files are.
    """
    said = told(rows, series, populated)
    headline = said.headline[0].upper() + said.headline[1:]
    left = len(said.failed) - MOST_LINES
    centres, levels = centre_rows(series, populated), level_rows(populated)
    listing = [cells(row, place, series) for place, row in enumerate(rows[:MOST_ROWS])]
    pooled = [
        pooled_cells(str(row[NAME]), place, series, populated)
        for place, row in enumerate(rows[:MOST_ROWS])
        if row["outcome"] == DONE and populated
    ]
    sections = [
        Section("failed", "Tables that could not be fitted", [
            Words([term(name, reason) for name, reason in said.failed[:MOST_LINES]], "list"),
            Words([f"{left:,} more stand in `batch.csv` with their reasons."] if left > 0 else [], "quiet"),
        ]),
        Section("parameters", "Parameters over the tables", [
            *[Picture(name, CAPTIONS[name], f"{CAPTIONS[name]} {headline}") for name in CAPTIONS if name in pictures],
            Table("Centre and spread of each quantity", [centre_heads(populated), *centres], ["unit"], rank="first"),
            Words([LEGEND] * bool(centres), "quiet", "page"),
        ]),
        Section("levels", "Each level", [
            Words([LEVELS] * bool(levels), only="page"),
            Table("What new tables would have", [LEVEL_HEADS, *levels], ["unit", "level"], rest="`batch.html`"),
        ]),
        Section("pooled", "Each table, given all", [
            Words([POOLED] * bool(pooled), only="page"),
            Table(
                "Tables alone and given all",
                [
                    ("table", *(head for one in populated for head in (f"{one.head} alone", "given all"))), *pooled
                ], only="page",
            ),
        ]),
        Section("tables", "Each table", [
            Words([TABLES], only="page"),
            Table(
                "Every table with its parameters",
                [("table", "impacts", "outcome", "describes", *(one.head for one in series)), *listing],
                ["outcome", "describes"], count=len(rows), only="page",
                rest="`batch.csv`, which holds every number of this page and more",
            ),
        ]),
        Section("repeat", "How to repeat it", [
            Words([] if command is None else [command], "code", "page"),
            Words(
                [] if command is None else ["The same line goes on after an interruption, and fits nothing twice."],
                only="page",
            ),
        ]),
        Section("", "", [Words([] if folder is None else [
            f"{folder / PAGE_NAME}, batch.csv; each table has its folder beside them"
        ], only="terminal")]),
    ]  # fmt: skip
    title = f"{len(rows):,} table{'s, each' if len(rows) != 1 else ''} fitted by itself"
    return Document(
        title, [Words([headline], "lead", rank="first"), Words(said.points, "list", rank="first")], sections
    )


def render(rows: Sequence[Row], series: Sequence[Series], folder: Path, populated: Sequence[Populated] = ()) -> str:
    """What a batch found, on a terminal."""
    return on_terminal(batch_document(rows, series, populated, folder=folder))


@dataclass(frozen=True)
class Shown:
    """What the files of a batch show: quantities over the tables, and the populations of some of them."""

    series: tuple[Series, ...]
    populated: tuple[Populated, ...]


def write_results(
    rows: Sequence[Row],
    folder: Path,
    command: str | None = None,
    quantities: Sequence[str] = (),
    over: Over = None,
) -> Shown:
    """Write every file, each whole or not at all; `command` is the line that asked. Returns what they show.

    Populations are those of parameters that enough tables tell, and of `quantities`, `over` levels or not. Parquet
    needs pyarrow, and is left out without it. Raises ResultFolderError, ParameterError as `populations` does.
    """
    from fitball.report.batch.figure import batch_figure
    from fitball.report.figures.canvas import save_figure

    series = all_series(rows)
    populated = populations(rows, folder, [*default_names(series), *quantities], over)
    write_populations(populated, folder)
    write_csv(folder / CSV_NAME, rows)
    if find_spec("pyarrow") is not None:
        _write_parquet(rows, folder / PARQUET_NAME)
    figures = {}
    if series:
        names = [str(row[NAME]) for row in rows]
        figures[PICTURE] = batch_figure(series, names, populated=populated)
        along = most_told(series)
        if along is not None:
            figures[DRIFT] = batch_figure(_drifting(series, along), names, along)
    for name in {PICTURE, DRIFT} - set(figures):
        remove(folder / name)
    images = {name: save_figure(figure, folder / name) for name, figure in figures.items()}
    write_text(folder / PAGE_NAME, as_page(batch_document(rows, series, populated, images, command), images))
    return Shown(series, populated)


def most_told(series: Sequence[Series]) -> Along | None:
    """What most quantities drift along."""
    found = [along for one in series for along, _line in one.drifts]
    return max(found, key=lambda along: sum(other is along for other in found), default=None)


def _drifting(series: Sequence[Series], along: Along) -> list[Series]:
    return [one for one in series if any(item is along for item, _line in one.drifts)]


def _write_parquet(rows: Sequence[Row], place: Path) -> None:
    import pandas as pd

    made = io.BytesIO()
    pd.DataFrame(list(rows)).to_parquet(made, index=False)
    write_bytes(place, made.getvalue())


def pooled_cells(name: str, place: int, series: Sequence[Series], populated: Sequence[Populated]) -> tuple[str, ...]:
    """One table as text: each quantity alone, and given the other tables; `?` where weights are not to be trusted."""
    columns = {one.quantity: one for one in series}
    shown = [name]
    for one in populated:
        table = next((table for table in one.population.tables if table.name == name), None)
        if table is None:
            shown += ["-", "-"]
            continue
        column = columns.get(one.quantity.name)
        # A ratio is no column of the tables: its draws are all there is.
        shown.append(cell(column, place) if column is not None else _drawn(one, one.own[name], one.own_sds[name]))
        shown.append(_drawn(one, table.known, table.sd) + ("" if table.trusted else " ?"))
    return tuple(shown)


def _drawn(populated: Populated, known: Known, sd: float) -> str:
    middle = populated.quantity.value(known.median)
    return populated.scale.plus_minus(middle, sd * (middle if populated.quantity.log else 1.0))


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
    middle, sd = float(series.median[k]), float(series.sd[k])
    return series.scale.plus_minus(middle, sd) if np.isfinite(sd) else significant(middle * series.scale.factor, 4)


@dataclass(frozen=True)
class Told:
    """A batch in words: a headline, what stands out, and who failed with the reason."""

    headline: str
    points: tuple[str, ...]
    failed: tuple[tuple[str, str], ...]


def told(rows: Sequence[Row], series: Sequence[Series], populated: Sequence[Populated] = ()) -> Told:
    """The words for the rows of a batch and their series."""
    failed = tuple((str(row[NAME]), str(row["reason"])) for row in rows if row["outcome"] == FAILED)
    done = [row for row in rows if row["outcome"] == DONE]
    parts = [f"{len(done):,} of {len(rows):,} tables fitted" if failed else _all_fitted(len(done))]
    if failed:
        parts.append(f"{len(failed):,} failed")
    unsure = [str(row[NAME]) for row in done if row["status"] == RunStatus.NOT_CONVERGED]
    if unsure:
        parts.append(f"{len(unsure):,} did not converge ({_some(unsure)})")
    answers = Counter(str(row["adequacy"]) for row in done if row["adequacy"] is not None)
    points = []
    if answers:
        said = [f"{answers[answer]:,} {words}" for answer, words in ANSWERS.items() if answers[answer]]
        points.append("Does the model describe the table? " + "; ".join(said) + ".")
        refused = [str(row[NAME]) for row in done if row["adequacy"] == Answer.FAILS]
        if refused:
            points.append(
                f"Not described: {_some(refused)}. What is said of their parameters holds within the model only."
            )
    points += [sentence for one in series for sentence in _standing_out(one)]
    points += dict.fromkeys(sentence for one in populated for sentence in one.said)
    points += doubts_of_all(populated)
    return Told("; ".join(parts) + ".", tuple(points), failed)


ANSWERS = {
    Answer.DESCRIBES: "described",
    Answer.EXCEPT: "described with exceptions",
    Answer.FAILS: "not described",
    Answer.UNTOLD: "that cannot tell",
}


def _all_fitted(count: int) -> str:
    return f"all {count:,} tables fitted" if count > 1 else "one table fitted"


def _some(names: Sequence[str], most: int = 5) -> str:
    """The first names of many."""
    more = len(names) - most
    return listed(names) if more <= 0 else f"{', '.join(names[:most])} and {more:,} more"


def _standing_out(series: Series) -> list[str]:
    """Drifts and outliers of a quantity, in words."""
    sentences = []
    for along, line in series.drifts:
        # A slope of logarithms is a share of the quantity.
        scale = Scale("%", 100.0) if series.logarithmic else series.scale
        slope, low, high = (float(end[1]) for end in (line.coefficients, line.low, line.high))
        per = f"{scale.unit} per day" if along.first_day is not None else f"{scale.unit} per unit of {along.name}"
        sentences.append(
            f"{series.name} drifts along {along.name}: {' '.join(_with_ends(scale, slope, low, high))} {per.strip()} "
            f"(p = {significant(float(line.p[1]), 2)}, not corrected for the number of quantities)."
        )
    if series.outside:
        places_of = dict(zip(series.rows, series.names, strict=True))
        far = [f"{places_of[row]} ({distance:+.1f} sd)" for row, distance in series.outside]
        sentences.append(f"{series.name} lies outside the bulk in {_some(far)}.")
    return sentences


def _with_ends(scale: Scale, middle: float, low: float, high: float) -> tuple[str, str]:
    """A value and its 95 % interval, all SI, in the unit people read."""
    places = scale.decimals((high - low) / (2.0 * REACH))
    return scale.fixed(middle, places), scale.interval(low, high, places)


def centre_rows(series: Sequence[Series], populated: Sequence[Populated] = ()) -> list[tuple[str, ...]]:
    """For each quantity about what it scatters over the tables, in the unit people read."""
    rows: list[tuple[str, ...]] = []
    known = {one.name: one for one in populated}
    for one in series:
        counted = np.array(one.told) & np.isfinite(one.sd)
        head = (one.name, one.scale.unit, f"{counted.sum():,} of {len(one.names):,}")
        if one.quantity in known:
            rows.append((*head, *population_cells(known.pop(one.quantity))))
        elif one.middle is None or one.centre is None:
            rows.append((*head, *["-"] * 5))
        else:
            # Of logarithms a small spread is a share.
            spread = one.centre.spread * (one.middle[0] if one.logarithmic else 1.0)
            spread, typical = spread * one.scale.factor, float(np.median(one.sd[counted])) * one.scale.factor
            rows.append(
                (*head, *_with_ends(one.scale, *one.middle), significant(spread, 2), "-", significant(typical, 2))
            )
    # A ratio is no column of the tables.
    rows += [(*_named(one), f"- of {len(one.own):,}", *population_cells(one)) for one in known.values()]
    # What has no levels has no spread within them.
    wide = len(centre_heads(populated))
    return [row if len(row) == wide else (*row[:7], "-", "-", row[7]) for row in rows]


def _named(populated: Populated) -> tuple[str, str]:
    return populated.name, populated.scale.unit


def centre_heads(populated: Sequence[Populated]) -> tuple[str, ...]:
    """Heads of the rows about what quantities scatter."""
    return OVER_HEADS if any(one.population.levels for one in populated) else CENTRE_HEADS


def level_rows(populated: Sequence[Populated]) -> list[tuple[str, ...]]:
    """For each quantity the value of each level, and of one to come, with what a new table there would have."""
    rows: list[tuple[str, ...]] = []
    for one in populated:
        found = one.population
        for level in found.levels:
            new = "-" if level.new is None else _known_cells(one, level.new)[1]
            rows.append((*_named(one), level.name, f"{len(level.tables):,}", *_known_cells(one, level.known), new))
        if found.new_level is not None:
            new = _known_cells(one, found.new)[1]
            rows.append((*_named(one), "a new one", "-", *_known_cells(one, found.new_level), new))
    return rows


def _known_cells(populated: Populated, known: Known) -> tuple[str, str]:
    """Something in the coordinate with its interval, in the unit people read."""
    return _with_ends(populated.scale, *populated.ends(known))


def population_cells(populated: Populated) -> tuple[str, ...]:
    """Centre and spread with their intervals, and the typical sd of a table, in the unit people read."""
    found = populated.population
    # Of logarithms a spread is a share, and so is the uncertainty of a table.
    scale, sign = (Scale("%", 100.0), " %") if populated.quantity.log else (populated.scale, "")
    cells = list(_known_cells(populated, found.centre))
    for spread in (found.spread, found.within):
        if spread is not None:
            size, ends = _with_ends(scale, spread.median, spread.low, spread.high)
            cells += [f"{size}{sign}", ends]
    typical = float(np.median(list(populated.own_sds.values()))) * scale.factor
    return (*cells, f"{significant(typical, 2)}{sign}")


def doubts_of_all(populated: Sequence[Populated]) -> list[str]:
    """What is not to be trusted of populations; of many with poor weights as one sentence."""
    poor = [one for one in populated if one.population.doubtful]
    if len(poor) <= MOST_POOR:
        return [sentence for one in populated for sentence in doubts(one)]
    named = listed([one.quantity.name for one in poor])
    count = len({name for one in poor for name in one.population.doubtful})
    together = (
        f"Populations of {named}: weights are not to be trusted (Pareto k above {K_TRUSTED}) in some of {count:,} "
        "tables (? on the page, k in population.csv): few draws there meet the population."
    )
    return [sentence for one in populated if one not in poor for sentence in doubts(one)] + [together]


def doubts(populated: Populated) -> list[str]:
    """What of a population is not to be trusted, and what would help."""
    found, name = populated.population, populated.name
    said = []
    for words, number in (("centre", found.centre), ("spread", found.spread), ("spread within", found.within)):
        if number is not None and number.error > MOST_ERROR * (number.high - number.low):
            share = number.error / (number.high - number.low)
            said.append(
                f"The {words} of {name} is known to {percent(share)} of its interval only, for want of draws."
            )
    if found.doubtful:
        few, each = ("table", "it") if len(found.doubtful) == 1 else ("tables", "them")
        said.append(
            f"Population of {name}: weights are not to be trusted (Pareto k above {K_TRUSTED}) in "
            f"{len(found.doubtful)} {few} ({_some(found.doubtful)}), nor what the others say of {each}: few draws "
            "there meet the population."
        )
    if said and len(populated.quantity.parts) == 1 and len(found.tables) <= MOST_TOGETHER:
        how = spoken(
            f"fitball calibrate TABLES --pool {name}=table", f"calibrate(tables, pool={{'{name}': 'table'}})"
        )
        said[-1] += f" So few tables can be fitted together instead: {how}."
    return said
