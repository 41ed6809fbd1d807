"""Lists of numbers as lines of a file."""

from collections.abc import Iterable
from textwrap import wrap


def wrapped(items: Iterable[str]) -> str:
    """The items of a constant list, separated by commas and wrapped into lines."""
    return "\n".join(wrap(", ".join(items), 110, initial_indent="    ", subsequent_indent="    "))
