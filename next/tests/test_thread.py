"""The thin thread: from a table to a page, by the command line and in Python. Goes as `calibrate` becomes whole."""

import json

import numpy as np
import pytest

import fitball
from fitball.cli import main

TRUTH = {"mu": 0.6, "e_x": 0.12, "offset": 0.002, "cor_10": 0.76, "cor_slope": -0.015}


@pytest.fixture
def table(tmp_path):
    """A file of what grip-slip itself says, without noise, some impacts sliding and some gripping."""
    import pandas as pd

    rng = np.random.default_rng(3)
    speed, angle = rng.uniform(10.0, 30.0, 24), rng.uniform(0.25, 1.2, 24)
    states = fitball.impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-200.0, 200.0, 24))
    made = fitball.model("grip-slip").rebound(TRUTH, states)
    columns = {"v_x1": states.v_x1, "v_y1": states.v_y1, "omega_1": states.omega_1,
               "v_x2": made.v_x2, "v_y2": made.v_y2, "omega_2": made.omega_2}  # fmt: skip
    place = tmp_path / "balls.csv"
    pd.DataFrame(columns).to_csv(place, index=False)
    return place


def test_a_table_of_the_model_itself_gives_its_parameters(table):
    fit = fitball.calibrate(table, model="grip-slip", progress=False)
    found = fit.frames["summary"]["point"]
    for name, value in TRUTH.items():
        assert found[name] == pytest.approx(value, abs=1e-9), name


def test_a_command_writes_a_page_and_its_numbers(table, tmp_path, capsys):
    assert main(["calibrate", str(table), "--out", str(tmp_path / "fit")]) == 0
    assert "mu" in capsys.readouterr().out
    page = (tmp_path / "fit" / "report.html").read_text(encoding="utf-8")
    assert page.count("<h2") == 2
    assert (tmp_path / "fit" / "summary.csv").read_text(encoding="utf-8").startswith("name,")


def test_check_prints_every_fault_as_json(tmp_path, capsys):
    place = tmp_path / "broken.csv"
    place.write_text("v_1,theta_1,v_y2\n17,much,5\n18,200,5\n")
    assert main(["check", str(place), "--json"]) == 1
    faults = json.loads(capsys.readouterr().out)["frames"]["faults"]
    assert {(fault["row"], fault["column"]) for fault in faults} >= {(1, "theta_1"), (2, "theta_1")}
    assert main(["calibrate", str(place), "--out", str(tmp_path / "fit")]) == 2
    assert not (tmp_path / "fit").exists()


def test_what_this_stage_cannot_do_is_refused(table):
    for options in ({"model": "two-mass"}, {"noise": "student-t"}, {"fix": {"mu": 0.5}}):
        with pytest.raises(fitball.FitballError) as caught:
            fitball.calibrate(table, **options)
        assert caught.value.code == "not-yet"
