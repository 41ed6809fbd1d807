"""Heights and times of flights become speeds, by falls and rises through air (`base.air`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from fitball.base import air
from fitball.base.columns import SPEED_OF_FLIGHT, SPEED_OF_HEIGHT
from fitball.base.itf import GRAVITY
from fitball.base.values import FloatArray
from fitball.data.cells import TableCells
from fitball.data.kinematics import Columns
from fitball.data.scene import Scene

# The speed that each height and each flight says.
SPEED_OF: Mapping[str, str] = {**SPEED_OF_HEIGHT, **SPEED_OF_FLIGHT}


class _Motion(NamedTuple):
    """How a column says a speed: `speed_of` and `slope_of` give it and its derivative from values
    (rows,) and a braking [1/m], `free` the speed without air; `words` name the motion.
    """

    speed_of: Callable[[FloatArray, float], FloatArray]
    slope_of: Callable[[FloatArray, float], FloatArray]
    free: Callable[[FloatArray], FloatArray]
    words: str


def speeds_of_heights(cells: TableCells, columns: Columns, scene: Scene) -> dict[str, FloatArray]:
    """The columns (rows,) in SI with vertical speeds in place of heights and times of flights;
    their sds to first order. A note says how much the air matters, a fault (`height-and-speed`)
    where the speed is there too.
    """
    with_speeds = dict(columns)
    braking = usual_braking(scene)
    for name, motion in _MOTIONS.items():
        read = with_speeds.pop(name, None)
        sd = with_speeds.pop(f"{name}_sd", None)
        if read is None:
            continue
        speed = SPEED_OF[name]
        if speed in with_speeds:
            others = [other for other in (speed, *_MOTIONS) if SPEED_OF.get(other, other) == speed]
            same = next(other for other in others if other in columns and other != name)
            words = f"says the same as {same}: leave one of them out (--ignore {name})"
            cells.fault("height-and-speed", words, name)
            continue
        values = np.abs(read)
        with_speeds[speed] = motion.speed_of(values, braking)
        if sd is not None:
            with_speeds[f"{speed}_sd"] = motion.slope_of(values, braking) * sd
        shares = with_speeds[speed] / motion.free(values)
        if np.isfinite(shares).any():
            words = _words(name, motion, float(np.nanmedian(shares)) - 1.0, scene.slow_drag())
            if name in SPEED_OF_HEIGHT:
                cells.note("heights", words)
            else:
                cells.note("flights", words)
    return with_speeds


class Flights(NamedTuple):
    """Times of flights (rows,) [s], and by how much [s/m] they grow with a height."""

    time: FloatArray
    slope: FloatArray


def flights_of_drops(height: FloatArray, braking: float) -> Flights:
    """Flights (rows,) that land as fast as balls that fall from heights [m], at a braking [1/m].
    Another drag moves both by the same share to first order: ln v falls by s h/4 dC/C.
    """
    landing = air.landing_speed(height, braking)
    time = air.flight_time(air.launch_of_landing(landing, braking), braking)
    slope = _fall_slope(height, braking) / _landing_slope(time, braking)
    return Flights(time, slope)


def usual_braking(scene: Scene) -> float:
    """The braking [1/m] of a scene's ball in its air, at the usual or the stated drag."""
    return scene.slow_drag().value * air.braking_per_drag(scene.ball_value(), scene.air)


def _words(name: str, motion: _Motion, change: float, drag: air.Coefficient) -> str:
    """What was made of a column, and by which share air changes the speeds."""
    sd = f" ± {drag.sd:g}" if drag.sd else ""
    return (
        f"{name}: {SPEED_OF[name]} by {motion.words}; drag coefficient {drag.value:g}{sd}; "
        f"{change:+.1%} against free fall"
    )


def heights_read(columns: Iterable[str], scene: Scene) -> dict[str, str]:
    """What a table keeps of the heights and flights among the names of its columns: the speeds that
    they became, and the drag coefficient; nothing where there are none.
    """
    names = {*columns}
    kept = {
        "heights": [speed for name, speed in SPEED_OF_HEIGHT.items() if name in names],
        "flights": [speed for name, speed in SPEED_OF_FLIGHT.items() if name in names],
    }
    read = {kind: ",".join(speeds) for kind, speeds in kept.items() if speeds}
    return {**read, "drag": repr(scene.slow_drag().value)} if read else {}


def _fall_slope(height: FloatArray, braking: float) -> FloatArray:
    """The derivative [1/s] of the landing speed by the height: v dv/dh is g less what the air
    brakes on the way down.
    """
    speed = air.landing_speed(height, braking)
    return (GRAVITY - 0.5 * braking * speed**2) / speed


def _rise_slope(height: FloatArray, braking: float) -> FloatArray:
    """The derivative [1/s] of the launch speed by the height: v dv/dh is g and what the air brakes
    on the way up.
    """
    speed = air.launch_speed(height, braking)
    return (GRAVITY + 0.5 * braking * speed**2) / speed


def _launch_slope(time: FloatArray, braking: float) -> FloatArray:
    """The derivative [m/s^2] of the launch speed by the time of the flight, from that of
    arctan(u) + arsinh(u).
    """
    speed = air.launch_of_flight(time, braking)
    squared = 1.0 + braking * speed**2 / (2.0 * GRAVITY)
    return GRAVITY / (1.0 / squared + 1.0 / np.sqrt(squared))


def _landing_slope(time: FloatArray, braking: float) -> FloatArray:
    """The derivative [m/s^2] of the landing speed v/sqrt(1 + u^2) by the time of the flight."""
    speed = air.launch_of_flight(time, braking)
    squared = 1.0 + braking * speed**2 / (2.0 * GRAVITY)
    return np.asarray(_launch_slope(time, braking) * squared**-1.5)


def _landing_of_flight(time: FloatArray, braking: float) -> FloatArray:
    """The landing speed [m/s] of flights (rows,) of these times [s]."""
    return air.landing_of_launch(air.launch_of_flight(time, braking), braking)


def _free_height(height: FloatArray) -> FloatArray:
    """The speed [m/s] of a free fall by a height [m]."""
    return np.sqrt(2.0 * GRAVITY * height)


def _free_flight(time: FloatArray) -> FloatArray:
    """The speed [m/s] at both ends of a flight without air: g T/2."""
    return np.asarray(0.5 * GRAVITY * time)


_BOTTOM = "through air, from the bottom of the ball"
_MOTIONS: Mapping[str, _Motion] = {
    "drop_height": _Motion(air.landing_speed, _fall_slope, _free_height, f"a fall {_BOTTOM}"),
    "rebound_height": _Motion(air.launch_speed, _rise_slope, _free_height, f"a rise {_BOTTOM}"),
    "flight_time_1": _Motion(
        _landing_of_flight, _landing_slope, _free_flight, "the end of a flight through air"
    ),
    "flight_time_2": _Motion(
        air.launch_of_flight, _launch_slope, _free_flight, "the start of a flight through air"
    ),
}
