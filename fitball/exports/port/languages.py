"""A calibrated bounce in C99, C# and JavaScript: what each language writes in its own way, as tables of texts that
`format` fills, and its files.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from fitball.errors import ParameterError
from fitball.exports.bounces import Bounces
from fitball.exports.port.kernel_source import Constant
from fitball.exports.port.names import TAKEN_CSHARP, TAKEN_JAVASCRIPT, camel_case
from fitball.exports.port.port import Port, port_of, python_port, translated_port
from fitball.exports.port.translate import Struct, Type, compound, fields_of, type_name
from fitball.wording import option

# What names of a port begin with.
PREFIX = "fitball_"
_FUNCTIONS = ("exp", "log", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh", "atan2")
_BITS = {"|": "({} | {})", "&": "({} & {})", "<<": "({} << {})"}


@dataclass(frozen=True)
class Dialect:
    """A language of the C family.

    `math` are functions of Python's `math`, `values` its constants, `types` plain types (empty where types are not
    written). Names that are `taken` in the language get a line behind them; of those of a port's functions, types and
    constants each begins with `prefix`. `helpers` are functions of `face` that the language has not itself.
    """

    language: str
    template: str
    math: Mapping[str, str]
    values: Mapping[str, str]
    types: Mapping[str, str] = field(default_factory=dict)
    helpers: tuple[str, ...] = ()
    taken: frozenset[str] = frozenset()
    prefix: str = ""
    same: str = "=="
    other: str = "!="
    # A whole number; one made real where that does not come by itself; a real one cut to a whole one; `|`, `&` and
    # `<<` of whole numbers of 60 bits.
    integer: str = "{}"
    cast: str = ""
    whole: str = "{}"
    bits: Mapping[str, str] = field(default_factory=_BITS.copy)
    # Parts of a complex number; functions of a language whose operators do not know complex numbers.
    real: str = "{}.real"
    imaginary: str = "{}.imag"
    complex_calls: Mapping[str, str] = field(default_factory=dict)
    # What declares a counter, a variable that is not changed, and others; what these begin as, by their types.
    counter: str = ""
    fixed: str = ""
    variable: str = ""
    zeros: Mapping[str, str] = field(default_factory=dict)
    zero: str = ""
    # An element of a tuple; a struct or tuple of `items`, or of `named` ones; how a constant one is written.
    element: str = "{}.f{}"
    built: str = "{type}({items})"
    tuple_made: str = ""
    initial: str = ""
    # The definition of a struct of `fields`, one of these; of a constant that is a number, or a struct.
    struct: str = ""
    member: str = ""
    constant_number: str = "const {name} = {value};"
    constant_struct: str = "const {name} = {value};"
    # What begins a function, its comment first, whose further lines begin so; what is said of an unread parameter.
    head: str = ""
    comment: str = ""
    unread: str = ""

    def name(self, text: str) -> str:
        """A variable, field or parameter."""
        return f"{text}_" if text in self.taken else text

    def function(self, text: str) -> str:
        """A function of the port."""
        return f"{self.prefix}{self.name(text)}"

    def constant(self, text: str) -> str:
        """A constant of the port."""
        return f"{self.prefix.upper()}{self.name(text)}"

    def number(self, value: float) -> str:
        """A finite number or truth value."""
        if isinstance(value, bool):
            return repr(value).lower()
        return self.integer.format(value) if isinstance(value, int) else repr(value)

    def literal(self, value: Constant) -> str:
        """A number, or a named tuple of such."""
        if not isinstance(value, tuple):
            return self.number(value)
        items = [self.literal(item) for item in value]
        if self.initial:
            return self.initial.format(", ".join(items))
        return self.make(Struct(type(value).__name__, tuple((name, "d") for name in value._fields)), items)  # type: ignore[attr-defined]

    def constant_definition(self, name: str, value: Constant) -> str:
        """A constant of the module."""
        form = self.constant_struct if isinstance(value, tuple) else self.constant_number
        of_numbers = self.types.get("d" if isinstance(value, float) else "i", "")
        kind = f"{self.prefix}{type(value).__name__}" if isinstance(value, tuple) else of_numbers
        return form.format(type=kind, name=self.constant(name), value=self.literal(value))

    def type(self, kind: Type) -> str:
        """How a type is written."""
        return self.types[kind] if isinstance(kind, str) else f"{self.prefix}{type_name(kind)}"

    def declared(self, kind: Type, name: str) -> str:
        """The declaration of a variable or function: its name, behind its type where that is written."""
        text = self.type(kind) if self.types else ""
        return f"{text}{name}" if text.endswith("*") or not text else f"{text} {name}"

    def local(self, kind: Type, name: str) -> str:
        """A variable at the top of a function, set to something harmless."""
        return f"{self.variable}{self.declared(kind, name)} = {self._zero(kind)}"

    def _zero(self, kind: Type) -> str:
        if self.initial and not isinstance(kind, str):
            return self.initial.format(", ".join(self._zero(item) for _name, item in fields_of(kind)))
        plain = self.zeros.get(kind) if isinstance(kind, str) else None
        return self.zero.format(self.type(kind) if self.types else "") if plain is None else plain

    def structs(self, kinds: Iterable[Type]) -> list[str]:
        """Definitions of the structs of `kinds`."""
        lines = []
        for kind in compound(kinds) if self.struct else []:
            names = [self.name(name) for name, _item in fields_of(kind)]
            declared = [self.declared(item, self.name(name)) for name, item in fields_of(kind)]
            fields = " ".join(self.member.format(text) for text in declared)
            stores = " ".join(f"this.{name} = {name};" for name in names)
            given = {"type": self.type(kind), "fields": fields, "taken": ", ".join(declared), "stores": stores}
            lines.append(self.struct.format(**given))
        return lines

    def make(self, kind: Type, texts: Sequence[str]) -> str:
        """A struct or tuple of these."""
        if self.tuple_made and isinstance(kind, tuple):
            return self.tuple_made.format(items=", ".join(texts))
        named = ", ".join(
            f"{self.name(name)}: {text}" for (name, _), text in zip(fields_of(kind), texts, strict=True)
        )
        return self.built.format(type=self.type(kind), items=", ".join(texts), named=named)

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


C99 = Dialect(
    "C99",
    "port.h.j2",
    {name: f"{name}({{}})" for name in (*_FUNCTIONS, "log1p", "hypot", "fabs")}
    | {name: f"({name}({{}}) != 0)" for name in ("isnan", "isfinite")},
    {"pi": "3.141592653589793", "nan": "NAN", "inf": "INFINITY"},
    {
        "d": "double", "i": "int64_t", "b": "bool", "z": "double complex", "A": "double *", "I": "const int64_t *",
        "S": "double *", "v": "void",
    },
    cast="(double)", whole="((int64_t){})", real="creal({})", imaginary="cimag({})", counter="int64_t",
    fixed="const ", zeros={"b": "false", "i": "0", "d": "0.0", "z": "0.0"}, zero="NULL",
    built="@UP@MAKE({type}, {items})", initial="{{{}}}", struct="typedef struct {{ {fields} }} {type};", member="{};",
    constant_number="#define {name} ({value})", constant_struct="static const {type} {name} = {value};",
    head="/* {comment} */\nstatic inline {declared}({taken})\n{{", comment="\n   ", unread="(void){};",
)  # fmt: skip

# Without anything new, which Unity and Mono have had for long.
CSHARP = Dialect(
    "C#",
    "port.cs.j2",
    {name: f"Math.{name.capitalize()}({{}})" for name in _FUNCTIONS}
    | {
        "fabs": "Math.Abs({})", "hypot": "hypot({})", "log1p": "log1p({})", "isnan": "double.IsNaN({})",
        "isfinite": "is_finite({})",
    },
    {"pi": "Math.PI", "nan": "double.NaN", "inf": "double.PositiveInfinity"},
    {
        "d": "double", "i": "long", "b": "bool", "z": "Complex", "A": "double[]", "I": "long[]", "S": "double[]",
        "v": "void",
    },
    helpers=("hypot", "log1p"),
    taken=frozenset(TAKEN_CSHARP.split()),
    integer="{}L", cast="(double)", whole="((long){})", bits={**_BITS, "<<": "({} << (int)({}))"}, real="{}.Real",
    imaginary="{}.Imaginary", counter="long", zero="default({})", built="new {type}({items})",
    struct="struct {type} {{ {fields} public {type}({taken}) {{ {stores} }} }}", member="public {};",
    constant_number="public const {type} {name} = {value};",
    constant_struct="static readonly {type} {name} = {value};",
    head="// {comment}\nstatic {declared}({taken})\n{{", comment="\n// ",
)  # fmt: skip

# ECMAScript 2020, for its integers of any length.
JAVASCRIPT = Dialect(
    "JavaScript",
    "port.js.j2",
    # Math.hypot may be off in the last digits, by engine.
    {name: f"Math.{name}({{}})" for name in (*_FUNCTIONS, "log1p")}
    | {
        "fabs": "Math.abs({})", "hypot": "hypot({})", "isnan": "Number.isNaN({})", "isfinite": "Number.isFinite({})",
    },
    {"pi": "Math.PI", "nan": "NaN", "inf": "Infinity"},
    helpers=("hypot",),
    taken=frozenset(TAKEN_JAVASCRIPT.split()),
    # Its own operators see 32 bits.
    bits={sign: f"(BigInt({{}}) {sign} BigInt({{}}))" for sign in _BITS},
    complex_calls={"+": "zplus", "-": "zminus", "*": "ztimes", "/": "zover"},
    same="===", other="!==", whole="Math.trunc({})", counter="let", fixed="const ", variable="let ",
    zeros={"b": "false", "i": "0", "d": "0"}, zero="undefined", element="{}[{}]", built="{{{named}}}",
    tuple_made="[{items}]", head="/** {comment} */\nfunction {declared}({taken}) {{", comment="\n * ",
)  # fmt: skip

# What a port in JavaScript offers; with several parameter sets, and with one.
_NAMES = ("rebound", "solve", "selfTest", "regimeName", "MODEL")
_SEVERAL = (
    "LEVELS",
    "rowOf",
    "speedRange",
    "RADIUS",
    "BEYOND_SPEEDS",
    "BEYOND_RESTITUTION",
    "WITHOUT_TWIST",
    "REASONS",
)
_ONE = (
    "ROW", "RADIUS", "V_Y1_LOW", "V_Y1_HIGH", "CALIBRATED_V_Y1_LOW", "CALIBRATED_V_Y1_HIGH", "BEYOND_SPEEDS",
    "BEYOND_RESTITUTION", "WITHOUT_TWIST", "REASONS", "COR_LOW", "COR_HIGH",
)  # fmt: skip


def python_text(bounces: Bounces) -> str:
    """Bounces as a module that needs `math` alone."""
    return python_port(port_of(bounces))


def c_text(bounces: Bounces, prefix: str = PREFIX) -> str:
    """Bounces as a header in which every name begins with `prefix`. Raises ParameterError for what begins none."""
    return c_port(port_of(bounces), _beginning(prefix))


def csharp_text(bounces: Bounces, prefix: str = PREFIX) -> str:
    """Bounces as a class; see `c_text`."""
    return csharp_port(port_of(bounces), _beginning(prefix))


def javascript_texts(bounces: Bounces, prefix: str = PREFIX) -> dict[str, str]:
    """Bounces as a script, and as an ES module; see `c_text`."""
    return javascript_port(port_of(bounces), _beginning(prefix))


def _beginning(prefix: str) -> str:
    if not (prefix.isascii() and prefix.lstrip("_").isidentifier()):
        raise ParameterError(f"{option('prefix', prefix)}: expected the beginning of a name, such as clay_")
    return prefix


def c_port(port: Port, prefix: str = PREFIX) -> str:
    """The header's text; every name in it begins with `prefix`. Raises UnportableError."""
    text = translated_port(port, replace(C99, prefix=prefix))
    return text.replace("@@", prefix).replace("@UP@", prefix.upper())


def csharp_port(port: Port, prefix: str = PREFIX) -> str:
    """The text of the class, called after `prefix`. Raises UnportableError."""
    return translated_port(port, CSHARP).replace("@@", camel_case(prefix))


def javascript_port(port: Port, prefix: str = PREFIX) -> dict[str, str]:
    """The script (a global called after `prefix`, or what `require` gives), the ES module. Raises UnportableError."""
    name = f"{camel_case(prefix)}Bounce"
    body = translated_port(port, JAVASCRIPT).replace("@@Bounce", name)
    listed = ", ".join(_offered(port))
    head, _, rest = body.partition("*/\n")
    inner = "\n".join(f"    {line}".rstrip() for line in rest.rstrip("\n").split("\n"))
    script = f"""{head}*/
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
    return {".js": script, ".mjs": f"{body}\nexport {{ {listed} }};\n"}


def _offered(port: Port) -> tuple[str, ...]:
    if port.arguments:
        return (*_NAMES, *_SEVERAL)
    return (*_NAMES, *(name for name in _ONE if port.measured or not name.startswith("CALIBRATED")))


def javascript_script(port: Port, more: Sequence[str]) -> str:
    """The port as one expression that gives what it offers, and the functions called `more`."""
    body = translated_port(port, JAVASCRIPT).replace("@@Bounce", "FitballBounce")
    return f'(function () {{\n"use strict";\n{body}\nreturn {{ {", ".join((*_offered(port), *more))} }};\n}})()'
