"""What Jafri's thesis (2004) prints of Wang's impacts, and the same computed again."""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from fitball.base.values import DataFrame, FloatArray, Impacts
from fitball.data.bundled import datasets_folder, printed_table
from fitball.models.registry import THESIS_EXACT, model
from fitball.thesis.printed import (
    BALL_MASS,
    BALL_MASS_ROUNDED,
    DAMPING,
    SET_OF_CASE,
    appendix_c,
    computed,
    recomputed,
    selects,
    set_values,
    within,
)

# Chapter V: mean restitution of each spin.
MEAN_COR = {"zero": 0.765, "topspin": 0.778, "backspin": 0.732}
# Deviations from print within which rows are counted [%].
LIMITS = (0.1, 0.5, 1.0)
# Outputs that are judged, with their units.
OUTPUTS = {"v_x2": "m/s", "theta_2": "deg", "omega_2": "rad/s"}
# Scales that weigh velocity against spin in one score: the noise of such measurements, SI.
SCALES = {"v_x2": 0.25, "omega_2": 10.0}
# Deviation of a cell of Appendix C that needs no cause [%]: rounding of its printed inputs.
ROUNDING = 0.1
# Half of the last printed digit of a velocity or spin; of a small one that is more than ROUNDING.
HALF_DIGIT = 5e-4
# Per cent points by which three printed digits on either side can move an error of Appendix D.
MATCHES = 0.1
# Numbers of sets by output or parameter, each (sets, impacts) or (sets,).
Outputs = Mapping[str, FloatArray]


@cache
def wang() -> DataFrame:
    """Wang's 21 impacts as printed, zero spin, topspin, backspin; `incident` is the spin before the
    bounce [rad/s], in which small spins are zero, as the thesis takes them.
    """
    table = pd.read_csv(datasets_folder() / "wang_all.csv")
    table["incident"] = table["omega_1 [rad/s]"].where(table["group"] != "zero", 0.0)
    return table


def headed(name: str) -> str:
    """The head of an output's column in tables, `v_x2 [m/s]`."""
    return f"{name} [{OUTPUTS.get(name, 'm/s')}]"


def column(name: str) -> FloatArray:
    """A column of Wang's impacts, (21,), in the unit of `headed`."""
    return wang()[headed(name)].to_numpy(np.float64)


def cor() -> FloatArray:
    """The measured restitution, (21,)."""
    return np.asarray(column("v_y2") / column("v_y1"))


def mean_cor() -> FloatArray:
    """The mean restitution of Chapter V of each impact's spin, (21,)."""
    return np.asarray(wang()["group"].map(MEAN_COR), dtype=np.float64)


def damping(speed_ratio: Any, mass_ratio: Any, k_y: Any, mass: float = BALL_MASS_ROUNDED) -> Any:
    """`c_y` [N s/m] of a core whose speed falls by `exp(-pi zeta/sqrt(1 - zeta^2)) = speed_ratio`
    in a contact; arguments in SI are broadcast. Chapter V takes COR for that ratio, Chapter III and
    Appendix C `(M1/M)/COR`, Eq. (8) `COR M/M1`, which exceeds one.
    """
    decrement = -np.log(speed_ratio) / math.pi
    return 2.0 * decrement * np.sqrt(k_y * mass_ratio * mass / (1.0 + decrement**2))


def by_computation(
    values: Outputs,
    restitution: FloatArray,
    c_y: FloatArray | None = None,
) -> dict[str, FloatArray]:
    """Outputs (sets, 21) of Wang's impacts by the thesis's computation, at parameters (sets,) and
    the `restitution` (21,) of each impact, with `c_y` (sets, 21) [N s/m] or that of Chapter V.
    """
    sets = {name: value[:, np.newaxis] for name, value in values.items()}
    if c_y is None:
        c_y = damping(restitution, sets["mass_ratio"], sets["k_y"])
    wangs = states()
    rebound = computed(sets, wangs.v_x1, wangs.v_y1, wangs.omega_1, restitution, c_y)
    return _with_angle(rebound.v_x2, rebound.v_y2, rebound.omega_2)


def by_equations(
    values: Outputs,
    states: Impacts,
    restitution: FloatArray,
) -> dict[str, FloatArray]:
    """Outputs (sets, impacts) by the thesis's equations, solved exactly, at parameters (sets,) and
    the `restitution` (impacts,) of each impact; NaN where they have no answer.
    """
    choices = {**THESIS_EXACT, "inertia": "table"}
    exact = model("+".join(["two-mass", *(f"{key}={choices[key]}" for key in choices)]))
    # The law of restitution, which each impact's own replaces.
    law = {"cor_10": np.full_like(values["mu"], 0.75), "cor_slope": np.zeros_like(values["mu"])}
    columns = {**values, **law}
    sets = np.stack([*columns.values()], axis=1)
    rebound = exact.evaluate([*columns], sets, states, restitution)
    return _with_angle(rebound.v_x2, rebound.v_y2, rebound.omega_2)


def states() -> Impacts:
    """Wang's impacts as the thesis takes them."""
    return Impacts(column("v_x1"), column("v_y1"), wang()["incident"].to_numpy(np.float64))


def _with_angle(v_x2: FloatArray, v_y2: FloatArray, omega_2: FloatArray) -> dict[str, FloatArray]:
    return {"v_x2": v_x2, "theta_2": np.degrees(np.arctan2(v_y2, v_x2)), "omega_2": omega_2}


def as_printed(rows: DataFrame) -> dict[str, FloatArray]:
    """Outputs of Appendix C as printed, (7, 21), with the measured V_y2, because two tables carry
    each other's.
    """
    sets = rows.sort_values("case", kind="stable")
    v_x2 = sets[headed("v_x2")].to_numpy(np.float64).reshape(7, 21)
    omega_2 = sets[headed("omega_2")].to_numpy(np.float64).reshape(7, 21)
    return _with_angle(v_x2, np.broadcast_to(column("v_y2"), v_x2.shape), omega_2)


def causes(rows: DataFrame, name: str) -> list[str]:
    """For each row of Appendix C the cause that the errata state for the deviation of the column
    `name`, or an empty text.
    """
    texts = [""] * len(rows)
    errata = printed_table("errata")
    outputs = errata[(errata["kind"] != "input") & (errata["column"] == name)]
    for erratum in outputs[outputs["table"].str.startswith("C")].to_dict("records"):
        for k in np.flatnonzero(selects(rows, erratum["table"], erratum["row"])):
            texts[k] = f"{erratum['kind']}: {erratum['evidence']}"
    return texts


def judged_c() -> DataFrame:
    """Appendix C computed again, as `recomputed`, with a column `NAME_cause` of each velocity and
    spin that deviates: what the errata say, or `unlisted`.
    """
    rows = recomputed(appendix_c())
    for name in SCALES:
        half_digit = 100.0 * HALF_DIGIT / rows[headed(name)].abs()
        deviates = rows[f"{name}_error"].abs() > np.maximum(ROUNDING, half_digit)
        texts = [text or "unlisted" for text in causes(rows, name)]
        rows[f"{name}_cause"] = np.where(deviates, np.array(texts, dtype=object), "")
    return rows


def judged_d() -> DataFrame:
    """The 63 rows of Appendix D: printed errors, `NAME` recomputed from Appendix C and Wang's
    tables [%], angles with the mean restitution of Chapter V, and `NAME_matches`, whether the two
    agree in size.
    """
    printed_c = printed_table("appendix_c")
    rows = printed_table("appendix_d")
    groups = []
    for (_table, spin, case), group in rows.groupby(["table", "spin", "case"], sort=False):
        of_case = printed_c["case"] == SET_OF_CASE[int(str(case))]
        theory = printed_c[of_case & (printed_c["spin"] == spin)]
        of_spin = (wang()["group"] == spin).to_numpy()
        outputs = _with_angle(
            theory["v_x2 [m/s]"].to_numpy(np.float64),
            (mean_cor() * column("v_y1"))[of_spin],
            theory["omega_2 [rad/s]"].to_numpy(np.float64),
        )
        judged = group.copy()
        for name, output in outputs.items():
            judged[name] = 100.0 * (output / column(name)[of_spin] - 1.0)
            apart = (judged[name].abs() - judged[f"{name}_error [%]"].abs()).abs()
            judged[f"{name}_matches"] = apart <= MATCHES
        groups.append(judged)
    return pd.concat(groups, ignore_index=True)


def counts(rows_c: DataFrame, rows_d: DataFrame) -> DataFrame:
    """How many rows agree, by table and output, of `judged_c` and `judged_d`; those of Appendix D
    within 0.1 per cent points.
    """
    counted: list[dict[str, Any]] = []
    for name in ("v_x2 and omega_2", "v_x2", "v_y2", "omega_2", "theta_2", "contact_time"):
        errors = [rows_c[f"{output}_error"].abs() for output in name.split(" and ")]
        worst = np.max(errors, axis=0)
        row: dict[str, Any] = {"table": "Appendix C", "output": name, "rows": len(rows_c)}
        for limit in LIMITS:
            row[f"within {limit:g} %"] = int(np.sum(worst <= limit))
        counted.append(row)
    for name in OUTPUTS:
        row = {"table": "Appendix D", "output": name, "rows": len(rows_d)}
        row[f"within {MATCHES:g} points"] = int(rows_d[f"{name}_matches"].sum())
        counted.append(row)
    return pd.DataFrame(counted)


def misses(predicted: Outputs) -> dict[str, FloatArray]:
    """Predicted less measured outputs of Wang's impacts, each (sets, 21)."""
    return {name: predicted[name] - column(name) for name in OUTPUTS}


# Departures of the thesis from its own equations, in words, and where it has these.
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


def slips() -> DataFrame:
    """Each departure from the thesis's own equations: by how much the outputs of the 147 rows
    change without it (rms), and how many rows then still agree with print within 0.1 % in both
    velocity and spin.
    """
    rows = appendix_c()
    values = set_values(rows)
    c_y = rows["c_y [lb s/in]"].to_numpy(np.float64) * DAMPING
    heads = ("v_x1 [m/s]", "v_y1 [m/s]", "omega_1 [rad/s]", "cor")
    v_x1, v_y1, omega_1, restitution = (rows[head].to_numpy(np.float64) for head in heads)

    def without(*slip: str, c_y: FloatArray = c_y, **changes: FloatArray) -> Outputs:
        """Outputs by the computation without these slips, or with another value."""
        changed = {**values, **changes}
        rebound = computed(changed, v_x1, v_y1, omega_1, restitution, c_y, mended=slip)
        return {
            "v_x2": rebound.v_x2,
            "v_y2": rebound.v_y2,
            "omega_2": rebound.omega_2,
            "contact_time": rebound.contact_time,
        }

    base = without()
    printed_inputs = recomputed(printed_table("appendix_c"))
    ratio = values["mass_ratio"]
    damped = ratio * np.exp(-0.5 * c_y / (ratio * BALL_MASS) * base["contact_time"])
    inertia = values["inertia_ratio"] * (1.3 / 1.25) ** 2
    impacts = Impacts(v_x1[:, np.newaxis], v_y1[:, np.newaxis], omega_1[:, np.newaxis])
    solved = by_equations(values, impacts, restitution[:, np.newaxis])
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
    """Rms changes of outputs (147,) from the `base`, those that `outputs` lacks being as there, and
    how many rows then agree with print.
    """
    mended = {**base, **outputs}
    changes: dict[str, float] = {}
    for name in ("v_x2", "v_y2", "omega_2"):
        changes[headed(name)] = math.sqrt(np.nanmean((mended[name] - base[name]) ** 2))
    errors = {}
    for name in SCALES:
        errors[f"{name}_error"] = 100.0 * (mended[name] / rows[headed(name)] - 1.0)
    return {**changes, "rows within 0.1 %": within(rows.assign(**errors), LIMITS[0])}
