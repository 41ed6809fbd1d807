"""Constants of ball and camera that are held, moved over their range: the shift of a refit to first
order.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import radians, sqrt
from typing import NamedTuple

import numpy as np

from fitball.base import itf
from fitball.base.values import FloatArray
from fitball.data.scene import Scene
from fitball.inference.density import cells
from fitball.inference.derived import Quantity
from fitball.inference.differences import central
from fitball.inference.judgement.first_order import FirstOrder, slopes_of_all
from fitball.inference.problem.problem import Problem
from fitball.inference.schema import Constant
from fitball.models.specs import BALL_PARAMETERS

# Stated sds to either side that make a range: 95 % of a normal distribution.
STATED_SDS = 2.0
# Sd of I/(M R^2) of a tennis ball: the bifilar test gives 0.5625 or 0.520 by which radius its
# strings had (Jafri 2004, Table 8 and Appendix B), and 1 mm of that is 6 %.
INERTIA_SD = 0.03
# I/(M R^2) of round bodies, from full sphere to thin shell: the range of a ball of which no more is
# known.
ROUND_BODIES = (0.4, 2.0 / 3.0)
# By how much a camera may be off that was set: a tilt of half a degree [rad], a ruler read to 1 %,
# a clock to 0.1 %, a court whose height was clicked to 3 mm [m].
CAMERA_REACHES: Mapping[str, float] = {
    "tilt": radians(0.5),
    "scale": 0.01,
    "clock": 0.001,
    "court_height": 0.003,
}
# Share of a range over which slopes are taken: no kink is passed, and rounding is far below.
STEP_SHARE = 0.01
# Sds below which nothing moves, but by rounding.
LEAST_SHIFT = 1e-3


class Held(NamedTuple):
    """A held constant with its `value` and range in SI; the `sd` that is stated or was measured,
    zero where only a tolerance is known.
    """

    name: str
    value: float
    low: float
    high: float
    sd: float

    @property
    def uncertainty(self) -> float:
        """The standard uncertainty: the sd, else that of a rectangular distribution over the
        range.
        """
        return self.sd if self.sd > 0.0 else (self.high - self.low) / sqrt(12.0)

    def values(self, shares: FloatArray) -> FloatArray:
        """The quantiles (values,) of its distribution at shares (values,) between 0 and 1."""
        from scipy.special import ndtri

        if self.sd > 0.0:
            return np.asarray(self.value + self.sd * ndtri(shares))
        return self.low + (self.high - self.low) * shares


class Moved(NamedTuple):
    """A held constant, and the change of a refit by one unit of it, to first order: `coordinates`
    (parameters,) in sds of priors, and what it does `directly` to all quantities (quantities,).
    """

    held: Held
    coordinates: FloatArray
    directly: FloatArray


def constants(
    problem: Problem,
    first: FirstOrder,
    derived: Sequence[Quantity],
) -> tuple[Constant, ...]:
    """The held constants of ball and camera that move any quantity. A shift is that of a refit, for
    derived quantities with what the constant does to them directly.
    """
    along = slopes_of_all(problem, first, derived)
    errors = np.linalg.norm(along @ first.root, axis=1)
    names = [*first.names, *(quantity.spec.name for quantity in derived)]
    moving = []
    for held, coordinates, directly in moves_of_constants(problem, first, derived):
        reach = max(held.high - held.value, held.value - held.low)
        shifts = (along @ coordinates + directly) * reach
        shifts = np.divide(shifts, errors, out=np.zeros(len(names)), where=errors > 0.0)
        by_name = zip(names, shifts.tolist(), strict=True)
        shift_of = {quantity: shift for quantity, shift in by_name if np.isfinite(shift)}
        if max(map(abs, shift_of.values())) > LEAST_SHIFT:
            moving.append(Constant(held.name, held.low, held.high, shift_of))
    return tuple(moving)


def moves_of_constants(
    problem: Problem,
    first: FirstOrder,
    derived: Sequence[Quantity],
) -> Iterator[Moved]:
    """What each held constant moves. Quantities are the parameters that are no noise, then derived
    ones.
    """
    rows, row_of_cell = np.unique(first.rows, return_inverse=True)
    problem_of_rows = problem.on_rows(rows)
    none = np.zeros(len(first.names))
    for held in _ranges(problem):
        extent = held.high - held.low
        rates = _rates(
            problem_of_rows, first.proposal.centre, derived, held.name, held.value, extent
        )
        mean = rates.mean[row_of_cell]
        moves = first.moves(-np.sum(first.whitening * mean, axis=1))
        if problem.contact_time is not None:
            row = first.slopes[first.residual.size]
            in_sds = rates.time / problem.contact_time[1]
            moves = moves - first.root @ (first.root.T @ row) * in_sds
        yield Moved(held, moves, np.concatenate([none, rates.derived]))


class _Rates(NamedTuple):
    """Derivatives by a held constant, in SI: `mean` (impacts, columns) of the predictions, `time`
    of the mean contact time, and `derived` (quantities,) of derived quantities.
    """

    mean: FloatArray
    time: float
    derived: FloatArray


def _rates(
    problem: Problem,
    x: FloatArray,
    derived: Sequence[Quantity],
    name: str,
    value: float,
    extent: float,
) -> _Rates:
    """The derivatives by the held constant `name` at its value, with the parameters at coordinates
    `x` (coordinates,). The step is a share of the constant's range, which is `extent` long.
    """

    def predicted(held: FloatArray) -> FloatArray:
        """At values of the constant (values, 1): all predictions, the mean contact time, then
        derived quantities (values, impacts x columns + 1 + quantities).
        """
        rows = []
        for constant in held[:, 0].tolist():
            posed = problem.with_constant(name, constant)
            cell = cells(posed, x[None])
            values = posed.values(x[None])
            mean = np.where(cell.possible, cell.mean[0], np.nan)
            following = [quantity.rule(values) for quantity in derived]
            rows.append(np.concatenate([mean.ravel(), cell.time, *following]))
        return np.stack(rows)

    step = np.array([STEP_SHARE * extent])
    unlimited = np.array([np.inf])
    at = np.array([[value]])
    slopes = central(predicted, at, step, -unlimited, unlimited)[1][0, 0]
    cell_count = slopes.size - len(derived) - 1
    mean = slopes[:cell_count].reshape(len(problem.rows.y), -1)
    return _Rates(mean, float(slopes[cell_count]), slopes[cell_count + 1 :])


def _ranges(problem: Problem) -> Iterator[Held]:
    """The held constants with their ranges.

    For a ball the range is two stated sds, else the ITF's tolerance, or what shells allow, for a
    camera its reach. Of a ball that is no tennis ball only what the scene states is known.
    """
    held = {}
    for parameter in problem.parameters:
        if parameter.fixed is not None:
            held[parameter.spec.name] = parameter.fixed
    for entry in ball_ranges(problem.scene, held):
        if entry.name not in problem.free:
            yield entry
    bases = {parameter.spec.name.partition("[")[0] for parameter in problem.parameters}
    if problem.forward.model.tangential and "tilt" not in bases:
        held["tilt"] = 0.0
    for name, value in held.items():
        reach = CAMERA_REACHES.get(name.partition("[")[0])
        if reach is not None:
            yield Held(name, value, value - reach, value + reach, 0.0)


def ball_ranges(scene: Scene, held: Mapping[str, float]) -> Iterator[Held]:
    """The constants of a scene's ball with their ranges, at the values of those that are `held`."""
    ball = scene.ball_value()
    stated = scene.ball_sd()
    tennis = itf.is_tennis_ball(ball)
    tolerated = itf.BALL_TOLERANCES if tennis else {}
    for name in BALL_PARAMETERS:
        key = name.removeprefix("ball_")
        value = held.get(name, float(getattr(ball, key)))
        sd = stated.get(key)
        if key == "inertia_ratio" and tennis and sd is None:
            sd = INERTIA_SD
        untested = ROUND_BODIES if key == "inertia_ratio" else (value, value)
        low, high = tolerated.get(name, untested)
        if sd is not None:
            low = value - STATED_SDS * sd
            high = value + STATED_SDS * sd
        if low <= value <= high and low < high:
            yield Held(name, value, low, high, sd or 0.0)
