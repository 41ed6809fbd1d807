"""What a look at a table finds: faults, for which it is refused, and notices."""

from __future__ import annotations

from dataclasses import dataclass, field

from fitball.data.dialect.cells import RawRow, RawTable
from fitball.data.table import Notice
from fitball.errors import Fault, TableError

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
