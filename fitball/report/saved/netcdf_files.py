"""The netCDF-4 files of a result folder, written variable by variable: xarray would copy them all first, and takes
half a second to load.

`data.nc` holds the measurements that a fit was made from, one variable per column, and `fit.json` their digest;
`posterior.nc` draws, diagnostics and data in the layout ArviZ reads.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import BALL_TEMPERATURE, SD_SUFFIX
from fitball.data.hdf5_arrays import array, finite, group, opened, texts
from fitball.data.table import Covariance, ImpactTable, Measurement
from fitball.errors import ResultFolderError
from fitball.inference.problem.force_records import ForceRecords
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Fit, Posterior
from fitball.inference.results.source import (
    COUNTS,
    COVARIANCE,
    FORCE,
    INCIDENT,
    LABEL,
    NUMBERS,
    ROW_COVARIANCE,
    Source,
    data_columns,
    digest,
)
from fitball.observables import SI_UNITS
from fitball.report.form.files import write_bytes
from fitball.report.form.numbers import listed_places
from fitball.values import FloatArray, Impacts
from fitball.version import __version__
from fitball.wording import spoken

DATA_NAME, POSTERIOR_NAME = "data.nc", "posterior.nc"
KIND = "fitball data"
CHAINS = ("chain", "draw")


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


def write_data(problem: Problem, path: Path) -> None:
    """Write `data.nc`, whole or not at all. Raises ResultFolderError."""
    names = {f"{LABEL}{k}": name for k, name in enumerate(problem.table.labels)}
    variables = []
    for name, column in data_columns(problem.table, problem.force).items():
        dims = ("record", "node") if name.startswith(FORCE) else ("impact", "state", "other_state")
        dims = ("impact", "column", "other_column") if name == ROW_COVARIANCE else dims
        told = {"units": SI_UNITS.get(name.removesuffix(SD_SUFFIX), ""), "long_name": names.get(name, "")}
        known = {key: word for key, word in told.items() if word}
        variables.append(Variable(name, dims[: column.ndim], column, known))
    write_groups(path, {"": variables}, kind=KIND)


def read_columns(source: Source, place: Path) -> dict[str, NDArray[Any]]:
    """The columns of `data.nc` at `place` that `source` names.

    Raises ResultFolderError for a file that is missing, damaged, or not the data of that fit.
    """
    sds = [name + SD_SUFFIX for name in source.with_sd]
    exact = (*INCIDENT, *(name + SD_SUFFIX for name in source.incident_sd))
    with opened(place, "the measurements that belong to the fit.json beside it") as file:
        columns = {
            name: texts(file, name, source.impacts)
            for name in ("impact", *(f"{LABEL}{k}" for k in range(len(source.labels))))
        }
        columns |= {name: finite(file, name, (source.impacts,)) for name in exact}
        columns |= {name: finite(file, name, (source.impacts,), gaps=True) for name in (*source.measurements, *sds)}
        if source.circumstances.ball_temperature is not None:
            columns[BALL_TEMPERATURE] = finite(file, BALL_TEMPERATURE, (source.impacts,), gaps=True)
        if source.incident_sd:
            columns[COVARIANCE] = finite(file, COVARIANCE, (source.impacts, 3, 3))
        if source.covariance:
            width = len(INCIDENT) + len(source.measurements)
            columns[ROW_COVARIANCE] = finite(file, ROW_COVARIANCE, (source.impacts, width, width))
        if source.force is not None:
            means = array(file, FORCE + "means", (None, None))
            columns |= {FORCE + name: array(file, FORCE + name, means.shape[:1], "iu") for name in COUNTS}
            columns |= {FORCE + name: finite(file, FORCE + name, means.shape[:1]) for name in NUMBERS}
            columns[FORCE + "means"] = means
        read = digest(columns)
    if read != source.digest:
        raise ResultFolderError(
            f"{place}: these measurements are not those of the fit.json beside them; "
            "calibrate again, or put the files of one run together"
        )
    return columns


def read_data(source: Source, place: Path) -> tuple[ImpactTable, ForceRecords | None]:
    """The table in `data.nc` that `source` describes, with its force records.

    What a table says of its own reading (notices, redundant columns, units) is not kept. Raises ResultFolderError as
    `read_columns` does.
    """
    columns = read_columns(source, place)
    impacts = Impacts(*(columns[name] for name in INCIDENT))
    table = ImpactTable(
        name=source.name,
        source=source.file,
        digest=source.sha256,
        ids=_texts(columns["impact"]),
        impacts=impacts,
        incident_columns=source.incident_columns,
        incident_sd={name: columns[name + SD_SUFFIX] for name in source.incident_sd},
        measurements=tuple(
            Measurement(name, columns[name], columns.get(name + SD_SUFFIX)) for name in source.measurements
        ),
        redundant=(),
        labels={name: _texts(columns[f"{LABEL}{k}"]) for k, name in enumerate(source.labels)},
        units={},
        notices=(),
        incident_covariance=columns.get(COVARIANCE),
        covariance=(
            Covariance((*INCIDENT, *source.measurements), columns[ROW_COVARIANCE]) if source.covariance else None
        ),
        flipped=source.flipped,
        ignored=source.ignored,
        ball_temperature=columns.get(BALL_TEMPERATURE),
    )
    if source.force is None:
        return table, None
    numbers = {name: columns[FORCE + name] for name in (*COUNTS[1:], *NUMBERS)}
    force, rows, means = source.force, columns[FORCE + "row"], columns[FORCE + "means"]
    return table, ForceRecords(force.file, force.sha256, force.start_sd, rows=rows, measured=means, **numbers)


def _texts(column: NDArray[Any]) -> tuple[str, ...]:
    return tuple(map(str, column))


def variable(name: str) -> str:
    """The variable of a parameter: a slash, which a user's label may bring into its name, would open a group."""
    return name.replace("/", "\u2215")


def write_netcdf(fit: Fit, posterior: Posterior, path: Path) -> None:
    """Write groups posterior and sample_stats (chain = walker of an ensemble, draw = step), prior (all that was
    known before the table) and observed_data. Raises ResultFolderError.
    """
    values, names, table = posterior.values, posterior.names, fit.problem.table
    ensembles, steps, walkers, _ = values.shape
    places = listed_places(len(table))

    def chains(column: FloatArray) -> FloatArray:
        """(ensembles, steps, walkers) as (chains, draws)."""
        return column.transpose(0, 2, 1).reshape(ensembles * walkers, steps)

    def axes(count: int, draws: int) -> Iterator[Variable]:
        yield Variable("chain", ("chain",), np.arange(count))
        yield Variable("draw", ("draw",), np.arange(draws))

    def drawn() -> Iterator[Variable]:
        yield from axes(ensembles * walkers, steps)
        yield Variable("ensemble", ("chain",), np.repeat(np.arange(ensembles), walkers))
        for k, name in enumerate(names):
            told = {"units": fit.parameters[name].unit, "coordinates": "ensemble"}
            yield Variable(variable(name), CHAINS, chains(values[..., k]), told)

    def known() -> Iterator[Variable]:
        yield from axes(1, len(posterior.prior_draws))
        for k, name in enumerate(names):
            yield Variable(variable(name), CHAINS, posterior.prior_draws[None, :, k])

    def observed() -> Iterator[Variable]:
        yield Variable("impact", ("impact",), np.array([table.ids[k] for k in places], dtype=object))
        for it in fit.problem.observables:
            yield Variable(it.name, ("impact",), it.everywhere(len(table)).observed[places])

    scores = [Variable("lp", CHAINS, chains(posterior.log_posterior))]
    groups = {"posterior": drawn(), "sample_stats": scores, "prior": known(), "observed_data": observed()}
    write_groups(path, groups, model=fit.problem.model.name)


def read_draws(path: Path, names: Sequence[str], shape: tuple[int, int, int]) -> Posterior:
    """The draws of `names` that `write_netcdf` wrote, of `shape` (ensembles, steps, walkers).

    Raises ResultFolderError for a file that is missing, damaged or foreign, or of another shape.
    """
    ensembles, steps, walkers = shape
    chains = (ensembles * walkers, steps)
    what = (
        f"the posterior draws of the fit.json beside it (batch saves them with {spoken('--all-files', 'full=True')})"
    )
    with opened(path, what) as file:
        posterior, known = group(file, "posterior"), group(file, "prior")
        owner = array(posterior, "ensemble", chains[:1], "iu")
        if not np.array_equal(owner, np.repeat(np.arange(ensembles), walkers)):
            raise ValueError(f"/posterior/ensemble: expected {walkers} chains of each of {ensembles} ensembles")
        draws = np.stack([finite(posterior, variable(name), chains) for name in names], axis=-1)
        scores = finite(group(file, "sample_stats"), "lp", chains)
        reference = np.stack([finite(known, variable(name), (1, None))[0] for name in names], axis=-1)
    return Posterior(
        tuple(names),
        np.ascontiguousarray(draws.reshape(ensembles, walkers, steps, -1).transpose(0, 2, 1, 3)),
        np.ascontiguousarray(scores.reshape(ensembles, walkers, steps).transpose(0, 2, 1)),
        reference,
    )
