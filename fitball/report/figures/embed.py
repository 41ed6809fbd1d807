"""A figure as text to embed in a page that needs nothing but itself."""

from __future__ import annotations

import base64
from dataclasses import dataclass

from fitball.report.form.document import DPI


@dataclass(frozen=True)
class PageFigure:
    """A figure to embed: `source` (a data URI), `caption`, `alt` text, and its `width` in inches."""

    source: str
    caption: str
    alt: str
    width: float


def embed(png: bytes, caption: str, alt: str) -> PageFigure:
    """The content of a PNG file of `DPI` as it is; its width is the first number of its header chunk."""
    pixels = int.from_bytes(png[16:20], "big")
    source = f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
    return PageFigure(source, caption, alt, pixels / DPI)
