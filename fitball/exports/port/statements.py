"""Kernels in another language, statement by statement; variables stand at the top of their function, with inferred
types.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from fitball.exports.port.dialect import Dialect
from fitball.exports.port.expressions import (
    Program,
    Scope,
    Signature,
    UnknownTypeError,
    expression,
    fitted,
    refused,
)
from fitball.exports.port.kernel_source import KernelSource, UnportableError, local_names
from fitball.exports.port.kinds import Structs, Type, annotated, joined, structs_of


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
    heads = [f"    {dialect.local(scope.variables[name], dialect.name(name))}{dialect.end}" for name in own]
    heads += [f"    {line}" for name in names if name not in read for line in dialect.unread(name)]
    taken = [(kind, dialect.name(name)) for kind, name in zip(kinds, names, strict=True)]
    comment = (ast.get_docstring(function) or "").split("\n\n")[0]
    head = dialect.define(comment, result, dialect.function(function.name), taken)
    return "\n".join([*head, *heads, *lines, *dialect.closing])


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
        end = self.scope.dialect.end
        match node:
            case ast.Assign():
                return self._assign(node.targets[0], node.value)
            case ast.AugAssign():
                return self._assign(node.target, _sum(node))
            case ast.Return():
                return [f"return {self._returned(node)}{end}"]
            case ast.Break():
                return [f"break{end}"]
            case ast.Continue():
                return [f"continue{end}"]
            case ast.Pass():
                return []
            case ast.Expr(value=ast.Call()):
                return [f"{expression(node.value, self.scope)[0]}{end}"]
            case ast.If():
                return self._if(node)
            case ast.While(orelse=[]):
                return self._block(self._condition("while", node.test), node.body)
            case ast.For(orelse=[]):
                return self._for(node)
        raise refused(node)

    def _block(self, head: str, body: list[ast.stmt], first: tuple[str, ...] = ()) -> list[str]:
        return [head, *self._inner(body, first), *self.scope.dialect.closing]

    def _inner(self, body: list[ast.stmt], first: tuple[str, ...] = ()) -> list[str]:
        lines = [*first, *(line for item in body for line in self.statement(item))]
        return [f"    {line}" for line in lines or self.scope.dialect.nothing]

    def _condition(self, word: str, node: ast.expr) -> str:
        text, kind = expression(node, self.scope)
        if kind != "b":
            raise refused(node)
        return self.scope.dialect.condition(word, text)

    def _if(self, node: ast.If) -> list[str]:
        lines = [self._condition("if", node.test), *self._inner(node.body)]
        if node.orelse:
            lines += [self.scope.dialect.otherwise, *self._inner(node.orelse)]
        return [*lines, *self.scope.dialect.closing]

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
        named = (f"{dialect.name(target.id)} = {counter}{dialect.end}",) if target.id in self.read else ()
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
                lines.append(f"{dialect.held(kind, held[-1][0], text)}{dialect.end}")
            pairs = zip(target.elts, held, strict=True)
            return dialect.together([*lines, *(line for item, code in pairs for line in self._store(item, *code))])
        text, kind = expression(value, self.scope)
        if not isinstance(target, ast.Tuple):
            return self._store(target, text, kind)
        name = self._temporary()
        lines = [f"{dialect.held(kind, name, text)}{dialect.end}"]
        for k, item in enumerate(target.elts):
            part = dialect.item(name, k) if isinstance(kind, tuple) else dialect.element(name, str(k))
            lines += self._store(item, part, kind[k] if isinstance(kind, tuple) else "d")
        return dialect.together(lines)

    def _store(self, target: ast.expr, text: str, kind: Type) -> list[str]:
        dialect = self.scope.dialect
        if isinstance(target, ast.Name):
            if target.id not in self.read:
                return []
            wanted = self.scope.variables[target.id]
            return [f"{dialect.name(target.id)} = {dialect.fit(text, kind, wanted)}{dialect.end}"]
        if isinstance(target, ast.Subscript):
            place, wanted = expression(target, self.scope)
            return [f"{place} = {dialect.fit(text, kind, wanted)}{dialect.end}"]
        raise refused(target)
