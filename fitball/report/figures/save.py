"""Figures as files, each drawn once: a page embeds what was written; equal figures become equal files."""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from fitball.report.figures.names import DPI
from fitball.report.figures.style import own_style
from fitball.report.form.atomic_write import write_bytes

# What would make equal figures unequal files: stamps of time and version.
STAMPS: Mapping[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
# As many as a drawing with smoothed edges needs: a third of the bytes that all colours take, and less time.
PNG_COLOURS = 128


def save_figure(figure: Figure, place: Path, form: str = "png", dpi: int = DPI) -> bytes:
    """Write a figure as png, svg or pdf, and return what was written. Raises ResultFolderError."""
    content = rendered(figure, form, dpi)
    write_bytes(place, content)
    return content


@own_style()
def rendered(figure: Figure, form: str, dpi: int) -> bytes:
    """A figure as the content of a png, svg or pdf file."""
    with warnings.catch_warnings():
        # A letter of a user's name that no font here has is seen as a box; the name stands in tables and alt texts.
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        if form == "png":
            return _png(figure, dpi)
        made = io.BytesIO()
        figure.savefig(made, format=form, dpi=dpi, metadata=STAMPS[form])
    return made.getvalue()


def _png(figure: Figure, dpi: int) -> bytes:
    canvas: Any = FigureCanvasAgg(figure)
    before = figure.dpi
    figure.set_dpi(dpi)
    try:
        canvas.draw()
        picture = few_colours(np.asarray(canvas.buffer_rgba()))
    finally:
        figure.set_dpi(before)
    made = io.BytesIO()
    picture.save(made, "png", dpi=(dpi, dpi))
    return made.getvalue()


def few_colours(pixels: NDArray[np.uint8]) -> Image.Image:
    """A picture (height, width, 4) on opaque paper in its `PNG_COLOURS` most frequent colours, six bits of each
    channel kept, and of colours that differ in the last of these one: areas keep theirs, smoothed edges the nearest.
    """
    packed = pixels.view("<u4")[..., 0]
    code = ((packed >> 2) & 0x3F) | ((packed >> 4) & 0xFC0) | ((packed >> 6) & 0x3F000)
    counts = np.bincount(code.ravel(), minlength=1 << 18)
    seen = np.flatnonzero(counts)
    seen = seen[np.argsort(-counts[seen], kind="stable")]
    six = np.stack([seen & 0x3F, (seen >> 6) & 0x3F, seen >> 12], axis=1)
    _, first = np.unique((six >> 1) @ (1, 1 << 5, 1 << 10), return_index=True)
    colours = (six << 2) | (six >> 4)
    palette = colours[np.sort(first)[:PNG_COLOURS]]
    # Squares of distances, less what is the same for the whole palette.
    nearest = np.argmin((palette**2).sum(axis=1) - 2 * colours @ palette.T, axis=1)
    places = np.zeros(1 << 18, dtype=np.uint8)
    places[seen] = nearest
    picture = Image.fromarray(places[code])
    picture.putpalette(palette.astype(np.uint8).tobytes())
    return picture
