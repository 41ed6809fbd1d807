"""The map of regimes: its edges where the algebra of a sliding ball has them, its probabilities as counted."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

import fitball
from fitball.cli.main import main
from fitball.data.lines import parse_window
from fitball.errors import ModelError, ParameterError
from fitball.inference.prediction.simulate import NONE, Window, regime_map
from fitball.inference.results.fitted_model import at_values
from fitball.models.types import regime_name
from fitball.report.figures.predictions import OTHERS
from fitball.report.history.regime_map import NO_SOLUTION, areas, map_figure, map_rows

COR, ALPHA = 0.75, 0.56
WINDOW = Window(20.0, (np.radians(5.0), np.radians(85.0)), (-300.0, 300.0))
BRODY = {"mu": 0.5, "cor_10": COR, "cor_slope": 0.0}


def brody(**changed):
    return at_values(fitball.model("brody"), {**BRODY, **changed})


def slides(angle, spin, mu, speed=20.0):
    """Coulomb's law on a rigid ball: friction mu (1 + e) v_y to the end does not stop the slip that there was."""
    radius = fitball.Ball().radius
    slip = speed * np.cos(angle) - radius * spin
    return np.abs(slip) > mu * (1.0 + COR) * (1.0 + 1.0 / ALPHA) * speed * np.sin(angle)


def test_edges_are_those_of_a_sliding_ball():
    found = regime_map(brody(), WINDOW)
    angle, spin = np.meshgrid(found.angles, found.spins)
    alone = np.array([[regime_name(code) in ("slide", "slide back") for code in row] for row in found.regime])
    assert np.array_equal(alone, slides(angle, spin, 0.5))
    # Without spin the edge is known to the last digits, not to the width of a cell.
    edge = np.arctan(1.0 / (0.5 * (1.0 + COR) * (1.0 + 1.0 / ALPHA)))
    (first, start, end), (_second, after, last) = found.along_angle
    assert first == "slide" and end == after == pytest.approx(edge, abs=1e-12)
    assert (start, last) == WINDOW.angle
    assert sum(found.areas.values()) == pytest.approx(1.0)


def test_every_cell_is_the_impact_it_stands_for():
    parameters = {spec.name: spec.typical for spec in fitball.model("two-mass").parameters}
    found = regime_map(at_values(fitball.model("two-mass"), parameters), WINDOW)
    rows, columns = np.random.default_rng(5).integers(0, (found.spins.size, found.angles.size), (40, 2)).T
    angle, spin = found.angles[columns], found.spins[rows]
    for k, (row, column) in enumerate(zip(rows, columns, strict=True)):
        impact = fitball.impacts(20.0 * np.cos(angle[k]), 20.0 * np.sin(angle[k]), spin[k])
        if found.regime[row, column] == NONE:
            with pytest.raises(ParameterError, match="mass_ratio"):
                fitball.model("two-mass").rebound(parameters, impact)
            continue
        rebound = fitball.model("two-mass").rebound(parameters, impact)
        assert rebound.regime[0] == found.regime[row, column]
        assert rebound.omega_2[0] == found.outputs["omega_2"][row, column]
    drawn = areas(found)
    assert drawn.names[-1] == NO_SOLUTION and OTHERS not in drawn.names[:-2]
    assert sum(drawn.shares) == pytest.approx(1.0)
    for number, share in enumerate(drawn.shares):
        assert np.mean(drawn.numbers == number) == pytest.approx(share)


def test_what_has_no_map_is_refused():
    with pytest.raises(ModelError, match="no motion along the court"):
        regime_map(replace(brody(), tangential=False), WINDOW)
    with pytest.raises(ModelError, match="cor = measured takes the restitution of each impact"):
        regime_map(at_values(fitball.model("two-mass", cor="measured"), {}), WINDOW)


def test_figure_marks_what_belongs_to_the_speed():
    found = regime_map(brody(), WINDOW)
    angle = np.radians([20.0, 40.0, 60.0])
    impacts = fitball.impacts(
        [20.0, 21.0, 30.0] * np.cos(angle), [20.0, 21.0, 30.0] * np.sin(angle), [0.0, 100.0, 0.0]
    )
    figure = map_figure(found, "brody", "omega_2", impacts, "mine")
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "mine: within 10 % of this speed (2)" in words and "mine: others (1)" in words
    assert any(word.startswith("slide (") for word in words)
    assert "contours: rebound spin" in " ".join(words)
    assert "20 m/s" in figure.get_suptitle()
    near, others = [line for line in figure.axes[0].lines if line.get_linestyle() == "None"]
    assert near.get_xdata() == pytest.approx([20.0, 40.0]) and others.get_xdata() == pytest.approx([60.0])
    rows = map_rows(found)
    assert {row["regime"] for row in rows} == set(found.areas)


def test_command_writes_a_map_and_says_where_one_regime_follows_another(tmp_path, capsys):
    place = tmp_path / "map"
    line = ["simulate", "--map", "v=20, theta=5..85", "--model", "brody", "--set", "mu=0.5", "--out", str(place)]
    assert main([*line, "--set", "cor_10=0.75", "--set", "cor_slope=0"]) == 0
    out = capsys.readouterr().out
    edge = np.degrees(np.arctan(1.0 / (0.5 * (1.0 + COR) * (1.0 + 1.0 / ALPHA))))
    assert f"5.000 to  {edge:.3f} deg  slide\n" in out
    assert sorted(item.name for item in place.iterdir()) == ["regime_map.csv", "regime_map.json", "regime_map.png"]
    content = json.loads((place / "regime_map.json").read_text(encoding="utf-8"))
    assert content["model"] == "brody" and content["speed"] == 20.0
    with (place / "regime_map.csv").open(encoding="utf-8") as file:
        assert {"theta_1 [rad]", "regime", "v_x2 [m/s]"} <= set(next(csv.DictReader(file)))
    first = (place / "regime_map.png").read_bytes()
    assert main([*line, "--set", "cor_10=0.75", "--set", "cor_slope=0"]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (place / "regime_map.png").read_bytes() == first


def test_the_map_of_a_fit_has_its_impacts(grip_slip_folder, tmp_path, capsys):
    assert main(["simulate", "--map", "--fit", str(grip_slip_folder), "--out", str(tmp_path), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["model"] == "grip-slip"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--map", "v=20..30"], "expected one speed"),
        (["--map", "theta=20"], "range"),
        (["--map", "v_x=20"], "expected v (one speed), theta and spin"),
        (["--map", "v=20, v=30"], "given twice"),
        (["--map", "vee=20"], "unknown quantity 'vee': known: omega"),
        (["--map", "theta=-10..80"], "between 0 and 180"),
        (["--map", "--impact", "v=17, theta=18"], "leave out --impact"),
        (["--map", "--contours", "omega2"], "did you mean 'omega_2'"),
        (["--map", "--contours", "contact_time", "--model", "grip-slip"], "model grip-slip"),
        (["--map", "--model", "thesis+damping=given"], "model thesis needs a value of c_y"),
        (["--impact", "v=17, theta=18", "--contours", "v_x2"], "--contours"),
    ],
)
def test_mistakes_are_named(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", *words]) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_window_is_read_in_any_unit():
    window = parse_window("v=72 km/h, theta=10..80 deg, spin=-3000..3000 rpm")
    assert window["v_1"] == pytest.approx((20.0, 20.0))
    assert window["theta_1"] == pytest.approx(np.radians([10.0, 80.0]))
    assert window["omega_1"] == pytest.approx((-100.0 * np.pi, 100.0 * np.pi))
    assert parse_window("") == {}
