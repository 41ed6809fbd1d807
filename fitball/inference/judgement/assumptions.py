"""What values rest on that the data cannot test: choices changed one at a time, fitted and scored
to first order.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from fitball.base.errors import FitballError, FitError
from fitball.base.numbers import fixed
from fitball.base.selection import evenly_spread, systematic
from fitball.base.values import FloatArray
from fitball.inference.density import log_posterior, slopes, terms
from fitball.inference.effort import ALTERNATIVES
from fitball.inference.judgement.first_order import proposal
from fitball.inference.noise import KINDS
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices, Problem
from fitball.inference.sampling.importance import RELIABLE, Student, importance, smoothed
from fitball.inference.schema import Alternative, Constant, PointFit, Summary
from fitball.inference.search.best_fit import gripping
from fitball.inference.search.objective import Objective, descend
from fitball.inference.summary import summarise
from fitball.models.model import Model
from fitball.models.registry import model as model_of
from fitball.models.registry import variants

# Impacts below which a score means nothing; sds, and size, from which a difference of scores is
# sure (Sivula et al. 2020, who find the standard error too small on few observations).
FEW = 6
SURE_ERRORS = 2.0
SURE_SIZE = 4.0
# Sds by which a value moves that rests on a choice, or on a constant over half of its range: then a
# 95 % interval misses the other value, or holds 92 %.
MOVED = 2.0
MOVED_BY_CONSTANT = 1.0
# Optima of the fit from which each alternative is searched, with these quantiles of the priors of
# what is new in it.
FOLLOWED = 2
QUANTILES = (0.16, 0.5, 0.84)
# Gain promised by a step from which searches end: at first, and at last. Between them places about
# what was found are looked at, and the best of them are searched from too.
ROUGH = 1e-2
FINE = 1e-4
AROUND = 300
AGAIN = 3
# Draws at which it is seen whether a choice acts at all; effective draws and draws of an
# alternative, whose median is then known to 0.06 sds, and the ends of its interval to 0.15.
PROBES = 20
EFFECTIVE = 700.0
DRAWS = 1000
# What all values rest on where a choice could not be tried.
MODEL = "model"


class _Fitted(NamedTuple):
    """A problem, its maximum (free,), a proposal about it, and the log density (impacts,) of each
    impact left out.
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
    """Every single change that makes a difference, and what the fit itself says in the same way, by
    weighted draws, so that `given` compares like with like and needs no chain. Of more than
    ALTERNATIVES rows a part, evenly spread, on which the fit is made again: by how much an
    alternative lies beside that, and is wider, it does so of all rows. Raises FitError
    (`no-answer`).
    """
    count = len(problem.rows.y)
    now = problem.forward.model
    rows = evenly_spread(count, ALTERNATIVES)
    x = problem.coordinates(point.optima[0])
    own = _fitted(problem.part(rows), x[None], rng)
    wider = np.ones(x.size)
    if count > len(rows):
        wider = np.linalg.norm(proposal(problem, x).factor, axis=1) / np.linalg.norm(
            own.about.factor,
            axis=1,
        )
    to_all = dict(zip(problem.free, np.stack([x - own.best, wider], axis=1), strict=True))
    here = _compared("", "", own, own, to_all, rng)
    probes = np.vstack([own.best, _draws(own.problem, own.about, rng, PROBES)])
    found = []
    for choice, instead_of, choices, model in _changes(problem):
        try:
            posed = build_problem(problem.table, problem.scene, choices, model, problem.known).part(
                rows
            )
            acts = posed.free != problem.free or not np.array_equal(
                log_posterior(posed, probes),
                log_posterior(own.problem, probes),
            )
            if acts:
                there = _fitted(posed, _starts(posed, point), rng)
                found.append(_compared(choice, instead_of, own, there, to_all, rng))
        except FitballError as error:
            found.append(_untried(choice, instead_of, model, str(error)))
    if not variants(now):
        found.append(
            _untried(MODEL, now.text, now, "the model has no choices that could be changed")
        )
    return tuple(found), dict(here.summaries)


def _untried(choice: str, instead_of: str, model: Model, reason: str) -> Alternative:
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


def _changes(problem: Problem) -> Iterator[tuple[str, str, Choices, Model]]:
    """Name, what it replaces, choices and model of each single change."""
    now = problem.forward.model
    noise = problem.forward.noise
    own = problem.choices
    for text in variants(now):
        model = model_of(text, ball=now.ball, tangential=now.tangential)
        choice = next(name for name, option in model.options.items() if option != now.options[name])
        fitting = own.fitting(text, [spec.name for spec in model.parameters])
        kept = Choices(text, fitting.fix, fitting.prior, fitting.pool, noise.name)
        yield f"{choice}={model.options[choice]}", f"{choice}={now.options[choice]}", kept, model
    gone = {spec.name for spec in noise.parameters}
    fix = {name: value for name, value in own.fix.items() if name not in gone}
    prior = {name: text for name, text in own.prior.items() if name not in gone}
    for kind in KINDS:
        if kind != noise.name:
            yield (
                f"noise={kind}",
                f"noise={noise.name}",
                Choices(own.model, fix, prior, own.pool, kind),
                now,
            )


def _starts(posed: Problem, point: PointFit) -> FloatArray:
    """Coordinates (starts, free): the fit's best optima, what is new at quantiles of its prior; and
    the same with friction so high that all grips.
    """
    rows = [
        [
            values[name]
            if name in values
            else float(item.prior.value(item.prior.quantile(np.array([level])))[0])
            for name, item in zip(posed.free, posed.prior.parameters, strict=True)
        ]
        for values in point.optima[:FOLLOWED]
        for level in QUANTILES
    ]
    starts = posed.prior.coordinate(np.unique(np.array(rows), axis=0))
    return np.unique(np.concatenate([starts, gripping(posed, starts)[0]]), axis=0)


def _draws(problem: Problem, about: Student, rng: np.random.Generator, count: int) -> FloatArray:
    """Coordinates (count, free) about a maximum, within the bounds, at which a scatter may lie."""
    return np.clip(about.draw(rng, count), problem.prior.low, problem.prior.high)


def _fitted(problem: Problem, starts: FloatArray, rng: np.random.Generator) -> _Fitted:
    """The best that searches from `starts` (starts, free) reach, and those from the best of many
    places about that: kinks of the density stop a search. Raises FitError (`no-answer`).
    """
    found, cost, _ = descend(Objective(problem), starts, ROUGH)
    if not np.isfinite(cost.min()):
        raise FitError(
            f"no search of {problem.forward.model.text} found parameters with an answer",
            "no-answer",
        )
    best = found[np.argmin(cost)]
    around = _draws(problem, proposal(problem, best), rng, AROUND)
    highest = np.argsort(-log_posterior(problem, around), kind="stable")[:AGAIN]
    found, cost, _ = descend(Objective(problem), np.vstack([best, around[highest]]), FINE)
    best = found[np.argmin(cost)]
    about = proposal(problem, best)
    return _Fitted(problem, best, about, left_out(problem, about))


def left_out(problem: Problem, about: Student) -> FloatArray:
    """Log predictive density (impacts,) of each impact from all others, to first order.

    With slopes K of its residuals, gradient g of its log density and covariance C, without it the
    covariance is D = C + C K (1 - K'CK)^-1 K'C and the maximum moves by -D g. Over that normal
    distribution its density has the mean exp(-g'Dg/2) |1 - K'CK|^(1/2) of what it is at the maximum
    of all.
    """
    x = about.centre[None]
    noise = problem.forward.noise
    measured = np.isfinite(problem.rows.y)
    values = problem.values(x)
    made, rate = slopes(problem, x)
    residual, turn = noise.residual(made.z, values)
    centre, scale = (np.sqrt(one[0]) for one in noise.information(values))
    gain, growth = (np.where(measured, one[0], 0.0) for one in (rate.z, rate.log_sd))
    pull = about.factor.T @ -(gain * (residual * turn)[0] + growth).sum(axis=2)
    # What a growing scale does to residuals is in its own information.
    known = np.concatenate([centre * (gain + growth * made.z[0]), scale * growth], axis=2)
    known = np.tensordot(about.factor.T, known, 1)
    leverage = np.einsum("fik,fil->ikl", known, known)
    along = np.einsum("fik,fi->ik", known, pull)
    without = np.eye(along.shape[1]) - leverage
    further = np.linalg.solve(without, along[..., None])[..., 0]
    fall = 0.5 * (
        (pull**2).sum(axis=0) + (along * further).sum(axis=1) - np.linalg.slogdet(without)[1]
    )
    return np.asarray(terms(problem, made, values)[0].sum(axis=1) - fall)


def _compared(
    choice: str,
    instead_of: str,
    own: _Fitted,
    there: _Fitted,
    to_all: Mapping[str, FloatArray],
    rng: np.random.Generator,
) -> Alternative:
    """An alternative beside the fit, both of the same rows. Raises FitError (`no-answer`,
    `unreliable`).
    """
    posed = there.problem
    prior = there.problem.prior
    count = len(own.scores)
    x, log_weights, k = importance(lambda q: log_posterior(posed, q), [there.about], rng, EFFECTIVE)
    if not len(x):
        raise FitError(
            f"{posed.forward.model.text} has no answer about its best values",
            "no-answer",
        )
    if choice and k > RELIABLE:
        text = (
            f"its weighted draws are not reliable: Pareto k is {fixed(k, 2)}, more than {RELIABLE}"
        )
        raise FitError(text, "unreliable")
    x = x[systematic(np.exp(smoothed(log_weights, 1.0)[0]), DRAWS, rng.uniform())]
    # What is new is where it is, and as wide, on the part.
    move, wider = np.array([to_all.get(name, (0.0, 1.0)) for name in posed.free]).T
    q = there.best + move + wider * (np.vstack([there.best, x]) - there.best)
    q = np.clip(q, prior.low, prior.high)
    gaps = there.scores - own.scores
    score = None
    error = 0.0
    if count >= FEW:
        score = float(gaps.sum())
        error = float(np.sqrt(count) * np.std(gaps, ddof=1))
    worse = score is not None and -score > max(SURE_ERRORS * error, SURE_SIZE)
    values = {name: float(one[0]) for name, one in posed.values(q[:1]).items()}
    alike = posed.forward.noise.name == own.problem.forward.noise.name
    return Alternative(
        choice,
        instead_of,
        posed.forward.model.text,
        values,
        _summaries(posed, q, alike),
        score,
        error,
        not worse,
    )


def _summaries(problem: Problem, q: FloatArray, alike: bool) -> dict[str, Summary]:
    """Of free parameters and what follows from them, by draws after the maximum, `q` (1 + draws,
    free); the scale of another kind of noise is another quantity.
    """
    values = problem.values(q)
    unlike = frozenset() if alike else problem.noises
    found = {name: values[name] for name in problem.free if name not in unlike}
    found |= {one.spec.name: one.rule(values) for one in problem.derived}
    return {name: summarise(column[1:], float(column[0])) for name, column in found.items()}


def given(
    found: tuple[Alternative, ...],
    held: tuple[Constant, ...],
    fit: Mapping[str, Summary],
) -> dict[str, tuple[str, ...]]:
    """By quantity the choices and constants that it rests on, the strongest first: choices that
    move its median, or an end of its 95 % interval outwards, by 2 sds, unless surely worse;
    constants that move it by 1 sd over half of their range. All are given the `model` where a
    choice could not be tried.
    """
    moves = [
        (abs(by), name, one.name)
        for one in held
        for name, by in one.moves.items()
        if abs(by) > MOVED_BY_CONSTANT
    ]
    for one in found:
        for name in fit.keys() & one.summaries.keys() if one.as_good else ():
            here = fit[name]
            there = one.summaries[name]
            by = max(
                abs(there.median - here.median),
                here.q025 - there.q025,
                there.q975 - here.q975,
            )
            if by > MOVED * here.half:
                moves.append((by / here.half, name, one.instead_of))
    rests: dict[str, dict[str, None]] = {name: {} for name in fit}
    for _, name, text in sorted(moves, reverse=True):
        if name in rests:
            rests[name][text] = None
    untried = (MODEL,) if any(one.reason for one in found) else ()
    return {name: (*texts, *untried) for name, texts in rests.items() if texts or untried}
