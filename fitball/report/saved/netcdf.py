"""netCDF-4 files, written variable by variable: xarray would copy them all first, and takes half a second to load."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np
from numpy.typing import NDArray

from fitball.report.form.files import write_bytes
from fitball.version import __version__


@dataclass(frozen=True)
class Variable:
    """An array of a group, with the names of its dimensions: numbers, or texts as objects."""

    name: str
    dimensions: tuple[str, ...]
    values: NDArray[Any]
    attributes: Mapping[str, str] = field(default_factory=dict)


def write_groups(path: Path, groups: Mapping[str, Iterable[Variable]], **attributes: str) -> None:
    """Write groups (by name, "" for the file itself), whole or not at all; only one variable at a time is in memory
    beside the file where the groups make them one by one. `attributes` are those of the first group.

    Raises ResultFolderError.
    """
    told = {"created_by": f"fitball {__version__}", **attributes}
    held: list[h5py.Dataset] = []
    made = io.BytesIO()
    with h5py.File(made, "w", track_order=True) as below, h5netcdf.File(below, "w") as file:
        for name, variables in groups.items():
            group = file.create_group(name) if name else file
            group.attrs.update(told)
            told = {}
            for variable in variables:
                _write(group, below[group.name], variable, held)
    write_bytes(path, made.getbuffer())


def _write(group: Any, below: h5py.Group, variable: Variable, held: list[h5py.Dataset]) -> None:
    values = variable.values
    for name, size in zip(variable.dimensions, values.shape, strict=True):
        if name not in group.dimensions:
            group.dimensions[name] = size
            # The variable of a dimension takes the place of what stood for it, whose room in the file is free once
            # nobody holds it. A profiler may hold it for a while, as Dask's does: then so do we, always, to the end,
            # or the same content would give other bytes.
            held.append(below[name])
    kind = h5py.string_dtype() if values.dtype.kind == "O" else values.dtype
    # As xarray marks what is missing.
    missing = np.nan if values.dtype.kind == "f" else None
    made = group.create_variable(variable.name, variable.dimensions, kind, data=values, fillvalue=missing)
    made.attrs.update(variable.attributes)
