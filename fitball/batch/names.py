"""Names of tables: each has a folder of that name below the batch's, whatever file system that comes to lie on."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath

from fitball.batch.plan import RECORD_NAME, ROW_NAME
from fitball.report.batch import document as files_of_all
from fitball.report.batch import population_files
from fitball.report.batch.rows import CSV_NAME
from fitball.report.figures.registry import FIGURES
from fitball.report.fit.folder import CHAIN_NAME, DERIVED
from fitball.report.saved.netcdf_files import DATA_NAME, POSTERIOR_NAME
from fitball.report.saved.run_file import RUN_NAME
from fitball.report.saved.structure import FIT_NAME
from fitball.visible import one_line

# What fitball writes into the folder of a batch or of a table, besides names that begin with a dot.
OWN_NAMES = frozenset(
    (
        RECORD_NAME, ROW_NAME, CSV_NAME, files_of_all.PAGE_NAME, files_of_all.PARQUET_NAME, files_of_all.PICTURE,
        files_of_all.DRIFT, population_files.JSON_NAME, population_files.CSV_NAME, FIT_NAME, CHAIN_NAME, DATA_NAME,
        POSTERIOR_NAME, RUN_NAME, *DERIVED, *(f"{name}.png" for name in FIGURES),
    )
)  # fmt: skip
# What Windows keeps for devices, whatever follows after a dot (learn.microsoft.com: Naming Files, Paths, Namespaces).
_DEVICE = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9¹²³]) *(\..*)?", re.IGNORECASE | re.DOTALL)
_NOWHERE = re.compile(r'[<>:"|?*\\]')
# Bytes of a name that every file system takes.
LONGEST = 240


def fault_of(name: str) -> str:
    """Why no folder can have the name of a table; empty where one can."""
    place = PurePosixPath(name)
    if not name.strip() or place.as_posix() != name or place.is_absolute() or {"..", "."} & {*place.parts, name}:
        return "expected a text that a folder can be called, such as 'court 3'"
    return next(filter(None, map(_fault_of_part, place.parts)), "")


def _fault_of_part(part: str) -> str:
    kept = same_key(part)
    if kept in OWN_NAMES:
        return f"fitball itself writes to files and folders that are called {part}"
    if part.startswith("."):
        return "names that begin with a dot are those of hidden files"
    if len(part.encode("utf-8", "surrogatepass")) > LONGEST:
        return f"the name has more than {LONGEST} bytes"
    if one_line(part) != part:
        return "the name holds a character that cannot be seen or is no text"
    if _DEVICE.fullmatch(part):
        return f"on Windows {part} is a device"
    if part[-1] in ". ":
        return "Windows drops a dot or blank at the end of a name"
    found = _NOWHERE.search(part)
    return "" if found is None else f"not every file system takes {found[0]} in a name"


def same_key(name: str) -> str:
    """Equal for names that some file system takes for one: those that differ only in case, or in how an accent is
    written (Unicode Standard, definition D145: canonical caseless matching).
    """
    return unicodedata.normalize("NFD", unicodedata.normalize("NFD", name).casefold())


def faults(names: Iterable[str]) -> dict[str, str]:
    """Why tables cannot have these names beside each other, by name."""
    names = list(names)
    keys = Counter(map(same_key, names))
    clash = "another table's name differs from it only in case or in how an accent is written"
    found = {name: fault_of(name) or (clash if keys[same_key(name)] > 1 else "") for name in names}
    return {name: f"{why}; rename the table" for name, why in found.items() if why}


def names_of(paths: Sequence[Path], common: Path) -> list[str]:
    """Paths below a folder that they have in common without endings; with them where two would be the same."""
    whole = [path.relative_to(common).as_posix() for path in paths]
    names = [path.relative_to(common).with_suffix("").as_posix() for path in paths]
    for _ in names:
        keys = Counter(map(same_key, names))
        # A name with its ending may in turn be that of another without: x.csv.
        longer = [full if keys[same_key(name)] > 1 else name for name, full in zip(names, whole, strict=True)]
        if longer == names:
            break
        names = longer
    return names
