"""What values rest on that the data cannot test: choices changed one at a time, fitted and scored
to first order.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from fitball.base.errors import FitballError, FitError
from fitball.base.numbers import fixed
from fitball.base.selection import evenly_spread
from fitball.base.values import FloatArray
from fitball.data.table import SPIN_CHOICE, UNKNOWN_SPIN_SD
from fitball.inference.density import log_posterior
from fitball.inference.effort import ALTERNATIVE_ROWS
from fitball.inference.judgement.first_order import proposal
from fitball.inference.judgement.laws import values_under
from fitball.inference.judgement.variant_draws import (
    Drawn,
    Weighed,
    corrected,
    first_draws,
    more_draws,
    weighed,
)
from fitball.inference.judgement.variants import (
    FittedVariant,
    ScoreGap,
    draws_about,
    fit_variant,
    score_gap,
)
from fitball.inference.judgement.weights import counts
from fitball.inference.noise import NOISE_KINDS
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices, Problem, base_of
from fitball.inference.sampling.importance import RELIABLE_K
from fitball.inference.schema import Alternative, Constant, Judgement, PointFit, Summary
from fitball.inference.search.limits import raise_friction
from fitball.models.model import Model
from fitball.models.registry import LAW_CHOICE, option_variants
from fitball.models.registry import model as model_of

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
# Draws at which the density is compared to see whether a choice acts at all: one that acts at none
# of them is not tried. How many is chosen by hand.
PROBE_DRAWS = 20
# Step of the grid of coordinates from which variants are searched, in widths of the priors.
# Searches by several seeds end a hundredth of it apart.
GRID = 0.01
# Effective draws of an alternative at first. Of a normal distribution they give the median to 0.07
# sds, and the ends of a 95 % interval to 0.15, twice that by FIRST_ERRORS: most moves are further
# from the limit.
EFFECTIVE_DRAWS = 500.0
# Effective draws of the fit, with which all alternatives are compared, and where a move is not
# surely above or below the limit.
EFFECTIVE_OF_FIT = 2_000.0
EFFECTIVE_WHERE_UNSURE = 4_000.0
# Effective draws of an alternative at most, and bounces for them: a long table has fewer draws.
MOST_EFFECTIVE = 4_000.0
MOST_BOUNCES = 5e5
# Factor by which there are more draws, at least, where a move is not surely above or below the
# limit.
MORE_DRAWS = 3.0
# Monte Carlo errors from the limit beyond which a move is surely above or below it.
SURE_BY_ERRORS = 2.0
# Monte Carlo error of a move, in sds, below which it is known well: a fortieth of the limit.
MOVE_ERROR = 0.05
# What all values rest on where a choice could not be tried.
UNTRIED_MODEL = "model"
# Where no incident spin was measured: the sd of spins [rad/s] is a choice too. Strokes of topspin
# spin three times as fast as the usual sd.
OTHER_SPIN_SD = 3.0 * UNKNOWN_SPIN_SD
OTHER_SPINS = f"{SPIN_CHOICE}={OTHER_SPIN_SD:g}"
# Where quantities were not judged.
NONE_JUDGED: Mapping[str, Judgement] = {}


def alternatives(
    problem: Problem,
    point: PointFit,
    rng: np.random.Generator,
    judged: Mapping[str, Judgement] = NONE_JUDGED,
) -> tuple[tuple[Alternative, ...], dict[str, Summary]]:
    """The fit with every single change that makes a difference, and by quantity the summaries of
    the fit itself by weighted draws, for comparison. Where the move of a quantity that is `judged`
    to be identified is near the limit there are more draws.

    Of more than ALTERNATIVE_ROWS so many rows, evenly spread, are used, on which the fit is made
    again. By how much an alternative lies beside that fit, and is wider, it does so of all rows.

    Raises:
        FitError: the fit itself has no answer on these rows (`no-answer`).
    """
    count = len(problem.rows.y)
    model = problem.forward.model
    rows = evenly_spread(count, ALTERNATIVE_ROWS)
    x = problem.coordinates(point.optima[0])
    point = _on_grid(problem, point)
    start = problem.coordinates(point.optima[0])[None]
    base = fit_variant(problem.on_rows(rows), start, rng)
    to_all = _beside_all(problem, x, base)
    most = max(EFFECTIVE_DRAWS, min(MOST_EFFECTIVE, MOST_BOUNCES / len(rows)))
    identified = {name for name, found in judged.items() if found.verdict == "identified"}
    given = {name for name, found in judged.items() if found.verdict == "given"}
    fit = _Fit(base, to_all, {}, frozenset(identified), frozenset(given), most)
    drawn = _some_draws(base, rng, min(EFFECTIVE_OF_FIT, most))
    fit = fit._replace(weighed=_weighed_draws(fit, base, drawn)[1])
    probes = np.vstack([base.best, draws_about(base.problem, base.about, rng, PROBE_DRAWS)])
    density = log_posterior(base.problem, probes)
    tried = list[Alternative | _Variant]()
    changes = [*_single_changes(problem)]
    # Each has its own random numbers: what is done with one leaves the others as they are.
    streams = rng.spawn(len(changes))
    for (choice, instead_of, choices, changed), stream in zip(changes, streams, strict=True):
        try:
            posed = _posed(problem, choice, choices, changed).on_rows(rows)
            if posed.free == problem.free:
                changed_density = log_posterior(posed, probes)
                if np.array_equal(changed_density, density):
                    continue
            name, _, option = choice.partition("=")
            starts = search_starts(posed, point)
            if name == LAW_CHOICE:
                starts = _starts_of_law(option, posed, problem, point)
            there = fit_variant(posed, starts, stream, base)
            tried.append(_first_look(choice, instead_of, fit, there, stream))
        except FitballError as error:
            tried.append(_untried_alternative(choice, instead_of, changed, str(error)))
    # A law of restitution says nothing of the motion along the court, and the others nothing of the
    # model.
    if {choice.partition("=")[0] for choice, *_ in changes} <= {LAW_CHOICE, SPIN_CHOICE, "noise"}:
        reason = "the model has no choices that could be changed"
        tried.append(_untried_alternative(UNTRIED_MODEL, model.text, model, reason))
    variants = [variant for variant in tried if isinstance(variant, _Variant)]
    unsure = any(_unsure_moves(fit, variant, fit.identified) for variant in variants)
    if most > EFFECTIVE_OF_FIT and unsure:
        drawn = more_draws(base, drawn, rng, min(EFFECTIVE_WHERE_UNSURE, most))
        fit = fit._replace(weighed=_weighed_draws(fit, base, drawn)[1])
    compared = tuple(
        _compare(fit, variant, rng) if isinstance(variant, _Variant) else variant
        for variant in tried
    )
    return compared, {name: here.summary for name, here in fit.weighed.items()}


def _posed(problem: Problem, choice: str, choices: Choices, changed: Model) -> Problem:
    """The problem with one choice changed: all choices and the model are then these."""
    table = problem.table
    if choice == OTHER_SPINS:
        table = table.with_unknown_spins(OTHER_SPIN_SD)
    return build_problem(table, problem.scene, choices, changed, problem.prior_texts)


def _beside_all(
    problem: Problem,
    x: FloatArray,
    base: FittedVariant,
) -> dict[str, FloatArray]:
    """By name of each free parameter how far the maximum `x` (coordinates,) of all rows lies beside
    that of the rows of `base`, and how much wider it is.
    """
    wider = np.ones(x.size)
    if len(problem.rows.y) > len(base.problem.rows.y):
        sd_of_all = np.linalg.norm(proposal(problem, x).factor, axis=1)
        wider = sd_of_all / np.linalg.norm(base.about.factor, axis=1)
    moves = np.stack([x - base.best, wider], axis=1)
    return dict(zip(problem.free, moves, strict=True))


def _on_grid(problem: Problem, point: PointFit) -> PointFit:
    """The best fit with its optima on a grid of coordinates. Searches of several seeds end a
    millionth apart, and from there searches of a variant that stop at kinks end elsewhere: from
    the grid they are the same. An optimum whose neighbour there has no answer stays.
    """
    prior = problem.prior
    step = GRID * prior.width
    q = np.array([problem.coordinates(values) for values in point.optima])
    near = np.clip(step * np.round(q / step), prior.low, prior.high)
    q = np.where(np.isfinite(log_posterior(problem, near))[:, None], near, q)
    columns = {name: column.tolist() for name, column in problem.values(q).items()}
    optima = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return msgspec.structs.replace(point, optima=tuple(optima))


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
    if model.tangential and "omega_1" not in problem.table.values:
        yield OTHER_SPINS, f"{SPIN_CHOICE}={UNKNOWN_SPIN_SD:g}", choices, model


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


class _Fit(NamedTuple):
    """What variants are compared with: the fit `base` of the same rows, and what its draws say of
    each quantity. For each parameter `to_all` has how far all rows move it, in coordinates, and the
    factor by which they widen it. Moves of `identified` quantities are precise, with `most`
    effective draws at most; of those `given` something else it is said where they are not.
    """

    base: FittedVariant
    to_all: Mapping[str, FloatArray]
    weighed: Mapping[str, Weighed]
    identified: frozenset[str]
    given: frozenset[str]
    most: float


def _some_draws(variant: FittedVariant, rng: np.random.Generator, enough: float) -> Drawn:
    """The first draws of a variant. Raises FitError (`no-answer`) where there are none."""
    drawn = first_draws(variant, rng, enough)
    if not len(drawn.x):
        text = variant.problem.forward.model.text
        raise FitError(f"{text} has no answer about its best values", "no-answer")
    return drawn


class _Variant(NamedTuple):
    """A variant by a `choice`, with its score beside the fit's (`gap`), draws, and what these say:
    its best `values` by name, and each quantity.
    """

    choice: str
    instead_of: str
    there: FittedVariant
    gap: ScoreGap
    drawn: Drawn
    values: Mapping[str, float]
    weighed: Mapping[str, Weighed]


def _first_look(
    choice: str,
    instead_of: str,
    fit: _Fit,
    there: FittedVariant,
    rng: np.random.Generator,
) -> Alternative | _Variant:
    """A variant with its first draws. One that fits surely worse has none, and no summaries: no
    value rests on it, and draws take time.

    Raises:
        FitError: the variant has no answer about its best values (`no-answer`), or its weighted
            draws are not reliable (`unreliable`).
    """
    posed = there.problem
    gap = score_gap(fit.base, there)
    if gap.worse:
        best = {name: float(value[0]) for name, value in posed.values(there.best[None]).items()}
        text = posed.forward.model.text
        return Alternative(choice, instead_of, text, best, {}, gap.score, gap.error, as_good=False)
    drawn = _some_draws(there, rng, EFFECTIVE_DRAWS)
    for enough in (MORE_DRAWS * EFFECTIVE_DRAWS, fit.most):
        if not drawn.reliable:
            drawn = more_draws(there, drawn, rng, enough)
    if not drawn.reliable:
        text = f"Pareto k is {fixed(drawn.k, 2)}, more than {RELIABLE_K}"
        raise FitError(f"its weighted draws are not reliable: {text}", "unreliable")
    return _Variant(choice, instead_of, there, gap, drawn, *_weighed_draws(fit, there, drawn))


def _compare(fit: _Fit, variant: _Variant, rng: np.random.Generator) -> Alternative:
    """A variant compared with the fit. There are more draws until each move of an identified
    quantity is surely above or below the limit, or known well.
    """
    enough = EFFECTIVE_DRAWS
    unsure = _unsure_moves(fit, variant, fit.identified)
    while enough < fit.most and any(error > MOVE_ERROR for _, error in unsure.values()):
        enough = min(fit.most, max(MORE_DRAWS, _missing_factor(unsure)) * enough)
        drawn = more_draws(variant.there, variant.drawn, rng, enough)
        values, found = _weighed_draws(fit, variant.there, drawn)
        variant = variant._replace(drawn=drawn, values=values, weighed=found)
        unsure = _unsure_moves(fit, variant, fit.identified)
    gap = variant.gap
    return Alternative(
        variant.choice,
        variant.instead_of,
        variant.there.problem.forward.model.text,
        variant.values,
        {name: found.summary for name, found in variant.weighed.items()},
        gap.score,
        gap.error,
        not gap.worse,
        better=gap.better,
        unsure=unsure,
        unsure_given=_unsure_moves(fit, variant, fit.given),
    )


def _missing_factor(unsure: Mapping[str, tuple[float, float]]) -> float:
    """The factor by which there must be more draws for each unsure move to be surely above or below
    the limit, or known well: errors fall with the root of their number.
    """
    return max(
        (error / max(MOVE_ERROR, abs(size - SHIFT_BY_CHOICE) / SURE_BY_ERRORS)) ** 2
        for size, error in unsure.values()
    )


def _unsure_moves(
    fit: _Fit,
    variant: _Variant,
    names: frozenset[str],
) -> dict[str, tuple[float, float]]:
    """The moves of quantities of these names by a variant that may lie on either side of the limit,
    and their Monte Carlo errors, in sds. No value rests on a variant that fits surely worse.
    """
    if variant.gap.worse:
        return {}
    unsure = {}
    for name in sorted(names & fit.weighed.keys() & variant.weighed.keys()):
        here = fit.weighed[name]
        there = variant.weighed[name]
        move = moved_by(variant.choice, name, here.summary, there.summary)
        of_ends = np.hypot(getattr(here, move.of), getattr(there, move.of))
        error = float(np.hypot(move.scale * of_ends, move.size * here.half)) / here.summary.half
        if abs(move.size - SHIFT_BY_CHOICE) <= SURE_BY_ERRORS * error:
            unsure[name] = (move.size, error)
    return unsure


def _weighed_draws(
    fit: _Fit,
    variant: FittedVariant,
    drawn: Drawn,
) -> tuple[dict[str, float], dict[str, Weighed]]:
    """The best values of a variant by name, and what its draws say of free parameters and derived
    quantities, both as all rows have them. Parameters of the noise are left out where its kind is
    not that of the fit: the scale of another kind is another quantity. So are quantities of held
    values alone, which nothing moves.
    """
    posed = variant.problem
    prior = posed.prior
    # New parameters are where, and as wide as, the chosen rows have them.
    move, wider = np.array([fit.to_all.get(name, (0.0, 1.0)) for name in posed.free]).T
    x = np.vstack([variant.best, drawn.x, drawn.compared])
    q = np.clip(variant.best + move + wider * (x - variant.best), prior.low, prior.high)
    values = posed.values(q)
    alike = posed.forward.noise.name == fit.base.problem.forward.noise.name
    unlike = frozenset() if alike else posed.noises
    columns = {name: values[name] for name in posed.free if name not in unlike}
    for quantity in posed.derived:
        column = quantity.rule(values)
        if np.unique(column).size > 1:
            columns[quantity.spec.name] = column
    count = 1 + len(drawn.x)
    found = {}
    for name, column in columns.items():
        found[name] = weighed(
            column[1:count],
            np.exp(drawn.log_weights),
            float(column[0]),
            drawn.optimism,
        )
        if len(drawn.compared):
            found[name] = corrected(found[name], column[count:], drawn.exact_weights)
    best = {name: float(value[0]) for name, value in values.items()}
    return best, found


class Move(NamedTuple):
    """By how many sds a choice moves a quantity, times a `scale` with which 2 is the limit, and
    what moves: its `median`, or the end `q025` or `q975` of its 95 % interval outwards.
    """

    size: float
    of: str
    scale: float


def moved_by(choice: str, name: str, here: Summary, there: Summary) -> Move:
    """The largest move of a quantity by a choice, from its summary in the fit `here`."""
    of_law = choice.startswith(f"{LAW_CHOICE}=") and base_of(name) in SLOPES
    scale = SHIFT_BY_CHOICE / SHIFT_BY_LAW if of_law else 1.0
    moves = (
        Move(scale * abs(there.median - here.median), "median", scale),
        Move(here.q025 - there.q025, "q025", 1.0),
        Move(there.q975 - here.q975, "q975", 1.0),
    )
    largest = max(moves, key=lambda move: move.size)
    return largest._replace(size=largest.size / here.half)


def what_values_rest_on(
    tried: Sequence[Alternative],
    held: Sequence[Constant],
    fit: Mapping[str, Summary],
) -> dict[str, tuple[str, ...]]:
    """For each quantity the choices and constants that it rests on, the strongest first.

    These are choices that move its median, or an end of its 95 % interval outwards, by 2 sds, of a
    slope of restitution laws that move it by 1 sd, unless they fit surely worse or are improbable
    beside the fit, and constants that move it by 1 sd over half of their range. A move that draws
    do not show to be below the limit counts too. Where a choice could not be tried all quantities
    rest on the `model`.
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
            move = moved_by(alternative.choice, name, fit[name], alternative.summaries[name])
            if move.size > SHIFT_BY_CHOICE or name in alternative.unsure:
                moves.append((move.size, name, alternative.instead_of))
    rests: dict[str, dict[str, None]] = {name: {} for name in fit}
    for _, name, text in sorted(moves, reverse=True):
        if name in rests:
            rests[name][text] = None
    untried = (UNTRIED_MODEL,) if any(alternative.reason for alternative in tried) else ()
    return {name: (*texts, *untried) for name, texts in rests.items() if texts or untried}
