"""Curves that figures draw: the model over incidence, at speeds and spins where a table has most
impacts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fitball.base.selection import evenly_spread
from fitball.base.values import DataFrame, FloatArray, Impacts, IntArray
from fitball.inference.forward import Draws
from fitball.inference.predictive import Asked
from fitball.inference.problem.problem import Problem
from fitball.inference.summary import bands

# Draws of a curve: ten are beyond either end of a band of 95 %, which is enough for the eye.
_DRAWS = 400
# Points of a curve: between two of 61 the eye sees no corner.
_POINTS = 61
# Curves at most: more cannot be told apart in one figure.
_MOST = 6
# How far from the speed of a curve, and from its spin times the radius, an impact may be, as a
# share of that speed: settings of one machine scatter by less.
_NEAR = 0.1
# Impacts with which a further curve of a level shows something: two may be near by chance.
_FEWEST = 3
# Impacts whose speed and spin are tried as those of a curve: each is compared with all others.
_TRIED = 256
# Least range of angles [rad] that is drawn: over a narrower one every curve is a line.
_NARROWEST = math.radians(10.0)
# How near to the court angles [rad] may come: at zero there is no impact.
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
        faster = np.abs(self.speed[rows] - speed)
        turning = self.radius * np.abs(self.spin[rows] - spin)
        return rows[np.maximum(faster, turning) <= share * speed]

    def crowd(self, rows: IntArray) -> tuple[float, float, IntArray]:
        """A round speed and spin with as many of `rows` near them as at any of those tried."""
        tried = rows[evenly_spread(rows.size, _TRIED)]
        crowds = (self.near(rows, self.speed[k], self.spin[k], _NEAR) for k in tried)
        near = max(crowds, key=len)
        speed = float(np.median(self.speed[near]))
        speed = _rounded(speed, _NEAR * speed)
        spin = float(np.median(self.spin[near]))
        spin = _rounded(spin, _NEAR * speed / self.radius)
        # Of two impacts far apart the rounded middle may lie near neither.
        round_near = self.near(rows, speed, spin, _NEAR)
        return speed, spin, round_near if round_near.size else near


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
    _, levels = np.unique(problem.rows.index, axis=0, return_inverse=True)
    levels = levels.ravel()
    remaining = {int(key): every[levels == key] for key in np.unique(levels)}
    drawn = list[Series]()
    drawn_levels = set[int]()
    crowds = {
        key: places.crowd(rows) if tangential else (math.nan, 0.0, rows)
        for key, rows in remaining.items()
    }

    def urgency(key: int) -> tuple[bool, int]:
        """First every level, then where most impacts are."""
        return key not in drawn_levels, crowds[key][2].size

    while crowds and len(drawn) < _MOST:
        key = max(crowds, key=urgency)
        speed, spin, near = crowds.pop(key)
        if key in drawn_levels and near.size < _FEWEST:
            continue
        drawn_levels.add(key)
        like = int(near[0])
        drawn.append(Series(_name(problem, like), speed, spin, like))
        if tangential:
            # What lies a little further off would make another curve like this one.
            similar = places.near(every, speed, spin, 2.0 * _NEAR)
            remaining[key] = np.setdiff1d(remaining[key], similar)
            if remaining[key].size:
                crowds[key] = places.crowd(remaining[key])
    drawn.sort(key=lambda curve: (curve.name, curve.spin, curve.speed))
    return tuple(drawn), _nearest(drawn, places, levels, tangential)


def _name(problem: Problem, like: int) -> str:
    """The labels of an impact in words, each once."""
    pairs = zip(problem.forward.levels, problem.rows.index[like], strict=True)
    return ", ".join(dict.fromkeys(level.labels[k] for level, k in pairs))


def _nearest(
    drawn: Sequence[Series],
    places: _Places,
    levels: IntArray,
    tangential: bool,
) -> IntArray:
    """The curve (impacts,) nearest to each impact, of its own of the `levels` (impacts,) if that
    has a curve.
    """
    distances = []
    for curve in drawn:
        turning = places.radius * (places.spin - curve.spin)
        faster = places.speed - curve.speed if tangential else 0.0
        distances.append(np.hypot(turning, faster))
    elsewhere = np.stack([levels != levels[curve.like] for curve in drawn])
    barred = elsewhere & ~elsewhere.all(axis=0)
    distance = np.where(barred, np.inf, np.stack(distances))
    return np.asarray(distance.argmin(axis=0))


def _rounded(value: float, tolerance: float) -> float:
    """`value` to a multiple of 1, 2 or 5 times a power of ten, at most a third of `tolerance`."""
    largest = tolerance / 3.0
    decade = 10.0 ** math.floor(math.log10(largest))
    steps = [digit * decade for digit in (1.0, 2.0, 5.0)]
    step = max(step for step in steps if step <= largest)
    return round(round(value / step) * step, 12)


def curves(problem: Problem, draws: Draws) -> DataFrame:
    """A row a curve, measured column and point; `report.fit_page` has the columns."""
    import pandas as pd

    drawn_curves, which = series(problem)
    tangential = problem.forward.model.tangential
    states = problem.rows.states
    place = states.polar()[1] if tangential else states.v_y1
    frames = []
    count = len(next(iter(draws.values.values())))
    rows = evenly_spread(count, _DRAWS)
    values = {name: array[rows] for name, array in draws.values.items()}
    columns = tuple(item.column.name for item in problem.observables)
    names = {curve.name for curve in drawn_curves}
    for k, curve in enumerate(drawn_curves):
        along = _range(place, tangential)
        index = np.tile(problem.rows.index[curve.like], (_POINTS, 1))
        # What is drawn beside measurements is what the camera of their session shows.
        camera = problem.camera
        if camera is not None:
            camera = camera.take(np.full(_POINTS, curve.like))
        shown = Asked(_along(curve, along), index, columns, camera=camera)
        best = shown.shown(problem.forward, draws.best, shown.impacts)
        drawn = shown.shown(problem.forward, values if count else draws.best, shown.impacts)
        measured = place[which == k]
        within = np.zeros(_POINTS, dtype=np.bool_)
        if measured.size:
            within = (along >= measured.min()) & (along <= measured.max())
        shared = {
            "series": k,
            "name": curve.name if len(names) > 1 else "",
            "speed": curve.speed,
            "spin": curve.spin if tangential else math.nan,
        }
        for column in columns:
            quantiles = np.full((5, _POINTS), np.nan)
            if count:
                quantiles = bands(drawn.answers(column))
            q025, q16, median, q84, q975 = quantiles
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
    narrowest = _NARROWEST if tangential else _NEAR * high
    room = max(0.0, 0.5 * (narrowest - (high - low)))
    if tangential:
        low = max(low, _LOWEST + room)
        high = min(high, math.pi - _LOWEST - room)
    return np.linspace(low - room, high + room, _POINTS)


def _along(curve: Series, along: FloatArray) -> Impacts:
    """The states of a curve at angles [rad], or in a drop test vertical speeds [m/s]."""
    spin = np.full(_POINTS, curve.spin)
    if math.isnan(curve.speed):
        return Impacts(np.zeros(_POINTS), along, spin)
    v_x1 = curve.speed * np.cos(along)
    v_y1 = curve.speed * np.sin(along)
    return Impacts(v_x1, v_y1, spin)
