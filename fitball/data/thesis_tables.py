"""The printed tables of Jafri (2004) as they come with the package: digits as printed, units in the heads."""

from __future__ import annotations

from fractions import Fraction

import pandas as pd

from fitball.data.bundled import bundled_folder
from fitball.errors import Fault, TableError

FOLDER = "thesis"


def thesis_table(name: str) -> pd.DataFrame:
    """One printed table by the stem of its file, such as `appendix_c`; text columns stay text.

    Raises TableError when there is no such table.
    """
    path = bundled_folder() / FOLDER / f"{name}.csv"
    if not path.is_file():
        known = ", ".join(sorted(item.stem for item in path.parent.glob("*.csv")))
        raise TableError(str(path), [Fault(f"no printed table of that name (known: {known})")])
    return pd.read_csv(path, dtype={"mass_ratio": str, "row": str, "printed": str, "correct": str}, na_filter=False)


def fraction(text: str) -> float:
    """`2/3` as a number."""
    return float(Fraction(text))
