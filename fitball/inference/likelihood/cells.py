"""What is measured, cell by cell, at draws: how far from its prediction in units of its spread, how wide that spread
is, and how both move. Densities, residuals, gradients and information follow from these and from the kind of noise.

A cell is what was measured of one impact in one column. Cells of an impact that scatter together, as those do whose
incident state is uncertain, are whitened: each is taken given those before it (Cholesky), so that heavy tails and
scores by column keep their meaning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.models.types import Rebound
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray

Columns = Mapping[str, FloatArray]
# Stands for the spread of a measurement that is not there: its square is finite, its inverse nothing.
UNKNOWN = 1e150


@dataclass(frozen=True)
class Cells:
    """The cells of a problem's `measured` columns, one column after the other, for parameters `columns` by name.

    `z` and `log_sd` (draws, cells): measured less predicted in units of its spread, and the logarithm of that.
    `slope` and `growth` (draws, cells, free): derivatives of the prediction, in units of its spread, and of `log_sd`.
    How the own spreads of whitened cells turn these into each other is `turn` (draws, impacts, pairs of columns,
    free), whose squares are information beside those of `growth`. `pace` (draws, free): derivatives of the mean
    contact time. All derivatives are with respect to coordinates, and empty where they were not asked for; that what
    cells share moves with the parameters too is left out of them.
    """

    impacts: int
    measured: Sequence[Observable]
    columns: Columns
    rebound: Rebound
    z: FloatArray
    log_sd: FloatArray
    slope: FloatArray
    growth: FloatArray
    turn: FloatArray
    pace: FloatArray

    @cached_property
    def impact(self) -> NDArray[np.int64]:
        """The number of each cell's impact, (cells,)."""
        return np.concatenate([item.places(self.impacts) for item in self.measured])

    @cached_property
    def column(self) -> NDArray[np.int64]:
        """The number of each cell's column, (cells,)."""
        return np.repeat(np.arange(len(self.measured)), [item.count(self.impacts) for item in self.measured])

    def spread_out(self, array: FloatArray) -> FloatArray:
        """What cells have (draws, cells, ...) over impacts and columns (draws, impacts, columns, ...), zero where
        nothing was measured.
        """
        whole = np.zeros((array.shape[0], self.impacts, len(self.measured), *array.shape[2:]))
        whole[:, self.impact, self.column] = array
        return whole


def cells(
    problem: Problem,
    coordinates: FloatArray,
    *,
    slopes: bool = False,
    sizes: Columns | None = None,
) -> Cells:
    """The cells of a problem at coordinates (draws, free), with noise parameters of these `sizes` where they are
    given instead of those of the coordinates; with `slopes` their derivatives.
    """
    values = problem.to_values(coordinates)
    columns: dict[str, FloatArray] = {**problem.all_values(values), **(sizes or {})}
    if not slopes:
        return cells_of(problem, columns, problem.rebound(values))
    rebound, moved = problem.differentiated(coordinates)
    return cells_of(problem, columns, rebound, moved=moved)


def cells_of(
    problem: Problem,
    columns: Mapping[str, FloatArray],
    rebound: Rebound,
    measured: Sequence[Observable] | None = None,
    moved: Columns | None = None,
) -> Cells:
    """As `cells`, for rebounds that are known, with their derivatives `moved` (draws, impacts, free) by output if
    those of cells are wanted; of other columns than the table's where these are `measured`.
    """
    seen = problem.observables if measured is None else measured
    count, (draws, _) = len(problem.impacts), rebound.v_x2.shape
    ends = np.cumsum([0, *(item.count(count) for item in seen)]).tolist()
    free = problem.dimension if moved is not None else 0
    z, spread = np.empty((2, draws, ends[-1]))
    slope, growth = np.zeros((2, draws, ends[-1], free))
    shared = shared_covariance(problem, columns, rebound, seen)
    for item, begin, end in zip(seen, ends[:-1], ends[1:], strict=True):
        mine = (slice(None), slice(begin, end))
        # Cells that scatter together are in units of their spread only when they are whitened.
        own = item if problem.errors is None else problem.errors.own(item)
        sd = own.sds(columns, rebound)
        unit = sd if shared is None else np.ones(())
        z[mine] = problem.deviation(columns, item, rebound) / unit
        spread[mine] = sd
        if moved is not None:
            slope[mine] = _slopes(problem, item, rebound, moved) / unit[..., None]
            _lay_growth(problem, own, columns, rebound, moved, growth[mine])
    pace = moved["contact_time"].mean(axis=1) if moved is not None else np.empty((draws, 0))
    made = Cells(
        count, seen, columns, rebound, z, spread, slope, growth, np.empty((draws, count, 0, free)), pace
    )  # fmt: skip
    return replace(made, log_sd=np.log(spread)) if shared is None else _whitened(made, shared)


def _slopes(problem: Problem, item: Observable, rebound: Rebound, moved: Columns) -> FloatArray:
    """Derivatives (draws, measurements, free) of what is measured in a column, the bias of its group included."""
    slopes, bias = item.column.slopes(rebound, moved), problem.group_bias
    if bias is not None:
        slopes = slopes.copy()
        for place, label in enumerate(bias.labels):
            if (name := bias.name(item.name, label)) in problem.free_names:
                slopes[:, bias.index == place, problem.free_names.index(name)] += 1.0
    return slopes if item.rows is None else slopes[:, item.rows]


def _lay_growth(
    problem: Problem, item: Observable, columns: Columns, rebound: Rebound, moved: Columns, growth: FloatArray
) -> None:
    """Add to `growth` (draws, measurements, free) the derivatives of the logarithm of a column's own spread."""
    if item.noise is None:
        return
    share = item.scattered(columns, rebound)
    if item.turned:
        # The spread of an angle falls with the rebound speed.
        speed = np.hypot(rebound.v_x2, rebound.v_y2)[..., None]
        turned = OBSERVABLES["v_2"].slopes(rebound, moved) / speed
        growth -= share[..., None] * (turned if item.rows is None else turned[:, item.rows])
    if item.noise in problem.free_names:
        k = problem.free_names.index(item.noise)
        growth[..., k] += share if problem.free[k].prior.log else share / np.reshape(columns[item.noise], (-1, 1))


def shared_covariance(
    problem: Problem, columns: Columns, rebound: Rebound, measured: Sequence[Observable] | None = None
) -> FloatArray | None:
    """Covariance (draws, impacts, columns, columns) that the columns of an impact have beside the own spread of each;
    None where they have none. It is that of errors of the incident state, to first order: with `J` the exact Jacobian
    of the bounce and `S` their covariance, `J S J^T` (Fuller 1987, section 3.1); where stated errors of the rebound
    belong to them, or to each other, `(J - B) S (J - B)^T + R` with `B` and `R` of `RowErrors`.
    """
    if problem.errors is None:
        return None
    seen = problem.observables if measured is None else measured
    errors = problem.errors.chosen([item.name for item in seen])
    if not errors.uncertain:
        return np.broadcast_to(errors.rest, (len(rebound.v_x2), *errors.rest.shape))
    slopes = problem.slopes_like(columns, problem.impacts, np.arange(len(problem.impacts)))
    by_input = np.stack([item.column.slopes(rebound, slopes) for item in seen], axis=2)
    return spread_by_input(by_input - errors.follows, errors.incident) + errors.rest


def spread_by_input(slopes: FloatArray, covariance: FloatArray) -> FloatArray:
    """Covariance (draws, impacts, columns, columns) that errors of the incident state alone give what is measured.

    `slopes` (draws, impacts, columns, 3); `covariance` (impacts, 3, 3), or any that broadcasts to
    (draws, impacts, 3, 3).
    """
    spread: FloatArray = np.einsum("...ck,...kl,...ml->...cm", slopes, covariance, slopes, optimize=True)
    return spread


def joint_root(shared: FloatArray, spreads: FloatArray) -> FloatArray:
    """Lower factor (..., columns, columns) of the `shared` covariance with the own `spreads` (..., columns) of each
    column, `UNKNOWN` where it takes part in nothing; NaN where there is no rebound.
    """
    lower: FloatArray = np.zeros(np.broadcast_shapes(shared.shape, (*spreads.shape, 1)))
    for i in range(spreads.shape[-1]):
        for j in range(i):
            known = np.sum(lower[..., i, :j] * lower[..., j, :j], axis=-1)
            lower[..., i, j] = (shared[..., i, j] - known) / lower[..., j, j]
        # Never below the column's own spread: the rest is a covariance, whose Schur complement rounding may spoil.
        rest = shared[..., i, i] - np.sum(lower[..., i, :i] ** 2, axis=-1)
        lower[..., i, i] = np.sqrt(spreads[..., i] ** 2 + np.maximum(rest, 0.0))
    return lower


def solved(lower: FloatArray, right: FloatArray) -> FloatArray:
    """`lower`^-1 `right` for a lower factor (..., columns, columns) and sides (..., columns, any)."""
    found: FloatArray = np.empty(np.broadcast_shapes(right.shape, (*lower.shape[:-1], 1)))
    for i in range(lower.shape[-1]):
        known = np.sum(lower[..., i, :i, None] * found[..., :i, :], axis=-2)
        found[..., i, :] = (right[..., i, :] - known) / lower[..., i, i, None]
    return found


def _whitened(made: Cells, shared: FloatArray) -> Cells:
    """The cells, of which `z` and `slope` are in units of the columns yet and `log_sd` is the own spread itself, each
    given those of its impact before it.

    Of a normal distribution whose covariance C changes by dC, the information is tr(C^-1 dC C^-1 dC)/2. With L the
    lower factor of C this is twice the sum of squares of L^-1 dC L^-T/2: its diagonal is the growth of the
    conditional spreads, the rest their turn.
    """
    impact, column, count = made.impact, made.column, len(made.measured)
    spreads = np.full(shared.shape[:-1], UNKNOWN)
    spreads[:, impact, column] = made.log_sd
    root = joint_root(shared, spreads)
    z = solved(root, made.spread_out(made.z)[..., None])[..., 0]
    log_sd = np.log(np.diagonal(root, axis1=2, axis2=3))
    slope, growth, turn = made.slope, made.growth, made.turn
    if slope.shape[-1]:
        slope = solved(root, made.spread_out(slope))[:, impact, column]
        own = solved(root, spreads[..., None, :] * np.eye(count))
        whole = np.einsum("diac,dick,dibc->diabk", own, made.spread_out(growth), own, optimize=True)
        growth = np.einsum("diaak->diak", whole)[:, impact, column]
        below, above = np.tril_indices(count, -1)
        turn = np.sqrt(2.0) * whole[:, :, below, above]
    return Cells(
        made.impacts, made.measured, made.columns, made.rebound, z[:, impact, column], log_sd[:, impact, column],
        slope, growth, turn, made.pace )  # fmt: skip


def prediction_slopes(problem: Problem, coordinates: FloatArray) -> FloatArray:
    """Derivatives (draws, impacts, columns, free) of all predictions, in units of their noise, with respect to
    coordinates (draws, free) counted in widths of the priors; zero where nothing was measured. A measurement with
    heavy tails has less information than a normal one.
    """
    made = cells(problem, coordinates, slopes=True)
    worth = np.sqrt(problem.noise.information(made.columns))[..., None, None, None]
    return np.asarray(worth * made.spread_out(made.slope) * problem.prior.width)
