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
    ".slp": _Format("of SLEAP", "sleap-io", "sleap_io.load_file(FILE).to_dataframe()"),
    ".h5": _Format("of HDF5", "h5py", "h5py.File(FILE); of DeepLabCut: pandas.read_hdf(FILE)"),
    ".nc": _Format(
        "of netCDF",
        "xarray",
        "xarray.open_dataset(FILE); of movement: save_poses.to_dlc_file of movement.io",
    ),
    ".npy": _Format("of NumPy", "numpy", "numpy.load(FILE)"),
    ".pkl": _Format("of Python", "pandas", "pandas.read_pickle(FILE), if you trust it"),
    ".feather": _Format("of Arrow", "pyarrow", "pandas.read_feather(FILE)"),
    ".rds": _Format("of R", "pyreadr", "pyreadr.read_r(FILE)[None]"),
    ".sav": _Format("of SPSS", "pyreadstat", "pandas.read_spss(FILE)"),
    ".dta": _Format("of Stata", "pandas", "pandas.read_stata(FILE)"),
    ".json": _Format("of JSON", "pandas", "pandas.read_json(FILE)"),
    ".xml": _Format("of XML", "pandas", "pandas.read_xml(FILE); of TrackMate: save spots as CSV"),
    ".numbers": _Format("of Numbers", "numbers-parser", "numbers_parser.Document(FILE)"),
    ".zip": _Format("an archive", "", ""),
    ".pdf": _Format("a page", "", ""),
}
# Other endings of these formats.
_SAME = {
    ".tiff": ".tif",
    ".hdf5": ".h5",
    ".hdf": ".h5",
    ".mp3": ".wav",
    ".png": ".tif",
    ".jpg": ".tif",
    ".jpeg": ".tif",
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
# First bytes of a file in HDF5.
HDF5 = b"\x89HDF\r\n\x1a\n"
# First bytes of formats, under whatever ending.
_MAGIC = {
    b"TDSm": ".tdms",
    b"MATLAB 5.0 MAT": ".mat",
    b"MATLAB 7.3 MAT": ".mat",
    HDF5: ".h5",
    b"CDF\1": ".nc",
    b"CDF\2": ".nc",
    b"CDF\5": ".nc",
    b"RIFF": ".wav",
    b"II*\0": ".tif",
    b"MM\0*": ".tif",
    b"\x93NUMPY": ".npy",
    b"%PDF": ".pdf",
    b"\x1f\x8b": ".zip",
    b"<?xml": ".xml",
}
# Formats of text. Of the others, what is text may be a table, such as those that Matlab saves.
_TEXTS = (".json", ".xml")
# Bytes of a file that show whether it is text.
_FIRST_BYTES = 4096
# Bytes that no text has: control characters but tabs, ends of lines and pages, and Ctrl-Z.
_CONTROLS = {*range(32)} - {*b"\t\n\r\f\x1a"}
# Share of these, but for the zeros of UTF-16, from which a file is no damaged text. Of random bytes
# a tenth are such.
_BINARY_SHARE = 0.05
# Endings of films and of projects about films, which people have beside their positions.
_FILMS = "mp4 mov avi mkv m4v wmv webm mts m2ts mpg mpeg cine gif trk trz kva 3gp flv"
# First bytes of a workbook, a zip archive or one of the older kind, and of Parquet.
_OURS = {b"PK\x03\x04": ".xlsx", b"\xd0\xcf\x11\xe0": ".xls", b"PAR1": ".parquet"}


def refuse_film(path: str) -> None:
    """Refuse a film by the ending of its name: it is not read, since it may be large.

    Raises:
        InputError: The file is a film, or a project about one (`film`).
    """
    if Path(path).suffix.lower().removeprefix(".") in _FILMS.split():
        words = "is a film, no table: open it in Tracker, Kinovea or DLTdv, and export positions"
        raise refusal(path, "film", words)


def refuse_foreign(path: str, data: bytes) -> None:
    """Refuse a file in a format of another program, by its ending or its first bytes `data`.

    Raises:
        InputError: The file is none that fitball reads (`other-format`).
    """
    suffix = Path(path).suffix.lower()
    ending = _SAME.get(suffix, suffix)
    if ending not in _TEXTS and not _CONTROLS.intersection(data[:_FIRST_BYTES]):
        ending = ""
    for magic, other in _MAGIC.items():
        # A project of SLEAP is a file in HDF5, too.
        if data.startswith(magic) and (other, ending) != (".h5", ".slp"):
            ending = other
    for magic, other in _OURS.items():
        if data.startswith(magic) and ending not in _FORMATS:
            raise _refusal(path, f"is no text, but a file {other}: rename it to that ending")
    if ending not in _FORMATS:
        first = data[:_FIRST_BYTES]
        controls = sum(byte in _CONTROLS for byte in first if byte)
        if controls > _BINARY_SHARE * len(first):
            words = "is no text: export its table as CSV from the program that wrote it"
            raise _refusal(path, words)
        return
    what, package, call = _FORMATS[ending]
    if not package:
        raise _refusal(path, f"is {what}, not a table: save its table as CSV")
    words = f"is a file {what}: read it in Python with {call} ({package})"
    raise _refusal(path, f"{words}, and pass its columns, or save them as CSV")


def _refusal(path: str, words: str) -> InputError:
    """The refusal of a file of another format."""
    return refusal(path, "other-format", words)
