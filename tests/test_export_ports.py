"""Ports in C and Python against the kernels they are generated from, and what the generators refuse."""

from __future__ import annotations

import importlib.util
import itertools
import math
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from fitball.exports.port.languages import c_port
from fitball.exports.port.port import make_port, python_port
from fitball.inference.prediction.outputs import golden
from fitball.inference.results.fitted_model import FittedModel
from fitball.models.registry import model
from fitball.models.types import Closures
from fitball.values import Ball, Impacts

CC = shutil.which("cc") or shutil.which("gcc")
needs_cc = pytest.mark.skipif(CC is None, reason="no C compiler here: the C port is generated but not compiled")
FLAGS = ("-std=c99", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
# Of speeds relative to the incident speed, of times to themselves; what a port promises.
AGREEMENT = 1e-12

# Reads `row codes v_x v_y omega cor` and prints `status v_x2 v_y2 omega_2 contact_time regime` for each line.
C_HARNESS = """
#include <stdio.h>
#include PORT

int main(void)
{
    double row[13], v[4];
    long long c[8];
    for (;;) {
        for (int k = 0; k < 13; ++k) if (scanf("%lf", &row[k]) != 1) return 0;
        for (int k = 0; k < 8; ++k) if (scanf("%lld", &c[k]) != 1) return 1;
        for (int k = 0; k < 4; ++k) if (scanf("%lf", &v[k]) != 1) return 1;
        const int64_t codes[8] = {c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7]};
        double function[44], twist[44], drive[44], stack[5 * 57];
        const fitball_Scratch scratch = {function, twist, drive, stack};
        const fitball_Bounce b = fitball_bounce(row, codes, v[0], v[1], v[2], v[3], scratch);
        printf("%d %.17g %.17g %.17g %.17g %lld\\n",
               (int)b.status, b.v_x2, b.v_y2, b.omega_2, b.contact_time, (long long)b.regime);
    }
}
"""

PYTHON_HARNESS = """
import importlib.util, sys
spec = importlib.util.spec_from_file_location("port", sys.argv[1])
port = importlib.util.module_from_spec(spec)
spec.loader.exec_module(port)
for line in sys.stdin:
    cells = line.split()
    row, codes = list(map(float, cells[:13])), list(map(int, cells[13:21]))
    scratch = port.Scratch([0.0] * 44, [0.0] * 44, [0.0] * 44, {})
    b = port.bounce(row, codes, *map(float, cells[21:]), scratch)
    print(*map(repr, (b.status, b.v_x2, b.v_y2, b.omega_2, b.contact_time, b.regime)))
assert not {"numpy", "numba"} & set(sys.modules)
"""


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


def all_closures():
    return [
        Closures(*chosen)
        for chosen in itertools.product(
            ("zero_displacement", "zero_force"), ("inner", "momentum", "total"), ("grip", "contact"),
            ("shell", "mean"), ("table", "tied"), ("matched", "free", "rigid"),
            ("line", "mean", "measured", "saturating"),
        )
    ]  # fmt: skip


@pytest.fixture(scope="session")
def random_cases(draw_priors):
    """Lines `row codes impact` over closures and priors, the kernel's answers, and the incident speeds."""
    rng = np.random.default_rng(20)
    lines, answers, speeds = [], [], []
    chosen = all_closures()
    for k in rng.permutation(len(chosen))[:COUNT]:
        made = model("two-mass", **{name: getattr(chosen[k], name) for name in Closures.__dataclass_fields__})
        values = draw_priors(made, rng, 1)
        call = made.kernel_call(made.parameter_names, values[0])
        v_x, v_y, omega = rng.uniform(-30, 30, 2), rng.uniform(1.0, 25.0, 2), rng.uniform(-500.0, 500.0, 2)
        cor = rng.uniform(0.4, 0.9, 2)
        # A ball that lands without slip, in half of the closures.
        if rng.uniform() < 0.5:
            omega[1] = v_x[1] / made.ball.radius
        found = made.evaluate(made.parameter_names, values, Impacts(v_x, v_y, omega, cor))
        for j in range(2):
            numbers = [*call.row, *call.codes, v_x[j], v_y[j], omega[j], cor[j]]
            lines.append(" ".join(repr(float(item)) if not isinstance(item, int) else str(item) for item in numbers))
            values_out = [getattr(found, name)[0, j] for name in ("v_x2", "v_y2", "omega_2", "contact_time")]
            answers.append([found.status[0, j], *values_out, found.regime[0, j]])
            speeds.append(math.sqrt(v_x[j] ** 2 + v_y[j] ** 2 + (made.ball.radius * omega[j]) ** 2))
    return lines, np.array(answers, dtype=float), np.array(speeds)


COUNT = 216


def differences(text, answers, speeds):
    """Largest relative difference; statuses and regimes must be equal."""
    rows = np.array([[float(cell) for cell in line.split()] for line in text.splitlines()])
    assert rows.shape == answers.shape
    np.testing.assert_array_equal(rows[:, 0], answers[:, 0])
    solved = answers[:, 0] == 0
    np.testing.assert_array_equal(rows[solved, 5], answers[solved, 5])
    assert solved.mean() > 0.5
    assert len(set(answers[solved, 5])) > 5
    scale = np.stack([speeds, speeds, speeds / Ball().radius, answers[:, 4]], axis=1)[solved]
    return float(np.max(np.abs(rows - answers)[solved, 1:5] / scale))


@pytest.fixture(scope="session")
def compiled_kernel(tmp_path_factory):
    """The general two-mass kernel in C, compiled."""
    folder = tmp_path_factory.mktemp("port")
    (folder / "port.h").write_text(c_port(port_of(fitted("two-mass"))))
    (folder / "main.c").write_text(C_HARNESS)
    done = subprocess.run(
        [CC, *FLAGS, '-DPORT="port.h"', "main.c", "-lm", "-o", "main"],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder / "main"


@needs_cc
def test_the_c_kernel_agrees_over_closures_and_priors(compiled_kernel, random_cases):
    lines, answers, speeds = random_cases
    done = subprocess.run([compiled_kernel], input="\n".join(lines), capture_output=True, text=True, check=True)
    assert differences(done.stdout, answers, speeds) < AGREEMENT


def test_the_python_kernel_agrees_over_closures_and_priors(tmp_path, random_cases):
    lines, answers, speeds = random_cases
    place = tmp_path / "port.py"
    place.write_text(python_port(port_of(fitted("two-mass"))))
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", PYTHON_HARNESS, str(place)],
        input="\n".join(lines), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert differences(done.stdout, answers, speeds) < AGREEMENT


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


@pytest.mark.parametrize("label", MODELS)
def test_the_python_module_passes_its_own_test_with_nothing_but_math(label, tmp_path):
    place = tmp_path / "port.py"
    place.write_text(python_port(named(label)))
    done = subprocess.run(
        [sys.executable, "-I", "-S", str(place)], capture_output=True, text=True, check=False
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "golden impacts" in done.stdout and "passed" in done.stdout


def run_header(text, folder):
    (folder / "port.h").write_text(text)
    done = subprocess.run(
        [CC, *FLAGS, "-x", "c", "-DFITBALL_SELF_TEST", "port.h", "-lm", "-o", "check"],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return subprocess.run([folder / "check"], capture_output=True, text=True, check=False)


@needs_cc
@pytest.mark.parametrize("label", MODELS)
def test_the_header_compiles_without_a_warning_and_passes_its_own_test(label, tmp_path):
    done = run_header(c_port(named(label)), tmp_path)
    assert done.returncode == 0, done.stdout
    assert "12 golden impacts" in done.stdout and "passed" in done.stdout


@needs_cc
def test_a_wrong_port_fails_its_own_test(tmp_path):
    """Negative control: a hair of friction too much, in both languages."""
    port = named("grip-slip")
    mu = repr(port.call.row[0])
    wrong = repr(port.call.row[0] * (1.0 + 1e-10))
    assert run_header(c_port(port).replace(mu, wrong), tmp_path).returncode == 1
    (tmp_path / "port.py").write_text(python_port(port).replace(mu, wrong))
    done = subprocess.run([sys.executable, "-I", "-S", str(tmp_path / "port.py")], capture_output=True, check=False)
    assert done.returncode == 1
    assert b"FAILED" in done.stdout


@needs_cc
def test_the_faces_agree_with_the_model_on_random_impacts(tmp_path):
    """`rebound` of both ports, four models in one program, on impacts of every regime."""
    names = ("brody", "grip-slip", "two-mass", "thesis-exact")
    rng = np.random.default_rng(4)
    given = Impacts(rng.uniform(-30, 30, 100), rng.uniform(9, 25, 100), rng.uniform(-500, 500, 100))
    main, found = ["#include <stdio.h>"], {}
    calls = []
    for k, name in enumerate(names):
        whole = fitted(name)
        (tmp_path / f"p{k}.h").write_text(c_port(port_of(whole), f"p{k}_"))
        found[name] = (whole.rebound(given), python_module(whole, tmp_path / f"p{k}.py"))
        main.append(f'#include "p{k}.h"')
        calls.append(
            f"{{ const p{k}_rebound_t r = p{k}_rebound(x, y, w);"
            ' printf("%.17g %.17g %.17g %.17g %lld %d\\n",'
            " r.v_x2, r.v_y2, r.omega_2, r.contact_time, (long long)r.regime, r.status); }"
        )
    main += ["int main(void) {", "double x, y, w;", 'while (scanf("%lf %lf %lf", &x, &y, &w) == 3) {', *calls, "}}"]
    (tmp_path / "main.c").write_text("\n".join(main))
    built = subprocess.run(
        [CC, *FLAGS, "main.c", "-lm", "-o", "main"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stderr
    states = np.stack([given.v_x1, given.v_y1, given.omega_1], axis=1).tolist()
    text = "\n".join(" ".join(map(repr, state)) for state in states)
    done = subprocess.run([tmp_path / "main"], input=text, capture_output=True, text=True, check=True)
    rows = np.array([[float(cell) for cell in line.split()] for line in done.stdout.splitlines()])
    speed = np.sqrt(given.v_x1**2 + given.v_y1**2 + (Ball().radius * given.omega_1) ** 2)
    for k, name in enumerate(names):
        expected, module = found[name]
        assert np.all(expected.status == 0)
        mine = rows[k :: len(names)]
        solved = [module.solve(*item) for item in zip(given.v_x1, given.v_y1, given.omega_1, strict=True)]
        theirs = np.array([(s.v_x2, s.v_y2, s.omega_2, s.contact_time, s.regime) for s in solved], dtype=float)
        for got in (mine, theirs):
            for column, weight, output in ((0, 1.0, "v_x2"), (1, 1.0, "v_y2"), (2, Ball().radius, "omega_2")):
                error = weight * np.abs(got[:, column] - getattr(expected, output)[0]) / speed
                assert error.max() < AGREEMENT, (name, output)
            np.testing.assert_array_equal(got[:, 4], expected.regime[0])
            if name in ("two-mass", "thesis-exact"):
                np.testing.assert_allclose(got[:, 3], expected.contact_time[0], rtol=AGREEMENT)
            else:
                assert np.all(np.isnan(got[:, 3]))
        assert np.all(mine[:, 5] == 0)


def python_module(whole, place):
    place.write_text(python_port(port_of(whole)))
    spec = importlib.util.spec_from_file_location(place.stem, place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_faces_refuse_what_is_no_impact(tmp_path):
    module = python_module(fitted("grip-slip"), tmp_path / "port.py")
    assert module.rebound(12.0, 9.0, 20.0)[3:] == (None, "grip", 0)
    assert module.rebound(20.0, 3.0, 0.0)[4] == "slide"
    for bad in ((math.nan, 9.0, 0.0), (10.0, -1.0, 0.0), (10.0, 5.0, math.inf)):
        with pytest.raises(ValueError, match="v_y1 >= 0 towards the court"):
            module.rebound(*bad)
    assert module.rebound(10.0, 90.0, 0.0)[5] == module.BEYOND_SPEEDS


def test_a_drop_test_ports_its_vertical_motion(tmp_path):
    whole = replace(fitted("two-mass"), tangential=False)
    given = Impacts([0.0], [6.0], [0.0])
    module = python_module(whole, tmp_path / "port.py")
    assert module.rebound(0.0, 6.0, 0.0)[1] == whole.rebound(given).v_y2[0, 0]
