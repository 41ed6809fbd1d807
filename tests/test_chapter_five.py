"""`fitball rederive`: what it finds, what it writes, and that a changed digit shows."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from fitball.cli.main import main
from fitball.data.thesis_tables import thesis_table
from fitball.errors import TableError
from fitball.inference import thesis_inputs
from fitball.inference.calibrate import Effort
from fitball.studies import (
    appendix_c,
    appendix_d,
    chapter_five,
    printed_tables,
    ranking,
    recalibration,
    vertical_damping,
)
from fitball.studies.chapter_five_page import write

QUICK = Effort(seed=1, cores=2, max_steps=500)


@pytest.fixture(scope="module")
def found():
    return chapter_five.derive(QUICK, lambda _stage: None)


def test_every_reproduction_holds(found):
    assert found.holds, [check for check in found.checks if not check.holds]
    assert len(found.checks) == 8


def test_appendix_c_beats_the_first_decoding(found):
    error = appendix_c.worst_error(found.appendix_c.rows)
    assert np.sum(error <= 0.1) > 75
    assert np.sum(error <= 1.0) > 117


def test_every_exception_has_its_entry_and_every_entry_its_exception(found):
    assert found.appendix_c.unlisted == ()
    assert found.appendix_c.stale == ()
    assert (found.appendix_c.exceptions["cause"] != "").all()
    assert "unlisted" not in set(appendix_d.deviations(found.appendix_d)["kind"])


@pytest.mark.parametrize(
    ("name", "factor"),
    [("FRICTION", 1.01), ("C1", 1.05), ("BALL_MASS", 1.01), ("BALL_RADIUS", 0.99), ("K_THETA", 1.1)],
)
def test_a_changed_constant_breaks_appendix_c(monkeypatch, name, factor):
    monkeypatch.setattr(thesis_inputs, name, getattr(thesis_inputs, name) * factor)
    rows = appendix_c.reproduce()
    assert rows.unlisted
    assert not chapter_five._check_appendix_c(rows, rows.rows).holds


def test_a_misprint_that_is_not_listed_is_noticed(monkeypatch):
    printed = thesis_table("appendix_c")
    printed.loc[3, "omega_2 [rad/s]"] = 254.57

    def tampered(name):
        return printed if name == "appendix_c" else thesis_table(name)

    monkeypatch.setattr(appendix_c, "thesis_table", tampered)
    assert appendix_c.reproduce().unlisted == (
        "C1 case 4, omega_2: printed and recomputed {'printed': 254.57, 'recomputed': 244.58}",
    )


def test_energies_need_the_inertia_of_appendix_b(monkeypatch):
    assert printed_tables.energies()["implied_inertia"].between(0.0003415, 0.0003425).all()
    monkeypatch.setattr(printed_tables, "INERTIA_APPENDIX_B", 0.00028)
    assert not chapter_five._check_energies(printed_tables.energies()).holds


def test_mean_friction_is_the_balance_of_every_impact():
    import fitball
    from fitball.data.balances import scene_balances
    from fitball.data.scene import load_scene

    rows = printed_tables.mean_friction()
    table = fitball.load_table("wang_topspin.csv")
    balance = scene_balances(table, load_scene("wang_topspin.csv")).mu_bar.values
    np.testing.assert_allclose(rows[rows["spin"] == "topspin"]["recomputed"], balance, rtol=1e-12)


def test_bifilar_inertia_by_hand():
    """(0.127/386.4) 386.4 1.25^2 / (40 in) (1.516 s / 2 pi)^2, lbf s^2 in."""
    ratio, inertia, shares = printed_tables.bifilar_inertia()
    expected = 0.127 / 386.4 * 386.4 * 1.25**2 / (1.016 * 39.37) * (1.516 / (2.0 * np.pi)) ** 2
    assert inertia.nominal_value == pytest.approx(expected, rel=1e-12)
    assert ratio.nominal_value == pytest.approx(386.4 / (1.016 * 39.37) * (1.516 / (2.0 * np.pi)) ** 2, rel=1e-12)
    # Ten runs of ten periods: mean 15.16 s, standard deviation 0.0699 s.
    assert shares["timing"] == pytest.approx(
        (2.0 * 0.0699 / 15.16 / np.sqrt(10)) ** 2 / (inertia.std_dev / expected) ** 2, rel=0.01
    )
    assert sum(shares.values()) == pytest.approx(1.0)


def test_nine_dampings_obey_chapter_five():
    table = vertical_damping.formula_table()
    nine = table[table["place"].str.startswith("Fig.")]
    assert list(nine["obeys"]) == ["Chapter V"] * 9
    assert nine["nearest [%]"].max() < 0.5
    assert table["Eq. (8)"].notna().sum() == 1


def test_ranking_of_known_errors():
    """A set that is better on every impact is best in every resample; equal sets share."""
    rng = np.random.default_rng(1)
    base = {
        name: rng.normal(0.0, scale, 21) for name, scale in {"v_x2": 0.5, "theta_2": 2.0, "omega_2": 20.0}.items()
    }
    worse = {name: 2.0 * values for name, values in base.items()}
    result = ranking.rank({"good": base, "bad": worse})
    assert list(result.certainty["best"]) == [1.0, 0.0]
    pooled = result.scores[result.scores["impacts"] == "pooled"].set_index("set")
    assert pooled.loc["bad", "score"] == pytest.approx(2.0 * pooled.loc["good", "score"])
    assert pooled.loc["good", "v_x2 [m/s]"] == pytest.approx(np.sqrt(np.mean(base["v_x2"] ** 2)))


def test_verdicts_on_table_nine(found):
    certainty = found.ranking_printed.certainty
    assert set(certainty[certainty["among the best three"] > 0.99]["set"].str[0]) == {"4", "5", "6"}
    assert "falls" in found.verdicts["Case 3"]
    assert "stands" in found.verdicts["Case 1"]
    for item in (found.fits["two-mass"], found.fits["thesis-exact"]):
        assert (item.points["credible level"] > 0.999).all()


def test_credible_level_of_a_normal_sample():
    rng = np.random.default_rng(3)
    draws = rng.standard_normal((2, 20000))
    # Two dimensions: the region within radius r holds 1 - exp(-r^2/2).
    for radius in (0.5, 1.5, 2.5):
        expected = 1.0 - np.exp(-0.5 * radius**2)
        level = recalibration.credible_level(draws, np.array([radius, 0.0]), rng)
        assert level == pytest.approx(expected, abs=0.05)


def test_the_offset_does_not_grow_as_equation_53_says(found):
    table = recalibration.offset_table(found.fits)
    fast = table[table["v_y1 [m/s]"] > 13.0]
    assert (fast["Eq. (53) [in]"] > 2.5 * fast["model-free [in]"]).all()


def test_files_and_page(found, tmp_path):
    write(found, tmp_path / "out")
    names = {item.name for item in (tmp_path / "out").iterdir()}
    assert {"report.html", "glance.png", "chapter_v.png", "appendix_c.csv", "errata.csv"} <= names
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for check in found.checks:
        assert check.name in text
    assert len(pd.read_csv(tmp_path / "out" / "appendix_c.csv")) == 147


def test_the_verb_ends_with_one_when_a_reproduction_fails(found, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("fitball.studies.chapter_five.derive", lambda _effort, _report: found)
    monkeypatch.setattr("fitball.studies.chapter_five_page.draw_all", lambda _found: {})
    monkeypatch.setattr("fitball.studies.chapter_five_page.page", lambda *_rest: "page")
    assert main(["rederive", "--out", str(tmp_path / "a"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["holds"] is True
    from dataclasses import replace

    broken = replace(found, checks=(replace(found.checks[0], holds=False), *found.checks[1:]))
    monkeypatch.setattr("fitball.studies.chapter_five.derive", lambda _effort, _report: broken)
    assert main(["rederive", "--out", str(tmp_path / "b")]) == 1
    assert "[FAILS] Appendix C" in capsys.readouterr().out
    (tmp_path / "file").write_text("x", encoding="utf-8")
    assert main(["rederive", "--out", str(tmp_path / "file")]) == 2


def test_unknown_table_is_named():
    with pytest.raises(TableError, match="known: appendix_c"):
        thesis_table("appendix_x")
