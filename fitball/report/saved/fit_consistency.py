"""Whether the parts of a `fit.json` agree with each other: lengths, names, bounds. Nothing is repaired."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from itertools import chain

import numpy as np

from fitball.errors import FitballError, ParameterError
from fitball.inference.assemble import rests_on
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.priors import parse_prior
from fitball.inference.results.assumptions import CONTACT_TIME, own_prior
from fitball.inference.results.quantiles import QUANTILES
from fitball.inference.results.results import Record, RunStatus, Verdict
from fitball.models.registry import parameter_spec
from fitball.models.specs import ParameterSpec
from fitball.models.types import regime_name
from fitball.values import FloatArray, Impacts

# A value at a bound is the exponential of a logarithm: rounding may take it this share of the bounds' width beyond.
ROUNDING = 1e-9
# Speeds and spins far beyond any that could be measured, and far below where squares overflow.
FASTEST = 1e6


def spec_of(name: str) -> ParameterSpec | None:
    """Bounds and prior of a parameter of a model or of its noise; None for one that only this fit has."""
    return NOISE_SPECS.get(name) or parameter_spec(name)


def outside(name: str, values: FloatArray) -> bool:
    """Whether any of the values is beyond the bounds of the parameter; no bounds are known of a fit's own ones."""
    spec = spec_of(name)
    return spec is not None and beyond(spec, values)


def beyond(spec: ParameterSpec, values: FloatArray) -> bool:
    """Whether any of the values is beyond the bounds by more than rounding, or no number."""
    slack = ROUNDING * (spec.upper - spec.lower)
    return not bool(np.all((values >= spec.lower - slack) & (values <= spec.upper + slack)))


def checked(fit: Record) -> str | None:
    """A sentence on the first place that contradicts another, or what a model or a prior says of itself; None where
    all agree.
    """
    parts = (_names, _shapes, _parameters, _profiles, _model, _adequacy, _assumptions, _golden)
    try:
        return next(chain.from_iterable(part(fit) for part in parts), None)
    except FitballError as error:
        return str(error)


def _names(fit: Record) -> Iterator[str]:
    yield from _other_names("fitted.names", fit.fitted.names, fit.parameters)
    yield from _other_names("golden.parameters", fit.golden.parameters, fit.parameters)
    yield from _other_names("identifiability.evidence", fit.identifiability.evidence, fit.free_names)
    for section, items in (("parameters", fit.parameters), ("derived", fit.derived)):
        yield from _other_names(f"{section}, names", (item.name for item in items.values()), items)
    if fit.diagnostics is not None:
        for look in ("ess_bulk", "ess_tail", "r_hat"):
            told: Mapping[str, float] = getattr(fit.diagnostics, look)
            yield from _other_names(f"diagnostics.{look}", sorted(told), sorted(fit.free_names))
    for name in ("incident_columns", "incident_sd", "measurements", "with_sd", "labels"):
        listed: Sequence[str] = getattr(fit.source, name)
        if len(set(listed)) < len(listed):
            yield f"source.{name}: read {_listed(listed)}, where a name comes twice"


def _other_names(what: str, names: Iterable[str], expected: Iterable[str]) -> Iterator[str]:
    one, other = list(names), list(expected)
    if one != other:
        yield f"{what}: read {_listed(one)}, expected {_listed(other)}"


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
    yield from _fast("fitted.impacts", fitted.impacts)
    yield from _fast("golden.impacts", fit.golden.impacts)
    sampled = fit.status is not RunStatus.POINT_ONLY
    if sampled != (fit.diagnostics is not None) or sampled != bool(draws):
        yield f"status is '{fit.status}', but diagnostics and fitted.draws say otherwise"
    if fit.diagnostics is not None and fit.diagnostics.warm_up >= fit.diagnostics.steps:
        yield f"diagnostics: {fit.diagnostics.warm_up} steps of warm-up in {fit.diagnostics.steps} steps"


def _fast(what: str, impacts: Impacts) -> Iterator[str]:
    if any(np.any(np.abs(column) > FASTEST) for column in impacts.states()[:3]):
        yield f"{what}: a speed or spin beyond {FASTEST:g}"


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
        draws = fit.fitted.draws[:, k] if len(fit.fitted.draws) else np.empty(0)
        for what, values in ((f"parameters.{name}", np.array(listed)), (f"fitted.draws of {name}", draws)):
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
            elif outside(name, values):
                yield f"profile of {name}: a value lies beyond the bounds of the parameter"


def _golden(fit: Record) -> Iterator[str]:
    made, count = fit.golden.rebound, len(fit.golden.impacts)
    for item in fields(made):
        column = getattr(made, item.name)
        unknown = np.isnan(column)
        if column.shape != (count,):
            yield f"golden.impacts and golden.rebound.{item.name} differ in number: {count} and {column.size}"
        elif unknown.any() and not (item.name == "contact_time" and unknown.all()):
            yield f"golden.rebound.{item.name}: a number is missing"
    for code in made.regime.tolist():
        try:
            regime_name(code)
        except ParameterError:
            yield f"golden.rebound.regime: {code} is no sequence of phases"


def _model(fit: Record) -> Iterator[str]:
    missing = [name for name in fit.fitted.model.parameter_names if name not in fit.parameters]
    if missing:
        yield f"parameters: without {', '.join(missing)}, which model {fit.fitted.model_name} has"


def _assumptions(fit: Record) -> Iterator[str]:
    found = {} if fit.assumptions is None else fit.assumptions.given
    items = {**fit.parameters, **fit.derived}
    for name in found:
        if name not in items:
            yield f"assumptions.parameters: {name} is none of the parameters"
    for name, item in items.items():
        known = rests_on(name, fit.adequacy, fit.assumptions)
        scene = (CONTACT_TIME, own_prior(name))
        rest = tuple(one for one in item.given if one not in scene or one in known)
        if item.verdict is Verdict.GIVEN and rest != known:
            yield f"parameters.{name}.given: read {_listed(item.given)}, but the looks say {_listed(known)}"


def _adequacy(fit: Record) -> Iterator[str]:
    described = fit.adequacy
    if described is None:
        return
    beyond_all = [name for name in described.moved if name not in fit.parameters]
    if beyond_all:
        yield f"adequacy.moved: read {_listed(beyond_all)}, which are no parameters"
    for name, item in fit.parameters.items():
        only = described.conditional(name)
        sure = item.verdict in (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.UNEXAMINED)
        if sure if only else item.verdict is Verdict.CONDITIONAL:
            yield f"parameters.{name} is '{item.verdict}', but adequacy says otherwise"
    chances = [*(check.p for check in described.checks), *(check.adjusted for check in described.noise)]
    for values in (chances, described.unseen.values(), *described.loo_pit.values()):
        if not all(0.0 <= value <= 1.0 + ROUNDING for value in values):
            yield "adequacy: a probability or share lies outside of 0 to 1"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names)[:300] or "none"
