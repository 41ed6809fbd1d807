"""Exports of a fit and of set values: what stands in each file, what is refused, and that nobody's
text runs.
"""

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.optimize import minimize_scalar
from support.made_fit import made_fit, table_of

import fitball
from fitball import cli
from fitball.base.errors import FitballError
from fitball.base.values import Ball
from fitball.data import bundled
from fitball.exports import FORMATS, engine, parameter_set

NASTY = (
    "</script><script>alert(1)</script>",
    r"\input{/etc/passwd}$%}#",
    "a\n`b`|<img src=x onerror=alert(1)>",
)
LABELS = ("Clay", *NASTY)


@pytest.fixture(scope="module")
def levelled():
    """A point fit of four surfaces, three with names that no file may obey."""
    return fitball.calibrate(table_of(40, surfaces=LABELS), model="grip-slip", point_only=True)


@pytest.fixture(scope="module")
def fit():
    return made_fit(name=NASTY[1], fix={"offset": 0.002})


def parsed(text):
    """JSON without the NaN and Infinity that Python would read."""
    return json.loads(text, parse_constant=lambda name: pytest.fail(name))


def content(made):
    (text,) = made.contents.values()
    return text


def test_json_says_of_every_number_whether_the_data_determine_it(fit):
    found = parsed(content(fit.export(to="json")))
    known = {"identified": True, "given": True}
    for name, one in {**fit.parameters, **fit.derived}.items():
        kept = {**found["parameters"], **found["derived"]}[name]
        assert kept["verdict"] == one.verdict
        assert kept["determined"] == known.get(
            one.verdict,
            False,
        )
        assert (kept["median"], kept["reason"], kept["given"]) == (
            one.median,
            one.reason,
            list(one.given),
        )
    doubtful = {"prior-dominated", "one-sided", "conditional", "extrapolated"}
    assert set(found["not_determined"]) == {
        one.name for one in fit.reported if one.verdict in doubtful
    }
    remarks = found["sets"][0]["remarks"]
    parameters = fit.parameters
    unsure = {
        name
        for name, one in parameters.items()
        if one.kind == "model" and one.verdict != "identified"
    }
    assert set(remarks) == unsure
    assert "offset" in unsure
    assert found["parameters"]["offset"]["verdict"] == "fixed"
    assert found["sets"][0]["values"]["mu"] == fit.point.optima[0]["mu"]
    names = found["correlation"]["names"]
    matrix = np.array(found["correlation"]["values"])
    draws = np.stack([fit.posterior.values[..., k].ravel() for k in range(len(names))])
    centred = draws - draws.mean(axis=1, keepdims=True)
    wanted = (
        centred
        @ centred.T
        / np.outer(np.linalg.norm(centred, axis=1), np.linalg.norm(centred, axis=1))
    )
    assert_allclose(matrix, wanted, atol=1e-12)


def test_each_surface_has_its_own_values_and_range(levelled):
    whole = parsed(content(levelled.export(to="json")))
    assert whole["correlation"] is whole["parameters"]["e_x"]["median"] is None
    assert whole["status"] == "point only"
    assert whole["parameters"]["e_x"]["point"] == levelled.point.optima[0]["e_x"]
    found = whole["sets"]
    assert [one["label"] for one in found] == list(LABELS)
    table = table_of(40, surfaces=LABELS)
    for label, one in zip(LABELS, found, strict=True):
        assert one["values"]["mu"] == levelled.point.optima[0][f"mu[{label}]"]
        speeds = table["v_y1"][table["surface"] == label]
        assert_allclose(
            one["measured"]["v_y1"],
            [speeds.min(), speeds.max()],
            rtol=1e-12,
        )
    (clay,) = parsed(content(levelled.export(to="json", level={"surface": "CLAY"})))["sets"]
    assert clay == found[0]
    (new,) = parameter_set.of_fit(levelled, {"Surface": "new"})
    assert new.values["mu"] == levelled.draws.best["mu[new]"][0]
    assert "mu" in new.sources
    assert len(new.impacts) == 40
    values = np.array([one["values"]["mu"] for one in found])
    assert values.min() < new.values["mu"] < values.max()


def test_published_and_set_values_become_a_set_with_their_sources():
    with (bundled.folder() / "literature" / "priors.csv").open(
        newline="",
        encoding="utf-8",
    ) as file:
        rows = {(row["parameter"], row["key"]): row for row in csv.DictReader(file)}
    found = fitball.export(
        to="json",
        model="two-mass",
        fix={"mu": "literature:clay", "cor_10": "0.7", "k_y": 3e4},
    )
    (one,) = parsed(content(found))["sets"]
    row = rows["mu", "clay"]
    values = one["values"]
    assert (values["mu"], values["cor_10"], values["k_y"]) == (float(row["value"]), 0.7, 3e4)
    assert row["source"] in one["remarks"]["mu"]
    low, high = (float(row["value"]) + end * float(row["sd"]) for end in (-1.96, 1.96))
    assert f"[{low:.2f}, {high:.2f}]" in one["remarks"]["mu"]
    assert one["measured"] is None
    assert {*values} - {*one["remarks"]} == {
        "ball_mass",
        "ball_radius",
        "inertia_ratio",
    }


def cost(one, point, e, inertia, mu):
    """Kinetic energy over mass of the difference between Brody's ball of another inertia and a
    set's rebound.
    """
    ball = Ball(one.values["ball_mass"], one.values["ball_radius"], inertia)
    made = fitball.model("brody", ball=ball).rebound(
        {"mu": mu, "cor_10": e, "cor_slope": 0.0},
        point,
    )
    true = one.model.rebound(one.values, point)
    spin = ball.radius**2 * one.values["inertia_ratio"] * (made.omega_2 - true.omega_2) ** 2
    return float(((made.v_x2 - true.v_x2) ** 2 + (made.v_y2 - true.v_y2) ** 2 + spin)[0])


@pytest.mark.parametrize(
    ("state", "grips"),
    [
        ((25.0, 5.0, 0.0), False),
        ((25.0, 5.0, -200.0), False),
        ((8.0, 15.0, 20.0), True),
        ((2.0, 9.0, 300.0), True),
    ],
)
@pytest.mark.parametrize("inertia", [0.4, 0.56])
def test_engine_settings_are_the_best_of_a_rigid_sphere(state, grips, inertia):
    one = parameter_set.of_model(fitball.model(), {})
    point = fitball.impacts(*state)
    found = engine.settings(one, point, inertia)
    best = minimize_scalar(
        lambda mu: cost(one, point, found.e, inertia, mu),
        bounds=(0.0, 2.0),
        method="bounded",
        options={"xatol": 1e-10},
    )
    assert found.grips is grips
    assert found.errors["v_y2"] == 0.0
    if grips:
        # What fits one such impact best is too little for others: the ball may slip, and bounce on
        # as if on ice.
        made = engine.sphere(found.e, found.mu, inertia, one.values["ball_radius"], point)
        assert made["v_x2"][0] == pytest.approx(
            one.values["ball_radius"] * made["omega_2"][0],
            rel=1e-12,
        )
        assert found.mu >= one.values["mu"]
        assert found.rms["v_x2"] < 3.0
    else:
        assert found.mu == pytest.approx(best.x, abs=1e-6)
        assert cost(one, point, found.e, inertia, found.mu) <= best.fun * (1.0 + 1e-9)


def test_an_engine_with_the_same_ball_makes_no_error():
    one = parameter_set.of_model(
        fitball.model("brody"),
        {"mu": 0.5, "cor_10": 0.75, "cor_slope": 0.0},
    )
    found = engine.settings(one, fitball.impacts(8.0, 9.0, 10.0), one.values["inertia_ratio"])
    # It grips there: the friction is the model's own, which other impacts need.
    assert found.grips
    assert found.mu == 0.5
    assert max(found.rms.values()) < 1e-12
    assert max(map(abs, found.errors.values())) < 1e-12
    # Without slip any friction would do.
    assert engine.settings(one, fitball.impacts(0.0, 9.0, 0.0), 0.4).mu == 0.5
    softer = engine.settings(one, fitball.impacts(8.0, 9.0, 10.0), 0.4)
    assert softer.rms["omega_2"] > 1.0


@pytest.mark.parametrize("e", [0.02, 0.1353, 0.75, 1.0])
def test_the_spring_of_mujoco_parts_at_the_restitution_when_its_force_ends(e):
    stiffness, damping = engine.spring(e, 0.005)
    pressed, speed = expm(0.005 * np.array([[0.0, 1.0], [-stiffness, -damping]])) @ [0.0, 1.0]
    assert speed == pytest.approx(-e, rel=1e-9)
    assert stiffness * pressed + damping * speed == pytest.approx(0.0, abs=1e-9 * stiffness * 0.005)


def test_an_impact_outside_of_the_measured_ones_is_noted_for_each_surface(levelled):
    notes = [
        content(levelled.export(to="engine", at=f"v_1={v},theta_1=40")).count("\n- ")
        for v in (18, 60)
    ]
    assert notes[1] - notes[0] == len(LABELS)


def test_a_drop_test_has_restitution_alone():
    one = parameter_set.of_model(
        fitball.model("two-mass+normal=total", tangential=False),
        {"cor_10": 0.7},
    )
    text = engine.engine([one], "v_y1=10")
    numbers = parsed(engine.as_json([one], "v_y1=10"))["sets"][0]
    assert "0.7000" in text
    assert "| friction mu |" not in text
    assert numbers["settings"][0]["e"] == pytest.approx(0.7)
    assert numbers["settings"][0]["mu"] is None
    with pytest.raises(FitballError) as caught:
        engine.engine([one], "v_1=10, theta_1=30")
    assert caught.value.code == "impact"


def test_nothing_in_latex_is_a_command_of_others(levelled, fit):
    ours = {
        "usepackage",
        "begin",
        "end",
        "centering",
        "caption",
        "small",
        "linewidth",
        "toprule",
        "midrule",
        "bottomrule",
        "raggedright",
        "pm",
        "times",
        "ldots",
        "mathrm",
        "par",
        "smallskip",
        "footnotesize",
        "mu",
        "varepsilon",
        "sigma",
        "theta",
        "omega",
        "textbackslash",
        "textasciicircum",
    }
    for text in (content(levelled.export(to="latex")), content(fit.export(to="latex"))):
        first, rest = text.split("\n", 1)
        assert first == r"% needs \usepackage{booktabs}"
        assert set(re.findall(r"\\([A-Za-z]+)", rest)) <= ours
        assert "textbackslash" in rest
        bare = re.sub(r"\\[^A-Za-z]", "", rest)
        assert "%" not in bare
        assert bare.count("{") == bare.count("}")
        assert bare.count("$") % 2 == 0
        assert all(
            line.count("&") == 4 for line in bare.split("\n") if re.search(r"(?<!\\)&", line)
        )


def test_tables_have_the_rounded_numbers_and_a_note_for_each_doubt(fit):
    latex, markdown = (content(fit.export(to=form)) for form in ("latex", "markdown"))
    one = fit.parameters["mu"]
    row = next(line for line in latex.split("\n") if r"$\mu$" in line)
    value, sd = (float(number) for number in re.search(r"\$([\d.]+) \\pm ([\d.]+)", row).groups())
    assert value == pytest.approx(one.median, abs=0.6 * 10 ** -len(str(value).partition(".")[2]))
    assert sd == pytest.approx(one.half, rel=0.06)
    assert f"{value} ± {sd}" in markdown
    for verdict, mark in (
        ("given", "a"),
        ("conditional", "b"),
        ("one-sided", "d"),
        ("prior-dominated", "e"),
    ):
        name = next(each.name for each in fit.parameters.values() if each.verdict == verdict)
        assert f"({mark})" in next(
            line for line in markdown.split("\n") if line.startswith(f"| `{name}`")
        )


@pytest.mark.parametrize(
    "form",
    [name for name, one in FORMATS.items() if name != "arviz" and not one.measured],
)
def test_every_format_is_made_without_a_fit(form):
    made = fitball.export(to=form, model="two-mass", fix={"mu": "literature:grass"})
    (name,) = made.contents
    assert name == FORMATS[form].file
    assert len(content(made)) > 100


def test_the_command_line_prints_or_writes_the_file_alone(tmp_path, capsys):
    words = ("export", "--model", "brody", "--fix", "mu=literature:clay", "--to", "json")
    assert cli.main(words) == 0
    printed = capsys.readouterr().out
    assert cli.main((*words, "--out", str(tmp_path / "made"))) == 0
    file = tmp_path / "made" / "parameters.json"
    assert capsys.readouterr().out.strip() == str(file)
    assert parsed(printed) == parsed(file.read_text())
    assert [one.name for one in file.parent.iterdir()] == ["parameters.json"]
    assert cli.main((*words, "--out", str(tmp_path / "made"))) == 2
    assert cli.main((*words[:-1], "engine", "--out", str(tmp_path / "made"))) == 0
    file.write_text("older")
    assert cli.main((*words, "--out", str(tmp_path / "made"), "--overwrite")) == 0
    assert parsed(file.read_text()) == parsed(printed)
    assert len(list(file.parent.iterdir())) == 2


def test_a_file_that_is_no_text_is_not_printed(fit):
    with pytest.raises(FitballError) as caught:
        fit.export(to="arviz").report()
    assert caught.value.code == "no-text"


def test_a_sampler_that_did_not_converge_is_named(fit):
    failed = replace(fit, status="not converged")
    failed.__dict__["made"] = fit.made
    assert "converge" in parsed(content(failed.export(to="json")))["origin"]
    assert "converge" not in parsed(content(fit.export(to="json")))["origin"]


def test_a_surface_and_a_ball_that_no_impact_has_together_are_named():
    table = table_of(24, surfaces=("clay", "hard"))
    table["ball"] = np.where(
        table["surface"] == "hard",
        "new ball",
        ["new ball", "new ball", "worn", "worn"] * 6,
    )
    two = fitball.calibrate(
        table,
        model="brody",
        pool={"mu": "surface", "cor_10": "ball"},
        point_only=True,
    )
    sets = parameter_set.of_fit(two, {})
    found = {one.label: len(one.impacts) for one in sets}
    assert found == {"clay, new ball": 6, "clay, worn": 6, "hard, new ball": 12}
    (apart,) = parameter_set.of_fit(two, {"ball": "worn", "surface": "hard"})
    best = two.point.optima[0]
    assert (apart.values["mu"], apart.values["cor_10"]) == (best["mu[hard]"], best["cor_10[worn]"])
    assert len(apart.impacts) == 24
    assert "together" in apart.origin
    assert "together" not in sets[0].origin
