"""One table of a batch: read, fitted unless it was already, its files and its row written, the row last."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fitball.api.calibrating import Run, pose
from fitball.batch.plan import RECORD_NAME, ROW_NAME, Plan
from fitball.batch.task import Task
from fitball.errors import FitballError, ResultFolderError
from fitball.files import all_or_none
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Fit
from fitball.inference.results.source import Digest
from fitball.report.batch.rows import CSV_NAME, Row, check_row, failed_row, row_of
from fitball.report.fit.folder import prepare_folder, write_all
from fitball.report.form.files import json_text, remove, write_text
from fitball.report.saved.fit_file import fit_text, read_fit
from fitball.report.saved.netcdf_files import DATA_NAME, write_data
from fitball.report.saved.run_file import RUN_NAME, run_text
from fitball.report.saved.structure import FIT_NAME, Part, damaged, read_json, structured
from fitball.wording import option


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
