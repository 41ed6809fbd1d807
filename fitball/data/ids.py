"""Names of the impacts: those in the table, made unique, or the numbers of the rows."""

from __future__ import annotations

from collections import Counter

from fitball.data.columns import Header
from fitball.data.dialect.cells import RawRow
from fitball.data.table import Notice


def unique_ids(header: Header, rows: tuple[RawRow, ...], notices: list[Notice]) -> tuple[str, ...]:
    """One name an impact; a notice for each that was empty or stood already."""
    if "id" not in header.texts:
        return tuple(str(row.number) for row in rows)
    written = [row.cells[header.texts["id"].index] for row in rows]
    taken = set(written)
    ids: list[str] = []
    seen: Counter[str] = Counter()
    for row, text in zip(rows, written, strict=True):
        name = text
        if not text:
            kind = "id is empty: the number of the row is taken"
            name = _free(f"row {row.number}", 0, taken)
            notices.append(Notice(f"{kind}: '{name}'", row.number, ("id",), kind))
        elif seen[text]:
            kind = "id names an earlier impact too and was made unique"
            name = _free(text, seen[text], taken)
            notices.append(Notice(f"{kind}: '{name}'", row.number, ("id",), kind))
        seen[text] += 1
        taken.add(name)
        ids.append(name)
    return tuple(ids)


def repeated(name: str, k: int = 2) -> str:
    """The name of the `k`-th impact that is called `name`."""
    return f"{name} ({k})"


def _free(name: str, count: int, taken: set[str]) -> str:
    """`name`, or the first `name (2)`, `name (3)`, ... that is not taken; `count` impacts have the name already."""
    if name not in taken:
        return name
    k = count + 1
    while repeated(name, k) in taken:
        k += 1
    return repeated(name, k)
