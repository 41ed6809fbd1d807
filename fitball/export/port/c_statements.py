"""Kernels in C99, statement by statement; variables stand at the top of their function, with inferred types."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from fitball.export.port.c_expressions import Scope, UnknownTypeError, expression, refused
from fitball.export.port.c_types import Structs, Type, annotated, c_type, declared, fields_of, joined
from fitball.export.port.kernel_source import Constant, UnportableError, local_names

Signature = tuple[tuple[Type, ...], Type]


def signature(function: ast.FunctionDef, structs: Structs) -> Signature:
    """Types of the parameters and of the result."""
    kinds = (annotated(argument.annotation, structs) for argument in function.args.args)
    return tuple(kinds), annotated(function.returns, structs)


def c_function(
    function: ast.FunctionDef,
    signatures: Mapping[str, Signature],
    constants: Mapping[str, Constant],
    structs: Structs,
    prefix: str,
) -> str:
    """One kernel as a `static inline` function. Raises UnportableError for what has no translation."""
    kinds, result = signatures[function.name]
    scope = Scope(signatures, constants, structs, prefix)
    names = [argument.arg for argument in function.args.args]
    scope.variables.update(zip(names, kinds, strict=True))
    _infer(function, scope)
    body = _Body(scope, result, _read_names(function))
    statements = function.body[1:] if ast.get_docstring(function) else function.body
    lines = [line for item in statements for line in body.statement(item, 1)]
    own = sorted(scope.variables.keys() - set(names) - body.unread(scope))
    heads = [f"    {_initialised(scope.variables[name], name, prefix)};" for name in own]
    heads += [f"    (void){name};" for name in names if name not in body.read]
    listed = ", ".join(declared(kind, name, prefix) for kind, name in zip(kinds, names, strict=True))
    comment = (ast.get_docstring(function) or "").split("\n\n")[0].replace("\n", "\n   ")
    return "\n".join(
        [
            f"/* {comment} */",
            f"static inline {declared(result, f'{prefix}{function.name}', prefix)}({listed})",
            "{",
            *heads,
            *lines,
            "}",
        ]
    )


def _initialised(kind: Type, name: str, prefix: str) -> str:
    held = fields_of(kind)
    # What follows a first zero is zero too; of structs within structs compilers want to see it.
    short = held and isinstance(held[0][1], str)
    return f"{declared(kind, name, prefix)} = {'{0}' if short else _zero(kind)}"


def _zero(kind: Type) -> str:
    if isinstance(kind, str):
        return {"b": "false", "i": "0", "d": "0.0", "z": "0.0"}.get(kind, "NULL")
    return f"{{{', '.join(_zero(item) for _name, item in fields_of(kind))}}}"


def _read_names(function: ast.FunctionDef) -> set[str]:
    return {node.id for node in ast.walk(function) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}


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

    def unread(self, scope: Scope) -> set[str]:
        return scope.variables.keys() - self.read

    def statement(self, node: ast.stmt, depth: int) -> list[str]:
        pad = "    " * depth
        match node:
            case ast.Assign():
                return [pad + line for line in self._assign(node.targets[0], node.value)]
            case ast.AugAssign():
                return [pad + line for line in self._assign(node.target, _sum(node))]
            case ast.Return():
                return [f"{pad}return {self._returned(node)};"]
            case ast.Break():
                return [f"{pad}break;"]
            case ast.Continue():
                return [f"{pad}continue;"]
            case ast.Pass():
                return []
            case ast.Expr(value=ast.Call()):
                return [f"{pad}{expression(node.value, self.scope)[0]};"]
            case ast.If():
                return self._if(node, depth)
            case ast.While(orelse=[]):
                return [f"{pad}while ({self._test(node.test)}) {{", *self._block(node.body, depth), f"{pad}}}"]
            case ast.For(orelse=[]):
                return self._for(node, depth)
        raise refused(node)

    def _block(self, body: list[ast.stmt], depth: int) -> list[str]:
        return [line for item in body for line in self.statement(item, depth + 1)]

    def _test(self, node: ast.expr) -> str:
        text, kind = expression(node, self.scope)
        if kind != "b":
            raise refused(node)
        return text

    def _if(self, node: ast.If, depth: int) -> list[str]:
        pad = "    " * depth
        lines = [f"{pad}if ({self._test(node.test)}) {{", *self._block(node.body, depth)]
        if node.orelse:
            lines += [f"{pad}}} else {{", *self._block(node.orelse, depth)]
        return [*lines, f"{pad}}}"]

    def _for(self, node: ast.For, depth: int) -> list[str]:
        pad = "    " * depth
        call = node.iter
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"):
            raise refused(node)
        if not isinstance(node.target, ast.Name):
            raise refused(node)
        bounds = [expression(child, self.scope)[0] for child in call.args]
        start, stop = ("0", bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        down = len(bounds) == 3 and bounds[2] == "(-1)"
        if len(bounds) == 3 and not down:
            raise refused(node)
        counter, end = self._temporary(), self._temporary()
        head = f"for (int64_t {counter} = {start}, {end} = {stop}; {counter} {'>' if down else '<'} {end}; "
        lines = [f"{pad}{head}{'--' if down else '++'}{counter}) {{"]
        if node.target.id in self.read:
            lines.append(f"{pad}    {node.target.id} = {counter};")
        return [*lines, *self._block(node.body, depth), f"{pad}}}"]

    def _temporary(self) -> str:
        self.temporaries += 1
        return f"t{self.temporaries}_"

    def _returned(self, node: ast.Return) -> str:
        if node.value is None:
            raise refused(node)
        if isinstance(node.value, ast.Tuple) and isinstance(self.result, tuple):
            codes = [expression(child, self.scope) for child in node.value.elts]
            if len(codes) != len(self.result):
                raise refused(node)
            for (_text, kind), wanted in zip(codes, self.result, strict=True):
                if joined(wanted, kind) != wanted:
                    raise refused(node)
            return f"({c_type(self.result, self.scope.prefix)}){{{', '.join(text for text, _ in codes)}}}"
        text, kind = expression(node.value, self.scope)
        if joined(self.result, kind) != self.result:
            raise refused(node)
        return text

    def _assign(self, target: ast.expr, value: ast.expr) -> list[str]:
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            # All of the right side first: the targets may be read there.
            held, lines = [], []
            for child in value.elts:
                text, kind = expression(child, self.scope)
                held.append(self._temporary())
                lines.append(f"const {declared(kind, held[-1], self.scope.prefix)} = {text};")
            stores = [line for item, name in zip(target.elts, held, strict=True) for line in self._store(item, name)]
            return ["{", *(f"    {line}" for line in [*lines, *stores]), "}"]
        text, kind = expression(value, self.scope)
        if not isinstance(target, ast.Tuple):
            return self._store(target, text)
        name = self._temporary()
        parts = [f"{name}[{k}]" if kind == "A" else f"{name}.f{k}" for k in range(len(target.elts))]
        stores = [line for item, part in zip(target.elts, parts, strict=True) for line in self._store(item, part)]
        return [
            "{",
            f"    const {declared(kind, name, self.scope.prefix)} = {text};",
            *(f"    {s}" for s in stores),
            "}",
        ]

    def _store(self, target: ast.expr, text: str) -> list[str]:
        if isinstance(target, ast.Name):
            return [f"{target.id} = {text};"] if target.id in self.read else []
        if isinstance(target, ast.Subscript):
            return [f"{expression(target, self.scope)[0]} = {text};"]
        raise refused(target)
