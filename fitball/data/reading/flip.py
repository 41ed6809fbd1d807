"""Columns counted the other way round, on request: what the option `flip` does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitball.data.findings import Findings
from fitball.data.number_column import NumberColumn
from fitball.errors import ParameterError, suggestion
from fitball.values import FloatArray

ANGLES = ("theta_1", "theta_2")
# Columns that have another way of counting; a speed and a time have not.
FLIPPABLE = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2", *ANGLES)


def flipped(name: str, values: FloatArray) -> FloatArray:
    """The values [SI] of a column counted the other way round: angles from the normal instead of from the court, all
    others with the other sign.
    """
    other: FloatArray = np.pi / 2.0 - values if name in ANGLES else -values
    return other


def flip_columns(
    columns: Mapping[str, NumberColumn], flip: Sequence[str], found: Findings
) -> dict[str, NumberColumn]:
    """The columns with those named in `flip` counted the other way round, and a notice that says so.

    Raises ParameterError for a name that is no such column of the table, or that is there twice.
    """
    turned = dict(columns)
    for name in flip:
        present = [known for known in FLIPPABLE if known in columns]
        if name not in present:
            raise ParameterError(f"flip: the table has no column '{name}' to flip: {suggestion(name, present)}")
        if flip.count(name) > 1:
            raise ParameterError(f"flip: {name} is named twice")
        turned[name] = replace(columns[name], values=flipped(name, columns[name].values))
        how = "from the normal" if name in ANGLES else "with the other sign"
        found.notice(f"{name} is counted {how}, on request (flip)", name)
    return turned


def flips_of(flip: Sequence[str], table: str) -> tuple[str, ...]:
    """Which columns of the table called `table` to flip: those named without a table, and those named with it, as in
    `my_balls:omega_1`.
    """
    named = [item.rpartition(":") for item in flip]
    return tuple(column for place, _, column in named if place in ("", table))


def check_flips(flip: Sequence[str], tables: Sequence[str]) -> None:
    """Raise ParameterError for a table that is not among `tables`."""
    for item in flip:
        place = item.rpartition(":")[0]
        if place and place not in tables:
            raise ParameterError(f"flip {item}: there is no table '{place}': {suggestion(place, tables)}")
