"""All evidence on all parameters, and the verdicts that follow: profiles and information (see there), several fits,
the impacts in which a parameter acts, whether only priors of others hold it, power-scaling.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitball.inference.identifiability.derived import extrapolated, extrapolated_words
from fitball.inference.identifiability.information import (
    UNINFORMED,
    eigendirections,
    information_evidence,
    inverse,
    prior_sds,
)
from fitball.inference.identifiability.profile import DROP_95, coverage, profiles
from fitball.inference.identifiability.profile_walk import best_top, standard_errors
from fitball.inference.identifiability.verdict import (
    CONFLICT,
    SENSITIVE,
    Judgement,
    Numbers,
    contraction_alone,
    judge,
    marginal,
    plain,
    tied_words,
    touched_by_scene,
)
from fitball.inference.likelihood.cells import prediction_slopes
from fitball.inference.likelihood.force import force_information, force_slopes, noise_held
from fitball.inference.likelihood.posterior import Densities, densities
from fitball.inference.point.surface import Surface, surface_of
from fitball.inference.problem.force_records import ForceRecords
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import LOOKED_AT, batches, thinned_problem, thinned_rows
from fitball.inference.results import sentences
from fitball.inference.results.evidence import (
    LEFT_OUT,
    NAMED,
    ActiveImpacts,
    ContractionEvidence,
    Evidence,
    Identifiability,
    PowerEvidence,
    Profiles,
)
from fitball.inference.results.results import PointFit, Posterior, Verdict, thinned
from fitball.inference.results.sentences import counted, listed
from fitball.inference.sampling.convergence import TAILS
from fitball.inference.sampling.importance import smoothed
from fitball.scheduling.engine import Engine
from fitball.values import FloatArray

# Several fits that the data cannot distinguish: maxima of the likelihood that lie far apart for their width.

# Standard errors, the smaller ones of two fits, by which a parameter must differ between them: beside a peak a
# plateau, on which a parameter acts no more, is another fit; two places on one plateau or ridge are not.
APART = 3.0
# Places on the straight way between two maxima at which the likelihood is looked at, and the
# span of its logarithm below which both are places of one fit, whose likelihood is flat: no odds to speak of (1.1).
BETWEEN, FLAT = 15, 0.1
# Rows up to which several fits are looked for: of long tables the likelihood is close to normal.
ROWS = 300


def several_fits(problem: Problem, optima: Sequence[Mapping[str, float]]) -> tuple[str, frozenset[str]]:
    """The fits that searches from `optima`, each all parameters by name in SI, lead to, the best first: those within
    a drop of 1.92 of the best that differ in something. In words, and the parameters that are not noise that all of
    them agree on; nothing of either where there is one fit.
    """
    if len(problem.impacts) > ROWS:
        return "", frozenset()
    objective = surface_of(problem)
    starts = objective.from_values(problem.free_rows(optima))
    top, others = best_top(objective, starts)
    drops = objective.cost(others, objective.free(others)) - top.cost if len(others) else ()
    fits = [(top.x, top.errors[objective.columns], 0.0)]
    for x, drop in zip(others, drops, strict=True):
        errors = standard_errors(objective, x[None, :])[objective.columns]
        near = any(np.all(np.abs(x - y) < APART * np.minimum(errors, known)) for y, known, _ in fits)
        if drop < DROP_95 and not near and not any(joined(objective, y, x) for y, *_ in fits):
            fits.append((x, errors, float(drop)))
    if len(fits) < 2:
        return "", frozenset()
    places = np.array([x for x, *_ in fits])
    apart = np.ptp(places, axis=0) > APART * np.min([errors for _, errors, _ in fits], axis=0)
    parameters = [problem.free[k] for k in objective.columns]
    fits_in_words = []
    for row, (_x, _errors, drop) in zip(objective.values(places, objective.free(places)), fits, strict=True):
        values = zip(parameters, row[objective.columns], apart, strict=True)
        words = ", ".join(f"{one.name} {plain(value, one.spec.unit)}" for one, value, differs in values if differs)
        fits_in_words.append(words + (sentences.LESS_LIKELY.format(drop=drop) if drop > 0.0 else ""))
    agree = [one.name for one, differs in zip(parameters, apart, strict=True) if not differs]
    several = sentences.SEVERAL.format(
        count=counted(len(fits)),
        fits="; or ".join(fits_in_words),
        agree=sentences.AGREE.format(names=listed(agree)) if agree else "",
    )
    return several, frozenset(agree)


def joined(objective: Surface, y: FloatArray, x: FloatArray) -> bool:
    """Whether the straight way between two places (columns,) is flat all along, as on a plateau."""
    way = x + np.linspace(0.0, 1.0, BETWEEN)[:, None] * (y - x)
    return float(np.ptp(objective.cost(way, objective.free(way)))) < FLAT


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
    probabilities of each impact's phase sequences, none of them in doubt when empty. Of a large table a part is
    used.
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
        # A draw at the very edge of what the model can evaluate has no derivative, and is left out.
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
            total=count,
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


# Parameters that the data do not determine by themselves, however narrow they are: only the priors of others hold
# them, because these data cannot separate them.

# Draws over which the information is averaged, fewer with force records: what moves together at all of them does so
# by the model's equations.
LOOKS, RECORDED = 50, 4
# Share of what the data add to the priors that they must add without those of the others: below it, nothing. By the
# equations it is 1e-7 and less; for parameters that the data determine, on Wang's and all simulated tables, 0.9 and
# more.
VANISHED = 0.01
# Correlation without priors from which two parameters count as moving together.
TOGETHER = 0.9


def traded(problem: Problem, coordinates: FloatArray) -> Mapping[str, tuple[str, ...]]:
    """Parameters that the data do not determine once the priors of all others are widened without end, each with
    those others that it moves with. By the mean information of the data, without the scene, over `coordinates`
    (draws, free). How levels and biases scatter, and what was measured of the ball, stays.
    """
    part = thinned_problem(problem, LOOKED_AT)
    slopes = prediction_slopes(part, coordinates)
    informations = np.einsum("dkmi,dkmj->dij", slopes, slopes)
    if problem.force is not None:
        # Expensive, and the same at every draw in what it can determine.
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


# Sensitivity of the posterior to priors, scene and likelihood: each part of its density is raised to a power near
# one, the draws reweighted (Pareto-smoothed), and the change of each marginal measured by the cumulative
# Jensen-Shannon distance per doubling of the power (Kallioinen, Paananen, Buerkner and Vehtari 2023, Stat Comput 34,
# 57).

# The authors' powers.
POWERS = (0.99, 1.01)
DRAWS = 4000
WEAK = "strong prior / weak likelihood"


def power_evidence(problem: Problem, posterior: Posterior) -> dict[str, PowerEvidence]:
    """The evidence on every free parameter, in the coordinate of its prior, on a few thousand draws."""
    scored = replace(
        posterior, values=np.concatenate([posterior.values, posterior.log_posterior[..., None]], axis=-1)
    )
    values, score = np.split(thinned(scored, DRAWS), [-1], axis=1)
    coordinates = problem.to_coordinates(values)
    each = np.stack(
        [parameter.prior.log_density(coordinates[:, k]) for k, parameter in enumerate(problem.free)], axis=1
    )
    # Where a level lies among the others is the model's, not a prior: what is prior there is their spread.
    places = [pooling.place_name(label) for pooling in problem.pooling for label in pooling.labels]
    stated = np.where(np.isin(problem.free_names, places), 0.0, each)
    density = _parts(problem, values, score[:, 0] - each.sum(axis=1))
    priors, likelihood = (sensitivities(coordinates, part) for part in (stated.sum(axis=1), density.likelihood))
    scene = None if problem.contact_time is None else sensitivities(coordinates, density.scene)
    return {
        name: PowerEvidence(
            prior=float(priors[k]),
            own_prior=float(sensitivities(coordinates[:, k : k + 1], stated[:, k])[0]),
            scene=None if scene is None else float(scene[k]),
            likelihood=float(likelihood[k]),
            diagnosis=diagnosis(float(priors[k]), float(likelihood[k])),
        )
        for k, name in enumerate(problem.free_names)
    }


def _parts(problem: Problem, values: FloatArray, both: FloatArray) -> Densities:
    """Scene and likelihood at draws (draws, free); of a large table the likelihood is what the scene, computed from a
    part of the impacts, leaves of `both` (draws,).
    """
    if len(problem.impacts) <= LOOKED_AT:
        return densities(problem, values)
    scene = densities(thinned_problem(problem, LOOKED_AT), values, measured=False)
    return replace(scene, likelihood=both - scene.scene)


def sensitivities(draws: FloatArray, log_density: FloatArray) -> FloatArray:
    """Power-scaling sensitivity (columns,) of each column of `draws` (draws, columns) to a part of the log density
    (draws,); zero for a part that is the same at every draw, which no power changes, and for a column that is, which
    no weights move. Draws may be tied, as those of a walker are that sat.
    """
    from fitball.inference.sampling.array_stats import array_stats

    if np.ptp(log_density) <= 0.0:
        return np.zeros(draws.shape[1])
    efficiency = float(array_stats.ess(log_density[None, :], method="tail", prob=TAILS)) / log_density.size
    lower, upper = (np.exp(smoothed((power - 1.0) * log_density, efficiency)[0])[None, :] for power in POWERS)
    sensitivity = np.zeros(draws.shape[1])
    for k in np.flatnonzero(np.ptp(draws, axis=0) > 0.0):
        column = draws[None, :, k]
        sensitivity[k] = array_stats.power_scale_sense(
            column, lower, upper, lower_alpha=POWERS[0], upper_alpha=POWERS[1]
        )
    return sensitivity


def diagnosis(prior: float, likelihood: float) -> str:
    """The authors' diagnosis in words, "" where there is none."""
    if prior < SENSITIVE:
        return ""
    return CONFLICT if likelihood >= SENSITIVE else WEAK


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
    draws = at[None, :] if posterior is None else problem.to_coordinates(thinned(posterior, DERIVED))
    by_others = traded(problem, draws[:: -(-len(draws) // LOOKS)])
    powers = {} if posterior is None else power_evidence(problem, posterior)
    active, information = active_impacts(problem, draws, regimes), information_evidence(problem, at)
    several, agree = several_fits(noise_held(problem, point.values), optima or point.optima)
    whole, without_scene = profiled
    beyond = extrapolated(problem)
    judgements = {
        item.name: Judgement(None, Verdict.FIXED, sentences.FIXED.format(why=item.fixed_because))
        for item in problem.parameters
    }
    evidence = {}
    for k, parameter in enumerate(problem.free):
        name = parameter.name
        look, unaided, others = information.get(name), without_scene.by_name.get(name), by_others.get(name)
        alone = contraction_alone(problem, parameter, look, unaided, others is not None)
        found, tied = None, ""
        if posterior is not None and correlation is not None:
            found = marginal(parameter.prior, posterior.draws[:, k], posterior.prior_draws[:, k], alone)
            tied = tied_words(posterior.names, correlation, k)
        evidence[name] = Evidence(
            profile=whole.by_name.get(name),
            alone=unaided,
            information=look,
            contraction=None if found is None else ContractionEvidence(found.contraction, found.open_sides),
            power=powers.get(name),
            active_impacts=active.get(name),
        )
        numbers = Numbers(
            problem,
            parameter,
            evidence[name],
            found,
            value=point.values[name],
            alone=alone,
            many=whole.missing == LEFT_OUT,
            traded=others,
            agreed=name in agree,
            tied=tied,
            beyond=extrapolated_words(problem) if name in beyond else "",
        )
        judgements[name] = judge(numbers)
    directions = eigendirections(problem, at)
    return Identifiability(evidence, directions, whole.missing, coverage(problem), several), judgements


def _coordinates(problem: Problem, point: PointFit) -> FloatArray:
    values = np.array([[point.values[name] for name in problem.free_names]])
    at: FloatArray = problem.to_coordinates(values)[0]
    return at
