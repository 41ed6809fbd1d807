"""Names of the impacts: those in the table, made unique, or the numbers of the rows."""

from __future__ import annotations

from collections import Counter

from fitball.data.columns import Header
from fitball.data.findings import Findings


def unique_ids(header: Header, found: Findings) -> tuple[str, ...]:
    """One name an impact; a notice for each that was empty or stood already."""
    if "id" not in header.texts:
        return tuple(str(row.number) for row in found.rows)
    written = header.cells("id", found.rows)
    taken = set(written)
    ids: list[str] = []
    seen: Counter[str] = Counter()
    for place, text in enumerate(written):
        name, kind = text, ""
        if not text:
            kind = "id is empty: the number of the row is taken"
            name = _free(f"row {found.rows[place].number}", 0, taken)
        elif seen[text]:
            kind = "id names an earlier impact too and was made unique"
            name = _free(text, seen[text], taken)
        if kind:
            found.notice(f"{kind}: '{name}'", "id", place=place, kind=kind)
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
