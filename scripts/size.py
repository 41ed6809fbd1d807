"""How large is the house, and how dense? `python scripts/size.py` prints it by room.

What a reader feels has limits, which `tests/test_house.py` holds: lines of code in a function,
lines in a file, places that the formatter must leave alone. Tokens a line of code, vague words and
assignments of several things at once are printed without a limit: they say where lines are hard to
read.
"""

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("fitball", "tests", "scripts")

# What fits on a screen and in a head.
FUNCTION_LINES = 60
# A file has one topic, and is read in one sitting.
FILE_LINES = 600
# Tables of numbers keep their columns; nothing else needs to be laid out by hand.
UNFORMATTED = 20

# Functions that may be longer, by module and name, with the reason.
LONG_FUNCTIONS = {
    "fitball/models/kernels/crossings.py:first_fall": "compiled: its parts would hand on 15 values",
    "fitball/models/kernels/phases.py:follow": "compiled: the walk over phases has 16 values",
}

# Words that say nothing of what they name.
VAGUE = frozenset(
    {
        "one",
        "found",
        "known",
        "own",
        "made",
        "item",
        "given",
        "part",
        "asked",
        "whole",
        "said",
        "left",
        "kept",
        "place",
        "some",
        "told",
    }
)

# Tokens that are no code: layout, comments, and texts (docstrings and sentences for users).
_NO_CODE = frozenset(
    {
        tokenize.COMMENT,
        tokenize.DEDENT,
        tokenize.ENCODING,
        tokenize.ENDMARKER,
        tokenize.INDENT,
        tokenize.NEWLINE,
        tokenize.NL,
        tokenize.STRING,
    }
)
_BY_HAND = re.compile(r"#\s*fmt:\s*(?:skip|off)\b")


@dataclass
class Density:
    """Counts of one or several texts of Python."""

    modules: int = 0
    lines: int = 0
    code_lines: int = 0
    tokens: int = 0
    names: int = 0
    vague_names: int = 0
    assignments: int = 0
    tuple_assignments: int = 0

    def add(self, text: str) -> None:
        """Count a module, too."""
        code_lines = set()
        for token in tokens_of(text):
            if token.type in _NO_CODE:
                continue
            self.tokens += 1
            code_lines.add(token.start[0])
            if token.type == tokenize.NAME:
                self.names += 1
                self.vague_names += not VAGUE.isdisjoint(token.string.split("_"))
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Assign):
                self.assignments += 1
                self.tuple_assignments += assigns_several(node)
        self.modules += 1
        self.lines += len(text.splitlines())
        self.code_lines += len(code_lines)

    def row(self, name: str) -> str:
        """A line of the report."""
        return (
            f"{name:12} {self.lines:7,} {self.modules:8} "
            f"{self.tokens / self.code_lines:11.2f} "
            f"{self.vague_names / self.names:8.1%} "
            f"{self.tuple_assignments / max(self.assignments, 1):8.1%}"
        )


@dataclass(frozen=True)
class Function:
    """A function or method, and its lines of code."""

    name: str
    line: int
    code_lines: int


def tokens_of(text: str) -> Iterator[tokenize.TokenInfo]:
    """The tokens of a text of Python."""
    return tokenize.generate_tokens(io.StringIO(text).readline)


def assigns_several(node: ast.Assign) -> bool:
    """Whether a statement gives several values to several names, as `a, b = 1, 2` does."""
    return isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)


def functions(text: str) -> list[Function]:
    """The functions of a text with their lines of code: from `def` on, without docstring, comments
    and blank lines. Lines of a function within another count for both.
    """
    covered: set[int] = set()
    for token in tokens_of(text):
        if token.type not in _NO_CODE - {tokenize.STRING}:
            covered.update(range(token.start[0], token.end[0] + 1))
    counted = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            inside = range(node.lineno, (node.end_lineno or node.lineno) + 1)
            code = covered.intersection(inside) - docstring_lines(node)
            counted.append(Function(node.name, node.lineno, len(code)))
    return counted


def docstring_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> set[int]:
    """The lines of a function's docstring, none where it has none."""
    if ast.get_docstring(node, clean=False) is None:
        return set()
    first = node.body[0]
    return set(range(first.lineno, (first.end_lineno or first.lineno) + 1))


def unformatted(text: str) -> int:
    """How many comments tell the formatter to leave a place alone."""
    if not _BY_HAND.search(text):
        return 0
    return sum(
        token.type == tokenize.COMMENT and bool(_BY_HAND.search(token.string))
        for token in tokens_of(text)
    )


def faults(name: str, text: str) -> list[str]:
    """What is over its limit in a module of that name: `fitball/cli.py: ...`."""
    over = []
    lines = len(text.splitlines())
    if lines > FILE_LINES:
        over.append(f"{name}: {lines} lines, at most {FILE_LINES}")
    for function in functions(text):
        allowed = f"{name}:{function.name}" in LONG_FUNCTIONS
        if function.code_lines > FUNCTION_LINES and not allowed:
            over.append(
                f"{name}:{function.line}: {function.name} has {function.code_lines} lines of code, "
                f"at most {FUNCTION_LINES}"
            )
    return over


def sources() -> dict[str, str]:
    """The text of every Python file, by its name in the project."""
    files = (path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py")))
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in files}


def room_of(name: str) -> str:
    """The room of a file by its name: a folder of the package, its top, `tests` or `scripts`."""
    folder, *inner = name.split("/")
    if folder != "fitball":
        return folder
    return inner[0] if len(inner) > 1 else "top"


def densities(texts: Iterable[tuple[str, str]]) -> dict[str, Density]:
    """Counts by room of files (name, text)."""
    rooms: dict[str, Density] = {}
    for name, text in texts:
        rooms.setdefault(room_of(name), Density()).add(text)
    return rooms


def main() -> int:
    """Print the report and what is over its limit; 1 where something is."""
    texts = sources()
    package = Density()
    for name, text in texts.items():
        if name.startswith("fitball/"):
            package.add(text)
    rooms = densities(texts.items())
    tests = rooms.pop("tests")
    scripts = rooms.pop("scripts")
    print(f"{'room':12} {'lines':>7} {'modules':>8} {'tokens/line':>11} {'vague':>8} {'tuples':>8}")
    for room, density in (*sorted(rooms.items()), ("package", package)):
        print(density.row(room))
    print(tests.row("tests"))
    print(scripts.row("scripts"))
    by_hand = sum(unformatted(text) for text in texts.values())
    print(f"left to hands by the formatter: {by_hand} places, at most {UNFORMATTED}")
    over = [fault for name, text in texts.items() for fault in faults(name, text)]
    print("\n".join(over) if over else "no function and no file is over its limit")
    return int(bool(over) or by_hand > UNFORMATTED)


if __name__ == "__main__":
    sys.exit(main())
