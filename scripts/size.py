"""How large is the house? Lines and modules by room: code, imports, docstrings, blank and comments apart; templates
and JavaScript beside. `python scripts/size.py`; `tests/test_house.py` holds the totals under `CEILINGS`.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Growth is a decision: who raises one of these says in the commit what for, see CONTRIBUTING.
CEILINGS: Mapping[str, int] = {
    "lines of fitball": 68_800, "modules of fitball": 308, "lines of scripts": 6_300, "lines of tests": 39_700,
}  # fmt: skip
KINDS = ("code", "imports", "docstrings", "comments", "blank")


def kinds_of(text: str) -> Counter[str]:
    """Lines of a module by kind; each line is of one."""
    kinds = ["blank" if not line.strip() else "code" for line in text.splitlines()]
    for k, line in enumerate(text.splitlines()):
        if line.lstrip().startswith("#"):
            kinds[k] = "comments"
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            kinds[node.lineno - 1 : node.end_lineno] = ["imports"] * _length(node)
        elif isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            said = node.body[0]
            kinds[said.lineno - 1 : said.end_lineno] = ["docstrings"] * _length(said)
    return Counter(kinds)


def _length(node: ast.stmt) -> int:
    return (node.end_lineno or node.lineno) - node.lineno + 1


def room_of(place: Path, top: Path) -> str:
    """The first folder below the top that a file lies in, with the second where rooms are nested."""
    parts = place.relative_to(top).parts[:-1]
    return "/".join((top.name, *parts[:2]))


def measured(top: Path) -> dict[str, Counter[str]]:
    """By room lines of each kind, `lines` in all and `modules`, and what is no Python as `others`."""
    rooms: dict[str, Counter[str]] = {}
    for place in sorted(top.rglob("*")):
        if place.suffix == ".py":
            kinds = kinds_of(place.read_text(encoding="utf-8"))
            found = kinds + Counter(lines=kinds.total(), modules=1)
        elif place.suffix in (".j2", ".js", ".css", ".sh") or (place.is_file() and not place.suffix):
            found = Counter(others=len(place.read_text(encoding="utf-8").splitlines()))
        else:
            continue
        rooms.setdefault(room_of(place, top), Counter()).update(found)
    return rooms


def totals() -> dict[str, int]:
    """What `CEILINGS` limits; the scripts without an ending count with those in Python."""
    tops = {name: sum(measured(ROOT / name).values(), Counter[str]()) for name in ("fitball", "scripts", "tests")}
    return {
        "lines of fitball": tops["fitball"]["lines"], "modules of fitball": tops["fitball"]["modules"],
        "lines of scripts": tops["scripts"]["lines"] + tops["scripts"]["others"],
        "lines of tests": tops["tests"]["lines"],
    }  # fmt: skip


def table(rooms: Mapping[str, Counter[str]]) -> Iterable[str]:
    """A line a room, and one of all."""
    heads = ("modules", "lines", *KINDS, "others")
    yield f"{'room':<34}" + "".join(f"{head:>11}" for head in heads)
    for name, found in [*rooms.items(), ("all", sum(rooms.values(), Counter[str]()))]:
        yield f"{name:<34}" + "".join(f"{found[head]:>11,}" for head in heads)


def main() -> None:
    """Print it."""
    for name in ("fitball", "scripts", "tests"):
        print("\n".join([*table(measured(ROOT / name)), ""]))
    for what, found in totals().items():
        print(f"{what}: {found:,}, at most {CEILINGS[what]:,}")


if __name__ == "__main__":
    main()
