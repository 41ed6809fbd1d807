"""Whether the parts of a `fit.json` agree with each other: lengths, names, bounds. Nothing is repaired."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

import numpy as np

from fitball.errors import FitballError, ParameterError
from fitball.inference.assemble import rests_on
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.priors import parse_prior
from fitball.inference.results.assumptions import CONTACT_TIME, own_prior
from fitball.inference.results.quantiles import QUANTILES
from fitball.inference.results.results import RunStatus, Verdict
from fitball.models.registry import model, parameter_spec
from fitball.models.specs import ParameterSpec
from fitball.models.types import regime_name
from fitball.report.saved.fit_file import FitFile
from fitball.report.saved.structure import Part
from fitball.values import FloatArray

# A value at a bound is the exponential of a logarithm: rounding may take it this share of the bounds' width beyond.
ROUNDING = 1e-9


def spec_of(name: str) -> ParameterSpec | None:
    """Bounds and prior of a parameter of a model or of its noise; None for one that only this fit has."""
    return NOISE_SPECS.get(name) or parameter_spec(name)


def outside(name: str, values: FloatArray) -> bool:
    """Whether any of the values is beyond the bounds of the parameter; no bounds are known of a fit's own ones."""
    spec = spec_of(name)
    return spec is not None and beyond(spec, values)


def beyond(spec: ParameterSpec, values: FloatArray) -> bool:
    """Whether any of the values is beyond the bounds by more than rounding."""
    slack = ROUNDING * (spec.upper - spec.lower)
    return bool(np.any((values < spec.lower - slack) | (values > spec.upper + slack)))


def checked(file: FitFile) -> str | None:
    """A sentence on the first two places that contradict each other, or what a model or a prior says of itself; None
    where all agree.
    """
    parts = (_shapes, _names, _parameters, _model, _adequacy, _assumptions, _golden)
    try:
        return next(chain.from_iterable(part(file) for part in parts), None)
    except FitballError as error:
        return str(error)


def _shapes(file: FitFile) -> Iterator[str]:
    fitted, data = file.fitted, file.data
    width = {"fitted.names": len(fitted.names), "fitted.point": len(fitted.point)}
    yield from _unequal(width | {f"fitted.draws[{k}]": len(row) for k, row in enumerate(fitted.draws)})
    yield from _unequal(_lengths("fitted.impacts", fitted.impacts))
    for name in ("incident_columns", "incident_sd", "measurements", "with_sd", "labels"):
        listed: Sequence[str] = getattr(data, name)
        if len(set(listed)) < len(listed):
            yield f"data.{name}: read {_listed(listed)}, where a name comes twice"
    sampled = file.status is not RunStatus.POINT_ONLY
    if sampled != (file.diagnostics is not None) or sampled != bool(fitted.draws):
        yield f"status is '{file.status}', but diagnostics and fitted.draws say otherwise"
    if file.diagnostics is not None and file.diagnostics.warm_up >= file.diagnostics.steps:
        yield f"diagnostics: {file.diagnostics.warm_up} steps of warm-up in {file.diagnostics.steps} steps"


def _names(file: FitFile) -> Iterator[str]:
    free = tuple(name for name, parameter in file.parameters.items() if parameter.verdict is not Verdict.FIXED)
    yield from _other_names("fitted.names", file.fitted.names, file.parameters)
    yield from _other_names("golden.parameters", file.golden.parameters, file.parameters)
    yield from _other_names("identifiability.evidence", file.identifiability.evidence, free)
    for what, matrix in (("covariance", file.covariance), ("correlation", file.correlation)):
        if matrix is None:
            continue
        yield from _other_names(f"{what}.names", matrix.names, free)
        lengths = {f"{what}.names": len(free), f"{what}.values": len(matrix.values)}
        yield from _unequal(lengths | {f"{what} row {k}": len(row) for k, row in enumerate(matrix.values)})
    for name, evidence in file.identifiability.evidence.items():
        for profile in filter(None, (evidence.profile, evidence.alone)):
            if profile.values.size != profile.drop.size or profile.values.size < 2:
                yield f"profile of {name}: {profile.values.size} values and {profile.drop.size} drops"
            elif np.any(np.diff(profile.values) <= 0.0) or np.any(profile.drop < 0.0):
                yield f"profile of {name}: its values do not rise, or a drop is negative"
            elif outside(name, profile.values):
                yield f"profile of {name}: a value lies beyond the bounds of the parameter"


def _parameters(file: FitFile) -> Iterator[str]:
    for k, (name, item) in enumerate(file.parameters.items()):
        spec = spec_of(name)
        if spec is None:
            continue
        listed = [value for name in ("point", *QUANTILES) if (value := getattr(item, name)) is not None]
        for what, values in (
            (f"parameters.{name}", np.array(listed)),
            (f"golden.parameters.{name}", np.array([file.golden.parameters[name]])),
            (f"fitted.point of {name}", np.array([file.fitted.point[k]])),
            (f"fitted.draws of {name}", np.array([row[k] for row in file.fitted.draws])),
        ):
            if outside(name, values):
                yield f"{what}: outside its bounds [{spec.lower:g}, {spec.upper:g}] {spec.unit}".rstrip()
        if item.unit != spec.unit:
            yield f"parameters.{name}.unit: read {item.unit!r}, expected {spec.unit!r}"
        parse_prior(name, item.prior, spec.lower, spec.upper, spec.unit)


def _golden(file: FitFile) -> Iterator[str]:
    given, made = file.golden.impacts, file.golden.rebound
    yield from _unequal(_lengths("golden", given) | _lengths("golden", made))
    for code in made.regime:
        try:
            regime_name(code)
        except ParameterError:
            yield f"golden.rebound.regime: {code} is no sequence of phases"


def _model(file: FitFile) -> Iterator[str]:
    composed = model(file.model.name, ball=file.ball.ball(), tangential=file.fitted.tangential, **file.model.closures)
    missing = [name for name in composed.parameter_names if name not in file.parameters]
    if missing:
        yield f"parameters: without {', '.join(missing)}, which model {file.model.name} has"


def _assumptions(file: FitFile) -> Iterator[str]:
    found = {} if file.assumptions is None else file.assumptions.given
    items = {**file.parameters, **file.derived}
    for name in found:
        if name not in items:
            yield f"assumptions.parameters: {name} is none of the parameters"
    for name, item in items.items():
        known = rests_on(name, file.adequacy, file.assumptions)
        scene = (CONTACT_TIME, own_prior(name))
        rest = tuple(one for one in item.given if one not in scene or one in known)
        if item.verdict is Verdict.GIVEN and rest != known:
            yield f"parameters.{name}.given: read {_listed(item.given)}, but the looks say {_listed(known)}"


def _adequacy(file: FitFile) -> Iterator[str]:
    described = file.adequacy
    if described is None:
        return
    beyond_all = [name for name in described.moved if name not in file.parameters]
    if beyond_all:
        yield f"adequacy.moved: read {_listed(beyond_all)}, which are no parameters"
    for name, item in file.parameters.items():
        only = described.conditional(name)
        sure = item.verdict in (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.UNEXAMINED)
        if sure if only else item.verdict is Verdict.CONDITIONAL:
            yield f"parameters.{name} is '{item.verdict}', but adequacy says otherwise"
    chances = [*(check.p for check in described.checks), *(check.adjusted for check in described.noise)]
    for values in (chances, described.unseen.values(), *described.loo_pit.values()):
        if not all(0.0 <= value <= 1.0 + ROUNDING for value in values):
            yield "adequacy: a probability or share lies outside of 0 to 1"


def _lengths(where: str, part: Part) -> dict[str, int]:
    """How many numbers each column of a section has that is there."""
    columns = {name: getattr(part, name) for name in part.__struct_fields__}
    return {f"{where}.{name}": len(column) for name, column in columns.items() if column is not None}


def _unequal(lengths: dict[str, int]) -> Iterator[str]:
    (first, count), *rest = lengths.items()
    for name, other in rest:
        if other != count:
            yield f"{first} and {name} differ in number: {count} and {other}"


def _other_names(what: str, names: Iterable[str], expected: Iterable[str]) -> Iterator[str]:
    one, other = list(names), list(expected)
    if one != other:
        yield f"{what}: read {_listed(one)}, expected {_listed(other)}"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names)[:300] or "none"
