"""A new algebraic model is one kernel, one face and one entry in the registry: the whole road of a toy."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib.resources import files

import jsonschema
import numba
import numpy as np
import pytest
from samples import leave_out_figures, search_briefly

import fitball
from fitball.cli.main import main
from fitball.data.read import load_table
from fitball.inference.comparison.candidates import default_names
from fitball.models.impulse import ImpulseModel
from fitball.models.registry import MODELS, Entry
from fitball.models.specs import ParameterSpec, specs
from fitball.models.types import GRIP
from fitball.values import FloatArray

CC = shutil.which("cc") or shutil.which("gcc")
COLUMNS = ("e_y", "e_x", "drag", "ball_mass", "ball_radius", "ball_inertia")
OK, TOO_LIVELY = 0, 1

# Without the cache on disk of fitball's own kernels, which knows the files of the package only.
compiled = numba.njit(error_model="numpy")


@compiled
def toy_bounce(row: FloatArray, v_x: float, v_y: float, omega: float) -> tuple[int, float, float, float, int]:
    """Constant restitutions both ways, and a share `drag` of the velocity along the court lost besides."""
    e_y, e_x, drag, mass, radius, inertia = row
    if not 0.0 < e_y.real <= 1.0:
        nothing = math.nan + 0.0 * e_y
        return TOO_LIVELY, nothing, nothing, nothing, 0
    a = inertia / (mass * radius * radius)
    change = a / (1.0 + a) * (1.0 + e_x) * (v_x - radius * omega)
    return OK, (1.0 - drag) * v_x - change, e_y * v_y, omega + mass * radius * change / inertia, GRIP


@compiled
def toy_batch(rows, v_x1, v_y1, omega_1, out, regime, status):
    for i in range(rows.shape[0]):
        own = i if v_x1.shape[0] > 1 else 0
        for j in range(v_x1.shape[1]):
            found, v_x2, v_y2, omega_2, phase = toy_bounce(rows[i], v_x1[own, j], v_y1[own, j], omega_1[own, j])
            out[0, i, j], out[1, i, j], out[2, i, j] = v_x2, v_y2, omega_2
            regime[i, j], status[i, j] = phase, found


@dataclass(frozen=True)
class ToyModel(ImpulseModel):
    kernel = staticmethod(toy_bounce)
    batch = staticmethod(toy_batch)
    columns = COLUMNS


TOY = (
    ParameterSpec("e_y", "", 0.0, 1.0, "uniform(0, 1)", "normal restitution at every speed", "$e_y$"),
    *specs("e_x"),
    ParameterSpec("drag", "", -1.0, 1.0, "normal(0, 0.3)", "share of v_x lost besides", "$d$"),
)


@pytest.fixture(scope="module", autouse=True)
def registered():
    with pytest.MonkeyPatch.context() as patched:
        search_briefly(patched)
        leave_out_figures(patched)
        patched.setitem(MODELS, "toy", Entry(ToyModel.composer(TOY, TOY[:1]), candidates=("toy",)))
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The toy calibrated at the command line."""
    out = tmp_path_factory.mktemp("toy") / "fit"
    words = ["calibrate", "wang_zero_spin.csv", "--model", "toy", "--seed", "1", "--cores", "1", "--max-steps", "300"]
    assert main([*words, "--quiet", "--out", str(out)]) in (0, 1)
    return out


def test_its_rebounds_and_derivatives():
    toy = fitball.model("toy")
    values = np.array([[0.7, 0.3, 0.1]])
    given = fitball.impacts([10.0, 8.0], [9.0, 12.0], [100.0, -50.0])
    found = toy.jacobian(toy.parameter_names, values, given)
    np.testing.assert_allclose(found.rebound.v_y2, [[6.3, 8.4]])
    np.testing.assert_allclose(found.parameters[0, :, 1, 0], [9.0, 12.0])
    np.testing.assert_allclose(found.parameters[0, :, 0, 2], [-10.0, -8.0])
    assert np.all(np.isnan(found.rebound.contact_time))
    assert toy.linear_constraints(given) == () and toy.oracle is None and not toy.has_force
    assert fitball.model("toy", tangential=False).parameter_names == ("e_y",)


def test_calibrate_fits_it(folder):
    fit = json.loads((folder / "fit.json").read_text("utf-8"))
    assert (fit["fitted"]["model_name"], fit["fitted"]["options"]) == ("toy", {})
    found = {name: item["verdict"] for name, item in fit["parameters"].items() if name in ("e_y", "e_x", "drag")}
    assert found == dict.fromkeys(("e_y", "e_x", "drag"), "identified")
    assert fit["parameters"]["drag"]["meaning"] == "share of v_x lost besides"
    assert 0.6 < fit["parameters"]["e_y"]["median"] < 0.9


def test_predict_takes_it(folder, capsys):
    assert main(["predict", str(folder), "--impact", "v=20, theta=30, spin=0", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["impacts"]
    e_y = json.loads((folder / "fit.json").read_text("utf-8"))["parameters"]["e_y"]["point"]
    assert row["outputs"]["v_y2"]["point"] == pytest.approx(10.0 * e_y, rel=1e-9)


def test_export_writes_it_in_python_and_in_c(folder, tmp_path):
    assert main(["export", str(folder), "--to", "python", "--out", str(tmp_path / "toy.py")]) == 0
    done = subprocess.run([sys.executable, str(tmp_path / "toy.py")], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and re.match(r"toy: \d+ golden impacts, .* passed", done.stdout)
    assert main(["export", str(folder), "--to", "c", "--out", str(tmp_path / "toy.h")]) == 0
    if CC is not None:
        words = [CC, "-std=c99", "-Wall", "-Werror", "-x", "c", "-DFITBALL_SELF_TEST", str(tmp_path / "toy.h"), "-lm"]
        subprocess.run([*words, "-o", str(tmp_path / "check")], check=True, capture_output=True)
        assert subprocess.run([str(tmp_path / "check")], check=False, capture_output=True).returncode == 0


def test_export_tells_its_own_parameters(folder, tmp_path):
    assert main(["export", str(folder), "--to", "json", "--out", str(tmp_path / "toy.json")]) == 0
    content = json.loads((tmp_path / "toy.json").read_text("utf-8"))
    schema = json.loads((files("fitball.exports") / "parameters.schema.json").read_text("utf-8"))
    jsonschema.validate(content, schema)
    exported = content["parameters"]
    assert {name for name, item in exported.items() if item["role"] == "model"} == {"e_y", "e_x", "drag"}
    assert main(["export", str(folder), "--to", "latex", "--out", str(tmp_path / "toy.tex")]) == 0
    assert "$d$" in (tmp_path / "toy.tex").read_text("utf-8")


def test_compare_ranks_it(tmp_path):
    out = tmp_path / "compared"
    words = ["compare", "wang_zero_spin.csv", "--models", "brody,toy", "--quick", "--max-steps", "100"]
    assert main([*words, "--cores", "1", "--quiet", "--out", str(out)]) in (0, 1)
    found = json.loads((out / "compare.json").read_text("utf-8"))
    assert {item["name"] for item in found["models"]} == {"brody", "toy"}


def test_compare_tries_it_by_default_where_it_says_so():
    names, _ = default_names(load_table("wang_zero_spin.csv"), quick=True)
    assert names == ("toy", "brody", "grip-slip", "thesis-exact", "two-mass")
    with pytest.raises(fitball.FitballError, match="did you mean 'toy'"):
        fitball.model("toyy")
