"""What no tennis ball can do: leave the court faster, or with more energy, than it came."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fitball.data.completeness import knows_incident
from fitball.data.number_column import NumberColumn
from fitball.data.raw import RawRow
from fitball.data.redundancy import independent
from fitball.errors import Fault
from fitball.values import FloatArray

# Radius of gyration squared [m^2] of any ball the ITF admits (diameter 65.4 to 68.6 mm): between a solid
# sphere of the smallest and a thin shell of the largest radius.
LEAST_GYRATION = 0.4 * 0.0327**2
MOST_GYRATION = 2.0 / 3.0 * 0.0343**2


def normal_speed(columns: Mapping[str, NumberColumn], end: str) -> FloatArray | None:
    """v_y [m/s] of `end` ("1" or "2") as a column or from speed and angle; None otherwise.

    Other pairs of columns determine it too, but at steep or grazing angles so badly that no bound
    can rest on it.
    """
    counted = independent(columns, end)
    if f"v_y{end}" in counted:
        return columns[f"v_y{end}"].values
    if counted == (f"v_{end}", f"theta_{end}"):
        speed: FloatArray = columns[f"v_{end}"].values * np.sin(columns[f"theta_{end}"].values)
        return speed
    return None


def check_bounds(columns: Mapping[str, NumberColumn], rows: tuple[RawRow, ...], faults: list[Fault]) -> None:
    """Add a fault for every row with a coefficient of restitution above 1 or a gain of energy.

    Spin may turn into speed and back, so energy counts both, with the moment of inertia that favours
    the table: no ball the ITF admits could have done what is called a fault. What was not measured
    of the rebound counts as zero. Nothing is checked while the incident velocity is incomplete.
    """
    if not knows_incident(columns):
        return
    blamed = _check_restitution(columns, rows, faults)
    before, after = (_least_speed_squared(columns, end, len(rows)) for end in ("1", "2"))
    spin_before, spin_after = (_spin_squared(columns, name, len(rows)) for name in ("omega_1", "omega_2"))
    gained = spin_after - spin_before
    total = after + np.where(gained > 0.0, LEAST_GYRATION, MOST_GYRATION) * gained
    for index in np.flatnonzero((total > before) & ~blamed):
        message = (
            f"the ball leaves with more energy than it came with: {np.sqrt(after[index]):.4g} m/s and "
            f"{np.sqrt(spin_after[index]):.4g} rad/s after {np.sqrt(before[index]):.4g} m/s and "
            f"{np.sqrt(spin_before[index]):.4g} rad/s; "
            "expected a loss: check the units and whether columns are swapped"
        )
        column = _rebound_column(columns, bool(after[index] > before[index]))
        faults.append(Fault(message, rows[index].number, rows[index].line, column))


def _check_restitution(
    columns: Mapping[str, NumberColumn], rows: tuple[RawRow, ...], faults: list[Fault]
) -> NDArray[np.bool_]:
    v_y1, v_y2 = normal_speed(columns, "1"), normal_speed(columns, "2")
    if v_y1 is None or v_y2 is None:
        return np.zeros(len(rows), dtype=np.bool_)
    above = (v_y2 > v_y1) & (v_y1 > 0.0)
    for index in np.flatnonzero(above):
        message = (
            f"coefficient of restitution {v_y2[index] / v_y1[index]:.3f}: v_y2 = {v_y2[index]:.4g} m/s after "
            f"v_y1 = {v_y1[index]:.4g} m/s; expected at most 1: "
            "check the units and whether columns are swapped"
        )
        column = "v_y2" if "v_y2" in columns else "v_2"
        faults.append(Fault(message, rows[index].number, rows[index].line, column))
    return above


def _least_speed_squared(columns: Mapping[str, NumberColumn], end: str, count: int) -> FloatArray:
    """v^2 [m^2/s^2] as far as the columns say; components count before the speed."""
    parts = [columns[name].values for name in (f"v_x{end}", f"v_y{end}") if name in columns]
    if f"v_{end}" in columns and len(parts) < 2:
        parts = [columns[f"v_{end}"].values]
    total = np.zeros(count)
    for part in parts:
        total = total + part**2
    return total


def _spin_squared(columns: Mapping[str, NumberColumn], name: str, count: int) -> FloatArray:
    return columns[name].values ** 2 if name in columns else np.zeros(count)


def _rebound_column(columns: Mapping[str, NumberColumn], by_speed: bool) -> str:
    """The rebound column to point at: a velocity when the speed alone is too much, the spin otherwise."""
    order = ("v_2", "v_x2", "v_y2", "omega_2") if by_speed else ("omega_2", "v_2", "v_x2", "v_y2")
    return next(name for name in order if name in columns)
