"""What the thesis prints of Wang's impacts, and the same computed again."""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from fitball.base.values import DataFrame, FloatArray, Impacts
from fitball.data.bundled import folder, printed
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
LIMITS = (0.1, 0.5, 1.0)
# What is judged, with its unit; scales that weigh velocity against spin in one score: the noise of
# such measurements.
OUTPUTS = {"v_x2": "m/s", "theta_2": "deg", "omega_2": "rad/s"}
SCALES = {"v_x2": 0.25, "omega_2": 10.0}
# Per cent within which a cell of Appendix C needs no cause; of an angle, which has V_y2 with it,
# and half of a last digit. Points that three printed digits on either side can make in Appendix D.
ROUNDING = 0.1
HALF_DIGIT = 5e-4
MATCHES = 0.1
Outputs = Mapping[str, FloatArray]


@cache
def wang() -> DataFrame:
    """Wang's 21 impacts as printed, zero spin, topspin, backspin; small spins are zero, as the
    thesis takes them.
    """
    table = pd.read_csv(folder() / "wang_all.csv")
    table["incident"] = table["omega_1 [rad/s]"].where(table["group"] != "zero", 0.0)
    return table


def headed(name: str) -> str:
    """How tables head a column."""
    return f"{name} [{OUTPUTS.get(name, 'm/s')}]"


def column(name: str) -> FloatArray:
    """A column of Wang's impacts, (21,)."""
    return wang()[headed(name)].to_numpy(np.float64)


def cor() -> FloatArray:
    """The measured restitution, (21,)."""
    return np.asarray(column("v_y2") / column("v_y1"))


def mean_cor() -> FloatArray:
    """That of Chapter V, (21,)."""
    return np.asarray(wang()["group"].map(MEAN_COR), dtype=np.float64)


def damping(left: Any, mass_ratio: Any, k_y: Any, mass: float = BALL_MASS_ROUNDED) -> Any:
    """`c_y` [N s/m] with `exp(-pi zeta/sqrt(1 - zeta^2)) = left`. Chapter V takes COR for it,
    Chapter III and Appendix C `(M1/M)/COR`, Eq. (8) `COR M/M1`, which exceeds one.
    """
    decrement = -np.log(left) / math.pi
    return 2.0 * decrement * np.sqrt(k_y * mass_ratio * mass / (1.0 + decrement**2))


def by_computation(
    values: Outputs,
    restitution: FloatArray,
    c_y: FloatArray | None = None,
) -> dict[str, FloatArray]:
    """Rebounds (sets, 21) of Wang's impacts by the thesis's computation; `c_y` (sets, 21) or that
    of Chapter V.
    """
    sets = {name: value[:, np.newaxis] for name, value in values.items()}
    c_y = damping(restitution, sets["mass_ratio"], sets["k_y"]) if c_y is None else c_y
    here = states()
    found = computed(sets, here.v_x1, here.v_y1, here.omega_1, restitution, c_y)
    return _with_angle(found.v_x2, found.v_y2, found.omega_2)


def by_equations(
    values: Outputs,
    states: Impacts,
    restitution: FloatArray,
) -> dict[str, FloatArray]:
    """The same (sets, impacts) by the thesis's equations, solved exactly; NaN where they have no
    answer.
    """
    choices = {**THESIS_EXACT, "inertia": "table"}
    exact = model(
        "+".join(["two-mass", *(f"{choice}={value}" for choice, value in choices.items())])
    )
    # The law of restitution, which each impact's own replaces.
    law = {"cor_10": np.full_like(values["mu"], 0.75), "cor_slope": np.zeros_like(values["mu"])}
    columns = {**values, **law}
    found = exact.evaluate([*columns], np.stack([*columns.values()], axis=1), states, restitution)
    return _with_angle(found.v_x2, found.v_y2, found.omega_2)


def states() -> Impacts:
    """Wang's impacts as the thesis takes them."""
    return Impacts(column("v_x1"), column("v_y1"), wang()["incident"].to_numpy(np.float64))


def _with_angle(v_x2: FloatArray, v_y2: FloatArray, omega_2: FloatArray) -> dict[str, FloatArray]:
    return {"v_x2": v_x2, "theta_2": np.degrees(np.arctan2(v_y2, v_x2)), "omega_2": omega_2}


def as_printed(rows: DataFrame) -> dict[str, FloatArray]:
    """Outputs of Appendix C, (7, 21), with the measured V_y2: two tables carry each other's."""
    sets = rows.sort_values("case", kind="stable")
    v_x2, omega_2 = (sets[headed(name)].to_numpy(np.float64).reshape(7, 21) for name in SCALES)
    return _with_angle(v_x2, np.broadcast_to(column("v_y2"), v_x2.shape), omega_2)


def causes(rows: DataFrame, name: str) -> list[str]:
    """For each row of Appendix C the cause that the errata give of the deviation of a column."""
    found = [""] * len(rows)
    for one in printed("errata").to_dict("records"):
        if one["kind"] != "input" and one["column"] == name and one["table"].startswith("C"):
            for k in np.flatnonzero(selects(rows, one["table"], one["row"])):
                found[k] = f"{one['kind']}: {one['evidence']}"
    return found


def judged_c() -> DataFrame:
    """Appendix C computed again, with the causes of deviations; `unlisted` is any without one."""
    rows = recomputed(appendix_c())
    for name in SCALES:
        off = rows[f"{name}_error"].abs() > np.maximum(
            ROUNDING,
            100.0 * HALF_DIGIT / rows[headed(name)].abs(),
        )
        listed = np.array(causes(rows, name), dtype=object)
        rows[f"{name}_cause"] = np.where(off, np.where(listed != "", listed, "unlisted"), "")
    return rows


def judged_d() -> DataFrame:
    """The 63 rows of Appendix D: printed errors, `NAME` recomputed from Appendix C and Wang's
    tables [%], angles with the mean restitution of Chapter V, and whether they match in size.
    """
    printed_c = printed("appendix_c")
    rows = printed("appendix_d")
    parts = []
    for (_table, spin, case), group in rows.groupby(["table", "spin", "case"], sort=False):
        mine = printed_c[
            (printed_c["spin"] == spin) & (printed_c["case"] == SET_OF_CASE[int(str(case))])
        ]
        here = (wang()["group"] == spin).to_numpy()
        v_x2 = mine["v_x2 [m/s]"].to_numpy(np.float64)
        theory = _with_angle(
            v_x2,
            (mean_cor() * column("v_y1"))[here],
            mine["omega_2 [rad/s]"].to_numpy(np.float64),
        )
        part = group.copy()
        for name, value in theory.items():
            part[name] = 100.0 * (value / column(name)[here] - 1.0)
            part[f"{name}_matches"] = (
                part[name].abs() - part[f"{name}_error [%]"].abs()
            ).abs() <= MATCHES
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def counts(rows_c: DataFrame, rows_d: DataFrame) -> DataFrame:
    """How many rows agree, by table and output; Appendix D within 0.1 points."""
    made: list[dict[str, Any]] = []
    for name in ("v_x2 and omega_2", "v_x2", "v_y2", "omega_2", "theta_2", "contact_time"):
        errors = np.max([rows_c[f"{one}_error"].abs() for one in name.split(" and ")], axis=0)
        found = {f"within {limit:g} %": int(np.sum(errors <= limit)) for limit in LIMITS}
        made.append({"table": "Appendix C", "output": name, "rows": len(rows_c)} | found)
    for name in OUTPUTS:
        found = {f"within {MATCHES:g} points": int(rows_d[f"{name}_matches"].sum())}
        made.append({"table": "Appendix D", "output": name, "rows": len(rows_d)} | found)
    return pd.DataFrame(made)


def misses(found: Outputs) -> dict[str, FloatArray]:
    """Predicted less measured, (sets, 21)."""
    return {name: found[name] - column(name) for name in OUTPUTS}


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
    v_x1, v_y1, omega_1, own = (rows[head].to_numpy(np.float64) for head in heads)

    def found(*mended: str, c_y: FloatArray = c_y, **changes: FloatArray) -> dict[str, FloatArray]:
        made = computed({**values, **changes}, v_x1, v_y1, omega_1, own, c_y, mended=mended)
        return {
            "v_x2": made.v_x2,
            "v_y2": made.v_y2,
            "omega_2": made.omega_2,
            "contact_time": made.contact_time,
        }

    base = found()
    printed_inputs = recomputed(printed("appendix_c"))
    ratio = values["mass_ratio"]
    left = ratio * np.exp(-0.5 * c_y / (ratio * BALL_MASS) * base["contact_time"])
    inertia = values["inertia_ratio"] * (1.3 / 1.25) ** 2
    solved = by_equations(
        values,
        Impacts(*(one[:, np.newaxis] for one in (v_x1, v_y1, omega_1))),
        own[:, np.newaxis],
    )
    outputs: Mapping[str, Mapping[str, Any]] = {
        "none": {},
        "torque": found("torque"),
        "sign": found("torque", "sign"),
        "cosine": found("cosine"),
        "restitution": {"v_y2": left * v_y1},
        "damping": found(c_y=damping(own, ratio, values["k_y"])),
        "radius": found(ball_radius=values["ball_radius"] * (1.25 / 1.3), inertia_ratio=inertia),
        "inputs": {name: printed_inputs[name] for name in SCALES},
        "all": {name: solved[name][:, 0] for name in SCALES},
    }
    return pd.DataFrame(
        [
            {"slip": slip, "where": where, **_change(rows, base, outputs[key])}
            for key, (slip, where) in _SLIPS.items()
        ]
    )


def _change(rows: DataFrame, base: Outputs, found: Mapping[str, Any]) -> dict[str, float]:
    """Of outputs that differ from the base: rms changes, and rows that agree with print."""
    new = {
        name: np.asarray(found.get(name, base[name]), dtype=np.float64)
        for name in ("v_x2", "v_y2", "omega_2")
    }
    moved = {name: math.sqrt(np.nanmean((value - base[name]) ** 2)) for name, value in new.items()}
    errors = {f"{name}_error": 100.0 * (new[name] / rows[headed(name)] - 1.0) for name in SCALES}
    return {headed(name): value for name, value in moved.items()} | {
        "rows within 0.1 %": within(rows.assign(**errors), LIMITS[0])
    }
