"""A figure that shows itself at the end of a notebook cell, though pyplot does not know it."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure

from fitball.report.figures.style import own_style

__all__ = ["Figure", "ShownFigure"]

# Dots an inch on a screen.
SCREEN_DPI = 100


class ShownFigure(Figure):
    """A matplotlib Figure with the picture that notebooks ask objects for."""

    @own_style()
    def _repr_png_(self) -> bytes:
        """The figure as PNG."""
        out = BytesIO()
        self.savefig(out, format="png", dpi=SCREEN_DPI)
        return out.getvalue()
