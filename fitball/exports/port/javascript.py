"""A calibrated bounce in JavaScript: for a plain `<script>` or `require`, and as an ES module."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from fitball.exports.port.dialect import Dialect
from fitball.exports.port.kinds import Struct, Type
from fitball.exports.port.port import Port
from fitball.exports.port.render import camel_case, translated_port

_FUNCTIONS = ("exp", "log", "log1p", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "atan2")
_TAKEN = """
arguments await break case catch class const continue debugger default delete do else enum eval export extends
finally for function if implements import in instanceof interface let new null package private protected public
return static super switch this throw try typeof undefined var void while with yield
"""


class JavaScript(Dialect):
    """ECMAScript 2020, for its integers of any length."""

    language: ClassVar[str] = "JavaScript"
    # Math.hypot may be off in the last digits, by engine.
    math: ClassVar[Mapping[str, str]] = {name: f"Math.{name}" for name in _FUNCTIONS} | {
        "fabs": "Math.abs", "hypot": "hypot", "isnan": "Number.isNaN", "isfinite": "Number.isFinite",
    }  # fmt: skip
    values: ClassVar[Mapping[str, str]] = {"pi": "Math.PI", "nan": "NaN", "inf": "Infinity"}
    counter: ClassVar[str] = "let"
    complex_calls: ClassVar[Mapping[str, str]] = {"+": "zplus", "-": "zminus", "*": "ztimes", "/": "zover"}
    taken: ClassVar[frozenset[str]] = frozenset(_TAKEN.split())
    compare: ClassVar[Mapping[str, str]] = {**Dialect.compare, "==": "===", "!=": "!=="}

    def bits(self, operator: str, left: str, right: str) -> str:
        # Its own operators see 32 bits.
        return f"(BigInt({left}) {operator} BigInt({right}))"

    def whole(self, text: str) -> str:
        return f"Math.trunc({text})"

    def make(self, kind: Type, texts: Sequence[str]) -> str:
        if isinstance(kind, Struct):
            pairs = zip((self.name(name) for name, _ in kind.fields), texts, strict=True)
            return f"{{{', '.join(f'{name}: {text}' for name, text in pairs)}}}"
        return f"[{', '.join(texts)}]"

    def item(self, text: str, place: int) -> str:
        return f"{text}[{place}]"

    def held(self, kind: Type, name: str, text: str) -> str:  # noqa: ARG002 - types are not written
        return f"const {name} = {text}"

    def local(self, kind: Type, name: str) -> str:
        start = {"b": " = false", "i": " = 0", "d": " = 0"}.get(kind, "") if isinstance(kind, str) else ""
        return f"let {name}{start}"

    def define(self, comment: str, result: Type, name: str, taken: Sequence[tuple[Type, str]]) -> list[str]:  # noqa: ARG002
        said = comment.replace("\n", "\n * ")
        return [f"/** {said} */", f"function {name}({', '.join(item for _kind, item in taken)}) {{"]


# What a port offers.
NAMES = (
    "rebound", "solve", "selfTest", "regimeName", "MODEL", "ROW", "RADIUS", "V_Y1_LOW", "V_Y1_HIGH",
    "CALIBRATED_V_Y1_LOW", "CALIBRATED_V_Y1_HIGH", "BEYOND_SPEEDS", "BEYOND_RESTITUTION", "WITHOUT_TWIST", "REASONS",
    "COR_LOW", "COR_HIGH",
)  # fmt: skip


def javascript_texts(port: Port, prefix: str = "fitball_") -> dict[str, str]:
    """The script (a global called after `prefix`, or what `require` gives), the ES module. Raises UnportableError."""
    name = f"{camel_case(prefix)}Bounce"
    body = translated_port(port, JavaScript(), "port.js.j2").replace("@@Bounce", name)
    listed = ", ".join(NAMES)
    return {".js": _script(body, name, listed), ".mjs": f"{body}\nexport {{ {listed} }};\n"}


def javascript_script(port: Port, more: Sequence[str]) -> str:
    """The port as one expression that gives what it offers, and the functions called `more`."""
    body = translated_port(port, JavaScript(), "port.js.j2").replace("@@Bounce", "FitballBounce")
    return f'(function () {{\n"use strict";\n{body}\nreturn {{ {", ".join((*NAMES, *more))} }};\n}})()'


def _script(body: str, name: str, listed: str) -> str:
    head, _, rest = body.partition("*/\n")
    inner = "\n".join(f"    {line}".rstrip() for line in rest.rstrip("\n").split("\n"))
    return f"""{head}*/
var {name} = (function () {{
    "use strict";

{inner}

    return {{ {listed} }};
}})();
if (typeof module !== "undefined" && module.exports) {{
    module.exports = {name};
    if (require.main === module) {{
        const found = {name}.selfTest();
        console.log(found.text);
        process.exit(found.passed ? 0 : 1);
    }}
}}
"""
