"""All evidence at all parameters, and the verdicts they add up to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.inference.identifiability.derived import extrapolated, extrapolated_words
from fitball.inference.identifiability.eigendirections import eigendirections
from fitball.inference.identifiability.fisher import UNINFORMED, information_evidence, inverse, prior_sds
from fitball.inference.identifiability.posterior_verdict import Judgement, judge, plain
from fitball.inference.identifiability.power_scaling import power_evidence
from fitball.inference.identifiability.profile import DROP_95, coverage, profiles
from fitball.inference.identifiability.profile_path import best_top, free_searches, standard_errors
from fitball.inference.identifiability.scene_share import contraction_alone, touched_by_scene
from fitball.inference.identifiability.verdict import combine
from fitball.inference.likelihood.cells import prediction_slopes
from fitball.inference.likelihood.force import force_information, force_slopes, noise_held
from fitball.inference.point.surface import Surface, surface_of
from fitball.inference.problem.force_records import ForceRecords
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import LOOKED_AT, batches, thinned_problem, thinned_rows
from fitball.inference.results.evidence import (
    LEFT_OUT,
    NAMED,
    ActiveImpacts,
    ContractionEvidence,
    Evidence,
    Identifiability,
    Profiles,
)
from fitball.inference.results.results import PointFit, Posterior, Verdict, thinned
from fitball.scheduling.engine import Engine
from fitball.values import FloatArray

# Several fits that a table cannot tell apart: maxima of the likelihood that lie far apart for their width.

# Standard errors, the smaller ones of two fits, by which a parameter must differ between them: beside a peak a
# plateau, on which a parameter acts no more, is another fit; two places on one plateau or ridge are not.
APART = 3.0
# Places on the straight way between two maxima at which the likelihood is looked at, and the
# span of its logarithm below which both are places of one fit, whose likelihood is flat: no odds to speak of (1.1).
BETWEEN, FLAT = 15, 0.1
# Rows up to which several fits are looked for: of long tables the likelihood is close to normal.
ROWS = 300


@dataclass(frozen=True)
class SeveralFits:
    """What several fits say: `words` for a reader, and the parameters that are not noise that all of them `agree` on;
    nothing of either where there is one fit.
    """

    words: str
    agree: frozenset[str]


def several_fits(problem: Problem, optima: Sequence[Mapping[str, float]]) -> SeveralFits:
    """The fits that searches from `optima`, each all parameters by name in SI, lead to, the best first: those within
    a drop of 1.92 of the best that differ in something.
    """
    one = SeveralFits("", frozenset())
    if len(problem.impacts) > ROWS:
        return one
    objective = surface_of(problem)
    scene = problem.contact_time is not None
    starts = objective.from_values(problem.free_rows(optima))
    top, others = best_top(objective, starts, scene)
    kept, errors, costs = [top.x], [_errors(objective, top.x, scene)], [top.cost]
    for x in others:
        cost = float(objective.cost(x[None, :], free_searches(objective, x[None, :], scene).given)[0])
        error = _errors(objective, x, scene)
        near = [
            np.all(np.abs(x - y) < APART * np.minimum(error, known)) for y, known in zip(kept, errors, strict=True)
        ]
        if cost - top.cost < DROP_95 and not any(near) and not _joined(objective, kept, x, scene):
            kept.append(x)
            errors.append(error)
            costs.append(cost)
    if len(kept) < 2:
        return one
    return _told(objective, np.array(kept), np.array(errors), np.array(costs) - top.cost, scene)


def _joined(objective: Surface, kept: Sequence[FloatArray], x: FloatArray, scene: bool) -> bool:
    """Whether the straight way from `x` to one of the fits `kept` is flat all along, as on a plateau."""
    shares = np.linspace(0.0, 1.0, BETWEEN)[:, None]
    for y in kept:
        way = x + shares * (y - x)
        cost = objective.cost(way, free_searches(objective, way, scene).given)
        if float(np.ptp(cost)) < FLAT:
            return True
    return False


def _errors(objective: Surface, x: FloatArray, scene: bool) -> FloatArray:
    return standard_errors(objective, x[None, :], scene)[objective.columns]


def _told(objective: Surface, x: FloatArray, errors: FloatArray, drops: FloatArray, scene: bool) -> SeveralFits:
    """What fits at `x` (fits, columns) say, with their standard errors and drops of the log likelihood."""
    apart = np.ptp(x, axis=0) > APART * errors.min(axis=0)
    names = [objective.problem.free[k].name for k in objective.columns]
    values = objective.values(x, free_searches(objective, x, scene).given)[:, objective.columns]
    units = [objective.problem.free[k].spec.unit for k in objective.columns]
    fits = []
    for row, drop in zip(values, drops, strict=True):
        told = ", ".join(
            f"{name} {plain(value, unit)}"
            for name, value, unit, differs in zip(names, row, units, apart, strict=True)
            if differs
        )
        fits.append(f"{told} (log likelihood {drop:.1f} below the best)" if drop > 0.0 else told)
    count = "Two" if len(fits) == 2 else str(len(fits))
    agree = frozenset(name for name, differs in zip(names, apart, strict=True) if not differs)
    same = f" They agree on {', '.join(name for name in names if name in agree)}." if agree else ""
    return SeveralFits(f"{count} fits describe the data: {'; or '.join(fits)}.{same}", agree)


# In which impacts a parameter moves the rebound, from the derivative over draws, and in which the regime is in doubt.

# Change of a rebound, in sds of its noise for the whole width of the prior, below which nothing acts: differences are
# good to about 1e-8 of it, and no table could show less than a thousandth.
ACTS = 1e-3
# Share of the draws in which a parameter must act to count as acting in an impact.
MOSTLY = 0.5
# A phase sequence with a probability between these leaves the regime of its impact in doubt.
DOUBT = (0.05, 0.95)


def active_impacts(
    problem: Problem, coordinates: FloatArray, regimes: Sequence[Mapping[str, float]]
) -> dict[str, ActiveImpacts]:
    """The evidence on every free parameter but noise, over `coordinates` (draws, free); `regimes` are the
    probabilities of each impact's phase sequences, none of them in doubt when empty. Of a large table a part
    is looked at.
    """
    kept = thinned_rows(problem, LOOKED_AT)
    problem = thinned_problem(problem, LOOKED_AT)
    regimes = [regimes[k] for k in kept] if regimes else ()
    count = len(problem.impacts)
    squares, acting, known = (np.zeros((count, problem.dimension)) for _ in range(3))
    for some in batches(problem, coordinates.shape[0], cost=2 * problem.dimension + 1):
        mine = coordinates[some]
        slopes = prediction_slopes(problem, mine)
        if problem.force is not None:
            slopes = np.concatenate([slopes, _on_records(problem, problem.force, mine)], axis=2)
        # A draw at the very edge of what the model can evaluate has no derivative: it says nothing.
        square = np.sum(slopes**2, axis=2)
        known += np.isfinite(square).sum(axis=0)
        squares += np.where(np.isfinite(square), square, 0.0).sum(axis=0)
        acting += np.sum(np.max(np.where(np.isfinite(slopes), np.abs(slopes), 0.0), axis=2) > ACTS, axis=0)
    squares, acting = squares / np.maximum(known, 1.0), acting / coordinates.shape[0]
    ids = problem.table.ids
    doubtful = [k for k, shares in enumerate(regimes) if DOUBT[0] < max(shares.values(), default=1.0) < DOUBT[1]]
    # Without motion along the court a contact has no phases, and no name.
    usual = tuple(sorted({max(shares, key=lambda name: shares[name]) for shares in regimes} - {""}))
    evidence = {}
    for column, parameter in enumerate(problem.free):
        if parameter.name in NOISE_SPECS:
            continue
        total = float(squares[:, column].sum())
        moved = np.flatnonzero(acting[:, column] >= MOSTLY)
        unsure = [k for k in doubtful if acting[k, column] > 0.0]
        evidence[parameter.name] = ActiveImpacts(
            impacts=tuple(ids[k] for k in moved[:NAMED]),
            acting=moved.size,
            of=count,
            regimes=usual,
            doubtful=tuple(ids[k] for k in unsure[:NAMED]),
            in_doubt=len(unsure),
            share_doubtful=float(squares[doubtful, column].sum()) / total if total > 0.0 else 0.0,
        )
    return evidence


def _on_records(problem: Problem, records: ForceRecords, coordinates: FloatArray) -> FloatArray:
    """Slopes (draws, impacts, 1, free) of force records: the length of those of each, none without a record."""
    slopes = np.zeros((coordinates.shape[0], len(problem.impacts), 1, problem.dimension))
    _rows, by_record, _shares = force_slopes(problem, records, coordinates)
    slopes[:, records.rows, 0] = np.sqrt(np.sum(by_record**2, axis=2)) * problem.prior.width
    return slopes


# Which parameters the table says nothing of by itself, however narrow they are: those that only the priors of others
# hold, because they can move together without a trace.

# Draws over which the information is averaged, fewer with force records: what moves together at all of them does so
# by the model's equations.
LOOKS, RECORDED = 50, 4
# Share of what the table adds to the priors that it must add without those of the others: below it, nothing. By the
# equations it is 1e-7 and less, on Wang's and all simulated tables 0.9 and more for parameters that a table tells.
VANISHED = 0.01
# Correlation without priors from which two parameters count as moving together.
TOGETHER = 0.9


def traded(problem: Problem, coordinates: FloatArray) -> Mapping[str, tuple[str, ...]]:
    """Parameters of which the table tells nothing once the priors of all others are widened without end, each with
    those others that it moves with, from the mean information of the table, without what the scene knows, over
    `coordinates` (draws, free). How levels and biases scatter, and what was measured of the ball, stays.
    """
    part = thinned_problem(problem, LOOKED_AT)
    slopes = prediction_slopes(part, coordinates)
    informations = np.einsum("dkmi,dkmj->dij", slopes, slopes)
    if problem.force is not None:
        # Dear, and the same at every draw in what it can tell.
        recorded = [force_information(problem, problem.force, at) for at in coordinates[:RECORDED]]
        informations = informations[:RECORDED] + np.outer(problem.prior.width, problem.prior.width) * recorded
    informations = informations[np.isfinite(informations).all(axis=(1, 2))]
    fitted = np.array([parameter.name not in NOISE_SPECS for parameter in problem.free])
    if not len(informations):
        return {}
    sds = prior_sds(problem)
    kept = np.ix_(fitted, fitted)
    information = (informations.mean(axis=0) * np.outer(sds, sds))[kept]
    parameters = [parameter for parameter in problem.free if parameter.name not in NOISE_SPECS]
    apart = np.diag([1.0 if parameter.name in problem.known_apart else 0.0 for parameter in parameters])
    alone = inverse(information + apart, UNINFORMED**-4)
    variance = np.diag(alone)
    added = 1.0 - np.diag(inverse(information, 1.0))
    lost = 1.0 / (1.0 + variance) < VANISHED * added
    correlation = np.abs(alone) / np.sqrt(np.outer(variance, variance))
    return {
        parameter.name: tuple(
            other.name for j, other in enumerate(parameters) if j != k and lost[j] and correlation[k, j] > TOGETHER
        )
        for k, parameter in enumerate(parameters)
        if lost[k] and parameter.name not in problem.known_apart
    }


# Rows up to which profiles are made unasked: ten seconds or so.
PROFILED = 300
# Draws over which derivatives are taken.
DERIVED = 200


def profile_all(
    problem: Problem,
    point: PointFit,
    optima: Sequence[Mapping[str, float]],
    report: Callable[[str], None] = lambda _stage: None,
    engine: Engine | None = None,
) -> tuple[Profiles, Profiles]:
    """Profiles of all free parameters, and, without the scene's contact time, of those that it touches; the search
    begins at `optima`, each all parameters by name in SI. Tables of many rows are left out unless there is an
    `engine`, which runs a task for each parameter.
    """
    problem = noise_held(problem, point.values)
    if len(problem.impacts) > PROFILED and engine is None:
        nothing = Profiles(point.log_likelihood, problem.contact_time is not None, {}, LEFT_OUT)
        return nothing, nothing
    whole = profiles(problem, optima, report=lambda stage: report(f"profiles {stage}"), engine=engine)
    touched = touched_by_scene(problem, information_evidence(problem, _coordinates(problem, point)))
    if not touched or whole.missing:
        return whole, Profiles(whole.log_likelihood, False, {}, whole.missing)
    alone = profiles(
        problem,
        optima,
        names=touched,
        scene=False,
        report=lambda stage: report(f"profiles without scene {stage}"),
        engine=engine,
    )
    return whole, alone


def with_profiles(
    problem: Problem, point: PointFit, identifiability: Identifiability, engine: Engine
) -> Identifiability:
    """The same evidence with profiles computed now by `engine`; verdicts stay as they were."""
    whole, alone = profile_all(problem, point, point.optima, engine=engine)
    evidence = {
        name: replace(seen, profile=whole.by_name.get(name), alone=alone.by_name.get(name))
        for name, seen in identifiability.evidence.items()
    }
    return replace(identifiability, evidence=evidence, profiles_missing=whole.missing)


def examine(
    problem: Problem,
    point: PointFit,
    profiled: tuple[Profiles, Profiles],
    posterior: Posterior | None,
    correlation: FloatArray | None,
    regimes: Sequence[Mapping[str, float]],
    optima: Sequence[Mapping[str, float]] = (),
) -> tuple[Identifiability, dict[str, Judgement]]:
    """Look at every parameter in every way there is, and judge; without a posterior from profile and information.

    `regimes` are the probabilities of each impact's phase sequences, empty without a posterior; `optima` those that
    searches found, from which several fits are looked for.
    """
    at = _coordinates(problem, point)
    information = information_evidence(problem, at)
    bases: dict[str, Judgement] = {}
    powers, draws = {}, at[None, :]
    if posterior is not None:
        draws = problem.to_coordinates(thinned(posterior, DERIVED))
    held_by_others = traded(problem, draws[:: -(-len(draws) // LOOKS)])
    if posterior is not None and correlation is not None:
        alone = contraction_alone(problem, information, profiled[1].by_name, held_by_others)
        bases = judge(problem, posterior, correlation, alone, held_by_others)
        powers = power_evidence(problem, posterior)
    active = active_impacts(problem, draws, regimes)
    evidence, judgements, beyond = {}, {}, extrapolated(problem)
    several = several_fits(noise_held(problem, point.values), optima or point.optima)
    for parameter in problem.parameters:
        if not parameter.free:
            held = f"held at its value: {parameter.fixed_because}"
            judgements[parameter.name] = Judgement(None, Verdict.FIXED, held)
            continue
        base = bases.get(parameter.name)
        contraction = None
        if base is not None and base.contraction is not None:
            contraction = ContractionEvidence(base.contraction, base.open_sides)
        seen = Evidence(
            profile=profiled[0].by_name.get(parameter.name),
            alone=profiled[1].by_name.get(parameter.name),
            information=information.get(parameter.name),
            contraction=contraction,
            power=powers.get(parameter.name),
            active_impacts=active.get(parameter.name),
        )
        judgements[parameter.name] = combine(
            problem,
            parameter,
            base,
            seen,
            value=point.values[parameter.name],
            many=profiled[0].missing == LEFT_OUT,
            traded=held_by_others.get(parameter.name),
            agreed=parameter.name in several.agree,
        )
        if parameter.name in beyond:
            judged = judgements[parameter.name]
            reason = f"{extrapolated_words(problem)}; {judged.reason}"
            judgements[parameter.name] = replace(judged, verdict=Verdict.EXTRAPOLATED, reason=reason)
        evidence[parameter.name] = seen
    return Identifiability(
        evidence, eigendirections(problem, at), profiled[0].missing, coverage(problem), several.words
    ), judgements


def _coordinates(problem: Problem, point: PointFit) -> FloatArray:
    values = np.array([[point.values[name] for name in problem.free_names]])
    at: FloatArray = problem.to_coordinates(values)[0]
    return at
