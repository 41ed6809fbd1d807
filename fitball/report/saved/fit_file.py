"""`fit.json`: the record of a fit, written and read as the types that it has in memory. The files beside it are read
when they are needed. Nothing is fitted or sampled again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, get_args

import msgspec
import numpy as np

from fitball.data.balances import scene_balances
from fitball.data.table import FrozenMapping
from fitball.errors import FitballError, ParameterError, ResultFolderError
from fitball.inference.assemble import rests_on
from fitball.inference.likelihood.posterior import log_likelihood
from fitball.inference.prediction.posterior_predictive import predictive, predictive_generator
from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.inference.problem.parameters import NOISE_SPECS, parse_prior
from fitball.inference.problem.problem import Problem
from fitball.inference.results.assumptions import CONTACT_TIME, own_prior
from fitball.inference.results.quantiles import QUANTILES
from fitball.inference.results.results import (
    BESIDE,
    KIND,
    SCHEMA_VERSION,
    Fit,
    PointFit,
    Posterior,
    Predictive,
    Record,
    RunStatus,
    Verdict,
    thinned,
)
from fitball.models.registry import parameter_spec
from fitball.models.specs import ParameterSpec
from fitball.models.types import no_rebound, regime_name
from fitball.observables import OBSERVABLES
from fitball.report.form.files import json_text
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
from fitball.values import FloatArray

# By what share the log likelihood of the point estimate may differ on another machine.
ROUNDING = 1e-6
# A value at a bound is the exponential of a logarithm: rounding may take it this share of the bounds' width beyond.
AT_BOUND = 1e-9
# Speeds and spins far beyond any that could be measured, and far below where squares overflow.
FASTEST = 1e6


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
    wrong = _contradiction(record)
    if wrong is not None:
        raise damaged(place, wrong)
    fitted = record.fitted
    if not len(fitted.draws):
        fitted = replace(fitted, draws=np.empty((0, len(fitted.names))))
    fit = Fit.__new__(Fit)
    fit.__dict__.update(vars(record), fitted=fitted, place=place, later=_later)
    return fit


def load(fit: Fit) -> None:
    """Read the run, the measurements and the draws that lie beside a fit, unless they are in memory; the table that
    was fitted need not be there any more.

    Raises ResultFolderError for files that are missing, damaged or foreign, or of different runs.
    """
    for name in BESIDE:
        # Predictions of a function of one's own that is not known here wait until they are asked for.
        if name != "predictive" or not fit.fitted.model.without:
            getattr(fit, name)


def complete(fit: Fit) -> bool:
    """Whether all that a fit is restored from is in memory, or lies in files beside it."""
    needed = [DATA_NAME, RUN_NAME, *([] if fit.diagnostics is None else [POSTERIOR_NAME])]
    in_memory = all(name in vars(fit) for name in BESIDE)
    return in_memory or (fit.place is not None and all(fit.place.with_name(name).exists() for name in needed))


def _later(fit: Fit, name: str) -> object:
    """What the files beside the `fit.json` of a fit say; `name` is one of BESIDE. Raises as `load`."""
    assert fit.place is not None
    makers: Mapping[str, Callable[[Fit, Path], object]] = {
        "posterior": partial(read_posterior, agreeing=True),
        "problem": _problem,
        "balances": lambda fit, _place: scene_balances(fit.problem.table, fit.problem.scene),
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
            if beyond(spec_of(name), values):
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
    table, force = read_data(fit.source, place.with_name(DATA_NAME))
    named, records = record.file.table.files, record.file.force
    table = replace(
        table,
        files=tuple((str(record.place_of(file)), file.sha256) for file in named),
        covariance_files=FrozenMapping(
            {
                str(record.place_of(file)): (str(record.place_of(own)) if own.file else "", own.sha256)
                for file in named
                if (own := file.covariance) is not None
            }
        ),
    )
    if force is not None and records is not None:
        force = replace(force, source=str(record.place_of(records)))
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


def _refuse_other(fit: Fit, record: RunRecord, problem: Problem) -> None:
    """Raise ResultFolderError unless `run.toml` and `fit.json` speak of the same model and parameters."""
    fitted, chosen = fit.fitted, problem.model
    described = {item.name: (item.prior.text, item.fixed) for item in problem.parameters}
    kept = {
        name: (item.prior, item.point if item.verdict is Verdict.FIXED else None)
        for name, item in fit.parameters.items()
    }
    pairs = [
        (record.file.fitball.seed, fit.seed),
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


def _point(fit: Fit, place: Path) -> PointFit:
    """The point estimate of `fit.json`, whose likelihood under the problem must be the one that is noted there."""
    problem, posterior = fit.problem, fit.posterior
    for k, item in enumerate(problem.free):
        if posterior is not None and beyond(item.spec, posterior.values[..., k]):
            raise damaged(place.with_name(POSTERIOR_NAME), f"draws of {item.name} lie outside its bounds")
    values = {name: item.point for name, item in fit.parameters.items()}
    row = np.array([[values[name] for name in problem.free_names]])
    if problem.model.without:
        rebound, again = no_rebound((1, len(problem.impacts))), fit.log_likelihood
    else:
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


def _contradiction(fit: Record) -> str | None:
    """A sentence on the first part of a record that contradicts another, or what a model or a prior says of itself;
    None where all agree. Nothing is repaired.
    """
    parts = (_names, _shapes, _parameters, _profiles, _adequacy, _given, _golden)
    try:
        return next(chain.from_iterable(part(fit) for part in parts), None)
    except FitballError as error:
        return str(error)


def spec_of(name: str) -> ParameterSpec | None:
    """Bounds and prior of a parameter of a model, its noise or a camera; None for one that only this fit has."""
    return NOISE_SPECS.get(name) or CAMERA_SPECS.get(name.partition("[")[0]) or parameter_spec(name)


def beyond(spec: ParameterSpec | None, values: FloatArray) -> bool:
    """Whether any of the values is beyond the bounds by more than rounding, or no number; none are known without."""
    if spec is None:
        return False
    slack = AT_BOUND * (spec.upper - spec.lower)
    return not bool(np.all((values >= spec.lower - slack) & (values <= spec.upper + slack)))


def _names(fit: Record) -> Iterator[str]:
    pairs: list[tuple[str, Iterable[str], Iterable[str]]] = [
        ("fitted.names", fit.fitted.names, fit.parameters),
        ("golden.parameters", fit.golden.parameters, fit.parameters),
        ("identifiability.evidence", fit.identifiability.evidence, fit.free_names),
        ("parameters, names", (item.name for item in fit.parameters.values()), fit.parameters),
        ("derived, names", (item.name for item in fit.derived.values()), fit.derived),
    ]
    looks = ("ess_bulk", "ess_tail", "r_hat") if fit.diagnostics is not None else ()
    pairs += [(f"diagnostics.{it}", sorted(getattr(fit.diagnostics, it)), sorted(fit.free_names)) for it in looks]
    for what, names, expected in pairs:
        one, other = [*names], [*expected]
        if one != other:
            yield f"{what}: read {_listed(one)}, expected {_listed(other)}"
    for name in ("incident_columns", "incident_sd", "measurements", "with_sd", "labels"):
        listed: Sequence[str] = getattr(fit.source, name)
        if len(set(listed)) < len(listed):
            yield f"source.{name}: read {_listed(listed)}, where a name comes twice"
    for item in fit.fitted.levels:
        for name in (item.parameter, *item.hidden):
            if name not in fit.parameters:
                yield f"fitted.levels: without parameter {name}"
    missing = [name for name in fit.fitted.model.parameter_names if name not in fit.parameters]
    if missing:
        yield f"parameters: without {', '.join(missing)}, which model {fit.fitted.model_name} has"


def _shapes(fit: Record) -> Iterator[str]:
    fitted, free, draws = fit.fitted, len(fit.free_names), len(fit.fitted.draws)
    shapes: list[tuple[str, FloatArray | None, tuple[int, ...]]] = [
        ("fitted.point", fitted.point, (len(fitted.names),)),
        ("fitted.draws", fitted.draws if draws else None, (draws, len(fitted.names))),
        ("covariance", fit.covariance, (free, free)),
        ("correlation", fit.correlation, (free, free)),
    ]
    for what, array, shape in shapes:
        if array is not None and array.shape != shape:
            yield f"{what}: numbers of shape {array.shape}, expected {shape}"
        elif array is not None and not np.isfinite(array).all():
            yield f"{what}: expected finite numbers"
    for what, impacts in (("fitted.impacts", fitted.impacts), ("golden.impacts", fit.golden.impacts)):
        if any(np.any(np.abs(column) > FASTEST) for column in impacts.states()[:3]):
            yield f"{what}: a speed or spin beyond {FASTEST:g}"
    sampled = fit.status is not RunStatus.POINT_ONLY
    if sampled != (fit.diagnostics is not None) or sampled != bool(draws):
        yield f"status is '{fit.status}', but diagnostics and fitted.draws say otherwise"
    if fit.diagnostics is not None and fit.diagnostics.warm_up >= fit.diagnostics.steps:
        yield f"diagnostics: {fit.diagnostics.warm_up} steps of warm-up in {fit.diagnostics.steps} steps"


def _parameters(fit: Record) -> Iterator[str]:
    for k, (name, item) in enumerate(fit.parameters.items()):
        for place, value in (
            ("fitted.point", fit.fitted.point[k]),
            ("golden.parameters", fit.golden.parameters[name]),
        ):
            if value != item.point:
                yield f"{place} of {name}: read {float(value)!r}, but its point is {item.point!r}"
        spec = spec_of(name)
        if spec is None:
            continue
        listed = [value for name in ("point", *QUANTILES) if (value := getattr(item, name)) is not None]
        for what, values in (
            (f"parameters.{name}", np.array(listed)),
            (f"fitted.draws of {name}", fit.fitted.draws[:, k] if len(fit.fitted.draws) else np.empty(0)),
        ):
            if beyond(spec, values):
                yield f"{what}: outside its bounds [{spec.lower:g}, {spec.upper:g}] {spec.unit}".rstrip()
        if item.unit != spec.unit:
            yield f"parameters.{name}.unit: read {item.unit!r}, expected {spec.unit!r}"
        parse_prior(name, item.prior, spec.lower, spec.upper, spec.unit)


def _profiles(fit: Record) -> Iterator[str]:
    for name, evidence in fit.identifiability.evidence.items():
        for profile in filter(None, (evidence.profile, evidence.alone)):
            values, drop = profile.values, profile.drop
            if values.ndim != 1 or values.shape != drop.shape or values.size < 2:
                yield f"profile of {name}: {values.size} values and {drop.size} drops"
            elif not (np.all(np.diff(values) > 0.0) and np.all(drop >= 0.0)):
                yield f"profile of {name}: its values do not rise, or a drop is negative"
            elif beyond(spec_of(name), values):
                yield f"profile of {name}: a value lies beyond the bounds of the parameter"


def _adequacy(fit: Record) -> Iterator[str]:
    described = fit.adequacy
    if described is None:
        return
    unknown = [name for name in described.moved if name not in fit.parameters]
    if unknown:
        yield f"adequacy.moved: read {_listed(unknown)}, which are no parameters"
    for name, item in fit.parameters.items():
        sure = item.verdict in (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.UNEXAMINED)
        if sure if described.conditional(name) else item.verdict is Verdict.CONDITIONAL:
            yield f"parameters.{name} is '{item.verdict}', but adequacy says otherwise"
    chances = [*(check.p for check in described.checks), *(check.adjusted for check in described.noise)]
    for values in (chances, described.unseen.values(), *described.loo_pit.values()):
        if not all(0.0 <= value <= 1.0 + AT_BOUND for value in values):
            yield "adequacy: a probability or share lies outside of 0 to 1"


def _given(fit: Record) -> Iterator[str]:
    """What verdicts name as their assumptions, beside what the looks say."""
    items = {**fit.parameters, **fit.derived}
    for name in {} if fit.assumptions is None else fit.assumptions.given:
        if name not in items:
            yield f"assumptions.parameters: {name} is none of the parameters"
    for name, item in items.items():
        known = rests_on(name, fit.adequacy, fit.assumptions)
        scene = (CONTACT_TIME, own_prior(name))
        rest = tuple(one for one in item.given if one not in scene or one in known)
        if item.verdict is Verdict.GIVEN and rest != known:
            yield f"parameters.{name}.given: read {_listed(item.given)}, but the looks say {_listed(known)}"


def _golden(fit: Record) -> Iterator[str]:
    made, count = fit.golden.rebound, len(fit.golden.impacts)
    timed = [name for name, column in OBSERVABLES.items() if column.timed]
    for item in fields(made):
        column = getattr(made, item.name)
        unknown = np.isnan(column)
        if column.shape != (count,):
            yield f"golden.impacts and golden.rebound.{item.name} differ in number: {count} and {column.size}"
        elif unknown.any() and not (item.name in timed and unknown.all()):
            yield f"golden.rebound.{item.name}: a number is missing"
    for code in made.regime.tolist():
        try:
            regime_name(code)
        except ParameterError:
            yield f"golden.rebound.regime: {code} is no sequence of phases"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names)[:300] or "none"
