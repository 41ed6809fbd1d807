"""A bounce without a table: values that are set, published and default, on one surface or several."""

from __future__ import annotations

import json

import numpy as np
import pytest
from test_export_ports import CC, FLAGS, loaded, needs_cc, run

import fitball
from fitball.cli.main import main
from fitball.exports.port.port import port_of, python_port
from fitball.exports.unfitted import unfitted_bounces

STATE = (25.0, 4.5, 30.0)
# Printed in the table of the literature: friction of clay and of grass, normal with these sds.
CLAY, GRASS = (0.73, 0.10), (0.53, 0.12)


def answers(module, *surface):
    found = module.rebound(*STATE, *surface)
    return [found.v_x2, found.v_y2, found.omega_2]


def by_model(name, **values):
    """The bounce of the model itself at default values but for these."""
    chosen = fitball.model(name)
    typical = {spec.name: spec.typical for spec in chosen.parameters}
    made = chosen.rebound(typical | values, fitball.impacts(*([number] for number in STATE)))
    return [made.v_x2[0], made.v_y2[0], made.omega_2[0]]


@pytest.mark.parametrize("name", ["two-mass", "grip-slip", "brody"])
def test_values_that_are_set_are_those_of_the_port(name, tmp_path):
    module = loaded(port_of(unfitted_bounces(name, {"mu": 0.31, "cor_10": 0.72}, {})), tmp_path / "set.py")
    np.testing.assert_allclose(answers(module), by_model(name, mu=0.31, cor_10=0.72), rtol=1e-12)
    assert module.self_test() == (pytest.approx(0.0, abs=1e-12), True)
    assert not hasattr(module, "CALIBRATED_V_Y1_LOW")
    for speed in (1e-9, 0.5, 60.0, 1e3):
        assert np.isfinite(module.rebound(10.0, speed, 0.0).v_y2)


def test_surfaces_of_the_literature_and_of_the_user_are_an_argument(tmp_path):
    surfaces = {"clay": "literature:clay", "Grass": "literature:grass, cor_10=0.7", "mine": {"mu": 0.31}}
    found = unfitted_bounces("grip-slip", {"cor_10": 0.74}, surfaces)
    module = loaded(port_of(found), tmp_path / "surfaces.py")
    for surface, mu, cor in (("clay", CLAY[0], 0.74), ("grass", GRASS[0], 0.7), ("mine", 0.31, 0.74)):
        np.testing.assert_allclose(answers(module, surface), by_model("grip-slip", mu=mu, cor_10=cor), rtol=1e-12)
    assert set(module.speed_range("clay")) == {"v_y1_low", "v_y1_high"}
    with pytest.raises(ValueError, match="as surface one of clay, grass, mine"):
        module.rebound(*STATE, "hard")


def test_every_value_has_its_source_and_a_published_one_its_range():
    surfaces = {"clay": "literature:clay", "grass": "literature:grass"}
    text = " ".join(python_port(port_of(unfitted_bounces(None, {"cor_10": 0.74}, surfaces))).split())
    assert "Not calibrated: nothing was fitted, and no measured impact supports these numbers." in text
    for label, (mu, sd) in (("clay", CLAY), ("grass", GRASS)):
        low, high = mu - 1.959964 * sd, mu + 1.959964 * sd
        assert f"mu = {mu:g} of {label}, 95 % range {low:.3g} to {high:.3g}: literature:{label}: ITF" in text
    assert "not a measured friction: clay is rated slow" in text and "U+0026" not in text
    assert "cor_10 = 0.74: set by the user." in text
    assert "Default values of the model, near the fits to Wang's balls: mass_ratio = 0.87, k_y = 20000 N/m" in text
    assert "Calibrated" not in text and "fitted to impacts" not in text


def test_one_surface_is_no_argument(tmp_path):
    port = port_of(unfitted_bounces("brody", {}, {"clay": "literature:clay"}))
    np.testing.assert_allclose(answers(loaded(port, tmp_path / "one.py")), by_model("brody", mu=CLAY[0]), rtol=1e-12)


def test_a_value_that_only_some_surfaces_have_is_default_on_the_others():
    found = unfitted_bounces("grip-slip", {}, {"hard": "literature:acrylic", "clay": "literature:clay"})
    assert "cor_10 = 0.776 of clay" in found.sources[-1] and "mu" not in found.sources[-1].split(":")[1]
    cor = [case.fitted.point[case.fitted.names.index("cor_10")] for case in found.cases]
    assert cor == [0.76, 0.776]


@needs_cc
def test_the_header_of_three_surfaces_at_the_command_line(tmp_path, capsys):
    place = tmp_path / "rally.h"
    given = ["--surface", "clay=literature:clay", "--surface", "grass=literature:grass", "--surface", "hard=mu=0.6"]
    call = ["export", "--model", "grip-slip", "--set", "cor_10=literature:court", *given, "--to", "c"]
    assert main([*call, "--out", str(place)]) == 0
    said = capsys.readouterr().err
    assert "note: nothing was fitted. Default values of the model" in said and "cor_slope" in said
    run([CC, *FLAGS, "-x", "c", "-DFITBALL_SELF_TEST", str(place), "-lm", "-o", "check"], tmp_path)
    assert "passed" in run(["./check"], tmp_path)
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "rally.h"\nint main(void) { printf("%.17g", '
        "fitball_rebound(25.0, 4.5, 30.0, FITBALL_SURFACE_GRASS).v_x2); return 0; }\n"
    )
    run([CC, *FLAGS, "main.c", "-lm", "-o", "main"], tmp_path)
    expected = by_model("grip-slip", mu=GRASS[0], cor_10=0.81)[0]
    assert float(run(["./main"], tmp_path)) == pytest.approx(expected, rel=1e-12)


def test_engine_settings_and_tables_without_a_table(tmp_path):
    surfaces = {"clay": "literature:clay", "grass": "literature:grass"}
    page = fitball.port("two-mass", "engine", surfaces=surfaces, at="v=30, theta=20")
    assert "**Nothing was fitted.**" in page[".md"] and "calibrated" not in page[".md"]
    assert [item["labels"]["surface"] for item in json.loads(page[".json"])["levels"]] == ["clay", "grass"]
    places = fitball.port("two-mass", "lookup", tmp_path, values={"mu": 0.7}, range="v=15..20:3, theta=20..30:3")
    assert sorted(place.name for place in places) == ["lookup.csv", "lookup.json"]
    assert json.loads((tmp_path / "lookup.json").read_text())["table"] is None


MISTAKES = (
    (["--set", "nu=0.7"], "unknown parameter 'nu' of model two-mass: known: ball_mass"),
    (["--set", "mu=7"], "mu = 7 lies outside its bounds, 0 to 5"),
    (["--set", "mu=nan"], "mu = nan lies outside its bounds"),
    (["--set", "mass_ratio=1"], "mass_ratio = 1 lies outside its bounds, 0.3 to below 1"),
    (["--set", "mu="], "expected NAME=VALUE, as in mu=0.6"),
    (["--set", "mu=much"], "read 'much', expected a number in SI units, or literature:KEY"),
    (["--set", "mu=literature:gras"], "did you mean 'grass'? known keys of mu"),
    (["--set", "eps_10=literature:clay"], "the literature has none for eps_10"),
    (["--set", "mu=0.6", "--set", "mu=0.7"], "mu is given twice"),
    (["--model", "thesis+damping=given", "--set", "mu=0.6"], "needs a value of c_y, which has no default"),
    (["--surface", "clay=literature:cley"], "the literature has no 'cley' for model two-mass: did you mean 'clay'?"),
    (["--surface", "clay=red"], "read 'red', expected literature:KEY, such as literature:clay, or a value"),
    (["--surface", "clay=mu=0.6, mu=0.7"], "--surface clay=mu=0.6, mu=0.7: mu is given twice"),
    (["--surface", "clay=nu=0.6"], "--surface clay=nu=0.6: unknown parameter 'nu'"),
    (["--surface", "clay"], "expected NAME=literature:KEY"),
    (["--model", "two-mas"], "unknown model 'two-mas': did you mean 'two-mass'?"),
    (["--set", "mass_ratio=0.5"], "has no bounce at 10 m/s with these parameters: the coefficient of restitution"),
    (["--set", "mu=0.6", "--level", "surface=clay"], "chooses a level of a fit: leave it out"),
    ([], "export needs a FIT; without one give a model"),
    (["some_fit", "--set", "mu=0.7"], "the fit some_fit has its own model and parameters: leave out --set"),
)


@pytest.mark.parametrize(("words", "said"), MISTAKES, ids=[" ".join(words) for words, _said in MISTAKES])
def test_mistakes(words, said, capsys):
    assert main(["export", *words, "--to", "python", "--out", "-"]) == 2
    out, err = capsys.readouterr()
    assert said in err and not out


def test_formats_that_need_a_fit_say_so(capsys):
    for to in ("json", "latex", "golden", "netcdf"):
        assert main(["export", "--set", "mu=0.7", "--to", to, "--out", "-"]) == 2
        assert f"format {to} needs a fit" in capsys.readouterr().err


def test_values_in_python_are_checked():
    for values in ({"mu": "much"}, {"mu": None}, {"mu": [0.5]}, {"mu": float("inf")}):
        with pytest.raises(fitball.FitballError, match="mu"):
            fitball.port("brody", "c", values=values)
    with pytest.raises(fitball.FitballError, match="the name of a surface"):
        fitball.port("brody", "c", surfaces={" ": "literature:clay"})
