"""Tables on levels (surfaces, balls, days): tables scatter about the value of their level, levels about a centre.

Both scatter normally, each spread with the half-normal prior of a pooled parameter's. At each spread within levels
the value of a level has a likelihood, the product of those of its tables, which quadrature nodes stand for; these
levels have a population as tables have, whose evidence weighs the spread within. What is told of levels and tables
is drawn from all of that together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.inference.population.box import covering_grid
from fitball.inference.population.draws import TableDraws, drawn_given, drawn_new, log_likelihood, log_mass, shares_of
from fitball.inference.population.hyper import (
    FAR,
    FINE,
    REACH,
    ROUGHLY,
    Before,
    HyperPosterior,
    Known,
    centre_and_spread,
    hyper_posterior,
    quantile_ends,
)
from fitball.inference.population.reweighting import (
    Level,
    Population,
    Weighted,
    given_others,
    influence,
    population,
)
from fitball.values import FloatArray

# Nodes on which the likelihood of a level stands, as far as it falls off by so much (ten sds of a normal one), and
# the width of the density of a node in spacings: sums of such densities ripple by one part in ten thousand.
NODES = 64
DEEP = 50.0
BLUR = 0.7
# Draws of everything together.
TOGETHER = 2000


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

    reach = FAR * np.hypot(within, max(table.width for table in tables))
    low = max(ends[0], min(float(table.places.min()) for table in tables) - reach)
    high = min(ends[1], max(float(table.places.max()) for table in tables) + reach)
    grid = covering_grid(
        lambda places: log_density(places, max(every, ROUGHLY)),
        lambda places: log_density(places, every),
        np.array([low]),
        np.array([high]),
        NODES,
        DEEP,
    )
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
        for within in size * np.sinh(u):
            nodes = [level_nodes(name, tables, within, before.ends, every) for name, tables in levels.items()]
            parts.append(Part(float(within), tuple(nodes), hyper_posterior(nodes, before)))
        evidence = np.array([part.posterior.grid.log_mass for part in parts])
        return np.asarray(evidence - 0.5 * (size * np.sinh(u) / before.spread) ** 2 + np.log(np.cosh(u)))

    # The spread within levels is `size` sinh u.
    grid = covering_grid(
        lambda places: log_density(places[:, 0], ROUGHLY),
        lambda places: log_density(places[:, 0], 1),
        np.array([0.0]),
        np.array([np.arcsinh(REACH * before.spread / size)]),
    )
    rng = np.random.default_rng([len(levels), TOGETHER])
    counts = rng.multinomial(TOGETHER, grid.shares)
    drawn = np.concatenate([part.drawn(count, rng) for part, count in zip(parts, counts, strict=True) if count])
    weighted, errors = _tables(levels, drawn)
    told, new_level, new = _levels(levels, drawn, errors, before.ends)
    centre, spread = centre_and_spread([part.posterior for part in parts], grid.shares.tolist())
    u = grid.sides[0]
    ends = quantile_ends(np.linspace(u[0], u[-1], FINE), u, grid.shares)
    middle, low, high = (size * float(np.sinh(end)) for end in ends)
    return Population(
        replace(centre, error=float(errors[0])), replace(spread, error=float(errors[1])), weighted, new, told,
        Known(middle, low, high, float(errors[2])), new_level,
    )  # fmt: skip


def _tables(levels: Mapping[str, Sequence[TableDraws]], drawn: FloatArray) -> tuple[tuple[Weighted, ...], FloatArray]:
    """Each table given the others, and the errors (3 + levels,) that the finite number of their draws gives to means
    of what is `drawn` together.
    """
    spans = (drawn - drawn.mean(axis=0)) / len(drawn)
    scatter = np.zeros(spans.shape[1])
    even = np.full(len(drawn), 1.0 / len(drawn))
    weighted: list[Weighted] = []
    for k, tables in enumerate(levels.values()):
        points = drawn[:, [3 + k, 2]]
        for table in tables:
            weights = shares_of(table, points)
            scatter += influence(table, weights, spans)
            rng = np.random.default_rng([len(weighted), TOGETHER, 1])
            weighted.append(given_others(table, points, even, weights, rng))
    return tuple(weighted), np.sqrt(scatter)


def _levels(
    levels: Mapping[str, Sequence[TableDraws]], drawn: FloatArray, errors: FloatArray, ends: tuple[float, float]
) -> tuple[tuple[Level, ...], Known, Known]:
    """Each level with what a new table there would have; the value of a new level, and of a table on it."""
    rng = np.random.default_rng([len(levels), TOGETHER, 2])
    told = []
    for k, (name, tables) in enumerate(levels.items(), 3):
        here = drawn[:, k]
        new = Known.of(drawn_new(drawn[:, [k, 2]], ends, rng))
        names = tuple(table.name for table in tables)
        told.append(Level(name, names, Known.of(here, float(errors[k])), float(here.std()), new))
    new_level = drawn_new(drawn[:, :2], ends, rng)
    new = Known.of(drawn_new(np.column_stack([new_level, drawn[:, 2]]), ends, rng))
    return tuple(told), Known.of(new_level), new
