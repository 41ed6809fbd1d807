"""Runs what the engine page says in the engines themselves: `check.py WORK [ENGINE ...]`.

Installs pinned packages in WORK. Each recipe of the page, with the stored parameter set, bounces
the 21 impacts of Wang at five heights within a step. It must come as near to the model as the page
states, and not much nearer, so that the numbers stay true. Single impacts must be the model's
within thrice that, and a dropped ball must rest. With ports a drop, a flat and spinning impacts
must be the port's to 1e-12. Controls that must fail: MuJoCo with the friction of geoms, a court
that is a sensor. Engines whose tools are missing are named.
"""

import importlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fitball.exports import engine, engine_page
from fitball.exports.engines import engines
from fitball.exports.ports import port

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
of_engines: Any = importlib.import_module("support.engines")
ports: Any = importlib.import_module("support.ports")

# Versions, which the rows of the engines state too.
PYTHON_PACKAGES = {"mujoco": "4.0.0", "pybullet": "3.2.7", "pymunk": "7.3.1", "Box2D": "2.3.10"}
NODE_PACKAGES = {
    "planck": "1.4.2",
    "cannon-es": "0.20.0",
    "jolt-physics": "1.1.0",
    "@babylonjs/havok": "1.3.14",
    "physx-js-webidl": "2.7.3",
    "@dimforge/rapier3d-compat": "0.21.0",
    "p2-es": "1.2.3",
    "oimo": "1.0.9",
    "matter-js": "0.20.0",
}
# Engines that settings do not help, tried with them at 60 Hz: least root mean squares of v_x2, v_y2
# [m/s] and omega_2 [rad/s] that are seen, 0 where they are those of an ideal sphere.
MISSED = {
    "p2": (3.0, 0.0, 100.0),
    "oimo": (0.0, 3.0, 0.0),
    "matter": (3.0, 0.0, 100.0),
}
# The header of Debian's package libchipmunk-dev.
CHIPMUNK = Path("/usr/include/chipmunk/chipmunk.h")
# Shares of a step at which a ball touches.
PHASES = (0.1, 0.3, 0.5, 0.7, 0.9)
# Steps a second at which balls rest and at which ports are run, where they are not 60.
REST_RATE = {
    "mujoco": 4000,
    "pybullet": 240,
    "box2d": 1000,
    "havok": 1000,
    "physx": 4000,
    "rapier": 1000,
}
# A drop, a flat impact, backspin, heavy topspin.
SINGLE = ((0.0, 9.9, 0.0), (15.62, 4.81, -5.0), (12.0, 12.0, -150.0), (16.0, 6.0, 150.0))
# Largest height [m] and speed [m/s] of a ball that rests; Godot's hops, as its row says.
RESTS = (0.002, 0.02)
HOPS = (0.02, 0.6)
# The least share of the stated root mean squares that is seen again.
STALE = 0.97
GODOT_SCENE = """[gd_scene load_steps=2 format=2]
[ext_resource path="res://main.gd" type="Script" id=1]
[node name="Main" type="Node2D"]
script = ExtResource( 1 )
"""
# MuJoCo with friction and damping of the ball's geom, as was exported before.
OLD_PAIR = '<geom name="ball" type="sphere"'


class Runner:
    """Runs recipes in a folder with the packages installed in it."""

    def __init__(self, work: Path) -> None:
        self.work = work
        self.python = work / "venv" / "bin" / "python"
        self.node = shutil.which("node") or ""
        self.godot = next(filter(None, map(shutil.which, ports.GODOT)), "") or ""

    def install(self) -> None:
        """Install the packages of Python, and of node where there is one."""
        self.work.mkdir(parents=True, exist_ok=True)
        if not self.python.exists():
            subprocess.run([sys.executable, "-m", "venv", self.work / "venv"], check=True)
            pins = [f"{name}=={version}" for name, version in PYTHON_PACKAGES.items()]
            pip = [
                str(self.python),
                "-m",
                "pip",
                "install",
                "--quiet",
                "--disable-pip-version-check",
            ]
            subprocess.run([*pip, *pins], check=True)
        if self.node and not (self.work / "node_modules").exists():
            pins = [f"{name}@{version}" for name, version in NODE_PACKAGES.items()]
            command = ["npm", "install", "--silent", "--prefix", str(self.work), *pins]
            subprocess.run(command, check=True)

    def can_run(self, file: str) -> bool:
        """Whether the tool of a recipe is there."""
        needed = {
            "python": True,
            "javascript": bool(self.node),
            "gdscript": bool(self.godot),
            "c": CHIPMUNK.exists() and shutil.which("cc") is not None,
        }
        return needed[file.rpartition(".")[2]]

    def run(self, key: str, file: str, code: str, job: Mapping[str, object]) -> np.ndarray:
        """The answer of an engine to a job, whose recipe `file` has the text `code`."""
        language = file.rpartition(".")[2]
        name = file.partition(".")[0]
        if language == "gdscript":
            return self._in_godot(code, job)
        if language == "c":
            return self._in_c(name, code, job)
        if language == "python":
            place = self.work / f"recipe_{name}.py"
            place.write_text(code, "utf-8")
            command = [str(self.python), str(HERE / "drive.py"), key, str(place)]
        else:
            place = self.work / f"recipe_{name}.mjs"
            files = [HERE / f"{key}.mjs", HERE / "drive.mjs"]
            parts = [code, *(file.read_text("utf-8") for file in files if file.exists())]
            place.write_text("\n".join(parts), "utf-8")
            browser = ["--import", str(HERE / "browser.mjs")] if key == "physx" else []
            command = [self.node, *browser, str(place)]
        done = subprocess.run(
            command,
            input=json.dumps(job),
            capture_output=True,
            text=True,
            cwd=self.work,
            env={**os.environ, "PYTHONPATH": str(self.work)},
            check=False,
        )
        if done.returncode:
            raise RuntimeError(f"{file}: {done.stderr[-1500:]}")
        return np.array(json.loads(done.stdout.strip().splitlines()[-1]))

    def _in_c(self, name: str, code: str, job: Mapping[str, Any]) -> np.ndarray:
        """The answer of an engine in C, Chipmunk."""
        place = self.work / f"recipe_{name}.c"
        place.write_text(code + (HERE / "drive.c").read_text("utf-8"), "utf-8")
        program = place.with_suffix("")
        libraries = ("-lchipmunk", "-lm")
        subprocess.run(["cc", "-O2", place, "-o", program, *libraries], check=True)
        if "seconds" in job:
            lines = [["rest", job["hertz"], job["radius"], job["height"], job["seconds"]]]
        else:
            lines = [["impacts", job["hertz"], job["radius"]]]
            lines += [[*one, share] for one in job["impacts"] for share in job["phases"]]
        text = "\n".join(" ".join(map(str, line)) for line in lines)
        done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
        # The engine says its version first.
        return np.array(json.loads(done.stdout.splitlines()[-1]))

    def _in_godot(self, code: str, job: Mapping[str, object]) -> np.ndarray:
        """The answer of Godot 3."""
        folder = self.work / "godot"
        folder.mkdir(exist_ok=True)
        (folder / "main.gd").write_text(code + (HERE / "godot3.gd").read_text("utf-8"), "utf-8")
        (folder / "main.tscn").write_text(GODOT_SCENE, "utf-8")
        project = (
            'config_version=4\n[application]\nrun/main_scene="res://main.tscn"\n[physics]\n'
            f"common/physics_fps={job['hertz']}\n"
        )
        (folder / "project.godot").write_text(project, "utf-8")
        (folder / "job.json").write_text(json.dumps(job), "utf-8")
        command = [self.godot, "--path", str(folder), "--fixed-fps", str(job["hertz"])]
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            env={**os.environ, "HOME": str(folder)},
            timeout=300,
            check=False,
        )
        answers = [line for line in done.stdout.splitlines() if line.startswith("[")]
        if not answers:
            raise RuntimeError(f"Godot: {done.stdout[-500:]} {done.stderr[-1500:]}")
        return np.array(json.loads(answers[-1]))


class Checks:
    """Counts what passed, and prints a line for each."""

    def __init__(self) -> None:
        self.failed = 0
        self.passed = 0

    def say(self, what: str, good: bool) -> None:
        """Count and print one result."""
        self.passed += good
        self.failed += not good
        print(f"{'ok  ' if good else 'FAIL'} {what}", flush=True)


def texts(numbers: Sequence[float]) -> str:
    """Numbers in few digits."""
    return " ".join(f"{number:.3g}" for number in numbers)


def check_settings(checks: Checks, runner: Runner, keys: Sequence[str]) -> None:
    """Run the recipes with settings: Wang's impacts, single impacts, a ball at rest."""
    wang = of_engines.wang_set()
    point = engine.operating_point([wang], "")
    time = engine.contact_duration(wang, point)
    setting = engine.settings(wang, point, wang.values["inertia_ratio"])
    numbers = engine_page.numbers_of(wang, setting, time)
    codes = engine_page.recipes(numbers, time, engines())
    radius = wang.values["ball_radius"]
    common = {"radius": radius, "phases": PHASES}
    for key, code in codes.items():
        row = engines()[key]
        if key not in keys:
            continue
        if not runner.can_run(row.recipe):
            print(f"-    {key}: not run, its tool is missing")
            continue
        for rate, stated in row.seen.items():
            job = {**common, "hertz": int(rate), "impacts": of_engines.incident(wang).tolist()}
            seen = of_engines.rms(wang, runner.run(key, row.recipe, code, job), len(PHASES))
            good = bool(np.all(seen <= stated) and np.all(seen >= STALE * np.array(stated) - 0.01))
            checks.say(f"{key} {rate} Hz: stated {texts(stated)}, seen {texts(seen)}", good)
        rate, stated = [*row.seen.items()][-1]
        job = {**common, "hertz": int(rate), "impacts": SINGLE}
        wanted = model_of(wang)
        rebounds = runner.run(key, row.recipe, code, job)
        worst = np.abs(rebounds - np.repeat(wanted, len(PHASES), axis=0)).max(axis=0)
        # Thrice a root mean square holds single impacts within the measured range.
        good = bool(np.all(worst <= 3.0 * np.array(stated)))
        checks.say(f"{key} {rate} Hz: single impacts off by {texts(worst)}", good)
        rate = str(REST_RATE.get(key, 60))
        job = {"radius": radius, "hertz": int(rate), "height": 1.0, "seconds": 12.0}
        highest, lowest, *speeds = runner.run(key, row.recipe, code, job)
        height, speed = HOPS if key == "godot3" else RESTS
        good = max(abs(highest), abs(lowest)) <= height and max(speeds[:2]) <= speed
        checks.say(f"{key} {rate} Hz: at rest {texts([highest, lowest, *speeds])}", good)


def model_of(wang: Any) -> np.ndarray:
    """Rebounds (impacts, 3) of the single impacts by the model."""
    module = ports.module(port([wang], "python"))
    return np.array([module.rebound(*impact, module.BALL)[:3] for impact in SINGLE])


def check_ports(checks: Checks, runner: Runner, keys: Sequence[str]) -> None:
    """Run the recipes with ports: single impacts, a ball at rest."""
    wang = of_engines.wang_set()
    point = engine.operating_point([wang], "")
    time = engine.contact_duration(wang, point)
    setting = engine.settings(wang, point, wang.values["inertia_ratio"])
    numbers = engine_page.numbers_of(wang, setting, time)
    (runner.work / "bounce.py").write_text(port([wang], "python"), "utf-8")
    (runner.work / "bounce.mjs").write_text(port([wang], "esm"), "utf-8")
    (runner.work / "bounce.h").write_text(port([wang], "c"), "utf-8")
    wanted = model_of(wang)
    radius = wang.values["ball_radius"]
    for key, code in engine_page.recipes(numbers, time, engines(), "port").items():
        file = engines()[key].port
        if key not in keys or not runner.can_run(file):
            continue
        rate = REST_RATE.get(key, 60)
        job = {"radius": radius, "phases": PHASES, "hertz": rate, "impacts": SINGLE}
        rebounds = runner.run(key, file, code, job)
        off = np.abs(rebounds - np.repeat(wanted, len(PHASES), axis=0)).max(axis=0)
        # Spins are hundreds, whose last digit is 1e-13; Rapier's numbers are single.
        most = (1e-4, 1e-4, 1e-2) if key == "rapier" else (1e-12, 1e-12, 1e-12 / radius)
        good = bool(np.all(off <= most))
        checks.say(f"port in {key} {rate} Hz: off by {texts(off)}", good)
        job = {"radius": radius, "hertz": rate, "height": 1.0, "seconds": 20.0}
        highest, lowest, *speeds = runner.run(key, file, code, job)
        good = max(abs(highest), abs(lowest)) <= RESTS[0] and max(speeds[:2]) <= RESTS[1]
        checks.say(f"port in {key} {rate} Hz: at rest {texts([highest, lowest, *speeds])}", good)
        if key == "planck":
            sensor = code.replace("restitution: 0, friction", "isSensor: true, friction")
            _, lowest, *_ = runner.run(key, file, sensor, job)
            checks.say(
                f"control, planck with a sensor: the ball is at {lowest:.3g} m", lowest < -1.0
            )


def check_port_only(checks: Checks, runner: Runner, keys: Sequence[str]) -> None:
    """Run settings in the engines that the page leaves to the port: they must miss."""
    wang = of_engines.wang_set()
    point = engine.operating_point([wang], "")
    setting = engine.settings(wang, point, wang.values["inertia_ratio"])
    time = engine.contact_duration(wang, point)
    numbers = engine_page.numbers_of(wang, setting, time)
    job = {
        "radius": wang.values["ball_radius"],
        "phases": PHASES,
        "hertz": 60,
        "impacts": of_engines.incident(wang).tolist(),
    }
    for key, least in MISSED.items():
        if key not in keys or not runner.node:
            continue
        code = (HERE / f"tried_{key}.mjs").read_text("utf-8")
        for name, number in numbers.items():
            code = code.replace(f"@{name}@", f"{number:.10g}")
        rebounds = runner.run(key, f"tried_{key}.javascript", code, job)
        seen = of_engines.rms(wang, rebounds, len(PHASES))
        checks.say(f"{key} 60 Hz by settings misses: {texts(seen)}", bool(np.all(seen >= least)))


def check_old_mujoco(checks: Checks, runner: Runner) -> None:
    """The control: friction and solref of the ball's geom miss what the page states."""
    wang = of_engines.wang_set()
    exported = json.loads(engine_page.settings_json([wang], "", "mujoco"))
    (of_set,) = exported["sets"]
    code = of_set["recipes"]["mujoco"]
    head, _, tail = code.partition("  <contact>")
    solref = " ".join(map(repr, of_set["mujoco"]["solref"]))
    mu = of_set["settings"][-1]["mu"]
    old = f'solref="{solref}" solimp="0.99 0.99 0.001 0.5 2" friction="{mu} 0 0" priority="1" '
    head = head.replace(OLD_PAIR, OLD_PAIR + f' condim="3" {old}')
    head = head.replace('impratio="1e-4" noslip_iterations="20"', "")
    job = {
        "radius": wang.values["ball_radius"],
        "phases": PHASES,
        "hertz": 4000,
        "impacts": of_engines.incident(wang).tolist(),
    }
    rebounds = runner.run("mujoco", "mujoco.python", head + tail.partition("</contact>\n")[2], job)
    seen = of_engines.rms(wang, rebounds, len(PHASES))
    stated = engines()["mujoco"].seen["4000"]
    good = bool(seen[0] > 3.0 * stated[0] and seen[2] > 3.0 * stated[2])
    checks.say(f"control, MuJoCo with friction of the geom: {texts(seen)}", good)


def main() -> int:
    """Install, run, count; 1 where something failed."""
    work, *names = sys.argv[1:]
    runner = Runner(Path(work).resolve())
    runner.install()
    keys = names or [*engines()]
    checks = Checks()
    pins = {**PYTHON_PACKAGES, **NODE_PACKAGES}
    for name, version in pins.items():
        rows = [row for row in engines().values() if name.casefold() in row.version.casefold()]
        checks.say(
            f"{name} {version} is the version of the page",
            any(version in row.version for row in rows),
        )
    check_settings(checks, runner, keys)
    check_ports(checks, runner, keys)
    check_port_only(checks, runner, keys)
    if "mujoco" in keys:
        check_old_mujoco(checks, runner)
    print(f"{checks.passed} passed, {checks.failed} failed")
    return int(checks.failed > 0)


if __name__ == "__main__":
    sys.exit(main())
