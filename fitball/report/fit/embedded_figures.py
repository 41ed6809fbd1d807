"""The figures of a page as text to embed: vector where points are few, raster where they are many."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from fitball.report.figures.kinds import DPI, save_figure

# Figures that draw thousands of draws or steps: a path for each would be larger than the pixels.
RASTER = ("corner", "trace")
# Impacts up to which a vector figure is smaller than its pixels (a marker is 250 bytes).
MOST_VECTOR = 400
# Dots an inch of a raster figure on the page; the files beside it are finer.
PAGE_DPI = 100
MEDIA = {"svg": "image/svg+xml", "png": "image/png"}


@dataclass(frozen=True)
class PageFigure:
    """A figure to embed: `source` (a data URI), `caption`, `alt` text, and its `width` in inches."""

    source: str
    caption: str
    alt: str
    width: float


def page_figures(
    figures: Mapping[str, Figure], captions: Mapping[str, str], alt: Mapping[str, str], impacts: int
) -> dict[str, PageFigure]:
    """Figures by name in the order of `captions`; `impacts` is how many rows the table has."""
    found = {}
    for name in captions:
        if name in figures:
            form = "png" if name in RASTER or impacts > MOST_VECTOR else "svg"
            content = _rendered(figures[name], form, PAGE_DPI if name in RASTER else DPI)
            width = float(figures[name].get_figwidth())
            found[name] = PageFigure(data_uri(content, form), captions[name], alt[name], width)
    return found


def embedded(images: Mapping[str, bytes], captions: Mapping[str, str]) -> dict[str, PageFigure]:
    """PNG files of `DPI` as they are, in the order of `captions`, which say what they show."""
    return {
        name: PageFigure(data_uri(images[name], "png"), captions[name], captions[name], _pixels(images[name]) / DPI)
        for name in captions
        if name in images
    }


def _pixels(png: bytes) -> int:
    """Width of a PNG file: the first number of its header chunk."""
    return int.from_bytes(png[16:20], "big")


def data_uri(content: bytes, form: str) -> str:
    """The content of an svg or png file as a URI."""
    return f"data:{MEDIA[form]};base64,{base64.b64encode(content).decode('ascii')}"


def _rendered(figure: Figure, form: str, dpi: int) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / f"figure.{form}"
        save_figure(figure, place, form, dpi)
        return place.read_bytes()
