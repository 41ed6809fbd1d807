"""Another law of restitution in place of that of a fit: where a search for it begins."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitball.base.values import Impacts
from fitball.inference.problem.problem import Problem
from fitball.models.kernels.contact import ANCHOR_SPEED, YIELDING_POWER

# Share of a speed over which the slope of restitution is taken.
_STEP = 0.01
# Share of its limit, 1 or the mass ratio, at which the restitution of the slowest impact begins.
_BELOW_LIMIT = 0.98


def values_under(law: str, problem: Problem, values: Mapping[str, float]) -> dict[str, float]:
    """The `values` of a fit by name, with those of another `law` that has the same restitution and
    slope at the median vertical speed of the table; of `saturating` at 10 m/s. A law without a
    slope has the same restitution.

    Laws that agree at 10 m/s differ far from it, where one of them may have no answer. The mass
    ratio, or else all restitution, is changed where the slowest impact would have none.
    """
    downwards = problem.rows.states.v_y1
    speed = ANCHOR_SPEED if law == "saturating" else float(np.median(downwards))
    slowest = float(downwards.min())
    speeds = speed * np.array([1.0 - _STEP, 1.0, 1.0 + _STEP])
    drops = Impacts(np.zeros(3), speeds, np.zeros(3))
    draw = {name: np.array([value]) for name, value in values.items()}
    changed = dict(values)
    levels = problem.forward.levels
    for numbers in np.unique(problem.rows.index, axis=0):
        rebound = problem.forward.rebound(draw, drops, np.tile(numbers, (3, 1)))
        slower, cor, faster = (rebound.v_y2[0] / speeds).tolist()
        slope = (faster - slower) / (speeds[2] - speeds[0])
        names = {}
        for level, number in zip(levels, numbers, strict=True):
            names[level.parameter] = level.name(level.labels[number])
        mass_ratio = names.get("mass_ratio", "mass_ratio")
        limit = changed[mass_ratio] if problem.forward.model.below else 1.0
        largest, _ = _moved(law, speed, slowest, cor, slope)
        if largest > _BELOW_LIMIT * limit and mass_ratio in problem.free:
            limit = max(limit, min(0.5 * (largest + 1.0), _BELOW_LIMIT))
            changed[mass_ratio] = limit
        share = min(1.0, _BELOW_LIMIT * limit / largest)
        cor_10, slope_10 = _moved(law, speed, ANCHOR_SPEED, share * cor, share * slope)
        changed[names.get("cor_10", "cor_10")] = min(cor_10, _BELOW_LIMIT * limit)
        changed[names.get("cor_slope", "cor_slope")] = slope_10
    return changed


def _moved(law: str, speed: float, to: float, cor: float, slope: float) -> tuple[float, float]:
    """The restitution and its slope [s/m] at the speed `to` by a law that has these at `speed`
    [m/s]. Of the saturating one, which has a limit, it is the tangent.
    """
    power = speed * slope / cor
    if law == "root":
        power = YIELDING_POWER
    elif law != "power":
        return cor + slope * (to - speed), slope
    there = cor * (to / speed) ** power
    return there, power * there / to
