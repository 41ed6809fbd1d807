"""Arrays from HDF5 files that anyone may have damaged: by shape, type and finiteness, or an error that says what is
wrong.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fitball.errors import ResultFolderError
from fitball.values import FloatArray

# What the HDF5 library raises at damaged bytes.
_FAULTS = (OSError, LookupError, ValueError, TypeError, RuntimeError, AttributeError, MemoryError)


@contextmanager
def opened(path: Path, what: str) -> Iterator[h5py.File]:
    """The file, which should be `what`. Raises ResultFolderError for what is missing, damaged or foreign in it."""
    try:
        if not path.is_file():
            missing = "not a file" if path.exists() else "no such file"
            raise ResultFolderError(f"{path}: {missing}; expected {what}; run calibrate again")
        with h5py.File(path, "r") as file:
            yield file
    except _FAULTS as error:
        raise ResultFolderError(f"{path}: not {what}, or damaged: {str(error)[:300]}; run calibrate again") from None


def group(parent: h5py.Group, name: str) -> h5py.Group:
    """A group in another. Raises ValueError."""
    member = parent.get(name)
    if not isinstance(member, h5py.Group):
        raise ValueError(f"no group {name}")  # noqa: TRY004
    return member


def array(parent: h5py.Group, name: str, shape: tuple[int | None, ...], kind: str = "f") -> np.ndarray[Any, Any]:
    """A dataset of that shape (None: any length) and kind of number ("f", or "iu"). Raises ValueError."""
    member = parent.get(name)
    where = f"{parent.name.rstrip('/')}/{name}"
    if not isinstance(member, h5py.Dataset):
        raise ValueError(f"no array {where}")  # noqa: TRY004
    fits = len(member.shape) == len(shape) and all(b in (a, None) for a, b in zip(member.shape, shape, strict=True))
    if member.dtype.kind not in kind or not fits:
        wanted = " x ".join("any" if count is None else str(count) for count in shape)
        raise ValueError(
            f"{where}: read {member.dtype} of shape {' x '.join(map(str, member.shape))}, expected "
            f"{'floating-point' if kind == 'f' else 'whole'} numbers of shape {wanted}"
        )
    # Nothing here is compressed: a length that was damaged must not fill the memory.
    if member.nbytes > Path(parent.file.filename).stat().st_size:
        raise ValueError(f"{where}: {member.size} numbers, more than the file has room for")
    return np.asarray(member[()])


def texts(parent: h5py.Group, name: str, count: int) -> np.ndarray[Any, Any]:
    """A column of `count` texts. Raises ValueError."""
    column = array(parent, name, (count,), "O")
    if not all(isinstance(item, bytes) for item in column):
        raise ValueError(f"{parent.name.rstrip('/')}/{name}: not a column of texts")
    return np.array([item.decode("utf-8") for item in column], dtype=object)


def finite(parent: h5py.Group, name: str, shape: tuple[int | None, ...], *, gaps: bool = False) -> FloatArray:
    """As `array`, of finite double-precision numbers, or with `gaps` NaN for some of them. Raises ValueError."""
    numbers = array(parent, name, shape).astype(np.float64)
    bad = np.argwhere(~np.isfinite(numbers) & ~(gaps & np.isnan(numbers)))
    if bad.size:
        raise ValueError(f"{parent.name.rstrip('/')}/{name}: entry {bad[0].tolist()} is not a finite number")
    return numbers
