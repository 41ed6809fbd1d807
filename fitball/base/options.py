"""Types of the options of verbs, and how Python and the command line read them."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar

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
_Value = TypeVar("_Value")


def names_of(names: Names) -> list[str]:
    """`A,B` or several names as a list.

    Raises:
        ParameterError: it is neither a text nor several texts (`names`).
    """
    if isinstance(names, str):
        stripped = (name.strip() for name in _COMMA.split(names))
        return [name for name in stripped if name]
    if not _are_texts(names):
        raise ParameterError(
            f"read {reprlib.repr(names)}; expected names, as in 'a,b' or ['a', 'b']",
            "names",
        )
    return list(names)


def _is_mapping(pairs: object) -> bool:
    """Whether an option has values by name, whatever the types say."""
    return isinstance(pairs, Mapping)


def _are_texts(names: object) -> bool:
    """Whether an option has several names, all of them texts, whatever the types say."""
    return isinstance(names, Iterable) and all(isinstance(name, str) for name in names)


def read_pairs(option: str, pairs: Mapping[str, _Value] | None) -> dict[str, _Value]:
    """The values of an option by name, empty without it.

    Raises:
        ParameterError: it is no mapping, such as a text, or a name is no text (`pairs`).
    """
    if pairs is None:
        return {}
    if not (_is_mapping(pairs) and _are_texts(pairs)):
        wanted = f"expected values by name, as in {option}={{'name': value}}"
        raise ParameterError(f"{option}: read {reprlib.repr(pairs)}; {wanted}", "pairs")
    return dict(pairs)


def read_texts(option: str, pairs: Mapping[str, str] | None) -> dict[str, str]:
    """The texts of an option by name, a number as its text, empty without it.

    Raises:
        ParameterError: it is no mapping, a name is no text, or a value neither text nor number
            (`pairs`).
    """
    texts = {}
    values: Mapping[str, object] = read_pairs(option, pairs)
    for name, value in values.items():
        if not isinstance(value, str | Real):
            read = f"read {reprlib.repr(value)} for {name}"
            raise ParameterError(f"{option}: {read}; expected a text", "pairs")
        texts[name] = str(value)
    return texts


def figures_to_save(figures: str) -> bool | Literal["all"]:
    """Which figures a verb saves, of "" (the usual ones), all and none.

    Raises:
        ParameterError: it is another word (`figures`).
    """
    if figures not in ("", "all", "none"):
        raise ParameterError(f"figures: read '{figures}', expected all or none", "figures")
    return "all" if figures == "all" else figures != "none"
