"""Whom messages speak to: a caller of Python, or whoever typed a command.

What a message asks for is passed in one way on the command line (`--overwrite`) and in another in Python
(`overwrite=True`). Messages ask here for the words; the command line says once that it is the one listening.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass
class _Listener:
    """Who reads the messages of this process; of threads too, which is why this is no context variable."""

    command_line: bool = False


_LISTENER = _Listener()


def on_command_line() -> bool:
    """Whether messages go to whoever typed a command."""
    return _LISTENER.command_line


def listen(command_line: bool) -> None:
    """Say who reads messages from now on, as a process that another one started is told."""
    _LISTENER.command_line = command_line


@contextmanager
def speaking_to_command_line() -> Iterator[None]:
    """Messages made meanwhile go to whoever typed a command."""
    before = on_command_line()
    listen(True)
    try:
        yield
    finally:
        listen(before)


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
