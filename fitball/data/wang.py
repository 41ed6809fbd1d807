"""Wang's measurements, table by table, as the thesis uses them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitball.data.read import load_table
from fitball.data.table import ImpactTable
from fitball.values import FloatArray

SPINS = ("zero", "topspin", "backspin")
FILES: Mapping[str, str] = {
    "zero": "wang_zero_spin.csv",
    "topspin": "wang_topspin.csv",
    "backspin": "wang_backspin.csv",
}


def wang_table(spin: str) -> ImpactTable:
    """The seven impacts of one spin."""
    return load_table(FILES[spin])


def measured(spin: str) -> dict[str, FloatArray]:
    """`v_x2`, `v_y2` [m/s], `theta_2` [deg], `omega_2` [rad/s] and the incident `v_x1`, `v_y1`, `omega_1`, (7,).

    The angle is the printed one, even where the components beside it give another.
    """
    table = wang_table(spin)
    columns = {measurement.name: measurement.values for measurement in (*table.measurements, *table.redundant)}
    return {
        "v_x2": columns["v_x2"],
        "v_y2": columns["v_y2"],
        "v_2": columns["v_2"],
        "theta_2": np.degrees(columns["theta_2"]),
        "omega_2": columns["omega_2"],
        "v_x1": table.impacts.v_x1,
        "v_y1": table.impacts.v_y1,
        "omega_1": table.impacts.omega_1,
    }
