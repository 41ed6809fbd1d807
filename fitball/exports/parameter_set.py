"""The fitted parameter set for other programs: one content, as JSON with a schema."""

from __future__ import annotations

from typing import Any

from msgspec import UNSET

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results.quantiles import ESSENTIALS
from fitball.inference.results.results import Estimate, Verdict
from fitball.models.registry import parameter_spec
from fitball.report.form.numbers import THESIS, Scale
from fitball.report.saved.saved_fit import SavedFit
from fitball.version import __version__

SCHEMA_VERSION = 1
NUMBERS = ("point", *ESSENTIALS)


def parameter_content(saved: SavedFit) -> dict[str, Any]:
    """What `parameters.schema.json` describes: SI, no nulls, absent numbers left out."""
    content = saved.content
    golden = content["golden"]
    parameter_set: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "kind": "fitball parameter set",
        "fitball": __version__,
        "status": str(saved.status),
        "model": {"name": saved.fitted.model_name, "closures": dict(saved.fitted.options)},
        "ball": dict(content["ball"]),
        "table": dict(content["table"]),
        "parameters": {
            name: _parameter(parameter, _thesis_scale(saved, name)) for name, parameter in saved.parameters.items()
        },
    }
    if content["levels"]:
        parameter_set["levels"] = _levels(content["levels"])
    if content["correlation"] is not None:
        parameter_set["correlation"] = content["correlation"]
    parameter_set["golden"] = {
        part: {name: column for name, column in golden[part].items() if column is not None}
        for part in ("impacts", "rebound")
    }
    return parameter_set


def _levels(listed: list[dict[str, Any]]) -> dict[str, Any]:
    """Values of the parameters that differ between surfaces, balls or tables: by parameter, then by label."""
    levels: dict[str, Any] = {}
    for item in listed:
        one = levels.setdefault(item["parameter"], {"column": item["column"], "values": {}})
        one["values"][item["label"]] = {name: item[name] for name in NUMBERS if item[name] is not None}
    return levels


def role(name: str) -> str:
    """Whether a parameter belongs to the bounce, to the noise of a measurement, or to a group of impacts."""
    return "noise" if name in NOISE_SPECS else "model" if parameter_spec(name) is not None else "group"


def _parameter(parameter: Estimate, scale: Scale | None) -> dict[str, Any]:
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
    if scale is not None:
        numbers = {name: content[name] * scale.factor for name in NUMBERS if name in content}
        content["thesis"] = {"unit": scale.unit} | numbers
    return content


def _thesis_scale(saved: SavedFit, name: str) -> Scale | None:
    """The thesis's unit of a parameter that was fitted to the thesis's data."""
    return None if saved.file.parameters[name].thesis_units is UNSET else THESIS[name]
