"""Appendices C and D of Jafri's thesis (2004), as printed and computed again."""

import math
from collections.abc import Mapping
from functools import cache
from typing import Annotated

import numpy as np
import pandas as pd

from fitball.base.values import DataFrame, FloatArray, Impacts
from fitball.data.bundled import datasets_folder, printed_table
from fitball.models.registry import THESIS_EXACT, model
from fitball.thesis.printed import (
    BALL_MASS,
    BALL_MASS_ROUNDED,
    LB_S_PER_IN,
    SET_OF_CASE,
    appendix_c,
    compute_sets,
    count_within,
    recompute_appendix_c,
    rows_of_erratum,
    set_values,
)

# Chapter V: mean restitution of each spin.
MEAN_COR = {"zero": 0.765, "topspin": 0.778, "backspin": 0.732}
# Deviations from print within which rows are counted [%].
COUNTED_LIMITS = (0.1, 0.5, 1.0)
# Outputs that are judged, with their units.
JUDGED_OUTPUTS = {"v_x2": "m/s", "theta_2": "deg", "omega_2": "rad/s"}
# Scales, SI, that weigh velocity [m/s] against spin [rad/s] in one score: about the noise of such
# measurements.
SCALES = {"v_x2": 0.25, "omega_2": 10.0}
# Deviation [%] of a cell of Appendix C that needs no cause: its printed inputs are rounded.
ROUNDING_PERCENT = 0.1
# Half of the last printed digit of a velocity [m/s] or spin [rad/s], which is more than
# ROUNDING_PERCENT of a small one.
HALF_DIGIT = 5e-4
# Per cent points by which three printed digits on either side can move an error of Appendix D.
MATCH_POINTS = 0.1
# Arrays by name of output, (sets, impacts), or of parameter, (sets,).
Outputs = Mapping[str, FloatArray]


@cache
def wang() -> DataFrame:
    """Wang's 21 impacts as printed: seven each of zero spin, topspin and backspin. The column
    `incident` is the spin before the bounce [rad/s], with small spins zero as the thesis takes
    them.
    """
    table = pd.read_csv(datasets_folder() / "wang_all.csv")
    table["incident"] = table["omega_1 [rad/s]"].where(table["group"] != "zero", 0.0)
    return table


def head_of(name: str) -> str:
    """The head of the column of an output in tables, such as `v_x2 [m/s]`."""
    return f"{name} [{JUDGED_OUTPUTS.get(name, 'm/s')}]"


def wang_column(name: str) -> Annotated[FloatArray, "21"]:
    """A column of Wang's impacts in the unit of `head_of`."""
    return wang()[head_of(name)].to_numpy(np.float64)


def measured_cor() -> Annotated[FloatArray, "21"]:
    """The measured coefficient of restitution of each of Wang's impacts."""
    return np.asarray(wang_column("v_y2") / wang_column("v_y1"))


def mean_cor() -> Annotated[FloatArray, "21"]:
    """For each of Wang's impacts the mean restitution that Chapter V has for its spin."""
    return np.asarray(wang()["group"].map(MEAN_COR), dtype=np.float64)


def damping(
    speed_ratio: FloatArray | float,
    mass_ratio: FloatArray | float,
    k_y: FloatArray | float,
    mass: float = BALL_MASS_ROUNDED,
) -> FloatArray:
    """Damping `c_y` [N s/m] of a core whose speed falls by `exp(-pi zeta/sqrt(1 - zeta^2)) =
    speed_ratio` in a contact; arguments in SI are broadcast. Chapter V takes COR for that ratio,
    Chapter III and Appendix C take `(M1/M)/COR`. Eq. (8) has `COR M/M1`, which exceeds one.
    """
    decrement = -np.log(speed_ratio) / math.pi
    stiffness = k_y * mass_ratio * mass
    return np.asarray(2.0 * decrement * np.sqrt(stiffness / (1.0 + decrement**2)))


def outputs_by_computation(
    values: Outputs,
    restitution: Annotated[FloatArray, "21"],
    c_y: Annotated[FloatArray, "sets 21"] | None = None,
) -> dict[str, FloatArray]:
    """Outputs (sets, 21) of Wang's impacts by the thesis's computation, at parameters (sets,) and
    the `restitution` of each impact; `c_y` [N s/m] is that of Chapter V if not passed.
    """
    sets = {name: value[:, np.newaxis] for name, value in values.items()}
    if c_y is None:
        c_y = damping(restitution, sets["mass_ratio"], sets["k_y"])
    wangs = wang_states()
    rebound = compute_sets(sets, wangs.v_x1, wangs.v_y1, wangs.omega_1, restitution, c_y)
    return _outputs_with_angle(rebound.v_x2, rebound.v_y2, rebound.omega_2)


def outputs_by_equations(
    values: Outputs,
    states: Impacts,
    restitution: FloatArray,
) -> dict[str, FloatArray]:
    """Outputs (sets, impacts) by the thesis's equations, solved exactly, at parameters (sets,),
    from incident states, with the `restitution` of each impact; NaN where the equations have no
    answer.
    """
    choices = {**THESIS_EXACT, "inertia": "table"}
    exact = model("+".join(["two-mass", *(f"{key}={choices[key]}" for key in choices)]))
    # Values of a law of restitution, which that of each impact replaces.
    law = {"cor_10": np.full_like(values["mu"], 0.75), "cor_slope": np.zeros_like(values["mu"])}
    columns = {**values, **law}
    sets = np.stack([*columns.values()], axis=1)
    rebound = exact.evaluate([*columns], sets, states, restitution)
    return _outputs_with_angle(rebound.v_x2, rebound.v_y2, rebound.omega_2)


def wang_states() -> Impacts:
    """Incident states of Wang's 21 impacts, SI, with small spins zero, as the thesis takes them."""
    return Impacts(
        wang_column("v_x1"), wang_column("v_y1"), wang()["incident"].to_numpy(np.float64)
    )


def _outputs_with_angle(
    v_x2: FloatArray, v_y2: FloatArray, omega_2: FloatArray
) -> dict[str, FloatArray]:
    """The outputs that are judged, from velocities [m/s] and spin [rad/s] after the bounce."""
    theta_2 = np.degrees(np.arctan2(v_y2, v_x2))
    return {"v_x2": v_x2, "theta_2": theta_2, "omega_2": omega_2}


def outputs_in_print(rows: DataFrame) -> dict[str, FloatArray]:
    """Outputs (7, 21) of `rows` of Appendix C as printed, by set and impact, with the measured
    V_y2: two of its tables carry each other's.
    """
    sets = rows.sort_values("case", kind="stable")
    v_x2 = sets[head_of("v_x2")].to_numpy(np.float64).reshape(7, 21)
    omega_2 = sets[head_of("omega_2")].to_numpy(np.float64).reshape(7, 21)
    return _outputs_with_angle(v_x2, np.broadcast_to(wang_column("v_y2"), v_x2.shape), omega_2)


def causes(rows: DataFrame, name: str) -> list[str]:
    """The cause that the errata state for the deviation of the column `name`, for each of the
    `rows` of Appendix C; empty where they state none.
    """
    texts = [""] * len(rows)
    errata = printed_table("errata")
    outputs = errata[(errata["kind"] != "input") & (errata["column"] == name)]
    for erratum in outputs[outputs["table"].str.startswith("C")].to_dict("records"):
        for k in np.flatnonzero(rows_of_erratum(rows, erratum["table"], erratum["row"])):
            texts[k] = f"{erratum['kind']}: {erratum['evidence']}"
    return texts


def judge_appendix_c() -> DataFrame:
    """Appendix C computed again, as by `recompute_appendix_c`. A column `NAME_cause` of velocity
    and of spin has the cause of each deviation by the errata, or `unlisted`.
    """
    rows = recompute_appendix_c(appendix_c())
    for name in SCALES:
        half_digit = 100.0 * HALF_DIGIT / rows[head_of(name)].abs()
        deviates = rows[f"{name}_error"].abs() > np.maximum(ROUNDING_PERCENT, half_digit)
        texts = [text or "unlisted" for text in causes(rows, name)]
        rows[f"{name}_cause"] = np.where(deviates, np.array(texts, dtype=object), "")
    return rows


def judge_appendix_d() -> DataFrame:
    """The 63 rows of Appendix D. Columns `NAME` are errors [%] computed again from Appendix C and
    Wang's tables, angles with the mean restitution of Chapter V. `NAME_matches` says whether they
    agree in size with the printed errors.
    """
    printed_c = printed_table("appendix_c")
    rows = printed_table("appendix_d")
    groups = []
    for (_table, spin, case), group in rows.groupby(["table", "spin", "case"], sort=False):
        of_case = printed_c["case"] == SET_OF_CASE[int(str(case))]
        theory = printed_c[of_case & (printed_c["spin"] == spin)]
        of_spin = (wang()["group"] == spin).to_numpy()
        outputs = _outputs_with_angle(
            theory["v_x2 [m/s]"].to_numpy(np.float64),
            (mean_cor() * wang_column("v_y1"))[of_spin],
            theory["omega_2 [rad/s]"].to_numpy(np.float64),
        )
        judged = group.copy()
        for name, output in outputs.items():
            judged[name] = 100.0 * (output / wang_column(name)[of_spin] - 1.0)
            apart = (judged[name].abs() - judged[f"{name}_error [%]"].abs()).abs()
            judged[f"{name}_matches"] = apart <= MATCH_POINTS
        groups.append(judged)
    return pd.concat(groups, ignore_index=True)


def counts_frame(rows_c: DataFrame, rows_d: DataFrame) -> DataFrame:
    """Numbers of rows that agree with print, by table and output, from the frames of
    `judge_appendix_c` and `judge_appendix_d`. Those of Appendix D agree within 0.1 per cent points.
    """
    counted: list[dict[str, object]] = []
    for name in ("v_x2 and omega_2", "v_x2", "v_y2", "omega_2", "theta_2", "contact_time"):
        errors = [rows_c[f"{output}_error"].abs() for output in name.split(" and ")]
        worst = np.max(errors, axis=0)
        row: dict[str, object] = {"table": "Appendix C", "output": name, "rows": len(rows_c)}
        for limit in COUNTED_LIMITS:
            row[f"within {limit:g} %"] = int(np.sum(worst <= limit))
        counted.append(row)
    for name in JUDGED_OUTPUTS:
        row = {"table": "Appendix D", "output": name, "rows": len(rows_d)}
        row[f"within {MATCH_POINTS:g} points"] = int(rows_d[f"{name}_matches"].sum())
        counted.append(row)
    return pd.DataFrame(counted)


def misses_of(predicted: Outputs) -> dict[str, FloatArray]:
    """Predicted less measured outputs (sets, 21) of Wang's impacts, by name."""
    return {name: predicted[name] - wang_column(name) for name in JUDGED_OUTPUTS}


# Departures of the thesis from its own equations, in words, and where it has these equations.
_SLIPS = {
    "none": ("none: the computation as it is", ""),
    "torque": (
        "the torque of friction on the shell is multiplied by a moment of inertia in lbf s^2 in, "
        "and so lost",
        "Appendix B",
    ),
    "sign": (
        "and the torque of the joint on the shell has the opposite sign",
        "Eqs (32), (34)",
    ),
    "cosine": (
        "a cosine too many in the damper's impulse on a ball that slides throughout",
        "Eq. (73)",
    ),
    "restitution": (
        "V_y2 is the measured restitution times V_y1, not what c_y gives",
        "Eqs (5) to (7)",
    ),
    "damping": (
        "c_y is that of exp(-x) = (M1/M)/COR; of exp(-x) = COR, as in Chapter V",
        "Eq. (8)",
    ),
    "radius": ("the radius is 1.3 in; the 1.25 in of Appendix B", "Appendix B"),
    "inputs": ("misprinted inputs are corrected; as printed", "Appendix C"),
    "all": (
        "all, with the twist at landing and at the start of rolling and the friction cone: solved "
        "exactly",
        "",
    ),
}


def slips_frame() -> DataFrame:
    """The departures of the thesis from its own equations. Each row has the rms changes of the
    outputs of the 147 rows without it, and the number of rows that then still agree with print,
    within 0.1 % in both velocity and spin.
    """
    rows = appendix_c()
    values = set_values(rows)
    c_y = rows["c_y [lb s/in]"].to_numpy(np.float64) * LB_S_PER_IN
    heads = ("v_x1 [m/s]", "v_y1 [m/s]", "omega_1 [rad/s]", "cor")
    v_x1, v_y1, omega_1, restitution = (rows[head].to_numpy(np.float64) for head in heads)

    def without(*slips: str, c_y: FloatArray = c_y, **changes: FloatArray) -> Outputs:
        """Outputs by the computation without these slips, or with other values of parameters."""
        changed = {**values, **changes}
        rebound = compute_sets(changed, v_x1, v_y1, omega_1, restitution, c_y, slips_mended=slips)
        return {
            "v_x2": rebound.v_x2,
            "v_y2": rebound.v_y2,
            "omega_2": rebound.omega_2,
            "contact_time": rebound.contact_time,
        }

    base = without()
    printed_inputs = recompute_appendix_c(printed_table("appendix_c"))
    ratio = values["mass_ratio"]
    damped = ratio * np.exp(-0.5 * c_y / (ratio * BALL_MASS) * base["contact_time"])
    inertia = values["inertia_ratio"] * (1.3 / 1.25) ** 2
    impacts = Impacts(v_x1[:, np.newaxis], v_y1[:, np.newaxis], omega_1[:, np.newaxis])
    solved = outputs_by_equations(values, impacts, restitution[:, np.newaxis])
    radius = values["ball_radius"] * (1.25 / 1.3)
    outputs: dict[str, Outputs] = {
        "none": {},
        "torque": without("torque"),
        "sign": without("torque", "sign"),
        "cosine": without("cosine"),
        "restitution": {"v_y2": damped * v_y1},
        "damping": without(c_y=damping(restitution, ratio, values["k_y"])),
        "radius": without(ball_radius=radius, inertia_ratio=inertia),
        "inputs": {name: printed_inputs[name].to_numpy(np.float64) for name in SCALES},
        "all": {name: solved[name][:, 0] for name in SCALES},
    }
    changes = []
    for key, (slip, where) in _SLIPS.items():
        changes.append({"slip": slip, "where": where, **_change(rows, base, outputs[key])})
    return pd.DataFrame(changes)


def _change(rows: DataFrame, base: Outputs, outputs: Outputs) -> dict[str, float]:
    """Rms changes of outputs (147,) from the `base`, and the number of rows that agree with print.
    Outputs that `outputs` lacks are those of the `base`.
    """
    without_slip = {**base, **outputs}
    changes: dict[str, float] = {}
    for name in ("v_x2", "v_y2", "omega_2"):
        changes[head_of(name)] = math.sqrt(np.nanmean((without_slip[name] - base[name]) ** 2))
    errors = {}
    for name in SCALES:
        errors[f"{name}_error"] = 100.0 * (without_slip[name] / rows[head_of(name)] - 1.0)
    return {**changes, "rows within 0.1 %": count_within(rows.assign(**errors), COUNTED_LIMITS[0])}
