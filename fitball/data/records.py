"""Records of cells, as texts and workbooks give them: header, comments, sizes.

What is too large is refused with words before it takes 1 GB of memory, whatever a file declares of
itself.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from math import isnan
from typing import TypeAlias

from fitball.base.errors import Fault, InputError

# What a cell is worth as one of a header: 1 for a name of a column, less for a text that may mean
# one, 0 for any other text.
NameWorth: TypeAlias = Callable[[str], float]
# The line on which a record starts, and its cells.
Record: TypeAlias = tuple[int, list[str]]

# Most bytes of a file.
MOST_BYTES = 250_000_000
# Most rows of a table.
MOST_ROWS = 2_000_000
# Most columns of a table.
MOST_COLUMNS = 1_000
# Most cells of a table.
MOST_CELLS = 20_000_000
# Records among which the header is looked for.
HEADER_RECORDS = 60
# The least that a header must be worth: a single name that may be meant.
_LEAST_WORTH = 0.5
# The least that a header in a comment must be worth: two names, since a remark may have one.
_LEAST_COMMENT_WORTH = 2.0
# A number with a decimal point.
NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
# Larger whole numbers are written with an exponent.
_LARGEST_WHOLE = 1e15
# A spreadsheet's error is no comment, though it begins like one.
FORMULA_ERROR = re.compile(
    r"#(?:N/?A|NV|VALUE!|WERT!|DIV/0!|REF!|BEZUG!|NAME\?|NUM!|ZAHL!|NULL!)(?![\w!?])",
    re.IGNORECASE,
)


def refusal(source: str, code: str, message: str, line: int | None = None) -> InputError:
    """The error of a source that cannot be taken apart."""
    return InputError(source, [Fault(code, message, line=line)])


def too_large(source: str, what: str, most: str, line: int | None = None) -> InputError:
    """The refusal of a source of which `what` is more than `most`."""
    words = (
        f"{what}: too large to be read; expected at most {most}: keep the columns of impacts, "
        "or divide the table"
    )
    return refusal(source, "too-large", words, line)


def check_shape(source: str, rows: int, columns: int) -> None:
    """Refuse more rows, columns or cells than a table may have.

    Raises:
        InputError: The table is larger (`too-large`).
    """
    if rows > MOST_ROWS or columns > MOST_COLUMNS or rows * columns > MOST_CELLS:
        most = f"{MOST_ROWS:,} rows, {MOST_COLUMNS:,} columns and {MOST_CELLS:,} cells"
        raise too_large(source, f"{rows:,} rows of {columns:,} columns", most)


def is_comment(cells: Sequence[str]) -> bool:
    """Whether a record is a comment: its first cell begins with `#`, but is no `#` alone, which is
    a name of a column, and no error of a formula.
    """
    first = cells[0]
    return first.startswith("#") and len(first) > 1 and not FORMULA_ERROR.match(first)


def is_wider_by_blanks(cells: Sequence[str], width: int) -> bool:
    """Whether a row has more cells than a header of this `width`, the others all empty."""
    return len(cells) > width and not any(cells[width:])


def find_header(records: Sequence[Record], name_worth: NameWorth) -> tuple[int, float]:
    """The header among records: its index, and what its names are worth in all.

    It is the record whose names are worth most; a comment, as NumPy writes headers, only where no
    other record is worth enough. Without any it is the first record that is no comment.
    """
    for comments, least in ((False, _LEAST_WORTH), (True, _LEAST_COMMENT_WORTH)):
        worths = []
        for _, cells in records:
            worth = sum(name_worth(cell.lstrip("# ")) for cell in cells)
            worths.append(worth if is_comment(cells) == comments else 0.0)
        best = max(worths, default=0.0)
        if best >= least:
            return worths.index(best), best
    for index, (_, cells) in enumerate(records):
        if not is_comment(cells):
            return index, 0.0
    return 0, 0.0


def cell_text(value: object) -> str:
    """A cell as a person would write it: whole numbers without a point, NaN as nothing, half
    characters escaped.
    """
    if not isinstance(value, float):
        return str(value).encode(errors="backslashreplace").decode().strip()
    if isnan(value):
        return ""
    if value.is_integer() and abs(value) < _LARGEST_WHOLE:
        return f"{value:.0f}"
    return str(value)
