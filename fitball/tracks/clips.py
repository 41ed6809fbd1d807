"""Clips: positions of a ball as a file has them, before time, scale and axes are settled; and what the user stated
about the files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitball.data.table import FrozenMapping
from fitball.data.units import Dimension, Unit
from fitball.values import Ball, FloatArray

# Lengths in a picture; `to_si` leaves them as they are.
PIXELS = Unit("px", Dimension.LENGTH, 1.0)
# Positions that a detector is less sure of are left out (DeepLabCut's own threshold for plots is 0.6 to 0.9).
LEAST_QUALITY = 0.9
_SOME = 30


@dataclass(frozen=True)
class Reading:
    """What the user states about files of positions; None where nothing was stated.

    `fps` [frames/s], `metres_per_px`, `ball_diameter` [m] (for the scale by radius; None: that of `ball`, if
    `states_ball`). `y_down` says that y grows downwards. `up` names the axis that points upwards ("x", "y", "z", or
    with a minus sign "-z"). `unit` is the unit of lengths ("m", "mm", "px", ...) where a file has none, `fold` that
    of marks without a column. `clockwise` says that angles of marks grow clockwise in the picture. `columns` maps
    names of the long table to those of a file. With `as_read` clips are accepted that gravity contradicts.
    `air_density` [kg/m^3] and the ball say how much air may change gravity.
    """

    fps: float | None = None
    metres_per_px: float | None = None
    ball_diameter: float | None = None
    ball: Ball = field(default_factory=Ball)
    states_ball: bool = False
    air_density: float = 1.2
    y_down: bool | None = None
    up: str | None = None
    unit: str | None = None
    fold: int | None = None
    clockwise: bool = False
    least_quality: float = LEAST_QUALITY
    columns: Mapping[str, str] = field(default_factory=FrozenMapping)
    as_read: bool = False


@dataclass(frozen=True)
class Clip:
    """One ball in one clip as written: arrays (frames,) in the order of time, positions (frames, 2 or 3).

    Positions and radii are in `unit` after conversion to SI, or in pixels; None where the file states no unit.
    `time` [s] is None where only frames are known. `labels` are texts of other columns, such as the surface.
    """

    id: str
    session: str
    source: str
    frame: NDArray[np.int64]
    line: NDArray[np.int64]
    position: FloatArray
    unit: Unit | None
    time: FloatArray | None = None
    angle: FloatArray | None = None
    fold: int = 1
    radius: FloatArray | None = None
    row: FloatArray | None = None
    metres_per_px: float | None = None
    labels: Mapping[str, str] = field(default_factory=FrozenMapping)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.frame)

    def take(self, kept: NDArray[np.int64] | NDArray[np.bool_]) -> Clip:
        """The clip with these frames."""
        arrays: dict[str, Any] = {
            name: value[kept] for name, value in vars(self).items() if isinstance(value, np.ndarray)
        }
        return replace(self, **arrays)

    def noted(self, *notes: str) -> Clip:
        """The clip with more notes."""
        return replace(self, notes=(*self.notes, *notes))


def some_of(clips: Sequence[Clip]) -> Sequence[Clip]:
    """At most some dozens of clips, from all over a session: what they have in common needs no more."""
    return clips[:: -(-len(clips) // _SOME)] if clips else clips


def frames_named(frames: NDArray[np.int64]) -> str:
    """Frame numbers for a message: runs as `12 to 18`, at most six of them."""
    runs = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1) if len(frames) else []
    words = [f"{run[0]}" if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs[:6]]
    more = f" and {sum(map(len, runs[6:]))} more" if len(runs) > 6 else ""
    return ("frame " if len(frames) == 1 else "frames ") + ", ".join(words) + more
