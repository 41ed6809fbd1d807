"""The parameter sets that Jafri (2004) published, as predictions of Wang's impacts to stand beside fitted models."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitball.data.bundled import bundled_folder
from fitball.data.read import load_table
from fitball.data.table import ImpactTable
from fitball.data.thesis_tables import thesis_table
from fitball.inference.comparison import FixedPrediction
from fitball.inference.outputs import measured_outputs, output_errors
from fitball.studies.ranking import chapter_five_predictions, set_name
from fitball.studies.wang import SPINS
from fitball.values import FloatArray

# Half a unit in the last printed digit: what is nearer than this was copied from the same print.
SAME = 5e-3
TABLE_9 = (
    "Jafri (2004), Table 9 with Eq. (53) and Chapter V's damping and mean restitution; hand-tuned on these impacts"
)
APPENDIX_C = "Jafri (2004), Appendix C as printed; each impact's own measured restitution is its input"


def wang_rows(table: ImpactTable) -> NDArray[np.int64] | None:
    """For each impact of the table its row among Wang's 21, or None when it holds any other impact."""
    wang = load_table(bundled_folder() / "wang_all.csv")
    mine, theirs = (
        {"v_x1": item.impacts.v_x1, "v_y1": item.impacts.v_y1, "omega_1": item.impacts.omega_1}
        | measured_outputs(item)
        for item in (table, wang)
    )
    shared = [name for name in mine if name in theirs and name not in ("theta_2", "v_2")]
    apart = np.max([np.abs(mine[name][:, None] - theirs[name][None, :]) for name in shared], axis=0)
    nearest: NDArray[np.int64] = np.argmin(apart, axis=1).astype(np.int64)
    if np.any(apart[np.arange(len(table)), nearest] > SAME):
        return None
    return nearest


def published_sets(table: ImpactTable) -> tuple[FixedPrediction, ...]:
    """Errors of the three cases of Table 9 and the seven sets of Appendix C; empty where the data are not Wang's."""
    rows = wang_rows(table)
    measured = measured_outputs(table)
    if rows is None or not {"v_x2", "v_y2", "omega_2"} <= measured.keys():
        return ()
    made = []
    for case, by_spin in chapter_five_predictions().items():
        predicted = {
            name: np.concatenate([by_spin[spin][name] for spin in SPINS])[rows]
            for name in ("v_x2", "v_y2", "omega_2")
        }
        predicted["theta_2"] = np.arctan2(predicted["v_y2"], predicted["v_x2"])
        made.append(FixedPrediction(f"Table 9, case {case}", TABLE_9, output_errors(measured, predicted), ()))
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
