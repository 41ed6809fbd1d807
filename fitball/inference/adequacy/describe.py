"""Does the model describe the table? All checks, what lies farthest off, and the answer they add up to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, ndtr, ndtri, stdtr, stdtrit

from fitball.inference.adequacy.directions import Direction, directions
from fitball.inference.adequacy.loo_pit import LEFT_OUT
from fitball.inference.adequacy.looks import Look, family, farthest, spanned, standardised
from fitball.inference.adequacy.made_tables import look_at
from fitball.inference.adequacy.noise_size import noise_checks
from fitball.inference.adequacy.refit import EVERY, Refit, influence, refit
from fitball.inference.adequacy.words import (
    ALL,
    based_on,
    better_words,
    blind,
    check_words,
    noise_words,
    sentence,
    strongest,
)
from fitball.inference.problem.problem import Problem
from fitball.inference.results.adequacy import FALSE_EXCEPT, FALSE_FAILS, Adequacy, Answer, Check, Misfit, NoiseCheck
from fitball.inference.results.assumptions import Alternative, Assumptions
from fitball.inference.results.results import PointFit, Posterior
from fitball.inference.results.score_difference import SURE_ERRORS
from fitball.values import FloatArray

# Patterns have three fifths of the chance of a false alarm, the size of the noise two.
OF_PATTERNS, OF_NOISE = 5.0 / 3.0, 5.0 / 2.0
# A pattern smaller than this, in units of the noise, is no exception however many rows make it sure.
SMALL = 0.1
# A model fails whose noise is surely this multiple of what was stated or expected.
FAR_WORSE = 2.0
# A model fails where smooth patterns explain this share of a column's residual variance.
HALF = 0.5
# Patterns that count as the model's own: a group may be biased for reasons of its own.
SMOOTH = ("trend", "bend", "together", "regime", "bias", "row", "drift")
PATTERNS = (*SMOOTH, "group", "level")
# How choices of a kind of noise begin.
NOISE = "noise="
# Misfits that are told, and rows that a check names.
TOLD, NAMED_ROWS = 5, 6


def adequacy(
    problem: Problem,
    point: PointFit,
    posterior: Posterior | None,
    seed: int,
    assumptions: Assumptions | None = None,
) -> Adequacy:
    """Hold the residuals of a fit against those of tables that the fitted model makes, each refitted to first order,
    and its noise against what was stated or expected. Without a posterior there is no leaving out by importance.
    An alternative that a look at the `assumptions` scores surely better is an exception.
    """
    # The fourth of a run's streams: those before it are the point fit's, the priors' and the predictions'.
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(4)[3])
    fit = refit(problem, point)
    noise = noise_checks(problem, point, fit, OF_NOISE)
    found = directions(problem, point, fit)
    looked = look_at(problem, point, posterior, fit, found, rng)
    looks, left_out = looked.looks, looked.left_out
    made = f"{looked.tables:,} tables" + (f" of {looked.impacts:,} impacts" if looked.impacts < fit.impacts else "")
    checks: tuple[Check, ...] = ()
    unseen = dict.fromkeys(fit.columns, 1.0)
    if looks:
        p, level = family(looks)
        checks = tuple(
            _check(problem, fit, look, found, min(1.0, OF_PATTERNS * float(p[k]))) for k, look in enumerate(looks)
        )
        unseen = _unseen(fit, looks, level, noise)
    misfits = [_misfit(fit, look, found) for look, check in zip(looks, checks, strict=True) if check.p < FALSE_EXCEPT]
    moved = influence(fit, [misfit for misfit in misfits if misfit is not None])
    better = () if assumptions is None else surely_better(assumptions.alternatives)
    answer = _answer(fit, found, checks, noise, unseen, better)
    return Adequacy(
        answer=answer,
        sentence=sentence(problem, answer, noise, checks, unseen, moved, better),
        based_on=based_on(problem, noise, checks, unseen, made, posterior is not None),
        exceptions=(
            *(noise_words(check) for check in noise if check.found),
            *(check_words(check) for check in strongest(check for check in checks if check.found)),
            *(better_words(item) for item in better),
        ),
        noise=noise,
        checks=checks,
        misfits=largest_misfits(problem, point, fit),
        moved=moved,
        given=_given(problem, fit, checks, better),
        unseen=unseen,
        loo_pit={}
        if left_out is None or fit.impacts > LEFT_OUT
        else {name: tuple(left_out[k][fit.places[k]].tolist()) for k, name in enumerate(fit.columns)},
        replicates=looked.tables,
    )


def surely_better(alternatives: Sequence[Alternative]) -> tuple[Alternative, ...]:
    """Alternatives that score surely better than the fit itself. Of many closures the best scores better by chance,
    so each is held to the error of one among as many (Bonferroni); a kind of noise is one.
    """
    closures = sum(not item.name.startswith(NOISE) for item in alternatives)
    found = []
    for item in alternatives:
        among = 1 if item.name.startswith(NOISE) else closures
        errors = -float(ndtri(ndtr(-SURE_ERRORS) / among))
        if item.better and item.difference is not None and item.difference.value > errors * item.difference.se:
            found.append(item)
    return tuple(found)


def _check(problem: Problem, fit: Refit, look: Look, found: Sequence[Direction], p: float) -> Check:
    """A check as it is told; a pattern of a size that matters, or one that is none but sure, is `found`."""
    explained = abs(float(look.seen[0])) if look.kind in (*PATTERNS, "jointly") else None
    size = None
    if look.kind in PATTERNS:
        pattern = found[look.number]
        even = (fit.measured / fit.scales(fit.measured[None, :])[0, fit.noise])[None, :]
        size = abs(float(pattern.along(fit, even, even @ fit.own)[0])) / pattern.shape.size**0.5
    elif look.kind == "jointly" and explained is not None:
        size = (explained * len(fit.columns)) ** 0.5
    made = sorted(abs(float(value)) for value in look.seen[1:])
    return Check(
        kind=look.kind,
        column=ALL if look.column == EVERY else fit.columns[look.column],
        over=look.over,
        words=_words(problem, fit, look),
        statistic=float(look.seen[0]),
        usual=made[int(0.95 * len(made))],
        p=p,
        explained=explained,
        size=size,
        found=p < FALSE_EXCEPT and (size is None or size >= SMALL),
    )


def _words(problem: Problem, fit: Refit, look: Look) -> str:
    """What a check looked for, and how it came out: which rows, which way."""
    if look.column == EVERY and look.kind in PATTERNS:
        return look.words
    column = ALL if look.column == EVERY else fit.columns[look.column]
    if look.kind == "spread":
        return f"{column}: the noise {'grows' if look.seen[0] > 0.0 else 'falls'} with {look.over}"
    if look.kind == "outlier":
        places = fit.places[look.column][_farthest(fit, look.column)]
        ids = [problem.table.ids[place] for place in places[:NAMED_ROWS]]
        more = f" and {places.size - NAMED_ROWS} more" if places.size > NAMED_ROWS else ""
        which = f"impact {ids[0]} lies" if places.size == 1 else f"impacts {', '.join(ids)}{more} lie"
        return f"{column}: {which} far off"
    return f"{column} {look.words}" if look.kind == "bias" else f"{column}: {look.words}"


def _farthest(fit: Refit, column: int) -> NDArray[np.int64]:
    """Which of a column's measurements lie farthest off together, the farthest first: those of the group that the
    others show to be off (Rosner 1983).
    """
    own = distances(fit)[fit.rows(column)]
    freedom = float(fit.freedom[fit.noise_of(column)])
    count, _p = farthest(own[None, :], freedom)
    far = np.argsort(-np.abs(own), kind="stable")[: int(count[0])]
    off, spread = _left_out(fit, column, far)
    left = freedom - far.size
    noise = fit.noise == fit.noise_of(column)
    rest = fit.measured + fit.own @ (off @ fit.own[fit.rows(column)][far])
    rest[fit.starts[column] + far] -= off
    size = np.abs(off) / (spread * np.sqrt(np.sum(rest[noise] ** 2) / left))
    sure = 2.0 * own.size * stdtr(left, -size) < FALSE_EXCEPT
    return far[sure] if np.any(sure) else far[:1]


def _left_out(fit: Refit, column: int, far: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """By how much the measurements `far` of a column are off as a fit to all others has it, and the sds of that in
    units of the noise.
    """
    own = fit.own[fit.rows(column)][far]
    inverse = np.linalg.pinv(np.eye(far.size) - own @ own.T)
    return inverse @ fit.measured[fit.rows(column)][far], np.sqrt(np.diag(inverse))


def _misfit(fit: Refit, look: Look, found: Sequence[Direction]) -> FloatArray | None:
    """What the basis has (rank,) of what was found, as a part of the residuals before a refit; None of what is no
    part of them.
    """
    if look.kind in (*PATTERNS, "jointly"):
        mine = [found[look.number]] if look.kind in PATTERNS else [item for item in found if item.over == look.over]
        # Of all that act together the strongest: the others are known too badly to be taken out.
        direction = max(mine, key=lambda item: abs(_measured(fit, item)))
        return np.asarray(direction.taken * (_measured(fit, direction) / direction.length))
    if look.kind != "outlier":
        return None
    far = _farthest(fit, look.column)
    return np.asarray(_left_out(fit, look.column, far)[0] @ fit.own[fit.rows(look.column)][far])


def _measured(fit: Refit, direction: Direction) -> float:
    """How much of a pattern is in the residuals as measured."""
    return float(direction.along(fit, fit.measured[None, :], fit.taken[None, :])[0])


def _given(
    problem: Problem, fit: Refit, checks: Sequence[Check], better: Sequence[Alternative]
) -> dict[str, tuple[str, ...]]:
    """Fitted noises that heavy tails make larger, and the kind of noise that their sizes are given."""
    kind = f"{NOISE}{problem.noise.name}"
    if any(item.instead_of == kind for item in better):
        columns = set(fit.columns)
    else:
        columns = {check.column for check in checks if check.found and check.kind in ("outlier", "tails")}
    names = {fit.noises[fit.noise_of(k)] for k, name in enumerate(fit.columns) if name in columns}
    return {name: (kind,) for name in problem.free_names if name in names}


def _unseen(fit: Refit, looks: Sequence[Look], level: FloatArray, noise: Sequence[NoiseCheck]) -> dict[str, float]:
    """By column the least share of the residual variance that a trend, or a noise above the stated one, must explain
    to be found as often as not.
    """
    shares = {}
    for column, name in enumerate(fit.columns):
        freedom = fit.freedom[fit.noise_of(column)] - 1.0
        levels = [level[k] for k, look in enumerate(looks) if look.kind == "trend" and look.column == column]
        share = 1.0
        if levels:
            square = float(stdtrit(freedom, 0.5 * max(levels) / OF_PATTERNS)) ** 2
            share = square / (square + freedom)
        for check in noise:
            if check.stated and name in check.columns:
                limit = float(chdtri(check.degrees_of_freedom, FALSE_EXCEPT / OF_NOISE / len(noise)))
                share = min(share, 1.0 - min(1.0, check.degrees_of_freedom / limit))
        shares[name] = share
    return shares


def _answer(
    fit: Refit,
    found: Sequence[Direction],
    checks: Sequence[Check],
    noise: Sequence[NoiseCheck],
    unseen: dict[str, float],
    better: Sequence[Alternative],
) -> Answer:
    if any(check.adjusted < FALSE_FAILS and check.ratio >= FAR_WORSE for check in noise):
        return Answer.FAILS
    sure = [check for check in checks if check.kind in SMOOTH and check.p < FALSE_FAILS]
    columns = {check.column for check in sure} - {ALL}
    together = max((check.explained or 0.0 for check in sure if check.column == ALL), default=0.0)
    if max([together, *(explained(fit, found, fit.columns.index(name)) for name in columns)]) >= HALF:
        return Answer.FAILS
    if better or any(check.found for check in checks) or any(check.found for check in noise):
        return Answer.EXCEPT
    return Answer.UNTOLD if blind(unseen) else Answer.DESCRIBES


def explained(fit: Refit, found: Sequence[Direction], column: int) -> float:
    """Share of a column's residual variance that all smooth patterns explain together, beyond what as many
    meaningless ones would; that of the best alone where there are too many to say.
    """
    mine = [item for item in found if item.column == column and item.kind in SMOOTH]
    noise = fit.noise_of(column)
    even = (fit.measured / fit.scales(fit.measured[None, :])[0][fit.noise])[None, :]
    taken = even @ fit.own
    freedom = float(fit.freedom[noise])

    def share(patterns: Sequence[Direction]) -> float:
        square, rank = spanned(fit, patterns, even, taken)
        part = min(float(square[0]) / freedom, 1.0)
        return 1.0 - (1.0 - part) * freedom / (freedom - rank) if freedom - rank >= 1.0 else 0.0

    return max(share(mine), *(share([one]) for one in mine))


def distances(fit: Refit) -> FloatArray:
    """Each measurement's distance from its prediction by all others, in sds of that prediction (measurements,)."""
    own: FloatArray = standardised(fit, fit.measured[None, :])[0]
    return own


def largest_misfits(problem: Problem, point: PointFit, fit: Refit) -> tuple[Misfit, ...]:
    """The largest, farthest first."""
    far = distances(fit)
    columns = problem.all_values(np.array([[point.values[name] for name in problem.free_names]]))
    told = []
    for k in np.argsort(-np.abs(far), kind="stable")[:TOLD]:
        column = int(np.searchsorted(fit.starts, k, side="right")) - 1
        own = int(k - fit.starts[column])
        observable = problem.observables[column]
        gap = problem.deviation(columns, observable, point.rebound)[0]
        measured = float(observable.observed[own])
        told.append(
            Misfit(
                problem.table.ids[fit.places[column][own]], observable.name, observable.column.unit, measured,
                measured - float(gap[own]), float(far[k]),
            )
        )  # fmt: skip
    return tuple(told)
