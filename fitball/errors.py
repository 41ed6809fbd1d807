"""The errors of fitball, one class for each kind.

Every error that a user can cause is a `FitballError`: the command line prints its message without a
traceback and exits with 2. The message says what was read, where, what was expected and what to do.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from numbers import Integral

from fitball.visible import folded, kind_of, one_line
from fitball.wording import option, spoken


class FitballError(Exception):
    """Base of all errors that a user can correct."""


class ModelError(FitballError):
    """An unknown model or closure, or a combination that does not exist."""


class ParameterError(FitballError):
    """A parameter value or prior that is unknown, out of bounds or impossible for the model."""


def check_whole(**numbers: object) -> None:
    """Raise ParameterError unless each is a whole number, not negative; None is the default."""
    for name, value in numbers.items():
        if value is not None and (isinstance(value, bool) or not isinstance(value, Integral) or value < 0):
            raise ParameterError(f"{name} = {value!r}: expected a whole number, 0 or more")


class UnitError(FitballError):
    """A unit that is unknown, or of another quantity."""


class SceneError(FitballError):
    """A scene file (TOML) that cannot be used."""


def fault_list(source: str, count: int, lines: Iterable[str]) -> str:
    """The message that lists the faults of a file."""
    return _bulleted(f"{one_line(source)}: {count} fault{'s' if count != 1 else ''}", lines)


class ResultFolderError(FitballError):
    """A result folder that cannot be written, read or resumed."""


class MemoryShortageError(FitballError):
    """Work that does not fit into the memory of the machine."""


class EnvironmentSettingError(FitballError):
    """A setting of the environment that fitball cannot run with."""


@contextmanager
def enough_memory() -> Iterator[None]:
    """Raise MemoryShortageError when the code inside runs out of memory."""
    try:
        yield
    except MemoryError as error:
        raise MemoryShortageError(
            f"not enough memory on this machine ({str(error) or 'nothing left'}): fit fewer rows or models at once, "
            + spoken(
                "with fewer --cores and --walkers, or calibrate with --point-only, which needs the least",
                "with fewer cores and walkers, or calibrate with point_only=True, which needs the least",
            )
        ) from None


class TrackError(FitballError):
    """Positions of a ball in which there is no impact."""


class FitError(FitballError):
    """A fit that is impossible with this input."""


@dataclass(frozen=True)
class Fault:
    """One fault of an input file.

    `row` counts data rows from 1 (the header is not a row), `line` counts lines of the file from 1.
    Either is None for a fault without a row.
    """

    message: str
    row: int | None = None
    line: int | None = None
    column: str | None = None

    def __str__(self) -> str:
        where = []
        if self.row is not None:
            where.append(f"row {self.row}" + (f" (line {self.line})" if self.line is not None else ""))
        elif self.line is not None:
            where.append(f"line {self.line}")
        if self.column is not None:
            where.append(f"column '{self.column}'")
        return one_line(f"{', '.join(where)}: {self.message}" if where else self.message)


# Rows of a kind of fault that are named one by one.
ROWS_NAMED = 6


class TableError(FitballError):
    """An impact table that cannot be used, with every fault; the message has one line for each kind. `hints` are
    readings that fit better.
    """

    def __init__(self, source: str, faults: Iterable[Fault], hints: Sequence[str] = ()) -> None:
        self.source = source
        self.faults = tuple(faults)
        self.hints = tuple(hints)
        lines = _grouped(self.faults)
        if len(lines) == 1 and lines[0] == self.faults[0].message:
            message = f"{one_line(source)}: {lines[0]}"
        else:
            message = fault_list(source, len(self.faults), folded((line, line) for line in lines))
        if self.hints:
            message += "\n" + _bulleted("possible reasons (these readings fit the data much better):", self.hints)
        super().__init__(message)

    def __reduce__(self) -> tuple[type[TableError], tuple[str, tuple[Fault, ...], tuple[str, ...]]]:
        # It may come from another process.
        return type(self), (self.source, self.faults, self.hints)


def _grouped(faults: Sequence[Fault]) -> list[str]:
    """One line for each kind of fault: a single fault, or the rows of several and the first in full."""
    kinds: dict[tuple[str | None, str, bool], list[Fault]] = {}
    for fault in faults:
        kinds.setdefault((fault.column, kind_of(fault.message), fault.row is None), []).append(fault)
    return [line for members in kinds.values() for line in _lines(members)]


def _lines(members: Sequence[Fault]) -> list[str]:
    first = members[0]
    if len(members) == 1 or first.row is None:
        return [str(fault) for fault in members]
    line = f"line {first.line}" if first.line is not None else ""
    if len(members) <= ROWS_NAMED:
        where = f"rows {', '.join(str(fault.row) for fault in members)}" + (f" (first: {line})" if line else "")
    else:
        where = f"{len(members):,} rows (first: row {first.row}{', ' + line if line else ''})"
    column = f", column '{first.column}'" if first.column is not None else ""
    return [one_line(f"{where}{column}: {first.message}")]


EXPLAINED = "another reading fits the data much better than the header:"


class ReadingError(FitballError):
    """A table that other readings fit much better than its header, or with copied rows, as `head` says; `readings`
    have the numbers, and what to do.
    """

    def __init__(self, source: str, readings: Sequence[str], head: str = EXPLAINED) -> None:
        self.source, self.head = source, head
        self.readings = tuple(readings)
        super().__init__(
            _bulleted(f"{one_line(source)}: {head}", self.readings)
            + f"\n  if the table is right, pass {option('as_read')}"
        )

    def __reduce__(self) -> tuple[type[ReadingError], tuple[str, tuple[str, ...], str]]:
        return type(self), (self.source, self.readings, self.head)


def _bulleted(head: str, lines: Iterable[str]) -> str:
    return "\n".join([head, *(f"  - {line}" for line in lines)])


def suggestion(name: object, known: Iterable[str]) -> str:
    """The nearest known spelling, or the list of all if none is near."""
    choices = sorted(known)
    near = get_close_matches(str(name), choices, n=1, cutoff=0.6)
    if near:
        return f"did you mean '{near[0]}'?"
    return "known: " + ", ".join(choices)
