"""Figures as PNG files."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

DPI = 150


def save_png(figure: Figure, place: Path) -> None:
    """Save without the version stamp, so that equal figures are equal files."""
    figure.savefig(place, format="png", dpi=DPI, metadata={"Software": None})
