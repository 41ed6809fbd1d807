"""Random small changes of the code, each met by the tests that reach it: which would nobody notice?

Not part of the suite: `python tests/mutate.py --seed 1 --count 60 --out mutants.csv`. The tree is copied; a first run
of every test file records which lines it reaches (kept in `--reach`, to be used again); then each mutant is met by
the test files that reach its line, those first that reach least else, until one fails. A survivor is either
equivalent (no input tells it from the original) or a hole in the tests: that is for a person to say.
"""

from __future__ import annotations

import argparse
import ast
import csv
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
COPIED = ("fitball", "datasets", "tests", "scripts", "fits", "pyproject.toml", "README.md", "CHANGELOG.md")
# Test files that run compiled kernels, whose lines no tracer sees.
KERNEL_TESTS = (
    "small_and_flat", "certificates", "laws", "kernel_oracle", "jacobian", "history", "hard_cases",
    "thesis_model", "force_likelihood", "export_ports", "export_languages",
)  # fmt: skip
COMPARED = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
COMPUTED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult}
JOINED = {ast.And: ast.Or, ast.Or: ast.And}
# Seconds after which a test file that does not end has noticed, too.
PATIENCE = 900


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


def reached(root: Path, place: Path, judging: str) -> dict[str, dict[str, list[int]]]:
    """Lines of each file that each test file reaches, measured once and kept in `place`."""
    if place.exists():
        return json.loads(place.read_text(encoding="utf-8"))
    found = {}
    for path in sorted((root / "tests").glob(judging)):
        print(f"reach of {path.name}", file=sys.stderr)
        measure = [sys.executable, "-m", "coverage"]
        run = [
            *measure,
            "run",
            "--source=fitball",
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            f"tests/{path.name}",
        ]
        subprocess.run(run, cwd=root, capture_output=True, check=False)
        subprocess.run([*measure, "json", "-q", "-o", "reach.json"], cwd=root, check=True)
        files = json.loads((root / "reach.json").read_text(encoding="utf-8"))["files"]
        found[path.name] = {name: item["executed_lines"] for name, item in files.items() if item["executed_lines"]}
    place.write_text(json.dumps(found), encoding="utf-8")
    return found


def judges(root: Path, mutant: Mutant, reach: dict[str, dict[str, list[int]]]) -> list[str]:
    """Test files that reach a mutant's line within a function, those first that reach little else."""
    source = (root / mutant.file).read_text(encoding="utf-8")
    tree = ast.parse(source)
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    within = [node for node in functions if node.lineno <= mutant.line <= (node.end_lineno or 0)]
    if "@compiled" in source or "@inlined" in source:
        return [f"test_{name}.py" for name in KERNEL_TESTS]
    # A statement of many lines is reached where it begins.
    around = [node for node in ast.walk(tree) if isinstance(node, ast.stmt)]
    around = [node for node in around if node.lineno <= mutant.line <= (node.end_lineno or 0)]
    begun = max(node.lineno for node in around)
    bodies = {line for node in functions for line in range(node.body[0].lineno, (node.end_lineno or 0) + 1)}
    wanted = {begun} if within else bodies
    found = {name: files for name, files in reach.items() if wanted & set(files.get(mutant.file, ()))}
    return sorted(found, key=lambda name: sum(len(lines) for lines in found[name].values()))


def met(root: Path, mutant: Mutant, tests: list[str]) -> str:
    """The first test that fails on a mutant, "" when none does."""
    path = root / mutant.file
    source = path.read_text(encoding="utf-8")
    first, last = mutant.span
    path.write_text(source[:first] + mutant.after + source[last:], encoding="utf-8")
    try:
        for name in tests:
            words = [
                sys.executable,
                "-m",
                "pytest",
                "-x",
                "-q",
                "--no-header",
                "-p",
                "no:cacheprovider",
                f"tests/{name}",
            ]
            try:
                done = subprocess.run(words, cwd=root, capture_output=True, text=True, timeout=PATIENCE, check=False)
            except subprocess.TimeoutExpired:
                return f"{name} does not end"
            if done.returncode:
                failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
                return failed[0].split(" - ")[0] if failed else f"{name}: exit {done.returncode}"
    finally:
        path.write_text(source, encoding="utf-8")
    return ""


def main() -> None:
    """Draw mutants, meet them, write one row each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--out", type=Path, default=Path("mutants.csv"))
    parser.add_argument("--reach", type=Path, default=Path("reach.json"))
    parser.add_argument("--within", metavar="FOLDER", default="fitball", help="draw mutants of this part only")
    parser.add_argument("--judges", metavar="GLOB", default="test_*.py", help="test files that take part")
    parser.add_argument("--at", metavar="FILE:LINE", action="append", help="every mutant of these lines instead")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(scratch) / "copy"
        root.mkdir()
        for name in COPIED:
            copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
            copy(ROOT / name, root / name)
        reach = reached(root, given.reach, given.judges)
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
                tests = judges(root, item, reach)
                outcome = met(root, item, tests) or ("survived" if tests else "reached by no test")
                rows.writerow((f"{item.file}:{item.line}", item.before, item.after, outcome))
                file.flush()
                print(f"{item.file}:{item.line}  {item.before} -> {item.after}  {outcome}", file=sys.stderr)


if __name__ == "__main__":
    main()
