"""Whom messages speak to: a caller of Python, or whoever typed a command.

What a message asks for is passed in one way on the command line (`--overwrite`) and in another in Python
(`overwrite=True`). Messages ask here for the words; the command line says once that it is the one listening.
Names that the user gave are cut here to what there is room for.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

# Letters of a user's name that a figure has room for, and of one in a formula.
MOST_LETTERS, MOST_IN_FORMULA = 22, 12


def short(name: str, most: int = MOST_LETTERS) -> str:
    """A user's name of `most` letters: a longer one loses its middle, where most are alike."""
    return name if len(name) <= most else f"{name[: most - most // 3 - 1].rstrip()}…{name[-(most // 3) :].lstrip()}"


def in_formula(name: str) -> str:
    """A user's name as an upright index of a formula: letters and digits only."""
    plain = short("".join(letter for letter in name if letter.isalnum()), MOST_IN_FORMULA)
    return rf"\mathrm{{{plain}}}"


# Whether messages go to whoever typed a command, in threads too, which is why this is no context variable.
_COMMAND_LINE = [False]


def on_command_line() -> bool:
    """Whether messages go to whoever typed a command."""
    return _COMMAND_LINE[0]


def listen(command_line: bool) -> None:
    """Say who reads messages from now on, as a process that another one started is told."""
    _COMMAND_LINE[0] = command_line


@contextmanager
def speaking_to_command_line() -> Iterator[None]:
    """Messages made meanwhile go to whoever typed a command."""
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
    """The words for whoever listens."""
    return command if on_command_line() else python


def option(name: str, *values: str | float) -> str:
    """How an option is passed: `--as-read` or `as_read=True`; with values `--flip a,b` or `flip=['a', 'b']`."""
    flag = f"--{name.replace('_', '-')}"
    if not values:
        return spoken(flag, f"{name}=True")
    given = values[0] if len(values) == 1 else list(values)
    return spoken(f"{flag} {','.join(map(str, values))}", f"{name}={given!r}")
