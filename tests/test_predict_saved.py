"""Predictions from a result folder: what the fit itself predicts, at the command line, and where they must warn."""

from __future__ import annotations

import json
import math
import re
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from samples import save_without_figures
from test_report_html import faults

import fitball
from fitball.cli.main import main
from fitball.errors import ResultFolderError
from fitball.inference.prediction.new_impacts import predict_new
from fitball.inference.results.fitted_model import PREDICTING
from fitball.inference.results.results import thinned
from fitball.report.saved.netcdf_files import write_netcdf


@pytest.fixture
def folder(grip_slip_folder):
    return grip_slip_folder


@pytest.fixture(scope="module")
def point_folder(tmp_path_factory):
    fit = fitball.calibrate("wang_all.csv", model="grip-slip", point_only=True)
    return save_without_figures(fit, tmp_path_factory.mktemp("p") / "f")


IMPACT = ["--impact", "v=38 mph, theta=18 deg, spin=950 rpm top"]


def widths(fit, draws, new):
    """Lengths of the 95 % intervals (outputs, impacts) from draws (draws, free)."""
    found = predict_new(fit.fitted.with_draws(fit.posterior.names, draws), new)
    return np.array([np.ptp(found.output(name).rebound, axis=0) for name in ("v_x2", "v_y2", "omega_2")])


def test_intervals_are_as_long_as_those_of_the_whole_chain(grip_slip_fit):
    """Over several choices of draws: those that predictions take, and the control, the few that fit.json holds."""
    fit = grip_slip_fit
    new = fitball.impacts(
        [15.6, 14.5, 11.1, 9.0, 20.0], [4.8, 9.9, 13.8, 6.0, 10.0], [-5.0, 150.0, 20.0, -120.0, 0.0]
    )
    whole = widths(fit, fit.posterior.draws, new)
    error = {}
    for count in (PREDICTING, 400):
        ratios = [widths(fit, thinned(fit.posterior, count + k), new) / whole for k in range(15)]
        error[count] = np.sqrt(np.mean(np.square(np.array(ratios) - 1.0)))
    # Of a normal quantity 0.015 and 0.048; the largest of many is three times as far.
    assert error[PREDICTING] < 0.025 < 0.035 < error[400]
    named = fit.predict(new)
    units = {"v_x2": "m/s", "v_y2": "m/s", "omega_2": "rad/s"}
    mine = np.array(
        [named[f"{name}_mean_q975 [{unit}]"] - named[f"{name}_mean_q025 [{unit}]"] for name, unit in units.items()]
    )
    np.testing.assert_allclose(mine, whole, rtol=0.08)


def test_draws_that_predict_are_read_beside_fit_json(grip_slip_fit, grip_slip_folder, tmp_path):
    new = fitball.impacts(np.linspace(8.0, 20.0, 600), 8.0, 10.0)
    saved = fitball.load_fit(grip_slip_folder)
    before, after = predict_new(grip_slip_fit.predicting, new), predict_new(saved.predicting, new)
    assert saved.predicting.draws.shape[0] == PREDICTING
    for one, other in zip(before.outputs, after.outputs, strict=True):
        assert one.rebound.shape == (5, 600)
        for name in ("point", "rebound", "measured"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
    # Impacts are predicted some at a time: the same as each alone.
    alone = predict_new(saved.predicting, fitball.impacts(new.v_x1[599], 8.0, 10.0))
    assert alone.output("v_x2").rebound[0, 0] == after.output("v_x2").rebound[0, 599]
    # The file itself holds a few, and says so where the others are missing.
    shutil.copy(grip_slip_folder / "fit.json", tmp_path / "fit.json")
    alone = fitball.load_fit(tmp_path)
    assert (tmp_path / "fit.json").stat().st_size < 250_000
    with pytest.raises(ResultFolderError, match=r"posterior\.nc"):
        alone.predict(new)
    assert alone.fitted.rebound(new).v_x2[0].tobytes() == before.output("v_x2").point.tobytes()


def test_predict_prints_json_and_csv(folder, tmp_path, capsys):
    assert main(["predict", str(folder), *IMPACT]) == 0
    out, err = capsys.readouterr()
    assert "16.99 m/s at 18.0 deg" in out
    assert "99.5 rad/s topspin" in out
    assert "did not converge" not in err and "outside" not in out
    (tmp_path / "new.csv").write_text(
        "id,v_1 [mph],theta_1,omega_1 [rpm]\na,38,18,950\nb,60,60,0\n", encoding="utf-8"
    )
    place = tmp_path / "out.csv"
    assert main(["predict", str(folder), str(tmp_path / "new.csv"), "--out", str(place), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    frame = pd.read_csv(place)
    assert [item["outside"] for item in found["impacts"]] == [False, True]
    assert found["impacts"][1]["beyond"]["v_y1"] == pytest.approx(60 * 0.44704 * math.sin(math.radians(60)) - 16.39)
    assert found["impacts"][1]["extrapolated"] == ["COR"]
    assert found["validation"] == []
    first = found["impacts"][0]["outputs"]
    assert frame["v_x2_median [m/s]"][0] == first["v_x2"]["median"]
    assert frame["theta_2_data_q975 [deg]"][0] == pytest.approx(math.degrees(first["theta_2"]["data_q975"]))
    assert frame["outside"].tolist() == ["no", "yes"]
    assert main(["predict", str(folder), *IMPACT, "--quiet", "--out", str(place), "--overwrite"]) == 0
    assert capsys.readouterr().out.strip() == str(place)


def test_a_page_has_the_figure_and_every_impact(folder, tmp_path, capsys):
    place = tmp_path / "predicted.html"
    words = ["predict", str(folder), "wang_backspin.csv", "--html", str(place)]
    assert main([*words, "--quiet"]) == 0
    assert capsys.readouterr().out.strip() == str(place)
    page = place.read_text(encoding="utf-8")
    assert faults(page) == []
    assert page.count("<figure>") == 1 and page.count(">backspin-") >= 7
    assert main(words) == 2
    assert "--overwrite" in capsys.readouterr().err


def test_the_first_screen_of_many_impacts_is_short(folder, capsys):
    impacts = [word for k in range(70) for word in ("--impact", f"v={15 + 0.05 * k}, theta=20")]
    assert main(["predict", str(folder), *impacts]) == 0
    first = capsys.readouterr().out
    assert len(first.splitlines()) <= 60 and "50 more" in first
    assert main(["predict", str(folder), "--full", *impacts]) == 0
    assert "30 more" in capsys.readouterr().out


def test_measured_columns_are_compared(folder, capsys):
    assert main(["predict", str(folder), "wang_backspin.csv"]) == 0
    out = capsys.readouterr().out
    assert "no validation" in out and "used 7 of the impacts" in out
    assert "within 95 %" in out
    assert out.count("backspin-") >= 7


def test_a_point_fit_has_no_intervals_and_says_so(point_folder, tmp_path, capsys):
    place = tmp_path / "out.csv"
    assert main(["predict", str(point_folder), "wang_zero_spin.csv", "--out", str(place)]) == 0
    out, err = capsys.readouterr()
    assert "no posterior" in err
    # But in the heads of columns, with their units.
    assert not re.search(r"\[[-0-9]", out)
    assert not [name for name in pd.read_csv(place).columns if "median" in name or "q025" in name]


def test_draws_missing_damaged_or_of_another_fit_are_refused(folder, grip_slip_fit, tmp_path, capsys):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (copy / "posterior.nc").unlink()
    assert main(["predict", str(copy), *IMPACT]) == 2
    assert "posterior.nc: no such file" in capsys.readouterr().err
    (copy / "posterior.nc").write_bytes(b"not a netCDF file")
    assert main(["predict", str(copy), *IMPACT]) == 2
    assert "damaged" in capsys.readouterr().err
    drawn = grip_slip_fit.posterior
    write_netcdf(grip_slip_fit, replace(drawn, values=drawn.values[::-1]), copy / "posterior.nc")
    with pytest.raises(ResultFolderError, match="of another fit"):
        fitball.load_fit(copy).predict_interval(fitball.impacts(15.0, 6.0))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "either DATA or --impact"),
        (["wang_all.csv", *IMPACT], "either DATA or --impact"),
        (["--impact", "v=38 mhp, theta=18"], "did you mean 'mph'"),
        (["nowhere.csv"], "no such file"),
        (["bad.csv"], "row 1 (line 2), column 'v_y1': read -3"),
        (["wang_all.csv", "--seed", "-1"], "seed = -1"),
        (["wang_all.csv", "--out", "nowhere/x.csv"], "there is no folder"),
    ],
)
def test_bad_input_ends_with_two_and_words(folder, tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.csv").write_text("v_x1,v_y1\n10,-3\n", encoding="utf-8")
    assert main(["predict", str(folder), *words]) == 2
    out, err = capsys.readouterr()
    assert said in err
    assert "Traceback" not in err
    assert not out
    assert [item.name for item in tmp_path.iterdir()] == ["bad.csv"]


def test_one_row_without_rebound_is_enough_to_predict_and_not_to_fit(folder, tmp_path, capsys):
    (tmp_path / "one.csv").write_text("v_x1,v_y1\n10,8\n", encoding="utf-8")
    assert main(["predict", str(folder), str(tmp_path / "one.csv")]) == 0
    assert "v_x1 10.00" in capsys.readouterr().out
    assert main(["calibrate", str(tmp_path / "one.csv")]) == 2
    assert "no rebound column" in capsys.readouterr().err
