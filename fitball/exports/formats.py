"""The formats of export: name, function and options of each; and a fit in one of them, written whole or not at all.
Nothing heavy is loaded before a form is made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitball.errors import ParameterError, suggestion
from fitball.wording import option, spoken

if TYPE_CHECKING:
    from fitball.exports.bounces import Bounces
    from fitball.inference.results.results import Fit


@dataclass(frozen=True)
class Format:
    """A form: a line of help, the function that makes it (`module:function` of this room), the `name` of its file by
    default, and the options that it takes. What `bounces` answers impacts.

    The function takes a fit, or `Bounces` of what answers impacts, and those options. It returns the text of the
    file, or bytes; for several files, whose `name` has no ending, texts by their endings. A note for the user may
    come with it.
    """

    help: str
    home: str
    name: str
    options: tuple[str, ...] = ()
    bounces: bool = True


FORMATS: Mapping[str, Format] = {
    "python": Format(
        "a Python module with rebound(v_x1, v_y1, omega_1) and a self-test; it needs math only",
        "port.languages:python_text", "bounce.py", ("levels",),
    ),
    "c": Format(
        "a C99 and C++11 header with the same function, and a self-test under FITBALL_SELF_TEST",
        "port.languages:c_text", "bounce.h", ("levels", "prefix"),
    ),
    "javascript": Format(
        "the same function for web pages or Node (.js) and as an ES module (.mjs)", "port.languages:javascript_texts",
        "bounce", ("levels", "prefix"),
    ),
    "csharp": Format(
        "the same function for Unity, Godot and .NET", "port.languages:csharp_text", "bounce.cs",
        ("levels", "prefix"),
    ),
    "golden": Format(
        "test impacts for ports, with their rebounds (--inputs-only: without them)",
        "tables:golden_table", "golden.csv", ("levels", "inputs_only"),
    ),
    "lookup": Format(
        "rebounds on a grid, and the error of interpolation between its points", "tables:lookup_texts", "lookup",
        ("levels", "range", "json"),
    ),
    "engine": Format(
        "restitution and friction for Unity, Godot, Bullet and MuJoCo, with their errors; as a page and as JSON",
        "tables:engine_texts", "engine", ("levels", "at", "engine_inertia", "json"),
    ),
    "json": Format(
        "parameters for other programs, with a schema (as CSV: summary.csv of the result folder)",
        "parameters:parameter_text", "parameters.json", bounces=False,
    ),
    "latex": Format(
        "a table of parameters (booktabs), rounded by the rule of the Particle Data Group", "parameters:latex_table",
        "parameters.tex", bounces=False,
    ),
    "markdown": Format("the same table in Markdown", "parameters:paper_markdown", "parameters.md", bounces=False),
    "certificate": Format(
        "one page of HTML to print and sign: result, interval, model test, SHA-256 of the data",
        "parameters:certificate", "certificate.html", bounces=False,
    ),
    "pdf": Format(
        "report.html printed by an installed browser: Chromium, Chrome or Edge (FITBALL_BROWSER names another)",
        "pdf:report_pdf", "report.pdf", bounces=False,
    ),
    "netcdf": Format("draws and data for ArviZ", "arviz_file:netcdf_file", "arviz.nc", bounces=False),
}  # fmt: skip
# What an option is, in words too. `json` leaves the other texts out.
KINDS: Mapping[str, tuple[type, str]] = {
    **dict.fromkeys(("prefix", "range", "at"), (str, "a text")), "engine_inertia": (Real, "a number"),
    **dict.fromkeys(("inputs_only", "json"), (bool, "True or False")),
    "levels": (Mapping, "a mapping from a column to a label, such as {'surface': 'clay'}"),
}  # fmt: skip
# Options that the command line calls otherwise.
FLAGS = {"levels": "level", "inputs_only": "inputs-only", "engine_inertia": "engine-inertia"}


@dataclass(frozen=True)
class Exported:
    """A fit in another form: `stem` of its files by default, `contents` by ending (bytes where they are no text), a
    `note` on what one should know at once.
    """

    stem: str
    contents: Mapping[str, str | bytes | memoryview]
    note: str = ""

    @property
    def texts(self) -> dict[str, str]:
        """Those of the contents that are texts."""
        return {ending: text for ending, text in self.contents.items() if isinstance(text, str)}

    def write(self, out: Path, overwrite: bool = False) -> tuple[Path, ...]:
        """Write the files, each whole or not at all: in a folder under the name of the form, else as named; of
        several, the endings follow the stem of what was named. Raises ResultFolderError, for files that exist too
        unless they may be replaced.
        """
        from fitball.report.form.files import refuse_existing, write_bytes

        if out.is_dir():
            places = tuple(out / f"{self.stem}{ending}" for ending in self.contents)
        else:
            # `speed-1.5` has no ending of its own.
            stem = out.stem if out.suffix in self.contents else out.name
            several = tuple(out.with_name(f"{stem}{ending}") for ending in self.contents)
            places = (out,) if len(self.contents) == 1 else several
        for place in places:
            refuse_existing(place, overwrite)
        for content, place in zip(self.contents.values(), places, strict=True):
            write_bytes(place, content.encode("utf-8") if isinstance(content, str) else content, named=True)
        return places


def exported(saved: Fit, to: str, options: Mapping[str, Any]) -> Exported:
    """A fit in the format `to`. Raises ParameterError for an unknown format, or an option that it does not have."""
    given = _checked(to, options)
    if not FORMATS[to].bounces:
        return _exported(saved, to, given)
    from fitball.exports.bounces import bounces_of

    return _exported(bounces_of(saved, given.pop("levels", None)), to, given)


def exported_model(
    name: str | None,
    to: str,
    values: Mapping[str, Any],
    surfaces: Mapping[str, Any],
    options: Mapping[str, Any],
) -> Exported:
    """A model at given parameters in the format `to`, see `unfitted.unfitted_bounces`. Raises what that raises, and
    ParameterError as `exported` does and for a format that needs a fit.
    """
    given = _checked(to, options)
    if "levels" in given:
        raise ParameterError(f"{option('level', '...')} chooses a level of a fit: leave it out")
    if not FORMATS[to].bounces or to == "golden":
        allowed = [name for name, form in FORMATS.items() if form.bounces and name != "golden"]
        raise ParameterError(f"format {to} needs a fit. Without one expected {', '.join(allowed)}")
    from fitball.exports.unfitted import DEFAULTS, unfitted_bounces

    bounces = unfitted_bounces(name, values, surfaces)
    made = _exported(bounces, to, given)
    defaults = (text.rstrip(".") for text in bounces.sources if text.startswith(DEFAULTS))
    return replace(made, note=". ".join(filter(None, ("nothing was fitted", *defaults, made.note))))


def _checked(to: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """The options that are given, which the format has."""
    if to not in FORMATS:
        raise ParameterError(f"unknown format '{to}': {suggestion(to, FORMATS)}")
    given = {name: value for name, value in options.items() if not _left_out(value)}
    for name, value in given.items():
        if name not in KINDS:
            raise ParameterError(f"unknown option '{name}': {suggestion(name, KINDS)}")
        if name not in FORMATS[to].options:
            owners = sorted(owner for owner, other in FORMATS.items() if name in other.options)
            listed = " and ".join(filter(None, (", ".join(owners[:-1]), owners[-1])))
            raise ParameterError(
                spoken(
                    f"--{FLAGS.get(name, name)} is an option of --to {listed}, not of --to {to}",
                    f"{name} is an option of the format {listed}, not of {to}",
                )
            )
        kind, words = KINDS[name]
        if not isinstance(value, kind):
            raise ParameterError(f"{name} = {value!r}: expected {words}")
    return given


def _left_out(value: object) -> bool:
    """Whether an option has the value of one that is not given."""
    return value is None or value is False or (isinstance(value, Mapping) and not value)


def _exported(subject: Fit | Bounces, to: str, given: dict[str, Any]) -> Exported:
    """What `subject` is in the format `to`, with checked options."""
    form, json_alone = FORMATS[to], given.pop("json", False)
    module, _, function = form.home.partition(":")
    made = getattr(import_module(f"fitball.exports.{module}"), function)(subject, **given)
    content, note = made if isinstance(made, tuple) else (made, "")
    stem, _, ending = form.name.partition(".")
    contents = {f".{ending}": content} if ending else content
    return Exported(stem, {".json": contents[".json"]} if json_alone else contents, note)
