"""Markers of a motion capture (`.c3d`), read by ezc3d to the cells of a table."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from fitball.base.environment import install_command
from fitball.base.text import one_line
from fitball.data import records
from fitball.data.cells import CellArray, TableCells
from fitball.data.records import refusal

# The second byte of a C3D file, behind the number of the block with its parameters.
_KEY = 0x50
# What ezc3d raises for damaged files.
_DAMAGED = (OSError, ValueError, LookupError, TypeError, RuntimeError)


def is_c3d(data: bytes) -> bool:
    """Whether the bytes of a file begin as those of a C3D file."""
    return data[1:2] == bytes([_KEY])


def cells_of_c3d(path: str, data: bytes) -> TableCells:
    """The cells of the markers of a C3D file: `t [s]`, and `NAME X`, `NAME Y`, `NAME Z` of each
    marker, in the unit of the file.

    Raises:
        InputError: The package that reads it is missing, or it cannot be read (`other-format`); it
            is too large (`too-large`).
    """
    try:
        import ezc3d
    except ImportError:
        words = (
            "is a file of motion capture: install the package that reads it "
            f"({install_command('ezc3d')}), or save its markers as CSV"
        )
        raise refusal(path, "other-format", words) from None
    try:
        file: Any = ezc3d.c3d(path)
        points = np.asarray(file["data"]["points"], dtype=np.float64)[:3]
        of_points = file["parameters"]["POINT"]
        rate = float(of_points["RATE"]["value"][0])
        names = [str(name).strip() for name in of_points["LABELS"]["value"]]
        units = of_points.get("UNITS", {}).get("value", [])
        first = int(file["header"]["points"]["first_frame"])
    except _DAMAGED as error:
        words = f"is a file of motion capture that ezc3d cannot read ({one_line(str(error))})"
        raise refusal(path, "other-format", words) from None
    unit = f" [{str(units[0]).strip()}]" if units else ""
    _, count, frames = points.shape
    records.check_shape(path, frames, 3 * count)
    header = ["frame", "t [s]"]
    number = first + np.arange(float(frames))
    columns: list[CellArray] = [number, number / rate]
    for k, name in enumerate(names[:count]):
        header += [f"{name} {axis}{unit}" for axis in "XYZ"]
        columns += [*points[:, k, :]]
    rows = np.arange(frames) + 1
    return TableCells(path, hashlib.sha256(data).hexdigest(), header, columns, rows)
