"""Does the model describe the table? All checks, what lies farthest off, and the answer they add up to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri, stdtrit

from fitball.inference.adequacy.directions import Direction, directions
from fitball.inference.adequacy.loo_pit import LEFT_OUT
from fitball.inference.adequacy.looks import Look, family, spanned, standardised
from fitball.inference.adequacy.made_tables import look_at
from fitball.inference.adequacy.noise_size import noise_checks
from fitball.inference.adequacy.refit import Refit, influence, refit
from fitball.inference.adequacy.words import ALL, based_on, check_words, noise_words, sentence, strongest
from fitball.inference.problem.problem import Problem
from fitball.inference.results.adequacy import FALSE_EXCEPT, FALSE_FAILS, Adequacy, Answer, Check, Misfit, NoiseCheck
from fitball.inference.results.results import PointFit, Posterior
from fitball.values import FloatArray

# Patterns and the noise each have half of the chance of a false alarm.
SHARE = 2.0
# A pattern smaller than this, in units of the noise, is no exception however many rows make it sure.
SMALL = 0.1
# A model fails whose noise is surely this multiple of what was stated or expected.
FAR_WORSE = 2.0
# A model fails where smooth patterns explain this share of a column's residual variance.
HALF = 0.5
# Nothing can be told where a pattern that explains this share of the residual variance would not be found.
BLIND = 0.6
# Patterns that count as the model's own: a group may be biased for reasons of its own.
SMOOTH = ("trend", "bend", "together", "regime")
PATTERNS = (*SMOOTH, "group")
# Misfits that are told.
TOLD = 5


def adequacy(problem: Problem, point: PointFit, posterior: Posterior | None, seed: int) -> Adequacy:
    """Hold the residuals of a fit against those of tables that the fitted model makes, each refitted to first order,
    and its noise against what was stated or expected. Without a posterior there is no leaving out by importance.
    """
    # The fourth of a run's streams: those before it are the point fit's, the priors' and the predictions'.
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(4)[3])
    fit = refit(problem, point)
    noise = noise_checks(problem, point, fit, SHARE)
    found = directions(problem, point, fit)
    looked = look_at(problem, point, posterior, fit, found, rng)
    looks, left_out = looked.looks, looked.left_out
    made = f"{looked.tables:,} tables" + (f" of {looked.impacts:,} impacts" if looked.impacts < fit.impacts else "")
    checks: tuple[Check, ...] = ()
    unseen = dict.fromkeys(fit.columns, 1.0)
    if looks:
        p, level = family(looks)
        checks = tuple(_check(fit, look, found, min(1.0, SHARE * float(p[k]))) for k, look in enumerate(looks))
        unseen = _unseen(fit, looks, level, noise)
    misfits = [_misfit(fit, look, found) for look, check in zip(looks, checks, strict=True) if check.p < FALSE_EXCEPT]
    moved = influence(fit, [misfit for misfit in misfits if misfit is not None])
    answer = _answer(fit, found, checks, noise, unseen)
    return Adequacy(
        answer=answer,
        sentence=sentence(problem, answer, noise, checks, unseen, moved),
        based_on=based_on(problem, noise, checks, unseen, made, posterior is not None),
        exceptions=(
            *(noise_words(check) for check in noise if check.found),
            *(check_words(check) for check in strongest(check for check in checks if check.found)),
        ),
        noise=noise,
        checks=checks,
        misfits=largest_misfits(problem, point, fit),
        moved=moved,
        unseen=unseen,
        loo_pit={}
        if left_out is None or fit.impacts > LEFT_OUT
        else {name: tuple(left_out[k][fit.places[k]].tolist()) for k, name in enumerate(fit.columns)},
        replicates=looked.tables,
    )


def _check(fit: Refit, look: Look, found: Sequence[Direction], p: float) -> Check:
    """A check as it is told; a pattern of a size that matters, or one that is none but sure, is `found`."""
    explained = abs(float(look.seen[0])) if look.kind in (*PATTERNS, "jointly") else None
    size = None
    if look.kind in PATTERNS:
        scale = fit.scales(fit.measured[None, :])[0, fit.noise_of(look.column)]
        size = abs(_measured(fit, found[look.number])) / float(scale) / fit.places[look.column].size ** 0.5
    elif look.kind == "jointly" and explained is not None:
        size = (explained * len(fit.columns)) ** 0.5
    column = ALL if look.column < 0 else fit.columns[look.column]
    made = sorted(abs(float(value)) for value in look.seen[1:])
    return Check(
        kind=look.kind,
        column=column,
        over=look.over,
        words=f"{column}: {look.words}",
        statistic=float(look.seen[0]),
        usual=made[int(0.95 * len(made))],
        p=p,
        explained=explained,
        size=size,
        found=p < FALSE_EXCEPT and (size is None or size >= SMALL),
    )


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
    rows = np.arange(fit.measured.size)[fit.rows(look.column)]
    far = rows[np.argmax(np.abs(distances(fit)[rows]))]
    return np.asarray(fit.own[far] * (fit.measured[far] / (1.0 - fit.leverage[far])))


def _measured(fit: Refit, direction: Direction) -> float:
    """How much of a pattern is in the residuals as measured."""
    return float(direction.along(fit, fit.measured[None, :], fit.taken[None, :])[0])


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
            square = float(stdtrit(freedom, 0.5 * max(levels) / SHARE)) ** 2
            share = square / (square + freedom)
        for check in noise:
            if check.stated and name in check.columns:
                limit = float(chdtri(check.degrees_of_freedom, FALSE_EXCEPT / SHARE / len(noise)))
                share = min(share, 1.0 - min(1.0, check.degrees_of_freedom / limit))
        shares[name] = share
    return shares


def _answer(
    fit: Refit,
    found: Sequence[Direction],
    checks: Sequence[Check],
    noise: Sequence[NoiseCheck],
    unseen: dict[str, float],
) -> Answer:
    if any(check.adjusted < FALSE_FAILS and check.ratio >= FAR_WORSE for check in noise):
        return Answer.FAILS
    sure = {check.column for check in checks if check.kind in SMOOTH and check.p < FALSE_FAILS}
    if any(explained(fit, found, fit.columns.index(name)) >= HALF for name in sure):
        return Answer.FAILS
    if any(check.found for check in checks) or any(check.found for check in noise):
        return Answer.EXCEPT
    return Answer.UNTOLD if min(unseen.values()) > BLIND else Answer.DESCRIBES


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
