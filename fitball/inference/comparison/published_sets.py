"""The parameter sets that Jafri (2004) published, as predictions of Wang's impacts to stand beside fitted models."""

from __future__ import annotations

import numpy as np

from fitball.data.published import SPINS, thesis_table
from fitball.data.table import ImpactTable
from fitball.inference.comparison.results import FixedPrediction
from fitball.inference.prediction.outputs import measured_outputs, output_errors
from fitball.inference.thesis.published_cases import case_errors, set_name, wang_rows
from fitball.values import FloatArray

TABLE_9 = (
    "Jafri (2004), Table 9 with Eq. (53) and Chapter V's damping and mean restitution; hand-tuned on these impacts"
)
APPENDIX_C = "Jafri (2004), Appendix C as printed; each impact's own measured restitution is its input"


def published_sets(table: ImpactTable) -> tuple[FixedPrediction, ...]:
    """Errors of the three cases of Table 9 and the seven sets of Appendix C; empty where the data are not Wang's."""
    rows = wang_rows(table)
    measured = measured_outputs(table)
    if rows is None or not {"v_x2", "v_y2", "omega_2"} <= measured.keys():
        return ()
    made = [
        FixedPrediction(f"Table 9, case {case}", TABLE_9, errors, ()) for case, errors in case_errors(table).items()
    ]
    printed = thesis_table("appendix_c")
    for case in sorted(printed["case"].unique()):
        mine = printed[printed["case"] == case]

        def column(name: str, mine: object = mine) -> FloatArray:
            parts = [mine[mine["spin"] == spin][name].to_numpy() for spin in SPINS]  # type: ignore[index]
            return np.concatenate(parts)[rows]

        predicted = {"v_x2": column("v_x2 [m/s]"), "omega_2": column("omega_2 [rad/s]")}
        predicted["theta_2"] = np.arctan2(measured["v_y2"], predicted["v_x2"])
        name = f"Appendix C, {set_name(mine.iloc[0].to_dict())}"
        made.append(FixedPrediction(name, APPENDIX_C, output_errors(measured, predicted), ("v_y2",)))
    return tuple(made)
