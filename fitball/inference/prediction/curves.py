"""Predictions over incidence angle at a fixed speed and spin, where a table has most impacts: what figures draw."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fitball.inference.problem.problem import Problem
from fitball.inference.results.quantiles import bands
from fitball.inference.results.results import Curve
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, Impacts

CURVE_DRAWS = 400
CURVE_POINTS = 91
MOST_CURVES = 3
# How far from the speed of a curve, and from its spin times the radius, an impact may be, as a share of that speed.
NEAR = 0.1
# A further curve that has fewer impacts near it shows nothing.
FEWEST = 3
# Impacts whose speed and spin are tried as those of a curve.
TRIED = 256
# Least range of angles [rad] that is drawn, and how near to the court it may come.
NARROWEST, LOWEST = math.radians(10.0), math.radians(0.5)


def curves(problem: Problem, values: FloatArray) -> tuple[Curve, ...]:
    """Curves at up to three speeds and spins, of free values (draws, free): first where most impacts are.

    A drop test has one, over its speed. Where a parameter differs between surfaces, balls or tables each curve is on
    one of them.
    """
    found = _levels(problem)
    if problem.table.has_tangential:
        return tuple(
            _over_angle(problem, values, label, rows)
            for label, rows in _crowds(problem, found if len(found) > 1 else {"": np.arange(len(problem.impacts))})
        )
    busiest = sorted(found.items(), key=lambda item: -item[1].size)[:MOST_CURVES]
    return tuple(_over_speed(problem, values, label, rows) for label, rows in sorted(busiest))


def _levels(problem: Problem) -> dict[str, NDArray[np.int64]]:
    """Impacts by what they share of the parameters that are pooled, in words; all as "" where none is."""
    if not problem.pooling:
        return {"": np.arange(len(problem.impacts))}
    columns = {pooling.column: problem.table.labels[pooling.column] for pooling in problem.pooling}
    words = np.array([", ".join(row) for row in zip(*columns.values(), strict=True)])
    return {str(word): np.flatnonzero(words == word) for word in np.unique(words)}


def _rounded(value: float, tolerance: float) -> float:
    """`value` to a multiple of 1, 2 or 5 times a power of ten, at most a third of `tolerance`."""
    decade = 10.0 ** math.floor(math.log10(tolerance / 3.0))
    step = max(digit * decade for digit in (1.0, 2.0, 5.0) if digit * decade <= tolerance / 3.0)
    return round(round(value / step) * step, 12)


def _near(
    problem: Problem, rows: NDArray[np.int64], speed: float, spin: float, share: float = NEAR
) -> NDArray[np.int64]:
    impacts, radius = problem.impacts, problem.model.ball.radius
    apart = np.abs(np.hypot(impacts.v_x1[rows], impacts.v_y1[rows]) - speed)
    turning = radius * np.abs(impacts.omega_1[rows] - spin)
    return rows[np.maximum(apart, turning) <= share * speed]


def _crowds(
    problem: Problem, levels: dict[str, NDArray[np.int64]]
) -> list[tuple[str, tuple[float, float, NDArray[np.int64]]]]:
    """Label, and speed, spin and rows of the impacts near them, by label, spin and speed."""
    left = dict(levels)
    chosen: list[tuple[str, tuple[float, float, NDArray[np.int64]]]] = []
    while left and len(chosen) < MOST_CURVES:
        best = max(((label, _crowd(problem, rows)) for label, rows in left.items()), key=lambda item: item[1][2].size)
        label, (speed, spin, near) = best
        if chosen and near.size < FEWEST:
            break
        chosen.append(best)
        # What lies a little further off would make another curve like this one.
        rows = left.pop(label)
        rest = np.setdiff1d(rows, _near(problem, rows, speed, spin, 2.0 * NEAR))
        # Of several surfaces each has one curve.
        if len(levels) == 1 and rest.size:
            left[label] = rest
    return sorted(chosen, key=lambda item: (item[0], item[1][1], item[1][0]))


def _crowd(problem: Problem, rows: NDArray[np.int64]) -> tuple[float, float, NDArray[np.int64]]:
    """A round speed and spin with as many of `rows` near them as at any of those tried."""
    impacts, radius = problem.impacts, problem.model.ball.radius
    speed = impacts.speed
    tried = rows[np.unique(np.linspace(0, rows.size - 1, TRIED).round().astype(np.int64))]
    near = max((_near(problem, rows, speed[k], impacts.omega_1[k]) for k in tried), key=len)
    middle = float(np.median(speed[near]))
    middle = _rounded(middle, NEAR * middle)
    spin = _rounded(float(np.median(impacts.omega_1[near])), NEAR * middle / radius)
    round_near = _near(problem, rows, middle, spin)
    # Of two impacts far apart the rounded middle may lie near neither.
    return middle, spin, round_near if round_near.size else near


def _over_angle(
    problem: Problem, values: FloatArray, label: str, crowd: tuple[float, float, NDArray[np.int64]]
) -> Curve:
    """The curve over all angles of the table."""
    speed, spin, near = crowd
    angles = problem.impacts.angle
    low, high = float(angles.min()), float(angles.max())
    room = max(0.0, 0.5 * (NARROWEST - (high - low)))
    along = np.linspace(max(low - room, LOWEST), min(high + room, math.pi - LOWEST), CURVE_POINTS)
    cor = _typical_cor(problem, near)
    impacts = Impacts.polar(speed, along, np.full_like(along, spin), cor)
    return Curve(label, speed, spin, near, along, impacts, _bands(problem, values, impacts, near))


def _over_speed(problem: Problem, values: FloatArray, label: str, rows: NDArray[np.int64]) -> Curve:
    """The curve of a drop test."""
    low, high = float(problem.impacts.v_y1.min()), float(problem.impacts.v_y1.max())
    room = max(0.0, 0.5 * (NEAR * high - (high - low)))
    along = np.linspace(low - room, high + room, CURVE_POINTS)
    spin = float(np.median(problem.impacts.omega_1[rows]))
    impacts = Impacts(np.zeros_like(along), along, np.full_like(along, spin), _typical_cor(problem, rows))
    return Curve(label, None, spin, rows, along, impacts, _bands(problem, values, impacts, rows))


def _typical_cor(problem: Problem, rows: NDArray[np.int64]) -> FloatArray | None:
    """For models that are given the restitution of each impact the median of `rows`."""
    given = problem.impacts.cor
    return None if given is None else np.full(CURVE_POINTS, np.median(given[rows]))


def _bands(problem: Problem, values: FloatArray, impacts: Impacts, rows: NDArray[np.int64]) -> dict[str, FloatArray]:
    rebound = problem.rebound(values, impacts, int(rows[0]) if rows.size else None)
    return {name: bands(column.predict(rebound)) for name, column in OBSERVABLES.items()}
