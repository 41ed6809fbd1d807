"""`data.nc`: the measurements that a fit was made from, one variable per column; `fit.json` holds their digest."""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import SD_SUFFIX
from fitball.data.hdf5_arrays import array, finite, opened, texts
from fitball.data.table import ImpactTable, Measurement
from fitball.errors import ParameterError, ResultFolderError
from fitball.inference.problem.force_records import Averaged, ForceRecords
from fitball.inference.problem.problem import Problem
from fitball.observables import SI_UNITS
from fitball.report.saved.fit_file import DataPart, ForcePart, TablePart
from fitball.report.saved.netcdf import Variable, write_groups
from fitball.report.saved.structure import part
from fitball.values import Impacts

DATA_NAME = "data.nc"
KIND = "fitball data"
INCIDENT = ("v_x1", "v_y1", "omega_1")
# What is kept of each force record besides its means, as numbers of one kind each.
COUNTS = ("row", "block", "samples")
NUMBERS = ("first", "spacing", "begin", "length", "peak", "centroid")
_FORCE = "force_"
# Label columns are numbered, because a user may have named one anything; `fit.json` holds their names.
_LABEL = "label_"
COVARIANCE = "incident_covariance"
Columns = Mapping[str, NDArray[Any]]


def data_columns(table: ImpactTable, force: ForceRecords | None) -> dict[str, NDArray[Any]]:
    """Every column of `data.nc` by name, in SI: texts as objects, numbers as float64 or int64."""
    columns: dict[str, NDArray[Any]] = {"impact": np.array(table.ids, dtype=object)}
    columns |= {name: getattr(table.impacts, name) for name in INCIDENT}
    for measurement in table.measurements:
        columns[measurement.name] = measurement.values
        if measurement.sd is not None:
            columns[measurement.name + SD_SUFFIX] = measurement.sd
    columns |= {name + SD_SUFFIX: sd for name, sd in table.incident_sd.items()}
    if table.incident_covariance is not None:
        columns[COVARIANCE] = table.incident_covariance
    columns |= {f"{_LABEL}{k}": np.array(column, dtype=object) for k, column in enumerate(table.labels.values())}
    if force is not None:
        columns |= {_FORCE + name: np.array([getattr(record, name) for record in force.records]) for name in COUNTS}
        columns |= {_FORCE + name: np.array([getattr(record, name) for record in force.records]) for name in NUMBERS}
        columns[_FORCE + "means"] = np.where(force.mask, force.means, np.nan)
    return columns


def data_part(problem: Problem) -> DataPart:
    """What `fit.json` says of the measurements: which columns there are, their digest, and what the scene knows of
    the contact time.
    """
    table, force = problem.table, problem.force
    return part(
        DataPart,
        table,
        incident_sd=tuple(table.incident_sd),
        measurements=tuple(measurement.name for measurement in table.measurements),
        with_sd=tuple(measurement.name for measurement in table.measurements if measurement.sd is not None),
        labels=tuple(table.labels),
        contact_time=problem.contact_time,
        sha256=digest(data_columns(table, force)),
        force=None if force is None else ForcePart(Path(force.source).name, force.digest, force.start_sd),
    )


def digest(columns: Columns) -> str:
    """SHA-256 over names, shapes and content of all columns, whatever their order."""
    checksum = sha256()
    for name in sorted(columns):
        column = columns[name]
        text = column.dtype.kind not in "fi"
        # Lengths, so that no text can stand for another column.
        checksum.update(f"{name} {column.shape} {'text' if text else column.dtype.kind}\n".encode())
        checksum.update(_packed(column) if text else np.ascontiguousarray(column).tobytes())
    return checksum.hexdigest()


def _packed(column: NDArray[Any]) -> bytes:
    return "".join(f"{len(item)}:{item}" for item in map(str, column)).encode("utf-8", "surrogatepass")


def write_data(problem: Problem, path: Path) -> None:
    """Write `data.nc`, whole or not at all. Raises ResultFolderError."""
    names = {f"{_LABEL}{k}": name for k, name in enumerate(problem.table.labels)}
    variables = []
    for name, column in data_columns(problem.table, problem.force).items():
        dims = ("record", "node") if name.startswith(_FORCE) else ("impact", "state", "other_state")
        told = {"units": SI_UNITS.get(name.removesuffix(SD_SUFFIX), ""), "long_name": names.get(name, "")}
        known = {key: word for key, word in told.items() if word}
        variables.append(Variable(name, dims[: column.ndim], column, known))
    write_groups(path, {"": variables}, kind=KIND)


def read_columns(data: DataPart, impacts: int, place: Path) -> dict[str, NDArray[Any]]:
    """The columns of `data.nc` at `place` that `data`, a section of `fit.json`, names, of so many `impacts`.

    Raises ResultFolderError for a file that is missing, damaged, or not the data of that fit.
    """
    sds = [name + SD_SUFFIX for name in data.with_sd]
    exact = (*INCIDENT, *(name + SD_SUFFIX for name in data.incident_sd))
    with opened(place, "the measurements that belong to the fit.json beside it") as file:
        columns = {name: texts(file, name, impacts) for name in ("impact", *_labels(data))}
        columns |= {name: finite(file, name, (impacts,)) for name in exact}
        columns |= {name: finite(file, name, (impacts,), gaps=True) for name in (*data.measurements, *sds)}
        _check_gaps(columns, data)
        if data.incident_sd:
            columns[COVARIANCE] = finite(file, COVARIANCE, (impacts, 3, 3))
        if data.force is not None:
            columns |= _force_columns(file)
        read = digest(columns)
    if read != data.sha256:
        raise ResultFolderError(
            f"{place}: these measurements are not those that the fit.json beside them was made from; "
            "calibrate again, or put the files of one run together"
        )
    return columns


def _check_gaps(columns: Columns, data: DataPart) -> None:
    """Raise ValueError where a column or an impact has no measurement at all, or one has no sd that states them."""
    missing = {name: np.isnan(columns[name]) for name in data.measurements}
    for name, gaps in missing.items():
        if gaps.all():
            raise ValueError(f"{name}: not one number")
        if name in data.with_sd and np.any(np.isnan(columns[name + SD_SUFFIX]) != gaps):
            raise ValueError(f"{name}{SD_SUFFIX}: expected a number wherever {name} has one")
    if missing and np.all(list(missing.values()), axis=0).any():
        raise ValueError("an impact without a measurement")


def _labels(data: DataPart) -> list[str]:
    return [f"{_LABEL}{k}" for k in range(len(data.labels))]


def _force_columns(file: h5py.File) -> Columns:
    means = array(file, _FORCE + "means", (None, None))
    counts = {_FORCE + name: array(file, _FORCE + name, means.shape[:1], "iu") for name in COUNTS}
    return (
        counts
        | {_FORCE + name: finite(file, _FORCE + name, means.shape[:1]) for name in NUMBERS}
        | {_FORCE + "means": means}
    )


def read_data(part: TablePart, data: DataPart, place: Path) -> tuple[ImpactTable, ForceRecords | None]:
    """The table in `data.nc` that `part` and `data`, sections of `fit.json`, describe, with its force records.

    What a table says of its own reading (notices, redundant columns, units) is not kept. Raises ResultFolderError as
    `read_columns` does.
    """
    columns = read_columns(data, part.impacts, place)
    try:
        impacts = Impacts(*(columns[name] for name in INCIDENT))
    except ParameterError as error:
        raise ResultFolderError(f"{place}: damaged: {error}") from None
    table = ImpactTable(
        name=part.name,
        source=part.file,
        digest=part.sha256,
        ids=_texts(columns["impact"]),
        impacts=impacts,
        incident_columns=data.incident_columns,
        incident_sd={name: columns[name + SD_SUFFIX] for name in data.incident_sd},
        measurements=tuple(
            Measurement(name, columns[name], columns.get(name + SD_SUFFIX)) for name in data.measurements
        ),
        redundant=(),
        labels={name: _texts(columns[label]) for name, label in zip(data.labels, _labels(data), strict=True)},
        units={},
        notices=(),
        incident_covariance=columns.get(COVARIANCE),
        flipped=part.flipped,
    )
    return table, None if data.force is None else _force(data.force, columns)


def _texts(column: NDArray[Any]) -> tuple[str, ...]:
    return tuple(map(str, column))


def _force(part: ForcePart, columns: Columns) -> ForceRecords:
    records = []
    for k, means in enumerate(columns[_FORCE + "means"]):
        numbers: dict[str, Any] = {name: columns[_FORCE + name][k].item() for name in (*COUNTS, *NUMBERS)}
        records.append(Averaged(**numbers, means=tuple(means[~np.isnan(means)].tolist())))
    return ForceRecords(part.file, part.sha256, part.start_sd, tuple(records))
