"""Speeds, angles, components: which columns count, propagated errors, balances without a model.

The angle is that between velocity and court, 0 to pi, above pi/2 when the ball moves backwards: v_x
= v cos(theta), v_y = v sin(theta).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fitball.base.columns import STATE
from fitball.base.values import Ball, DataFrame, FloatArray

if TYPE_CHECKING:
    from fitball.data.table import ImpactTable

# Arrays (impacts,) by name; complex ones where a step goes through.
Columns: TypeAlias = Mapping[str, Any]

# The derivative of an analytic function f is Im f(x + ih)/h without any difference (Squire and
# Trapp, SIAM Rev. 40 (1998) 110): the error is of order h^2, and a power of two multiplies exactly.
_STEP = 2.0**-100
# Balances and their units.
BALANCES: Mapping[str, str] = {
    "cor": "",
    "mu_bar": "",
    "e_x": "",
    "offset": "m",
    "energy_lost": "J",
    "energy_fraction": "",
}


def counted(names: Iterable[str], end: str) -> tuple[str, ...]:
    """The velocity columns of one `end` ("1" or "2") that count: at most two, components before
    polar.

    With one component and both polar columns the polar pair counts: it always determines the
    velocity, while a component and the angle or the speed need not.
    """
    present = set(names)
    components = (f"v_x{end}", f"v_y{end}")
    polar = (f"v_{end}", f"theta_{end}")
    for pair in (components, polar):
        if present.issuperset(pair):
            return pair
    return tuple(name for name in (*components, *polar) if name in present)


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


def balances(table: ImpactTable, ball: Ball, noise: Mapping[str, float] | None = None) -> DataFrame:
    """What each impact says by conservation laws alone (index `id`), NaN where the columns do not
    determine it.

    `cor` is v_y2/v_y1; `mu_bar` the mean friction (v_x1 - v_x2)/(v_y1 + v_y2) (Jafri 2004, Eq. 65);
    `e_x` the tangential restitution of the contact point; `offset` [m] the distance of the normal
    force ahead of the centre, from angular momentum about the contact point; `energy_lost` [J], and
    its share of the incident energy.

    NAME_sd is propagated from the stated errors of the whole row with their correlations; `noise`
    are sds of rebound columns that state none, without which what depends on them has no sd. The
    ball is exact.
    """
    import pandas as pd

    impacts = table.impacts
    rebound = [name for name in (*counted(table.values, "2"), "omega_2") if name in table.values]
    values = {name: getattr(impacts, name) for name in STATE} | {
        name: table.values[name] for name in rebound
    }
    covariance = table.covariance(rebound)
    if covariance is None:
        covariance = np.zeros((len(impacts), len(values), len(values)))
    unknown = []
    for k, name in enumerate(values):
        if name in rebound and name not in table.sd:
            covariance[:, k, k] = (noise or {}).get(name, 0.0) ** 2
            unknown += [] if name in (noise or {}) else [k]
    drop = not table.shows("tangential")
    spun = table.shows("spin")
    results, slope = slopes(lambda known: _balances(known, ball, drop, spun), values)
    with np.errstate(invalid="ignore"):
        sds = np.sqrt(np.einsum("kri,kij,krj->rk", slope, covariance, slope))
    # A slope is exactly zero where a result does not contain the column.
    sds[np.any(slope[:, :, unknown] != 0.0, axis=2).T] = np.nan
    frame: dict[str, FloatArray] = {}
    for name, unit in BALANCES.items():
        bracket = f" [{unit}]" if unit else ""
        column = np.full(len(impacts), np.nan)
        sd = column
        if name in results:
            column = np.where(np.isfinite(results[name]), results[name], np.nan)
            sd = sds[[*results].index(name)]
        frame |= {name + bracket: column, f"{name}_sd{bracket}": sd}
    return pd.DataFrame(frame, index=pd.Index(table.labels["id"], name="id"))


def _balances(known: Columns, ball: Ball, drop: bool, spun: bool) -> Columns:
    """Balances of the rebound columns in `known`; a `drop` has no motion along the court, spin if
    `spun`.
    """
    x_1, y_1, omega_1 = (known[name] for name in STATE)
    after = velocity(known, "2")
    omega_2 = known.get("omega_2")
    x_2, y_2, speed = (after.get(name) for name in ("v_x2", "v_y2", "v_2"))
    inertia = ball.inertia_ratio * ball.mass * ball.radius**2
    found = {}
    if y_2 is not None:
        found["cor"] = y_2 / y_1
    if x_2 is not None and not drop:
        if y_2 is not None:
            found["mu_bar"] = (x_1 - x_2) / (y_1 + y_2)
        if omega_2 is not None:
            found["e_x"] = -(x_2 - ball.radius * omega_2) / (x_1 - ball.radius * omega_1)
        if y_2 is not None and omega_2 is not None:
            turn = ball.mass * ball.radius * (x_1 - x_2) - inertia * (omega_2 - omega_1)
            found["offset"] = turn / (ball.mass * (y_1 + y_2))
    last = y_2 if drop else speed
    if last is not None and (omega_2 is not None or (drop and not spun)):
        first = y_1**2 if drop else x_1**2 + y_1**2
        before = 0.5 * (ball.mass * first + inertia * omega_1**2)
        left = 0.5 * (ball.mass * last**2 + (0.0 if omega_2 is None else inertia * omega_2**2))
        found |= {"energy_lost": before - left, "energy_fraction": (before - left) / before}
    return found
