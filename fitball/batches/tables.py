"""Tables and folders named, names safe on every file system.

A table is called after its file, as its folder and its row are. Where several would be called the
same, whatever the case, these have the path below their common folder, then the ending too; one
that still is not alone gets a digest.
"""

from __future__ import annotations

import glob
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from pathlib import Path

from fitball.base.errors import ParameterError
from fitball.base.text import listed
from fitball.data.sources import PARQUET, file_and_sheet
from fitball.data.table import ImpactTable
from fitball.data.workbooks import WORKBOOKS

# Endings of tables in a folder; what `*` matches besides, scenes and notes, is none.
ENDINGS = (".csv", ".tsv", ".txt", *WORKBOOKS, *PARQUET)
# What Windows keeps for devices (learn.microsoft.com: Naming Files, Paths, and Namespaces).
_DEVICE = re.compile(r"con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³]", re.IGNORECASE)
# Bytes of a name that every file system takes, with what is put beside it for a moment.
_MOST_BYTES = 100
# Letters of a digest, enough for any folder of tables.
_LETTERS_OF_DIGEST = 8


def tables_by_name(data: object, out: Path) -> dict[str, object]:
    """Tables by safe names: those of a mapping by its keys; paths, folders, patterns
    (`courts/*.csv`, `**`), bundled tables and frames by the names of their files. What lies in
    `out` is none of them.

    Raises:
        ParameterError: there is no table (`no-tables`).
    """
    if isinstance(data, Mapping):
        forms: dict[str, tuple[str, ...]] = {str(name): (str(name),) for name in data}
        sources = dict(zip(forms, data.values(), strict=True))
    else:
        entries = data if isinstance(data, list | tuple | Iterator) else [data]
        expanded = [source for entry in entries for source in _expanded(entry, out)]
        sources = {_key(k, source): source for k, source in enumerate(expanded)}
        forms = _forms(sources)
    if not sources:
        raise ParameterError(
            "batch: no table was given; expected files, folders or patterns",
            "no-tables",
        )
    return {name: sources[key] for key, name in _unique_names(forms).items()}


def scenes_of_folders(data: object) -> dict[Path, Path]:
    """By folder of tables among `data` the scene file that counts for all tables of it which have
    none of their own name.

    Raises:
        ParameterError: a folder has several such files (`several-scenes`).
    """
    scenes = dict[Path, Path]()
    entries = data if isinstance(data, list | tuple) else [data]
    for entry in entries:
        if not isinstance(entry, str | os.PathLike) or not os.path.isdir(entry):  # noqa: PTH112
            continue
        folder = Path(entry).absolute()
        files = sorted(folder.iterdir())
        stems = {file.stem for file in files if file.suffix.lower() in ENDINGS}
        of_all = [file for file in files if file.suffix == ".toml" and file.stem not in stems]
        if len(of_all) > 1:
            named = listed(file.name for file in of_all)
            words = f"{named} are called as no table of {folder}: keep one, the scene of them all"
            raise ParameterError(f"batch: {words}", "several-scenes")
        if of_all:
            scenes[folder] = of_all[0]
    return scenes


def _key(number: int, source: object) -> str:
    """The key of a source, a file's path, else its number: `a.csv` and `./a.csv` are the same
    table.
    """
    return os.path.abspath(source) if isinstance(source, str) else f"{number}"  # noqa: PTH100


def _expanded(entry: object, out: Path) -> Iterator[object]:
    """The tables of a folder or a pattern, sorted; others as they are."""
    if not isinstance(entry, str | os.PathLike):
        yield entry
        return
    text = os.fspath(entry)
    # Unlike those of Path, these answer for a name too long for the system.
    folder = os.path.isdir(text)  # noqa: PTH112
    if not folder and (os.path.exists(text) or not glob.has_magic(text)):  # noqa: PTH110
        # One that is not there is a failed row, not the end of all others.
        yield text
        return
    pattern = os.path.join(glob.escape(text), "*") if folder else text  # noqa: PTH118
    paths = [Path(name) for name in sorted(glob.glob(pattern, recursive=True))]  # noqa: PTH207
    tables = [path for path in paths if path.suffix.lower() in ENDINGS and path.is_file()]
    outside = [path for path in tables if not path.absolute().is_relative_to(out.absolute())]
    if not outside:
        raise ParameterError(
            f"{text}: no table there; names of tables end with {', '.join(ENDINGS)}",
            "no-tables",
        )
    yield from map(str, outside)


def _forms(sources: Mapping[str, object]) -> dict[str, tuple[str, ...]]:
    """What each source could be called, the shortest first."""
    files = [file_and_sheet(key)[0] for key, source in sources.items() if isinstance(source, str)]
    folders = [os.path.dirname(file) for file in files]  # noqa: PTH120
    common = os.path.commonpath(folders) if folders else ""
    forms = dict[str, tuple[str, ...]]()
    for key, source in sources.items():
        if isinstance(source, str):
            forms[key] = _forms_of_file(key, common)
        else:
            name = _name_of(source)
            forms[key] = (name, f"{name}-{int(key) + 1}")
    return forms


def _forms_of_file(key: str, common: str) -> tuple[str, ...]:
    """A file is called by its stem, its path below the `common` folder, that with the ending."""
    path, sheet = file_and_sheet(key)
    file = Path(path)
    below = "-".join(file.relative_to(common).parts)
    names = (file.stem, below.removesuffix(file.suffix), below)
    return tuple(f"{name}-{sheet}" for name in names) if sheet else names


def _name_of(source: object) -> str:
    """The name of a table or frame in memory."""
    if isinstance(source, ImpactTable):
        return source.name
    return str(getattr(source, "attrs", {}).get("name", "table"))


def _unique_names(forms: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """A safe name for each key, no two the same on any file system."""
    names = dict[str, str]()
    rest = dict(forms)
    for step in range(1 + max(map(len, forms.values()))):
        tried = {key: _name_at_step(key, choices, step) for key, choices in rest.items()}
        count = Counter(map(_folded_name, [*tried.values(), *names.values()]))
        names |= {key: name for key, name in tried.items() if count[_folded_name(name)] == 1}
        rest = {key: choices for key, choices in rest.items() if key not in names}
        if not rest:
            break
    return {key: names[key] for key in forms}


def _name_at_step(key: str, choices: Sequence[str], step: int) -> str:
    """The name that is tried in this step; after all choices the last one with a digest."""
    if step < len(choices):
        return safe_name(choices[step])
    digest = sha256(key.encode()).hexdigest()[:_LETTERS_OF_DIGEST]
    return f"{safe_name(choices[-1])}-{digest}"


def safe_name(name: str) -> str:
    """A name that a folder can have on every file system: letters, digits, blanks and `_+=-()` of
    any script.
    """
    composed = unicodedata.normalize("NFC", name)
    letters = re.sub(r"[^\w +=()-]", "_", composed).strip()
    short = letters.encode()[:_MOST_BYTES].decode(errors="ignore").strip() or "table"
    return f"{short}_" if _DEVICE.fullmatch(short) else short


def _folded_name(name: str) -> str:
    """A name as file systems compare it that ignore case: equal for names that some take for the
    same (Unicode Standard, definition D145).
    """
    return unicodedata.normalize("NFD", unicodedata.normalize("NFD", name).casefold())
