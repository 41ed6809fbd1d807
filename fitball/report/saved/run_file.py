"""`run.toml`: all that is needed to repeat a run; `run_record` reads it back."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from fitball.data.bundled import bundled_folder
from fitball.data.scene import Scene
from fitball.inference.problem.force_records import ForceRecords
from fitball.inference.problem.parameters import SD_SPECS, TAILS
from fitball.inference.results.results import Fit
from fitball.version import __version__

RUN_NAME = "run.toml"
RUN_KIND = "fitball run"
# Version 1, which had no number, named neither the files nor the scene's numbers.
RUN_SCHEMA = 2
SCENE_NUMBERS = (*SD_SPECS, "nominal_velocity_sd", "nominal_spin_sd", "force_sd", "force_start_sd")
SCENE_TEXTS = ("model", "surface", "description", "citation")


def _toml(value: object) -> str:
    """A scalar, or a list of them, as TOML; JSON's strings, numbers and booleans are valid TOML, but for DEL."""
    return json.dumps(value).replace("\x7f", "\\u007f")


def _section(name: str, content: Mapping[str, object], brackets: str = "[]") -> list[str]:
    half = len(brackets) // 2
    head = f"{brackets[:half]}{name}{brackets[half:]}"
    return [head, *(f"{_toml(key)} = {_toml(value)}" for key, value in content.items()), ""]


def _force(records: ForceRecords, folder: Path) -> dict[str, object]:
    return _named(Path(records.source), folder) | {"sha256": records.digest}


def run_text(fit: Fit, folder: Path) -> str:
    """The run as TOML: tables with digests, model, closures, every prior and fixed value, scene, sampler, seed.

    Tables are named relative to the `folder` that the text is written to.
    """
    problem = fit.problem
    ball = problem.model.ball
    fixed = {item.name: item for item in problem.parameters if item.fixed is not None}
    lines = ["# Everything this result depends on; SI units. `fitball repeat` runs it again.", ""]
    lines += [
        f"kind = {_toml(RUN_KIND)}",
        f"schema_version = {RUN_SCHEMA}",
        f"notes = {_toml(list(problem.notes))}",
        "",
    ]
    lines += _section("fitball", {"version": __version__, "seed": fit.seed, "point_only": fit.diagnostics is None})
    lines += _section("table", {"name": problem.table.name, "sha256": problem.table.digest})
    for place, digest in problem.table.files:
        lines += _section("table.files", _named(Path(place), folder) | {"sha256": digest}, "[[]]")
    lines += _section("model", {"name": problem.model.name})
    lines += _section("model.closures", problem.model.options)
    lines += _section("ball", {"mass": ball.mass, "radius": ball.radius, "inertia": ball.inertia})
    if problem.contact_time is not None:
        lines += _section("contact_time", {"value": problem.contact_time[0], "sd": problem.contact_time[1]})
    if problem.force is not None:
        lines += _section("force", _force(problem.force, folder))
    lines += ["# Of all parameters; the prior of one that is fixed below takes no part."]
    lines += _section("priors", {item.name: item.prior.text for item in problem.parameters})
    lines += _section("fix", {name: item.fixed for name, item in fixed.items()})
    lines += _section("fixed_because", {name: item.fixed_because for name, item in fixed.items()})
    lines += _section("pool", {item.parameter: item.column for item in problem.pooling})
    measurement: dict[str, object] = {"distribution": "student-t" if TAILS in fit.point.values else "normal"}
    if problem.group_bias is not None:
        measurement["offsets"] = problem.group_bias.column
    measurement["incident_errors"] = problem.incident is not None
    lines += _section("measurement", measurement)
    lines += _scene(problem.scene)
    if fit.diagnostics is not None:
        found = fit.diagnostics
        lines += _section(
            "sampler",
            {
                "ensembles": found.ensembles,
                "walkers": found.walkers,
                "steps": found.steps,
                "max_steps": found.max_steps,
                "target_ess": found.target_ess,
            },
        )
    return "\n".join(lines)


def _named(place: Path, folder: Path) -> dict[str, object]:
    """How a table is named: bundled ones by name, others by the way from the result folder to them."""
    if place.parent == bundled_folder().resolve():
        return {"file": place.name, "bundled": True}
    return {"file": Path(os.path.relpath(place, folder.resolve())).as_posix(), "bundled": False}


def _scene(scene: Scene) -> list[str]:
    """What the scene knew besides that which stands in the other sections."""
    content: dict[str, object] = {
        name: getattr(scene, name) for name in (*SCENE_TEXTS, *SCENE_NUMBERS) if getattr(scene, name) is not None
    }
    return [*_section("scene", content), *_section("scene.ball_sd", scene.ball_sd)]
