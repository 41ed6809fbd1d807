"""The figures of a page as text to embed: vector where points are few, raster where they are many."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from fitball.report.figures.embed import PageFigure, data_uri, embed
from fitball.report.figures.names import FIGURES, FigureText
from fitball.report.figures.save import DPI, few_colours

# Impacts up to which a vector figure is smaller than its pixels (a marker is 250 bytes).
MOST_VECTOR = 400
HERE = Path()


def page_figures(
    figures: Mapping[str, Figure], alt: Mapping[str, str], impacts: int, folder: Path = HERE
) -> dict[str, list[PageFigure]]:
    """The figures of each section of the page; `impacts` is how many rows the table has, `folder` where the figures
    lie as PNG files.
    """
    sections: dict[str, list[PageFigure]] = {text.section: [] for text in FIGURES.values()}
    for name, text in FIGURES.items():
        if name not in figures:
            continue
        figure = figures[name]
        form = "png" if text.raster or impacts > MOST_VECTOR else "svg"
        shown = (
            embed(figure, text.caption, alt[name])
            if form == "svg"
            else _from_file(folder / f"{name}.png", text, alt[name])
        )
        sections[text.section].append(shown)
    return sections


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


def _from_file(place: Path, text: FigureText, alt: str) -> PageFigure:
    """A PNG file of `DPI`, in few colours where these suffice."""
    content = place.read_bytes()
    width = _pixels(content) / DPI
    return PageFigure(data_uri(few_colours(content) if text.raster else content, "png"), text.caption, alt, width)
