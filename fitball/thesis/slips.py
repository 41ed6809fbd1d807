"""Cells of Appendices C and D that another, named input explains, each computed anew with that input.

A slip of the errata reads `codes: name=value ...; codes: ...`: the value in those worksheets of Appendix B instead
of the row's own input, `all:` alone that nothing did. It says how a printed number came about; no table, no ranking
and no claim is mended by it.

Possible sources of a wrong input are short lists, made in advance, each with the number of its entries that fit by
chance. No list holds a continuous range, so that nothing can be tuned; a slip whose input is on no list is refused.
Every list was tried in each worksheet of Appendix B, in both for sliding, in both that follow and in all. A row that
two candidates fit equally well stays unexplained, with both of them named.

Last, how large the slips of the computation itself are on Wang's impacts, set by set.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from fitball.data.published import SPINS, fraction, measured, thesis_table
from fitball.errors import Fault, TableError
from fitball.inference.prediction.outputs import root_mean_square
from fitball.inference.thesis.published_cases import (
    BALL_RADIUS,
    INCH,
    INERTIA,
    INERTIA_OF,
    printed_model,
    row_parameters,
)
from fitball.report.form.numbers import digits, listed
from fitball.thesis import appendices
from fitball.thesis.appendices import (
    CODES,
    HEADS,
    INPUTS,
    MEAN_RESTITUTION,
    Clause,
    Inputs,
    Row,
    filled_in,
    outputs,
    row_inputs,
)
from fitball.thesis.judgement import EXACT, RECOMPUTED, UNITS, Ranking
from fitball.thesis.printed_tables import Check
from fitball.values import impacts

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
    rows = appendices.with_corrected_inputs(thesis_table("appendix_c"), errata)
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
    for row in rows[appendices.selects(rows, table, case)].to_dict("records"):
        values = outputs(filled_in(row_inputs(row), clauses))
        lists = candidates(row, rows, clauses)
        chance = by_chance(row, lists, claimed) if claimed and lists else None
        for name in columns:
            printed = float(row[HEADS[name]])
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
    mine = (rows["spin"] == line["spin"]) & (rows["case"] == appendices.CASE_IN_APPENDIX_C[int(line["case"])])
    theory = rows[mine].reset_index(drop=True)
    place = int(theory.index[theory["theta_1 [deg]"] == float(angle)][0])
    row = theory.loc[place].to_dict()
    values = outputs(filled_in(row_inputs(row), clauses))
    for name in TANGENTIAL:
        theory.loc[place, HEADS[name]] = values[name]
    errors = appendices.percentage_errors(str(line["spin"]), theory)
    lists = candidates(row, rows, clauses)
    source = "" if lists is None else ", ".join(dict.fromkeys(lists.names)) or "own inputs"
    for name in columns:
        error, was = float(errors[name][place]), float(line[appendices.ERROR_HEADS[name]])
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
            complaints.append(f"{where}: an input that is on no list of candidates")
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
        f"{len(counted)} velocities and spins of Appendix C agree within {worst_c:.3f} % with inputs that were left "
        f"over or mistyped. {int(np.sum(~in_c))} errors of Appendix D agree within {worst_d:.3f} points. No claim of "
        f"the thesis changes. The inputs are from lists of {few:.0f} to {many:.0f} candidates. By chance "
        f"{chances(cells).sum():.2f} of them would agree as well, with {len(SOURCES)} lists tried in every group of "
        f"worksheets. {len(rest)} rows stay unexplained: {', '.join(rest)}."
    )
    return Check("Slips of Appendices C and D", " ".join([finding, *problems]), not problems)


# Columns that were retyped together: single, the fractions as a pair, the vertical ones, a set of Chapter II.
COLUMNS = (
    ("mass_ratio",),
    ("k_y",),
    ("c_y",),
    ("i1_over_i",),
    ("i2_over_i",),
    ("i1_over_i", "i2_over_i"),
    ("inertia",),
    ("mass_ratio", "k_y", "c_y"),
    ("mass_ratio", "i1_over_i", "i2_over_i", "inertia"),
)
INCIDENT = ("v_x1", "v_y1", "offset_v_y1", "omega_1", "cor", "c_y")
# Appendix B prints these where all but a few rows follow 1.3 in and the inertias of Chapter II.
APPENDIX_B: Inputs = {"radius": 1.25, "inertia": 0.000342}
# Candidates this near, in per cent, are counted to know how densely they lie around the printed value.
NEAR = 2.0
# Numbers are the same within this, relative, and outputs different beyond so many decimals of a per cent.
SAME, DISTINCT = 1e-9, 7
# Nearer than this, in per cent, print does not distinguish.
LAST_DIGIT = 0.001
# `v_x2` and `R omega_2` of a rolling ball agree within this whether R is 1.25 or 1.3 in; a sliding ball's never do.
ROLLS = 0.05


def neighbours(row: Row, rows: pd.DataFrame) -> Iterator[Inputs]:
    """What the case before or after, or the nearest one with another value, has in a group of columns."""
    table = [row_inputs(item) for item in rows[rows["table"] == row["table"]].to_dict("records")]
    here = int(row["case"]) - 1
    for names, step in itertools.product(COLUMNS, (-1, 1)):
        k = here + step
        while 0 <= k < len(table):
            other = {name: table[k][name] for name in names}
            if other != {name: table[here][name] for name in names}:
                yield other
                break
            k += step


def other_tables(row: Row, rows: pd.DataFrame) -> Iterator[Inputs]:
    """One value of the same case of every other table, of an example of Chapter III, or Chapter V's restitution."""
    others = rows[(rows["case"] == row["case"]) & (rows["table"] != row["table"])]
    for item, name in itertools.product(others.to_dict("records"), INCIDENT):
        yield {name: row_inputs(item)[name]}
    for item, name in itertools.product(thesis_table("chapter_three_examples").to_dict("records"), INCIDENT):
        yield {name: row_inputs(item)[name]}
    yield {"cor": MEAN_RESTITUTION[row["spin"]]}


def printed_constants(row: Row, rows: pd.DataFrame) -> Iterator[Inputs]:
    """Radius and inertia of Appendix B, and the row's own inputs as printed where the errata mend them."""
    del rows
    yield from ({name: value} for name, value in APPENDIX_B.items())
    yield APPENDIX_B
    printed = thesis_table("appendix_c")
    same = printed[(printed["table"] == row["table"]) & (printed["case"] == row["case"])].iloc[0].to_dict()
    mended = row_inputs(row)
    yield from ({name: value} for name, value in row_inputs(same).items() if value != mended[name])


def misread_digits(row: Row, rows: pd.DataFrame) -> Iterator[Inputs]:
    """Own inputs with neighbouring digits exchanged, one left out, the point moved or the end rounded off."""
    del rows
    own = row_inputs(row)
    for name in ("v_x1", "v_y1", "offset_v_y1", "omega_1", "cor", "k_y", "c_y", "i1_over_i", "i2_over_i", "inertia"):
        text = np.format_float_positional(own[name], precision=6, trim="-")
        for other in sorted({*_slipped(text), own[name] / 10.0, own[name] * 10.0, *_rounded(own[name])}):
            if other not in (0.0, own[name]):
                yield {name: other}


def round_damping(row: Row, rows: pd.DataFrame) -> Iterator[Inputs]:
    """Every `c_y` of two digits between 0.01 and 0.1 lb s/in, in which all of Chapter V's and most of C's lie."""
    del row, rows
    yield from ({"c_y": k / 1000.0} for k in range(10, 100))


SOURCES: Mapping[str, Callable[[Row, pd.DataFrame], Iterator[Inputs]]] = {
    "constants in print": printed_constants,
    "neighbouring case": neighbours,
    "another table": other_tables,
    "digits": misread_digits,
    "round c_y": round_damping,
}


def _slipped(text: str) -> Iterator[float]:
    places = [k for k, character in enumerate(text) if character.isdigit()]
    for k, m in itertools.pairwise(places):
        yield float(text[:k] + text[m] + text[k + 1 : m] + text[k] + text[m + 1 :])
    for k in places:
        yield float(text[:k] + text[k + 1 :] or "0")


def _rounded(value: float) -> Iterator[float]:
    yield from (float(f"{value:.{figures}g}") for figures in (2, 3))


@dataclass(frozen=True)
class Chance:
    """How many `candidates` of the kind of a slip give different numbers, and how many of them one would expect as
    near to the printed values as the slip is, were they strewn at random.
    """

    candidates: int
    expected: float


@dataclass(frozen=True)
class Candidates:
    """The lists, by name, on which each clause of a slip was found."""

    clauses: tuple[Clause, ...]
    names: tuple[str, ...]
    lists: tuple[tuple[Inputs, ...], ...]


def candidates(row: Row, rows: pd.DataFrame, clauses: Sequence[Clause]) -> Candidates | None:
    """The first list that holds the inputs of each clause; None if those of one are on no list."""
    fitting: list[tuple[str, tuple[Inputs, ...]]] = []
    for clause in clauses:
        for name, draw in SOURCES.items():
            drawn = tuple(draw(row, rows))
            if any(_same(item, clause.inputs) for item in drawn):
                fitting.append((name, drawn))
                break
        else:
            return None
    return Candidates(tuple(clauses), tuple(name for name, _ in fitting), tuple(drawn for _, drawn in fitting))


def by_chance(row: Row, alternatives: Candidates, columns: Sequence[str]) -> Chance:
    """How likely by chance a slip is that explains these `columns` of a row, the lists of its clauses combined.

    A ball that rolls in the end gives one number, `v_x2` being `R omega_2`; one that slides gives two.
    """
    printed = np.array([float(row[HEADS[name]]) for name in columns])
    own = row_inputs(row)

    def deviations(chosen: Sequence[Inputs]) -> tuple[float, ...]:
        made = [Clause(clause.codes, inputs) for clause, inputs in zip(alternatives.clauses, chosen, strict=True)]
        values = outputs(filled_in(own, made))
        return tuple(np.round(100.0 * (np.array([values[name] for name in columns]) / printed - 1.0), DISTINCT))

    distinct = {item for item in map(deviations, itertools.product(*alternatives.lists)) if np.all(np.isfinite(item))}
    near = sum(max(map(abs, item)) <= NEAR for item in distinct)
    mine = np.abs(deviations([clause.inputs for clause in alternatives.clauses]))
    rolls = len(columns) == 2 and abs(printed[0] / (printed[1] * own["radius"] * INCH) - 1.0) < ROLLS
    shares = np.maximum(mine.max(keepdims=True) if rolls else mine, LAST_DIGIT) / NEAR
    return Chance(len(distinct), float(near * np.prod(shares)))


def _same(first: Inputs, second: Inputs) -> bool:
    return first.keys() == second.keys() and all(abs(first[k] - second[k]) <= SAME * abs(second[k]) for k in first)


# Relative difference below which two computations count as the same.
ALIKE = 0.01


def slip_table(rankings: Mapping[str, Ranking]) -> pd.DataFrame:
    """One row per set of Appendix C, over the impacts of Wang that slide throughout in its computation: the spin
    gained over what the loss of `v_x` gives by angular momentum, recomputed and printed (medians), and what the stray
    cosine takes back of that loss (largest); then how far the computation is from the exact solution, over all
    impacts.
    """
    rows = []
    ours, exact = rankings[RECOMPUTED].errors, rankings[EXACT].errors
    for (case, mine), name in zip(thesis_table("appendix_c").groupby("case"), ours, strict=True):
        ratio, share = mine["mass_ratio"].iloc[0], mine["i1_over_i"].iloc[0]
        ratios = np.array([item for spin in SPINS for item in _sliding(mine[mine["spin"] == spin], spin)])
        gained, printed, stray = ratios.reshape(-1, 3).T
        rows.append(
            {"set": case, "M1/M": ratio, "I1/I2": share / (1.0 - share), "sliding": len(gained),
             "spin gained / balance": np.median(gained), "in print": np.median(printed),
             "stray cosine [% of loss]": 100.0 * stray.max(),
             **{f"{output} from exact [{UNITS[output]}]": root_mean_square(ours[name][output] - exact[name][output])
                for output in ("v_x2", "omega_2")}}
        )  # fmt: skip
    return pd.DataFrame(rows)


def _sliding(rows: pd.DataFrame, spin: str) -> Iterator[tuple[float, float, float]]:
    """For each sliding impact: spin gained over the balance, recomputed and printed, and the stray cosine's share."""
    chosen, wang, first = printed_model(), measured(spin), rows.iloc[0]
    values = row_parameters(first.to_dict())
    lever = values["ball_mass"] * BALL_RADIUS / (INERTIA_OF[first["mass_ratio"]] * INERTIA)
    for k, row in enumerate(rows.to_dict("records")):
        incident, omega_1 = row["v_x1 [m/s]"], row["omega_1 [rad/s]"]
        impact = impacts(incident, wang["v_y1"][k], omega_1, wang["v_y2"][k] / wang["v_y1"][k])
        rebound = chosen.rebound(values, impact)
        course = chosen.course(values, impact, rebound.contact_time)
        if np.isnan(course.transition):
            loss = incident - course.v_x[0]
            gained = (rebound.omega_2[0] - omega_1) / (lever * loss)
            printed = (row["omega_2 [rad/s]"] - omega_1) / (lever * (incident - row["v_x2 [m/s]"]))
            yield gained, printed, (course.v_x[0] - rebound.v_x2[0]) / loss


def slip_words(table: pd.DataFrame) -> str:
    """What the slips do, one clause a mass ratio."""
    gained, stray = [], []
    for ratio, mine in table.groupby("M1/M", sort=False):
        factor = float(mine["spin gained / balance"].median())
        size = "right" if abs(factor - 1.0) <= ALIKE else "too small" if factor < 1.0 else "too large"
        gained.append(f"{factor:.2f} ({size}) for M1/M = {ratio}, where I1/I2 is {mine['I1/I2'].iloc[0]:.2f}")
        stray.append(f"{digits(mine['stray cosine [% of loss]'].max(), 1)} % ({ratio})")
    apart = 100.0 * (table["spin gained / balance"] / table["I1/I2"] - 1.0).abs().max()
    spin, speed = table["omega_2 from exact [rad/s]"], table["v_x2 from exact [m/s]"]
    return (
        f"The spin gained while sliding is I1/I2 times the value that follows from the loss of V_x (to {apart:.1f} "
        f"%): {listed(gained)}. A stray cosine reduces the velocity loss of a ball that slides throughout by up to "
        f"{listed(stray)}. The exact solution differs from the computed rebounds by "
        f"{digits(speed.min(), 2)} to {digits(speed.max(), 2)} m/s and {digits(spin.min(), 2)} to "
        f"{digits(spin.max(), 2)} rad/s (rms, range over the sets)."
    )
