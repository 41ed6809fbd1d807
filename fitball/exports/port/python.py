"""A calibrated bounce as a Python module that needs nothing but `math`."""

from __future__ import annotations

import ast
import builtins
from collections.abc import Iterable

from fitball.exports.port.kernel_source import UnportableError, free_names
from fitball.exports.port.port import Port
from fitball.exports.port.render import rendered


def python_port(port: Port) -> str:
    """The module's text. Raises UnportableError when it would use more than `math` and what it defines itself."""
    source = port.source
    text = rendered(
        port,
        "port.py.j2",
        constants=source.constants,
        classes="\n\n\n".join(_class(name, fields) for name, fields in source.structs.items()),
        functions="\n\n\n".join(map(_function, source.functions)),
    )
    check_self_contained(text)
    return text


def check_self_contained(text: str) -> None:
    """Raise UnportableError unless a module imports `math` alone and every name in it is its own or a builtin."""
    tree = ast.parse(text)
    known = {*dir(builtins), "math", "__name__"}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) or (isinstance(node, ast.Import) and node.names[0].name != "math"):
            raise UnportableError(f"the module imports more than math: {ast.unparse(node)}")
    for item in tree.body:
        if isinstance(item, (ast.ClassDef, ast.FunctionDef)):
            known.add(item.name)
        elif isinstance(item, ast.Assign):
            known |= {node.id for node in ast.walk(item.targets[0]) if isinstance(node, ast.Name)}
    for item in tree.body:
        if isinstance(item, ast.FunctionDef) and (strange := free_names(item) - known):
            raise UnportableError(f"{item.name} uses {', '.join(sorted(strange))}, which the module does not have")


def _class(name: str, fields: Iterable[str]) -> str:
    """A class for a named tuple, which would need an import."""
    lines = [f"class {name}:", f"    def __init__(self, {', '.join(fields)}):"]
    return "\n".join([*lines, *(f"        self.{field} = {field}" for field in fields)])


def _function(function: ast.FunctionDef) -> str:
    """A kernel's text without annotations, which name types that a port does not have."""
    plain = ast.parse(ast.unparse(function)).body[0]
    assert isinstance(plain, ast.FunctionDef)
    plain.returns = None
    for argument in plain.args.args:
        argument.annotation = None
    return ast.unparse(plain)
