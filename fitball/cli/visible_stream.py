"""The terminal as all verbs write to it: text from files cannot steer it."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from typing import Any, TextIO, cast

from fitball.visible import visible


class VisibleStream:
    """A text stream that makes control characters visible, and what its encoding lacks; all else is that stream's."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write `text`, visibly."""
        encoding = getattr(self.stream, "encoding", None) or "utf-8"
        shown = visible(text).encode(encoding, "backslashreplace").decode(encoding)
        return self.stream.write(shown)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextlib.contextmanager
def visible_streams() -> Iterator[None]:
    """Everything printed meanwhile, by whomever, is made visible."""
    out, err = (cast(TextIO, VisibleStream(stream)) for stream in (sys.stdout, sys.stderr))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        yield


def own_stream(stream: TextIO) -> TextIO:
    """The stream below, for a program's own line that rewrites itself."""
    return stream.stream if isinstance(stream, VisibleStream) else stream
