"""`fit.json`: the record of a fit, written and read as the types that it has in memory; what lies in the files beside
it is read when it is asked for. Nothing is fitted or sampled again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import msgspec
import numpy as np

from fitball.data.balances import Balances, scene_balances
from fitball.data.table import ImpactTable
from fitball.errors import FitballError, ResultFolderError
from fitball.inference.likelihood.posterior import log_likelihood
from fitball.inference.prediction.posterior_predictive import predictive, predictive_generator
from fitball.inference.problem.force_records import ForceRecords
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import (
    BESIDE,
    KIND,
    SCHEMA_VERSION,
    Fit,
    PointFit,
    Posterior,
    Predictive,
    Record,
    Verdict,
    thinned,
)
from fitball.report.form.files import json_text
from fitball.report.saved.fit_consistency import beyond, checked, outside
from fitball.report.saved.netcdf_files import DATA_NAME, POSTERIOR_NAME, read_data, read_draws
from fitball.report.saved.run_file import RUN_NAME, RunRecord, read_run
from fitball.report.saved.structure import (
    FIT_NAME,
    damaged,
    place_of,
    plain,
    read_json,
    refuse_foreign,
    structured,
)

# By what share the log likelihood of the point estimate may differ on another machine.
ROUNDING = 1e-6


def fit_text(fit: Fit) -> str:
    """`fit.json` as text, all numbers in SI at full precision."""
    return json_text({item.name: plain(getattr(fit, item.name)) for item in fields(Record)})


def fit_schema() -> dict[str, Any]:
    """The structure as JSON Schema; `fit.schema.json` of the package is made from it."""
    made = msgspec.json.schema(Record, schema_hook=_array_schema)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": KIND, **made}


def _array_schema(kind: type) -> dict[str, Any]:
    if getattr(kind, "__origin__", kind) is not np.ndarray:
        raise TypeError(f"a field of fit.json is of type {kind!r}, which JSON Schema does not know")
    whole = get_args(kind) and np.issubdtype(get_args(get_args(kind)[1])[0], np.integer)
    numbers = {"type": "integer" if whole else ["number", "null"]}
    return {"type": "array", "items": {"anyOf": [numbers, {"type": "array", "items": numbers}]}}


def read_fit(path: Path) -> Fit:
    """Read `fit.json`, or the one in a folder.

    Raises ResultFolderError for a missing, damaged or foreign file and for another schema version.
    """
    place = place_of(path, FIT_NAME)
    content = read_json(place)
    refuse_foreign(place, content, KIND, SCHEMA_VERSION)
    record = structured(place, content, Record)
    wrong = checked(record)
    if wrong is not None:
        raise damaged(place, wrong)
    return _with_files(record, place)


def _with_files(record: Record, place: Path) -> Fit:
    """A fit of which only the record is in memory."""
    fitted = record.fitted
    if not len(fitted.draws):
        fitted = replace(fitted, draws=np.empty((0, len(fitted.names))))
    fit = Fit.__new__(Fit)
    fit.__dict__.update(vars(record), fitted=fitted, place=place, later=_later)
    return fit


def restore(path: Path) -> Fit:
    """Read a fit as `read_fit`, with the run, the measurements and the draws beside it at once; the table that was
    fitted need not be there any more.

    Raises ResultFolderError for files that are missing, damaged or foreign, or of different runs.
    """
    fit = read_fit(path)
    load(fit)
    return fit


def load(fit: Fit) -> None:
    """Read what lies beside a fit, unless it is in memory. Raises ResultFolderError as `restore` does."""
    for name in BESIDE:
        getattr(fit, name)


def complete(fit: Fit) -> bool:
    """Whether all that a fit is restored from is in memory, or lies in files beside it."""
    needed = [DATA_NAME, RUN_NAME, *([] if fit.diagnostics is None else [POSTERIOR_NAME])]
    in_memory = all(name in vars(fit) for name in BESIDE)
    return in_memory or (fit.place is not None and all(fit.place.with_name(name).exists() for name in needed))


def _later(fit: Fit, name: str) -> object:
    """What the files beside the `fit.json` of a fit say; `name` is one of BESIDE. Raises ResultFolderError."""
    assert fit.place is not None
    makers: Mapping[str, Callable[[Fit, Path], object]] = {
        "posterior": partial(read_posterior, agreeing=True),
        "problem": _problem,
        "balances": _balances,
        "point": _point,
        "predictive": _predictive,
    }
    return makers[name](fit, fit.place)


def read_posterior(fit: Fit, place: Path, *, agreeing: bool) -> Posterior | None:
    """All draws, from `posterior.nc` beside the `fit.json` at `place`; None for a point fit.

    `fit.json` holds some of the same draws: unless they are equal to the last digit the two files belong to
    different runs, which is refused if the draws must be `agreeing`. Raises ResultFolderError for that, and for a
    file that is missing, damaged or foreign.
    """
    diagnostics, beside = fit.diagnostics, place.with_name(POSTERIOR_NAME)
    if diagnostics is None:
        return None
    shape = (diagnostics.ensembles, diagnostics.kept, diagnostics.walkers)
    posterior = read_draws(beside, fit.free_names, shape)
    for k, name in enumerate(posterior.names):
        for values in (posterior.values[..., k], posterior.prior_draws[:, k]):
            if outside(name, values):
                raise damaged(beside, f"draws of {name} lie outside its bounds")
    mine = fit.fitted.with_draws(posterior.names, thinned(posterior, fit.fitted.draws.shape[0])).draws
    if agreeing and not np.array_equal(mine, fit.fitted.draws):
        raise ResultFolderError(
            f"{beside}: these draws are of another fit than the fit.json beside them; calibrate again, or put the "
            "files of one run together"
        )
    return posterior


def _problem(fit: Fit, place: Path) -> Problem:
    record = read_run(place)
    table, force = _measured(fit, place, record)
    try:
        problem = record.problem(table, force)
    except FitballError as error:
        raise damaged(record.place, str(error)) from None
    _refuse_other(fit, record, problem)
    for item in problem.free:
        # Bounds that only the problem knows: of levels and group biases.
        if beyond(item.spec, np.array(fit.parameters[item.name].point)):
            raise damaged(place, f"parameters.{item.name}.point: outside its bounds")
    return problem


def _measured(fit: Fit, place: Path, record: RunRecord) -> tuple[ImpactTable, ForceRecords | None]:
    """The measurements, with the places of the files that they were read from."""
    table, force = read_data(fit.source, place.with_name(DATA_NAME))
    table = replace(table, files=tuple((str(record.place_of(named)), named.sha256) for named in record.tables))
    if force is not None and record.force is not None:
        force = replace(force, source=str(record.place_of(record.force)))
    return table, force


def _refuse_other(fit: Fit, record: RunRecord, problem: Problem) -> None:
    """Raise ResultFolderError unless `run.toml` and `fit.json` speak of the same model and parameters."""
    fitted, chosen = fit.fitted, problem.model
    described = {item.name: (item.prior.text, item.fixed) for item in problem.parameters}
    kept = {
        name: (item.prior, item.point if item.verdict is Verdict.FIXED else None)
        for name, item in fit.parameters.items()
    }
    pairs = [
        (record.effort.seed, fit.seed),
        ((chosen.name, dict(chosen.options), chosen.ball), (fitted.model_name, dict(fitted.options), fitted.ball)),
        (problem.contact_time, fit.source.contact_time),
        (list(described.items()), list(kept.items())),
    ]
    if any(one != other for one, other in pairs):
        raise _other(record.place)


def _other(place: Path) -> ResultFolderError:
    return ResultFolderError(
        f"{place}: this run is another than that of the fit.json beside it; calibrate again, or put the files of one "
        "run together"
    )


def _balances(fit: Fit, _place: Path) -> Balances:
    return scene_balances(fit.problem.table, fit.problem.scene)


def _point(fit: Fit, place: Path) -> PointFit:
    """The point estimate of `fit.json`, whose likelihood under the problem must be the one that is noted there."""
    problem, posterior = fit.problem, fit.posterior
    for k, item in enumerate(problem.free):
        if posterior is not None and beyond(item.spec, posterior.values[..., k]):
            raise damaged(place.with_name(POSTERIOR_NAME), f"draws of {item.name} lie outside its bounds")
    values = {name: item.point for name, item in fit.parameters.items()}
    row = np.array([[values[name] for name in problem.free_names]])
    rebound = problem.rebound(row)
    again = float(log_likelihood(problem, row, rebound)[0])
    if not abs(again - fit.log_likelihood) <= ROUNDING * (1.0 + abs(fit.log_likelihood)):
        raise _other(place.with_name(RUN_NAME))
    return PointFit(
        values=values,
        log_posterior=fit.log_posterior,
        log_likelihood=fit.log_likelihood,
        rms=fit.rms,
        rebound=rebound,
        optima=fit.optima,
        optima_log_posterior=fit.optima_log_posterior,
    )


def _predictive(fit: Fit, _place: Path) -> Predictive | None:
    point, posterior = fit.point, fit.posterior
    if posterior is None:
        return None
    return predictive(fit.problem, point, posterior, predictive_generator(fit.seed))
