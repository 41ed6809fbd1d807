"""Which folder of `fitball` works when, while one table is fitted and its report written: drawn from a traced run.

`docs/architecture.md` shows the picture; `python scripts/road.py road.png` draws it.
"""

from __future__ import annotations

import sys
import tempfile
import time
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

from matplotlib.figure import Figure

import fitball

TOP = Path(fitball.__file__).parent
# Seconds without work of a folder that end a bar, and the least width of a bar.
PAUSE = 0.05


@cache
def folder_of(file: str) -> str:
    """The folder of `fitball` that a file is in, empty for files elsewhere and directly in `fitball`."""
    folder = Path(file).parent
    return str(folder.relative_to(TOP)) if folder.is_relative_to(TOP) and folder != TOP else ""


class Trace:
    """Stretches of work [s] by folder, in this thread; Python calls only."""

    def __init__(self) -> None:
        self.folders: list[str] = [""]
        self.stretches: dict[str, list[list[float]]] = {}
        self.began = time.perf_counter()

    def __call__(self, frame: FrameType, event: str, _argument: Any) -> None:
        """What `sys.setprofile` calls."""
        if event == "call":
            self.folders.append(folder_of(frame.f_code.co_filename) or self.folders[-1])
        elif event == "return" and len(self.folders) > 1:
            self.folders.pop()
        now, mine = time.perf_counter() - self.began, self.stretches.setdefault(self.folders[-1], [])
        if not mine or now - mine[-1][1] > PAUSE:
            mine.append([now, now])
        mine[-1][1] = now


def draw(place: Path) -> None:
    """Fit a bundled table and save it twice, the first time to load everything; trace and draw the second."""
    with tempfile.TemporaryDirectory() as folder:
        fitball.calibrate("wang_zero_spin.csv", cores=1, point_only=True).save(Path(folder) / "first")
        trace = Trace()
        sys.setprofile(trace)
        fitball.calibrate("wang_zero_spin.csv", cores=1).save(Path(folder) / "second")
        sys.setprofile(None)
    rows = [(name, bars) for name, bars in trace.stretches.items() if name]
    axis = Figure(figsize=(8.0, 0.6 + 0.2 * len(rows)), layout="constrained").add_subplot()
    for row, (_, bars) in enumerate(rows):
        widths = [(start, max(end - start, PAUSE)) for start, end in bars]
        axis.broken_barh(widths, (row - 0.35, 0.7), color="#1f4e79")
    axis.set(yticks=range(len(rows)), yticklabels=[name for name, _ in rows], xlabel="time [s]")
    axis.set(title="fitball.calibrate on seven impacts, then save", ylim=(len(rows) - 0.5, -0.5))
    axis.figure.savefig(place, dpi=110)


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
