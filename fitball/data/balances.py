"""What each impact says by conservation laws alone, without a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitball.base.columns import STATE
from fitball.base.text import column_head
from fitball.base.values import Ball, DataFrame, FloatArray
from fitball.data.kinematics import (
    AnalyticArray,
    AnalyticColumns,
    Columns,
    counting_columns,
    results_and_slopes,
    velocity,
)
from fitball.data.table import ImpactTable

# Balances and their units; "" where a balance is a number.
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
    its share of the incident energy. Balls that fly towards negative v_x count as their mirror
    images.

    NAME_sd is propagated from the stated errors of the whole row with their correlations; `noise`
    are sds of rebound columns that state none, without which what depends on them has no sd. An
    incident spin that was not measured is unknown. The ball is exact.
    """
    import pandas as pd

    if table.has_tangential:
        table = table.with_unknown_spins()
    rebound = [
        name for name in (*counting_columns(table.values, "2"), "omega_2") if name in table.values
    ]
    impacts = table.impacts
    values = {name: getattr(impacts, name) for name in STATE}
    values |= {name: table.values[name] for name in rebound}
    is_drop = not table.has_tangential
    has_spin = table.has_spin
    side = impacts.side

    def of_columns(columns: AnalyticColumns) -> AnalyticColumns:
        results = dict(_balances(columns, ball, is_drop, has_spin))
        for name in results.keys() & {"mu_bar", "offset"}:
            results[name] = side * results[name]
        return results

    results, slope = results_and_slopes(of_columns, values)
    sds = _sds(table, values, rebound, slope, noise or {})
    sd_of = dict(zip(results, sds, strict=True))
    frame: dict[str, FloatArray] = {}
    gaps = np.full(len(impacts), np.nan)
    for name, unit in BALANCES.items():
        column = results.get(name, gaps)
        frame[column_head(name, unit)] = np.where(np.isfinite(column), column, np.nan)
        frame[column_head(f"{name}_sd", unit)] = sd_of.get(name, gaps)
    ids = pd.Index(table.labels["id"], name="id")
    return pd.DataFrame(frame, index=ids)


def _sds(
    table: ImpactTable,
    values: Columns,
    rebound: Sequence[str],
    slope: FloatArray,
    noise: Mapping[str, float],
) -> FloatArray:
    """Standard deviations (results, impacts) of results with a `slope` (impacts, results, columns)
    by the columns `values`; NaN where a result depends on a column without an error.
    """
    covariance = table.covariance(rebound)
    if covariance is None:
        size = len(values)
        covariance = np.zeros((len(table), size, size))
    without_error = []
    for k, name in enumerate(values):
        if name in rebound and name not in table.sd:
            covariance[:, k, k] = noise.get(name, 0.0) ** 2
            if name not in noise:
                without_error.append(k)
    with np.errstate(invalid="ignore"):
        variances = np.einsum("kri,kij,krj->rk", slope, covariance, slope)
        sds = np.asarray(np.sqrt(variances))
    # A slope is exactly zero where a result does not contain the column.
    depends = np.any(slope[:, :, without_error] != 0.0, axis=2)
    sds[depends.T] = np.nan
    return sds


def _balances(
    columns: AnalyticColumns,
    ball: Ball,
    is_drop: bool,
    has_spin: bool,
) -> AnalyticColumns:
    """Balances by name that incident states and rebound columns determine. A drop has no motion
    along the court; its energy is that of v_y alone where no spin was measured.
    """
    x_1, y_1, omega_1 = (columns[name] for name in STATE)
    after = velocity(columns, "2")
    x_2 = after.get("v_x2")
    y_2 = after.get("v_y2")
    omega_2 = columns.get("omega_2")
    inertia = ball.inertia_ratio * ball.mass * ball.radius**2
    results: dict[str, AnalyticArray] = {}
    if y_2 is not None:
        results["cor"] = y_2 / y_1
    if x_2 is not None and not is_drop:
        if y_2 is not None:
            results["mu_bar"] = (x_1 - x_2) / (y_1 + y_2)
        if omega_2 is not None:
            slip_1 = x_1 - ball.radius * omega_1
            slip_2 = x_2 - ball.radius * omega_2
            results["e_x"] = -slip_2 / slip_1
        if y_2 is not None and omega_2 is not None:
            spun = inertia * (omega_2 - omega_1)
            turn = ball.mass * ball.radius * (x_1 - x_2) - spun
            results["offset"] = turn / (ball.mass * (y_1 + y_2))
    speed_2 = y_2 if is_drop else after.get("v_2")
    has_spin_energy = omega_2 is not None or (is_drop and not has_spin)
    if speed_2 is not None and has_spin_energy:
        square_1 = y_1**2 if is_drop else x_1**2 + y_1**2
        spin_2 = 0.0 if omega_2 is None else inertia * omega_2**2
        before = 0.5 * (ball.mass * square_1 + inertia * omega_1**2)
        lost = before - 0.5 * (ball.mass * speed_2**2 + spin_2)
        results["energy_lost"] = lost
        results["energy_fraction"] = lost / before
    return results
