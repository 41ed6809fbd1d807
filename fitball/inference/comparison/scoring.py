"""One model of a comparison, fitted and scored; and several of them at once, each in a process of its own."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.inference.calibrate import run
from fitball.inference.comparison.candidates import Candidate
from fitball.inference.comparison.cross_validation import FOLLOWED, Fold, leave_out
from fitball.inference.comparison.psis_loo import leave_one_out
from fitball.inference.comparison.results import ModelScore, criteria
from fitball.inference.effort import Effort
from fitball.inference.likelihood.posterior import log_posterior
from fitball.scheduling.engine import Engine

# Ensembles of an exact refit: enough to see that they agree.
REFIT_ENSEMBLES = 2
# Impacts times draws by which a model is timed.
TIMED = 2000


@dataclass(frozen=True)
class Task:
    """All it takes to score one model; `columns` are the measured ones scored, `seed` the root of its generators,
    `beside` further places (all parameters by name) from which its searches begin.
    """

    candidate: Candidate
    columns: tuple[str, ...]
    folds: tuple[Fold, ...]
    effort: Effort
    seed: np.random.SeedSequence
    quick: bool
    beside: tuple[Mapping[str, float], ...] = ()

    def again(self, beside: Iterable[Mapping[str, float]]) -> Task:
        """The same task with further places, its generators as they were before."""
        seed = np.random.SeedSequence(self.seed.entropy, spawn_key=self.seed.spawn_key)
        return replace(self, seed=seed, beside=tuple(beside))


def scored(tasks: Sequence[Task], engine: Engine, report: Callable[[str], None]) -> Iterator[ModelScore]:
    """Scores of all tasks as they are done.

    Raises what `score_model` and `Engine.unordered` raise.
    """
    done, count = 0, len(tasks)
    # The longest first, so that none waits for it at the end.
    tasks = sorted(tasks, key=_cost, reverse=True)

    def here(task: Task) -> ModelScore:
        return score_model(task, lambda stage: report(f"{task.candidate.name}: {stage} ({done} of {count} done)"))

    for score in engine.unordered(score_model, tasks, here):
        done += 1
        report(f"{score.name}: done ({done} of {count})")
        yield score


def _cost(task: Task) -> float:
    """How long a task takes beside others: CPU time of a batch of densities and derivatives, times the parameters.

    Where a cold start has no kernels on disk, they are compiled here, once and not by every process for itself.
    """
    problem = task.candidate.problem
    values = problem.prior.draw(np.random.default_rng(0), max(1, TIMED // len(problem.impacts)))
    took = 0.0
    for _ in range(2):
        begun = time.process_time()
        log_posterior(problem, problem.to_coordinates(values))
        columns = problem.all_values(values[:1])
        names = problem.model.parameter_names
        problem.model.jacobian(names, np.stack([columns[name] for name in names], axis=1), problem.impacts)
        took = time.process_time() - begun
    return took * problem.dimension


def score_model(task: Task, report: Callable[[str], None] = lambda _stage: None) -> ModelScore:
    """Posterior, leave-one-out densities and left-out errors of a model. Raises FitError, KeyboardInterrupt."""
    begun = time.perf_counter()
    candidate, effort, columns = task.candidate, task.effort, task.columns
    problem = candidate.problem
    fit = run(problem, effort, report=lambda stage, _progress: report(stage), beside=task.beside)
    assert fit.posterior is not None
    report("leave-one-out scores")
    # The refits' ensembles must not repeat those of the full fit.
    fold_seed, refit_seed = task.seed.spawn(2)
    refits = replace(effort, seed=int(refit_seed.generate_state(1)[0]), ensembles=REFIT_ENSEMBLES)
    settings = refits.settings(problem)
    loo = leave_one_out(problem, fit, fit.posterior, columns, settings, exact=not task.quick)
    report("refits without some impacts")
    missed, notes = leave_out(
        problem, fit.point, task.folds, candidate.given_columns, np.random.default_rng(fold_seed)
    )
    notes += fit.notes[len(problem.table.remarks) + len(problem.notes) :]
    every = {observable.name for observable in problem.observables} == set(columns)
    starts = (*fit.point.optima[:FOLLOWED], fit.least_squares.values, *task.beside)
    information = criteria(problem, starts) if every else None
    if not every:
        extra = ", ".join(observable.name for observable in problem.observables if observable.name not in columns)
        notes.append(f"fitted to {extra} too, so that AICc and BIC would not compare: left out")
    left = sum(observable.observed.size for observable in problem.observables) - len(problem.observables)
    if left <= problem.dimension:
        notes.append(
            f"without one impact {left} measurements are left for {problem.dimension} free parameters: its priors "
            "decide its scores"
        )
    return ModelScore(
        name=candidate.name,
        fit=fit,
        given_columns=candidate.given_columns,
        loo=loo,
        missed=missed,
        criteria=information,
        notes=tuple(notes),
        seconds=time.perf_counter() - begun,
    )
