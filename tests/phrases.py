"""Phrases that no text of the project has, and names that no public signature has: the one list of both.

`python tests/phrases.py [PATH ...]` lists where they are, with the line; `tests/test_words.py` holds that there are
none.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Each with what is written instead. Data do not speak, and a table is a file: whoever reads English as a second
# language looks these verbs up and finds another meaning.
PHRASES = {
    r"\b(un)?(tell|tells|telling|told)\b": "determine, distinguish, report, say which",
    r"\b(has|have|had) to say\b": "shows, contributes",
    r"\bworth an? (?!look)": "say what it gives",
    r"\b(come|comes|came|coming) up to\b": "predicts as well as",
    r"\bwhat (was|is) known (before|beforehand)\b": "prior",
    r"\bfrom both sides\b": "two-sided",
    r"\b(just )?as good( as)?\b": "fits equally well",
    r"\bthere is none that\b": "no ... does",
    r"\b(meets?|met) (it|them|the|no|none|each|all|a|an|these|those|by)\b": "agrees with, satisfies, reaches",
    r"\bbears? (it|them|the|no|none|on|out|all)\b": "allows, has",
    r"\b(stands?|stood) (in|at|above|below|beside|there|here|under|alone|behind|before|on|with)\b": "is",
    r"\b([Tt]he|[Tt]his|[Aa]|[Tt]hat|[Ee]ach) (table|sheet) "
    r"(tells?|identif\w+|knows?|sees?|saw|narrows?|decides?|pulls?|contradicts?)\b": "the data ...",
    r"\b[Ww]ho(ever)? (wants?|asks?|carries|skims|doubts|knows)\b": "if you ..., to ...",
    r"\bwithout a trace\b": "cannot be separated",
    r"\bearns? (its|their)\b": "is worth its",
    r"\bhalf of it by\b": "half of ... comes from",
}  # fmt: skip
PATTERNS = {re.compile(pattern, re.IGNORECASE): instead for pattern, instead in PHRASES.items()}
# As whole names of public functions, parameters, attributes.
NAMES = frozenset({"told", "untold", "said", "shown", "item", "items_of", "made", "of", "tell"})
# Written once, of what was then.
PAST = "CHANGELOG.md"


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """What people read of a file, with the line: of code its string constants, docstrings among them."""
    source = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        yield 1, source
        return
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value


def phrases_in(path: Path) -> Iterator[tuple[int, str, str]]:
    """Line, phrase and what is written instead, of every phrase in a file."""
    for line, text in texts(path):
        # A phrase may be broken between lines.
        flat = re.sub(r"\s", " ", text)
        for pattern, instead in PATTERNS.items():
            for found in pattern.finditer(flat):
                yield line + text.count("\n", 0, found.start()), found[0], instead


def names_in(path: Path) -> Iterator[tuple[int, str]]:
    """Line and name of public functions, their parameters, and fields of public classes that have such a name."""
    if path.suffix != ".py":
        return
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            for name in (node.name, *(argument.arg for argument in given)):
                if name in NAMES:
                    yield node.lineno, name
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for field in node.body:
                if (
                    isinstance(field, ast.AnnAssign)
                    and isinstance(field.target, ast.Name)
                    and field.target.id in NAMES
                ):
                    yield field.lineno, field.target.id


def read_by_users(root: Path = ROOT) -> list[Path]:
    """Files whose text users read."""
    found = [*root.glob("*.md"), *root.glob("docs/**/*.md"), *root.glob("fitball/**/*.py")]
    found += [*root.glob("fitball/**/*.j2"), *root.glob("fitball/**/*.json"), *root.glob("scripts/**/*.py")]
    return sorted(path for path in found if path.name != PAST)


if __name__ == "__main__":
    asked = [Path(name).resolve() for name in sys.argv[1:]] or [ROOT]
    count = 0
    for path in read_by_users():
        if any(path == it or it in path.parents for it in asked):
            where = path.relative_to(ROOT)
            for line, phrase, instead in phrases_in(path):
                print(f"{where}:{line}: '{phrase.strip()}': {instead}")
                count += 1
            for line, name in names_in(path):
                print(f"{where}:{line}: name {name}")
                count += 1
    print(f"{count} found")
