"""What is asked of every table of a batch; one table fitted and its row written, the row last; all of them through an
engine, nothing held of a table but its row.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from fitball.api.calibrating import Run, pose
from fitball.batch.tables import RECORD_NAME, ROW_NAME, Task
from fitball.errors import FitballError, ParameterError, ResultFolderError
from fitball.files import all_or_none
from fitball.inference.calibrate import fingerprint
from fitball.inference.effort import Effort
from fitball.inference.problem.problem import Choices, Problem
from fitball.inference.results.results import Fit
from fitball.inference.results.source import Digest
from fitball.report.batch.rows import CSV_NAME, FAILED, HEAD, NAME, Row, check_row, failed_row, row_of
from fitball.report.fit.folder import prepare_folder, write_all
from fitball.report.form.files import json_text, remove, write_text
from fitball.report.form.folders import LOCK_NAME, make_folder
from fitball.report.saved.fit_file import fit_text, read_fit
from fitball.report.saved.netcdf_files import DATA_NAME, write_data
from fitball.report.saved.run_file import RUN_NAME, run_text
from fitball.report.saved.structure import FIT_NAME, Part, damaged, read_json, structured
from fitball.scheduling.engine import Engine
from fitball.wording import option


@dataclass(frozen=True)
class Plan:
    """How each table is read and fitted, and where its folder lies: below `folder`, by name.

    `full` results are those of `calibrate`, the others `fit.json` alone. `config` is the scene of all (None: each
    its own, beside it).
    """

    folder: Path
    choices: Choices = field(default_factory=Choices)
    effort: Effort = field(default_factory=lambda: Effort(cores=1))
    config: str | None = None
    flip: tuple[str, ...] = ()
    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    as_read: bool = False
    full: bool = False
    overwrite: bool = False

    def mark(self, problem: Problem) -> str:
        """SHA-256 over all that the result of a table depends on."""
        effort = self.effort
        parts = [fingerprint(problem, effort), *map(repr, (self.choices, effort.max_steps, effort.point_only))]
        # What is told of a fit depends on the scene beyond its parameters: surface, type of ball, temperature.
        scene = replace(problem.scene, source=None)
        parts += map(repr, (self.full, self.as_read, sorted(self.units.items()), problem.notes, scene))
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


class KeptRow(Part, frozen=True):
    """What `row.json` holds: the digest of all that a fit depends on, and the row of the fit."""

    mark: Digest
    row: Mapping[str, str | float | None]


@dataclass(frozen=True)
class Done:
    """One table is done: its `row`, and whether that was `kept` from an earlier run."""

    row: Row
    kept: bool = False


def fit_one(plan: Plan, task: Task) -> Done:
    """The row of a table; where it could not be fitted, a row that says why. Raises nothing but KeyboardInterrupt:
    one table does not stop the others.
    """
    try:
        # What one should know of a fit stands in its notes; warnings of two hundred tables are noise.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return _fitted(plan, task)
    except FitballError as error:
        return Done(failed_row(task.name, " ".join(str(error).split())))
    except Exception as error:
        # A fault of ours in one table must not cost a night's work on the others; its row tells of it.
        said = f"a fault of fitball, please report it: {type(error).__name__}: {error}"
        return Done(failed_row(task.name, " ".join(said.split())))


def _fitted(plan: Plan, task: Task) -> Done:
    if not (plan.folder / RECORD_NAME).is_file():
        raise ResultFolderError(
            f"{plan.folder.absolute()}: not the folder of the batch in the process that works; workers on other "
            "machines need the files of this one at the same place"
        )
    problem = pose(
        task.table, plan.choices, config=plan.config, flip=plan.flip, columns=plan.columns, as_read=plan.as_read,
        units=plan.units,
    )  # fmt: skip
    folder, mark = plan.folder / task.name, plan.mark(problem)
    if (folder / ROW_NAME).exists():
        try:
            kept = kept_row(folder, task.name, mark, problem)
        except ResultFolderError as error:
            if not plan.overwrite:
                raise ResultFolderError(f"{error}; or replace it with {option('overwrite')}") from None
            kept = None
        if kept is not None:
            return Done(kept, kept=True)
        if not plan.overwrite:
            raise ResultFolderError(
                f"{folder}: holds a fit of another table or with other settings; use {option('overwrite')} "
                "to replace it"
            )
    # The table of all tells of the fit that goes: nobody shall read it beside the new one.
    for place in (plan.folder / CSV_NAME, folder / ROW_NAME):
        remove(place)
    prepare_folder(folder, overwrite=True, resume=False)
    fit = Run(problem, plan.effort).fit()
    _write(fit, folder, plan.full)
    row = row_of(task.name, read_fit(folder), problem)
    write_text(folder / ROW_NAME, json_text({"mark": mark, "row": row}))
    return Done(row)


@all_or_none()
def _write(fit: Fit, folder: Path, full: bool) -> None:
    if full:
        write_all(fit, folder)
        return
    # What a fit is read back with: measurements and settings.
    write_data(fit.problem, folder / DATA_NAME)
    write_text(folder / RUN_NAME, run_text(fit, folder))
    write_text(folder / FIT_NAME, fit_text(fit))


def kept_row(folder: Path, name: str, mark: str, problem: Problem) -> Row | None:
    """The row of a finished table from the fit that lies there, None where that is of other data or settings.

    Raises ResultFolderError for files that are missing, damaged, or say different things.
    """
    place = folder / ROW_NAME
    kept = structured(place, read_json(place), KeptRow)
    if kept.mark != mark:
        return None
    saved = read_fit(folder)
    check_row(dict(kept.row), saved, place)
    row = row_of(name, saved, problem)
    if saved.source.sha256 != problem.table.digest or kept.row != row:
        raise damaged(place, "not the row of the fit.json beside it")
    return row


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
