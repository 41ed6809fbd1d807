"""Many small panels in one Axes, where lines, areas and ticks of all of them are one artist each: panels of
matplotlib's own have five artists a tick, and most of a drawing's time goes into ticks.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator

from fitball.report.figures.canvas import log_ticks, new_figure
from fitball.values import FloatArray

# Inches: lengths of ticks, whether numbered or not, and from an edge to its numbers.
LONG, SHORT, TO_NUMBERS = 0.05, 0.028, 0.075


@dataclass(frozen=True)
class Side:
    """One direction of a panel: `low` to `high` of what it shows, over `length` inches of the sheet from `start`."""

    low: float
    high: float
    logarithmic: bool
    start: float
    length: float

    def place(self, values: FloatArray | float) -> FloatArray:
        """Places of values on the sheet [in]."""
        if self.logarithmic:
            share = np.log(np.asarray(values) / self.low) / np.log(self.high / self.low)
        else:
            share = (np.asarray(values) - self.low) / (self.high - self.low)
        return np.asarray(self.start + self.length * share)

    def ticks(self, most: int) -> tuple[list[float], list[float]]:
        """Numbered ticks, `most` or a few more where logarithmic, and those between which nothing is written."""
        if self.logarithmic:
            return log_ticks(self.low, self.high)
        found = MaxNLocator(most, prune="lower").tick_values(self.low, self.high)
        return [float(tick) for tick in found if self.low <= tick <= self.high], []


@dataclass(frozen=True)
class Panel:
    """A rectangle of the sheet."""

    across: Side
    up: Side

    def path(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Points (points, 2) of the sheet [in]."""
        return np.stack(np.broadcast_arrays(self.across.place(x), self.up.place(y)), axis=-1)

    def steps(self, edges: FloatArray, heights: FloatArray, lying: bool = False) -> FloatArray:
        """The outline of a histogram from bottom to bottom; `lying` where its bars lie on their side."""
        along = np.repeat(edges, 2)
        high = np.concatenate([[0.0], np.repeat(heights, 2), [0.0]])
        return self.path(high, along) if lying else self.path(along, high)

    @property
    def frame(self) -> FloatArray:
        """Its corners, the first one again at the end."""
        x, y = self.across, self.up
        right, top = x.start + x.length, y.start + y.length
        return np.array([(x.start, y.start), (right, y.start), (right, top), (x.start, top), (x.start, y.start)])


class Sheet:
    """A figure of `width` by `height` inches whose only Axes has inches from its lower left corner as coordinates."""

    def __init__(self, width: float, height: float) -> None:
        self.figure = new_figure(width, height, layout=None)
        self.axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes.set_xlim(0.0, width)
        self.axes.set_ylim(0.0, height)
        self.axes.axis("off")

    def lines(self, paths: Sequence[FloatArray], colour: str | Sequence[str], width: float, **style: Any) -> None:
        """Lines through points of the sheet, in one colour or one each."""
        made = LineCollection(list(paths), colors=colour, linewidths=width, **{"zorder": 2, **style})
        self.axes.add_collection(made, autolim=False)

    def areas(self, paths: Iterable[Path], colour: str, zorder: float) -> None:
        """Areas without outlines."""
        self.axes.add_collection(
            PathCollection(list(paths), facecolors=colour, linewidths=0, zorder=zorder), autolim=False
        )

    def frames(self, panels: Sequence[Panel]) -> None:
        """The edges of panels."""
        self.lines([panel.frame for panel in panels], "black", 0.8, zorder=4)

    def ticks(self, panels: Sequence[Panel], which: Literal["x", "y"], most: int = 3, rotation: float = 0.0) -> None:
        """Ticks with their numbers at the lower ("x") or left ("y") edge of each panel."""
        marks = []
        for panel in panels:
            side, edge = (panel.across, panel.up.start) if which == "x" else (panel.up, panel.across.start)
            named, unnamed = side.ticks(most)
            for values, size in ((named, LONG), (unnamed, SHORT)):
                for place in side.place(np.array(values)):
                    ends = np.array([(place, edge), (place, edge - size)])
                    marks.append(ends if which == "x" else ends[:, ::-1])
            for place, text in zip(side.place(np.array(named)), tick_labels(named), strict=True):
                x, y = (place, edge - TO_NUMBERS) if which == "x" else (edge - TO_NUMBERS, place)
                held = {"ha": "center", "va": "top"} if which == "x" else {"ha": "right", "va": "center"}
                self.text(x, y, text, 8, rotation=rotation, **held)
        self.lines(marks, "black", 0.7)

    def text(self, x: float, y: float, words: str, size: float, **style: Any) -> None:
        """Words at a place of the sheet."""
        self.axes.text(x, y, words, fontsize=size, **style)


def tick_labels(ticks: Sequence[float]) -> list[str]:
    """Numbers of ticks, with as many decimals each as any of them needs."""
    short = [f"{tick:.6g}" for tick in ticks]
    if not any("e" in text for text in short):
        places = max((len(text.partition(".")[2]) for text in short), default=0)
        short = [f"{tick:.{places}f}" for tick in ticks]
    return [text.replace("-", "\u2212") for text in short]
