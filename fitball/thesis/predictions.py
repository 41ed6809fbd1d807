"""What the thesis's computation predicts of Wang's impacts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitball.data.published import measured, thesis_table
from fitball.inference.thesis.inputs import printed_model, row_parameters
from fitball.models.model import Model
from fitball.values import FloatArray, impacts


def chapter_five_predictions() -> dict[int, dict[str, dict[str, FloatArray]]]:
    """`v_x2`, `v_y2`, `theta_2`, `omega_2` (7,) by case and spin, with Chapter V's own `c_y` and mean restitution."""
    damping = thesis_table("chapter_five_damping").merge(thesis_table("table_9"), on="case", validate="many_to_one")
    chosen = printed_model()
    return {
        int(str(case)): {
            str(row["spin"]): spin_predictions(chosen, row_parameters(row), str(row["spin"]), float(row["cor"]))
            for row in rows.to_dict("records")
        }
        for case, rows in damping.groupby("case")
    }


def spin_predictions(
    chosen: Model, values: Mapping[str, float], spin: str, cor: float | None = None
) -> dict[str, FloatArray]:
    """`v_x2`, `v_y2` [m/s], `theta_2` [deg], `omega_2` [rad/s] (7,) of Wang's impacts of one spin, from a model that
    is told the restitution: `cor`, or each impact's own.
    """
    wang = measured(spin)
    restitution = wang["v_y2"] / wang["v_y1"] if cor is None else cor
    # The thesis takes the small spins of the zero-spin impacts as zero.
    omega_1 = np.zeros(7) if spin == "zero" else wang["omega_1"]
    rebound = chosen.rebound(values, impacts(wang["v_x1"], wang["v_y1"], omega_1, restitution))
    angle = np.degrees(np.arctan2(rebound.v_y2, rebound.v_x2))
    return {"v_x2": rebound.v_x2, "v_y2": rebound.v_y2, "theta_2": angle, "omega_2": rebound.omega_2}
