"""Appendix C of the thesis recomputed row by row from its printed inputs, and what does not come out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from fitball.data.thesis_tables import thesis_table
from fitball.inference.thesis.inputs import case_parameters, printed_model, relative_error
from fitball.values import FloatArray, impacts

COLUMNS = ("v_x2", "v_y2", "omega_2", "theta_2", "contact_time")
HEADS = {
    "v_x2": "v_x2 [m/s]",
    "v_y2": "v_y2 [m/s]",
    "omega_2": "omega_2 [rad/s]",
    "theta_2": "theta_2 [deg]",
    "contact_time": "contact_time [ms]",
}
LIMITS = (0.1, 0.5, 1.0)
# A row counts as reproduced within this, in per cent, and must be listed with its cause beyond it.
REPRODUCED = 0.1
INPUTS = {
    "cor": "cor",
    "v_y1": "v_y1 [m/s]",
    "k_y": "k_y [lb/in]",
    "i1_over_i": "i1_over_i",
}


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
            column = INPUTS[str(erratum.column)]
            corrected.loc[selects(rows, str(erratum.table), str(erratum.row)), column] = float(str(erratum.correct))
    return corrected


def recompute(rows: pd.DataFrame) -> pd.DataFrame:
    """`rows` with NAME and NAME_error [%] for every output, from the inputs in `rows`."""
    chosen = printed_model()
    columns: dict[str, list[float]] = {name: [] for name in COLUMNS}
    for row in rows.to_dict("records"):
        impact = impacts(row["v_x1 [m/s]"], row["v_y1 [m/s]"], row["omega_1 [rad/s]"], row["cor"])
        inputs = (row["mass_ratio"], row["k_y [lb/in]"], row["i1_over_i"], row["c_y [lb s/in]"])
        rebound = chosen.rebound(case_parameters(*inputs), impact)
        timing = chosen.rebound(case_parameters(*inputs, rounded_mass=True), impact)
        v_x2, v_y2 = float(rebound.v_x2[0]), float(rebound.v_y2[0])
        columns["v_x2"].append(v_x2)
        columns["v_y2"].append(-v_y2)
        columns["omega_2"].append(float(rebound.omega_2[0]))
        columns["theta_2"].append(-float(np.degrees(np.arctan2(v_y2, v_x2))))
        columns["contact_time"].append(1e3 * float(timing.contact_time[0]))
    result = rows.copy()
    for name in COLUMNS:
        result[name] = columns[name]
        result[f"{name}_error"] = relative_error(columns[name], rows[HEADS[name]])
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
            {
                "output": name,
                "rows": len(rows),
                **{f"within {limit} %": int(np.sum(error <= limit)) for limit in LIMITS},
            }
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
    unlisted, used = [], set()
    for k, row in enumerate(rows.to_dict("records")):
        for name in COLUMNS:
            if abs(row[f"{name}_error"]) <= _tolerance(name, abs(row[HEADS[name]])):
                continue
            entry = notes.get((k, name))
            place = {"table": row["table"], "case": row["case"], "column": name}
            values = {"printed": row[HEADS[name]], "recomputed": float(f"{row[name]:.5g}")}
            error = {"error [%]": round(row[f"{name}_error"], 3)}
            if entry is None:
                unlisted.append(f"{row['table']} case {row['case']}, {name}: printed and recomputed {values}")
                cause = {"kind": "unlisted", "cause": ""}
            else:
                used.add(entry)
                cause = {"kind": entries[entry]["kind"], "cause": entries[entry]["evidence"]}
            exceptions.append({**place, **values, **error, **cause})
    stale = tuple(
        f"{entries[k]['table']} row {entries[k]['row']}, {entries[k]['column']}" for k in set(notes.values()) - used
    )
    return AppendixC(rows, pd.DataFrame(exceptions), tuple(unlisted), tuple(sorted(stale)))


def mended(appendix: AppendixC) -> pd.DataFrame:
    """The rows with every printed `v_x2` and `omega_2` whose misprint or other input is known set to the recomputed
    value; unexplained ones stand as printed.
    """
    rows, known = appendix.rows.copy(), appendix.exceptions["kind"].isin(("misprint", "other input"))
    for item in appendix.exceptions[known & appendix.exceptions["column"].isin(("v_x2", "omega_2"))].itertuples():
        chosen = (rows["table"] == item.table) & (rows["case"] == item.case)
        rows.loc[chosen, HEADS[str(item.column)]] = rows.loc[chosen, str(item.column)]
    return rows


def _tolerance(name: str, printed: float) -> float:
    """Per cent beyond which a cell needs a cause: `REPRODUCED`, or what rounding of print allows if that is more."""
    last_digit = {"v_x2": 0.0005, "v_y2": 0.005, "omega_2": 0.0005, "theta_2": 0.0005, "contact_time": 0.0005}[name]
    inputs = 0.15 if name in ("v_y2", "theta_2") else REPRODUCED
    return float(max(inputs, 100.0 * last_digit / printed))


def selects(rows: pd.DataFrame, table: str, case: str) -> FloatArray:
    """Which rows an erratum means; `table` and `case` may be `*` behind a letter or alone, or list cases as `1 2`."""
    tables = rows["table"].str.startswith(table.rstrip("*")) if table.endswith("*") else rows["table"] == table
    cases = np.full(len(rows), True) if case == "*" else rows["case"].astype(str).isin(case.split()).to_numpy()
    return np.asarray(tables.to_numpy() & cases)
