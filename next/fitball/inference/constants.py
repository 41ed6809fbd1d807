"""Constants of ball and camera that are held, moved over their range: the shift of a refit to first order.
Imports: first_order, derived, density, models.specs, itf, problem, results, base.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import radians

import numpy as np

from fitball import itf
from fitball.inference.density import cells
from fitball.inference.differences import central
from fitball.inference.first_order import FirstOrder
from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.inference.problem.joint_prior import Parameter
from fitball.inference.problem.problem import Problem
from fitball.inference.results import Constant
from fitball.models.specs import BALL_PARAMETERS, SPECS
from fitball.priors import parse_prior
from fitball.values import FloatArray

# Stated sds that are a range. Sd of I/(M R^2) of a tennis ball: the bifilar test (0.5625), a thick shell (0.56) and
# other measurements (0.55) agree within it; the ratio of round bodies, from full sphere to thin shell.
STATED, INERTIA_SD, ROUND = 2.0, 0.015, (0.4, 2.0 / 3.0)
# By how much a camera may be off that was set: half a degree, a ruler read to 1 %, a clock to 0.1 %, a court whose
# height was clicked to 3 mm.
CAMERA: Mapping[str, float] = {"tilt": radians(0.5), "scale": 0.01, "clock": 0.001, "court_height": 0.003}
# Share of a range over which slopes are taken: no kink is passed, and rounding is far below.
STEP = 0.01
# Sds below which nothing moves, but by rounding.
NOTHING = 1e-3


def constants(problem: Problem, first: FirstOrder) -> tuple[Constant, ...]:
    """Held constants of ball and camera that move anything: the shift of a refit."""
    kept = np.unique(first.rows)
    part, place = problem.part(kept), np.searchsorted(kept, first.rows)
    x, sds = first.proposal.centre[None], np.linalg.norm(first.root, axis=1)
    found = []
    for name, value, low, high in _ranges(problem):

        def seen(at: FloatArray, name: str = name) -> FloatArray:
            """Predictions, and the mean contact time (constants, impacts + 1, columns)."""
            made = [cells(_with(part, name, float(one)), x) for one in at[:, 0]]
            means = [np.where(one.possible, one.mean[0], np.nan) for one in made]
            times = [np.full((1, one.mean.shape[2]), one.time[0]) for one in made]
            return np.concatenate([np.stack(means), np.stack(times)], axis=1)

        step, ends = np.array([STEP * (high - low)]), np.array([np.inf])
        rate = central(seen, np.array([[value]]), step, -ends, ends)[1][0, 0] * max(high - value, value - low)
        moves = first.moves(-np.sum(first.whitening * rate[:-1][place], axis=1))
        if problem.contact_time is not None:
            time = first.slopes[first.residual.size]
            moves = moves - first.root @ (first.root.T @ time) * (rate[-1, 0] / problem.contact_time[1])
        if np.abs(moves / sds).max() > NOTHING:
            found.append(Constant(name, low, high, dict(zip(first.names, (moves / sds).tolist(), strict=True))))
    return tuple(found)


def _ranges(problem: Problem) -> Iterator[tuple[str, float, float, float]]:
    """Name, value and range: two stated sds, else the ITF's tolerance, or what shells allow; of a camera `CAMERA`. Of
    a ball of another kind nothing is known but what the scene states.
    """
    held = {item.spec.name: item.fixed for item in problem.parameters if item.fixed is not None}
    ball, stated = problem.scene.value(), problem.scene.ball_sd()
    limits = zip((ball.mass, ball.radius), itf.TOLERANCES.values(), strict=True)
    tennis = all(low <= one <= high for one, (low, high) in limits)
    known = itf.TOLERANCES if tennis else {}
    for name in BALL_PARAMETERS:
        key = name.removeprefix("ball_")
        value, sd = held.get(name, float(getattr(ball, key))), stated.get(key)
        if key == "inertia_ratio" and tennis and sd is None:
            sd = INERTIA_SD
        low, high = known.get(name, ROUND if key == "inertia_ratio" else (value, value))
        if sd is not None:
            low, high = value - STATED * sd, value + STATED * sd
        if name not in problem.free and low <= value <= high and low < high:
            yield name, value, low, high
    for name, value in held.items():
        reach = CAMERA.get(name.partition("[")[0])
        if reach is not None:
            yield name, value, value - reach, value + reach


def _with(problem: Problem, name: str, value: float) -> Problem:
    """The problem with another value of a constant."""
    spec = {**SPECS, **CAMERA_SPECS}[name.partition("[")[0]]
    others = tuple(item for item in problem.parameters if item.spec.name != name)
    held = Parameter(replace(spec, name=name), parse_prior(spec, spec.prior), value)
    return replace(problem, parameters=(*others, held))
