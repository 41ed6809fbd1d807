"""The candidates of models on one table, each fitted and scored by what it says of impacts it has not seen."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fitball.data.table import ImpactTable
from fitball.errors import FitError
from fitball.inference.comparison.candidates import Candidates
from fitball.inference.comparison.cross_validation import make_folds
from fitball.inference.comparison.model_weights import stacking_weights
from fitball.inference.comparison.nesting import alarm_words, overtaken, settled_words
from fitball.inference.comparison.over_models import over_models
from fitball.inference.comparison.results import Comparison, FixedPrediction, ModelScore
from fitball.inference.comparison.scoring import Task, scored
from fitball.inference.effort import Effort
from fitball.inference.results.results import RunStatus
from fitball.inference.results.score_difference import FEW
from fitball.scheduling.engine import Engine

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
    published: Sequence[FixedPrediction] = (),
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
            f"{table.source}: {count}: models are compared by leaving impacts out, which needs at least "
            f"{LEAST_IMPACTS} of them, and {FEW} to mean anything"
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
        notes.insert(0, f"with {len(table)} impacts leave-one-out scores mean nothing: no model is recommended")
    return Comparison(
        table=table,
        columns=candidates.columns,
        models=tuple(scores),
        published=tuple(published),
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
        task.again(start for starts in behind[task.candidate.name].values() for start in starts)
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
        still = overtaken(score, mended)
        if still:
            alarms.append(alarm_words(name, tuple(still)))
        else:
            said.append(settled_words(score, tuple(behind[name])))
    return mended, sorted(said), sorted(alarms)
