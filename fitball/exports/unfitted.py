"""Bounces without a table: a model at parameters that are set, published or its own defaults, on one surface or on
several. Nothing is fitted; every value is stated with its source, and with its range where it is known.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from fitball.data.published import PREFIX, PublishedPrior, published_prior, published_priors
from fitball.errors import ModelError, ParameterError, suggestion
from fitball.exports.bounces import Bounces, Case
from fitball.inference.comparison.candidates import parse_name
from fitball.inference.prediction.outputs import golden
from fitball.inference.prediction.reach import valid_range
from fitball.inference.prediction.simulate import chosen_parameters
from fitball.inference.problem.parameters import parse_prior
from fitball.inference.results.fitted_model import FittedModel, at_values
from fitball.models.kernels.contact import ANCHOR_SPEED
from fitball.models.model import Model
from fitball.models.registry import model
from fitball.models.specs import DEFAULT_MODEL, ParameterSpec
from fitball.models.types import STATUS_REASON, Status
from fitball.values import Impacts
from fitball.wording import option, spoken

# A number in SI, or `literature:KEY`.
Value: TypeAlias = float | str
# The column of surfaces that are named here.
SURFACE = "surface"
ORIGIN = "nothing was fitted, and no measured impact supports these numbers"
# Bounces of a rally, of which the golden impacts are made: along the court, towards it [m/s], and spin [rad/s].
ALONG, TOWARDS = (6.0, 10.0, 14.0, 18.0, 24.0, 30.0), (10.0, 8.0, 14.0, 4.0, 6.0, 12.0)
SPINS = (-150.0, 0.0, 100.0, 250.0, -50.0, 50.0)
# Restitution of those of a model that takes it as an input.
USUAL_COR = 0.75
# What begins the sentence on all other parameters.
DEFAULTS = "Default values of the model, near the fits to Wang's balls"
PROBABILITIES = np.array([0.025, 0.975])


@dataclass(frozen=True)
class _Chosen:
    """The value of a parameter; `row` is where it was published, None of one that was set."""

    value: float
    row: PublishedPrior | None = None


def unfitted_bounces(
    name: str | None, values: Mapping[str, Value], surfaces: Mapping[str, str | Mapping[str, Value]]
) -> Bounces:
    """The model called `name` (default: the default model) at `values`, and on each of the `surfaces` at what these
    change: by their names, a mapping of parameters, or a text such as `literature:clay, cor_10=0.79`.

    Raises ModelError for an unknown model, and if it has no bounce at these values; ParameterError for an unknown
    parameter, surface or key, a value that is none or out of bounds, and a parameter without any.
    """
    plain, closures = parse_name(DEFAULT_MODEL if name is None else name)
    chosen = model(plain, ball=None, tangential=True, **closures)
    common = {key: _chosen(chosen, key, value, "") for key, value in values.items()}
    by_surface = {label: _of_surface(chosen, label, given) for label, given in surfaces.items()}
    columns = {SURFACE: tuple(by_surface)} if len(by_surface) > 1 else {}
    cases = [_case(chosen, {SURFACE: label}, {**common, **own}) for label, own in by_surface.items()] or [
        _case(chosen, {}, common)
    ]
    return Bounces(ORIGIN, columns, tuple(cases), measured=False, sources=_sources(chosen, common, by_surface))


def _of_surface(chosen: Model, label: str, given: str | Mapping[str, Value]) -> dict[str, _Chosen]:
    """What a surface changes."""
    asked = spoken(f"--surface {label}={given}", f"surfaces={{{label!r}: {given!r}}}")
    if not label.strip():
        raise ParameterError(f"{asked}: expected the name of a surface, such as clay")
    if isinstance(given, Mapping):
        return {name: _chosen(chosen, name, value, f"{asked}: ") for name, value in given.items()}
    found: dict[str, _Chosen] = {}
    for part in given.split(","):
        name, equals, value = (text.strip() for text in part.partition("="))
        if not equals and name.lower().startswith(PREFIX):
            new = _published(chosen, name, asked)
        elif equals and name and value:
            new = {name: _chosen(chosen, name, value, f"{asked}: ")}
        else:
            raise ParameterError(
                f"{asked}: read '{part.strip()}', expected {PREFIX}KEY, such as {PREFIX}clay, or a value, such as "
                "mu=0.7"
            )
        if twice := [name for name in new if name in found and not found[name].row]:
            raise ParameterError(f"{asked}: {twice[0]} is given twice")
        found |= new
    return found


def _published(chosen: Model, text: str, asked: str) -> dict[str, _Chosen]:
    """All parameters of the model that were published under a key."""
    own = [row for row in published_priors() if row.parameter in chosen.parameter_names]
    key, known = text[len(PREFIX) :].strip().lower(), dict.fromkeys(row.key for row in own)
    if key not in known:
        raise ParameterError(
            f"{asked}: the literature has no '{key}' for model {chosen.name}: {suggestion(key, known)}. "
            f"Known keys: {', '.join(known)}; fitball datasets priors lists them with their sources"
        )
    return {row.parameter: _Chosen(row.value, row) for row in own if row.key == key}


def _chosen(chosen: Model, name: str, value: object, before: str) -> _Chosen:
    """A value of a parameter; errors begin with `before`."""
    specs = chosen.specs
    if name not in specs:
        raise ParameterError(f"{before}unknown parameter '{name}' of model {chosen.name}: {suggestion(name, specs)}")
    if isinstance(value, str):
        row = published_prior(name, value)
        if row is not None:
            return _Chosen(row.value, row)
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise ParameterError(
            f"{before}{name}: read {value!r}, expected a number in SI units, or {PREFIX}KEY"
        ) from None
    spec = specs[name]
    if not spec.lower <= number <= spec.upper or (spec.open_above and number >= spec.upper):
        unit = f" {spec.unit}" if spec.unit else ""
        raise ParameterError(
            f"{before}{name} = {number:g}{unit} lies outside its bounds, {spec.lower:g} to "
            f"{'below ' if spec.open_above else ''}{spec.upper:g}{unit}"
        )
    return _Chosen(number)


def _case(chosen: Model, labels: Mapping[str, str], given: Mapping[str, _Chosen]) -> Case:
    parameters = chosen_parameters(chosen, {name: item.value for name, item in given.items()})
    cor = np.array([USUAL_COR]) if chosen.needs_cor else None
    one = replace(
        at_values(chosen, parameters), impacts=Impacts(np.zeros(1), np.array([ANCHOR_SPEED]), np.zeros(1), cor)
    )
    status = Status(int(one.rebound(one.impacts).status[0, 0]))
    if status is not Status.OK:
        where = f" on {' '.join(labels.values())}" if labels else ""
        raise ModelError(
            f"model {chosen.name} has no bounce{where} at {ANCHOR_SPEED:g} m/s with these parameters: "
            f"{STATUS_REASON[status]}. Change one with {option('set', 'NAME=VALUE')}"
        )
    rally = replace(one, impacts=_rally(one))
    return Case(labels, rally, golden(rally, rally.impacts))


def _rally(fitted: FittedModel) -> Impacts:
    """The bounces of a rally, inside the speeds at which the model is sound around `ANCHOR_SPEED`."""
    valid = valid_range(fitted)
    cor = np.full(len(ALONG), USUAL_COR) if fitted.model.needs_cor else None
    return Impacts(np.array(ALONG), np.clip(TOWARDS, valid.low, valid.high), np.array(SPINS), cor)


def _sources(
    chosen: Model, common: Mapping[str, _Chosen], by_surface: Mapping[str, Mapping[str, _Chosen]]
) -> tuple[str, ...]:
    """A sentence on every value: of each surface, of all, and by default."""
    groups = [(f" of {label}", own) for label, own in by_surface.items()]
    own_everywhere = [name for name in common if by_surface and all(name in own for own in by_surface.values())]
    groups.append(("", {name: item for name, item in common.items() if name not in own_everywhere}))
    lines = [_sentence(chosen.specs[name], item, where) for where, group in groups for name, item in group.items()]
    typical = [spec for spec in chosen.parameters if spec.name not in common and spec.typical is not None]
    values = [f"{_value(spec, spec.typical or 0.0)}{where}" for spec, where in _lacking(typical, by_surface)]
    return (*lines, *([f"{DEFAULTS}: {', '.join(values)}."] if values else []))


def _lacking(
    specs: Sequence[ParameterSpec], by_surface: Mapping[str, Mapping[str, _Chosen]]
) -> Iterator[tuple[ParameterSpec, str]]:
    """Those of the parameters that a surface says nothing of, with its name where others do."""
    for spec in specs:
        lacking = [label for label, own in by_surface.items() if spec.name not in own]
        if len(lacking) == len(by_surface):
            yield spec, ""
        elif lacking:
            yield spec, f" of {' and '.join(lacking)}"


def _value(spec: ParameterSpec, value: float) -> str:
    return f"{spec.name} = {value:.6g}{f' {spec.unit}' if spec.unit else ''}"


def _sentence(spec: ParameterSpec, item: _Chosen, where: str) -> str:
    if item.row is None:
        return f"{_value(spec, item.value)}{where}: set by the user."
    low, high = parse_prior(spec.name, item.row.text, spec.lower, spec.upper).quantile(PROBABILITIES)
    # Comments of ports have no ampersand, see `port.source_text`.
    source = item.row.provenance.replace("&", "and")
    assert math.isfinite(low) and math.isfinite(high)
    return f"{_value(spec, item.value)}{where}, 95 % range {low:.3g} to {high:.3g}: {source}."
