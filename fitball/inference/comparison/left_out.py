"""Predictions of left-out impacts: refits without some impacts, and how far their predictions of these
are off; predictive densities of single ones, by importance sampling, by an exact refit where that is unreliable.

Only the likelihood of what is left out goes, as in `withheld`: the scene's knowledge, the priors, and that every
impact must be possible stay.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fitball.data.table import ImpactTable
from fitball.errors import FitError
from fitball.inference.identifiability.information import about
from fitball.inference.likelihood.posterior import pointwise
from fitball.inference.point.gauss_newton import Searches, descend
from fitball.inference.point.point_fit import starting_points
from fitball.inference.point.surface import Conditions, surface_of
from fitball.inference.prediction.outputs import measured_outputs, output_errors, predicted_outputs
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import withheld
from fitball.inference.results.results import TARGET_ESS, Fit, PointFit, Posterior, thinned
from fitball.inference.sampling.ensembles import Settings, sample
from fitball.inference.sampling.importance import K_TRUSTED, equal_draws, refitted, smoothed_elpd
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
# A promised gain of log posterior below which a maximum is found: errors of left-out impacts then stand to a
# thousandth of their noise.
SETTLED = 1e-7
# Draws used, fewer on large tables so that draws times impacts fit into memory.
DRAWS = 8000
LEAST_DRAWS = 1000
ENTRIES = 4_000_000


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
        notes.append(
            f"{count} impacts: errors of left-out impacts come from {FOLDS} random folds, not from leaving out "
            "one at a time"
        )
    labels = table.labels.get("group", ())
    groups = sorted(set(labels))
    if len(groups) >= 2:
        folds += [Fold(GROUPS, group, np.flatnonzero(np.array(labels) == group)) for group in groups]
    else:
        notes.append("the table has fewer than two groups: none is left out")
    if count < 6:
        notes.append(f"{count} impacts are too few to leave out a third")
        return tuple(folds), notes
    given = table.impacts
    angle = table.has_tangential
    along = np.arctan2(given.v_y1, np.abs(given.v_x1)) if angle else given.v_y1
    order = np.argsort(along, kind="stable")
    third = count // 3
    if along[order[third - 1]] == along[order[-third]]:
        notes.append(
            f"too many impacts have the same {'angle' if angle else 'speed'} to leave out its lower or upper end"
        )
        return tuple(folds), notes
    low, high = ("shallowest third", "steepest third") if angle else ("slowest third", "fastest third")
    folds += [Fold(low, low, np.sort(order[:third])), Fold(high, high, np.sort(order[-third:]))]
    return tuple(folds), notes


def leave_out(
    problem: Problem, point: PointFit, folds: Sequence[Fold], given_columns: Sequence[str], rng: np.random.Generator
) -> tuple[tuple[Missed, ...], list[str]]:
    """Errors of the refits' predictions, one `Missed` a scheme, and a sentence for each fold without a fit."""
    left, notes = [], []
    for fold in folds:
        try:
            withheld(problem, fold.rows)
            left.append(fold)
        except FitError as error:
            notes.append(f"without {fold.label}: {error}")
    if not left:
        return (), notes
    known = _free_values(problem, point.optima[:FOLLOWED])
    large = [fold.rows.size >= LARGE_SHARE * len(problem.impacts) for fold in left]
    many = np.concatenate([known, starting_points(problem, rng, FRESH_STARTS)]) if any(large) else known
    found = held_maxima(problem, [fold.rows for fold in left], [many if share else known for share in large])
    by_scheme: dict[str, list[tuple[Fold, dict[str, FloatArray]]]] = {}
    for fold, values, lowest in zip(left, *found, strict=True):
        if not np.isfinite(lowest):
            missing = f"model {problem.model.name}: no search found parameters of finite posterior density"
            notes.append(f"without {fold.label}: {missing}")
            continue
        measured = measured_outputs(_unbiased(problem, values))
        errors = output_errors(measured, predicted_outputs(problem.rebound(values[None, :]), given_columns))
        mine = {name: column[fold.rows] for name, column in errors.items()}
        by_scheme.setdefault(fold.scheme, []).append((fold, mine))
    missed = []
    for scheme, parts in by_scheme.items():
        labels, rows = zip(*((fold.label, fold.rows) for fold, _ in parts), strict=True)
        joined = {name: np.concatenate([errors[name] for _, errors in parts]) for name in parts[0][1]}
        missed.append(Missed(scheme, labels, np.concatenate(rows), joined))
    return tuple(missed), notes


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


def _free_values(problem: Problem, optima: Sequence[Mapping[str, float]]) -> FloatArray:
    """Free values (optima, free) of optima, all parameters by name."""
    return np.array([[optimum[name] for name in problem.free_names] for optimum in optima])


def held_maxima(
    problem: Problem, left: Sequence[NDArray[np.int64]], starts: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Free values (folds, free) of the highest maximum without the rows `left` of each fold, searched from its own
    `starts`, free values (starts, free); and minus its log posterior, but for a constant, inf where none was found.
    """
    assert problem.force is None, "records of the force are no measurements of an impact that could be left out here"
    surface = surface_of(problem, SETTLED, penalised=True)
    fold = np.repeat(np.arange(len(left)), [len(some) for some in starts])
    counted = np.ones((len(left), len(problem.impacts)), dtype=bool)
    for k, rows in enumerate(left):
        counted[k, rows] = False
    given = Conditions(np.empty((fold.size, 0)), problem.contact_time is not None, counted[fold])
    begun = surface.from_values(np.concatenate(starts))
    reached = descend(surface, Searches(begun, np.full(fold.size, -1), given))
    best = [np.flatnonzero(fold == k)[np.argmin(reached.cost[fold == k])] for k in range(len(left))]
    return surface.values(reached.x[best], given.take(np.array(best))), reached.cost[best]


@dataclass(frozen=True)
class LeaveOneOut:
    """Log predictive density of each left-out impact, `elpd` (impacts,); `pareto_k` (impacts,) of the importance
    sampling, `p_loo` the effective number of parameters; `refitted` impacts whose density comes from a refit, and
    `unsettled` those among them whose refit did not converge.
    """

    elpd: FloatArray
    pareto_k: FloatArray
    p_loo: float
    refitted: tuple[int, ...]
    unsettled: tuple[int, ...]

    @property
    def doubtful(self) -> tuple[int, ...]:
        """Impacts whose density comes from unreliable importance weights."""
        return tuple(int(k) for k in np.flatnonzero(self.pareto_k > K_TRUSTED) if int(k) not in self.refitted)

    @property
    def total(self) -> float:
        """Expected log predictive density of the whole table."""
        return float(self.elpd.sum())


def leave_one_out(
    problem: Problem, fit: Fit, posterior: Posterior, columns: Sequence[str], settings: Settings, exact: bool
) -> LeaveOneOut:
    """Score every impact by the measured `columns`; with `exact`, impacts of high Pareto k by a refit without them.

    Raises FitError as fits do.
    """
    values = thinned(posterior, max(LEAST_DRAWS, min(DRAWS, ENTRIES // len(problem.impacts))))
    whole, scored = pointwise(problem, values, columns)
    # Independent draws among those used, as a fraction; the mean over parameters, at most 1 (as ArviZ takes it).
    assert fit.diagnostics is not None
    efficiency = min(1.0, float(np.mean(list(fit.diagnostics.ess_bulk.values()))) / len(values))
    elpd, pareto_k = smoothed_elpd(whole, scored, efficiency)
    average = logsumexp(scored, axis=0) - np.log(len(values))
    again = np.flatnonzero(~(pareto_k <= K_TRUSTED)) if exact else np.empty(0, dtype=np.int64)
    unsettled = []
    if again.size:
        starts = _free_values(problem, fit.point.optima)
        optima, _cost = held_maxima(problem, [again[k : k + 1] for k in range(again.size)], [starts] * again.size)
        for row, optimum in zip(again.tolist(), problem.to_coordinates(optima), strict=True):
            elpd[row], settled = refitted_elpd(problem, values, whole[:, row], optimum, row, columns, settings)
            unsettled += [] if settled else [row]
    loss = float(np.sum(average - elpd))
    return LeaveOneOut(elpd, pareto_k, loss, tuple(again.tolist()), tuple(unsettled))


def refitted_elpd(
    problem: Problem,
    values: FloatArray,
    likelihood: FloatArray,
    optimum: FloatArray,
    row: int,
    columns: Sequence[str],
    settings: Settings,
) -> tuple[float, bool]:
    """Log density of the `columns` of one impact under the posterior without it, and whether that settled.

    By `refitted`, begun from the draws (draws, free) of the whole, at which the log `likelihood` (draws,) of the
    impact is known, and about its own maximum (free,), in coordinates; where that does not settle, by a chain.
    """
    rng = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=(row,)))
    held = withheld(problem, np.array([row]))
    beside = [about(held, optimum)]
    found = refitted(problem, equal_draws(values), likelihood, row, columns, rng, TARGET_ESS, beside)
    if found is not None:
        return found.elpd, True
    sampled = sample(held, optimum[None, :], settings, None, False, lambda _progress: None)
    draws = sampled.kept.reshape(-1, problem.dimension)
    chosen = draws[np.linspace(0, len(draws) - 1, min(DRAWS, len(draws))).astype(np.int64)]
    _whole, scored = pointwise(problem, problem.to_values(chosen), columns)
    return float(logsumexp(scored[:, row]) - np.log(len(chosen))), sampled.converged
