"""Does the model describe the data? All tests, the largest misfits, and the answer that follows from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri, ndtr, ndtri, stdtr, stdtrit

from fitball.data.scene import NO_SPIN_SD, NO_VELOCITY_SD
from fitball.inference.adequacy.looks import KINDS, Look, Tables, family, farthest
from fitball.inference.adequacy.made_tables import LEFT_OUT, look_at
from fitball.inference.adequacy.refit import EVERY, Pattern, Refit, patterns, refit
from fitball.inference.adequacy.repeats import far_beyond, repeats_words
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
from fitball.inference.problem.observables import beyond_stated, expected_prior
from fitball.inference.problem.parameters import FORCE_NOISE, SD_SPECS, Parameter
from fitball.inference.problem.problem import Problem
from fitball.inference.results import sentences
from fitball.inference.results.assumptions import SURE_ERRORS, Alternative, Assumptions
from fitball.inference.results.evidence import (
    FALSE_EXCEPT,
    FALSE_FAILS,
    FAR_FROM_STATED,
    Adequacy,
    Answer,
    Check,
    Misfit,
    NoiseCheck,
)
from fitball.inference.results.results import PointFit, Posterior
from fitball.values import FloatArray

# How large is the noise of the residuals, beside the stated or the expected one?

# The multiple of the stated or expected noise from which it is an exception.
WORSE = 1.2


def noise_checks(problem: Problem, point: PointFit, fit: Refit, share: float) -> tuple[NoiseCheck, ...]:
    """Each noise beside its stated or expected size, adjusted for their number (Holm 1979) times `share` families."""
    known = {parameter.name: parameter for parameter in problem.parameters}
    scales = fit.scales(fit.measured[None, :])[0]
    checks, scatters = [], beyond_stated(problem.observables)
    for number, name in enumerate(fit.noises):
        columns = tuple(column for k, column in enumerate(fit.columns) if fit.noise_of(k) == number)
        freedom, scale, parameter = float(fit.freedom[number]), float(scales[number]), known.get(name)
        if freedom < 1.0:
            continue
        if parameter is None or parameter.fixed is not None:
            own = parameter is not None and name not in scatters
            size, unit = (point.values[name], parameter.spec.unit) if own and parameter is not None else (1.0, "")
            p = float(chdtrc(freedom, freedom * scale**2))
            checks.append(NoiseCheck(name, columns, unit, True, scale * size, size, freedom, scale, p, p, False))
        else:
            # The residuals of heavy tails are not in units of their scale, which the fit has found; nor are those
            # with stated errors in units of their scatter.
            found = bool(problem.noise.parameters) or name in scatters
            fitted = point.values[name] * (1.0 if found else scale)
            checks.append(_expected(parameter, columns, fitted, freedom, _is_assumed(problem, parameter)))
    if problem.force is not None:
        nodes = float(problem.force.nodes)
        checks += [
            _expected(item, ("force",), point.values[item.name], nodes, True)
            for item in problem.free
            if item.name in FORCE_NOISE
        ]
    largest = 0.0
    for place, k in enumerate(sorted(range(len(checks)), key=lambda k: checks[k].p)):
        check = checks[k]
        largest = max(largest, min(1.0, (len(checks) - place) * check.p))
        p = min(1.0, share * largest)
        far = not check.assumed and check.ratio >= FAR_FROM_STATED
        checks[k] = replace(check, adjusted=p, found=far or (p < FALSE_EXCEPT and check.ratio >= WORSE))
    return tuple(checks)


def _is_assumed(problem: Problem, parameter: Parameter) -> bool:
    """Whether the scene states no noise to expect, or a chosen prior does, so that its width counts."""
    scatter = parameter.name in beyond_stated(problem.observables)
    if parameter.prior.text != expected_prior(parameter.name, problem.scene, problem.table, scatter):
        return True
    unit = SD_SPECS[parameter.name].unit
    silence = {"rad/s": NO_SPIN_SD, "m/s": NO_VELOCITY_SD, "rad": NO_VELOCITY_SD}.get(unit)
    return silence is None or silence in problem.notes


def _expected(
    parameter: Parameter, columns: tuple[str, ...], fitted: float, freedom: float, assumed: bool
) -> NoiseCheck:
    """A noise beside its prior: the probability, before the table, of one that comes out as large with so many
    degrees of freedom.
    """
    prior, unit = parameter.prior, parameter.spec.unit
    median, at = float(prior.quantile(np.array([0.5]))[0]), float(prior.coordinate(np.array(fitted)))
    error = (1.0 if prior.log else fitted) / math.sqrt(2.0 * freedom)
    (low, high), ratio = prior.support, fitted / median
    if prior.bell:
        p = prior.below((prior.a - at) / math.hypot(prior.b, error))
        if not prior.log and prior.ends[0] >= prior.a:
            # Only the upper half of this one is there.
            p = min(1.0, 2.0 * p)
    else:
        # A uniform density knows no size that would be improbable but by its ends.
        p = float(ndtr((high - at) / error)) if at > high else (high - max(at, low)) / (high - low)
    return NoiseCheck(parameter.name, columns, unit, False, fitted, median, freedom, ratio, p, p, False, assumed)


# Patterns have three fifths of the chance of a false alarm, the size of the noise two.
OF_PATTERNS, OF_NOISE = 5.0 / 3.0, 5.0 / 2.0
# A pattern smaller than this, in units of the noise, is no exception however many rows make it sure.
SMALL = 0.1
# A model fails whose noise is surely this multiple of what was stated or expected.
FAR_WORSE = 2.0
# A model fails where smooth patterns explain this share of a column's residual variance.
HALF = 0.5
# How choices of a kind of noise begin.
NOISE = "noise="
# Misfits that are listed, and rows that a test names.
LISTED, NAMED_ROWS = 5, 6


def adequacy(
    problem: Problem,
    point: PointFit,
    posterior: Posterior | None,
    seed: int,
    assumptions: Assumptions | None = None,
) -> Adequacy:
    """Compare the residuals of a fit with those of data sets simulated from it, each refitted to first order, and its
    noise with the stated or expected one. Without a posterior nothing is left out by importance weights. An
    alternative among the `assumptions` that scores significantly better is an exception.
    """
    # The fourth of a run's streams: those before it are the point fit's, the priors' and the predictions'.
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(4)[3])
    fit = refit(problem, point)
    observed = Tables(fit, fit.measured[None, :])
    noise = noise_checks(problem, point, fit, OF_NOISE)
    found = patterns(problem, point, fit)
    looked = look_at(problem, point, posterior, fit, found, rng)
    looks, left_out = looked.looks, looked.left_out
    simulated = sentences.SIMULATED.format(count=looked.tables)
    if looked.impacts < fit.impacts:
        simulated += sentences.SHORTER.format(impacts=looked.impacts)
    checks: tuple[Check, ...] = ()
    unseen = dict.fromkeys(fit.columns, 1.0)
    if looks:
        p, level = family(looks)
        checks = tuple(
            _check(problem, observed, look, min(1.0, OF_PATTERNS * chance))
            for look, chance in zip(looks, p.tolist(), strict=True)
        )
        unseen = _unseen(fit, looks, level, noise)
    misfits = [
        _misfit(observed, look, found) for look, check in zip(looks, checks, strict=True) if check.p < FALSE_EXCEPT
    ]
    # By how many of its sds each parameter moves, at most, if one of these is taken out.
    parts = [np.abs(fit.reach @ misfit) for misfit in misfits if misfit is not None]
    moved = dict(zip(fit.names, np.max(parts, axis=0).tolist(), strict=True)) if parts else {}
    better = () if assumptions is None else surely_better(assumptions.alternatives)
    answer = _answer(observed, found, checks, noise, unseen, better)
    return Adequacy(
        answer=answer,
        sentence=sentence(problem, answer, noise, checks, unseen, moved, better),
        based_on=based_on(problem, noise, checks, unseen, simulated, posterior is not None),
        exceptions=(
            *(noise_words(check) for check in noise if check.found),
            *(check_words(check) for check in strongest(check for check in checks if check.found)),
            *(better_words(alternative) for alternative in better),
        ),
        noise=noise,
        checks=checks,
        misfits=largest_misfits(problem, point, observed),
        moved=moved,
        given=_given(problem, fit, checks, better),
        unseen=unseen,
        loo_pit={}
        if left_out is None or fit.impacts > LEFT_OUT
        else {name: tuple(left_out[k][fit.places[k]].tolist()) for k, name in enumerate(fit.columns)},
        replicates=looked.tables,
        repeats=repeats_words(problem, point, fit),
        scattering=tuple(far_beyond(problem, point)),
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


def _check(problem: Problem, observed: Tables, look: Look, p: float) -> Check:
    """A test as it is reported; a pattern is `found` where it is sure and, if it has a size, large enough."""
    fit, explained, size = observed.fit, None, None
    if look.found is not None:
        explained = abs(float(look.seen[0]))
        size = abs(float(observed.along(look.found)[0])) / look.found.shape.size**0.5
    elif look.kind == "jointly":
        explained = abs(float(look.seen[0]))
        size = (explained * len(fit.columns)) ** 0.5
    usual = sorted(abs(float(value)) for value in look.seen[1:])
    return Check(
        kind=look.kind,
        column=ALL if look.column == EVERY else fit.columns[look.column],
        over=look.over,
        words=_words(problem, observed, look),
        statistic=float(look.seen[0]),
        usual=usual[int(0.95 * len(usual))],
        p=p,
        explained=explained,
        size=size,
        found=p < FALSE_EXCEPT and (size is None or size >= SMALL),
    )


def _words(problem: Problem, observed: Tables, look: Look) -> str:
    """The pattern that a test looked for, and what it found: which rows, which way."""
    if look.column == EVERY and look.found is not None:
        return look.words
    column, words = ALL if look.column == EVERY else observed.fit.columns[look.column], look.words
    if look.kind == "bias":
        return sentences.BIASED.format(column=column, rows=words)
    if look.kind == "spread":
        words = (sentences.GROWS if look.seen[0] > 0.0 else sentences.FALLS).format(quantity=look.over)
    if look.kind == "outlier":
        places = observed.fit.places[look.column][_farthest(observed, look.column)]
        ids = [problem.table.ids[place] for place in places[:NAMED_ROWS]]
        more = sentences.MORE.format(more=places.size - NAMED_ROWS) if places.size > NAMED_ROWS else ""
        one = places.size == 1
        words = (sentences.OUTLIER if one else sentences.OUTLYING).format(ids=", ".join(ids), more=more)
    return sentences.IN_COLUMN.format(column=column, pattern=words)


def _farthest(observed: Tables, column: int) -> NDArray[np.int64]:
    """Which of a column's measurements lie farthest off together, the farthest first: those of the group that the
    others show to be off (Rosner 1983).
    """
    fit = observed.fit
    own = observed.standardised[:, fit.rows(column)]
    freedom = float(fit.freedom[fit.noise_of(column)])
    far = np.argsort(-np.abs(own[0]), kind="stable")[: int(farthest(own, freedom)[0][0])]
    off, spread = _left_out(fit, column, far)
    left = freedom - far.size
    noise = fit.noise == fit.noise_of(column)
    rest = fit.measured + fit.own @ (off @ fit.own[fit.rows(column)][far])
    rest[fit.starts[column] + far] -= off
    size = np.abs(off) / (spread * np.sqrt(np.sum(rest[noise] ** 2) / left))
    sure = 2.0 * own.size * stdtr(left, -size) < FALSE_EXCEPT
    return far[sure] if np.any(sure) else far[:1]


def _left_out(fit: Refit, column: int, far: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """By how much the measurements `far` of a column deviate from a fit to all others, and the sds of that in
    units of the noise.
    """
    own = fit.own[fit.rows(column)][far]
    inverse = np.linalg.pinv(np.eye(far.size) - own @ own.T)
    return inverse @ fit.measured[fit.rows(column)][far], np.sqrt(np.diag(inverse))


def _misfit(observed: Tables, look: Look, found: Sequence[Pattern]) -> FloatArray | None:
    """What the basis has (rank,) of what was found, as a part of the residuals before a refit; None of what is no
    part of them.
    """
    fit = observed.fit
    if look.found is not None or look.kind == "jointly":
        mine = [item for item in found if item.over == look.over] if look.found is None else [look.found]
        measured = [float(item.along(fit, fit.measured[None, :], fit.taken[None, :])[0]) for item in mine]
        # Of all that act together the strongest: the others are known too badly to be taken out.
        k = int(np.argmax(np.abs(measured)))
        return np.asarray(mine[k].taken * (measured[k] / mine[k].length))
    if look.kind != "outlier":
        return None
    far = _farthest(observed, look.column)
    return np.asarray(_left_out(fit, look.column, far)[0] @ fit.own[fit.rows(look.column)][far])


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
    observed: Tables,
    found: Sequence[Pattern],
    checks: Sequence[Check],
    noise: Sequence[NoiseCheck],
    unseen: dict[str, float],
    better: Sequence[Alternative],
) -> Answer:
    if any(check.adjusted < FALSE_FAILS and check.ratio >= FAR_WORSE for check in noise):
        return Answer.FAILS
    sure = [check for check in checks if KINDS[check.kind].smooth and check.p < FALSE_FAILS]
    columns = {check.column for check in sure} - {ALL}
    together = max((check.explained or 0.0 for check in sure if check.column == ALL), default=0.0)
    if max([together, *(explained(observed, found, observed.fit.columns.index(name)) for name in columns)]) >= HALF:
        return Answer.FAILS
    if better or any(check.found for check in checks) or any(check.found for check in noise):
        return Answer.EXCEPT
    return Answer.UNDECIDED if blind(unseen) else Answer.DESCRIBES


def explained(observed: Tables, found: Sequence[Pattern], column: int) -> float:
    """Share of a column's residual variance that all smooth patterns explain together, beyond what as many
    meaningless ones would; that of the best alone where there are too many to say.
    """
    mine = [item for item in found if item.column == column and KINDS[item.kind].smooth]
    freedom = float(observed.fit.freedom[observed.fit.noise_of(column)])

    def share(some: Sequence[Pattern]) -> float:
        square, rank = observed.spanned(some)
        part = min(float(square[0]) / freedom, 1.0)
        return 1.0 - (1.0 - part) * freedom / (freedom - rank) if freedom - rank >= 1.0 else 0.0

    return max(share(mine), *(share([one]) for one in mine))


def largest_misfits(problem: Problem, point: PointFit, observed: Tables) -> tuple[Misfit, ...]:
    """The largest, farthest first, each by its distance from its prediction by all others, in sds of that."""
    far, fit = observed.standardised[0], observed.fit
    columns = problem.all_values(np.array([[point.values[name] for name in problem.free_names]]))
    largest = []
    for k in np.argsort(-np.abs(far), kind="stable")[:LISTED]:
        column = int(np.searchsorted(fit.starts, k, side="right")) - 1
        own = int(k - fit.starts[column])
        observable = problem.observables[column]
        gap = problem.deviation(columns, observable, point.rebound)[0]
        measured = float(observable.observed[own])
        largest.append(
            Misfit(
                problem.table.ids[fit.places[column][own]], observable.name, observable.column.unit, measured,
                measured - float(gap[own]), float(far[k]),
            )
        )  # fmt: skip
    return tuple(largest)
