"""Structs in place: the walk for JavaScript, where each new object, and each number that is handed
to a large function, is a piece of memory that must be found and given back.

A variable of a struct is an object of its function that is made once; what is assigned to it is
written into it. A function writes its struct into an object of its caller, `result`, and returns
that. Large functions find numbers in an object that their callers write. Functions that call each
other in a circle would write into their own objects: they are refused.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

from fitball.exports.ports.dialects import OFFERED_TYPES, Dialect, type_name
from fitball.exports.ports.source import KernelSource, Type, UnportableError, fields_of
from fitball.exports.ports.translate import Walk, stored_in, text_of

# The object that a function writes its struct into. No variable may have this name.
RESULT = "result"
# Nodes of the syntax tree of a function from which on engines do not expand it where it is called.
LARGE = 60

# The values that are assigned to variables of structs, by variable.
Values = Mapping[str, Sequence[ast.expr]]


def translated(source: KernelSource, name: str, dialect: Dialect) -> str:
    """One function of a source, behind its objects.

    Raises:
        UnportableError: a construct has no translation (`no-port`).
    """
    walk = InPlace(source, name, dialect)
    text = text_of(walk)
    return "\n".join([*walk.objects(), text])


def definitions(kinds: Iterable[Type], text: str) -> list[str]:
    """The functions that make, copy and fill objects of structs, as far as a text calls them."""
    known = [function for kind in kinds for function in _functions(kind)]
    needed = list[str]()
    count = -1
    while len(needed) > count:
        count = len(needed)
        whole = "\n".join([text, *needed])
        needed = [body for name, body in known if re.search(rf"\b{name}\(", whole)]
    return needed


def _functions(kind: Type) -> Iterator[tuple[str, str]]:
    """Names and texts of the functions of a struct: a new object, a copy of one, one of fields."""
    name = type_name(kind)
    # Numbers are NaN at first: engines keep 0 as an integer, and would make room for a real one.
    first: dict[Type, str] = {float: "NaN", int: "0", bool: "false"}
    begins = {
        key: first.get(of_field) or new(of_field) for key, of_field in fields_of(kind).items()
    }
    if name in OFFERED_TYPES:
        fields = ", ".join(f"{key}: {begin}" for key, begin in begins.items())
        yield _function(f"{name}_new_", [], [f"return {{ {fields} }};"])
    else:
        # Of a constructor, so that engines know its objects from those of other structs.
        yield _function(f"{name}_", [], [f"this.{key} = {begin};" for key, begin in begins.items()])
    copied = list[str]()
    filled = list[str]()
    for key, of_field in fields_of(kind).items():
        nested = type_name(of_field) if fields_of(of_field) else ""
        for lines, value in ((copied, f"from.{key}"), (filled, key)):
            place = f"{RESULT}.{key}"
            lines.append(f"{nested}_put_({value}, {place});" if nested else f"{place} = {value};")
    yield _function(f"{name}_put_", ["from", RESULT], copied)
    yield _function(f"{name}_fill_", [*fields_of(kind), RESULT], [*filled, f"return {RESULT};"])


def _function(name: str, taken: Sequence[str], lines: Sequence[str]) -> tuple[str, str]:
    """Name and text of a function."""
    body = (f"    {line}" for line in lines)
    return name, "\n".join([f"function {name}({', '.join(taken)}) {{", *body, "}"])


def new(kind: Type) -> str:
    """A new object of a struct."""
    name = type_name(kind)
    return f"{name}_new_()" if name in OFFERED_TYPES else f"new {name}_()"


class InPlace(Walk):
    """The walk over one function.

    `spare` are objects for what its expressions make, by node, and `terms` variables for numbers in
    them. `behind` are the variables that stay references, with those whose parts they may be.
    `shared` are variables whose objects are items of a tuple, by the item. `placed` are variables
    that are parts of the result.
    """

    def __init__(self, source: KernelSource, name: str, dialect: Dialect) -> None:
        super().__init__(source, name, dialect)
        self.spare: dict[int, tuple[str, Type]] = {}
        self.terms: dict[int, str] = {}
        self.behind: dict[str, set[str]] = {}
        self.shared: dict[str, str] = {}
        self.placed: dict[str, str] = {}
        self.parameters = {argument.arg for argument in source.functions[name].args.args}
        self.offered = not name.endswith("_")

    def infer(self) -> None:
        """Find types, and where variables are kept. Raises UnportableError, also for a parameter
        that is assigned what a function makes.
        """
        super().infer()
        values = self.assigned()
        self.behind = self.references(values)
        self.shared = self.sharing(values)
        self.placed = self.placing(values)
        for name in self.parameters & values.keys():
            if self.is_object(name):
                raise UnportableError(f"{self.name}: the parameter {name} is assigned")
        self.spare.clear()
        self.terms.clear()

    def is_object(self, name: str) -> bool:
        """Whether a variable is a struct with an object of its own."""
        return bool(fields_of(self.kinds[name])) and name not in self.behind

    def assigned(self) -> dict[str, list[ast.expr]]:
        """All that is assigned to each variable of a struct."""
        values = dict[str, list[ast.expr]]()
        for node in self.nodes():
            match node:
                case ast.Assign(targets=[ast.Name(id=name)], value=value) if name in self.read:
                    if fields_of(self.kinds[name]):
                        values.setdefault(name, []).append(value)
        return values

    def references(self, values: Values) -> dict[str, set[str]]:
        """The variables that stay references: nothing is assigned to them but parts of parameters,
        of constants, and of variables that are assigned once, outside of loops. Parts of what a
        user hands over are copied.
        """
        loops = [node for node in self.nodes() if isinstance(node, ast.For | ast.While)]
        repeated = {name for loop in loops for name in stored_in(loop)}
        lasting = {name for name, its in values.items() if len(its) == 1} - repeated
        lasting |= self.source.constants.keys()
        lasting |= set[str]() if self.offered else self.parameters
        found = {name: {*map(root_of, its)} for name, its in values.items()}
        before = 0
        while len(found) != before:
            before = len(found)
            found = {name: its for name, its in found.items() if its <= {*lasting, *found}}
        for name, its in values.items():
            match its:
                # Or either a constant or what a function makes, in an object of that call.
                case [ast.IfExp(body=ast.Call() as call, orelse=ast.Name(id=other))] if (
                    other in self.source.constants and name not in names_in(call)
                ):
                    found[name] = {other}
        return found

    def sharing(self, values: Values) -> dict[str, str]:
        """The variables whose objects are items of tuples, by the items: what a function returns
        in a tuple that is taken apart is written where it goes, unless it is made of that.
        """
        items = dict[str, str]()
        for name, its in values.items():
            for value in its:
                match value:
                    case ast.Subscript(value=ast.Name(id=whole)) if (
                        self.is_object(name)
                        and self.is_object(whole)
                        and not any(self.reads(made, name) for made in values[whole])
                    ):
                        items[self.field(value)[0]] = name
        return items

    def placing(self, values: Values) -> dict[str, str]:
        """The variables that are parts of the result from the beginning: those that are returned as
        one part of it, and nowhere else.
        """
        if self.offered or not fields_of(self.result):
            return {}
        free = values.keys() - self.behind.keys() - {*self.shared.values()} - self.parameters
        places = dict[str, set[str]]()
        for node in self.nodes():
            match node:
                case ast.Return(value=ast.expr() as value):
                    for place, part in self.parts(value).items():
                        whole = isinstance(part, ast.Name)
                        for name in free & names_in(part):
                            places.setdefault(name, set()).add(place if whole else "")
        found = dict[str, str]()
        for name in sorted(places):
            (place, *more) = places[name]
            if place and not more and place not in found.values():
                found[name] = place
        return found

    def parts(self, node: ast.expr) -> dict[str, ast.expr]:
        """The parts of a struct that is made where it is returned, by their places in it; any other
        expression as a whole.
        """
        match node:
            case ast.Tuple():
                fields = self.items(node)
            case ast.Call(func=ast.Name(id=name)) if name not in self.source.signatures and (
                fields_of(self.code(node)[1])
            ):
                fields = self.built(node)[1]
            case _:
                return {"": node}
        return {
            f"{name}.{rest}".rstrip("."): part
            for name, item in fields.items()
            for rest, part in self.parts(item).items()
        }

    def local(self, variable: str) -> str:
        """The declaration of a variable: a name for its object, where it has one."""
        name = self.dialect.name(variable)
        if variable in self.placed:
            return f"const {name} = {RESULT}.{self.placed[variable]}"
        if self.is_object(variable):
            return f"const {name} = {self.object_name(variable)}"
        return super().local(variable)

    def object_name(self, name: str) -> str:
        """The name of an object of this function, outside of it."""
        return f"{self.name.rstrip('_')}_{name.rstrip('_')}_"

    def objects(self) -> Iterator[str]:
        """The definitions of the objects of this function, once it is walked."""
        given = self.given_to(self.name)
        if given:
            numbers = ", ".join(f"{name}: NaN" for name in given)
            yield f"const {given_name(self.name)} = {{ {numbers} }};"
        for variable in sorted(self.kinds.keys() - self.parameters - self.placed.keys()):
            if self.is_object(variable):
                yield f"const {self.object_name(variable)} = {new(self.kinds[variable])};"
        for name, kind in self.spare.values():
            yield f"const {name} = {new(kind)};"
        for item, variable in self.shared.items():
            whole, _, part = item.partition(".")
            yield f"{self.object_name(whole)}.{part} = {self.object_name(variable)};"

    def given_to(self, name: str) -> list[str]:
        """The parameters of a function that its callers write into an object: numbers, if it is
        large.
        """
        function = self.source.functions[name]
        if not name.endswith("_") or sum(1 for _ in ast.walk(function)) < LARGE:
            return []
        arguments = zip(function.args.args, self.source.signatures[name][0], strict=True)
        return [self.dialect.name(one.arg) for one, kind in arguments if kind is float]

    def more_locals(self) -> list[str]:
        """Declarations of the numbers that are found in an object, and of terms."""
        given = self.given_to(self.name)
        return [
            *(f"let {name} = {given_name(self.name)}.{name};" for name in given),
            *(f"let {name};" for name in self.terms.values()),
        ]

    def taken(self) -> list[str]:
        """What the function takes, as it is declared."""
        given = self.given_to(self.name)
        taken = [name for name in super().taken() if name not in given]
        if not fields_of(self.result):
            return taken
        return [*taken, f"{RESULT} = {new(self.result)}" if self.offered else RESULT]

    def code(self, node: ast.expr) -> tuple[str, Type]:
        """Text and type of an expression; minimum and maximum as a comparison, without a call."""
        match node:
            case ast.Call(func=ast.Name(id="min" | "max" as name), args=[first, other]):
                steps = list[str]()
                a = self.term(first, steps)
                b = self.term(other, steps)
                # As in Python: of equal numbers, and of NaN and a number, the first.
                sign = "<" if name == "min" else ">"
                return f"({', '.join([*steps, f'{b} {sign} {a} ? {b} : {a}'])})", float
        return super().code(node)

    def term(self, node: ast.expr, steps: list[str]) -> str:
        """The text of a number that is used twice, or later. An expression is stored in a variable
        by a further step.
        """
        text = self.fitted(node, float)
        if isinstance(node, ast.Name | ast.Constant):
            return text
        name = self.terms.setdefault(id(node), f"term_{len(self.terms) + 1}")
        steps.append(f"{name} = {text}")
        return name

    def spared(self, node: ast.AST, kind: Type) -> str:
        """The object for what an expression makes."""
        name = self.object_name(str(len(self.spare) + 1))
        return self.spare.setdefault(id(node), (name, kind))[0]

    def made(self, node: ast.expr, kind: Type, fields: Mapping[str, ast.expr]) -> str:
        """The text of a struct with these fields, in the object of `node`."""
        kinds = fields_of(kind)
        texts = [self.fitted(value, kinds[name]) for name, value in fields.items()]
        return f"{type_name(kind)}_fill_({', '.join([*texts, self.spared(node, kind)])})"

    def called_function(self, node: ast.Call, name: str) -> tuple[str, Type]:
        """Text and type of a call, whose struct is written into the object of `node`."""
        result = self.source.signatures[name][1]
        target = [self.spared(node, result)] if fields_of(result) else []
        steps = self.steps(node, name, target)
        return (f"({', '.join(steps)})" if len(steps) > 1 else steps[0]), result

    def steps(self, node: ast.Call, name: str, target: Sequence[str]) -> list[str]:
        """What calls a function of the source: numbers are written into its object, then comes the
        call, with a `target` for its struct.
        """
        order = list(self.source.functions)
        if order.index(name) >= order.index(self.name):
            raise UnportableError(f"{self.name} calls {name}, which calls it: one object for both")
        texts = self.texts(node.args, self.source.signatures[name][0], node)
        given = self.given_to(name)
        steps = list[str]()
        writes = list[str]()
        arguments = list[str]()
        parameters = self.source.functions[name].args.args
        for parameter, value, text in zip(parameters, node.args, texts, strict=True):
            known = self.dialect.name(parameter.arg)
            if known not in given:
                arguments.append(text)
                continue
            # A call within may write into the same object.
            if any(isinstance(inner, ast.Call) for inner in ast.walk(value)):
                text = self.term(value, steps)
            writes.append(f"{given_name(name)}.{known} = {text}")
        call = f"{self.dialect.function(name)}({', '.join([*arguments, *target])})"
        return [*steps, *writes, call]

    def statement(self, node: ast.stmt) -> list[str]:
        """The lines of a statement: structs that are assigned or returned are written in place."""
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=value) if (
                name in self.read and self.is_object(name)
            ):
                return self.stored(self.dialect.name(name), value, self.kinds[name])
            case ast.Return(value=ast.expr() as value) if fields_of(self.result):
                return [*self.stored(RESULT, value, self.result), f"return {RESULT};"]
        return super().statement(node)

    def stored(self, target: str, node: ast.expr, kind: Type) -> list[str]:
        """Statements that write a struct into a target: a variable, or a part of one."""
        match node:
            case ast.IfExp(test=test, body=yes, orelse=no):
                head = self.dialect.block_if.format(self.fitted(test, bool))
                first = [f"    {line}" for line in self.stored(target, yes, kind)]
                other = [f"    {line}" for line in self.stored(target, no, kind)]
                return [head, *first, self.dialect.block_else.format(), *other, *self.end()]
            case ast.Tuple():
                return self.filled(target, self.items(node), kind)
            case ast.Call(func=ast.Name(id=name)) if name in self.source.signatures:
                if not self.reads(node, target):
                    return [f"{step};" for step in self.steps(node, name, [target])]
            case ast.Call():
                fields = self.built(node)[1]
                if self.reads(node, target):
                    return self.changed(target, node, fields, kind)
                return self.filled(target, fields, kind)
        return self.put(target, self.fitted(node, kind), kind)

    def put(self, target: str, text: str, kind: Type) -> list[str]:
        """The statement that copies a struct into a target, unless it is there already."""
        place = f"{RESULT}.{self.placed[text]}" if text in self.placed else text
        if target in (text, place, self.shared.get(text)):
            return []
        return [f"{type_name(kind)}_put_({text}, {target});"]

    def filled(self, target: str, fields: Mapping[str, ast.expr], kind: Type) -> list[str]:
        """Statements that write fields into a target that none of them reads."""
        lines = list[str]()
        for name, node in fields.items():
            of_field = fields_of(kind)[name]
            if fields_of(of_field):
                lines += self.stored(f"{target}.{name}", node, of_field)
            else:
                lines.append(f"{target}.{name} = {self.fitted(node, of_field)};")
        return lines

    def changed(
        self, target: str, node: ast.Call, fields: Mapping[str, ast.expr], kind: Type
    ) -> list[str]:
        """Statements that write fields into a target that some of them read: all are read first."""
        kinds = fields_of(kind)
        reads = list[str]()
        writes = list[str]()
        for name, value in fields.items():
            text = self.fitted(value, kinds[name])
            if text == f"{target}.{name}":
                continue
            if fields_of(kinds[name]):
                return self.put(target, self.code(node)[0], kind)
            reads.append(f"    const {name}_now = {text};")
            writes.append(f"    {target}.{name} = {name}_now;")
        return ["{", *reads, *writes, "}"]

    def reads(self, node: ast.expr, target: str) -> bool:
        """Whether an expression reads the variable of a target, itself or by a reference."""
        names = names_in(node)
        count = 0
        while len(names) > count:
            count = len(names)
            names = names.union(*(self.behind.get(name, set()) for name in names))
        return target.partition(".")[0] in map(self.dialect.name, names)


def given_name(name: str) -> str:
    """The object in which a function finds its numbers."""
    return f"{name.rstrip('_')}_in_"


def names_in(node: ast.AST) -> set[str]:
    """The names that stand in a syntax tree."""
    return {inner.id for inner in ast.walk(node) if isinstance(inner, ast.Name)}


def root_of(node: ast.expr) -> str:
    """The variable whose part an expression is; empty for an expression that makes a value."""
    match node:
        case ast.Name(id=name):
            return name
        case ast.Attribute(value=value) | ast.Subscript(value=value):
            return root_of(value)
    return ""
