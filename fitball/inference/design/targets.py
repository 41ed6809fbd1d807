"""What a plan is asked to determine: parameters, the rebound of an impact, or the court pace rating."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.data.lines import parse_impact
from fitball.errors import FitError, ParameterError, suggestion
from fitball.inference.design.asked import Labels, surfaces_of
from fitball.inference.design.knowledge import Knowledge
from fitball.inference.problem.level_names import at_level
from fitball.inference.problem.pooling import Pooling
from fitball.inference.problem.problem import Problem
from fitball.inference.results.lab import PACE_CONSTANT, apparent_friction, itf_impact, pace_rating
from fitball.models.kernels.dual import STEP, NumberArray
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, Impacts
from fitball.wording import spoken

COURT_PACE, IMPACT = "court pace", "impact"
# All parameters in words, by their number: one is called by its name.
ALL = {1: "", 2: "both parameters of the model", 3: "all {} parameters of the model"}
TARGET_FORMS = f"expected parameters separated by commas, '{COURT_PACE}', or {IMPACT}=\"v=30 m/s, theta=16 deg\""


def asked_for(text: str) -> str:
    """How a target was asked for."""
    return spoken(f"--for {text}", f"target={text!r}")


@dataclass(frozen=True)
class Part:
    """One quantity of a target: its `name` and `unit` (SI); `log`: it is the logarithm that is known so well."""

    name: str
    unit: str
    log: bool = False


@dataclass(frozen=True)
class Target:
    """Quantities that are functions of the parameters, called `words` in a sentence: at coordinates (draws, free)
    their `values` (draws, parts), and the derivatives of these, `gradients` (draws, parts, free); NaN where the model
    has no answer.
    """

    words: str
    parts: tuple[Part, ...]
    values: Callable[[FloatArray], FloatArray]
    gradients: Callable[[FloatArray], FloatArray]


def parse_target(text: str | Sequence[str] | None, known: Knowledge, levels: Labels | None = None) -> Target:
    """The target that `text` names; without one all parameters of the model. What differs between surfaces or balls
    has a part for each, or for those of `levels`. Raises ParameterError that quotes the text, FitError for a
    prediction that the fit has not.
    """
    problem = known.problem
    if text is None:
        names = tuple(name for name in problem.model_names if name in problem.free_names)
        if not names:
            raise FitError("no parameter of the model is free: name a free one (a noise) as the target")
        return of_parameters(problem, names, ALL[min(len(names), 3)].format(len(names)), levels)
    if not isinstance(text, str):
        try:
            names = tuple(map(str, text))
        except TypeError:
            raise ParameterError(f"{asked_for(str(text))}: {TARGET_FORMS}") from None
        return of_parameters(problem, names, levels=levels)
    kind, equals, rest = (part.strip() for part in text.partition("="))
    if equals:
        if kind != IMPACT:
            raise ParameterError(f"{asked_for(text)}: {TARGET_FORMS}")
        return of_impact(known, parse_impact(rest), rest, levels)
    if text.strip().replace("_", " ").lower() == COURT_PACE:
        return of_court_pace(known, levels)
    return of_parameters(problem, tuple(name.strip() for name in text.split(",")), levels=levels)


def of_parameters(problem: Problem, names: tuple[str, ...], words: str = "", levels: Labels | None = None) -> Target:
    """Parameters by name, each at every surface or ball where it differs between these. Raises ParameterError for one
    that is not free or named twice.
    """
    one_level = {item.level_name(label): (item, label) for item in problem.pooling for label in item.labels}
    for name in names:
        if name in one_level:
            item, label = one_level[name]
            raise ParameterError(
                f"{asked_for(','.join(names))}: '{name}' is {item.parameter} at one {item.column}: name "
                f"{item.parameter}, and {at_level(item.column, label)} for that one alone"
            )
        if name not in problem.free_names:
            fixed = name in {parameter.name for parameter in problem.parameters}
            why = "is fixed in this fit" if fixed else "is no parameter of this fit"
            raise ParameterError(
                f"{asked_for(','.join(names))}: '{name}' {why}: {suggestion(name, problem.free_names)}; "
                f"{TARGET_FORMS}"
            )
    if len(set(names)) < len(names):
        raise ParameterError(f"{asked_for(','.join(names))}: a name is given twice")
    free, pooled = dict(zip(problem.free_names, problem.free, strict=True)), _pooled(problem, levels)
    parts = tuple(
        Part(own, free[name].spec.unit, free[name].prior.log)
        for name in names
        for own in (map(pooled[name][0].level_name, pooled[name][1]) if name in pooled else (name,))
    )  # fmt: skip

    def values(coordinates: NumberArray) -> NumberArray:
        columns, made = problem.all_values(problem.to_values(coordinates)), []
        for name in names:
            if name in pooled:
                pooling, labels = pooled[name]
                at = [pooling.value(columns, label) for label in labels]
                made += [np.log(value) if pooling.log else value for value in at]
            else:
                made.append(coordinates[:, problem.free_names.index(name)])
        return np.stack(made, axis=1)

    def gradients(coordinates: FloatArray) -> FloatArray:
        # A complex step: how a level follows from the common value, the spread and its place.
        size = coordinates.shape[1]
        moved = [values(coordinates + 1j * STEP * np.eye(size)[k]).imag / STEP for k in range(size)]
        return np.stack(moved, axis=2)

    return Target(words or ", ".join(names), parts, values, gradients)


def _pooled(problem: Problem, levels: Labels | None) -> dict[str, tuple[Pooling, tuple[str, ...]]]:
    """Parameters that differ between surfaces or balls, each with its labels, or the one of `levels`."""
    chosen = levels or {}
    return {
        item.parameter: (item, (chosen[item.column],) if item.column in chosen else item.labels)
        for item in problem.pooling
    }


def of_impact(known: Knowledge, impact: Impacts, text: str, levels: Labels | None = None) -> Target:
    """The rebound of an impact on each surface. Raises ParameterError for one it cannot know."""
    problem = known.problem
    if not problem.table.has_tangential and (impact.v_x1[0] or impact.omega_1[0]):
        raise ParameterError(f"impact '{text}': this fit is of a drop test, with vertical motion only")
    shown = ("v_x2", "v_y2", "omega_2") if problem.table.has_tangential else ("v_y2",)
    surfaces, at = _on_each_surface(known, impact, levels)
    parts = tuple(Part(f"{name} {words}".strip(), OBSERVABLES[name].unit) for name in shown for words in surfaces)

    def values(coordinates: FloatArray) -> FloatArray:
        rebound = at.rebound(at.to_values(coordinates))
        return np.concatenate([OBSERVABLES[name].predict(rebound) for name in shown], axis=1)

    def gradients(coordinates: FloatArray) -> FloatArray:
        rebound, slopes = at.differentiated(coordinates)
        return np.concatenate([OBSERVABLES[name].slopes(rebound, slopes) for name in shown], axis=1)

    return Target(f"the rebound of {text}", parts, values, gradients)


def _on_each_surface(known: Knowledge, impact: Impacts, levels: Labels | None) -> tuple[tuple[str, ...], Problem]:
    """The surfaces of a fit in words, and the problem at one impact on each of them, without errors."""
    surfaces, first = surfaces_of(known.problem, levels)
    impacts = impact.take(np.zeros(len(surfaces), dtype=np.int64))
    return surfaces, replace(known.at(impacts, np.array(first)), group_bias=None, errors=None, camera=None)


def of_court_pace(known: Knowledge, levels: Labels | None = None) -> Target:
    """The ITF's rating of each surface; a temperature of the ball, which only shifts it, is left out. Raises FitError
    where the fit has none.
    """
    problem = known.problem
    if not problem.table.has_tangential:
        raise FitError("a fit of a drop test has no court pace rating: no motion along the court was measured")
    if not problem.scene.tennis:
        raise FitError("this ball is no tennis ball: the court pace rating is defined for tennis balls")
    surfaces, at = _on_each_surface(known, itf_impact(), levels)
    impacts = at.impacts
    parts = tuple(Part(f"court pace {words}".strip(), "") for words in surfaces)

    def values(coordinates: FloatArray) -> FloatArray:
        rebound = at.rebound(at.to_values(coordinates))
        friction = apparent_friction(impacts.v_x1, impacts.v_y1, rebound.v_x2, rebound.v_y2)
        return pace_rating(friction, rebound.v_y2 / impacts.v_y1)

    def gradients(coordinates: FloatArray) -> FloatArray:
        rebound, slopes = at.differentiated(coordinates)
        vertical = (impacts.v_y1 + rebound.v_y2)[..., None]
        lost = (impacts.v_x1 - rebound.v_x2)[..., None]
        friction = -slopes["v_x2"] / vertical - lost / vertical**2 * slopes["v_y2"]
        return np.asarray(-100.0 * friction - PACE_CONSTANT * slopes["v_y2"] / impacts.v_y1[:, None])

    return Target("the court pace rating", parts, values, gradients)
