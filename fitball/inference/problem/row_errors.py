"""Errors that a row states of its incident state, and how those of its rebound belong to them.

A row reads `u + e_u` and `f(u) + e_y + s`, with the stated errors `e_u` and `e_y` and the scatter `s`. Of normal
errors `e_y = B e_u + e`, with `B = C_yu C_uu^-1` and `e` independent of `e_u`, of covariance `C_yy - B C_uy` (the
regression of the one on the other). The true state lies at `t = -e_u` from the one that was read, so that what is
measured less what is predicted there is, to first order, `(J - B) t + e + s` with `J` the Jacobian of the bounce.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitball.data.table import Covariance, ImpactTable
from fitball.errors import FitError
from fitball.inference.problem.observables import STATED, Observable
from fitball.observables import INCIDENT_UNITS
from fitball.values import FloatArray
from fitball.wording import option

# Share of the largest eigenvalue of a correlation below which rounding cannot be told from none.
NOTHING = 1e-10


@dataclass(frozen=True)
class RowErrors:
    """Stated errors of rows in SI: `incident` (impacts, 3, 3) is the covariance `C_uu` of `(v_x1, v_y1, omega_1)`.

    Of the rebound `columns` whose errors belong together, or to the incident ones, `follows` (impacts, columns, 3) is
    `B` and `rest` (impacts, columns, columns) the covariance of what is left; their stated sds are part of that.
    Other columns have independent errors of their own.
    """

    incident: FloatArray
    columns: tuple[str, ...]
    follows: FloatArray
    rest: FloatArray

    @cached_property
    def uncertain(self) -> bool:
        """Whether the incident state of any row has an error."""
        return bool(np.any(self.incident))

    def take(self, rows: NDArray[np.int64]) -> RowErrors:
        """Those of some of the rows."""
        return RowErrors(self.incident[rows], self.columns, self.follows[rows], self.rest[rows])

    def chosen(self, names: Sequence[str]) -> RowErrors:
        """Those of other rebound columns `names`, in this order; what is not among `columns` has none here."""
        places = [self.columns.index(name) if name in self.columns else len(self.columns) for name in names]
        follows = np.concatenate([self.follows, np.zeros((len(self.follows), 1, 3))], axis=1)
        rest = np.pad(self.rest, ((0, 0), (0, 1), (0, 1)))
        known = tuple(name for name in names if name in self.columns)
        return RowErrors(self.incident, known, follows[:, places], rest[:, places][:, :, places])

    def own(self, observable: Observable) -> Observable:
        """A column as it scatters by itself: without a stated sd where that is part of `rest`."""
        return replace(observable, sd=None) if observable.name in self.columns else observable


def row_errors(table: ImpactTable, observables: Sequence[Observable], incident_errors: bool) -> RowErrors | None:
    """The errors of a table's rows with those of the columns that are used; columns that are not are left out (their
    errors are integrated over). Without `incident_errors` the incident states are exact. None where there is nothing
    but independent errors of rebound columns.
    """
    if table.covariance is None:
        if table.incident_covariance is None or not incident_errors:
            return None
        count = len(table)
        return RowErrors(table.incident_covariance, (), np.zeros((count, 0, 3)), np.zeros((count, 0, 0)))
    return errors_from(table.covariance, [item.name for item in observables], incident_errors)


def errors_from(covariance: Covariance, names: Sequence[str], incident_errors: bool = True) -> RowErrors:
    """The errors of columns called `names` (those among the covariance's) given those of the incident state."""
    among = tuple(name for name in names if name in covariance.columns)
    places = {name: k for k, name in enumerate(covariance.columns)}
    u, y = [places[name] for name in INCIDENT_UNITS], [places[name] for name in among]
    values = covariance.values
    incident, rest = values[:, u][:, :, u], values[:, y][:, :, y]
    if not incident_errors:
        incident = np.zeros_like(incident)
    across = values[:, y][:, :, u] if incident_errors else np.zeros((len(values), len(y), 3))
    # Columns in units of their sds, which differ by powers of ten; one without an error follows none.
    sds = np.sqrt(np.diagonal(incident, axis1=1, axis2=2))
    unit = np.where(sds > 0.0, sds, 1.0)
    inverse = np.linalg.pinv(incident / (unit[:, :, None] * unit[:, None, :]), rcond=NOTHING, hermitian=True)
    follows = across @ (inverse / (unit[:, :, None] * unit[:, None, :]))
    left = rest - follows @ across.swapaxes(1, 2)
    return RowErrors(incident, among, follows, 0.5 * (left + left.swapaxes(1, 2)))


def refuse_singular(table: ImpactTable, errors: RowErrors, scattering: Sequence[bool]) -> None:
    """Raises FitError where stated errors leave no density: some are exact combinations of others, and columns have
    no scatter of their own; `scattering` says which of the `columns` have.
    """
    places = np.flatnonzero(~np.asarray(scattering, dtype=bool))
    for row in range(len(errors.rest) if places.size else 0):
        own = errors.rest[row][np.ix_(places, places)]
        used = np.flatnonzero([np.isfinite(_measured(table, errors.columns[k])[row]) for k in places])
        own = own[np.ix_(used, used)]
        sds = np.sqrt(np.diag(own))
        if sds.size and (np.any(sds <= 0.0) or np.linalg.eigvalsh(own / np.outer(sds, sds))[0] < NOTHING):
            names = ", ".join(errors.columns[places[k]] for k in used)
            raise FitError(
                f"{table.source}: row {table.ids[row]}: the stated errors of {names} are exact combinations of each "
                f"other or of incident errors, and without scatter no fit can weigh them. Leave out "
                f"{option('noise', STATED)} and noises fixed at zero, or state a covariance that is positive definite"
            )


def _measured(table: ImpactTable, name: str) -> FloatArray:
    found = table.measurement(name)
    assert found is not None
    return found.values
