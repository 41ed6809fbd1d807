"""What values rest on that the data cannot test: choices changed one at a time, fitted and scored
to first order.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, NamedTuple

import msgspec
import numpy as np

from fitball.base.errors import FitballError, FitError
from fitball.base.numbers import fixed
from fitball.base.selection import evenly_spread, systematic
from fitball.base.values import FloatArray
from fitball.inference.density import cell_log_density, cell_slopes, log_posterior
from fitball.inference.effort import ALTERNATIVE_ROWS
from fitball.inference.judgement.first_order import proposal
from fitball.inference.judgement.laws import values_under
from fitball.inference.judgement.weights import counts
from fitball.inference.noise import NOISE_KINDS
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices, Problem, base_of
from fitball.inference.sampling.importance import RELIABLE_K, Student, importance, pareto_smoothed
from fitball.inference.schema import Alternative, Constant, PointFit, Summary
from fitball.inference.search.best_fit import raise_friction
from fitball.inference.search.objective import Objective, descend
from fitball.inference.summary import summarise
from fitball.models.model import Model
from fitball.models.registry import LAW_CHOICE, option_variants
from fitball.models.registry import model as model_of

# Impacts from which a difference of scores is used: of fewer its standard error is poorly known (of
# five to a third of itself). Chosen by hand.
LEAST_SCORED_IMPACTS = 6
# Standard errors by which a score is lower that is surely worse, or higher that is surely better.
WORSE_BY_ERRORS = 2.0
# Amount by which it is: on few observations the standard error is too small (Sivula et al. 2020).
WORSE_BY_SCORE = 4.0
# Sds by which a value moves that rests on a choice: then a 95 % interval misses the other value.
SHIFT_BY_CHOICE = 2.0
# Sds by which the median of a slope of restitution moves that rests on the law: laws differ in
# their slopes, and an interval that is off by one sd holds 83 % instead of 95.
SHIFT_BY_LAW = 1.0
# Slopes of restitution.
SLOPES = ("cor_slope", "cor_slope_median")
# Sds by which a value moves that rests on a constant over half of its range. Where that is two sds
# of the constant a 95 % interval then holds 92 %.
SHIFT_BY_CONSTANT = 1.0
# Optima of the fit from which each alternative is searched: the best may be another there. How
# many is chosen by hand.
FOLLOWED_OPTIMA = 2
# Quantiles of the priors of what is new in an alternative, from which it is searched: the median
# and one sd to either side.
NEW_PRIOR_QUANTILES = (0.16, 0.5, 0.84)
# Gain promised by a step from which first searches end: they show where to look further.
ROUGH_GAIN = 1e-2
# Gain promised by a step from which last searches end: far below WORSE_BY_SCORE.
FINE_GAIN = 1e-4
# Draws about the best of the first searches at which the density is looked at: some lie beyond the
# kinks that stop a search. How many is chosen by hand.
DRAWS_AROUND = 300
# The highest of these draws, from which is searched again. How many is chosen by hand.
SEARCHES_AGAIN = 3
# Draws at which the density is compared to see whether a choice acts at all: one that acts at none
# of them is not tried. How many is chosen by hand.
PROBE_DRAWS = 20
# Effective draws of an alternative. Of a normal distribution they give the median to 0.05 sds, and
# the ends of a 95 % interval to 0.1.
EFFECTIVE_DRAWS = 700.0
# Draws of equal weight by which an alternative is summarised: more than are effective, so that
# resampling adds less to the error than the draws have.
RESAMPLED_DRAWS = 1000
# What all values rest on where a choice could not be tried.
UNTRIED_MODEL = "model"


class FittedVariant(NamedTuple):
    """A fitted variant of a problem: its maximum `best` (coordinates,), a proposal about that, and
    as `scores` the log predictive density (impacts,) of each impact from the others.
    """

    problem: Problem
    best: FloatArray
    about: Student
    scores: FloatArray


def alternatives(
    problem: Problem,
    point: PointFit,
    rng: np.random.Generator,
) -> tuple[tuple[Alternative, ...], dict[str, Summary]]:
    """The fit with every single change that makes a difference, and by quantity the summaries of
    the fit itself by the same weighted draws, for comparison.

    Of more than ALTERNATIVE_ROWS so many rows, evenly spread, are used, on which the fit is made
    again. By how much an alternative lies beside that fit, and is wider, it does so of all rows.

    Raises:
        FitError: the fit itself has no answer on these rows (`no-answer`).
    """
    count = len(problem.rows.y)
    model = problem.forward.model
    rows = evenly_spread(count, ALTERNATIVE_ROWS)
    x = problem.coordinates(point.optima[0])
    base = fit_variant(problem.on_rows(rows), x[None], rng)
    wider = np.ones(x.size)
    if count > len(rows):
        sd_of_all = np.linalg.norm(proposal(problem, x).factor, axis=1)
        wider = sd_of_all / np.linalg.norm(base.about.factor, axis=1)
    moves = np.stack([x - base.best, wider], axis=1)
    to_all = dict(zip(problem.free, moves, strict=True))
    here = _compare("", "", base, base, to_all, rng)
    probes = np.vstack([base.best, _draws_about(base.problem, base.about, rng, PROBE_DRAWS)])
    density = log_posterior(base.problem, probes)
    tried = []
    changes = [*_single_changes(problem)]
    for choice, instead_of, choices, changed in changes:
        try:
            posed = build_problem(
                problem.table,
                problem.scene,
                choices,
                changed,
                problem.prior_texts,
            ).on_rows(rows)
            if posed.free == problem.free:
                changed_density = log_posterior(posed, probes)
                if np.array_equal(changed_density, density):
                    continue
            name, _, option = choice.partition("=")
            starts = search_starts(posed, point)
            if name == LAW_CHOICE:
                starts = _starts_of_law(option, posed, problem, point)
            there = fit_variant(posed, starts, rng)
            tried.append(_compare(choice, instead_of, base, there, to_all, rng))
        except FitballError as error:
            tried.append(_untried_alternative(choice, instead_of, changed, str(error)))
    # A law of restitution says nothing of the motion along the court, the noise nothing of either.
    if {choice.partition("=")[0] for choice, *_ in changes} <= {LAW_CHOICE, "noise"}:
        reason = "the model has no choices that could be changed"
        tried.append(_untried_alternative(UNTRIED_MODEL, model.text, model, reason))
    return tuple(tried), dict(here.summaries)


def _untried_alternative(choice: str, instead_of: str, model: Model, reason: str) -> Alternative:
    """An alternative that could not be tried, with the reason."""
    return Alternative(
        choice,
        instead_of,
        model.text,
        {},
        {},
        None,
        0.0,
        as_good=False,
        reason=reason,
    )


def _single_changes(problem: Problem) -> Iterator[tuple[str, str, Choices, Model]]:
    """Each single change of a choice: its name, what it replaces, all choices, and the model."""
    model = problem.forward.model
    noise = problem.forward.noise
    choices = problem.choices
    for text in option_variants(model):
        variant = model_of(text, ball=model.ball, tangential=model.tangential)
        name, option = next(
            (name, option)
            for name, option in variant.options.items()
            if option != model.options[name]
        )
        fitting = choices.for_model(text, [spec.name for spec in variant.parameters])
        changed = msgspec.structs.replace(fitting, noise=noise.name)
        yield f"{name}={option}", f"{name}={model.options[name]}", changed, variant
    gone = {spec.name for spec in noise.parameters}
    fix = {name: value for name, value in choices.fix.items() if name not in gone}
    prior = {name: text for name, text in choices.prior.items() if name not in gone}
    for kind in NOISE_KINDS:
        if kind != noise.name:
            changed = msgspec.structs.replace(choices, fix=fix, prior=prior, noise=kind)
            yield f"noise={kind}", f"noise={noise.name}", changed, model


def search_starts(posed: Problem, point: PointFit) -> FloatArray:
    """Coordinates (starts, coordinates) from which a variant is searched: the fit's best optima,
    with new parameters at quantiles of their priors, and the same with friction so high that all
    impacts grip.
    """
    levels = np.array(NEW_PRIOR_QUANTILES)
    blocks = []
    for values in point.optima[:FOLLOWED_OPTIMA]:
        block = np.empty((levels.size, len(posed.free)))
        for k, parameter in enumerate(posed.prior.parameters):
            name = posed.free[k]
            block[:, k] = values[name] if name in values else parameter.prior.quantile(levels)
        blocks.append(block)
    starts = posed.prior.coordinate(np.unique(np.concatenate(blocks), axis=0))
    gripped = raise_friction(posed, starts)[0]
    return np.unique(np.concatenate([starts, gripped]), axis=0)


def _starts_of_law(law: str, posed: Problem, problem: Problem, point: PointFit) -> FloatArray:
    """Coordinates (starts, coordinates) from which the variant `posed` of a fit with another law of
    restitution is searched: the fit's best optimum under that law, which acts on restitution alone.
    """
    values = values_under(law, problem, point.optima[0])
    return posed.coordinates(values)[None]


def _draws_about(
    problem: Problem, about: Student, rng: np.random.Generator, count: int
) -> FloatArray:
    """Draws (count, coordinates) about a maximum, moved to the bounds where they are beyond."""
    prior = problem.prior
    return np.clip(about.draw(rng, count), prior.low, prior.high)


def fit_variant(problem: Problem, starts: FloatArray, rng: np.random.Generator) -> FittedVariant:
    """The best fit of a variant. Kinks of the density stop a search: after searches from `starts`
    (starts, coordinates) others begin at the best of many draws about what these reach.

    Raises:
        FitError: no search reaches parameters with an answer (`no-answer`).
    """
    x, cost, _ = descend(Objective(problem), starts, ROUGH_GAIN)
    if not np.isfinite(cost.min()):
        text = f"no search of {problem.forward.model.text} found parameters with an answer"
        raise FitError(text, "no-answer")
    best = x[np.argmin(cost)]
    around = _draws_about(problem, proposal(problem, best), rng, DRAWS_AROUND)
    order = np.argsort(-log_posterior(problem, around), kind="stable")
    again = np.vstack([best, around[order[:SEARCHES_AGAIN]]])
    x, cost, _ = descend(Objective(problem), again, FINE_GAIN)
    best = x[np.argmin(cost)]
    about = proposal(problem, best)
    return FittedVariant(problem, best, about, leave_one_out_density(problem, about))


def leave_one_out_density(
    problem: Problem,
    about: Student,
) -> Annotated[FloatArray, "impacts"]:
    """The log predictive density of each impact from all others, to first order about a maximum.

    With slopes K of its residuals, gradient g of its log density and covariance C, without it the
    covariance is D = C + C K (1 - K'CK)^-1 K'C and the maximum moves by -D g. Over that normal
    distribution its density has the mean exp(-g'Dg/2) |1 - K'CK|^(1/2) of what it is at the maximum
    of all.
    """
    x = about.centre[None]
    noise = problem.forward.noise
    measured = np.isfinite(problem.rows.y)
    values = problem.values(x)
    cell, rate = cell_slopes(problem, x)
    residual, turn = noise.residual(cell.z, values)
    of_centre, of_scale = noise.information(values)
    rate_z = np.where(measured, rate.z[0], 0.0)
    rate_scale = np.where(measured, rate.log_sd[0], 0.0)
    gradient = -(rate_z * (residual * turn)[0] + rate_scale).sum(axis=2)
    pull = about.factor.T @ gradient
    # What a growing scale does to residuals is in its own information.
    centre = np.sqrt(of_centre[0]) * (rate_z + rate_scale * cell.z[0])
    scale = np.sqrt(of_scale[0]) * rate_scale
    weighted = np.concatenate([centre, scale], axis=2)
    weighted = np.tensordot(about.factor.T, weighted, 1)
    leverage = np.einsum("fik,fil->ikl", weighted, weighted)
    along = np.einsum("fik,fi->ik", weighted, pull)
    without = np.eye(along.shape[1]) - leverage
    further = np.linalg.solve(without, along[..., None])[..., 0]
    # g'Dg is g'Cg and what one impact less adds to it.
    square = (pull**2).sum(axis=0) + (along * further).sum(axis=1)
    fall = 0.5 * (square - np.linalg.slogdet(without)[1])
    density = cell_log_density(problem, cell, values)[0].sum(axis=1)
    return np.asarray(density - fall)


class ScoreGap(NamedTuple):
    """By how much a variant scores more than a fit, with standard `error`; None of few impacts.
    Whether it is surely `worse` or `better`.
    """

    score: float | None
    error: float
    worse: bool
    better: bool


def score_gap(base: FittedVariant, there: FittedVariant) -> ScoreGap:
    """The scores of a variant beside those of the fit `base` of the same rows."""
    gaps = there.scores - base.scores
    count = len(gaps)
    if count < LEAST_SCORED_IMPACTS:
        return ScoreGap(None, 0.0, worse=False, better=False)
    score = float(gaps.sum())
    error = float(np.sqrt(count) * np.std(gaps, ddof=1))
    sure = max(WORSE_BY_ERRORS * error, WORSE_BY_SCORE)
    return ScoreGap(score, error, worse=score < -sure, better=score > sure)


def _compare(
    choice: str,
    instead_of: str,
    base: FittedVariant,
    there: FittedVariant,
    to_all: Mapping[str, FloatArray],
    rng: np.random.Generator,
) -> Alternative:
    """A variant compared with the fit `base` of the same rows. For each parameter `to_all` has how
    far all rows move it, in coordinates, and the factor by which they widen it. A law of
    restitution that fits surely worse has no summaries: no value rests on it, and draws take time.

    Raises:
        FitError: the variant has no answer about its best values (`no-answer`), or its weighted
            draws are not reliable (`unreliable`).
    """
    posed = there.problem
    prior = there.problem.prior
    gap = score_gap(base, there)
    if gap.worse and choice.startswith(f"{LAW_CHOICE}="):
        best = {name: float(value[0]) for name, value in posed.values(there.best[None]).items()}
        text = posed.forward.model.text
        return Alternative(choice, instead_of, text, best, {}, gap.score, gap.error, as_good=False)
    x, log_weights, k = importance(
        lambda q: log_posterior(posed, q),
        [there.about],
        rng,
        EFFECTIVE_DRAWS,
    )
    if not len(x):
        text = f"{posed.forward.model.text} has no answer about its best values"
        raise FitError(text, "no-answer")
    if choice and k > RELIABLE_K:
        text = f"Pareto k is {fixed(k, 2)}, more than {RELIABLE_K}"
        raise FitError(f"its weighted draws are not reliable: {text}", "unreliable")
    weights = np.exp(pareto_smoothed(log_weights, 1.0)[0])
    x = x[systematic(weights, RESAMPLED_DRAWS, rng.uniform())]
    # New parameters are where, and as wide as, the chosen rows have them.
    move, wider = np.array([to_all.get(name, (0.0, 1.0)) for name in posed.free]).T
    deviation = np.vstack([there.best, x]) - there.best
    q = there.best + move + wider * deviation
    q = np.clip(q, prior.low, prior.high)
    values = {name: float(value[0]) for name, value in posed.values(q[:1]).items()}
    alike = posed.forward.noise.name == base.problem.forward.noise.name
    return Alternative(
        choice,
        instead_of,
        posed.forward.model.text,
        values,
        _summaries(posed, q, alike),
        gap.score,
        gap.error,
        not gap.worse,
        better=gap.better,
    )


def _summaries(problem: Problem, q: FloatArray, alike: bool) -> dict[str, Summary]:
    """Summaries of free parameters and derived quantities by the coordinates `q` (1 + draws,
    coordinates) of the maximum and of draws. Parameters of the noise are left out where its kind
    is not `alike`: the scale of another kind is another quantity.
    """
    values = problem.values(q)
    unlike = frozenset() if alike else problem.noises
    columns = {name: values[name] for name in problem.free if name not in unlike}
    for quantity in problem.derived:
        columns[quantity.spec.name] = quantity.rule(values)
    return {name: summarise(column[1:], float(column[0])) for name, column in columns.items()}


def what_values_rest_on(
    tried: Sequence[Alternative],
    held: Sequence[Constant],
    fit: Mapping[str, Summary],
) -> dict[str, tuple[str, ...]]:
    """For each quantity the choices and constants that it rests on, the strongest first.

    These are choices that move its median, or an end of its 95 % interval outwards, by 2 sds, of a
    slope of restitution laws that move it by 1 sd, unless they fit surely worse or are improbable
    beside the fit, and constants that move it by 1 sd over half of their range. Where a choice
    could not be tried all quantities rest on the `model`.
    """
    moves = [
        (abs(shift), name, constant.name)
        for constant in held
        for name, shift in constant.moves.items()
        if abs(shift) > SHIFT_BY_CONSTANT
    ]
    for alternative in tried:
        if not (alternative.as_good and counts(alternative)):
            continue
        for name in fit.keys() & alternative.summaries.keys():
            here = fit[name]
            there = alternative.summaries[name]
            by_median = abs(there.median - here.median)
            of_law = alternative.choice.startswith(f"{LAW_CHOICE}=")
            if of_law and base_of(name) in SLOPES:
                by_median *= SHIFT_BY_CHOICE / SHIFT_BY_LAW
            shift = max(by_median, here.q025 - there.q025, there.q975 - here.q975)
            if shift > SHIFT_BY_CHOICE * here.half:
                moves.append((shift / here.half, name, alternative.instead_of))
    rests: dict[str, dict[str, None]] = {name: {} for name in fit}
    for _, name, text in sorted(moves, reverse=True):
        if name in rests:
            rests[name][text] = None
    untried = (UNTRIED_MODEL,) if any(alternative.reason for alternative in tried) else ()
    return {name: (*texts, *untried) for name, texts in rests.items() if texts or untried}
