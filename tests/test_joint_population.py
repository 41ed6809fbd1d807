"""Tables of a batch fitted together: which can be, what is asked, and that what was fitted is kept."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import fitball
from fitball.batch import joint
from fitball.batch.joint import joint_populations, poolable, posed
from fitball.cli.main import main
from fitball.errors import FitballError
from fitball.inference.effort import Effort
from fitball.report.batch.folder import write_results
from fitball.report.batch.rows import row_of

NAMES = ("a", "b", "c", "d")


@pytest.fixture
def season(small_fit, short_fit, tmp_path, monkeypatch):
    """A batch of four tables alike, without its figure, the last of a heavier ball."""
    monkeypatch.setattr("fitball.report.batch.folder.batch_figure", lambda *_given, **_others: None)
    monkeypatch.setattr("fitball.report.batch.folder.save_figure", lambda *_given: b"")
    folder = tmp_path / "batch"
    for name in NAMES:
        (folder / name).mkdir(parents=True)
        for file in ("fit.json", "data.nc", "run.toml"):
            shutil.copy(small_fit / file, folder / name)
    text = (folder / "d" / "run.toml").read_text("utf-8")
    mass = next(line for line in text.splitlines() if line.startswith("mass = "))
    (folder / "d" / "run.toml").write_text(text.replace(mass, "mass = 0.059"), encoding="utf-8")
    write_results([row_of(name, short_fit, short_fit.problem) for name in NAMES], folder)
    return folder


def test_tables_that_differ_are_left_out_and_the_others_are_pooled_over_themselves(season):
    members, left_out = poolable(fitball.load_batch(season).rows, season)
    assert list(members) == ["a", "b", "c"]
    assert list(left_out) == ["d"] and "ball" in left_out["d"] and "0.059" in left_out["d"]
    problem = posed(members, ["mu"])
    (pooling,) = problem.pooling
    assert (pooling.parameter, pooling.labels) == ("mu", ("a", "b", "c"))
    assert len(problem.table) == 3 * len(members["a"][1])
    # One fit alone has one mu, three together a spread and a place of each besides.
    assert problem.dimension == 7 + 4
    assert problem.scene.ball.mass == members["a"][0].scene.ball.mass


@pytest.mark.parametrize(
    ("words", "said"),
    [(["k_theta/k_y"], "is a ratio"), (["spin_sd"], "unknown parameter 'spin_sd'"), ([], "are to be trusted")],
)  # fmt: skip
def test_what_no_joint_fit_has_is_refused(season, words, said):
    with pytest.raises(FitballError, match=said):
        joint_populations(fitball.load_batch(season).rows, season, (), words, Effort(cores=1))


def test_what_scenes_tell_and_no_fit_rests_on_may_differ_and_is_then_not_told_of_all(season):
    text = (season / "b" / "run.toml").read_text("utf-8")
    assert 'surface = "acrylic"' in text
    other = text.replace('surface = "acrylic"', 'surface = "clay"\nball_temperature = 31.0')
    (season / "b" / "run.toml").write_text(other, encoding="utf-8")
    members, _left_out = poolable(fitball.load_batch(season).rows, season)
    scene = posed(members, ["mu"]).scene
    assert list(members) == ["a", "b", "c"]
    assert (scene.surface, scene.ball_temperature) == (None, None)


def test_tables_measured_otherwise_than_most_are_left_out():
    table = fitball.load_table("wang_zero_spin")
    angles = replace(table, measurements=(*(item for item in table.redundant), table.measurement("omega_2")))
    stated = [replace(item, sd=0.1 * np.ones(len(table))) for item in table.measurements]
    fewer = replace(table, measurements=table.measurements[:2])
    tables = {"a": table, "polar": angles, "b": table, "fewer": fewer, "sds": replace(table, measurements=stated)}
    tables = {name: replace(table, name=name) for name, table in tables.items()}
    odd = joint._measured_otherwise(tables)
    assert list(odd) == ["polar", "sds"]
    assert "told in different ways" in odd["polar"] and "stated sd" in odd["sds"]


def test_who_is_left_out_of_a_population_is_left_out_of_the_joint_fit(season):
    weighted = (SimpleNamespace(name="mu", left_out={"a": "it has no one surface"}),)
    with pytest.raises(FitballError, match="2 tables can be fitted together"):
        joint_populations(fitball.load_batch(season).rows, season, weighted, ["mu"], Effort(cores=1))


def test_batches_without_measurements_and_too_few_tables_are_refused(season):
    rows = fitball.load_batch(season).rows
    with pytest.raises(FitballError, match="2 tables can be fitted together, expected at least 3; d: other settings"):
        poolable([row for row in rows if row["table"] != "a"], season)
    (season / "b" / "data.nc").unlink()
    with pytest.raises(FitballError, match="b: of an older batch"):
        poolable(rows, season)


def test_a_joint_fit_stands_beside_the_weighted_one_and_is_kept(season, capsys, brief, monkeypatch):
    words = ["population", str(season), "--of", "mu", "--joint", "--max-steps", "100", "--cores", "1"]
    main([*words, "--json"])
    told = json.loads(capsys.readouterr().out)
    one, both = told["quantities"]["mu"], told["joint"]["mu"]
    assert list(both["left_out"]) == ["d"] and both["tables"] == 3 and one["tables"] == 4
    # The same tables thrice: both ways find what each of them says, the spread as small as its prior lets it.
    assert both["centre"]["q025"] < one["centre"]["median"] < both["centre"]["q975"]
    (fitted,) = [place for place in season.iterdir() if place.name.startswith("joint_")]
    assert fitball.load_fit(fitted).levels

    def again(*_given, **_others):
        raise AssertionError("fitted again")

    monkeypatch.setattr(joint, "begin", again)
    main(words)
    said = capsys.readouterr().out
    assert "mu (joint fit)" in said and "Not in the joint fit: d: other settings" in said
    assert "did not converge: more than 100 steps go on with it" in said
    assert "mu (joint fit)" in (season / "batch.html").read_text("utf-8")


@pytest.mark.parametrize("text", [b"\xff\xfe", b"", b"x" * 10_000])
def test_a_joint_fit_whose_mark_is_damaged_is_begun_anew(season, text, monkeypatch):
    place = season / "joint_mu"
    place.mkdir()
    (place / "begun.txt").write_bytes(text)
    asked = []

    def begin(*_given, overwrite, resume):
        asked.append((overwrite, resume))
        raise FitballError("begun")

    monkeypatch.setattr(joint, "begin", begin)
    with pytest.raises(FitballError, match="begun"):
        fitball.load_batch(season).population("mu", joint=True, cores=1, max_steps=100)
    assert asked == [(True, False)]
