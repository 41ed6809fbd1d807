"""The forms a fit can be exported in, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from fitball.errors import ParameterError
from fitball.exports.certificate import certificate
from fitball.exports.engine_settings import engine_texts
from fitball.exports.golden import golden_table
from fitball.exports.lookup_table import lookup_note, lookup_texts
from fitball.exports.parameters import latex_table, paper_markdown, parameter_content
from fitball.exports.port.languages import c_port, csharp_port, javascript_texts
from fitball.exports.port.port import Port, make_port, python_port
from fitball.inference.results.results import Fit
from fitball.report.form.files import json_text
from fitball.wording import option


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
