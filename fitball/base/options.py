"""Types of the options of verbs, as Python and the command line take them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

from fitball.base.errors import ParameterError
from fitball.base.progress import Progress

# How the command line reads them: A,B; NAME=VALUE; NAME=NUMBER; a file.
Names: TypeAlias = str | Sequence[str]
Pairs: TypeAlias = Mapping[str, str] | None
Numbers: TypeAlias = Mapping[str, float] | None
File: TypeAlias = str | Path
Watch: TypeAlias = bool | Progress | None
# A comma outside of brackets; one inside belongs to a name, as in mu[clay, wet].
_COMMA = re.compile(r",(?![^\[]*\])")


def as_list(data: Any) -> list[Any]:
    """One source of data or several as a list; None is no source."""
    if data is None:
        return []
    return list(data) if isinstance(data, list | tuple) else [data]


def names_of(names: Names) -> list[str]:
    """`A,B` or several names as a list."""
    if not isinstance(names, str):
        return list(names)
    parts = (part.strip() for part in _COMMA.split(names))
    return [part for part in parts if part]


def figures_to_save(figures: str) -> bool | Literal["all"]:
    """Which figures a verb saves, of "" (the usual ones), all and none. Raises ParameterError
    (`figures`).
    """
    if figures not in ("", "all", "none"):
        raise ParameterError(f"figures: read '{figures}', expected all or none", "figures")
    return "all" if figures == "all" else figures != "none"
