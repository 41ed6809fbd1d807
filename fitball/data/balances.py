"""What each impact says by conservation laws alone, without a model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitball.base.columns import STATE
from fitball.base.text import column_head
from fitball.base.values import Ball, DataFrame, FloatArray
from fitball.data.kinematics import Columns, counting_columns, results_and_slopes, velocity
from fitball.data.table import ImpactTable

# Balances and their units.
BALANCES: Mapping[str, str] = {
    "cor": "",
    "mu_bar": "",
    "e_x": "",
    "offset": "m",
    "energy_lost": "J",
    "energy_fraction": "",
}


def impact_balances(
    table: ImpactTable, ball: Ball, noise: Mapping[str, float] | None = None
) -> DataFrame:
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

    rebound = [
        name for name in (*counting_columns(table.values, "2"), "omega_2") if name in table.values
    ]
    impacts = table.impacts
    values = {name: getattr(impacts, name) for name in STATE}
    values |= {name: table.values[name] for name in rebound}
    is_drop = not table.has_tangential
    has_spin = table.has_spin

    def of_columns(columns: Columns) -> Columns:
        return _balances(columns, ball, is_drop, has_spin)

    results, slope = results_and_slopes(of_columns, values)
    sds = _sds(table, values, rebound, slope, noise or {})
    frame: dict[str, FloatArray] = {}
    gaps = np.full(len(impacts), np.nan)
    for name, unit in BALANCES.items():
        column = gaps
        sd = gaps
        if name in results:
            column = np.where(np.isfinite(results[name]), results[name], np.nan)
            sd = sds[[*results].index(name)]
        frame[column_head(name, unit)] = column
        frame[column_head(f"{name}_sd", unit)] = sd
    return pd.DataFrame(frame, index=pd.Index(table.labels["id"], name="id"))


def _sds(
    table: ImpactTable,
    values: Columns,
    rebound: list[str],
    slope: FloatArray,
    noise: Mapping[str, float],
) -> FloatArray:
    """Standard deviations (results, impacts) of results with a `slope` (impacts, results, columns)
    by the columns `values`; NaN where a column that counts has no error.
    """
    covariance = table.covariance(rebound)
    if covariance is None:
        covariance = np.zeros((len(table), len(values), len(values)))
    unknown = []
    for k, name in enumerate(values):
        if name in rebound and name not in table.sd:
            covariance[:, k, k] = noise.get(name, 0.0) ** 2
            if name not in noise:
                unknown.append(k)
    with np.errstate(invalid="ignore"):
        sds = np.sqrt(np.einsum("kri,kij,krj->rk", slope, covariance, slope))
    # A slope is exactly zero where a result does not contain the column.
    sds[np.any(slope[:, :, unknown] != 0.0, axis=2).T] = np.nan
    return np.asarray(sds)


def _balances(columns: Columns, ball: Ball, is_drop: bool, has_spin: bool) -> Columns:
    """Balances (impacts,) by name that incident states and rebound columns determine. A drop has no
    motion along the court; its energy is that of v_y alone where no spin was measured.
    """
    x_1, y_1, omega_1 = (columns[name] for name in STATE)
    after = velocity(columns, "2")
    x_2 = after.get("v_x2")
    y_2 = after.get("v_y2")
    omega_2 = columns.get("omega_2")
    inertia = ball.inertia_ratio * ball.mass * ball.radius**2
    results = {}
    if y_2 is not None:
        results["cor"] = y_2 / y_1
    if x_2 is not None and not is_drop:
        if y_2 is not None:
            results["mu_bar"] = (x_1 - x_2) / (y_1 + y_2)
        if omega_2 is not None:
            results["e_x"] = -(x_2 - ball.radius * omega_2) / (x_1 - ball.radius * omega_1)
        if y_2 is not None and omega_2 is not None:
            turn = ball.mass * ball.radius * (x_1 - x_2) - inertia * (omega_2 - omega_1)
            results["offset"] = turn / (ball.mass * (y_1 + y_2))
    speed_2 = y_2 if is_drop else after.get("v_2")
    spins_known = omega_2 is not None or (is_drop and not has_spin)
    if speed_2 is not None and spins_known:
        square_1 = y_1**2 if is_drop else x_1**2 + y_1**2
        spin_2 = 0.0 if omega_2 is None else inertia * omega_2**2
        before = 0.5 * (ball.mass * square_1 + inertia * omega_1**2)
        rest = 0.5 * (ball.mass * speed_2**2 + spin_2)
        results["energy_lost"] = before - rest
        results["energy_fraction"] = (before - rest) / before
    return results
