"""Speeds, angles, components: which columns count, propagated errors.

The angle is that between velocity and court, 0 to pi, above pi/2 when the ball moves backwards: v_x
= v cos(theta), v_y = v sin(theta).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias

import numpy as np

from fitball.base.columns import COMPONENTS, STATE, velocity_columns
from fitball.base.values import FloatArray

# Arrays (impacts,) by name; complex ones where a step goes through.
Columns: TypeAlias = Mapping[str, Any]

# The derivative of an analytic function f is Im f(x + ih)/h without any difference (Squire and
# Trapp, SIAM Rev. 40 (1998) 110): the error is of order h^2, and a power of two multiplies exactly.
_STEP = 2.0**-100


def counted(names: Iterable[str], end: str) -> tuple[str, ...]:
    """The velocity columns of one `end` ("1" or "2") that count: at most two, components before
    polar, and these before what else follows from the velocity.

    With one component and both polar columns the polar pair counts: it always determines the
    velocity, while a component and the angle or the speed need not.
    """
    present = set(names)
    polar = (f"v_{end}", f"theta_{end}")
    for pair in (COMPONENTS[end], polar):
        if present.issuperset(pair):
            return pair
    order = dict.fromkeys((*COMPONENTS[end], *polar, *velocity_columns(end)))
    return tuple(name for name in order if name in present)[:2]


def velocity(known: Columns, end: str) -> dict[str, FloatArray]:
    """Of `v_x, v_y, v_, theta_` of one `end` those that its columns determine, `known` first; v_y
    is positive.

    Analytic, so that complex steps pass. From v_y and the speed alone the sign of v_x stays open.
    What has no finite value is NaN or infinite, without a warning.
    """
    x, y, speed, angle = (known.get(f"{name}{end}") for name in ("v_x", "v_y", "v_", "theta_"))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if x is not None and y is None:
            if angle is not None:
                y = x * np.tan(angle)
            elif speed is not None:
                y = np.sqrt(speed**2 - x**2)
        elif x is None and angle is not None:
            if y is not None:
                x = y / np.tan(angle)
            elif speed is not None:
                x = speed * np.cos(angle)
                y = speed * np.sin(angle)
        if x is not None and y is not None:
            speed = np.sqrt(x**2 + y**2) if speed is None else speed
            angle = np.pi / 2 - np.arctan(x / y) if angle is None else angle
    made = {f"v_x{end}": x, f"v_y{end}": y, f"v_{end}": speed, f"theta_{end}": angle}
    return {name: column for name, column in made.items() if column is not None}


def state(known: Columns, count: int) -> dict[str, FloatArray]:
    """v_x1, v_y1, omega_1 from the incident columns that count; zero where there is none."""
    found = {**known, **velocity(known, "1")}
    return {name: found.get(name, np.zeros(count)) for name in STATE}


def slopes(function: Callable[[Columns], Columns], values: Columns) -> tuple[Columns, FloatArray]:
    """An analytic `function` of columns (impacts,), and its derivatives (impacts, results,
    columns), NaN where a result is not finite.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        results = function(values)
        shape = next(iter(values.values())).shape
        found = np.empty((*shape, len(results), len(values)))
        for k, name in enumerate(values):
            moved = function({**values, name: values[name] + 1j * _STEP})
            for j, (result, real) in enumerate(results.items()):
                found[..., j, k] = np.where(np.isfinite(real), moved[result].imag / _STEP, np.nan)
    return results, found


def propagate(
    function: Callable[[Columns], Columns],
    values: Columns,
    covariance: FloatArray,
) -> tuple[Columns, FloatArray]:
    """Results of an analytic function of columns, and their covariance (impacts, results, results)
    to first order from that of the columns (impacts, columns, columns): JCGM 100:2008, Eq. 13.
    """
    results, slope = slopes(function, values)
    return results, slope @ covariance @ slope.swapaxes(-1, -2)
