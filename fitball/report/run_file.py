"""`run.toml`: all that is needed to repeat a run."""

from __future__ import annotations

import json
from collections.abc import Mapping

from fitball.inference.parameters import TAILS
from fitball.inference.results import Fit
from fitball.version import __version__


def _toml(value: object) -> str:
    """A scalar as TOML; JSON's strings, numbers and booleans are valid TOML."""
    return json.dumps(value)


def _section(name: str, content: Mapping[str, object]) -> list[str]:
    lines = [f"[{name}]", *(f"{json.dumps(key)} = {_toml(value)}" for key, value in content.items())]
    return [*lines, ""]


def run_text(fit: Fit) -> str:
    """The run as TOML: table and digest, model, closures, every prior and fixed value, sampler, seed, versions."""
    problem = fit.problem
    ball = problem.model.ball
    lines = ["# Everything this result depends on; SI units.", ""]
    lines += _section("fitball", {"version": __version__, "seed": fit.seed})
    lines += _section("table", {"name": problem.table.name, "sha256": problem.table.digest})
    lines += _section("model", {"name": problem.model.name})
    lines += _section("model.closures", problem.model.options)
    lines += _section("ball", {"mass": ball.mass, "radius": ball.radius, "inertia": ball.inertia})
    if problem.contact_time is not None:
        lines += _section("contact_time", {"value": problem.contact_time[0], "sd": problem.contact_time[1]})
    lines += _section("priors", {item.name: item.prior.text for item in problem.free})
    lines += _section("fix", {item.name: item.fixed for item in problem.parameters if item.fixed is not None})
    lines += _section("pool", {item.parameter: item.column for item in problem.levels})
    measurement = {"distribution": "student-t" if TAILS in fit.point.values else "normal"}
    if problem.offsets is not None:
        measurement["offsets"] = problem.offsets.column
    lines += _section("measurement", measurement)
    if fit.diagnostics is not None:
        found = fit.diagnostics
        lines += _section(
            "sampler",
            {
                "ensembles": found.ensembles,
                "walkers": found.walkers,
                "steps": found.steps,
                "max_steps": found.max_steps,
            },
        )
    return "\n".join(lines)
