"""Compiled kernels on disk: a file for each kernel and kind of arguments, sealed with a checksum.

Numba's own files end a run in a traceback when one is cut short, end the process when its machine code is damaged,
and mix up kernels that two processes compile at once. Here a file that is not whole counts as none.
"""

from __future__ import annotations

import hashlib
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from numba.core.serialize import dumps

SEAL = hashlib.sha256().digest_size


class KernelFiles:
    """Stands in for numba's files of one function: `stem` begins their names, `stamp` says of which sources and of
    which numba they are. `loaded` is called before machine code that came from disk is linked.
    """

    def __init__(self, folder: Path, stem: str, stamp: tuple[Any, ...]) -> None:
        self.folder, self.stem, self.stamp = folder, stem, stamp
        self.loaded: Callable[[], None] = lambda: None

    def place(self, key: object) -> Path:
        """Where the kernel is kept for what numba calls its key: kinds of arguments, processor, bytecode."""
        return self.folder / f"{self.stem}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.nbc"

    def load(self, key: object) -> Any:
        """What was saved, or None where there is none that is whole and of these sources."""
        try:
            content = self.place(key).read_bytes()
        except OSError:
            return None
        if content[:SEAL] != self._seal(key, content[SEAL:]):
            return None
        self.loaded()
        return pickle.loads(content[SEAL:])

    def save(self, key: object, data: object) -> None:
        """Keep it, whole or not at all. Raises OSError."""
        content: bytes = dumps(data)  # type: ignore[no-untyped-call]
        place = self.place(key)
        with NamedTemporaryFile(dir=self.folder, prefix=f".{self.stem}.", suffix=".tmp", delete=False) as file:
            try:
                file.write(self._seal(key, content) + content)
                file.close()
                os.replace(file.name, place)  # noqa: PTH105 - a name of tempfile's
            except BaseException:
                Path(file.name).unlink(missing_ok=True)
                raise

    def _seal(self, key: object, content: bytes) -> bytes:
        return hashlib.sha256(repr((self.stamp, key)).encode() + content).digest()
