"""`Drawn`, the result of `plot`: figures of a fit, written into its folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from fitball.base.errors import Note
from fitball.base.files import WAIT, ResultFolder, result_folder
from fitball.base.text import listed
from fitball.base.values import DataFrame
from fitball.report.page import Layout
from fitball.report.plotted import PAGE, Plotted
from fitball.report.style import image_bytes
from fitball.results.result import Result


@dataclass(frozen=True, eq=False, repr=False)
class Drawn(Result):
    """Figures of a fit as files; its numbers are those of the fit.

    Example:
        >>> import fitball
        >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
        >>> fitball.plot(fit, "curves")
        <Drawn: curves, as png>
    """

    plotted: Plotted

    def __repr__(self) -> str:
        return f"<Drawn: {listed(self.names, most=20)}, as {self.plotted.form}>"

    @property
    def notes(self) -> tuple[Note, ...]:  # type: ignore[override]
        """Which figures the fit has no data for, where all were asked for.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
            >>> [note.code for note in fitball.plot(fit).notes]
            ['not-drawn']
        """
        return self.plotted.notes

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the figures, in the order in which they were asked for.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
            >>> fitball.plot(fit, "residuals,curves").names
            ('residuals', 'curves')
        """
        return self.plotted.names

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """An empty mapping: the fit has the numbers.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
            >>> fitball.plot(fit, "curves").frames
            {}
        """
        return {}

    @property
    def _layout(self) -> Layout:
        return PAGE.of(self.plotted)

    def save(
        self,
        folder: str | Path | ResultFolder,
        *,
        overwrite: bool = False,
        figures: bool | Literal["all"] = True,
        **_options: object,
    ) -> tuple[Path, ...]:
        """Write the figures beside what the folder has, in place of older ones of the same names,
        and return their paths. The options of other results have no effect.

        Raises:
            FolderError: another run holds the folder (`folder-in-use`), or it cannot be made or
                written (`no-folder`, `not-written`).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("wang_zero_spin", model="brody", point_only=True)
            >>> paths = fitball.plot(fit, "curves", format="svg").save("figures")
            >>> [path.name for path in paths]
            ['curves.svg']
        """
        if not isinstance(folder, ResultFolder):
            # A run that writes into the folder of the fit is waited for.
            with result_folder(Path(folder), wait=WAIT) as locked:
                return self.save(locked, overwrite=overwrite, figures=figures)
        form = self.plotted.form
        # All are drawn before any is written.
        images = {f"{name}.{form}": image_bytes(self.plot(name), form) for name in self.names}
        return tuple(folder.write(name, image) for name, image in images.items())
