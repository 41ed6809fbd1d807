"""Quantities that follow from several parameters and are known where these are not: the value of a parameter on each
surface or with each ball, the ratio of the stiffnesses, and the restitution and the offset at a speed that was
measured where their lines are anchored at another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.inference.identifiability.information import first_order_moves
from fitball.inference.identifiability.verdict import CENTRAL_95, Judgement, Numbers, judge, marginal
from fitball.inference.problem.parameters import Parameter, parse_prior
from fitball.inference.problem.pooling import Pooling
from fitball.inference.problem.problem import Problem
from fitball.inference.results import sentences
from fitball.inference.results.evidence import FALSE_EXCEPT, Difference, Evidence
from fitball.inference.results.results import PointFit, Posterior
from fitball.models.kernels.contact import ANCHOR_SPEED
from fitball.models.specs import ParameterSpec
from fitball.values import FloatArray, Impacts
from fitball.wording import in_formula

# Values (draws, free) in SI -> the quantity (draws,), NaN where the model has no answer.
Rule = Callable[[FloatArray], FloatArray]
# Share of the middle speed by which the anchor must lie outside of the measured ones: those of one setting of a
# launcher scatter by 3 % (sd of Wang's 21 impacts), and closer than twice that is scatter.
BEYOND = 0.05
# Lines in the normal speed: parameter at the anchor, its slope.
LINES = {"cor_10": "cor_slope", "eps_10": "eps_slope"}
# Draws of a point fit, and the step of its derivatives in widths of the priors.
DRAWS, STEP = 2000, 1e-5
# They are judged by their draws alone.
NOTHING = Evidence(None, None, None, None, None, None)


@dataclass(frozen=True)
class Quantity:
    """A quantity that follows from the parameters called `parts`; `parameter` has its name, unit and coordinate.

    A `level` is known where spread and place, whose product it has, are not: to first order it is its own line.
    `beyond` says that it is extrapolated.
    """

    parameter: Parameter
    parts: tuple[str, ...]
    rule: Rule
    level: bool = False
    beyond: str = ""


@dataclass(frozen=True)
class Derived:
    """A quantity with its best value, its draws (draws,) and the verdict on it."""

    quantity: Quantity
    point: float
    draws: FloatArray
    judged: Judgement


def extrapolated(problem: Problem) -> tuple[str, ...]:
    """The free parameters that are values at 10 m/s of lines that were measured at other speeds only."""
    low, high = _speeds(problem)
    slack = BEYOND * float(np.median(problem.impacts.v_y1))
    if low - slack <= ANCHOR_SPEED <= high + slack:
        return ()
    return tuple(name for name, slope in LINES.items() if {name, slope} <= set(problem.free_names))


def _speeds(problem: Problem) -> tuple[float, float]:
    return float(problem.impacts.v_y1.min()), float(problem.impacts.v_y1.max())


def extrapolated_words(problem: Problem) -> str:
    """Why a value at 10 m/s is extrapolated."""
    low, high = _speeds(problem)
    return sentences.BEYOND.format(anchor=ANCHOR_SPEED, low=low, high=high)


def quantities(problem: Problem) -> tuple[Quantity, ...]:
    """Those that a problem has: values of parameters at levels, values at a measured speed, at each level where the
    line differs between levels, and the ratio of the stiffnesses where it is one.
    """
    return (*_levels(problem), *_at_measured_speed(problem), *_ratio(problem))


def _levels(problem: Problem) -> Iterator[Quantity]:
    extrapolating = extrapolated(problem)
    for pooling in problem.pooling:
        spec = problem.model.specs[pooling.parameter]
        prior = next(item.prior for item in problem.parameters if item.name == pooling.parameter)
        for label in pooling.labels:
            own = replace(
                spec, name=pooling.level_name(label), meaning=f"{spec.meaning}, {pooling.column} {label}",
                label=f"{spec.label} $({in_formula(label)})$",
            )  # fmt: skip
            parts, rule = (pooling.parameter, pooling.place_name(label)), _level(problem, pooling, label)
            beyond = extrapolated_words(problem) if pooling.parameter in extrapolating else ""
            yield Quantity(Parameter(own, prior, None), parts, rule, level=True, beyond=beyond)


def _level(problem: Problem, pooling: Pooling, label: str) -> Rule:
    return lambda values: pooling.value(problem.all_values(values), label)


def _at_measured_speed(problem: Problem) -> Iterator[Quantity]:
    speed = float(f"{np.median(problem.impacts.v_y1):.3g}")
    at, pooled = f"at {speed:g} m/s", {pooling.parameter: pooling for pooling in problem.pooling}
    for anchor in extrapolated(problem):
        slope, pooling = LINES[anchor], pooled.get(anchor)
        if slope in pooled:
            continue
        if pooling is None:
            rule = _measured(problem, anchor, _free(problem, anchor), speed, None)
            yield Quantity(_measured_spec(anchor, at, "", ""), (anchor, slope), rule)
            continue
        for k, label in enumerate(pooling.labels):
            own = _measured_spec(anchor, at, f"[{label}]", f", {pooling.column} {label}")
            parts = (anchor, slope, pooling.place_name(label))
            like = int(np.argmax(pooling.index == k))
            rule = _measured(problem, anchor, _level(problem, pooling, label), speed, like)
            yield Quantity(own, parts, rule, level=True)


def _measured_spec(anchor: str, at: str, where: str, words: str) -> Parameter:
    if anchor == "cor_10":
        spec = ParameterSpec(
            f"COR {at}{where}", "", 0.0, 1.0, "normal(0.75, 0.15)", f"vertical restitution, {at}{words}",
            r"$\mathrm{COR}$",
        )  # fmt: skip
    else:
        spec = ParameterSpec(
            f"offset {at}{where}", "m", -0.033, 0.033, "normal(0, 0.005)",
            f"normal-force offset, ahead of the centre, {at}{words}", r"$\varepsilon$",
        )  # fmt: skip
    return _parameter(spec)


def _measured(problem: Problem, anchor: str, value: Rule, speed: float, like: int | None) -> Rule:
    """What a line is at a speed; of the restitution as the model has it, at the level of the table's row `like`."""
    if anchor == "cor_10":
        return _restitution(problem, speed, like)
    slope, away = _free(problem, LINES[anchor]), speed - ANCHOR_SPEED
    return lambda values: value(values) + away * slope(values)


def _ratio(problem: Problem) -> Iterator[Quantity]:
    pooled = {pooling.parameter for pooling in problem.pooling}
    if {"k_theta", "k_y"} <= set(problem.free_names) - pooled:
        spec = ParameterSpec(
            "k_theta/k_y", "m^2/rad", 1e-12, 1e6, "lognormal(1.5e-3, 1.8)",
            "stiffness ratio, torsional over vertical: rebounds determine only this", r"$K_\theta/K_y$",
        )  # fmt: skip
        above, below = _free(problem, "k_theta"), _free(problem, "k_y")
        yield Quantity(_parameter(spec), ("k_theta", "k_y"), lambda values: above(values) / below(values))


def _free(problem: Problem, name: str) -> Rule:
    column = problem.free_names.index(name)
    return lambda values: values[:, column]


def _along(problem: Problem, item: Quantity, at: FloatArray, moves: FloatArray) -> FloatArray:
    """Draws (draws,) of a quantity whose coordinate is a line in those of the problem, from `at` (free,) and `moves`
    (draws, free), by central differences.
    """
    steps = np.diag(STEP * problem.prior.width)
    prior = item.parameter.prior
    ahead, behind, here = (
        prior.coordinate(item.rule(problem.to_values(rows))) for rows in (at + steps, at - steps, at[None, :])
    )
    slope = (ahead - behind) / (2.0 * np.diag(steps))
    return np.asarray(prior.value(np.clip(here + moves @ slope, *prior.support)))


def differences(problem: Problem, followed: Sequence[Derived]) -> tuple[Difference, ...]:
    """By how much every parameter that is fitted to levels differs between them: the pair farthest apart, found where
    less than a share of 0.05 over all pairs of the draws of its difference lies beyond zero, on either side.
    """
    draws, found = {item.quantity.parameter.name: item.draws for item in followed}, []
    for pooling in problem.pooling:
        names = {label: pooling.level_name(label) for label in pooling.labels if pooling.level_name(label) in draws}
        if len(names) < 2:
            continue
        order = sorted(names, key=lambda label: float(np.median(draws[names[label]])))
        low, high = order[0], order[-1]
        apart = draws[names[high]] - draws[names[low]]
        pairs = len(names) * (len(names) - 1) // 2
        p = min(1.0, 2.0 * pairs * float(np.mean(apart <= 0.0)))
        unit = problem.model.specs[pooling.parameter].unit
        within = dict(zip(("q025", "q975"), np.quantile(apart, CENTRAL_95).tolist(), strict=True))
        size, sd = float(np.median(apart)), float(np.std(apart, ddof=1))
        found.append(
            Difference(
                pooling.parameter, pooling.column, low, high, unit, size, sd, **within, p=p, found=p < FALSE_EXCEPT,
                fitted=True,
            )
        )  # fmt: skip
    return tuple(found)


def _parameter(spec: ParameterSpec) -> Parameter:
    return Parameter(spec, parse_prior(spec.name, spec.prior, spec.lower, spec.upper, spec.unit), None)


def _restitution(problem: Problem, speed: float, like: int | None) -> Rule:
    """By the law of the model, at the table's median motion along the court."""
    given = problem.impacts
    impact = Impacts(np.array([np.median(given.v_x1)]), np.array([speed]), np.array([np.median(given.omega_1)]))

    def rule(values: FloatArray) -> FloatArray:
        rebound = problem.rebound(values, impact, like)
        return np.where(rebound.status[:, 0] == 0, rebound.v_y2[:, 0] / speed, np.nan)

    return rule


def derived(
    problem: Problem, point: PointFit, posterior: Posterior | None, rng: np.random.Generator
) -> tuple[Derived, ...]:
    """Every quantity, judged by its draws beside those of prior and scene."""
    asked = quantities(problem)
    if not asked:
        return ()
    best = np.array([[point.values[name] for name in problem.free_names]])
    at = moves = np.empty(0)
    if posterior is None:
        at, moves = first_order_moves(problem, point, DRAWS, rng)
        values = problem.to_values(np.clip(at + moves, *problem.prior.limits))
        before = problem.prior.draw(rng, DRAWS)
    else:
        values, before = posterior.draws, posterior.prior_draws
    found = []
    for item in asked:
        straight = item.level and posterior is None
        draws = _along(problem, item, at, moves) if straight else item.rule(values)
        known = item.rule(before)
        draws, known = draws[np.isfinite(draws)], known[np.isfinite(known)]
        # Where the model hardly has an answer there is nothing to report.
        if 2 * len(draws) < len(values) or 2 * len(known) < len(before):
            continue
        found_in = marginal(item.parameter.prior, draws, known)
        numbers = Numbers(problem, item.parameter, NOTHING, found_in, beyond=item.beyond)
        found.append(Derived(item, float(item.rule(best)[0]), draws, judge(numbers)))
    return tuple(found)
