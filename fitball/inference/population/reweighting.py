"""A population over many tables from the stored draws of each: hierarchical inference by importance weights.

What the draws of all tables say of centre and spread; what the population says of a table is its draws with their
weights under it, averaged over its posterior (Hogg, Myers and Bovy 2010, ApJ 725, 2166).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.inference.population.draws import TableDraws, drawn_given, drawn_new, shares_of
from fitball.inference.population.hyper import Before, Known, centre_and_spread, hyper_posterior
from fitball.inference.sampling.importance import K_TRUSTED, smoothed
from fitball.values import FloatArray

# Draws of each table from its weighted ones, from which its quantiles are told.
DRAWN = 1000


@dataclass(frozen=True)
class Weighted:
    """A table, given the others: the quantity there with its sd, the `effective` number of its draws, Pareto k."""

    name: str
    known: Known
    sd: float
    effective: float
    pareto_k: float

    @property
    def trusted(self) -> bool:
        """Whether its weights carry what is said of it."""
        return self.pareto_k <= K_TRUSTED


@dataclass(frozen=True)
class Level:
    """One of the levels that tables lie on: what the quantity has there, with its sd, and what a `new` table would
    have, None where one table a level does not tell how tables differ within one.
    """

    name: str
    tables: tuple[str, ...]
    known: Known
    sd: float
    new: Known | None


@dataclass(frozen=True)
class Population:
    """Centre and spread of a quantity over tables, each table given the others, and what a `new` table would have,
    all in its coordinate.

    Over `levels` the spread is that between them, `within` that of tables of one level about it, and `new` a table on
    a new level, whose own value is `new_level`.
    """

    centre: Known
    spread: Known
    tables: tuple[Weighted, ...]
    new: Known
    levels: tuple[Level, ...] = ()
    within: Known | None = None
    new_level: Known | None = None

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Tables whose weights are not to be trusted."""
        return tuple(table.name for table in self.tables if not table.trusted)


def population(tables: Sequence[TableDraws], before: Before) -> Population:
    """Centre and spread of a quantity from the draws of at least two tables, and each table given the others."""
    posterior = hyper_posterior(tables, before)
    points, shares = posterior.heaviest
    spans = points - shares @ points
    # What one draw more or less does to the means (an infinitesimal jackknife).
    scatter = np.zeros(2)
    weighted = []
    for k, table in enumerate(tables):
        weights = shares_of(table, points)
        scatter += influence(table, weights, shares[:, None] * spans)
        weighted.append(given_others(table, points, shares, weights, np.random.default_rng([k, DRAWN])))
    centre, spread = centre_and_spread([posterior], [1.0])
    errors = np.sqrt(scatter)
    rng = np.random.default_rng([len(tables), DRAWN])
    new = Known.of(drawn_new(points[rng.choice(len(points), 4 * DRAWN, p=shares)], before.ends, rng))
    return Population(
        replace(centre, error=float(errors[0])), replace(spread, error=float(errors[1])), tuple(weighted), new
    )


def influence(table: TableDraws, weights: FloatArray, spans: FloatArray) -> FloatArray:
    """Variances (numbers,) that the finite number of a table's draws gives to means over populations: from its
    weights (points, draws) and how far each point lies from the means, times its share, `spans` (points, numbers).
    """
    return np.asarray(np.sum(np.einsum("gs,gk->sk", weights, spans) ** 2, axis=0) / table.efficiency)


def given_others(
    table: TableDraws, points: FloatArray, shares: FloatArray, weights: FloatArray, rng: np.random.Generator
) -> Weighted:
    """A table given the others, from its weights (points, draws), of each point adding up to one."""
    # Not by a product of matrices: threads of a numerical library cost more here than they save.
    own = np.einsum("g,gs->s", shares, weights)
    _smooth, pareto_k = smoothed(np.log(np.maximum(own, 1e-300)), table.efficiency)
    which = rng.choice(len(points), DRAWN, p=shares)
    drawn = drawn_given(table, points, weights, which, rng)
    return Weighted(table.name, Known.of(drawn), float(drawn.std()), 1.0 / float(own @ own), pareto_k)
