"""Kernels in another language: the types of their restricted Python, and a walk over their syntax trees that is the
same for all dialects. What is not known here is refused: no port can drift in silence. Variables are declared at the
top of their function, with inferred types.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fitball.exports.port.kernel_source import Constant, KernelSource, UnportableError, local_names

if TYPE_CHECKING:
    from fitball.exports.port.languages import Dialect


@dataclass(frozen=True)
class Struct:
    """A named tuple: a struct with fields of the same names."""

    name: str
    fields: tuple[tuple[str, Type], ...]


# d double, i integer, b truth value, z complex, A array of double, I array of integers, S array of double with two
# indices (rows of STRIDE), v nothing; a Python tuple of these is a struct with fields f0, f1, ...
Type = str | tuple["Type", ...] | Struct
Structs = Mapping[str, Struct]
Code = tuple[str, Type]
Signature = tuple[tuple[Type, ...], Type]

STRIDE = 5
_NAMES: dict[str, Type] = {
    "float": "d", "Number": "d", "int": "i", "bool": "b", "complex": "z",
    "FloatArray": "A", "NumberArray": "A", "Ints": "I", "Stack": "S",
}  # fmt: skip
_ARITHMETIC: Mapping[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_BITS: Mapping[type[ast.operator], str] = {ast.BitOr: "|", ast.BitAnd: "&", ast.LShift: "<<"}
_COMPARE: Mapping[type[ast.cmpop], str] = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
_TESTS = ("isnan", "isfinite")


def annotated(node: ast.expr | None, structs: Structs) -> Type:
    """The type an annotation names. Raises UnportableError for one that kernels are not known to use."""
    known = {**_NAMES, **structs}
    match node:
        case ast.Constant(value=None):
            return "v"
        case ast.Name(id=name) if name in known:
            return known[name]
        case ast.Subscript(value=ast.Name(id="tuple"), slice=ast.Tuple(elts=items)):
            return tuple(annotated(child, structs) for child in items)
        case ast.Subscript(value=ast.Name(id=name)) if name in structs:
            return structs[name]
        case ast.Subscript(value=ast.Name(id="NDArray")) if "int64" in ast.unparse(node.slice):
            return "I"
    raise UnportableError(f"annotation {'missing' if node is None else ast.unparse(node)}: no type is known for it")


def joined(one: Type, other: Type) -> Type:
    """The type that holds values of both. Raises UnportableError when there is none."""
    if one == other:
        return one
    for wide, narrow in (("d", "i"), ("z", "d"), ("z", "i")):
        if {one, other} == {wide, narrow}:
            return wide
    raise UnportableError(f"no type holds both {one} and {other}")


def fields_of(kind: Type) -> tuple[tuple[str, Type], ...]:
    """Names and types of what a struct holds; of anything else, nothing."""
    if isinstance(kind, Struct):
        return kind.fields
    return tuple((f"f{k}", item) for k, item in enumerate(kind)) if isinstance(kind, tuple) else ()


def compound(kinds: Iterable[Type]) -> list[Type]:
    """The structs and tuples among `kinds`, and those that these hold, inner ones first, each once."""
    found: dict[Type, None] = {}
    for kind in kinds:
        if not isinstance(kind, str):
            found |= dict.fromkeys([*compound(item for _name, item in fields_of(kind)), kind])
    return list(found)


def type_name(kind: Type) -> str:
    """A name for a struct or a tuple; of a tuple, the letters of what it holds."""
    if isinstance(kind, Struct):
        return kind.name
    return kind.lower() if isinstance(kind, str) else "t" + "".join(map(type_name, kind)) + "_"


@dataclass(frozen=True)
class Program:
    """What all functions of a port share: their signatures, module constants, structs, and the language."""

    signatures: Mapping[str, Signature]
    constants: Mapping[str, Constant]
    structs: Structs
    dialect: Dialect

    @classmethod
    def from_source(cls, source: KernelSource, dialect: Dialect) -> Program:
        """A source in a language. Raises UnportableError."""
        structs: dict[str, Struct] = {}
        for name, given in source.structs.items():
            structs[name] = Struct(name, tuple((item, annotated(node, structs)) for item, node in given.items()))
        return cls(signatures(source.functions, structs), source.constants, structs, dialect)

    @property
    def kinds(self) -> list[Type]:
        """The types of structs, and of what functions take and give."""
        return [
            *self.structs.values(),
            *(kind for taken, result in self.signatures.values() for kind in (*taken, result)),
        ]


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
    names = [argument.arg for argument in function.args.args]
    read = {node.id for node in ast.walk(function) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
    walk = _Walk(program, result, read, dict(zip(names, kinds, strict=True)))
    walk.infer(function)
    statements = function.body[1:] if ast.get_docstring(function) else function.body
    lines = [f"    {line}" for item in statements for line in walk.statement(item)]
    own = sorted((walk.variables.keys() & read) - set(names))
    heads = [f"    {dialect.local(walk.variables[name], dialect.name(name))};" for name in own]
    heads += [f"    {dialect.unread.format(name)}" for name in names if name not in read and dialect.unread]
    taken = [dialect.declared(kind, dialect.name(name)) for kind, name in zip(kinds, names, strict=True)]
    head = dialect.head.format(
        comment=(ast.get_docstring(function) or "").split("\n\n")[0].replace("\n", dialect.comment),
        declared=dialect.declared(result, dialect.function(function.name)),
        taken=", ".join(taken),
    )
    return "\n".join([head, *heads, *lines, "}"])


class UnknownTypeError(UnportableError):
    """A variable is read whose type is not inferred yet."""


def refused(node: ast.AST) -> UnportableError:
    """The error for a construct without a translation."""
    return UnportableError(f"no translation of: {ast.unparse(node)}")


@dataclass
class _Walk:
    """The walk over one function, whose result is of type `result`: `read` are the names whose value is used,
    `variables` the types of its parameters, then of its locals too.
    """

    program: Program
    result: Type
    read: set[str]
    variables: dict[str, Type]
    temporaries: int = field(default=0)

    @property
    def dialect(self) -> Dialect:
        """The language."""
        return self.program.dialect

    def infer(self, function: ast.FunctionDef) -> None:
        """Fill in the types of the locals: assignments are gone through until nothing changes."""
        waiting: list[str] = []
        for _ in range(20):
            before, waiting = dict(self.variables), []
            for node in ast.walk(function):
                for target, value in _assignments(node):
                    try:
                        self._note(target, self.code(value)[1])
                    except UnknownTypeError as error:
                        waiting.append(str(error))
            if self.variables == before:
                break
        missing = local_names(function) - self.variables.keys() - {"_"}
        if waiting or missing:
            raise UnportableError(f"{function.name}: no type found of {', '.join(sorted(missing)) or waiting[0]}")

    def _note(self, target: ast.expr, kind: Type) -> None:
        if isinstance(target, ast.Name):
            known = self.variables.get(target.id)
            self.variables[target.id] = kind if known is None else joined(known, kind)
        elif isinstance(target, ast.Tuple):
            parts = ("d",) * len(target.elts) if kind == "A" else kind
            if not isinstance(parts, tuple) or len(parts) != len(target.elts):
                raise refused(target)
            for item, part in zip(target.elts, parts, strict=True):
                self._note(item, part)
        elif not isinstance(target, ast.Subscript):
            raise refused(target)

    def code(self, node: ast.expr) -> Code:
        """Text and type of an expression. Raises UnportableError for a construct that is not known."""
        dialect, program = self.dialect, self.program
        kind: Type
        match node:
            case ast.Constant(value=bool() | int() | float() as value):
                kind = "b" if isinstance(value, bool) else "d" if isinstance(value, float) else "i"
                return dialect.number(value), kind
            case ast.Name(id=name) if name in self.variables:
                return dialect.name(name), self.variables[name]
            case ast.Name(id=name) if name in program.constants:
                return dialect.constant(name), self._kind_of(program.constants[name])
            case ast.Name(id=name):
                raise UnknownTypeError(f"{name} is read before its type is known")
            case ast.BinOp():
                return self._binary(node)
            case ast.Compare():
                return self._compare(node)
            case ast.UnaryOp(op=ast.USub() | ast.Not()):
                text, kind = self.code(node.operand)
                if isinstance(node.op, ast.USub) and kind in ("d", "i", "z"):
                    return dialect.negative(text, kind), kind
                if isinstance(node.op, ast.Not) and kind == "b":
                    return f"(!{text})", "b"
            case ast.BoolOp(values=values):
                # Python returns an operand, others a truth value: they agree for truth values only.
                texts, kinds = self._codes(values)
                if set(kinds) == {"b"}:
                    return f"({(' && ' if isinstance(node.op, ast.And) else ' || ').join(texts)})", "b"
            case ast.IfExp():
                (test, *_), (truth, one, other) = self._codes([node.test, node.body, node.orelse])
                if truth == "b":
                    wide = joined(one, other)
                    return f"({test} ? {self.fitted(node.body, wide)} : {self.fitted(node.orelse, wide)})", wide
            case ast.Attribute(value=ast.Name(id="math"), attr=name) if name in dialect.values:
                return dialect.values[name], "d"
            case ast.Attribute(value=value, attr=name):
                text, kind = self.code(value)
                held = dict(kind.fields).get(name) if isinstance(kind, Struct) else None
                if held is not None:
                    return f"{text}.{dialect.name(name)}", held
                if kind == "z" and name in ("real", "imag"):
                    return (dialect.real if name == "real" else dialect.imaginary).format(text), "d"
                if kind == "d" and name == "real":
                    return text, "d"
            case ast.Subscript():
                return self._subscript(node)
            case ast.Tuple(elts=items):
                texts, kinds = self._codes(items)
                return dialect.make(tuple(kinds), texts), tuple(kinds)
            case ast.Call(func=ast.Attribute(value=ast.Name(id="math"), attr=name), keywords=[]) if (
                name in dialect.math
            ):
                texts, kinds = self._codes(node.args)
                if kinds == ["d"] if name in _TESTS else set(kinds) <= {"d", "i"}:
                    return dialect.math[name].format(", ".join(texts)), "b" if name in _TESTS else "d"
            case ast.Call(func=ast.Name(id=name), keywords=[]) if name in program.structs:
                made = program.structs[name]
                return dialect.make(made, self._arguments(node, [kind for _field, kind in made.fields])), made
            case ast.Call(func=ast.Name(id=name), keywords=[]) if name in program.signatures:
                wanted, result = program.signatures[name]
                return f"{dialect.function(name)}({', '.join(self._arguments(node, wanted))})", result
            case ast.Call(func=ast.Name(id=name), keywords=[]):
                return self._builtin(node, name)
        raise refused(node)

    def _codes(self, nodes: Iterable[ast.expr]) -> tuple[list[str], list[Type]]:
        codes = [self.code(node) for node in nodes]
        return [text for text, _kind in codes], [kind for _text, kind in codes]

    def fitted(self, node: ast.expr, wanted: Type) -> str:
        """The text of an expression where `wanted` is held. Raises UnportableError where it would not fit."""
        text, kind = self.code(node)
        if joined(wanted, kind) != wanted:
            raise refused(node)
        return self.dialect.fit(text, kind, wanted)

    def _kind_of(self, value: Constant) -> Type:
        if isinstance(value, tuple):
            return self.program.structs[type(value).__name__]
        return "d" if isinstance(value, float) else "i"

    def _binary(self, node: ast.BinOp) -> Code:
        (left, right), (kind, other) = self._codes([node.left, node.right])
        operator = type(node.op)
        if operator in _BITS and kind == other == "i":
            return self.dialect.bits[_BITS[operator]].format(left, right), "i"
        if operator is ast.Pow and isinstance(node.left, ast.Name) and isinstance(node.right, ast.Constant):
            power = node.right.value
            if isinstance(power, int) and 2 <= power <= 8 and kind in ("d", "i"):
                return f"({' * '.join([left] * power)})", kind
        if operator not in _ARITHMETIC or not {kind, other} <= {"d", "i", "z"}:
            raise refused(node)
        wide = "d" if operator is ast.Div and kind == other == "i" else joined(kind, other)
        return self.dialect.binary(_ARITHMETIC[operator], (left, kind), (right, other), wide), wide

    def _compare(self, node: ast.Compare) -> Code:
        terms = [node.left, *node.comparators]
        # What stands in the middle would be evaluated twice.
        twice = any(isinstance(part, ast.Call) for term in terms[1:-1] for part in ast.walk(term))
        signs = {**_COMPARE, ast.Eq: self.dialect.same, ast.NotEq: self.dialect.other}
        texts, kinds = self._codes(terms)
        if twice or not set(kinds) <= {"d", "i"} or any(type(op) not in signs for op in node.ops):
            raise refused(node)
        pairs = zip(texts, node.ops, texts[1:], strict=False)
        links = [f"({left} {signs[type(op)]} {right})" for left, op, right in pairs]
        return (links[0] if len(links) == 1 else f"({' && '.join(links)})"), "b"

    def _subscript(self, node: ast.Subscript) -> Code:
        text, kind = self.code(node.value)
        match node.slice:
            case ast.Constant(value=int() as place) if isinstance(kind, tuple):
                return self.dialect.element.format(text, place), kind[place]
            case ast.Tuple(elts=[_, _] as places) if kind == "S":
                (row, column), kinds = self._codes(places)
                if kinds == ["i", "i"]:
                    return f"{text}[{STRIDE} * {row} + {column}]", "d"
            case place if kind in ("A", "I"):
                index, whole = self.code(place)
                if whole == "i":
                    return f"{text}[{index}]", "d" if kind == "A" else "i"
        raise refused(node)

    def _arguments(self, node: ast.Call, wanted: Sequence[Type]) -> list[str]:
        if len(wanted) != len(node.args):
            raise refused(node)
        return [self.fitted(child, kind) for child, kind in zip(node.args, wanted, strict=True)]

    def _builtin(self, node: ast.Call, name: str) -> Code:
        dialect, (texts, kinds) = self.dialect, self._codes(node.args)
        numbers = len(kinds) == 2 and set(kinds) <= {"d", "i"}
        if name == "abs" and kinds == ["d"]:
            return dialect.math["fabs"].format(texts[0]), "d"
        if name == "int" and kinds == ["d"]:
            return dialect.whole.format(texts[0]), "i"
        if name in ("min", "max") and numbers:
            kind = joined(*kinds)
            helper = f"{name}_{'whole' if kind == 'i' else 'real'}"
            return f"{dialect.function(helper)}({', '.join(texts)})", kind
        if name == "complex" and numbers:
            return f"{dialect.function(name)}({', '.join(texts)})", "z"
        raise refused(node)

    def statement(self, node: ast.stmt) -> list[str]:
        """The lines of a statement."""
        match node:
            case ast.Assign():
                return self._assign(node.targets[0], node.value)
            case ast.AugAssign():
                return self._assign(node.target, _sum(node))
            case ast.Return(value=ast.expr() as value):
                return [f"return {self._returned(value)};"]
            case ast.Break():
                return ["break;"]
            case ast.Continue():
                return ["continue;"]
            case ast.Pass():
                return []
            case ast.Expr(value=ast.Call() as value):
                return [f"{self.code(value)[0]};"]
            case ast.If(orelse=other):
                lines = [self._condition("if", node.test), *self._inner(node.body)]
                return [*lines, *(["} else {", *self._inner(other)] if other else []), "}"]
            case ast.While(orelse=[]):
                return [self._condition("while", node.test), *self._inner(node.body), "}"]
            case ast.For(orelse=[], target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=bounds)):
                return self._for(node, name, bounds)
        raise refused(node)

    def _inner(self, body: Iterable[ast.stmt]) -> list[str]:
        return [f"    {line}" for item in body for line in self.statement(item)]

    def _condition(self, word: str, node: ast.expr) -> str:
        text, kind = self.code(node)
        if kind != "b":
            raise refused(node)
        return f"{word} ({text}) {{"

    def _for(self, node: ast.For, name: str, bounds: Sequence[ast.expr]) -> list[str]:
        """A loop from start to before stop, which is looked at once."""
        down = len(bounds) == 3 and ast.unparse(bounds[2]) == "-1"
        if len(bounds) == 3 and not down:
            raise refused(node)
        dialect, counter = self.dialect, self._temporary()
        start, stop = [dialect.number(0), *self._codes(bounds[:2])[0]][-2:]
        step = f"{counter} > {counter}end; --{counter}" if down else f"{counter} < {counter}end; ++{counter}"
        head = f"for ({dialect.counter} {counter} = {start}, {counter}end = {stop}; {step}) {{"
        named = [f"    {dialect.name(name)} = {counter};"] if name in self.read else []
        return [head, *named, *self._inner(node.body), "}"]

    def _temporary(self) -> str:
        self.temporaries += 1
        return f"t{self.temporaries}_"

    def _returned(self, node: ast.expr) -> str:
        if isinstance(node, ast.Tuple) and isinstance(self.result, tuple):
            if len(node.elts) != len(self.result):
                raise refused(node)
            return self.dialect.make(self.result, list(map(self.fitted, node.elts, self.result)))
        return self.fitted(node, self.result)

    def _assign(self, target: ast.expr, value: ast.expr) -> list[str]:
        dialect = self.dialect
        if not isinstance(target, ast.Tuple):
            return self._store(target, *self.code(value))
        # All of the right side first: the targets may be read there.
        sources = value.elts if isinstance(value, ast.Tuple) else [value]
        held = [(self._temporary(), *self.code(source)) for source in sources]
        lines = [f"{dialect.fixed}{dialect.declared(kind, name)} = {text};" for name, text, kind in held]
        parts: list[Code] = [(name, kind) for name, _text, kind in held]
        if not isinstance(value, ast.Tuple):
            ((name, kind),) = parts
            if isinstance(kind, tuple):
                parts = [(dialect.element.format(name, k), item) for k, item in enumerate(kind)]
            else:
                parts = [(f"{name}[{k}]", "d") for k in range(len(target.elts))]
        pairs = zip(target.elts, parts, strict=True)
        stored = [line for item, part in pairs for line in self._store(item, *part)]
        # Their variables are seen by nobody else.
        return ["{", *(f"    {line}" for line in (*lines, *stored)), "}"]

    def _store(self, target: ast.expr, text: str, kind: Type) -> list[str]:
        if isinstance(target, ast.Name):
            if target.id not in self.read:
                return []
            wanted = self.variables[target.id]
            return [f"{self.dialect.name(target.id)} = {self.dialect.fit(text, kind, wanted)};"]
        if isinstance(target, ast.Subscript):
            place, wanted = self.code(target)
            return [f"{place} = {self.dialect.fit(text, kind, wanted)};"]
        raise refused(target)


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
