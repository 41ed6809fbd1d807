"""Where a wrong input may have come from: short lists, drawn up beforehand, and how often one of them fits by chance.

No list holds a continuous range, so that nothing can be tuned; a slip whose input is on none of them is refused.
Every list was tried in each worksheet of Appendix B, in both for sliding, in both that follow and in all. A row that
two candidates fit equally well stays unexplained, with both of them named.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from fitball.data.published import thesis_table
from fitball.inference.thesis.inputs import INCH
from fitball.thesis.appendix_b import Clause, Inputs, Row, filled_in, outputs, row_inputs
from fitball.thesis.appendix_c import HEADS
from fitball.thesis.appendix_d import MEAN_RESTITUTION

# Columns that were retyped together: single, the fractions as a pair, the vertical ones, a set of Chapter II.
COLUMNS = (
    ("mass_ratio",),
    ("k_y",),
    ("c_y",),
    ("i1_over_i",),
    ("i2_over_i",),
    ("i1_over_i", "i2_over_i"),
    ("inertia",),
    ("mass_ratio", "k_y", "c_y"),
    ("mass_ratio", "i1_over_i", "i2_over_i", "inertia"),
)
INCIDENT = ("v_x1", "v_y1", "offset_v_y1", "omega_1", "cor", "c_y")
# Appendix B prints these where all but a few rows follow 1.3 in and the inertias of Chapter II.
APPENDIX_B: Inputs = {"radius": 1.25, "inertia": 0.000342}
# Candidates this near, in per cent, are counted to know how densely they lie around the printed value.
NEAR = 2.0
# Numbers are the same within this, relative, and outputs different beyond so many decimals of a per cent.
SAME, DISTINCT = 1e-9, 7
# Nearer than this, in per cent, print does not tell.
LAST_DIGIT = 0.001
# `v_x2` and `R omega_2` of a rolling ball agree within this whether R is 1.25 or 1.3 in; a sliding ball's never do.
ROLLS = 0.05


def neighbours(row: Row, rows: pd.DataFrame) -> Iterator[Inputs]:
    """What the case before or after, or the nearest one with another value, has in a group of columns."""
    table = [row_inputs(item) for item in rows[rows["table"] == row["table"]].to_dict("records")]
    here = int(row["case"]) - 1
    for names, step in itertools.product(COLUMNS, (-1, 1)):
        k = here + step
        while 0 <= k < len(table):
            other = {name: table[k][name] for name in names}
            if other != {name: table[here][name] for name in names}:
                yield other
                break
            k += step


def other_tables(row: Row, rows: pd.DataFrame) -> Iterator[Inputs]:
    """One value of the same case of every other table, of an example of Chapter III, or Chapter V's restitution."""
    others = rows[(rows["case"] == row["case"]) & (rows["table"] != row["table"])]
    for item, name in itertools.product(others.to_dict("records"), INCIDENT):
        yield {name: row_inputs(item)[name]}
    for item, name in itertools.product(thesis_table("chapter_three_examples").to_dict("records"), INCIDENT):
        yield {name: row_inputs(item)[name]}
    yield {"cor": MEAN_RESTITUTION[row["spin"]]}


def printed_constants(row: Row, rows: pd.DataFrame) -> Iterator[Inputs]:
    """Radius and inertia of Appendix B, and the row's own inputs as printed where the errata mend them."""
    del rows
    yield from ({name: value} for name, value in APPENDIX_B.items())
    yield APPENDIX_B
    printed = thesis_table("appendix_c")
    same = printed[(printed["table"] == row["table"]) & (printed["case"] == row["case"])].iloc[0].to_dict()
    mended = row_inputs(row)
    yield from ({name: value} for name, value in row_inputs(same).items() if value != mended[name])


def digits(row: Row, rows: pd.DataFrame) -> Iterator[Inputs]:
    """Own inputs with neighbouring digits exchanged, one left out, the point moved or the end rounded off."""
    del rows
    own = row_inputs(row)
    for name in ("v_x1", "v_y1", "offset_v_y1", "omega_1", "cor", "k_y", "c_y", "i1_over_i", "i2_over_i", "inertia"):
        text = np.format_float_positional(own[name], precision=6, trim="-")
        for other in sorted({*_slipped(text), own[name] / 10.0, own[name] * 10.0, *_rounded(own[name])}):
            if other not in (0.0, own[name]):
                yield {name: other}


def round_damping(row: Row, rows: pd.DataFrame) -> Iterator[Inputs]:
    """Every `c_y` of two digits between 0.01 and 0.1 lb s/in, in which all of Chapter V's and most of C's lie."""
    del row, rows
    yield from ({"c_y": k / 1000.0} for k in range(10, 100))


SOURCES: Mapping[str, Callable[[Row, pd.DataFrame], Iterator[Inputs]]] = {
    "constants in print": printed_constants,
    "neighbouring case": neighbours,
    "another table": other_tables,
    "digits": digits,
    "round c_y": round_damping,
}


def _slipped(text: str) -> Iterator[float]:
    places = [k for k, character in enumerate(text) if character.isdigit()]
    for k, m in itertools.pairwise(places):
        yield float(text[:k] + text[m] + text[k + 1 : m] + text[k] + text[m + 1 :])
    for k in places:
        yield float(text[:k] + text[k + 1 :] or "0")


def _rounded(value: float) -> Iterator[float]:
    yield from (float(f"{value:.{figures}g}") for figures in (2, 3))


@dataclass(frozen=True)
class Chance:
    """How many `candidates` of the kind of a slip give different numbers, and how many of them one would expect as
    near to the printed values as the slip is, were they strewn at random.
    """

    candidates: int
    expected: float


@dataclass(frozen=True)
class Candidates:
    """The lists, by name, on which each clause of a slip was found."""

    clauses: tuple[Clause, ...]
    names: tuple[str, ...]
    lists: tuple[tuple[Inputs, ...], ...]


def candidates(row: Row, rows: pd.DataFrame, clauses: Sequence[Clause]) -> Candidates | None:
    """The first list that holds the inputs of each clause; None if those of one stand on no list."""
    fitting: list[tuple[str, tuple[Inputs, ...]]] = []
    for clause in clauses:
        for name, draw in SOURCES.items():
            drawn = tuple(draw(row, rows))
            if any(_same(item, clause.inputs) for item in drawn):
                fitting.append((name, drawn))
                break
        else:
            return None
    return Candidates(tuple(clauses), tuple(name for name, _ in fitting), tuple(drawn for _, drawn in fitting))


def by_chance(row: Row, alternatives: Candidates, columns: Sequence[str]) -> Chance:
    """What a slip is worth that claims these `columns` of a row, the lists of its clauses combined.

    A ball that rolls in the end gives one number, `v_x2` being `R omega_2`; one that slides gives two.
    """
    printed = np.array([float(row[HEADS[name]]) for name in columns])
    own = row_inputs(row)

    def deviations(chosen: Sequence[Inputs]) -> tuple[float, ...]:
        made = [Clause(clause.codes, inputs) for clause, inputs in zip(alternatives.clauses, chosen, strict=True)]
        values = outputs(filled_in(own, made))
        return tuple(np.round(100.0 * (np.array([values[name] for name in columns]) / printed - 1.0), DISTINCT))

    distinct = {item for item in map(deviations, itertools.product(*alternatives.lists)) if np.all(np.isfinite(item))}
    near = sum(max(map(abs, item)) <= NEAR for item in distinct)
    mine = np.abs(deviations([clause.inputs for clause in alternatives.clauses]))
    rolls = len(columns) == 2 and abs(printed[0] / (printed[1] * own["radius"] * INCH) - 1.0) < ROLLS
    shares = np.maximum(mine.max(keepdims=True) if rolls else mine, LAST_DIGIT) / NEAR
    return Chance(len(distinct), float(near * np.prod(shares)))


def _same(first: Inputs, second: Inputs) -> bool:
    return first.keys() == second.keys() and all(abs(first[k] - second[k]) <= SAME * abs(second[k]) for k in first)
