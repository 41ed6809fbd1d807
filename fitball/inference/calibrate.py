"""The whole road from a table to a fit: point fit, posterior, diagnosis, prediction."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from fitball.errors import enough_memory
from fitball.inference.assemble import assemble
from fitball.inference.assumptions.constants import constants
from fitball.inference.assumptions.look import assumptions_generator, look
from fitball.inference.effort import Effort, Stopwatch
from fitball.inference.identifiability.examine import profile_all
from fitball.inference.identifiability.information import DRAWN_ABOUT, about, known_before
from fitball.inference.point.least_squares import deeper
from fitball.inference.point.point_fit import higher_maximum, point_fit
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import LOOKED_AT
from fitball.inference.results.results import Fit, LeastSquares, PointFit, Posterior
from fitball.inference.sampling.chain_file import ChainFile
from fitball.inference.sampling.convergence import convergence
from fitball.inference.sampling.ensembles import ENSEMBLES, Progress, Sampled, Settings, sample
from fitball.inference.sampling.importance import K_TRUSTED, importance_posterior, smoothed
from fitball.inference.sampling.stragglers import left_behind_words
from fitball.scheduling.engine import engine
from fitball.values import FloatArray
from fitball.version import __version__

# The point fits once more from draws of the chains: a chain goes where no search began, and no point that is
# published lies below a draw.

# Draws that a search begins from; and the sds of all draws by which these lie apart.
BEGUN, APART = 4, 1.0
# Gain of log posterior worth a word: less is what a polish leaves, and moves nothing by a tenth of its sd.
NOTED = 0.01


def search_again(
    problem: Problem, squares: LeastSquares, point: PointFit, sampled: Sampled
) -> tuple[LeastSquares, PointFit, tuple[str, ...]]:
    """The point fits, searched again from the best draws of all steps where one of them lies above the point, and in
    words what came of it.
    """
    draws = sampled.chains.reshape(-1, sampled.chains.shape[-1])
    scores = sampled.log_posterior.ravel()
    # Each search costs as many evaluations as the table has rows.
    count = BEGUN if len(problem.impacts) <= LOOKED_AT else 1
    starts = _best_apart(draws, scores, point.log_posterior, count)
    if not starts.size:
        return squares, point, ()
    higher = higher_maximum(problem, point, problem.to_values(starts))
    if higher.log_posterior - point.log_posterior < NOTED:
        return squares, higher, ()
    after = deeper(problem, squares, [higher.values])
    words = (
        f"the first search for the maximum of the posterior ended at log posterior {point.log_posterior:.2f}, below "
        f"draws of the chains. A second search from the best draws reached {higher.log_posterior:.2f}: "
        f"{_moves(problem, point, higher)}"
    )
    if after is not squares:
        words += f"; chi-square of least squares fell from {squares.chi_square:.3g} to {after.chi_square:.3g}"
    if not sampled.converged:
        words += ". The ensembles started at the lower maximum and do not agree yet: continue the run with more steps"
    return after, higher, (words,)


def _best_apart(draws: FloatArray, scores: FloatArray, least: float, count: int) -> FloatArray:
    """At most `count` draws (found, free) above `least`, best first, none near one before it."""
    above = np.flatnonzero(scores > least)
    ranked = above[np.argsort(-scores[above], kind="stable")]
    spread = draws.std(axis=0)
    spread[spread <= 0.0] = 1.0
    chosen: list[int] = []
    while ranked.size and len(chosen) < count:
        chosen.append(int(ranked[0]))
        ranked = ranked[np.max(np.abs(draws[ranked] - draws[chosen[-1]]) / spread, axis=1) > APART]
    return draws[chosen]


def _moves(problem: Problem, before: PointFit, after: PointFit) -> str:
    """How the three parameters that moved most, in widths of their priors, did so."""
    way = np.abs(np.diff(problem.to_coordinates(problem.free_rows([before.values, after.values])), axis=0))[0]
    names = [problem.free_names[k] for k in np.argsort(-way / problem.prior.width, kind="stable")[:3]]
    return ", ".join(f"{name} changed from {before.values[name]:.3g} to {after.values[name]:.3g}" for name in names)


# Effective draws that are made for each that is asked for, and at least: chains that are dealt out of fewer may
# disagree by chance.
SPARE, LEAST_WEIGHED = 1.5, 1500.0
# Gets the stage and, while sampling, the progress.
Report: TypeAlias = Callable[[str, Progress | None], None]


def silent(_stage: str, _progress: Progress | None) -> None:
    """Report nothing."""


class Drawn(NamedTuple):
    """A sampled posterior: the best values, higher ones among the draws included, chains, draws, and remarks of the
    search.
    """

    squares: LeastSquares
    point: PointFit
    sampled: Sampled
    posterior: Posterior
    remarks: tuple[str, ...]


def fingerprint(problem: Problem, effort: Effort) -> str:
    """SHA-256 over all that must be equal for two runs to make the same chain (steps and threads may differ)."""
    settings = effort.settings(problem)
    content = {
        "version": __version__,
        "table": problem.table.digest,
        "model": [problem.model.name, dict(problem.model.options)],
        "ball": [problem.model.ball.mass, problem.model.ball.radius, problem.model.ball.inertia],
        "parameters": [[parameter.name, parameter.prior.text, parameter.fixed] for parameter in problem.parameters],
        "contact_time": problem.contact_time,
        "noise": [[observable.name, observable.noise] for observable in problem.observables],
        "levels": [[pooling.parameter, pooling.column, pooling.index.tolist()] for pooling in problem.pooling],
        "offsets": None
        if problem.group_bias is None
        else [problem.group_bias.column, problem.group_bias.index.tolist()],
        "incident": problem.errors.incident.tolist() if problem.errors is not None and problem.uncertain else None,
        "sampler": [settings.walkers, settings.ensembles, settings.seed, settings.schedule.warm_up],
    }
    if problem.errors is not None and problem.errors.columns:
        content["errors"] = [problem.errors.columns, problem.errors.follows.tolist(), problem.errors.rest.tolist()]
    if problem.table.flipped:
        content["flipped"] = problem.table.flipped
    if problem.table.ignored:
        content["ignored"] = problem.table.ignored
    if problem.table.columns:
        content["columns"] = dict(problem.table.columns)
    if problem.force is not None:
        content["force"] = [problem.force.digest, problem.force.start_sd]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


@enough_memory()
def run(
    problem: Problem,
    effort: Effort,
    chain_file: ChainFile | None = None,
    resume: bool = False,
    report: Report = silent,
    beside: Sequence[Mapping[str, float]] = (),
    *,
    assumptions: bool = False,
) -> Fit:
    """Fit a problem.

    `report` gets the stage and, while sampling, the progress; the point is searched from `beside` (all parameters
    by name) too. With `assumptions`, alternatives to each choice are fitted quickly. Raises FitError, ParameterError,
    MemoryShortageError and `sampling.Interrupted` on Ctrl-C with the chain kept.
    """
    watch = Stopwatch()
    squares, point = search(problem, effort, watch, report, beside)
    shared = replace(problem, threads=effort.settings(problem).cores)
    sampled, posterior, found = None, None, None
    remarks: tuple[str, ...] = ()
    if not effort.point_only:
        squares, point, sampled, posterior, remarks = draw(
            problem, effort, squares, point, watch, report, chain_file, resume
        )
    with watch.stage("profiles"):
        optima = [*point.optima, *squares.optima]
        profiled = profile_all(shared, point, optima, lambda stage: report(stage, None))
    if assumptions:
        report("assumptions", None)
        with watch.stage("assumptions"):
            found = look(shared, point, posterior, assumptions_generator(effort.seed))
            moving, tilt = constants(shared, point, posterior, _generator(effort, 2))
            found = replace(found, constants=moving, tilt=tilt)
    return assemble(problem, effort, squares, point, profiled, sampled, posterior, watch, remarks, found)


def search(
    problem: Problem,
    effort: Effort,
    watch: Stopwatch,
    report: Report = silent,
    beside: Sequence[Mapping[str, float]] = (),
) -> tuple[LeastSquares, PointFit]:
    """The first stage of `run`: the best values."""
    report("point fit", None)
    with watch.stage("point fit"):
        shared = replace(problem, threads=effort.settings(problem).cores)
        compile_ahead(shared)
        return point_fit(shared, _generator(effort, 0), beside)


def compile_ahead(problem: Problem) -> None:
    """Compile what the model's rebounds and their derivatives call, by several processes at once, unless it is on
    disk or would not be kept there. An algebraic bounce compiles too quickly for a second process to pay.
    """
    if problem.threads == 1 or problem.model.unported or problem.model.convention != "two-mass":
        return
    from fitball.models.two_mass import compile_kernel, to_be_compiled

    if names := to_be_compiled():
        for _ in engine(min(problem.threads, len(names))).unordered(compile_kernel, names):
            pass


def draw(
    problem: Problem,
    effort: Effort,
    squares: LeastSquares,
    point: PointFit,
    watch: Stopwatch,
    report: Report = silent,
    chain_file: ChainFile | None = None,
    resume: bool = False,
) -> Drawn:
    """The second stage of `run`: the posterior, sampled from the optima that `search` found."""
    settings = effort.settings(problem)
    shared = replace(problem, threads=settings.cores)
    with watch.stage("sampling"):
        optima, sampled = problem.to_coordinates(problem.free_rows(point.optima)), None
        remarks: tuple[str, ...] = ()
        if weighs(problem, effort):
            sampled, words = weigh(shared, optima, settings, lambda progress: report("sampling", progress))
            remarks = (words,)
        if sampled is None:
            sampled = sample(
                shared, optima, settings, chain_file, resume, lambda progress: report("sampling", progress)
            )
    report("diagnosis", None)
    with watch.stage("diagnosis"):
        shape = sampled.kept.shape
        posterior = Posterior(
            problem.free_names,
            problem.to_values(sampled.kept.reshape(-1, shape[-1])).reshape(shape),
            sampled.log_posterior[:, sampled.first :],
            known_before(problem, optima[0], _generator(effort, 1)),
        )
        squares, point, found = search_again(shared, squares, point, sampled)
    return Drawn(squares, point, sampled, posterior, (*remarks, *left_behind_words(sampled.moved), *found))


def weighs(problem: Problem, effort: Effort) -> bool:
    """Whether the posterior is drawn by importance sampling: where a density costs much, as for long tables and
    uncertain incident states. Elsewhere ensembles take seconds and also find what no mode shows. A given number of
    `walkers` asks for ensembles.
    """
    return (len(problem.impacts) > LOOKED_AT or problem.uncertain) and effort.walkers is None


def weigh(
    problem: Problem, optima: FloatArray, settings: Settings, report: Callable[[Progress], None]
) -> tuple[Sampled | None, str]:
    """Draws of the posterior about its `optima` (optima, free), in coordinates, each weighed by its density on all
    rows and dealt out to as many chains as there are ensembles; in words what came of it. None where no Student
    distribution comes near the posterior.

    With many rows a posterior becomes normal and its density expensive, as with mixtures at changes of regime:
    walkers cost a hundred times more than importance sampling. Pareto's k measures how heavy the tail of the weights
    is (Vehtari et al. 2024, JMLR 25, 72).
    """
    rng = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=(11,)))
    rows, plan = f"{len(problem.impacts):,} rows", settings.schedule
    proposals = [about(problem, optimum) for optimum in optima[:DRAWN_ABOUT]]
    drawn = importance_posterior(problem, proposals, rng, max(SPARE * plan.target_ess, LEAST_WEIGHED))
    k = smoothed(drawn.log_weights, 1.0)[1] if drawn.effective > 1.0 else np.inf
    if drawn.score is None or drawn.effective < plan.target_ess or k > K_TRUSTED:
        found = f"Pareto k {k:.2f}, {drawn.effective:.0f} effective draws of {len(drawn.values):,}"
        return None, f"importance weights of {rows} are unreliable ({found}): sampled by ensembles of walkers"
    # Each as often as it weighs, in no order.
    shares, steps = np.cumsum(np.exp(drawn.log_weights)), len(drawn.values) // ENSEMBLES
    places = (np.arange(ENSEMBLES * steps) + rng.uniform()) / (ENSEMBLES * steps)
    dealt = rng.permutation(np.searchsorted(shares / shares[-1], places)).reshape(ENSEMBLES, steps)
    chains = problem.to_coordinates(drawn.values)[dealt][:, :, None]
    worth = dict.fromkeys(problem.free_names, drawn.effective)
    mixing = replace(convergence(problem.free_names, chains), ess_bulk=worth, ess_tail=worth)
    report(Progress(steps, steps, mixing))
    sampled = Sampled(
        chains,
        drawn.score[dealt][:, :, None],
        (drawn.effective / len(drawn.values),) * ENSEMBLES,
        steps,
        warm_up=0,
        first=0,
        convergence=mixing,
        converged=mixing.meets(plan.target_ess, plan.target_r_hat),
        moved=np.zeros((ENSEMBLES, 1), dtype=bool),
        pareto_k=k,
    )
    words = (
        f"importance sampling instead of walkers: {len(drawn.values):,} draws from Student distributions about the "
        f"mode, weighted by their posterior density on all {rows}. Pareto k of the weights is {k:.2f}; "
        f"below {K_TRUSTED:g} is reliable"
    )
    return sampled, words


def _generator(effort: Effort, stage: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(effort.seed).spawn(3)[stage])
