"""Residuals at the best fit, and those of data sets simulated from it, each refitted to first order; patterns that
they may have: trends with the incident state, biases of groups.

With `K` the derivatives of all weighted residuals (measurements, scene, records, priors) and `U` an
orthonormal basis of its columns, a refit takes `U U^T e` off deviations `e`: what is left of standard ones has, over
the prior, exactly the covariance of the residuals of a linear model. So a test that is calibrated on them does not
use the data twice (Robins, van der Vaart and Ventura 2000, JASA 95, 1143).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from fitball.data.labels import labelled
from fitball.inference.likelihood.residuals import IMPOSSIBLE, Weighting, differentiable, residual_slopes, residuals
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import whole_of_parts
from fitball.inference.results import sentences
from fitball.inference.results.results import PointFit
from fitball.models.types import regime_name
from fitball.values import FloatArray

# Step of the differences that replace derivatives where there are none, in widths of the priors.
STEP = 1e-5
# The number of no column: of all together.
EVERY = -1
# Parameters that wear, temperature and the court change from impact to impact.
WEARING = ("mu", "cor_10")
# The share by which friction is changed either way to see what it does: by so much balls that grip begin to slide.
FRICTION = 0.2
# The sd of a uniform density of width one.
UNIFORM_SD = 1.0 / np.sqrt(12.0)


@dataclass(frozen=True)
class Refit:
    """A best fit and its first order.

    `columns` names the measured columns, one after the other in `measured` (measurements,): residuals, measured less
    predicted, in units of the fitted noise; `places` are the `impacts` at which each column was measured.
    `noise` (measurements,) numbers the noises of `noises`. `basis` (rows, rank) is `U`, its first rows those of the
    measurements; a change `c` of coefficients of the basis moves parameter `names[k]` by `reach[k] @ c` of its
    standard deviations. `effects` (measurements,) has what a small change of each parameter of `WEARING` does,
    `predicted` (measurements,) how large each prediction is among those of its column.
    """

    columns: tuple[str, ...]
    impacts: int
    places: tuple[NDArray[np.int64], ...]
    measured: FloatArray
    noises: tuple[str, ...]
    noise: NDArray[np.int64]
    basis: FloatArray
    names: tuple[str, ...]
    reach: FloatArray
    effects: Mapping[str, FloatArray]
    predicted: FloatArray

    @property
    def own(self) -> FloatArray:
        """The basis at the measurements, (measurements, rank)."""
        return self.basis[: self.measured.size]

    @cached_property
    def leverage(self) -> FloatArray:
        """How much of each deviation a refit takes off, (measurements,)."""
        return np.asarray(np.einsum("ij,ij->i", self.own, self.own))

    @cached_property
    def gram(self) -> FloatArray:
        """Products (rank, rank) of the basis at the measurements."""
        return np.asarray(self.own.T @ self.own)

    @cached_property
    def taken(self) -> FloatArray:
        """What the basis has of the residuals as measured, (rank,)."""
        return np.asarray(self.own.T @ self.measured)

    @cached_property
    def freedom(self) -> FloatArray:
        """Degrees of freedom that are left for each of the `noises`."""
        return np.asarray(np.bincount(self.noise, 1.0 - self.leverage, len(self.noises)), dtype=np.float64)

    @cached_property
    def starts(self) -> NDArray[np.int64]:
        """Where the measurements of each column begin, and where the last ends, (columns + 1,)."""
        return np.cumsum([0, *(places.size for places in self.places)])

    def rows(self, column: int) -> slice:
        """The measurements of a column; of all for `EVERY`."""
        if column == EVERY:
            return slice(0, self.measured.size)
        return slice(int(self.starts[column]), int(self.starts[column + 1]))

    def noise_of(self, column: int) -> int:
        """The number of the noise of a column."""
        return int(self.noise[self.starts[column]])

    def replicate(self, deviations: FloatArray) -> FloatArray:
        """Residuals (tables, measurements) of refitted tables with standard deviations (tables, rows)."""
        return deviations[:, : self.measured.size] - (deviations @ self.basis) @ self.own.T

    def scales(self, residual: FloatArray) -> FloatArray:
        """Sizes (tables, noises) of each noise, as residuals (tables, measurements) show it."""
        squares = np.stack([np.sum(residual[:, self.noise == g] ** 2, axis=1) for g in range(len(self.noises))], 1)
        scale: FloatArray = np.sqrt(squares / self.freedom)
        return scale


def refit(problem: Problem, point: PointFit) -> Refit:
    """The first order of a problem about its point estimate."""
    values = np.array([[point.values[name] for name in problem.free_names]])
    weighting = _weighting(point)
    count = len(problem.impacts)
    places = tuple(observable.places(count) for observable in problem.observables)
    sizes_of = [mine.size for mine in places]
    measured = -residuals(problem, values, weighting)[0, : sum(sizes_of)]
    kept = [k for k, parameter in enumerate(problem.free) if parameter.name not in NOISE_SPECS]
    width = np.array([p.prior.width * (1.0 if p.prior.bell else UNIFORM_SD) for p in problem.free])
    every = _slopes(problem, values, weighting)
    slopes = every[:, kept] * width[kept]
    # A uniform prior has no residual; without one a direction that the table hardly sees would count as fitted.
    flat = np.eye(len(kept))[[not problem.free[k].prior.bell for k in kept]]
    left, sizes, right = np.linalg.svd(np.concatenate([slopes, flat]), full_matrices=False)
    seen = sizes > 1e-9 * max(sizes.max(initial=0.0), 1.0)
    solved = right[seen].T / sizes[seen]
    errors = np.linalg.norm(solved, axis=1)
    noise_names = [o.noise or f"{o.name}_sd" for o in problem.observables]
    noises = tuple(dict.fromkeys(noise_names))
    return Refit(
        columns=tuple(o.name for o in problem.observables),
        impacts=count,
        places=places,
        measured=measured,
        noises=noises,
        noise=np.repeat([noises.index(name) for name in noise_names], sizes_of),
        basis=left[:, seen],
        names=tuple(problem.free_names[k] for k in kept),
        reach=solved / errors[:, None],
        predicted=_predicted_sizes(problem, values),
        effects=_effects(problem, values, weighting, every[: measured.size]),
    )


def _effects(problem: Problem, values: FloatArray, weighting: Weighting, slopes: FloatArray) -> dict[str, FloatArray]:
    """What changes of the parameters of `WEARING` do to the measurements (measurements,), of which `slopes`
    (measurements, free) are the derivatives.
    """
    names = problem.free_names
    # Copies: a view would keep the derivatives of all parameters for as long as the effects live.
    effects = {name: slopes[:, names.index(name)].copy() for name in WEARING if name in names}
    if "mu" in effects:
        ends = np.repeat(values, 2, axis=0)
        ends[:, names.index("mu")] *= 1.0 + FRICTION * np.array([-1.0, 1.0])
        low, high = residuals(problem, ends, weighting)[:, : len(slopes)]
        if max(np.abs(low).max(), np.abs(high).max()) < IMPOSSIBLE:
            effects["mu"] = high - low
    return effects


def _predicted_sizes(problem: Problem, values: FloatArray) -> FloatArray:
    """Sizes (measurements,) of what free values (1, free) predict, by column in units of their root mean square."""
    columns, rebound = problem.all_values(values), problem.rebound(values)
    sizes = [np.abs(o.observed - problem.deviation(columns, o, rebound)[0]) for o in problem.observables]
    return np.concatenate([size / np.sqrt(np.mean(size**2)) for size in sizes])


def slopes_of(problem: Problem, point: PointFit) -> FloatArray:
    """Derivatives (rows, free) of all weighted residuals at a point with respect to coordinates."""
    values = np.array([[point.values[name] for name in problem.free_names]])
    return _slopes(problem, values, _weighting(point))


def _weighting(point: PointFit) -> Weighting:
    return Weighting({name: point.values[name] for name in point.values if name in NOISE_SPECS}, penalised=True)


def _slopes(problem: Problem, values: FloatArray, weighting: Weighting) -> FloatArray:
    """Derivatives (rows, free) of all weighted residuals with respect to coordinates."""
    at = problem.to_coordinates(values)
    if differentiable(problem):
        return whole_of_parts(problem, lambda part: residual_slopes(part, at, weighting)[0])
    steps, (lowest, highest) = np.diag(STEP * problem.prior.width), problem.prior.limits
    low, high = np.maximum(at - steps, lowest), np.minimum(at + steps, highest)
    ahead, behind = (residuals(problem, problem.to_values(side), weighting) for side in (high, low))
    return np.asarray(((ahead - behind) / np.sum(high - low, axis=1)[:, None]).T)


def standard_deviates(
    problem: Problem, fit: Refit, sizes: dict[str, float], tables: int, rng: np.random.Generator
) -> FloatArray:
    """Deviations (tables, rows) of as many tables as the model makes: those of the table's noise as its residuals
    count them, standard normal ones of all else that is known.
    """
    deviates = rng.standard_normal((tables, fit.basis.shape[0]))
    if problem.noise.parameters:
        own = {name: np.full(tables, value) for name, value in sizes.items()}
        drawn = problem.noise.draw(rng, (tables, fit.measured.size), own)
        deviates[:, : fit.measured.size] = problem.noise.residual(drawn, own)
    return deviates


# --- patterns

# Rows from which a trend may bend, and two quantities act together.
BENDS, TOGETHER = 7, 12
# Rows that a group must have, and groups that are looked at.
LEAST_IN_GROUP, MOST_GROUPS = 3, 40
# Degrees of freedom of a noise from which its residuals can be looked at.
LEAST_FREEDOM = 2.0
# A pattern of whose square a refit leaves less cannot be separated from parameters.
LEFT = 0.02
# Patterns whose remains agree so well are one.
SAME = 0.98
# What a pattern is a pattern of, and those that are no knowledge of the incidence.
WHOLE_TABLE, ROWS = "all rows", "the order of rows"
# The correlation from which rows count as in the order of a quantity.
IN_ORDER = 0.9


@dataclass(frozen=True)
class Pattern:
    """A pattern in one `column` (its number, or `EVERY`): `kind` trend, bend, together, bias, row, group or regime,
    drift or level of a parameter; `over` which quantity or group, in `words`; `shape` (measurements of the column,)
    of root mean square one. A refit takes off what the basis has of it, `taken` (rank,), and leaves `length` times
    what `left` gives.

    Of the measurements of all columns nothing is kept: patterns are many, and rows may be.
    """

    kind: str
    column: int
    over: str
    words: str
    shape: FloatArray
    taken: FloatArray
    length: float

    def left(self, fit: Refit) -> FloatArray:
        """What a refit leaves of it (measurements,), of length one."""
        whole = -(fit.own @ self.taken)
        whole[fit.rows(self.column)] += self.shape
        return np.asarray(whole / self.length)

    def along(self, fit: Refit, residual: FloatArray, taken: FloatArray) -> FloatArray:
        """How much of `left` is in residuals (tables, measurements), (tables,); `taken` (tables, rank) is what the
        basis has of these.
        """
        return np.asarray((residual[:, fit.rows(self.column)] @ self.shape - taken @ self.taken) / self.length)


def overlap(fit: Refit, one: Pattern, other: Pattern) -> float:
    """The product of what a refit leaves of each."""
    mine, its = fit.rows(one.column), fit.rows(other.column)
    first, last = max(mine.start, its.start), min(mine.stop, its.stop)
    whole = 0.0
    if first < last:
        common = [item.shape[first - own.start : last - own.start] for item, own in ((one, mine), (other, its))]
        whole = float(common[0] @ common[1])
    return _remains(fit, whole, one.taken, other.taken) / (one.length * other.length)


def _remains(fit: Refit, whole: float, one: FloatArray, other: FloatArray) -> float:
    # The basis is orthonormal with the rows of priors, which are none of the measurements.
    return whole - 2.0 * float(one @ other) + float(one @ fit.gram @ other)


def pattern(fit: Refit, column: int, kind: str, over: str, words: str, shape: FloatArray) -> Pattern | None:
    """The pattern of that `shape` (measurements of the column,); None where a refit leaves too little of it."""
    taken = fit.own[fit.rows(column)].T @ shape
    square = float(shape @ shape)
    remains = _remains(fit, square, taken, taken)
    if square <= 0.0 or remains < LEFT * square:
        return None
    return Pattern(kind, column, over, words, shape, taken, float(np.sqrt(remains)))


def covariates(problem: Problem) -> dict[str, FloatArray]:
    """The incident state of each impact by name, (impacts,) in SI, where it differs between impacts."""
    impacts = problem.impacts
    known = {"v_y1": impacts.v_y1}
    if problem.model.tangential:
        known = {"theta_1": impacts.angle, "v_1": impacts.speed, "omega_1": impacts.omega_1}
    return {name: column for name, column in known.items() if np.ptp(column) > 1e-9 * np.abs(column).max()}


def _groups(problem: Problem, point: PointFit) -> Iterator[tuple[str, str, str, FloatArray]]:
    labels = {item.column: np.array(problem.table.labels[item.column]) for item in labelled(problem.table.labels)}
    if problem.model.tangential:
        labels["regime"] = np.array([regime_name(int(code)) for code in point.rebound.regime[0]])
    for kind, column in labels.items():
        names, sizes = np.unique(column, return_counts=True)
        if 2 <= names.size <= MOST_GROUPS:
            for name, size in zip(names, sizes, strict=True):
                if size >= LEAST_IN_GROUP and column.size - size >= LEAST_IN_GROUP:
                    inside = (column == name).astype(float)
                    yield ("regime" if kind == "regime" else "group"), kind, f"{kind} {name}", inside


def patterns(problem: Problem, point: PointFit, fit: Refit) -> list[Pattern]:
    """All patterns that can be separated from parameters and from each other: in single columns, then what friction
    and restitution that drift or differ between groups do to all columns.
    """
    groups, drift = list(_groups(problem, point)), list(_drift(problem))
    whole = "bias", WHOLE_TABLE, WHOLE_TABLE, np.ones(len(problem.impacts))
    shapes = [*_trends(problem), whole, *drift, *groups]
    kept: list[Pattern] = []

    def keep(column: int, kind: str, over: str, words: str, shape: FloatArray) -> None:
        size = float(np.sqrt(np.mean(shape**2)))
        found = None if size <= 0.0 else pattern(fit, column, kind, over, words, shape / size)
        if found is not None and all(abs(overlap(fit, found, other)) <= SAME for other in kept):
            kept.append(found)

    for column in range(len(fit.columns)):
        if fit.freedom[fit.noise_of(column)] > LEAST_FREEDOM:
            for kind, over, words, shape in shapes:
                biased = kind in ("group", "regime")
                fault = sentences.BIAS.format(group=words) if biased else words
                keep(column, kind, over, fault, shape[fit.places[column]])
    if np.all(fit.freedom > LEAST_FREEDOM):
        rows = np.concatenate(fit.places)
        for kind, over, words, shape in (*drift, *groups):
            for name, effect in fit.effects.items() if kind != "regime" else ():
                if kind == "row":
                    fault = sentences.PARAMETER_DRIFT.format(name=name, drift=words)
                else:
                    fault = sentences.PARAMETER_LEVEL.format(name=name, group=words)
                keep(EVERY, "drift" if kind == "row" else "level", over, fault, effect * shape[rows])
    return kept


def _drift(problem: Problem) -> Iterator[tuple[str, str, str, FloatArray]]:
    """A trend over the order of the rows, which is mostly that of measuring."""
    count = len(problem.impacts)
    if count >= BENDS:
        row: FloatArray = np.arange(float(count)) - 0.5 * (count - 1)
        known = covariates(problem).items()
        like = [name for name, column in known if abs(np.corrcoef(row, column)[0, 1]) >= IN_ORDER]
        order = sentences.IN_ORDER.format(quantities=sentences.listed(like)) if like else ""
        yield "row", ROWS, sentences.DRIFT.format(order=order), row


def _trends(problem: Problem) -> Iterator[tuple[str, str, str, FloatArray]]:
    count, straight = len(problem.impacts), {}
    for name, column in covariates(problem).items():
        levels = np.unique(np.round(column / np.ptp(column), 6)).size
        degree = min(levels - 1, 1 + (count >= BENDS))
        # Orthogonal to all lower powers over the impacts of the table.
        powers = np.linalg.qr(np.vander((column - column.mean()) / np.ptp(column), degree + 1, increasing=True))[0]
        for power in range(1, degree + 1):
            kind, words = ("trend", sentences.TREND) if power == 1 else ("bend", sentences.CURVE)
            yield kind, name, words.format(quantity=name), powers[:, power]
        straight[name] = powers[:, 1]
    for one, other in combinations(straight, 2):
        product = straight[one] * straight[other]
        if count >= TOGETHER and np.ptp(product) > 0.0:
            over = f"{one} and {other}"
            yield "together", over, sentences.INTERACTION.format(quantity=over), product - product.mean()
