"""A calibrated bounce in C#, for Unity, Godot and anything else on .NET."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import ClassVar

from fitball.exports.port.dialect import Dialect
from fitball.exports.port.kinds import Type, compound, fields_of, type_name
from fitball.exports.port.port import Port
from fitball.exports.port.render import camel_case, translated_port

_PLAIN = {
    "d": "double", "i": "long", "b": "bool", "z": "Complex", "A": "double[]", "I": "long[]", "S": "double[]",
    "v": "void",
}  # fmt: skip
_FUNCTIONS = ("exp", "log", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "atan2")
_TAKEN = """
abstract as base bool break byte case catch char checked class const continue decimal default delegate do double
else enum event explicit extern false finally fixed float for foreach goto if implicit in int interface internal
is lock long namespace new null object operator out override params private protected public readonly ref return
sbyte sealed short sizeof stackalloc static string struct switch this throw true try typeof uint ulong unchecked
unsafe ushort using virtual void volatile while var
"""


class CSharp(Dialect):
    """C# without anything new, which Unity and Mono have had for long."""

    language: ClassVar[str] = "C#"
    math: ClassVar[Mapping[str, str]] = {name: f"Math.{name.capitalize()}" for name in _FUNCTIONS} | {
        "fabs": "Math.Abs", "hypot": "hypot", "log1p": "log1p", "isnan": "double.IsNaN", "isfinite": "is_finite",
    }  # fmt: skip
    values: ClassVar[Mapping[str, str]] = {"pi": "Math.PI", "nan": "double.NaN", "inf": "double.PositiveInfinity"}
    cast: ClassVar[str] = "(double)"
    counter: ClassVar[str] = "long"
    taken: ClassVar[frozenset[str]] = frozenset(_TAKEN.split())

    def number(self, value: float) -> str:
        text = super().number(value)
        return f"{text}L" if type(value) is int else text

    def type(self, kind: Type) -> str:
        """How a type is written."""
        return _PLAIN[kind] if isinstance(kind, str) else type_name(kind)

    def structs(self, kinds: Iterable[Type]) -> list[str]:
        """Definitions of the structs of `kinds`."""
        lines = []
        for kind in compound(kinds):
            pairs = [(self.type(item), self.name(name)) for name, item in fields_of(kind)]
            fields = " ".join(f"public {item} {name};" for item, name in pairs)
            taken = ", ".join(f"{item} {name}" for item, name in pairs)
            stores = " ".join(f"this.{name} = {name};" for _item, name in pairs)
            lines.append(f"struct {self.type(kind)} {{ {fields} public {self.type(kind)}({taken}) {{ {stores} }} }}")
        return lines

    def bits(self, operator: str, left: str, right: str) -> str:
        return f"({left} {operator} {f'(int)({right})' if operator == '<<' else right})"

    def whole(self, text: str) -> str:
        return f"((long){text})"

    def part(self, which: str, text: str) -> str:
        return f"{text}.{ {'real': 'Real', 'imag': 'Imaginary'}[which] }"

    def make(self, kind: Type, texts: Sequence[str]) -> str:
        return f"new {self.type(kind)}({', '.join(texts)})"

    def held(self, kind: Type, name: str, text: str) -> str:
        return f"{self.type(kind)} {name} = {text}"

    def local(self, kind: Type, name: str) -> str:
        return f"{self.type(kind)} {name} = default({self.type(kind)})"

    def define(self, comment: str, result: Type, name: str, taken: Sequence[tuple[Type, str]]) -> list[str]:
        listed = ", ".join(f"{self.type(kind)} {item}" for kind, item in taken)
        return [*(f"// {line}" for line in comment.split("\n")), f"static {self.type(result)} {name}({listed})", "{"]


def csharp_port(port: Port, prefix: str = "fitball_") -> str:
    """The text of the class, called after `prefix`. Raises UnportableError."""
    return translated_port(port, CSharp(), "port.cs.j2").replace("@@", camel_case(prefix))
