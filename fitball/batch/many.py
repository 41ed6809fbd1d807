"""`calibrate_many`: many tables, each fitted on its own; the verb `batch` calls the same functions."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from fitball.api import Fit, load_fit
from fitball.api.calibrating import Run, pose
from fitball.api.own_model import AnyModel
from fitball.api.reading import DEFAULTS, Fitting, PathLike, Table, choices_of, effort_of, listed
from fitball.batch.tables import RECORD_NAME, Task, fault_of, tasks_of
from fitball.data.covariance_entries import LEFT_OUT, Given
from fitball.errors import FitballError, ParameterError, ResultFolderError, suggestion
from fitball.files import all_or_none
from fitball.inference.calibrate import fingerprint
from fitball.inference.effort import Effort
from fitball.inference.problem.problem import Choices, Problem
from fitball.inference.results import results
from fitball.inference.results.source import Digest
from fitball.kinds import checked, spelled
from fitball.models.own import OwnFunction, last_of
from fitball.report.batch.document import Results, render, write_results
from fitball.report.batch.found import Populations
from fitball.report.batch.populations import default_names, populations
from fitball.report.batch.rows import (
    CSV_NAME,
    DONE,
    FAILED,
    HEAD,
    NAME,
    ROW_NAME,
    Row,
    check_row,
    failed_row,
    read_rows,
    row_of,
)
from fitball.report.batch.series import Over, all_series
from fitball.report.fit.folder import prepare_folder, write_all
from fitball.report.form.files import json_text, read_bounded, remove, write_text
from fitball.report.form.folders import LOCK_NAME, held, make_folder
from fitball.report.saved.fit_file import fit_text, read_fit
from fitball.report.saved.netcdf_files import DATA_NAME, write_data
from fitball.report.saved.run_file import RUN_NAME, run_text
from fitball.report.saved.structure import FIT_NAME, Part, damaged, read_json, structured
from fitball.scheduling.engine import Engine, engine
from fitball.wording import option

if TYPE_CHECKING:
    import pandas as pd

FOLDER = Path("fits") / "batch"
# A batch.csv of a hundred thousand tables has a fifth of this.
MOST_BYTES = 2**30


class Batch(Mapping[str, Fit]):
    """The fits of many tables: `batch["name"]` is the fit of one, read from its folder when it is needed.
    `to_frame()` has one row for each table, `failed` the reasons why tables could not be fitted.
    """

    def __init__(self, folder: Path, rows: Sequence[Row]) -> None:
        self.folder = folder
        self.rows = tuple(rows)
        self._shown: Results | None = None

    @property
    def failed(self) -> Mapping[str, str]:
        """Why a table could not be fitted, by its name."""
        return {str(row[NAME]): str(row["reason"]) for row in self.rows if row["outcome"] == FAILED}

    def to_frame(self) -> pd.DataFrame:
        """One row for each table: outcome, adequacy, labels, and each parameter's median (SI), sd, 95 % interval,
        verdict.
        """
        import pandas as pd

        return pd.DataFrame(self.rows).set_index(NAME)

    def report(self) -> str:
        """The result as text."""
        shown = self._shown or Results(all_series(self.rows), ())
        return render(self.rows, shown.series, self.folder, shown.populated)

    @checked
    def summarise(
        self,
        quantities: Sequence[str] = (),
        command: str | None = None,
        over: Over = None,
    ) -> Populations:
        """Write the files of the batch anew, with the populations of `quantities` besides those of `population()`.
        Returns those of `quantities`, without any all of them.
        """
        with held(self.folder):
            self._shown = write_results(self.rows, self.folder, command, quantities, over)
        return Populations(self._shown.populated, self.folder).only(quantities)

    @checked
    def population(self, *quantities: str, over: Over = None) -> Populations:
        """Mean and spread of parameters, or ratios of two (`"k_theta/k_y"`), over the tables, and each table's value
        given all others; without names those of parameters that at least three tables determine. They come from the
        saved draws: nothing is fitted. `to_frame()`, `report()` and `plot()` show them in the parameters' units.

        `over` groups tables into levels. It is a label that all rows of a table share (`"surface"`), or
        `"folder"`, or a mapping of tables to levels. There is then a spread between levels and one within them.

        Raises ParameterError for an unknown quantity, or one that too few tables have; ResultFolderError.
        """
        names = quantities or default_names(all_series(self.rows))
        return Populations(populations(self.rows, self.folder, names, over), self.folder)

    @checked
    def __getitem__(self, name: str) -> Fit:
        """Raises KeyError with the reason for a table that failed."""
        if name in self.failed:
            raise KeyError(f"{name}: {self.failed[name]}")
        if name not in list(self):
            raise KeyError(f"{name}: {suggestion(name, list(self))}")
        return load_fit(self.folder / name)

    def __iter__(self) -> Iterator[str]:
        return (str(row[NAME]) for row in self.rows if row["outcome"] != FAILED)

    def __len__(self) -> int:
        return sum(1 for _name in self)

    def __repr__(self) -> str:
        failed = f", {len(self.failed):,} failed" if self.failed else ""
        return f"<Batch of {len(self.rows):,} tables{failed}, in {self.folder}>"

    def _repr_html_(self) -> str:
        """The rows, for a notebook."""
        return f"<p>{escape(repr(self)[1:-1])}</p>{self.to_frame().to_html(max_rows=20, notebook=True)}"


@checked
def load_batch(folder: PathLike = FOLDER) -> Batch:
    """The batch in a folder that `calibrate_many` or `fitball batch` wrote; nothing is fitted.

    Raises ResultFolderError if there is none, if it is not finished, or if its table disagrees with its fits.

    >>> many = folder.parent / "kept"
    >>> tables = {"still air": "wang_zero_spin"}
    >>> made = fitball.calibrate_many(tables, "grip-slip", out=many, point_only=True, cores=1)
    >>> list(fitball.load_batch(many))
    ['still air']
    """
    place = Path(folder)
    table = place / CSV_NAME
    try:
        return Batch(place, _rows(table))
    except FileNotFoundError:
        raise ResultFolderError(
            f"{table}: no such file; expected the folder of a finished batch (to finish one, run the same fitball "
            "batch command again)"
        ) from None
    except (OSError, ValueError) as error:
        raise ResultFolderError(f"{table}: not the table of a batch: {error}; run fitball batch again") from None


def _rows(place: Path) -> tuple[Row, ...]:
    """The rows of a `batch.csv`, each compared with its fit."""
    rows = read_rows(read_bounded(place, MOST_BYTES).decode("utf-8"))
    for row in rows:
        if row["outcome"] == DONE:
            name = str(row[NAME])
            why = fault_of(name)
            if why:
                raise ValueError(f"table {name!r}: {why}")
            check_row(row, read_fit(place.parent / name), place)
    return rows


@checked
@spelled(Fitting, DEFAULTS)
def calibrate_many(
    tables: Mapping[str, Table] | Sequence[Table] | PathLike,
    model: AnyModel | None = None,
    *,
    out: PathLike = FOLDER,
    scheduler: str | None = None,
    cores: int | None = None,
    full: bool = False,
    overwrite: bool = False,
    progress: Callable[[Going], None] | None = None,
    **options: Unpack[Fitting],
) -> Batch:
    """Fit many tables, each on its own: named ones (`{"court 3": frame}`), paths, patterns (`"courts/*.csv"`),
    folders.

    In the folder `out`, every table has a folder with `fit.json`, or with `full` all files of `calibrate`. A page and
    a table with one row for each (CSV, and Parquet if pyarrow is installed) are beside them. Finished tables are not
    fitted again: the same call continues after an interruption. Results of other data or settings are refused unless
    `overwrite`. A table that cannot be fitted does not stop the others; its row has the reason. Tables run on `cores`
    processes (default: all), or on the Dask cluster at the address `scheduler`; the results do not depend on this.
    Each table is fitted as by `calibrate` with the same `seed`; for the other arguments see there. `progress` is
    called with the progress of the batch.

    Raises ParameterError, ResultFolderError; KeyboardInterrupt when it is interrupted.

    >>> tables = {"still air": "wang_zero_spin", "no table": {"v_1": [17.0]}}
    >>> many = folder.parent / "many"
    >>> batch = fitball.calibrate_many(tables, "grip-slip", out=many, point_only=True, cores=1)
    >>> batch.to_frame()["outcome"].tolist()
    ['done', 'failed']
    """
    plan = plan_of(Path(out), model, full, overwrite, **options)
    return batch_of(tables, plan, cores, scheduler, (lambda _going: None) if progress is None else progress)


def plan_of(folder: Path, model: AnyModel | None, full: bool, overwrite: bool, **options: Unpack[Fitting]) -> Plan:
    """The settings for all tables. Raises ParameterError."""
    choices, config = choices_of(model, options), options.get("config")
    return Plan(
        folder,
        choices,
        effort_of(options, 1),
        None if config is None else os.fspath(config),
        listed(options.get("flip", ())),
        listed(options.get("ignore", ())),
        _left_out(options.get("covariance")),
        options.get("columns") or {},
        options.get("units") or {},
        options.get("as_read", False),
        full,
        overwrite,
        last_of(choices.model),
    )


def _left_out(covariance: Given | None) -> str | None:
    """The word "none" where covariances are left out. Raises ParameterError for those of one table."""
    if covariance is None or (isinstance(covariance, str) and covariance == LEFT_OUT):
        return covariance
    raise ParameterError("covariance: a batch takes none only; expected files NAME_covariance.csv beside the tables")


def batch_of(
    tables: Mapping[str, Table] | Sequence[Table] | PathLike,
    plan: Plan,
    cores: int | None,
    scheduler: str | None,
    report: Callable[[Going], None],
    command: str | None = None,
) -> Batch:
    """The same for a plan; `command` is the command line."""
    workers = engine(cores, scheduler)
    tasks = tasks_of(tables, plan.folder)
    with held(plan.folder):
        batch = Batch(plan.folder, run_tasks(tasks, plan, workers, report))
        batch._shown = write_results(batch.rows, plan.folder, command, (), None)
    return batch


@dataclass(frozen=True)
class Plan:
    """How each table is read and fitted; its result is in a folder of its name, in `folder`.

    `full` results have all files of `calibrate`, others `fit.json` alone. `config` is the scene of all tables (None:
    each has its own beside it). `own` is the function of a model of one's own.
    """

    folder: Path
    choices: Choices = field(default_factory=Choices)
    effort: Effort = field(default_factory=lambda: Effort(cores=1))
    config: str | None = None
    flip: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    covariance: str | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    as_read: bool = False
    full: bool = False
    overwrite: bool = False
    own: OwnFunction | None = None

    def mark(self, problem: Problem) -> str:
        """SHA-256 of everything that the result of a table depends on."""
        effort = self.effort
        parts = [fingerprint(problem, effort), *map(repr, (self.choices, effort.max_steps, effort.point_only))]
        # Reports depend on more of the scene than the parameters: surface, type of ball, temperature.
        scene = replace(problem.scene, source=None)
        parts += map(repr, (self.full, self.as_read, sorted(self.units.items()), problem.notes, scene))
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


class KeptRow(Part, frozen=True):
    """The content of `row.json`: the digest of everything that a fit depends on, and its row."""

    mark: Digest
    row: Mapping[str, str | float | None]


@dataclass(frozen=True)
class Done:
    """A finished table: its `row`, and whether that was `kept` from an earlier run."""

    row: Row
    kept: bool = False


def fit_one(plan: Plan, task: Task) -> Done:
    """The row of a table, with the reason if it could not be fitted. Raises KeyboardInterrupt only: one table does
    not stop the others.
    """
    try:
        # Notes of a fit are in its file; warnings of two hundred tables would not be read.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return _fitted(plan, task)
    except FitballError as error:
        return Done(failed_row(task.name, " ".join(str(error).split())))
    except Exception as error:
        # A fault of fitball with one table must not stop the others; its row reports it.
        reason = f"a fault of fitball, please report it: {type(error).__name__}: {error}"
        return Done(failed_row(task.name, " ".join(reason.split())))


def _fitted(plan: Plan, task: Task) -> Done:
    if not (plan.folder / RECORD_NAME).is_file():
        raise ResultFolderError(
            f"{plan.folder.absolute()}: a worker does not find the folder of the batch here; workers on other "
            "machines need the same files at the same path"
        )
    problem = pose(
        task.table, plan.choices, config=plan.config, flip=plan.flip, columns=plan.columns, as_read=plan.as_read,
        units=plan.units, ignore=plan.ignore, covariance=plan.covariance,
    )  # fmt: skip
    folder, mark = plan.folder / task.name, plan.mark(problem)
    if (folder / ROW_NAME).exists():
        try:
            kept = kept_row(folder, task.name, mark, problem)
        except ResultFolderError as error:
            if not plan.overwrite:
                raise ResultFolderError(f"{error}; {option('overwrite')} replaces it") from None
            kept = None
        if kept is not None:
            return Done(kept, kept=True)
        if not plan.overwrite:
            raise ResultFolderError(
                f"{folder}: has a fit of another table or with other settings; {option('overwrite')} replaces it"
            )
    # The table of all has the row of the old fit, and must not be read beside the new one.
    for place in (plan.folder / CSV_NAME, folder / ROW_NAME):
        remove(place)
    prepare_folder(folder, overwrite=True, resume=False)
    fit = Run(problem, plan.effort).fit()
    _write(fit, folder, plan.full)
    row = row_of(task.name, read_fit(folder), problem)
    write_text(folder / ROW_NAME, json_text({"mark": mark, "row": row}))
    return Done(row)


@all_or_none()
def _write(fit: results.Fit, folder: Path, full: bool) -> None:
    if full:
        write_all(fit, folder)
        return
    # Measurements and settings, with which a fit is read back.
    write_data(fit.problem, folder / DATA_NAME)
    write_text(folder / RUN_NAME, run_text(fit, folder))
    write_text(folder / FIT_NAME, fit_text(fit))


def kept_row(folder: Path, name: str, mark: str, problem: Problem) -> Row | None:
    """The row of a finished table, None if its fit is of other data or settings.

    Raises ResultFolderError for files that are missing, damaged, or disagree.
    """
    place = folder / ROW_NAME
    kept = structured(place, read_json(place), KeptRow)
    if kept.mark != mark:
        return None
    saved = read_fit(folder)
    check_row(dict(kept.row), saved, place)
    row = row_of(name, saved, problem)
    if saved.source.sha256 != problem.table.digest or kept.row != row:
        raise damaged(place, "its row is not that of the fit.json beside it")
    return row


KIND = "fitball batch"


@dataclass(frozen=True)
class Going:
    """Progress of a batch: tables `done` of a `total`, with those `kept` from an earlier run and those `failed`."""

    done: int
    total: int
    kept: int
    failed: int


def run_tasks(
    tasks: Sequence[Task], plan: Plan, engine: Engine, report: Callable[[Going], None] = lambda _going: None
) -> tuple[Row, ...]:
    """One row for each task, in their order, all with the same columns.

    A table that is finished in `plan.folder` is not fitted again, one that was interrupted is. Raises
    ResultFolderError for a folder with other files, ParameterError for two tables of one name, and as
    `Engine.unordered` does.
    """
    names = [task.name for task in tasks]
    twice = next((name for name in names if names.count(name) > 1), None) if len(set(names)) < len(names) else None
    if twice is not None:
        raise ParameterError(f"two tables have the name '{twice}'; rename one")
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
        f"the process that fitted it ended with {how}, also when it ran alone. The file makes a library crash, or "
        "needs more memory than this machine has. Check it, or leave it out"
    )
    return Done(failed_row(task.name, reason))


def _columns(rows: Sequence[Row]) -> list[str]:
    """The columns of all rows, in the order of the row with most columns, others after these."""
    most: Row = max(rows, key=len, default={})
    return list(dict.fromkeys([*HEAD, *most, *(column for row in rows for column in row)]))


def _claim(plan: Plan) -> None:
    """Mark the folder as that of a batch. Raises ResultFolderError for one that holds other things."""
    record = plan.folder / RECORD_NAME
    if record.exists():
        if read_json(record) != {"kind": KIND}:
            raise ResultFolderError(f"{record}: not written by fitball batch; name another folder")
        return
    if plan.folder.is_dir() and any(item.name != LOCK_NAME for item in plan.folder.iterdir()):
        raise ResultFolderError(f"{plan.folder}: has files other than those of a batch; name another folder")
    make_folder(plan.folder)
    write_text(record, json_text({"kind": KIND}))
