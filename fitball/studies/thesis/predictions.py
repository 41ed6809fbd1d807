"""What the thesis's computation predicts of Wang's impacts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitball.data.thesis_tables import thesis_table
from fitball.data.wang import SPINS, measured
from fitball.inference.thesis.inputs import case_parameters, printed_model
from fitball.models.model import Model
from fitball.values import FloatArray, impacts


def chapter_five_predictions() -> dict[int, dict[str, dict[str, FloatArray]]]:
    """`v_x2`, `v_y2`, `theta_2`, `omega_2` (7,) by case and spin, with Chapter V's own `c_y` and mean restitution."""
    best, damping = thesis_table("table_9"), thesis_table("chapter_five_damping")
    chosen = printed_model()
    predictions: dict[int, dict[str, dict[str, FloatArray]]] = {}
    for row in best.to_dict("records"):
        case = int(row["case"])
        predictions[case] = {}
        for spin in SPINS:
            printed = damping[(damping["case"] == case) & (damping["spin"] == spin)].iloc[0]
            values = case_parameters(
                row["mass_ratio"], row["k_y [lb/in]"], row["i1_over_i"], printed["c_y [lb s/in]"]
            )
            predictions[case][spin] = spin_predictions(chosen, values, spin, float(printed["cor"]))
    return predictions


def spin_predictions(
    chosen: Model, values: Mapping[str, float], spin: str, cor: float | None = None
) -> dict[str, FloatArray]:
    """`v_x2`, `v_y2` [m/s], `theta_2` [deg], `omega_2` [rad/s] (7,) of Wang's impacts of one spin, from a model that
    is told the restitution: `cor`, or each impact's own.
    """
    wang = measured(spin)
    restitution = wang["v_y2"] / wang["v_y1"] if cor is None else cor
    rebound = chosen.rebound(values, impacts(wang["v_x1"], wang["v_y1"], _incident_spin(spin), restitution))
    return {
        "v_x2": rebound.v_x2,
        "v_y2": rebound.v_y2,
        "theta_2": np.degrees(np.arctan2(rebound.v_y2, rebound.v_x2)),
        "omega_2": rebound.omega_2,
    }


def _incident_spin(spin: str) -> FloatArray:
    """The thesis takes the small spins of the zero-spin impacts as zero."""
    return np.zeros(7) if spin == "zero" else measured(spin)["omega_1"]
