"""`fitball rederive`: what it finds, what it writes, and that a changed digit shows."""

from __future__ import annotations

import html
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from samples import search_briefly
from uncertainties import ufloat

import fitball
from fitball.cli.main import main
from fitball.data.published import thesis_table
from fitball.errors import TableError
from fitball.inference.effort import Effort
from fitball.inference.thesis import published_cases as thesis_inputs
from fitball.thesis import (
    appendices,
    chapter_five,
    judgement,
    printed_tables,
    recalibration,
)
from fitball.thesis.page import write


@pytest.fixture(scope="module")
def found():
    with pytest.MonkeyPatch.context() as patch:
        search_briefly(patch)
        return chapter_five.derive(Effort(seed=1, cores=2, max_steps=300), lambda _stage: None)


def test_every_count_is_the_pinned_one(found):
    assert found.holds, [check for check in found.checks if not check.holds]
    assert len(found.checks) == 8
    assert (found.appendix_c.exceptions["cause"] != "").all()


def test_the_summary_says_what_pinned_means(found):
    error = appendices.worst_error(found.appendix_c.rows)
    assert "comparisons with the printed numbers: unchanged" in found.summary
    assert f"{np.sum(error > 1.0)} by more than 1 %" in found.summary
    changed = replace(found, checks=(*found.checks[1:], replace(found.checks[0], holds=False)))
    assert "changed: Appendix C" in changed.summary and not changed.holds
    better = found.appendix_c.rows.assign(v_x2_error=0.0, omega_2_error=0.0)
    clean = replace(found.appendix_c, rows=better, exceptions=found.appendix_c.exceptions.iloc[:0])
    assert "0 by more than 1 %. 0 cells are unexplained" in replace(found, appendix_c=clean).summary


@pytest.mark.parametrize(
    ("name", "factor"),
    [("FRICTION", 1.01), ("C1", 1.05), ("BALL_MASS", 1.01), ("BALL_RADIUS", 0.99), ("K_THETA", 1.1)],
)
def test_a_changed_constant_breaks_appendix_c(monkeypatch, name, factor):
    monkeypatch.setattr(thesis_inputs, name, getattr(thesis_inputs, name) * factor)
    rows = appendices.reproduce()
    assert rows.unlisted
    assert not chapter_five._check_appendix_c(rows, rows.rows).holds


def test_a_misprint_that_is_not_listed_is_noticed(monkeypatch):
    printed = thesis_table("appendix_c")
    printed.loc[3, "omega_2 [rad/s]"] = 254.57

    def tampered(name):
        return printed if name == "appendix_c" else thesis_table(name)

    monkeypatch.setattr(appendices, "thesis_table", tampered)
    assert appendices.reproduce().unlisted == (
        "C1 case 4, omega_2: printed and recomputed {'printed': 254.57, 'recomputed': 244.58}",
    )


def test_energies_need_the_inertia_of_appendix_b(monkeypatch):
    assert printed_tables.energies()["implied_inertia"].between(0.0003415, 0.0003425).all()
    assert (
        ", that of Appendix B (0.000342). This is +22 % from"
        in chapter_five._check_energies(printed_tables.energies()).finding
    )
    monkeypatch.setattr(printed_tables, "INERTIA_APPENDIX_B", 0.00028)
    check = chapter_five._check_energies(printed_tables.energies())
    assert not check.holds and ", not that of Appendix B (0.00028). This is +22 % from" in check.finding
    lighter = printed_tables.energies().assign(implied_inertia=0.000252)
    assert "-10 % from the 0.00028 of Chapter IV" in chapter_five._check_energies(lighter).finding


def test_the_words_on_inertia_damping_and_angles_follow_the_numbers(found):
    for value, word in ((2.888e-4, "truncated"), (2.803e-4, "rounded"), (2.6e-4, "neither rounded nor truncated")):
        assert f"0.00028, {word}." in chapter_five._check_inertia(ufloat(value, 1e-6)).finding
    nine = found.tables["damping"]["place"].str.startswith("Fig.")
    none = found.tables["damping"].assign(obeys=np.where(nine, "none", "Eq. (8)"), **{"Eq. (8)": 1.0})
    told = chapter_five._check_damping(none)
    assert told.finding.startswith("0 of the 9 values of Chapter V") and "no solution for 0 of the 30" in told.finding
    assert not told.holds
    angles = found.tables["appendix_d"].assign(**{"theta_2_error [%]": found.tables["appendix_d"]["theta_2_printed"]})
    assert "(63 with their sign)" not in chapter_five._check_appendix_d(angles).finding
    assert "prints 63 would" in chapter_five._check_appendix_d(angles).finding


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
    found = printed_tables.bifilar_inertia()
    ratio, inertia, shares = found.ratio, found.moment, found.shares
    expected = 0.127 / 386.4 * 386.4 * 1.25**2 / (1.016 * 39.37) * (1.516 / (2.0 * np.pi)) ** 2
    assert inertia.nominal_value == pytest.approx(expected, rel=1e-12, abs=0)
    assert ratio.nominal_value == pytest.approx(386.4 / (1.016 * 39.37) * (1.516 / (2.0 * np.pi)) ** 2, rel=1e-12)
    # Ten runs of ten periods: mean 15.16 s, standard deviation 0.0699 s.
    assert shares["timing"] == pytest.approx(
        (2.0 * 0.0699 / 15.16 / np.sqrt(10)) ** 2 / (inertia.std_dev / expected) ** 2, rel=0.01
    )
    assert sum(shares.values()) == pytest.approx(1.0)


def test_nine_dampings_obey_chapter_five():
    table = printed_tables.formula_table()
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
    result = judgement.rank({"good": base, "bad": worse})
    assert list(result.certainty["best"]) == [1.0, 0.0]
    pooled = result.scores[result.scores["impacts"] == "pooled"].set_index("set")
    assert pooled.loc["bad", "score"] == pytest.approx(2.0 * pooled.loc["good", "score"])
    assert pooled.loc["good", "v_x2 [m/s]"] == pytest.approx(np.sqrt(np.mean(base["v_x2"] ** 2)))


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
    # A page writes the sign that a terminal may lack.
    text = html.unescape((tmp_path / "out" / "report.html").read_text(encoding="utf-8")).replace("\u00b1", "+-")
    for sentence in (*(check.finding for check in found.checks), *found.verdicts.values(), found.summary):
        assert sentence in text
    assert "friction 0.55 +- 0.05, contact time\n5.0 +- 0.5 ms" in text
    assert len(pd.read_csv(tmp_path / "out" / "appendix_c.csv")) == 147


def test_the_published_values_stand_beside_the_fits(found, tmp_path):
    """One of the fitted models is called `thesis`, as the column of the thesis's own values once was."""
    table = recalibration.parameter_table(found.fits).set_index("parameter")
    published = table[recalibration.PUBLISHED]
    assert list(published) == ["2/3, 2/3, 1/2", "80, 90, 72", "1000, 1000, 1000", "0.55", "0.0431", "-0.189"]
    assert table.shape[1] == 2 + len(recalibration.MODELS)
    for name, item in found.fits.items():
        median = float(table.loc["k_y", f"{name}, fitted"].split()[0])
        assert median == pytest.approx(np.median(item.column("k_y")) / 175.127, rel=0.01)


def test_each_fit_says_what_it_excludes_and_what_the_data_do(found):
    """No restitution above the mass ratio: a wall of two-mass, no finding of the data. k_theta is one, in each."""
    for name, item in found.fits.items():
        cases = [place for place in item.placed if place.point.startswith("case")]
        assert [set(place.excluded) for place in cases] == [{"mass_ratio"} if name == "two-mass" else set()] * 3
        assert all(place.below["k_theta"] > 0.9 for place in cases)
        assert all(place.level > 0.99 for place in cases)
    assert "mass_ratio excluded by the model itself" in found.verdicts["Posterior of two-mass"]


def test_the_points_of_figures_36_to_44():
    table = printed_tables.figures_36_to_44()
    assert list(table.groupby("figure").size()) == [7] * 9
    # Fig. 44: backspin, case 3; its third impact by the thesis's computation with what the caption states.
    values = thesis_inputs.case_parameters("1/2", 72.0, 0.353, 0.0215)
    wang = fitball.load_table("wang_backspin.csv")
    state = wang.impacts
    impact = fitball.impacts(state.v_x1[2], state.v_y1[2], state.omega_1[2], 0.732)
    rebound = thesis_inputs.printed_model().rebound(values, impact)
    row = table[table["figure"] == 44].iloc[2]
    assert row["v_x2, recomputed [m/s]"] == pytest.approx(rebound.v_x2[0], rel=1e-12)
    assert row["omega_2, recomputed [rad/s]"] == pytest.approx(rebound.omega_2[0], rel=1e-12)
    printed = thesis_table("appendix_c")
    same = printed[(printed["table"] == "C17") & (printed["case"] == 1)].iloc[0]
    assert row["omega_2, Appendix C [rad/s]"] == same["omega_2 [rad/s]"]
    assert row["theta_2, Appendix C [deg]"] == -same["theta_2 [deg]"]
    assert row["v_x2, measured [m/s]"] == {item.name: item.values for item in wang.measurements}["v_x2"][2]


def test_the_verb_ends_with_one_when_a_reproduction_fails(found, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("fitball.thesis.chapter_five.derive", lambda _effort, _report: found)
    monkeypatch.setattr("fitball.thesis.page.draw_all", lambda _found: {})
    monkeypatch.setattr("fitball.thesis.page.page", lambda *_rest: "page")
    assert main(["rederive", "--out", str(tmp_path / "a"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["holds"] is True and told["summary"] == found.summary and told["verdicts"] == found.verdicts
    broken = replace(found, checks=(replace(found.checks[0], holds=False), *found.checks[1:]))
    monkeypatch.setattr("fitball.thesis.chapter_five.derive", lambda _effort, _report: broken)
    assert main(["rederive", "--out", str(tmp_path / "b")]) == 1
    first = capsys.readouterr().out
    assert len(first.splitlines()) <= 40 and "Comparisons that have changed" in first
    assert main(["rederive", "--full", "--out", str(tmp_path / "b")]) == 1
    full = capsys.readouterr().out
    row = next(line for line in full.splitlines() if line.startswith("5: M1/M"))
    assert [word for word in row.split() if word.startswith("(")] == [
        f"({100.0 * item.pooled['best'].iloc[4]:.1f}" for item in found.rankings.values()
    ]
    assert "Appendix C, CHANGED" in full and full.count(", unchanged:") == len(found.checks) - 1
    assert " ".join(broken.summary.split()) in " ".join(full.split())
    (tmp_path / "file").write_text("x", encoding="utf-8")
    begun = []
    monkeypatch.setattr("fitball.thesis.chapter_five.derive", lambda *rest: begun.append(rest))
    assert main(["rederive", "--out", str(tmp_path / "file")]) == 2
    assert main(["rederive", "--out", str(tmp_path / "c"), "--seed", "-1"]) == 2
    assert "seed = -1" in capsys.readouterr().err and not begun


def test_unknown_table_is_named():
    with pytest.raises(TableError, match="known: appendix_c"):
        thesis_table("appendix_x")
