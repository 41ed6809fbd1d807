"""Figures as files, written whole; equal figures become equal files."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from PIL import Image

from fitball.report.form.atomic_write import write_whole

DPI = 150
# What would make equal figures unequal files: stamps of time and version.
STAMPS: Mapping[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
# As many as a drawing with smoothed edges needs: a third of the bytes that all colours take.
PNG_COLOURS = 96


def save_figure(figure: Figure, place: Path, form: str = "png", dpi: int = DPI) -> None:
    """Write a figure as png, svg or pdf. Raises ResultFolderError."""

    def write(target: Path) -> None:
        with mpl.rc_context({"svg.hashsalt": "fitball"}):
            figure.savefig(target, format=form, dpi=dpi, metadata=STAMPS[form])

    write_whole(place, write)


def few_colours(png: bytes) -> bytes:
    """A PNG file of the same picture in `PNG_COLOURS` colours at most: nearly white becomes white."""
    made = io.BytesIO()
    pixels = Image.open(io.BytesIO(png)).convert("RGB")
    pixels.quantize(PNG_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(made, "png", optimize=True)
    return made.getvalue()
