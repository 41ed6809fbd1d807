"""Figures as files, each drawn once: a page embeds what was written; equal figures become equal files."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from fitball.report.figures.names import DPI
from fitball.report.form.atomic_write import write_bytes

# What would make equal figures unequal files: stamps of time and version.
STAMPS: Mapping[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
# As many as a drawing with smoothed edges needs: a third of the bytes and of the time that all colours take.
PNG_COLOURS = 96


def save_figure(figure: Figure, place: Path, form: str = "png", dpi: int = DPI) -> bytes:
    """Write a figure as png, svg or pdf, and return what was written. Raises ResultFolderError."""
    content = rendered(figure, form, dpi)
    write_bytes(place, content)
    return content


def rendered(figure: Figure, form: str, dpi: int) -> bytes:
    """A figure as the content of a png, svg or pdf file."""
    if form == "png":
        return _png(figure, dpi)
    made = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "fitball"}):
        figure.savefig(made, format=form, dpi=dpi, metadata=STAMPS[form])
    return made.getvalue()


def _png(figure: Figure, dpi: int) -> bytes:
    """The figure in `PNG_COLOURS` colours at most: nearly white becomes white."""
    canvas: Any = FigureCanvasAgg(figure)
    before = figure.dpi
    figure.set_dpi(dpi)
    try:
        canvas.draw()
        pixels = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    finally:
        figure.set_dpi(before)
    made = io.BytesIO()
    few = pixels.quantize(PNG_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(made, "png", dpi=(dpi, dpi))
    return made.getvalue()
