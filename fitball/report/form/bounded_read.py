"""Files read whole, but for what could hang a reader or fill its memory: pipes, devices, more than a result holds."""

from __future__ import annotations

import stat
from pathlib import Path

from fitball.errors import ResultFolderError

# No fit.json of a thousand tables' parameters came near this; its values take ten times as much in memory.
MOST_BYTES = 64 * 2**20


def read_bounded(place: Path, most: int = MOST_BYTES) -> bytes:
    """The content of a regular file. Raises OSError, ResultFolderError for what is no file or has more bytes."""
    if not stat.S_ISREG(place.stat().st_mode):
        raise ResultFolderError(f"{place}: not a file; put back the file that fitball wrote, or run it again")
    with place.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise ResultFolderError(f"{place}: more than {most:,} bytes, which fitball did not write here")
    return content
