"""Expected information gain by nested Monte Carlo, an oracle for gains to first order: no density is taken as normal,
no rebound as linear.

Measurements are simulated from draws of the posterior, and of each its density at given target is compared with its
density whatever the target, `E[ln p(y | target) - ln p(y)]` (Ryan 2003; Rainforth et al. 2018). `p(y)` is the mean
over all other draws. `p(y | target)` is the mean over draws near the target's value that are moved onto it along
their regression on the target (Beaumont, Zhang and Balding 2002) and bounced again: exact for a normal posterior, and
trivially where the target is all there is. The logarithm of a mean of few terms is too low; half of its relative
variance is added, which leaves a bias that falls with the square of their number.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.inference.design.asked import PlannedColumn, Sensor
from fitball.inference.design.knowledge import Knowledge
from fitball.inference.design.targets import Target
from fitball.inference.likelihood.cells import joint_root, shared_covariance
from fitball.inference.likelihood.cells import solved as whiten
from fitball.inference.problem.problem import Problem
from fitball.values import FloatArray

# Simulated measurements, and draws near each target.
OUTER, NEAR = 1500, 200
# Draws, as many independent ones as the weights of an inner mean are worth in the middle case, below which the mean
# hangs on too few of them to be believed.
LEAST_EFFECTIVE = 20.0
# Variation of coordinates at given target, as a share of all, that is rounding; measurements looked at together.
DECIDED, TOGETHER = 1e-12, 60
# Moved draws of a target that must be left by priors and model.
LEAST_NEAR = 10


@dataclass(frozen=True)
class NestedGain:
    """Nats with their Monte Carlo standard error.

    `effective` is the number of independent draws that the inner means, whatever the target or given it, are worth in
    the middle case; `left_out` the share of simulations without an answer.
    """

    nats: float
    se: float
    effective: float
    left_out: float

    @property
    def settled(self) -> bool:
        """Whether there are draws enough to believe it."""
        return self.effective >= LEAST_EFFECTIVE


# What is said where nothing can be simulated.
NOT_SIMULATED = NestedGain(float("nan"), float("nan"), 0.0, 1.0)


@dataclass(frozen=True)
class Planned:
    """Impacts of a `problem` (see `Knowledge.at`) that are read by one `sensor`."""

    problem: Problem
    sensor: Sensor


@dataclass(frozen=True)
class Read:
    """What is read of one planned impact, by draw: means (draws, columns), sds likewise, and the covariance by an
    uncertain incident state (draws, columns, columns) or None.
    """

    means: FloatArray
    sds: FloatArray
    shared: FloatArray | None

    def take(self, rows: NDArray[np.int64]) -> Read:
        """Those of some draws."""
        return Read(self.means[rows], self.sds[rows], None if self.shared is None else self.shared[rows])

    def standardised(self, gaps: Sequence[FloatArray]) -> tuple[list[FloatArray], list[FloatArray]]:
        """Whitened gaps (draws, ...) of the first columns, each given those before it, and their conditional sds."""
        count, extra = len(gaps), (1,) * (gaps[0].ndim - 1)
        sds = [self.sds[:, j].reshape(-1, *extra) for j in range(count)]
        if self.shared is None:
            return [gap / sd for gap, sd in zip(gaps, sds, strict=True)], sds
        shared = self.shared[:, :count, :count].reshape(-1, *extra, count, count)
        root = joint_root(shared, np.stack(sds, axis=-1))
        z, widths = whiten(root, np.stack(gaps, axis=-1)[..., None])[..., 0], np.diagonal(root, axis1=-2, axis2=-1)
        return list(np.moveaxis(z, -1, 0)), list(np.moveaxis(widths, -1, 0))


def read(plans: Sequence[Planned], coordinates: FloatArray) -> tuple[list[Read], NDArray[np.bool_]]:
    """What is read of each planned impact at draws (draws, free), and which draws can be evaluated at all of them."""
    impacts, possible = [], np.ones(len(coordinates), dtype=np.bool_)
    for plan in plans:
        problem, sensor = plan.problem, plan.sensor
        values = problem.to_values(coordinates)
        columns, rebound = problem.all_values(values), problem.rebound(values)
        shared = shared_covariance(problem, columns, rebound, sensor.columns)
        means = np.stack([column.predict(rebound) + _bias(problem, columns, column) for column in sensor.columns], 2)
        sds = np.stack([column.sds(columns, rebound) for column in sensor.columns], axis=2)
        possible &= np.all(rebound.status == 0, axis=1)
        impacts += [
            Read(means[:, k], sds[:, k], None if shared is None else shared[:, k]) for k in range(means.shape[1])
        ]
    return impacts, possible


def _bias(problem: Problem, columns: Mapping[str, FloatArray], column: PlannedColumn) -> FloatArray | float:
    """The bias of planned impacts, where there is one."""
    bias = problem.group_bias
    if bias is None or bias.name(column.name, bias.labels[-1]) not in columns:
        return 0.0
    return bias.offset(columns, column.name)


def nested_gain(known: Knowledge, plans: Sequence[Planned], target: Target, rng: np.random.Generator) -> NestedGain:
    """What all planned impacts together tell of the target."""
    expected, possible = read(plans, known.coordinates)
    quantities = target.values(known.coordinates)
    rows = np.flatnonzero(possible & np.isfinite(quantities).all(axis=1))
    if rows.size < 2 * LEAST_NEAR:
        return NOT_SIMULATED
    outer = np.sort(rng.choice(rows, min(OUTER, rows.size), replace=False))
    y = simulated(known, [impact.take(outer) for impact in expected], outer, rng)
    near = _near(known, quantities, rows)
    every = [impact.take(rows) for impact in expected]
    terms, effective = [], []
    # Few at a time, so that the arrays stay in the processor's cache.
    for part in np.array_split(np.arange(outer.size), -(-outer.size // TOGETHER)):
        mine, measured = outer[part], [one[part] for one in y]
        whatever = _log_densities(known, every, known.coordinates[rows], measured)
        # A draw takes no part in the mean that its own measurement is compared with.
        whatever[np.searchsorted(rows, mine), np.arange(part.size)] = -np.inf
        total, worth = _log_mean(whatever)
        given, worth_given = _given_target(known, plans, near, mine, measured)
        terms.append(given - total)
        effective.append([worth, worth_given])
    return _summed_up(np.concatenate(terms), np.concatenate(effective, axis=1), rows.size / len(known.coordinates))


def _summed_up(terms: FloatArray, effective: FloatArray, possible: float) -> NestedGain:
    """The mean of the terms there are, of simulations from a share `possible` of the draws, with inner means worth
    `effective` (2, simulations) draws.
    """
    left = np.isfinite(terms)
    nats, se = float(np.mean(terms[left])), float(np.std(terms[left], ddof=1) / np.sqrt(left.sum()))
    return NestedGain(nats, se, float(np.median(effective, axis=1).min()), 1.0 - possible * float(np.mean(left)))


def simulated(
    known: Knowledge, expected: Sequence[Read], rows: NDArray[np.int64], rng: np.random.Generator
) -> list[FloatArray]:
    """A measurement (draws, columns) of each impact from each of the draws `rows`, of the same density as
    `_log_densities`: columns one after the other, each given those before it.
    """
    columns = known.problem.all_values(known.problem.to_values(known.coordinates[rows]))
    made = []
    for impact in expected:
        gaps: list[FloatArray] = []
        for _ in range(impact.means.shape[1]):
            z, sds = impact.standardised([*gaps, np.zeros(rows.size)])
            deviation = known.problem.noise.draw(rng, (rows.size, 1), columns)[:, 0]
            # What is standardised of a gap of zero is what the columns before it make expected.
            gaps.append((deviation - z[-1]) * sds[-1])
        made.append(impact.means + np.stack(gaps, axis=1))
    return made


def _log_densities(
    known: Knowledge, expected: Sequence[Read], coordinates: FloatArray, y: Sequence[FloatArray], *, own: bool = False
) -> FloatArray:
    """Log density (draws, simulated) of measurements `y`, of each impact (simulated, columns), under each draw; if
    each draw has its `own`, (draws,).
    """
    columns = known.problem.all_values(known.problem.to_values(coordinates))
    total = np.zeros((len(coordinates), 1 if own else len(y[0])))
    for impact, measured in zip(expected, y, strict=True):
        seen = measured[:, None] if own else measured[None]
        z, sds = impact.standardised([seen[..., j] - impact.means[:, j, None] for j in range(measured.shape[1])])
        for one, sd in zip(z, sds, strict=True):
            total += known.problem.noise.log_density(one, columns) - np.log(sd)
    return total[:, 0] if own else total


def _log_mean(logs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Logarithm (columns,) of the means of exponentials over rows, corrected for their number, and how many
    independent rows each mean is worth. Terms of minus infinity are none.
    """
    count = np.isfinite(logs).sum(axis=0)
    top = np.max(logs, axis=0, initial=-np.inf)
    top = np.where(np.isfinite(top), top, 0.0)
    weights = np.exp(logs - top)
    total, squares = weights.sum(axis=0), (weights**2).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        effective = np.where(total > 0.0, total**2 / squares, 0.0)
        relative = 1.0 / effective - 1.0 / count
        return np.log(total / count) + top + 0.5 * relative, effective


@dataclass(frozen=True)
class Near:
    """How draws near a target are found and moved onto it.

    `rows` are the draws, `quantities` (all draws, parts) their targets, `scaled` (all draws, ...) the same on
    independent axes, `along` (free, parts) the regression of coordinates on the target, `count` how many are taken:
    one, itself, where the target leaves nothing open.
    """

    rows: NDArray[np.int64]
    quantities: FloatArray
    scaled: FloatArray
    along: FloatArray
    count: int

    def around(self, mine: NDArray[np.int64]) -> NDArray[np.int64]:
        """The draws nearest to each of `mine`, (mine, count)."""
        axes = [self.scaled[mine, None, k] - self.scaled[None, self.rows, k] for k in range(self.scaled.shape[1])]
        apart = np.sum([axis * axis for axis in axes], axis=0)
        if self.count > 1:
            # The draw itself knows its own measurement.
            apart[np.arange(mine.size), np.searchsorted(self.rows, mine)] = np.inf
        return np.asarray(self.rows[np.argpartition(apart, self.count - 1, axis=1)[:, : self.count]])


def _near(known: Knowledge, quantities: FloatArray, rows: NDArray[np.int64]) -> Near:
    along, unit = _regression(known.coordinates[rows], quantities[rows])
    residual = np.ptp(known.coordinates[rows] - quantities[rows] @ along.T, axis=0)
    alone = bool(np.all(residual <= DECIDED * np.ptp(known.coordinates[rows], axis=0)))
    return Near(rows, quantities, quantities @ unit, along, 1 if alone else min(NEAR, rows.size - 1))


def _given_target(
    known: Knowledge, plans: Sequence[Planned], near: Near, mine: NDArray[np.int64], y: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Log density (mine,) of each simulated measurement given the target of its draw, NaN where too few are left; and
    how many draws each mean is worth, infinitely many where there is no mean.
    """
    chosen = near.around(mine)
    moves = (near.quantities[mine, None] - near.quantities[chosen]) @ near.along.T
    moved = (known.coordinates[chosen] + moves).reshape(-1, moves.shape[-1])
    inside = np.isfinite(known.problem.prior.log_density(moved))
    moved = np.where(inside[:, None], moved, known.coordinates[chosen.ravel()])
    expected, possible = read(plans, moved)
    logs = _log_densities(known, expected, moved, [np.repeat(one, near.count, axis=0) for one in y], own=True)
    logs = np.where(inside & possible, logs, -np.inf).reshape(chosen.shape)
    enough = np.isfinite(logs).sum(axis=1) >= min(LEAST_NEAR, near.count)
    means, effective = _log_mean(logs.T)
    return np.where(enough, means, np.nan), effective if near.count > 1 else np.full(mine.size, np.inf)


def _regression(coordinates: FloatArray, quantities: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The regression (free, parts) of coordinates on the target, and a matrix that whitens the target's parts."""
    centred, about = coordinates - coordinates.mean(axis=0), quantities - quantities.mean(axis=0)
    scale = np.maximum(np.std(about, axis=0), np.finfo(np.float64).tiny)
    about = about / scale
    values, vectors = np.linalg.eigh(about.T @ about / len(about))
    wide = values > 1e-9 * values[-1]
    unit = vectors[:, wide] / np.sqrt(values[wide])
    slopes = (centred.T @ (about @ unit)) / len(about)
    return np.asarray(slopes @ unit.T / scale), np.asarray(unit / scale[:, None])
