"""Figures as matplotlib draws them by itself, whatever a matplotlibrc or the session of a caller has set."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import matplotlib as mpl

# Settings that are the user's: what shows windows (nothing here does), and where ffmpeg lies.
_KEPT = ("backend", "interactive", "animation.ffmpeg_path", "animation.ffmpeg_args")


@contextmanager
def own_style() -> Iterator[None]:
    """In here, or in a function decorated so, matplotlib's own defaults hold, and names in SVG files are the same for
    equal figures; afterwards what held before.
    """
    defaults = {name: value for name, value in mpl.rcParamsDefault.items() if name not in _KEPT}
    with mpl.rc_context(defaults | {"svg.hashsalt": "fitball"}):
        yield
