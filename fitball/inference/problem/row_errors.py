"""Stated errors of rows, of a fit or to be predicted.

A row reads `u + e_u` and `f(u) + e_y + s`, with `e_y = B e_u + e`, B = C_yu C_uu^+: at the true
state `u + t` it is predicted as `f(u + t) - B t`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fitball.base.columns import INCIDENT
from fitball.base.errors import FitError, Note
from fitball.base.text import listed
from fitball.base.values import FloatArray, IntArray
from fitball.data.table import ImpactTable

# Share of the largest eigenvalue of a correlation below which rounding cannot be told from none.
NOTHING = 1e-10
# Rows of which the whole covariance is there at once.
PART = 20_000


class RowErrors(NamedTuple):
    """SI, zero where nothing is stated or measured: `axes` (impacts, 3, 3) have in columns one sd
    along each axis of the correlation of C_uu, `follows` (impacts, columns, 3) is B, `rest`
    (impacts, columns, columns) C_yy - B C_uy.
    """

    axes: FloatArray
    follows: FloatArray
    rest: FloatArray

    def take(self, rows: IntArray) -> RowErrors:
        """Those of some of the rows."""
        return RowErrors(*(array[rows] for array in self))

    @property
    def note(self) -> Note:
        """What a fit does with them."""
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


def row_errors(
    table: ImpactTable,
    columns: Sequence[str],
    bare: Sequence[str] = (),
) -> RowErrors | None:
    """Of rows of a fit or to be predicted; None where states are exact and errors independent (then
    they are sds alone). `bare` columns do not scatter beyond what is stated. Raises FitError
    (`singular-errors`).
    """
    used = {*columns, *(name for name in INCIDENT if name in table.values)}
    together = any({*pair.split(",")} <= used for pair in table.corr)
    if not together and not any(name in table.sd for name in INCIDENT):
        return None
    count = len(table)
    parts = [
        _errors(table.take(rows), columns, bare)
        for rows in np.array_split(np.arange(count), -(-count // PART))
    ]
    return RowErrors(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _errors(table: ImpactTable, columns: Sequence[str], bare: Sequence[str]) -> RowErrors:
    covariance = table.covariance(columns)
    assert covariance is not None
    states = covariance[:, :3, :3]
    across = covariance[:, 3:, :3]
    rebound = covariance[:, 3:, 3:]
    unit = _units(states)
    units = _units(rebound)
    correlation = states / (unit[:, :, None] * unit[:, None, :])
    sizes, vectors = np.linalg.eigh(correlation)
    # Of axes without an error nothing follows.
    some = sizes > NOTHING * sizes.max(axis=1, keepdims=True)
    inverse = np.where(some, 1.0 / np.where(some, sizes, 1.0), 0.0)
    towards = vectors / unit[:, :, None]
    follows = across @ (towards * inverse[:, None, :]) @ towards.swapaxes(1, 2)
    remaining = rebound - follows @ across.swapaxes(1, 2)
    rest = 0.5 * (remaining + remaining.swapaxes(1, 2))
    in_units = rest / (units[:, :, None] * units[:, None, :])
    _refuse_singular(table, columns, in_units, bare)
    lengths = np.sqrt(np.maximum(sizes, 0.0))
    axes = unit[:, :, None] * vectors * lengths[:, None, :]
    return RowErrors(axes, follows, rest)


def _units(covariance: FloatArray) -> FloatArray:
    """Sds (n, k), which differ by powers of ten, or one where there is none."""
    sds = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return np.where(sds > 0.0, sds, 1.0)


def _refuse_singular(
    table: ImpactTable,
    columns: Sequence[str],
    rest: FloatArray,
    bare: Sequence[str],
) -> None:
    """Refuse rows in which errors of columns that do not scatter are combinations of others: of
    `rest` in units of what is stated (impacts, columns, columns) nothing but rounding is left in
    some direction.
    """
    if not bare:
        return
    places = [columns.index(name) for name in bare]
    y = np.stack([table.values[name] for name in bare], axis=1)
    used = np.isfinite(y)
    both_used = used[:, :, None] & used[:, None, :]
    of_bare = rest[:, places][:, :, places]
    smallest = np.linalg.eigvalsh(np.where(both_used, of_bare, np.eye(len(bare))))[:, 0]
    for row in np.flatnonzero(smallest < NOTHING)[:1]:
        names = listed(name for name, counts in zip(bare, used[row], strict=True) if counts)
        raise FitError(
            f"{table.name}: impact {table.labels['id'][row]}: stated errors of {names} are exact "
            "combinations of each other or of incident errors. Without scatter no fit can weigh "
            "them: leave their noise free, or state other correlations",
            "singular-errors",
        )
