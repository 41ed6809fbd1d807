"""Wang's measurements, table by table, as the thesis uses them."""

from __future__ import annotations

import numpy as np

from fitball.data.read import load_table
from fitball.values import FloatArray

SPINS = ("zero", "topspin", "backspin")
FILES = {"zero": "wang_zero_spin.csv", "topspin": "wang_topspin.csv", "backspin": "wang_backspin.csv"}


def measured(spin: str) -> dict[str, FloatArray]:
    """`v_x2`, `v_y2`, `v_2` [m/s], `theta_2` [deg], `omega_2` [rad/s], incident `v_x1`, `v_y1`, `omega_1`, all (7,).

    The angle is the printed one, even where the components beside it give another.
    """
    table = load_table(FILES[spin])
    columns = {name: getattr(table.impacts, name) for name in table.incident_columns}
    columns |= {item.name: item.values for item in (*table.measurements, *table.redundant)}
    return columns | {"theta_2": np.degrees(columns["theta_2"])}
