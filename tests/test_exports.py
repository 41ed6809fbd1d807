"""Exports of a fit and of set values: what stands in each file, what is refused, and that nobody's
text runs.
"""

import csv
import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.optimize import minimize_scalar
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball import cli
from fitball.base.errors import FitballError
from fitball.base.values import Ball
from fitball.data import bundled
from fitball.exports import FORMATS, engine, engine_page, parameter_set

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
    return fit_by_hand(name=NASTY[1], fix={"offset": 0.002})


def parsed(text):
    """JSON without the NaN and Infinity that Python would read."""
    return json.loads(text, parse_constant=lambda name: pytest.fail(name))


def content(exported):
    """The text of the only file."""
    (text,) = exported.contents.values()
    return text


def test_json_says_of_every_number_whether_the_data_determine_it(fit):
    exported = parsed(content(fit.export(to="json")))
    quantities = {**exported["parameters"], **exported["derived"]}
    for name, estimate in {**fit.parameters, **fit.derived}.items():
        quantity = quantities[name]
        assert quantity["verdict"] == estimate.verdict
        assert quantity["determined"] == (estimate.verdict in ("identified", "given"))
        assert quantity["median"] == estimate.median
        assert quantity["reason"] == estimate.reason
        assert quantity["given"] == list(estimate.given)
    doubtful = {"prior-dominated", "one-sided", "conditional", "extrapolated"}
    not_determined = {estimate.name for estimate in fit.reported if estimate.verdict in doubtful}
    assert set(exported["not_determined"]) == not_determined
    (only_set,) = exported["sets"]
    unsure = set()
    for name, estimate in fit.parameters.items():
        if estimate.kind == "model" and estimate.verdict != "identified":
            unsure.add(name)
    assert set(only_set["remarks"]) == unsure
    assert "offset" in unsure
    assert exported["parameters"]["offset"]["verdict"] == "fixed"
    assert only_set["values"]["mu"] == fit.point.optima[0]["mu"]
    count = len(exported["correlation"]["names"])
    matrix = exported["correlation"]["values"]
    draws = [fit.posterior.values[..., k].ravel() for k in range(count)]
    assert_allclose(matrix, np.corrcoef(draws), atol=1e-12)


def test_each_surface_has_its_own_values_and_range(levelled):
    exported = parsed(content(levelled.export(to="json")))
    e_x = exported["parameters"]["e_x"]
    best = levelled.point.optima[0]
    assert exported["correlation"] is None
    assert exported["status"] == "point only"
    assert e_x["median"] is None
    assert e_x["point"] == best["e_x"]
    sets = exported["sets"]
    assert [each["label"] for each in sets] == list(LABELS)
    table = table_of(40, surfaces=LABELS)
    for label, each in zip(LABELS, sets, strict=True):
        assert each["values"]["mu"] == best[f"mu[{label}]"]
        speeds = table["v_y1"][table["surface"] == label]
        measured = [speeds.min(), speeds.max()]
        assert_allclose(each["measured"]["v_y1"], measured, rtol=1e-12)
    of_clay = levelled.export(to="json", level={"surface": "CLAY"})
    assert parsed(content(of_clay))["sets"] == sets[:1]
    (new,) = parameter_set.sets_of_fit(levelled, {"Surface": "new"})
    assert new.values["mu"] == levelled.draws.best["mu[new]"][0]
    assert "mu" in new.sources
    assert len(new.impacts) == 40
    values = [each["values"]["mu"] for each in sets]
    assert min(values) < new.values["mu"] < max(values)


def published(parameter, key):
    """The row of a published prior, read here."""
    path = bundled.datasets_folder() / "literature" / "priors.csv"
    with path.open(newline="", encoding="utf-8") as file:
        rows = {(row["parameter"], row["key"]): row for row in csv.DictReader(file)}
    return rows[parameter, key]


def test_published_and_set_values_become_a_set_with_their_sources():
    exported = fitball.export(
        to="json",
        model="two-mass",
        fix={"mu": "literature:clay", "cor_10": "0.7", "k_y": 3e4},
    )
    (only_set,) = parsed(content(exported))["sets"]
    row = published("mu", "clay")
    value = float(row["value"])
    sd = float(row["sd"])
    values = only_set["values"]
    remarks = only_set["remarks"]
    assert values["mu"] == value
    assert values["cor_10"] == 0.7
    assert values["k_y"] == 3e4
    assert row["source"] in remarks["mu"]
    low = value - 1.96 * sd
    high = value + 1.96 * sd
    assert f"[{low:.2f}, {high:.2f}]" in remarks["mu"]
    assert only_set["measured"] is None
    assert {*values} - {*remarks} == {
        "ball_mass",
        "ball_radius",
        "inertia_ratio",
    }


def cost(parameters, point, e, inertia, mu):
    """Kinetic energy over mass of the difference between Brody's ball of another inertia and a
    set's rebound.
    """
    values = parameters.values
    ball = Ball(values["ball_mass"], values["ball_radius"], inertia)
    brody = fitball.model("brody", ball=ball)
    sphere = brody.rebound({"mu": mu, "cor_10": e, "cor_slope": 0.0}, point)
    exact = parameters.model.rebound(values, point)
    v_x = sphere.v_x2[0] - exact.v_x2[0]
    v_y = sphere.v_y2[0] - exact.v_y2[0]
    omega = sphere.omega_2[0] - exact.omega_2[0]
    return v_x**2 + v_y**2 + values["inertia_ratio"] * (ball.radius * omega) ** 2


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
    parameters = parameter_set.set_of_model(fitball.model(), {})
    point = fitball.impacts(*state)
    settings = engine.settings(parameters, point, inertia)

    def cost_of_friction(mu):
        return cost(parameters, point, settings.e, inertia, mu)

    best = minimize_scalar(
        cost_of_friction,
        bounds=(0.0, 2.0),
        method="bounded",
        options={"xatol": 1e-10},
    )
    assert settings.grips is grips
    assert settings.errors["v_y2"] == 0.0
    if grips:
        # What fits one such impact best is too little for others: the ball may slip, and bounce on
        # as if on ice.
        radius = parameters.values["ball_radius"]
        rebound = engine.sphere(settings.e, settings.mu, inertia, radius, point)
        surface_speed = radius * rebound["omega_2"][0]
        assert rebound["v_x2"][0] == pytest.approx(surface_speed, rel=1e-12)
        assert settings.mu >= parameters.values["mu"]
        assert settings.rms["v_x2"] < 3.0
    else:
        assert settings.mu == pytest.approx(best.x, abs=1e-6)
        assert cost_of_friction(settings.mu) <= best.fun * (1.0 + 1e-9)


def test_an_engine_with_the_same_ball_makes_no_error():
    parameters = parameter_set.set_of_model(
        fitball.model("brody"),
        {"mu": 0.5, "cor_10": 0.75, "cor_slope": 0.0},
    )
    point = fitball.impacts(8.0, 9.0, 10.0)
    exact = engine.settings(parameters, point, parameters.values["inertia_ratio"])
    # It grips there: the friction is the model's own, which other impacts need.
    assert exact.grips
    assert exact.mu == 0.5
    assert max(exact.rms.values()) < 1e-12
    assert max(map(abs, exact.errors.values())) < 1e-12
    # Without slip any friction would do.
    without_slip = fitball.impacts(0.0, 9.0, 0.0)
    assert engine.settings(parameters, without_slip, 0.4).mu == 0.5
    other_inertia = engine.settings(parameters, point, 0.4)
    assert other_inertia.rms["omega_2"] > 1.0


@pytest.mark.parametrize("e", [0.02, 0.1353, 0.75, 1.0])
def test_the_spring_of_mujoco_parts_at_the_restitution_when_its_force_ends(e):
    time = 0.005
    stiffness, damping = engine.spring(e, time)
    motion = np.array([[0.0, 1.0], [-stiffness, -damping]])
    pressed, speed = expm(time * motion) @ [0.0, 1.0]
    force = stiffness * pressed + damping * speed
    assert speed == pytest.approx(-e, rel=1e-9)
    assert force == pytest.approx(0.0, abs=1e-9 * stiffness * time)


def test_an_impact_outside_of_the_measured_ones_is_noted_for_each_surface(levelled):
    def count_of_notes(speed):
        exported = levelled.export(to="engine", at=f"v_1={speed},theta_1=40")
        return content(exported).count("\n- ")

    assert count_of_notes(60) - count_of_notes(18) == len(LABELS)


def test_a_drop_test_has_restitution_alone():
    vertical = fitball.model("two-mass+normal=total", tangential=False)
    parameters = parameter_set.set_of_model(vertical, {"cor_10": 0.7})
    text = engine_page.settings_page([parameters], "v_y1=10")
    assert "0.7000" in text
    assert "| friction mu |" not in text
    exported = parsed(engine_page.settings_json([parameters], "v_y1=10"))
    settings = exported["sets"][0]["settings"][0]
    assert settings["e"] == pytest.approx(0.7)
    assert settings["mu"] is None
    with pytest.raises(FitballError) as caught:
        engine_page.settings_page([parameters], "v_1=10, theta_1=30")
    assert caught.value.code == "impact"


def test_nothing_in_latex_is_a_command_of_others(levelled, fit):
    ours = {
        "usepackage",
        "begin",
        "end",
        "centering",
        "caption",
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
        "setlength",
        "tabcolsep",
        "parbox",
        "allowbreak",
        "num",
        "unit",
        "percent",
        "mu",
        "varepsilon",
        "sigma",
        "theta",
        "omega",
        "textbackslash",
        "textasciicircum",
    }
    texts = [
        content(source.export(to=to)) for source in (levelled, fit) for to in ("latex", "siunitx")
    ]
    for text in texts:
        rest = "".join(line for line in text.splitlines(keepends=True) if line[:1] != "%")
        assert set(re.findall(r"\\([A-Za-z]+)", rest)) <= ours
        assert "textbackslash" in rest
        bare = re.sub(r"\\[^A-Za-z]", "", rest)
        assert "%" not in bare
        assert bare.count("{") == bare.count("}")
        assert bare.count("$") % 2 == 0
        for line in bare.split("\n"):
            if re.search(r"(?<!\\)&", line):
                assert line.count("&") == 2


def test_tables_have_the_rounded_numbers_and_a_note_for_each_doubt(fit):
    latex = content(fit.export(to="latex"))
    markdown = content(fit.export(to="markdown"))
    mu = fit.parameters["mu"]
    row = next(line for line in latex.split("\n") if r"$\mu$" in line)
    value, sd = map(float, re.search(r"\$([\d.]+) \\pm ([\d.]+)", row).groups())
    digits = len(str(value).partition(".")[2])
    assert value == pytest.approx(mu.median, abs=0.6 * 10**-digits)
    assert sd == pytest.approx(mu.half, rel=0.06)
    assert f"{value} ± {sd}" in markdown
    lines = markdown.split("\n")
    marks = []
    verdicts = fit.summary["verdict"]
    for line in lines:
        name = re.match(r"\| `([^`]+)`", line)
        if name:
            mark = re.search(r"\((\w)\) \|", line)
            assert (mark is None) == (verdicts[name[1]] in ("identified", "fixed"))
            marks.append((mark[1] if mark else "", verdicts[name[1]]))
    # Each verdict has its own letter, in the order of the first rows.
    letters = [mark for mark in dict(marks) if mark]
    assert letters == list("abcde")[: len(letters)]
    assert len(letters) > 2
    assert len({verdict for mark, verdict in marks if mark}) == len(letters)
    assert [line[1] for line in lines if re.match(r"\(\w\) ", line)] == letters


def test_tables_have_the_rows_that_are_chosen(fit):
    latex = content(fit.export(to="latex", parameters=["cor_10", "mu"]))
    rows = [line for line in latex.splitlines() if line.count("&") == 2][1:]
    assert len(rows) == 2
    assert r"\mu" in rows[1]
    assert content(fit.export(to="markdown", parameters="mu")).count("| `") == 1
    siunitx = content(fit.export(to="siunitx", parameters="mu"))
    mu = fit.parameters["mu"]
    value, sd = map(float, re.search(r"\\num\{([\d.]+) \+- ([\d.]+)\}", siunitx).groups())
    assert value == pytest.approx(mu.median, abs=0.6 * sd)
    ends = re.search(r"\[\\num\{([\d.]+)\}, \\num\{([\d.]+)\}\]", siunitx).groups()
    assert list(map(float, ends)) == pytest.approx([mu.q025, mu.q975], abs=0.5 * sd)
    for options, code in (
        ({"to": "latex", "parameters": "mo"}, "unknown-quantity"),
        ({"to": "json", "parameters": "mu"}, "not-for-this-format"),
    ):
        with pytest.raises(FitballError) as caught:
            fit.export(**options)
        assert caught.value.code == code


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no LaTeX here")
@pytest.mark.parametrize("to", ["latex", "siunitx"])
@pytest.mark.parametrize("columns", ["", "twocolumn"])
def test_no_line_of_a_table_is_wider_than_its_column(levelled, fit, tmp_path, to, columns):
    tables = [content(source.export(to=to)) for source in (levelled, fit)]
    document = "\n".join(
        [
            rf"\documentclass[{columns}]{{article}}\usepackage{{booktabs,siunitx}}",
            r"\usepackage[T1]{fontenc}\begin{document}",
            *tables,
            r"\end{document}",
        ]
    )
    (tmp_path / "paper.tex").write_text(document)
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout[-1000:]
    assert "Overfull" not in run.stdout


WITHOUT_FIT = [name for name, form in FORMATS.items() if name != "arviz" and not form.needs_fit]


@pytest.mark.parametrize("form", WITHOUT_FIT)
def test_every_format_is_made_without_a_fit(form):
    exported = fitball.export(to=form, model="two-mass", fix={"mu": "literature:grass"})
    (name,) = exported.contents
    assert name == FORMATS[form].file
    assert len(content(exported)) > 100


@pytest.mark.parametrize(
    ("ending", "form"), [("js", "javascript"), (".py", "python"), ("gd", "gdscript"), ("h", "c")]
)
def test_the_ending_of_a_file_leads_to_its_format(ending, form):
    with pytest.raises(FitballError) as caught:
        fitball.export(to=ending, model="two-mass", fix={"mu": "literature:grass"})
    assert caught.value.code == "unknown-format"
    assert f"'{form}'" in str(caught.value)


def test_the_command_line_prints_or_writes_the_file_alone(tmp_path, capsys):
    words = ("export", "--model", "brody", "--fix", "mu=literature:clay", "--to", "json")
    as_engine = (*words[:-1], "engine")
    folder = tmp_path / "folder"
    out = ("--out", str(folder))
    assert cli.main(words) == 0
    printed = capsys.readouterr().out
    assert cli.main((*words, *out)) == 0
    file = folder / "parameters.json"
    assert capsys.readouterr().out.strip() == str(file)
    assert parsed(printed) == parsed(file.read_text())
    assert list(folder.iterdir()) == [file]
    assert cli.main((*words, *out)) == 2
    assert cli.main((*as_engine, *out)) == 0
    file.write_text("older")
    assert cli.main((*words, *out, "--overwrite")) == 0
    assert parsed(file.read_text()) == parsed(printed)
    assert len(list(folder.iterdir())) == 2


def test_a_file_that_is_no_text_is_not_printed(fit):
    with pytest.raises(FitballError) as caught:
        fit.export(to="arviz").report()
    assert caught.value.code == "no-text"


def test_a_sampler_that_did_not_converge_is_named(fit):
    failed = replace(fit, status="not converged")
    failed.__dict__["built"] = fit.built
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
    sets = parameter_set.sets_of_fit(two, {})
    counts = {each.label: len(each.impacts) for each in sets}
    assert counts == {
        "clay, new ball": 6,
        "clay, worn": 6,
        "hard, new ball": 12,
    }
    (apart,) = parameter_set.sets_of_fit(two, {"ball": "worn", "surface": "hard"})
    best = two.point.optima[0]
    assert apart.values["mu"] == best["mu[hard]"]
    assert apart.values["cor_10"] == best["cor_10[worn]"]
    assert len(apart.impacts) == 24
    assert "together" in apart.origin
    assert "together" not in sets[0].origin
