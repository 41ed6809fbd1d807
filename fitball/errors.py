"""What can go wrong, named so that a caller can tell one fault from another.

Every error a user can cause is a `FitballError`: the command line prints its message without a
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
    """Base of all errors that a user, not a programmer, has to mend."""


class ModelError(FitballError):
    """An unknown model or closure, or a combination that does not exist."""


class ParameterError(FitballError):
    """A parameter value or prior that is unknown, out of bounds or impossible for the model."""


def check_whole(**numbers: object) -> None:
    """Raise ParameterError for what is no whole number, or negative; None stands for a default."""
    for name, value in numbers.items():
        if value is not None and (isinstance(value, bool) or not isinstance(value, Integral) or value < 0):
            raise ParameterError(f"{name} = {value!r}: expected a whole number not below 0")


class UnitError(FitballError):
    """A unit that is not known, or that measures something else than the quantity it stands beside."""


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
    """A setting of the environment with which fitball cannot run."""


@contextmanager
def enough_memory() -> Iterator[None]:
    """Raise MemoryShortageError where what is done inside (or by a function decorated so) runs out of memory."""
    try:
        yield
    except MemoryError as error:
        raise MemoryShortageError(
            f"the memory of this machine does not suffice ({str(error) or 'nothing left'}): fit fewer rows or models "
            "at once, "
            + spoken(
                "with fewer --cores and --walkers, or calibrate with --point-only, which needs least",
                "with fewer cores and walkers, or calibrate with point_only=True, which needs least",
            )
        ) from None


class FitError(FitballError):
    """A fit that cannot be made from what was given."""


@dataclass(frozen=True)
class Fault:
    """One fault of an input file.

    `row` counts data rows from 1 (the header is not a row), `line` counts lines of the file from 1;
    either is None where the fault belongs to no single row.
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
    """An impact table that cannot be used; carries every fault found; its message has a line for each kind.
    `hints` say what may be meant.
    """

    def __init__(self, source: str, faults: Iterable[Fault], hints: Sequence[str] = ()) -> None:
        self.source = source
        self.faults = tuple(faults)
        self.hints = tuple(hints)
        lines = _grouped(self.faults)
        message = fault_list(source, len(self.faults), folded((line, line) for line in lines))
        if self.hints:
            message += "\n" + _bulleted("what may be meant, since it explains the table much better:", self.hints)
        super().__init__(message)

    def __reduce__(self) -> tuple[type[TableError], tuple[str, tuple[Fault, ...], tuple[str, ...]]]:
        # It may come from another process.
        return type(self), (self.source, self.faults, self.hints)


def _grouped(faults: Sequence[Fault]) -> list[str]:
    """One line a kind of fault: the fault, or of several rows which these are and the first in full."""
    kinds: dict[tuple[str | None, str, bool], list[Fault]] = {}
    for fault in faults:
        kinds.setdefault((fault.column, kind_of(fault.message), fault.row is None), []).append(fault)
    return [line for members in kinds.values() for line in _told(members)]


def _told(members: Sequence[Fault]) -> list[str]:
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


EXPLAINED = "another reading explains it much better than its header:"


class ReadingError(FitballError):
    """A table that other readings explain much better than its header, or whose rows are copies, as `head` says;
    `readings` say which, in numbers, and what to do about each.
    """

    def __init__(self, source: str, readings: Sequence[str], head: str = EXPLAINED) -> None:
        self.source, self.head = source, head
        self.readings = tuple(readings)
        super().__init__(
            _bulleted(f"{one_line(source)}: {head}", self.readings)
            + f"\n  if it is right as it stands, pass {option('as_read')}; nothing was changed"
        )

    def __reduce__(self) -> tuple[type[ReadingError], tuple[str, tuple[str, ...], str]]:
        return type(self), (self.source, self.readings, self.head)


def _bulleted(head: str, lines: Iterable[str]) -> str:
    return "\n".join([head, *(f"  - {line}" for line in lines)])


def suggestion(name: object, known: Iterable[str]) -> str:
    """Words that name the nearest known spelling, or list all known ones when none is near."""
    choices = sorted(known)
    near = get_close_matches(str(name), choices, n=1, cutoff=0.6)
    if near:
        return f"did you mean '{near[0]}'?"
    return "known: " + ", ".join(choices)
