"""The three best cases of Jafri (2004), Table 9, on the impacts of a table: their values, predictions and errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitball.data.bundled import bundled_folder
from fitball.data.read import load_table
from fitball.data.table import ImpactTable
from fitball.data.thesis_tables import thesis_table
from fitball.data.wang import SPINS, measured
from fitball.inference.prediction.outputs import measured_outputs, output_errors, predicted_outputs, root_mean_square
from fitball.inference.thesis.inputs import case_parameters, printed_model
from fitball.models.model import Model
from fitball.models.types import Rebound
from fitball.values import FloatArray, impacts

# Half a unit in the last printed digit: what is nearer than this was copied from the same print.
SAME = 5e-3
NEEDED = ("v_x2", "v_y2", "omega_2")
COMPARED = (*NEEDED, "theta_2")


@dataclass(frozen=True)
class PublishedCase:
    """One case: `values` of its parameters by name in SI, `restitution` the smallest and largest mean of a
    spin, `rms` its root mean square errors by output in SI (angles in radians).
    """

    case: int
    values: Mapping[str, float]
    restitution: tuple[float, float]
    rms: Mapping[str, float]


@dataclass(frozen=True)
class CaseComparison:
    """The cases beside a fit whose point estimate has these `fitted_rms`, on the same impacts."""

    cases: tuple[PublishedCase, ...]
    fitted_rms: Mapping[str, float]


@cache
def _wang() -> ImpactTable:
    return load_table(bundled_folder() / "wang_all.csv")


def wang_rows(table: ImpactTable) -> NDArray[np.int64] | None:
    """For each impact of the table its row among Wang's 21, or None when it holds any other impact, or more."""
    wang = _wang()
    if len(table) > len(wang):
        return None
    mine, theirs = (
        {"v_x1": data.impacts.v_x1, "v_y1": data.impacts.v_y1, "omega_1": data.impacts.omega_1}
        | measured_outputs(data)
        for data in (table, wang)
    )
    shared = [name for name in mine if name in theirs and name not in ("theta_2", "v_2")]
    apart = np.max([np.abs(mine[name][:, None] - theirs[name][None, :]) for name in shared], axis=0)
    nearest: NDArray[np.int64] = np.argmin(apart, axis=1).astype(np.int64)
    if np.any(apart[np.arange(len(table)), nearest] > SAME):
        return None
    return nearest


def case_errors(table: ImpactTable) -> dict[int, dict[str, FloatArray]]:
    """Predicted minus measured (impacts,) by case and output, SI; empty where the data are not Wang's."""
    rows = wang_rows(table)
    known = measured_outputs(table)
    if rows is None or not set(NEEDED) <= known.keys():
        return {}
    errors = {}
    for case, by_spin in chapter_five_predictions().items():
        predicted = {name: np.concatenate([by_spin[spin][name] for spin in SPINS])[rows] for name in NEEDED}
        predicted["theta_2"] = np.arctan2(predicted["v_y2"], predicted["v_x2"])
        errors[case] = output_errors(known, predicted)
    return errors


def compare_cases(table: ImpactTable, rebound: Rebound, given_columns: tuple[str, ...]) -> CaseComparison | None:
    """The cases beside a model whose `rebound` (1, impacts) is `told` some outputs; None for others' data."""
    errors = case_errors(table)
    if not errors:
        return None
    best, damping = thesis_table("table_9"), thesis_table("chapter_five_damping")
    cases = []
    for row in best.to_dict("records"):
        case = int(row["case"])
        mean = damping[damping["case"] == case]["cor"]
        cases.append(
            PublishedCase(
                case,
                case_parameters(row["mass_ratio"], row["k_y [lb/in]"], row["i1_over_i"]),
                (float(mean.min()), float(mean.max())),
                {name: root_mean_square(errors[case][name]) for name in COMPARED},
            )
        )
    mine = output_errors(measured_outputs(table), predicted_outputs(rebound, given_columns))
    return CaseComparison(tuple(cases), {name: root_mean_square(mine[name]) for name in COMPARED if name in mine})


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


def set_name(row: Mapping[Any, Any]) -> str:
    """A set of Appendix C as people name it."""
    return f"{row['case']}: M1/M = {row['mass_ratio']}, k_y = {row['k_y [lb/in]']}"
