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
from typing import Any

from fitball.base.errors import ParameterError
from fitball.data.cells import PARQUET, file_and_sheet
from fitball.data.records import WORKBOOKS
from fitball.data.table import ImpactTable

# Endings of tables in a folder; what `*` matches besides, scenes and notes, is none.
ENDINGS = (".csv", ".tsv", ".txt", *WORKBOOKS, *PARQUET)
# What Windows keeps for devices (learn.microsoft.com: Naming Files, Paths, and Namespaces), and
# bytes of a name that every file system takes, with what is put beside it for a moment.
_DEVICE = re.compile(r"con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³]", re.IGNORECASE)
_LONGEST = 100
_DIGEST = 8


def named(data: Any, out: Path) -> dict[str, Any]:
    """Tables by safe names: of a mapping its own; of paths, folders, patterns (`courts/*.csv`,
    `**`), bundled names and frames made of their files. What lies in `out` is none of them. Raises
    ParameterError (`no-tables`).
    """
    if isinstance(data, Mapping):
        forms: dict[str, tuple[str, ...]] = {str(name): (str(name),) for name in data}
        sources = dict(zip(forms, data.values(), strict=True))
    else:
        many = data if isinstance(data, list | tuple | Iterator) else [data]
        found = [one for given in many for one in _expanded(given, out)]
        # `a.csv` and `./a.csv` are one table.
        sources = {
            os.path.abspath(one) if isinstance(one, str) else f"{k}": one  # noqa: PTH100
            for k, one in enumerate(found)
        }
        forms = _forms(sources)
    if not sources:
        raise ParameterError(
            "batch: no table was given; expected files, folders or patterns",
            "no-tables",
        )
    return {name: sources[key] for key, name in _alone(forms).items()}


def _expanded(given: Any, out: Path) -> Iterator[Any]:
    """The tables of a folder or a pattern, sorted; others as they are."""
    if not isinstance(given, str | os.PathLike):
        yield given
        return
    text = os.fspath(given)
    if not os.path.isdir(text) and (os.path.exists(text) or not glob.has_magic(text)):  # noqa: PTH110, PTH112
        # One that is not there is a failed row, not the end of all others.
        yield text
        return
    pattern = os.path.join(glob.escape(text), "*") if os.path.isdir(text) else text  # noqa: PTH112, PTH118
    inside = [Path(one) for one in sorted(glob.glob(pattern, recursive=True))]  # noqa: PTH207
    kept = [one for one in inside if one.suffix.lower() in ENDINGS and one.is_file()]
    kept = [one for one in kept if not one.absolute().is_relative_to(out.absolute())]
    if not kept:
        raise ParameterError(
            f"{text}: no table there; names of tables end with {', '.join(ENDINGS)}",
            "no-tables",
        )
    yield from map(str, kept)


def _forms(sources: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """What each could be called, the shortest first."""
    files = {key: file_and_sheet(key)[0] for key, one in sources.items() if isinstance(one, str)}
    common = os.path.commonpath([os.path.dirname(file) for file in files.values()]) if files else ""  # noqa: PTH120
    forms: dict[str, tuple[str, ...]] = {}
    for key, one in sources.items():
        if isinstance(one, str):
            file = Path(files[key])
            sheet = file_and_sheet(key)[1]
            whole = "-".join(file.relative_to(common).parts)
            forms[key] = tuple(
                f"{name}-{sheet}" if sheet else name
                for name in (file.stem, whole.removesuffix(file.suffix), whole)
            )
        else:
            own = (
                one.name
                if isinstance(one, ImpactTable)
                else getattr(one, "attrs", {}).get("name", "table")
            )
            forms[key] = (str(own), f"{own}-{int(key) + 1}")
    return forms


def _alone(forms: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """A safe name for each, no two the same on any file system."""
    names = dict[str, str]()
    rest = dict(forms)
    for step in range(1 + max(map(len, forms.values()))):
        tried = {
            key: safe(own[step])
            if step < len(own)
            else f"{safe(own[-1])}-{sha256(key.encode()).hexdigest()[:_DIGEST]}"
            for key, own in rest.items()
        }
        count = Counter(map(_same, [*tried.values(), *names.values()]))
        names |= {key: name for key, name in tried.items() if count[_same(name)] == 1}
        rest = {key: own for key, own in rest.items() if key not in names}
        if not rest:
            break
    return {key: names[key] for key in forms}


def safe(name: str) -> str:
    """A name that is that of a folder everywhere: letters, digits, blanks and `_+=-()` of any
    script.
    """
    kept = re.sub(r"[^\w +=()-]", "_", unicodedata.normalize("NFC", name)).strip()
    kept = kept.encode()[:_LONGEST].decode(errors="ignore").strip() or "table"
    return f"{kept}_" if _DEVICE.fullmatch(kept) else kept


def _same(name: str) -> str:
    """Equal for names that some file system takes for one (Unicode Standard, definition D145)."""
    return unicodedata.normalize("NFD", unicodedata.normalize("NFD", name).casefold())
