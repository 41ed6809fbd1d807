"""Posterior predictions of the measurements: at the table's impacts, draw by draw, and along curves for figures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fitball.inference.likelihood.cells import UNKNOWN, joint_root, shared_covariance
from fitball.inference.problem.noise import NoiseKind
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import batches, impacts_in_parts
from fitball.inference.results.quantiles import BAND_LEVELS, bands
from fitball.inference.results.results import Curve, ObservablePrediction, PointFit, Posterior, Predictive, thinned
from fitball.models.types import Rebound, regime_name
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, Impacts

# Predictions over incidence angle at a fixed speed and spin, where a table has most impacts: what figures draw.

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
    found = {
        ", ".join(levels_of(problem, labels).values()): rows for labels, rows in sorted(by_level(problem).items())
    }
    if problem.table.has_tangential:
        surfaces = dict(zip(found, (next(iter(labels), "") for labels in sorted(by_level(problem))), strict=True))
        return tuple(_curve(problem, values, *crowd) for crowd in _crowds(problem, found, surfaces))
    busiest = sorted(found.items(), key=lambda item: -item[1].size)[:MOST_CURVES]
    spin = problem.impacts.omega_1
    return tuple(
        _curve(problem, values, label, None, float(np.median(spin[rows])), rows) for label, rows in sorted(busiest)
    )


def by_level(problem: Problem) -> dict[tuple[str, ...], NDArray[np.int64]]:
    """Rows of the table by the labels of the levels over which parameters are pooled; all by () where none is."""
    if not problem.pooling:
        return {(): np.arange(len(problem.impacts))}
    rows: dict[tuple[int, ...], list[int]] = {}
    for row, places in enumerate(zip(*(pooling.index.tolist() for pooling in problem.pooling), strict=True)):
        rows.setdefault(places, []).append(row)
    return {
        tuple(pooling.labels[place] for pooling, place in zip(problem.pooling, places, strict=True)): np.array(some)
        for places, some in rows.items()
    }


def levels_of(problem: Problem, labels: Sequence[str]) -> dict[str, str]:
    """The labels of a combination of levels by column: two parameters over one column have the same."""
    return dict(zip((pooling.column for pooling in problem.pooling), labels, strict=True))


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


Crowd = tuple[str, float, float, NDArray[np.int64]]


def _crowds(problem: Problem, levels: Mapping[str, NDArray[np.int64]], surfaces: Mapping[str, str]) -> list[Crowd]:
    """Label, speed, spin and rows of the impacts near them, by label, spin and speed: with few impacts only of a
    surface (the first label of a combination in `surfaces`) that has no other.
    """
    left, chosen = dict(levels), list[Crowd]()
    while left and len(chosen) < MOST_CURVES:
        seen = {surfaces[label] for label, *_rest in chosen}
        crowds = [_crowd(problem, label, rows) for label, rows in left.items()]
        best = max(crowds, key=lambda crowd: (surfaces[crowd[0]] not in seen, crowd[3].size))
        label, speed, spin, near = best
        if near.size < FEWEST and surfaces[label] in seen:
            del left[label]
            continue
        chosen.append(best)
        # What lies a little further off would make another curve like this one.
        rows = left.pop(label)
        rest = np.setdiff1d(rows, _near(problem, rows, speed, spin, 2.0 * NEAR))
        # Of several surfaces each has one curve.
        if len(levels) == 1 and rest.size:
            left[label] = rest
    return sorted(chosen, key=lambda crowd: (crowd[0], crowd[2], crowd[1]))


def _crowd(problem: Problem, label: str, rows: NDArray[np.int64]) -> Crowd:
    """A round speed and spin with as many of `rows` near them as at any of those tried."""
    speed, spin = problem.impacts.speed, problem.impacts.omega_1
    tried = rows[np.unique(np.linspace(0, rows.size - 1, TRIED).round().astype(np.int64))]
    near = max((_near(problem, rows, speed[k], spin[k]) for k in tried), key=len)
    middle = float(np.median(speed[near]))
    middle = _rounded(middle, NEAR * middle)
    turning = _rounded(float(np.median(spin[near])), NEAR * middle / problem.model.ball.radius)
    round_near = _near(problem, rows, middle, turning)
    # Of two impacts far apart the rounded middle may lie near neither.
    return label, middle, turning, round_near if round_near.size else near


def _curve(
    problem: Problem, values: FloatArray, label: str, speed: float | None, spin: float, near: NDArray[np.int64]
) -> Curve:
    """The curve over all angles of the table at a speed; over all speeds where there is none, in a drop test."""
    known = problem.impacts.v_y1 if speed is None else problem.impacts.angle
    low, high = float(known.min()), float(known.max())
    room = max(0.0, 0.5 * ((NEAR * high if speed is None else NARROWEST) - (high - low)))
    if speed is not None:
        low, high = max(low, LOWEST + room), min(high, math.pi - LOWEST - room)
    along = np.linspace(low - room, high + room, CURVE_POINTS)
    # Models that are given the restitution of each impact have the median of those near.
    given = problem.impacts.cor
    cor = None if given is None else np.full(CURVE_POINTS, np.median(given[near]))
    if speed is None:
        impacts = Impacts(np.zeros_like(along), along, np.full_like(along, spin), cor)
    else:
        impacts = Impacts.polar(speed, along, np.full_like(along, spin), cor)
    if near.size and problem.camera is not None:
        # What is drawn beside measurements is what the camera of their session would show.
        rebound = problem.seen_like(problem.all_values(values), impacts, np.full(len(impacts), near[0]))
    else:
        rebound = problem.rebound(values, impacts, int(near[0]) if near.size else None)
    shown = {name: bands(column.predict(rebound)) for name, column in OBSERVABLES.items()}
    return Curve(label, speed, spin, near, along, impacts, shown)


if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Made = TypeVar("Made", bound="DataclassInstance")
# Draws that each impact is predicted with; of so many impacts that this would be more rebounds, fewer.
DRAWS, REBOUNDS, LEAST = 1500, 30_000_000, 120
# Deviations from which the quantiles of a noise are known.
DEVIATIONS = 100_000


def predictive_generator(seed: int) -> np.random.Generator:
    """The generator of the noise in predictions, the third of a run's streams."""
    return np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[2])


def predictive(problem: Problem, point: PointFit, posterior: Posterior, rng: np.random.Generator) -> Predictive:
    """Quantiles of each observable at each impact, with and without noise; regimes; curves.

    Impacts are taken some at a time, so that memory does not grow with draws times impacts.
    """
    values = thinned(posterior, min(DRAWS, max(LEAST, REBOUNDS // len(problem.impacts))))
    parts = [
        _at_impacts(part, point.rebound.take(rows), values, rng)
        for rows, part in impacts_in_parts(problem, len(values))
    ]
    observables = tuple(joined([part[0][k] for part in parts]) for k in range(len(problem.observables)))
    regimes = tuple(share for part in parts for share in part[1])
    return Predictive(observables, regimes, curves(problem, thinned(posterior, CURVE_DRAWS)))


def joined(parts: Sequence[Made]) -> Made:
    """Values that hold arrays (..., impacts), of some impacts after the other; all else as in the first of them."""

    def together(values: Sequence[Any]) -> Any:
        if is_dataclass(values[0]):
            return joined(values)
        return np.concatenate(values, axis=-1) if isinstance(values[0], np.ndarray) else values[0]

    names = [item.name for item in fields(parts[0])]
    return replace(parts[0], **{name: together([getattr(part, name) for part in parts]) for name in names})


def in_order(value: Made, order: NDArray[np.int64]) -> Made:
    """A value that holds arrays (..., impacts), of the impacts in another order."""

    def moved(held: Any) -> Any:
        if is_dataclass(held) and not isinstance(held, type):
            return in_order(held, order)
        return held[..., order] if isinstance(held, np.ndarray) else held

    return replace(value, **{item.name: moved(getattr(value, item.name)) for item in fields(value)})


def _at_impacts(
    problem: Problem, at_point: Rebound, values: FloatArray, rng: np.random.Generator
) -> tuple[list[ObservablePrediction], tuple[Mapping[str, float], ...]]:
    """Every observable, and the regimes, at the impacts of the problem."""
    rebound = problem.rebound(values)
    columns = problem.all_values(values)
    even = len(values) < DRAWS
    observables = []
    for observable, predicted, spread, data in measurements(problem, columns, rebound, rng, even=even):
        # Even deviations stand for the middles of equal parts.
        ends = np.quantile(data, (BAND_LEVELS[0], BAND_LEVELS[-1]), axis=0, method="hazen" if even else "linear")
        low, mid_low, median, mid_high, high = np.quantile(predicted, BAND_LEVELS, axis=0)
        observables.append(
            ObservablePrediction(
                name=observable.name,
                unit=observable.column.unit,
                observed=observable.observed,
                sd=np.median(spread, axis=0),
                point=observable.predict(at_point)[0],
                median=median,
                mean_q025=low,
                mean_q16=mid_low,
                mean_q84=mid_high,
                mean_q975=high,
                data_q025=ends[0],
                data_q975=ends[1],
            )
        )
    # Without motion along the court there is neither slip nor grip.
    shares = regime_shares(rebound) if problem.model.has_regimes else ({"": 1.0},) * len(problem.impacts)
    return observables, shares


def measurements(
    problem: Problem,
    columns: Mapping[str, FloatArray],
    rebound: Rebound,
    rng: np.random.Generator,
    *,
    even: bool = False,
) -> Iterator[tuple[Observable, FloatArray, FloatArray, FloatArray]]:
    """Each measured column over all impacts of the problem with its noise by `with_noise`, errors of the incident
    state and biases of groups included.
    """
    everywhere = [item.everywhere(len(problem.impacts)) for item in problem.observables]
    if problem.errors is None:
        drawn = iter([with_noise(problem.noise, item, columns, rebound, rng, even=even) for item in everywhere])
    else:
        drawn = _together(problem, everywhere, columns, rebound, rng, even=even)
    for observable, (predicted, spread, data) in zip(everywhere, drawn, strict=True):
        if problem.group_bias is not None:
            data = data + problem.group_bias.offset(columns, observable.name)
        yield observable, predicted, spread, data


def _together(
    problem: Problem,
    observables: Sequence[Observable],
    columns: Mapping[str, FloatArray],
    rebound: Rebound,
    rng: np.random.Generator,
    *,
    even: bool,
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """As `with_noise`, of all columns: those of an impact have errors in common."""
    assert problem.errors is not None
    whole, own = (
        np.stack([np.broadcast_to(item.sds(columns, rebound), rebound.v_x2.shape) for item in some], axis=2)
        for some in (observables, [problem.errors.own(item) for item in observables])
    )
    stated = ~np.isnan(whole)
    shared = shared_covariance(problem, columns, rebound, observables)
    assert shared is not None
    root = joint_root(shared, np.where(stated, own, UNKNOWN))
    kind, shape = problem.noise, rebound.v_x2.shape
    z = np.stack(
        [evenly(kind, columns, shape, rng) if even else kind.draw(rng, shape, columns) for _ in observables], axis=2
    )
    errors = np.where(stated, (root @ z[..., None])[..., 0], np.nan)
    sds = np.where(stated, np.sqrt(np.sum(root**2, axis=3)), np.nan)
    for place, observable in enumerate(observables):
        predicted = observable.predict(rebound)
        yield predicted, sds[..., place], predicted + errors[..., place]


def with_noise(
    noise: NoiseKind,
    observable: Observable,
    columns: Mapping[str, FloatArray],
    rebound: Rebound,
    rng: np.random.Generator,
    *,
    even: bool = False,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One observable draw by draw, each (draws, impacts): without noise, the sd of its noise, and a new measurement.

    `columns` are the draws of each parameter by name, (draws,). Noise is drawn at random, or, where draws are few,
    `even`: at each impact once from each of equally probable parts.
    """
    predicted = observable.predict(rebound)
    spread = np.broadcast_to(observable.sds(columns, rebound), predicted.shape)
    drawn = evenly(noise, columns, predicted.shape, rng) if even else noise.draw(rng, predicted.shape, columns)
    return predicted, spread, predicted + spread * drawn


def evenly(
    noise: NoiseKind, columns: Mapping[str, FloatArray], shape: tuple[int, ...], rng: np.random.Generator
) -> FloatArray:
    """Deviations (draws, impacts), at each impact the quantiles of the noise in another order."""
    draws, impacts = shape
    sizes = {parameter.name: np.median(columns[parameter.name], keepdims=True) for parameter in noise.parameters}
    levels = (np.arange(draws) + 0.5) / draws
    steps = np.quantile(noise.draw(rng, (1, DEVIATIONS), sizes), levels)
    return np.asarray(steps[(rng.permutation(draws)[:, None] + np.arange(impacts)) % draws])


def regime_shares(rebound: Rebound) -> tuple[Mapping[str, float], ...]:
    """For each impact the phase sequences among the draws that can be evaluated there, most probable first."""
    solved = rebound.status == 0
    kinds = np.unique(rebound.regime[solved])
    met = (
        np.stack([solved & (rebound.regime == kind) for kind in kinds])
        if kinds.size
        else np.zeros((0, *solved.shape))
    )
    # Of kinds that are met as often the one that comes first is named first.
    rank = met.sum(axis=1) * (len(solved) + 1) - np.where(met.any(axis=1), met.argmax(axis=1), 0)
    distinct, which = np.unique(rank, axis=1, return_inverse=True)
    counts = -(-distinct // (len(solved) + 1))
    shares = [
        {regime_name(int(kinds[k])): float(met[k] / met.sum()) for k in np.argsort(-order) if met[k]}
        for order, met in zip(distinct.T, counts.T, strict=True)
    ]
    return tuple(shares[k] for k in which.ravel())


def replicated(problem: Problem, values: FloatArray, rng: np.random.Generator) -> dict[str, FloatArray]:
    """New measurements of every column at the table's impacts for free values (draws, free), some draws at a time:
    column -> (draws, impacts) in SI, NaN where a column of stated sds states none.
    """
    tables = []
    for some in batches(problem, values.shape[0]):
        columns, rebound = problem.all_values(values[some]), problem.rebound(values[some])
        tables.append({item.name: data for item, _, _, data in measurements(problem, columns, rebound, rng)})
    return {name: np.concatenate([part[name] for part in tables]) for name in tables[0]}
