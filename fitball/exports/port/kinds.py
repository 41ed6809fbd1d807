"""Types of the restricted Python of the kernels, as every language of the ports sees them."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from fitball.exports.port.kernel_source import UnportableError


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
