"""Label columns: what they name, and when two spellings are one."""

from collections.abc import Iterable

# What people call columns of labels, by role: what the labels name.
_NAMES_BY_ROLE = {
    "surface": "surface surfaces surfacetype court courts courttype courtsurface playingsurface "
    "floor",
    "ball": "ball balls balltype ballid ballno ballnumber ballname ballbrand ballmodel",
    "place": "location locations place places position positions spot testlocation testposition",
    "session": "session sessions filmsession",
    "table": "table",
}
_ROLES = {name: role for role, names in _NAMES_BY_ROLE.items() for name in names.split()}


def role_of(column: str) -> str:
    """What the labels of a column name: surface, ball, place, session, table; "" for any other
    column.
    """
    letters = [letter for letter in column.casefold() if letter not in " _-"]
    name = "".join(letters)
    return _ROLES.get(name, "")


def spelling_key(label: str) -> str:
    """A label without that in which its spellings differ: case and blanks. Tables, tables of new
    impacts and `--level` compare labels by it.
    """
    return " ".join(label.casefold().split())


def first_spelled(labels: Iterable[str]) -> tuple[str, ...]:
    """The labels, each spelled as at its first use."""
    first: dict[str, str] = {}
    respelled = []
    for label in labels:
        key = spelling_key(label)
        respelled.append(first.setdefault(key, label.strip()))
    return tuple(respelled)
