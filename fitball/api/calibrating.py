"""The road from table to fit: `calibrate` and `load_fit`, and its steps for the command line."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from fitball.api.fit import Fit
from fitball.api.progress import Report, Wanted, reporting, silent
from fitball.api.reading import PathLike, Reading, Table, checked_choices, given, read
from fitball.data.force import find_force
from fitball.data.scene import Scene
from fitball.inference.calibrate import fingerprint, run
from fitball.inference.effort import MAX_STEPS, Effort
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.force_records import build_records
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.chain_file import ChainFile
from fitball.kinds import checked
from fitball.report.fit.folder import CHAIN_NAME, prepare_folder

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class Run:
    """A calibration that may begin: `chain` is where its walkers are kept (None: nowhere), `resumes` whether it goes
    on with those.
    """

    problem: Problem
    effort: Effort
    chain: ChainFile | None = None
    resumes: bool = False

    def fit(self, report: Report = silent) -> Fit:
        """Fit. Raises as `inference.calibrate.run` does, on Ctrl-C with the chain kept."""
        return Fit.of(run(self.problem, self.effort, self.chain, self.resumes, report, assumptions=True))


def pose(
    data: Table | Sequence[Table], choices: Choices, force: PathLike | None = None, **reading: Unpack[Reading]
) -> Problem:
    """The problem of a table, or of tables that are fitted together.

    For `force` and `reading` see `calibrate`. Raises as reading, `trusted_table` and `build_problem` do.
    """
    checked_choices(choices)
    table, known, doubts, files = read(data, **reading)
    records, said = find_force(files, table, known, None if force is None else os.fspath(force))
    averaged = None if records is None else build_records(records, known.force_start_sd)
    problem = build_problem(table, known, choices, averaged)
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


@checked
def calibrate(
    table: Table | Sequence[Table],
    model: str | None = None,
    *,
    scene: Scene | None = None,
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
    force: PathLike | None = None,
    flip: str | Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    as_read: bool = False,
    seed: int = 1,
    point_only: bool = False,
    walkers: int | None = None,
    max_steps: int = MAX_STEPS,
    cores: int | None = None,
    progress: Wanted = None,
) -> Fit:
    """Fit `model` (default: the scene's) to a table: a data frame, a path or bundled name, an `ImpactTable`, or to
    several of them together.

    Columns are named as in files (`v_1 [mph]`); those that state no unit are in m/s, rad/s, degrees and s unless
    `units` says otherwise (`{"v_1": "mph"}`); `columns` gives names that are not ours by our name
    (`{"v_1": "Vin [mph]"}`). The scene is `scene`, or the file `config`, or the TOML file beside the
    table. `priors` are texts such as `normal(0.55, 0.05)`, `fix` holds values in SI. `noise` is "normal" or
    "student-t"; `pool` maps parameters to the label column over whose levels they differ (pooled in part), `offsets`
    names the label column whose groups may be biased; without `incident_errors` the incident state counts as exact;
    `velocity_noise` is "tied" or "separate" (default: as the table can tell). `force` is a file of force-time records
    (see `data.force`), by default what the scene names or what lies beside the table, "none" for none. `flip`
    names columns that count the other way round than fitball does: spins and velocities of the other sign, angles
    measured from the normal (`TABLE:COLUMN` for one of several tables). A table that another reading explains much
    better, and a scene that is unlike any ball's, are refused unless `as_read`.

    `point_only` leaves out the posterior. `progress` is True, False, a function that is told stage and progress, or
    None: a bar in a notebook or terminal. The same seed gives the same fit. Raises subclasses of FitballError for
    everything a caller can mend, KeyboardInterrupt when it is interrupted.

    >>> fit = fitball.calibrate("wang_zero_spin.csv", model="grip-slip", point_only=True)
    >>> round(fit.parameters["mu"].point, 2)
    0.56
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
    threads = (os.cpu_count() or 1) if cores is None else cores
    effort = Effort(seed=seed, point_only=point_only, walkers=walkers, max_steps=max_steps, cores=threads)
    asked = pose(
        table, choices, force, scene=scene, config=config, flip=flip, columns=columns, as_read=as_read, units=units
    )
    with reporting(progress) as report:
        return Run(asked, effort).fit(report)
