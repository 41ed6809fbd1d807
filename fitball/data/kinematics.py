"""Speeds, angles, components: which columns count, propagated errors.

The angle is that between velocity and court, 0 to pi, above pi/2 when the ball moves backwards: v_x
= v cos(theta), v_y = v sin(theta).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fitball.base.columns import COMPONENTS, STATE, velocity_columns
from fitball.base.values import FloatArray

# Columns of numbers by name, in SI.
Columns: TypeAlias = Mapping[str, Annotated[FloatArray, "impacts"]]
# Columns that may be complex, where a step goes through a function.
AnalyticArray: TypeAlias = NDArray[Any]
AnalyticColumns: TypeAlias = Mapping[str, Annotated[AnalyticArray, "impacts"]]

# The derivative of an analytic function f is Im f(x + ih)/h without any difference (Squire and
# Trapp, SIAM Rev. 40 (1998) 110): the error is of order h^2, and a power of two multiplies exactly.
_STEP = 2.0**-100


def counting_columns(names: Iterable[str], end: str) -> tuple[str, ...]:
    """The columns among `names` by which the velocity of one `end` ("1" or "2") counts.

    They are two at most: components before speed and angle, and these before what else follows from
    the velocity. With one component and both polar columns the polar pair counts: it always
    determines the velocity, while a component and the angle or the speed need not.
    """
    present = set(names)
    polar = (f"v_{end}", f"theta_{end}")
    for pair in (COMPONENTS[end], polar):
        if present.issuperset(pair):
            return pair
    by_rank = dict.fromkeys((*COMPONENTS[end], *polar, *velocity_columns(end)))
    counting = [name for name in by_rank if name in present]
    return tuple(counting[:2])


def velocity(columns: AnalyticColumns, end: str) -> dict[str, Annotated[FloatArray, "impacts"]]:
    """Components, speed and angle of one `end` ("1" or "2"), as far as its columns determine them:
    `v_x1`, `v_y1`, `v_1` [m/s] and `theta_1` [rad], or those with 2.

    Columns that are there stay as they are. A v_y that follows from others is positive.

    Analytic, so that complex steps pass. From v_y and the speed alone the sign of v_x stays open.
    What has no finite value is NaN or infinite, without a warning.
    """
    x = columns.get(f"v_x{end}")
    y = columns.get(f"v_y{end}")
    speed = columns.get(f"v_{end}")
    angle = columns.get(f"theta_{end}")
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        x, y = _components(x, y, speed, angle)
        if x is not None and y is not None:
            if speed is None:
                speed = np.sqrt(x**2 + y**2)
            if angle is None:
                angle = np.pi / 2 - np.arctan(x / y)
    results = {f"v_x{end}": x, f"v_y{end}": y, f"v_{end}": speed, f"theta_{end}": angle}
    return {name: column for name, column in results.items() if column is not None}


def _components(
    x: AnalyticArray | None,
    y: AnalyticArray | None,
    speed: AnalyticArray | None,
    angle: AnalyticArray | None,
) -> tuple[AnalyticArray | None, AnalyticArray | None]:
    """Both components of a velocity [m/s], from those of components, speed and angle [rad] that are
    there; None where these do not determine a component.
    """
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
    return x, y


def state(columns: AnalyticColumns, count: int) -> dict[str, Annotated[FloatArray, "impacts"]]:
    """The incident state v_x1, v_y1 [m/s] and omega_1 [rad/s] of `count` impacts, from the incident
    columns that count; zero where these do not determine it.
    """
    determined = {**columns, **velocity(columns, "1")}
    return {name: determined.get(name, np.zeros(count)) for name in STATE}


def results_and_slopes(
    function: Callable[[AnalyticColumns], AnalyticColumns],
    values: Columns,
) -> tuple[Columns, Annotated[FloatArray, "impacts results columns"]]:
    """Results of an analytic `function` of the columns `values`, and the derivative of each result
    by each column, by complex steps; NaN where a result is not finite.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        results = function(values)
        impacts = next(iter(values.values())).shape
        derivatives = np.empty((*impacts, len(results), len(values)))
        for k, name in enumerate(values):
            moved = function({**values, name: values[name] + 1j * _STEP})
            for j, (result, real) in enumerate(results.items()):
                derivative = moved[result].imag / _STEP
                derivatives[..., j, k] = np.where(np.isfinite(real), derivative, np.nan)
    return results, derivatives


def propagate(
    function: Callable[[AnalyticColumns], AnalyticColumns],
    values: Columns,
    covariance: Annotated[FloatArray, "... columns columns"],
) -> tuple[Columns, Annotated[FloatArray, "impacts results results"]]:
    """Results of an analytic `function` of the columns `values`, and their covariance to first
    order from that of the columns: JCGM 100:2008, Eq. 13.

    The `covariance` is in the order of `values`, one for each impact or one for all.
    """
    results, slope = results_and_slopes(function, values)
    return results, slope @ covariance @ slope.swapaxes(-1, -2)
