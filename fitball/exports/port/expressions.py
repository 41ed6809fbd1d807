"""Expressions of the kernels in another language. What is not known here is refused: no port can drift in silence."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from fitball.exports.port.dialect import Dialect
from fitball.exports.port.kernel_source import Constant, UnportableError
from fitball.exports.port.kinds import Struct, Structs, Type, joined

_ARITHMETIC: Mapping[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_BITS: Mapping[type[ast.operator], str] = {ast.BitOr: "|", ast.BitAnd: "&", ast.LShift: "<<"}
_COMPARE: Mapping[type[ast.cmpop], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
_MATH_FUNCTIONS = ("exp", "log", "log1p", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "hypot", "atan2")
_MATH_TESTS = ("isnan", "isfinite")

Code = tuple[str, Type]
Signature = tuple[tuple[Type, ...], Type]


@dataclass(frozen=True)
class Program:
    """What all functions of a port share: their signatures, module constants, structs, and the language."""

    signatures: Mapping[str, Signature]
    constants: Mapping[str, Constant]
    structs: Structs
    dialect: Dialect


@dataclass
class Scope:
    """What names mean: the program, and the locals of the function at hand."""

    program: Program
    variables: dict[str, Type] = field(default_factory=dict)

    @property
    def dialect(self) -> Dialect:
        """The language."""
        return self.program.dialect


class UnknownTypeError(UnportableError):
    """A variable is read whose type is not inferred yet."""


def expression(node: ast.expr, scope: Scope) -> Code:
    """Text and type of an expression. Raises UnportableError for a construct that is not known."""
    handler = _HANDLERS.get(type(node))
    if handler is None:
        raise refused(node)
    return handler(node, scope)


def fitted(node: ast.expr, wanted: Type, scope: Scope) -> str:
    """The text of an expression where `wanted` is held. Raises UnportableError where it would not fit."""
    text, kind = expression(node, scope)
    if joined(wanted, kind) != wanted:
        raise refused(node)
    return scope.dialect.fit(text, kind, wanted)


def refused(node: ast.AST) -> UnportableError:
    """The error for a construct without a translation."""
    return UnportableError(f"no translation of: {ast.unparse(node)}")


def _constant(node: ast.Constant, scope: Scope) -> Code:
    value = node.value
    if isinstance(value, (int, float)):
        kind = "b" if isinstance(value, bool) else "d" if isinstance(value, float) else "i"
        return scope.dialect.number(value), kind
    raise refused(node)


def _name(node: ast.Name, scope: Scope) -> Code:
    if node.id in scope.variables:
        return scope.dialect.name(node.id), scope.variables[node.id]
    constants = scope.program.constants
    if node.id in constants:
        value = constants[node.id]
        if isinstance(value, tuple):
            return scope.dialect.shared(node.id), scope.program.structs[type(value).__name__]
        return scope.dialect.constant(node.id), "d" if isinstance(value, float) else "i"
    raise UnknownTypeError(f"{node.id} is read before its type is known")


def _binary(node: ast.BinOp, scope: Scope) -> Code:
    (left, kind), (right, other) = expression(node.left, scope), expression(node.right, scope)
    operator = type(node.op)
    if operator in _BITS and kind == other == "i":
        return scope.dialect.bits(_BITS[operator], left, right), "i"
    if operator is ast.Pow and isinstance(node.left, ast.Name) and isinstance(node.right, ast.Constant):
        power = node.right.value
        if isinstance(power, int) and 2 <= power <= 8 and kind in ("d", "i"):
            return f"({' * '.join([left] * power)})", kind
    if operator not in _ARITHMETIC or not {kind, other} <= {"d", "i", "z"}:
        raise refused(node)
    wide = "d" if operator is ast.Div and kind == other == "i" else joined(kind, other)
    return scope.dialect.binary(_ARITHMETIC[operator], (left, kind), (right, other), wide), wide


def _unary(node: ast.UnaryOp, scope: Scope) -> Code:
    text, kind = expression(node.operand, scope)
    if isinstance(node.op, ast.USub) and kind in ("d", "i", "z"):
        return scope.dialect.negative(text, kind), kind
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
        f"({left} {scope.dialect.compare[_COMPARE[type(op)]]} {right})"
        for (left, _), op, (right, _) in zip(codes, node.ops, codes[1:], strict=False)
    ]
    return (links[0] if len(links) == 1 else f"({' && '.join(links)})"), "b"


def _logic(node: ast.BoolOp, scope: Scope) -> Code:
    codes = [expression(child, scope) for child in node.values]
    # Python returns an operand, others a truth value: they agree for truth values only.
    if {kind for _text, kind in codes} != {"b"}:
        raise refused(node)
    sign = " && " if isinstance(node.op, ast.And) else " || "
    return f"({sign.join(text for text, _kind in codes)})", "b"


def _choice(node: ast.IfExp, scope: Scope) -> Code:
    (test, truth), (_one, kind), (_other, second) = (
        expression(part, scope) for part in (node.test, node.body, node.orelse)
    )
    if truth != "b":
        raise refused(node)
    wide = joined(kind, second)
    return scope.dialect.choice(test, fitted(node.body, wide, scope), fitted(node.orelse, wide, scope)), wide


def _attribute(node: ast.Attribute, scope: Scope) -> Code:
    if isinstance(node.value, ast.Name) and node.value.id == "math" and node.attr in scope.dialect.values:
        return scope.dialect.values[node.attr], "d"
    text, kind = expression(node.value, scope)
    if isinstance(kind, Struct) and (held := kind.field(node.attr)) is not None:
        return f"{text}.{scope.dialect.name(node.attr)}", held
    if node.attr in ("real", "imag") and kind == "z":
        return scope.dialect.part(node.attr, text), "d"
    if node.attr == "real" and kind == "d":
        return text, "d"
    raise refused(node)


def _subscript(node: ast.Subscript, scope: Scope) -> Code:
    text, kind = expression(node.value, scope)
    if isinstance(kind, tuple) and isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, int):
        return scope.dialect.item(text, node.slice.value), kind[node.slice.value]
    if kind == "S" and isinstance(node.slice, ast.Tuple) and len(node.slice.elts) == 2:
        (row, one), (column, other) = (expression(child, scope) for child in node.slice.elts)
        if one == other == "i":
            return scope.dialect.cell(text, row, column), "d"
    if kind in ("A", "I"):
        index, whole = expression(node.slice, scope)
        if whole == "i":
            return scope.dialect.element(text, index), "d" if kind == "A" else "i"
    raise refused(node)


def _tuple(node: ast.Tuple, scope: Scope) -> Code:
    codes = [expression(child, scope) for child in node.elts]
    kind = tuple(item for _text, item in codes)
    return scope.dialect.make(kind, [text for text, _ in codes]), kind


def _call(node: ast.Call, scope: Scope) -> Code:
    if node.keywords:
        raise refused(node)
    function, dialect, program = node.func, scope.dialect, scope.program
    if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name) and function.value.id == "math":
        return _math(node, function.attr, scope)
    if not isinstance(function, ast.Name):
        raise refused(node)
    if function.id in program.structs:
        made = program.structs[function.id]
        return dialect.make(made, _arguments(node, tuple(kind for _field, kind in made.fields), scope)), made
    if function.id in program.signatures:
        wanted, result = program.signatures[function.id]
        return f"{dialect.function(function.id)}({', '.join(_arguments(node, wanted, scope))})", result
    return _builtin(node, function.id, scope)


def _arguments(node: ast.Call, wanted: tuple[Type, ...], scope: Scope) -> list[str]:
    if len(wanted) != len(node.args):
        raise refused(node)
    return [fitted(child, kind, scope) for child, kind in zip(node.args, wanted, strict=True)]


def _math(node: ast.Call, name: str, scope: Scope) -> Code:
    codes = [expression(child, scope) for child in node.args]
    kinds = [kind for _, kind in codes]
    if set(kinds) <= {"d", "i"} and name in _MATH_FUNCTIONS:
        return f"{scope.dialect.math[name]}({', '.join(text for text, _ in codes)})", "d"
    if kinds == ["d"] and name in _MATH_TESTS:
        return scope.dialect.test(name, codes[0][0]), "b"
    raise refused(node)


def _builtin(node: ast.Call, name: str, scope: Scope) -> Code:
    codes, dialect = [expression(child, scope) for child in node.args], scope.dialect
    texts, kinds = [text for text, _ in codes], [kind for _, kind in codes]
    if name == "abs" and kinds == ["d"]:
        return dialect.absolute(texts[0]), "d"
    if name == "int" and kinds == ["d"]:
        return dialect.whole(texts[0]), "i"
    if name in ("min", "max") and len(kinds) == 2 and set(kinds) <= {"d", "i"}:
        kind = joined(*kinds)
        helper = f"{name}_{'whole' if kind == 'i' else 'real'}"
        return f"{dialect.function(helper)}({', '.join(texts)})", kind
    if name == "complex" and len(kinds) == 2 and set(kinds) <= {"d", "i"}:
        return f"{dialect.function('complex')}({', '.join(texts)})", "z"
    raise refused(node)


_HANDLERS: Mapping[type[ast.expr], Callable[..., Code]] = {
    ast.Constant: _constant, ast.Name: _name, ast.BinOp: _binary, ast.UnaryOp: _unary, ast.Compare: _compare,
    ast.BoolOp: _logic, ast.IfExp: _choice, ast.Attribute: _attribute, ast.Subscript: _subscript,
    ast.Tuple: _tuple, ast.Call: _call,
}  # fmt: skip
