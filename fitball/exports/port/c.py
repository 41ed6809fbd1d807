"""A calibrated bounce as a C99 header that needs nothing but the standard library."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import ClassVar

from fitball.exports.port.dialect import Dialect
from fitball.exports.port.kernel_source import Constant
from fitball.exports.port.kinds import Type, compound, fields_of, type_name
from fitball.exports.port.port import Port
from fitball.exports.port.render import translated_port

_PLAIN = {
    "d": "double", "i": "int64_t", "b": "bool", "z": "double complex", "A": "double *", "I": "const int64_t *",
    "S": "double *", "v": "void",
}  # fmt: skip
_FUNCTIONS = (
    "exp", "log", "log1p", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "hypot", "atan2", "isnan", "isfinite",
    "fabs",
)  # fmt: skip


class C99(Dialect):
    """C99 in which every name begins with `prefix`."""

    language: ClassVar[str] = "C99"
    math: ClassVar[Mapping[str, str]] = {name: name for name in _FUNCTIONS}
    values: ClassVar[Mapping[str, str]] = {"pi": "3.141592653589793", "nan": "NAN", "inf": "INFINITY"}
    cast: ClassVar[str] = "(double)"
    counter: ClassVar[str] = "int64_t"

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix

    def function(self, text: str) -> str:
        return f"{self.prefix}{text}"

    def constant(self, text: str) -> str:
        return f"{self.prefix.upper()}{text}"

    def literal(self, value: Constant) -> str:
        return f"{{{', '.join(map(self.literal, value))}}}" if isinstance(value, tuple) else self.number(value)

    def type(self, kind: Type) -> str:
        """How a type is written."""
        return _PLAIN[kind] if isinstance(kind, str) else f"{self.prefix}{type_name(kind)}"

    def declared(self, kind: Type, name: str) -> str:
        """The declaration of a variable or function."""
        text = self.type(kind)
        return f"{text}{name}" if text.endswith("*") else f"{text} {name}"

    def structs(self, kinds: Iterable[Type]) -> list[str]:
        """Definitions of the structs of `kinds`."""

        def fields(kind: Type) -> str:
            return " ".join(f"{self.declared(item, name)};" for name, item in fields_of(kind))

        return [f"typedef struct {{ {fields(kind)} }} {self.type(kind)};" for kind in compound(kinds)]

    def constant_definition(self, name: str, value: Constant) -> str:
        """A constant of the module."""
        if isinstance(value, tuple):
            return f"static const {self.prefix}{type(value).__name__} {self.constant(name)} = {self.literal(value)};"
        return f"#define {self.constant(name)} ({self.literal(value)})"

    def whole(self, text: str) -> str:
        return f"((int64_t){text})"

    def test(self, function: str, text: str) -> str:
        return f"({function}({text}) != 0)"

    def part(self, which: str, text: str) -> str:
        return f"c{which}({text})"

    def make(self, kind: Type, texts: Sequence[str]) -> str:
        return f"({self.type(kind)}){{{', '.join(texts)}}}"

    def held(self, kind: Type, name: str, text: str) -> str:
        return f"const {self.declared(kind, name)} = {text}"

    def local(self, kind: Type, name: str) -> str:
        held = fields_of(kind)
        # What follows a first zero is zero too; of structs within structs compilers want to see it.
        short = held and isinstance(held[0][1], str)
        return f"{self.declared(kind, name)} = {'{0}' if short else _zero(kind)}"

    def define(self, comment: str, result: Type, name: str, taken: Sequence[tuple[Type, str]]) -> list[str]:
        listed = ", ".join(self.declared(kind, item) for kind, item in taken)
        said = comment.replace("\n", "\n   ")
        return [f"/* {said} */", f"static inline {self.declared(result, name)}({listed})", "{"]

    def unread(self, name: str) -> list[str]:
        return [f"(void){name};"]


def c_port(port: Port, prefix: str = "fitball_") -> str:
    """The header's text; every name in it begins with `prefix`. Raises UnportableError."""
    return translated_port(port, C99(prefix), "port.h.j2").replace("@@", prefix).replace("@UP@", prefix.upper())


def _zero(kind: Type) -> str:
    if isinstance(kind, str):
        return {"b": "false", "i": "0", "d": "0.0", "z": "0.0"}.get(kind, "NULL")
    return f"{{{', '.join(_zero(item) for _name, item in fields_of(kind))}}}"
