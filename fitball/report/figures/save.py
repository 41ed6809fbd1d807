"""Figures as files, written whole; equal figures become equal files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from fitball.report.form.atomic_write import write_whole

DPI = 150
# What would make equal figures unequal files: stamps of time and version.
STAMPS: Mapping[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def save_figure(figure: Figure, place: Path, form: str = "png", dpi: int = DPI) -> None:
    """Write a figure as png, svg or pdf. Raises ResultFolderError."""

    def write(target: Path) -> None:
        with mpl.rc_context({"svg.hashsalt": "fitball"}):
            figure.savefig(target, format=form, dpi=dpi, metadata=STAMPS[form])

    write_whole(place, write)
