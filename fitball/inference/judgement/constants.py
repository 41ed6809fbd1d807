"""Constants of ball and camera that are held, moved over their range: the shift of a refit to first
order.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import radians

import numpy as np

from fitball.base import itf
from fitball.base.values import FloatArray
from fitball.inference.density import cells
from fitball.inference.derived import Quantity
from fitball.inference.differences import central
from fitball.inference.judgement.first_order import FirstOrder, slopes_of_all
from fitball.inference.problem.problem import Problem
from fitball.inference.schema import Constant
from fitball.models.specs import BALL_PARAMETERS

# Stated sds that are a range. Sd of I/(M R^2) of a tennis ball: the bifilar test (0.5625), a thick
# shell (0.56) and other measurements (0.55) agree within it; the ratio of round bodies, from full
# sphere to thin shell.
STATED = 2.0
INERTIA_SD = 0.015
ROUND = (0.4, 2.0 / 3.0)
# By how much a camera may be off that was set: half a degree, a ruler read to 1 %, a clock to 0.1
# %, a court whose height was clicked to 3 mm.
CAMERA: Mapping[str, float] = {
    "tilt": radians(0.5),
    "scale": 0.01,
    "clock": 0.001,
    "court_height": 0.003,
}
# Share of a range over which slopes are taken: no kink is passed, and rounding is far below.
STEP = 0.01
# Sds below which nothing moves, but by rounding.
NOTHING = 1e-3


def constants(
    problem: Problem,
    first: FirstOrder,
    derived: Sequence[Quantity],
) -> tuple[Constant, ...]:
    """Held constants of ball and camera that move anything: the shift of a refit; of derived
    quantities also what the constant does to them itself.
    """
    kept, place = np.unique(first.rows, return_inverse=True)
    part = problem.part(kept)
    x = first.proposal.centre
    along = slopes_of_all(problem, first, derived)
    spread = np.linalg.norm(along @ first.root, axis=1)
    found = []
    names = [*first.names, *(one.spec.name for one in derived)]
    for name, value, low, high in _ranges(problem):

        def seen(at: FloatArray, name: str = name) -> FloatArray:
            """Predictions and the mean contact time (constants, (impacts + 1) columns), then
            derived quantities.
            """
            rows = []
            for one in at[:, 0].tolist():
                posed = part.holding(name, one)
                made = cells(posed, x[None])
                values = posed.values(x[None])
                mean = np.where(made.possible, made.mean[0], np.nan)
                rows.append([mean.ravel(), made.time, *(each.rule(values) for each in derived)])
            return np.stack([np.concatenate(row) for row in rows])

        step = np.array([STEP * (high - low)])
        ends = np.array([np.inf])
        rate = central(seen, np.array([[value]]), step, -ends, ends)[1][0, 0] * max(
            high - value,
            value - low,
        )
        mean, time, own = np.split(rate, [rate.size - len(derived) - 1, rate.size - len(derived)])
        moves = first.moves(-np.sum(first.whitening * mean.reshape(len(kept), -1)[place], axis=1))
        if problem.contact_time is not None:
            row = first.slopes[first.residual.size]
            moves = moves - first.root @ (first.root.T @ row) * (time[0] / problem.contact_time[1])
        further = along @ moves + np.concatenate([np.zeros(len(first.names)), own])
        further = np.divide(further, spread, out=np.zeros(len(names)), where=spread > 0.0)
        whole = {
            name: by for name, by in zip(names, further.tolist(), strict=True) if np.isfinite(by)
        }
        if max(map(abs, whole.values())) > NOTHING:
            found.append(Constant(name, low, high, whole))
    return tuple(found)


def _ranges(problem: Problem) -> Iterator[tuple[str, float, float, float]]:
    """Name, value and range: two stated sds, else the ITF's tolerance, or what shells allow; of a
    camera `CAMERA`. Of a ball of another kind nothing is known but what the scene states.
    """
    held = {item.spec.name: item.fixed for item in problem.parameters if item.fixed is not None}
    ball = problem.scene.ball_value()
    stated = problem.scene.ball_sd()
    tennis = itf.is_tennis_ball(ball)
    tolerated = itf.TOLERANCES if tennis else {}
    for name in BALL_PARAMETERS:
        key = name.removeprefix("ball_")
        value = held.get(name, float(getattr(ball, key)))
        sd = stated.get(key)
        if key == "inertia_ratio" and tennis and sd is None:
            sd = INERTIA_SD
        low, high = tolerated.get(name, ROUND if key == "inertia_ratio" else (value, value))
        if sd is not None:
            low = value - STATED * sd
            high = value + STATED * sd
        if name not in problem.free and low <= value <= high and low < high:
            yield name, value, low, high
    known = {item.spec.name.partition("[")[0] for item in problem.parameters}
    if problem.forward.model.tangential and "tilt" not in known:
        held["tilt"] = 0.0
    for name, value in held.items():
        reach = CAMERA.get(name.partition("[")[0])
        if reach is not None:
            yield name, value, value - reach, value + reach
