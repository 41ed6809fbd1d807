"""From a table to a page: by the command line and in Python."""

import json

import numpy as np
import pytest
from msgspec.structs import replace
from support.fit_by_hand import TRUTH, fit_by_hand, table_of

import fitball
from fitball.cli import main
from fitball.inference.assemble import notes_of_best_outside
from fitball.saved.files_of_fit import read


def test_a_table_of_the_model_itself_gives_its_parameters(tmp_path):
    table_of(scatter=0.0).to_csv(tmp_path / "balls.csv", index=False)
    fit = fitball.calibrate(
        tmp_path / "balls.csv",
        model="grip-slip",
        # That of the model, not of a ball of which nothing is stated.
        fix={"inertia_ratio": 0.56},
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
    names = {path.name for path in (tmp_path / "fit").iterdir()}
    assert names >= {
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
    sampled = fitball.calibrate("wang_all", seed=1, progress=False)
    point = fitball.calibrate("wang_all", seed=2, point_only=True, progress=False)

    def verdicts(fit):
        return {estimate.name: (estimate.verdict, estimate.given) for estimate in fit.reported}

    assert verdicts(sampled) == verdicts(point)
    # Table of choices: the offset rests on where it acts, friction and stiffness on more than the
    # data say.
    assert {"offset=contact", "inertia_ratio"} <= {*point.parameters["eps_10"].given}
    assert point.parameters["cor_10"].verdict == "identified"


def test_check_prints_every_fault_as_json(tmp_path, capsys):
    path = tmp_path / "broken.csv"
    path.write_text("v_1,theta_1,v_y2\n17,much,5\n18,200,5\n")
    assert main(["check", str(path), "--quiet"]) == 1
    assert path.name in capsys.readouterr().out
    assert main(["check", str(path), "--json"]) == 1
    faults = json.loads(capsys.readouterr().out)["frames"]["faults"]
    places = {(fault["row"], fault["column"]) for fault in faults}
    assert places >= {(1, "theta_1"), (2, "theta_1")}
    assert main(["calibrate", str(path), "--out", str(tmp_path / "fit")]) == 2
    assert not (tmp_path / "fit").exists()


def test_best_values_outside_of_their_intervals_are_named(monkeypatch):
    estimates = [*fit_by_hand().parameters.values()]
    assert not notes_of_best_outside(estimates)
    assert not notes_of_best_outside([*fit_by_hand(sampled=False).parameters.values()])
    far = [replace(estimate, point=estimate.q975 + estimate.half) for estimate in estimates]
    note = notes_of_best_outside(far)[0]
    assert note.code == "best-outside"
    named = set()
    closed = set()
    for estimate in estimates:
        if f"{estimate.name} (" in note.text:
            named.add(estimate.name)
        sure = estimate.verdict in ("given", "identified", "conditional")
        if estimate.kind == "model" and sure:
            closed.add(estimate.name)
            if estimate.unit:
                assert f" {estimate.unit})" in note.text
    assert closed
    assert named == closed
    assert closed < {estimate.name for estimate in estimates}

    def always_outside(estimates):
        assert len(estimates) > 5
        return [note]

    monkeypatch.setattr("fitball.inference.calibrate.notes_of_best_outside", always_outside)
    fit = fitball.calibrate(table_of(8), model="grip-slip", point_only=True, progress=False)
    assert fit.notes[-1] == note
