"""Curves that figures draw: the model over incidence, at speeds and spins where a table has most
impacts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.errors import ParameterError, suggestion
from fitball.base.selection import evenly_spread
from fitball.base.values import DataFrame, FloatArray, Impacts, IntArray
from fitball.inference.forward import Draws
from fitball.inference.predictive import PredictionRequest
from fitball.inference.problem.problem import Problem
from fitball.inference.summary import bands

# Draws of a curve: ten are beyond either end of a band of 95 %, which is enough for the eye.
_DRAWS = 400
# Points of a curve: between two of 61 the eye sees no corner.
_POINTS = 61
# Curves at most: more cannot be told apart in one figure.
_MOST = 6
# How far from the speed of a curve, and from its spin times the radius, an impact may be, as a
# share of that speed: settings of one launcher scatter by less (3 %, see SLACK of `forward`).
_NEAR = 0.1
# Impacts with which a level has a further curve: two may be near by chance.
_FEWEST = 3
# Impacts whose speed and spin are tried as those of a curve: each is compared with all others.
_TRIED = 256
# Least range of angles [rad] that is drawn: over a narrower one every curve is a line.
_NARROWEST = math.radians(10.0)
# How near to the court angles [rad] may come: at zero there is no impact.
_LOWEST = math.radians(0.5)
# Columns of the quantiles of draws, in the order of `bands`.
_QUANTILES = ("q025", "q16", "median", "q84", "q975")


class Series(NamedTuple):
    """A curve: the labels of its level in words, a round speed [m/s] (NaN in a drop test) and spin
    [rad/s], and the row number of an impact `like` it, whose level and camera it has.
    """

    name: str
    speed: float
    spin: float
    like: int


class _SpeedsAndSpins(NamedTuple):
    """The speeds [m/s] and spins [rad/s] (impacts,) of a table's impacts, and the radius [m] that
    makes speeds of spins.
    """

    speed: FloatArray
    spin: FloatArray
    radius: float

    def near(self, rows: IntArray, speed: float, spin: float, share: float) -> IntArray:
        """Those of `rows` whose speed and spin are within a `share` of the speed of these."""
        faster = np.abs(self.speed[rows] - speed)
        turning = self.radius * np.abs(self.spin[rows] - spin)
        return rows[np.maximum(faster, turning) <= share * speed]

    def crowd(self, rows: IntArray) -> tuple[float, float, IntArray]:
        """A round speed and spin where most of `rows` are, among those tried, and the rows near
        them.
        """
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


def series(problem: Problem) -> tuple[tuple[Series, ...], Annotated[IntArray, "impacts"]]:
    """The curves of a table, and the number of the curve nearest to each impact: one of its own
    level, if that has one, by speed and by spin as speed of the surface. A drop test has one curve
    for each level.
    """
    forward = problem.forward
    states = problem.rows.states.forwards
    tangential = forward.model.tangential
    radius = forward.model.ball.radius
    speeds_and_spins = _SpeedsAndSpins(states.polar()[0], states.omega_1, radius)
    every = np.arange(len(states))
    _, levels = np.unique(problem.rows.index, axis=0, return_inverse=True)
    levels = levels.ravel()
    remaining = {int(key): every[levels == key] for key in np.unique(levels)}
    drawn = list[Series]()
    levels_with_curve = set[int]()
    crowds = {
        key: speeds_and_spins.crowd(rows) if tangential else (math.nan, 0.0, rows)
        for key, rows in remaining.items()
    }

    def urgency(key: int) -> tuple[bool, int]:
        """First every level, then where most impacts are."""
        return key not in levels_with_curve, crowds[key][2].size

    while crowds and len(drawn) < _MOST:
        key = max(crowds, key=urgency)
        speed, spin, near = crowds.pop(key)
        if key in levels_with_curve and near.size < _FEWEST:
            continue
        levels_with_curve.add(key)
        like = int(near[0])
        drawn.append(Series(_name(problem, like), speed, spin, like))
        if tangential:
            # What lies a little further off would make another curve like this one.
            similar = speeds_and_spins.near(every, speed, spin, 2.0 * _NEAR)
            remaining[key] = np.setdiff1d(remaining[key], similar)
            if remaining[key].size:
                crowds[key] = speeds_and_spins.crowd(remaining[key])
    drawn.sort(key=lambda curve: (curve.name, curve.spin, curve.speed))
    return tuple(drawn), _nearest(drawn, speeds_and_spins, levels, tangential)


def equal_series(
    problem: Problem, groups: Sequence[str]
) -> tuple[tuple[Series, ...], Annotated[IntArray, "impacts"]]:
    """A curve for each combination of levels that has one of the labels `groups`, in their order,
    all at one speed and spin, where most of their impacts are; and the number of the curve of each
    impact, -1 of others.

    Raises:
        ParameterError: a label is none of the fit (`unknown-label`).
    """
    states = problem.rows.states.forwards
    _, first, levels = np.unique(problem.rows.index, axis=0, return_index=True, return_inverse=True)
    names = [_name(problem, int(like)) for like in first]
    labels = {label for name in names for label in (name, *name.split(", ")) if label}
    for group in groups:
        if group not in labels:
            known = suggestion(group, sorted(labels)) if labels else "this fit has no levels"
            raise ParameterError(f"no group '{group}': {known}", "unknown-label")
    order = []
    for group in groups:
        order += [k for k, name in enumerate(names) if group in (name, *name.split(", "))]
    order = list(dict.fromkeys(order))
    which = np.full(len(states), -1)
    for number, k in enumerate(order):
        which[levels.ravel() == k] = number
    speed, spin = math.nan, 0.0
    if problem.forward.model.tangential:
        radius = problem.forward.model.ball.radius
        crowded = _SpeedsAndSpins(states.polar()[0], states.omega_1, radius)
        speed, spin, _ = crowded.crowd(np.flatnonzero(which >= 0))
    return tuple(Series(names[k], speed, spin, int(first[k])) for k in order), which


def _name(problem: Problem, like: int) -> str:
    """The labels of the impact with this row number in words, each once."""
    pairs = zip(problem.forward.levels, problem.rows.index[like], strict=True)
    return ", ".join(dict.fromkeys(level.labels[k] for level, k in pairs))


def _nearest(
    drawn: Sequence[Series],
    speeds_and_spins: _SpeedsAndSpins,
    levels: IntArray,
    tangential: bool,
) -> IntArray:
    """The number of the curve nearest to each impact (impacts,), of the impact's own level if that
    has one; `levels` (impacts,) are numbers of combinations of levels.
    """
    distances = []
    for curve in drawn:
        turning = speeds_and_spins.radius * (speeds_and_spins.spin - curve.spin)
        faster = speeds_and_spins.speed - curve.speed if tangential else 0.0
        distances.append(np.hypot(turning, faster))
    elsewhere = np.stack([levels != levels[curve.like] for curve in drawn])
    barred = elsewhere & ~elsewhere.all(axis=0)
    distance = np.where(barred, np.inf, np.stack(distances))
    return np.asarray(distance.argmin(axis=0))


def _rounded(value: float, tolerance: float) -> float:
    """The value rounded to a multiple of 1, 2 or 5 times a power of ten, at most a third of the
    tolerance.
    """
    largest = tolerance / 3.0
    decade = 10.0 ** math.floor(math.log10(largest))
    steps = [digit * decade for digit in (1.0, 2.0, 5.0)]
    step = max(step for step in steps if step <= largest)
    return round(round(value / step) * step, 12)


def curves_frame(
    problem: Problem,
    draws: Draws,
    grouped: tuple[tuple[Series, ...], Annotated[IntArray, "impacts"]] | None = None,
) -> DataFrame:
    """The frame `curves`: a row for each curve, measured column and point; `report.fit_page` has
    its columns. The curves are those of `series`, or of `equal_series`.
    """
    import pandas as pd

    all_series, which = grouped or series(problem)
    tangential = problem.forward.model.tangential
    states = problem.rows.states.forwards
    along_of_impacts = states.polar()[1] if tangential else states.v_y1
    count = len(next(iter(draws.values.values())))
    rows = evenly_spread(count, _DRAWS)
    values = {name: array[rows] for name, array in draws.values.items()}
    drawn = draws._replace(values=values)
    names = {curve.name for curve in all_series}
    frames = []
    for k, curve in enumerate(all_series):
        along = _points_along(along_of_impacts, tangential)
        measured = along_of_impacts[which == k]
        within = np.zeros(_POINTS, dtype=np.bool_)
        if measured.size:
            within = (along >= measured.min()) & (along <= measured.max())
        of_curve = {
            "series": k,
            "name": curve.name if len(names) > 1 else "",
            "speed": curve.speed,
            "spin": curve.spin if tangential else math.nan,
        }
        for column, numbers in _numbers_of_curve(problem, drawn, curve, along):
            frame = {**of_curve, "column": column, "along": along, **numbers, "within": within}
            frames.append(pd.DataFrame(frame))
    return pd.concat(frames, ignore_index=True)


def _numbers_of_curve(
    problem: Problem,
    draws: Draws,
    curve: Series,
    along: FloatArray,
) -> Iterator[tuple[str, dict[str, FloatArray]]]:
    """For each measured column its name, and at the points `along` a curve the value at the best
    fit and quantiles of draws, in SI; NaN without draws.
    """
    forward = problem.forward
    index = np.tile(problem.rows.index[curve.like], (_POINTS, 1))
    columns = tuple(observable.column.name for observable in problem.observables)
    # What is drawn beside measurements is what the camera of their session shows.
    like = np.full(_POINTS, curve.like)
    camera = None if problem.camera is None else problem.camera.take(like)
    fall = None if problem.fall is None else problem.fall.take(like)
    states = _states_along(curve, along)
    request = PredictionRequest(states, index, columns, camera=camera, fall=fall)
    has_draws = bool(len(next(iter(draws.values.values()))))
    best = request.rebounds(forward, draws.best, request.impacts)
    values = draws.values if has_draws else draws.best
    sampled = request.rebounds(forward, values, request.impacts)
    for column in columns:
        quantiles = np.full((len(_QUANTILES), _POINTS), np.nan)
        if has_draws:
            quantiles = bands(sampled.answers(column))
        by_name = zip(_QUANTILES, quantiles, strict=True)
        yield column, {"point": best.answers(column)[0], **dict(by_name)}


def _points_along(along: FloatArray, tangential: bool) -> FloatArray:
    """The points of a curve over all angles [rad] of a table, or vertical speeds [m/s] of a drop
    test: `along` (impacts,). A narrow range is widened.
    """
    low = float(along.min())
    high = float(along.max())
    narrowest = _NARROWEST if tangential else _NEAR * high
    room = max(0.0, 0.5 * (narrowest - (high - low)))
    if tangential:
        low = max(low, _LOWEST + room)
        high = min(high, math.pi - _LOWEST - room)
    return np.linspace(low - room, high + room, _POINTS)


def _states_along(curve: Series, along: FloatArray) -> Impacts:
    """The incident states of a curve at angles [rad], or in a drop test vertical speeds [m/s]."""
    spin = np.full(_POINTS, curve.spin)
    if math.isnan(curve.speed):
        return Impacts(np.zeros(_POINTS), along, spin)
    v_x1 = curve.speed * np.cos(along)
    v_y1 = curve.speed * np.sin(along)
    return Impacts(v_x1, v_y1, spin)
