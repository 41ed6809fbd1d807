"""What a caller of Python asked for, looked at before anything begins, since no type checker may have seen it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import fields
from numbers import Real
from typing import Any, TypeVar

from fitball.data.table import ImpactTable
from fitball.data.written import check_source, in_memory
from fitball.errors import ParameterError
from fitball.inference.problem.priors import FAMILIES
from fitball.inference.problem.problem import Choices

T = TypeVar("T")


def sources_of(data: Any) -> tuple[list[Any], tuple[str, ...]]:
    """The tables that were handed over, one by one, and the files they were or are read from."""
    alone = isinstance(data, ImpactTable | str | os.PathLike) or in_memory(data)
    sources = list(data) if not alone and isinstance(data, Sequence) else [data]
    if not sources:
        raise ParameterError("read an empty list of tables, expected at least one")
    files = []
    for source in sources:
        if isinstance(source, ImpactTable):
            files += [place for place, _digest in source.files]
        elif not in_memory(source):
            check_source(source)
            files.append(os.fspath(source))
    return sources, tuple(files)


def flips(flip: str | Sequence[str]) -> tuple[str, ...]:
    """Columns to flip; one may be named without a list."""
    return (flip,) if isinstance(flip, str) else tuple(flip)


def given(options: Mapping[str, T] | None) -> Mapping[str, T]:
    """What was said by name, nothing for None; what is no mapping stays for `checked_choices`."""
    return {} if options is None else options


def checked_choices(choices: Choices) -> None:
    """Raise ParameterError for choices of a type that cannot be meant, and say how they are written."""
    for field in fields(choices):
        value = getattr(choices, field.name)
        if field.name in ("closures", "priors", "fix", "pool"):
            if not isinstance(value, Mapping):
                raise ParameterError(f"{field.name}: read {value!r}, expected a dict, such as {EXAMPLES[field.name]}")
            for name, item in value.items():
                _check_item(field.name, name, item)


EXAMPLES = {
    "closures": "{'cor': 'saturating'}",
    "priors": "{'mu': 'normal(0.55, 0.05)'}",
    "fix": "{'eps_slope': 0.0}",
    "pool": "{'mu': 'surface'}",
}


def _check_item(option: str, name: object, value: object) -> None:
    if option == "fix":
        if type(value) is bool or not isinstance(value, Real):
            raise ParameterError(f"fix: {name} = {value!r}: expected a number in SI units, such as {EXAMPLES['fix']}")
    elif not isinstance(value, str):
        more = ""
        if option == "priors":
            more = f"{_pair_words(name, value)}; forms: {', '.join(form for form, *_ in FAMILIES.values())}"
        raise ParameterError(f"{option}: {name} = {value!r}: expected a text, such as {EXAMPLES[option]}{more}")


def _pair_words(name: object, value: object) -> str:
    """What a pair of numbers may have been meant as: mean and sd or two bounds, which nobody can tell."""
    if not (isinstance(value, Sequence) and len(value) == 2 and all(isinstance(item, Real) for item in value)):
        return ""
    a, b = value
    spread, ends = f"'normal({a:g}, {b:g})'", f"'uniform({min(a, b):g}, {max(a, b):g})'"
    return f"; if these are mean and sd, write {{{name!r}: {spread}}}; if they are bounds, {{{name!r}: {ends}}}"
