"""What a fit was made from: the measurements as columns in SI, and their summary in its record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from fitball.data.columns import BALL_TEMPERATURE, SD_SUFFIX
from fitball.data.labels import Role, role_of
from fitball.data.scene import Scene
from fitball.data.table import FrozenMapping, ImpactTable
from fitball.inference.problem.force_records import ForceRecords
from fitball.inference.problem.problem import Problem

# What numbers and texts of a file are held to when it is read.
Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Counted = Annotated[int, Meta(ge=1)]
Whole = Annotated[int, Meta(ge=0)]
Digest = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]

INCIDENT = ("v_x1", "v_y1", "omega_1")
IncidentName = Literal["v_x1", "v_y1", "omega_1"]
# What is kept of each force record besides its means, as numbers of one kind each.
COUNTS = ("row", "block", "samples")
NUMBERS = ("first", "spacing", "begin", "length", "peak", "centroid")
FORCE = "force_"
# Label columns are numbered, because a user may have named one anything; `Source` holds their names.
LABEL = "label_"
# The covariance of the incident state, and that of whole rows.
COVARIANCE, ROW_COVARIANCE = "incident_covariance", "covariance"
Columns = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class ForceSource:
    """Force-time records as the likelihood took them; `start_sd` is how well t = 0 is known to be the start of
    contact.
    """

    file: str
    sha256: Digest
    start_sd: Positive | None


@dataclass(frozen=True)
class Circumstances:
    """Where, when and by whom a table was measured, as its scene says; None where it does not. `ball_temperature` is
    the lowest and the highest of the table's own column, `stated_temperature` that of the scene [degrees Celsius].
    """

    laboratory: str | None = None
    operator: str | None = None
    instrument: str | None = None
    date: str | None = None
    court: str | None = None
    surface: str | None = None
    ball_temperature: tuple[float, float] | None = None
    stated_temperature: float | None = None


@dataclass(frozen=True)
class Source:
    """The table of a fit: its file with digest, names of incident and of measured columns, of those with a stated sd,
    of label columns, `contact_time` (value, sd) as known to the scene. `flipped` are columns that were counted the
    other way round on request, `ignored` those that were left out, `columns` those that were named, by our names;
    `covariance` says whether errors of a row belong together. `digest` is the SHA-256 over all measurements, force
    records among them.
    """

    name: str
    file: str
    sha256: Digest
    impacts: Annotated[int, Meta(ge=2)]
    flipped: tuple[str, ...]
    incident_columns: tuple[IncidentName, ...]
    incident_sd: tuple[IncidentName, ...]
    measurements: tuple[str, ...]
    with_sd: tuple[str, ...]
    labels: tuple[str, ...]
    contact_time: tuple[Positive, Positive] | None
    digest: Digest
    force: ForceSource | None = None
    columns: Mapping[str, str] = field(default_factory=FrozenMapping)
    ignored: tuple[str, ...] = ()
    covariance: bool = False
    circumstances: Circumstances = field(default_factory=Circumstances)


def source_of(problem: Problem) -> Source:
    """The measurements in the record of a fit."""
    table, force = problem.table, problem.force
    return Source(
        name=table.name,
        file=Path(table.source).name,
        sha256=table.digest,
        impacts=len(table),
        flipped=table.flipped,
        incident_columns=table.incident_columns,  # type: ignore[arg-type]
        incident_sd=tuple(table.incident_sd),  # type: ignore[arg-type]
        measurements=tuple(measurement.name for measurement in table.measurements),
        with_sd=tuple(measurement.name for measurement in table.measurements if measurement.sd is not None),
        labels=tuple(table.labels),
        contact_time=problem.contact_time,
        digest=digest(data_columns(table, force)),
        force=None if force is None else ForceSource(Path(force.source).name, force.digest, force.start_sd),
        columns=dict(table.columns),
        ignored=table.ignored,
        covariance=table.covariance is not None,
        circumstances=_circumstances(table, problem.scene),
    )


def _circumstances(table: ImpactTable, scene: Scene) -> Circumstances:
    warmth = table.ball_temperature
    names = ("laboratory", "operator", "instrument", "date", "court")
    surfaces = [cells for name, cells in table.labels.items() if role_of(name) is Role.SURFACE]
    one = {cells[0] for cells in surfaces if len({*cells}) == 1}
    return Circumstances(
        **{name: getattr(scene, name) for name in names},
        surface=scene.surface or (one.pop() if len(one) == 1 else "") or None,
        ball_temperature=None if warmth is None else (float(np.nanmin(warmth)), float(np.nanmax(warmth))),
        stated_temperature=scene.ball_temperature,
    )


def data_columns(table: ImpactTable, force: ForceRecords | None) -> dict[str, NDArray[Any]]:
    """Every measurement by the name of its column, in SI: texts as objects, numbers as float64 or int64."""
    columns: dict[str, NDArray[Any]] = {"impact": np.array(table.ids, dtype=object)}
    columns |= {name: getattr(table.impacts, name) for name in INCIDENT}
    for measurement in table.measurements:
        columns[measurement.name] = measurement.values
        if measurement.sd is not None:
            columns[measurement.name + SD_SUFFIX] = measurement.sd
    columns |= {name + SD_SUFFIX: sd for name, sd in table.incident_sd.items()}
    if table.incident_covariance is not None:
        columns[COVARIANCE] = table.incident_covariance
    if table.covariance is not None:
        columns[ROW_COVARIANCE] = table.covariance.values
    if table.ball_temperature is not None:
        columns[BALL_TEMPERATURE] = table.ball_temperature
    columns |= {f"{LABEL}{k}": np.array(column, dtype=object) for k, column in enumerate(table.labels.values())}
    if force is not None:
        columns[FORCE + "row"] = force.rows
        columns |= {FORCE + name: getattr(force, name) for name in (*COUNTS[1:], *NUMBERS)}
        columns[FORCE + "means"] = force.measured
    return columns


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
