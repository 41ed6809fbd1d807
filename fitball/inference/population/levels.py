"""A population over many tables from the stored draws of each: hierarchical inference by importance weights.

Centre and spread from the draws of all tables; the estimate of a table within the population is its draws, weighted
by it, averaged over its posterior (Hogg, Myers and Bovy 2010, ApJ 725, 2166).

Tables may lie on levels (surfaces, balls, days): tables scatter about the value of their level, levels about a
centre. Both scatter normally, each spread with the prior of a pooled parameter's. At each spread within
levels the value of a level has a likelihood, the product of those of its tables, which quadrature nodes stand for;
these levels have a population as tables have, whose evidence weighs the spread within. Levels and tables are drawn
from all of that together.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.inference.population.hyper import (
    FAR,
    FINE,
    Before,
    HyperPosterior,
    Known,
    TableDraws,
    centre_and_spread,
    covering_grid,
    drawn_given,
    drawn_new,
    hyper_posterior,
    log_likelihood,
    log_mass,
    quantile_ends,
    reach,
    shares_of,
)
from fitball.inference.sampling.importance import K_TRUSTED, smoothed
from fitball.values import FloatArray

# Draws of each table from its weighted ones, from which its quantiles are told.
DRAWN = 1000
# Nodes on which the likelihood of a level stands, as far as it falls off by so much (ten sds of a normal one), and
# the width of the density of a node in spacings: sums of such densities ripple by one part in ten thousand.
NODES = 64
DEEP = 50.0
BLUR = 0.7
# Draws of everything together.
TOGETHER = 2000


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
        """Whether its weights are reliable."""
        return self.pareto_k <= K_TRUSTED


@dataclass(frozen=True)
class Level:
    """One of the levels that tables lie on: what the quantity has there, with its sd, and what a `new` table would
    have, None where each level has one table, so that differences within a level are unknown.
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
    weighted, errors = _weighted(((table, points) for table in tables), shares, points, (DRAWN,))
    centre, spread = centre_and_spread([posterior], [1.0])
    rng = np.random.default_rng([len(tables), DRAWN])
    new = Known.drawn(drawn_new(points[rng.choice(len(points), 4 * DRAWN, p=shares)], before.ends, rng))
    return Population(replace(centre, error=float(errors[0])), replace(spread, error=float(errors[1])), weighted, new)


def _weighted(
    tables: Iterable[tuple[TableDraws, FloatArray]], shares: FloatArray, numbers: FloatArray, seed: tuple[int, ...]
) -> tuple[tuple[Weighted, ...], FloatArray]:
    """Each table given the others, from the populations (points, 2) that it may be of, which have these `shares`
    (points,); and the errors that the finite number of draws of all tables gives to means of `numbers` (points,
    numbers) over populations, by what one draw more or less does to them (an infinitesimal jackknife).
    """
    spans = shares[:, None] * (numbers - shares @ numbers)
    scatter = np.zeros(spans.shape[1])
    made = []
    for k, (table, points) in enumerate(tables):
        weights = shares_of(table, points)
        scatter += np.sum(np.einsum("gs,gk->sk", weights, spans) ** 2, axis=0) / table.efficiency
        # Not by a product of matrices: threads of a numerical library cost more here than they save.
        own = np.einsum("g,gs->s", shares, weights)
        _smooth, pareto_k = smoothed(np.log(np.maximum(own, 1e-300)), table.efficiency)
        rng = np.random.default_rng([k, *seed])
        drawn = drawn_given(table, points, weights, rng.choice(len(points), DRAWN, p=shares), rng)
        value = Known.drawn(drawn)
        made.append(Weighted(table.name, value, float(drawn.std()), 1.0 / float(own @ own), pareto_k))
    return tuple(made), np.sqrt(scatter)


@dataclass(frozen=True)
class Nodes(TableDraws):
    """The likelihood of a level as a sum of normal densities: the logarithm of its value is minus `log_interim`."""

    def take(self, every: int) -> Nodes:  # noqa: ARG002
        """All of them: a quadrature has no node to spare."""
        return self

    @property
    def mean(self) -> float:
        """Mean of the likelihood."""
        return float(self._shares @ self.places)

    @property
    def sd(self) -> float:
        """Sd of the likelihood."""
        return float(np.sqrt(self._shares @ (self.places - self.mean) ** 2 + self.width**2))

    @property
    def _shares(self) -> FloatArray:
        mass = np.exp(self.log_interim.min() - self.log_interim)
        return np.asarray(mass / mass.sum())


def level_nodes(
    name: str, tables: Sequence[TableDraws], within: float, ends: tuple[float, float], every: int = 1
) -> Nodes:
    """The likelihood of the value of a level about which its tables scatter with the spread `within`; from one of
    `every` so many draws.
    """

    def log_density(places: FloatArray, every: int) -> FloatArray:
        points = np.column_stack([places[:, 0], np.full(len(places), within)])
        total = -len(tables) * log_mass(points, ends)
        for table in tables:
            total += log_likelihood(table.take(every), points)
        return total

    far = FAR * np.hypot(within, max(table.width for table in tables))
    low = max(ends[0], min(float(table.places.min()) for table in tables) - far)
    high = min(ends[1], max(float(table.places.max()) for table in tables) + far)
    grid = covering_grid(log_density, (low,), (high,), NODES, DEEP, every)
    side, shares = grid.sides[0], grid.shares
    centre, width = float(shares @ side), BLUR * float(side[1] - side[0])
    # As with draws: drawn together, so that nodes and their densities have mean and variance of the likelihood.
    closer = np.sqrt(1.0 - width**2 / float(shares @ (side - centre) ** 2))
    with np.errstate(divide="ignore"):
        log_values = np.log(shares) + grid.log_mass + np.log(len(side))
    # Of quadrature nodes there are not more to be had: no error of finite number.
    return Nodes(name, centre + closer * (side - centre), width, -log_values, np.inf)


@dataclass(frozen=True)
class Part:
    """Levels and their population at one spread `within` levels."""

    within: float
    nodes: tuple[Nodes, ...]
    posterior: HyperPosterior

    def drawn(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Centre, spread between, spread within, and the value of each level, drawn together: (count, 3 + levels)."""
        points, shares = self.posterior.heaviest
        points = points[rng.choice(len(points), count, p=shares)]
        each = np.arange(count)
        values = [drawn_given(node, points, shares_of(node, points), each, rng) for node in self.nodes]
        return np.column_stack([points, np.full(count, self.within), *values])


def population_over(levels: Mapping[str, Sequence[TableDraws]], before: Before) -> Population:
    """The population over at least two levels, each with at least one table. Where none has more than one the
    spread is that of tables, between and within levels together.
    """
    if all(len(tables) == 1 for tables in levels.values()):
        plain = population([table for (table,) in levels.values()], before)
        named = zip(levels, plain.tables, strict=True)
        alone = tuple(Level(name, (table.name,), table.known, table.sd, None) for name, table in named)
        return replace(plain, levels=alone, new_level=plain.new)
    size = float(np.median([table.sd for tables in levels.values() for table in tables]))
    parts: list[Part] = []

    def log_density(u: FloatArray, every: int) -> FloatArray:
        parts.clear()
        # The spread within levels is `size` sinh u.
        spreads = size * np.sinh(u[:, 0])
        for within in spreads:
            nodes = [level_nodes(name, tables, within, before.ends, every) for name, tables in levels.items()]
            parts.append(Part(float(within), tuple(nodes), hyper_posterior(nodes, before)))
        evidence = np.array([part.posterior.grid.log_mass for part in parts])
        return np.asarray(evidence + before.within.log_density(spreads) + np.log(np.cosh(u[:, 0])))

    grid = covering_grid(log_density, (0.0,), (reach(before.within, size),))
    rng = np.random.default_rng([len(levels), TOGETHER])
    counts = rng.multinomial(TOGETHER, grid.shares)
    drawn = np.concatenate([part.drawn(count, rng) for part, count in zip(parts, counts, strict=True) if count])
    each = ((table, drawn[:, [3 + k, 2]]) for k, tables in enumerate(levels.values()) for table in tables)
    weighted, errors = _weighted(each, np.full(len(drawn), 1.0 / len(drawn)), drawn, (TOGETHER, 1))
    rng = np.random.default_rng([len(levels), TOGETHER, 2])
    told = []
    for k, (name, tables) in enumerate(levels.items(), 3):
        here, known = drawn[:, k], Known.drawn(drawn[:, k], float(errors[k]))
        new = Known.drawn(drawn_new(drawn[:, [k, 2]], before.ends, rng))
        told.append(Level(name, tuple(table.name for table in tables), known, float(here.std()), new))
    new_level = drawn_new(drawn[:, :2], before.ends, rng)
    new = Known.drawn(drawn_new(np.column_stack([new_level, drawn[:, 2]]), before.ends, rng))
    centre, spread = centre_and_spread([part.posterior for part in parts], grid.shares.tolist())
    u = grid.sides[0]
    ends = quantile_ends(np.linspace(u[0], u[-1], FINE), u, grid.shares)
    middle, low, high = (size * float(np.sinh(end)) for end in ends)
    return Population(
        replace(centre, error=float(errors[0])), replace(spread, error=float(errors[1])), weighted, new, tuple(told),
        Known(middle, low, high, float(errors[2])), Known.drawn(new_level),
    )  # fmt: skip
