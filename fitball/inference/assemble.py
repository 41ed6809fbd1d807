"""From what the stages of a fit gave to the one frozen result: estimates, verdicts, predictions, a sentence.

What a table tells of a parameter within a model is not yet what may be said of it: a model that fails identifies
nothing, a value that moves with an assumption is known only given that assumption, and where assumptions could not be
examined the verdict says so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fitball.data.balances import scene_balances
from fitball.inference.adequacy.describe import adequacy
from fitball.inference.effort import Effort, Stopwatch
from fitball.inference.identifiability.derived import Derived, derived
from fitball.inference.identifiability.examine import examine
from fitball.inference.identifiability.posterior_verdict import Judgement
from fitball.inference.prediction.court_pace import court_pace
from fitball.inference.prediction.drop_test import drop_test
from fitball.inference.prediction.error_budget import error_budget
from fitball.inference.prediction.extrapolation import spanning_impacts
from fitball.inference.prediction.force_notes import force_notes
from fitball.inference.prediction.group_estimates import group_estimates
from fitball.inference.prediction.one_way import lab_generator
from fitball.inference.prediction.port_check import golden
from fitball.inference.prediction.posterior_predictive import predictive, predictive_generator
from fitball.inference.problem.problem import Problem
from fitball.inference.results.adequacy import Adequacy
from fitball.inference.results.assumptions import Assumptions
from fitball.inference.results.evidence import Profiles
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.quantiles import SUMMARY
from fitball.inference.results.results import (
    TARGET_R_HAT,
    Diagnostics,
    Estimate,
    Fit,
    LeastSquares,
    PointFit,
    Posterior,
    RunStatus,
    Verdict,
    thinned,
)
from fitball.inference.results.source import source_of
from fitball.inference.sampling.convergence import summaries
from fitball.inference.sampling.ensembles import Sampled
from fitball.values import FloatArray
from fitball.version import package_versions

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
    said: tuple[str, ...] = (),
    assumptions: Assumptions | None = None,
) -> Fit:
    """The fit of a problem; `profiled` with and without the scene; a point fit without `sampled` and `posterior`;
    `said` is what its search has to tell, `assumptions` what a look at them found, if there was one.
    """
    covariance = correlation = None
    prediction = diagnostics = None
    with watch.stage("adequacy"):
        described = adequacy(problem, point, posterior, effort.seed, assumptions)
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
            _estimate(problem, k, point, posterior, sampled, judgements, described, assumptions)
            for k in range(len(problem.parameters))
        ]
        followed = [
            _derived(item, described, assumptions)
            for item in derived(problem, point, posterior, derived_generator(effort.seed))
        ]
        fitted = _fitted(problem, point, posterior)
        chosen = golden(fitted, problem.impacts)
        budget = error_budget(problem, fitted, point, prediction, chosen)
    status = RunStatus.POINT_ONLY
    if diagnostics is not None:
        status = RunStatus.CONVERGED if diagnostics.converged else RunStatus.NOT_CONVERGED
    lab = lab_generator(effort.seed)
    return Fit(
        problem=problem,
        source=source_of(problem),
        notes=(*problem.table.remarks, *problem.notes, *said, *force_notes(problem, point)),
        balances=scene_balances(problem.table, problem.scene),
        least_squares=squares,
        point=point,
        posterior=posterior,
        log_posterior=point.log_posterior,
        log_likelihood=point.log_likelihood,
        rms=point.rms,
        optima=point.optima,
        optima_log_posterior=point.optima_log_posterior,
        parameters={item.name: item for item in estimates},
        derived={item.name: item for item in followed},
        covariance=covariance,
        correlation=correlation,
        diagnostics=diagnostics,
        predictive=prediction,
        identifiability=identifiability,
        fitted=fitted,
        golden=chosen,
        error_budget=budget,
        levels=group_estimates(problem, point, posterior),
        status=status,
        verdict=f"{described.sentence} "
        f"{_sentence(status, diagnostics, [*followed, *estimates], identifiability.several)}",
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
            complaints.append(f"{name}: the ensembles disagree, R-hat {r_hat:.3f} (wanted below {TARGET_R_HAT})")
        if not least >= effort.ess:
            complaints.append(f"{name}: effective sample size {least:.0f} (wanted {effort.ess:.0f})")
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
    problem: Problem,
    row: int,
    point: PointFit,
    posterior: Posterior | None,
    sampled: Sampled | None,
    judgements: Mapping[str, Judgement],
    described: Adequacy | None,
    assumptions: Assumptions | None,
) -> Estimate:
    parameter = problem.parameters[row]
    numbers: dict[str, float | None] = dict.fromkeys((*SUMMARY, "ess_bulk", "ess_tail", "r_hat"))
    if parameter.free and posterior is not None and sampled is not None:
        convergence = sampled.convergence
        numbers |= summaries(posterior.values[..., posterior.names.index(parameter.name)])
        numbers |= {
            "ess_bulk": convergence.ess_bulk[parameter.name],
            "ess_tail": convergence.ess_tail[parameter.name],
            "r_hat": convergence.r_hat[parameter.name],
        }
    judged = judgements[parameter.name]
    verdict, given = qualified(parameter.name, judged, described, assumptions)
    reason = judged.reason
    if verdict is Verdict.CONDITIONAL and described is not None:
        reason = f"{described.why(parameter.name)}: {reason}"
    return Estimate(
        name=parameter.name,
        unit=parameter.spec.unit,
        meaning=parameter.spec.meaning,
        prior=parameter.prior.text,
        point=point.values[parameter.name],
        contraction=judged.contraction,
        verdict=verdict,
        given=given,
        reason=reason,
        prior_source=parameter.prior_source,
        **numbers,
    )


def derived_generator(seed: int) -> np.random.Generator:
    """The generator of the draws of derived quantities of a point fit, a stream of its own."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(26,)))


def _derived(item: Derived, described: Adequacy | None, assumptions: Assumptions | None) -> Estimate:
    """A quantity as an estimate, conditional where one of its parts is."""
    parameter, judged = item.quantity.parameter, item.judged
    verdict, given = qualified(parameter.name, judged, described, assumptions, item.quantity.parts)
    numbers: dict[str, Any] = {**dict.fromkeys(("ess_bulk", "ess_tail", "r_hat")), **summaries(item.draws)}
    return Estimate(
        name=parameter.name,
        unit=parameter.spec.unit,
        meaning=parameter.spec.meaning,
        prior="of its parts",
        point=item.point,
        contraction=judged.contraction,
        verdict=verdict,
        given=given,
        reason=judged.reason,
        **numbers,
    )


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
    )


def _sentence(
    status: RunStatus, diagnostics: Diagnostics | None, estimates: Sequence[Estimate], several: str = ""
) -> str:
    if diagnostics is None:
        head = "Point fit only: no posterior; the verdicts rest on profile likelihoods and Fisher information."
    elif status is RunStatus.CONVERGED:
        head = (
            f"Converged: every parameter has an effective sample size of at least "
            f"{min(diagnostics.min_ess_bulk, diagnostics.min_ess_tail):.0f} and R-hat of at most "
            f"{diagnostics.max_r_hat:.3f}."
        )
    else:
        head = f"Not converged after {diagnostics.steps} steps: " + "; ".join(diagnostics.complaints) + "."
    parts = []
    for verdict, words in (
        (Verdict.IDENTIFIED, "The table identifies"),
        (Verdict.GIVEN, "Given assumptions that it cannot test, it identifies"),
        (Verdict.UNEXAMINED, "It identifies, where assumptions could not be examined,"),
        (Verdict.EXTRAPOLATED, "It extrapolates"),
        (Verdict.CONDITIONAL, "If the model described it, it would identify"),
        (Verdict.ONE_SIDED, "It bounds from one side only"),
        (Verdict.PRIOR_DOMINATED, "It does not tell"),
    ):
        names = [estimate.name for estimate in estimates if estimate.verdict is verdict]
        if names:
            parts.append(f"{words} {', '.join(names)}.")
    return " ".join([head, *([several] if several else []), *parts])


def qualified(
    name: str,
    judged: Judgement,
    adequacy: Adequacy | None,
    assumptions: Assumptions | None,
    parts: Sequence[str] = (),
) -> tuple[Verdict, tuple[str, ...]]:
    """The verdict on one parameter, or on a quantity that follows from the parameters called `parts`, and the
    assumptions it is given; None for what was not looked at.
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
