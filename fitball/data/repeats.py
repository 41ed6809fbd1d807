"""Repeats side by side, `v_y2 a, v_y2 b, v_y2 c` or `Trial 1, Trial 2`, become rows of their own.

Names of ours with a mark behind them are repeats, and so are the columns that `--columns
"rebound_height=Trial *"` names. What has no mark, such as the drop height, holds for each repeat.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import nan
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.text import listed
from fitball.base.values import BoolArray, FloatArray, IntArray
from fitball.data.cells import ABSENT, CellArray, TableCells
from fitball.data.header import NUMBERS, Naming, our_name
from fitball.data.lexicon import without_unit
from fitball.data.records import check_shape

# A name and the mark of a repeat behind it, a number or a letter, with a word or without.
_MARKED = re.compile(
    r"(?P<name>.*?)(?P<gap>[\s_.,:;#(-]*)(?P<word>(?:trial|run|rep|repeat|repetition|replicate|test|"
    r"try|attempt|measurement|reading|shot|versuch|messung|lauf|essai|mesure)[\s_.]*[#(]?\s*)?"
    r"(?P<mark>[0-9]{1,3}|[a-h])\)?",
    re.IGNORECASE,
)
# The mark of a column without one among those with one.
_MARK_OF_FIRST = "0"
# Share by which the mean of repeats beside them may be off by its last digit.
_OF_A_MEAN = 0.01
# Columns that a note names.
_NAMED_COLUMNS = 8


class Mark(NamedTuple):
    """A name in front of the `mark` of a repeat, empty where there is none; whether anything stands
    between them, and a `word` such as `trial`; whether the mark is one that pandas writes behind a
    name that is twice in a header: a point and a number.
    """

    name: str
    mark: str
    apart: bool = True
    word: bool = False
    numbered: bool = False


class _Marked(NamedTuple):
    """A column that may be one of repeats: its place among the columns, our name, its unit, and its
    name with the mark.
    """

    place: int
    ours: str
    unit: str
    parts: Mark

    @property
    def mark(self) -> str:
        """The mark of the repeat, empty where there is none."""
        return self.parts.mark


def in_rows(cells: TableCells, naming: Naming) -> TableCells:
    """The cells with a row for each repeat; these cells where nothing is repeated. A note says so.

    Raises:
        InputError: There are more rows than a table may have (`too-large`).
    """
    groups, means = _groups(cells, naming)
    if not groups:
        return cells
    marks = list(dict.fromkeys(column.mark for group in groups.values() for column in group))
    by_mark = [_indices_of(mark, groups) for mark in marks]
    filled = [_any_filled(cells, [*indices.values()]) for indices in by_mark]
    rows, of_mark = np.nonzero(np.stack(filled, axis=1))
    check_shape(cells.source, len(rows), len(cells.names))
    repeated = [column.place for group in groups.values() for column in group]
    names = list[str]()
    columns = list[CellArray]()
    for index, name in enumerate(cells.names):
        if index not in repeated and index not in means:
            names.append(name)
            columns.append(cells.columns[index][rows])
    for ours, group in groups.items():
        first = group[0]
        name = first.parts.name
        names.append(f"{name} [{first.unit}]" if first.unit else name)
        indices_of_ours = [indices.get(ours) for indices in by_mark]
        columns.append(_woven(cells, indices_of_ours, rows, of_mark))
    heads = listed((cells.names[index] for index in repeated), most=_NAMED_COLUMNS)
    cells.note("repeats", f"repeats have rows of their own: {heads}")
    if means:
        words = "not used, since it is the mean of its repeats"
        cells.note("repeats", f"{listed(cells.names[index] for index in means)}: {words}")
    in_rows_of_repeats = replace(
        cells,
        names=names,
        columns=columns,
        rows=cells.rows[rows],
        lines=None if cells.lines is None else cells.lines[rows],
    )
    _mark_ids(in_rows_of_repeats, naming, [marks[k] for k in of_mark.tolist()])
    return in_rows_of_repeats


def _groups(cells: TableCells, naming: Naming) -> tuple[dict[str, list[_Marked]], list[int]]:
    """The columns that are repeats, by our names, at least two each; the indices of those that are
    means of repeats.
    """
    groups: dict[str, list[_Marked]] = {}
    plain = dict[str, _Marked]()
    for index, cell in enumerate(cells.names):
        column = _marked(index, cell, naming)
        if column is not None and column.mark:
            groups.setdefault(column.ours, []).append(column)
        elif column is not None:
            plain.setdefault(column.ours, column)
    means = list[int]()
    for ours, column in plain.items():
        group = groups.get(ours, [])
        is_numbered = bool(group) and group[0].parts.numbered
        if len(group) > 1 and not is_numbered and _is_mean(cells, column, group):
            means.append(column.place)
        elif len(group) > 1 or is_numbered:
            first = column.parts._replace(mark=_MARK_OF_FIRST)
            groups[ours] = [column._replace(parts=first), *group]
    alike = {ours: group for ours, group in groups.items() if _are_repeats(group)}
    places = {column.place: ours for ours, column in plain.items()}
    return alike, [place for place in means if places[place] in alike]


def _are_repeats(group: Sequence[_Marked]) -> bool:
    """Whether columns of one name are repeats: with marks that count, in one unit."""
    units = {column.unit for column in group}
    return are_counted([column.parts for column in group]) and len(units) == 1


def are_counted(marks: Sequence[Mark]) -> bool:
    """Whether marks count from 0, 1 or a, or stand behind a word such as `trial`: `v_1 x` and `v_1
    y` are no repeats.
    """
    texts = [mark.mark.casefold() for mark in marks]
    if len({*texts}) < len(texts) or len(texts) < 2:
        return False
    if all(mark.word for mark in marks):
        return True
    if all(text.isdecimal() for text in texts):
        numbers = sorted(map(int, texts))
        return numbers[0] in {0, 1} and numbers == [*range(numbers[0], numbers[0] + len(numbers))]
    return sorted(texts) == [*"abcdefgh"[: len(texts)]]


def mark_of(text: str) -> Mark | None:
    """A name, without its unit, taken apart into name and mark; None where it has no mark."""
    matched = _MARKED.fullmatch(text)
    if matched is None:
        return None
    mark = matched["mark"]
    word = bool(matched["word"])
    apart = word or bool(matched["gap"]) or not mark.isdecimal()
    numbered = matched["gap"] == "." and mark.isdecimal() and not word
    return Mark(matched["name"].strip(), mark, apart, word, numbered)


def _marked(place: int, cell: str, naming: Naming) -> _Marked | None:
    """What a column is by its header cell; None where its name is none of ours, with a mark or
    without.
    """
    text, unit = without_unit(cell)
    for ours, their in naming.theirs.items():
        if "*" in their:
            pattern = "(.*)".join(map(re.escape, their.split("*", 1)))
            for written in (text, cell):
                folded = written.casefold()
                matched = re.fullmatch(pattern, folded)
                if matched is not None:
                    # As the file has it, unless folding made two letters of one.
                    starred = f"{written[: matched.start(1)]}*{written[matched.end(1) :]}"
                    starred = starred if len(folded) == len(written) else their
                    return _Marked(place, ours, unit, Mark(starred, matched[1], word=True))
    ours_of_text = naming.by_user(cell, text) or our_name(text)
    if ours_of_text is not None:
        parts = Mark(text, "")
        return _Marked(place, ours_of_text, unit, parts) if ours_of_text in NUMBERS else None
    mark = mark_of(text)
    # `v_y12` is more likely a slip.
    if mark is None or not mark.apart:
        return None
    ours_of_name = naming.by_user(mark.name) or our_name(mark.name)
    return _Marked(place, ours_of_name, unit, mark) if ours_of_name in NUMBERS else None


def _is_mean(cells: TableCells, column: _Marked, group: Sequence[_Marked]) -> bool:
    """Whether a column is the mean of a group of repeats, but for its last digit."""
    repeats = [_values(cells, repeat.place) for repeat in group]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.abs(_values(cells, column.place) / np.mean(repeats, axis=0) - 1.0)
    known = share[np.isfinite(share)]
    return known.size > 0 and bool(np.all(known < _OF_A_MEAN))


def _values(cells: TableCells, index: int) -> FloatArray:
    """The numbers of a column (rows,), NaN where a cell is none."""
    return np.array([_value(text) for text in cells.text(index)])


def _value(text: str) -> float:
    """The number of a cell, NaN where it is none."""
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return nan


def _indices_of(mark: str, groups: Mapping[str, Sequence[_Marked]]) -> dict[str, int]:
    """The indices of the columns with a mark, by our names."""
    return {
        ours: column.place
        for ours, group in groups.items()
        for column in group
        if column.mark == mark
    }


def _any_filled(cells: TableCells, indices: Sequence[int]) -> BoolArray:
    """Whether a row (rows,) has a number in any of these columns."""
    filled = np.zeros(len(cells.rows), np.bool_)
    for index in indices:
        filled |= [text.strip().casefold() not in ABSENT for text in cells.text(index)]
    return filled


def _woven(
    cells: TableCells,
    indices: Sequence[int | None],
    rows: Annotated[IntArray, "repeats"],
    of_mark: Annotated[IntArray, "repeats"],
) -> CellArray:
    """The cells (repeats,) of repeated columns, whose indices are by mark, at rows and marks; empty
    where a mark has none. Numbers stay numbers where all of them are.
    """
    columns = [None if index is None else cells.columns[index] for index in indices]
    present = [column for column in columns if column is not None]
    numeric = all(column.dtype.kind != "T" for column in present)
    dtype = np.dtype(np.float64) if numeric else np.dtypes.StringDType()
    woven = np.full(len(rows), np.nan if numeric else "", dtype=dtype)
    for mark, index in enumerate(indices):
        if index is not None:
            here = of_mark == mark
            column = cells.columns[index] if numeric else np.array(cells.text(index), dtype=dtype)
            woven[here] = column[rows[here]]
    return woven


def _mark_ids(cells: TableCells, naming: Naming, marks: Sequence[str]) -> None:
    """Put the marks (rows,) behind the ids, which are the numbers of the rows where no column has
    them. Its argument changes.
    """
    names = [naming.split(cell)[0] for cell in cells.names]
    index = next((k for k, name in enumerate(names) if our_name(name) == "id"), None)
    ids = cells.rows.astype(str).tolist() if index is None else cells.text(index)
    texts = [f"{text} {mark}" if text else "" for text, mark in zip(ids, marks, strict=True)]
    column = np.array(texts, dtype=np.dtypes.StringDType())
    if index is None:
        cells.names.append("id")
        cells.columns.append(column)
    else:
        cells.columns[index] = column
