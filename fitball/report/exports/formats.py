"""The forms a fit can be exported in, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from fitball.errors import ParameterError
from fitball.report.export import SavedFit
from fitball.report.exports.c_port import c_port
from fitball.report.exports.golden_table import golden_table
from fitball.report.exports.port import Port, make_port
from fitball.report.exports.python_port import python_port


@dataclass(frozen=True)
class Options:
    """What may be chosen: `None` leaves it to the format."""

    prefix: str = "fitball_"
    inputs_only: bool = False
    grid: str | None = None
    at: str | None = None
    engine_inertia: float = 0.4


@dataclass(frozen=True)
class TextFormat:
    """A form made of text: `stem` of its file by default, and `make`, which gives one text for each ending."""

    stem: str
    make: Callable[[SavedFit, Options], Mapping[str, str]]


def saved_port(saved: SavedFit) -> Port:
    """The port of a saved fit."""
    table = saved.content["table"]
    origin = f"table {table['file']} ({table['impacts']} impacts), point estimate, fit {saved.status}"
    return make_port(saved.fitted, saved.golden, origin)


def _c(saved: SavedFit, options: Options) -> Mapping[str, str]:
    if not (options.prefix.isidentifier() and options.prefix.isascii()):
        raise ParameterError(f"--prefix {options.prefix}: expected the beginning of a C name, such as clay_")
    return {".h": c_port(saved_port(saved), options.prefix)}


TEXT_FORMATS: Mapping[str, TextFormat] = {
    "python": TextFormat("bounce", lambda saved, _options: {".py": python_port(saved_port(saved))}),
    "c": TextFormat("bounce", _c),
    "golden": TextFormat(
        "golden", lambda saved, options: {".csv": golden_table(saved.fitted, saved.golden, options.inputs_only)}
    ),
}
