"""The whole road from a table to a fit: point fit, posterior, diagnosis, prediction."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from fitball.data.balances import scene_balances
from fitball.errors import ParameterError, enough_memory
from fitball.inference.identifiability.examine import examine, profile_all
from fitball.inference.identifiability.posterior_verdict import Judgement
from fitball.inference.point.point_fit import point_fit
from fitball.inference.prediction.court_pace import court_pace
from fitball.inference.prediction.error_budget import error_budget
from fitball.inference.prediction.extrapolation import spanning_impacts
from fitball.inference.prediction.force_notes import force_notes
from fitball.inference.prediction.golden import golden
from fitball.inference.prediction.group_estimates import group_estimates
from fitball.inference.prediction.posterior_predictive import predictive, predictive_generator
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import Profiles
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.quantiles import SUMMARY
from fitball.inference.results.results import (
    TARGET_ESS,
    Diagnostics,
    Estimate,
    Fit,
    LeastSquares,
    PointFit,
    Posterior,
    RunStatus,
    Timing,
    Verdict,
    thinned,
)
from fitball.inference.sampling.chain_file import ChainFile
from fitball.inference.sampling.ensembles import (
    ENSEMBLES,
    Progress,
    Sampled,
    Schedule,
    Settings,
    default_walkers,
    sample,
)
from fitball.inference.sampling.monte_carlo_error import summaries
from fitball.inference.sampling.prior_draws import prior_draws
from fitball.inference.sampling.stragglers import left_behind_words
from fitball.inference.second_search import search_again
from fitball.values import FloatArray
from fitball.version import __version__

MAX_STEPS = 20_000
# Walkers of all ensembles together: a hundred steps of more would fill the memory before anything could be diagnosed.
MOST_WALKERS = 20_000
KEPT_DRAWS = 400


@dataclass(frozen=True)
class Effort:
    """How much to spend: `walkers` of each ensemble (None: four a parameter), steps at most, threads, seed;
    `ess` is the effective sample size that every parameter must have.
    """

    seed: int = 1
    point_only: bool = False
    walkers: int | None = None
    ensembles: int = ENSEMBLES
    max_steps: int = MAX_STEPS
    cores: int = 2
    ess: float = TARGET_ESS

    def settings(self, problem: Problem) -> Settings:
        """Sampler settings for a problem. Raises ParameterError for numbers that cannot work."""
        walkers = default_walkers(problem.dimension) if self.walkers is None else self.walkers
        least = max(4, 2 * problem.dimension)
        if walkers < least or walkers % 2:
            raise ParameterError(
                f"walkers = {walkers}: an ensemble over {problem.dimension} free parameters needs an even number "
                f"of at least {least}"
            )
        if self.max_steps < 100:
            raise ParameterError(f"max_steps = {self.max_steps}: at least 100 are needed to diagnose anything")
        if self.cores < 1:
            raise ParameterError(f"cores = {self.cores}: expected at least 1")
        if self.ensembles < 2:
            raise ParameterError(f"ensembles = {self.ensembles}: at least 2 are needed to compare")
        if walkers * self.ensembles > MOST_WALKERS:
            raise ParameterError(
                f"walkers = {walkers} in each of {self.ensembles} ensembles: expected at most {MOST_WALKERS} in all"
            )
        if self.seed < 0:
            raise ParameterError(f"seed = {self.seed}: expected a number not below 0")
        return Settings(walkers, self.ensembles, self.max_steps, self.cores, self.seed, Schedule(target_ess=self.ess))


@dataclass
class Stopwatch:
    """Wall time by stage."""

    timings: list[Timing] = field(default_factory=list)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what happens inside."""
        begun = time.perf_counter()
        yield
        self.timings.append(Timing(name, time.perf_counter() - begun))


def fingerprint(problem: Problem, effort: Effort) -> str:
    """SHA-256 over all that must be equal for two runs to make the same chain (steps and threads may differ)."""
    settings = effort.settings(problem)
    content = {
        "version": __version__,
        "table": problem.table.digest,
        "model": [problem.model.name, dict(problem.model.options)],
        "ball": [problem.model.ball.mass, problem.model.ball.radius, problem.model.ball.inertia],
        "parameters": [[item.name, item.prior.text, item.fixed] for item in problem.parameters],
        "contact_time": problem.contact_time,
        "noise": [[observable.name, observable.noise] for observable in problem.observables],
        "levels": [[item.parameter, item.column, item.index.tolist()] for item in problem.pooling],
        "offsets": None
        if problem.group_bias is None
        else [problem.group_bias.column, problem.group_bias.index.tolist()],
        "incident": None if problem.incident is None else problem.incident.covariance.tolist(),
        "sampler": [settings.walkers, settings.ensembles, settings.seed],
    }
    if problem.force is not None:
        content["force"] = [problem.force.digest, problem.force.start_sd]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


@enough_memory()
def run(
    problem: Problem,
    effort: Effort,
    chain_file: ChainFile | None = None,
    resume: bool = False,
    report: Callable[[str, Progress | None], None] = lambda _stage, _progress: None,
    beside: Sequence[Mapping[str, float]] = (),
) -> Fit:
    """Fit a problem.

    `report` is told the stage and, while sampling, the progress; the point is searched from `beside` (all parameters
    by name) too. Raises FitError, ParameterError, MemoryShortageError and `sampling.Interrupted` on Ctrl-C with the
    chain kept.
    """
    settings = effort.settings(problem)
    seeds = np.random.SeedSequence(effort.seed).spawn(3)
    watch = Stopwatch()
    report("point fit", None)
    with watch.stage("point fit"):
        shared = replace(problem, threads=settings.cores)
        squares, point = point_fit(shared, np.random.default_rng(seeds[0]), beside)
    if effort.point_only:
        profiled = _profiles(problem, settings, squares, point, watch, report)
        return _assemble(problem, effort, squares, point, profiled, None, None, watch)
    with watch.stage("sampling"):
        optima = np.array([[optimum[name] for name in problem.free_names] for optimum in point.optima])
        sampled = sample(
            problem,
            problem.to_coordinates(optima),
            settings,
            chain_file,
            resume,
            lambda progress: report("sampling", progress),
        )
    report("diagnosis", None)
    with watch.stage("diagnosis"):
        shape = sampled.kept.shape
        posterior = Posterior(
            problem.free_names,
            problem.to_values(sampled.kept.reshape(-1, shape[-1])).reshape(shape),
            sampled.log_posterior[:, sampled.warm_up :],
            prior_draws(problem, np.random.default_rng(seeds[1])),
        )
        squares, point, said = search_again(shared, squares, point, sampled)
    profiled = _profiles(problem, settings, squares, point, watch, report)
    said = (*left_behind_words(sampled.moved), *said)
    return _assemble(problem, effort, squares, point, profiled, sampled, posterior, watch, said)


def _profiles(
    problem: Problem,
    settings: Settings,
    squares: LeastSquares,
    point: PointFit,
    watch: Stopwatch,
    report: Callable[[str, Progress | None], None],
) -> tuple[Profiles, Profiles]:
    with watch.stage("profiles"):
        shared = replace(problem, threads=settings.cores)
        return profile_all(shared, point, [*point.optima, *squares.optima], lambda stage: report(stage, None))


def _assemble(
    problem: Problem,
    effort: Effort,
    squares: LeastSquares,
    point: PointFit,
    profiled: tuple[Profiles, Profiles],
    sampled: Sampled | None,
    posterior: Posterior | None,
    watch: Stopwatch,
    said: tuple[str, ...] = (),
) -> Fit:
    covariance = correlation = None
    prediction = diagnostics = None
    with watch.stage("verdicts and prediction"):
        if posterior is not None and sampled is not None:
            covariance = np.atleast_2d(np.cov(posterior.draws, rowvar=False))
            correlation = np.atleast_2d(np.corrcoef(posterior.draws, rowvar=False))
            prediction = predictive(problem, point, posterior, predictive_generator(effort.seed))
            diagnostics = _diagnostics(sampled, effort)
        regimes = () if prediction is None else prediction.regimes
        identifiability, judgements = examine(problem, point, profiled, posterior, correlation, regimes)
        estimates = tuple(
            _estimate(problem, k, point, posterior, sampled, judgements) for k in range(len(problem.parameters))
        )
        fitted = _fitted(problem, point, posterior)
        chosen = golden(fitted, problem.impacts)
        budget = error_budget(problem, fitted, point, prediction, chosen)
    status = RunStatus.POINT_ONLY
    if diagnostics is not None:
        status = RunStatus.CONVERGED if diagnostics.converged else RunStatus.NOT_CONVERGED
    return Fit(
        problem=problem,
        notes=(*problem.notes, *said, *force_notes(problem, point)),
        balances=scene_balances(problem.table, problem.scene),
        least_squares=squares,
        point=point,
        posterior=posterior,
        estimates=estimates,
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
        verdict=_sentence(status, diagnostics, estimates),
        seed=effort.seed,
        timings=tuple(watch.timings),
        court_pace=court_pace(problem, point, posterior),
    )


def _diagnostics(sampled: Sampled, effort: Effort) -> Diagnostics:
    ensembles, steps, walkers, _ = sampled.chains.shape
    found = sampled.convergence
    complaints = []
    for name, r_hat in found.r_hat.items():
        least = min(found.ess_bulk[name], found.ess_tail[name])
        if not r_hat < 1.01:
            complaints.append(f"{name}: the ensembles disagree, R-hat {r_hat:.3f} (wanted below 1.01)")
        if not least >= effort.ess:
            complaints.append(f"{name}: effective sample size {least:.0f} (wanted {effort.ess:.0f})")
    return Diagnostics(
        ensembles=ensembles,
        walkers=walkers,
        warm_up=sampled.warm_up,
        steps=steps,
        max_steps=effort.max_steps,
        acceptance=sampled.acceptance,
        min_ess_bulk=min(found.ess_bulk.values()),
        min_ess_tail=min(found.ess_tail.values()),
        max_r_hat=found.max_r_hat,
        ess_bulk=found.ess_bulk,
        ess_tail=found.ess_tail,
        r_hat=found.r_hat,
        evaluations=ensembles * steps * walkers,
        converged=sampled.converged,
        complaints=tuple(complaints),
        target_ess=effort.ess,
    )


def _estimate(
    problem: Problem,
    row: int,
    point: PointFit,
    posterior: Posterior | None,
    sampled: Sampled | None,
    judgements: Mapping[str, Judgement],
) -> Estimate:
    item = problem.parameters[row]
    numbers: dict[str, float | None] = dict.fromkeys((*SUMMARY, "ess_bulk", "ess_tail", "r_hat"))
    if item.free and posterior is not None and sampled is not None:
        convergence = sampled.convergence
        numbers |= summaries(posterior.values[..., posterior.names.index(item.name)])
        numbers |= {
            "ess_bulk": convergence.ess_bulk[item.name],
            "ess_tail": convergence.ess_tail[item.name],
            "r_hat": convergence.r_hat[item.name],
        }
    judged = judgements[item.name]
    return Estimate(
        name=item.name,
        unit=item.spec.unit,
        label=item.spec.label,
        meaning=item.spec.meaning,
        prior=item.prior.text,
        point=point.values[item.name],
        contraction=judged.contraction,
        verdict=judged.verdict,
        reason=judged.reason,
        **numbers,
    )


def _fitted(problem: Problem, point: PointFit, posterior: Posterior | None) -> FittedModel:
    names = tuple(item.name for item in problem.parameters)
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
        impacts=spanning_impacts(problem.table.impacts, problem.model.ball.radius),
    )


def _sentence(status: RunStatus, diagnostics: Diagnostics | None, estimates: tuple[Estimate, ...]) -> str:
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
        (Verdict.ONE_SIDED, "It bounds from one side only"),
        (Verdict.PRIOR_DOMINATED, "It does not tell"),
    ):
        names = [item.name for item in estimates if item.verdict is verdict]
        if names:
            parts.append(f"{words} {', '.join(names)}.")
    return " ".join([head, *parts])
