"""Words of messages for two kinds of user: callers of Python, and users of the command line.

An option is written `--overwrite` on the command line and `overwrite=True` in Python. Messages get the right form
here; the command line switches to its form when it starts. Long names that a user gave are shortened here.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

# Options with another name on the command line than in Python.
FLAGS = {"config": "scene", "force": "force-records"}
# The longest name in a figure, and in a formula.
MOST_LETTERS, MOST_IN_FORMULA = 22, 12


def short(name: str, most: int = MOST_LETTERS) -> str:
    """A user's name of at most `most` letters: a longer one loses its middle, where names differ least."""
    return name if len(name) <= most else f"{name[: most - most // 3 - 1].rstrip()}…{name[-(most // 3) :].lstrip()}"


def in_formula(name: str) -> str:
    """A user's name as an upright index of a formula: letters and digits only."""
    plain = short("".join(letter for letter in name if letter.isalnum()), MOST_IN_FORMULA)
    return rf"\mathrm{{{plain}}}"


# Whether messages go to the command line. No context variable, since threads need it too.
_COMMAND_LINE = [False]


def on_command_line() -> bool:
    """Whether messages go to the command line."""
    return _COMMAND_LINE[0]


def listen(command_line: bool) -> None:
    """Set where messages go from now on; a new process gets this from the one that started it."""
    _COMMAND_LINE[0] = command_line


@contextmanager
def speaking_to_command_line() -> Iterator[None]:
    """Messages in this context go to the command line."""
    before = on_command_line()
    listen(True)
    try:
        yield
    finally:
        listen(before)


@dataclass(frozen=True)
class Screen:
    """What a report is shown on: letters a line, whether it takes colours, and whether all is wanted or what comes
    first. A caller of Python gets all, plain.
    """

    width: int = 100
    colour: bool = False
    full: bool = True


_SCREEN = [Screen()]


def screen() -> Screen:
    """What reports are shown on now."""
    return _SCREEN[0]


@contextmanager
def shown_on(wanted: Screen) -> Iterator[None]:
    """Reports made meanwhile are laid out for that screen."""
    before = screen()
    _SCREEN[0] = wanted
    try:
        yield
    finally:
        _SCREEN[0] = before


def spoken(command: str, python: str) -> str:
    """The words for the command line, or those for Python."""
    return command if on_command_line() else python


def option(name: str, *values: str | float) -> str:
    """How an option is passed: `--as-read` or `as_read=True`; with values `--flip a,b` or `flip=['a', 'b']`."""
    flag = f"--{FLAGS.get(name, name).replace('_', '-')}"
    if not values:
        return spoken(flag, f"{name}=True")
    given = values[0] if len(values) == 1 else list(values)
    return spoken(f"{flag} {','.join(map(str, values))}", f"{name}={given!r}")
