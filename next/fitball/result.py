"""What a verb returns: one shape for Python, notebook, terminal and folder. Imports: errors, files, values.

A result is computed below and laid out above: it holds numbers, and the address of the module that lays it out, which
is imported when a report is first asked for. So no computation imports a report.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from fitball.errors import Note
from fitball.files import ResultFolder
from fitball.values import DataFrame, Figure


class Result:
    """Base of what verbs return: `Frames`, `Fit`, `Film`, `Exported`, `Batch`. `page` is the address of a module with
    `report(result) -> Report`, `figures(result) -> {name: () -> Figure}`, `files(result) -> {name: () -> bytes}`;
    `record` is the file written last.
    """

    page: ClassVar[str] = ""
    record: ClassVar[str] = ""
    notes: tuple[Note, ...]

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """All numbers, SI; each becomes `<name>.csv`."""

    @property
    def exit_code(self) -> int:
        """1 if the run finished and its own checks failed, such as a posterior that did not converge."""
        return 0

    def report(self, *, full: bool = True, width: int = 100, colour: bool = False) -> str:
        """As text; without `full` the summary alone, as in `_repr_html_`."""

    def plot(self, name: str) -> Figure:
        """A figure outside of pyplot. Raises ParameterError (`unknown-figure`, `no-such-data`) with those it has."""

    def json(self) -> dict[str, Any]:
        """Frames, notes and exit code, as `--json` prints them."""

    def save(
        self, folder: str | Path | ResultFolder, *, overwrite: bool = False, figures: bool = True, command: str = ""
    ) -> tuple[Path, ...]:
        """Write page, figures, frames and files, the record last; the only writer of results. A `ResultFolder` is
        locked already (the command line locks before a long run). Raises FolderError as `result_folder`.
        """


@dataclass(frozen=True, eq=False)
class Frames(Result):
    """A result that is its frames: of check, compare, predict, plan, simulate, rederive, bench. `layout` is the
    address of its page, "report.plan" or "thesis.page".
    """

    layout: str
    data: Mapping[str, DataFrame]
    notes: tuple[Note, ...] = ()
    failed: bool = False
