"""Random small changes of the code, each met by the tests that reach it: which would nobody notice?

Not part of the suite: `python tests/mutate.py --seed 1 --count 60 --out mutants.csv`. The tree is copied; the suite
is run once, with what pytest is given behind `--` (`-m "not slow"`), to record which test reaches which line (kept
in `--reach`, to be used again); then each mutant runs the tests that reach its line, those first that reach least
else, until one fails. A survivor is either equivalent (no input separates it from the original) or a hole in the
tests: a person decides.
"""

from __future__ import annotations

import argparse
import ast
import csv
import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import coverage
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
COPIED = ("fitball", "datasets", "tests", "scripts", "fits", "docs", "pyproject.toml", "README.md", "CHANGELOG.md")
# Test files that run compiled kernels, whose lines no tracer sees.
KERNEL_TESTS = (
    "small_and_flat", "certificates", "laws", "kernel_oracle", "jacobian", "history", "hard_cases",
    "thesis_model", "force_likelihood", "export_ports",
)  # fmt: skip
COMPARED = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
COMPUTED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult}
JOINED = {ast.And: ast.Or, ast.Or: ast.And}
# Seconds after which tests that do not end have noticed, too, and tests that meet a mutant at most.
PATIENCE, MOST = 900, 60


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """As a plugin of the recorded run: lines that run now are reached by this test."""
    if (running := coverage.Coverage.current()) is not None:
        running.switch_context(item.nodeid)
    return (yield)


@dataclass(frozen=True)
class Mutant:
    """One expression of a file and what stands in its place; `span` are its first and last character."""

    file: str
    line: int
    span: tuple[int, int]
    before: str
    after: str


def changed(node: ast.expr) -> ast.expr | None:
    """The expression with one thing altered, None where there is nothing to alter."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARED:
        return ast.Compare(node.left, [COMPARED[type(node.ops[0])]()], node.comparators)
    if isinstance(node, ast.BinOp) and type(node.op) in COMPUTED:
        return ast.BinOp(node.left, COMPUTED[type(node.op)](), node.right)
    if isinstance(node, ast.BoolOp):
        return ast.BoolOp(JOINED[type(node.op)](), node.values)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        return node.operand
    if isinstance(node, ast.IfExp):
        return ast.IfExp(node.test, node.orelse, node.body)
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        return ast.Constant(not node.value)
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return ast.Constant(node.value + 1 if isinstance(node.value, int) else 1.1 * node.value + 1e-3)
    return None


def expressions(tree: ast.AST) -> Iterator[ast.expr]:
    """Expressions that are evaluated: no annotations, no decorators, no words."""
    for field, value in ast.iter_fields(tree):
        if field in ("annotation", "returns", "decorator_list") or isinstance(tree, ast.JoinedStr):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.expr):
                yield child
            if isinstance(child, ast.AST):
                yield from expressions(child)


def mutants(root: Path) -> list[Mutant]:
    """Every mutant of the package."""
    found = []
    for path in sorted((root / "fitball").rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        starts = [0]
        for line in source.splitlines(keepends=True):
            starts.append(starts[-1] + len(line))
        for node in expressions(ast.parse(source)):
            other = changed(node)
            if other is None or not source.isascii():
                continue
            first, last = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
            after = f"({ast.unparse(ast.fix_missing_locations(other))})"
            found.append(Mutant(str(path.relative_to(root)), node.lineno, (first, last), source[first:last], after))
    return found


def reached(root: Path, place: Path, asked: list[str]) -> coverage.CoverageData:
    """Which test reaches which line, measured once and kept in `place`."""
    if not place.exists():
        settings = root / "reach.ini"
        settings.write_text(f"[run]\nsource = fitball\nrelative_files = true\ndata_file = {place.resolve()}\n")
        run = ["-m", "coverage", "run", f"--rcfile={settings}", "-m", "pytest", "-q", "-p", "mutate", *asked, "tests"]
        subprocess.run([sys.executable, *run], cwd=root, env=_environment(root), check=False)
    data = coverage.CoverageData(str(place))
    data.read()
    return data


def _environment(root: Path) -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(root), str(root / "tests")])}


def judges(root: Path, mutant: Mutant, reach: coverage.CoverageData, sizes: Counter[str]) -> list[str]:
    """Tests that reach a mutant's line within a function, those first that reach little else."""
    source = (root / mutant.file).read_text(encoding="utf-8")
    tree = ast.parse(source)
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    within = [node for node in functions if node.lineno <= mutant.line <= (node.end_lineno or 0)]
    if "/kernels/" in mutant.file or "@compiled" in source or "@inner" in source:
        return [f"tests/test_{name}.py" for name in KERNEL_TESTS]
    # A statement of many lines is reached where it begins.
    around = [node for node in ast.walk(tree) if isinstance(node, ast.stmt)]
    around = [node for node in around if node.lineno <= mutant.line <= (node.end_lineno or 0)]
    begun = max(node.lineno for node in around)
    bodies = {line for node in functions for line in range(node.body[0].lineno, (node.end_lineno or 0) + 1)}
    lines = reach.contexts_by_lineno(mutant.file)
    found = {name for line in ({begun} if within else bodies) for name in lines.get(line, ()) if name}
    return sorted(found, key=lambda name: sizes[name])[:MOST]


def met(root: Path, mutant: Mutant, tests: list[str]) -> str:
    """The first test that fails on a mutant, "" when none does."""
    path = root / mutant.file
    source = path.read_text(encoding="utf-8")
    first, last = mutant.span
    path.write_text(source[:first] + mutant.after + source[last:], encoding="utf-8")
    words = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(
            words, cwd=root, env=_environment(root), capture_output=True, text=True, timeout=PATIENCE, check=False
        )
    except subprocess.TimeoutExpired:
        return "the tests do not end"
    finally:
        path.write_text(source, encoding="utf-8")
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if done.returncode > 1 and not failed:
        raise RuntimeError(f"pytest cannot run the tests of {mutant.file}:{mutant.line}\n{done.stdout}{done.stderr}")
    return failed[0].split(" - ")[0] if failed else "a test process died" * bool(done.returncode)


def main() -> None:
    """Draw mutants, meet them, write one row each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--out", type=Path, default=Path("mutants.csv"))
    parser.add_argument("--reach", type=Path, default=Path("reach.sqlite"))
    parser.add_argument("--within", metavar="FOLDER", default="fitball", help="draw mutants of this part only")
    parser.add_argument("--at", metavar="FILE:LINE", action="append", help="every mutant of these lines instead")
    parser.add_argument("asked", nargs="*", metavar="-- WORDS", help="what pytest is given for the recorded run")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(scratch) / "copy"
        root.mkdir()
        for name in COPIED:
            copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
            copy(ROOT / name, root / name)
        reach = reached(root, given.reach, given.asked)
        sizes = Counter(
            name
            for file in reach.measured_files()
            for names in reach.contexts_by_lineno(file).values()
            for name in names
        )
        everything = [item for item in mutants(root) if item.file.startswith(given.within)]
        chosen = [
            everything[k] for k in np.random.default_rng(given.seed).permutation(len(everything))[: given.count]
        ]
        if given.at:
            chosen = [item for item in everything if f"{item.file}:{item.line}" in given.at]
        with given.out.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(("place", "before", "after", "outcome"))
            for item in chosen:
                tests = judges(root, item, reach, sizes)
                outcome = (met(root, item, tests) or "survived") if tests else "reached by no test"
                rows.writerow((f"{item.file}:{item.line}", item.before, item.after, outcome))
                file.flush()
                print(f"{item.file}:{item.line}  {item.before} -> {item.after}  {outcome}", file=sys.stderr)


if __name__ == "__main__":
    main()
