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
from fitball.uses.budget import budgets
from fitball.uses.sources import LINEAR_SHARE, hypercube

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


GRAVITY = 9.80665
# Measurements of each laboratory test, and drawings of its Monte Carlo.
COUNT = 12
MANY = 200_000


def totals_of(fit):
    """The combined rows of a fit's budget by result."""
    frame = budgets(fit)
    return frame[frame["source"] == "combined"].set_index("result")


def test_the_budget_of_a_mean_rebound_is_a_monte_carlo_of_the_test():
    rng = np.random.default_rng(8)
    cor = 0.76 + 0.01 * rng.standard_normal(COUNT)
    frame = pd.DataFrame({"v_y1": 6.85, "v_y2": 6.85 * cor})
    fit = fitball.calibrate(frame, progress=False)
    row = totals_of(fit).loc["rebound_measured"]
    # Drag 0.55 +- 0.08, mass and radius over the limits of the rules, air of 1.204 kg/m^3.
    drag = rng.normal(0.55, 0.08, MANY)
    mass = rng.uniform(0.0560, 0.0594, MANY)
    radius = rng.uniform(0.0327, 0.0343, MANY)
    braking = drag * 1.204 * np.pi * radius**2 / mass
    squared = 2.0 * GRAVITY / braking * (1.0 - np.exp(-braking * 2.54))
    mean = cor.mean() + rng.standard_t(COUNT - 1, MANY) * cor.std(ddof=1) / np.sqrt(COUNT)
    heights = np.log1p(0.5 * braking * mean**2 * squared / GRAVITY) / braking
    assert row["contribution"] == pytest.approx(heights.std(), rel=0.05)
    assert row["monte_carlo"] == pytest.approx(heights.std(), rel=0.05)
    assert row["value"] == pytest.approx(heights.mean(), rel=0.005)
    assert row["linear"]
    sources = budgets(fit).query("result == 'rebound_measured'").set_index("source")
    assert sources.loc["drag", "share"] > 0.3
    assert sources.loc["ball_mass", "distribution"] == "rectangular"


def test_heights_on_both_sides_do_not_depend_on_the_air():
    rng = np.random.default_rng(9)
    rebounds = 140.0 + 2.0 * rng.standard_normal(COUNT)
    frame = pd.DataFrame({"drop_height [cm]": 254.0, "rebound_height [cm]": rebounds})
    fit = fitball.calibrate(frame, progress=False)
    row = totals_of(fit).loc["rebound_measured"]
    assert row["contribution"] == pytest.approx(0.02 / np.sqrt(COUNT), rel=0.4)
    sources = budgets(fit).query("result == 'rebound_measured'")["source"]
    assert list(sources) == [f"scatter of {COUNT} repeats", "combined"]
    # The restitution does.
    assert "drag" in set(budgets(fit).query("result == 'cor_measured'")["source"])


def test_the_budget_of_a_court_is_a_monte_carlo_of_the_test():
    rng = np.random.default_rng(10)
    angle = np.deg2rad(16.0)
    before = 30.0 * np.exp(1j * angle)
    after = (19.5 + 6.6j) * (1.0 + 0.02 * rng.standard_normal(COUNT))
    frame = pd.DataFrame(
        {"v_x1": before.real, "v_y1": before.imag, "v_x2": after.real, "v_y2": after.imag}
    )
    fit = fitball.calibrate(frame, model="brody", progress=False)
    row = totals_of(fit).loc["pace_measured"]
    tilt = rng.uniform(-np.deg2rad(0.5), np.deg2rad(0.5), (MANY, 1))
    temperature = rng.uniform(10.0, 30.0, MANY)
    # A ball that falls is turned as one that rises: both are seen by the same camera.
    falls = np.conj(before) * np.exp(-1j * tilt)
    rises = after * np.exp(-1j * tilt)
    friction = (falls.real - rises.real) / (rises.imag - falls.imag)
    restitution = -rises.imag / falls.imag
    ratings = 100.0 * (1.0 - friction) + 150.0 * (0.81 - restitution)
    scatter = ratings.std(axis=1, ddof=1) / np.sqrt(COUNT)
    drawn = ratings.mean(axis=1) + rng.standard_t(COUNT - 1, MANY) * scatter
    drawn = drawn - 150.0 * 0.003 * (23.0 - temperature)
    assert row["contribution"] == pytest.approx(drawn.std(), rel=0.05)
    assert row["monte_carlo"] == pytest.approx(drawn.std(), rel=0.05)
    sources = budgets(fit).query("result == 'pace_measured'").set_index("source")
    assert sources.loc["tilt", "share"] > 0.3
    assert sources.loc["ball_temperature", "source_unit"] == "degC"
    assert page.section(fit).blocks[0].rows[0]["result"] == "pace_measured"


def test_a_stated_contact_time_is_the_source_of_the_stiffness():
    """The stiffness is the mass times the square of the frequency, which goes as one over the
    contact time: its relative error is twice that of the time.
    """
    fit = fitball.calibrate("wang_zero_spin", progress=False)
    frame = budgets(fit).query("result == 'k_y'").set_index("source")
    row = frame.loc["contact time of the scene"]
    total = frame.loc["combined"]
    assert (row["value"], row["uncertainty"]) == (0.005, 0.0005)
    # Scatter and priors add some per cent to what the time leaves open.
    assert row["contribution"] == pytest.approx(2.0 * 0.1 * total["value"], rel=0.1)
    parts = frame["contribution"].drop("combined")
    assert np.sum(parts**2) == pytest.approx(total["contribution"] ** 2, rel=0.01)


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


def test_a_workbook_of_best_values_has_no_sheet_of_an_empty_budget(tmp_path):
    frame = pd.DataFrame({"v_y1": 7.0, "v_y2": 5.0 + 0.01 * np.arange(8)})
    fit = fitball.calibrate(frame, point_only=True, progress=False)
    assert not len(fit.budget)
    fit.save(tmp_path / "fit", figures=False, xlsx=True)
    names = load_workbook(tmp_path / "fit" / "results.xlsx").sheetnames
    assert "summary" in names
    assert "budget" not in names


def test_a_workbook_is_refused_at_once_where_openpyxl_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(ParameterError) as refused:
        require_openpyxl()
    assert refused.value.code == "no-openpyxl"
