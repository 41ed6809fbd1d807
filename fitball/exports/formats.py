"""The forms a fit can be exported in, by name."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from fitball.data.lines import parse_grid
from fitball.errors import ParameterError
from fitball.exports.certificate import certificate
from fitball.exports.engine_settings import engine_texts
from fitball.exports.golden import golden_table
from fitball.exports.parameters import latex_table, paper_markdown, parameter_content
from fitball.exports.port.languages import c_port, csharp_port, javascript_texts
from fitball.exports.port.port import Port, make_port, python_port
from fitball.inference.prediction.engine_fit import SEED, Lookup, default_axes, make_lookup
from fitball.inference.results.results import Fit
from fitball.models.types import regime_name
from fitball.observables import SI_UNITS
from fitball.report.form.files import csv_text, json_text
from fitball.wording import option

# A lookup table as CSV, and what is known of it as JSON.


def lookup_texts(saved: Fit, grid: str | None) -> Mapping[str, str]:
    """The table and its description. Raises ParameterError for a grid that is none."""
    axes = default_axes(saved.fitted) if grid is None else parse_grid(grid)
    lookup = make_lookup(saved.fitted, axes)
    content = json_text(_content(saved, lookup))
    return {".csv": csv_text(_rows(lookup)), ".json": content}


def lookup_note(texts: Mapping[str, str]) -> str:
    """The interpolation error in one line, and grid points that are extrapolated or have no rebound."""
    content = json.loads(texts[".json"])
    errors = content["interpolation"]["errors"]
    parts = [f"{name} {item['largest']:.2g} (RMS {item['rms']:.2g}) {item['unit']}" for name, item in errors.items()]
    note = f"largest error of interpolation: {', '.join(parts)}" if parts else "interpolation could not be checked"
    reasons = "; ".join(f"{count} of {content['points']} points have no rebound: {reason}"
                        for reason, count in content["points_without_rebound"].items())  # fmt: skip
    beyond, valid = content["points_extrapolated"], content["valid_range"]
    if beyond:
        note += (
            f"; {beyond} of {content['points']} points lie outside of v_y1 = {valid['v_y1_low']:.4g} to "
            f"{valid['v_y1_high']:.4g} m/s: restitution and offset stay there what they are at its ends (column "
            "extrapolated)"
        )
    return note + (f"; {reasons}" if reasons else "")


def _rows(lookup: Lookup) -> list[dict[str, object]]:
    names = {name: regime_name(int(name)) for name in set(lookup.regime.tolist())}
    rows = []
    for k, point in enumerate(lookup.points.tolist()):
        row: dict[str, object] = {
            f"{axis.name} [{axis.unit.symbol}]": f"{axis.unit.from_si(value):.12g}"
            for axis, value in zip(lookup.axes, point, strict=True)
        }
        for name, column in lookup.outputs.items():
            row[f"{name} [{SI_UNITS[name]}]"] = None if column[k] != column[k] else f"{column[k]:.12g}"
        row["regime"] = names[int(lookup.regime[k])]
        row["extrapolated"] = "yes" if lookup.extrapolated[k] else "no"
        rows.append(row)
    return rows


def _content(saved: Fit, lookup: Lookup) -> dict[str, Any]:
    units = {axis.name: axis.unit for axis in lookup.axes}
    return {
        "schema_version": 1,
        "kind": "fitball lookup table",
        "model": saved.fitted.model_name,
        "table": saved.source.file,
        "parameters": dict(saved.golden.parameters),
        "order": "the last axis varies fastest",
        "axes": [
            {"name": axis.name, "unit": axis.unit.symbol, "values": [*map(axis.unit.from_si, axis.values.tolist())]}
            for axis in lookup.axes
        ],
        "outputs": {name: SI_UNITS[name] for name in lookup.outputs},
        "points": len(lookup.points),
        "points_without_rebound": dict(lookup.failed),
        "points_extrapolated": int(lookup.extrapolated.sum()),
        "valid_range": {
            "v_y1_low": lookup.valid.low,
            "v_y1_high": lookup.valid.high,
            "unit": "m/s",
            "ends_below_by": lookup.valid.below,
            "ends_above_by": lookup.valid.above,
            "outside": "restitution and offset of the normal force stay what they are at the nearer end",
        },
        "interpolation": {
            "method": "multilinear in the axes",
            "checked_at": f"{lookup.checked} impacts: midpoints of cells, and random ones (seed {SEED})",
            "errors": {
                name: {
                    "unit": SI_UNITS[name],
                    "largest": item.largest,
                    "rms": item.rms,
                    "largest_at": {axis: units[axis].from_si(value) for axis, value in item.place.items()},
                }
                for name, item in lookup.errors.items()
            },
        },
    }


@dataclass(frozen=True)
class Options:
    """What may be chosen: `None` leaves it to the format."""

    prefix: str = "fitball_"
    inputs_only: bool = False
    range: str | None = None
    at: str | None = None
    engine_inertia: float = 0.4


@dataclass(frozen=True)
class TextFormat:
    """A form made of text: `stem` of its file by default, and `make`, which gives one text for each ending; `note`
    finds in them what a user should know at once. What `bounces` answers impacts.
    """

    stem: str
    make: Callable[[Fit, Options], Mapping[str, str]]
    note: Callable[[Mapping[str, str]], str] = lambda _texts: ""
    bounces: bool = True


def _parameters(ending: str, make: Callable[[Fit], str]) -> TextFormat:
    return TextFormat("parameters", lambda saved, _options: {ending: make(saved)}, bounces=False)


def origin_of(saved: Fit) -> str:
    """Which fit a port is of, in a line."""
    table = saved.source
    origin = f"table {table.file} ({table.impacts} impacts), point estimate, fit {saved.status}"
    pooled = sorted({item.parameter for item in saved.levels})
    if pooled:
        origin += f", {', '.join(pooled)} at the value common to all levels"
    return origin


def _port(make: Callable[[Port, str], Mapping[str, str]]) -> TextFormat:
    def texts(saved: Fit, options: Options) -> Mapping[str, str]:
        prefix = options.prefix
        if not (prefix.isascii() and prefix.lstrip("_").isidentifier()):
            raise ParameterError(f"{option('prefix', prefix)}: expected the beginning of a name, such as clay_")
        return make(make_port(saved.fitted, saved.golden, origin_of(saved)), prefix)

    return TextFormat("bounce", texts)


TEXT_FORMATS: Mapping[str, TextFormat] = {
    "python": _port(lambda port, _prefix: {".py": python_port(port)}),
    "c": _port(lambda port, prefix: {".h": c_port(port, prefix)}),
    "javascript": _port(javascript_texts),
    "csharp": _port(lambda port, prefix: {".cs": csharp_port(port, prefix)}),
    "lookup": TextFormat("lookup", lambda saved, options: lookup_texts(saved, options.range), lookup_note),
    "engine": TextFormat("engine", lambda saved, options: engine_texts(saved, options.at, options.engine_inertia)),
    "json": _parameters(".json", lambda saved: json_text(parameter_content(saved))),
    "latex": _parameters(".tex", latex_table),
    "markdown": _parameters(".md", paper_markdown),
    "certificate": TextFormat("certificate", lambda saved, _options: {".html": certificate(saved)}, bounces=False),
    "golden": TextFormat(
        "golden", lambda saved, options: {".csv": golden_table(saved.fitted, saved.golden, options.inputs_only)}
    ),
}
