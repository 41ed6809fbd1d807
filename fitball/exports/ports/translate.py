"""The typed walk over the trees, the same for all languages of the C family: variables are declared
at the top of their function, with inferred types, and what has no translation is refused.
"""

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
_WHOLE = ("//", "%", "|", "<<")


def translated(source: KernelSource, name: str, dialect: Dialect) -> str:
    """One function in a language. Raises UnportableError for what has no translation."""
    walk = _Walk(source, name, dialect)
    walk.infer()
    function = source.functions[name]
    kinds, result = source.signatures[name]
    names = [argument.arg for argument in function.args.args]
    lines = [
        *(
            f"{dialect.local(walk.kinds[own], own)};"
            for own in sorted(walk.kinds.keys() - set(names))
        ),
        *(
            dialect.unread.format(dialect.name(own))
            for own in names
            if own not in walk.read and dialect.unread
        ),
        *(line for item in walk.body for line in walk.statement(item)),
    ]
    taken = ", ".join(
        dialect.declared(kind, dialect.name(own)) for kind, own in zip(kinds, names, strict=True)
    )
    comment = " ".join((ast.get_docstring(function) or "").split("\n\n")[0].split())
    head = dialect.head.format(
        comment="\n   ".join(wrap(comment.replace("*/", "* /"), 110)),
        declared=dialect.declared(result, dialect.function(name)),
        taken=taken or dialect.nothing,
        offered="" if name.endswith("_") else dialect.offered,
    )
    return "\n".join([head, *(f"    {line}" for line in lines), "}"])


def _simple(body: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements with one target an assignment; a tuple is held first if what is stored is read in
    it.
    """
    for node in body:
        match node:
            case ast.AugAssign(target=ast.Name(id=name)):
                yield _stored(name, ast.BinOp(ast.Name(name, ast.Load()), node.op, node.value))
            case ast.Assign(targets=[ast.Name(id=first), ast.Name(id=other)]):
                yield _stored(other, node.value)
                yield _stored(first, ast.Name(other, ast.Load()))
            case ast.Assign(
                value=ast.IfExp(test=test, body=ast.Tuple(elts=ones), orelse=ast.Tuple(elts=others))
            ):
                parts: list[ast.expr] = list(map(ast.IfExp, [test] * len(ones), ones, others))
                yield from _simple([ast.Assign(node.targets, ast.Tuple(parts, ast.Load()))])
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
    """The assignments of `a, b = x, y`; values are held first if a target is read in them."""
    if _names(targets) & _names(values):
        held = [f"{ast.unparse(target)}_now" for target in targets]
        yield from map(_stored, held, values)
        values = [ast.Name(name, ast.Load()) for name in held]
    for target, value in zip(targets, values, strict=True):
        yield _stored(ast.unparse(target), value)


def _unpacked(targets: Sequence[ast.expr], value: ast.expr) -> Iterator[ast.stmt]:
    """The assignments of `a, b = f(x)`: the tuple is held, and its fields are taken."""
    names = [ast.unparse(target).strip("_") or "none" for target in targets]
    held = "_".join(["of", *names])
    yield _stored(held, value)
    for place, target in enumerate(targets):
        field = ast.Subscript(ast.Name(held, ast.Load()), ast.Constant(place), ast.Load())
        yield _stored(ast.unparse(target), field)


def _stored(name: str, value: ast.expr) -> ast.Assign:
    return ast.Assign([ast.Name(name, ast.Store())], value)


def _names(nodes: Iterable[ast.AST]) -> set[str]:
    return {node.id for top in nodes for node in ast.walk(top) if isinstance(node, ast.Name)}


def _refused(node: ast.AST) -> UnportableError:
    return UnportableError(f"no translation of: {ast.unparse(ast.fix_missing_locations(node))}")


class _UnknownYetError(UnportableError):
    """A variable is read whose type is not inferred yet."""


class _Walk:
    """The walk over one function: `kinds` are the types of its parameters, then of its locals
    too.
    """

    def __init__(self, source: KernelSource, name: str, dialect: Dialect) -> None:
        self.all = source
        self.dialect = dialect
        self.of = name
        function = source.functions[name]
        kinds, self.result = source.signatures[name]
        self.kinds: dict[str, Type] = dict(
            zip((item.arg for item in function.args.args), kinds, strict=True)
        )
        self.body = list(_simple(function.body))
        nodes = [
            node for item in self.body for node in ast.walk(item) if isinstance(node, ast.Name)
        ]
        self.read = {node.id for node in nodes if isinstance(node.ctx, ast.Load)}

    def infer(self) -> None:
        """Fill in the types of the locals that are read: assignments are gone through until nothing
        changes.
        """
        before = None
        waiting = ""
        while before != self.kinds:
            before = dict(self.kinds)
            waiting = ""
            for node in (part for item in self.body for part in ast.walk(item)):
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
        wanted, _ = self.all.signatures[self.of]
        if waiting or tuple(self.kinds.values())[: len(wanted)] != wanted:
            raise UnportableError(f"{self.of}: {waiting or 'a parameter changes its type'}")

    def joined(self, one: Type, other: Type, node: ast.AST) -> Type:
        """The type that holds values of both. Raises UnportableError when there is none."""
        if one != other and {one, other} != {float, int}:
            raise _refused(node)
        return one if one == other else float

    def fitted(self, node: ast.expr, wanted: Type) -> str:
        """The text of an expression where `wanted` is held."""
        text, kind = self.code(node)
        if self.joined(wanted, kind, node) != wanted:
            raise _refused(node)
        return self.dialect.cast.format(text) if kind != wanted else text

    def code(self, node: ast.expr) -> tuple[str, Type]:
        """Text and type of an expression. Raises UnportableError for a construct that is not
        known.
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
            case ast.IfExp(test=test, body=one, orelse=other):
                kind = self.joined(self.code(one)[1], self.code(other)[1], node)
                return (
                    f"({self.fitted(test, bool)} ? {self.fitted(one, kind)} : "
                    f"{self.fitted(other, kind)})",
                    kind,
                )
            case ast.Attribute() | ast.Subscript():
                return self.field(node)
            case ast.Call():
                return self.called(node)
        raise _refused(node)

    def leaf(self, node: ast.Constant | ast.Name) -> tuple[str, Type]:
        """Text and type of a truth value, a number, a variable or a constant of a module."""
        match node:
            case ast.Constant(value=bool() as truth):
                return ("true" if truth else "false"), bool
            case ast.Constant(value=int() | float() as number):
                return repr(number), type(number)
            case ast.Name(id=name) if name in self.kinds:
                return self.dialect.name(name), self.kinds[name]
            case ast.Name(id=name) if name in self.all.constants:
                return self.dialect.constant(name), type_of(self.all.constants[name])
            case ast.Name(id=name):
                raise _UnknownYetError(f"{name} is read before its type is known")
        raise _refused(node)

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
            case ast.Subscript(value=value, slice=place):
                text, kind = self.code(value)
                if origin_of(kind) is list:
                    return f"{text}[{self.fitted(place, int)}]", get_args(kind)[0]
                field = f"f{ast.unparse(place)}"
                if origin_of(kind) is tuple and field in fields_of(kind):
                    return f"{text}.{field}", fields_of(kind)[field]
        raise _refused(node)

    def operated(self, node: ast.BinOp | ast.Compare | ast.BoolOp) -> tuple[str, Type]:
        """Operators: of numbers, comparisons in a chain, truth values."""
        d = self.dialect
        if isinstance(node, ast.BoolOp):
            sign = f" {_SIGNS[type(node.op)]} "
            return f"({sign.join(self.fitted(item, bool) for item in node.values)})", bool
        if isinstance(node, ast.Compare):
            terms = [node.left, *node.comparators]
            codes = [self.code(term) for term in terms]
            # What stands in the middle would be evaluated twice.
            if any(
                isinstance(part, ast.Call) for term in terms[1:-1] for part in ast.walk(term)
            ) or not all(kind in (int, float) for _, kind in codes):
                raise _refused(node)
            steps = zip(codes, node.ops, codes[1:], strict=False)
            links = [f"({left} {_SIGNS[type(op)]} {right})" for (left, _), op, (right, _) in steps]
            return links[0] if len(links) == 1 else f"({' && '.join(links)})", bool
        sign = _SIGNS.get(type(node.op), "")
        left, one = self.code(node.left)
        right, other = self.code(node.right)
        kind = self.joined(one, other, node)
        # The quotient of whole numbers is none.
        if (
            not sign
            or (sign in _WHOLE and kind is not int)
            or (sign == "/" and kind is int)
            or kind is bool
        ):
            raise _refused(node)
        return d.operators.get(sign, f"({{}} {sign} {{}})").format(left, right), kind

    def called(self, node: ast.Call) -> tuple[str, Type]:
        """Functions, and named tuples made or made anew with other fields."""
        d = self.dialect
        match node:
            case ast.Call(
                func=ast.Attribute(value=ast.Name(id="math"), attr=name), keywords=[]
            ) if name in d.math:
                return d.math[name].format(
                    ", ".join(self.fitted(item, float) for item in node.args)
                ), float
            case ast.Call(func=ast.Name(id="abs"), args=[value], keywords=[]):
                return d.math["fabs"].format(self.fitted(value, float)), float
            case ast.Call(func=ast.Name(id="int"), args=[value], keywords=[]):
                return d.whole.format(self.fitted(value, float)), int
            case ast.Call(func=ast.Attribute(value=ast.Name() as value, attr="_replace"), args=[]):
                text, kind = self.code(value)
                changed = {item.arg: item.value for item in node.keywords}
                items = [
                    self.fitted(changed.pop(field), item) if field in changed else f"{text}.{field}"
                    for field, item in fields_of(kind).items()
                ]
                if not changed:
                    return d.make(kind, items), kind
            case ast.Call(func=ast.Name(id=name), keywords=[]) if name in self.all.signatures:
                wanted, result = self.all.signatures[name]
                return (
                    f"{d.function(name)}({', '.join(self.items(node.args, wanted, node))})",
                    result,
                )
            case ast.Call(func=ast.Name(id=name), keywords=[]):
                for kind in self.all.compounds:
                    if is_struct(kind) and kind.__name__ == name:
                        return d.make(
                            kind,
                            self.items(node.args, list(fields_of(kind).values()), node),
                        ), kind
        raise _refused(node)

    def items(self, nodes: Sequence[ast.expr], wanted: Sequence[Type], node: ast.AST) -> list[str]:
        """Texts of as many expressions as are wanted."""
        if len(nodes) != len(wanted):
            raise _refused(node)
        return [self.fitted(item, kind) for item, kind in zip(nodes, wanted, strict=True)]

    def statement(self, node: ast.stmt) -> list[str]:
        """The lines of a statement."""
        d = self.dialect
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                return (
                    [f"{d.name(name)} = {self.fitted(value, self.kinds[name])};"]
                    if name in self.read
                    else []
                )
            case ast.Return(value=ast.Tuple(elts=items)) if origin_of(self.result) is tuple:
                return [
                    f"return {d.make(self.result, self.items(items, get_args(self.result), node))};"
                ]
            case ast.Return(value=ast.expr() as value):
                return [f"return {self.fitted(value, self.result)};"]
            case ast.Break() | ast.Continue():
                return [f"{ast.unparse(node)};"]
            case ast.If(test=test, body=body, orelse=other):
                more = ["} else {", *self.inner(other)] if other else []
                return [f"if ({self.fitted(test, bool)}) {{", *self.inner(body), *more, "}"]
            case ast.While(test=test, body=body):
                return [f"while ({self.fitted(test, bool)}) {{", *self.inner(body), "}"]
            case ast.For(
                target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=bounds)
            ) if len(bounds) <= 2:
                stored = {
                    ast.unparse(part.targets[0])
                    for part in ast.walk(node)
                    if isinstance(part, ast.Assign)
                }
                # The end of the range is looked at in each turn.
                if _names(bounds) & stored or name in stored:
                    raise _refused(node)
                first, end = ["0", *(self.fitted(bound, int) for bound in bounds)][-2:]
                own = d.name(name)
                return [
                    f"for ({own} = {first}; {own} < {end}; {own} = {own} + 1) {{",
                    *self.inner(node.body),
                    "}",
                ]
        raise _refused(node)

    def inner(self, body: Iterable[ast.stmt]) -> list[str]:
        """The lines of a block."""
        return [f"    {line}" for item in body for line in self.statement(item)]
