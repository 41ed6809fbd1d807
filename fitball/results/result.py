"""The shape of what verbs return, for Python, notebook, terminal and folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal

from fitball.base.errors import Note, ParameterError, suggestion
from fitball.base.files import REPORT_FILE, ResultFolder, csv_bytes, result_folder, with_index
from fitball.base.findings import Findings
from fitball.base.numbers import counted
from fitball.base.text import listed
from fitball.base.values import DataFrame, Figure
from fitball.base.workbook import WORKBOOK_FILE, workbook_bytes
from fitball.report.blocks import Report
from fitball.report.page import Layout, Page


class Result:
    """What a verb returns: all numbers as `frames`, what a reader must know of them as `notes`,
    and a page of both. `record` is the file that is written last.

    Example:
        >>> import fitball
        >>> isinstance(fitball.check("wang_zero_spin"), fitball.Result)
        True
    """

    record: ClassVar[str] = REPORT_FILE
    # A field of some results, and a property of others: checkers accept only one of the two.
    notes: tuple[Note, ...]

    def __repr__(self) -> str:
        sizes = (f"{name} ({counted(len(frame), 'row')})" for name, frame in self.frames.items())
        return f"<{type(self).__name__}: {listed(sizes, most=20)}>"

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """All numbers of a result by name, in SI; each frame becomes `<name>.csv`.

        Example:
            >>> import fitball
            >>> checked = fitball.check("wang_zero_spin")
            >>> list(checked.frames)
            ['table', 'faults', 'doubts']
        """
        raise NotImplementedError

    @property
    def exit_code(self) -> int:
        """1 if the run finished and its own checks failed, such as a posterior that did not
        converge, else 0.

        Example:
            >>> import fitball
            >>> fitball.check("wang_zero_spin").exit_code
            0
        """
        return 0

    @property
    def _layout(self) -> Layout:
        """The page of this result."""
        raise NotImplementedError

    @cached_property
    def _report(self) -> Report:
        """The page of this result, laid out once."""
        return self._layout.report()

    def report(self, *, full: bool = True, width: int = 100, colour: bool = False) -> str:
        """The report as text of `width` columns; without `full` the summary alone, as in a
        notebook.

        Example:
            >>> import fitball
            >>> checked = fitball.check("wang_zero_spin")
            >>> checked.report(full=False).splitlines()[0]
            'Check of a table'
        """
        from fitball.report.render import to_text

        return to_text(self._report, width=width, colour=colour, full=full)

    def _repr_html_(self) -> str:
        from fitball.report.render import to_notebook

        return to_notebook(self._report)

    def plot(self, name: str) -> Figure:
        """A figure by its name, outside of pyplot.

        Raises:
            ParameterError: the result has no such figure, with the names of those that it has
                (`unknown-figure`), or no data for it (`no-such-data`).

        Example:
            >>> import fitball
            >>> simulated = fitball.simulate(impact="v_1=25, theta_1=20 deg")
            >>> figure = simulated.plot("history")
            >>> figure.savefig("history.pdf")
        """
        from fitball.report.style import draw_styled

        figures = self._layout.figures()
        if name not in figures:
            hint = suggestion(name, figures) if figures else "this result has none"
            raise ParameterError(f"no figure '{name}': {hint}", "unknown-figure")
        return draw_styled(figures[name])

    def json(self) -> dict[str, Any]:
        """Frames, notes and exit code, as `--json` prints them: rows by column, null for what is no
        finite number.

        Example:
            >>> import fitball
            >>> checked = fitball.check("wang_zero_spin")
            >>> list(checked.json())
            ['frames', 'notes', 'exit_code']
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
        xlsx: bool = False,
        command: str = "",
    ) -> tuple[Path, ...]:
        """Write page, figures, frames and files, the record last, and return their paths. Figures
        are those that the page shows unasked, or all that it has a place for; `xlsx` is for a
        workbook `results.xlsx` of all frames. A `ResultFolder` is locked already (the command line
        locks before a long run).

        Raises:
            FolderError: the folder is in use (`folder-in-use`), has an older result
                (`older-result`), or cannot be made or written (`no-folder`, `not-written`).
            ParameterError: a workbook is wanted without openpyxl (`no-openpyxl`).

        Example:
            >>> import fitball
            >>> checked = fitball.check("wang_zero_spin")
            >>> [path.name for path in checked.save("checked", figures=False)][-1]
            'report.html'
        """
        if not isinstance(folder, ResultFolder):
            with result_folder(Path(folder), overwrite=overwrite, record=self.record) as locked:
                return self.save(locked, figures=figures, xlsx=xlsx, command=command)
        from fitball.report.render import to_page

        images = self._images(figures)
        contents = {name: make() for name, make in self._layout.files().items()}
        contents |= {f"{name}.csv": csv_bytes(frame) for name, frame in self.frames.items()}
        contents |= {f"{name}.png": image for name, image in images.items()}
        if xlsx:
            contents[WORKBOOK_FILE] = workbook_bytes(self._sheets)
        contents[REPORT_FILE] = to_page(self._report, images, command).encode()
        # The record is last: where it is, all other files are.
        order = sorted(contents, key=lambda name: name == self.record)
        return folder.replace({name: contents[name] for name in order})

    @property
    def _sheets(self) -> Mapping[str, DataFrame]:
        """The frames of a workbook by name of sheet."""
        return self.frames

    def _images(self, figures: bool | Literal["all"]) -> dict[str, bytes]:
        """The figures of the page as PNG, by name."""
        if not figures:
            return {}
        from fitball.report.style import image_bytes

        drawable = self._layout.figures()
        on_page = self._report.pictures(every=figures == "all")
        return {name: image_bytes(self.plot(name)) for name in on_page if name in drawable}


def _rows(frame: DataFrame) -> list[dict[str, object]]:
    """Rows as JSON has them, with the index where that has a name; null for what is no finite
    number.
    """
    import numpy as np
    import pandas as pd

    cells = with_index(frame).astype(object)
    finite = pd.notna(cells) & ~cells.isin([np.inf, -np.inf])
    rows = cells.where(finite, None).to_dict("records")
    return [{str(head): cell for head, cell in row.items()} for row in rows]


@dataclass(frozen=True, eq=False, repr=False)
class Frames(Result):
    """A result that is its frames: findings and their page, as check, compare, predict, plan,
    simulate, rederive and bench return them.

    Example:
        >>> import fitball
        >>> fitball.check("wang_zero_spin")
        <Frames: table (7 rows), faults (0 rows) and doubts (0 rows)>
    """

    findings: Findings
    page: Page[Findings]

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """All numbers of the findings by name, in SI.

        Example:
            >>> import fitball
            >>> fitball.check("wang_zero_spin").frames["table"].shape
            (7, 8)
        """
        return self.findings.frames

    @property
    def notes(self) -> tuple[Note, ...]:  # type: ignore[override]
        """What a reader must know of the findings: notes with a stable `code` and a `text`.

        Example:
            >>> import fitball
            >>> {note.code for note in fitball.check("wang_zero_spin").notes}
            {'disagreement'}
        """
        return self.findings.notes

    @property
    def exit_code(self) -> int:
        """1 if the computation finished and its own checks failed, else 0.

        Example:
            >>> import fitball
            >>> fitball.check({"v_y1": [7.0]}).exit_code
            1
        """
        return int(self.findings.failed)

    @property
    def _layout(self) -> Layout:
        return self.page.of(self.findings)
