"""A batch for a person: one document, for terminal and page, and the files of the whole: CSV, Parquet, figures."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
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
from fitball.report.batch.slips import slips
from fitball.report.form.document import (
    MOST_LINES,
    MOST_ROWS,
    Document,
    Part,
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
from fitball.wording import option, screen, spoken

CENTRE_HEADS = (
    "quantity", "unit", "determined by", "mean", "95 % of mean", "spread", "95 % of spread", "typical sd",
)  # fmt: skip
# The same where tables have levels.
OVER_HEADS = (
    *CENTRE_HEADS[:5], "between levels", "95 % of between", "within levels", "95 % of within", "typical sd",
)  # fmt: skip
# Those of either that a first screen has room for.
BRIEF_HEADS = ("unit", "determined by", "mean", "95 % of mean", "spread")
BRIEF_OVER = ("unit", "mean", "95 % of mean", "between levels", "within levels")
LEVEL_HEADS = ("quantity", "unit", "level", "tables", "value", "95 %", "a new table there, 95 %")
LEGEND = (
    "determined by: number of tables whose data determine the value. mean: population mean of the true values, with "
    "its 95 % interval. spread: population standard deviation; in percent, that of the logarithm. typical sd: median "
    "uncertainty of one table. Mean and spread use the posterior draws of all tables. They are reweighted so "
    "that the population replaces the prior of each table (Hogg, Myers and Bovy 2010). Court pace and other "
    "quantities whose prior cannot be divided out have no interval of the spread. Theirs is a random-effects "
    "estimate from the medians of the tables that determine them."
)

LEVELS = (
    "Mean of each level, given all tables, and the 95 % interval of a new table there. A new one: a level that has "
    "no table yet."
)
POOLED = (
    "Median +- sd: alone, with the prior of the table's own fit; and partially pooled, with the population as prior. "
    "A table with little information moves towards the others. ?: its importance weights are unreliable."
)
TABLES = "Median +- sd; of a point fit the best value. Each table's `fit.json` is in the folder that has its name."
CAPTIONS = {
    "parameters.png": "Each quantity over the tables: median and 95 % interval. Pale: not determined by the table's "
    "data. Dashed: population mean. Purple: the table given all others (left out where tables crowd). Grey bands: "
    "levels. Rings: outliers.",
    "drift.png": "Quantities that drift: fitted line, with median and 95 % interval of each table.",
}
PAGE_NAME, PARQUET_NAME = "batch.html", "batch.parquet"
PICTURE, DRIFT = "parameters.png", "drift.png"
# Monte Carlo error of a number, as a share of its 95 % interval, above which it is reported.
MOST_ERROR = 0.1
# Populations with poor weights that are named one by one.
MOST_POOR = 2
# Tables that are practical to fit together.
MOST_TOGETHER = 12
# Failed tables that are listed on a first screen.
FIRST_FAILED = 5


def batch_document(
    rows: Sequence[Row],
    series: Sequence[Series],
    populated: Sequence[Populated] = (),
    pictures: Collection[str] = (),
    command: str | None = None,
    folder: Path | None = None,
) -> Document:
    """The report on a batch, with those of the pictures of `CAPTIONS` that there are; `command` is the line that
    made it, None where none did, `folder` where its files are.
    """
    found = summarised(rows, series, populated)
    centres, levels = centre_rows(series, populated), level_rows(populated)
    listing = [cells(row, place, series) for place, row in enumerate(rows[:MOST_ROWS])]
    pooled = [
        pooled_cells(str(row[NAME]), place, series, populated)
        for place, row in enumerate(rows[:MOST_ROWS])
        if row["outcome"] == DONE and populated
    ]
    drawn = {name: Picture(name, text, f"{text} {found.answer[0]}") for name, text in CAPTIONS.items()}
    most, heads = MOST_LINES if screen().full else FIRST_FAILED, centre_heads(populated)
    lead: list[Part] = [
        Words(found.answer, "lead", rank="first"),
        Table(
            "Mean and spread of each quantity over the tables", [heads, *centres], ["unit"],
            brief=BRIEF_HEADS if heads == CENTRE_HEADS else BRIEF_OVER, rank="first",
        ),
        Words(found.points, "list", rank="first"),
        *(replace(drawn[name], rank="first") for name in (PICTURE,) if name in pictures),
    ]  # fmt: skip
    sections = [
        Section("failed", "Tables that could not be fitted", [
            Words(_failures(found.failed, most), "list", "terminal", rank="first"),
            Words(_failures(found.failed, MOST_LINES), "list", "page"),
        ]),
        Section("levels", "Levels", [
            Words([LEVELS] * bool(levels)),
            Table(
                "Each level, and new tables there", [LEVEL_HEADS, *levels], ["unit", "level"], rest="`batch.html`",
                brief=("unit", "level", "value", "95 %"), rank="first",
            ),
        ]),
        Section("drift", "Drifts", [drawn[name] for name in (DRIFT,) if name in pictures]),
        Section("tables", "Each table", [
            Words([TABLES], only="page"),
            Table(
                "Every table with its parameters",
                [("table", "impacts", "outcome", "fits the data", *(one.head for one in series)), *listing],
                ["outcome", "fits the data"], count=len(rows), only="page",
                rest="`batch.csv`, which holds every number of this page and more",
            ),
        ]),
        Section("pooled", "Each table, given all others", [
            Words([POOLED] * bool(pooled), only="page"),
            Table(
                "Tables alone and given all others",
                [
                    ("table", *(head for one in populated for head in (f"{one.head} alone", "given all"))), *pooled
                ], only="page",
            ),
        ], rank="folded"),
        Section("method", "How mean and spread are computed", [Words([LEGEND] * bool(centres))], rank="folded"),
        Section("repeat", "How to repeat this batch", [
            Words([] if command is None else [command], "code", "page"),
            Words(
                [] if command is None else ["After an interruption the same command continues where it stopped."],
                only="page",
            ),
        ], rank="folded"),
        Section("", "", [Words([] if folder is None else [
            f"Report: {folder / PAGE_NAME}; every number: {folder / CSV_NAME}"
        ], only="terminal", rank="first")]),
    ]  # fmt: skip
    title = f"{len(rows):,} table{'s, each' if len(rows) != 1 else ''} fitted by itself"
    return Document(title, lead, sections)


def _failures(failed: Sequence[tuple[str, str]], most: int) -> list[str]:
    """The first failed tables with their reasons, and where the others are."""
    left = [f"{len(failed) - most:,} more, with their reasons: `{CSV_NAME}`"] if len(failed) > most else []
    return [*(term(name, reason) for name, reason in failed[:most]), *left]


def render(rows: Sequence[Row], series: Sequence[Series], folder: Path, populated: Sequence[Populated] = ()) -> str:
    """A batch on a terminal."""
    return on_terminal(batch_document(rows, series, populated, folder=folder))


@dataclass(frozen=True)
class Results:
    """What the files of a batch hold: quantities over the tables, and the populations of some of them."""

    series: tuple[Series, ...]
    populated: tuple[Populated, ...]


def write_results(
    rows: Sequence[Row],
    folder: Path,
    command: str | None = None,
    quantities: Sequence[str] = (),
    over: Over = None,
) -> Results:
    """Write every file, each whole or not at all; `command` is the line that asked. Returns what they hold.

    Populations are those of parameters that enough tables determine, and of `quantities`, `over` levels or not.
    Parquet needs pyarrow, and is left out without it. Raises ResultFolderError, ParameterError as `populations` does.
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
        along = most_drifting(series)
        if along is not None:
            figures[DRIFT] = batch_figure(_drifting(series, along), names, along)
    for name in {PICTURE, DRIFT} - set(figures):
        remove(folder / name)
    images = {name: save_figure(figure, folder / name) for name, figure in figures.items()}
    write_text(folder / PAGE_NAME, as_page(batch_document(rows, series, populated, images, command), images))
    return Results(series, populated)


def most_drifting(series: Sequence[Series]) -> Along | None:
    """The label along which most quantities drift."""
    found = [along for one in series for along, _line in one.drifts]
    return max(found, key=lambda along: sum(other is along for other in found), default=None)


def _drifting(series: Sequence[Series], along: Along) -> list[Series]:
    return [one for one in series if any(drift is along for drift, _line in one.drifts)]


def _write_parquet(rows: Sequence[Row], place: Path) -> None:
    import pandas as pd

    content = io.BytesIO()
    pd.DataFrame(list(rows)).to_parquet(content, index=False)
    write_bytes(place, content.getvalue())


def pooled_cells(name: str, place: int, series: Sequence[Series], populated: Sequence[Populated]) -> tuple[str, ...]:
    """One table as text: each quantity alone, and given the other tables; `?` where weights are unreliable."""
    columns = {one.quantity: one for one in series}
    texts = [name]
    for one in populated:
        table = next((table for table in one.population.tables if table.name == name), None)
        if table is None:
            texts += ["-", "-"]
            continue
        column = columns.get(one.quantity.name)
        # A ratio is no column of the tables: its draws are all there is.
        texts.append(cell(column, place) if column is not None else _drawn(one, one.own[name], one.own_sds[name]))
        texts.append(_drawn(one, table.known, table.sd) + ("" if table.trusted else " ?"))
    return tuple(texts)


def _drawn(populated: Populated, known: Known, sd: float) -> str:
    middle = populated.quantity.value(known.median)
    return populated.scale.plus_minus(middle, sd * (middle if populated.quantity.log else 1.0))


def cells(row: Row, place: int, series: Sequence[Series]) -> tuple[str, ...]:
    """One table as text: outcome, adequacy, each quantity with its sd."""
    outcome = str(row["status"]) if row["outcome"] == DONE else "failed"
    answer = "-" if row["adequacy"] is None else SHORT.get(str(row["adequacy"]), str(row["adequacy"]))
    return (str(row[NAME]), str(row["impacts"] or "-"), outcome, answer, *(cell(one, place) for one in series))


def cell(series: Series, place: int) -> str:
    """A quantity of the table at `place` with its sd."""
    if place not in series.rows:
        return "-"
    k = series.rows.index(place)
    middle, sd = float(series.median[k]), float(series.sd[k])
    return series.scale.plus_minus(middle, sd) if np.isfinite(sd) else significant(middle * series.scale.factor, 4)


@dataclass(frozen=True)
class Summary:
    """A batch in words: how many fits, and whether the model fits; drifts, outliers and cautions; tables that failed,
    with the reason.
    """

    answer: tuple[str, ...]
    points: tuple[str, ...]
    failed: tuple[tuple[str, str], ...]


def summarised(rows: Sequence[Row], series: Sequence[Series], populated: Sequence[Populated] = ()) -> Summary:
    """The words for the rows of a batch and their series."""
    failed = tuple((str(row[NAME]), str(row["reason"])) for row in rows if row["outcome"] == FAILED)
    done = [row for row in rows if row["outcome"] == DONE]
    parts = [f"{len(done):,} of {len(rows):,} tables fitted" if failed else _all_fitted(len(done))]
    if failed:
        parts.append(f"{len(failed):,} failed")
    unsure = [str(row[NAME]) for row in done if row["status"] == RunStatus.NOT_CONVERGED]
    if unsure:
        parts.append(f"{len(unsure):,} did not converge ({listed(unsure, 5)})")
    answers = Counter(str(row["adequacy"]) for row in done if row["adequacy"] is not None)
    sentences = ["; ".join(parts) + "."]
    if answers:
        counts = [f"{words} in {answers[answer]:,}" for answer, words in ANSWERS.items() if answers[answer]]
        sentences.append(f"Does the model fit the data? {'; '.join(counts).capitalize()}.")
    refused = [str(row[NAME]) for row in done if row["adequacy"] == Answer.FAILS]
    if refused:
        sentences.append(f"The model does not fit {listed(refused, 5)}: their parameters hold within the model only.")
    sentences += slips(rows, series)
    points = [sentence for one in series for sentence in _standing_out(one)]
    points += dict.fromkeys(sentence for one in populated for sentence in one.remarks)
    points += doubts_of_all(populated)
    if done and not any(one.drawn for one in series):
        points.append(f"Point fits have no uncertainty. For means and spreads fit without {option('point_only')}.")
    return Summary(tuple(sentences), tuple(points), failed)


ANSWERS = {
    Answer.DESCRIBES: "yes",
    Answer.EXCEPT: "yes, with exceptions",
    Answer.FAILS: "no",
    Answer.UNDECIDED: "too few data to test",
}
# The same in a cell.
SHORT = {str(answer): words for answer, words in zip(ANSWERS, ("yes", "except", "NO", "too few data"), strict=True)}


def _all_fitted(count: int) -> str:
    return f"All {count:,} tables fitted" if count > 1 else "One table fitted"


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
            f"(p = {significant(float(line.p[1]), 2)}, uncorrected for multiple tests)."
        )
    if series.outside:
        places_of = dict(zip(series.rows, series.names, strict=True))
        far = [f"{places_of[row]} ({distance:+.1f} sd)" for row, distance in series.outside]
        sentences.append(f"Outliers of {series.name}: {listed(far, 5)}.")
    return sentences


def _with_ends(scale: Scale, middle: float, low: float, high: float) -> tuple[str, str]:
    """A value and its 95 % interval, all SI, in handy units."""
    places = scale.decimals((high - low) / (2.0 * REACH))
    return scale.fixed(middle, places), scale.interval(low, high, places)


def centre_rows(series: Sequence[Series], populated: Sequence[Populated] = ()) -> list[tuple[str, ...]]:
    """For each quantity its mean and spread over the tables, in handy units."""
    rows: list[tuple[str, ...]] = []
    known = {one.name: one for one in populated}
    for one in series:
        # Point fits have verdicts, but nothing that a mean and a spread could follow from.
        counted = np.array(one.determined) & (np.isfinite(one.sd) | (not one.drawn))
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
    """Heads of the rows of means and spreads."""
    return OVER_HEADS if any(one.population.levels for one in populated) else CENTRE_HEADS


def level_rows(populated: Sequence[Populated]) -> list[tuple[str, ...]]:
    """For each quantity the value of each level, and of a new one, with the interval of a new table there."""
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
    """A value in the coordinate with its interval, in handy units."""
    return _with_ends(populated.scale, *populated.ends(known))


def population_cells(populated: Populated) -> tuple[str, ...]:
    """Mean and spread with their intervals, and the typical sd of a table, in handy units."""
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
    """What is unreliable in populations; of many with poor weights as one sentence."""
    poor = [one for one in populated if one.population.doubtful]
    if len(poor) <= MOST_POOR:
        return [sentence for one in populated for sentence in doubts(one)]
    named = listed([one.quantity.name for one in poor])
    count = len({name for one in poor for name in one.population.doubtful})
    together = (
        f"Importance weights of {count:,} tables are unreliable (Pareto k above {K_TRUSTED}) for {named}. They are "
        "marked ? on the page; k is in population.csv."
    )
    return [sentence for one in populated if one not in poor for sentence in doubts(one)] + [together]


def doubts(populated: Populated) -> list[str]:
    """What is unreliable in a population, and what would help."""
    found, name = populated.population, populated.name
    sentences = []
    for words, number in (("mean", found.centre), ("spread", found.spread), ("spread within levels", found.within)):
        if number is not None and number.error > MOST_ERROR * (number.high - number.low):
            share = number.error / (number.high - number.low)
            sentences.append(
                f"The {words} of {name} has a Monte Carlo error of {percent(share)} of its interval: too few draws."
            )
    if found.doubtful:
        count = len(found.doubtful)
        sentences.append(
            f"Importance weights of {count:,} table{'s' * (count > 1)} ({listed(found.doubtful, 5)}) are unreliable "
            f"for {name} (Pareto k above {K_TRUSTED})."
        )
    if sentences and len(populated.quantity.parts) == 1 and len(found.tables) <= MOST_TOGETHER:
        how = spoken(
            f"fitball calibrate TABLES --pool {name}=table", f"calibrate(tables, pool={{'{name}': 'table'}})"
        )
        sentences[-1] += f" You can fit so few tables together instead: {how}."
    return sentences
