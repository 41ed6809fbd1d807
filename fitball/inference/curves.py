"""Curves that figures draw: the model over incidence, at speeds and spins where a table has most
impacts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fitball.base.selection import evenly_spread
from fitball.base.values import DataFrame, FloatArray, Impacts, IntArray
from fitball.inference.forward import Draws
from fitball.inference.predictive import Asked
from fitball.inference.problem.problem import Problem
from fitball.inference.summary import bands

# Draws and points of a curve; curves at most.
_DRAWS = 400
_POINTS = 61
_MOST = 6
# How far from the speed of a curve, and from its spin times the radius, an impact may be, as a
# share of that speed; impacts with which a further curve shows something; impacts whose speed and
# spin are tried as those of a curve.
_NEAR = 0.1
_FEWEST = 3
_TRIED = 256
# Least range of angles [rad] that is drawn, and how near to the court it may come.
_NARROWEST = math.radians(10.0)
_LOWEST = math.radians(0.5)


class Series(NamedTuple):
    """A curve: labels of its level in words, a round speed [m/s] (NaN in a drop test) and spin
    [rad/s], the levels (levels,) on which it lies, and an impact `like` it.
    """

    name: str
    speed: float
    spin: float
    like: int


class _Places(NamedTuple):
    """Speeds [m/s] and spins [rad/s] (impacts,), and the radius [m] that makes speeds of spins."""

    speed: FloatArray
    spin: FloatArray
    radius: float

    def near(self, rows: IntArray, speed: float, spin: float, share: float) -> IntArray:
        """Of rows those near a speed and spin."""
        away = self.radius * np.abs(self.spin[rows] - spin)
        return rows[np.maximum(np.abs(self.speed[rows] - speed), away) <= share * speed]

    def crowd(self, rows: IntArray) -> tuple[float, float, IntArray]:
        """A round speed and spin with as many of `rows` near them as at any of those tried."""
        tried = rows[evenly_spread(rows.size, _TRIED)]
        near = max((self.near(rows, self.speed[k], self.spin[k], _NEAR) for k in tried), key=len)
        middle = float(np.median(self.speed[near]))
        middle = _rounded(middle, _NEAR * middle)
        turning = _rounded(float(np.median(self.spin[near])), _NEAR * middle / self.radius)
        # Of two impacts far apart the rounded middle may lie near neither.
        round_near = self.near(rows, middle, turning, _NEAR)
        return middle, turning, round_near if round_near.size else near


def series(problem: Problem) -> tuple[tuple[Series, ...], IntArray]:
    """The curves of a table, and of each impact (impacts,) the nearest: of its own level, if that
    has one, by speed, and spin as the speed of the surface. A drop test has one a level.
    """
    forward = problem.forward
    states = problem.rows.states
    tangential = forward.model.tangential
    radius = forward.model.ball.radius
    places = _Places(states.polar()[0], states.omega_1, radius)
    every = np.arange(len(states))
    levels = np.unique(problem.rows.index, axis=0, return_inverse=True)[1].ravel()
    left = {int(key): every[levels == key] for key in np.unique(levels)}
    found = list[Series]()
    drawn = set[int]()
    crowds = {
        key: places.crowd(rows) if tangential else (math.nan, 0.0, rows)
        for key, rows in left.items()
    }
    while crowds and len(found) < _MOST:
        # First every level, then where most impacts are.
        key = max(crowds, key=lambda key: (key not in drawn, crowds[key][2].size))
        middle, turning, near = crowds.pop(key)
        if key in drawn and near.size < _FEWEST:
            continue
        drawn.add(key)
        labels = (
            own.labels[k]
            for own, k in zip(forward.levels, problem.rows.index[near[0]], strict=True)
        )
        found.append(Series(", ".join(dict.fromkeys(labels)), middle, turning, int(near[0])))
        if tangential:
            # What lies a little further off would make another curve like this one.
            left[key] = np.setdiff1d(left[key], places.near(every, middle, turning, 2.0 * _NEAR))
            if left[key].size:
                crowds[key] = places.crowd(left[key])
    found.sort(key=lambda one: (one.name, one.spin, one.speed))
    away = np.stack(
        [
            np.hypot(
                radius * (places.spin - one.spin),
                places.speed - one.speed if tangential else 0.0,
            )
            for one in found
        ]
    )
    other = np.stack([levels != levels[one.like] for one in found])
    return tuple(found), np.where(other & ~other.all(axis=0), np.inf, away).argmin(axis=0)


def _rounded(value: float, tolerance: float) -> float:
    """`value` to a multiple of 1, 2 or 5 times a power of ten, at most a third of `tolerance`."""
    decade = 10.0 ** math.floor(math.log10(tolerance / 3.0))
    step = max(digit * decade for digit in (1.0, 2.0, 5.0) if digit * decade <= tolerance / 3.0)
    return round(round(value / step) * step, 12)


def curves(problem: Problem, draws: Draws) -> DataFrame:
    """A row a curve, measured column and point; `report.fit_page` has the columns."""
    import pandas as pd

    found, which = series(problem)
    tangential = problem.forward.model.tangential
    states = problem.rows.states
    place = states.polar()[1] if tangential else states.v_y1
    frames = []
    count = len(next(iter(draws.values.values())))
    rows = evenly_spread(count, _DRAWS)
    values = {name: array[rows] for name, array in draws.values.items()}
    columns = tuple(item.column.name for item in problem.observables)
    names = {one.name for one in found}
    for k, one in enumerate(found):
        along = _range(place, tangential)
        index = np.tile(problem.rows.index[one.like], (_POINTS, 1))
        # What is drawn beside measurements is what the camera of their session shows.
        camera = None if problem.camera is None else problem.camera.take(np.full(_POINTS, one.like))
        shown = Asked(_along(one, along), index, columns, camera=camera)
        best = shown.shown(problem.forward, draws.best, shown.impacts)
        drawn = shown.shown(problem.forward, values if count else draws.best, shown.impacts)
        own = place[which == k]
        within = (
            (along >= own.min()) & (along <= own.max())
            if own.size
            else np.zeros(_POINTS, dtype=np.bool_)
        )
        shared = {"series": k, "name": one.name if len(names) > 1 else "", "speed": one.speed}
        shared |= {"spin": one.spin if tangential else math.nan}
        for column in columns:
            known = drawn.answers(column)
            q025, q16, median, q84, q975 = bands(known) if count else np.full((5, _POINTS), np.nan)
            point = best.answers(column)[0]
            frames.append(
                pd.DataFrame(
                    {
                        **shared,
                        "column": column,
                        "along": along,
                        "point": point,
                        "q025": q025,
                        "q16": q16,
                        "median": median,
                        "q84": q84,
                        "q975": q975,
                        "within": within,
                    }
                )
            )
    return pd.concat(frames, ignore_index=True)


def _range(place: FloatArray, tangential: bool) -> FloatArray:
    """Points over all angles [rad] of a table, or vertical speeds [m/s] of a drop test, over some
    range at least.
    """
    low = float(place.min())
    high = float(place.max())
    room = max(0.0, 0.5 * ((_NARROWEST if tangential else _NEAR * high) - (high - low)))
    if tangential:
        low = max(low, _LOWEST + room)
        high = min(high, math.pi - _LOWEST - room)
    return np.linspace(low - room, high + room, _POINTS)


def _along(one: Series, along: FloatArray) -> Impacts:
    """The states of a curve."""
    spin = np.full(_POINTS, one.spin)
    if math.isnan(one.speed):
        return Impacts(np.zeros(_POINTS), along, spin)
    return Impacts(one.speed * np.cos(along), one.speed * np.sin(along), spin)
