"""What the thesis prints beside its appendices, recomputed: Tables 2, 4, 6, 7 and 8, the examples of Chapter III,
which of three formulas each printed `c_y` obeys; and what its computation predicts of Wang's impacts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from uncertainties import ufloat
from uncertainties.core import Variable

from fitball.data.published import SPINS, fraction, measured, thesis_table
from fitball.inference.thesis.published_cases import (
    BALL_MASS_ROUNDED,
    DAMPING,
    INCH,
    STIFFNESS,
    case_parameters,
    printed_model,
    relative_error,
    row_parameters,
)
from fitball.models.model import Model
from fitball.thesis.appendices import CASE_IN_APPENDIX_C
from fitball.values import FloatArray, impacts

TABLE_OF = {"zero": "table_2", "topspin": "table_4", "backspin": "table_6"}
# Appendix B, lbf s^2 in: what its programs use, against the 0.00028 of Chapter IV.
INERTIA_APPENDIX_B = 0.000342
# What the second example of Chapter III was computed with, found by recomputation, and the row of Appendix C in which
# its rebound stands: v_x1, v_y1 [m/s], omega_1 [rad/s], c_y [lb s/in].
USED_IN_EXAMPLE_2 = (12.63, 12.55, 136.32, 0.0129)
ROW_OF_EXAMPLE_2 = ("C11", 5)
INPUT_HEADS = ["v_x1 [m/s]", "v_y1 [m/s]", "omega_1 [rad/s]", "c_y [lb s/in]"]
# Half of the last printed digit of a transition, and per cent that rounding of inputs leaves of a rebound.
TRANSITION_ROUNDING = 0.0005
EXAMPLE_ROUNDING = 0.05
MASS = 0.127 / 386.4
GRAVITY = 386.4


def energies() -> pd.DataFrame:
    """Tables 2, 4 and 6: restitutions and kinetic energies [lbf in] as printed, and recomputed from Wang's numbers.

    `implied_inertia` [lbf s^2 in] is what each printed rebound energy needs.
    """
    parts = []
    for spin in SPINS:
        printed, wang = thesis_table(TABLE_OF[spin]), measured(spin)
        speed_1 = printed["v_1 [m/s]"] / INCH
        speed_2 = printed["v_2 [m/s]"] / INCH
        spin_2 = printed["omega_2 [rad/s]"].to_numpy()
        moving = 0.5 * MASS * speed_2**2
        parts.append(
            pd.DataFrame(
                {
                    "spin": spin,
                    "theta_1 [deg]": printed["theta_1 [deg]"],
                    "cor": printed["cor"],
                    "cor_recomputed": wang["v_y2"] / wang["v_y1"],
                    "v_x2_over_v_x1": printed["v_x2_over_v_x1"],
                    "v_x2_over_v_x1_recomputed": wang["v_x2"] / wang["v_x1"],
                    "energy_1": printed["energy_1 [lb in]"],
                    "energy_1_recomputed": 0.5 * MASS * speed_1**2
                    + 0.5 * INERTIA_APPENDIX_B * printed["omega_1 [rad/s]"] ** 2,
                    "energy_2": printed["energy_2 [lb in]"],
                    "energy_2_recomputed": moving + 0.5 * INERTIA_APPENDIX_B * spin_2**2,
                    "implied_inertia": 2.0 * (printed["energy_2 [lb in]"] - moving) / spin_2**2,
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def mean_friction() -> pd.DataFrame:
    """Table 7 against Eq. (65) with the measured restitution: printed, recomputed, and how print was rounded."""
    printed = thesis_table("table_7")
    rows = []
    for spin in SPINS:
        wang = measured(spin)
        friction = (wang["v_x1"] - wang["v_x2"]) / (wang["v_y1"] + wang["v_y2"])
        for angle, value, exact in zip(printed["nominal_theta_1 [deg]"], printed[spin], friction, strict=True):
            if abs(value - exact) <= 0.0005 + 1e-12:
                how = "rounded"
            else:
                how = "truncated" if 0.0 <= exact - value < 0.001 else "differs"
            rows.append({"spin": spin, "theta_1 [deg]": angle, "printed": value, "recomputed": exact, "print": how})
    return pd.DataFrame(rows)


@dataclass(frozen=True)
class Inertia:
    """The moment of inertia over `M R_s^2` and in lbf s^2 in, and the share of each source in the variance."""

    ratio: Variable
    moment: Variable
    shares: Mapping[str, float]


def bifilar_inertia() -> Inertia:
    """Table 8 and Eq. (79).

    Timing scatters as the ten runs do; length and radius carry the rounding of their last printed digit, as the
    thesis states nothing else. The mass cancels; `R_s` is the 1.25 in at which the strings were taped.
    """
    table = thesis_table("table_8")
    periods = (table["time [s]"] / table["cycles"]).to_numpy()
    period = ufloat(periods.mean(), periods.std(ddof=1) / math.sqrt(periods.size))
    length = ufloat(101.6, 0.1 / math.sqrt(12.0)) / 100.0 / INCH
    radius = ufloat(1.25, 0.01 / math.sqrt(12.0))
    ratio = GRAVITY / (length * (2.0 * math.pi / period) ** 2)
    moment = MASS * radius**2 * ratio
    parts, total = moment.error_components(), moment.std_dev**2
    shares = {name: parts.get(item, 0.0) ** 2 / total for name, item in (("timing", period), ("radius", radius))}
    return Inertia(ratio, moment, shares | {"string length": 1.0 - sum(shares.values())})


def examples() -> pd.DataFrame:
    """The two examples of Chapter III: printed, recomputed from the stated inputs, from those that give the printed
    rebound, and the second from those of the row of Appendix C that shares its rebound.
    """
    printed, rows_c = thesis_table("chapter_three_examples"), thesis_table("appendix_c")
    table, case = ROW_OF_EXAMPLE_2
    row_c = rows_c[(rows_c["table"] == table) & (rows_c["case"] == case)].iloc[0]
    rows = []
    for row in printed.to_dict("records"):
        inputs = {"stated": tuple(row[head] for head in INPUT_HEADS)}
        inputs["used"] = inputs["stated"] if row["example"] == 1 else USED_IN_EXAMPLE_2
        if row["example"] == 2:
            inputs[f"{table}, case {case}"] = tuple(float(row_c[head]) for head in INPUT_HEADS)
        for label, (v_x1, v_y1, omega_1, c_y) in inputs.items():
            values = case_parameters(row["mass_ratio"], row["k_y [lb/in]"], row["i1_over_i"], c_y)
            chosen = printed_model()
            impact = impacts(v_x1, v_y1, omega_1, row["cor"])
            rebound, course = chosen.rebound(values, impact), chosen.course(values, impact, np.zeros(1))
            rows.append(
                {
                    "example": row["example"],
                    "inputs": label,
                    **dict(zip(INPUT_HEADS, (v_x1, v_y1, omega_1, c_y), strict=True)),
                    "v_x2": row["v_x2 [m/s]"],
                    "v_x2_recomputed": rebound.v_x2[0],
                    "v_x2_error": float(relative_error(rebound.v_x2[0], row["v_x2 [m/s]"])),
                    "omega_2": row["omega_2 [rad/s]"],
                    "omega_2_recomputed": rebound.omega_2[0],
                    "omega_2_error": float(relative_error(rebound.omega_2[0], row["omega_2 [rad/s]"])),
                    "transition": row["transition"],
                    "transition_recomputed": course.transition / course.contact_time,
                }
            )
    return pd.DataFrame(rows)


def rebound_words(rows: pd.DataFrame, number: int) -> str:
    """Of rows of `examples()`: which inputs give the printed rebound of one."""
    mine = _example(rows, number)
    stated, used = mine["stated"], mine["used"]
    rebound = f"Example {number}: the printed {used['v_x2']:g} m/s and {used['omega_2']:g} rad/s come"
    if _reproduced(stated):
        return f"{rebound} from the inputs stated."
    others = f"but from {_inputs(used)}" if _reproduced(used) else "nor from any inputs known"
    return (
        f"{rebound} not from the inputs stated, which give {stated['v_x2_recomputed']:.3f} m/s and "
        f"{stated['omega_2_recomputed']:.2f} rad/s, {others}."
    )


def transition_words(rows: pd.DataFrame, number: int) -> str:
    """Whether the printed start of rolling is that of the printed rebound's inputs; empty where none is printed."""
    mine = _example(rows, number)
    if mine["used"]["transition"] == "":
        return ""
    printed = float(mine["used"]["transition"])
    shares = {label: float(row["transition_recomputed"]) for label, row in mine.items()}
    if abs(shares["used"] - printed) <= TRANSITION_ROUNDING:
        return f"Example {number}: the printed transition, {printed:g}, comes from the inputs of the rebound."
    nearest = min(shares, key=lambda label: abs(shares[label] - printed))
    others = {label: share for label, share in shares.items() if label not in ("used", nearest)}
    given = ", ".join(f"{share:.3f} with the inputs {label}" for label, share in others.items())
    return (
        f"Example {number}: the printed transition, {printed:g}, is not that of the printed rebound, whose inputs "
        f"({_inputs(mine['used'])}) give {shares['used']:.3f}. The nearest is {shares[nearest]:.3f}, with those of "
        f"{nearest} ({_inputs(mine[nearest])}); {given}."
    )


def _example(rows: pd.DataFrame, number: int) -> dict[str, dict[Any, Any]]:
    return {str(row["inputs"]): dict(row) for row in rows[rows["example"] == number].to_dict("records")}


def _reproduced(row: dict[Any, Any]) -> bool:
    return bool(max(abs(row["v_x2_error"]), abs(row["omega_2_error"])) <= EXAMPLE_ROUNDING)


def _inputs(row: dict[Any, Any]) -> str:
    v_x1, v_y1, omega_1, c_y = (row[head] for head in INPUT_HEADS)
    return f"V_x1 = {v_x1:g}, V_y1 = {v_y1:g} m/s, {omega_1:g} rad/s, c_y = {c_y:g} lb s/in"


def figures_36_to_44() -> pd.DataFrame:
    """The points of Figs 36 to 44: by figure and impact what Wang measured, what the thesis's computation gives with
    the `c_y` and the mean restitution of Chapter V (`recomputed`), and what Appendix C prints for the same set.
    """
    own, rows_c = chapter_five_predictions(), thesis_table("appendix_c")
    parts = []
    for row in thesis_table("chapter_five_damping").to_dict("records"):
        case, spin = int(row["case"]), str(row["spin"])
        wang, heads = measured(spin), {"v_x2": "m/s", "theta_2": "deg", "omega_2": "rad/s"}
        printed = rows_c[(rows_c["spin"] == spin) & (rows_c["case"] == CASE_IN_APPENDIX_C[case])]
        part = {**row, "theta_1 [deg]": np.degrees(np.arctan2(wang["v_y1"], wang["v_x1"]))}
        for name, unit in heads.items():
            part[f"{name}, measured [{unit}]"] = wang[name]
            part[f"{name}, recomputed [{unit}]"] = own[case][spin][name]
            # Angles are printed negative.
            sign = -1.0 if name == "theta_2" else 1.0
            part[f"{name}, Appendix C [{unit}]"] = sign * printed[f"{name} [{unit}]"].to_numpy()
        parts.append(pd.DataFrame(part))
    return pd.concat(parts, ignore_index=True)


@dataclass(frozen=True)
class Check:
    """`name` of what was recomputed; `finding` in words; `holds` whether the recomputation still gives what it gave
    when this was written, so that a change in the code shows.
    """

    name: str
    finding: str
    holds: bool


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
    """`v_x2`, `v_y2` [m/s], `theta_2` [deg], `omega_2` [rad/s] (7,) of Wang's impacts of one spin, from a model with
    given restitution: `cor`, or each impact's own.
    """
    wang = measured(spin)
    restitution = wang["v_y2"] / wang["v_y1"] if cor is None else cor
    # The thesis takes the small spins of the zero-spin impacts as zero.
    omega_1 = np.zeros(7) if spin == "zero" else wang["omega_1"]
    rebound = chosen.rebound(values, impacts(wang["v_x1"], wang["v_y1"], omega_1, restitution))
    angle = np.degrees(np.arctan2(rebound.v_y2, rebound.v_x2))
    return {"v_x2": rebound.v_x2, "v_y2": rebound.v_y2, "theta_2": angle, "omega_2": rebound.omega_2}


# Eq. (8): exp(-x) = (M/M1) COR; Chapter III: exp(-x) = (M1/M)/COR; Chapter V: exp(-x) = COR.
# Per cent within which a formula is taken to be the one that was used. The formulas differ by 20 % and more; the
# mean restitution that went into a printed value is known to two or three digits only, which makes up to 4 %.
OBEYS = 5.0


def damping_of(left: float, mass_ratio: float, k_y: float) -> float:
    """`c_y` [lb s/in] with `exp(-pi zeta/sqrt(1 - zeta^2)) = left`; NaN unless `0 < left <= 1`; `k_y` [lb/in]."""
    if not 0.0 < left <= 1.0:
        return math.nan
    decrement = -math.log(left) / math.pi
    core = mass_ratio * BALL_MASS_ROUNDED
    zeta = decrement / math.sqrt(1.0 + decrement * decrement)
    return 2.0 * zeta * math.sqrt(k_y * STIFFNESS * core) / DAMPING


def formula_table() -> pd.DataFrame:
    """Every distinct printed `c_y`: the nine of Chapter V and those of Appendix C, beside the three formulas."""
    # As Chapter V takes it.
    cor = {spin: float(np.mean(measured(spin)["v_y2"] / measured(spin)["v_y1"])) for spin in SPINS}
    nine = thesis_table("chapter_five_damping").merge(thesis_table("table_9"), on="case", validate="many_to_one")
    nine["place"] = [f"Fig. {figure}" for figure in nine["figure"]]
    columns = ["spin", "case", "mass_ratio", "k_y [lb/in]", "c_y [lb s/in]"]
    distinct = thesis_table("appendix_c")[columns].drop_duplicates()
    distinct["place"] = [f"Appendix C, case {case}" for case in distinct["case"]]
    printed = pd.concat([nine, distinct])[["place", "spin", "mass_ratio", "k_y [lb/in]", "c_y [lb s/in]"]]
    rows = []
    for place, spin, ratio, k_y, c_y in printed.itertuples(index=False):
        m = fraction(ratio)
        lefts = {"Eq. (8)": cor[spin] / m, "Chapter III": m / cor[spin], "Chapter V": cor[spin]}
        dampings = {name: damping_of(left, m, k_y) for name, left in lefts.items()}
        near = {name: abs(100.0 * (value / c_y - 1.0)) for name, value in dampings.items() if math.isfinite(value)}
        nearest = min(near, key=lambda name: near[name])
        rows.append(
            {"place": place, "spin": spin, "mass_ratio": ratio, "k_y [lb/in]": k_y, "printed": c_y, **dampings,
             "obeys": nearest if near[nearest] <= OBEYS else "none", "nearest [%]": near[nearest]}
        )  # fmt: skip
    return pd.DataFrame(rows)
