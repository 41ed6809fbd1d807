"""The road from table to fit for Python users: `calibrate` and `load_fit`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

from fitball.data.force_place import find_force
from fitball.data.read import load_table
from fitball.data.scene import Scene, load_scene
from fitball.data.table import ImpactTable
from fitball.inference.calibrate import MAX_STEPS, Effort, run
from fitball.inference.prediction.new_impacts import DRAWS, NewPrediction, predict_new
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.observables import Observable
from fitball.inference.results.results import Fit, thinned
from fitball.report.fit.folder import prepare, write_all
from fitball.report.saved.saved_fit import SavedFit, read_fit
from fitball.values import FloatArray, Impacts


@dataclass(frozen=True)
class Calibration(Fit):
    """A fit that knows how to save itself."""

    def save(self, folder: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
        """Write the result folder (see `report.folder`); refuses one that holds an older result.

        Raises ResultFolderError.
        """
        path = Path(folder)
        prepare(path, overwrite=overwrite, resume=False)
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
        found = self.posterior
        fitted = self.fitted if found is None else self.fitted.with_draws(found.names, thinned(found, DRAWS))
        return predict_new(fitted, impacts, observed, seed, incident_covariance)


def calibrate(
    table: ImpactTable | str | os.PathLike[str],
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
    force: str | os.PathLike[str] | None = None,
    seed: int = 1,
    point_only: bool = False,
    walkers: int | None = None,
    max_steps: int = MAX_STEPS,
    cores: int | None = None,
) -> Calibration:
    """Fit `model` (default: the scene's) to a table, or to the path or bundled name of one.

    The scene defaults to the TOML file beside the table. `priors` are texts such as `normal(0.55, 0.05)`, `fix`
    holds values in SI. `noise` is "normal" or "student-t"; `pool` maps parameters to the label column over whose
    levels they differ (pooled in part), `offsets` names the label column whose groups may be biased; without
    `incident_errors` the incident state counts as exact; `velocity_noise` is "tied" or "separate" (default: as the
    table can tell). `force` is a file of force-time records (see
    `data.force_file`), by default what the scene names or what lies beside the table, "none" for none. Raises
    subclasses of FitballError for everything a caller can mend.
    """
    known = scene
    if known is None:
        known = load_scene(table.source if isinstance(table, ImpactTable) else table)
    loaded = table if isinstance(table, ImpactTable) else load_table(table, scene=known)
    choices = Choices(
        model, closures or {}, priors or {}, fix or {}, noise, pool or {}, offsets, incident_errors, velocity_noise
    )
    records, found = find_force([loaded.source], loaded, known, None if force is None else os.fspath(force))
    problem = build_problem(loaded, known, choices, records)
    problem = replace(problem, notes=(*found, *problem.notes))
    effort = Effort(
        seed=seed,
        point_only=point_only,
        walkers=walkers,
        max_steps=max_steps,
        cores=(os.cpu_count() or 1) if cores is None else cores,
    )
    fit = run(problem, effort)
    return Calibration(**{item.name: getattr(fit, item.name) for item in fields(Fit)})


def load_fit(path: str | os.PathLike[str]) -> SavedFit:
    """Read a `fit.json` (or the folder that holds one). Raises ResultFolderError."""
    return read_fit(Path(path))
