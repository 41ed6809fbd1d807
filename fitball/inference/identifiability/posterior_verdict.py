"""One verdict a parameter: does the table fix it, bound it from one side, or leave it as it was known?

The marginal likelihood of a parameter is, up to a constant, its posterior density over its density before the table
(the reference). Where that ratio does not fall off towards an end of the posterior, the table leaves that side open.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.inference.identifiability.scene_share import NOT_ALONE, RESTS_ON_SCENE, scene_words
from fitball.inference.problem.parameters import Parameter
from fitball.inference.problem.problem import Problem
from fitball.inference.results.assumptions import CONTACT_TIME
from fitball.inference.results.results import Posterior, Verdict
from fitball.values import FloatArray

# Share of its peak that the marginal likelihood must keep over the outer twentieth of what was possible before for
# that side to count as open. A normal likelihood 1.75 times as wide as a normal prior just does.
OPEN_SHARE = 0.5
EDGE = 0.05
# Contraction below which the table added next to nothing, whatever the shape.
NEGLIGIBLE = 0.2
# Correlation worth naming.
TIED = 0.9
# Ends of the central 68 %.
MIDDLE = (0.16, 0.84)
# What ends an open side that nothing else ends.
PRIOR = "the prior"
# Levels at which a prior stands for what was known before, where the scene's knowledge is to count as evidence.
LEVELS = (np.arange(2000) + 0.5) / 2000


@dataclass(frozen=True)
class Judgement:
    """Verdict on one parameter, with the contraction, the reason in words, and the open sides of the marginal;
    `middle` are the ends, in SI, between which the posterior has it with 68 %; `given` is what of the scene an
    identified value rests on.
    """

    contraction: float | None
    verdict: Verdict
    reason: str
    open_sides: tuple[bool, bool] = (False, False)
    middle: tuple[float, float] | None = None
    given: tuple[str, ...] = ()


def judge(
    problem: Problem,
    posterior: Posterior,
    correlation: FloatArray,
    alone: Mapping[str, float],
    traded: Mapping[str, tuple[str, ...]],
) -> dict[str, Judgement]:
    """Judge every free parameter; `alone` is the contraction without the scene of those that the scene touches,
    `traded` are those that only the priors of others hold, with these.
    """
    return {
        parameter.name: _judge(problem, posterior, correlation, parameter, alone.get(parameter.name), traded)
        for parameter in problem.free
    }


def _judge(
    problem: Problem,
    posterior: Posterior,
    correlation: FloatArray,
    parameter: Parameter,
    alone: float | None,
    traded: Mapping[str, tuple[str, ...]],
) -> Judgement:
    column = posterior.names.index(parameter.name)
    values = posterior.draws[:, column]
    after = parameter.prior.coordinate(values)
    before = parameter.prior.coordinate(posterior.prior_draws[:, column])
    remarks = _tied_to(posterior.names, correlation, column)
    # Against the prior itself, because the reference already holds what the scene knows.
    against_prior = 1.0 - float(np.var(after)) / parameter.prior.variance
    rests = alone is not None and against_prior - alone > RESTS_ON_SCENE
    if parameter.name in traded and not rests:
        contraction = 1.0 - float(np.var(after) / np.var(before))
        reason = traded_words(traded[parameter.name])
        return Judgement(contraction, Verdict.PRIOR_DOMINATED, reason + remarks, open_ends(after, before))
    if rests and alone is not None:
        scene = scene_words(problem)
        if alone < NOT_ALONE:
            own = parameter.prior.coordinate(parameter.prior.quantile(LEVELS))
            reason = f"its size comes from {scene}"
            known = judged_draws(problem, parameter, values, own, reason, remarks)
            given = (CONTACT_TIME,) if known.verdict is Verdict.IDENTIFIED else ()
            return replace(known, contraction=1.0 - float(np.var(after) / np.var(before)), given=given)
        remarks = f"; rests on {scene}, without it the contraction would be {alone:.2f}" + remarks
    return judged_draws(problem, parameter, values, before, "", remarks)


def judged_draws(
    problem: Problem, parameter: Parameter, values: FloatArray, before: FloatArray, source: str, remarks: str = ""
) -> Judgement:
    """The verdict on a parameter by its draws, `values` (draws,) in SI, beside what was known `before` (draws,) in
    the coordinate of its prior; `source` says in words what it rests on besides the table.
    """
    after = parameter.prior.coordinate(values)
    contraction = 1.0 - float(np.var(after) / np.var(before))
    left, right = open_ends(after, before)
    remarks = f"; {source}{remarks}" if source else remarks
    if contraction < NEGLIGIBLE or (left and right):
        reason = f"the table leaves it as it was known before (contraction {contraction:.2f})"
        return Judgement(contraction, Verdict.PRIOR_DOMINATED, reason + remarks, (left, right))
    if left or right:
        end = float(np.quantile(values, 0.05 if right else 0.95))
        side, other = ("below", "upwards") if right else ("above", "downwards")
        limit = limit_words(problem, parameter, right)
        reason = (
            f"the table bounds it from {side} only ({'>' if right else '<'} {plain(end, parameter.spec.unit)} "
            f"with 95 %); {other} it is limited by {limit}"
        )
        return Judgement(contraction, Verdict.ONE_SIDED, reason + remarks, (left, right))
    width = float(np.std(after) / np.std(before))
    reason = f"the table narrows it from both sides to {100.0 * width:.2g} % of what was known before"
    first, last = np.quantile(values, MIDDLE)
    return Judgement(contraction, Verdict.IDENTIFIED, reason + remarks, middle=(float(first), float(last)))


def traded_words(others: Sequence[str]) -> str:
    """Why a parameter is not told although its posterior is narrower than its prior."""
    with_whom = f"together with {' and '.join(others)}" if others else "together with others"
    priors = "the priors of both" if len(others) == 1 else "the priors of all"
    return f"the table tells it only {with_whom}: its own size comes from {priors}"


def limit_words(problem: Problem, parameter: Parameter, right: bool) -> str:
    """What ends an open side of a parameter: what the model demands, what is possible, or its prior."""
    demanded = [c for c in problem.model.linear_constraints(problem.impacts) if c.lower_bound_of == parameter.name]
    if demanded and not right:
        return f"{demanded[0].words}, which the model demands"
    bound, possible = (parameter.spec.lower, parameter.spec.upper)[right], parameter.spec.beyond[right]
    end = parameter.prior.support[right]
    if bound == possible and end == parameter.prior.ends[right]:
        return f"what is possible, {plain(bound, parameter.spec.unit)}"
    return PRIOR


def open_ends(after: FloatArray, before: FloatArray) -> tuple[bool, bool]:
    """Whether the marginal likelihood stays high at the left and at the right end of what was possible before.

    With `u` the place of a posterior draw `after` among the reference draws `before` (0 to 1), the density of `u` is
    the marginal likelihood up to a constant; its mean over each outer twentieth is compared with its peak over the
    deciles of the posterior.
    """
    ordered = np.sort(before)
    place = np.interp(after, ordered, (np.arange(ordered.size) + 0.5) / ordered.size)
    deciles = np.quantile(place, np.linspace(0.0, 1.0, 11))
    # A posterior far narrower than the spacing of the reference has no width here: its peak is infinite.
    narrowest = float(np.min(np.diff(deciles)))
    left, right = np.mean(place < EDGE) / EDGE, np.mean(place > 1.0 - EDGE) / EDGE
    return bool(left * narrowest > OPEN_SHARE * 0.1), bool(right * narrowest > OPEN_SHARE * 0.1)


def _tied_to(names: tuple[str, ...], correlation: FloatArray, column: int) -> str:
    row = np.abs(correlation[column]).copy()
    row[column] = 0.0
    partner = int(np.argmax(row))
    if row[partner] < TIED:
        return ""
    return f"; tied to {names[partner]} (correlation {correlation[column, partner]:.2f})"


def plain(value: float, unit: str) -> str:
    """A value with its unit, to three digits; thousands are written out."""
    return f"{float(f'{value:.3g}'):g} {unit}".rstrip()
