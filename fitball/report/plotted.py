"""What `plot` returns: figures of a fit, written into its folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar, Literal

from fitball.base.errors import Note, ParameterError, suggestion
from fitball.base.files import WAIT, ResultFolder, result_folder
from fitball.base.text import listed
from fitball.base.values import DataFrame, Figure
from fitball.inference.fitted import Fit
from fitball.report.blocks import Report, Text
from fitball.report.figures import FIGURES, drawable
from fitball.report.style import FORMATS, saved
from fitball.result import Result


@dataclass(frozen=True, eq=False)
class Drawn(Result):
    """Figures `names` of a fit, as files of a `form`; its numbers are those of the fit."""

    page: ClassVar[str] = "fitball.report.plotted"
    fit: Fit
    names: tuple[str, ...]
    form: str
    notes: tuple[Note, ...] = ()

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """None."""
        return {}

    def save(
        self,
        folder: str | Path | ResultFolder,
        *,
        overwrite: bool = False,
        figures: bool | Literal["all"] = True,
        command: str = "",
    ) -> tuple[Path, ...]:
        """Write the figures beside what the folder has, in place of older ones of the same
        names.
        """
        if not isinstance(folder, ResultFolder):
            with result_folder(Path(folder), wait=WAIT) as held:
                return self.save(held, overwrite=overwrite, figures=figures, command=command)
        # All are drawn before any is written.
        images = {f"{name}.{self.form}": saved(self.plot(name), self.form) for name in self.names}
        return tuple(folder.write(name, image) for name, image in images.items())


def drawn(fit: Fit, names: Sequence[str], form: str) -> Drawn:
    """The figures `names`, or all that a fit has data for. Raises ParameterError (`format`,
    `unknown-figure`, `no-such-data`).
    """
    if form not in FORMATS:
        raise ParameterError(
            f"format: read '{form}', expected {listed(FORMATS, last='or')}",
            "format",
        )
    known = drawable(fit)
    for name in names:
        if name not in FIGURES:
            raise ParameterError(
                f"no figure '{name}': {suggestion(name, FIGURES)}",
                "unknown-figure",
            )
        if name not in known:
            text = f"figure {name}: this fit has no data for it; it has {listed(known, most=20)}"
            raise ParameterError(text, "no-such-data")
    missing = [name for name in FIGURES if name not in known and not names]
    notes = [Note("not-drawn", f"This fit has no data for {listed(missing, most=20)}.")] * bool(
        missing
    )
    return Drawn(fit, tuple(dict.fromkeys(names)) or known, form, tuple(notes))


def report(result: Drawn) -> Report:
    """Which figures there are."""
    text = f"{listed(result.names, most=20)}, as {result.form}."
    return Report(
        f"Figures of {result.fit.run.table.name}",
        [Text([text, *(note.text for note in result.notes)])],
    )


def figures(result: Drawn) -> Mapping[str, Callable[[], Figure]]:
    """Those that were asked for."""
    return {name: partial(FIGURES[name], result.fit) for name in result.names}
