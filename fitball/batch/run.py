"""Tasks through an engine, and what they found together; nothing is held of a table but its row."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from fitball.batch.one import Done, fit_one
from fitball.batch.plan import RECORD_NAME, Plan
from fitball.batch.task import Task
from fitball.errors import ParameterError, ResultFolderError
from fitball.report.batch.rows import FAILED, HEAD, NAME, Row, failed_row
from fitball.report.form.files import json_text, write_text
from fitball.report.form.folders import LOCK_NAME, make_folder
from fitball.report.saved.structure import read_json
from fitball.scheduling.engine import Engine

KIND = "fitball batch"


@dataclass(frozen=True)
class Going:
    """How far a batch is: so many `done` `of` all, `kept` of them from an earlier run, `failed`."""

    done: int
    of: int
    kept: int
    failed: int


def run_tasks(
    tasks: Sequence[Task], plan: Plan, engine: Engine, report: Callable[[Going], None] = lambda _going: None
) -> tuple[Row, ...]:
    """One row a task, in their order, all with the same columns.

    A table that is finished in `plan.folder` is not fitted again, one that was interrupted is. Raises
    ResultFolderError for a folder that holds something else, ParameterError for two tables of one name and for what
    `Engine.unordered` names.
    """
    names = [task.name for task in tasks]
    twice = next((name for name in names if names.count(name) > 1), None) if len(set(names)) < len(names) else None
    if twice is not None:
        raise ParameterError(f"two tables are called '{twice}'")
    _claim(plan)
    rows: dict[str, Row] = {}
    kept = failed = 0
    report(Going(0, len(tasks), 0, 0))
    for done in _done(tasks, plan, engine):
        rows[str(done.row[NAME])] = done.row
        kept += done.kept
        failed += done.row["outcome"] == FAILED
        report(Going(len(rows), len(tasks), kept, failed))
    columns = _columns([rows[name] for name in names])
    return tuple({column: rows[name].get(column) for column in columns} for name in names)


def _done(tasks: Sequence[Task], plan: Plan, engine: Engine) -> Iterator[Done]:
    for task in tasks:
        if task.fault:
            yield Done(failed_row(task.name, task.fault))
    yield from engine.unordered(partial(fit_one, plan), [task for task in tasks if not task.fault], lost=_lost)


def _lost(task: Task, how: str) -> Done:
    """The row of a table that ended the process that fitted it."""
    reason = (
        f"the process that read and fitted it ended with {how}, and so when nothing else ran beside it: the file "
        "makes a library crash, or needs more memory than this machine has; look at it, or leave it out"
    )
    return Done(failed_row(task.name, reason))


def _columns(rows: Sequence[Row]) -> list[str]:
    """Those of all rows in the order of the row that has most, others behind."""
    most: Row = max(rows, key=len, default={})
    return list(dict.fromkeys([*HEAD, *most, *(column for row in rows for column in row)]))


def _claim(plan: Plan) -> None:
    """Mark the folder as that of a batch. Raises ResultFolderError for one that holds other things."""
    record = plan.folder / RECORD_NAME
    if record.exists():
        if read_json(record) != {"kind": KIND}:
            raise ResultFolderError(f"{record}: not what fitball batch writes; name another folder")
        return
    if plan.folder.is_dir() and any(item.name != LOCK_NAME for item in plan.folder.iterdir()):
        raise ResultFolderError(f"{plan.folder}: holds other files than those of a batch; name another folder")
    make_folder(plan.folder)
    write_text(record, json_text({"kind": KIND}))
