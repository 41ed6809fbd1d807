"""What a verb returns: one shape for Python, notebook, terminal and folder.

A result is computed below and laid out above: it holds numbers, and the address of the module that
lays it out, which is imported when a report is first asked for. So no computation imports a report.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Literal

from fitball.base.errors import Note, ParameterError, suggestion
from fitball.base.files import ResultFolder, csv_bytes, result_folder, with_index
from fitball.base.values import DataFrame, Figure


class Result:
    """Base of what verbs return: `Frames`, `Fit`, `Film`, `Exported`, `Batch`. `page` is the
    address of a module with `report(result) -> Report` and, where there are any, `figures(result)
    -> {name: () -> Figure}` and, besides frames and page, `files(result) -> {name: () -> bytes}`;
    `record` is the file written last.
    """

    page: ClassVar[str] = ""
    record: ClassVar[str] = "report.html"
    notes: tuple[Note, ...]

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """All numbers, SI; each becomes `<name>.csv`."""
        raise NotImplementedError

    @property
    def exit_code(self) -> int:
        """1 if the run finished and its own checks failed, such as a posterior that did not
        converge.
        """
        return 0

    @property
    def _layout(self) -> Any:
        return import_module(self.page)

    def _made(self, kind: str) -> Mapping[str, Any]:
        made: Mapping[str, Any] = getattr(self._layout, kind, lambda _: {})(self)
        return made

    @cached_property
    def _report(self) -> Any:
        return self._layout.report(self)

    def report(self, *, full: bool = True, width: int = 100, colour: bool = False) -> str:
        """As text; without `full` the summary alone, as in `_repr_html_`."""
        text: str = _renderer().to_text(self._report, width=width, colour=colour, full=full)
        return text

    def _repr_html_(self) -> str:
        html: str = _renderer().to_notebook(self._report)
        return html

    def plot(self, name: str) -> Figure:
        """A figure outside of pyplot. Raises ParameterError (`unknown-figure`, `no-such-data`) with
        those it has.
        """
        figures = self._made("figures")
        if name not in figures:
            raise ParameterError(
                f"no figure '{name}': {suggestion(name, figures)}",
                "unknown-figure",
            )
        figure: Figure = import_module("fitball.report.style").styled(figures[name])
        return figure

    def json(self) -> dict[str, Any]:
        """Frames, notes and exit code, as `--json` prints them: rows by column, null for what is no
        finite number.
        """
        return {
            "frames": {name: _rows(frame) for name, frame in self.frames.items()},
            "notes": [{"code": note.code, "text": note.text} for note in self.notes],
            "exit_code": self.exit_code,
        }

    def save(
        self,
        folder: str | Path | ResultFolder,
        *,
        overwrite: bool = False,
        figures: bool | Literal["all"] = True,
        command: str = "",
    ) -> tuple[Path, ...]:
        """Write page, figures, frames and files, the record last; the only writer of results.
        Figures are those that the page shows unasked, or all that it has a place for. A
        `ResultFolder` is locked already (the command line locks before a long run). Raises
        FolderError as `result_folder`.
        """
        if not isinstance(folder, ResultFolder):
            with result_folder(Path(folder), overwrite=overwrite, record=self.record) as held:
                return self.save(held, figures=figures, command=command)
        style = import_module("fitball.report.style")
        drawable = self._made("figures") if figures else {}
        shown = self._report.pictures(every=figures == "all")
        images = {name: style.saved(self.plot(name)) for name in shown if name in drawable}
        contents = {name: make() for name, make in self._made("files").items()}
        contents |= {f"{name}.csv": csv_bytes(frame) for name, frame in self.frames.items()}
        contents |= {f"{name}.png": image for name, image in images.items()}
        contents["report.html"] = _renderer().to_page(self._report, images, command).encode()
        folder.clear()
        # Whoever finds the record finds all the rest.
        order = sorted(contents, key=lambda name: name == self.record)
        return tuple(folder.write(name, contents[name]) for name in order)


def _renderer() -> Any:
    return import_module("fitball.report.render")


def _rows(frame: DataFrame) -> list[dict[str, Any]]:
    """Rows as JSON has them, with the index where that has a name."""
    import numpy as np
    import pandas as pd

    known = with_index(frame).astype(object)
    rows = known.where(pd.notna(known) & ~known.isin([np.inf, -np.inf]), None).to_dict("records")
    return [{str(head): cell for head, cell in row.items()} for row in rows]


@dataclass(frozen=True, eq=False)
class Frames(Result):
    """A result that is its frames: of check, compare, predict, plan, simulate, rederive, bench.
    `layout` is the address of its page, "report.plan" or "thesis.page".
    """

    layout: str
    data: Mapping[str, DataFrame]
    notes: tuple[Note, ...] = ()
    failed: bool = False

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """The data as they are."""
        return self.data

    @property
    def exit_code(self) -> int:
        """1 if `failed`."""
        return int(self.failed)

    @property
    def _layout(self) -> Any:
        return import_module(f"fitball.{self.layout}")
