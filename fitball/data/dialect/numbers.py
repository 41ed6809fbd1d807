"""Numbers as people write them, as our columns have them: decimal commas, printed minus signs, `21.0 ± 0.2`.

What may be meant in two ways is left as it is, and refused with the words of `explained` where it is read.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from fitball.data.dialect.cells import RawRow

_COMMA = re.compile(r"[+\-]?\d*,\d+(?:[eE][+\-]?\d+)?")
_POINT = re.compile(r"[+\-]?(?:\d+\.\d*|\.\d+)(?:[eE][+\-]?\d+)?")
_THOUSANDS = re.compile(r"[+\-]?[1-9]\d{0,2},\d{3}")
_GROUPED = re.compile(r"[+\-]?\d{1,3}(?:[.,' \u00a0\u202f]\d{3})+(?:[.,]\d+)?")
_MINUS = re.compile(r"(?:^|(?<=[eE]))[\u2212\u2013](?=[\d.,])")
# Without any of these there is no decimal comma, printed minus sign or deviation; and no deviation.
_SIGNS, _DEVIATION_SIGNS = ",±+\u2212\u2013", "±+"
# No number with its deviation is longer; the pattern takes time with the square of the length.
_LONGEST_PAIR = 100
_PLUS_MINUS = re.compile(r"(?P<value>[^±]*?\S)\s*(?:±|\+/-|\+/\u2212|\+-)\s*(?P<sd>[^±+\-\s].*)")


def plain_numbers(rows: Sequence[RawRow], places: Sequence[int]) -> tuple[tuple[RawRow, ...], tuple[str, ...]]:
    """The rows with decimal points and hyphens in their cells at `places`, which hold numbers, and notes on what was
    changed.

    A file has one decimal sign: commas are one where no number has a point, and at least one comma cannot stand
    between thousands.
    """
    notes: tuple[str, ...] = ()
    cells = [row.cells[place] for row in rows for place in places]
    if not _any_of(_SIGNS, cells):
        return tuple(rows), notes
    if any(_MINUS.search(cell) for cell in cells):
        notes = ("printed minus signs (\u2212, –) were read as such",)
        rows = [_changed(row, places, lambda cell: _MINUS.sub("-", cell)) for row in rows]
    parts = [part for row in rows for place in places for part in _parts(row.cells[place])]
    commas = [part for part in parts if _COMMA.fullmatch(part)]
    if not commas or all(map(_THOUSANDS.fullmatch, commas)) or any(map(_POINT.fullmatch, parts)):
        return tuple(rows), notes
    return tuple(_changed(row, places, _with_point) for row in rows), (*notes, "numbers have decimal commas")


def _any_of(signs: str, cells: Sequence[str]) -> bool:
    """Whether any of the signs stands in any of the cells, which are looked at as one text: they may be millions."""
    text = "\n".join(cells)
    return any(sign in text for sign in signs)


def _changed(row: RawRow, places: Sequence[int], change: Callable[[str], str]) -> RawRow:
    cells = list(row.cells)
    for place in places:
        cells[place] = change(cells[place])
    return replace(row, cells=tuple(cells))


def _parts(cell: str) -> Iterable[str]:
    """The number of a cell, or number and deviation."""
    pair = _pair(cell)
    return (cell,) if pair is None else (pair["value"], pair["sd"])


def _pair(cell: str) -> re.Match[str] | None:
    """A number and its deviation, if a cell holds both."""
    return _PLUS_MINUS.fullmatch(cell) if len(cell) <= _LONGEST_PAIR else None


def _with_point(cell: str) -> str:
    whole = all(_COMMA.fullmatch(part) or part.lstrip("+-").isdigit() for part in _parts(cell))
    return cell.replace(",", ".") if whole else cell


def split_deviations(rows: Sequence[RawRow], places: Sequence[int]) -> tuple[tuple[RawRow, ...], dict[int, int]]:
    """The rows with each `value ± sd` as its value, the sds in columns of their own behind the others; the places of
    these columns by that of the number. A row without a deviation has an empty cell there.
    """
    if not _any_of(_DEVIATION_SIGNS, [row.cells[place] for row in rows for place in places]):
        return tuple(rows), {}
    stated = [place for place in places if any(_pair(row.cells[place]) for row in rows)]
    if not stated:
        return tuple(rows), {}
    width = len(rows[0].cells)
    split = []
    for row in rows:
        cells, sds = list(row.cells), []
        for place in stated:
            pair = _pair(cells[place])
            sds.append("" if pair is None else pair["sd"])
            if pair is not None:
                cells[place] = pair["value"]
        split.append(replace(row, cells=(*cells, *sds)))
    return tuple(split), {place: width + k for k, place in enumerate(stated)}


def explained(cell: str) -> str | None:
    """Why the number of a cell is open, and what to write; None where it is something else than a number."""
    if _THOUSANDS.fullmatch(cell):
        return (
            f"read '{cell}', which may be {cell.replace(',', '.')} or {cell.replace(',', '')}; expected a decimal "
            "point, and nothing between thousands"
        )
    if _COMMA.fullmatch(cell):
        return (
            f"read '{cell}', a decimal comma, beside numbers with points; expected one decimal sign: write "
            f"'{cell.replace(',', '.')}'"
        )
    if _GROUPED.fullmatch(cell):
        return f"read '{cell}', with signs between thousands; expected a decimal point and no other sign"
    return None
