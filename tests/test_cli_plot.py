"""`fitball plot`: the same figures from files as from the run, and every fault in words."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from samples import same_values, save_without_figures

import fitball
from fitball.cli.main import main
from fitball.cli.options import FORMATS
from fitball.inference.results.evidence import (
    ActiveImpacts,
    Eigendirections,
    End,
    Evidence,
    Identifiability,
    InformationEvidence,
    Profile,
)
from fitball.report.figures.canvas import STAMPS
from fitball.report.figures.evidence import profile_panels
from fitball.report.figures.predictions import OTHERS, regime_bars, regime_colours
from fitball.report.figures.registry import FIGURES, drawable_kinds
from fitball.report.fit.document import fit_document
from fitball.report.form.numbers import handy
from fitball.report.form.palette import FAINT
from fitball.report.saved.structure import plain, structured


@pytest.fixture(scope="module")
def point_folder(tmp_path_factory):
    point = fitball.calibrate("wang_zero_spin.csv", model="grip-slip", point_only=True, cores=1)
    return save_without_figures(point, tmp_path_factory.mktemp("point") / "fit")


def test_an_open_profile_is_read_back_open():
    """Left and right are not the same."""
    profile = Profile(
        "mu", np.array([0.5, 5.0]), np.array([2.5, 0.0]), 5.0, (0.7, None), (0.6, None), (End.CLOSED, End.BOUND),
        ((), ("k_y",)), 1,
    )  # fmt: skip
    action = ActiveImpacts(("a",), 1, 2, ("grip",), ("b",), 1, 0.25)
    evidence = Evidence(profile, None, InformationEvidence(None, 2.0, 0.5, 0.4), None, None, action)
    identifiability = Identifiability({"mu": evidence}, Eigendirections((), (), ("mu",)), "", 0.87)
    read = structured(Path("fit.json"), plain(identifiability), Identifiability)
    same_values(read.evidence["mu"], evidence)
    assert read.profile_coverage == 0.87
    assert read.eigendirections == identifiability.eigendirections


def test_kinds_and_formats_are_the_ones_promised(short_fit):
    assert all(
        callable(kind.function(f"{name}_{what}")) for name, kind in FIGURES.items() for what in ("figure", "words")
    )
    assert {text.section for text in FIGURES.values()} <= {"", *(it.name for it in fit_document(short_fit).sections)}
    assert ("png", *STAMPS) == FORMATS


@pytest.mark.parametrize("form", ["svg", "pdf"])
def test_other_formats_are_written_whole_and_twice_the_same(small_fit, tmp_path, form):
    for name in ("a", "b"):
        command = ["plot", str(small_fit), "profiles", "--format", form, "--out", str(tmp_path / name), "--quiet"]
        assert main(command) == 0
    first = (tmp_path / "a" / f"profiles.{form}").read_bytes()
    assert first == (tmp_path / "b" / f"profiles.{form}").read_bytes()
    assert first.startswith(b"%PDF" if form == "pdf" else b"<?xml")


def test_a_point_fit_shows_what_it_has(point_folder, tmp_path, capsys):
    assert main(["plot", str(point_folder), "all", "--out", str(tmp_path)]) == 0
    captured = capsys.readouterr()
    drawn = {item.stem for item in tmp_path.iterdir()}
    assert drawn == {"sketch", "predictive", "curves", "forest", "profiles", "residuals"}
    assert all(kind in captured.err for kind in ("regimes", "corner", "trace"))
    for kind in ("corner", "trace", "regimes"):
        assert main(["plot", str(point_folder), kind]) == 2
        assert "needs a posterior; run calibrate without --point-only" in capsys.readouterr().err


def test_a_drop_test_has_no_regimes(tmp_path, capsys, monkeypatch, brief):
    monkeypatch.chdir(tmp_path)
    rows = "\n".join(f"{v},{v * (0.86 - 0.012 * v) + 0.1 * (-1) ** v:.3f}" for v in (3, 5, 6, 8, 9, 11))
    (tmp_path / "drop.csv").write_text(f"v_y1,v_y2\n{rows}\n", encoding="utf-8")
    assert main(["calibrate", "drop.csv", "--model", "brody", "--max-steps", "100", "--out", "fit", "--quiet"]) == 1
    assert "regimes" not in drawable_kinds(fitball.load_fit("fit"))
    assert main(["plot", "fit", "regimes"]) == 2
    assert "there are no regimes" in capsys.readouterr().err
    assert main(["plot", "fit", "profiles"]) == 0


def test_profiles_that_are_not_stored_are_computed(point_folder, tmp_path, capsys):
    place = tmp_path / "fit.json"
    content = json.loads((point_folder / "fit.json").read_text(encoding="utf-8"))
    kept = content["identifiability"]["evidence"]["mu"]["profile"]["interval_95"]
    for evidence in content["identifiability"]["evidence"].values():
        evidence["profile"] = None
    place.write_text(json.dumps(content), encoding="utf-8")
    for name in ("data.nc", "run.toml"):
        shutil.copy(point_folder / name, tmp_path)
    assert main(["plot", str(place), "profiles"]) == 0
    assert "has no profiles" in capsys.readouterr().err
    assert (tmp_path / "profiles.png").stat().st_size > 0
    content["identifiability"]["profiles_missing"] = "the noise falls to its bound"
    place.write_text(json.dumps(content), encoding="utf-8")
    assert main(["plot", str(place), "profiles"]) == 2
    assert "there are no profiles: the noise falls to its bound" in capsys.readouterr().err
    assert len(kept) == 2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda here: ["plot", str(here), "cornr"], ["unknown figure 'cornr'", "did you mean 'corner'"]),
        (lambda here: ["plot", str(here), "corner", "--format", "pgn"], ["unknown format 'pgn': did you mean 'png'"]),
        (lambda here: ["plot", str(here / "nowhere.json"), "corner"], ["no such file"]),
        (lambda here: ["plot", str(here / "run.toml"), "corner"], ["not readable as JSON"]),
        (lambda here: ["plot", str(here), "corner", "--out", str(here / "fit.json")], ["is a file; name a folder"]),
    ],
)
def test_faults_end_with_two_and_words(small_fit, capsys, change, words):
    assert main(change(small_fit)) == 2
    err = capsys.readouterr().err
    for word in words:
        assert word in err, err
    assert "Traceback" not in err


def test_missing_damaged_and_older_files(small_fit, tmp_path, capsys):
    here = tmp_path / "fit"
    here.mkdir()
    for name in ("fit.json", "data.nc", "run.toml"):
        shutil.copy(small_fit / name, here)
    old = json.dumps(json.loads((small_fit / "fit.json").read_text(encoding="utf-8")) | {"schema_version": 1})
    for spoil, said in (
        (lambda: None, "posterior.nc: no such file"),
        (lambda: (here / "posterior.nc").write_bytes(b"nothing"), "posterior.nc: not the posterior draws"),
        (lambda: (here / "data.nc").write_bytes((here / "data.nc").read_bytes()[:-100]), "data.nc: not the meas"),
        ((here / "data.nc").unlink, "data.nc: no such file"),
        ((here / "run.toml").unlink, "run.toml: no such file"),
        (lambda: (here / "fit.json").write_text(old, "utf-8"), "reads version 8: run calibrate again"),
    ):
        spoil()
        assert main(["plot", str(here), "corner"]) == 2
        assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new"), [("seed = 4", "seed = 5"), ("mass = 0.05", "mass = 0.06"), ('mu = "normal(', 'mu = "lognormal(')]
)
def test_a_run_of_another_fit_is_refused(small_fit, tmp_path, capsys, old, new):
    here = tmp_path / "fit"
    shutil.copytree(small_fit, here)
    text = (here / "run.toml").read_text(encoding="utf-8")
    assert old in text
    (here / "run.toml").write_text(text.replace(old, new), encoding="utf-8")
    assert main(["plot", str(here), "residuals"]) == 2
    assert "run.toml: this run is another than that of the fit.json beside it" in capsys.readouterr().err


def test_a_run_that_takes_the_errors_otherwise_is_told_by_the_likelihood(tmp_path, capsys):
    rows = "15,5,10,4,0.2\n12,9,8,7,0.2\n9,12,6,9,0.3\n"
    (tmp_path / "balls.csv").write_text(f"v_x1,v_y1,v_x2,v_y2,v_x1_sd\n{rows}", encoding="utf-8")
    fit = fitball.calibrate(tmp_path / "balls.csv", model="brody", point_only=True, cores=1)
    folder = save_without_figures(fit, tmp_path / "fit")
    assert main(["plot", str(folder), "residuals"]) == 0
    text = (folder / "run.toml").read_text(encoding="utf-8")
    changed = text.replace("incident_errors = true", "incident_errors = false")
    assert changed != text
    (folder / "run.toml").write_text(changed, encoding="utf-8")
    assert main(["plot", str(folder), "residuals"]) == 2
    assert "run.toml: this run is another" in capsys.readouterr().err


def test_panels_show_the_profiles_in_handy_units(short_fit, point_fit):
    fit, panels = short_fit, dict(zip(point_fit.identifiability.evidence, profile_panels(point_fit), strict=True))
    evidence, panel = point_fit.identifiability.evidence["k_y"], panels["k_y"]
    np.testing.assert_allclose(panel.values, evidence.profile.values * handy("k_y", "N/m").factor)
    np.testing.assert_allclose(panel.log_likelihood, -evidence.profile.drop)
    assert panel.axis.label.endswith("[kN/m]")
    # The curve crosses the level where the interval ends.
    for end in evidence.profile.interval_95:
        assert np.interp(1e-3 * end, *panel.curve) == pytest.approx(-1.9207, abs=0.01)
    # Without the scene nothing ties k_y down; friction does not care.
    assert np.ptp(panel.curve_alone[1]) < 0.01
    assert panels["mu"].curve_alone.shape == (2, 0)
    assert panels["mu"].posterior is None
    sampled = dict(zip(fit.identifiability.evidence, profile_panels(fit), strict=True))
    low, high = np.quantile(fit.posterior.draws[:, fit.posterior.names.index("mu")], (0.025, 0.975))
    assert sampled["mu"].posterior == pytest.approx((low, high))
    assert sampled["mu"].span[0] < low < high < sampled["mu"].span[1]


def test_bars_are_the_probabilities(short_fit):
    fit = short_fit
    bars = regime_bars(fit, fit.predictive)
    np.testing.assert_allclose(bars.shares.sum(axis=1), 1.0)
    assert bars.labels[0] == "zero-1  4.8 m/s, 17°"
    named = dict(zip(bars.regimes, bars.shares[1], strict=True))
    for name, share in fit.predictive.regimes[1].items():
        if name in named:
            assert named[name] == pytest.approx(share)
    assert regime_colours(["slide", OTHERS])[1] == FAINT
    assert regime_colours(["slide"]) == regime_colours(["slide", "hold"])[:1]
    assert len(set(regime_colours(["slide", "hold", "grip-hold", "slide-grip"]))) == 4
