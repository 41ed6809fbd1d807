"""Ports compiled and run: lines of parameters, an impact in the plane and one in three dimensions,
to rebounds.
"""

import functools
import json
import os
import shutil
import subprocess
import types
import warnings

import numpy as np
import pytest

import fitball
from fitball.exports.parameter_set import ParameterSet
from fitball.exports.ports import FILES, port

OUTPUTS = (
    "v_x2",
    "v_y2",
    "omega_2",
    "contact_time",
    "gap_time",
    "gap_path",
    "gap_turn",
    "regime",
    "status",
    "extrapolated",
)
C = """#include "bounce.h"
#include <stdio.h>
#include <string.h>
int main(void)
{
    double x[64], *i = x + sizeof(fitball_Parameters) / sizeof(double);
    fitball_Parameters p;
    for (int k = 0; scanf("%lf", &x[k]) == 1; k++) {
        if (&x[k] < i + 11)
            continue;
        memcpy(&p, x, sizeof p);
        fitball_Vector v = {i[3], i[4], i[5]}, w = {i[6], i[7], i[8]}, u = {i[9], i[10], i[11]};
        fitball_Rebound r = fitball_rebound(i[0], i[1], i[2], p);
        fitball_Rebound3 s = fitball_rebound_3d(v, w, u, p);
        double y[] = {r.v_x2, r.v_y2, r.omega_2, r.contact_time, r.gap_time, r.gap_path, r.gap_turn,
                      (double)r.regime, (double)r.status, (double)r.extrapolated,
                      s.velocity.x, s.velocity.y, s.velocity.z, s.spin.x, s.spin.y, s.spin.z,
                      s.gap_path.x, s.gap_path.y, s.gap_path.z,
                      s.gap_turn.x, s.gap_turn.y, s.gap_turn.z};
        for (k = 0; k < 22; k++)
            printf(k < 21 ? "%.17g " : "%.17g\\n", y[k]);
        k = -1;
    }
    return 0;
}
"""
CSHARP = """using System;
using System.Globalization;
using System.Linq;
static class Run
{
    static Bounce.Vector vector(double[] i, int k)
    {
        return new Bounce.Vector(i[k], i[k + 1], i[k + 2]);
    }

    static void Main()
    {
        CultureInfo culture = CultureInfo.InvariantCulture;
        var make = typeof(Bounce.Parameters).GetConstructors()[0];
        int n = make.GetParameters().Length;
        for (string line; (line = Console.ReadLine()) != null;) {
            double[] x = line.Split(' ').Select(text => double.Parse(text, culture)).ToArray();
            double[] i = x.Skip(n).ToArray();
            var p = (Bounce.Parameters)make.Invoke(x.Take(n).Cast<object>().ToArray());
            var r = Bounce.rebound(i[0], i[1], i[2], p);
            var s = Bounce.rebound_3d(vector(i, 3), vector(i, 6), vector(i, 9), p);
            double[] y = {
                r.v_x2, r.v_y2, r.omega_2, r.contact_time, r.gap_time, r.gap_path, r.gap_turn,
                r.regime, r.status, r.extrapolated ? 1 : 0,
                s.velocity.x, s.velocity.y, s.velocity.z, s.spin.x, s.spin.y, s.spin.z,
                s.gap_path.x, s.gap_path.y, s.gap_path.z, s.gap_turn.x, s.gap_turn.y, s.gap_turn.z
            };
            Console.WriteLine(string.Join(" ", y.Select(one => one.ToString("R", culture))));
        }
    }
}
"""
JAVASCRIPT = """const Bounce = require("./bounce.js");
const names = Object.keys(Bounce.BALL), n = names.length;
for (const line of require("fs").readFileSync(0, "utf8").trim().split("\\n")) {
    const x = line.split(" ").map(Number), i = x.slice(n);
    const p = Object.fromEntries(names.map((name, k) => [name, x[k]]));
    const vector = (k) => ({ x: i[k], y: i[k + 1], z: i[k + 2] });
    const r = Bounce.rebound(i[0], i[1], i[2], p);
    const s = Bounce.rebound_3d(vector(3), vector(6), vector(9), p);
    const plane = Object.values(r).map(Number);
    const vectors = [s.velocity, s.spin, s.gap_path, s.gap_turn];
    console.log([...plane, ...vectors.flatMap((one) => [one.x, one.y, one.z])].join(" "));
}
"""
# Numbers as doubles in files: Godot's own texts of numbers have fewer digits.
GDSCRIPT = """extends SceneTree
func vector(bounce, i, k):
    return bounce.BounceVector.new(i[k], i[k + 1], i[k + 2])

func _init():
    var bounce = load("res://bounce.gd").new()
    var numbers = File.new()
    var out = File.new()
    numbers.open("res://in.bin", File.READ)
    out.open("res://out.bin", File.WRITE)
    var lines = int(numbers.get_double())
    var n = int(numbers.get_double()) - 12
    out.store_double(bounce.self_test())
    for _k in range(lines):
        var row = []
        for _j in range(n):
            row.append(numbers.get_double())
        var i = []
        for _j in range(12):
            i.append(numbers.get_double())
        var p = bounce.BounceParameters.callv("new", row)
        var r = bounce.rebound(i[0], i[1], i[2], p)
        var v_1 = vector(bounce, i, 3)
        var s = bounce.rebound_3d(v_1, vector(bounce, i, 6), vector(bounce, i, 9), p)
        for y in [r.v_x2, r.v_y2, r.omega_2, r.contact_time, r.gap_time, r.gap_path, r.gap_turn,
                r.regime, r.status, 1.0 if r.extrapolated else 0.0]:
            out.store_double(y)
        for v in [s.velocity, s.spin, s.gap_path, s.gap_turn]:
            for y in [v.x, v.y, v.z]:
                out.store_double(y)
    out.close()
    quit()
"""
# What runs first, how a file is compiled, how a self-test is, and the driver.
RUNS = {
    "c": (
        "gcc",
        "gcc -std=c99 -Wall -Wextra -Werror -pedantic -O0 -x c {} -lm -o run",
        ("run.c", C),
    ),
    "c++": (
        "g++",
        "g++ -std=c++11 -Wall -Wextra -Werror -pedantic -O0 -x c++ {} -lm -o run",
        ("run.c", C),
    ),
    "csharp": ("mcs", "mcs -warnaserror -out:run.exe {}", ("Run.cs", CSHARP)),
    "javascript": ("node", "", ("run.js", JAVASCRIPT)),
}
# Languages whose file is compiled and run by itself; `in_godot` runs the other one.
LANGUAGES = ("c", "c++", "csharp", "javascript", "python")
# Names of Godot 3 without a window.
GODOT = ("godot3-server", "godot-server", "godot3-headless")


def text_of(sets, language):
    """The port in a language; that in C is C++ too."""
    return port(sets, "c" if language == "c++" else language)


def module(text):
    """The port in Python, as a module."""
    port_module = types.ModuleType("bounce")
    exec(compile(text, "bounce.py", "exec"), vars(port_module))
    return port_module


def in_python(port_module, lines):
    """Rebounds (lines, 22) of lines (lines, numbers) by the port in Python, as of `run`."""
    rebounds = []
    count = len(port_module.Parameters._fields)
    for line in lines.tolist():
        row = port_module.Parameters(*line[:count])
        impact = line[count:]
        vectors = [port_module.Vector(*impact[k : k + 3]) for k in (3, 6, 9)]
        with warnings.catch_warnings():
            # Balls that move away are among them.
            warnings.simplefilter("ignore", RuntimeWarning)
            flat = port_module.rebound(*impact[:3], row)
            spatial = port_module.rebound_3d(*vectors, row)
        gaps = (*spatial.gap_path, *spatial.gap_turn)
        rebounds.append([*map(float, flat), *spatial.velocity, *spatial.spin, *gaps])
    return np.array(rebounds)


def in_node(folder, sets, script):
    """What a script prints as JSON, that has the port in JavaScript beside it as `bounce.js`. Skips
    without Node.
    """
    if not shutil.which("node"):
        pytest.skip("Node is not installed")
    (folder / "bounce.js").write_text(port(sets, "javascript"), encoding="utf-8")
    done = subprocess.run(
        ["node", "-e", script],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    return json.loads(done.stdout)


def in_godot(folder, text, lines):
    """What the self-test of the port in GDScript returns, and rebounds (lines, 22) as of `run`."""
    godot = next(filter(None, map(shutil.which, GODOT)), None)
    if godot is None:
        pytest.skip("Godot 3 is not installed")
    (folder / "bounce.gd").write_text(text, encoding="utf-8")
    (folder / "main.gd").write_text(GDSCRIPT, encoding="utf-8")
    (folder / "project.godot").write_text("config_version=4\n", encoding="utf-8")
    lines = np.asarray(lines)
    numbers = np.concatenate([np.array(lines.shape, float), lines.ravel()])
    (folder / "in.bin").write_bytes(numbers.astype("<f8").tobytes())
    subprocess.run(
        [godot, "--path", str(folder), "-s", "res://main.gd"],
        check=True,
        capture_output=True,
        env={**os.environ, "HOME": str(folder)},
        timeout=300,
    )
    answer = np.frombuffer((folder / "out.bin").read_bytes(), "<f8")
    return answer[0], answer[1:].reshape(len(lines), 22)


def compiled(folder, language, text, driver=True):
    """The command that runs the port in `text` with its driver, or its self-test. Skips without a
    compiler.
    """
    tool, command, (name, source) = RUNS[language]
    if shutil.which(tool) is None:
        pytest.skip(f"{tool} is not installed")
    port_file = FILES["c" if language == "c++" else language]
    (folder / port_file).write_text(text, encoding="utf-8")
    (folder / name).write_text(source, encoding="utf-8")
    define = "-define:" if language == "csharp" else "-D"
    if not driver:
        arguments = f"{define}FITBALL_SELF_TEST {port_file}"
    elif language == "csharp":
        arguments = f"{name} {port_file}"
    else:
        arguments = name
    if command:
        subprocess.run(command.format(arguments).split(), cwd=folder, check=True, timeout=120)
    if language == "csharp":
        return ["mono", "run.exe"]
    if language == "javascript":
        return ["node", name if driver else port_file]
    return ["./run"]


def run(folder, language, sets, lines):
    """OUTPUTS, then velocity, spin, and path and turn between the flights in space (lines, 22) of
    lines (lines, numbers).
    """
    text = text_of(sets, language)
    if language == "python":
        return in_python(module(text), lines)
    if language == "gdscript":
        return in_godot(folder, text, lines)[1]
    command = compiled(folder, language, text)
    text_of_lines = "\n".join(" ".join(map(repr, line)) for line in lines.tolist())
    done = subprocess.run(
        command,
        cwd=folder,
        input=text_of_lines,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    rebounds = [list(map(float, line.split())) for line in done.stdout.splitlines()]
    return np.array(rebounds)


@functools.cache
def reference(text):
    """The port in Python of a model at its typical values."""
    return module(port([typical(text)], "python"))


# The ball of all ports here: that of the thesis.
BALL = fitball.Ball(inertia_ratio=0.56)


def typical(text, label="", **changes):
    """The parameter set of a model at its typical values."""
    model = fitball.model(text, ball=BALL)
    values = {spec.name: spec.typical for spec in model.parameters} | changes
    return ParameterSet(label, model, values, "Typical values.", {})
