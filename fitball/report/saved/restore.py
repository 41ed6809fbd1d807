"""A fit read back from its files, so far as figures need it: nothing is fitted or sampled again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitball.errors import FitballError, ResultFolderError
from fitball.inference.likelihood.posterior import log_likelihood
from fitball.inference.prediction.posterior_predictive import predictive, predictive_generator
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import Identifiability
from fitball.inference.results.results import PointFit, Posterior, Predictive, Verdict
from fitball.report.saved.fit_consistency import beyond
from fitball.report.saved.fit_file import DiagnosticsPart
from fitball.report.saved.run_file import RUN_NAME
from fitball.report.saved.run_record import RunRecord, read_run
from fitball.report.saved.saved_fit import POSTERIOR_NAME, SavedFit, read_fit
from fitball.report.saved.structure import damaged

# By what share the log likelihood of the point estimate may differ on another machine.
ROUNDING = 1e-6


@dataclass(frozen=True)
class Restored:
    """What figures need of a fit; see `drawable.Drawable`. `posterior` and `predictive` are None for a point fit."""

    problem: Problem
    point: PointFit
    predictive: Predictive | None
    diagnostics: DiagnosticsPart | None
    identifiability: Identifiability
    posterior: Posterior | None


def restore(path: Path) -> Restored:
    """Read a `fit.json`, or the one in a folder, with the run, the measurements and the draws beside it; the table
    that was fitted need not be there any more.

    Raises ResultFolderError for files that are missing, damaged or foreign, or of different runs.
    """
    saved = read_fit(path)
    record = read_run(saved.place.with_name(RUN_NAME))
    table, force = saved.measured()
    try:
        problem = record.problem(table, force)
    except FitballError as error:
        raise damaged(record.place, str(error)) from None
    _refuse_other(saved, record, problem)
    posterior = saved.posterior()
    _refuse_beyond(saved, problem, posterior)
    point = _point(problem, saved, record)
    found = None
    if posterior is not None:
        found = predictive(problem, point, posterior, predictive_generator(saved.file.seed))
    return Restored(problem, point, found, saved.file.diagnostics, saved.file.identifiability, posterior)


def _refuse_other(saved: SavedFit, record: RunRecord, problem: Problem) -> None:
    """Raise ResultFolderError unless `run.toml` and `fit.json` speak of the same model and parameters."""
    file, fitted, chosen = saved.file, saved.fitted, problem.model
    described = {item.name: (item.prior.text, item.fixed) for item in problem.parameters}
    kept = {
        name: (item.prior, item.point if item.verdict is Verdict.FIXED else None)
        for name, item in saved.parameters.items()
    }
    pairs = [
        (record.effort.seed, file.seed),
        ((chosen.name, dict(chosen.options), chosen.ball), (fitted.model_name, dict(fitted.options), fitted.ball)),
        (problem.contact_time, file.data.contact_time),
        (list(described.items()), list(kept.items())),
    ]
    if any(one != other for one, other in pairs):
        raise _other(record)


def _refuse_beyond(saved: SavedFit, problem: Problem, posterior: Posterior | None) -> None:
    """Raise ResultFolderError for values beyond bounds that only the problem knows: of levels and group biases."""
    for k, item in enumerate(problem.free):
        if beyond(item.spec, np.array(saved.parameters[item.name].point)):
            raise damaged(saved.place, f"parameters.{item.name}.point: outside its bounds")
        if posterior is not None and beyond(item.spec, posterior.values[..., k]):
            raise damaged(saved.place.with_name(POSTERIOR_NAME), f"draws of {item.name} lie outside its bounds")


def _other(record: RunRecord) -> ResultFolderError:
    return ResultFolderError(
        f"{record.place}: this run is another than that of the fit.json beside it; calibrate again, or put the files "
        "of one run together"
    )


def _point(problem: Problem, saved: SavedFit, record: RunRecord) -> PointFit:
    """The point estimate of `fit.json`, whose likelihood under `problem` must be the one that is noted there."""
    scores = saved.file.scores
    values = {name: item.point for name, item in saved.parameters.items()}
    row = np.array([[values[name] for name in problem.free_names]])
    rebound = problem.rebound(row)
    again = float(log_likelihood(problem, row, rebound)[0])
    if not abs(again - scores.log_likelihood) <= ROUNDING * (1.0 + abs(scores.log_likelihood)):
        raise _other(record)
    return PointFit(
        values=values,
        log_posterior=scores.log_posterior,
        log_likelihood=scores.log_likelihood,
        rms=scores.rms,
        rebound=rebound,
        optima=(values,),
        optima_log_posterior=(scores.log_posterior,),
    )
