"""How large is the house? Lines and modules by room beside their budgets: `python scripts/size.py`.

A budget is a promise: a room goes over it only by what another gives back. `tests/test_house.py`
holds the ceilings.
"""

from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LINES = 26_000
MODULES = 160
TEST_LINES = 13_000
SCRIPT_LINES = 2_000
BUDGETS: Mapping[str, int] = {
    "base": 850,
    "data": 2_300,
    "models": 2_300,
    "tracks": 1_200,
    "inference": 5_100,
    "uses": 2_300,
    "saved": 250,
    "report": 4_200,
    "exports": 1_900,
    "thesis": 800,
    "bench": 350,
    "verbs": 1_200,
}
# Modules at the top of the package, and the room that has them; `batch` is counted with the verbs,
# as budgeted.
VERBS = ("batch", "scheduling.py", "result.py", "itf.py", "verbs.py", "cli.py")


def lines_of(place: Path) -> int:
    """Lines of a file, blank ones included."""
    return len(place.read_text(encoding="utf-8").splitlines())


def room_of(place: Path) -> str:
    """The room of a file of the package."""
    first = place.relative_to(ROOT / "fitball").parts[0]
    return "verbs" if first in VERBS else first if first in BUDGETS else "base"


def sizes() -> dict[str, tuple[int, int]]:
    """Lines and modules by room; templates of all kinds count with their rooms' lines."""
    found = dict.fromkeys(BUDGETS, (0, 0))
    for place in sorted((ROOT / "fitball").rglob("*")):
        if place.suffix == ".py" or (place.parent.name == "templates" and place.is_file()):
            room = room_of(place)
            lines, modules = found[room]
            found[room] = lines + lines_of(place), modules + (place.suffix == ".py")
    return found


def total(folder: str) -> int:
    """Lines of all Python and shell below a folder."""
    texts = (
        p
        for p in (ROOT / folder).rglob("*")
        if p.suffix in (".py", ".sh", ".toml") or (p.is_file() and not p.suffix)
    )
    return sum(lines_of(p) for p in texts)


if __name__ == "__main__":
    found = sizes()
    print(f"{'room':12} {'lines':>7} {'budget':>7} {'modules':>8}")
    for room, (lines, modules) in found.items():
        print(f"{room:12} {lines:7} {BUDGETS[room]:7} {modules:8}")
    print(
        f"{'package':12} {sum(n for n, _ in found.values()):7} {LINES:7} "
        f"{sum(m for _, m in found.values()):8}"
    )
    print(f"{'tests':12} {total('tests'):7} {TEST_LINES:7}")
    print(f"{'scripts':12} {total('scripts'):7} {SCRIPT_LINES:7}")
