"""Positions in HDF5, as SLEAP, movement (`.nc`) and DeepLabCut write them, read to the cells of a
table.

All are read as arrays. DeepLabCut writes by pandas and PyTables, whose attributes are pickles:
names of columns are read from these without anything that a pickle could run.
"""

from __future__ import annotations

import hashlib
import io
import json
import pickle
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.base.text import listed, one_line
from fitball.base.values import FloatArray
from fitball.data import records
from fitball.data.cells import CellArray, TableCells, texts_of
from fitball.data.records import cell_text, refusal
from fitball.tracks.names import INDEX

if TYPE_CHECKING:
    from h5py import Dataset, File, Group

# Axes of the positions of SLEAP where the file does not say them, as it writes for MATLAB.
_SLEAP_AXES = ("track", "xy", "node", "frame")
# How the table of a DataFrame is called in its group.
_TABLE = "table"
# How rows of names begin in DeepLabCut, from the outer level to the inner one.
_HEADS = ("scorer", "individuals", "bodyparts")
# What damaged files raise as arrays, names or pickles.
_DAMAGED = (
    OSError,
    ValueError,
    LookupError,
    TypeError,
    RuntimeError,
    AttributeError,
    EOFError,
    pickle.PickleError,
)


class _Columns(NamedTuple):
    """Columns by name, in the order of a header."""

    names: list[str]
    columns: list[Annotated[CellArray, "rows"]]
    above: list[list[str]]


class _Clock(NamedTuple):
    """The numbers (frames,) of a clock, and the name of its column."""

    name: str
    numbers: FloatArray


def cells_of_hdf5(source: str, data: bytes) -> TableCells | None:
    """The cells of positions of SLEAP, movement or DeepLabCut, None of another file in HDF5.

    Raises:
        InputError: The file is damaged (`other-format`), too large (`too-large`), or has other
            coordinates than x, y and z (`no-positions`).
    """
    import h5py

    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            found: _Columns | None
            if "tracks" in file:
                found = _of_sleap(source, file)
            elif "position" in file:
                found = _of_movement(source, file)
            else:
                found = _of_deeplabcut(source, file)
    except _DAMAGED as error:
        words = f"is a file in HDF5 that h5py cannot read ({one_line(str(error))}); save it as CSV"
        raise refusal(source, "other-format", words) from None
    if found is None:
        return None
    rows = np.arange(len(found.columns[0])) + 1
    sha256 = hashlib.sha256(data).hexdigest()
    return TableCells(source, sha256, found.names, found.columns, rows, above=found.above)


def _of_sleap(source: str, file: File) -> _Columns:
    """The columns of an analysis file of SLEAP. Raises InputError (`too-large`)."""
    positions = _with_axes(source, file["tracks"], _SLEAP_AXES)
    count, _, nodes, frames = positions.shape
    scores = np.full((count, nodes, frames), np.nan)
    if "point_scores" in file:
        scores = _with_axes(source, file["point_scores"], ("track", "node", "frame"))
    tracks = _names(file, "track_names", count) or [f"track_{k}" for k in range(count)]
    parts = _names(file, "node_names", nodes) or [f"node_{k}" for k in range(nodes)]
    clock = _Clock("frame", np.arange(float(frames)))
    return _of_instances(clock, tracks, parts, positions, scores)


def _of_movement(source: str, file: File) -> _Columns:
    """The columns of a dataset of movement, whose time is that of frames or in seconds. Raises
    InputError (`no-positions`, `too-large`).
    """
    axes = _axes_of_scales(file["position"])
    usual = ["individuals", "space", *(["keypoints"] if "keypoints" in axes else []), "time"]
    positions = _with_axes(source, file["position"], tuple(usual), axes)
    positions = positions[:, _order_of_space(source, file, positions.shape[1])]
    usual.remove("space")
    scores = np.full([positions.shape[0], *positions.shape[2:]], np.nan)
    if "confidence" in file:
        confidence = file["confidence"]
        scores = _with_axes(source, confidence, tuple(usual), _axes_of_scales(confidence))
    if "keypoints" not in axes:
        # Boxes are of one part.
        positions = positions[:, :, None]
        scores = scores[:, None]
    count, _, nodes, _ = positions.shape
    parts = _names(file, "keypoints", nodes) if "keypoints" in axes else ["centre"]
    tracks = _names(file, "individuals", count)
    is_counted = _text(file.attrs.get("time_unit", "")) == "frames"
    name = "frame" if is_counted else "t [s]"
    clock = _Clock(name, np.asarray(_values(source, file["time"]), dtype=np.float64))
    return _of_instances(clock, tracks, parts, positions, scores)


def _order_of_space(source: str, file: File, count: int) -> list[int]:
    """The places of x, y and z among the coordinates of a dataset of movement. Raises InputError
    (`no-positions`) for others, such as polar ones.
    """
    names = _names(file, "space", count) or [*"xyz"[:count]]
    if {*names} != {*"xyz"[:count]}:
        words = f"positions have the coordinates {listed(names)}; expected x and y"
        raise refusal(source, "no-positions", words)
    return [names.index(axis) for axis in "xyz"[:count]]


def _axes_of_scales(dataset: Dataset) -> tuple[str, ...]:
    """The names of the axes of a dataset of netCDF, as those of its scales."""
    return tuple(axis[0].name.rpartition("/")[2] for axis in dataset.dims)


def _of_instances(
    clock: _Clock,
    tracks: Sequence[str],
    parts: Sequence[str],
    positions: Annotated[FloatArray, "tracks axes parts frames"],
    scores: Annotated[FloatArray, "tracks parts frames"],
) -> _Columns:
    """The columns of a clock, `track`, and `PART.x`, `PART.y`, `PART.score` of each part, with
    `PART.z` where there are three axes; frames of a track that show nothing are left out.
    """
    names = [clock.name, "track"]
    for part in parts:
        names += [*(f"{part}.{axis}" for axis in "xyz"[: positions.shape[1]]), f"{part}.score"]
    columns: list[list[CellArray]] = [[] for _ in names]
    for k, track in enumerate(tracks):
        seen = np.flatnonzero(np.isfinite(positions[k]).any(axis=(0, 1)))
        of_track: list[CellArray] = [clock.numbers[seen], texts_of([track] * seen.size)]
        for number in range(len(parts)):
            of_track += [*positions[k, :, number, seen].T, scores[k, number, seen]]
        for column, piece in zip(columns, of_track, strict=True):
            column.append(piece)
    return _Columns(names, [np.concatenate(pieces) for pieces in columns], [])


def _with_axes(
    source: str,
    dataset: Dataset,
    usual: tuple[str, ...],
    axes: tuple[str, ...] = (),
) -> FloatArray:
    """The numbers of a dataset, its axes in the usual order: they are `axes`, or as it states.
    Raises InputError (`too-large`).
    """
    stated = dataset.attrs.get("dims")
    axes = axes or (usual if stated is None else tuple(json.loads(stated)))
    numbers_of = np.asarray(_values(source, dataset), dtype=np.float64)
    return np.transpose(numbers_of, [axes.index(axis) for axis in usual])


def _values(source: str, dataset: Dataset) -> NDArray[Any]:
    """The values of a dataset, unless they are too many. Raises InputError (`too-large`)."""
    if dataset.nbytes > records.MOST_BYTES:
        most = f"{records.MOST_BYTES / 1e6:.0f} MB"
        raise records.too_large(source, "an array of a larger size", most)
    return np.asarray(dataset[()])


def _names(file: File, dataset: str, count: int) -> list[str]:
    """The names of a dataset, empty where there are not as many as expected."""
    names = [_text(name) for name in file[dataset][()]] if dataset in file else []
    return names if len(names) == count else []


def _text(value: Any) -> str:
    """A text of HDF5, which may be bytes."""
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _of_deeplabcut(source: str, file: File) -> _Columns | None:
    """The columns of a DataFrame that pandas wrote, with its levels of names; None where the file
    has none.
    """
    for group in file.values():
        kind = _text(getattr(group, "attrs", {}).get("pandas_type", ""))
        if kind == "frame_table":
            return _of_table(source, group)
        if kind == "frame":
            return _of_blocks(source, group)
    return None


def _of_table(source: str, group: Group) -> _Columns:
    """The columns of a DataFrame that is one table of PyTables."""
    table = group[_TABLE]
    rows = _values(source, table)
    index, *blocks = rows.dtype.names or ()
    levels = list[Any]()
    columns = list[CellArray]()
    for name in blocks:
        levels += _pickled(table.attrs[f"{name}_kind"])
        block = rows[name].reshape(len(rows), -1)
        columns += [_array(block[:, k]) for k in range(block.shape[1])]
    return _with_levels([_array(rows[index])], levels, columns)


def _of_blocks(source: str, group: Group) -> _Columns:
    """The columns of a DataFrame in blocks of equal types."""
    levels = list[Any]()
    columns = list[CellArray]()
    for number in range(int(group.attrs["nblocks"])):
        items = f"block{number}_items"
        count = int(group.attrs.get(f"{items}_nlevels", 1))
        labels = [_level(group, items, level, count) for level in range(count)]
        values = group[f"block{number}_values"]
        block = _values(source, values)
        levels += zip(*labels, strict=True)
        columns += [_array(block[:, k]) for k in range(block.shape[1])]
    # An index of several levels, as of labelled pictures, is written as names of columns are.
    count = int(group.attrs.get("axis1_nlevels", 1))
    index = [texts_of(_level(group, "axis1", level, count)) for level in range(count)]
    if count == 1:
        index = [_array(group["axis1"][()])]
    return _with_levels(index, levels, columns)


def _level(group: Group, items: str, level: int, count: int) -> list[str]:
    """The names of columns, or of rows, in a level."""
    if count == 1:
        return [_text(name) for name in group[items][()]]
    names = [_text(name) for name in group[f"{items}_level{level}"][()]]
    return [names[label] for label in group[f"{items}_label{level}"][()]]


def _with_levels(
    index: list[CellArray],
    levels: Sequence[Sequence[Any]],
    columns: list[CellArray],
) -> _Columns:
    """The columns of a DataFrame behind those of its index; several levels of names stand above
    each other as in a table of DeepLabCut.
    """
    *above, names = (
        [*map(cell_text, level)] for level in zip(*map(_as_tuple, levels), strict=True)
    )
    others = [f"{INDEX} {k}" for k in range(2, len(index) + 1)]
    if not above:
        return _Columns([INDEX, *others, *names], [*index, *columns], [])
    heads = _HEADS if len(above) == len(_HEADS) else (_HEADS[0], _HEADS[-1])
    blank = [""] * len(others)
    of_levels = zip(heads[-len(above) :], above, strict=True)
    rows_above = [[head, *blank, *row] for head, row in of_levels]
    return _Columns(["coords", *others, *names], [*index, *columns], rows_above)


def _as_tuple(name: Any) -> Sequence[Any]:
    """The levels of the name of a column."""
    return name if isinstance(name, tuple | list) else (name,)


def _array(values: NDArray[Any]) -> CellArray:
    """Values (rows,) as numbers, or as texts."""
    if values.dtype.kind in "iufb":
        return values.astype(np.float64)
    return texts_of([cell_text(_text(value)) for value in values.tolist()])


class _Harmless(pickle.Unpickler):
    """Reads pickles of texts, numbers, lists and tuples."""

    def find_class(self, module: str, name: str) -> Any:
        """Nothing: what a pickle names is code. Raises UnpicklingError."""
        raise pickle.UnpicklingError(f"a pickle names {module}.{name}")


def _pickled(attribute: bytes) -> list[Any]:
    """The list in an attribute of PyTables. Raises UnpicklingError for anything that could run."""
    value = _Harmless(io.BytesIO(bytes(attribute)), encoding="utf-8").load()
    if not isinstance(value, list):
        raise pickle.UnpicklingError("an attribute has no list of names")
    return value
