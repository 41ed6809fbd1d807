"""Appendices B to D of the thesis, recomputed from what they print.

C row by row from its printed inputs, by model `thesis`, and what does not come out; D, the percentage errors of three
cases, from the printed Appendix C and Wang's tables, its angles with the mean restitution of Chapter V. B as four
worksheets run apart from each other, in the units of the thesis: velocity while sliding, spin while sliding,
transition and rolling, into which every input was typed anew, so that one could hold another's value; model `thesis`
is the case where all hold the same.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from fitball.data.published import fraction, measured, thesis_table
from fitball.inference.thesis import published_cases as thesis_inputs
from fitball.inference.thesis.published_cases import (
    DAMPING,
    INCH,
    INERTIA,
    STIFFNESS,
    printed_model,
    relative_error,
    row_parameters,
)
from fitball.models.thesis import Pair, ThesisContact, ThesisMotion, stray_impulse, thesis_motion
from fitball.models.types import Status
from fitball.values import FloatArray, impacts

HEADS = {
    "v_x2": "v_x2 [m/s]",
    "v_y2": "v_y2 [m/s]",
    "omega_2": "omega_2 [rad/s]",
    "theta_2": "theta_2 [deg]",
    "contact_time": "contact_time [ms]",
}
COLUMNS = tuple(HEADS)
# Half of the last printed digit of each.
HALF_DIGIT = {"v_x2": 0.0005, "v_y2": 0.005, "omega_2": 0.0005, "theta_2": 0.0005, "contact_time": 0.0005}
LIMITS = (0.1, 0.5, 1.0)
# A row counts as reproduced within this, in per cent, and must be listed with its cause beyond it.
REPRODUCED = 0.1
# Inputs that are misprinted somewhere.
MENDED = {"cor": "cor", "v_y1": "v_y1 [m/s]", "k_y": "k_y [lb/in]", "i1_over_i": "i1_over_i"}


@dataclass(frozen=True)
class AppendixC:
    """`rows`: one a printed row, with columns NAME (recomputed) and NAME_error [%] beside the printed ones.

    `exceptions` are the cells beyond `REPRODUCED`, each with its cause from the table of errata; `unlisted` those
    without one, and `stale` the errata that no longer stand for a deviation.
    """

    rows: pd.DataFrame
    exceptions: pd.DataFrame
    unlisted: tuple[str, ...]
    stale: tuple[str, ...]


def with_corrected_inputs(rows: pd.DataFrame, errata: pd.DataFrame) -> pd.DataFrame:
    """The printed rows with the inputs that the errata correct; outputs are never touched."""
    corrected = rows.copy()
    for erratum in errata.itertuples():
        if erratum.kind == "input" and str(erratum.table).startswith("C"):
            column = MENDED[str(erratum.column)]
            corrected.loc[selects(rows, str(erratum.table), str(erratum.row)), column] = float(str(erratum.correct))
    return corrected


def recompute(rows: pd.DataFrame) -> pd.DataFrame:
    """`rows` with NAME and NAME_error [%] for every output, from the inputs in `rows`."""
    chosen, outputs = printed_model(), []
    for row in rows.to_dict("records"):
        impact = impacts(row["v_x1 [m/s]"], row["v_y1 [m/s]"], row["omega_1 [rad/s]"], row["cor"])
        rebound = chosen.rebound(row_parameters(row), impact)
        timing = chosen.rebound(row_parameters(row, rounded_mass=True), impact)
        v_x2, v_y2 = float(rebound.v_x2[0]), float(rebound.v_y2[0])
        angle, time = -float(np.degrees(np.arctan2(v_y2, v_x2))), 1e3 * float(timing.contact_time[0])
        outputs.append((v_x2, -v_y2, float(rebound.omega_2[0]), angle, time))
    result = rows.copy()
    for name, column in zip(COLUMNS, zip(*outputs, strict=True), strict=True):
        result[name] = column
        result[f"{name}_error"] = relative_error(column, rows[HEADS[name]])
    return result


def worst_error(rows: pd.DataFrame) -> FloatArray:
    """The larger of the deviations of `v_x2` and `omega_2` [%], (rows,)."""
    return np.asarray(np.maximum(rows.v_x2_error.abs(), rows.omega_2_error.abs()), dtype=np.float64)


def shares(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows within each limit, by output, and for `v_x2` and `omega_2` together."""
    errors = {"v_x2 and omega_2": worst_error(rows)}
    errors |= {name: rows[f"{name}_error"].abs().to_numpy() for name in COLUMNS}
    return pd.DataFrame(
        [
            {"output": name, "rows": len(rows)} | {f"within {most} %": int(np.sum(error <= most)) for most in LIMITS}
            for name, error in errors.items()
        ]
    )


def shares_by_case(rows: pd.DataFrame) -> pd.DataFrame:
    """`shares` for each of the seven sets."""
    parts = []
    for case, group in rows.groupby("case"):
        part = shares(group)
        part.insert(0, "set", f"{case}: {group['mass_ratio'].iloc[0]}, {group['k_y [lb/in]'].mode().iloc[0]} lb/in")
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def reproduce() -> AppendixC:
    """Appendix C recomputed, with every deviation looked up in the errata."""
    printed, errata = thesis_table("appendix_c"), thesis_table("errata")
    rows = recompute(with_corrected_inputs(printed, errata))
    entries = errata.to_dict("records")
    notes = {
        (int(k), str(item["column"])): index
        for index, item in enumerate(entries)
        if item["kind"] != "input" and item["column"] in COLUMNS
        for k in np.flatnonzero(selects(rows, str(item["table"]), str(item["row"])))
    }
    exceptions: list[dict[str, object]] = []
    unlisted, unused = [], set(notes.values())
    for (k, row), name in itertools.product(enumerate(rows.to_dict("records")), COLUMNS):
        # Or what the rounding of print allows, if that is more.
        rounding = 100.0 * HALF_DIGIT[name] / abs(row[HEADS[name]])
        if abs(row[f"{name}_error"]) <= max(0.15 if name in ("v_y2", "theta_2") else REPRODUCED, rounding):
            continue
        values = {"printed": row[HEADS[name]], "recomputed": float(f"{row[name]:.5g}")}
        entry, cause = notes.get((k, name)), {"kind": "unlisted", "cause": ""}
        if entry is None:
            unlisted.append(f"{row['table']} case {row['case']}, {name}: printed and recomputed {values}")
        else:
            unused.discard(entry)
            cause = {"kind": entries[entry]["kind"], "cause": entries[entry]["evidence"]}
        place = {"table": row["table"], "case": row["case"], "column": name}
        exceptions.append({**place, **values, "error [%]": round(row[f"{name}_error"], 3), **cause})
    stale = sorted(
        f"{item['table']} row {item['row']}, {item['column']}" for item in map(entries.__getitem__, unused)
    )
    return AppendixC(rows, pd.DataFrame(exceptions), tuple(unlisted), tuple(stale))


def mended(appendix: AppendixC) -> pd.DataFrame:
    """The rows with every printed `v_x2` and `omega_2` whose misprint or other input is known set to the recomputed
    value; unexplained ones stand as printed.
    """
    rows, known = appendix.rows.copy(), appendix.exceptions["kind"].isin(("misprint", "other input"))
    for item in appendix.exceptions[known & appendix.exceptions["column"].isin(("v_x2", "omega_2"))].itertuples():
        chosen = (rows["table"] == item.table) & (rows["case"] == item.case)
        rows.loc[chosen, HEADS[str(item.column)]] = rows.loc[chosen, str(item.column)]
    return rows


def selects(rows: pd.DataFrame, table: str, case: str) -> FloatArray:
    """Which rows an erratum means; `table` and `case` may be `*` behind a letter or alone, or list cases as `1 2`."""
    tables = rows["table"].str.startswith(table.rstrip("*")) if table.endswith("*") else rows["table"] == table
    cases = np.full(len(rows), True) if case == "*" else rows["case"].astype(str).isin(case.split()).to_numpy()
    return np.asarray(tables.to_numpy() & cases)


# Chapter V's cases 1 to 3 are cases 5, 6 and 1 of Appendix C.
CASE_IN_APPENDIX_C: Mapping[int, int] = {1: 5, 2: 6, 3: 1}
MEAN_RESTITUTION: Mapping[str, float] = {"zero": 0.765, "topspin": 0.778, "backspin": 0.732}
ERRORS = ("v_x2", "theta_2", "omega_2")
ERROR_HEADS = {name: f"{name}_error [%]" for name in ERRORS}
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


def recompute_errors() -> pd.DataFrame:
    """The 63 rows with NAME (recomputed, %) beside NAME_error (printed, %), and which of them match in size."""
    printed, theory = thesis_table("appendix_d"), thesis_table("appendix_c")
    parts = []
    for (_table, spin, case), group in printed.groupby(["table", "spin", "case"], sort=False):
        rows = theory[(theory.spin == spin) & (theory.case == CASE_IN_APPENDIX_C[int(str(case))])]
        part = group.copy()
        for name, error in percentage_errors(str(spin), rows).items():
            part[name] = error
            part[f"{name}_matches"] = matches(error, part[ERROR_HEADS[name]])
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
        for name in ERRORS:
            if not row[f"{name}_matches"]:
                place = (row["table"], f"{row['theta_1 [deg]']:g}", name)
                kind, cause = listed.get(place, ("unlisted", ""))
                rows_found.append(
                    {"table": row["table"], "theta_1 [deg]": row["theta_1 [deg]"], "column": name,
                     "printed [%]": row[ERROR_HEADS[name]], "recomputed [%]": round(row[name], 3),
                     "kind": kind, "cause": cause}
                )  # fmt: skip
    return pd.DataFrame(rows_found)


Inputs = Mapping[str, float]
# A row of the printed table, by its heads.
Row = Mapping[Any, Any]
# The programs, the search for the transition, and the rebound angle, which was worked out after them.
PROGRAMS = ("velocity", "spin", "rolling")
CODES = ("velocity", "spin", "transition", "rolling", "angle")
INPUTS = (
    *("v_x1", "v_y1", "offset_v_y1", "omega_1", "cor", "mass_ratio"),
    *("k_y", "c_y", "i1_over_i", "i2_over_i", "inertia", "radius"),
)
# Steps of `n := 0, 0.001 .. 1`, between which the transition is sought.
STEPS = np.linspace(0.0, 1.0, 1001)


def row_inputs(row: Row) -> dict[str, float]:
    """Inputs of a row of Appendix C by name, SI for velocities and spin, else inch, pound and second.

    `offset_v_y1` is the vertical velocity put into Eq. (53), which was worked out apart.
    """
    heads = ("v_x1 [m/s]", "v_y1 [m/s]", "v_y1 [m/s]", "omega_1 [rad/s]", "cor")
    incident = [float(row[name]) for name in heads]
    k_y, c_y, i1 = (float(row[name]) for name in ("k_y [lb/in]", "c_y [lb s/in]", "i1_over_i"))
    inertia, radius = thesis_inputs.INERTIA_OF[row["mass_ratio"]], thesis_inputs.BALL_RADIUS / INCH
    ball = (fraction(row["mass_ratio"]), k_y, c_y, i1, 1.0 - i1, inertia, radius)
    return dict(zip(INPUTS, (*incident, *ball), strict=True))


@dataclass(frozen=True)
class Clause:
    """`inputs` used in the worksheets `codes` instead of the row's own."""

    codes: tuple[str, ...]
    inputs: Inputs


def filled_in(own: Inputs, clauses: Iterable[Clause]) -> dict[str, Inputs]:
    """Inputs of every worksheet: `own` but for the clauses, of which a later one goes before an earlier one."""
    made = dict.fromkeys(CODES, own)
    for clause in clauses:
        changed: dict[int, Inputs] = {}
        for code in clause.codes:
            made[code] = changed.setdefault(id(made[code]), {**made[code], **clause.inputs})
    return made


def program(inputs: Inputs, ball_mass: float | None = None) -> ThesisMotion[float] | None:
    """A worksheet filled in, or None where its formulas have no solution."""
    mass = thesis_inputs.BALL_MASS if ball_mass is None else ball_mass
    core_mass = inputs["mass_ratio"] * mass
    sigma = 0.5 * inputs["c_y"] * DAMPING / core_mass
    if not sigma**2 < inputs["k_y"] * STIFFNESS / core_mass:
        return None
    moment = inputs["inertia"] * INERTIA
    contact = ThesisContact(
        mass=mass,
        radius=inputs["radius"] * INCH,
        inertia_core=inputs["i1_over_i"] * moment,
        inertia_shell=inputs["i2_over_i"] * moment,
        core_mass=core_mass,
        k_y=inputs["k_y"] * STIFFNESS,
        sigma=sigma,
        k_theta=thesis_inputs.K_THETA,
        mu=thesis_inputs.FRICTION,
        eps=(thesis_inputs.C1 * inputs["offset_v_y1"] + thesis_inputs.C2) * INCH,
        v_x=inputs["v_x1"],
        v_y=inputs["v_y1"],
        omega=inputs["omega_1"],
    )
    motion = thesis_motion(contact)
    return motion if motion.status == int(Status.OK) else None


def swing(motion: ThesisMotion[float], n: Any) -> Any:
    """`e^{zt}` at the dimensionless time `n = t/t_c`."""
    return np.exp(complex(*motion.z) * n * math.pi / motion.z.im)


def outputs(codes: Mapping[str, Inputs]) -> dict[str, float]:
    """Columns of Appendix C from the inputs of each of `CODES`; NaN where a worksheet has no solution.

    `v_y2` and `contact_time` [ms] are those of the worksheet for velocity.
    """
    first, last = codes["velocity"], codes["angle"]
    sheets = {id(codes[name]): codes[name] for name in PROGRAMS}
    solved = {key: program(inputs) for key, inputs in sheets.items()}
    velocity, spin, rolling = (solved[id(codes[name])] for name in PROGRAMS)
    # The printed contact times follow the rounded mass; see `thesis_inputs`.
    timing = program(first, thesis_inputs.BALL_MASS_ROUNDED)
    if velocity is None or spin is None or rolling is None or timing is None:
        return dict.fromkeys(COLUMNS, math.nan)
    v_x2, omega_2 = _tangential(codes, velocity, spin, rolling)
    angle = -math.degrees(math.atan2(last["cor"] * last["v_y1"], v_x2))
    return dict(zip(COLUMNS, (v_x2, -first["cor"] * first["v_y1"], omega_2, angle, 1e3 * timing.t_c), strict=True))


def _tangential(
    codes: Mapping[str, Inputs],
    velocity: ThesisMotion[float],
    spin: ThesisMotion[float],
    rolling: ThesisMotion[float],
) -> tuple[float, float]:
    """`v_x2` [m/s] and `omega_2` [rad/s]; the search for the transition has a radius of its own."""
    first, radius = codes["velocity"], codes["transition"]["radius"] * INCH

    def sliding(n: Any) -> tuple[Any, Any]:
        v_x = first["v_x1"] - (complex(*velocity.friction) * (swing(velocity, n) - 1.0)).real
        return v_x, codes["spin"]["omega_1"] + (complex(*spin.slide) * (swing(spin, n) - 1.0)).real

    def slip(n: Any) -> Any:
        v_x, omega = sliding(n)
        return velocity.sign * (v_x - radius * omega)

    gripped = np.flatnonzero(slip(STEPS) <= 0.0)
    if gripped.size == 0:
        v_x, omega = map(float, sliding(1.0))
        core_mass, end = first["mass_ratio"] * thesis_inputs.BALL_MASS, complex(swing(velocity, 1.0))
        stray = stray_impulse(core_mass, first["v_y1"], velocity.z, Pair(end.real, end.imag))
        return v_x - velocity.sign * thesis_inputs.FRICTION / thesis_inputs.BALL_MASS * stray, omega
    if gripped[0] == 0:
        return math.nan, math.nan
    n = float(brentq(slip, STEPS[gripped[0] - 1], STEPS[gripped[0]], xtol=1e-14))
    omega = float(sliding(n)[1] + (complex(*rolling.roll) * (swing(rolling, 1.0) - swing(rolling, n))).real)
    return codes["rolling"]["radius"] * INCH * omega, omega
