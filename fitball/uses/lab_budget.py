"""Uncertainty budgets of what laboratory tests measured: mean rebounds and ratings of courts.

Of type A is the scatter of balls, places and repeats, by the draws of `uses.means`: half of the
central 68 %, so that few repeats count as Student's t has them. Of type B are constants that no
drop or impact shows: the drag of a ball in air with its mass and radius, the tilt of the camera of
a court test, and the temperature of the balls where none is stated. The Monte Carlo draws them
together and computes the result anew at each drawing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np

from fitball.base import air, itf
from fitball.base.values import FloatArray
from fitball.data.kinematics import AnalyticArray, velocity
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.effort import Effort
from fitball.inference.fitted import Fitted
from fitball.inference.judgement.constants import CAMERA_REACHES, STATED_SDS, Held, ball_ranges
from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.inference.problem.fall import FALL_SPECS
from fitball.models.specs import SPECS
from fitball.uses.drops import Drops, Restitution, drops_of
from fitball.uses.measured import label_of
from fitball.uses.pace import TestedPace, pace_of, rating
from fitball.uses.sources import DRAWINGS, Budget, Source, combined, hypercube, rows_of_result

# From a value of each constant, by name, to the result in SI.
_Computed: TypeAlias = Callable[[Mapping[str, float]], float]
# The constant of the balls of a court test, and its unit.
_TEMPERATURE = "ball_temperature"
_CELSIUS = "degC"
# What a ball's flight through air depends on.
_OF_FLIGHT = ("ball_mass", "ball_radius")
# Share of a standard uncertainty over which slopes are taken: far from the ends of any range.
_STEP = 0.01


def measured_rows(fit: Fitted) -> Iterator[dict[str, object]]:
    """The rows of budgets of all that laboratory tests of a fit's table measured, with an interval:
    mean rebound and COR of drops on each surface, rating of each court.
    """
    run = fit.run
    asked = run.table, run.scene, run.choices.prior
    found = drops_of(*asked)
    for test, restitutions in found:
        label = label_of(test.surface if len(found) > 1 else "")
        yield from _rows_of_drops(test, restitutions[0], label, run.scene)
    for tested in pace_of(*asked):
        yield from _rows_of_pace(tested, run.table, run.scene)


def _rows_of_drops(
    test: Drops,
    mean: Restitution,
    label: str,
    scene: Scene,
) -> Iterator[dict[str, object]]:
    """The rows of the mean rebound of a test, where that is judged, and of its mean COR."""
    if not mean.draws.size:
        return
    held = [*_of_air(scene)]
    cor = np.array([mean.cor])
    sizes = {"balls": len(test.names), "repeats": len(test.cor)}
    spreads = {"balls": test.means.between, "repeats": test.means.repeats}

    def restitution(values: Mapping[str, float]) -> float:
        """The mean COR."""
        return float(test.air.restitutions_at(cor, mean.speed, _braking(scene, values))[0])

    def rebound(values: Mapping[str, float]) -> float:
        """The mean rebound [m] from the height of the test."""
        return float(test.air.rebounds_at(cor, _braking(scene, values))[0])

    usual = np.full(mean.draws.size, test.air.usual)
    if test.judged:
        draws = test.air.rebounds_at(mean.draws, usual)
        scatter = list(_scatter(draws, spreads, sizes, "m"))
        yield from _rows(f"rebound_measured{label}", "m", draws, scatter, held, rebound)
    scatter = list(_scatter(mean.draws, spreads, sizes, ""))
    yield from _rows(f"cor_measured{label}", "", mean.draws, scatter, held, restitution)


def _rows_of_pace(
    tested: TestedPace,
    table: ImpactTable,
    scene: Scene,
) -> Iterator[dict[str, object]]:
    """The rows of the rating of a court."""
    means = tested.means
    if not means.mean.size:
        return
    sizes = {"places": len(tested.places), "repeats": len(tested.rows)}
    spreads = {"places": means.between, "repeats": means.repeats}
    scatter = list(_scatter(means.mean, spreads, sizes, ""))
    computed = partial(_mean_rating, tested, table, scene)
    name = f"pace_measured{label_of(tested.surface)}"
    yield from _rows(name, "", means.mean, scatter, [*_of_court(scene)], computed)


def _half(draws: FloatArray) -> float:
    """Half of the width of the central 68 % of draws (draws,)."""
    low, high = np.quantile(draws, (0.16, 0.84))
    return 0.5 * float(high - low)


def _scatter(
    draws: FloatArray,
    spreads: Mapping[str, FloatArray],
    sizes: Mapping[str, int],
    unit: str,
) -> Iterator[Source]:
    """The sources of the scatter of a mean (draws,): of groups and of repeats, each by the draws of
    its sd and by how many there are.
    """
    variances = {
        name: float(np.median(sds)) ** 2 / sizes[name] for name, sds in spreads.items() if sds.size
    }
    total = sum(variances.values())
    whole = _half(draws)
    if not total > 0.0:
        variances = {"repeats": 1.0}
        total = 1.0
    for name, variance in variances.items():
        part = whole * float(np.sqrt(variance / total))
        words = f"scatter of {sizes[name]} {name}"
        yield Source(words, np.nan, part, unit, "A", "Student's t", np.array([part]))


def _rows(
    name: str,
    unit: str,
    draws: FloatArray,
    scatter: Sequence[Source],
    held: Sequence[Held],
    computed: _Computed,
) -> Iterator[dict[str, object]]:
    """The rows of one result with these `draws` (draws,), sources of scatter, and constants that
    are `held`, from which it is `computed`.
    """
    usual = {constant.name: constant.value for constant in held}
    sources = list(scatter)
    for constant in held:
        step = _STEP * constant.uncertainty
        above, below = (
            computed(usual | {constant.name: constant.value + side}) for side in (step, -step)
        )
        slope = (above - below) / (2.0 * step)
        sources.append(
            Source(
                constant.name,
                constant.value,
                constant.uncertainty,
                _unit_of(constant.name),
                "B",
                "normal" if constant.sd > 0.0 else "rectangular",
                np.array([slope * constant.uncertainty]),
            )
        )
    sd = _half(draws)
    drawn = float(np.hypot(sd, _spread_of_drawings(held, computed)))
    value = float(np.median(draws))
    yield from rows_of_result(Budget(name, unit, value, sd, combined(sources), drawn), sources)


def _spread_of_drawings(held: Sequence[Held], computed: _Computed) -> float:
    """The sd of a result over drawings of all constants together."""
    if not held:
        return 0.0
    shares = hypercube(len(held), DRAWINGS, Effort().stream("budget"))
    drawn = np.stack([constant.values(row) for constant, row in zip(held, shares, strict=True)])
    names = [constant.name for constant in held]
    results = [computed(dict(zip(names, values, strict=True))) for values in drawn.T.tolist()]
    return float(np.std(results))


def _of_air(scene: Scene) -> Iterator[Held]:
    """The constants that the flights of a dropped ball depend on."""
    drag = scene.slow_drag()
    if drag.sd > 0.0:
        reach = STATED_SDS * drag.sd
        yield Held("drag", drag.value, drag.value - reach, drag.value + reach, drag.sd)
    yield from (held for held in ball_ranges(scene, {}) if held.name in _OF_FLIGHT)


def _braking(scene: Scene, values: Mapping[str, float]) -> FloatArray:
    """The braking [1/m] (1,) of a scene's ball with these constants."""
    constants = {name.removeprefix("ball_"): values[name] for name in _OF_FLIGHT if name in values}
    ball = replace(scene.ball_value(), **constants)
    drag = max(values.get("drag", scene.slow_drag().value), FALL_SPECS["drag"].lower)
    return np.array([drag * air.braking_per_drag(ball, scene.air)])


def _of_court(scene: Scene) -> Iterator[Held]:
    """The constants that the rating of a court depends on. A scene's tilt is that of its camera."""
    if scene.camera is None or scene.camera.tilt is None:
        reach = CAMERA_REACHES["tilt"]
        yield Held("tilt", 0.0, -reach, reach, 0.0)
    if scene.ball.temperature is None:
        yield Held(_TEMPERATURE, itf.TEST_TEMPERATURE, *itf.PACE_BALL_TEMPERATURES, 0.0)


def _mean_rating(
    tested: TestedPace,
    table: ImpactTable,
    scene: Scene,
    values: Mapping[str, float],
) -> float:
    """The mean over places of ratings, seen by a camera with a tilt, of balls of a temperature."""
    rows = tested.rows
    leaving = velocity(table.values, "2")
    tilt = values.get("tilt", 0.0)
    before = _turned(table.impacts.v_x1[rows], -table.impacts.v_y1[rows], tilt)
    after = _turned(leaving["v_x2"][rows], leaving["v_y2"][rows], tilt)
    columns = {
        "v_x1": before.real,
        "v_y1": -before.imag,
        "v_x2": after.real,
        "v_y2": after.imag,
    }
    temperature = values.get(_TEMPERATURE, scene.ball.temperature)
    ratings = rating(columns, table.impacts.side[rows], temperature).real
    count = len(tested.places)
    sums = np.bincount(tested.place, weights=ratings, minlength=count)
    return float(np.mean(sums / np.bincount(tested.place, minlength=count)))


def _turned(along: FloatArray, up: FloatArray, tilt: float) -> AnalyticArray:
    """Velocities (rows,) as complex numbers, in the frame of a court that is tilted by so much."""
    return np.asarray((along + 1j * up) * np.exp(-1j * tilt))


def _unit_of(name: str) -> str:
    """The SI unit of a constant."""
    if name == _TEMPERATURE:
        return _CELSIUS
    return {**SPECS, **CAMERA_SPECS, **FALL_SPECS}[name].unit
