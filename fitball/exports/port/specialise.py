"""A kernel's syntax tree narrowed to plain floats, without what only derivatives and logs of phases need."""

from __future__ import annotations

import ast
from collections.abc import Set as AbstractSet

# The optional log of phases: a parameter of this name is always None in a port.
PHASE_LOG = "phase_log"
# The kind of number a kernel takes where it serves floats and derivatives alike (`models.dual`).
NUMBER = "Number"


def specialised(function: ast.FunctionDef, math_names: AbstractSet[str]) -> ast.FunctionDef:
    """The function for floats: calls of `math_names` go to `math`, carried derivatives, the phase log and whatever
    was computed for their sake alone are left out.
    """
    generic = any(isinstance(node, ast.Name) and node.id == NUMBER for node in ast.walk(function))
    function.decorator_list = []
    function.args.args = [argument for argument in function.args.args if argument.arg != PHASE_LOG]
    narrowed = _Narrow(math_names, generic).visit(function)
    assert isinstance(narrowed, ast.FunctionDef)
    # Until every name that is assigned is read; expressions have no effects here.
    dropping = True
    while dropping:
        dropper = _Drop(narrowed)
        dropper.visit(narrowed)
        dropping = dropper.dropped
    return ast.fix_missing_locations(narrowed)


class _Narrow(ast.NodeTransformer):
    def __init__(self, math_names: AbstractSet[str], generic: bool) -> None:
        self.math_names, self.generic = math_names, generic

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name):
            if node.func.id == "carry":
                return node.args[0]
            if node.func.id in self.math_names:
                node.func = ast.Attribute(ast.Name("math", ast.Load()), node.func.id, ast.Load())
        node.args = [child for child in node.args if not _is_log(child)]
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        self.generic_visit(node)
        # A float is its own real part.
        return node.value if self.generic and node.attr == "real" else node

    def visit_If(self, node: ast.If) -> ast.AST | None:
        test = node.test
        if isinstance(test, ast.Compare) and _is_log(test.left) and isinstance(test.ops[0], ast.IsNot):
            return None
        self.generic_visit(node)
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        self.generic_visit(node)
        assert node.value is not None
        return ast.Assign([node.target], node.value)


def _is_log(node: ast.expr) -> bool:
    named = isinstance(node, ast.Name) and node.id == PHASE_LOG
    return named or (isinstance(node, ast.Constant) and node.value is None)


class _Drop(ast.NodeTransformer):
    """Removes assignments to names that nothing reads."""

    def __init__(self, function: ast.FunctionDef) -> None:
        names = [node for node in ast.walk(function) if isinstance(node, ast.Name)]
        self.read = {node.id for node in names if isinstance(node.ctx, ast.Load)}
        self.dropped = False

    def visit_Assign(self, node: ast.Assign) -> ast.AST | None:
        target = node.targets[0]
        if isinstance(target, ast.Name) and target.id not in self.read:
            self.dropped = True
            return None
        return node
