"""From a table to a page: by the command line and in Python."""

import json

import numpy as np
import pytest
from msgspec.structs import replace
from support.made_fit import TRUTH, made_fit, table_of

import fitball
from fitball.cli import main
from fitball.inference.assemble import outside
from fitball.saved.files_of_fit import read


def test_a_table_of_the_model_itself_gives_its_parameters(tmp_path):
    table_of(scatter=0.0).to_csv(tmp_path / "balls.csv", index=False)
    fit = fitball.calibrate(
        tmp_path / "balls.csv",
        model="grip-slip",
        point_only=True,
        progress=False,
    )
    for name, value in TRUTH.items():
        # Scatter is no less than its bound, against which priors pull.
        assert fit.parameters[name].point == pytest.approx(value, abs=1e-5), name
    assert fit.status == "point only"
    assert fit.exit_code == 0


def test_a_command_writes_a_fit_that_reads_back_and_an_older_one_is_kept(tmp_path, capsys):
    words = [
        "calibrate",
        "wang_zero_spin.csv",
        "--model",
        "grip-slip",
        "--out",
        str(tmp_path / "fit"),
        "--seed",
        "2",
    ]
    assert main(words) == 0
    assert "mu" in capsys.readouterr().out
    made = {place.name for place in (tmp_path / "fit").iterdir()}
    assert made >= {
        "report.html",
        "fit.json",
        "fit.nc",
        "summary.csv",
        "corner.png",
        "curves.png",
        "references.bib",
    }
    fit = read(tmp_path / "fit")
    again = fitball.calibrate("wang_zero_spin.csv", model="grip-slip", seed=2, progress=False)
    assert fit == again
    assert fit.run.key == again.run.key
    assert fit.run.packages["numpy"] == np.__version__
    # Another seed gives other draws of the same posterior.
    other = fitball.calibrate("wang_zero_spin.csv", model="grip-slip", seed=3, progress=False)
    moved = fit.moved_from(other)
    assert fit != other
    assert 0.0 < max(moved.values()) < 0.5
    assert main(words) == 2
    assert read(tmp_path / "fit") == fit


def test_what_values_rest_on_depends_on_no_seed_and_needs_no_chain():
    fits = [
        fitball.calibrate("wang_all", seed=seed, point_only=seed > 1, progress=False)
        for seed in (1, 2)
    ]
    judged = [{one.name: (one.verdict, one.given) for one in fit.reported} for fit in fits]
    assert judged[0] == judged[1]
    # Table of choices: the offset rests on where it acts, friction and stiffness on more than the
    # data say.
    assert {"offset=contact", "inertia_ratio"} <= {*fits[1].parameters["eps_10"].given}
    assert fits[1].parameters["cor_10"].verdict == "identified"


def test_check_prints_every_fault_as_json(tmp_path, capsys):
    place = tmp_path / "broken.csv"
    place.write_text("v_1,theta_1,v_y2\n17,much,5\n18,200,5\n")
    assert main(["check", str(place), "--quiet"]) == 1
    assert place.name in capsys.readouterr().out
    assert main(["check", str(place), "--json"]) == 1
    faults = json.loads(capsys.readouterr().out)["frames"]["faults"]
    assert {(fault["row"], fault["column"]) for fault in faults} >= {(1, "theta_1"), (2, "theta_1")}
    assert main(["calibrate", str(place), "--out", str(tmp_path / "fit")]) == 2
    assert not (tmp_path / "fit").exists()


def test_best_values_outside_of_their_intervals_are_named(monkeypatch):
    found = [*made_fit().parameters.values()]
    assert not outside(found)
    assert not outside([*made_fit(sampled=False).parameters.values()])
    note = outside([replace(one, point=one.q975 + one.half) for one in found])[0]
    sure = ("given", "identified", "conditional")
    closed = {one.name for one in found if one.kind == "model" and one.verdict in sure}
    assert note.code == "best-outside"
    assert closed
    assert (
        {one.name for one in found if f"{one.name} (" in note.text}
        == closed
        < {one.name for one in found}
    )
    assert all(f" {one.unit})" in note.text for one in found if one.name in closed and one.unit)
    monkeypatch.setattr(
        "fitball.inference.calibrate.outside",
        lambda found: [note] * (len(found) > 5),
    )
    fit = fitball.calibrate(table_of(8), model="grip-slip", point_only=True, progress=False)
    assert fit.notes[-1] == note
