"""What comes of a file before anything is interpreted, cells as text, each with its place; and what a look at them
finds: faults, for which a table is refused, and notices.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field

from fitball.data.table import Notice
from fitball.errors import Fault, TableError

# Cells, and the line they start on (None where there are no lines).
Record = tuple[int | None, tuple[str, ...]]

# What a spreadsheet shows where a formula has no value, in English and German: no comment, though it begins like one.
FORMULA_ERROR = re.compile(
    r"#(?:N/?A|NV|VALUE!|WERT!|DIV/0!|REF!|BEZUG!|NAME\?|NUM!|ZAHL!|NULL!)(?![\w!?])", re.IGNORECASE
)


@dataclass(frozen=True)
class RawRow:
    """One data row: its `number` from 1, the `line` of the file it starts on (None without lines), its cells."""

    number: int
    line: int | None
    cells: tuple[str, ...]


@dataclass(frozen=True)
class RawTable:
    """Header and rows as text; every row has as many cells as the header. `data` is the file's bytes, `notes` say
    what was assumed or passed over.
    """

    header: tuple[str, ...]
    header_line: int | None
    rows: tuple[RawRow, ...]
    data: bytes
    faults: tuple[Fault, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Vocabulary:
    """What a header is told by: `worth` of a cell (1 for a column that is known, less for one that may be meant, 0
    for any other text), and whether a text `is_unit`.
    """

    worth: Callable[[str], float]
    is_unit: Callable[[str], bool]


def refusal(source: str, message: str, line: int | None = None) -> TableError:
    """The error of a file that cannot be taken apart."""
    return TableError(source, [Fault(message, line=line)])


# Faults that are kept one by one: a table of millions of cells may have one in each.
MOST_FAULTS = 100_000


@dataclass
class Findings:
    """Faults and notices of a table, as one check after the other finds them; `rows` are those that are left of it,
    `line` is that of its header, `more` counts faults beyond those that are kept.
    """

    rows: tuple[RawRow, ...]
    line: int | None
    faults: list[Fault] = field(default_factory=list)
    notices: list[Notice] = field(default_factory=list)
    more: int = 0

    @staticmethod
    def of(raw: RawTable) -> Findings:
        """What was found of a table when it was taken apart."""
        return Findings(raw.rows, raw.header_line, list(raw.faults), [Notice(text) for text in raw.notes])

    def fault(self, message: str, column: str | None = None, place: int | None = None) -> None:
        """Add a fault of the row at a `place`, or without one of the whole table."""
        if len(self.faults) >= MOST_FAULTS:
            self.more += 1
            return
        number, line = (None, None) if place is None else (self.rows[place].number, self.rows[place].line)
        self.faults.append(Fault(message, number, line, column))

    def header_fault(self, message: str, column: str | None = None) -> None:
        """Add a fault of the header."""
        self.faults.append(Fault(message, line=self.line, column=column))

    def notice(self, message: str, *columns: str, place: int | None = None, kind: str = "") -> None:
        """Add a notice about `columns`, or about them in the row at a `place`; for `kind` see `Notice`."""
        row = None if place is None else self.rows[place].number
        self.notices.append(Notice(message, row, columns, kind))

    def refuse(self, source: str, hints: tuple[str, ...] = ()) -> None:
        """Raise TableError if there is a fault: header first, then row by row, as one works through a file."""
        if self.more:
            self.faults.append(Fault(f"{self.more:,} more faults, which are not listed"))
        if self.faults:
            raise TableError(source, sorted(self.faults, key=lambda fault: fault.row or 0), hints)
