"""Files that come with the package: tables, films, printed tables, published priors.

`datasets/thesis` has tables of Jafri (2004) as printed, `datasets/literature/priors.csv` priors
with their sources.
"""

import csv
import os
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path

from fitball.base.errors import FolderError, ParameterError, suggestion
from fitball.base.prior_families import Prior
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.text import one_line
from fitball.base.values import DataFrame

# Endings of bundled files.
_ENDINGS = (".csv", ".mp4")
# Text before the key of a published prior.
PUBLISHED = "literature:"


def datasets_folder() -> Path:
    """The folder of the bundled files: in the installed package, or beside it in a checkout."""
    package = Path(str(files("fitball")))
    installed = package / "_datasets"
    return installed if installed.is_dir() else package.parent / "datasets"


def descriptions(kind: str = "") -> dict[str, str]:
    """Descriptions of the bundled tables (or, of kind "tracks", films), by name."""
    by_name = {}
    for path in sorted((datasets_folder() / kind).glob("*.toml")):
        scene = tomllib.loads(path.read_text(encoding="utf-8"))
        by_name[path.stem] = str(scene["source"]["description"])
    return by_name


def bundled_file(text: str, kind: str = "") -> Path | None:
    """The file of a bundled table (of kind "tracks": film) by its name, with the ending or without;
    None if there is none.
    """
    names = descriptions(kind)
    for ending in _ENDINGS:
        name = text.removesuffix(ending)
        file = datasets_folder() / kind / f"{name}{ending}"
        if name in names and file.is_file():
            return file
    return None


def path_of_source(source: str | os.PathLike[str], kind: str = "") -> Path:
    """The file of a source: its path, or the name of a bundled table (of kind "tracks": film). A
    path that exists wins over a name.

    Raises:
        FolderError: There is no such file, and no bundled one of this name (`not-found`).
    """
    path = Path(source)
    text = os.fspath(source)
    # Unlike those of Path, these answer for a name too long for the system. Pipes are files here.
    is_folder = os.path.isdir(text)  # noqa: PTH112
    if os.path.exists(text) and not is_folder:  # noqa: PTH110
        return path
    bundled = bundled_file(text, kind)
    if bundled is not None:
        return bundled
    fault = "no such file"
    hint = suggestion(path.stem, descriptions(kind))
    if is_folder:
        fault = "a folder, no file"
        fits = sorted(path.glob("*/fit.json"))
        if fits:
            hint = f"did you mean the fit {fits[0].parent}?"
        elif any(path.glob("*.csv")):
            hint = f"name its tables, {one_line(text.rstrip('/'))}/*.csv"
    words = f"{one_line(text)}: {fault}, and no bundled one of this name; {hint}"
    raise FolderError(words, "not-found")


def printed_table(name: str) -> DataFrame:
    """A printed table of Jafri (2004), such as `appendix_c`. A column in which any cell is a text,
    such as 2/3, has texts only.
    """
    import pandas as pd

    return pd.read_csv(datasets_folder() / "thesis" / f"{name}.csv", na_filter=False)


@cache
def published_priors() -> tuple[Mapping[str, str], ...]:
    """Published priors: rows with parameter, key, distribution, value, sd, source, note.

    Value and sd are in SI; of a lognormal they are the median and the sd of the logarithm, of a
    half-t the scale and the degrees of freedom. The note says what the value and its width are.
    """
    with (datasets_folder() / "literature" / "priors.csv").open(
        encoding="utf-8", newline=""
    ) as file:
        return tuple(csv.DictReader(file))


def published_prior(spec: ParameterSpec, key: str) -> Prior:
    """The published prior `literature:KEY` of a parameter or a spread, with its source.

    Raises:
        ParameterError: No prior of this parameter has the key (`unknown-key`).
    """
    wanted = key.strip().removeprefix(PUBLISHED).strip().casefold()
    rows = {row["key"]: row for row in published_priors() if row["parameter"] == spec.name}
    if wanted not in rows:
        if rows:
            hint = suggestion(wanted, rows)
        else:
            parameters = dict.fromkeys(row["parameter"] for row in published_priors())
            hint = f"it has priors of {', '.join(parameters)}"
        read = f"prior of {spec.name}: the literature has no '{one_line(wanted)}' for it"
        raise ParameterError(f"{read}; {hint} (fitball check lists them)", "unknown-key")
    row = rows[wanted]
    prior = parse_prior(spec, f"{row['distribution']}({row['value']}, {row['sd']})")
    return replace(prior, source=f"{PUBLISHED}{wanted}: {row['source']} ({row['note']})")
