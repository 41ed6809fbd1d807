"""Priors from the literature: a small table, each value with where it was published and what its width means.

`mu=literature:clay` asks for the row of parameter `mu` and key `clay` of `datasets/literature/priors.csv`.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from fitball.data.bundled import bundled_folder
from fitball.errors import ParameterError, suggestion

PREFIX = "literature:"


@dataclass(frozen=True)
class PublishedPrior:
    """A prior of `parameter` under `key`: `distribution` is normal (`value` [SI], `sd`) or lognormal (median, sd of
    the natural logarithm); `source` is where the value was published, `note` what it and its width are.
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
            f"prior of {parameter}: read '{text}', but the literature table has none of {parameter} (it has {named}; "
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
