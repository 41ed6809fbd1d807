"""The source of a kernel and of all it calls, as syntax trees: what ports are generated from.

Ports are not written a second time: the kernels are plain scalar functions, and what is emitted elsewhere is their
own source. `specialised` narrows it to floats without a log of phases; everything else stays as it is written.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from fitball.exports.port.specialise import specialised
from fitball.models.kernels import dual

# What kernels may call besides each other and `math`.
BUILTINS = ("abs", "complex", "int", "max", "min", "range")
# Functions of `dual` that are those of `math` for a float.
_MATH = ("exp", "log", "log1p", "sqrt", "sin", "cos", "sinh", "cosh")

Constant = int | float | tuple["Constant", ...]


class UnportableError(Exception):
    """A kernel uses something that ports cannot express: a fault of this program, found while generating."""


@dataclass(frozen=True)
class KernelSource:
    """Functions, each after those it calls, the module constants they use, and the named tuples they hand each other:
    annotations by field, each tuple after those it holds.
    """

    functions: tuple[ast.FunctionDef, ...]
    constants: Mapping[str, Constant]
    structs: Mapping[str, Mapping[str, ast.expr]]


def kernel_source(*entries: Callable[..., Any], given: Mapping[str, Any] = MappingProxyType({})) -> KernelSource:
    """Collect `entries` and whatever they call. Raises UnportableError for all but numbers and `math`.

    `given` says what names stand for that the modules of the functions do not define: numbers, or functions.
    """
    kernels: dict[str, ast.FunctionDef] = {}
    origin: dict[str, Any] = {}
    constants: dict[str, Constant] = {}
    structs: dict[str, Mapping[str, ast.expr]] = {}

    def add_struct(kind: Any) -> None:
        if kind.__name__ in structs:
            return
        # With postponed annotations the fields' types are held as text.
        annotations = {
            name: ast.parse(text.__forward_arg__, mode="eval").body for name, text in kind.__annotations__.items()
        }
        add_structs_of(annotations.values(), vars(sys.modules[kind.__module__]))
        structs[kind.__name__] = annotations

    def add_structs_of(annotations: Iterable[ast.expr], known: Mapping[str, Any]) -> None:
        for name in sorted(_names(annotations)):
            if _is_struct(known.get(name)):
                add_struct(known[name])

    def add(function: Any) -> None:
        plain = getattr(function, "py_func", function)
        if plain.__name__ in origin:
            if origin[plain.__name__] is not plain:
                raise UnportableError(f"two kernels are called {plain.__name__}")
            return
        origin[plain.__name__] = plain
        tree = _tree(plain)
        hints = [argument.annotation for argument in tree.args.args] + [tree.returns]
        add_structs_of([item for item in hints if item is not None], plain.__globals__)
        for name in sorted(free_names(tree)):
            value = given.get(name, plain.__globals__.get(name, _MISSING))
            if value is _MISSING and name in BUILTINS and hasattr(builtins, name):
                continue
            # A specialised kernel may call `math` where its module imports the same function from `dual`.
            if name == "math" and value in (math, _MISSING):
                continue
            if _is_struct(value):
                add_struct(value)
            elif isinstance(value, (int, float)) or _is_struct(type(value)):
                if name in constants and repr(constants[name]) != repr(value):
                    raise UnportableError(f"{plain.__name__}: two kernels disagree about the constant {name}")
                constants[name] = value
            elif callable(value):
                add(value)
                _rename(tree, name, getattr(value, "py_func", value).__name__)
            else:
                raise UnportableError(f"{plain.__name__} uses {name}, which is no number and no kernel")
        kernels[plain.__name__] = tree

    for entry in entries:
        add(entry)
    return KernelSource(tuple(kernels.values()), dict(sorted(constants.items())), structs)


_MISSING = object()


def _is_struct(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields")


def _rename(tree: ast.FunctionDef, old: str, new: str) -> None:
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and node.id == old:
            node.id = new


def _names(trees: Iterable[ast.AST]) -> set[str]:
    return {node.id for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Name)}


def _tree(function: Callable[..., Any]) -> ast.FunctionDef:
    """The specialised syntax tree of one kernel."""
    module = ast.parse(textwrap.dedent(inspect.getsource(function)))
    node = module.body[0]
    if not isinstance(node, ast.FunctionDef):
        raise UnportableError(f"{function.__name__} is no plain function")
    known = vars(inspect.getmodule(function))
    aliases = {name for name in _MATH if known.get(name) is getattr(dual, name)}
    return specialised(node, aliases)


def local_names(function: ast.FunctionDef) -> set[str]:
    """Parameters and names assigned in a function."""
    stored = {
        node.id for node in ast.walk(function) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
    return stored | {argument.arg for argument in function.args.args}


def free_names(function: ast.FunctionDef) -> set[str]:
    """Names a function's body takes from outside (annotations left aside)."""
    loaded = {
        node.id
        for statement in function.body
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
    }
    return loaded - local_names(function)
