"""`fitball simulate`: files and numbers, bands of a fit, figures, and every misuse in one line."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

import fitball
from fitball.cli.main import main
from fitball.inference.prediction.simulate import POINTS, chosen_parameters, simulate, simulate_fit
from fitball.inference.results.fitted_model import FittedModel
from fitball.models.specs import SPECS
from fitball.report.history.document import render
from fitball.report.history.figure import ALL_PANELS, DRAWN, LABELS, history_figure
from fitball.report.saved.fit_file import fit_text
from fitball.thesis.examples import EXAMPLES

DEFAULTS = {name: spec.typical for name, spec in SPECS.items() if spec.typical is not None}
IMPACT = "v=38 mph, theta=18 deg, spin=950 rpm top"


@pytest.mark.slow
def test_one_impact_to_files_and_json(tmp_path, capsys):
    out, table = tmp_path / "one", tmp_path / "courses.csv"
    assert main(["simulate", "--impact", IMPACT, "--out", str(out), "--json", "--csv", str(table)]) == 0
    said = capsys.readouterr()
    assert "k_y = 20000" in said.err
    (told,) = json.loads(said.out)["simulations"]
    speed, angle, spin = 38.0 * 0.44704, np.radians(18.0), 950.0 * np.pi / 30.0
    impact = fitball.impacts(speed * np.cos(angle), speed * np.sin(angle), spin)
    model = fitball.model("two-mass")
    rebound = model.rebound({name: DEFAULTS[name] for name in model.parameter_names}, impact)
    assert told["rebound"]["v_x2"] == pytest.approx(rebound.v_x2[0], rel=1e-12)
    assert told["rebound"]["v_y2"] == pytest.approx(rebound.v_y2[0], rel=1e-12)
    assert told["rebound"]["omega_2"] == pytest.approx(rebound.omega_2[0], rel=1e-12)
    assert told["regime"] == fitball.regime_name(rebound.regime[0]) == "slide"
    assert told["phases"][-1]["end"] == told["contact_time"] == rebound.contact_time[0]
    assert told["gaps"] == {name: getattr(rebound, name)[0] for name in ("gap_time", "gap_path", "gap_turn")}
    assert {item.name for item in out.iterdir()} == {"history.png", "history.csv", "simulate.json"}
    assert json.loads((out / "simulate.json").read_text()) == json.loads(said.out)
    assert table.read_bytes() == (out / "history.csv").read_bytes()
    rows = pd.read_csv(table)
    assert len(rows) == POINTS and set(rows["phase"]) == {"slide"}
    exact = model.history(told["parameters"], impact, rows["time [s]"].to_numpy())
    np.testing.assert_allclose(rows["friction_force [N]"], exact.friction_force, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(rows["omega_1 [rad/s]"], exact.omega_1, rtol=1e-12)


def test_a_result_is_not_overwritten_unless_asked_and_repeats_to_the_byte(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command = ["simulate", "--example", "fig26", "--quiet", "--format", "svg"]
    assert main(command) == 0
    places = capsys.readouterr().out.split()
    assert places[0] == "fits/simulations/fig26/history.svg"
    first = [(tmp_path / place).read_bytes() for place in places]
    assert main(command) == 2
    assert "use --overwrite" in capsys.readouterr().err
    assert main([*command, "--overwrite"]) == 0
    assert [(tmp_path / place).read_bytes() for place in places] == first
    # No figure of an older result stays beside a newer one.
    assert main([*command[:-1], "pdf", "--overwrite"]) == 0
    names = {item.name for item in (tmp_path / "fits" / "simulations" / "fig26").iterdir()}
    assert names == {"history.pdf", "history.csv", "simulate.json"}


def test_the_table_says_when_and_what(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "--impact", "v_x=12, v_y=10, spin=50"]) == 0
    said = capsys.readouterr().out
    assert "fits/simulations/two-mass_12_10_50/history.png" in said
    found = simulate(
        fitball.model(), chosen_parameters(fitball.model(), {}), fitball.impacts(12.0, 10.0, 50.0)
    ).history
    assert f"phases: {found.regime_name}" in said
    for span in found.spans:
        assert f"{1e3 * span.end:.4f}" in said and f"{span.end_share:.4f}" in said
    assert f"{found.peak_force.value:.1f} N" in said and f"{1e3 * found.peak_compression.value:.2f} mm" in said
    assert "stops the shell at once" in said
    between = fitball.model().rebound(chosen_parameters(fitball.model(), {}), fitball.impacts(12.0, 10.0, 50.0))
    lines = [" ".join(line.split()) for line in said.splitlines()]
    assert f"time between the flights {1e3 * between.gap_time[0]:.3f} ms" in lines
    assert f"path between the flights {1e3 * between.gap_path[0]:.2f} mm" in lines
    assert f"turn between the flights {np.degrees(between.gap_turn[0]):.2f} deg" in lines


MISUSE = [
    (["--impact", "v=17, theta=18", "--set", "k_thet=3"], "did you mean 'k_theta'?"),
    (["--impact", "v=17, theta=18", "--set", "mu=9"], "mu = 9: expected a value within [0, 5]"),
    (["--impact", "v=17, theta=18", "--set", "mu"], "expected NAME=VALUE"),
    (["--impact", "v=17, theta=18", "--set", "mu=much"], "expected a number in SI units"),
    (["--impact", "v=17, theta=18", "--set", "mu=1", "--set", "mu=2"], "given twice"),
    (["--impact", "v=17, theta=18", "--set", "mass_ratio=0.5"], "exceeds mass_ratio"),
    (["--impact", "v_x=17, v_y=-3"], "positive speed v_y towards the court"),
    (["--impact", "v=17, theta=0"], "between 0 and 180 deg"),
    (["--impact", "v=17 lb, theta=18"], "is ambiguous: write lbf"),
    (["--impact", "v=17 glops, theta=18"], "unknown"),
    (["--impact", "v=17, theta=18", "--model", "brody"], "models with a history: two-mass, thesis-exact"),
    (["--impact", "v=17, theta=18", "--model", "grip-slip"], "no time axis"),
    (["--impact", "v=17, theta=18", "--model", "thesis"], "model thesis has no history"),
    (["--impact", "v=17, theta=18", "--model", "two-mas"], "did you mean 'two-mass'?"),
    (["--impact", "v=17, theta=18", "--model", "two-mass+torsion=stiff"], "closure torsion"),
    (["--impact", "v=17, theta=18", "--format", "jpg"], "unknown format 'jpg'"),
    (["--impact", "v=17, theta=18", "--fit", "nowhere", "--set", "mu=1"], "leave out --model and --set"),
    (["--impact", "v=17, theta=18", "--fit", "nowhere"], "no such file"),
    (["--map", "v=17", "--model", "brody", "--contours", "gap_turn"], "model brody does not compute it"),
    (["--example", "fig7"], "unknown example 'fig7'"),
    (["--example", "fig8", "--impact", "v=17, theta=18"], "leave out --impact"),
    ([], "simulate needs an impact"),
]


@pytest.mark.parametrize(("words", "said"), MISUSE, ids=[" ".join(words) for words, _ in MISUSE])
def test_misuse_is_one_line_and_leaves_nothing(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "--quiet", *words]) == 2
    heard = capsys.readouterr()
    assert said in heard.err and heard.err.startswith("fitball: ") and heard.err.count("\n") == 1
    assert heard.out == "" and list(tmp_path.iterdir()) == []


def fitted(draws=60):
    model = fitball.model("two-mass")
    rng = np.random.default_rng(5)
    names = (*model.parameter_names, "velocity_sd")
    point = np.array([DEFAULTS.get(name, 0.4) for name in names])
    spread = point * (1.0 + 0.03 * rng.standard_normal((draws, len(names))))
    # One draw without a solution: a restitution beyond its mass ratio.
    if draws:
        spread[0, names.index("mass_ratio")] = 0.5
    return FittedModel(
        "two-mass", model.options, fitball.Ball(), True, names, point, spread, fitball.impacts(12.0, 9.0)
    )


def test_bands_are_the_quantiles_of_the_draws():
    made, impact = fitted(), fitball.impacts(12.0, 10.0, 50.0)
    found = simulate_fit(made, impact, draws=60)
    assert (found.band.draws, found.band.failed) == (59, 1)
    share = found.shares[123]
    spins, contacts, paths = [], [], []
    for row in made.draws[1:]:
        values = dict(zip(made.model.parameter_names, row, strict=False))
        rebound = made.model.rebound(values, impact)
        contact = float(rebound.contact_time[0])
        paths.append(float(rebound.gap_path[0]))
        spins.append(float(made.model.history(values, impact, share * contact).omega_2[0]))
        contacts.append(contact)
    np.testing.assert_allclose(
        found.band.quantiles["omega_2"][:, 123], np.quantile(spins, (0.025, 0.16, 0.5, 0.84, 0.975))
    )
    np.testing.assert_allclose(found.band.contact_time, np.quantile(contacts, (0.025, 0.16, 0.5, 0.84, 0.975)))
    np.testing.assert_allclose(found.band.gaps["gap_path"], np.quantile(paths, (0.025, 0.16, 0.5, 0.84, 0.975)))
    low, high = 1e3 * found.band.gaps["gap_path"][[0, -1]]
    assert f"95 %: {low:.2f} to {high:.2f} mm" in render([found])
    assert sum(found.band.regimes.values()) == pytest.approx(1.0)
    assert simulate_fit(made, impact, draws=10).band.draws <= 10
    assert simulate_fit(fitted(0), impact).band is None
    for row, share in ((30, 0.5), (31, 31 / 60), (60, 1.0)):
        hopeless = made.draws.copy()
        hopeless[:row, 0] = 0.5
        some = simulate_fit(made.with_draws(made.names, hopeless), impact, draws=60)
        assert some.unsolved == pytest.approx(share)
        # No bands of a minority of the draws; the report has the share.
        assert (some.band is None) == (share > 0.5)
        text = " ".join(render([some]).split())
        assert f"{100 * share:.0f} %" in text
        assert ("no bands" in text) == (share > 0.5) and (f"{row} more" in text) == (share <= 0.5)


def test_from_a_fit_at_the_command_line(tmp_path, capsys):
    # All but the friction is held, so that the fit costs little.
    fix = {name: DEFAULTS[name] for name in fitball.model().parameter_names if name != "mu"}
    fit = fitball.calibrate("wang_topspin.csv", model="two-mass", point_only=True, cores=1, fix=fix)
    folder = tmp_path / "fit"
    folder.mkdir()
    (folder / "fit.json").write_text(fit_text(fit))
    command = ["simulate", "--impact", "v=17, theta=42, spin=100", "--fit", str(folder), "--json"]
    assert main([*command, "--out", str(tmp_path / "point")]) == 0
    said = capsys.readouterr()
    assert "without bands" in said.err and json.loads(said.out)["simulations"][0]["posterior"] is None
    fit = fitball.calibrate("wang_topspin.csv", model="two-mass", cores=1, fix=fix, max_steps=100, walkers=8)
    (folder / "fit.json").write_text(fit_text(fit))
    assert main([*command, "--out", str(tmp_path / "bands"), "--draws", "20"]) == 0
    said = capsys.readouterr()
    (told,) = json.loads(said.out)["simulations"]
    assert told["posterior"]["draws"] == 20
    notes = json.loads(said.out)["notes"]
    assert said.err == "".join(f"note: {note}\n" for note in notes)
    assert any("k_y, which is fixed" in note for note in notes)
    far = ["simulate", "--impact", "v=120, theta=42, spin=100", "--fit", str(folder), "--out", str(tmp_path / "far")]
    assert main(far) == 2 and "(0, 1]" in capsys.readouterr().err
    far[2] = "v=25, theta=42, spin=100"
    assert main([*far, "--format", "svg"]) == 0
    assert "outside the range of the fitted data: v_y1" in capsys.readouterr().err
    rows = pd.read_csv(tmp_path / "bands" / "history.csv")
    low, high = rows["v_x_q025 [m/s]"], rows["v_x_q975 [m/s]"]
    assert (low <= rows["v_x [m/s]"] + 0.1).all() and (high >= rows["v_x [m/s]"] - 0.1).all() and (high > low).all()
    assert told["parameters"]["mu"] == pytest.approx(fit.parameters["mu"].point)


# What each panel has to draw of a history, in the order drawn.
EXPECTED = {
    "y": lambda h: [1e3 * h.y],
    "v_y": lambda h: [h.v_y],
    "v_x": lambda h: [h.v_x, h.radius * h.omega_2, h.radius * h.omega_1],
    "slip": lambda h: [h.v_x - h.radius * h.omega_2],
    "normal_force": lambda h: [h.normal_force],
    "friction_force": lambda h: [DEFAULTS["mu"] * h.normal_force, -DEFAULTS["mu"] * h.normal_force, h.friction_force],
    "omega_2": lambda h: [h.omega_2],
    "centre": lambda h: [h.v_x],
    "forces": lambda h: [h.normal_force, h.friction_force],
}


@pytest.fixture(scope="module")
def banded():
    """An impact that slides, grips and slides back, with bands."""
    found = simulate_fit(fitted(), fitball.impacts(12.0, 10.0, 50.0), draws=20)
    assert len(found.history.transition_shares) == 2
    return found


def curves(axis):
    return [line for line in axis.lines if len(line.get_ydata()) == POINTS]


def edges(band):
    """Lower and upper edge of a filled band over the points, from its outline."""
    x, y = band.get_paths()[0].vertices.T
    shares = np.unique(x)
    return np.array([[f(y[x == share]) for share in shares] for f in (np.min, np.max)])


@pytest.mark.parametrize("panel", DRAWN)
def test_a_panel_shows_its_courses_bands_and_transitions(panel, banded):
    history = banded.history
    (axis,) = history_figure([banded], "one", (panel,)).axes
    assert axis.get_ylabel() == LABELS[panel]
    shown = curves(axis)
    expected = EXPECTED[panel](history)
    assert len(shown) == len(expected)
    for line, course in zip(shown, expected, strict=True):
        np.testing.assert_array_equal(line.get_xdata(), banded.shares)
        np.testing.assert_allclose(line.get_ydata(), course, rtol=1e-12, atol=1e-12 * np.ptp(course))
    for band, (low, high) in zip(axis.collections[:2], ((0, 4), (1, 3)), strict=True):
        # The first course with a band: the cone of friction has none.
        name = {"centre": "v_x", "forces": "normal_force"}.get(panel, panel)
        factor = 1e3 if panel == "y" else 1.0
        np.testing.assert_allclose(edges(band), factor * banded.band.quantiles[name][[low, high]], rtol=1e-12)
    marks = [line.get_xdata()[0] for line in axis.lines if line.get_linestyle() == ":"]
    np.testing.assert_allclose(sorted(marks), history.transition_shares)
    (upper,) = axis.child_axes
    forward, _back = upper._functions
    assert forward(1.0) == pytest.approx(1e3 * history.contact_time)


def test_marks_of_flight_lie_before_landing_and_after_release(banded):
    (axis,) = history_figure([banded], "one", ("v_x",)).axes
    found, radius = banded.history, banded.history.radius
    marks = [(line.get_xdata()[0], line.get_ydata()[0]) for line in axis.lines if len(line.get_ydata()) == 1]
    before, after = found.landing.before, found.release.after
    assert before.omega_2 != found.omega_2[0]
    expected = [(0, before.v_x), (0, radius * before.omega_2), (1, after.v_x), (1, radius * after.omega_2)]
    np.testing.assert_allclose(marks, expected, rtol=1e-12)


def test_the_panels_are_those_asked_for(banded):
    figure = history_figure([banded], "one")
    assert [axis.get_ylabel() for axis in figure.axes] == [LABELS[panel] for panel in ALL_PANELS]
    assert set(DRAWN) == set(LABELS) == set(EXPECTED)
    assert set(LABELS) >= {panel for example in EXAMPLES for panel in example.panels}


def test_curves_of_several_are_not_mixed_up():
    """Two impacts in one figure: each course in its own colour, surfaces dashed, marks where its phases change."""
    values = {name: DEFAULTS[name] for name in fitball.model("two-mass").parameter_names}
    model = fitball.model("two-mass")
    pair = [simulate(model, values, fitball.impacts(12.0, 10.0, spin), label=f"{spin:g}") for spin in (-50.0, 250.0)]
    figure = history_figure(pair, "two", panels=("y", "v_x"))
    height, along = figure.axes
    for axis, colour_of_first in ((height, height.lines[0].get_color()), (along, height.lines[0].get_color())):
        colours = {line.get_color() for line in axis.lines}
        assert len(colours) == 2 and colour_of_first in colours
    solid = [line for line in along.lines if line.get_linestyle() == "-" and len(line.get_xdata()) == POINTS]
    dashed = [line for line in along.lines if line.get_linestyle() == "--"]
    dots = [line for line in along.lines if line.get_marker() == "o"]
    assert len(solid) == len(dashed) == len(dots) == 2
    for item, centre, surface, marks in zip(pair, solid, dashed, dots, strict=True):
        np.testing.assert_array_equal(centre.get_ydata(), item.history.v_x)
        np.testing.assert_array_equal(surface.get_ydata(), item.history.radius * item.history.omega_2)
        np.testing.assert_array_equal(marks.get_xdata(), item.history.transition_shares)
        assert centre.get_color() == surface.get_color() == marks.get_color()
    assert not [line for line in height.lines if line.get_marker() == "o"]
    assert {text.get_text() for text in figure.legends[0].get_texts()} >= {"-50", "250", "transition"}


@pytest.mark.parametrize(
    "words",
    [
        ["simulate", "--impact", "v=17, theta=18", "--out", "a", "--csv", "mine.csv"],
        ["predict", "FIT", "mine.csv", "--out", "mine.csv"],
    ],
    ids=lambda words: words[0],
)
def test_a_file_of_the_user_is_not_replaced(small_fit, tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    kept, before = tmp_path / "mine.csv", "v_1,theta_1,omega_1\n17,30,0\n"
    kept.write_text(before, encoding="utf-8")
    line = [str(small_fit) if word == "FIT" else word for word in (*words, "--quiet")]
    assert main(line) == 2
    assert "exists already" in capsys.readouterr().err
    assert kept.read_text(encoding="utf-8") == before and [*tmp_path.iterdir()] == [kept]
    assert main([*line, "--overwrite"]) == 0
    assert kept.read_text(encoding="utf-8") != before
