"""The ladder of models on one table, each fitted and scored by what it says of impacts it has not seen."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fitball.data.table import ImpactTable
from fitball.errors import FitError
from fitball.inference.calibrate import Effort, run
from fitball.inference.comparison import FEW, Comparison, FixedPrediction, ModelScore
from fitball.inference.criteria import criteria
from fitball.inference.ladder import Ladder, Rung
from fitball.inference.leave_out import FOLLOWED, Fold, leave_out, make_folds
from fitball.inference.loo import leave_one_out
from fitball.inference.results import RunStatus
from fitball.inference.sampling import SamplingInterrupted
from fitball.inference.weights import pseudo_bma_weights, stacking_weights

# Fewer impacts than this leave nothing to compare: one left out of two is a fit to a single bounce.
LEAST_IMPACTS = 3
# Effective sample size of every chain of a comparison: the log density of one impact is then known to a few
# hundredths, far below the differences that matter.
ESS = 400.0
# Steps after which a chain is given up, and said to be unsettled.
MAX_STEPS = 8000
# Ensembles of an exact refit: enough to see that they agree.
REFIT_ENSEMBLES = 2


def compare(
    table: ImpactTable,
    ladder: Ladder,
    effort: Effort,
    quick: bool = False,
    published: Sequence[FixedPrediction] = (),
    report: Callable[[str], None] = lambda _stage: None,
) -> Comparison:
    """Fit and score every model of the ladder.

    `quick` leaves out the exact refits of impacts with a high Pareto k. Interrupted with at least two models done, it
    returns those with status INTERRUPTED; with fewer it raises KeyboardInterrupt. Raises FitError for a table of
    fewer than three impacts and as fits do.
    """
    begun = time.perf_counter()
    if len(table) < LEAST_IMPACTS:
        count = "1 impact" if len(table) == 1 else f"{len(table)} impacts"
        raise FitError(
            f"{table.source}: {count}: models are compared by leaving impacts out, which needs at least "
            f"{LEAST_IMPACTS} of them, and {FEW} to mean anything"
        )
    fold_seed, weight_seed, *model_seeds = np.random.SeedSequence(effort.seed).spawn(2 + len(ladder.rungs))
    folds, notes = make_folds(table, np.random.default_rng(fold_seed))
    scores: list[ModelScore] = []
    interrupted = False
    for k, (rung, seed) in enumerate(zip(ladder.rungs, model_seeds, strict=True)):
        try:
            scores.append(
                score_model(rung, ladder.columns, folds, effort, seed, quick, _naming(report, rung.name, k, ladder))
            )
        except (KeyboardInterrupt, SamplingInterrupted):
            if len(scores) < 2:
                raise KeyboardInterrupt from None
            interrupted = True
            missing = ", ".join(item.name for item in ladder.rungs[k:])
            notes.append(f"interrupted: {missing} not compared")
            break
    scores.sort(key=lambda item: -item.loo.total)
    elpd = np.stack([item.loo.elpd for item in scores], axis=1)
    names = [item.name for item in scores]
    shares = (stacking_weights(elpd), pseudo_bma_weights(elpd, np.random.default_rng(weight_seed)))
    stacking, pseudo_bma = (dict(zip(names, map(float, found), strict=True)) for found in shares)
    if len(table) < FEW:
        notes.insert(0, f"with {len(table)} impacts leave-one-out scores mean nothing: no model is recommended")
    settled = all(item.fit.status is RunStatus.CONVERGED and not item.loo.unsettled for item in scores)
    status = RunStatus.CONVERGED if settled else RunStatus.NOT_CONVERGED
    return Comparison(
        table=table,
        columns=ladder.columns,
        models=tuple(scores),
        published=tuple(published),
        stacking=stacking,
        pseudo_bma=pseudo_bma,
        status=RunStatus.INTERRUPTED if interrupted else status,
        notes=(*ladder.notes, *notes),
        seed=effort.seed,
        quick=quick,
        seconds=time.perf_counter() - begun,
    )


def score_model(
    rung: Rung,
    columns: Sequence[str],
    folds: Sequence[Fold],
    effort: Effort,
    seed: np.random.SeedSequence,
    quick: bool,
    report: Callable[[str], None],
) -> ModelScore:
    """Posterior, leave-one-out densities and left-out errors of a model. Raises FitError, SamplingInterrupted."""
    begun = time.perf_counter()
    problem = rung.problem
    fit = run(problem, effort, report=lambda stage, _progress: report(stage))
    assert fit.posterior is not None
    report("leave-one-out scores")
    # The refits' ensembles must not repeat those of the full fit.
    fold_seed, refit_seed = seed.spawn(2)
    refits = replace(effort, seed=int(refit_seed.generate_state(1)[0]), ensembles=REFIT_ENSEMBLES)
    settings = refits.settings(problem)
    loo = leave_one_out(problem, fit, fit.posterior, columns, settings, exact=not quick)
    report("refits without some impacts")
    missed, notes = leave_out(problem, fit.point, folds, rung.told, np.random.default_rng(fold_seed))
    every = {channel.name for channel in problem.channels} == set(columns)
    found = criteria(problem, (*fit.point.optima[:FOLLOWED], fit.least_squares.values)) if every else None
    if not every:
        extra = ", ".join(channel.name for channel in problem.channels if channel.name not in columns)
        notes.append(f"fitted to {extra} too, so that AICc and BIC would not compare: left out")
    left = sum(channel.observed.size for channel in problem.channels) - len(problem.channels)
    if left <= problem.dimension:
        notes.append(
            f"without one impact {left} measurements are left for {problem.dimension} free parameters: its priors "
            "decide its scores"
        )
    return ModelScore(
        name=rung.name,
        fit=fit,
        told=rung.told,
        loo=loo,
        missed=missed,
        criteria=found,
        notes=tuple(notes),
        seconds=time.perf_counter() - begun,
    )


def _naming(report: Callable[[str], None], name: str, position: int, ladder: Ladder) -> Callable[[str], None]:
    return lambda stage: report(f"{name} ({position + 1} of {len(ladder.rungs)}): {stage}")
