"""Appendix C of the thesis recomputed row by row from its printed inputs, and what does not come out."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pandas as pd

from fitball.data.published import thesis_table
from fitball.inference.thesis.published_cases import printed_model, relative_error, row_parameters
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
INPUTS = {"cor": "cor", "v_y1": "v_y1 [m/s]", "k_y": "k_y [lb/in]", "i1_over_i": "i1_over_i"}


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
