"""Models of another kind that predict left-out impacts as well: what they say else, data do not
decide.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from fitball.base.errors import FitballError
from fitball.base.values import FloatArray
from fitball.inference.effort import ALTERNATIVE_ROWS
from fitball.inference.forward import ForwardModel
from fitball.inference.judgement.assumptions import search_starts
from fitball.inference.judgement.variants import fit_variant, score_gap
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Problem
from fitball.inference.schema import PointFit
from fitball.models.model import Model
from fitball.models.registry import MODELS, candidates
from fitball.models.registry import model as model_of


class Rival(NamedTuple):
    """A model that predicts left-out impacts as well as that of a fit, with its best `values` by
    name, each (1,), and its `score` less the fit's, None of few impacts.
    """

    forward: ForwardModel
    values: Mapping[str, FloatArray]
    score: float | None


def rivals(
    problem: Problem,
    point: PointFit,
    rng: np.random.Generator,
) -> tuple[Rival, ...]:
    """Models of another kind that predict all measured columns, and left-out impacts not surely
    worse: none for a function of the user, and of tables long enough to decide.
    """
    own = problem.forward.model
    if own.name not in MODELS or len(problem.rows.y) > ALTERNATIVE_ROWS:
        return ()
    base = fit_variant(problem, problem.coordinates(point.optima[0])[None], rng)
    as_good = []
    for model in _other_models(problem):
        names = [spec.name for spec in model.parameters]
        choices = problem.choices.for_model(model.text, names)
        try:
            posed = build_problem(problem.table, problem.scene, choices)
            there = fit_variant(posed, search_starts(posed, point), rng, base)
        except FitballError:
            # A model that cannot be fitted predicts nothing else.
            continue
        gap = score_gap(base, there)
        if not gap.worse:
            values = posed.values(there.best[None])
            as_good.append(Rival(posed.forward, values, gap.score))
    return tuple(as_good)


def _other_models(problem: Problem) -> list[Model]:
    """Models of another kind than that of a problem which predict all its measured columns."""
    table = problem.table
    own = problem.forward.model
    texts = candidates(
        tangential=table.has_tangential,
        spin=table.has_spin,
        timed=table.has_times,
        quick=True,
    )
    models = [model_of(text, ball=own.ball, tangential=own.tangential) for text in texts]
    columns = [observable.column for observable in problem.observables]
    return [
        model
        for model in models
        if model.name != own.name and all(model.predicts(column) for column in columns)
    ]
