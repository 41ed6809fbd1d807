"""The terminal as all verbs write to it: text from files cannot steer it, and a stream that is closed or full is no
reason to fail.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO, cast

from fitball.visible import visible


class VisibleStream:
    """A text stream that makes control characters visible, and what its encoding lacks; all else is that stream's.
    What the system says of it bears its `name`.
    """

    def __init__(self, stream: TextIO, name: str = "") -> None:
        self.stream, self.name = stream, name
        self.broken: OSError | None = None

    def write(self, text: str) -> int:
        """Write `text`, visibly. Raises OSError."""
        encoding = getattr(self.stream, "encoding", None) or "utf-8"
        shown = visible(text).encode(encoding, "backslashreplace").decode(encoding)
        with self._named():
            return self.stream.write(shown)

    def flush(self) -> None:
        """Let what was written leave. Raises OSError, also for what was lost before: argparse does not look."""
        if self.broken is not None:
            raise self.broken
        with self._named():
            self.stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    @contextlib.contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            _give_up(self.stream)
            self.broken = type(error)(error.errno, error.strerror, self.name)
            raise self.broken from None


class RemarkStream:
    """A stream for remarks, such as progress: when it cannot be written to, there is no place left to say so, and the
    work goes on without them.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write `text`, if the stream takes it."""
        with self._heard_or_not():
            self.stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Let what was written leave, if it can."""
        with self._heard_or_not():
            self.stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    @contextlib.contextmanager
    def _heard_or_not(self) -> Iterator[None]:
        try:
            yield
        except OSError:
            _give_up(self.stream)


def _give_up(stream: TextIO) -> None:
    """Let what a broken stream still holds go nowhere: Python would try once more when it ends, and complain."""
    with contextlib.suppress(OSError, AttributeError):
        number = stream.fileno()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)


@contextlib.contextmanager
def visible_streams() -> Iterator[None]:
    """Everything printed meanwhile, by whomever, is made visible."""
    _open_closed_streams()
    out = cast(TextIO, VisibleStream(sys.stdout, "standard output"))
    err = cast(TextIO, VisibleStream(cast(TextIO, RemarkStream(sys.stderr))))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        yield


def _open_closed_streams() -> None:
    """Open what the caller closed (`>&-`) on the null device: Python has no stream then, and the next file that is
    opened would take its number, and with it what other programs and libraries print.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            # The system gives the lowest number that is free, which is the stream's; workers are to have it too.
            stream = open(os.devnull, "r" if name == "stdin" else "w", encoding="utf-8")  # noqa: PTH123, SIM115
            os.set_inheritable(stream.fileno(), True)
            setattr(sys, name, stream)


def own_stream(stream: TextIO) -> TextIO:
    """The stream below, for a program's own line that rewrites itself."""
    return stream.stream if isinstance(stream, VisibleStream) else stream
