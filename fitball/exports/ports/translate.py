"""The typed walk over syntax trees of kernels, the same for all languages of the C family.

Variables are declared at the top of their function, with inferred types. What has no translation is
refused.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping, Sequence
from textwrap import wrap
from typing import get_args

from fitball.exports.ports.dialects import Dialect
from fitball.exports.ports.source import (
    KernelSource,
    Type,
    UnportableError,
    fields_of,
    is_struct,
    origin_of,
    type_of,
)

# Operators of Python as they are written, before `Dialect.operators` changes them.
_SIGNS: Mapping[type[ast.AST], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.FloorDiv: "//",
    ast.Mod: "%",
    ast.BitOr: "|",
    ast.LShift: "<<",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.And: "&&",
    ast.Or: "||",
}
# Operators that only integers have.
_OF_INTEGERS = ("//", "%", "|", "<<")


def translated(source: KernelSource, name: str, dialect: Dialect) -> str:
    """One function of a source, in the language of a dialect.

    Raises:
        UnportableError: a construct has no translation (`no-port`).
    """
    return text_of(Walk(source, name, dialect))


def text_of(walk: Walk) -> str:
    """The text of the function that a walk goes over. Raises UnportableError."""
    source = walk.source
    dialect = walk.dialect
    name = walk.name
    walk.infer()
    function = source.functions[name]
    _, result = source.signatures[name]
    parameters = [argument.arg for argument in function.args.args]
    variables = sorted(walk.kinds.keys() - set(parameters) - walk.declared_by_loops())
    statements = [line for statement in walk.body for line in walk.statement(statement)]
    lines = [f"{walk.local(variable)}{dialect.stop}" for variable in variables]
    lines += walk.more_locals()
    if dialect.unread:
        unread = [parameter for parameter in parameters if parameter not in walk.read]
        lines += [dialect.unread.format(dialect.name(parameter)) for parameter in unread]
    lines += statements
    summary = (ast.get_docstring(function) or "").split("\n\n")[0]
    comment = " ".join(summary.split()).replace("*/", "* /")
    head = dialect.head.format(
        comment=f"\n{dialect.margin}".join(wrap(comment, 110)),
        declared=dialect.declared(result, dialect.function(name)),
        taken=", ".join(walk.taken()) or dialect.nothing,
        offered="" if name.endswith("_") else dialect.offered,
        how=dialect.expanded if name in source.expanded else dialect.called,
    )
    if dialect.empty and not lines:
        lines = [dialect.empty]
    return "\n".join([head, *(f"    {line}" for line in lines), dialect.block_end]).rstrip()


def _simple(body: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements in which each assignment has a single target. A tuple is stored in a variable of
    its own first if its targets are read in it.
    """
    for node in body:
        match node:
            case ast.AugAssign(target=ast.Name(id=name)):
                yield _stored(name, ast.BinOp(_read(name), node.op, node.value))
            case ast.Assign(targets=[ast.Name(id=first), ast.Name(id=other)]):
                yield _stored(other, node.value)
                yield _stored(first, _read(other))
            case ast.Assign(
                value=ast.IfExp(test=test, body=ast.Tuple(elts=yes), orelse=ast.Tuple(elts=no))
            ):
                choices: list[ast.expr] = list(map(ast.IfExp, [test] * len(yes), yes, no))
                yield from _simple([ast.Assign(node.targets, ast.Tuple(choices, ast.Load()))])
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Tuple(elts=values)):
                yield from _several(targets, values)
            case ast.Assign(targets=[ast.Tuple(elts=targets)]):
                yield from _unpacked(targets, node.value)
            case ast.If():
                yield ast.If(node.test, list(_simple(node.body)), list(_simple(node.orelse)))
            case ast.While(orelse=[]):
                yield ast.While(node.test, list(_simple(node.body)), [])
            case ast.For(orelse=[]):
                yield ast.For(node.target, node.iter, list(_simple(node.body)), [])
            case ast.Expr(value=ast.Constant()):
                continue
            case _:
                yield node


def _several(targets: Sequence[ast.expr], values: Sequence[ast.expr]) -> Iterator[ast.stmt]:
    """The assignments of `a, b = x, y`. Values are stored in other variables first if a target is
    read in them.
    """
    if _names(targets) & _names(values):
        held = [f"{ast.unparse(target)}_now" for target in targets]
        yield from map(_stored, held, values)
        values = [_read(name) for name in held]
    for target, value in zip(targets, values, strict=True):
        yield _stored(ast.unparse(target), value)


def _unpacked(targets: Sequence[ast.expr], value: ast.expr) -> Iterator[ast.stmt]:
    """The assignments of `a, b = f(x)`: the tuple is stored, and its fields are read."""
    names = [ast.unparse(target).strip("_") or "none" for target in targets]
    held = "_".join(["of", *names])
    yield _stored(held, value)
    for number, target in enumerate(targets):
        field = ast.Subscript(_read(held), ast.Constant(number), ast.Load())
        yield _stored(ast.unparse(target), field)


def _read(name: str) -> ast.Name:
    """A variable where it is read."""
    return ast.Name(name, ast.Load())


def _stored(name: str, value: ast.expr) -> ast.Assign:
    """The assignment of a value to a variable."""
    return ast.Assign([ast.Name(name, ast.Store())], value)


def stored_in(node: ast.AST) -> set[str]:
    """The variables that are assigned in a statement."""
    names = [inner for inner in ast.walk(node) if isinstance(inner, ast.Name)]
    return {name.id for name in names if isinstance(name.ctx, ast.Store)}


def _names(nodes: Iterable[ast.AST]) -> set[str]:
    """The names that stand in syntax trees."""
    return {node.id for top in nodes for node in ast.walk(top) if isinstance(node, ast.Name)}


def refused(node: ast.AST) -> UnportableError:
    """An error for a construct that has no translation, not yet raised."""
    text = ast.unparse(ast.fix_missing_locations(node))
    return UnportableError(f"no translation of: {text}")


class _UnknownYetError(UnportableError):
    """A variable is read whose type is not inferred yet."""


class Walk:
    """The walk over one function: `kinds` are the types of its parameters, then of its other
    variables too; `read` are the names that it reads.
    """

    def __init__(self, source: KernelSource, name: str, dialect: Dialect) -> None:
        self.source = source
        self.dialect = dialect
        self.name = name
        function = source.functions[name]
        kinds, self.result = source.signatures[name]
        parameters = [argument.arg for argument in function.args.args]
        self.kinds: dict[str, Type] = dict(zip(parameters, kinds, strict=True))
        self.body = list(_simple(function.body))
        names = [node for node in self.nodes() if isinstance(node, ast.Name)]
        self.read = {name.id for name in names if isinstance(name.ctx, ast.Load)}

    def nodes(self) -> Iterator[ast.AST]:
        """The nodes of all statements."""
        for statement in self.body:
            yield from ast.walk(statement)

    def local(self, variable: str) -> str:
        """The declaration of a variable at the top of the function."""
        return self.dialect.local(self.kinds[variable], variable)

    def more_locals(self) -> list[str]:
        """Declarations of variables that the function itself does not have, once it is walked."""
        return []

    def taken(self) -> list[str]:
        """What the function takes, as it is declared."""
        function = self.source.functions[self.name]
        parameters = [self.dialect.name(argument.arg) for argument in function.args.args]
        return list(map(self.dialect.declared, self.source.signatures[self.name][0], parameters))

    def made(self, _node: ast.expr, kind: Type, fields: Mapping[str, ast.expr]) -> str:
        """The text of a struct or tuple with these fields."""
        kinds = fields_of(kind)
        texts = [self.fitted(value, kinds[name]) for name, value in fields.items()]
        return self.dialect.make(kind, texts)

    def called_function(self, node: ast.Call, name: str) -> tuple[str, Type]:
        """Text and type of a call of a function of the source."""
        kinds, result = self.source.signatures[name]
        arguments = self.texts(node.args, kinds, node)
        return f"{self.dialect.function(name)}({', '.join(arguments)})", result

    def infer(self) -> None:
        """Find the types of the variables that are read: assignments are gone through until nothing
        changes. Raises UnportableError if a type is not found, or a parameter changes its type.
        """
        before = None
        waiting = ""
        while before != self.kinds:
            before = dict(self.kinds)
            waiting = ""
            for node in self.nodes():
                match node:
                    case ast.For(target=ast.Name(id=name)):
                        self.kinds[name] = int
                    case ast.Assign(targets=[ast.Name(id=name)], value=value) if name in self.read:
                        try:
                            kind = self.code(value)[1]
                        except _UnknownYetError as error:
                            waiting = str(error)
                        else:
                            self.kinds[name] = self.joined(self.kinds.get(name, kind), kind, value)
        wanted, _ = self.source.signatures[self.name]
        if waiting or tuple(self.kinds.values())[: len(wanted)] != wanted:
            raise UnportableError(f"{self.name}: {waiting or 'a parameter changes its type'}")

    def joined(self, first: Type, second: Type, node: ast.AST) -> Type:
        """The type that holds values of both types. Raises UnportableError when there is none."""
        if first == second:
            return first
        if {first, second} != {float, int}:
            raise refused(node)
        return float

    def fitted(self, node: ast.expr, wanted: Type) -> str:
        """The text of an expression where a value of the type `wanted` is needed. Raises
        UnportableError where the expression has another type.
        """
        text, kind = self.code(node)
        if self.joined(wanted, kind, node) != wanted:
            raise refused(node)
        return self.dialect.cast.format(text) if kind != wanted else text

    def code(self, node: ast.expr) -> tuple[str, Type]:
        """Text and type of an expression. Raises UnportableError for a construct that has no
        translation.
        """
        match node:
            case ast.Constant() | ast.Name():
                return self.leaf(node)
            case ast.BinOp() | ast.Compare() | ast.BoolOp():
                return self.operated(node)
            case ast.UnaryOp(op=ast.USub() | ast.Not()):
                text, kind = self.code(node.operand)
                if (kind is bool) == isinstance(node.op, ast.Not):
                    return f"({'!' if kind is bool else '-'}{text})", kind
            case ast.IfExp(test=test, body=yes, orelse=no):
                kind = self.joined(self.code(yes)[1], self.code(no)[1], node)
                text = self.dialect.choice.format(
                    test=self.fitted(test, bool),
                    yes=self.fitted(yes, kind),
                    no=self.fitted(no, kind),
                )
                return text, kind
            case ast.Attribute() | ast.Subscript():
                return self.field(node)
            case ast.Call():
                return self.called(node)
        raise refused(node)

    def leaf(self, node: ast.Constant | ast.Name) -> tuple[str, Type]:
        """Text and type of a truth value, a number, a variable or a constant of a module."""
        match node:
            case ast.Constant(value=bool() as truth):
                return ("true" if truth else "false"), bool
            case ast.Constant(value=int() | float() as number):
                return repr(number), type(number)
            case ast.Name(id=name) if name in self.kinds:
                return self.dialect.name(name), self.kinds[name]
            case ast.Name(id=name) if name in self.source.constants:
                return self.dialect.constant(name), type_of(self.source.constants[name])
            case ast.Name(id=name):
                raise _UnknownYetError(f"{name} is read before its type is known")
        raise refused(node)

    def field(self, node: ast.Attribute | ast.Subscript) -> tuple[str, Type]:
        """Text and type of `math.pi`, of a field of a named tuple or a tuple, of an item of a
        list.
        """
        match node:
            case ast.Attribute(value=ast.Name(id="math"), attr=name) if name in self.dialect.values:
                return self.dialect.values[name], float
            case ast.Attribute(value=value, attr=name):
                text, kind = self.code(value)
                if is_struct(kind) and name in fields_of(kind):
                    return f"{text}.{name}", fields_of(kind)[name]
            case ast.Subscript(value=value, slice=index):
                text, kind = self.code(value)
                if origin_of(kind) is list:
                    return f"{text}[{self.fitted(index, int)}]", get_args(kind)[0]
                field = f"f{ast.unparse(index)}"
                if origin_of(kind) is tuple and field in fields_of(kind):
                    return f"{text}.{field}", fields_of(kind)[field]
        raise refused(node)

    def operated(self, node: ast.BinOp | ast.Compare | ast.BoolOp) -> tuple[str, Type]:
        """Text and type of an operation: of numbers, of truth values, or comparisons in a chain."""
        if isinstance(node, ast.BoolOp):
            sign = f" {_SIGNS[type(node.op)]} "
            return f"({sign.join(self.fitted(value, bool) for value in node.values)})", bool
        if isinstance(node, ast.Compare):
            return self.compared(node), bool
        sign = _SIGNS.get(type(node.op), "")
        first, first_kind = self.code(node.left)
        second, second_kind = self.code(node.right)
        kind = self.joined(first_kind, second_kind, node)
        only_for_integers = sign in _OF_INTEGERS and kind is not int
        # Of integers `/` has another meaning in other languages.
        integers_divided = sign == "/" and kind is int
        if not sign or only_for_integers or integers_divided or kind is bool:
            raise refused(node)
        form = self.dialect.operators.get(sign, f"({{}} {sign} {{}})")
        return form.format(first, second), kind

    def compared(self, node: ast.Compare) -> str:
        """The text of a comparison, or of a chain of comparisons of numbers."""
        terms = [node.left, *node.comparators]
        codes = [self.code(term) for term in terms]
        # Terms in the middle are evaluated twice, which must not be a call.
        twice = [inner for term in terms[1:-1] for inner in ast.walk(term)]
        numbers = all(kind in (int, float) for _, kind in codes)
        if not numbers or any(isinstance(inner, ast.Call) for inner in twice):
            raise refused(node)
        links = []
        for operator, (first, _), (second, _) in zip(node.ops, codes, codes[1:], strict=False):
            links.append(f"({first} {_SIGNS[type(operator)]} {second})")
        return links[0] if len(links) == 1 else f"({' && '.join(links)})"

    def called(self, node: ast.Call) -> tuple[str, Type]:
        """Text and type of a call: of a function or of the class of a named tuple, or a named tuple
        with other fields.
        """
        d = self.dialect
        match node:
            case ast.Call(
                func=ast.Attribute(value=ast.Name(id="math"), attr=name), keywords=[]
            ) if name in d.math:
                arguments = [self.fitted(argument, float) for argument in node.args]
                return d.math[name].format(", ".join(arguments)), float
            case ast.Call(func=ast.Name(id="abs"), args=[value], keywords=[]):
                return d.math["fabs"].format(self.fitted(value, float)), float
            case ast.Call(func=ast.Name(id="int"), args=[value], keywords=[]):
                return d.truncate.format(self.fitted(value, float)), int
            case ast.Call(func=ast.Name(id=name), keywords=[]) if name in self.source.signatures:
                return self.called_function(node, name)
            case ast.Call():
                kind, fields = self.built(node)
                return self.made(node, kind, fields), kind
        raise refused(node)

    def built(self, node: ast.Call) -> tuple[Type, dict[str, ast.expr]]:
        """Type and fields of a named tuple that is made, or made of another one by `_replace`.
        Raises UnportableError for any other call.
        """
        match node:
            case ast.Call(func=ast.Attribute(value=ast.Name() as value, attr="_replace"), args=[]):
                kind = self.code(value)[1]
                changes = {keyword.arg: keyword.value for keyword in node.keywords}
                if changes.keys() <= fields_of(kind).keys():
                    same = {
                        name: ast.Attribute(value, name, ast.Load()) for name in fields_of(kind)
                    }
                    return kind, {**same, **{str(name): new for name, new in changes.items()}}
            case ast.Call(func=ast.Name(id=name), keywords=[]):
                for kind in self.source.compounds:
                    names = fields_of(kind)
                    if is_struct(kind) and kind.__name__ == name and len(names) == len(node.args):
                        return kind, dict(zip(names, node.args, strict=True))
        raise refused(node)

    def items(self, node: ast.Tuple) -> dict[str, ast.expr]:
        """The items of a tuple that is returned, by their fields. Raises UnportableError unless
        there are as many as the function says.
        """
        names = fields_of(self.result)
        if len(names) != len(node.elts):
            raise refused(node)
        return dict(zip(names, node.elts, strict=True))

    def texts(self, nodes: Sequence[ast.expr], wanted: Sequence[Type], node: ast.AST) -> list[str]:
        """Texts of expressions of the types `wanted`, which are parts of `node`. Raises
        UnportableError unless there are as many expressions as types.
        """
        if len(nodes) != len(wanted):
            raise refused(node)
        return [self.fitted(value, kind) for value, kind in zip(nodes, wanted, strict=True)]

    def statement(self, node: ast.stmt) -> list[str]:
        """The lines of a statement. Raises UnportableError for what has no translation."""
        d = self.dialect
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                if name not in self.read:
                    return []
                return [f"{d.name(name)} = {self.fitted(value, self.kinds[name])}{d.stop}"]
            case ast.Return(value=ast.Tuple() as value) if origin_of(self.result) is tuple:
                return [f"return {self.made(value, self.result, self.items(value))}{d.stop}"]
            case ast.Return(value=ast.expr() as value):
                return [f"return {self.fitted(value, self.result)}{d.stop}"]
            case ast.Break() | ast.Continue():
                return [f"{ast.unparse(node)}{d.stop}"]
            case ast.If(test=test, body=body, orelse=other):
                more = [d.block_else.format(), *self.inner(other)] if other else []
                begin = d.block_if.format(self.fitted(test, bool))
                return [begin, *self.inner(body), *more, *self.end()]
            case ast.While(test=test, body=body):
                begin = d.block_while.format(self.fitted(test, bool))
                return [begin, *self.inner(body), *self.end()]
            case ast.For(
                target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=bounds)
            ) if len(bounds) <= 2:
                assignments = [inner for inner in ast.walk(node) if isinstance(inner, ast.Assign)]
                stored = {ast.unparse(assignment.targets[0]) for assignment in assignments}
                # Other languages look at the end of the range before each turn.
                if _names(bounds) & stored or name in stored:
                    raise refused(node)
                first, end = ["0", *(self.fitted(bound, int) for bound in bounds)][-2:]
                begin = d.block_for.format(k=d.name(name), first=first, end=end)
                return [begin, *self.inner(node.body), *self.end()]
        raise refused(node)

    def inner(self, body: Iterable[ast.stmt]) -> list[str]:
        """The lines of a block, indented."""
        lines = [line for statement in body for line in self.statement(statement)]
        if self.dialect.empty and not lines:
            lines = [self.dialect.empty]
        return [f"    {line}" for line in lines]

    def end(self) -> list[str]:
        """The line that ends a block, if there is one."""
        return [self.dialect.block_end] if self.dialect.block_end else []

    def declared_by_loops(self) -> set[str]:
        """The variables that loops declare."""
        if not self.dialect.loop_declares:
            return set()
        loops = (node for node in self.nodes() if isinstance(node, ast.For))
        return {ast.unparse(loop.target) for loop in loops}
