"""Velocities with three components become motion in the plane of incidence.

With the track t = (p_1, q_1)/h_1 of the horizontal components p and q, h_1^2 = p_1^2 + q_1^2, the
speed along it is h_1 before and p_2 t_p + q_2 t_q after the impact. What is across it, p_2 t_q -
q_2 t_p, is left out, as is the spin about other axes than that of topspin. The vertical component
is the one whose sign changes at the bounce; where none does, the one of the same sign in all rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from fitball.base.display_units import PLAIN
from fitball.base.errors import Fault, InputError
from fitball.base.text import listed
from fitball.base.values import FloatArray

if TYPE_CHECKING:
    from fitball.data.cells import TableCells

# Columns of the third dimension with their units in SI.
SPATIAL: Mapping[str, str] = {
    **dict.fromkeys(("v_z1", "v_z2", "v_z1_sd", "v_z2_sd"), "m/s"),
    **{f"omega_{axis}{end}": "rad/s" for end in "12" for axis in "xyz"},
    # Sideways for certain, whatever its sign.
    **dict.fromkeys(("v_lateral1", "v_lateral2"), "m/s"),
}
# Share of rows in which a vertical component has the sign of most: noise may turn slow ones.
_SAME_SIGN = 0.95
# Share of the speed by which a coordinate that hardly moves changes that along the court at most.
_HARDLY = 0.01
_AXES = "xyz"
# Components that are none of the plane.
_THIRD = ("v_z1", "v_z2", "v_lateral1", "v_lateral2")
# What a reduction writes anew.
_VELOCITIES = {"v_x1", "v_y1", "v_x2", "v_y2"}


def with_spatial(
    names: Sequence[str], ours: Sequence[str | None], meant: Sequence[str]
) -> list[str | None]:
    """Our names of columns with those of a third dimension: `names` are the header's without blanks
    and signs, `ours` those that are known, `meant` those that others may mean. `v_z1` is a third
    component only where there are two others: else it is probably the vertical one.
    """
    known = {*ours, *meant}
    is_spatial = any(f"v_y{end}" in known and f"v_x{end}" in known for end in "12")
    answers = [our or spatial_name(name) for name, our in zip(names, ours, strict=True)]
    has_third = any(answer in _THIRD for answer in answers)
    return answers if is_spatial and has_third else [*ours]


def spatial_name(name: str) -> str | None:
    """Our name of a column of the third dimension by its name without blanks and signs."""
    return _BY_NAME.get(name)


_BY_NAME = {name.replace("_", ""): name for name in SPATIAL}
_BY_NAME |= {f"v{word}{end}": f"v_lateral{end}" for word in ("lat", "side") for end in "12"}


@dataclass(frozen=True)
class _Plane:
    """The vertical axis, the signs that count it up at both ends, and the two horizontal axes."""

    vertical: str
    signs: Mapping[str, float]
    horizontal: tuple[str, str]


def in_plane(
    cells: TableCells, columns: Mapping[str, FloatArray], corr: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """The columns (rows,) in SI with components in the plane of incidence in place of three; as
    they are where there are no three, or where one hardly moves.

    Raises:
        InputError: The plane of incidence is not determined (`three-coordinates`).
    """
    planar = {name: column for name, column in columns.items() if name not in SPATIAL}
    if not any(name in columns for name in _THIRD):
        return planar
    plane = _plane(columns)
    if "v_lateral1" in columns or "v_lateral2" in columns:
        columns = _with_lateral_as_z(columns)
        signs = {end: _sign(columns.get(f"v_y{end}")) or 1.0 for end in "12"}
        plane = _Plane("y", signs, ("x", "z"))
    if (plane is None or plane.vertical == "y") and _hardly_moves(columns):
        words = "v_z is not used: with it the speed along the court changes by less than 1 %"
        cells.note("plane-of-incidence", words)
        return planar
    if plane is None:
        words = (
            "three components, and no sign says which one is vertical; expected v_y for it and "
            "v_x along the track, or leave out one that is small (--ignore v_z1,v_z2)"
        )
        _refuse(cells, words)
    missing = _missing(columns, plane)
    if missing or any(set(pair.split(",")) & _VELOCITIES for pair in corr):
        why = f"{listed(missing)} is not there" if missing else "errors are correlated"
        _refuse(cells, f"three components, and {why}: {_in_words(plane)}")
    kept = {k: v for k, v in planar.items() if k.removesuffix("_sd") not in _VELOCITIES}
    return kept | _reduced(cells, columns, plane)


def _with_lateral_as_z(columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The columns with sideways components as those along z."""
    named = {name: column for name, column in columns.items() if name not in ("v_z1", "v_z2")}
    return {name.replace("lateral", "z"): column for name, column in named.items()}


def _refuse(cells: TableCells, words: str) -> NoReturn:
    """Refuse the table (`three-coordinates`), with the faults that were found before."""
    faults = [*cells.faults, Fault("three-coordinates", words, line=cells.header)]
    raise InputError(cells.source, faults)


def _plane(columns: Mapping[str, FloatArray]) -> _Plane | None:
    """The plane by the signs of y and z at both ends; None where they do not determine it."""
    signs = {}
    for axis in "yz":
        signs[axis] = {end: _sign(columns.get(f"v_{axis}{end}")) for end in "12"}
    steady = [axis for axis, of_ends in signs.items() if 0.0 not in of_ends.values()]
    turning = [axis for axis in steady if signs[axis]["1"] * signs[axis]["2"] < 0.0]
    candidates = turning if len(turning) == 1 else steady
    if len(candidates) != 1:
        return None
    vertical = candidates[0]
    first, second = (axis for axis in _AXES if axis != vertical)
    return _Plane(vertical, signs[vertical], (first, second))


def _sign(column: FloatArray | None) -> float:
    """The sign of nearly all numbers of a column, 0 where they differ, NaN without a column."""
    if column is None:
        return np.nan
    measured = column[np.isfinite(column)]
    positive = float(np.mean(measured > 0.0)) if measured.size else 0.5
    if positive >= _SAME_SIGN:
        return 1.0
    return -1.0 if positive <= 1.0 - _SAME_SIGN else 0.0


def _hardly_moves(columns: Mapping[str, FloatArray]) -> bool:
    """Whether v_z changes the speed along the court by little at both ends."""
    for end in "12":
        third = columns.get(f"v_z{end}", np.zeros(1))
        along = np.abs(columns.get(f"v_x{end}", np.zeros(1)))
        speed = np.sqrt(third**2 + along**2 + columns.get(f"v_y{end}", np.zeros(1)) ** 2)
        if np.any(np.hypot(along, third) - along > _HARDLY * speed):
            return False
    return True


def _missing(columns: Mapping[str, FloatArray], plane: _Plane) -> list[str]:
    """Components that the plane needs and that are not there."""
    needed = [f"v_{axis}1" for axis in _AXES]
    if "v_y2" in columns or "v_z2" in columns:
        needed.append(f"v_{plane.vertical}2")
    first, second = (f"v_{axis}2" for axis in plane.horizontal)
    if first in columns or second in columns:
        needed += [first, second]
    for end in "12":
        spins = [f"omega_{axis}{end}" for axis in plane.horizontal]
        if any(f"omega_{axis}{end}" in columns for axis in _AXES):
            needed += spins
    return [name for name in needed if name not in columns]


def _in_words(plane: _Plane) -> str:
    """How a table is reduced by hand, in its own columns."""
    first, second = plane.horizontal
    signs = {end: "-" if sign < 0.0 else "" for end, sign in plane.signs.items()}
    vertical = [f"v_y{end} = {signs[end]}v_{plane.vertical}{end}" for end in "12"]
    return (
        f"v_{plane.vertical} is vertical; write {listed(vertical)}, "
        f"v_x1 = sqrt(v_{first}1^2 + v_{second}1^2), "
        f"v_x2 = (v_{first}1 v_{first}2 + v_{second}1 v_{second}2)/v_x1"
    )


def _reduced(
    cells: TableCells, columns: Mapping[str, FloatArray], plane: _Plane
) -> dict[str, FloatArray]:
    """The components in the plane, with their sds where both horizontal ones have them; what is
    left out is noted.
    """
    first, second = plane.horizontal
    p = columns[f"v_{first}1"]
    q = columns[f"v_{second}1"]
    along = np.hypot(p, q)
    moves = along > 0.0
    track = {
        first: np.divide(p, along, out=np.ones_like(p), where=moves),
        second: np.divide(q, along, out=np.zeros_like(q), where=moves),
    }
    reduced = {"v_x1": along}
    across = np.zeros(1)
    if f"v_{first}2" in columns:
        p_2 = columns[f"v_{first}2"]
        q_2 = columns[f"v_{second}2"]
        reduced["v_x2"] = p_2 * track[first] + q_2 * track[second]
        across = p_2 * track[second] - q_2 * track[first]
    for end, sign in plane.signs.items():
        vertical = f"v_{plane.vertical}{end}"
        if vertical in columns:
            reduced[f"v_y{end}"] = sign * columns[vertical]
        if f"{vertical}_sd" in columns:
            reduced[f"v_y{end}_sd"] = columns[f"{vertical}_sd"]
        sds = [columns.get(f"v_{axis}{end}_sd") for axis in plane.horizontal]
        if sds[0] is not None and sds[1] is not None:
            reduced[f"v_x{end}_sd"] = np.hypot(sds[0] * track[first], sds[1] * track[second])
    spins = [name for name in ("omega_1", "omega_2") if name in columns]
    up = -plane.signs["1"] if np.isfinite(plane.signs["1"]) else plane.signs["2"]
    for end in "12":
        if f"omega_{first}{end}" in columns:
            spins.append(f"omega_{end}")
            reduced[f"omega_{end}"] = _topspin(columns, plane, track, end, up)
    _note(cells, plane, round(float(np.nanmax(np.abs(across), initial=0.0)), 3), spins)
    return reduced


def _topspin(
    columns: Mapping[str, FloatArray],
    plane: _Plane,
    track: Mapping[str, FloatArray],
    end: str,
    up: float,
) -> FloatArray:
    """The topspin (rows,), the component of the spin along up x track in right-handed axes."""
    first, second = plane.horizontal
    spin = {axis: columns[f"omega_{axis}{end}"] for axis in plane.horizontal}
    # z x (x, y) = (-y, x), and y x (x, z) = (z, -x).
    handed = 1.0 if plane.vertical == "z" else -1.0
    return np.asarray(up * handed * (spin[second] * track[first] - spin[first] * track[second]))


def _note(cells: TableCells, plane: _Plane, across: float, spins: Sequence[str]) -> None:
    """Note what was taken as vertical, and what is left out."""
    words = (
        f"three components: v_{plane.vertical} is read as vertical, v_x as along the track of each "
        f"impact; up to {PLAIN.number(across, 2)} m/s across it, and sidespin, are not modelled"
    )
    if spins:
        words += f"; read as topspin: {listed(spins)}"
    cells.note("plane-of-incidence", words)
