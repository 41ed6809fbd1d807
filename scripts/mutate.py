"""Random small changes of the code, each run against the tests of its room until one fails: what
would nobody notice?

`python scripts/mutate.py --rooms data models --count 40 --seed 1`, in the environment of
scripts/test; with `--constants` only numbers of units and of module constants change. The tree is
copied. A survivor of its room's tests meets the whole suite. Of those that survive that too a
person decides: either no input separates them from the original, or the tests have a hole.
"""

from __future__ import annotations

import argparse
import ast
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
# Tests of a room, those most likely to fail first, by the beginning of the path of its modules; the
# first beginning that fits counts.
TESTS = {
    "models/kernels": "hard_cases laws oracle models history",
    "models/own": "own_model",
    "models/history": "history",
    "models/grip_slip": "grip_slip models",
    "models": "models grip_slip own_model history laws",
    "inference/differences": "differences density",
    "inference/problem/levels": "levels priors_joint",
    "inference/problem/camera": "camera",
    "inference/problem": "priors_joint density levels camera",
    "inference/judgement/first_order": "first_order",
    "inference/judgement/profile": "profile",
    "inference/judgement/verdict": "verdicts",
    "inference/derived": "derived",
    "inference/judgement/assumptions": "assumptions",
    "inference/judgement/adequacy": "adequacy",
    "inference/judgement/patterns": "adequacy",
    "inference/judgement/residuals": "adequacy",
    "inference/judgement/noise_tests": "adequacy",
    "inference/search": "search least_squares",
    "inference/sampling": "sampling importance",
    "inference/predictive": "predictive",
    "inference/fitted": "frames saved calibrate",
    "inference": "frames calibrate density priors_joint",
    "data/misreading": "misreading read_faults",
    "data/scene": "scene",
    "data/kinematics": "kinematics table",
    "data/balances": "kinematics",
    "data/check": "read read_faults",
    "data/force": "read",
    "data/in_words": "lines",
    "data/bundled": "bundled",
    "data/table": "table read",
    "data/labels": "read table",
    "data/checks": "read_faults read",
    "data/read": "read read_faults",
    "data": "dialects read read_faults hostile",
    "thesis": "thesis rederive",
    "base/itf": "itf",
    "base/units": "units dialects",
    "report/figures": "fit_figures plot",
    "report/fit": "fit_page",
    "report/check": "read_faults cli",
    "report/lab": "lab",
    "report/plan": "plan",
    "report/predict": "predict",
    "report/compare": "compare",
    "report/simulate": "simulate",
    "report/track": "track_page",
    "report/quantities": "fit_page derived",
    "report": "render fit_page result",
    "uses/hierarchy": "hierarchy batch",
    "uses/lab": "lab",
    "uses/means": "means",
    "uses/plan": "plan",
    "uses/information": "plan",
    "uses/compare": "compare",
    "uses/left_out": "compare",
    "uses": "predict simulate",
    "saved": "saved again",
    "batches": "batch",
    "tracks": "tracks tracks_read track_page",
    "exports/ports": "port port_space port_text",
    "exports/page": "exports_page",
    "exports": "exports",
    "speed": "bench",
    "results": "verbs result",
    "verbs": "verbs cli",
    "fit_verbs": "verbs cli",
    "": "text_numbers priors files result render scheduling cli calibrate",
}
# The comparison that a mutant has for each.
COMPARED = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}
# The arithmetic that a mutant has for each.
COMPUTED = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
}
# Seconds after which tests that do not end count as failed.
PATIENCE = 900


class Mutant(NamedTuple):
    """One expression of a file and what stands in its place; `first` and `last` are its bytes."""

    file: str
    line: int
    first: int
    last: int
    before: str
    after: str


def changed(node: ast.expr) -> ast.expr | None:
    """The expression with one thing altered, None where there is nothing to alter."""
    match node:
        case ast.Compare(ops=[op]) if type(op) in COMPARED:
            return ast.Compare(node.left, [COMPARED[type(op)]()], node.comparators)
        case ast.BinOp() if type(node.op) in COMPUTED:
            return ast.BinOp(node.left, COMPUTED[type(node.op)](), node.right)
        case ast.BoolOp():
            return ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            return node.operand
        case ast.IfExp():
            return ast.IfExp(node.test, node.orelse, node.body)
        case ast.Constant(value=bool()):
            return ast.Constant(not node.value)
        case ast.Constant(value=int(value)):
            return ast.Constant(value + 1)
        case ast.Constant(value=float(value)):
            return ast.Constant(1.1 * value + 1e-3)
    return None


def expressions(tree: ast.AST) -> Iterator[ast.expr]:
    """Expressions that are evaluated: no annotations, no decorators, no parts of texts."""
    for field, value in ast.iter_fields(tree):
        if field in ("annotation", "returns", "decorator_list") or isinstance(tree, ast.JoinedStr):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.expr):
                yield child
            if isinstance(child, ast.AST):
                yield from expressions(child)


def constants(tree: ast.Module) -> Iterator[ast.expr]:
    """Numbers of module constants, and in calls of `Unit` anywhere."""
    tops = [node for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign)]
    units = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "Unit"
    ]
    inside = [expression for node in (*tops, *units) for expression in expressions(node)]
    # A unit that is a module constant is met twice.
    for node in dict.fromkeys(inside):
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            yield node


def mutants(room: str, only_constants: bool = False) -> list[Mutant]:
    """Every mutant of the modules whose path in the package begins with `room`."""
    drawable = []
    for path in sorted((ROOT / "fitball").rglob("*.py")):
        if not str(path.relative_to(ROOT / "fitball")).startswith(room):
            continue
        source = path.read_bytes()
        starts = np.cumsum([0, *(len(line) for line in source.splitlines(keepends=True))])
        tree = ast.parse(source)
        for node in constants(tree) if only_constants else expressions(tree):
            other = changed(node)
            if other is not None:
                first = int(starts[node.lineno - 1]) + node.col_offset
                last = int(starts[(node.end_lineno or 0) - 1]) + (node.end_col_offset or 0)
                after = f"({ast.unparse(ast.fix_missing_locations(other))})"
                drawable.append(
                    Mutant(
                        str(path.relative_to(ROOT)),
                        node.lineno,
                        first,
                        last,
                        source[first:last].decode(),
                        after,
                    )
                )
    return drawable


def failing(tree: Path, tests: list[str]) -> str:
    """The first test that fails, "" if none does."""
    command = [
        sys.executable,
        "-P",
        "-m",
        "pytest",
        "-x",
        "-q",
        "--no-header",
        "-p",
        "no:cacheprovider",
        *tests,
    ]
    environment = os.environ | {"PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(tree / "cache")}
    try:
        run = subprocess.run(
            command,
            cwd=tree,
            env=environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "no end"
    if run.returncode == 0:
        return ""
    named = [line for line in run.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return named[0][:160] if named else f"exit code {run.returncode}"


def copied(tree: Path) -> Path:
    """A copy to change. It keeps its place, so kernels compile once for all mutants of others."""
    shutil.copytree(
        ROOT,
        tree,
        ignore=shutil.ignore_patterns(".venv", "venv", "__pycache__", ".*_cache", "fits"),
    )
    # A checkout has its data beside the package, where an installed one has them inside.
    shutil.copytree(ROOT / "datasets", tree / "fitball" / "_datasets")
    return tree


def judged(trees: SimpleQueue[Path], mutant: Mutant) -> str:
    """A line of the table: which test notices a mutant."""
    tree = trees.get()
    path = tree / mutant.file
    source = path.read_bytes()
    path.write_bytes(source[: mutant.first] + mutant.after.encode() + source[mutant.last :])
    inside = mutant.file.removeprefix("fitball/")
    names = next(tests for room, tests in TESTS.items() if inside.startswith(room)).split()
    noticed = failing(tree, [f"tests/test_{name}.py" for name in names])
    if not noticed:
        noticed = failing(tree, ["tests", "--deselect", "tests/test_house.py"]) or "SURVIVED"
    path.write_bytes(source)
    trees.put(tree)
    return f"{mutant.file}:{mutant.line}: {mutant.before!r} -> {mutant.after!r}: {noticed}"


def main() -> None:
    """Draw mutants evenly over rooms and print what became of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--rooms",
        nargs="+",
        default=["models/kernels", "models", "data", "inference", "thesis"],
    )
    parser.add_argument("--constants", action="store_true", help="of units and constants only")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    drawn: list[Mutant] = []
    for k, room in enumerate(arguments.rooms):
        every = [
            mutant
            for mutant in mutants(room, arguments.constants)
            if not (room == "models" and "/kernels/" in mutant.file)
        ]
        share = arguments.count // len(arguments.rooms) + (
            k < arguments.count % len(arguments.rooms)
        )
        drawn += [every[i] for i in rng.choice(len(every), min(share, len(every)), replace=False)]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(arguments.processes) as pool:
        trees = SimpleQueue[Path]()
        for k in range(arguments.processes):
            trees.put(copied(Path(folder) / str(k)))
        for line in pool.map(partial(judged, trees), drawn):
            print(line, flush=True)


if __name__ == "__main__":
    main()
