"""What each impact says by conservation laws alone, without a model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitball.base.columns import STATE
from fitball.base.text import column_head
from fitball.base.values import Ball, DataFrame, FloatArray
from fitball.data.kinematics import Columns, counted, slopes, velocity
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
    drop = not table.has_tangential
    spun = table.has_spin
    results, slope = slopes(lambda known: _balances(known, ball, drop, spun), values)
    with np.errstate(invalid="ignore"):
        sds = np.sqrt(np.einsum("kri,kij,krj->rk", slope, covariance, slope))
    # A slope is exactly zero where a result does not contain the column.
    sds[np.any(slope[:, :, unknown] != 0.0, axis=2).T] = np.nan
    frame: dict[str, FloatArray] = {}
    for name, unit in BALANCES.items():
        column = np.full(len(impacts), np.nan)
        sd = column
        if name in results:
            column = np.where(np.isfinite(results[name]), results[name], np.nan)
            sd = sds[[*results].index(name)]
        frame |= {column_head(name, unit): column, column_head(f"{name}_sd", unit): sd}
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
