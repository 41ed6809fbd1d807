"""The study of films: a few replicates, their controls, and what its verdict refuses."""

import copy

import numpy as np
import pytest
from validation import tracks as study
from validation.command import main

FILMS = (5, 19, 33)


@pytest.fixture(scope="module")
def made():
    """Three sessions of eight impacts at 1000 frames/s, with their controls."""
    return [study.replicate(1, number) for number in FILMS]


def test_intervals_hold_and_lines_are_ten_times_worse(made):
    rows = [one for record in made for row in record if row["kind"] == "film" for one in row["impacts"]]
    z = np.abs([[np.nan if value is None else value for value in one["z"]] for one in rows])
    assert len(rows) == 24 and np.isfinite(z).all()
    assert 0.5 < np.mean(z < 1.0) < 0.85 and np.mean(z < 1.96) > 0.87
    assert all(one["sure"] and one["right"] for one in rows)
    lines, sds = np.array([one["lines"] for one in rows]), np.array([one["sd"] for one in rows])[:, [0, 1, 3, 4]]
    assert np.sqrt(np.mean(lines**2)) > 5.0 * np.sqrt(np.mean(sds**2))


def test_controls_fail_as_geometry_and_air_say(made):
    still = [one["z"] for record in made for row in record if row["kind"] == study.STILL for one in row["impacts"]]
    assert np.mean(np.abs([[one[0], one[1], one[4]] for one in still]) < 1.0) < 0.4
    shifts = [ratio for record in made for row in record if row["kind"] == study.HIGHER for ratio in row["ratios"]]
    assert np.median(shifts) == pytest.approx(1.0, abs=0.02)


def test_a_film_is_fitted_and_lines_have_no_stiffness():
    (row,) = study.replicate(1, 13)
    assert row["kind"] == "fit" and not row["failed"] and row["rows"] >= 18
    assert row["found"]["k_y"]["sd"] < 0.06 and abs(row["found"]["k_y"]["off"]) < 5.0 * row["found"]["k_y"]["sd"]
    assert set(row["found"]) == set(study.FITTED) and "k_y" not in row["lines"]


def spoiled(made, change):
    records = copy.deepcopy(made)
    for record in records:
        for row in record:
            change(row)
    return study.judge(records * 12, 1)


def narrow(row):
    for one in row.get("impacts", ()):
        one["z"] = [None if value is None else 2.0 * value for value in one["z"]]


def wrong_turns(row):
    for one in row.get("impacts", ()):
        one["right"] = False


def unsure(row):
    for one in row.get("impacts", ()):
        one["sure"] = False


def still_as_well(row):
    if row["kind"] == study.STILL:
        for one in row["impacts"]:
            one["z"] = [0.5 for _ in one["z"]]


def lower(row):
    if row["kind"] == study.HIGHER:
        row["ratios"] = [0.9 * ratio for ratio in row["ratios"]]


def test_verdict_holds_for_these(made):
    assert study.judge(made, 1).content["holds"]


@pytest.mark.parametrize("change", [narrow, wrong_turns, unsure, still_as_well, lower])
def test_verdict_refuses(made, change):
    assert not spoiled(made, change).content["holds"]


def test_command_writes_and_goes_on(tmp_path, capsys):
    arguments = ["--tracks", "--replicates", "2", "--out", str(tmp_path), "--cores", "1", "--quiet"]
    assert main(arguments) in (0, 1)
    first = (tmp_path / "tracks.jsonl").read_bytes()
    assert main(arguments) in (0, 1) and (tmp_path / "tracks.jsonl").read_bytes() == first
    assert (tmp_path / "tracks.md").exists() and (tmp_path / "coverage.csv").exists()
    assert "Intervals of impacts" in capsys.readouterr().out
