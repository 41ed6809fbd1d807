"""Files of other programs, by their ending and their first bytes: named, with what reads them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from fitball.base.errors import InputError
from fitball.data.records import refusal


class _Format(NamedTuple):
    """A format: what it is, the package that reads it, and the call of it that does."""

    name: str
    package: str
    call: str


_FORMATS = {
    ".tdms": _Format("of LabVIEW", "npTDMS", "nptdms.TdmsFile.read(FILE).as_dataframe()"),
    ".mat": _Format("of Matlab", "scipy", "scipy.io.loadmat(FILE); of version 7.3: h5py"),
    ".wav": _Format("of sound", "scipy", "scipy.io.wavfile.read(FILE)"),
    ".c3d": _Format("of motion capture", "ezc3d", "ezc3d.c3d(FILE)['data']['points']"),
    ".tif": _Format("of pictures", "tifffile", "tifffile.imread(FILE)"),
    ".h5": _Format("of HDF5", "h5py", "h5py.File(FILE); of DeepLabCut: pandas.read_hdf(FILE)"),
    ".npy": _Format("of NumPy", "numpy", "numpy.load(FILE)"),
    ".pkl": _Format("of Python", "pandas", "pandas.read_pickle(FILE), if you trust it"),
    ".feather": _Format("of Arrow", "pyarrow", "pandas.read_feather(FILE)"),
    ".rds": _Format("of R", "pyreadr", "pyreadr.read_r(FILE)[None]"),
    ".sav": _Format("of SPSS", "pyreadstat", "pandas.read_spss(FILE)"),
    ".dta": _Format("of Stata", "pandas", "pandas.read_stata(FILE)"),
    ".json": _Format("of JSON", "pandas", "pandas.read_json(FILE)"),
    ".numbers": _Format("of Numbers", "numbers-parser", "numbers_parser.Document(FILE)"),
    ".zip": _Format("an archive", "", ""),
    ".pdf": _Format("a page", "", ""),
}
# Other endings of these formats.
_SAME = {
    ".tiff": ".tif",
    ".hdf5": ".h5",
    ".hdf": ".h5",
    ".npz": ".npy",
    ".pickle": ".pkl",
    ".rdata": ".rds",
    ".rda": ".rds",
    ".gz": ".zip",
    ".7z": ".zip",
    ".rar": ".zip",
    ".docx": ".pdf",
    ".doc": ".pdf",
}
# First bytes of formats, under whatever ending.
_MAGIC = {
    b"TDSm": ".tdms",
    b"MATLAB 5.0 MAT": ".mat",
    b"\x89HDF\r\n\x1a\n": ".h5",
    b"RIFF": ".wav",
    b"II*\0": ".tif",
    b"MM\0*": ".tif",
    b"\x93NUMPY": ".npy",
    b"%PDF": ".pdf",
    b"\x1f\x8b": ".zip",
}
# First bytes of a workbook, a zip archive or one of the older kind, and of Parquet.
_OURS = {b"PK\x03\x04": ".xlsx", b"\xd0\xcf\x11\xe0": ".xls", b"PAR1": ".parquet"}


def refuse_foreign(path: str, data: bytes) -> None:
    """Refuse a file in a format of another program, by its ending or its first bytes `data`.

    Raises:
        InputError: The file is none that fitball reads (`other-format`).
    """
    suffix = Path(path).suffix.lower()
    ending = _SAME.get(suffix, suffix)
    for magic, other in _MAGIC.items():
        if data.startswith(magic):
            ending = other
    for magic, other in _OURS.items():
        if data.startswith(magic) and ending not in _FORMATS:
            raise _refusal(path, f"is no text, but a file {other}: rename it to that ending")
    if ending not in _FORMATS:
        return
    what, package, call = _FORMATS[ending]
    if not package:
        raise _refusal(path, f"is {what}, not a table: save its table as CSV")
    words = f"is a file {what}: read it in Python with {call} ({package})"
    raise _refusal(path, f"{words}, and pass its columns, or save them as CSV")


def _refusal(path: str, words: str) -> InputError:
    """The refusal of a file of another format."""
    return refusal(path, "other-format", words)
