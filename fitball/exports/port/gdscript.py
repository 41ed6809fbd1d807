"""A calibrated bounce in GDScript, in what Godot 3 and Godot 4 both read."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import ClassVar

from fitball.exports.port.dialect import Dialect
from fitball.exports.port.kernel_source import Constant
from fitball.exports.port.kinds import Struct, Type
from fitball.exports.port.port import Port
from fitball.exports.port.render import translated_port

_FUNCTIONS = ("exp", "log", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "atan2")
_TYPES = {"d": "float", "i": "int", "b": "bool"}
_START = {"d": "0.0", "i": "0", "b": "false"}
_TAKEN = """
if elif else for while match break continue pass return class extends is in as self signal func static const
enum var onready export setget breakpoint preload yield await assert void super trait namespace when abs acos
asin atan ceil char clamp convert cos db2linear ease exp floor fmod hash instance inst2dict lerp linear2db load
log max min nearest_po2 ord posmod pow print range round seed sign sin sqrt step stepify str tan tanh
type_exists typeof wrap free get set call connect notification tr
"""


class GDScript(Dialect):
    """GDScript without what changed between Godot 3 and 4."""

    language: ClassVar[str] = "GDScript"
    math: ClassVar[Mapping[str, str]] = {name: name for name in _FUNCTIONS} | {
        "fabs": "abs", "hypot": "hypot", "log1p": "log1p", "isnan": "is_nan", "isfinite": "finite",
    }  # fmt: skip
    values: ClassVar[Mapping[str, str]] = {"pi": "PI", "nan": "NAN", "inf": "INF"}
    complex_calls: ClassVar[Mapping[str, str]] = {"+": "zplus", "-": "zminus", "*": "ztimes", "/": "zover"}
    # Words of the language, functions that every script sees, and methods of every object.
    taken: ClassVar[frozenset[str]] = frozenset(_TAKEN.split())
    opening = ":"
    otherwise = "else:"
    closing = ()
    nothing = ("pass",)
    end = ""

    def constant(self, text: str) -> str:
        return f"K_{text}"

    def shared(self, text: str) -> str:
        # A constant holds no object.
        return f"{text.lower()}()"

    def literal(self, value: Constant) -> str:
        if isinstance(value, tuple):
            return f"K{type(value).__name__}.new({', '.join(map(self.literal, value))})"
        return self.number(value)

    def fit(self, text: str, kind: Type, wanted: Type) -> str:
        return f"float({text})" if wanted == "d" and kind == "i" else super().fit(text, kind, wanted)

    def binary(self, operator: str, left: tuple[str, Type], right: tuple[str, Type], kind: Type) -> str:
        # Numbers are widened here: of two integers it would divide the whole part.
        one, other = ((self.fit(*side, kind), kind) for side in (left, right))
        return super().binary(operator, one, other, kind)

    def choice(self, test: str, one: str, other: str) -> str:
        return f"({one} if {test} else {other})"

    def whole(self, text: str) -> str:
        return f"int({text})"

    def part(self, which: str, text: str) -> str:
        return f"{text}[{0 if which == 'real' else 1}]"

    def make(self, kind: Type, texts: Sequence[str]) -> str:
        listed = ", ".join(texts)
        return f"{self.type(kind)}.new({listed})" if isinstance(kind, Struct) else f"[{listed}]"

    def type(self, kind: Struct) -> str:
        """The class of a struct; plain names are those of the engine's own classes."""
        return f"K{kind.name}"

    def item(self, text: str, place: int) -> str:
        return f"{text}[{place}]"

    def held(self, kind: Type, name: str, text: str) -> str:
        return f"var {name}{_typed(kind)} = {text}"

    def local(self, kind: Type, name: str) -> str:
        start = _START.get(kind, "null") if isinstance(kind, str) else "null"
        return f"var {name}{_typed(kind)} = {start}"

    def condition(self, word: str, test: str) -> str:
        return f"{word} {test}:"

    def counting(self, counter: str, start: str, stop: str, down: bool) -> str:
        return f"for {counter} in range({start}, {stop}{', -1' if down else ''}):"

    def together(self, lines: Sequence[str]) -> list[str]:
        return list(lines)

    def define(self, comment: str, result: Type, name: str, taken: Sequence[tuple[Type, str]]) -> list[str]:
        listed = ", ".join(f"{item}{_typed(kind)}" for kind, item in taken)
        gives = _TYPES.get(result) if isinstance(result, str) else None
        head = f"static func {name}({listed}){f' -> {gives}' if gives else ''}:"
        return [*(f"# {line}".rstrip() for line in comment.split("\n")), head]


def _typed(kind: Type) -> str:
    known = _TYPES.get(kind) if isinstance(kind, str) else None
    return f": {known}" if known else ""


def gdscript_port(port: Port) -> str:
    """The script's text. Raises UnportableError."""
    text = translated_port(port, GDScript(), "port.gd.j2")
    # One kind of indentation, the editor's.
    return re.sub(r"^(?:    )+", lambda found: "\t" * (len(found[0]) // 4), text, flags=re.MULTILINE)
