"""The candidates of models on one table, each fitted and scored by its predictions of left-out impacts."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.data.table import ImpactTable
from fitball.errors import FitError
from fitball.inference.calibrate import run
from fitball.inference.comparison.candidates import Candidate, Candidates
from fitball.inference.comparison.left_out import FOLLOWED, Fold, leave_one_out, leave_out, make_folds
from fitball.inference.comparison.results import Comparison, ModelScore, criteria, published_sets
from fitball.inference.effort import Effort
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.prediction.court_pace import pace_by_surface
from fitball.inference.problem.problem import Problem
from fitball.inference.results.assumptions import FEW, PACE, Quantity, elpd_difference, span, summary
from fitball.inference.results.results import RunStatus, thinned
from fitball.models.kernels.contact import tied_inertia_split
from fitball.scheduling.engine import Engine
from fitball.values import FloatArray

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
    fold_seed, refit_seed = np.random.SeedSequence(task.seed.entropy, spawn_key=task.seed.spawn_key).spawn(2)
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
    # Levels and biases scatter by a prior: how many parameters they count for is not a whole number.
    counted = every and not problem.pooling and problem.group_bias is None
    information = criteria(problem, starts) if counted else None
    if not every:
        extra = ", ".join(observable.name for observable in problem.observables if observable.name not in columns)
        notes.append(f"fitted to {extra} too, which makes AICc and BIC incomparable: left out")
    elif not counted:
        notes.append("parameters are fitted to each level of a label: AICc and BIC are left out")
    left = sum(observable.observed.size for observable in problem.observables) - len(problem.observables)
    if left <= problem.dimension:
        notes.append(
            f"without one impact {left} measurements are left for {problem.dimension} free parameters: the priors "
            "decide the scores of this model"
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


# Which model contains which: one that does can fit no table worse, and if it seems to, its search has failed.

# Log density that a search may leave unfound and be settled all the same.
SETTLED = 0.05
Values = Mapping[str, float]
# Closure, the option that contains and the one contained: the values that make the first into the second.
CLOSURES: Mapping[tuple[str, str, str], Callable[[Values], Values]] = {
    ("cor", "line", "mean"): lambda _values: {"cor_slope": 0.0},
    ("cor", "saturating", "mean"): lambda _values: {"cor_slope": 0.0},
    ("inertia", "table", "tied"): lambda values: {"inertia_split": float(tied_inertia_split(values["mass_ratio"]))},
}


def as_container(container: Problem, contained: Problem, values: Values) -> Values | None:
    """The `values` (all parameters by name) of the contained problem as values of the container, which then predicts
    the same; None where the one does not contain the other.
    """
    added = _added(container, contained, values)
    if added is None:
        return None
    complete = {**values, **added}
    free = {parameter.name: parameter for parameter in container.parameters}
    if not complete.keys() >= free.keys():
        return None
    for name, parameter in free.items():
        value, prior = complete[name], parameter.prior
        if parameter.fixed is not None and not math.isclose(parameter.fixed, value, rel_tol=1e-9):
            return None
        low, high = prior.support
        place = float(prior.coordinate(np.array(max(value, 0.0) if prior.log else value)))
        if parameter.free and not low <= place <= high:
            return None
    return {name: complete[name] for name in free}


def _added(container: Problem, contained: Problem, values: Values) -> Values | None:
    wide, narrow = container.model, contained.model
    more = set(wide.parameter_names) - set(narrow.parameter_names)
    if wide.absent_is_zero and narrow.absent_is_zero:
        alike = type(wide) is type(narrow) and wide.options == narrow.options
        contains = alike and set(narrow.parameter_names) < set(wide.parameter_names)
        return dict.fromkeys(more, 0.0) if contains else None
    if wide.options.keys() != narrow.options.keys() or not wide.options:
        return None
    added: dict[str, float] = {}
    for closure, option in wide.options.items():
        if option == narrow.options[closure]:
            continue
        known = CLOSURES.get((closure, option, narrow.options[closure]))
        if known is None:
            return None
        if closure == "inertia" and "mass_ratio" not in values:
            return None
        added |= known(values)
    return added


def overtaken(score: ModelScore, others: Sequence[ModelScore]) -> dict[str, list[Values]]:
    """Models of `others` that `score`'s model contains and that fit better all the same, with the values from which
    its search has to begin anew.

    Either its maximum of the posterior lies below its own density at what they found, or its likelihood without
    priors has a lower maximum than theirs.
    """
    problem = score.fit.problem
    better = {}
    for other in others:
        fits = (other.fit.point.values, other.fit.least_squares.values)
        starts = [start for values in fits if (start := as_container(problem, other.fit.problem, values)) is not None]
        if other is not score and starts and _loses(score, other, starts):
            better[other.name] = starts
    return better


def _loses(score: ModelScore, other: ModelScore, starts: Sequence[Values]) -> bool:
    problem = score.fit.problem
    rows = np.array([[start[name] for name in problem.free_names] for start in starts])
    density = log_posterior(problem, problem.to_coordinates(rows))
    if np.any(density > score.fit.point.log_posterior + SETTLED):
        return True
    mine, theirs = score.criteria, other.criteria
    return mine is not None and theirs is not None and mine.log_likelihood < theirs.log_likelihood - SETTLED


# What each model of a comparison says of a parameter, beside the mixture of them by stacking weights. The draws are
# those that the comparison has already; nothing is fitted.

# Draws of each model.
DRAWS = 4000
# Share of a model's draws that must give a quantity for it to be told.
DETERMINED = 0.9


def over_models(models: Sequence[ModelScore], stacking: Mapping[str, float]) -> dict[str, Quantity]:
    """Every quantity that at least two of the models, best first, have."""
    drawn: dict[str, dict[str, FloatArray]] = {}
    units: dict[str, str] = {}
    for score in models:
        units |= {estimate.name: estimate.unit for estimate in score.fit.estimates}
        for name, column in _quantities(score).items():
            drawn.setdefault(name, {})[score.name] = column
    best = models[0].loo.elpd
    as_good = [score.name for score in models if not elpd_difference(best, score.loo.elpd).sure]
    return {
        name: _quantity(columns, units.get(name, ""), stacking, as_good)
        for name, columns in drawn.items()
        if len(columns) > 1
    }


def _quantities(score: ModelScore) -> dict[str, FloatArray]:
    """Draws (draws,) of each quantity of a model."""
    assert score.fit.posterior is not None
    problem, values = score.fit.problem, thinned(score.fit.posterior, DRAWS)
    columns = dict(zip(problem.free_names, values.T, strict=True))
    for surface, rating in pace_by_surface(problem, values).items():
        known = rating[np.isfinite(rating)]
        if known.size >= DETERMINED * rating.size:
            columns[f"{PACE} of {surface}" if surface else PACE] = known
    return columns


def _quantity(
    columns: Mapping[str, FloatArray], unit: str, weights: Mapping[str, float], as_good: list[str]
) -> Quantity:
    by_model = {name: summary(column, np.ones(column.size)) for name, column in columns.items()}
    weight = sum(weights[name] for name in columns)
    stacked = None
    if weight > 0.0:
        shares = [np.full(column.size, weights[name] / column.size) for name, column in columns.items()]
        stacked = summary(np.concatenate(list(columns.values())), np.concatenate(shares))
    good = [name for name in columns if name in as_good]
    over = span(by_model[good[0]], [(name, name, by_model[name]) for name in good[1:]]) if good else None
    return Quantity(unit, by_model, stacked, min(weight, 1.0), tuple(good), over)


# Weights of several models from their pointwise predictive densities (Yao, Vehtari, Simpson and Gelman 2018).

# Largest gain in mean log score an impact that any other mixture could still bring; far below what matters.
GAP = 1e-5
# The score comes within ln(models)/steps of the best (Cover 1984).
STEPS = 300_000


def stacking_weights(elpd: FloatArray) -> FloatArray:
    """Weights (models,) on the simplex that maximise the mean log score of the mixture.

    `elpd` is (impacts, models): log predictive density of each left-out impact. Cover's (1984) multiplicative steps
    raise the score each time. It is concave, so the largest mean ratio of a model's density to the mixture's, less 1,
    bounds what is left to gain. Raises FitError when that bound does not come down.
    """
    # Scaled by the best model of each impact: the weights do not change, and nothing overflows.
    density = np.exp(elpd - elpd.max(axis=1, keepdims=True))
    weights: FloatArray = np.full(elpd.shape[1], 1.0 / elpd.shape[1])
    for _ in range(STEPS):
        ratio = (density / (density @ weights)[:, None]).mean(axis=0)
        if float(ratio.max()) - 1.0 < GAP:
            return weights
        weights = weights * ratio
    raise FitError(f"stacking weights did not converge (a gain of {ratio.max() - 1.0:.1g} an impact is left)")


# Fewer impacts than this leave nothing to compare: one left out of two is a fit to a single bounce.
LEAST_IMPACTS = 3
# Effective sample size of every chain of a comparison: the log density of one impact is then known to a few
# hundredths, far below the differences that matter.
ESS = 400.0
# Steps after which a chain is given up, and said to be unsettled.
MAX_STEPS = 8000


def compare(
    table: ImpactTable,
    candidates: Candidates,
    effort: Effort,
    engine: Engine,
    quick: bool = False,
    report: Callable[[str], None] = lambda _stage: None,
) -> Comparison:
    """Fit and score every model of the candidates.

    `quick` leaves out the exact refits of impacts with a high Pareto k. The models are tasks of `engine`; the scores
    do not depend on it. Interrupted with at least two models done, it returns those
    with status INTERRUPTED; with fewer it raises KeyboardInterrupt. Raises FitError for a table of fewer than three
    impacts and as fits do.
    """
    begun = time.perf_counter()
    if len(table) < LEAST_IMPACTS:
        count = "1 impact" if len(table) == 1 else f"{len(table)} impacts"
        raise FitError(
            f"{table.source}: {count}: a comparison leaves impacts out and needs at least "
            f"{LEAST_IMPACTS} of them, {FEW} for a recommendation"
        )
    # The second stream is kept free, so that models keep theirs between versions.
    fold_seed, _free, *model_seeds = np.random.SeedSequence(effort.seed).spawn(2 + len(candidates.candidates))
    folds, notes = make_folds(table, np.random.default_rng(fold_seed))
    tasks = [
        Task(candidate, candidates.columns, folds, replace(effort, cores=1), seed, quick)
        for candidate, seed in zip(candidates.candidates, model_seeds, strict=True)
    ]
    scores: list[ModelScore] = []
    interrupted, alarms = False, list[str]()
    try:
        for score in scored(tasks, engine, report):
            scores.append(score)  # noqa: PERF402 - what is done must stay when the rest is interrupted
        scores, said, alarms = _searched_again(tasks, scores, engine, report)
        notes = [*alarms, *said, *notes]
    except KeyboardInterrupt:
        if len(scores) < 2:
            raise KeyboardInterrupt from None
        interrupted = True
        done = {score.name for score in scores}
        missing = ", ".join(candidate.name for candidate in candidates.candidates if candidate.name not in done)
        notes.append(f"interrupted: {missing} not compared" if missing else "interrupted while searching again")
    order = [candidate.name for candidate in candidates.candidates]
    scores.sort(key=lambda score: (-score.loo.total, order.index(score.name)))
    elpd = np.stack([score.loo.elpd for score in scores], axis=1)
    names = [score.name for score in scores]
    stacking = dict(zip(names, map(float, stacking_weights(elpd)), strict=True))
    if len(table) < FEW:
        notes.insert(0, f"with {len(table)} impacts leave-one-out scores are meaningless: no model is recommended")
    return Comparison(
        table=table,
        columns=candidates.columns,
        models=tuple(scores),
        published=published_sets(table),
        stacking=stacking,
        status=RunStatus.INTERRUPTED if interrupted else _status(scores, alarms),
        notes=(*candidates.notes, *notes),
        seed=effort.seed,
        quick=quick,
        seconds=time.perf_counter() - begun,
        assumptions=over_models(scores, stacking),
    )


def _status(scores: Sequence[ModelScore], alarms: Sequence[str]) -> RunStatus:
    """Converged when every fit and its refits are, and no model loses to what it contains."""
    settled = all(score.fit.status is RunStatus.CONVERGED and not score.loo.unsettled for score in scores)
    return RunStatus.CONVERGED if settled and not alarms else RunStatus.NOT_CONVERGED


def _searched_again(
    tasks: Sequence[Task], scores: Sequence[ModelScore], engine: Engine, report: Callable[[str], None]
) -> tuple[list[ModelScore], list[str], list[str]]:
    """Scores in which no model fits worse than one it contains, with what was done about it, and about which models
    nothing could be done.
    """
    behind = {score.name: rivals for score in scores if (rivals := overtaken(score, scores))}
    again = [
        replace(task, beside=tuple(start for starts in behind[task.candidate.name].values() for start in starts))
        for task in tasks
        if task.candidate.name in behind
    ]
    if not again:
        return list(scores), [], []
    report(f"{', '.join(behind)} searched again")
    better = {score.name: score for score in scored(again, engine, report)}
    mended = [better.get(score.name, score) for score in scores]
    said, alarms = [], []
    for name, score in better.items():
        if still := overtaken(score, mended):
            alarms.append(
                f"ALARM: {name} contains {' and '.join(still)} but fits worse: its maximum was not found. Do not use "
                "its results here"
            )
        else:
            said.append(
                f"{name} contains {' and '.join(behind[name])} but first fitted worse, so its maximum was "
                "missed. A second search "
                f"from their maxima reached log posterior {score.fit.point.log_posterior:.2f}"
            )
    return mended, sorted(said), sorted(alarms)
