"""The printed tables of Jafri (2004) as they come with the package: digits as printed, units in the heads."""

from __future__ import annotations

import csv
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.data.bundled import bundled_folder
from fitball.errors import Fault, TableError

if TYPE_CHECKING:
    import pandas as pd

FOLDER = "thesis"


def thesis_table(name: str) -> pd.DataFrame:
    """One printed table by the stem of its file, such as `appendix_c`; text columns stay text.

    Raises TableError when there is no such table.
    """
    import pandas as pd

    text = {"mass_ratio": str, "row": str, "printed": str, "correct": str}
    return pd.read_csv(_file(name), dtype=text, na_filter=False)


def thesis_rows(name: str) -> list[dict[str, str]]:
    """The same as text, row by row, for who has no need of a frame."""
    with _file(name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _file(name: str) -> Path:
    path = bundled_folder() / FOLDER / f"{name}.csv"
    if not path.is_file():
        known = ", ".join(sorted(item.stem for item in path.parent.glob("*.csv")))
        raise TableError(str(path), [Fault(f"no printed table of that name (known: {known})")])
    return path


def fraction(text: str) -> float:
    """`2/3` as a number."""
    return float(Fraction(text))
