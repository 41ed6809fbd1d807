"""What a plan is about: parameters, the rebound of an impact, or the court pace rating."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.data.lines import parse_impact
from fitball.errors import FitError, ParameterError, suggestion
from fitball.inference.design.knowledge import Knowledge
from fitball.inference.problem.problem import Problem
from fitball.inference.results.pace_rating import PACE_CONSTANT, apparent_friction, itf_impact, pace_rating
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, Impacts
from fitball.wording import spoken

COURT_PACE, IMPACT = "court pace", "impact"
# All parameters in words, by their number: one is called by its name.
ALL = {1: "", 2: "both parameters of the model", 3: "all {} parameters of the model"}
FORMS = f"expected parameters separated by commas, '{COURT_PACE}', or {IMPACT}=\"v=30 m/s, theta=16 deg\""


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


def parse_target(text: str | Sequence[str] | None, known: Knowledge) -> Target:
    """The target that `text` names; without one all parameters of the model. Raises ParameterError that quotes it,
    FitError for a prediction that the fit has not.
    """
    problem = known.problem
    if text is None:
        names = tuple(name for name in problem.model_names if name in problem.free_names)
        if not names:
            raise FitError("no parameter of the model is free: name one that is (a noise) to plan for")
        return of_parameters(problem, names, ALL[min(len(names), 3)].format(len(names)))
    if not isinstance(text, str):
        try:
            names = tuple(map(str, text))
        except TypeError:
            raise ParameterError(f"{asked_for(str(text))}: {FORMS}") from None
        return of_parameters(problem, names)
    kind, equals, rest = (part.strip() for part in text.partition("="))
    if equals:
        if kind != IMPACT:
            raise ParameterError(f"{asked_for(text)}: {FORMS}")
        return of_impact(known, parse_impact(rest), rest)
    if text.strip().replace("_", " ").lower() == COURT_PACE:
        return of_court_pace(known)
    return of_parameters(problem, tuple(name.strip() for name in text.split(",")))


def of_parameters(problem: Problem, names: tuple[str, ...], words: str = "") -> Target:
    """Parameters by name. Raises ParameterError for one that is not free or named twice."""
    for name in names:
        if name not in problem.free_names:
            fixed = name in {parameter.name for parameter in problem.parameters}
            why = "is fixed in this fit" if fixed else "is no parameter of this fit"
            raise ParameterError(
                f"{asked_for(','.join(names))}: '{name}' {why}: {suggestion(name, problem.free_names)}; {FORMS}"
            )
    if len(set(names)) < len(names):
        raise ParameterError(f"{asked_for(','.join(names))}: a name is given twice")
    places = tuple(problem.free_names.index(name) for name in names)
    chosen = [problem.free[k] for k in places]
    parts = tuple(Part(item.name, item.spec.unit, item.prior.log) for item in chosen)

    def gradients(coordinates: FloatArray) -> FloatArray:
        unit = np.eye(coordinates.shape[1])[list(places)]
        return np.broadcast_to(unit, (len(coordinates), *unit.shape))

    return Target(words or ", ".join(names), parts, lambda coordinates: coordinates[:, places], gradients)


def of_impact(known: Knowledge, impact: Impacts, text: str) -> Target:
    """The rebound of an impact in the middle of all levels. Raises ParameterError for one it cannot know."""
    problem = known.problem
    if not problem.table.has_tangential and (impact.v_x1[0] or impact.omega_1[0]):
        raise ParameterError(f"impact '{text}': this fit of a drop test knows the vertical motion only")
    shown = ("v_x2", "v_y2", "omega_2") if problem.table.has_tangential else ("v_y2",)
    parts = tuple(Part(name, OBSERVABLES[name].unit) for name in shown)
    at = known.common(impact)

    def values(coordinates: FloatArray) -> FloatArray:
        rebound = at.rebound(at.to_values(coordinates))
        return np.concatenate([OBSERVABLES[name].predict(rebound) for name in shown], axis=1)

    def gradients(coordinates: FloatArray) -> FloatArray:
        rebound, slopes = at.differentiated(coordinates)
        return np.concatenate([OBSERVABLES[name].slopes(rebound, slopes) for name in shown], axis=1)

    return Target(f"the rebound of {text}", parts, values, gradients)


def of_court_pace(known: Knowledge) -> Target:
    """The ITF's rating of each surface; a temperature of the ball, which only shifts it, is left out. Raises FitError
    where the fit has none.
    """
    problem = known.problem
    if not problem.table.has_tangential:
        raise FitError("a fit of a drop test has no court pace rating: no motion along the court was measured")
    if not problem.scene.tennis:
        raise FitError("a fit of another ball than a tennis ball has no court pace rating: the test is made with one")
    rows = first_rows(problem)
    impacts = itf_impact().take(np.zeros(len(rows), dtype=np.int64))
    at = replace(known.at(impacts, np.array(rows)), group_bias=None, incident=None)
    parts = tuple(Part(f"court pace {where}".strip(), "") for where in surfaces(problem, rows))

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


def first_rows(problem: Problem) -> list[int]:
    """The first row of the table on each combination of levels; row 0 alone where there are none."""
    seen: dict[tuple[int, ...], int] = {}
    for row in range(len(problem.impacts)):
        seen.setdefault(tuple(int(pooling.index[row]) for pooling in problem.pooling), row)
    return list(seen.values())


def surfaces(problem: Problem, rows: Sequence[int]) -> list[str]:
    """What tells the table's `rows` apart: the labels of their levels, empty where there are none."""
    return [", ".join(levels_at(problem, row).values()) for row in rows]


def levels_at(problem: Problem, row: int) -> dict[str, str]:
    """The label of a row of the table in each column over which parameters are pooled."""
    return {pooling.column: pooling.labels[int(pooling.index[row])] for pooling in problem.pooling}
