"""What comes of a file before anything is interpreted: cells as text, each with its place."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

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
