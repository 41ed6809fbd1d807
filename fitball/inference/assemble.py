"""From the results of the stages to the one frozen fit: estimates, verdicts, predictions, the verdict in sentences.

A verdict within a model is not yet final. A model that fails determines nothing. A value that changes with a model
assumption is known only given that assumption. Where assumptions could not be examined the verdict says so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitball.data.balances import scene_balances
from fitball.inference.adequacy import by_label
from fitball.inference.adequacy.by_camera import camera_notes
from fitball.inference.adequacy.describe import adequacy
from fitball.inference.effort import Effort, Stopwatch
from fitball.inference.identifiability.derived import Quantity, derived, differences
from fitball.inference.identifiability.examine import examine
from fitball.inference.identifiability.verdict import Judgement
from fitball.inference.likelihood.force import MISFIT, SD, aligned, mean_forces, rotated
from fitball.inference.prediction.court_pace import court_pace
from fitball.inference.prediction.drop_test import drop_test, lab_generator
from fitball.inference.prediction.outputs import golden
from fitball.inference.prediction.posterior_predictive import predictive, predictive_generator
from fitball.inference.prediction.reach import spanning_impacts
from fitball.inference.problem.parameters import Parameter
from fitball.inference.problem.problem import Problem
from fitball.inference.results import sentences
from fitball.inference.results.assumptions import Assumptions
from fitball.inference.results.evidence import Adequacy, Profiles
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.quantiles import MEDIAN_FIRST, SUMMARY, quantiles
from fitball.inference.results.results import (
    TARGET_R_HAT,
    BudgetLine,
    Diagnostics,
    ErrorBudget,
    Estimate,
    Fit,
    Golden,
    LeastSquares,
    LevelEstimate,
    PointFit,
    Posterior,
    Predictive,
    RunStatus,
    Verdict,
    reported,
    thinned,
)
from fitball.inference.results.sentences import listed
from fitball.inference.results.source import source_of
from fitball.inference.sampling.convergence import summaries
from fitball.inference.sampling.ensembles import Sampled
from fitball.models.types import Rebound
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, Impacts
from fitball.version import package_versions

# How large the numerical error of the rebounds is, beside the measurement error and the posterior width.

INDEPENDENT = "an independent integration (matrix exponentials, events by bisection)"
ROUNDED = "the same closed form with every input rounded the other way"
STIFF = f"{ROUNDED} (shell and core oscillate too fast for {INDEPENDENT})"
# Steps an impact, of some microseconds, up to which the independent integration is worth its time.
AFFORDED = 1e5


def error_budget(
    problem: Problem, fitted: FittedModel, point: PointFit, prediction: Predictive | None, golden: Golden
) -> ErrorBudget:
    """The budget of every measured column, at the golden impacts and the point estimate.

    A model with an oracle is compared with that independent integration of the same motion, unless it would take
    forever. The others are algebraic, and only rounding moves them: there the change is taken when each input moves
    by one unit in the last place.
    """
    oracle = fitted.model.oracle
    if oracle is not None and oracle.steps(golden.parameters, golden.impacts) <= AFFORDED:
        exact = oracle.rebound(golden.parameters, golden.impacts)
        error, reference = _differences(golden.rebound, exact), INDEPENDENT
    else:
        error, reference = _by_rounding(fitted, golden), ROUNDED if oracle is None else STIFF
    widths = (
        {}
        if prediction is None
        else {predicted.name: predicted.mean_q84 - predicted.mean_q16 for predicted in prediction.observables}
    )
    lines = {}
    for observable in problem.observables:
        sd = observable.sds(point.values, point.rebound)
        lines[observable.name] = BudgetLine(
            numerical=float(np.max(error[observable.name], initial=0.0)),
            measurement=float(np.median(sd)),
            posterior=0.5 * float(np.median(widths[observable.name])) if observable.name in widths else None,
        )
    return ErrorBudget(len(golden.impacts), reference, lines)


def _by_rounding(fitted: FittedModel, golden: Golden) -> Mapping[str, FloatArray]:
    given = golden.impacts
    base = fitted.rebound(given)
    values = np.repeat(fitted.point[None, :], fitted.point.size, axis=0)
    np.fill_diagonal(values, np.nextafter(fitted.point, np.inf))
    moved = [_differences(fitted.rebound(given, row[None, :]), base) for row in values]
    for name in ("v_x1", "v_y1", "omega_1"):
        other: Impacts = replace(given, **{name: np.nextafter(getattr(given, name), np.inf)})
        moved.append(_differences(fitted.rebound(other), base))
    return {name: np.sum([differences[name] for differences in moved], axis=0) for name in moved[0]}


def _differences(one: Rebound, other: Rebound) -> Mapping[str, FloatArray]:
    """Absolute differences of every column that can be measured; zero where one is beyond a bound, not known."""
    gaps = {name: np.abs(column.predict(one) - column.predict(other)) for name, column in OBSERVABLES.items()}
    return {name: np.where(np.isfinite(gap), gap, 0.0) for name, gap in gaps.items()}


# Notes of a fit on its force records: how much they count, and where they contradict the model.

# Misfit, as a share of the peak, from which a warning is given: over three times the median of its prior.
LARGE = 0.1
# Root mean square of standardised deviations from which the stated noise is wrong, and the logarithm of ratios of
# impulses from which units are.
EXCESS = 2.0
OFF = 0.25


def force_notes(problem: Problem, point: PointFit) -> tuple[str, ...]:
    """Sentences about the records at the point estimate; none without records."""
    records = problem.force
    if records is None:
        return ()
    columns = {name: np.array([value]) for name, value in point.values.items()}
    alignment = aligned(problem, records, columns)
    sd, misfit = point.values[SD], point.values[MISFIT]
    # How much the height of the pulse is known by the record, against as many independent samples of its noise.
    first = records.first - (alignment.start + alignment.move)
    force, _rate = mean_forces(problem, columns, records.rows, first, records.spacing, records.nodes)
    seen = np.where(records.mask, force, 0.0)
    information = np.sum((rotated(records, seen) / alignment.spread) ** 2)
    alone = np.sum(seen**2 * records.block[:, None] / (sd**2 + (misfit * records.peak[:, None]) ** 2))
    samples = int(np.median(records.samples))
    worth = samples * information / alone
    notes = [
        f"force records: sensor noise {sd:.3g} N per sample; misfit of the model's force {100.0 * misfit:.2g} % of "
        f"the peak. The {samples} samples of a record count as {worth:.2g} independent ones. The misfit is assumed "
        "independent between impacts: more impacts do not average out a misfit that all share"
    ]
    rows = alignment.rows(records)[0, :, :-1]
    excess = math.sqrt(float(np.sum(rows**2)) / max(1, int(records.mask.sum()) - len(records)))
    # Tiny where a record has none.
    ratios = np.maximum(records.means.sum(axis=1) * records.spacing, 1e-12) / (seen[0].sum(axis=1) * records.spacing)
    typical = float(np.median(ratios))
    if misfit > LARGE:
        notes.append(
            f"MISFIT: the model's force differs from the records by {100.0 * misfit:.0f} % of their peak. Check "
            "units, the calibration of the sensor and the ball's mass before you use k_y"
        )
    if excess > EXCESS:
        notes.append(f"MISFIT: residuals of the force records are {excess:.1f} × their stated noise")
    if abs(math.log(typical)) > OFF:
        notes.append(
            f"MISFIT: the impulse of the force records is {typical:.2f} × the model's. Check the unit of F, the "
            "calibration of the sensor and the ball's mass"
        )
    return tuple(notes)


# What each surface, ball or table has of a parameter that differs between them.


def group_estimates(problem: Problem, point: PointFit, posterior: Posterior | None) -> tuple[LevelEstimate, ...]:
    """The value at every level, at the point estimate and, with a posterior, its quantiles."""
    at_point = {name: np.array([value]) for name, value in point.values.items()}
    columns = None if posterior is None else problem.all_values(posterior.draws)
    estimates = []
    for pooling in problem.pooling:
        for place, label in enumerate(pooling.labels):
            draws: FloatArray | None = None if columns is None else pooling.value(columns, label)
            estimates.append(
                LevelEstimate(
                    pooling.parameter,
                    pooling.column,
                    label,
                    problem.model.specs[pooling.parameter].unit,
                    int(np.count_nonzero(pooling.index == place)),
                    float(pooling.value(at_point, label)[0]),
                    sd=None if draws is None else float(np.std(draws, ddof=1)),
                    **(dict.fromkeys(MEDIAN_FIRST) if draws is None else quantiles(draws, MEDIAN_FIRST)),
                )
            )
    return tuple(estimates)


# Draws that fit.json holds: enough to look at, and to know the posterior beside it again; predictions take more.
KEPT_DRAWS = 400


def assemble(
    problem: Problem,
    effort: Effort,
    squares: LeastSquares,
    point: PointFit,
    profiled: tuple[Profiles, Profiles],
    sampled: Sampled | None,
    posterior: Posterior | None,
    watch: Stopwatch,
    remarks: tuple[str, ...] = (),
    assumptions: Assumptions | None = None,
) -> Fit:
    """The fit of a problem; `profiled` with and without the scene; a point fit without `sampled` and `posterior`;
    `remarks` are those of its search, `assumptions` what changing them one by one gave, if that was done.
    """
    covariance = correlation = None
    prediction = diagnostics = None
    with watch.stage("adequacy"):
        described = adequacy(problem, point, posterior, effort.seed, assumptions)
        unfitted = by_label.differences(problem, point)
        filmed = camera_notes(problem, point)
    with watch.stage("verdicts and prediction"):
        if posterior is not None and sampled is not None:
            covariance = np.atleast_2d(np.cov(posterior.draws, rowvar=False))
            correlation = np.atleast_2d(np.corrcoef(posterior.draws, rowvar=False))
            prediction = predictive(problem, point, posterior, predictive_generator(effort.seed))
            diagnostics = diagnose(sampled, effort)
        regimes = () if prediction is None else prediction.regimes
        identifiability, judgements = examine(
            problem, point, profiled, posterior, correlation, regimes, [*point.optima, *squares.optima]
        )
        estimates = [
            _estimate(
                parameter,
                judgements[parameter.name],
                point.values[parameter.name],
                _posterior_numbers(parameter.name, posterior, sampled),
                described,
                assumptions,
            )
            for parameter in problem.parameters
        ]
        quantified = derived(problem, point, posterior, derived_generator(effort.seed))
        followed = [
            _estimate(
                item.quantity.parameter,
                item.judged,
                item.point,
                summaries(item.draws),
                described,
                assumptions,
                item.quantity,
            )
            for item in quantified
        ]
        fitted = _fitted(problem, point, posterior)
        parameters, quantities = ({item.name: item for item in some} for some in (estimates, followed))
        chosen = golden(fitted, problem.impacts)
        budget = error_budget(problem, fitted, point, prediction, chosen)
    status = RunStatus.POINT_ONLY
    if diagnostics is not None:
        status = RunStatus.CONVERGED if diagnostics.converged else RunStatus.NOT_CONVERGED
    lab = lab_generator(effort.seed)
    return Fit(
        problem=problem,
        source=source_of(problem),
        notes=(*problem.table.remarks, *problem.notes, *remarks, *force_notes(problem, point), *filmed),
        balances=scene_balances(problem.table, problem.scene),
        least_squares=squares,
        point=point,
        posterior=posterior,
        log_posterior=point.log_posterior,
        log_likelihood=point.log_likelihood,
        rms=point.rms,
        optima=point.optima,
        optima_log_posterior=point.optima_log_posterior,
        parameters=parameters,
        derived=quantities,
        covariance=covariance,
        correlation=correlation,
        diagnostics=diagnostics,
        predictive=prediction,
        identifiability=identifiability,
        fitted=fitted,
        golden=chosen,
        error_budget=budget,
        levels=group_estimates(problem, point, posterior),
        differences=(*differences(problem, quantified), *unfitted),
        status=status,
        verdict=f"{described.sentence} "
        f"{_sentence(status, diagnostics, reported(parameters, quantities, fitted.levels), identifiability.several)}",
        seed=effort.seed,
        timings=tuple(watch.timings),
        court_pace=court_pace(problem, point, posterior, lab),
        drop_test=drop_test(problem, point, posterior, lab),
        adequacy=described,
        assumptions=assumptions,
        versions=package_versions(),
    )


def diagnose(sampled: Sampled, effort: Effort) -> Diagnostics:
    """How well the chains agree."""
    ensembles, _, walkers, _ = sampled.chains.shape
    steps = sampled.steps
    convergence = sampled.convergence
    complaints = []
    for name, r_hat in convergence.r_hat.items():
        least = min(convergence.ess_bulk[name], convergence.ess_tail[name])
        if not r_hat < TARGET_R_HAT:
            complaints.append(sentences.R_HAT.format(name=name, r_hat=r_hat, target=TARGET_R_HAT))
        if not least >= effort.ess:
            complaints.append(sentences.FEW_EFFECTIVE.format(name=name, ess=least, target=effort.ess))
    return Diagnostics(
        ensembles=ensembles,
        walkers=walkers,
        warm_up=sampled.warm_up,
        steps=steps,
        kept=sampled.kept.shape[1],
        max_steps=effort.max_steps,
        acceptance=sampled.acceptance,
        min_ess_bulk=min(convergence.ess_bulk.values()),
        min_ess_tail=min(convergence.ess_tail.values()),
        max_r_hat=convergence.max_r_hat,
        ess_bulk=convergence.ess_bulk,
        ess_tail=convergence.ess_tail,
        r_hat=convergence.r_hat,
        evaluations=ensembles * steps * walkers,
        converged=sampled.converged,
        complaints=tuple(complaints),
        target_ess=effort.ess,
        pareto_k=sampled.pareto_k,
    )


def _estimate(
    parameter: Parameter,
    judged: Judgement,
    point: float,
    numbers: Mapping[str, float],
    described: Adequacy,
    assumptions: Assumptions | None,
    quantity: Quantity | None = None,
) -> Estimate:
    """A parameter, or a `quantity` that follows from several, with the `numbers` of its posterior; conditional where
    one of its parts is.
    """
    parts = () if quantity is None else quantity.parts
    verdict, given = qualified(parameter.name, judged, described, assumptions, parts)
    reason = judged.reason
    if verdict is Verdict.CONDITIONAL and quantity is None:
        reason = described.qualified(parameter.name, reason)
    return Estimate(
        name=parameter.name,
        unit=parameter.spec.unit,
        meaning=parameter.spec.meaning,
        prior=parameter.prior.text if quantity is None else "from its parts",
        point=point,
        contraction=judged.contraction,
        verdict=verdict,
        given=given,
        reason=reason,
        prior_source=parameter.prior_source,
        **{**dict.fromkeys((*SUMMARY, "ess_bulk", "ess_tail", "r_hat")), **numbers},
    )


def _posterior_numbers(name: str, posterior: Posterior | None, sampled: Sampled | None) -> dict[str, float]:
    """The posterior of a parameter and how well it is sampled; nothing of one that is fixed."""
    if posterior is None or sampled is None or name not in posterior.names:
        return {}
    found = sampled.convergence
    return {
        **summaries(posterior.values[..., posterior.names.index(name)]),
        "ess_bulk": found.ess_bulk[name],
        "ess_tail": found.ess_tail[name],
        "r_hat": found.r_hat[name],
    }


def derived_generator(seed: int) -> np.random.Generator:
    """The generator of the draws of derived quantities of a point fit, a stream of its own."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(26,)))


def _fitted(problem: Problem, point: PointFit, posterior: Posterior | None) -> FittedModel:
    names = tuple(parameter.name for parameter in problem.parameters)
    draws: FloatArray = np.empty((0, len(names)))
    if posterior is not None:
        columns = problem.all_values(thinned(posterior, KEPT_DRAWS))
        draws = np.stack([columns[name] for name in names], axis=1)
    return FittedModel(
        model_name=problem.model.name,
        options=dict(problem.model.options),
        ball=problem.model.ball,
        tangential=problem.model.tangential,
        names=names,
        point=np.array([point.values[name] for name in names]),
        draws=draws,
        impacts=spanning_impacts(problem.impacts, problem.model.ball.radius),
        levels=tuple(item.levels for item in problem.pooling),
    )


# Verdicts in the order in which they are reported, and of which parameters they hold.
VERDICTS = (
    (Verdict.IDENTIFIED, sentences.DETERMINED),
    (Verdict.GIVEN, sentences.GIVEN),
    (Verdict.UNEXAMINED, sentences.UNEXAMINED),
    (Verdict.CONDITIONAL, sentences.CONDITIONAL),
    (Verdict.ONE_SIDED, sentences.ONE_SIDED),
    (Verdict.PRIOR_DOMINATED, sentences.NOT_DETERMINED),
    (Verdict.EXTRAPOLATED, sentences.EXTRAPOLATED),
)


def _sentence(
    status: RunStatus, diagnostics: Diagnostics | None, estimates: Sequence[Estimate], several: str = ""
) -> str:
    if diagnostics is None:
        head = sentences.POINT_ONLY
    elif status is RunStatus.CONVERGED:
        least = min(diagnostics.min_ess_bulk, diagnostics.min_ess_tail)
        head = sentences.CONVERGED.format(ess=least, r_hat=diagnostics.max_r_hat)
    else:
        sizes = {name: min(size, diagnostics.ess_tail[name]) for name, size in diagnostics.ess_bulk.items()}
        rarest = min(sizes, key=lambda name: sizes[name])
        apart = max(diagnostics.r_hat, key=lambda name: diagnostics.r_hat[name])
        head = sentences.NOT_CONVERGED.format(
            steps=diagnostics.steps,
            ess=sizes[rarest],
            rarest=rarest,
            enough=diagnostics.target_ess,
            r_hat=diagnostics.r_hat[apart],
            apart=apart,
            target=TARGET_R_HAT,
        )
    parts: list[str] = []
    for verdict, template in VERDICTS:
        names = [estimate.name for estimate in estimates if estimate.verdict is verdict]
        if names:
            # The data are named once.
            named = any(part.startswith((sentences.THE_DATA, sentences.THEY)) for part in parts)
            they = sentences.THEY if named else sentences.THE_DATA
            its = sentences.ITS_PRIOR if len(names) == 1 else sentences.THEIR_PRIORS
            parts.append(template.format(they=they, names=listed(names), its=its))
    # Results come first, unless sampling casts doubt on them.
    found = [*([several] if several else []), *parts]
    return " ".join([*found, head] if status is not RunStatus.NOT_CONVERGED else [head, *found])


def qualified(
    name: str,
    judged: Judgement,
    adequacy: Adequacy | None,
    assumptions: Assumptions | None,
    parts: Sequence[str] = (),
) -> tuple[Verdict, tuple[str, ...]]:
    """The verdict on one parameter, or on a quantity that follows from the parameters called `parts`, and the
    assumptions it is given; None for what was not examined.
    """
    if judged.verdict is not Verdict.IDENTIFIED:
        return judged.verdict, ()
    if adequacy is not None and any(adequacy.conditional(one) for one in (name, *parts)):
        return Verdict.CONDITIONAL, ()
    given = (*judged.given, *rests_on(name, adequacy, assumptions))
    if given or assumptions is None or assumptions.examined:
        return (Verdict.GIVEN if given else Verdict.IDENTIFIED), given
    return Verdict.UNEXAMINED, ()


def rests_on(name: str, adequacy: Adequacy | None, assumptions: Assumptions | None) -> tuple[str, ...]:
    """The choices that the value of a parameter is given."""
    known = [found.given.get(name, ()) for found in (adequacy, assumptions) if found is not None]
    return tuple(dict.fromkeys(choice for choices in known for choice in choices))
