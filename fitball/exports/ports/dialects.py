"""The languages of the C family that kernels are translated to, as tables of texts."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import get_args

from fitball.exports.ports import offered, python
from fitball.exports.ports.source import PortConstant, Type, fields_of, origin_of
from fitball.exports.ports.wrapped import wrapped

# Words of C, C# and JavaScript that are no words of Python, so that a kernel may call a variable
# so, such as `event`: the port then adds an underscore. Compilers refuse any other.
RESERVED = frozenset(
    {
        "case",
        "default",
        "double",
        "event",
        "fixed",
        "function",
        "long",
        "new",
        "object",
        "short",
        "this",
    }
)
# Words of GDScript, its functions among them, that kernels may have as variables.
_GDSCRIPT_RESERVED = frozenset(
    (
        *("_", "ceil", "char", "clamp", "class", "deg2rad", "ease", "export", "extends"),
        *("floor", "func", "lerp", "load", "master", "match", "preload", "range", "remote"),
        *("round", "seed", "self", "sign", "signal", "static", "str", "sync", "tool", "var"),
        "yield",
    )
)
# Types of arguments and results of the functions that a port offers.
OFFERED_TYPES = ("Parameters", "Rebound", "Vector", "Rebound3", "Plane", "Flight")
# Functions of Python's `math` that all these languages have.
_FUNCTIONS = ("exp", "log", "sqrt", "sin", "cos", "atan2")
# Helpers of all these languages: min and max as Python has them for NaN, and the sixth power.
_EVERYWHERE: Mapping[str, Callable[..., object]] = {
    "min": offered.least,
    "max": offered.greatest,
    "**6": offered.sixth,
}


@dataclass(frozen=True)
class Dialect:
    """A language of the C family, as formats of its texts.

    `math` are functions of Python's `math`, `values` its constants. `helpers` are functions of
    `offered` in place of what the language lacks. `operators` are those that are written otherwise
    than in Python. `types` are empty where types are not written.
    """

    math: Mapping[str, str]
    values: Mapping[str, str]
    helpers: Mapping[str, Callable[..., object]]
    operators: Mapping[str, str]
    # An integer as a real number, and a real number without its fraction as an integer.
    cast: str = "{}"
    truncate: str = "{}"
    types: Mapping[Type, str] = field(default_factory=dict)
    # What names of functions and types begin with; types may have another one.
    prefix: str = ""
    type_prefix: str = ""
    # Words that variables must not be called.
    reserved: Collection[str] = RESERVED
    # Blocks: how each kind begins, what ends it, what stands in an empty one.
    block_if: str = "if ({}) {{"
    block_else: str = "}} else {{"
    block_while: str = "while ({}) {{"
    block_for: str = "for ({k} = {first}; {k} < {end}; {k} = {k} + 1) {{"
    block_end: str = "}"
    empty: str = ""
    # The end of a statement, and a choice of two values.
    stop: str = ";"
    choice: str = "({test} ? {yes} : {no})"
    # Whether a loop declares its variable.
    loop_declares: bool = False
    # A struct or tuple, of `items` or of `named` fields.
    built: str = ""
    # A struct as a constant, where that is written otherwise.
    initial: str = ""
    # The declaration of a variable, with a harmless value.
    variable: str = ""
    # What stands before a function that kernels expand, and before others.
    expanded: str = ""
    called: str = ""
    # The lines before the body of a function, and what further lines of its comment begin with.
    head: str = ""
    margin: str = "   "
    # A statement that names a parameter which is not read, so that compilers do not warn.
    unread: str = ""
    # What stands in place of parameters where there are none.
    nothing: str = ""
    # What stands before a function that is offered.
    offered: str = ""
    # The definition of a struct, and of one of its fields.
    struct: str = ""
    member: str = ""
    # The definition of a constant: a number, a struct, a list.
    constant_number: str = ""
    constant_struct: str = ""
    constant_list: str = ""
    # A list of structs, where that is written otherwise.
    constant_structs: str = ""
    # Whether structs are objects that are written into, since new ones cost time.
    in_place: bool = False

    def name(self, text: str) -> str:
        """The name of a variable or parameter."""
        if text not in self.reserved:
            return text
        return f"{text}_" if text.strip("_") else "unread_"

    def function(self, text: str) -> str:
        """The name of a function."""
        return f"{self.prefix}{text}"

    def constant(self, text: str) -> str:
        """The name of a constant."""
        return f"{self.prefix.upper()}{text}"

    def type(self, kind: Type) -> str:
        """How a type is written."""
        if kind in self.types:
            return self.types[kind]
        return f"{self.type_prefix or self.prefix}{type_name(kind)}"

    def declared(self, kind: Type, name: str) -> str:
        """The name of a variable or function, behind its type where that is written."""
        return f"{self.type(kind)} {name}" if self.types else name

    def local(self, kind: Type, name: str) -> str:
        """The declaration of a variable at the top of a function."""
        zero = "FITBALL_EMPTY_" if fields_of(kind) else "0"
        return self.variable.format(
            declared=self.declared(kind, self.name(name)),
            type=self.type(kind),
            zero=zero,
        )

    def make(self, kind: Type, texts: Sequence[str]) -> str:
        """A struct or tuple whose fields have these texts."""
        named = (f"{name}: {text}" for name, text in zip(fields_of(kind), texts, strict=True))
        return self.built.format(
            type=self.type(kind),
            items=", ".join(texts),
            named=", ".join(named),
        )

    def definition(self, kind: Type) -> str:
        """The definition of a struct or tuple."""
        taken = [self.declared(of_field, name) for name, of_field in fields_of(kind).items()]
        stores = " ".join(f"this.{name} = {name};" for name in fields_of(kind))
        fields = "\n".join(f"    {self.member.format(text)}" for text in taken)
        lines = "\n".join(f"        self.{name} = {name}" for name in fields_of(kind))
        return self.struct.format(
            type=self.type(kind),
            fields=fields,
            taken=", ".join(taken),
            stores=stores,
            lines=lines,
        )

    def literal(self, value: PortConstant) -> str:
        """A number, or a named tuple of numbers, as a constant is written."""
        if isinstance(value, bool):
            return "true" if value else "false"
        if not isinstance(value, tuple):
            return repr(value)
        items = [self.literal(field) for field in value]
        name = type(value).__name__
        if self.in_place and name not in OFFERED_TYPES:
            return f"{name}_fill_({', '.join(items)}, new {name}_())"
        if self.initial:
            return self.initial.format(", ".join(items))
        return self.make(type(value), items)

    def constant_of(self, name: str, value: PortConstant) -> str:
        """The definition of a constant."""
        form = self.constant_struct if isinstance(value, tuple) else self.constant_number
        if isinstance(value, list):
            structs = isinstance(value[0], tuple) and self.constant_structs
            return (structs or self.constant_list).format(
                type=self.type(type(value[0])),
                name=self.constant(name),
                items=wrapped(map(self.literal, value)),
            )
        return form.format(
            type=self.type(type(value)),
            name=self.constant(name),
            value=self.literal(value),
        )


def type_name(kind: Type) -> str:
    """The name of a struct, of a tuple, or of a type of Python."""
    if origin_of(kind) is tuple:
        return "_".join(["tuple", *map(type_name, get_args(kind))])
    return str(kind.__name__)


C = Dialect(
    {name: f"{name}({{}})" for name in (*_FUNCTIONS, "log1p", "hypot", "fabs", "copysign")},
    {"pi": "3.141592653589793", "nan": "((double)NAN)", "inf": "((double)INFINITY)"},
    _EVERYWHERE,
    {"//": "({} / {})", "<<": "((int64_t){} << {})"},
    cast="((double){})",
    truncate="((int64_t){})",
    types={float: "double", int: "int64_t", bool: "bool"},
    prefix="fitball_",
    built="FITBALL_MAKE_({type}, {items})",
    initial="{{{}}}",
    variable="{declared} = {zero}",
    expanded="FITBALL_EXPANDED_",
    called="static inline",
    head="/* {comment} */\n{how} {declared}({taken})\n{{",
    unread="(void){};",
    nothing="void",
    struct="typedef struct {{\n{fields}\n}} {type};",
    member="{};",
    constant_number="#define {name} ({value})",
    constant_struct="static const {type} {name} = {value};",
    constant_list="static const {type} {name}[] = {{\n{items}}};",
)

# Without anything new, which Unity and Mono have had for long.
CSHARP = Dialect(
    {name: f"Math.{name.capitalize()}({{}})" for name in _FUNCTIONS} | {"fabs": "Math.Abs({})"},
    {"pi": "Math.PI", "nan": "double.NaN", "inf": "double.PositiveInfinity"},
    {
        **_EVERYWHERE,
        "math.hypot": offered.hypot,
        "math.log1p": offered.log1p,
        "math.copysign": offered.copysign,
    },
    {"//": "({} / {})", "<<": "({} << (int)({}))"},
    offered="public ",
    truncate="((long){})",
    types={float: "double", int: "long", bool: "bool"},
    built="new {type}({items})",
    variable="{declared} = default({type})",
    head="/* {comment} */\n{offered}static {declared}({taken})\n{{",
    struct="public struct {type}\n{{\n{fields}\n    public {type}({taken}) {{ {stores} }}\n}}",
    member="public {};",
    constant_number="const {type} {name} = {value};",
    constant_struct="static readonly {type} {name} = {value};",
    constant_list="static readonly {type}[] {name} = {{\n{items} }};",
)

JAVASCRIPT = Dialect(
    {name: f"Math.{name}({{}})" for name in (*_FUNCTIONS, "log1p")} | {"fabs": "Math.abs({})"},
    {"pi": "Math.PI", "nan": "NaN", "inf": "Infinity"},
    {
        "**6": offered.sixth,
        "<<": offered.shifted,
        "math.hypot": offered.hypot,
        "math.copysign": offered.copysign,
    },
    # Its own operators on bits see 32 of them; phases are packed into bits that are free.
    {"//": "Math.floor({} / {})", "|": "({} + {})"},
    truncate="Math.trunc({})",
    built="{{ {named} }}",
    variable="let {declared}",
    head="/** {comment} */\nfunction {declared}({taken}) {{",
    constant_number="const {name} = {value};",
    constant_struct="const {name} = {value};",
    constant_list="const {name} = [\n{items}];",
    reserved=RESERVED | {"result", "from"},
    in_place=True,
)

# Godot 3 and 4. Divisions by zero are errors there, as in Python.
GDSCRIPT = Dialect(
    {name: f"{name}({{}})" for name in _FUNCTIONS} | {"fabs": "abs({})"},
    {"pi": "PI", "nan": "NAN", "inf": "INF"},
    {
        **_EVERYWHERE,
        "/": python.over,
        "math.hypot": offered.hypot,
        "math.log1p": offered.log1p,
        "math.copysign": offered.copysign,
    },
    {"//": "({} / {})", "<<": "({} << {})"},
    cast="float({})",
    truncate="int({})",
    type_prefix="Bounce",
    reserved=RESERVED | _GDSCRIPT_RESERVED,
    block_if="if {}:",
    block_else="else:",
    block_while="while {}:",
    block_for="for {k} in range({first}, {end}):",
    block_end="",
    empty="pass",
    stop="",
    choice="({yes} if {test} else {no})",
    loop_declares=True,
    built="{type}.new({items})",
    variable="var {declared}",
    margin="# ",
    head="# {comment}\nfunc {declared}({taken}):",
    struct="class {type}:\n{fields}\n    func _init({taken}):\n{lines}\n",
    member="var {}",
    constant_number="const {name} = {value}",
    constant_struct="var {name} = {value}",
    constant_list="const {name} = [\n{items}]",
    constant_structs="var {name} = [\n{items}]",
)
