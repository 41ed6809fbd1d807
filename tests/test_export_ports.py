"""Ports in every language against the kernels they are generated from: each is given what its model answers to many
impacts in the place of its dozen golden ones, and tests itself.
"""

from __future__ import annotations

import importlib.util
import json
import math
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from samples import COMPOSITIONS

from fitball.exports.port.languages import c_port, csharp_port, javascript_port
from fitball.exports.port.port import make_port, python_port
from fitball.inference.prediction.outputs import golden
from fitball.inference.prediction.reach import restitution_range, total_rebound, valid_range
from fitball.inference.results.fitted_model import FittedModel
from fitball.models.registry import model
from fitball.models.types import OUTPUTS
from fitball.values import Ball, Impacts

CC = shutil.which("cc") or shutil.which("gcc")
CXX, NODE, MCS, MONO = (shutil.which(name) for name in ("g++", "node", "mcs", "mono"))
needs_cc = pytest.mark.skipif(CC is None, reason="no C compiler here: the C port is generated but not compiled")
NO_CXX = pytest.mark.skipif(CXX is None, reason="no g++ here: the C port is not compiled as C++")
NO_JS = pytest.mark.skipif(NODE is None, reason="no node here: ports in JavaScript are made but not run")
NO_CS = pytest.mark.skipif(None in (MCS, MONO), reason="no mcs and mono here: ports in C# are made but not run")
# A compiler that knows more than C99 takes texts of any length.
FLAGS = ("-std=c99", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Wno-overlength-strings", "-Werror")


def fitted(name, seed=0, impacts=None, **closures):
    """A model with the default priors' medians, scattered a little."""
    made = model(name, **closures)
    middle = {
        "mass_ratio": 0.85, "k_y": 2e4, "k_theta": 25.0, "mu": 0.55, "eps_10": 2.4e-3, "eps_slope": 1e-4,
        "cor_10": 0.77, "cor_slope": -0.015, "zeta_theta": 0.4, "inertia_split": 0.6, "c_y": 5.0, "e_x": 0.1,
        "offset": 2e-3,
    }  # fmt: skip
    names = made.parameter_names
    scatter = np.random.default_rng(seed).uniform(0.97, 1.03, len(names))
    point = np.array([middle[item] for item in names]) * scatter
    given = impacts if impacts is not None else Impacts([15.6, 11.7, 6.6], [4.8, 13.2, 16.1], [-5.0, 10.6, 1.2])
    return FittedModel(name, closures, Ball(), True, names, point, np.empty((0, len(names))), given)


def port_of(found):
    return make_port(found, golden(found, found.impacts), "a test")


MODELS = {
    "brody": {},
    "grip-slip": {},
    "two-mass": {},
    "thesis-exact": {},
    "two-mass, saturating": {"cor": "saturating"},
    "brody, saturating": {"cor": "saturating"},
    "two-mass, measured": {"cor": "measured", "torsion": "rigid"},
    "thesis": {},
    "thesis, given": {"damping": "given", "inertia": "table", "cor": "mean"},
}


def named(label):
    impacts = None
    if "measured" in label:
        impacts = Impacts([15.6, 11.7, 6.6], [4.8, 13.2, 16.1], [-5.0, 10.6, 1.2], [0.8, 0.7, 0.65])
    return port_of(fitted(label.split(",")[0], impacts=impacts, **MODELS[label]))


def run(command, folder):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


# How each language checks itself: the file it is written to, what compiles it without a warning, what runs it.
LANGUAGES = {
    "c": (
        "port.h", c_port, [[CC, *FLAGS, "-x", "c", "-DFITBALL_SELF_TEST", "port.h", "-lm", "-o", "check"]],
        ["./check"],
    ),
    "c++": (
        "port.h", c_port,
        [[CXX, "-std=c++11", *FLAGS[1:], "-x", "c++", "-DFITBALL_SELF_TEST", "port.h", "-lm", "-o", "check"]],
        ["./check"],
    ),
    "python": ("port.py", python_port, [], [sys.executable, "-I", "-S", "port.py"]),
    "javascript": ("port.js", lambda port: javascript_port(port)[".js"], [], [NODE, "port.js"]),
    "csharp": (
        "port.cs", csharp_port,
        [[MCS, "-define:FITBALL_SELF_TEST", "-r:System.Numerics", "-warnaserror", "-out:check.exe", "port.cs"]],
        [MONO, "check.exe"],
    ),
}  # fmt: skip
MARKS = {"c": needs_cc, "c++": NO_CXX, "javascript": NO_JS, "csharp": NO_CS}
ALL = [pytest.param(name, marks=MARKS.get(name, ())) for name in LANGUAGES]


def self_tested(language, port, folder, spoil=lambda text: text):
    """The self-test of a port, run."""
    name, write, compiling, running = LANGUAGES[language]
    (folder / name).write_text(spoil(write(port)), encoding="utf-8")
    for command in compiling:
        run(command, folder)
    return subprocess.run(running, cwd=folder, capture_output=True, text=True, check=False)


def examined(ball, count=250, seed=8):
    """The port of a model with impacts in and out of the valid range, grazes and landings without slip among them, in
    the place of the golden ones; and how many are asked.
    """
    rng, port, valid = np.random.default_rng(seed), port_of(ball), valid_range(ball)
    v_x, v_y, omega = (rng.uniform(-end, end, count) for end in (30.0, 30.0, 500.0))
    v_y, told = np.abs(v_y), rng.uniform(0.4, 1.2, count)
    omega[: count // 4] = v_x[: count // 4] / Ball().radius
    v_y[:2] = 1e-14
    low, high = restitution_range(ball) if port.needs_cor else (0.0, 2.0)
    taken = np.clip(told, low, high)
    expected, outside = total_rebound(ball, valid, Impacts(v_x, v_y, omega, taken if port.needs_cor else None))
    assert outside.any() and not outside.all()
    flags = 1.0 * outside + 2.0 * (taken != told) * port.needs_cor
    rebound = [getattr(expected, name)[0] for name in OUTPUTS]
    solved = expected.status[0] == 0
    assert solved.mean() > 0.5 and len(set(expected.regime[0][solved])) > 3
    rows = np.stack([v_x, v_y, omega, told, *rebound, flags], axis=1)[solved]
    return replace(port, golden=rows.tolist(), regimes=expected.regime[0][solved].tolist()), int(solved.sum())


# Every closure; the languages differ in what they are called, not in what they follow: two of them are enough.
CLOSURES = {f"{name} {' '.join(closures.values())}".strip(): (name, closures) for name, closures in COMPOSITIONS}
CASES = [(language, label) for language in LANGUAGES for label in MODELS]
# Complex numbers of C99 are not those of C++.
CASES = [(language, label) for language, label in CASES if language != "c++" or not label.startswith("thesis")]
CASES += [(language, label) for language in ("c", "python") for label in CLOSURES if label not in MODELS]


@pytest.mark.parametrize(("language", "label"), [pytest.param(*case, marks=MARKS.get(case[0], ())) for case in CASES])
def test_a_port_answers_as_its_model_does(language, label, tmp_path):
    """Speeds, spin and time to 1e-12, phases and what is extrapolated exactly; of compilers no warning."""
    name, closures = CLOSURES[label] if label in CLOSURES else (label.split(",")[0], MODELS[label])
    told = None
    if closures.get("cor") == "measured":
        told = Impacts([15.6, 11.7, 6.6], [4.8, 13.2, 16.1], [-5.0, 10.6, 1.2], [0.8, 0.7, 0.65])
    port, count = examined(fitted(name, impacts=told, **closures))
    done = self_tested(language, port, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{count} golden impacts" in done.stdout and "passed" in done.stdout


@pytest.mark.parametrize("language", ALL)
def test_a_wrong_port_fails_its_own_test(language, tmp_path):
    """Negative controls: a hair of friction too much, another phase, another flag, no rebound."""
    port = port_of(fitted("grip-slip"))
    mu, first = repr(port.call.row[0]), list(port.golden[0])
    wrong = [
        (port, lambda text: text.replace(mu, repr(port.call.row[0] * (1.0 + 1e-10)))),
        (replace(port, regimes=[port.regimes[0] + 1, *port.regimes[1:]]), str),
        (replace(port, golden=[[*first[:-1], 1.0], *port.golden[1:]]), str),
        (replace(port, golden=[[first[0], -1.0, *first[2:]], *port.golden[1:]]), str),
    ]
    assert self_tested(language, port, tmp_path).returncode == 0
    for spoilt, spoil in wrong:
        done = self_tested(language, spoilt, tmp_path, spoil)
        assert done.returncode == 1 and "FAILED" in done.stdout


@pytest.mark.parametrize("language", ALL)
def test_a_wrong_gap_fails_a_ports_own_test(language, tmp_path):
    """Time, path and turn between the flights: each is compared, in all languages."""
    port = port_of(fitted("two-mass"))
    assert self_tested(language, port, tmp_path).returncode == 0
    for place in (8, 9, 10):
        wrong = list(port.golden[0])
        wrong[place] *= 1.0 + 1e-10
        done = self_tested(language, replace(port, golden=[wrong, *port.golden[1:]]), tmp_path)
        assert done.returncode == 1 and "FAILED" in done.stdout, place


def python_module(whole, place):
    return loaded(port_of(whole), place)


def loaded(port, place):
    place.write_text(python_port(port), encoding="utf-8")
    spec = importlib.util.spec_from_file_location(place.stem, place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_faces_refuse_what_is_no_impact(tmp_path):
    module = python_module(fitted("grip-slip"), tmp_path / "port.py")
    assert module.rebound(12.0, 9.0, 20.0)[3:] == (None, "grip", 0, None, None, None)
    assert module.rebound(20.0, 3.0, 0.0)[4] == "slide"
    for bad in ((math.nan, 9.0, 0.0), (10.0, -1.0, 0.0), (10.0, 5.0, math.inf)):
        with pytest.raises(ValueError, match="v_y1 >= 0 towards the court"):
            module.rebound(*bad)
    assert module.rebound(10.0, 90.0, 0.0)[5] == module.BEYOND_SPEEDS


BOTH_WAYS = [(12.0, 9.0, 20.0), (-12.0, 9.0, -20.0)]
WRITTEN = ("v_x2", "v_y2", "omega_2", "contact_time", "gap_time", "gap_path", "gap_turn")
# What calls a port in each language, and writes seven numbers of a line for each impact of BOTH_WAYS.
CALLS = {
    "c": (
        "calls.c",
        '#include <stdio.h>\n#include "port.h"\nint main(void) {\n'
        + "".join(
            f"{{ fitball_rebound_t r = fitball_rebound({x}, {y}, {w});"
            f' printf("{"%.17g " * 7}\\n", {", ".join("r." + name for name in WRITTEN)}); }}\n'
            for x, y, w in BOTH_WAYS
        )
        + "return 0; }",
        [CC, "-std=c99", "calls.c", "-lm", "-o", "calls"],
        ["./calls"],
    ),
    "javascript": (
        "calls.js",
        'const { rebound } = require("./port.js");\n'
        f"for (const at of {json.dumps(BOTH_WAYS)}) {{\n    const r = rebound(...at);\n"
        f'    console.log({json.dumps(WRITTEN)}.map((name) => r[name]).join(" "));\n}}',
        None,
        [NODE, "calls.js"],
    ),
    "csharp": (
        "calls.cs",
        "static class Calls { static void Main() {\n"
        + "".join(
            f"{{ var r = FitballBounce.Rebound({x}, {y}, {w}); foreach (double value in new double[] {{"
            f' {", ".join("r." + name for name in WRITTEN)} }}) System.Console.Write(value.ToString("R", '
            'System.Globalization.CultureInfo.InvariantCulture) + " "); System.Console.WriteLine(); }\n'
            for x, y, w in BOTH_WAYS
        )
        + "} }",
        [MCS, "-r:System.Numerics", "-out:calls.exe", "port.cs", "calls.cs"],
        [MONO, "calls.exe"],
    ),
    "python": (
        "calls.py",
        f"from port import rebound\nfor at in {BOTH_WAYS}:\n    r = rebound(*at)\n"
        f'    print(*(repr(getattr(r, name)) for name in {WRITTEN}))\n',
        None,
        [sys.executable, "calls.py"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("language", [pytest.param(name, marks=MARKS.get(name, ())) for name in CALLS])
def test_a_ball_that_flies_the_other_way_is_mirrored(language, tmp_path):
    """The offset of the normal force is ahead of a ball of either direction: behind it, bounces gain energy."""
    port_name, write, _compiling, _running = LANGUAGES[language]
    (tmp_path / port_name).write_text(write(port_of(fitted("two-mass"))))
    name, text, compiling, running = CALLS[language]
    (tmp_path / name).write_text(text)
    if compiling:
        run(compiling, tmp_path)
    there, back = (tuple(map(float, line.split())) for line in run(running, tmp_path).splitlines())
    v_x2, v_y2, omega_2, contact_time, gap_time, gap_path, gap_turn = there
    assert back == (-v_x2, v_y2, -omega_2, contact_time, gap_time, -gap_path, -gap_turn)
    assert v_x2 > 0.0 and omega_2 > 0.0


def test_golden_impacts_fly_along_the_court_whichever_way_the_table_counts():
    """Ports mirror a ball that flies the other way, so that none is asked for another answer than the model's."""
    left = fitted("two-mass", impacts=Impacts([-15.6, -11.7, 6.6], [4.8, 13.2, 16.1], [5.0, -10.6, 1.2]))
    given = golden(left, left.impacts).impacts
    assert given.v_x1.min() >= 0.0
    np.testing.assert_array_equal(given.omega_1[given.v_x1 == 15.6], -5.0)


def test_a_straight_fall_that_leaves_sideways_is_said():
    """The offset does not vanish at the vertical: who drops a ball in a game is to know."""
    whole = fitted("two-mass")
    v_x2 = whole.rebound(Impacts([0.0], [10.0], [0.0])).v_x2[0, 0]
    assert v_x2 < -0.5
    for write in (c_port, python_port, csharp_port, lambda port: javascript_port(port)[".js"]):
        assert f"leaves with v_x2 = {v_x2:.2f} m/s" in " ".join(write(port_of(whole)).split()).replace(" * ", " ")
        assert "Straight down" not in write(port_of(fitted("brody")))


@pytest.mark.parametrize(
    "write", [c_port, python_port, csharp_port, *(lambda p, e=e: javascript_port(p)[e] for e in (".js", ".mjs"))]
)
def test_a_port_has_the_licence_of_its_code(write):
    licence = Path(__file__).parents[1].joinpath("LICENSE").read_text().split()
    text = [word for word in write(port_of(fitted("brody"))).split() if word != "*"]
    assert " ".join(licence) in " ".join(text)


def test_a_drop_test_ports_its_vertical_motion(tmp_path):
    whole = replace(fitted("two-mass"), tangential=False)
    given = Impacts([0.0], [6.0], [0.0])
    module = python_module(whole, tmp_path / "port.py")
    assert module.rebound(0.0, 6.0, 0.0)[1] == whole.rebound(given).v_y2[0, 0]


def test_python_results_have_names_and_are_tuples_still(tmp_path):
    module = python_module(fitted("two-mass"), tmp_path / "port.py")
    found = module.rebound(12.0, 9.0, 20.0)
    v_x2, v_y2, omega_2, contact_time, regime, extrapolated, gap_time, gap_path, gap_turn = found
    assert (found.v_x2, found.v_y2, found.omega_2) == (v_x2, v_y2, omega_2)
    assert (found.contact_time, found.regime, found.extrapolated) == (contact_time, regime, extrapolated)
    assert (found.gap_time, found.gap_path, found.gap_turn) == (gap_time, gap_path, gap_turn)
    assert found._asdict()["regime"] == regime == "slide-grip-slide back"
    assert repr(found).startswith(f"Rebound(v_x2={v_x2!r}, ")


@NO_JS
def test_javascript_by_name_as_script_and_as_module(tmp_path):
    port = port_of(fitted("grip-slip"))
    for ending, text in javascript_port(port, "red_clay_").items():
        (tmp_path / f"bounce{ending}").write_text(text)
    script = 'import {rebound, selfTest, V_Y1_HIGH} from "./bounce.mjs";\nlet said = "";\n'
    script += "try { rebound(10, -1, 0) } catch (error) { said = error instanceof RangeError && error.message }\n"
    script += "console.log(JSON.stringify([selfTest().passed, rebound(12, 9, 20), V_Y1_HIGH, said]));"
    passed, found, high, said = json.loads(run([NODE, "--input-type=module", "-e", script], tmp_path))
    assert passed and high == port.valid.high and "v_y1 >= 0 towards the court" in said
    assert list(found) == [*OUTPUTS, "regime", "extrapolated"]
    assert {found[name] for name in OUTPUTS[3:]} == {None}
    assert (found["regime"], found["extrapolated"]) == ("grip", 0)
    plain = (
        "new Function(require('fs').readFileSync('bounce.js') + '; return RedClayBounce')().rebound(12, 9, 20).v_y2"
    )
    assert float(run([NODE, "-p", plain], tmp_path)) == found["v_y2"]


CS_CALLS = """
static class Check
{
    static void Main()
    {
        var r = RedClayBounce.Rebound(12, 9, 20, COR);
        string said = "";
        try { RedClayBounce.Rebound(double.NaN, 9, 20, COR); }
        catch (System.ArgumentException error) { said = error.Message; }
        var culture = System.Globalization.CultureInfo.InvariantCulture;
        System.Console.Write(string.Format(culture, "{0:R}|{1}|{2}|{3}", r.v_y2, r.regime, r.extrapolated, said));
    }
}
"""


@NO_CS
def test_csharp_by_name_beside_code_of_others(tmp_path):
    told = fitted("two-mass", impacts=Impacts([15.6], [9.0], [-5.0], [0.7]), cor="measured", torsion="rigid")
    (tmp_path / "port.cs").write_text(csharp_port(port_of(told), "red_clay_"))
    (tmp_path / "check.cs").write_text(CS_CALLS.replace("COR", "0.7"))
    run([MCS, "-r:System.Numerics", "-warnaserror", "-out:check.exe", "port.cs", "check.cs"], tmp_path)
    v_y2, regime, extrapolated, said = run([MONO, "check.exe"], tmp_path).split("|")
    module = python_module(told, tmp_path / "port.py")
    found = module.rebound(12.0, 9.0, 20.0, 0.7)
    assert float(v_y2) == pytest.approx(found.v_y2, rel=1e-12)
    assert (regime, int(extrapolated)) == (found.regime, found.extrapolated)
    assert "finite cor" in said and "v_y1 >= 0 towards the court" in said
