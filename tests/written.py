"""Tables as texts: read, compared, refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fitball.data.read import load_table
from fitball.data.table import ImpactTable
from fitball.errors import Fault, TableError


def read(folder: Path, data: str | bytes, name: str = "t.csv", **words: object) -> ImpactTable:
    place = folder / name
    place.write_bytes(data if isinstance(data, bytes) else data.encode())
    return load_table(place, **words)  # type: ignore[arg-type]


def assert_same(one: ImpactTable, other: ImpactTable) -> None:
    """Every number and label is the same, to the last bit."""
    assert (one.ids, dict(one.labels), dict(one.units)) == (other.ids, dict(other.labels), dict(other.units))
    assert one.incident_columns == other.incident_columns
    for name in ("v_x1", "v_y1", "omega_1"):
        np.testing.assert_array_equal(getattr(one.impacts, name), getattr(other.impacts, name))
    assert [item.name for item in one.measurements] == [item.name for item in other.measurements]
    for item, same in zip(one.measurements, other.measurements, strict=True):
        np.testing.assert_array_equal(item.values, same.values)
        assert (item.sd is None) == (same.sd is None)
        if item.sd is not None:
            np.testing.assert_array_equal(item.sd, same.sd)


def faults_of(tmp_path: Path, text: str | bytes, name: str = "t.csv") -> tuple[Fault, ...]:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(TableError) as caught:
        load_table(path)
    assert str(path) in str(caught.value)
    for fault in caught.value.faults:
        told = str(caught.value)
        assert str(fault) in told or f"rows {fault.row}" in told or f", {fault.row}" in told
    return caught.value.faults


def only(tmp_path: Path, text: str | bytes) -> Fault:
    faults = faults_of(tmp_path, text)
    assert len(faults) == 1, faults
    return faults[0]
