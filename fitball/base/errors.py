"""Errors that a user can correct, and notes that a user should read.

One class for each kind of remedy; each error, fault and note has a stable `code`. Tests and
programs look at codes and places, never at sentences.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches

from fitball.base.text import listed, one_line, visible

# Rows of a kind of fault that are named one by one.
_ROWS = 6
# Lines of a message, which must stay on a screen.
_LINES = 40
# How alike a known name is that is probably meant: one slip in a name of three letters.
_ALIKE = 0.7


class FitballError(Exception):
    """What a user can correct. The message says what was read, where, what was expected, and what
    to do; the `code` is stable. The command line prints it without traceback, with exit code 2.

    Example:
        >>> import fitball
        >>> try:
        ...     fitball.calibrate("wang_zero_spin", model="two-mas")
        ... except fitball.FitballError as error:
        ...     print(error.code)
        unknown-model
    """

    def __init__(self, message: str, code: str) -> None:
        # It may quote a file or an option.
        super().__init__(visible(message))
        self.code = code

    def __reduce__(self) -> tuple[type[FitballError], tuple[object, ...]]:
        # It may come from another process.
        return type(self), (str(self), self.code)


class ParameterError(FitballError):
    """A value, prior, unit, label, option or name that is unknown, out of bounds or impossible."""


class ModelError(FitballError):
    """A model or option that does not exist or cannot do this; a function of one's own that cannot
    be used.
    """


class FitError(FitballError):
    """A fit that is impossible with this input."""


class FolderError(FitballError):
    """A file or result folder that cannot be written, locked or read, is of another version, or was
    changed.
    """


class MachineError(FitballError):
    """Too little memory, or a setting of the environment with which fitball cannot run."""


@dataclass(frozen=True)
class Fault:
    """One fault of an input file; `row` counts rows of data, `line` lines of the file, both from
    1.
    """

    code: str
    message: str
    row: int | None = None
    line: int | None = None
    column: str | None = None


class InputError(FitballError):
    """A table, scene or film that cannot be used: all faults, and readings that explain the data
    better (`hints`).
    """

    def __init__(self, source: str, faults: Iterable[Fault], hints: Sequence[str] = ()) -> None:
        self.source = one_line(source)
        self.faults = tuple(faults)
        self.hints = tuple(hints)
        lines = _folded(self.faults)
        if len(lines) == 1:
            message = f"{self.source}: {lines[0]}"
        else:
            message = "\n  - ".join([f"{self.source}: {counted_faults(self.faults)}", *lines])
        if self.hints:
            head = "\nOther readings fit the data much better:"
            message += "\n  - ".join([head, *(one_line(hint, 400) for hint in self.hints)])
        super().__init__(message, self.faults[0].code)

    def __reduce__(self) -> tuple[type[FitballError], tuple[object, ...]]:
        return type(self), (self.source, self.faults, self.hints)


def kinds_of_faults(faults: Iterable[Fault]) -> list[list[Fault]]:
    """Faults with those of the same code and column in other rows, in the order of the first of
    each kind.
    """
    kinds: dict[object, list[Fault]] = {}
    for k, fault in enumerate(faults):
        kinds.setdefault(k if fault.row is None else (fault.column, fault.code), []).append(fault)
    return list(kinds.values())


def counted_faults(faults: Sequence[Fault]) -> str:
    """How many faults there are: one fault of many rows is one, `1 fault, in 36 rows`."""
    kinds = kinds_of_faults(faults)
    count = f"{len(kinds):,} fault{'s' * (len(kinds) != 1)}"
    if len(kinds) == len(faults):
        return count
    rows = {fault.row for fault in faults if fault.row is not None}
    return f"{count}, in {len(rows):,} rows" if len(rows) > 1 else count


def rows_of_faults(faults: Iterable[Fault]) -> str:
    """The rows of faults: `3 to 38` where none is left out, else the first six by number."""
    rows = [fault.row for fault in faults if fault.row is not None]
    if len(rows) > _ROWS and rows == [*range(rows[0], rows[0] + len(rows))]:
        return f"{rows[0]} to {rows[-1]}"
    return listed(map(str, rows), most=_ROWS)


def _folded(faults: Sequence[Fault]) -> list[str]:
    """One line for each kind of fault."""
    lines = [_line(members) for members in kinds_of_faults(faults)]
    more = len(lines) - _LINES
    if more > 0:
        return [*lines[:_LINES], f"... and {more:,} more of other columns or kinds"]
    return lines


def _line(members: Sequence[Fault]) -> str:
    """Where, and the message of the first."""
    first = members[0]
    row = "" if first.row is None else f"row {first.row}"
    line = "" if first.line is None else f"line {first.line}"
    where = f"{row} ({line})" if row and line else row + line
    if len(members) > 1:
        where = f"rows {rows_of_faults(members)} (first: {line or row})"
    column = ""
    if first.column is not None:
        kind = "key" if first.code == "scene" else "column"
        column = f"{kind} '{first.column}'"
    position = ", ".join(filter(None, [where, column]))
    return one_line(": ".join(filter(None, [position, first.message])), 400)


@dataclass(frozen=True)
class Note:
    """A sentence on what was assumed, left out or doubted; it stopped nothing."""

    code: str
    text: str


@contextmanager
def enough_memory() -> Iterator[None]:
    """Say in words, with the remedy, where the code inside runs out of memory.

    Raises:
        MachineError: it did (`memory`).
    """
    try:
        yield
    except MemoryError as error:
        remedy = (
            "fit fewer rows or models at once, use fewer cores, or fit without the posterior "
            "(--point-only)"
        )
        text = f"not enough memory on this machine ({str(error) or 'nothing is left'}): {remedy}"
        raise MachineError(text, "memory") from None


def suggestion(name: str, names: Iterable[str]) -> str:
    """`did you mean 'mu'?`, or the list of all names that could be meant."""
    choices = list(dict.fromkeys(names))
    bare = {choice.lstrip("-"): choice for choice in choices}
    near = [bare[match] for match in get_close_matches(name.lstrip("-"), bare, 1, _ALIKE)]
    if not near and name:
        near = [choice for choice in choices if choice.startswith(name)]
    if near:
        return f"did you mean '{near[0]}'?"
    return f"known: {one_line(', '.join(choices), 400)}"
