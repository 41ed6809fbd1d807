"""Room: parameter sets and ports for other programs. Imports: report, uses, inference, models, data, base."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from fitball.errors import Note
from fitball.inference.fit import Fit
from fitball.models.model import Model
from fitball.result import Result

# Help of each: c, csharp, javascript, python, golden, page, engine, json, latex, markdown, arviz.
FORMATS: Mapping[str, str] = {}


@dataclass(frozen=True, eq=False)
class Exported(Result):
    """Files by name; `save` writes them alone, and without a folder the command line prints the text."""

    page: ClassVar[str] = "fitball.exports"
    contents: Mapping[str, str | bytes]
    notes: tuple[Note, ...]


def export(source: Fit | Model, to: str, *, level: Mapping[str, str], fix: Mapping[str, str], at: str) -> Exported:
    """A fit at its point on one surface, or a model at numbers or `literature:KEY`, other parameters at their typical
    value. Raises ParameterError (`unknown-format`, `unknown-label`, `not-for-this-format`), ModelError (`own-model`).
    """
