"""Figures of a stored fit, drawn into its folder: names, formats, what is there stays."""

import re
import threading
import time
from xml.etree import ElementTree

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.text import Text
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball import cli
from fitball.base import files
from fitball.base.errors import FitballError
from fitball.inference.curves import curves_frame, equal_series
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


def test_text_of_svg_is_text_in_a_font_with_these_letters(stored, capsys):
    options = ["corner", "--parameters", "mu,cor_slope", "--format", "svg", "--quiet"]
    assert cli.main(["plot", str(stored / "fit.json"), *options]) == 0
    (path,) = stored.glob("corner*.svg")
    figure = ElementTree.fromstring(path.read_text(encoding="utf-8"))
    texts = [element for element in figure.iter() if element.tag.endswith(("text", "tspan"))]
    words = "".join("".join(element.itertext()) for element in texts)
    assert "posterior, 68 and 95 %" in words
    # Fonts of Computer Modern have other letters in the places of Unicode's.
    assert "COR\N{PRIME}" in words
    styles = " ".join(element.get("style", "") for element in texts)
    assert "DejaVu Sans" in styles
    assert not re.findall(r"'cm\w+'", styles)


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


def drawn_axes(figure):
    return [axes for axes in figure.axes if axes.get_visible()]


def test_figures_have_the_width_of_a_journal(stored):
    fit = fitball.load_fit(stored)
    for name in ("curves", "corner", "forest", "residuals"):
        figure = fit.plot(name, width="88mm")
        assert figure.get_size_inches()[0] * 25.4 == pytest.approx(88.0)
        figure.draw_without_rendering()
        sizes = [text.get_fontsize() for text in figure.findobj(Text) if text.get_text()]
        assert min(sizes) >= 6.0
        assert max(sizes) < 8.5
    (path,) = fitball.plot(fit, "curves", width="3.5in").save(stored)
    # Two dots in the place of one.
    assert plt.imread(path).shape[1] == pytest.approx(2 * 80 * 3.5, abs=1)


def test_parameters_and_columns_are_chosen():
    fit = fit_by_hand()
    assert len(drawn_axes(fit.plot("corner", parameters="mu,cor_10,court_pace"))) == 6
    assert len(drawn_axes(fit.plot("profiles", parameters=["mu"]))) == 1
    (axes,) = drawn_axes(fit.plot("curves", columns="omega_2"))
    assert "omega" in axes.get_title(loc="left")
    assert len(drawn_axes(fit.plot("residuals", columns="v_x2"))) < len(
        drawn_axes(fit.plot("residuals"))
    )
    assert fitball.plot(fit, columns="v_x2").names == ("curves", "predictive", "residuals")


def test_groups_are_drawn_at_equal_conditions():
    fit = fit_by_hand(table_of(40, surfaces=("clay", "hard", "wood")))
    grouped = equal_series(fit.problem, ["wood", "clay"])
    series, which = grouped
    assert [curve.name for curve in series] == ["wood", "clay"]
    assert len({(curve.speed, curve.spin) for curve in series}) == 1
    labels = np.array(fit.run.table.labels["surface"])
    assert [*np.unique(labels[which == 0])] == ["wood"]
    assert [*np.unique(labels[which == -1])] == ["hard"]
    lines = curves_frame(fit.problem, fit.draws, grouped)
    for number, curve in enumerate(series):
        here = lines[(lines["series"] == number) & (lines["column"] == "v_y2")]
        angle = here["along"].to_numpy()
        state = fitball.impacts(
            curve.speed * np.cos(angle), curve.speed * np.sin(angle), curve.spin
        )
        best = {name: value[0] for name, value in fit.draws.best.items()}
        values = {name.partition("[")[0]: value for name, value in best.items()}
        of_level = {
            name.partition("[")[0]: value
            for name, value in best.items()
            if name.endswith(f"[{curve.name}]")
        }
        model = fit.problem.forward.model
        known = {**values, **of_level}
        values = {name: known[name] for name in model.specs if name in known}
        rebound = model.rebound(values, state)
        np.testing.assert_allclose(here["point"], rebound.v_y2, rtol=1e-9)
    assert len(drawn_axes(fit.plot("curves", groups="wood,clay", columns="v_x2"))) == 1


def test_a_figure_of_one_panel_is_drawn_on_axes_of_the_user():
    fit = fit_by_hand()
    figure, axes = plt.subplots(1, 2)
    assert fit.plot("profiles", parameters="mu", ax=axes[0]) is figure
    assert axes[0].lines
    assert not axes[1].lines
    for name in ("curves", "corner"):
        with pytest.raises(FitballError) as caught:
            fit.plot(name, ax=axes[1])
        assert caught.value.code == "several-panels"
    plt.close(figure)


@pytest.mark.parametrize(
    ("name", "chosen", "labels"),
    [
        ("profiles", {"parameters": "mu"}, {"profile, 95 % (open ends: to the edge)"}),
        ("regimes", {}, {"grip", "slide"}),
    ],
)
def test_on_axes_of_the_user_labels_are_there_and_no_legend_is_drawn(name, chosen, labels):
    figure, (axes, alone) = plt.subplots(1, 2)
    axes.plot([0.5], [0.5], label="mine")
    fit = fit_by_hand()
    fit.plot(name, ax=axes, **chosen)
    fit.plot(name, ax=alone, **chosen)
    assert axes.get_legend() is None
    assert not figure.legends
    shown = {text.get_text() for text in axes.legend().get_texts()}
    assert labels | {"mine"} <= shown
    # What carries the labels moves no axis.
    ends = [np.ravel(one.dataLim.get_points()) for one in (axes, alone)]
    assert np.isfinite(ends).all()
    assert ends[1][2] <= ends[0][2]
    plt.close(figure)
