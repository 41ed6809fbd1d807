"""Uncertainty budgets: against refits at drawn constants, and a straight line by hand."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from openpyxl import load_workbook
from support.fit_by_hand import table_of
from support.fits import best

import fitball
from fitball.base.errors import ParameterError
from fitball.base.workbook import require_openpyxl, workbook_bytes
from fitball.data.scene import BallSection, Scene, ValueWithSd
from fitball.inference.judgement.constants import moves_of_constants
from fitball.inference.judgement.first_order import first_order
from fitball.report import budget as page
from fitball.uses.budget import LINEAR_SHARE, budgets, hypercube

STORED = Path(__file__).parent / "data" / "stored" / "grip_slip"
# Drawings of all constants.
DRAWINGS = 40


def fits():
    """Four fits: two surfaces, a bundled table, a made one, and one with a stated mass."""
    yield fitball.load_fit(STORED)
    yield fitball.calibrate("wang_zero_spin", model="brody", progress=False)
    yield fitball.calibrate(table_of(24), model="grip-slip", progress=False)
    scene = Scene(ball=BallSection(mass=ValueWithSd(0.0577, 0.0003)))
    table = table_of(30, scatter=0.5)
    yield fitball.calibrate(table, model="brody", scene=scene, progress=False)


def by_refits(fit, names):
    """Standard uncertainties (names,) of results: the spread of best fits over constants that are
    drawn together, each searched for anew, beside the posterior sd.
    """
    problem = fit.problem
    held = [
        entry.held
        for entry in moves_of_constants(problem, first_order(problem, fit.point), problem.derived)
    ]
    rng = np.random.default_rng(17)
    shares = hypercube(len(held), DRAWINGS, rng)
    drawn = [entry.values(row) for entry, row in zip(held, shares, strict=True)]
    start = problem.coordinates(fit.point.optima[0])
    found = []
    for values in zip(*drawn, strict=True):
        posed = problem
        for entry, value in zip(held, values, strict=True):
            posed = posed.with_constant(entry.name, float(value))
        there = posed.values(best(posed, start)[None])
        found.append([float(fit.quantity(name).rule(there)[0]) for name in names])
    sds = fit.summary.loc[names, "sd"].to_numpy(float)
    return np.hypot(sds, np.std(found, axis=0))


def test_budgets_are_those_of_refits_or_said_to_be_bent():
    count = 0
    for fit in fits():
        frame = budgets(fit)
        totals = frame[frame["source"] == "combined"].set_index("result")
        names = list(totals.index)
        wanted = by_refits(fit, names)
        drawn = totals["monte_carlo"].to_numpy(float)
        np.testing.assert_allclose(drawn, wanted, rtol=0.05, err_msg=str(names))
        linear = totals["linear"].to_numpy(bool)
        combined = totals["contribution"].to_numpy(float)
        np.testing.assert_allclose(combined[linear], drawn[linear], rtol=LINEAR_SHARE)
        assert (totals["expanded"] == 2.0 * totals["contribution"]).all()
        count += len(names)
        for name, rows in frame[frame["source"] != "combined"].groupby("result"):
            squares = float(np.sum(rows["contribution"].to_numpy(float) ** 2))
            assert squares == pytest.approx(totals.loc[name, "contribution"] ** 2, rel=0.01)
            assert rows["share"].sum() == pytest.approx(1.0, abs=0.01)
    assert count > 10


def test_a_point_fit_has_no_budget_and_no_section():
    fit = fitball.calibrate("synthetic_drop", point_only=True, progress=False)
    assert budgets(fit).empty
    assert not any(block.filled for block in page.section(fit).blocks)


def test_the_page_says_which_result_is_not_linear():
    fit = fitball.load_fit(STORED)
    frame = budgets(fit)
    totals = frame[frame["source"] == "combined"].set_index("result")
    rows = {row["result"]: row for row in page.section(fit).blocks[0].rows}
    assert rows.keys() == set(totals.index)
    for name, total in totals.iterrows():
        assert (rows[name][""] == "not linear") is not total["linear"]


def test_drawn_constants_fill_their_strata_and_do_not_go_together():
    for constants in (1, 2, 5):
        shares = hypercube(constants, 64, np.random.default_rng(constants))
        for row in shares:
            np.testing.assert_allclose(np.sort(row), (np.arange(64) + 0.5) / 64)
        together = np.atleast_2d(np.corrcoef(shares)) - np.eye(constants)
        assert np.abs(together).max() < 0.16


def test_a_workbook_has_the_results_and_the_budget(tmp_path):
    fit = fitball.load_fit(STORED)
    fit.save(tmp_path / "fit", figures=False, xlsx=True)
    book = load_workbook(tmp_path / "fit" / "results.xlsx")
    assert book.sheetnames[0] == "summary"
    heads = [cell.value for cell in book["budget"][1]]
    frame = fit.budget
    assert heads == list(frame.columns)
    rows = list(book["budget"].iter_rows(min_row=2, values_only=True))
    assert len(rows) == len(frame)
    contributions = [row[heads.index("contribution")] for row in rows]
    np.testing.assert_allclose(contributions, frame["contribution"].to_numpy(float))
    # No cell is a formula, and what is no number is empty.
    text = pd.DataFrame({"name": ["=1+1"], "value": [np.nan], "count": [3], "open": [np.inf]})
    (tmp_path / "odd.xlsx").write_bytes(workbook_bytes({"odd": text}))
    cells = load_workbook(tmp_path / "odd.xlsx")["odd"][2]
    assert [cell.value for cell in cells] == ["'=1+1", None, 3, None]
    assert {cell.data_type for cell in cells} <= {"s", "n"}


def test_a_workbook_is_refused_at_once_where_openpyxl_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(ParameterError) as refused:
        require_openpyxl()
    assert refused.value.code == "no-openpyxl"
