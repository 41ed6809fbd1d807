"""Room: parameter sets and ports for other programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from fitball.base.errors import FolderError, ModelError, Note, ParameterError, suggestion
from fitball.base.files import ResultFolder, result_folder
from fitball.base.text import listed
from fitball.exports import arviz, engine, page, parameters
from fitball.exports.parameter_set import of_fit, of_model
from fitball.exports.ports import FILES, port
from fitball.inference.fitted import Fit
from fitball.models.model import Model
from fitball.result import Result


class Format(NamedTuple):
    """The `file` of a format; who makes it of sets, the fit or None and an impact in words;
    `measured`: of a whole fit, no less; `at`: takes an impact; `ported`: holds or tests the bounce
    as source code, which not every model has.
    """

    file: str
    make: Callable[..., str | bytes]
    measured: bool = False
    at: bool = False
    ported: bool = False


FORMATS: Mapping[str, Format] = {
    **{
        name: Format(file, lambda sets, _fit, _at, name=name: port(sets, name), ported=True)
        for name, file in FILES.items()
    },
    "page": Format(
        "bounce.html",
        lambda sets, _fit, at: page.page(sets, at),
        at=True,
        ported=True,
    ),
    "engine": Format("engine.md", lambda sets, _fit, at: engine.engine(sets, at), at=True),
    "engine-json": Format("engine.json", lambda sets, _fit, at: engine.as_json(sets, at), at=True),
    "json": Format("parameters.json", lambda sets, fit, _at: parameters.as_json(sets, fit)),
    "latex": Format(
        "parameters.tex",
        lambda _sets, fit, _at: parameters.as_latex(fit),
        measured=True,
    ),
    "markdown": Format(
        "parameters.md",
        lambda _sets, fit, _at: parameters.as_markdown(fit),
        measured=True,
    ),
    "arviz": Format("arviz.nc", lambda _sets, fit, _at: arviz.netcdf(fit), measured=True),
}


@dataclass(frozen=True, eq=False)
class Exported(Result):
    """Files by name; `save` writes them alone, and without a folder the command line prints the
    text.
    """

    record: ClassVar[str] = ""
    contents: Mapping[str, str | bytes]
    notes: tuple[Note, ...] = ()

    def report(self, **_options: Any) -> str:
        """The text itself. Raises ParameterError (`no-text`) of a file that has none."""
        for name, content in self.contents.items():
            if isinstance(content, bytes):
                raise ParameterError(
                    f"{name} is no text: name a folder for it, --out DIR",
                    "no-text",
                )
        return "\n".join(str(content).removesuffix("\n") for content in self.contents.values())

    def _repr_html_(self) -> str:
        return f"<p>{listed(self.contents)}: save(folder) writes it.</p>"

    def json(self) -> dict[str, Any]:
        """The texts by name."""
        texts = {
            name: content for name, content in self.contents.items() if isinstance(content, str)
        }
        return {"files": texts, "notes": [], "exit_code": self.exit_code}

    def save(
        self, folder: str | Path | ResultFolder, *, overwrite: bool = False, **_options: Any
    ) -> tuple[Path, ...]:
        """Write the files and nothing else. Raises FolderError as `result_folder`, and
        `older-result` where one is there already.
        """
        if not isinstance(folder, ResultFolder):
            with result_folder(Path(folder)) as held:
                return self.save(held, overwrite=overwrite)
        there = [name for name in self.contents if (folder.path / name).exists() and not overwrite]
        if there:
            remedy = "replace it with --overwrite (overwrite=True), or name another folder"
            raise FolderError(
                f"{folder.path / there[0]}: is there already; {remedy}",
                "older-result",
            )
        texts = {
            name: text.encode() if isinstance(text, str) else text
            for name, text in self.contents.items()
        }
        return tuple(folder.write(name, text) for name, text in texts.items())


def export(
    source: Fit | Model,
    to: str,
    *,
    level: Mapping[str, str],
    fix: Mapping[str, Any],
    at: str,
) -> Exported:
    """A fit at its point on each of its surfaces, or those of `level`; or a model at numbers or
    `literature:KEY`, other parameters at their typical value. Raises ParameterError
    (`unknown-format`, `unknown-label`, `not-for-this-format`), ModelError (`own-model`, `no-port`).
    """
    if to not in FORMATS:
        raise ParameterError(f"unknown format '{to}': {suggestion(to, FORMATS)}", "unknown-format")
    form = FORMATS[to]
    fit = source if isinstance(source, Fit) else None
    faults = {
        f"format {to} needs a fit": form.measured and fit is None,
        f"format {to} has all surfaces of a fit: leave out level": form.measured and bool(level),
        "level chooses a surface or ball of a fit: leave it out": fit is None and bool(level),
        "fix sets values of a model: leave it out, or name a model instead of a fit": fit
        is not None
        and bool(fix),
        f"at is an impact for {listed((n for n, f in FORMATS.items() if f.at), last='and')}, not "
        f"for {to}": (bool(at) and not form.at),
    }
    for fault, found in faults.items():
        if found:
            raise ParameterError(fault, "not-for-this-format")
    sets = (of_model(source, fix),) if isinstance(source, Model) else of_fit(source, level)
    try:
        return Exported({form.file: form.make(sets, fit, at)})
    except ModelError as error:
        if not form.ported:
            raise
        others = (name for name, other in FORMATS.items() if not other.ported)
        remedy = f"{error}. Its numbers can be exported: {listed(others, last='or', most=20)}"
        raise ModelError(remedy, error.code) from None
