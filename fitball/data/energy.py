"""Rows that rebound with more than they came with, and the cell that is to blame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np

from fitball.base.columns import COLUMNS, REBOUND
from fitball.base.display_units import PLAIN
from fitball.base.priors import ParameterSpec, usual_value
from fitball.base.text import listed
from fitball.base.values import Ball, BoolArray, FloatArray
from fitball.data.cells import TableCells
from fitball.data.checks import Units, in_unit_of_file
from fitball.data.kinematics import Columns, counting_columns, results_and_slopes, velocity
from fitball.data.scene import Scene
from fitball.data.slips import slips_by_row

# Sds of the noise by which no row is above what is possible: by chance one of three million on the
# bound.
_MOST_SDS = 5.0
# Numbers of a row that a message names.
_NAMED_NUMBERS = 8
# What says that a ball rebounds too fast, by the columns that say so.
_EXCESSES = {
    ("v_y1", "v_y2"): "v_y2 exceeds v_y1",
    ("v_1", "v_2"): "v_y2 exceeds v_y1",
    ("drop_height", "rebound_height"): "rebound_height exceeds drop_height",
    ("flight_time_1", "flight_time_2"): "flight_time_2 exceeds flight_time_1",
    ("cor",): "cor exceeds 1",
    ("height_ratio",): "height_ratio exceeds 1",
    ("peak_height",): "peak_height exceeds that before it",
    ("bounce_interval",): "bounce_interval exceeds that before it",
}


def gained_energy(
    cells: TableCells,
    numbers: Columns,
    own: Columns,
    units: Units,
    ball: Ball,
    noise: Mapping[str, float],
    option: str = "",
) -> None:
    """Add faults of rows that rebound faster, or with more energy, than they came, by 5 sd of the
    stated or expected `noise` [SI, by column]. What was not measured of the rebound counts as zero.
    `numbers` are velocities, `own` the columns (rows,) of the file, which faults name. `option` is
    what `--columns` takes to read columns of other names that may be meant.
    """
    names = [*counting_columns(numbers, "1"), *counting_columns(numbers, "2"), "omega_1", "omega_2"]
    values = {}
    for name in names:
        if name in numbers:
            array = numbers[name]
            values[name] = np.nan_to_num(array) if name.endswith("2") else array
    results, slope = results_and_slopes(lambda columns: _gains(columns, ball), values)
    variance = np.zeros(slope.shape[:2])
    for k, name in enumerate(values):
        sd = np.nan_to_num(np.asarray(numbers.get(f"{name}_sd", noise.get(name, 0.0))))
        variance += (slope[:, :, k] * sd[..., None]) ** 2
    shown = {
        name: array
        for name, array in own.items()
        if name in COLUMNS and (name in values or name not in numbers)
    }
    blamed = np.zeros(len(slope), dtype=np.bool_)
    # Where a slope is not finite nothing is known, and no comparison holds.
    for code, gain, sds in zip(results, results.values(), np.sqrt(variance).T, strict=True):
        above = (gain > _MOST_SDS * sds) & ~blamed
        blamed |= above
        with np.errstate(divide="ignore", invalid="ignore"):
            _blame(cells, code, shown, units, above, gain / sds, option)


def _blame(
    cells: TableCells,
    code: str,
    shown: Columns,
    units: Units,
    above: Annotated[BoolArray, "rows"],
    sds: FloatArray,
    option: str,
) -> None:
    """Add faults of the rows that are `above` what is possible by as many `sds` (rows,): of the
    cell that is mistyped, else of the column that says the rebound.
    """
    column = None
    gained = "the ball gains energy"
    if code == "restitution":
        gained, column = _excess(shown)
    slips = slips_by_row(shown, units)
    remedy = _remedy(shown, above, option)
    for k in np.flatnonzero(above).tolist():
        size = f"{gained} by {PLAIN.number(sds[k], 2)} sd of the noise"
        row = [
            f"{name} = {in_unit_of_file(name, float(array[k]), units)}"
            for name, array in shown.items()
            if np.isfinite(array[k])
        ]
        if len(slips.get(k, ())) == 1:
            ((mistyped, words),) = slips[k].items()
            cells.fault(code, f"{words}: correct the cell. As it stands {size}", mistyped, k)
        else:
            words = f"{size}: {listed(row, most=_NAMED_NUMBERS)}; expected a loss: {remedy}"
            cells.fault(code, words, column, k)


def _excess(shown: Columns) -> tuple[str, str | None]:
    """The words that a ball rebounds too fast, and the column that says so."""
    for names, words in _EXCESSES.items():
        if all(name in shown for name in names):
            return words, names[-1]
    after = (name for name in ("v_y2", "v_2") if name in shown)
    return "v_y2 exceeds v_y1", next(after, None)


def _remedy(shown: Columns, above: Annotated[BoolArray, "rows"], option: str) -> str:
    """What to look for, where some rows or most gain energy."""
    if "surface_speed" in option:
        return f'did the surface move? --columns "{option}"'
    words = "look for swapped columns and other units, or state ball and noise in the scene"
    if "surface_speed" in shown and np.all(shown["surface_speed"][above] < 0.0):
        return f"{words}. surface_speed is positive towards the ball: --flip surface_speed"
    dropped = shown.keys() <= {"v_y1", "v_y2", "v_1", "v_2"}
    if dropped and 2 * int(above.sum()) > len(above):
        return f"{words}; add the speed of a racket or plate as surface_speed"
    return words


def _gains(columns: Columns, ball: Ball) -> Columns:
    """By how much v_y2 exceeds v_y1 [m/s], and energy after energy before, over half the mass
    [m^2/s^2], each (impacts,).
    """
    before = velocity(columns, "1")
    after = velocity(columns, "2")
    zero = 0.0 * next(iter(columns.values()))
    speed_1 = before.get("v_1", before["v_y1"])
    speed_2 = after.get("v_2", after.get("v_x2", after.get("v_y2", zero)))
    spins = columns.get("omega_2", zero) ** 2 - columns.get("omega_1", zero) ** 2
    gains = {}
    if "v_y2" in after:
        gains["restitution"] = after["v_y2"] - before["v_y1"]
    gains["energy"] = speed_2**2 - speed_1**2 + ball.inertia_ratio * ball.radius**2 * spins
    return gains


def expected_noises(scene: Scene) -> dict[str, float]:
    """Noise [SI] of rebound columns that state no errors: that in the scene, else the median of its
    prior.
    """
    noises = {}
    for name in REBOUND:
        spec = COLUMNS[name].noise
        if spec is None:
            continue
        stated = _stated_noise(scene, spec)
        if stated is None:
            stated = usual_value(spec)
        noises[name] = stated
    return noises


def _stated_noise(scene: Scene, spec: ParameterSpec) -> float | None:
    """The sd that a scene states for a noise parameter, held or nominal, or for all velocities."""
    names = [spec.name]
    if spec.unit == "m/s":
        names.append("velocity_sd")
    for name in names:
        for key in (name, f"nominal_{name}"):
            stated = scene.measurement.get(key)
            if isinstance(stated, float | int):
                return stated
    return None
