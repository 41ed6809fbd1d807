"""Appendix D: percentage errors of three cases, recomputed from the printed Appendix C and Wang's tables.

Velocity and spin are those of Appendix C; the angles follow its `V_x2` with the mean restitution of Chapter V.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from fitball.data.published import measured, thesis_table
from fitball.values import FloatArray

# Chapter V's cases 1 to 3 are cases 5, 6 and 1 of Appendix C.
CASE_IN_APPENDIX_C: Mapping[int, int] = {1: 5, 2: 6, 3: 1}
MEAN_RESTITUTION: Mapping[str, float] = {"zero": 0.765, "topspin": 0.778, "backspin": 0.732}
COLUMNS = ("v_x2", "theta_2", "omega_2")
HEADS = {name: f"{name}_error [%]" for name in COLUMNS}
# Percentage points that the rounding of three printed digits on either side can make.
MATCHES = 0.1


def percentage_errors(spin: str, rows: pd.DataFrame) -> dict[str, FloatArray]:
    """`100 (theory - experiment)/experiment`, (impacts,), for rows of Appendix C; angles unsigned."""
    wang = measured(spin)
    v_x2 = rows["v_x2 [m/s]"].to_numpy()
    theory = {
        "v_x2": v_x2,
        "theta_2": np.degrees(np.arctan2(MEAN_RESTITUTION[spin] * wang["v_y1"], v_x2)),
        "omega_2": rows["omega_2 [rad/s]"].to_numpy(),
    }
    return {name: 100.0 * (values / wang[name] - 1.0) for name, values in theory.items()}


def matches(errors: FloatArray | pd.Series, printed: pd.Series) -> FloatArray:
    """Which errors match print in size."""
    return np.asarray(np.abs(np.abs(errors) - np.abs(printed)) <= MATCHES)


def recompute() -> pd.DataFrame:
    """The 63 rows with NAME (recomputed, %) beside NAME_error (printed, %), and which of them match in size."""
    printed, theory = thesis_table("appendix_d"), thesis_table("appendix_c")
    parts = []
    for (_table, spin, case), group in printed.groupby(["table", "spin", "case"], sort=False):
        rows = theory[(theory.spin == spin) & (theory.case == CASE_IN_APPENDIX_C[int(str(case))])]
        part = group.copy()
        for name, error in percentage_errors(str(spin), rows).items():
            part[name] = error
            part[f"{name}_matches"] = matches(error, part[HEADS[name]])
        # With the angle that Appendix C prints.
        part["theta_2_printed"] = 100.0 * (-rows["theta_2 [deg]"].to_numpy() / measured(str(spin))["theta_2"] - 1.0)
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def deviations(rows: pd.DataFrame) -> pd.DataFrame:
    """Every entry that does not match in size, with its cause from the errata; `kind` is `unlisted` without one."""
    errata = thesis_table("errata")
    listed = {
        (erratum["table"], erratum["row"], erratum["column"]): (erratum["kind"], erratum["evidence"])
        for erratum in errata.to_dict("records")
    }
    rows_found = []
    for row in rows.to_dict("records"):
        for name in COLUMNS:
            if not row[f"{name}_matches"]:
                place = (row["table"], f"{row['theta_1 [deg]']:g}", name)
                kind, cause = listed.get(place, ("unlisted", ""))
                rows_found.append(
                    {"table": row["table"], "theta_1 [deg]": row["theta_1 [deg]"], "column": name,
                     "printed [%]": row[HEADS[name]], "recomputed [%]": round(row[name], 3),
                     "kind": kind, "cause": cause}
                )  # fmt: skip
    return pd.DataFrame(rows_found)
