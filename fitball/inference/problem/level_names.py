"""The labels over which parameters of a fit differ, as a user names them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

from fitball.data.header import bare
from fitball.data.labels import plain_label, role_of
from fitball.errors import ParameterError
from fitball.inference.problem.pooling import NEW, Levels
from fitball.visible import some
from fitball.wording import spoken

Value = TypeVar("Value")


def labels_of(levels: Sequence[Levels]) -> Mapping[str, tuple[str, ...]]:
    """The labels of each column over which a parameter differs."""
    return {item.column: item.labels for item in levels}


def heads_of(columns: Sequence[str]) -> tuple[str, ...]:
    """What labels name: surface, place or ball by what a column is, where no two are the same, else the column."""
    named = tuple(str(role_of(column) or column) for column in columns)
    return named if len({*named}) == len(named) else tuple(columns)


def column_of(levels: Sequence[Levels], name: str) -> str | None:
    """The column over which a parameter differs that is called `name`, whatever its case, blanks and underscores."""
    return next((column for column in labels_of(levels) if bare(column) == bare(name)), None)


def columns_of(levels: Sequence[Levels], asked: Mapping[str, Value]) -> dict[str, Value]:
    """What is asked for by column, under the names that the columns have in the fit. Raises ParameterError for a
    column over which no parameter differs, and for one that is named twice.
    """
    found = dict[str, Value]()
    for name, value in asked.items():
        column, label = column_of(levels, name), value if isinstance(value, str) else "..."
        if column is None:
            known = labels_of(levels)
            others = f" (columns: {', '.join(known)})" if known else ""
            raise ParameterError(
                f"{at_level(name, label)}: no parameter of this fit differs between levels of {name}{others}: "
                "leave it out"
            )
        if column in found:
            raise ParameterError(f"{at_level(name, label)}: {column} is named twice; give each label once")
        found[column] = value
    return found


def checked_label(levels: Sequence[Levels], column: str, label: str | None) -> str:
    """A label as it was fitted, whatever its case, blanks and accents, or `new`. Raises ParameterError for None, and
    for one that was not fitted.
    """
    known = labels_of(levels)[column]
    if label is None:
        names = [item.parameter for item in levels if item.column == column]
        raise ParameterError(
            f"{' and '.join(names)} {'differs' if len(names) == 1 else 'differ'} between the levels of {column} "
            f"({some(known)}): name one, such as {at_level(column, known[0])}"
        )
    found = label if label in known else next((name for name in known if plain_label(name) == plain_label(label)), "")
    if not found and plain_label(label) != NEW:
        raise ParameterError(
            f"{column} '{label}' was not fitted. Fitted: {some(known)}. For one of which nothing was measured use "
            f"{at_level(column, NEW)}; its intervals are wider"
        )
    return found or NEW


def at_level(column: str, label: str) -> str:
    """How a level is asked for."""
    return spoken(f"--level {column}={label}", f"levels={{{column!r}: {label!r}}}")
