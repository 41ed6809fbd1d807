"""Incident conditions of simulated tables, and what their scene knows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitball.data.read import load_table
from fitball.data.scene import NO_SPIN_SD, NO_VELOCITY_SD, Scene, load_scene
from fitball.data.table import ImpactTable, Measurement
from fitball.values import FloatArray, Impacts

WANG = "wang_all.csv"
# A court's contact time as a scene may know it [s].
CONTACT_TIME = (5.0e-3, 0.5e-3)
GROUPS = 4


@dataclass(frozen=True)
class Design:
    """What is known of a table before it is measured: rows, incidence and scene. `columns` are measured."""

    words: str
    scene: Scene
    make: Callable[[int], Impacts]
    rows: int
    columns: tuple[str, ...] = ("v_x2", "v_y2", "omega_2")

    def table(self, times: int = 1) -> ImpactTable:
        """The design as a table of zeros; so many `times` as long, further rows between those that there are."""
        impacts = self.make(self.rows * times)
        count = len(impacts)
        drop = not np.any(impacts.v_x1)
        return replace(
            load_table(WANG),
            name="simulated",
            source="simulated",
            impacts=impacts,
            incident_columns=("v_y1",) if drop else ("v_x1", "v_y1", "omega_1"),
            ids=tuple(str(k + 1) for k in range(count)),
            measurements=tuple(Measurement(name, np.zeros(count)) for name in self.columns),
            redundant=(),
            labels={} if drop else {"group": tuple("ABCD"[GROUPS * k // count] for k in range(count))},
            notices=(),
        )


def _evenly(low: float, high: float, count: int, step: float) -> FloatArray:
    """Numbers that fill a range evenly however many there are (Weyl 1916)."""
    return np.asarray(low + (high - low) * ((0.5 + step * np.arange(count)) % 1.0))


# Steps of sequences that fill a square or a cube evenly: roots of two and three, and the golden section.
STEPS = (0.6180339887498949, 0.41421356237309515, 0.7320508075688772)


def spread(angle: tuple[float, float], speed: tuple[float, float], spin: float) -> Callable[[int], Impacts]:
    """Impacts over ranges of angle [deg] and speed [m/s], with spins [rad/s] of either sign up to `spin`."""

    def make(count: int) -> Impacts:
        theta = np.radians(_evenly(*angle, count, STEPS[0]))
        fast = _evenly(*speed, count, STEPS[1])
        return Impacts(fast * np.cos(theta), fast * np.sin(theta), _evenly(-spin, spin, count, STEPS[2]))

    return make


def _wang(count: int) -> Impacts:
    impacts = load_table(WANG).impacts
    return impacts.take(np.arange(count) % len(impacts))


def _drop(count: int) -> Impacts:
    return Impacts(np.zeros(count), _evenly(3.0, 12.0, count, STEPS[0]), np.zeros(count))


# True noises are drawn from priors, which are wider than what a scene means that states a noise.
_SILENT = (NO_VELOCITY_SD, NO_SPIN_SD)
_TIMED = Scene(contact_time=CONTACT_TIME, assumed=_SILENT)
_WANG_SCENE = replace(load_scene(WANG), assumed=_SILENT)
DESIGNS: Mapping[str, Design] = {
    "wang": Design("Wang's 21 impacts, his scene", _WANG_SCENE, _wang, 21),
    "untimed": Design(
        "Wang's 21 impacts, contact time not known", replace(_WANG_SCENE, contact_time=None), _wang, 21
    ),
    "grip": Design(
        "21 steep impacts, at which most balls grip", _TIMED, spread((55.0, 75.0), (12.0, 18.0), 100.0), 21
    ),
    "slide": Design("21 shallow impacts, at which balls slide", _TIMED, spread((11.0, 17.0), (25.0, 40.0), 50.0), 21),
    "one-angle": Design("21 impacts at one angle", _TIMED, spread((35.0, 35.0), (12.0, 25.0), 100.0), 21),
    "drop": Design("a drop test of 15 heights", Scene(assumed=_SILENT), _drop, 15, ("v_y2",)),
    "broad": Design(
        "40 impacts, steep and shallow, of every spin", _TIMED, spread((20.0, 65.0), (14.0, 25.0), 300.0), 40
    ),
}
