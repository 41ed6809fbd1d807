"""The covariance of each row of a table: errors that belong together, checked, and carried over to what a fit takes.

A covariance that is given for two columns needs the variance of both: in the same place, or as the standard deviation
in the table. Each row's matrix is a covariance: symmetric and positive semidefinite, but for the rounding of printed
digits. It is propagated linearly from speed and angle of the incident ball to its components (JCGM 102:2011,
6.2.1.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import SD_SUFFIX, limit_of
from fitball.data.covariance_entries import LEFT_OUT, Entry, Given, Layout, Written, beside, read_entries
from fitball.data.kinematics import Uncertain, independent, velocity
from fitball.data.numbers import Columns, NumberColumn, beyond_limit
from fitball.data.table import Covariance, Notice, frozen
from fitball.observables import INCIDENT_UNITS
from fitball.values import FloatArray
from fitball.visible import some

# By how much, as a share, a variance may differ from the standard deviation that the table states.
AGREES = 0.02
# How far below zero the smallest eigenvalue of a correlation may be: by rounding of printed digits at most, and by
# that of floating-point numbers.
ROUNDED, EXACT = 0.05, 1.0e-9
# Below this share of the product of two standard deviations a difference of covariances is rounding.
SAME = 1.0e-6
# Eigenvalues of a correlation down to this are those of a covariance, as floating-point numbers have it.
NEGLIGIBLE = 1.0e-12


@dataclass(frozen=True)
class Stated:
    """The stated errors of a table: `values` (impacts, columns, columns) are the covariances of its `columns` in SI,
    with the signs of the table as it is written; zero where nothing is stated. `place` is the file ("" in Python)
    with its `digest`, `notices` are for the table.
    """

    columns: tuple[str, ...]
    values: FloatArray
    place: str
    digest: str
    notices: tuple[Notice, ...]


@dataclass(frozen=True)
class _Rows:
    """Matrices (impacts, columns, columns) in SI: `values`, half a unit of their last printed digits (`half`), and
    the entry that each is from (`entry`, its number, -1 for none).
    """

    values: FloatArray
    half: FloatArray
    entry: NDArray[np.int64]

    @property
    def given(self) -> NDArray[np.bool_]:
        """Where there is an entry."""
        found: NDArray[np.bool_] = self.entry >= 0
        return found


def stated_covariance(given: Given, layout: Layout, numbers: Columns) -> Stated:
    """The covariances that are given for a table with these `numbers`. Its standard deviations are taken where no
    variance is given, and held against it where one is.

    Raises TableError with every fault: row of the file, column, what was read and what was expected.
    """
    written = read_entries(given, layout)
    rows = _filled(written, layout, numbers)
    written.found.refuse(written.source)
    rows = _symmetric(written, layout, rows)
    variances = _variances(written, layout, rows, numbers)
    written.found.refuse(written.source)
    values, notices = _definite(written, layout, rows, variances)
    written.found.refuse(written.source)
    own = np.unique([entry.row for entry in written.entries]).size
    total = len(layout.ids)
    # Without the folder, which is another where a fit is made again.
    name = Path(written.source).name if written.place else "Python"
    kept = f"covariances of {own} of {total} rows are read from {name}"
    if own < total:
        kept += "; the errors of the others are independent, with the standard deviations of the table"
    notes = tuple(Notice(f"{name}: {note}") for note in written.notes)
    return Stated(layout.columns, values, written.place, written.digest, (Notice(kept), *notes, *notices))


def _filled(written: Written, layout: Layout, numbers: Columns) -> _Rows:
    """The entries as matrices; a fault for each that is given twice, of what was not measured, or no variance."""
    count, width = len(layout.ids), len(layout.columns)
    factors = np.array([layout.units[name].to_si(1.0) for name in layout.columns])
    values, half = np.zeros((count, width, width)), np.zeros((count, width, width))
    number = np.full((count, width, width), -1, dtype=np.int64)
    missing = {name: numbers[name].missing for name in layout.columns if name in numbers}
    for place, entry in enumerate(written.entries):
        k, i, j = entry.row, entry.one, entry.other
        ends = dict.fromkeys((layout.columns[i], layout.columns[j]))
        gaps = [name for name in ends if name not in missing or missing[name][k]]
        factor = factors[i] * factors[j]
        if gaps:
            written.fault(f"{' and '.join(gaps)} was not measured in this row; delete the entry", layout, entry)
        elif number[k, i, j] >= 0:
            written.fault("given twice; keep one of them", layout, entry)
        elif i == j and (wrong := _variance_fault(layout.columns[i], entry.value, factor)):
            written.fault(wrong, layout, entry)
        else:
            values[k, i, j], half[k, i, j], number[k, i, j] = entry.value * factor, entry.half * factor, place
    return _Rows(values, half, number)


def _variance_fault(name: str, value: float, factor: float) -> str | None:
    """What is wrong with a variance, in units whose squares have this `factor` to SI; None for none."""
    if value <= 0.0:
        return f"read the variance {value:g}; expected a positive number (leave out a variance that is not known)"
    if beyond_limit(name + SD_SUFFIX, np.sqrt([value * factor])).any():
        return (
            f"the variance {value:g} is a standard deviation of {np.sqrt(value * factor):.3g} in SI units; expected "
            f"{limit_of(name + SD_SUFFIX).words}: check the unit, which is the square of that in the table"
        )
    return None


def _symmetric(written: Written, layout: Layout, rows: _Rows) -> _Rows:
    """The matrices with each covariance at both of its places; a fault where the two that are given differ."""
    both = rows.given & rows.given.swapaxes(1, 2)
    size = np.sqrt(np.abs(np.einsum("kii->ki", rows.values)))
    reach = (
        rows.half.swapaxes(1, 2)
        + rows.half
        + SAME * np.maximum(size[:, :, None] * size[:, None, :], np.abs(rows.values))
    )
    apart = both & (np.abs(rows.values - rows.values.swapaxes(1, 2)) > reach)
    for k, i, j in np.argwhere(apart).tolist():
        if i < j:
            one, other = (written.entries[rows.entry[k, a, b]] for a, b in ((i, j), (j, i)))
            later, first = (one, other) if (one.place or 0) > (other.place or 0) else (other, one)
            written.fault(
                f"read {later.value:g}, but {first.value:g} with the two columns the other way round; expected one "
                "covariance of the two",
                layout, later,
            )  # fmt: skip
    lower = ~rows.given
    return _Rows(
        np.where(lower, rows.values.swapaxes(1, 2), rows.values),
        np.where(lower, rows.half.swapaxes(1, 2), rows.half),
        np.where(lower, rows.entry.swapaxes(1, 2), rows.entry),
    )


def _variances(written: Written, layout: Layout, rows: _Rows, numbers: Columns) -> FloatArray:
    """The variance of each number (impacts, columns): as given, or that of the stated standard deviation; NaN without
    either. Adds a fault where the two disagree, for a column whose errors are stated in some rows only, and for each
    covariance without the variances of both columns.
    """
    given, diagonal = np.einsum("kii->ki", rows.given), np.einsum("kii->ki", rows.values)
    found = np.where(given, diagonal, np.nan)
    for i, name in enumerate(layout.columns):
        if name not in numbers:
            continue
        stated, measured = numbers.get(name + SD_SUFFIX), ~numbers[name].missing
        if stated is not None:
            sds = np.sqrt(np.where(given[:, i], diagonal[:, i], 1.0))
            rounding = 0.5 * rows.half[:, i, i] / sds + stated.half_width
            apart = given[:, i] & (np.abs(sds - stated.values) > AGREES * stated.values + rounding)
            for k in np.flatnonzero(apart).tolist():
                message = (
                    f"the variance is that of a standard deviation of {stated.printed(float(sds[k]))}, but the table "
                    f"has {stated.name} = {stated.text(k)}; expected one error: correct one of them, or delete the "
                    "column"
                )
                written.fault(message, layout, written.entries[rows.entry[k, i, i]])
            found[:, i] = np.where(given[:, i], found[:, i], stated.values**2)
        elif given[:, i].any() and (bare := np.flatnonzero(measured & ~given[:, i])).size:
            without = some([f"'{layout.ids[k]}'" for k in bare.tolist()])
            written.found.header_fault(
                f"no variance of {name} for {without}; expected one in every row with {name}, or a column "
                f"{name}{SD_SUFFIX} in {layout.source}"
            )
    if independent(numbers, "1") == ("v_1", "theta_1"):
        known = [not np.isnan(found[:, layout.columns.index(name)]).all() for name in ("v_1", "theta_1")]
        if known[0] != known[1]:
            lacking = "theta_1" if known[0] else "v_1"
            written.found.header_fault(
                f"no variance of {lacking}; the incident components need the errors of both speed and angle"
            )
    pairs = rows.given & (np.isnan(found)[:, :, None] | np.isnan(found)[:, None, :])
    for k, i, j in np.argwhere(pairs & np.triu(np.ones(rows.values.shape[1:], dtype=np.bool_), 1)).tolist():
        bare_columns = [layout.columns[m] for m in (i, j) if np.isnan(found[k, m])]
        asked = " and ".join(
            f"({name}, {name}) here or {name}{SD_SUFFIX} in {layout.source}" for name in bare_columns
        )
        written.fault(
            f"a covariance without the variance of {' and '.join(bare_columns)}; expected {asked}",
            layout, written.entries[rows.entry[k, i, j]],
        )  # fmt: skip
    return found


def _definite(
    written: Written, layout: Layout, rows: _Rows, variances: FloatArray
) -> tuple[FloatArray, tuple[Notice, ...]]:
    """The covariances with these variances; a fault for each that is not positive semidefinite by more than printed
    digits may be off. One that is not by less becomes the nearest with its variances, with a notice.
    """
    known = ~np.isnan(variances)
    sds = np.sqrt(np.where(known, variances, 1.0))
    scale = sds[:, :, None] * sds[:, None, :]
    width = len(layout.columns)
    correlation, unit = rows.values / scale, np.eye(width, dtype=np.bool_)
    correlation[:, unit] = 1.0
    lowest = np.linalg.eigvalsh(correlation)[:, 0]
    rounding = np.sum(rows.half / scale, axis=2).max(axis=1, initial=0.0)
    # Where a variance is rounded, so are all correlations with its column.
    bent = lowest < -NEGLIGIBLE
    wrong = lowest < -(EXACT + np.minimum(rounding, ROUNDED))
    for k in np.flatnonzero(wrong).tolist():
        off = np.abs(np.where(unit, 0.0, correlation[k]))
        i, j = divmod(int(off.argmax()), width)
        entry: Entry = written.entries[rows.entry[k, i, j]]
        written.fault(
            f"the covariances of this impact are not positive semidefinite: the smallest eigenvalue of its "
            f"correlations is {lowest[k]:.3g}, the largest correlation {correlation[k, i, j]:.3g}; expected "
            "covariances that errors of one impact can have: check values, units and digits",
            layout, entry,
        )  # fmt: skip
    for k in np.flatnonzero(bent & ~wrong).tolist():
        sizes, axes = np.linalg.eigh(correlation[k])
        near = (axes * np.maximum(sizes, 0.0)) @ axes.T
        root = np.sqrt(np.diagonal(near))
        correlation[k] = near / (root[:, None] * root[None, :])
    covariance = np.where(known[:, :, None] & known[:, None, :], correlation * scale, 0.0)
    near_by = [layout.ids[k] for k in np.flatnonzero(bent & ~wrong & (lowest < -EXACT)).tolist()]
    if not near_by:
        return covariance, ()
    said = (
        f"covariances of {len(near_by)} rows are not positive semidefinite by the rounding of printed digits "
        f"(smallest eigenvalue {lowest.min():.2g}, of {some(near_by)}); the nearest ones that are were taken"
    )
    return covariance, (Notice(said),)


def errors_of(source: object, given: Given | None, layout: Layout, numbers: Columns, name: str) -> Stated | None:
    """The covariances of a table called `name`: those that are `given`, or those in the file beside it; None where
    there are none, or "none" is asked for. Raises as `stated_covariance` does.
    """
    found = beside(source, name) if given is None else given
    if found is None or (isinstance(found, str) and found == LEFT_OUT):
        return None
    return stated_covariance(found, layout, numbers)


def with_sds(numbers: Columns, stated: Stated) -> Columns:
    """The numbers with the standard deviations that covariances state."""
    made = dict(numbers)
    for i, name in enumerate(stated.columns):
        if name not in numbers or not (stated.values[:, i, i] > 0.0).any():
            continue
        column = numbers[name]
        sd = numbers.get(name + SD_SUFFIX) or NumberColumn(
            name + SD_SUFFIX, column.values, 0.0, column.unit, column.decimals + 2, column.missing
        )
        made[sd.name] = replace(sd, values=np.where(column.missing, np.nan, np.sqrt(stated.values[:, i, i])))
    return made


def turned(stated: Stated, before: Columns, after: Columns, flips: Sequence[str]) -> Stated:
    """The covariances of columns of which some are counted the other way round: those in `flips`, and those whose
    sign was changed from `before` to `after`.
    """
    signs = np.ones(len(stated.columns))
    for i, name in enumerate(stated.columns):
        if name in flips:
            signs[i] = -signs[i]
        if name in before and not np.array_equal(before[name].values, after[name].values, equal_nan=True):
            signs[i] = -signs[i]
    return replace(stated, values=stated.values * signs[:, None] * signs[None, :])


def whole_rows(columns: Columns, stated: Stated, measured: Sequence[str]) -> Covariance:
    """The covariance of what a fit takes: the components of the incident state, and the columns that were `measured`
    (those that say the same in another form are left out).
    """
    count = len(stated.values)
    inputs = [name for name in (*independent(columns, "1"), "omega_1") if name in columns]
    known = {name: Uncertain.measured(name, columns[name].values, np.ones(count)) for name in inputs}
    along = velocity(known, "1")
    items: dict[str, Uncertain | None] = {"v_x1": along.x, "v_y1": along.y, "omega_1": known.get("omega_1")}
    items |= {name: Uncertain.measured(name, columns[name].values, np.ones(count)) for name in measured}
    slopes = np.zeros((count, len(items), len(stated.columns)))
    for i, item in enumerate(items.values()):
        for name, part in ({} if item is None else item.parts).items():
            if name in stated.columns:
                slopes[:, i, stated.columns.index(name)] = part
    values = slopes @ stated.values @ slopes.swapaxes(1, 2)
    return Covariance(tuple(items), frozen(0.5 * (values + values.swapaxes(1, 2))))


def together(covariance: Covariance) -> bool:
    """Whether errors belong together that separate standard deviations do not say."""
    own = len(INCIDENT_UNITS)
    apart = covariance.values.copy()
    apart[:, :own, :own] = 0.0
    apart[:, range(apart.shape[1]), range(apart.shape[1])] = 0.0
    return bool(apart.any())
