"""Expressions of the kernels in C99. What is not known here is refused, so that no port can drift in silence."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from fitball.export.port.c_types import STRIDE, Struct, Structs, Type, c_type, joined
from fitball.export.port.kernel_source import Constant, UnportableError

_ARITHMETIC: Mapping[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_BITS: Mapping[type[ast.operator], str] = {ast.BitOr: "|", ast.BitAnd: "&", ast.LShift: "<<"}
_COMPARE: Mapping[type[ast.cmpop], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
_MATH_FUNCTIONS = ("exp", "log", "log1p", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "hypot", "atan2")
_MATH_TESTS = ("isnan", "isfinite")
_MATH_VALUES = {"pi": "3.141592653589793", "nan": "NAN", "inf": "INFINITY"}

Code = tuple[str, Type]


@dataclass
class Scope:
    """What names mean: signatures of kernels, module constants, structs, and the locals of the function at hand."""

    signatures: Mapping[str, tuple[tuple[Type, ...], Type]]
    constants: Mapping[str, Constant]
    structs: Structs
    prefix: str
    variables: dict[str, Type] = field(default_factory=dict)


class UnknownTypeError(UnportableError):
    """A variable is read whose type is not inferred yet."""


def expression(node: ast.expr, scope: Scope) -> Code:
    """C text and type of an expression. Raises UnportableError for a construct that is not known."""
    handler = _HANDLERS.get(type(node))
    if handler is None:
        raise refused(node)
    return handler(node, scope)


def refused(node: ast.AST) -> UnportableError:
    """The error for a construct without a translation."""
    return UnportableError(f"no C99 translation of: {ast.unparse(node)}")


def _constant(node: ast.Constant, _scope: Scope) -> Code:
    value = node.value
    if isinstance(value, bool):
        return ("true" if value else "false"), "b"
    if isinstance(value, (int, float)):
        return repr(value), "d" if isinstance(value, float) else "i"
    raise refused(node)


def _name(node: ast.Name, scope: Scope) -> Code:
    if node.id in scope.variables:
        return node.id, scope.variables[node.id]
    if node.id in scope.constants:
        value = scope.constants[node.id]
        kind: Type = "d" if isinstance(value, float) else "i"
        if isinstance(value, tuple):
            kind = scope.structs[type(value).__name__]
        return f"{scope.prefix.upper()}{node.id}", kind
    raise UnknownTypeError(f"{node.id} is read before its type is known")


def _binary(node: ast.BinOp, scope: Scope) -> Code:
    (left, kind), (right, other) = expression(node.left, scope), expression(node.right, scope)
    operator = type(node.op)
    if operator in _BITS and kind == other == "i":
        return f"({left} {_BITS[operator]} {right})", "i"
    if operator is ast.Pow and isinstance(node.left, ast.Name) and isinstance(node.right, ast.Constant):
        power = node.right.value
        if isinstance(power, int) and 2 <= power <= 8:
            return f"({' * '.join([left] * power)})", kind
    if operator not in _ARITHMETIC or not {kind, other} <= {"d", "i", "z"}:
        raise refused(node)
    if operator is ast.Div and kind == other == "i":
        return f"((double){left} / (double){right})", "d"
    return f"({left} {_ARITHMETIC[operator]} {right})", joined(kind, other)


def _unary(node: ast.UnaryOp, scope: Scope) -> Code:
    text, kind = expression(node.operand, scope)
    if isinstance(node.op, ast.USub) and kind in ("d", "i", "z"):
        return f"(-{text})", kind
    if isinstance(node.op, ast.Not) and kind == "b":
        return f"(!{text})", "b"
    raise refused(node)


def _compare(node: ast.Compare, scope: Scope) -> Code:
    terms = [node.left, *node.comparators]
    if any(isinstance(part, ast.Call) for term in terms[1:-1] for part in ast.walk(term)):
        # It would be evaluated twice.
        raise refused(node)
    codes = [expression(term, scope) for term in terms]
    if not {kind for _text, kind in codes} <= {"d", "i"} or any(type(op) not in _COMPARE for op in node.ops):
        raise refused(node)
    links = [
        f"({left} {_COMPARE[type(op)]} {right})"
        for (left, _), op, (right, _) in zip(codes, node.ops, codes[1:], strict=False)
    ]
    return (links[0] if len(links) == 1 else f"({' && '.join(links)})"), "b"


def _logic(node: ast.BoolOp, scope: Scope) -> Code:
    codes = [expression(child, scope) for child in node.values]
    # Python returns an operand, C a truth value: they agree for truth values only.
    if {kind for _text, kind in codes} != {"b"}:
        raise refused(node)
    sign = " && " if isinstance(node.op, ast.And) else " || "
    return f"({sign.join(text for text, _kind in codes)})", "b"


def _choice(node: ast.IfExp, scope: Scope) -> Code:
    (test, truth), (one, kind), (other, second) = (
        expression(part, scope) for part in (node.test, node.body, node.orelse)
    )
    if truth != "b":
        raise refused(node)
    return f"({test} ? {one} : {other})", joined(kind, second)


def _attribute(node: ast.Attribute, scope: Scope) -> Code:
    if isinstance(node.value, ast.Name) and node.value.id == "math" and node.attr in _MATH_VALUES:
        return _MATH_VALUES[node.attr], "d"
    text, kind = expression(node.value, scope)
    if isinstance(kind, Struct) and (held := kind.field(node.attr)) is not None:
        return f"{text}.{node.attr}", held
    if node.attr in ("real", "imag") and kind == "z":
        return f"c{node.attr}({text})", "d"
    if node.attr == "real" and kind == "d":
        return text, "d"
    raise refused(node)


def _subscript(node: ast.Subscript, scope: Scope) -> Code:
    text, kind = expression(node.value, scope)
    if isinstance(kind, tuple) and isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, int):
        return f"{text}.f{node.slice.value}", kind[node.slice.value]
    if kind == "S" and isinstance(node.slice, ast.Tuple) and len(node.slice.elts) == 2:
        (row, one), (column, other) = (expression(child, scope) for child in node.slice.elts)
        if one == other == "i":
            return f"{text}[{STRIDE} * {row} + {column}]", "d"
    if kind in ("A", "I"):
        index, whole = expression(node.slice, scope)
        if whole == "i":
            return f"{text}[{index}]", "d" if kind == "A" else "i"
    raise refused(node)


def _tuple(node: ast.Tuple, scope: Scope) -> Code:
    codes = [expression(child, scope) for child in node.elts]
    kind = tuple(item for _text, item in codes)
    return f"({c_type(kind, scope.prefix)}){{{', '.join(text for text, _ in codes)}}}", kind


def _call(node: ast.Call, scope: Scope) -> Code:
    if node.keywords:
        raise refused(node)
    codes = [expression(child, scope) for child in node.args]
    texts, kinds = [text for text, _ in codes], [kind for _, kind in codes]
    listed = ", ".join(texts)
    if (
        isinstance(node.func, ast.Attribute)
        and isinstance(node.func.value, ast.Name)
        and node.func.value.id == "math"
    ):
        if set(kinds) <= {"d", "i"} and node.func.attr in _MATH_FUNCTIONS:
            return f"{node.func.attr}({listed})", "d"
        if kinds == ["d"] and node.func.attr in _MATH_TESTS:
            return f"({node.func.attr}({listed}) != 0)", "b"
        raise refused(node)
    if not isinstance(node.func, ast.Name):
        raise refused(node)
    name = node.func.id
    if name in scope.structs:
        made = scope.structs[name]
        _check_arguments(node, tuple(kind for _field, kind in made.fields), kinds)
        return f"({c_type(made, scope.prefix)}){{{listed}}}", made
    if name in scope.signatures:
        wanted, result = scope.signatures[name]
        _check_arguments(node, wanted, kinds)
        return f"{scope.prefix}{name}({listed})", result
    return _builtin(node, name, listed, kinds, scope.prefix)


def _check_arguments(node: ast.Call, wanted: tuple[Type, ...], kinds: list[Type]) -> None:
    if len(wanted) != len(kinds) or any(joined(*pair) != pair[0] for pair in zip(wanted, kinds, strict=True)):
        raise refused(node)


def _builtin(node: ast.Call, name: str, listed: str, kinds: list[Type], prefix: str) -> Code:
    if name == "abs" and kinds == ["d"]:
        return f"fabs({listed})", "d"
    if name == "int" and kinds == ["d"]:
        return f"((int64_t){listed})", "i"
    if name in ("min", "max") and len(kinds) == 2 and set(kinds) <= {"d", "i"}:
        kind = joined(*kinds)
        return f"{prefix}{name}_{'whole' if kind == 'i' else 'real'}({listed})", kind
    if name == "complex" and len(kinds) == 2 and set(kinds) <= {"d", "i"}:
        return f"{prefix}complex({listed})", "z"
    raise refused(node)


_HANDLERS: Mapping[type[ast.expr], Callable[..., Code]] = {
    ast.Constant: _constant, ast.Name: _name, ast.BinOp: _binary, ast.UnaryOp: _unary, ast.Compare: _compare,
    ast.BoolOp: _logic, ast.IfExp: _choice, ast.Attribute: _attribute, ast.Subscript: _subscript,
    ast.Tuple: _tuple, ast.Call: _call,
}  # fmt: skip
