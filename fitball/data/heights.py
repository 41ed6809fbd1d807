"""Heights of drops and rebounds become speeds, by falls and rises through air (`base.air`)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fitball.base import air
from fitball.base.columns import SPEED_OF_HEIGHT
from fitball.base.itf import GRAVITY
from fitball.base.values import FloatArray
from fitball.data.cells import TableCells
from fitball.data.kinematics import Columns
from fitball.data.scene import Scene


def speeds_of_heights(cells: TableCells, columns: Columns, scene: Scene) -> dict[str, FloatArray]:
    """The columns (rows,) in SI with vertical speeds in place of heights; their sds to first order.
    A note says how much the air matters, a fault (`height-and-speed`) where both are there.
    """
    with_speeds = dict(columns)
    drag = scene.slow_drag()
    braking = usual_braking(scene)
    for name, speed in SPEED_OF_HEIGHT.items():
        height = with_speeds.pop(name, None)
        sd = with_speeds.pop(f"{name}_sd", None)
        if height is None:
            continue
        if speed in columns:
            words = f"says the same as {speed}: leave one of them out (--ignore)"
            cells.fault("height-and-speed", words, name)
            continue
        falls = speed == "v_y1"
        convert = air.landing_speed if falls else air.launch_speed
        speeds = convert(np.abs(height), braking)
        with_speeds[speed] = speeds
        if sd is not None:
            # v dv/dh is g less what the air brakes on the way down, and g more on the way up.
            braked = 0.5 * braking * speeds**2
            change = GRAVITY - braked if falls else GRAVITY + braked
            with_speeds[f"{speed}_sd"] = change * sd / speeds
        cells.note("heights", _words(name, speed, height, speeds, drag))
    return with_speeds


def usual_braking(scene: Scene) -> float:
    """The braking [1/m] of a scene's ball in its air, at the usual or the stated drag."""
    return scene.slow_drag().value * air.braking_per_drag(scene.ball_value(), scene.air)


def _words(
    name: str,
    speed: str,
    height: FloatArray,
    speeds: FloatArray,
    drag: air.Coefficient,
) -> str:
    """What was made of a column of heights (rows,), and by how much air changes the speeds."""
    free = np.sqrt(2.0 * GRAVITY * np.abs(height))
    change = float(np.nanmedian(speeds / free)) - 1.0
    motion = "a fall" if speed == "v_y1" else "a rise"
    sd = f" ± {drag.sd:g}" if drag.sd else ""
    return (
        f"{name}: {speed} by {motion} through air, from the bottom of the ball; drag coefficient "
        f"{drag.value:g}{sd}; {change:+.1%} against free fall"
    )


def heights_read(columns: Iterable[str], scene: Scene) -> dict[str, str]:
    """What a table keeps of the heights among the names of its columns: the speeds that they
    became, and the drag coefficient; nothing where there are none.
    """
    speeds = [speed for height, speed in SPEED_OF_HEIGHT.items() if height in columns]
    if not speeds:
        return {}
    return {"heights": ",".join(speeds), "drag": repr(scene.slow_drag().value)}
