"""The house: sizes against their ceilings, and the list of what is still empty."""

import ast
import importlib.util
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_spec = importlib.util.spec_from_file_location("size", ROOT / "scripts" / "size.py")
assert _spec is not None and _spec.loader is not None
size = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(size)


def _empty(text):
    """Whether any function's body is its docstring alone (of protocols it is meant so)."""
    tree = ast.parse(text)
    meant = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and any(ast.unparse(base) == "Protocol" for base in node.bases)
        for inner in ast.walk(node)
    }
    return any(
        isinstance(node, ast.FunctionDef)
        and id(node) not in meant
        and all(isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) for line in node.body)
        for node in ast.walk(tree)
    )


def _words_alone(place):
    """Whether a module is its docstring alone; rooms may be."""
    return place.name != "__init__.py" and len(ast.parse(place.read_text(encoding="utf-8")).body) < 2


def _module(place):
    parts = place.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def test_the_list_of_empty_modules_is_exact():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    listed = next(o for o in settings["tool"]["mypy"]["overrides"] if o.get("disable_error_code") == ["empty-body"])
    places = sorted((ROOT / "fitball").rglob("*.py"))
    empty = [_module(p) for p in places if _empty(p.read_text(encoding="utf-8")) or _words_alone(p)]
    assert sorted(listed["module"]) == sorted(empty)


def test_sizes_stay_below_their_ceilings():
    found = size.sizes().values()
    assert sum(lines for lines, _ in found) <= size.LINES
    assert sum(modules for _, modules in found) <= size.MODULES
    assert size.total("tests") <= size.TEST_LINES
    assert size.total("scripts") <= size.SCRIPT_LINES


def test_an_empty_body_is_noticed():
    assert _empty('def f() -> int:\n    """Nothing."""\n')
    assert not _empty('def f() -> int:\n    """One."""\n    return 1\n')
