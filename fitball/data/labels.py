"""Label columns: which name surfaces, balls, places or sessions, how labels are spelled, how many rows each has."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from enum import StrEnum
from typing import TYPE_CHECKING

from fitball.data.cells import Findings, Texts, is_number
from fitball.data.header import bare
from fitball.visible import some
from fitball.wording import spoken

if TYPE_CHECKING:
    from fitball.data.table import ImpactTable


class Role(StrEnum):
    """What the labels of a column name."""

    SURFACE = "surface"
    BALL = "ball"
    PLACE = "place"
    SESSION = "session"


# Names of such columns in some languages, without case, blanks and underscores.
_NAMES: Mapping[Role, str] = {
    Role.SURFACE: (
        "surface surfaces surfacetype court courts courttype courtsurface playingsurface floor turf belag bodenbelag "
        "untergrund superficie terrain pista"
    ),
    Role.BALL: "ball balls balltype ballid ballno ballnumber ballname ballbrand ballmodel pelota balle bola palla",
    Role.PLACE: (
        "location locations place places position positions pos spot testlocation testposition ort stelle "
        "ubicacion posicion emplacement"
    ),
    Role.SESSION: "session sessions filmsession sitzung aufnahme sesion seance",
}
_ROLES = {name: role for role, names in _NAMES.items() for name in names.split()}
# Names of labels of which it is not known what they name, which are looked at like those of surfaces.
GROUPS = ("group", "table")
# Rows that a level must have to count, levels of which that must be so, and levels at most.
LEAST_ROWS, LEAST_LEVELS, MOST_LEVELS = 3, 2, 12
# Labels of a column that are compared with each other, at most.
MOST_COMPARED = 40
# Labels are near each other where so much of their letters agrees: one wrong letter in four.
_NEAR, _LEAST_LETTERS = 0.75, 4


def role_of(name: str) -> Role | None:
    """What the labels of a column of this name are names of; None where the name does not say."""
    return _ROLES.get(bare(name))


@dataclass(frozen=True)
class Labelled:
    """A label column: `column`, its `role` (None: unknown), and the number of rows of each label, in their order."""

    column: str
    role: Role | None
    counts: Mapping[str, int]

    @property
    def divides(self) -> bool:
        """Whether parameters can be separated between its levels: enough levels, with enough rows."""
        enough = sum(count >= LEAST_ROWS for count in self.counts.values())
        return enough >= LEAST_LEVELS and len(self.counts) <= MOST_LEVELS and "" not in self.counts

    def has(self, rows: int) -> bool:
        """Whether so many levels have at least so many rows each as a fit to each takes."""
        return self.divides and sum(count >= rows for count in self.counts.values()) >= LEAST_LEVELS

    @property
    def rows(self) -> str:
        """The levels with their numbers of rows, in words."""
        rows = [f"{label or 'no label'} ({count})" for label, count in self.counts.items()]
        return some([f"{rows[0][:-1]} row{'s' * (next(iter(self.counts.values())) != 1)})", *rows[1:]])

    @property
    def noun(self) -> str:
        """What its levels are called, in the plural."""
        return f"{self.role or 'level'}s"


def labelled(labels: Mapping[str, Sequence[str]]) -> tuple[Labelled, ...]:
    """The label columns by which rows may be grouped: those of surfaces, balls and places, groups, and others whose
    labels come again. Texts of which most come once are remarks, and numbers with decimals are measurements.
    """
    found = []
    for column, cells in labels.items():
        # A counter keeps the order in which labels first come.
        role, counts = role_of(column), dict(Counter(cells))
        if len(counts) < LEAST_LEVELS:
            continue
        item = Labelled(column, role, counts)
        if role is not None or column in GROUPS or (item.divides and not _measured(counts)):
            found.append(item)
    return tuple(found)


def grouping(table: ImpactTable) -> tuple[Labelled, ...]:
    """The label columns of a table that divide the rows."""
    return tuple(item for item in labelled(table.labels) if item.divides)


def _measured(labels: Iterable[str]) -> bool:
    return all(is_number(label) for label in labels) and any(re.search(r"[.,]", label) for label in labels)


def one_spelling(texts: Mapping[str, Texts], found: Findings) -> dict[str, Texts]:
    """The texts with labels that differ in case, blanks or accents only as one, in the most frequent spelling, with a
    notice; and a notice for what was found in columns of surfaces, balls and places.
    """
    made = dict(texts)
    for column, cells in texts.items():
        if role_of(column) is None and column not in GROUPS:
            continue
        as_plain = {cell: plain_label(cell) for cell in set(cells)}
        spellings: dict[str, Counter[str]] = {}
        for cell in cells:
            spellings.setdefault(as_plain[cell], Counter())[cell.strip()] += 1
        chosen = {own: counts.most_common(1)[0][0] for own, counts in spellings.items()}
        made[column] = tuple(chosen[as_plain[cell]] for cell in cells)
        for own, counts in spellings.items():
            others = [f"'{label}' ({count})" for label, count in counts.items() if label != chosen[own]]
            if others:
                found.notice(f"{column}: {some(others)} read as '{chosen[own]}'", column)
    for item in labelled(made):
        _announce(item, made[item.column], found)
    return made


def _announce(item: Labelled, cells: Texts, found: Findings) -> None:
    """What a label column holds, what in it may be misspelt or missing, and what an unknown one may name."""
    column, count = item.column, len(item.counts)
    if item.role is not None and item.divides:
        found.notice(f"column {column}: {count} {item.noun}: {item.rows}", column)
    elif item.role is None and column not in GROUPS:
        ours = spoken(f"--columns ball={column}", f"columns={{'ball': {column!r}}}")
        found.notice(
            f"column {column} has {count} labels: {item.rows}. If they name balls, surfaces or places, say which, as "
            f"in {ours}",
            column,
        )
    if item.role is not None and (missing := item.counts.get("")):
        rows = [str(number) for number, cell in zip(found.rows.numbers, cells, strict=True) if not cell]
        found.notice(
            f"{missing} row{'s' * (missing != 1)} without a {column} (row {some(rows)}): no parameter is fitted to "
            f"each {column}. Fill these cells, or leave the rows out",
            column,
        )
    # Of many labels each is compared with all others; those that name every row of a long table are no misspellings.
    for label, other in _near_labels(item) if count <= MOST_COMPARED else ():
        row = next(number for number, cell in zip(found.rows.numbers, cells, strict=True) if cell == label)
        found.notice(
            f"{column} '{label}' (row {row}) is like '{other}', and is kept apart. If it is a misspelling, write "
            f"'{other}' there",
            column,
        )


def _near_labels(item: Labelled) -> list[tuple[str, str]]:
    """Labels of fewer rows that one or two letters may make another: without numbers, which name what differs."""
    order = sorted(item.counts, key=lambda label: -item.counts[label])
    found = []
    for k, label in enumerate(order):
        for other in order[:k]:
            near = SequenceMatcher(None, plain_label(label), plain_label(other)).ratio() >= _NEAR
            if near and _digits(label) == _digits(other) and min(len(label), len(other)) >= _LEAST_LETTERS:
                found.append((label, other))
                break
    return found


def _digits(label: str) -> list[str]:
    return re.findall(r"[0-9]+", label)


def plain_label(label: str) -> str:
    """A label without case, accents and superfluous blanks."""
    apart = unicodedata.normalize("NFKD", label.casefold())
    return " ".join("".join(letter for letter in apart if not unicodedata.combining(letter)).split())
