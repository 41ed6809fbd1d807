"""Which of three formulas each printed `c_y` obeys, and why Eq. (8) as printed cannot hold."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from fitball.data.published import SPINS, fraction, measured, thesis_table
from fitball.inference.thesis.inputs import BALL_MASS_ROUNDED, DAMPING, STIFFNESS

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
