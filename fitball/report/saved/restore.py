"""A fit read back from all its files: nothing is fitted or sampled again."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fitball.data.balances import scene_balances
from fitball.errors import FitballError, ResultFolderError
from fitball.inference.likelihood.posterior import log_likelihood
from fitball.inference.prediction.posterior_predictive import predictive, predictive_generator
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import (
    Diagnostics,
    ErrorBudget,
    Fit,
    LeastSquares,
    PointFit,
    Posterior,
    Verdict,
)
from fitball.report.saved.fit_consistency import beyond
from fitball.report.saved.fit_file import LeastSquaresPart, Matrix
from fitball.report.saved.run_file import RUN_NAME
from fitball.report.saved.run_record import RunRecord, read_run
from fitball.report.saved.saved_fit import FIT_NAME, POSTERIOR_NAME, SavedFit, read_fit
from fitball.report.saved.structure import damaged
from fitball.values import FloatArray

# By what share the log likelihood of the point estimate may differ on another machine.
ROUNDING = 1e-6


def restore(path: Path) -> Fit:
    """Read a `fit.json`, or the one in a folder, with the run, the measurements and the draws beside it; the table
    that was fitted need not be there any more.

    Raises ResultFolderError for files that are missing, damaged or foreign, or of different runs.
    """
    return restored(read_fit(path))


def restored(saved: SavedFit) -> Fit:
    """The fit that was saved, from the files beside its `fit.json`; of its search only the outcome is kept.

    Raises ResultFolderError as `restore` does.
    """
    file, fitted = saved.file, saved.fitted
    record = read_run(saved.beside(RUN_NAME))
    table, force = saved.measured()
    table = replace(table, files=tuple((str(record.place_of(named)), named.sha256) for named in record.tables))
    if force is not None and record.force is not None:
        force = replace(force, source=str(record.place_of(record.force)))
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
        found = predictive(problem, point, posterior, predictive_generator(file.seed))
    own: dict[str, Any] = {
        "problem": problem,
        "balances": scene_balances(table, problem.scene),
        "least_squares": _least_squares(file.scores.least_squares),
        "point": point,
        "posterior": posterior,
        "estimates": tuple(saved.parameters.values()),
        "derived": saved.derived,
        "covariance": _array(file.covariance),
        "correlation": _array(file.correlation),
        "diagnostics": _diagnostics(saved, record),
        "predictive": found,
        "fitted": fitted,
        "golden": saved.golden,
        "error_budget": ErrorBudget(file.error_budget.impacts, file.error_budget.reference, file.error_budget.lines),
        "timings": (),
    }
    # All else is in the file as it was found.
    return Fit(**own, **{item.name: getattr(file, item.name) for item in fields(Fit) if item.name not in own})


def _array(matrix: Matrix | None) -> FloatArray | None:
    return None if matrix is None else np.array(matrix.values)


def _least_squares(part: LeastSquaresPart) -> LeastSquares:
    known = {name: getattr(part, name) for name in ("values", "stderr", "chi_square", "degrees_of_freedom", "rms")}
    return LeastSquares(
        **known, missing=part.stderr_missing, starts=0, optima=(), optima_chi_square=(), evaluations=0
    )


def _diagnostics(saved: SavedFit, record: RunRecord) -> Diagnostics | None:
    part = saved.file.diagnostics
    if part is None:
        return None
    known: dict[str, Any] = msgspec.structs.asdict(part)
    for look in ("ess_bulk", "ess_tail", "r_hat"):
        known[look] = {name: getattr(saved.parameters[name], look) for name in saved.free_names}
    return Diagnostics(**known, evaluations=part.ensembles * part.steps * part.walkers, target_ess=record.effort.ess)


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
            raise damaged(saved.beside(FIT_NAME), f"parameters.{item.name}.point: outside its bounds")
        if posterior is not None and beyond(item.spec, posterior.values[..., k]):
            raise damaged(saved.beside(POSTERIOR_NAME), f"draws of {item.name} lie outside its bounds")


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
