"""The fitted parameter set for other programs: one content, as JSON with a schema."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results.quantiles import ESSENTIALS
from fitball.inference.results.results import Estimate, Fit, LevelEstimate, Verdict
from fitball.models.registry import parameter_spec
from fitball.models.types import OUTPUTS
from fitball.report.saved.structure import plain
from fitball.version import __version__

SCHEMA_VERSION = 1
NUMBERS = ("point", *ESSENTIALS)
# What is told of the table.
TABLE = ("name", "file", "sha256", "impacts", "flipped", "columns")


def parameter_content(saved: Fit) -> dict[str, Any]:
    """What `parameters.schema.json` describes: SI, no nulls, absent numbers left out."""
    parameter_set: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "kind": "fitball parameter set",
        "fitball": __version__,
        "status": str(saved.status),
        "model": {"name": saved.fitted.model_name, "closures": dict(saved.fitted.options)},
        "ball": plain(saved.fitted.ball),
        "table": {key: part for key, part in plain(saved.source).items() if key in TABLE}
        | {"flipped": list(saved.source.flipped)},
        "parameters": {name: _parameter(parameter) for name, parameter in saved.parameters.items()},
    }
    if saved.levels:
        parameter_set["levels"] = _levels(saved.levels)
    if saved.correlation is not None:
        parameter_set["correlation"] = {"names": list(saved.free_names), "values": saved.correlation.tolist()}
    impacts, rebound = saved.golden.impacts, saved.golden.rebound
    columns = {name: getattr(rebound, name) for name in (*OUTPUTS, "regime")}
    parameter_set["golden"] = {
        "impacts": {name: column for name, column in plain(impacts).items() if column is not None},
        "rebound": {name: column.tolist() for name, column in columns.items() if not np.isnan(column).any()},
    }
    return parameter_set


def _levels(listed: Sequence[LevelEstimate]) -> dict[str, Any]:
    """Values of the parameters that differ between surfaces, balls or tables: by parameter, then by label."""
    levels: dict[str, Any] = {}
    for item in listed:
        one = levels.setdefault(item.parameter, {"column": item.column, "values": {}})
        one["values"][item.label] = {name: getattr(item, name) for name in NUMBERS if getattr(item, name) is not None}
    return levels


def role(name: str) -> str:
    """Whether a parameter belongs to the bounce, to the noise of a measurement, or to a group of impacts."""
    return "noise" if name in NOISE_SPECS else "model" if parameter_spec(name) is not None else "group"


def _parameter(parameter: Estimate) -> dict[str, Any]:
    content: dict[str, Any] = {
        "role": role(parameter.name),
        "unit": parameter.unit,
        "meaning": parameter.meaning,
        "fixed": parameter.verdict is Verdict.FIXED,
        "verdict": str(parameter.verdict),
        "prior": parameter.prior,
    }
    if parameter.given:
        content["given"] = list(parameter.given)
    content |= {name: getattr(parameter, name) for name in NUMBERS if getattr(parameter, name) is not None}
    return content
