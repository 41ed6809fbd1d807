"""Published data in the package. The tables of Jafri (2004) have the printed digits, with units in the heads; Wang's
measurements are as the thesis uses them. Priors from the literature have their source and the meaning of their width.

`mu=literature:clay` asks for the row of parameter `mu` and key `clay` of `datasets/literature/priors.csv`.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fitball.data.bundled import bundled_folder
from fitball.data.read import load_table
from fitball.errors import Fault, ParameterError, TableError, suggestion
from fitball.values import FloatArray

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


PREFIX = "literature:"


@dataclass(frozen=True)
class PublishedPrior:
    """A prior of `parameter` under `key`: `distribution` is normal (`value` [SI], `sd`), lognormal (median, sd of
    the natural logarithm) or half-t (scale, degrees of freedom), of the spread between levels; `source` is where the
    value was published, `note` what it and its width are.
    """

    parameter: str
    key: str
    distribution: str
    value: float
    sd: float
    source: str
    note: str

    @property
    def text(self) -> str:
        """The prior as a user would write it."""
        return f"{self.distribution}({self.value:g}, {self.sd:g})"

    @property
    def provenance(self) -> str:
        """The key, the source and what was made of it, in a sentence."""
        return f"{PREFIX}{self.key}: {self.source} ({self.note})"


@cache
def published_priors() -> tuple[PublishedPrior, ...]:
    """All rows of the table."""
    place = bundled_folder() / "literature" / "priors.csv"
    with place.open(encoding="utf-8", newline="") as file:
        return tuple(
            PublishedPrior(**{**row, "value": float(row["value"]), "sd": float(row["sd"])})  # type: ignore[arg-type]
            for row in csv.DictReader(file)
        )


def published_prior(parameter: str, text: str) -> PublishedPrior | None:
    """The row that a prior such as `literature:clay` asks for; None for a prior that is written out.

    Raises ParameterError with the keys of the parameter where there is none of that name.
    """
    if not text.strip().lower().startswith(PREFIX):
        return None
    key = text.strip()[len(PREFIX) :].strip().lower()
    known = {row.key: row for row in published_priors() if row.parameter == parameter}
    if key in known:
        return known[key]
    if not known:
        named = ", ".join(dict.fromkeys(row.parameter for row in published_priors()))
        raise ParameterError(
            f"prior of {parameter}: read '{text}', but the literature has none for {parameter} (it has {named}; "
            "fitball datasets priors lists them)"
        )
    hint = suggestion(key, known)
    raise ParameterError(
        f"prior of {parameter}: read '{text}': {hint + ' ' if hint.startswith('did') else ''}known keys of "
        f"{parameter}: {', '.join(known)}; fitball datasets priors lists them with their sources"
    )


def with_published(priors: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """Priors with those from the literature written out, and the provenance of these by parameter.

    Raises ParameterError as `published_prior` does.
    """
    written, sources = dict(priors), {}
    for name, text in priors.items():
        row = published_prior(name, text)
        if row is not None:
            written[name], sources[name] = row.text, row.provenance
    return written, sources


SPINS = ("zero", "topspin", "backspin")
FILES = {"zero": "wang_zero_spin.csv", "topspin": "wang_topspin.csv", "backspin": "wang_backspin.csv"}


def measured(spin: str) -> dict[str, FloatArray]:
    """`v_x2`, `v_y2`, `v_2` [m/s], `theta_2` [deg], `omega_2` [rad/s], incident `v_x1`, `v_y1`, `omega_1`, all (7,).

    The angle is the printed one, even where the components beside it give another.
    """
    table = load_table(FILES[spin])
    columns = {name: getattr(table.impacts, name) for name in table.incident_columns}
    columns |= {item.name: item.values for item in (*table.measurements, *table.redundant)}
    return columns | {"theta_2": np.degrees(columns["theta_2"])}
