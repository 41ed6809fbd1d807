"""A batch in words and cells, the same on the terminal and on the page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitball.inference.population.trend import Line
from fitball.inference.results.adequacy import Answer
from fitball.inference.results.results import RunStatus
from fitball.report.batch.rows import DONE, FAILED, NAME, Row
from fitball.report.batch.series import REACH, Series
from fitball.report.form.display_units import handy
from fitball.report.form.rounding import decimals, fixed, interval, significant
from fitball.report.form.sentences import listed

CENTRE_HEADS = ("quantity", "unit", "told by", "centre", "95 %", "spread", "typical sd")
LEGEND = (
    "Told by: tables that tell the value themselves, the only ones that the other columns count. Centre: about what "
    "value they scatter, with the 95 % interval of that (random effects, restricted maximum likelihood). Spread: "
    "standard deviation of the true values from table to table, beyond the uncertainty of each. Typical sd: median "
    "uncertainty of one table."
)


@dataclass(frozen=True)
class Told:
    """A batch in words: a headline, what stands out, and who failed with the reason."""

    headline: str
    points: tuple[str, ...]
    failed: tuple[tuple[str, str], ...]


def told(rows: Sequence[Row], series: Sequence[Series]) -> Told:
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
    return Told("; ".join(parts) + ".", tuple(points), failed)


ANSWERS = {
    Answer.DESCRIBES: "described",
    Answer.EXCEPT: "described with exceptions",
    Answer.FAILS: "not described",
    Answer.UNTOLD: "with too few rows to tell",
}


def _all_fitted(count: int) -> str:
    return f"all {count:,} tables fitted" if count > 1 else "one table fitted"


def _some(names: Sequence[str], most: int = 5) -> str:
    """The first names of many."""
    more = len(names) - most
    return listed(names) if more <= 0 else f"{', '.join(names[:most])} and {more:,} more"


def _standing_out(series: Series) -> list[str]:
    """Drifts and outliers of a quantity, in words."""
    name, factor, unit = _shown(series)
    sentences = []
    for along, line in series.drifts:
        # A slope of logarithms is a share of the quantity.
        scale, each = (100.0, "%") if series.logarithmic else (factor, unit)
        slope, low, high = (float(end[1]) * scale for end in (line.coefficients, line.low, line.high))
        per = f"{each} per day" if along.first_day is not None else f"{each} per unit of {along.name}"
        places = decimals((high - low) / (2.0 * REACH))
        sentences.append(
            f"{name} drifts along {along.name}: {fixed(slope, places)} {interval(low, high, places)} {per.strip()} "
            f"(p = {significant(float(line.p[1]), 2)}, not corrected for the number of quantities)."
        )
    if series.outside:
        places_of = dict(zip(series.rows, series.names, strict=True))
        far = [f"{places_of[row]} ({distance:+.1f} sd)" for row, distance in series.outside]
        sentences.append(f"{name} lies outside the bulk in {_some(far)}.")
    return sentences


def _shown(series: Series) -> tuple[str, float, str]:
    """Name, factor and unit in which people read a quantity."""
    scale = handy(series.quantity, series.unit)
    return series.name, scale.factor, scale.unit


def centre_of(series: Series, line: Line) -> tuple[float, float, float]:
    """Low end, middle, high end of the centre of a quantity, SI."""
    ends = (float(end[0]) for end in (line.low, line.coefficients, line.high))
    low, middle, high = (float(np.exp(end)) if series.logarithmic else end for end in ends)
    return low, middle, high


def centre_rows(series: Sequence[Series]) -> list[tuple[str, ...]]:
    """For each quantity about what it scatters over the tables, in the unit people read."""
    rows: list[tuple[str, ...]] = []
    for one in series:
        name, factor, unit = _shown(one)
        counted = np.array(one.told) & np.isfinite(one.sd)
        head = (name, unit, f"{counted.sum():,} of {len(one.names):,}")
        if one.centre is None:
            rows.append((*head, "-", "-", "-", "-"))
            continue
        low, middle, high = (value * factor for value in centre_of(one, one.centre))
        places = decimals(max((high - low) / (2.0 * REACH), 1e-12))
        # Of logarithms a small spread is a share.
        spread = one.centre.spread * (middle if one.logarithmic else factor)
        typical = float(np.median(one.sd[counted])) * factor
        rows.append(
            (
                *head,
                fixed(middle, places),
                interval(low, high, places),
                significant(spread, 2),
                significant(typical, 2),
            )
        )
    return rows
