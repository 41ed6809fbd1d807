"""Rooms of the package: what imports what, with every import and every address in a string."""

import ast
import importlib
import re
from pathlib import Path

import grimp
import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

import fitball

ADDRESS = re.compile(r"fitball(?:\.\w+)+")
# Calls that import what a text names.
IMPORTERS = {"import_module", "__import__", "find_spec", "exec_module"}


@pytest.fixture(scope="module")
def graph():
    """Imports among modules, those inside functions too, without those for checkers alone."""
    return grimp.build_graph("fitball", exclude_type_checking_imports=True, cache_dir=None)


@pytest.fixture(scope="module")
def trees():
    """The syntax tree of each module by name."""
    root = Path(fitball.__file__).parent
    found = {}
    for place in root.rglob("*.py"):
        parts = place.relative_to(root.parent).with_suffix("").parts
        name = ".".join(parts).removesuffix(".__init__")
        found[name] = ast.parse(place.read_text(encoding="utf-8"))
    return found


def addresses(tree):
    """Names of modules, or of something in them, that stand in strings which are no docstrings."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, documented) and node.body and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and id(node) not in docstrings and ADDRESS.fullmatch(text):
            yield text


def circles(modules, edges):
    """Groups of modules that reach each other."""
    place = {name: k for k, name in enumerate(modules)}
    pairs = np.array([(place[a], place[b]) for a, b in edges])
    matrix = csr_array((np.ones(len(pairs)), pairs.T), shape=(len(modules),) * 2)
    _, group = connected_components(matrix, connection="strong")
    groups = [[name for name in modules if group[place[name]] == k] for k in set(group.tolist())]
    return [names for names in groups if len(names) > 1]


def edges_of(graph):
    """Pairs of a module and one that it imports."""
    modules = sorted(graph.modules)
    pairs = [
        (name, other) for name in modules for other in graph.find_modules_directly_imported_by(name)
    ]
    return modules, pairs


def test_every_address_in_a_string_resolves(trees):
    for name, tree in trees.items():
        for address in addresses(tree):
            assert importlib.util.find_spec(address), f"{name}: {address}"


def test_only_the_public_names_are_addresses(trees):
    assert {name for name, tree in trees.items() if [*addresses(tree)]} == {"fitball"}


def test_no_module_imports_itself_over_others(graph, trees):
    modules, pairs = edges_of(graph)
    pairs += [(name, other) for name, tree in trees.items() for other in addresses(tree)]
    assert circles(modules, pairs) == []


def test_a_circle_is_seen(graph):
    modules, pairs = edges_of(graph)
    back = ("fitball.base.text", "fitball.results.fit")
    (circle,) = circles(modules, [*pairs, back])
    assert {*back} <= {*circle}


def test_imports_by_name_are_the_public_names_and_files_of_users(trees):
    calls = {
        name
        for name, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and getattr(node.func, "id", getattr(node.func, "attr", "")) in IMPORTERS
    }
    assert calls <= {"fitball", "fitball.models.own"}
