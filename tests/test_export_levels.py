"""Exports of a fit whose parameters differ between surfaces and balls: ports that take these as arguments, in every
language against the kernels; tables, engine settings and parameter sets with each of them.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import jsonschema
import numpy as np
import pandas as pd
import pytest
from samples import search_briefly
from test_export_formats import schema
from test_export_ports import (
    ALL,
    CC,
    FLAGS,
    MCS,
    MONO,
    NO_CS,
    NO_JS,
    NODE,
    examined,
    fitted,
    loaded,
    needs_cc,
    run,
    self_tested,
)
from test_hostile_text import HOSTILE, untouched

import fitball
from fitball.api.simulating import Subject, page_of
from fitball.cli.main import main
from fitball.errors import ParameterError
from fitball.exports.bounces import Bounces, Case, bounces_of, joined
from fitball.exports.parameters import latex_table, paper_rows, parameter_content
from fitball.exports.port.languages import c_port, csharp_port, javascript_port
from fitball.exports.port.names import arguments_of, plain_name
from fitball.exports.port.port import make_port, port_of, python_port
from fitball.inference.prediction.outputs import golden
from fitball.inference.prediction.reach import total_rebound, valid_range
from fitball.inference.results.results import Verdict
from fitball.models.registry import model
from fitball.values import Impacts

# Friction and restitution of three surfaces, and between which speeds towards the court each was measured [m/s].
TRUTH = {"Clay (wet)": (0.74, 0.80, 4.0, 9.0), "Hard": (0.58, 0.75, 6.0, 14.0), "Grasé": (0.45, 0.70, 5.0, 11.0)}
NAMES = ("clay_wet", "hard", "grase")


def measured(name):
    """A table of eight impacts on each surface."""
    chosen, rng, parts = model(name), np.random.default_rng(5), []
    others = {spec.name: spec.typical for spec in chosen.parameters}
    for label, (mu, cor, low, high) in TRUTH.items():
        v_x, v_y, omega = rng.uniform(12, 24, 8), np.linspace(low, high, 8), rng.uniform(-100, 200, 8)
        values = others | {"mu": mu, "cor_10": cor, "cor_slope": -0.008}
        made = chosen.rebound(values, fitball.impacts(v_x, v_y, omega))
        columns = {"surface": [label] * 8, "v_x1": v_x, "v_y1": v_y, "omega_1": omega}
        noisy = {item: getattr(made, item) + rng.normal(0.0, sd, 8) for item, sd in NOISE.items()}
        parts.append(pd.DataFrame(columns | noisy))
    return pd.concat(parts)


NOISE = {"v_x2": 0.2, "v_y2": 0.2, "omega_2": 8.0}


@pytest.fixture(scope="module")
def fits(tmp_path_factory):
    """A point fit of each model, and its folder."""
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        search_briefly(patch)
        for name in ("grip-slip", "two-mass"):
            pool = {"mu": "surface", "cor_10": "surface"}
            fit = fitball.calibrate(measured(name), model=name, pool=pool, point_only=True, cores=1)
            found[name] = fit, fit.save(tmp_path_factory.mktemp("levels") / name, figures=False)
    return found


def on(fit, label):
    """The fitted model on a surface by the formula of the levels, written anew: `mu` has a prior of its logarithm."""
    at = dict(zip(fit.fitted.names, fit.fitted.point, strict=True))
    at["mu"] *= np.exp(at["mu_spread"] * at[f"mu_place[{label}]"])
    at["cor_10"] += at["cor_10_spread"] * at[f"cor_10_place[{label}]"]
    mine = np.flatnonzero(np.array(fit.problem.table.labels["surface"]) == label)
    point = np.array([at[name] for name in fit.fitted.names])
    return replace(fit.fitted, point=point, levels=(), impacts=fit.fitted.impacts.take(mine))


@pytest.fixture(scope="module")
def asked(fits):
    """The port of each fit with a hundred impacts on each surface, in and out of its own valid range, in the place of
    the golden ones; and how many are asked.
    """
    found = {}
    for name, (fit, _folder) in fits.items():
        port, told = port_of(bounces_of(fit)), [examined(on(fit, label), 100) for label in TRUTH]
        sets = tuple(
            replace(part, golden=one.golden, regimes=one.regimes)
            for part, (one, _count) in zip(port.sets, told, strict=True)
        )
        found[name] = replace(port, sets=sets), sum(count for _one, count in told)
    return found


@pytest.mark.parametrize("name", ["grip-slip", "two-mass"])
@pytest.mark.parametrize("language", ALL)
def test_a_port_of_three_surfaces_answers_as_the_kernels_do(language, name, asked, tmp_path):
    port, count = asked[name]
    done = self_tested(language, port, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{count} golden impacts" in done.stdout and "passed" in done.stdout


@pytest.mark.parametrize("language", ALL)
def test_surfaces_exchanged_fail_the_self_test(language, asked, tmp_path):
    port, _count = asked["grip-slip"]
    first, second, third = port.sets
    wrong = replace(second, golden=third.golden, regimes=third.regimes)
    done = self_tested(language, replace(port, sets=(first, wrong, third)), tmp_path)
    assert done.returncode == 1 and "FAILED" in done.stdout


def test_each_surface_has_its_own_parameters_ranges_and_golden_impacts(fits):
    fit, _folder = fits["grip-slip"]
    found = bounces_of(fit)
    assert found.columns == {"surface": tuple(TRUTH)} and [case.measured for case in found.cases] == [8, 8, 8]
    port = port_of(found)
    for part, label in zip(port.sets, TRUTH, strict=True):
        alone, (_mu, _cor, low, high) = on(fit, label), TRUTH[label]
        assert part.row == make_port(alone, golden(alone, alone.impacts), "here").row
        assert part.calibrated == (low, high)
        assert (part.valid.low, part.valid.high) == (valid_range(alone).low, valid_range(alone).high)
        assert part.golden != port.sets[0].golden or label == next(iter(TRUTH))
    assert len({part.valid.high for part in port.sets}) == 3


def test_a_level_that_is_chosen_gives_the_port_of_one_surface(fits):
    """The one that the model on this surface alone has."""
    fit, _folder = fits["two-mass"]
    one = bounces_of(fit, {"surface": "Hard"})
    alone = on(fit, "Hard")
    assert python_port(port_of(one)) == python_port(make_port(alone, golden(alone, alone.impacts), one.origin))
    assert one.origin.endswith("surface Hard") and "mu and cor_10 of each surface" in bounces_of(fit).origin


def test_a_fit_without_its_measurements_has_one_range_and_says_so(fits, tmp_path):
    _fit, folder = fits["grip-slip"]
    (tmp_path / "fit.json").write_bytes((folder / "fit.json").read_bytes())
    port = port_of(bounces_of(fitball.load_fit(tmp_path)))
    assert {part.calibrated for part in port.sets} == {(4.0, 14.0)}
    assert "The measurements are not beside fit.json" in python_port(port)


# Labels that no language takes as they are: of two columns, so that which is fastest can be seen.
LABELS = {"class": ("Clay, (wet)", "clay wet", "粘土", "1st"), "v_x1": ("é", "E", "new")}


def two_columns(cor="line", **labels):
    """Bounces with friction by the first column and restitution by the second."""
    columns = labels or LABELS
    closures = {"cor": cor} | ({"torsion": "rigid"} if cor == "measured" else {})
    told = [0.8, 0.7, 0.65] if cor == "measured" else None
    given = Impacts([15.6, 11.7, 6.6], [4.8, 13.2, 16.1], [-5.0, 10.6, 1.2], told)
    whole = fitted("two-mass" if told else "grip-slip", impacts=given, **closures)
    cases = []
    for k, one in enumerate(next(iter(columns.values()))):
        for m, other in enumerate([*columns.values()][1]):
            point = whole.point.copy()
            point[whole.names.index("mu")] = 0.3 + 0.1 * k
            if told is None:
                point[whole.names.index("cor_10")] = 0.7 + 0.03 * m
            ball = replace(whole, point=point)
            cases.append(Case(dict(zip(columns, (one, other), strict=True)), ball, golden(ball, given)))
    return Bounces("a test", columns, tuple(cases))


def expected(found, *state):
    """The rebound `v_x2`, `v_y2` of every case, by the model."""
    impact = Impacts(*([number] for number in state))
    made = [total_rebound(case.fitted, valid_range(case.fitted), impact)[0] for case in found.cases]
    return [(item.v_x2[0, 0], item.v_y2[0, 0]) for item in made]


STATE = (25.0, 4.0, 30.0)


def test_python_takes_names(tmp_path):
    found = two_columns()
    module = loaded(port_of(found), tmp_path / "levels_port.py")
    (first, names), (second, others) = module.LEVELS.items()
    assert (first, names) == ("class_label", ("clay_wet", "clay_wet_2", "class_label_3", "1st"))
    assert (second, others) == ("v_x1_label", ("e", "e_2", "new"))
    made = [module.rebound(*STATE, class_label=one, v_x1_label=other)[:2] for one in names for other in others]
    np.testing.assert_allclose(made, expected(found, *STATE), rtol=1e-12)
    for bad in (("clay", "e"), ("clay_wet", "grass"), (None, "e"), ("clay_wet", [])):
        with pytest.raises(ValueError, match="as class_label one of clay_wet, clay_wet_2"):
            module.rebound(*STATE, *bad)
    assert module.speed_range("1st", "new")["calibrated_v_y1_high"] == 16.1


JS = """
const bounce = require("./port.js"), found = [], said = [];
for (const one of bounce.LEVELS.class_label)
    for (const other of bounce.LEVELS.v_x1_label)
        found.push(bounce.rebound(25, 4, 30, one, other));
for (const bad of [[], ["clay", "e"], ["clay_wet", "grass"], [0, 0], ["clay_wet", null]])
    try { bounce.rebound(25, 4, 30, ...bad) }
    catch (error) { said.push(error instanceof RangeError && error.message) }
console.log(JSON.stringify([found, said, bounce.speedRange("1st", "new")]));
"""


@NO_JS
def test_javascript_takes_names(tmp_path):
    found = two_columns()
    (tmp_path / "port.js").write_text(javascript_port(port_of(found))[".js"], encoding="utf-8")
    made, said, ends = json.loads(run([NODE, "-e", JS], tmp_path))
    np.testing.assert_allclose([(one["v_x2"], one["v_y2"]) for one in made], expected(found, *STATE), rtol=1e-12)
    assert len(said) == 5 and all("as class_label one of clay_wet, clay_wet_2" in text for text in said)
    assert ends["calibrated_v_y1_high"] == 16.1


C = """
#include <stdio.h>
#include "port.h"
int main(void)
{
    for (int one = CLAY_CLASS_LABEL_CLAY_WET; one <= CLAY_CLASS_LABEL_1ST; one++)
        for (int other = CLAY_V_X1_LABEL_E; other <= CLAY_V_X1_LABEL_NEW; other++) {
            clay_rebound_t r = clay_rebound(25.0, 4.0, 30.0, (clay_class_label_t)one, (clay_v_x1_label_t)other);
            printf("%d %.17g %.17g\\n", r.status, r.v_x2, r.v_y2);
        }
    for (int bad = -1; bad < 5; bad += 5) {
        clay_rebound_t r = clay_rebound(25.0, 4.0, 30.0, (clay_class_label_t)bad, CLAY_V_X1_LABEL_E);
        clay_v_x1_label_t worse = (clay_v_x1_label_t)(bad < 0 ? bad : 3);
        clay_rebound_t s = clay_rebound(25.0, 4.0, 30.0, CLAY_CLASS_LABEL_1ST, worse);
        printf("%d %d %d\\n", r.status, s.status, isnan(r.v_x2) && isnan(s.v_y2));
    }
    printf("%g %d %s\\n", clay_range(CLAY_CLASS_LABEL_1ST, CLAY_V_X1_LABEL_E).calibrated_v_y1_high,
           isnan(clay_range((clay_class_label_t)9, CLAY_V_X1_LABEL_E).v_y1_low), clay_reason(CLAY_BAD_INPUT));
    return 0;
}
"""


@needs_cc
def test_c_takes_enumerators_and_any_other_number_is_bad_input(tmp_path):
    found = two_columns()
    (tmp_path / "port.h").write_text(c_port(port_of(found), "clay_"), encoding="utf-8")
    (tmp_path / "main.c").write_text(C, encoding="utf-8")
    run([CC, *FLAGS, "main.c", "-lm", "-o", "main"], tmp_path)
    *rows, low, high, ends = run(["./main"], tmp_path).strip().split("\n")
    made = [[float(word) for word in row.split()] for row in rows]
    np.testing.assert_allclose(made, [(0.0, *one) for one in expected(found, *STATE)], rtol=1e-12)
    assert low == high == "-1 -1 1"
    assert ends.startswith("16.1 1 expected finite numbers, v_y1 >= 0 towards the court, and as class_label one of")


CS = """
using System;
static class Check
{
    static string Told(ClayBounce.ClassLabel one, ClayBounce.VX1Label other)
    {
        try {
            var r = ClayBounce.Rebound(25, 4, 30, 0.7, one, other);
            return string.Format(System.Globalization.CultureInfo.InvariantCulture, "{0:R} {1:R}", r.v_x2, r.v_y2);
        }
        catch (ArgumentException error) { return error.Message; }
    }
    static void Main()
    {
        foreach (ClayBounce.ClassLabel one in Enum.GetValues(typeof(ClayBounce.ClassLabel)))
            foreach (ClayBounce.VX1Label other in Enum.GetValues(typeof(ClayBounce.VX1Label)))
                Console.WriteLine(Told(one, other));
        Console.WriteLine(Told((ClayBounce.ClassLabel)2, ClayBounce.VX1Label.E));
        Console.WriteLine(Told(ClayBounce.ClassLabel.ClassLabel1st, (ClayBounce.VX1Label)(-1)));
        var range = ClayBounce.SpeedRange(ClayBounce.ClassLabel.ClayWet, ClayBounce.VX1Label.New);
        Console.WriteLine(range.v_y1_low > 0.0);
    }
}
"""


@NO_CS
def test_csharp_takes_enumerators_beside_a_given_restitution(tmp_path):
    found = two_columns(cor="measured", **{"class": ("Clay, (wet)", "1st"), "v_x1": ("é", "new")})
    (tmp_path / "port.cs").write_text(csharp_port(port_of(found), "clay_"), encoding="utf-8")
    (tmp_path / "check.cs").write_text(CS, encoding="utf-8")
    run([MCS, "-r:System.Numerics", "-warnaserror", "-out:check.exe", "port.cs", "check.cs"], tmp_path)
    *rows, bad, worse, ends = run([MONO, "check.exe"], tmp_path).strip().split("\n")
    made = [[float(word) for word in row.split()] for row in rows]
    np.testing.assert_allclose(made, expected(found, *STATE, 0.7), rtol=1e-12)
    assert bad == worse and "a finite cor, v_y1 >= 0" in bad and "as v_x1_label one of e, new" in bad
    assert ends == "True"


@cache
def odd_ports():
    """Ports of columns and labels: many strings that would end a comment or a string; words of the languages, names
    of the port, and names that differ by what no name has.
    """
    hostile = {
        name: ("".join(HOSTILE[k::4]), "".join(HOSTILE[k + 1 :: 4])) for k, name in ((0, HOSTILE[0]), (2, '"\n'))
    }
    pairs = (("rebound", "Solved"), ("row", "int"), ("beyond", "v"), ("a b", "a-b"), ("fitball bounce", "math"))
    named = ({one: ("speeds", "v y1 low"), other: ("y1_low", "int")} for one, other in pairs)
    return [port_of(two_columns(**labels)) for labels in (hostile, *named)]


@pytest.mark.parametrize("language", ALL)
def test_labels_and_columns_are_neither_obeyed_nor_in_the_way(language, tmp_path):
    for port in odd_ports():
        untouched(self_tested(language, port, tmp_path).stdout)


def test_names_are_plain_and_unique():
    assert [plain_name(text) for text in ("Gras\u00e9 (wet)", "gra\u00df", "  ", "\u7c98\u571f", "A--b")] == [
        "grase_wet", "grass", "", "", "a_b",
    ]  # fmt: skip
    assert plain_name("clay court 7 of the club, wet") == "clay_court_7_of_the_club"
    (one, two) = arguments_of({"a": ("b c", "b_c", "B c!"), "a b": ("c", "C")}, [], ["A_B_C"])
    assert one.names == ("b_c", "b_c_2", "b_c_3") and len({*one.constants, *two.constants, "A_B_C"}) == 6
    assert len(set(one.members)) == 3 and one.kind != two.kind


def test_tables_and_engine_settings_have_every_surface(fits, tmp_path, capsys):
    fit, folder = fits["grip-slip"]
    call = ["export", str(folder), "--out", str(tmp_path), "--to"]
    assert main([*call, "lookup", "--range", "v=15..20:3, theta=20..30:3"]) == 0
    table, about = pd.read_csv(tmp_path / "lookup.csv"), json.loads((tmp_path / "lookup.json").read_text())
    assert [item["labels"] for item in about["levels"]] == [{"surface": label} for label in TRUTH]
    assert main([*call, "engine", "--at", "v=17, theta=25"]) == 0
    engine, page = json.loads((tmp_path / "engine.json").read_text()), (tmp_path / "engine.md").read_text()
    for k, label in enumerate(TRUTH):
        mine, alone = table[table["surface"] == label], on(fit, label)
        angle = np.radians(mine["theta_1 [deg]"])
        speed = mine["v_1 [m/s]"]
        made = alone.rebound(fitball.impacts(speed * np.cos(angle), speed * np.sin(angle)))
        np.testing.assert_allclose(mine["v_x2 [m/s]"], made.v_x2[0], rtol=1e-9)
        settings = engine["levels"][k]
        towards = 17.0 * np.sin(np.radians(25.0))
        made = alone.rebound(fitball.impacts(17.0 * np.cos(np.radians(25.0)), towards))
        assert settings["labels"] == {"surface": label}
        assert settings["at_point"]["restitution"] == pytest.approx(made.v_y2[0, 0] / towards, rel=1e-9)
        assert f"## surface {label}" in page and f"| {label} | {settings['at_point']['restitution']:.4f} |" in page
    assert main([*call, "engine", "--level", "surface=Hard", "--overwrite"]) == 0
    one = json.loads((tmp_path / "engine.json").read_text())
    assert one["labels"] == {"surface": "Hard"} and "at_point" in one
    assert "note: surface Clay (wet): largest error of interpolation" in capsys.readouterr().err


def test_a_page_with_sliders_is_of_one_surface(fits):
    fit, _folder = fits["grip-slip"]
    page = page_of(Subject.from_fit(fit, None, {}, {"surface": "Hard"}), None)
    assert "surface Hard" in page and "The model was fitted to impacts from 6 to 14 m/s." in page
    assert repr(float(on(fit, "Hard").point[0])) in page
    assert "The model was fitted" not in page_of(Subject.from_fit(None, "grip-slip", {}), None)


def test_golden_impacts_of_every_surface_are_verified(fits, tmp_path, capsys):
    fit, folder = fits["two-mass"]
    call = ["export", str(folder), "--to", "golden", "--out"]
    hard = ["--level", "surface=Hard"]
    assert main([*call, str(tmp_path / "all.csv")]) == 0 and main([*call, str(tmp_path / "one.csv"), *hard]) == 0
    every = pd.read_csv(tmp_path / "all.csv")
    assert list(every["surface"].unique()) == list(TRUTH) and every["id"].is_unique
    check = ["verify", "--fit", str(folder)]
    assert main([*check, str(tmp_path / "all.csv")]) == 0
    assert main([*check, str(tmp_path / "one.csv"), *hard]) == 0
    assert main([*check, str(tmp_path / "one.csv"), "--level", "surface=Grasé"]) == 2
    # Surfaces exchanged.
    rebounds = ["v_x2 [m/s]", "v_y2 [m/s]", "omega_2 [rad/s]"]
    every.loc[every["surface"] == "Hard", rebounds] = every.loc[every["surface"] == "Grasé", rebounds].to_numpy()
    every.to_csv(tmp_path / "wrong.csv", index=False)
    assert main([*check, str(tmp_path / "wrong.csv")]) == 1
    capsys.readouterr()
    given, labels = joined(bounces_of(fit))
    assert len(labels["surface"]) == len(given.impacts)


def test_parameter_sets_have_the_value_on_each_surface(fits):
    """None that is common to all among those of the model."""
    fit, _folder = fits["grip-slip"]
    content = parameter_content(fit)
    jsonschema.validate(content, schema())
    assert not {"mu", "cor_10", "mu_spread", "mu_place[Hard]"} & content["parameters"].keys()
    for label in TRUTH:
        alone = on(fit, label)
        for name in ("mu", "cor_10"):
            point = content["levels"][name]["values"][label]["point"]
            assert point == pytest.approx(alone.point[alone.names.index(name)], rel=1e-12)
    where = content["golden"]["labels"]["surface"]
    assert set(where) == set(TRUTH) and len(where) == len(content["golden"]["rebound"]["v_x2"])
    names = [row.name for row in paper_rows(fit)]
    assert names[:3] == ["mu[Clay (wet)]", "mu[Hard]", "mu[Grasé]"] and "mu_spread" in names
    assert not [name for name in names if "place" in name or name == "mu"]
    text = latex_table(fit)
    row = rf"$\mu$ Hard & \raggedright {fit.parameters['mu'].meaning}, surface Hard & ${fit.levels[1].point:.4g}$"
    assert row in text


def test_the_table_of_a_paper_marks_the_value_on_a_surface_that_depends_on_an_assumption(fits):
    """With a posterior, a row of a level has the mark of its own verdict, as rows of other parameters have."""
    fit, _folder = fits["grip-slip"]
    known = {"median": 0.6, "sd": 0.01, "q025": 0.58, "q16": 0.59, "q84": 0.61, "q975": 0.62}
    derived = dict(fit.derived)
    for name, verdict in (("mu[Hard]", Verdict.GIVEN), ("mu[Grasé]", Verdict.IDENTIFIED)):
        derived[name] = replace(derived[name], verdict=verdict)
    sampled = replace(fit, levels=tuple(replace(item, **known) for item in fit.levels), derived=derived)
    marks = {row.name: row.mark for row in paper_rows(sampled)}
    assert (marks["mu[Hard]"], marks["mu[Grasé]"]) == ("c", "")
    assert r"$0.600 \pm 0.010$$^{\mathrm{c}}$" in latex_table(sampled)
    assert "depends on model assumptions" in latex_table(sampled)


@pytest.mark.parametrize(
    ("levels", "words"),
    [
        ({"surface": "grass"}, "surface 'grass' was not fitted"),
        ({"court": "Hard"}, r"no parameter of this fit differs between levels of court \(columns: surface\)"),
    ],
)
def test_levels_that_were_not_fitted_are_refused(levels, words, fits):
    fit, _folder = fits["grip-slip"]
    with pytest.raises(ParameterError, match=words):
        fit.export("c", levels=levels)
    with pytest.raises(ParameterError, match="levels is an option of the format c, csharp, engine"):
        fit.export("json", levels={"surface": "Hard"})


def test_a_fit_without_levels_refuses_one(small_fit, capsys):
    assert main(["export", str(small_fit), "--to", "c", "--out", "-", "--level", "surface=clay"]) == 2
    told = capsys.readouterr().err
    assert "--level surface=clay: no parameter of this fit differs between levels of surface" in told
