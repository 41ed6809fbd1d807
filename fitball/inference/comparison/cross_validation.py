"""Refits without some impacts, and how far their predictions of those impacts are off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.data.table import ImpactTable
from fitball.errors import FitError
from fitball.inference.comparison.held_maxima import free_values, held_maxima
from fitball.inference.point.point_fit import starting_points
from fitball.inference.prediction.outputs import measured_outputs, output_errors, predicted_outputs
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import withheld
from fitball.inference.results.results import PointFit
from fitball.values import FloatArray

# Rows up to which each impact is left out by itself; on larger tables the folds hold several.
SINGLY = 40
FOLDS = 20
# Fresh starts beside the optima of the full fit where a tenth of the impacts or more is left out at once and another
# optimum may become the best.
FRESH_STARTS = 5
LARGE_SHARE = 0.1
# Optima of the full fit that a refit starts from; more of them are as a rule one optimum, seen twice.
FOLLOWED = 6
IMPACTS = "each impact"
GROUPS = "each group"


@dataclass(frozen=True)
class Fold:
    """Impacts `rows` that are left out together; `scheme` names the family of folds, `label` this one."""

    scheme: str
    label: str
    rows: NDArray[np.int64]


@dataclass(frozen=True)
class Missed:
    """Errors of the left-out impacts of one scheme, output -> (impacts left out,) in SI, and their `rows`."""

    scheme: str
    labels: tuple[str, ...]
    rows: NDArray[np.int64]
    errors: Mapping[str, FloatArray]


def make_folds(table: ImpactTable, rng: np.random.Generator) -> tuple[tuple[Fold, ...], list[str]]:
    """Folds by impact, by group, and the two ends of incidence, with a sentence for each that cannot be made.

    Incidence is the angle; for a drop test, the speed.
    """
    count = len(table)
    notes = []
    if count <= SINGLY:
        folds = [Fold(IMPACTS, table.ids[k], np.array([k])) for k in range(count)]
    else:
        parts = np.array_split(rng.permutation(count), FOLDS)
        folds = [Fold(IMPACTS, f"fold {k + 1}", np.sort(part)) for k, part in enumerate(parts)]
        notes.append(f"{count} impacts: errors of left-out impacts come from {FOLDS} random folds, not one by one")
    labels = table.labels.get("group", ())
    groups = sorted(set(labels))
    if len(groups) >= 2:
        folds += [Fold(GROUPS, group, np.flatnonzero(np.array(labels) == group)) for group in groups]
    else:
        notes.append("the table names fewer than two groups: no group is left out")
    if count < 6:
        notes.append(f"{count} impacts have no thirds worth leaving out")
        return tuple(folds), notes
    given = table.impacts
    angle = table.has_tangential
    along = np.arctan2(given.v_y1, np.abs(given.v_x1)) if angle else given.v_y1
    order = np.argsort(along, kind="stable")
    third = count // 3
    if along[order[third - 1]] == along[order[-third]]:
        notes.append(f"too many impacts have the same {'angle' if angle else 'speed'} to leave out either end of it")
        return tuple(folds), notes
    low, high = ("shallowest third", "steepest third") if angle else ("slowest third", "fastest third")
    folds += [Fold(low, low, np.sort(order[:third])), Fold(high, high, np.sort(order[-third:]))]
    return tuple(folds), notes


def leave_out(
    problem: Problem, point: PointFit, folds: Sequence[Fold], given_columns: Sequence[str], rng: np.random.Generator
) -> tuple[tuple[Missed, ...], list[str]]:
    """Errors of the refits' predictions, one `Missed` a scheme, and a sentence for each fold without a fit."""
    by_scheme: dict[str, list[tuple[Fold, dict[str, FloatArray]]]] = {}
    fitted, notes = _refitted(problem, point, folds, rng)
    for fold, values in fitted:
        measured = measured_outputs(_unbiased(problem, values))
        errors = output_errors(measured, predicted_outputs(problem.rebound(values[None, :]), given_columns))
        mine = {name: column[fold.rows] for name, column in errors.items()}
        by_scheme.setdefault(fold.scheme, []).append((fold, mine))
    return tuple(_joined(scheme, parts) for scheme, parts in by_scheme.items()), notes


def _unbiased(problem: Problem, values: FloatArray) -> ImpactTable:
    """The table with the biases of groups at free values (free,) taken off its columns."""
    if problem.group_bias is None:
        return problem.table
    columns, told = problem.all_values(values[None, :]), {item.name for item in problem.observables}
    measurements = tuple(
        replace(item, values=item.values - problem.group_bias.offset(columns, item.name)[0])
        if item.name in told
        else item
        for item in problem.table.measurements
    )
    return replace(problem.table, measurements=measurements)


def _refitted(
    problem: Problem, point: PointFit, folds: Sequence[Fold], rng: np.random.Generator
) -> tuple[list[tuple[Fold, FloatArray]], list[str]]:
    """Free values (free,) of the refit without each fold, and a sentence for each fold without one."""
    left, notes = [], []
    for fold in folds:
        try:
            withheld(problem, fold.rows)
            left.append(fold)
        except FitError as error:
            notes.append(f"without {fold.label}: {error}")
    if not left:
        return [], notes
    known = free_values(problem, point.optima[:FOLLOWED])
    large = [fold.rows.size >= LARGE_SHARE * len(problem.impacts) for fold in left]
    many = np.concatenate([known, starting_points(problem, rng, FRESH_STARTS)]) if any(large) else known
    starts = [many if share else known for share in large]
    values, cost = held_maxima(problem, [fold.rows for fold in left], starts)
    fitted = [(fold, values[k]) for k, fold in enumerate(left) if np.isfinite(cost[k])]
    notes += [
        f"without {fold.label}: model {problem.model.name}: no start led to parameters of finite posterior density"
        for fold, lowest in zip(left, cost, strict=True)
        if not np.isfinite(lowest)
    ]
    return fitted, notes


def _joined(scheme: str, parts: Sequence[tuple[Fold, Mapping[str, FloatArray]]]) -> Missed:
    names = parts[0][1]
    return Missed(
        scheme,
        tuple(fold.label for fold, _ in parts),
        np.concatenate([fold.rows for fold, _ in parts]),
        {name: np.concatenate([errors[name] for _, errors in parts]) for name in names},
    )
