"""The road from table to fit: `calibrate` and `load_fit` for Python users, and its steps for the command line."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Union

from fitball.data.force_place import find_force
from fitball.data.scene import Scene, likely_scene, load_scene
from fitball.data.table import ImpactTable
from fitball.data.trusted import trusted_table
from fitball.data.written import PATHS
from fitball.inference.calibrate import fingerprint, run
from fitball.inference.effort import MAX_STEPS, Effort
from fitball.inference.prediction.new_impacts import NewPrediction, predict_new
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.force_records import build_records
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Fit
from fitball.inference.sampling.chain_file import ChainFile
from fitball.inference.sampling.ensembles import Progress
from fitball.report.fit.folder import CHAIN_NAME, prepare_folder, write_all
from fitball.report.saved.saved_fit import SavedFit, read_fit
from fitball.values import FloatArray, Impacts

if TYPE_CHECKING:
    import pandas

PathLike = str | os.PathLike[str]
Source = Union[PathLike, "pandas.DataFrame"]
# Is told the stage of a run and, while sampling, the progress.
Report = Callable[[str, Progress | None], None]


@dataclass(frozen=True)
class Calibration(Fit):
    """A fit that knows how to save itself."""

    def save(self, folder: PathLike, *, overwrite: bool = False) -> Path:
        """Write the result folder (see `report.folder`); refuses one that holds an older result.

        Raises ResultFolderError.
        """
        path = Path(folder)
        prepare_folder(path, overwrite=overwrite, resume=False)
        write_all(self, path)
        return path

    def predict_interval(
        self,
        impacts: Impacts,
        observed: Sequence[Observable] = (),
        *,
        seed: int = 1,
        incident_covariance: FloatArray | None = None,
    ) -> NewPrediction:
        """See `new_impacts.predict_new`: the same numbers as from the fit when it is saved and read back."""
        return predict_new(self.predicting, impacts, observed, seed, incident_covariance)


@dataclass(frozen=True)
class Run:
    """A calibration that may begin: `chain` is where its walkers are kept (None: nowhere), `resumes` whether it goes
    on with those.
    """

    problem: Problem
    effort: Effort
    chain: ChainFile | None = None
    resumes: bool = False

    def fit(self, report: Report = lambda _stage, _progress: None) -> Calibration:
        """Fit. Raises as `inference.calibrate.run` does, on Ctrl-C with the chain kept."""
        fit = run(self.problem, self.effort, self.chain, self.resumes, report, assumptions=True)
        return Calibration(**{field.name: getattr(fit, field.name) for field in fields(Fit)})


def pose(
    data: ImpactTable | Source | Sequence[Source],
    choices: Choices,
    *,
    scene: Scene | None = None,
    config: PathLike | None = None,
    force: PathLike | None = None,
    flip: Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    as_read: bool = False,
) -> Problem:
    """The problem of a table, or of paths, bundled names and DataFrames of tables that are fitted together.

    The scene is `scene`, or the file `config`, or the TOML file beside the first table (a DataFrame has none); for
    `force`, `flip`, `columns` and `as_read` see `calibrate`. Raises as reading, `trusted_table` and `build_problem`
    do.
    """
    sources: Sequence[Source]
    if isinstance(data, ImpactTable):
        # Of a DataFrame there is no file.
        sources = [data.source] if data.files else []
    else:
        sources = data if isinstance(data, Sequence) and not isinstance(data, str) else [data]
    paths = [source if isinstance(source, PATHS) else None for source in sources] or [None]
    known = load_scene(paths[0], config, as_read) if scene is None else likely_scene(scene, as_read)
    table, doubts = trusted_table(data if isinstance(data, ImpactTable) else sources, known, flip, as_read, columns)
    named = None if force is None else os.fspath(force)
    records, said = find_force([os.fspath(path) for path in paths if path is not None], table, known, named)
    averaged = None if records is None else build_records(records, known.force_start_sd)
    problem = build_problem(table, known, choices, averaged)
    if len(sources) > 1 and scene is None and known.source is not None:
        said = (f"the scene of {config or paths[0]} is taken for all tables", *said)
    return replace(problem, notes=(*doubts, *said, *problem.notes))


def begin(problem: Problem, effort: Effort, folder: Path, *, overwrite: bool = False, resume: bool = False) -> Run:
    """A run whose chain is kept in a result folder, which is made. With `resume` it goes on with the chain there, if
    there is one.

    Raises ParameterError before anything is touched, ResultFolderError as `folder.prepare_folder` does.
    """
    mark = fingerprint(problem, effort)
    prepare_folder(folder, overwrite=overwrite, resume=resume)
    chain = None if effort.point_only else ChainFile(folder / CHAIN_NAME, mark)
    return Run(problem, effort, chain, resume and chain is not None and chain.path.exists())


def calibrate(
    table: ImpactTable | Source | Sequence[Source],
    model: str | None = None,
    *,
    scene: Scene | None = None,
    closures: Mapping[str, str] | None = None,
    priors: Mapping[str, str] | None = None,
    fix: Mapping[str, float] | None = None,
    noise: str | None = None,
    pool: Mapping[str, str] | None = None,
    offsets: str | None = None,
    incident_errors: bool = True,
    velocity_noise: str | None = None,
    force: PathLike | None = None,
    flip: Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    as_read: bool = False,
    seed: int = 1,
    point_only: bool = False,
    walkers: int | None = None,
    max_steps: int = MAX_STEPS,
    cores: int | None = None,
) -> Calibration:
    """Fit `model` (default: the scene's) to a table, to the path or bundled name of one, or to several together.

    The scene defaults to the TOML file beside the table. `priors` are texts such as `normal(0.55, 0.05)`, `fix`
    holds values in SI. `noise` is "normal" or "student-t"; `pool` maps parameters to the label column over whose
    levels they differ (pooled in part), `offsets` names the label column whose groups may be biased; without
    `incident_errors` the incident state counts as exact; `velocity_noise` is "tied" or "separate" (default: as the
    table can tell). `force` is a file of force-time records (see
    `data.force_file`), by default what the scene names or what lies beside the table, "none" for none. `flip` names
    columns that count the other way round than fitball does: spins and velocities of the other sign, angles measured
    from the normal (`TABLE:COLUMN` for one of several tables). `columns` gives names that are not ours by our name,
    such as `{"v_1": "Vin [mph]"}`. A table that another reading explains much better, and
    a scene that is unlike any ball's, are refused unless `as_read`. Raises subclasses of FitballError for everything
    a caller can mend.
    """
    choices = Choices(
        model, closures or {}, priors or {}, fix or {}, noise, pool or {}, offsets, incident_errors, velocity_noise
    )
    effort = Effort(
        seed=seed,
        point_only=point_only,
        walkers=walkers,
        max_steps=max_steps,
        cores=(os.cpu_count() or 1) if cores is None else cores,
    )
    return Run(
        pose(table, choices, scene=scene, force=force, flip=flip, columns=columns, as_read=as_read), effort
    ).fit()


def load_fit(path: PathLike) -> SavedFit:
    """Read a `fit.json` (or the folder that holds one). Raises ResultFolderError."""
    return read_fit(Path(path))
