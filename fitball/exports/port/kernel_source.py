"""The source of a kernel and of all it calls, as syntax trees: what ports are generated from.

Ports are not written a second time: the kernels are plain scalar functions, and what is emitted elsewhere is their
own source, narrowed to floats without a log of phases; everything else stays as it is written.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from fitball.models.kernels import dual

# What kernels may call besides each other and `math`.
BUILTINS = ("abs", "complex", "int", "max", "min", "range")
# Functions of `dual` that are those of `math` for a float.
_MATH = ("exp", "log", "log1p", "sqrt", "sin", "cos", "sinh", "cosh")
# The optional log of phases: a parameter of this name is always None in a port.
PHASE_LOG = "phase_log"
# The kind of number a kernel takes where it serves floats and derivatives alike (`models.dual`).
NUMBER = "Number"

Constant = int | float | tuple["Constant", ...]


@dataclass(frozen=True)
class InRow:
    """A number that is not a constant but an element of the parameter row, at this `place`."""

    place: int


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

    `given` says what names stand for that the modules of the functions do not define: numbers, functions, or places
    in the `row` that a function is given.
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
            elif isinstance(value, InRow):
                tree = ast.fix_missing_locations(_InRow(name, value.place).visit(tree))
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


class _InRow(ast.NodeTransformer):
    """Reads a name from the row."""

    def __init__(self, name: str, place: int) -> None:
        self.name, self.place = name, place

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id != self.name:
            return node
        return ast.Subscript(ast.Name("row", ast.Load()), ast.Constant(self.place), ast.Load())


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


def specialised(function: ast.FunctionDef, math_names: AbstractSet[str]) -> ast.FunctionDef:
    """The function for floats: calls of `math_names` go to `math`, carried derivatives, the phase log and whatever
    was computed for their sake alone are left out.
    """
    generic = any(isinstance(node, ast.Name) and node.id == NUMBER for node in ast.walk(function))
    function.decorator_list = []
    function.args.args = [argument for argument in function.args.args if argument.arg != PHASE_LOG]
    narrowed = _Narrow(math_names, generic).visit(function)
    assert isinstance(narrowed, ast.FunctionDef)
    # Until every name that is assigned is read; expressions have no effects here.
    dropping = True
    while dropping:
        dropper = _Drop(narrowed)
        dropper.visit(narrowed)
        dropping = dropper.dropped
    return ast.fix_missing_locations(narrowed)


class _Narrow(ast.NodeTransformer):
    def __init__(self, math_names: AbstractSet[str], generic: bool) -> None:
        self.math_names, self.generic = math_names, generic

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name):
            if node.func.id == "carry":
                return node.args[0]
            if node.func.id in self.math_names:
                node.func = ast.Attribute(ast.Name("math", ast.Load()), node.func.id, ast.Load())
        node.args = [child for child in node.args if not _is_log(child)]
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        self.generic_visit(node)
        # A float is its own real part.
        return node.value if self.generic and node.attr == "real" else node

    def visit_If(self, node: ast.If) -> ast.AST | None:
        test = node.test
        if isinstance(test, ast.Compare) and _is_log(test.left) and isinstance(test.ops[0], ast.IsNot):
            return None
        self.generic_visit(node)
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        self.generic_visit(node)
        assert node.value is not None
        return ast.Assign([node.target], node.value)


def _is_log(node: ast.expr) -> bool:
    named = isinstance(node, ast.Name) and node.id == PHASE_LOG
    return named or (isinstance(node, ast.Constant) and node.value is None)


class _Drop(ast.NodeTransformer):
    """Removes assignments to names that nothing reads."""

    def __init__(self, function: ast.FunctionDef) -> None:
        names = [node for node in ast.walk(function) if isinstance(node, ast.Name)]
        self.read = {node.id for node in names if isinstance(node.ctx, ast.Load)}
        self.dropped = False

    def visit_Assign(self, node: ast.Assign) -> ast.AST | None:
        target = node.targets[0]
        if isinstance(target, ast.Name) and target.id not in self.read:
            self.dropped = True
            return None
        return node
