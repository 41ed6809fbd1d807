"""Cells of Appendices C and D that another, named input explains, each computed anew with that input.

A slip of the errata reads `codes: name=value ...; codes: ...`: what stood in which worksheets of Appendix B instead
of the row's own input, `all:` alone that nothing did. It says how a printed number came about; no table, no ranking
and no claim is mended by it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from fitball.data.published import fraction, thesis_table
from fitball.errors import Fault, TableError
from fitball.thesis import appendix_c, appendix_d
from fitball.thesis.appendix_b import CODES, INPUTS, Clause, filled_in, outputs, row_inputs
from fitball.thesis.check import Check
from fitball.thesis.slip_candidates import SOURCES, by_chance, candidates

# A residual is stated with three decimals.
STATED = 6e-4
# Beyond so many chance fits among its candidates a slip explains nothing.
BY_CHANCE = 0.1
TANGENTIAL = ("v_x2", "omega_2")


def parse(text: str, place: str) -> tuple[Clause, ...]:
    """The clauses of a slip. Raises TableError, naming `place`, for a worksheet or an input that is none."""
    clauses = []
    for part in filter(str.strip, text.split(";")):
        head, colon, body = part.partition(":")
        codes = CODES if head.strip() == "all" else tuple(head.split())
        if not colon or not set(codes) <= set(CODES):
            known = ", ".join(("all", *CODES))
            raise TableError(place, [Fault(f"'{part.strip()}' names no worksheet of Appendix B (known: {known})")])
        inputs: dict[str, float] = {}
        for name, _equals, value in (item.partition("=") for item in body.split()):
            if name not in INPUTS:
                raise TableError(place, [Fault(f"{name}: no input of Appendix B (known: {', '.join(INPUTS)})")])
            try:
                inputs[name] = fraction(value)
            except (ValueError, ZeroDivisionError):
                raise TableError(place, [Fault(f"{name}: '{value}' is no number")]) from None
        if inputs:
            clauses.append(Clause(codes, inputs))
    return tuple(clauses)


def recomputed() -> pd.DataFrame:
    """One row per cell with a slip: place, slip, printed and recomputed value, `residual` and the `stated` one (per
    cent in Appendix C, percentage points in D), and the `source` of the slip, empty if it is on no list. Velocities
    and spins of C have the number of `candidates` and how many are `expected by chance` to come as near.
    """
    errata = thesis_table("errata")
    rows = appendix_c.with_corrected_inputs(thesis_table("appendix_c"), errata)
    found: list[dict[str, object]] = []
    uncounted = {"candidates": 0, "expected by chance": math.nan}
    listed = errata[errata["slip"] != ""]
    for (table, case, slip), lines in listed.groupby(["table", "row", "slip"], sort=False):
        clauses = parse(str(slip), f"errata, {table} {case}")
        cells = _cells_of_d if str(table).startswith("D") else _cells_of_c
        stated = dict(zip(lines["column"], lines["residual"].astype(float), strict=True))
        found += [
            {"table": table, "slip": slip, **uncounted, **cell, "stated": stated[str(cell["column"])]}
            for cell in cells(str(table), str(case), clauses, tuple(stated), rows)
        ]
    return pd.DataFrame(found)


def _cells_of_c(
    table: str, case: str, clauses: Sequence[Clause], columns: Sequence[str], rows: pd.DataFrame
) -> Iterator[dict[str, object]]:
    claimed = [name for name in columns if name in TANGENTIAL]
    for row in rows[appendix_c.selects(rows, table, case)].to_dict("records"):
        values = outputs(filled_in(row_inputs(row), clauses))
        lists = candidates(row, rows, clauses)
        chance = by_chance(row, lists, claimed) if claimed and lists else None
        for name in columns:
            printed = float(row[appendix_c.HEADS[name]])
            cell = {
                "row": str(row["case"]),
                "column": name,
                "printed": printed,
                "recomputed": values[name],
                "residual": abs(100.0 * (values[name] / printed - 1.0)),
                "source": ", ".join(dict.fromkeys(lists.names)) if lists else "",
            }
            if chance and name in claimed:
                cell |= {"candidates": chance.candidates, "expected by chance": chance.expected}
            yield cell


def _cells_of_d(
    table: str, angle: str, clauses: Sequence[Clause], columns: Sequence[str], rows: pd.DataFrame
) -> Iterator[dict[str, object]]:
    """The errors of one impact in Appendix D from what its row of Appendix C should have been with the slip."""
    printed = thesis_table("appendix_d")
    line = printed[(printed["table"] == table) & (printed["theta_1 [deg]"] == float(angle))].iloc[0]
    mine = (rows["spin"] == line["spin"]) & (rows["case"] == appendix_d.CASE_IN_APPENDIX_C[int(line["case"])])
    theory = rows[mine].reset_index(drop=True)
    place = int(theory.index[theory["theta_1 [deg]"] == float(angle)][0])
    row = theory.loc[place].to_dict()
    values = outputs(filled_in(row_inputs(row), clauses))
    for name in TANGENTIAL:
        theory.loc[place, appendix_c.HEADS[name]] = values[name]
    errors = appendix_d.percentage_errors(str(line["spin"]), theory)
    lists = candidates(row, rows, clauses)
    source = "" if lists is None else ", ".join(dict.fromkeys(lists.names)) or "own inputs"
    for name in columns:
        error, was = float(errors[name][place]), float(line[appendix_d.HEADS[name]])
        # Appendix D drops the sign of its angles.
        residual = abs(abs(error) - abs(was))
        yield {"row": angle, "column": name, "printed": was, "recomputed": error, "residual": residual,
               "source": source}  # fmt: skip


def chances(cells: pd.DataFrame) -> pd.Series:
    """Fits expected by chance for every slip, (slips,) by its last clause.

    Where one clause explains rows of several tables each of them had its own chance; cells of one table, or the two
    outputs of one row, have not.
    """
    counted = cells[cells["expected by chance"].notna()]
    by_cell = {}
    for name, group in counted.groupby(counted["slip"].str.split(";").str[-1].str.strip(), sort=False):
        worst = group.groupby("table")[["candidates", "expected by chance"]].max()
        single = worst["expected by chance"] / worst["candidates"]
        by_cell[str(name)] = float(worst["candidates"].max() * single.prod())
    return pd.Series(by_cell, dtype=float)


def faults(cells: pd.DataFrame) -> list[str]:
    """What is wrong with the slips of the errata, in words; empty if every one does what it says."""
    complaints = []
    for (table, slip, column), group in cells.groupby(["table", "slip", "column"], sort=False):
        worst, stated = float(group["residual"].max()), float(group["stated"].iloc[0])
        where = f"{table} row {' '.join(group['row'])}, {column} with '{slip}'"
        if not abs(worst - stated) <= STATED:
            complaints.append(f"{where}: residual {worst:.4f}, stated {stated:g}")
        if (group["source"] == "").any():
            complaints.append(f"{where}: an input that stands on no list of candidates")
    chance = chances(cells)
    return complaints + [f"{name}: {value:.2f} fits by chance" for name, value in chance.items() if value > BY_CHANCE]


def unexplained() -> list[str]:
    """Rows of Appendix C, as `C1-5`, whose velocity or spin no input on any list explains alone."""
    errata = thesis_table("errata")
    lines = errata[(errata["kind"] == "unexplained") & errata["column"].isin(TANGENTIAL)]
    lines = lines[lines["table"].str.startswith("C")]
    named = [f"{item.table}-{case}" for item in lines.itertuples() for case in str(item.row).split()]
    return list(dict.fromkeys(named))


def check(cells: pd.DataFrame) -> Check:
    """Whether every slip of the errata, `recomputed`, does what it says."""
    problems, rest = faults(cells), unexplained()
    in_c = cells["table"].str.startswith("C")
    counted = cells[cells["expected by chance"].notna()]
    worst_c, worst_d = counted["residual"].max(), cells[~in_c]["residual"].max()
    few, many = counted["candidates"].min(), counted["candidates"].max()
    finding = (
        f"{len(counted)} velocities and spins of Appendix C come out within {worst_c:.3f} % with named inputs that "
        f"were left over or mistyped, {int(np.sum(~in_c))} errors of Appendix D within {worst_d:.3f} points. They "
        f"mend no claim of the thesis. The inputs stand on lists of {few:.0f} to {many:.0f} candidates, of which "
        f"{chances(cells).sum():.2f} in all would come as near by chance, {len(SOURCES)} lists having been tried in "
        f"every group of worksheets. {len(rest)} rows stay unexplained: {', '.join(rest)}."
    )
    return Check("Slips of Appendices C and D", " ".join([finding, *problems]), not problems)
