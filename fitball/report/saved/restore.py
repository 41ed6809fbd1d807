"""A fit read back from its files, so far as figures need it: nothing is fitted or sampled again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.errors import FitballError, ResultFolderError
from fitball.inference.prediction.posterior_predictive import predictive, predictive_generator
from fitball.inference.problem.build import impacts_with_cor
from fitball.inference.problem.measurement_noise import noise_in
from fitball.inference.problem.observables import build_observables
from fitball.inference.problem.parameters import Parameter
from fitball.inference.problem.priors import parse_prior
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import Identifiability
from fitball.inference.results.results import Diagnostics, PointFit, Posterior, Predictive, Verdict
from fitball.report.saved.data_file import MeasuredData
from fitball.report.saved.fit_consistency import spec_of
from fitball.report.saved.fit_file import FitFile
from fitball.report.saved.saved_fit import SavedFit, read_fit
from fitball.report.saved.structure import damaged


@dataclass(frozen=True)
class Restored:
    """What figures need of a fit; see `drawable.Drawable`. `posterior` and `predictive` are None for a point fit."""

    problem: Problem
    point: PointFit
    predictive: Predictive | None
    diagnostics: Diagnostics | None
    identifiability: Identifiability
    posterior: Posterior | None


def restore(path: Path) -> Restored:
    """Read a `fit.json`, or the one in a folder, with the draws beside it.

    Raises ResultFolderError for files that are missing, damaged or foreign, and for a fit whose parameters are not
    those of its model alone.
    """
    saved = read_fit(path)
    own = [name for name in saved.parameters if spec_of(name) is None]
    if own:
        raise ResultFolderError(
            f"{saved.place}: figures of a fit with parameters of its own ({', '.join(own)[:200]}) are made by "
            "calibrate only"
        )
    measured = saved.measured()
    try:
        problem = _problem(saved, measured)
        point = _point(problem, saved)
    except FitballError as error:
        raise damaged(saved.place, str(error)) from None
    posterior = saved.posterior()
    found = None
    if posterior is not None:
        found = predictive(problem, point, posterior, predictive_generator(saved.file.seed))
    return Restored(problem, point, found, _diagnostics(saved.file), saved.file.identifiability, posterior)


def _problem(saved: SavedFit, measured: MeasuredData) -> Problem:
    fitted, data = saved.fitted, saved.file.data
    table = _table(saved.file, measured)
    noise_of = noise_in(saved.parameters)
    observables, _unused = build_observables(
        table, table.has_tangential, fitted.model.has_time, fitted.model.needs_cor, noise_of
    )
    return Problem(
        table=table,
        scene=Scene(ball=fitted.ball, contact_time=data.contact_time),
        model=fitted.model,
        parameters=tuple(_parameter(saved, name) for name in saved.parameters),
        observables=observables,
        impacts=impacts_with_cor(table, fitted.model),
        contact_time=data.contact_time,
        notes=saved.file.notes,
        force=measured.force,
        noise=fitted.noise,
    )


def _table(file: FitFile, measured: MeasuredData) -> ImpactTable:
    return ImpactTable(
        name=file.table.name,
        source=file.table.file,
        digest=file.table.sha256,
        ids=measured.ids,
        impacts=measured.impacts,
        incident_columns=file.data.incident_columns,
        incident_sd={},
        measurements=measured.measurements,
        redundant=(),
        labels=measured.labels,
        units={},
        notices=(),
    )


def _parameter(saved: SavedFit, name: str) -> Parameter:
    item, spec = saved.parameters[name], spec_of(name)
    assert spec is not None
    prior = parse_prior(name, item.prior, spec.lower, spec.upper, spec.unit)
    fixed = item.verdict is Verdict.FIXED
    return Parameter(spec, prior, item.point if fixed else None, item.reason if fixed else "")


def _point(problem: Problem, saved: SavedFit) -> PointFit:
    scores = saved.file.scores
    values = {name: item.point for name, item in saved.parameters.items()}
    return PointFit(
        values=values,
        log_posterior=scores.log_posterior,
        log_likelihood=scores.log_likelihood,
        rms=scores.rms,
        rebound=problem.rebound(np.array([[values[name] for name in problem.free_names]])),
        optima=(values,),
        optima_log_posterior=(scores.log_posterior,),
    )


def _diagnostics(file: FitFile) -> Diagnostics | None:
    found = file.diagnostics
    if found is None:
        return None
    free = {name: item for name, item in file.parameters.items() if item.verdict is not Verdict.FIXED}
    return Diagnostics(
        **msgspec.structs.asdict(found),
        ess_bulk={name: item.ess_bulk for name, item in free.items() if item.ess_bulk is not None},
        ess_tail={name: item.ess_tail for name, item in free.items() if item.ess_tail is not None},
        r_hat={name: item.r_hat for name, item in free.items() if item.r_hat is not None},
        evaluations=found.ensembles * found.steps * found.walkers,
    )
