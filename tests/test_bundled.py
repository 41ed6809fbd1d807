"""Bundled files: found by name, physically sound, published priors with their sources."""

import os
import tomllib

import numpy as np
import pytest

import fitball
from fitball.base.errors import FolderError, ParameterError
from fitball.base.priors import ParameterSpec
from fitball.data.bundled import descriptions, path_of_source, published_prior, published_priors


def test_a_file_that_exists_wins_over_a_bundled_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    inside = path_of_source("wang_all.csv")
    assert inside == path_of_source("wang_all")
    assert inside.is_absolute()
    (tmp_path / "wang_all.csv").write_text("own")
    assert path_of_source("wang_all.csv").read_text() == "own"
    assert path_of_source("wang_all") == inside
    if hasattr(os, "mkfifo"):
        os.mkfifo("pipe")
        assert path_of_source("pipe").name == "pipe"


@pytest.mark.parametrize(
    "source",
    ["wang_al", "folder", "a" * 5000, "tracks/table_tennis_topspin", "../wang_all"],
)
def test_what_is_nowhere(source, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    with pytest.raises(FolderError) as caught:
        path_of_source(source)
    assert caught.value.code == "not-found"
    assert len(str(caught.value)) < 600


def test_a_folder_of_tables_names_what_to_pass(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lots").mkdir()
    (tmp_path / "lots" / "lot-01.csv").write_text("v_y1,v_y2\n5,4\n")
    with pytest.raises(FolderError, match=r"name its tables, lots/\*\.csv$"):
        path_of_source("lots/")


def test_every_table_has_a_scene_that_describes_it():
    by_name = descriptions()
    assert {"wang_all", "synthetic_gaps", "synthetic_court", "synthetic_drop"} < {*by_name}
    assert all(by_name.values())
    assert [*descriptions("tracks")] == ["four_throws", "table_tennis_topspin"]
    # Of others, by its licence.
    path = path_of_source("table_tennis_topspin", "tracks")
    assert path.with_suffix(".LICENSE").is_file()


@pytest.mark.parametrize(
    ("ball", "limits"),
    [
        ("itf-type-1", (1.38, 1.51)),
        ("itf-type-2", (1.35, 1.47)),
        ("itf-high-altitude", (1.22, 1.35)),
    ],
)
def test_restitutions_of_ball_types_are_those_of_their_rebounds(ball, limits):
    """Rebounds from 254 cm through air: the middle of the range, less what 10 m/s take away."""
    spec = ParameterSpec("cor_10", "", 0.01, 1.0, "normal(0.75, 0.15)", "restitution", "")
    prior = published_prior(spec, f"literature:{ball}")
    braking = 0.55 * 1.2 * np.pi * 0.03302**2 / 0.0576
    fall = 1.0 - np.exp(-2.54 * braking)
    low, high = (np.sqrt((np.exp(braking * limit) - 1.0) / fall) for limit in limits)
    assert f"{low:.3f} to {high:.3f}" in prior.source
    assert 0.0 <= 0.5 * (low + high) - prior.location < 0.01


def test_priors_of_the_literature():
    spec = ParameterSpec("mu", "", 0.01, 2.0, "lognormal(0.5, 0.5)", "friction", "")
    prior = published_prior(spec, "literature:Clay")
    assert prior.location == 0.73
    assert prior.width == 0.10
    assert prior.lower == 0.01
    assert prior.upper == 2.0
    assert "Carre" in prior.source
    spread = ParameterSpec("mu_spread", "", 0.0, 2.0, "half-t(0.2, 4)", "spread", "")
    assert published_prior(spread, "surface").width == 0.2
    assert published_prior(spread, "place").numbers[1] == 4.0
    for row in published_priors():
        assert row["source"]
        assert row["note"]
    for name, key in (
        ("mu", "literature:clya"),
        ("offset", "clay"),
        ("mu", ""),
    ):
        spec = ParameterSpec(name, "", 0.0, 1.0, "uniform(0, 1)", "", "")
        with pytest.raises(ParameterError) as caught:
            published_prior(spec, key)
        assert caught.value.code == "unknown-key"


def test_every_published_prior_can_be_used():
    for row in published_priors():
        spec = ParameterSpec(row["parameter"], "", 1e-6, 1e6, "uniform(0, 1)", "", "")
        prior = published_prior(spec, f"literature:{row['key']}")
        middle = prior.quantile(np.array([0.5])).item()
        value = float(row["value"])
        assert 0.5 * value < middle < 1.5 * value


def test_the_scene_of_the_bundled_film_states_the_inertia_that_made_it():
    path = path_of_source("four_throws", "tracks").with_suffix(".toml")
    stated = tomllib.loads(path.read_text(encoding="utf-8"))["ball"]
    # `scripts/bundled_film.py` bounces this model.
    assert stated["inertia_ratio"] == fitball.model("two-mass").ball.inertia_ratio
