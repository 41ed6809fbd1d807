"""Label columns: what they name, and when two spellings are one."""

from collections.abc import Iterable

# What people call columns of labels, by what these name.
_NAMES = {
    "surface": "surface surfaces surfacetype court courts courttype courtsurface playingsurface "
    "floor",
    "ball": "ball balls balltype ballid ballno ballnumber ballname ballbrand ballmodel",
    "place": "location locations place places position positions spot testlocation testposition",
    "session": "session sessions filmsession",
    "table": "table",
}
_ROLES = {name: role for role, names in _NAMES.items() for name in names.split()}


def role_of(column: str) -> str:
    """What the labels of a column name: surface, ball, place, session, table, or "" where only the
    user knows.
    """
    letters = [letter for letter in column.casefold() if letter not in " _-"]
    return _ROLES.get("".join(letters), "")


def spelling_key(label: str) -> str:
    """A label without what spellings of it differ in: case and blanks. One rule for tables, new
    tables and `--level`.
    """
    return " ".join(label.casefold().split())


def first_spelled(labels: Iterable[str]) -> tuple[str, ...]:
    """The labels, each spelled as at its first use."""
    first: dict[str, str] = {}
    return tuple(first.setdefault(spelling_key(label), label.strip()) for label in labels)
