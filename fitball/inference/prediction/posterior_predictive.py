"""What the posterior says of the measurements: at the table's impacts, and along curves for figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitball.inference.likelihood.incident_marginal import incident_sds
from fitball.inference.prediction.curves import CURVE_DRAWS, curves
from fitball.inference.problem.batches import cells
from fitball.inference.problem.noise import NoiseKind
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import part_of
from fitball.inference.results.quantiles import BAND_LEVELS
from fitball.inference.results.results import ObservablePrediction, PointFit, Posterior, Predictive, thinned
from fitball.models.types import Rebound, regime_name
from fitball.values import FloatArray

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
    count = len(problem.impacts)
    values = thinned(posterior, min(DRAWS, max(LEAST, REBOUNDS // count)))
    size = max(1, cells(problem) // len(values))
    parts = []
    for place in (np.arange(k, min(k + size, count)) for k in range(0, count, size)):
        part = problem if place.size == count else part_of(problem, place)
        parts.append(_at_impacts(part, point.rebound.take(place), values, rng))
    observables = tuple(_joined([part[0][k] for part in parts]) for k in range(len(problem.observables)))
    regimes = tuple(share for part in parts for share in part[1])
    return Predictive(observables, regimes, curves(problem, thinned(posterior, CURVE_DRAWS)))


def _joined(parts: Sequence[ObservablePrediction]) -> ObservablePrediction:
    arrays = [name for name, value in vars(parts[0]).items() if isinstance(value, np.ndarray)]
    joined: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays}
    return replace(parts[0], **joined)


def _at_impacts(
    problem: Problem, at_point: Rebound, values: FloatArray, rng: np.random.Generator
) -> tuple[list[ObservablePrediction], tuple[Mapping[str, float], ...]]:
    """Every observable, and the regimes, at the impacts of the problem."""
    rebound = problem.rebound(values)
    columns = problem.all_values(values)
    even = len(values) < DRAWS
    by_incidence = incident_sds(problem, columns, rebound)
    observables = []
    for observable in (item.everywhere(len(problem.impacts)) for item in problem.observables):
        predicted, spread, data = with_noise(
            problem.noise, observable, columns, rebound, rng, by_incidence[observable.name], even=even
        )
        if problem.group_bias is not None:
            data = data + problem.group_bias.offset(columns, observable.name)
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
    return observables, regime_shares(rebound)


def with_noise(
    noise: NoiseKind,
    observable: Observable,
    columns: Mapping[str, FloatArray],
    rebound: Rebound,
    rng: np.random.Generator,
    incident_sd: FloatArray | float = 0.0,
    *,
    even: bool = False,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One observable draw by draw, each (draws, impacts): without noise, the sd of its noise, and a new measurement.

    `columns` are the draws of each parameter by name, (draws,); `incident_sd` is what incident errors add. Noise is
    drawn at random, or, where draws are few, `even`: at each impact once from each of equally probable parts.
    """
    predicted = observable.predict(rebound)
    spread = np.hypot(np.broadcast_to(observable.sds(columns, rebound), predicted.shape), incident_sd)
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
    shares = [_named_shares(kinds, column, len(solved) + 1) for column in distinct.T]
    return tuple(shares[k] for k in which.ravel())


def _named_shares(kinds: NDArray[np.integer[Any]], rank: NDArray[np.int64], unit: int) -> Mapping[str, float]:
    """Shares of kinds by name, from how often each was met, times `unit`, less where it was first."""
    counts = -(-rank // unit)
    return {regime_name(int(kinds[k])): float(counts[k] / counts.sum()) for k in np.argsort(-rank) if counts[k]}
