"""Types of the restricted Python of the kernels, and what they are in C99."""

from __future__ import annotations

import ast

from fitball.export.port.kernel_source import UnportableError

# d double, i integer, b truth value, z complex, A array of double, I array of integers, S array of double with two
# indices (rows of STRIDE), v nothing; a Python tuple of these is a struct.
Type = str | tuple["Type", ...]

STRIDE = 5
_PLAIN = {
    "d": "double",
    "i": "int64_t",
    "b": "bool",
    "z": "double complex",
    "A": "double *",
    "I": "const int64_t *",
    "S": "double *",
    "v": "void",
}
_NAMES: dict[str, Type] = {
    "float": "d", "Number": "d", "int": "i", "bool": "b", "complex": "z",
    "FloatArray": "A", "NumberArray": "A", "Scratch": ("A", "A", "A", "A", "S"),
}  # fmt: skip


def annotated(node: ast.expr | None) -> Type:
    """The type an annotation names. Raises UnportableError for one that kernels are not known to use."""
    if isinstance(node, ast.Constant) and node.value is None:
        return "v"
    if isinstance(node, ast.Name) and node.id in _NAMES:
        return _NAMES[node.id]
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
        if node.value.id == "tuple" and isinstance(node.slice, ast.Tuple):
            return tuple(annotated(item) for item in node.slice.elts)
        if node.value.id == "Basis":
            return ("d",) * 6
        if node.value.id == "NDArray" and "int64" in ast.unparse(node.slice):
            return "I"
    raise UnportableError(f"annotation {'missing' if node is None else ast.unparse(node)}: no C type is known for it")


def joined(one: Type, other: Type) -> Type:
    """The type that holds values of both. Raises UnportableError when there is none."""
    if one == other:
        return one
    for wide, narrow in (("d", "i"), ("z", "d"), ("z", "i")):
        if {one, other} == {wide, narrow}:
            return wide
    raise UnportableError(f"no C type holds both {one} and {other}")


def c_type(kind: Type, prefix: str) -> str:
    """How a type is written in C."""
    return _PLAIN[kind] if isinstance(kind, str) else f"{prefix}{_letters(kind)}"


def _letters(kind: Type) -> str:
    return kind.lower() if isinstance(kind, str) else "t" + "".join(map(_letters, kind)) + "_"


def struct_definitions(kinds: list[tuple[Type, ...]], prefix: str) -> list[str]:
    """Definitions of the structs of `kinds`, inner ones first, each once."""
    found: dict[str, str] = {}

    def define(kind: tuple[Type, ...]) -> None:
        for item in kind:
            if isinstance(item, tuple):
                define(item)
        fields = " ".join(f"{declared(item, f'f{k}', prefix)};" for k, item in enumerate(kind))
        name = c_type(kind, prefix)
        found.setdefault(name, f"typedef struct {{ {fields} }} {name};")

    for kind in kinds:
        define(kind)
    return list(found.values())


def declared(kind: Type, name: str, prefix: str) -> str:
    """The declaration of a variable."""
    text = c_type(kind, prefix)
    return f"{text}{name}" if text.endswith("*") else f"{text} {name}"
