"""Stated errors of the rows of a fit or of rows to be predicted.

A row reads `u + e_u` and `f(u) + e_y + s`, with `e_y = B e_u + e`, B = C_yu C_uu^+: at the true
state `u + t` it is predicted as `f(u + t) - B t`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.columns import INCIDENT
from fitball.base.errors import FitError, Note
from fitball.base.text import listed
from fitball.base.values import FloatArray, IntArray
from fitball.data.table import ImpactTable

# Eigenvalue of a matrix in units of its errors, as a share of the largest or of one, below which it
# is zero but for rounding.
ZERO_EIGENVALUE = 1e-10
# Rows whose covariances are in memory at once.
ROWS_AT_ONCE = 20_000


class RowErrors(NamedTuple):
    """Errors of rows, in SI, zero where nothing is stated or measured. The columns of `axes` are
    one sd along each axis of the correlation of C_uu; `follows` is B, and `rest` is
    C_yy - B C_uy.
    """

    axes: Annotated[FloatArray, "impacts 3 3"]
    follows: Annotated[FloatArray, "impacts columns 3"]
    rest: Annotated[FloatArray, "impacts columns columns"]

    def take(self, rows: Annotated[IntArray, "rows"]) -> RowErrors:
        """The errors of the rows with these numbers."""
        return RowErrors(*(array[rows] for array in self))

    @property
    def note(self) -> Note:
        """What a fit does with these errors, in a sentence."""
        if self.axes.any():
            text = (
                "Incident states are uncertain: the fit averages over true states, by six "
                "sigma points an impact."
            )
            return Note("uncertain-states", text)
        return Note(
            "correlated-errors",
            "Stated errors of an impact belong together, as the table says.",
        )


class LearntOffsets(NamedTuple):
    """How far predictions at sigma points of uncertain states lie from that at the stated state, in
    SI: linear in coordinates, as draws taught it.

    Offsets are those `at_centre`, and `slopes` times the distance from the `centre`, of the
    coordinates with the numbers `used`. Beyond the limits `low` and `high` of the draws offsets
    stay as they are there.
    """

    used: Annotated[IntArray, "coordinates"]
    low: Annotated[FloatArray, "coordinates"]
    high: Annotated[FloatArray, "coordinates"]
    centre: Annotated[FloatArray, "coordinates"]
    at_centre: Annotated[FloatArray, "points impacts columns"]
    slopes: Annotated[FloatArray, "coordinates points impacts columns"]

    def take(self, rows: Annotated[IntArray, "rows"]) -> LearntOffsets:
        """The offsets of the rows with these numbers."""
        at_centre = self.at_centre[:, rows]
        return self._replace(at_centre=at_centre, slopes=self.slopes[:, :, rows])

    def offsets(
        self,
        q: Annotated[FloatArray, "draws all_coordinates"],
    ) -> Annotated[FloatArray, "draws points impacts columns"]:
        """The offsets at coordinates of the free parameters of a problem."""
        distance = np.clip(q[:, self.used], self.low, self.high) - self.centre
        return np.asarray(np.tensordot(distance, self.slopes, 1) + self.at_centre)


def row_errors(
    table: ImpactTable,
    columns: Sequence[str],
    bare: Sequence[str] = (),
) -> RowErrors | None:
    """The errors of the rows of a table in rebound `columns`; None where incident states are exact
    and errors independent, since sds then say all. `bare` columns do not scatter beyond what is
    stated.

    Raises:
        FitError: without scatter, stated errors are exact combinations of each other
            (`singular-errors`).
    """
    used = {*columns, *(name for name in INCIDENT if name in table.values)}
    correlated = any({*pair.split(",")} <= used for pair in table.corr)
    if not correlated and not any(name in table.sd for name in INCIDENT):
        return None
    count = len(table)
    blocks = [
        _errors_of_block(table.take(rows), columns, bare)
        for rows in np.array_split(np.arange(count), -(-count // ROWS_AT_ONCE))
    ]
    return RowErrors(*(np.concatenate(arrays) for arrays in zip(*blocks, strict=True)))


def _errors_of_block(table: ImpactTable, columns: Sequence[str], bare: Sequence[str]) -> RowErrors:
    """The errors of a table whose covariances fit into memory at once."""
    covariance = table.covariance(columns)
    assert covariance is not None
    states = covariance[:, :3, :3]
    across = covariance[:, 3:, :3]
    rebound = covariance[:, 3:, 3:]
    state_units = _error_units(states)
    rebound_units = _error_units(rebound)
    correlation = states / (state_units[:, :, None] * state_units[:, None, :])
    sizes, vectors = np.linalg.eigh(correlation)
    # The pseudo-inverse: along an axis without an error nothing is known of the rebound.
    positive = sizes > ZERO_EIGENVALUE * sizes.max(axis=1, keepdims=True)
    inverse = np.where(positive, 1.0 / np.where(positive, sizes, 1.0), 0.0)
    towards = vectors / state_units[:, :, None]
    follows = across @ (towards * inverse[:, None, :]) @ towards.swapaxes(1, 2)
    remaining = rebound - follows @ across.swapaxes(1, 2)
    rest = 0.5 * (remaining + remaining.swapaxes(1, 2))
    in_units = rest / (rebound_units[:, :, None] * rebound_units[:, None, :])
    _refuse_singular(table, columns, in_units, bare)
    lengths = np.sqrt(np.maximum(sizes, 0.0))
    axes = state_units[:, :, None] * vectors * lengths[:, None, :]
    return RowErrors(axes, follows, rest)


def _error_units(covariance: FloatArray) -> FloatArray:
    """The sds (rows, columns) of covariances (rows, columns, columns), or one where an sd is zero.
    In these units matrices are well conditioned: sds differ by powers of ten.
    """
    sds = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return np.where(sds > 0.0, sds, 1.0)


def _refuse_singular(
    table: ImpactTable,
    columns: Sequence[str],
    rest: FloatArray,
    bare: Sequence[str],
) -> None:
    """Refuse rows in which errors of `bare` columns, which do not scatter, are exact combinations
    of others: `rest` (impacts, columns, columns), in units of stated errors, then has no variance
    in some direction but for rounding. Raises FitError (`singular-errors`).
    """
    if not bare:
        return
    indices = [columns.index(name) for name in bare]
    y = np.stack([table.values[name] for name in bare], axis=1)
    measured = np.isfinite(y)
    both_measured = measured[:, :, None] & measured[:, None, :]
    of_bare = rest[:, indices][:, :, indices]
    unit = np.eye(len(bare))
    eigenvalues = np.linalg.eigvalsh(np.where(both_measured, of_bare, unit))
    smallest = eigenvalues[:, 0]
    for row in np.flatnonzero(smallest < ZERO_EIGENVALUE)[:1]:
        names = listed(name for name, counts in zip(bare, measured[row], strict=True) if counts)
        raise FitError(
            f"{table.name}: impact {table.labels['id'][row]}: stated errors of {names} are exact "
            "combinations of each other or of incident errors. Without scatter no fit can weigh "
            "them: leave their noise free, or state other correlations",
            "singular-errors",
        )
