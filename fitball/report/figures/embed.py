"""A figure as text to embed in a page that needs nothing but itself."""

from __future__ import annotations

import base64
import tempfile
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from matplotlib.figure import Figure

from fitball.report.figures.save import DPI, save_figure

# What may stand in a quoted attribute as it is, beside letters and digits.
PLAIN = " :;,=()/!*+-._~@$?[]{}|'\n"
MEDIA = {"svg": "image/svg+xml", "png": "image/png"}


@dataclass(frozen=True)
class PageFigure:
    """A figure to embed: `source` (a data URI), `caption`, `alt` text, and its `width` in inches."""

    source: str
    caption: str
    alt: str
    width: float


def embed(figure: Figure, caption: str, alt: str, form: str = "svg", dpi: int = DPI) -> PageFigure:
    """The figure as it stands, as svg or png."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / f"figure.{form}"
        save_figure(figure, place, form, dpi)
        content = place.read_bytes()
    return PageFigure(data_uri(content, form), caption, alt, float(figure.get_figwidth()))


def data_uri(content: bytes, form: str) -> str:
    """The content of an svg or png file as a URI; text stays text, a quarter shorter than in base 64."""
    if form == "svg":
        text = quote(content.decode("utf-8").replace('"', "'"), safe=PLAIN)
        # Names of XML look like addresses: a page that asks for none should show none.
        return f"data:{MEDIA[form]},{text.replace('http:', 'http%3A')}"
    return f"data:{MEDIA[form]};base64,{base64.b64encode(content).decode('ascii')}"
