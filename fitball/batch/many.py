"""`calibrate_many`: many tables, each fitted by itself, for a caller of Python; the verb `batch` calls the same."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.api import Fit, load_fit
from fitball.api.reading import PathLike, Table, checked_choices, flips, given
from fitball.batch.run import Going, Plan, run_tasks
from fitball.batch.tables import fault_of, tasks_of
from fitball.errors import ResultFolderError, suggestion
from fitball.inference.effort import MAX_STEPS, Effort
from fitball.inference.problem.problem import Choices
from fitball.kinds import checked
from fitball.report.batch.document import Shown, render, write_results
from fitball.report.batch.populations import Populated, default_names, populations
from fitball.report.batch.rows import CSV_NAME, DONE, FAILED, NAME, Row, check_row, read_rows
from fitball.report.batch.series import Over, all_series
from fitball.report.form.files import read_bounded
from fitball.report.form.folders import held
from fitball.report.saved.fit_file import read_fit
from fitball.scheduling.engine import engine

if TYPE_CHECKING:
    import pandas as pd

FOLDER = Path("fits") / "batch"
# A batch.csv of a hundred thousand tables has a fifth of this.
MOST_BYTES = 2**30


class Batch(Mapping[str, Fit]):
    """What was found of many tables: `batch["name"]` is the fit of one, read from its folder when asked for;
    `to_frame()` has a row a table, `failed` says why some could not be fitted.
    """

    def __init__(self, folder: Path, rows: Sequence[Row]) -> None:
        self.folder = folder
        self.rows = tuple(rows)
        self._shown: Shown | None = None

    @property
    def failed(self) -> Mapping[str, str]:
        """Why a table could not be fitted, by its name."""
        return {str(row[NAME]): str(row["reason"]) for row in self.rows if row["outcome"] == FAILED}

    def to_frame(self) -> pd.DataFrame:
        """A row a table: outcome, adequacy, labels, and each parameter's median (SI), sd, 95 % interval, verdict."""
        import pandas as pd

        return pd.DataFrame(self.rows).set_index(NAME)

    def report(self) -> str:
        """What was found, as text."""
        shown = self._shown or Shown(all_series(self.rows), ())
        return render(self.rows, shown.series, self.folder, shown.populated)

    @checked
    def summarise(
        self,
        quantities: Sequence[str] = (),
        command: str | None = None,
        over: Over = None,
    ) -> tuple[Populated, ...]:
        """Write the files of all tables anew with the populations of `quantities`, which are returned; see
        `population`.
        """
        with held(self.folder):
            self._shown = write_results(self.rows, self.folder, command, quantities, over)
        return self._shown.populated

    @checked
    def population(self, *quantities: str, over: Over = None) -> tuple[Populated, ...]:
        """Centre and spread of parameters or ratios of two (`"k_theta/k_y"`) over the tables, and each table given
        all others, from the draws that were kept: nothing is fitted.

        Tables lie on levels `over` a label that all rows of a table share (`"surface"`), over their `"folder"`, or as
        a mapping of tables to levels tells: then the spread is that between levels, beside that within them.

        Raises ParameterError for what is no quantity or too few tables have, ResultFolderError.
        """
        names = quantities or default_names(all_series(self.rows))
        return populations(self.rows, self.folder, names, over)

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
        """The rows as a notebook shows them."""
        return f"<p>{escape(repr(self)[1:-1])}</p>{self.to_frame().to_html(max_rows=20, notebook=True)}"


@checked
def load_batch(folder: PathLike = FOLDER) -> Batch:
    """The batch that lies in a folder, as `calibrate_many` or `fitball batch` left it; nothing is fitted.

    Raises ResultFolderError where none does, one that has not ended, or one whose table of all says something else
    than its fits.

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
            f"{table}: there is no such file; expected the folder of a batch that has ended: fitball batch "
            "goes on where one stopped"
        ) from None
    except (OSError, ValueError) as error:
        raise ResultFolderError(f"{table}: not the table of a batch: {error}; run fitball batch again") from None


def _rows(place: Path) -> tuple[Row, ...]:
    """The rows of a `batch.csv`, each held against the fit that it is of."""
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
def calibrate_many(
    tables: Mapping[str, Table] | Sequence[Table] | PathLike,
    model: str | None = None,
    *,
    out: PathLike = FOLDER,
    scheduler: str | None = None,
    cores: int | None = None,
    full: bool = False,
    overwrite: bool = False,
    config: PathLike | None = None,
    units: Mapping[str, str] | None = None,
    closures: Mapping[str, str] | None = None,
    priors: Mapping[str, str] | None = None,
    fix: Mapping[str, float] | None = None,
    noise: str | None = None,
    pool: Mapping[str, str] | None = None,
    offsets: str | None = None,
    incident_errors: bool = True,
    velocity_noise: str | None = None,
    flip: str | Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    as_read: bool = False,
    seed: int = 1,
    point_only: bool = False,
    walkers: int | None = None,
    max_steps: int = MAX_STEPS,
    progress: Callable[[Going], None] | None = None,
) -> Batch:
    """Fit each of many tables by itself: named ones (`{"court 3": frame}`), paths, patterns (`"courts/*.csv"`),
    folders.

    Below the folder `out` every table has one of its own with `fit.json`, or with `full` all that `calibrate` writes;
    beside them lie a table of all (CSV, Parquet where pyarrow is installed) and a page. Tables that are finished
    there are not fitted again, so the same call goes on after an interruption; those of other data or settings are
    refused unless `overwrite`. A table that cannot be fitted does not stop the others and says why. Tables run on
    `cores` processes (default: all), or on the Dask cluster whose `scheduler` is at that address; results are the
    same bytes. Each table is fitted as by `calibrate` with the same `seed`, for the other arguments see there.
    `progress` is told how far all are.

    Raises ParameterError, ResultFolderError; KeyboardInterrupt when it is interrupted.

    >>> tables = {"still air": "wang_zero_spin", "no table": {"v_1": [17.0]}}
    >>> many = folder.parent / "many"
    >>> batch = fitball.calibrate_many(tables, "grip-slip", out=many, point_only=True, cores=1)
    >>> batch.to_frame()["outcome"].tolist()
    ['done', 'failed']
    """
    choices = Choices(
        model,
        given(closures),
        given(priors),
        given(fix),
        noise,
        given(pool),
        offsets,
        incident_errors,
        velocity_noise,
    )
    checked_choices(choices)
    effort = Effort(seed=seed, point_only=point_only, walkers=walkers, max_steps=max_steps, cores=1)
    scene = None if config is None else os.fspath(config)
    plan = Plan(Path(out), choices, effort, scene, flips(flip), columns or {}, units or {}, as_read, full, overwrite)
    return batch_of(tables, plan, cores, scheduler, (lambda _going: None) if progress is None else progress)


def batch_of(
    tables: Mapping[str, Table] | Sequence[Table] | PathLike,
    plan: Plan,
    cores: int | None,
    scheduler: str | None,
    report: Callable[[Going], None],
    command: str | None = None,
) -> Batch:
    """The same for a plan; `command` is the line that asked for it."""
    workers = engine(cores, scheduler)
    tasks = tasks_of(tables, plan.folder)
    with held(plan.folder):
        batch = Batch(plan.folder, run_tasks(tasks, plan, workers, report))
        batch._shown = write_results(batch.rows, plan.folder, command, (), None)
    return batch
