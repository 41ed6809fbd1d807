"""On which level each table of a batch lies: by a label that all its rows share, by its folder, or as told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath

from fitball.errors import ParameterError, suggestion
from fitball.report.batch.rows import DONE, LABEL, NAME, Row
from fitball.report.batch.series import things_along
from fitball.report.form.numbers import listed
from fitball.wording import option

# Levels that are the folders of tables, unless tables have a label of that name.
FOLDER = "folder"
# What every table is a level of by itself.
TABLE = "table"
# What levels are called that are told table by table.
LEVEL = "level"
Over = str | Mapping[str, str] | None


@dataclass(frozen=True)
class Grouping:
    """The level of each table that has one, `over` what; none where every table is a level by itself. `said` is what
    is to be said of that.
    """

    over: str = ""
    levels: Mapping[str, str] = field(default_factory=dict)
    said: tuple[str, ...] = ()


def grouped(rows: Sequence[Row], over: Over) -> Grouping:
    """Tables grouped `over` a label, over "folder", or as a mapping of tables to levels tells.

    Numbers or dates of which every table has its own are no levels: what drifts along them is told of a batch anyway.
    Raises ParameterError for a label that no table has, or all have the same.
    """
    if over is None or over == TABLE:
        return Grouping()
    done = {str(row[NAME]): row for row in rows if row["outcome"] == DONE}
    if not isinstance(over, str):
        for table in over.keys() - {str(row[NAME]) for row in rows}:
            raise ParameterError(f"over: no table is called '{table}': {suggestion(str(table), done)}")
        name, levels = LEVEL, {table: str(over[table]) for table in done if table in over}
    else:
        name, levels = over, _labelled(done, over)
    count = len(set(levels.values()))
    if count < 2:
        same = ", ".join(set(levels.values()))
        raise ParameterError(f"{option('over', name)}: one level alone, {same}; expected at least two levels")
    along = next((item for item in things_along(rows) if item.name == name), None)
    kind = "" if along is None else "dates" if along.first_day is not None else "numbers"
    if kind and count == len(levels):
        return Grouping(said=(_DRIFT.format(name=name, kind=kind),))
    said = [f"{len(levels):,} tables lie on {count:,} levels of {name}."]
    without = [table for table in done if table not in levels]
    if without:
        said.append(f"Left out, without one {name} for all their rows: {listed(without[:5])}{_more(without)}.")
    if kind:
        said.append(
            f"{name} holds {kind}, which are taken as names of levels; what drifts along them is told beside."
        )
    return Grouping(name, levels, (*said, *_weak(name, count, len(levels))))


_DRIFT = "{name} holds {kind}, and every table another: there are no levels; what drifts along it is told."


def _labelled(done: Mapping[str, Row], over: str) -> dict[str, str]:
    labels = {key.removeprefix(LABEL) for row in done.values() for key in row if key.startswith(LABEL)}
    if over in labels:
        cells = {table: row.get(f"{LABEL}{over}") for table, row in done.items()}
        return {table: str(cell) for table, cell in cells.items() if cell is not None}
    if over == FOLDER:
        return {table: PurePosixPath(table).parent.as_posix() for table in done}
    known = sorted({*labels, FOLDER})
    raise ParameterError(
        f"{option('over', over)}: no table has one {over} for all its rows; expected a label that tables have, or "
        f"their folder: {', '.join(known)}"
    )


def _weak(name: str, levels: int, tables: int) -> list[str]:
    """What so few levels and tables hardly tell."""
    said = []
    if levels == 2:
        said.append(f"Two levels of {name} hardly tell how far levels lie apart: that spread rests on its prior too.")
    if tables == levels:
        said.append(
            f"Every {name} has one table: how tables of one {name} differ cannot be told from how levels do, and the "
            "spread is of both."
        )
    elif tables == levels + 1:
        said.append(f"One {name} alone has two tables: the spread within levels rests on its prior too.")
    return said


def _more(names: Sequence[str]) -> str:
    return f" and {len(names) - 5:,} more" if len(names) > 5 else ""
