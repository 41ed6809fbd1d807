"""Units and inputs of the thesis's simulations, turned to SI: what was printed, and how it was read; and the three
best cases of Jafri (2004), Table 9, on the impacts of a table: their values, predictions and errors.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitball.data.bundled import bundled_folder
from fitball.data.published import fraction, thesis_rows
from fitball.data.read import load_table
from fitball.data.table import ImpactTable
from fitball.inference.prediction.outputs import measured_outputs, output_errors, predicted_outputs, root_mean_square
from fitball.models.thesis import ThesisModel, compose_thesis
from fitball.models.types import Rebound, ThesisClosures
from fitball.values import Ball, FloatArray

# The thesis converts with 39.37 inches to the metre; within its own numbers that is the inch.
INCH = 1.0 / 39.37
POUND_FORCE = 4.4482216152605
STIFFNESS = POUND_FORCE / INCH
TORSION = POUND_FORCE * INCH
DAMPING = POUND_FORCE / INCH
MASS = POUND_FORCE / INCH
INERTIA = POUND_FORCE * INCH

# Appendix B: weight 0.127 lb and g = 386.4 in/s^2 within the programs; 0.000329 lb s^2/in in the text. The printed
# spins follow the first, the printed contact times the second.
BALL_MASS = 0.127 / 386.4 * MASS
BALL_MASS_ROUNDED = 0.000329 * MASS
# 1.3 in as in Eq. (72), not the 1.25 in of Appendix B.
BALL_RADIUS = 1.3 * INCH
FRICTION = 0.55
K_THETA = 1000.0 * TORSION
# Eq. (53), inches against metres a second.
C1, C2 = 0.0431, -0.189
# Chapter II, sets (a) to (c); Appendix C rounds the last two to 0.00026 and 0.00025.
INERTIA_OF: Mapping[str, float] = {"1/2": 0.00028, "2/3": 0.000264, "3/4": 0.000257}


def offset_line() -> dict[str, float]:
    """Eq. (53) as `eps_10` [m] and `eps_slope` [m/(m/s)]."""
    return {"eps_10": (10.0 * C1 + C2) * INCH, "eps_slope": C1 * INCH}


def case_parameters(
    mass_ratio: str, k_y: float, i1_over_i: float, c_y: float | None = None, *, rounded_mass: bool = False
) -> dict[str, float]:
    """Parameters of model `thesis` for a set of the thesis; `k_y` [lb/in], `c_y` [lb s/in]."""
    mass = BALL_MASS_ROUNDED if rounded_mass else BALL_MASS
    values = {
        "mass_ratio": fraction(mass_ratio),
        "k_y": k_y * STIFFNESS,
        "k_theta": K_THETA,
        "mu": FRICTION,
        **offset_line(),
        "inertia_split": i1_over_i,
        "ball_mass": mass,
        "ball_radius": BALL_RADIUS,
        "inertia_ratio": INERTIA_OF[mass_ratio] * INERTIA / (mass * BALL_RADIUS**2),
    }
    return values if c_y is None else {**values, "c_y": c_y * DAMPING}


def row_parameters(row: Mapping[Any, Any], *, rounded_mass: bool = False) -> dict[str, float]:
    """`case_parameters` of a row of Appendix C with its own `c_y`."""
    set_values = (row["mass_ratio"], row["k_y [lb/in]"], row["i1_over_i"], row["c_y [lb s/in]"])
    return case_parameters(*set_values, rounded_mass=rounded_mass)


def printed_model() -> ThesisModel:
    """Model `thesis` as Appendix C and the examples use it: damping, inertia and restitution given."""
    return compose_thesis("thesis", Ball(), True, ThesisClosures("given", "table", "measured"))


def relative_error(computed: Any, printed: Any) -> Any:
    """Deviation from a printed value in per cent of its size."""
    return 100.0 * (np.asarray(computed) - np.asarray(printed)) / np.abs(np.asarray(printed))


# Half a unit in the last printed digit: what is nearer than this was copied from the same print.
SAME = 5e-3
NEEDED = ("v_x2", "v_y2", "omega_2")
PREDICTIONS = Path(__file__).with_name("predictions.csv")
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
    for case, by_output in predictions().items():
        predicted = {name: column[rows] for name, column in by_output.items()}
        predicted["theta_2"] = np.arctan2(predicted["v_y2"], predicted["v_x2"])
        errors[case] = output_errors(known, predicted)
    return errors


def compare_cases(table: ImpactTable, rebound: Rebound, given_columns: tuple[str, ...]) -> CaseComparison | None:
    """The cases beside a model with this `rebound` (1, impacts), which takes some outputs as input; None for others'
    data.
    """
    errors = case_errors(table)
    if not errors:
        return None
    damping = thesis_rows("chapter_five_damping")
    cases = []
    for row in thesis_rows("table_9"):
        case = int(row["case"])
        mean = [float(spin["cor"]) for spin in damping if spin["case"] == row["case"]]
        cases.append(
            PublishedCase(
                case,
                case_parameters(row["mass_ratio"], float(row["k_y [lb/in]"]), float(row["i1_over_i"])),
                (min(mean), max(mean)),
                {name: root_mean_square(errors[case][name]) for name in COMPARED},
            )
        )
    mine = output_errors(measured_outputs(table), predicted_outputs(rebound, given_columns))
    return CaseComparison(tuple(cases), {name: root_mean_square(mine[name]) for name in COMPARED if name in mine})


@cache
def predictions() -> Mapping[int, Mapping[str, FloatArray]]:
    """`v_x2`, `v_y2` [m/s] and `omega_2` [rad/s] (21,) of Wang's impacts by case: what the thesis's computation gives
    with Chapter V's damping and mean restitution. A file holds it, so that no fit compiles that computation;
    `fitball.thesis.printed_tables` makes it.
    """
    with PREDICTIONS.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        case: {name: np.array([float(row[name]) for row in rows if int(row["case"]) == case]) for name in NEEDED}
        for case in sorted({int(row["case"]) for row in rows})
    }


def set_name(row: Mapping[Any, Any]) -> str:
    """A set of Appendix C as people name it."""
    return f"{row['case']}: M1/M = {row['mass_ratio']}, k_y = {row['k_y [lb/in]']} lb/in"
