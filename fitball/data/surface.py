"""Moving surfaces, such as rackets: velocities become those that the surface sees.

A surface that moves towards the ball at s sees it come at v_y1 + s and leave at v_y2 - s; spins
and velocities along the surface are the same. Models are of a surface at rest.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from fitball.base.columns import COMPONENTS
from fitball.base.values import FloatArray
from fitball.data.cells import TableCells
from fitball.data.kinematics import (
    AnalyticColumns,
    Columns,
    counting_columns,
    propagate,
    velocity,
)
from fitball.data.table import stated_errors

_Correlations: TypeAlias = dict[str, FloatArray]


def seen_by_surface(
    cells: TableCells,
    columns: Columns,
    corr: _Correlations,
) -> dict[str, FloatArray]:
    """The columns (rows,) in SI with velocities in the frame of the surface in place of those of
    the court and of `surface_speed`; errors by JCGM 100:2008, Eq. 13, and that of the surface's
    speed as a correlation of v_y1 and v_y2 (`corr`, by pair). A note says so. Faults:
    `moving-surface` where a velocity is not known whole.
    """
    if "surface_speed" not in columns:
        return dict(columns)
    names = [*counting_columns(columns, "1"), *counting_columns(columns, "2"), "surface_speed"]
    known = {name: columns[name] for name in names}
    moved = _moved(known)
    for end, (_, vertical) in COMPONENTS.items():
        if counting_columns(columns, end) and vertical not in moved:
            words = (
                f"the speed of the surface adds to {vertical}, which does not follow from "
                f"{', '.join(counting_columns(columns, end))}; expected {vertical}"
            )
            cells.fault("moving-surface", words, "surface_speed")
    stated = {name: columns.get(f"{name}_sd") for name in known}
    others = {
        name: values
        for name, values in columns.items()
        if name.removesuffix("_sd") not in (*known, *moved, "v_1", "theta_1", "v_2", "theta_2")
    }
    seen = {**others, **moved}
    if any(sd is not None for sd in stated.values()):
        seen |= _errors(known, stated, corr)
    _check_directions(cells, seen)
    words = (
        "v_y1 and v_y2 are those that the moving surface sees: v_y1 + surface_speed, "
        "v_y2 - surface_speed. Predictions are so too: to v_y2 add the speed of the surface"
    )
    cells.note("moving-surface", words)
    return seen


def _check_directions(cells: TableCells, seen: Columns) -> None:
    """Add faults of rows in which ball and surface move apart before, or into each other after."""
    for name, words in (
        ("v_y1", "the surface moves away from the ball faster than it comes"),
        ("v_y2", "the ball leaves slower than the surface follows"),
    ):
        values = seen.get(name, np.empty(0))
        for row in np.flatnonzero(values <= 0.0).tolist():
            remedy = "surface_speed is positive towards the ball: --flip surface_speed"
            cells.fault("moving-surface", f"{words}; {remedy}", "surface_speed", row)


def _moved(columns: AnalyticColumns) -> AnalyticColumns:
    """The components of both velocities (rows,) that follow from columns, as the surface sees them.
    Analytic.
    """
    speed = columns["surface_speed"]
    moved = {}
    for end, sign in (("1", 1.0), ("2", -1.0)):
        determined = velocity(columns, end)
        along, vertical = COMPONENTS[end]
        if along in determined:
            moved[along] = determined[along]
        if vertical in determined:
            moved[vertical] = determined[vertical] + sign * speed
    return moved


def _errors(
    known: Columns,
    stated: dict[str, FloatArray | None],
    corr: _Correlations,
) -> dict[str, FloatArray]:
    """The sds of components that the surface sees, by name NAME_sd; their correlations go to
    `corr`. `stated` are sds by column of `known`.
    """
    names = [*known]
    count = len(known["surface_speed"])
    sds = np.zeros((count, len(names)))
    for k, name in enumerate(names):
        sd = stated[name]
        if sd is not None:
            sds[:, k] = np.nan_to_num(sd)
    matrix = np.tile(np.eye(len(names)), (count, 1, 1))
    for pair, values in corr.items():
        first, second = pair.split(",")
        if first in names and second in names:
            matrix[:, names.index(first), names.index(second)] = np.nan_to_num(values)
            matrix[:, names.index(second), names.index(first)] = np.nan_to_num(values)
    covariance = matrix * sds[:, :, None] * sds[:, None, :]
    moved, propagated = propagate(_moved, known, covariance)
    sd_of, corr_of = stated_errors([*moved], propagated)
    corr |= {pair: np.nan_to_num(values) for pair, values in corr_of.items()}
    return {f"{name}_sd": sd for name, sd in sd_of.items() if np.isfinite(sd).any()}
