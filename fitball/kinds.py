"""Checks the types of arguments of public functions before anything begins.

`checked` is what every public function and method is decorated with; the kinds are those of its annotations.
"""

from __future__ import annotations

import builtins
import inspect
import os
import sys
import types
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cache, wraps
from numbers import Integral, Real
from reprlib import Repr
from typing import Any, ParamSpec, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from fitball.errors import ParameterError
from fitball.visible import one_line

P = ParamSpec("P")
T = TypeVar("T")

# Kinds that are wider than their annotation, as type checkers have it too, and what each is called.
_KINDS: Mapping[object, tuple[tuple[type, ...], str]] = {
    str: ((str,), "a text"),
    bool: ((bool, np.bool_), "True or False"),
    int: ((Integral,), "a whole number"),
    float: ((Real,), "a number"),
    os.PathLike: ((os.PathLike,), "a path"),
    types.NoneType: ((types.NoneType,), "None"),
}
# Arguments of which `api.reading.choices_of` says more.
SPOKEN_FOR = ("closures", "priors", "fix", "pool")
_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = 60


class _Elsewhere:
    """Stands for what only type checkers import: any kind."""

    def __getattr__(self, _name: str) -> _Elsewhere:
        return self

    def __getitem__(self, _part: object) -> _Elsewhere:
        return self

    def __or__(self, _other: object) -> Any:
        return Any

    __ror__ = __or__


class _Names(dict[str, Any]):
    """The names that an annotation is written in; an alias may be in quotes."""

    def __getitem__(self, name: str) -> Any:
        found = self.get(name, getattr(builtins, name, _Elsewhere()))
        return eval(found, {"__builtins__": {}}, self) if isinstance(found, str) else found


def spelled(options: type, defaults: Mapping[str, Any]) -> Callable[[T], T]:
    """Options that several functions take by `**options: Unpack[...]`, as each one's own: by name in its signature,
    of the kinds of a TypedDict, with these defaults (else None).
    """

    def spell(function: T) -> T:
        own = inspect.signature(cast("Callable[..., Any]", function))
        *known, _options = own.parameters.values()
        more = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=defaults.get(name), annotation=kind)
            for name, kind in get_type_hints(options).items()
        ]
        function.__signature__ = own.replace(parameters=[*known, *more])  # type: ignore[attr-defined]
        return function

    return spell


def checked(function: Callable[P, T]) -> Callable[P, T]:
    """The function, which raises ParameterError for an argument that is not of the kind its annotation names."""
    signature = inspect.signature(function)

    @cache
    def kinds() -> dict[str, Any]:
        names, found = _Names(vars(sys.modules[function.__module__])), {}
        for item in signature.parameters.values():
            if item.name == "self" or (item.name in SPOKEN_FOR and item.kind is inspect.Parameter.KEYWORD_ONLY):
                continue
            kind = item.annotation
            kind = eval(kind, {"__builtins__": {}}, names) if isinstance(kind, str) else kind
            found[item.name] = Any if kind is inspect.Parameter.empty or isinstance(kind, _Elsewhere) else kind
        return found

    @wraps(function)
    def wrapper(*args: P.args, **named: P.kwargs) -> T:
        try:
            given = signature.bind(*args, **named).arguments
        except TypeError as error:
            if hasattr(function, "__signature__"):
                raise TypeError(f"{function.__name__}() {error}") from None
            # Python says best which argument is missing or not known.
            return function(*args, **named)
        for name, kind in kinds().items():
            if name in given:
                _check(name, given[name], kind, signature.parameters[name].kind)
        return function(*args, **named)

    return wrapper


def _check(name: str, value: Any, kind: Any, how: Any) -> None:
    values = [(name, value)]
    if how is inspect.Parameter.VAR_POSITIONAL:
        values = [(name, item) for item in value]
    elif how is inspect.Parameter.VAR_KEYWORD:
        values = [*value.items()]
    for called, item in values:
        if not _fits(item, kind):
            words, shown = _words(kind), _shown(item)
            read = f"{called} = {shown}:" if words in ("a number", "a whole number") else f"{called}: read {shown},"
            raise ParameterError(one_line(f"{read} expected {words}"))


def _parts(kind: Any) -> tuple[Any, tuple[Any, ...]]:
    """A kind without what it holds, and that; `Union` with its members."""
    origin = get_origin(kind)
    parts = tuple(part for part in get_args(kind) if part is not ...)
    return (Union if origin is types.UnionType else origin or (types.NoneType if kind is None else kind)), parts


def _fits(value: Any, kind: Any) -> bool:
    """Whether a value is of a kind, through and through; it is of every kind that is not known here."""
    kind, parts = _parts(kind)
    if kind is Union:
        if isinstance(value, str | os.PathLike) and any(_parts(part)[0] is os.PathLike for part in parts):
            return _is_text(os.fspath(value)) and "\0" not in os.fspath(value)
        # Arrays and what may become one are looked at by `values.numbers`.
        arrays = any(getattr(_parts(part)[0], "_is_protocol", False) for part in parts)
        return arrays or any(_fits(value, part) for part in parts)
    if kind in _KINDS:
        if kind is float and isinstance(value, int) and abs(value) > sys.float_info.max:
            return False
        truth = isinstance(value, bool | np.bool_)
        return isinstance(value, _KINDS[kind][0]) and truth is (kind is bool) and (kind is not str or _is_text(value))
    if kind is Callable:
        return callable(value)
    if kind is Mapping:
        if not isinstance(value, Mapping):
            return False
        return not parts or all(_fits(key, parts[0]) and _fits(item, parts[1]) for key, item in value.items())
    if kind in (Sequence, tuple):
        # What has no length can be gone through but once, and an array of other dimensions has no items.
        if not isinstance(value, Collection) or isinstance(value, bytes | Mapping) or getattr(value, "ndim", 1) != 1:
            return False
        return all(any(_fits(item, part) for part in parts) for item in value)
    return kind is Any or not isinstance(kind, type) or isinstance(value, kind)


def _is_text(value: object) -> bool:
    """Whether this can be written into a file: half of a surrogate pair cannot, a byte of a file's name can."""
    try:
        return isinstance(value, str) and value.encode("utf-8", "surrogateescape") is not None
    except UnicodeEncodeError:
        return False


def _words(kind: Any) -> str:
    """What a kind is called."""
    kind, parts = _parts(kind)
    parts = tuple(part for part in parts if part is not types.NoneType)
    if kind in _KINDS:
        return _KINDS[kind][1]
    if kind is Mapping:
        return f"a dict, each value {_words(parts[-1])}"
    if kind in (Union, Sequence, tuple):
        listed = " or ".join(dict.fromkeys(map(_words, parts)))
        return listed if kind is Union else f"a list, each {listed}"
    return "a function" if kind is Callable else f"a value of type {getattr(kind, '__name__', kind)}"


def _shown(value: Any) -> str:
    """A value that is short to write, of others their type."""
    plain = value is None or isinstance(value, str | int | float | complex | bytes | list | tuple | dict | set)
    return _SHORT.repr(value) if plain else f"a value of type {type(value).__name__}"
