"""Positions in HDF5 files: in any group, datasets `positions` (frames, 2 or 3) and `time_stamps` (frames,), or `x`,
`y` and perhaps `z`, `t`, `frame`, `radius`, each (frames,). Lengths are in metres unless the attribute `unit` of a
dataset says otherwise, times in seconds.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fitball.data.cells import refusal
from fitball.data.header import bare
from fitball.data.units import Dimension, Unit, parse_unit
from fitball.errors import UnitError
from fitball.tracks.clips import PIXELS, Clip, Reading
from fitball.values import FloatArray

SUFFIXES = (".hdf5", ".h5", ".hdf", ".mat")
_NAMES = {
    "positions": "position", "position": "position", "xyz": "position", "xy": "position", "timestamps": "t",
    "timestamp": "t", "time": "t", "times": "t", "t": "t", "x": "x", "y": "y", "z": "z", "frame": "frame",
    "frames": "frame", "radius": "radius", "angle": "angle",
}  # fmt: skip
_METRES = parse_unit("m", Dimension.LENGTH)
_MOST_BYTES = 1e9
# What the HDF5 library raises at damaged bytes.
_FAULTS = (OSError, LookupError, ValueError, TypeError, RuntimeError, AttributeError, MemoryError)


def hdf5_clips(path: Path, how: Reading) -> list[Clip]:
    """The clips of an HDF5 file, one for each group with positions. Raises TableError for other files."""
    source = str(path)
    try:
        with h5py.File(path, "r") as file:
            groups: list[h5py.Group] = [file]
            file.visititems(lambda _name, item: groups.append(item) if isinstance(item, h5py.Group) else None)
            clips = [clip for group in groups for clip in _clip_of(group, source, path.stem, how)]
    except UnitError as error:
        raise refusal(source, str(error)) from None
    except _FAULTS as error:
        raise refusal(source, f"not an HDF5 file of positions, or damaged: {str(error)[:200]}") from None
    if not clips:
        raise refusal(
            source,
            "no group has positions; expected datasets positions (frames x 2 or 3) and time_stamps, or t, x, y, z",
        )
    return sorted(clips, key=lambda clip: [int(part) if part.isdigit() else part for part in _pieces(clip.id)])


def _pieces(name: str) -> list[str]:
    # Texts and numbers alternate, so that they compare.
    return re.split(r"(\d+)", name)


def _clip_of(group: h5py.Group, source: str, stem: str, how: Reading) -> list[Clip]:
    """The clip of a group, if it has one."""
    sets = {
        _NAMES[bare(name)]: item
        for name, item in group.items()
        if isinstance(item, h5py.Dataset) and bare(name) in _NAMES
    }
    axes = [name for name in "xyz" if name in sets]
    if "position" not in sets and axes[:2] != ["x", "y"]:
        return []
    # A damaged length must not fill the memory.
    if sum(item.nbytes for item in sets.values()) > _MOST_BYTES:
        raise refusal(source, f"{group.name}: more than {_MOST_BYTES / 1e9:g} GB; expected the positions of a clip")
    arrays: dict[str, FloatArray] = {name: np.asarray(item[()], dtype=np.float64) for name, item in sets.items()}
    position = arrays["position"] if "position" in arrays else np.stack([np.ravel(arrays[name]) for name in axes], 1)
    where = group.name
    if position.ndim != 2 or position.shape[1] not in (2, 3):
        raise refusal(source, f"{where}: positions have shape {position.shape}; expected frames x 2 or 3")
    count = len(position)
    rest = {name: np.ravel(values) for name, values in arrays.items() if name not in ("position", *axes)}
    for name, values in rest.items():
        if len(values) != count:
            raise refusal(
                source, f"{where}: {len(values)} entries of {name}, but {count} positions; expected as many"
            )
    unit = _unit(sets.get("position", sets.get("x")), how)
    frame = np.round(rest["frame"]).astype(np.int64) if "frame" in rest else np.arange(1, count + 1)
    time, radius = rest.get("t"), rest.get("radius")
    seen: NDArray[np.bool_] = np.asarray(np.isfinite(position).all(axis=1))
    seen = seen if time is None else seen & np.isfinite(time)
    if time is not None and np.any(np.diff(time[seen]) <= 0.0):
        k = int(np.argmax(np.diff(time[seen]) <= 0.0))
        raise refusal(
            source, f"{where}: time {time[seen][k + 1]:g} s follows {time[seen][k]:g} s; expected increasing times"
        )
    name = where.strip("/").rpartition("/")[2] or stem
    clip = Clip(
        name, "", source, frame, np.arange(1, count + 1), unit.to_si(position), unit,
        time=time, radius=None if radius is None else unit.to_si(radius), angle=rest.get("angle"),
    )  # fmt: skip
    return [clip.take(seen)] if seen.any() else []


def _unit(dataset: Any, how: Reading) -> Unit:
    said = dataset.attrs.get("unit", dataset.attrs.get("units", how.unit))
    text = said.decode() if isinstance(said, bytes) else said
    if text is not None and str(text).casefold() in ("px", "pixel", "pixels"):
        return PIXELS
    return _METRES if text is None else parse_unit(str(text), Dimension.LENGTH)
