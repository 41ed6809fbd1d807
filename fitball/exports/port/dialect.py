"""Types of the restricted Python of the kernels, and what the languages of the ports differ in; the walk over
a kernel (`translate`) is one for all.
"""

from __future__ import annotations

import ast
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from fitball.exports.port.kernel_source import Constant, UnportableError


@dataclass(frozen=True)
class Struct:
    """A named tuple: a struct with fields of the same names."""

    name: str
    fields: tuple[tuple[str, Type], ...]

    def field(self, name: str) -> Type | None:
        """The type of a field, None if there is none of that name."""
        return dict(self.fields).get(name)


# d double, i integer, b truth value, z complex, A array of double, I array of integers, S array of double with two
# indices (rows of STRIDE), v nothing; a Python tuple of these is a struct with fields f0, f1, ...
Type = str | tuple["Type", ...] | Struct
Structs = Mapping[str, Struct]

STRIDE = 5
_NAMES: dict[str, Type] = {
    "float": "d", "Number": "d", "int": "i", "bool": "b", "complex": "z",
    "FloatArray": "A", "NumberArray": "A", "Ints": "I", "Stack": "S",
}  # fmt: skip


def structs_of(fields: Mapping[str, Mapping[str, ast.expr]]) -> Structs:
    """The structs that named tuples become, given the annotations of their fields, inner ones first."""
    made: dict[str, Struct] = {}
    for name, given in fields.items():
        made[name] = Struct(name, tuple((item, annotated(node, made)) for item, node in given.items()))
    return made


def annotated(node: ast.expr | None, structs: Structs) -> Type:
    """The type an annotation names. Raises UnportableError for one that kernels are not known to use."""
    if isinstance(node, ast.Constant) and node.value is None:
        return "v"
    if isinstance(node, ast.Name) and node.id in {**_NAMES, **structs}:
        return {**_NAMES, **structs}[node.id]
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
        if node.value.id == "tuple" and isinstance(node.slice, ast.Tuple):
            return tuple(annotated(child, structs) for child in node.slice.elts)
        if node.value.id in structs:
            return structs[node.value.id]
        if node.value.id == "NDArray" and "int64" in ast.unparse(node.slice):
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

    def note(kind: Type) -> None:
        if not isinstance(kind, str):
            for _name, item in fields_of(kind):
                note(item)
            found[kind] = None

    for kind in kinds:
        note(kind)
    return list(found)


def type_name(kind: Type) -> str:
    """A name for a struct or a tuple; of a tuple, the letters of what it holds."""
    if isinstance(kind, Struct):
        return kind.name
    return kind.lower() if isinstance(kind, str) else "t" + "".join(map(type_name, kind)) + "_"


def holds_complex(kind: Type) -> bool:
    """Whether a complex number is, or is within, a value of this type."""
    return kind == "z" or any(holds_complex(item) for _name, item in fields_of(kind))


class Dialect(ABC):
    """A language of the C family: a table of how it writes things, most of them texts that `format` fills; a subclass
    says what is otherwise, and by a method what no text can say.

    Texts go in and out. `math` maps functions of Python's `math` to what they are called, `values` its constants,
    `types` plain types (empty where types are not written). Names that are `taken` in the language get a line behind
    them. `complex_calls` are functions of a language whose operators do not know complex numbers.
    """

    language: ClassVar[str]
    math: ClassVar[Mapping[str, str]]
    values: ClassVar[Mapping[str, str]]
    types: ClassVar[Mapping[str, str]] = {}
    taken: ClassVar[frozenset[str]] = frozenset()
    complex_calls: ClassVar[Mapping[str, str]] = {}
    same, other = "==", "!="
    # What makes an integer real where that does not come by itself, what declares a counter, and a fixed variable.
    cast, counter, fixed = "", "", ""
    # A real number cut to an integer; a test such as `isnan`; parts of a complex number; an item of a tuple.
    whole, test, item = "{}", "{}({})", "{}.f{}"
    real, imaginary = "{}.real", "{}.imag"
    # A struct or tuple of `items`, its definition of `fields`, one of these.
    made, struct, member = "", "", ""
    # What begins a function, its comment first, whose further lines begin so.
    head, comment = "", ""

    prefix = ""

    def name(self, text: str) -> str:
        """A variable, field or parameter."""
        return f"{text}_" if text in self.taken else text

    def function(self, text: str) -> str:
        """A function of the port."""
        return self.name(text)

    def constant(self, text: str) -> str:
        """A constant of the port."""
        return self.name(text)

    def number(self, value: float) -> str:
        """A finite number or truth value."""
        return repr(value).lower() if isinstance(value, bool) else repr(value)

    def literal(self, value: Constant) -> str:
        """A number, or a named tuple of such."""
        if isinstance(value, tuple):
            kinds = Struct(type(value).__name__, tuple((name, "d") for name in value._fields))  # type: ignore[attr-defined]
            return self.make(kinds, [self.literal(item) for item in value])
        return self.number(value)

    def type(self, kind: Type) -> str:
        """How a type is written."""
        return self.types[kind] if isinstance(kind, str) else f"{self.prefix}{type_name(kind)}"

    def declared(self, kind: Type, name: str) -> str:
        """The declaration of a variable or function: its name, behind its type where that is written."""
        text = self.type(kind) if self.types else ""
        return f"{text}{name}" if text.endswith("*") or not text else f"{text} {name}"

    def structs(self, kinds: Iterable[Type]) -> list[str]:
        """Definitions of the structs of `kinds`."""
        lines = []
        for kind in compound(kinds):
            names = [self.name(name) for name, _item in fields_of(kind)]
            declared = [self.declared(item, self.name(name)) for name, item in fields_of(kind)]
            fields = " ".join(self.member.format(text) for text in declared)
            stores = " ".join(f"this.{name} = {name};" for name in names)
            given = {"type": self.type(kind), "fields": fields, "taken": ", ".join(declared), "stores": stores}
            lines.append(self.struct.format(**given))
        return lines

    def make(self, kind: Type, texts: Sequence[str]) -> str:
        """A struct or tuple of these."""
        return self.made.format(type=self.type(kind), items=", ".join(texts))

    def fit(self, text: str, kind: Type, wanted: Type) -> str:
        """A value where `wanted` is held, which is `kind` or wider."""
        return f"complex({text}, 0.0)" if self.complex_calls and wanted == "z" != kind else text

    def binary(self, operator: str, left: tuple[str, Type], right: tuple[str, Type], kind: Type) -> str:
        """Sum, difference, product or quotient, of type `kind`; division of two integers is of real numbers."""
        if kind == "z" and self.complex_calls:
            return f"{self.complex_calls[operator]}({self.fit(*left, 'z')}, {self.fit(*right, 'z')})"
        cast = self.cast if operator == "/" and left[1] == right[1] == "i" else ""
        return f"({cast}{left[0]} {operator} {cast}{right[0]})"

    def negative(self, text: str, kind: Type) -> str:
        """The number with its other sign."""
        called = kind == "z" and self.complex_calls
        return f"{self.complex_calls['-']}(complex(0.0, 0.0), {text})" if called else f"(-{text})"

    def bits(self, operator: str, left: str, right: str) -> str:
        """`|`, `&` or `<<` of integers of 60 bits."""
        return f"({left} {operator} {right})"

    @abstractmethod
    def local(self, kind: Type, name: str) -> str:
        """A variable at the top of a function, set to something harmless."""

    def held(self, kind: Type, name: str, text: str) -> str:
        """A new variable that is not changed."""
        return f"{self.fixed}{self.declared(kind, name)} = {text}"

    def counting(self, counter: str, start: str, stop: str, down: bool) -> str:
        """The head of a loop from `start` to before `stop`, which is looked at once."""
        end = f"{counter}end"
        step = f"{counter} > {end}; --{counter}" if down else f"{counter} < {end}; ++{counter}"
        return f"for ({self.counter} {counter} = {start}, {end} = {stop}; {step}) {{"

    def define(self, comment: str, result: Type, name: str, taken: Sequence[tuple[Type, str]]) -> str:
        """What begins a function."""
        listed = ", ".join(self.declared(kind, item) for kind, item in taken)
        said = comment.replace("\n", self.comment)
        return self.head.format(comment=said, declared=self.declared(result, name), taken=listed)

    def unread(self, name: str) -> list[str]:  # noqa: ARG002
        """What to say of a parameter that is not read."""
        return []
