"""Figures as files, written whole; equal figures become equal files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from fitball.report.form.atomic_write import write_whole

DPI = 150
# What would make equal figures unequal files: stamps of time and version.
STAMPS: Mapping[str, dict[str, Any]] = {
    "png": {},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
# As many as a drawing with smoothed edges needs: a third of the bytes that all colours take.
PNG_COLOURS = 96


def save_figure(figure: Figure, place: Path, form: str = "png", dpi: int = DPI) -> None:
    """Write a figure as png, svg or pdf. Raises ResultFolderError."""

    def write(target: Path) -> None:
        if form == "png":
            _write_png(figure, target, dpi)
            return
        with mpl.rc_context({"svg.hashsalt": "fitball"}):
            figure.savefig(target, format=form, dpi=dpi, metadata=STAMPS[form])

    write_whole(place, write)


def _write_png(figure: Figure, target: Path, dpi: int) -> None:
    """A picture of `PNG_COLOURS` colours at most."""
    before = figure.dpi
    figure.set_dpi(dpi)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])  # type: ignore[no-untyped-call]
    figure.set_dpi(before)
    few = pixels.quantize(PNG_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(target, "png", optimize=True, dpi=(dpi, dpi))
