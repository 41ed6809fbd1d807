"""A calibrated bounce in C99, C# and JavaScript: what each language writes in its own way, and its files."""

from __future__ import annotations

from collections.abc import Sequence

from fitball.exports.port.dialect import Dialect, Struct, Type, fields_of
from fitball.exports.port.kernel_source import Constant
from fitball.exports.port.port import Port, translated_port

_FUNCTIONS = ("exp", "log", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "atan2")
_TAKEN_CSHARP = """
abstract as base bool break byte case catch char checked class const continue decimal default delegate do double
else enum event explicit extern false finally fixed float for foreach goto if implicit in int interface internal
is lock long namespace new null object operator out override params private protected public readonly ref return
sbyte sealed short sizeof stackalloc static string struct switch this throw true try typeof uint ulong unchecked
unsafe ushort using virtual void volatile while var
"""
_TAKEN_JAVASCRIPT = """
arguments await break case catch class const continue debugger default delete do else enum eval export extends
finally for function if implements import in instanceof interface let new null package private protected public
return static super switch this throw try typeof undefined var void while with yield
"""


class C99(Dialect):
    """C99 in which every name begins with `prefix`."""

    language = "C99"
    math = {name: name for name in (*_FUNCTIONS, "log1p", "hypot", "isnan", "isfinite", "fabs")}
    values = {"pi": "3.141592653589793", "nan": "NAN", "inf": "INFINITY"}
    types = {
        "d": "double", "i": "int64_t", "b": "bool", "z": "double complex", "A": "double *", "I": "const int64_t *",
        "S": "double *", "v": "void",
    }  # fmt: skip
    cast, counter, fixed = "(double)", "int64_t", "const "
    whole, test = "((int64_t){})", "({}({}) != 0)"
    real, imaginary = "creal({})", "cimag({})"
    made, struct, member = "({type}){{{items}}}", "typedef struct {{ {fields} }} {type};", "{};"
    head, comment = "/* {comment} */\nstatic inline {declared}({taken})\n{{", "\n   "

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix

    def function(self, text: str) -> str:
        return f"{self.prefix}{text}"

    def constant(self, text: str) -> str:
        return f"{self.prefix.upper()}{text}"

    def literal(self, value: Constant) -> str:
        return f"{{{', '.join(map(self.literal, value))}}}" if isinstance(value, tuple) else self.number(value)

    def constant_definition(self, name: str, value: Constant) -> str:
        """A constant of the module."""
        if isinstance(value, tuple):
            return f"static const {self.prefix}{type(value).__name__} {self.constant(name)} = {self.literal(value)};"
        return f"#define {self.constant(name)} ({self.literal(value)})"

    def local(self, kind: Type, name: str) -> str:
        held = fields_of(kind)
        # What follows a first zero is zero too; of structs within structs compilers want to see it.
        short = held and isinstance(held[0][1], str)
        return f"{self.declared(kind, name)} = {'{0}' if short else self._zero(kind)}"

    def _zero(self, kind: Type) -> str:
        if isinstance(kind, str):
            return {"b": "false", "i": "0", "d": "0.0", "z": "0.0"}.get(kind, "NULL")
        return f"{{{', '.join(self._zero(item) for _name, item in fields_of(kind))}}}"

    def unread(self, name: str) -> list[str]:
        return [f"(void){name};"]


class CSharp(Dialect):
    """C# without anything new, which Unity and Mono have had for long."""

    language = "C#"
    math = {name: f"Math.{name.capitalize()}" for name in _FUNCTIONS} | {
        "fabs": "Math.Abs", "hypot": "hypot", "log1p": "log1p", "isnan": "double.IsNaN", "isfinite": "is_finite",
    }  # fmt: skip
    values = {"pi": "Math.PI", "nan": "double.NaN", "inf": "double.PositiveInfinity"}
    types = {
        "d": "double", "i": "long", "b": "bool", "z": "Complex", "A": "double[]", "I": "long[]", "S": "double[]",
        "v": "void",
    }  # fmt: skip
    taken = frozenset(_TAKEN_CSHARP.split())
    cast, counter = "(double)", "long"
    whole, real, imaginary = "((long){})", "{}.Real", "{}.Imaginary"
    made, member = "new {type}({items})", "public {};"
    struct = "struct {type} {{ {fields} public {type}({taken}) {{ {stores} }} }}"
    head, comment = "// {comment}\nstatic {declared}({taken})\n{{", "\n// "

    def number(self, value: float) -> str:
        text = super().number(value)
        return f"{text}L" if type(value) is int else text

    def bits(self, operator: str, left: str, right: str) -> str:
        return f"({left} {operator} {f'(int)({right})' if operator == '<<' else right})"

    def local(self, kind: Type, name: str) -> str:
        return f"{self.declared(kind, name)} = default({self.type(kind)})"


class JavaScript(Dialect):
    """ECMAScript 2020, for its integers of any length."""

    language = "JavaScript"
    # Math.hypot may be off in the last digits, by engine.
    math = {name: f"Math.{name}" for name in (*_FUNCTIONS, "log1p")} | {
        "fabs": "Math.abs", "hypot": "hypot", "isnan": "Number.isNaN", "isfinite": "Number.isFinite",
    }  # fmt: skip
    values = {"pi": "Math.PI", "nan": "NaN", "inf": "Infinity"}
    complex_calls = {"+": "zplus", "-": "zminus", "*": "ztimes", "/": "zover"}
    taken = frozenset(_TAKEN_JAVASCRIPT.split())
    same, other = "===", "!=="
    counter, fixed, whole, item = "let", "const ", "Math.trunc({})", "{}[{}]"
    head, comment = "/** {comment} */\nfunction {declared}({taken}) {{", "\n * "

    def bits(self, operator: str, left: str, right: str) -> str:
        # Its own operators see 32 bits.
        return f"(BigInt({left}) {operator} BigInt({right}))"

    def make(self, kind: Type, texts: Sequence[str]) -> str:
        if isinstance(kind, Struct):
            pairs = zip((self.name(name) for name, _ in kind.fields), texts, strict=True)
            return f"{{{', '.join(f'{name}: {text}' for name, text in pairs)}}}"
        return f"[{', '.join(texts)}]"

    def local(self, kind: Type, name: str) -> str:
        start = {"b": " = false", "i": " = 0", "d": " = 0"}.get(kind, "") if isinstance(kind, str) else ""
        return f"let {name}{start}"


# What a port in JavaScript offers.
NAMES = (
    "rebound", "solve", "selfTest", "regimeName", "MODEL", "ROW", "RADIUS", "V_Y1_LOW", "V_Y1_HIGH",
    "CALIBRATED_V_Y1_LOW", "CALIBRATED_V_Y1_HIGH", "BEYOND_SPEEDS", "BEYOND_RESTITUTION", "WITHOUT_TWIST", "REASONS",
    "COR_LOW", "COR_HIGH",
)  # fmt: skip


def c_port(port: Port, prefix: str = "fitball_") -> str:
    """The header's text; every name in it begins with `prefix`. Raises UnportableError."""
    return translated_port(port, C99(prefix), "port.h.j2").replace("@@", prefix).replace("@UP@", prefix.upper())


def csharp_port(port: Port, prefix: str = "fitball_") -> str:
    """The text of the class, called after `prefix`. Raises UnportableError."""
    return translated_port(port, CSharp(), "port.cs.j2").replace("@@", camel_case(prefix))


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


def camel_case(prefix: str) -> str:
    """`red_clay_` as `RedClay`."""
    return "".join(word[0].upper() + word[1:] for word in prefix.split("_") if word)
