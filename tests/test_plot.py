"""Figures of a stored fit, drawn into its folder: names, formats, what is there stays."""

import threading
import time

import pytest
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball import cli
from fitball.base import files
from fitball.report.figures import FIGURES

STARTS = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fits") / "balls"
    fit_by_hand().save(folder, figures=False)
    return folder


@pytest.mark.parametrize("form", STARTS)
def test_figures_are_written_beside_the_fit(stored, capsys, form):
    before = {path: path.read_bytes() for path in stored.iterdir() if not path.name.startswith(".")}
    assert (
        cli.main(
            ["plot", str(stored / "fit.json"), "forest", "regime_map", "--format", form, "--quiet"]
        )
        == 0
    )
    written = capsys.readouterr().out.split()
    assert written == [str(stored / f"{name}.{form}") for name in ("forest", "regime_map")]
    first = [(stored / f"{name}.{form}").read_bytes() for name in ("forest", "regime_map")]
    assert all(image.startswith(STARTS[form]) for image in first)
    assert {path: path.read_bytes() for path in before} == before
    # Again, in place of the first.
    assert cli.main(["plot", str(stored), "forest", "regime_map", "--format", form]) == 0
    assert [(stored / f"{name}.{form}").read_bytes() for name in ("forest", "regime_map")] == first
    assert fitball.load_fit(stored).run.table.name == "balls"


def test_fonts_of_pdf_are_embedded_as_truetype(stored, capsys):
    assert cli.main(["plot", str(stored / "fit.json"), "forest", "--format", "pdf", "--quiet"]) == 0
    (path,) = stored.glob("forest*.pdf")
    written = path.read_bytes()
    assert b"/FontFile2" in written
    assert b"/Type3" not in written


def test_without_names_all_that_there_is_data_for(tmp_path):
    fit_by_hand(table_of(12, drop=True), sampled=False).save(tmp_path / "drop", figures=False)
    drawn = fitball.plot(tmp_path / "drop")
    assert (
        drawn.names == ("curves", "profiles", "predictive", "residuals") or "forest" in drawn.names
    )
    assert {*FIGURES} - {*drawn.names} >= {"corner", "trace", "regimes", "regime_map"}
    assert [note.code for note in drawn.notes] == ["not-drawn"]
    paths = drawn.save(tmp_path / "other")
    assert [path.name for path in paths] == [f"{name}.png" for name in drawn.names]
    assert fitball.plot(fit_by_hand(), "curves,corner").names == ("curves", "corner")


def test_a_run_that_writes_into_the_folder_is_waited_for(stored, monkeypatch):
    held = threading.Event()

    def run():
        with files.result_folder(stored):
            held.set()
            time.sleep(1.0)

    other = threading.Thread(target=run)
    other.start()
    held.wait()
    assert cli.main(["plot", str(stored), "forest", "--quiet"]) == 0
    other.join()
    monkeypatch.setattr(files, "WAIT", 0.1)
    with files.result_folder(stored):
        assert cli.main(["plot", str(stored), "forest"]) == 2


def test_a_plan_and_a_simulation_go_below_the_fit(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    fit_by_hand(model="two-mass").save("fit", figures=False)
    words = [
        "--speed",
        "15..25:2",
        "--angle",
        "20..60:2",
        "--spin",
        "0",
        "--count",
        "1",
        "--sensor",
    ]
    assert cli.main(["plan", "fit", "--target", "mu", *words, "contact_time=0.1ms", "--quiet"]) == 0
    assert cli.main(["simulate", "fit", "--impact", "v_1=20, theta_1=30", "--quiet"]) == 0
    for verb, names in (
        ("plan", "to_fill_in.csv plan.csv gains.png"),
        ("simulate", "history.csv history.png"),
    ):
        assert {*names.split(), "report.html"} <= {
            path.name for path in (tmp_path / "fit" / verb).iterdir()
        }
    assert cli.main(["simulate", "fit", "--impact", "v_1=20, theta_1=30", "--quiet"]) == 0
    assert (tmp_path / "fit" / "simulate-2" / "report.html").is_file()
    assert (
        cli.main(["simulate", "--impact", "v_1=20, theta_1=30", "--json", "--out", "by_hand"]) == 0
    )
    assert '"contact_time"' in capsys.readouterr().out
