"""Kernels in another language: a walk over their syntax trees, the same for all dialects. What is not known here is
refused: no port can drift in silence. Variables stand at the top of their function, with inferred types.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from fitball.exports.port.dialect import STRIDE, Dialect, Struct, Structs, Type, annotated, joined, structs_of
from fitball.exports.port.kernel_source import Constant, KernelSource, UnportableError, local_names

_ARITHMETIC: Mapping[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_BITS: Mapping[type[ast.operator], str] = {ast.BitOr: "|", ast.BitAnd: "&", ast.LShift: "<<"}
_COMPARE: Mapping[type[ast.cmpop], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="
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
            return scope.dialect.constant(node.id), scope.program.structs[type(value).__name__]
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
    signs = {**_COMPARE, ast.Eq: scope.dialect.same, ast.NotEq: scope.dialect.other}
    links = [
        f"({left} {signs[type(op)]} {right})"
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
    return f"({test} ? {fitted(node.body, wide, scope)} : {fitted(node.orelse, wide, scope)})", wide


def _attribute(node: ast.Attribute, scope: Scope) -> Code:
    if isinstance(node.value, ast.Name) and node.value.id == "math" and node.attr in scope.dialect.values:
        return scope.dialect.values[node.attr], "d"
    text, kind = expression(node.value, scope)
    if isinstance(kind, Struct) and (held := kind.field(node.attr)) is not None:
        return f"{text}.{scope.dialect.name(node.attr)}", held
    if node.attr in ("real", "imag") and kind == "z":
        return (scope.dialect.real if node.attr == "real" else scope.dialect.imaginary).format(text), "d"
    if node.attr == "real" and kind == "d":
        return text, "d"
    raise refused(node)


def _subscript(node: ast.Subscript, scope: Scope) -> Code:
    text, kind = expression(node.value, scope)
    if isinstance(kind, tuple) and isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, int):
        return scope.dialect.item.format(text, node.slice.value), kind[node.slice.value]
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
        return scope.dialect.test.format(scope.dialect.math[name], codes[0][0]), "b"
    raise refused(node)


def _builtin(node: ast.Call, name: str, scope: Scope) -> Code:
    codes, dialect = [expression(child, scope) for child in node.args], scope.dialect
    texts, kinds = [text for text, _ in codes], [kind for _, kind in codes]
    if name == "abs" and kinds == ["d"]:
        return f"{dialect.math['fabs']}({texts[0]})", "d"
    if name == "int" and kinds == ["d"]:
        return dialect.whole.format(texts[0]), "i"
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


def program_of(source: KernelSource, dialect: Dialect) -> Program:
    """What the functions of a source share in a language. Raises UnportableError."""
    structs = structs_of(source.structs)
    return Program(signatures(source.functions, structs), source.constants, structs, dialect)


def signatures(functions: Iterable[ast.FunctionDef], structs: Structs) -> Mapping[str, Signature]:
    """Types of the parameters and of the result of each function."""
    return {
        item.name: (
            tuple(annotated(argument.annotation, structs) for argument in item.args.args),
            annotated(item.returns, structs),
        )
        for item in functions
    }


def translated(function: ast.FunctionDef, program: Program) -> str:
    """One kernel in the program's language. Raises UnportableError for what has no translation."""
    dialect = program.dialect
    kinds, result = program.signatures[function.name]
    scope = Scope(program)
    names = [argument.arg for argument in function.args.args]
    scope.variables.update(zip(names, kinds, strict=True))
    _infer(function, scope)
    read = {node.id for node in ast.walk(function) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
    body = _Body(scope, result, read)
    statements = function.body[1:] if ast.get_docstring(function) else function.body
    lines = [f"    {line}" for item in statements for line in body.statement(item)]
    own = sorted((scope.variables.keys() & read) - set(names))
    heads = [f"    {dialect.local(scope.variables[name], dialect.name(name))};" for name in own]
    heads += [f"    {line}" for name in names if name not in read for line in dialect.unread(name)]
    taken = [(kind, dialect.name(name)) for kind, name in zip(kinds, names, strict=True)]
    comment = (ast.get_docstring(function) or "").split("\n\n")[0]
    head = dialect.define(comment, result, dialect.function(function.name), taken)
    return "\n".join([head, *heads, *lines, "}"])


def _infer(function: ast.FunctionDef, scope: Scope) -> None:
    """Fill in the types of the locals: assignments are gone through until nothing changes."""
    waiting: list[str] = []
    for _ in range(20):
        before, waiting = dict(scope.variables), []
        for node in ast.walk(function):
            for target, value in _assignments(node):
                try:
                    kind = expression(value, scope)[1]
                except UnknownTypeError as error:
                    waiting.append(str(error))
                    continue
                _note(target, kind, scope)
        if scope.variables == before:
            break
    missing = local_names(function) - scope.variables.keys() - {"_"}
    if waiting or missing:
        raise UnportableError(f"{function.name}: no type found of {', '.join(sorted(missing)) or waiting[0]}")


def _assignments(node: ast.AST) -> Iterator[tuple[ast.expr, ast.expr]]:
    if isinstance(node, ast.Assign):
        yield node.targets[0], node.value
    elif isinstance(node, ast.AugAssign):
        yield node.target, _sum(node)
    elif isinstance(node, ast.For):
        yield node.target, ast.Constant(0)


def _sum(node: ast.AugAssign) -> ast.BinOp:
    """`target op value`, the target read."""
    read = ast.parse(ast.unparse(node.target), mode="eval").body
    return ast.BinOp(read, node.op, node.value)


def _note(target: ast.expr, kind: Type, scope: Scope) -> None:
    if isinstance(target, ast.Name):
        known = scope.variables.get(target.id)
        scope.variables[target.id] = kind if known is None else joined(known, kind)
    elif isinstance(target, ast.Tuple):
        parts = ("d",) * len(target.elts) if kind == "A" else kind
        if not isinstance(parts, tuple) or len(parts) != len(target.elts):
            raise refused(target)
        for item, part in zip(target.elts, parts, strict=True):
            _note(item, part, scope)
    elif not isinstance(target, ast.Subscript):
        raise refused(target)


@dataclass
class _Body:
    """Writes the statements of one function; `read` are the names whose value is used."""

    scope: Scope
    result: Type
    read: set[str]
    temporaries: int = field(default=0)

    def statement(self, node: ast.stmt) -> list[str]:
        match node:
            case ast.Assign():
                return self._assign(node.targets[0], node.value)
            case ast.AugAssign():
                return self._assign(node.target, _sum(node))
            case ast.Return():
                return [f"return {self._returned(node)};"]
            case ast.Break():
                return ["break;"]
            case ast.Continue():
                return ["continue;"]
            case ast.Pass():
                return []
            case ast.Expr(value=ast.Call()):
                return [f"{expression(node.value, self.scope)[0]};"]
            case ast.If():
                return self._if(node)
            case ast.While(orelse=[]):
                return self._block(self._condition("while", node.test), node.body)
            case ast.For(orelse=[]):
                return self._for(node)
        raise refused(node)

    def _block(self, head: str, body: list[ast.stmt], first: tuple[str, ...] = ()) -> list[str]:
        return [head, *self._inner(body, first), "}"]

    def _inner(self, body: list[ast.stmt], first: tuple[str, ...] = ()) -> list[str]:
        lines = [*first, *(line for item in body for line in self.statement(item))]
        return [f"    {line}" for line in lines]

    def _condition(self, word: str, node: ast.expr) -> str:
        text, kind = expression(node, self.scope)
        if kind != "b":
            raise refused(node)
        return f"{word} ({text}) {{"

    def _if(self, node: ast.If) -> list[str]:
        lines = [self._condition("if", node.test), *self._inner(node.body)]
        if node.orelse:
            lines += ["} else {", *self._inner(node.orelse)]
        return [*lines, "}"]

    def _for(self, node: ast.For) -> list[str]:
        call, target = node.iter, node.target
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"):
            raise refused(node)
        if not isinstance(target, ast.Name):
            raise refused(node)
        bounds = [expression(child, self.scope)[0] for child in call.args]
        start, stop = ("0", bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        down = len(bounds) == 3 and ast.unparse(call.args[2]) == "-1"
        if len(bounds) == 3 and not down:
            raise refused(node)
        dialect, counter = self.scope.dialect, self._temporary()
        named = (f"{dialect.name(target.id)} = {counter};",) if target.id in self.read else ()
        return self._block(dialect.counting(counter, start, stop, down), node.body, named)

    def _temporary(self) -> str:
        self.temporaries += 1
        return f"t{self.temporaries}_"

    def _returned(self, node: ast.Return) -> str:
        if node.value is None:
            raise refused(node)
        if isinstance(node.value, ast.Tuple) and isinstance(self.result, tuple):
            if len(node.value.elts) != len(self.result):
                raise refused(node)
            pairs = zip(node.value.elts, self.result, strict=True)
            return self.scope.dialect.make(self.result, [fitted(child, kind, self.scope) for child, kind in pairs])
        return fitted(node.value, self.result, self.scope)

    def _assign(self, target: ast.expr, value: ast.expr) -> list[str]:
        dialect = self.scope.dialect
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            # All of the right side first: the targets may be read there.
            held, lines = [], []
            for child in value.elts:
                text, kind = expression(child, self.scope)
                held.append((self._temporary(), kind))
                lines.append(f"{dialect.held(kind, held[-1][0], text)};")
            pairs = zip(target.elts, held, strict=True)
            return _apart([*lines, *(line for item, code in pairs for line in self._store(item, *code))])
        text, kind = expression(value, self.scope)
        if not isinstance(target, ast.Tuple):
            return self._store(target, text, kind)
        name = self._temporary()
        lines = [f"{dialect.held(kind, name, text)};"]
        for k, item in enumerate(target.elts):
            part = dialect.item.format(name, k) if isinstance(kind, tuple) else f"{name}[{k}]"
            lines += self._store(item, part, kind[k] if isinstance(kind, tuple) else "d")
        return _apart(lines)

    def _store(self, target: ast.expr, text: str, kind: Type) -> list[str]:
        dialect = self.scope.dialect
        if isinstance(target, ast.Name):
            if target.id not in self.read:
                return []
            wanted = self.scope.variables[target.id]
            return [f"{dialect.name(target.id)} = {dialect.fit(text, kind, wanted)};"]
        if isinstance(target, ast.Subscript):
            place, wanted = expression(target, self.scope)
            return [f"{place} = {dialect.fit(text, kind, wanted)};"]
        raise refused(target)


def _apart(lines: Iterable[str]) -> list[str]:
    """Lines whose variables are seen by nobody else."""
    return ["{", *(f"    {line}" for line in lines), "}"]
