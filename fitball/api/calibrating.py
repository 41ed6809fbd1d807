"""From a table to a fit, `calibrate`, with its steps for the command line; and to compared models, `compare`."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from fitball.api.fit import Fit
from fitball.api.own_model import AnyModel, named_model
from fitball.api.reading import (
    DEFAULTS,
    Fitting,
    PathLike,
    Reading,
    Report,
    Table,
    Wanted,
    choices_of,
    effort_of,
    read,
    reading_of,
    reporting,
    silent,
)
from fitball.data.force import find_force
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.calibrate import fingerprint, run
from fitball.inference.comparison import results
from fitball.inference.comparison.candidates import Candidates, build_candidates, default_names
from fitball.inference.comparison.compare import ESS, MAX_STEPS
from fitball.inference.comparison.compare import compare as run_comparison
from fitball.inference.effort import Effort
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.force_records import build_records
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import RunStatus
from fitball.inference.sampling.chain_file import ChainFile
from fitball.kinds import checked, spelled
from fitball.report.compare.document import render, words
from fitball.report.compare.rows import csv_rows, json_content
from fitball.report.fit.folder import CHAIN_NAME, prepare_folder
from fitball.report.form.document import columns as aligned
from fitball.report.form.folders import clear_folder, held
from fitball.scheduling.engine import Engine, engine

if TYPE_CHECKING:
    import pandas as pd

    from fitball.report.figures.canvas import Figure


@dataclass(frozen=True)
class Run:
    """A calibration before it starts: `chain` is the file of its walkers (None: not saved), `resumes` whether it
    continues with the walkers there.
    """

    problem: Problem
    effort: Effort
    chain: ChainFile | None = None
    resumes: bool = False

    def fit(self, report: Report = silent) -> Fit:
        """Fit. Raises as `inference.calibrate.run` does, on Ctrl-C with the chain kept."""
        return Fit.from_results(run(self.problem, self.effort, self.chain, self.resumes, report, assumptions=True))


def pose(
    data: Table | Sequence[Table],
    choices: Choices,
    force: PathLike | None = None,
    scene: Scene | None = None,
    **reading: Unpack[Reading],
) -> Problem:
    """The problem of a table, or of tables that are fitted together.

    For `force`, `scene` and `reading` see `calibrate`. Raises as reading, `trusted_table` and `build_problem` do.
    """
    table, known, doubts, files = read(data, scene, **reading)
    records, found = find_force(files, table, known, None if force is None else os.fspath(force))
    averaged = None if records is None else build_records(records, known.force_start_sd)
    problem = build_problem(table, known, choices, averaged)
    return replace(problem, notes=(*doubts, *found, *problem.notes))


def begin(problem: Problem, effort: Effort, folder: Path, *, overwrite: bool = False, resume: bool = False) -> Run:
    """A run whose chain is saved in a result folder, which is created. With `resume` it continues with the chain
    there, if there is one.

    Raises ParameterError before any file is changed, ResultFolderError as `folder.prepare_folder` does.
    """
    mark = fingerprint(problem, effort)
    prepare_folder(folder, overwrite=overwrite, resume=resume)
    chain = None if effort.point_only else ChainFile(folder / CHAIN_NAME, mark)
    return Run(problem, effort, chain, resume and chain is not None and chain.path.exists())


@checked
@spelled(Fitting, DEFAULTS)
def calibrate(
    table: Table | Sequence[Table],
    model: AnyModel | None = None,
    *,
    scene: Scene | None = None,
    force: PathLike | None = None,
    cores: int | None = None,
    progress: Wanted = None,
    **options: Unpack[Fitting],
) -> Fit:
    """Fit `model` (default: the scene's) to a table: a data frame, a path or bundled name, or an `ImpactTable`.
    Several tables are fitted together.

    Table. Columns are named as in files (`v_1 [mph]`). Columns without a unit are in m/s, rad/s, degrees and s, or in
    the unit that `units` gives (`{"v_1": "mph"}`). `columns` maps fitball's names to those of the table (`{"v_1":
    "Vin [mph]"}`). `flip` lists columns with the opposite convention (`TABLE:COLUMN` for one of several tables). The
    sign of spins and velocities is reversed; angles are taken from the normal. `ignore` lists rebound columns that
    are left out. `covariance` are errors that belong together: a path, `{id: {(column, column): value}}` or an array
    (see `load_table`); default: the file `NAME_covariance.csv` beside the table; "none" for none. The scene is
    `scene`, or the file `config`, or the TOML file beside the table. `force` is a file of force-time records (see
    `data.force`); default: the one that the scene names, or the one beside the table; "none" for none. A table is
    refused if another reading fits much better, or if the ball is unlike any game ball, unless `as_read`.

    Model. `model` is a name, or a model of `model_from`. `closures` replace model assumptions, `priors` are texts
    such as `normal(0.55, 0.05)`, `fix` holds parameters at values in SI. `pool` maps parameters to the label column
    to whose levels they are fitted, with partial pooling. By default mu and cor_10 are fitted to each surface, mu
    to each place, cor_10 and the offset to each ball, where a column names several. "none" fits one value to all.

    Noise. `noise` is a distribution, "normal" (default) or "student-t", or a structure, or both:
    `"student-t,separate"`. With "tied" all columns of the rebound velocity share one noise, with "separate" each has
    its own (default: "separate" if the table has enough rows). Where the table states sds these are the scatter
    beyond stated errors; with "stated" there is none. `offsets` names the label column whose groups may have
    a measurement bias. Without `incident_errors` the incident state is exact. `velocity_noise` is an older name for
    the second part of `noise`.

    Sampling. With `point_only` there is no posterior. `progress` is True, False, a function of stage and progress, or
    None: a bar in a notebook or terminal. The same seed gives the same fit. Raises subclasses of FitballError for
    mistakes of the caller, KeyboardInterrupt when it is interrupted.

    >>> fit = fitball.calibrate("wang_zero_spin.csv", model="grip-slip", point_only=True)
    >>> round(fit.parameters["mu"].point, 2)
    0.56
    """
    effort = effort_of(options, (os.cpu_count() or 1) if cores is None else cores)
    problem = pose(table, choices_of(model, options), force, scene, **reading_of(options))
    with reporting(progress) as report:
        return Run(problem, effort).fit(report)


class Comparison:
    """The result of `compare`: a recommendation, and models with the best first. Each has its fit
    (`comparison["two-mass"]`) and its scores on impacts that were left out.
    """

    def __init__(self, result: results.Comparison) -> None:
        self.result = result

    @cached_property
    def words(self) -> str:
        """The recommendation."""
        return words(self.result)

    @property
    def status(self) -> RunStatus:
        """Converged when every fit is."""
        return self.result.status

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the comparison."""
        return self.result.notes

    @property
    def names(self) -> tuple[str, ...]:
        """The models, best first."""
        return tuple(self.result.by_name)

    def __getitem__(self, name: str) -> Fit:
        """The fit of a model."""
        return Fit.from_results(self.result.by_name[name].fit)

    def __repr__(self) -> str:
        head = f"<Comparison of {len(self.names)} models on {self.result.table.name}: {self.status}>"
        gaps = [self.result.elpd_difference(name, self.names[0]) for name in self.names]
        rows = [["", "elpd difference", "stacking"]] + [
            [name, f"{gap.value:.1f} ± {gap.se:.1f}", f"{self.result.stacking[name]:.2f}"]
            for name, gap in zip(self.names, gaps, strict=True)
        ]
        return "\n".join([head, *(f"  {line}" for line in aligned(rows))])

    def _repr_html_(self) -> str:
        """The summary, for a notebook."""
        return f"<p>{self.words}</p>{self.summary().to_html(notebook=True)}"

    def summary(self) -> pd.DataFrame:
        """One row for each model, best first: scores, weights, criteria and errors on impacts left out, in SI."""
        import pandas as pd

        return pd.DataFrame(csv_rows(self.result)).set_index("model")

    @property
    def exit_code(self) -> int:
        """0 if every fit converged, 130 if it was interrupted, else 1."""
        return {RunStatus.CONVERGED: 0, RunStatus.INTERRUPTED: 130}.get(self.status, 1)

    @checked
    def report(self, folder: Path | None = None) -> str:
        """The comparison as text, with the `folder` that it was saved in."""
        return render(self.result, "" if folder is None else str(folder))

    def json(self) -> Mapping[str, object]:
        """The content of `compare.json`."""
        return json_content(self.result, self.words)

    def plot(self) -> Figure:
        """Scores and errors of the models, as a matplotlib Figure that is not registered with pyplot."""
        from fitball.report.compare.figures import compare_figure

        return compare_figure(self.result)

    @checked
    def save(self, folder: PathLike, *, overwrite: bool = False) -> Path:
        """Write `compare.json`, tables and figures. Raises ResultFolderError."""
        from fitball.report.compare.document import JSON_NAME, write_all

        path = Path(folder)
        with held(path):
            clear_folder(path, JSON_NAME, overwrite=overwrite)
            write_all(self.result, path)
        return path

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Comparison):
            return NotImplemented
        timeless = [{key: value for key, value in item.json().items() if key != "seconds"} for item in (self, other)]
        return timeless[0] == timeless[1]

    def __hash__(self) -> int:
        return hash((self.names, self.result.seed, self.result.table.digest))


@dataclass(frozen=True)
class Contest:
    """A comparison before it starts, with notes to print first."""

    table: ImpactTable
    candidates: Candidates
    effort: Effort
    engine: Engine
    quick: bool
    notes: tuple[str, ...]

    def compare(self, report: Callable[[str], None] = lambda _stage: None) -> Comparison:
        """Fit and score every model. Raises as `inference.comparison.compare` does."""
        return Comparison(run_comparison(self.table, self.candidates, self.effort, self.engine, self.quick, report))


def contest(
    data: Table | Sequence[Table],
    models: AnyModel | Sequence[AnyModel] | None,
    *,
    quick: bool,
    seed: int,
    max_steps: int | None,
    cores: int | None,
    scheduler: str | None,
    scene: Scene | None = None,
    **reading: Unpack[Reading],
) -> Contest:
    """A comparison of models on a table, see `compare`. Raises ParameterError before anything is fitted."""
    table, known, doubts, _files = read(data, scene, **reading)
    workers = engine(cores, scheduler)
    effort = Effort(seed=seed, max_steps=MAX_STEPS if max_steps is None else max_steps, cores=1, ess=ESS)
    if models is None:
        names, skipped = default_names(table, quick)
    else:
        named = models if isinstance(models, Sequence) and not isinstance(models, str) else (models,)
        names, skipped = tuple(map(named_model, named)), []
    candidates = build_candidates(table, known, names)
    for candidate in candidates.candidates:
        effort.settings(candidate.problem)
    candidates = replace(candidates, notes=(*doubts, *candidates.notes))
    return Contest(table, candidates, effort, workers, quick, (*skipped, *doubts, *table.remarks, *known.assumed))


@checked
@spelled(Reading, DEFAULTS)
def compare(
    data: Table | Sequence[Table],
    models: Sequence[AnyModel] | None = None,
    *,
    scene: Scene | None = None,
    quick: bool = False,
    seed: int = 1,
    max_steps: int | None = None,
    cores: int | None = None,
    scheduler: str | None = None,
    progress: Wanted = None,
    **reading: Unpack[Reading],
) -> Comparison:
    """Compare models on a table by predictions of impacts left out, as the verb `compare` does.

    `models` are names such as `two-mass+torsion=free`, or models of `model_from` (default: all that can differ on
    this table, with `quick` the main ones). For the table and its options (`scene`, `units`, `flip`, ...) see
    `calibrate`.
    `cores` models are fitted at once (default: all cores), each in its own process, or on the workers of a Dask
    cluster (address `scheduler`). The results do not depend on this. Raises subclasses of FitballError.

    >>> fitball.compare("wang_zero_spin", ["brody"], cores=1)
    Traceback (most recent call last):
    ...
    fitball.errors.FitError: a comparison needs at least two different models, read 1: name more (models)
    """
    asked = contest(
        data, models, quick=quick, seed=seed, max_steps=max_steps, cores=cores, scheduler=scheduler, scene=scene,
        **reading,
    )  # fmt: skip
    with reporting(progress) as report:
        return asked.compare(lambda stage: report(stage, None))
