"""Weighted draws by adaptive multiple importance sampling (Cornuet et al. 2012); Pareto smoothing.

Draws come from mixtures of Student distributions that are fitted to them round by round, and all
draws so far are weighted by the mixture of all proposals so far.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import lgamma, log, pi
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.selection import evenly_spread, systematic
from fitball.base.values import FloatArray
from fitball.inference.diagnostics import pareto_smoothed_tail

# Fewest draws of a round, after which the proposals are fitted again, and fewest rounds.
DRAWS_OF_ROUND = 500
LEAST_ROUNDS = 4
# Share of each later round that the first proposals and their wider copies keep.
DEFENCE_SHARE = 0.1
# Scale of these copies over that of the proposals, and their degrees of freedom.
DEFENCE_WIDTH = 2.0
DEFENCE_FREEDOM = 4.0
# Effective draws for each parameter from which a mixture is fitted.
DRAWS_FOR_MIXTURE = 12.0
# Rounds at most, unless many draws are wanted.
IMPORTANCE_ROUNDS = 16
# Draws at most, over the effective draws that are wanted: unequal weights lower the effective size.
MOST_DRAWS = 5.0
# Effective draws for each parameter from which a proposal is fitted; where there are fewer, their
# weights are flattened.
DRAWS_A_PARAMETER = 5.0
# Factor of the exponent of weights at each step of flattening.
FLATTENING = 0.8
# The exponent at which flattening ends: all draws then count nearly the same.
FLATTEST = 0.05
# Degrees of freedom of a fitted proposal: its tails are heavier than those of most posteriors.
PROPOSAL_FREEDOM = 8.0
# Variance of a fitted proposal over that of its draws: a proposal that is too narrow has weights
# without limit.
WIDENING = 1.1
# Condition number of correlations above which draws do not span the space but for rounding.
WORST_CONDITION = 1e12
# Components of a proposal: enough for a bent posterior, few enough that each has draws.
MIXTURE_COMPONENTS = 6
# Rounds of the EM that fits the components; a proposal need not be exact.
EM_ROUNDS = 10
# Draws to which the components are fitted: more take time and move them little.
DRAWS_FOR_EM = 1_500
# Added variance of a component, over that of all draws: it keeps one with few draws regular.
LEAST_VARIANCE = 1e-6
# Pareto k up to which weights are reliable (Vehtari et al. 2024, JMLR 25, 72).
RELIABLE_K = 0.7
# Fewest draws in a tail to which a Pareto distribution can be fitted.
LEAST_TAIL = 5


@dataclass(frozen=True)
class Student:
    """A multivariate Student distribution of coordinates: its `centre`, the lower Cholesky `factor`
    of its scale matrix, and its degrees of `freedom`.
    """

    centre: Annotated[FloatArray, "coordinates"]
    factor: Annotated[FloatArray, "coordinates coordinates"]
    freedom: float = 5.0

    def draw(
        self,
        rng: np.random.Generator | np.random.RandomState,
        count: int,
    ) -> Annotated[FloatArray, "draws coordinates"]:
        """Coordinates of `count` random draws."""
        normal = rng.standard_normal((count, self.centre.size))
        stretch = np.sqrt(rng.chisquare(self.freedom, size=count) / self.freedom)
        return np.asarray(self.centre + normal @ self.factor.T / stretch[:, None])

    def log_density(
        self,
        x: Annotated[FloatArray, "draws coordinates"],
    ) -> Annotated[FloatArray, "draws"]:
        """The normalised log density at coordinates."""
        z = (x - self.centre) @ self.whitening
        power = 0.5 * (self.freedom + self.centre.size)
        square = np.sum(z * z, axis=1)
        return np.asarray(self._peak - power * np.log1p(square / self.freedom))

    def wider(self, factor: float) -> Student:
        """The same distribution, wider by a factor, with heavier tails."""
        return Student(self.centre, factor * self.factor, min(self.freedom, DEFENCE_FREEDOM))

    @cached_property
    def whitening(self) -> Annotated[FloatArray, "coordinates coordinates"]:
        """The matrix that makes deviations, as rows, standard ones. It is kept, since chains need
        it at every step.
        """
        return np.asarray(np.linalg.inv(self.factor).T)

    @cached_property
    def _peak(self) -> float:
        """The log density at the centre."""
        nu = self.freedom
        size = self.centre.size
        constant = lgamma(0.5 * (nu + size)) - lgamma(0.5 * nu) - 0.5 * size * log(nu * pi)
        return float(constant - np.sum(np.log(np.diagonal(self.factor))))


def fit_student(
    x: Annotated[FloatArray, "draws coordinates"],
    log_weights: Annotated[FloatArray, "draws"] | None = None,
) -> Student | None:
    """The Student distribution with the mean and the widened covariance of draws, which may have
    weights; None where the draws do not span the space.
    """
    log_weights = np.zeros(len(x)) if log_weights is None else log_weights
    weights = np.exp(flattened(log_weights, DRAWS_A_PARAMETER * x.shape[1]))
    # A single draw with all the weight spans no space.
    if not np.sum(weights**2) < 1.0:
        return None
    covariance = np.atleast_2d(np.cov(x, rowvar=False, aweights=weights))
    scale = np.sqrt(np.diagonal(covariance))
    if not np.all(scale > 0.0):
        return None
    correlation = covariance / np.outer(scale, scale)
    if np.linalg.cond(correlation) > WORST_CONDITION:
        return None
    factor = np.asarray(np.linalg.cholesky(WIDENING * covariance), dtype=np.float64)
    return Student(weights @ x, factor, PROPOSAL_FREEDOM)


def flattened(
    log_weights: Annotated[FloatArray, "draws"],
    enough: float,
) -> Annotated[FloatArray, "draws"]:
    """Log weights that add up to one, with an exponent of at most one at which `enough` draws are
    effective, or all count nearly the same.
    """
    power = 1.0
    while True:
        flat = _normalised(power * log_weights)
        if effective_size(flat) >= enough or power < FLATTEST:
            return flat
        power *= FLATTENING


def fit_mixture(
    x: Annotated[FloatArray, "draws coordinates"],
    rng: np.random.Generator,
) -> list[tuple[float, Student]]:
    """A mixture of Student distributions for draws, with the share of each; empty where the draws
    do not span the space. Normal components are fitted by EM (Dempster, Laird and Rubin 1977), and
    then widened. A mixture follows a posterior that is bent, or ends at a wall, closer than a
    single component does.
    """
    x = x[evenly_spread(len(x), DRAWS_FOR_EM, down=True)]
    single = fit_student(x)
    if single is None:
        return []
    # Whitened, since units and scales of coordinates differ by powers of ten.
    w = (x - single.centre) @ single.whitening
    middles = w[rng.choice(len(w), MIXTURE_COMPONENTS, replace=False), None]
    logs = -np.sum((w - middles) ** 2, axis=2)
    components = list[Student]()
    for _ in range(EM_ROUNDS):
        belongs = np.exp(logs - np.logaddexp.reduce(logs))
        belongs = belongs[belongs.sum(axis=1) >= DRAWS_A_PARAMETER * x.shape[1]]
        shares = belongs.mean(axis=1)
        components = []
        normal = list[FloatArray]()
        weights = belongs / belongs.sum(axis=1, keepdims=True)
        for share, weight in zip(shares, weights, strict=True):
            middle = weight @ w
            away = w - middle
            covariance = (weight * away.T) @ away
            factor = np.linalg.cholesky(covariance + LEAST_VARIANCE * np.eye(x.shape[1]))
            z = away @ np.linalg.inv(factor).T
            size = np.sum(np.log(np.diagonal(factor)))
            normal.append(np.log(share) - size - 0.5 * np.sum(z * z, axis=1))
            centre = single.centre + single.factor @ middle
            wider = np.sqrt(WIDENING) * single.factor @ factor
            components.append(Student(centre, wider, PROPOSAL_FREEDOM))
        logs = np.stack(normal)
    return list(zip((shares / shares.sum()).tolist(), components, strict=True))


class AdaptiveDraws(NamedTuple):
    """Draws `x` with a finite log density (their `scores`), log weights that add up to one, Pareto
    `k`, and how many were `tried`. `of_centres` are the weights that the centres of the first
    proposals would have if they were draws, over the mean weight.
    """

    x: Annotated[FloatArray, "draws coordinates"]
    scores: Annotated[FloatArray, "draws"]
    log_weights: Annotated[FloatArray, "draws"]
    k: float
    tried: int
    of_centres: Annotated[FloatArray, "proposals"]

    @property
    def size(self) -> float:
        """The effective number of draws (Kish)."""
        return effective_size(self.log_weights) if len(self.x) else 0.0


def importance(
    log_density: Callable[[FloatArray], FloatArray],
    begin: Sequence[Student],
    rng: np.random.Generator,
    enough: float,
) -> tuple[
    Annotated[FloatArray, "draws coordinates"],
    Annotated[FloatArray, "draws"],
    float,
]:
    """Draws as by `adaptive_draws`: coordinates, log weights that add up to one, and Pareto k."""
    drawn = adaptive_draws(log_density, begin, rng, enough)
    return drawn.x, drawn.log_weights, drawn.k


def adaptive_draws(
    log_density: Callable[[FloatArray], FloatArray],
    begin: Sequence[Student],
    rng: np.random.Generator,
    enough: float,
    good_k: float = np.inf,
) -> AdaptiveDraws:
    """Draws from a log density, a function from coordinates (draws, coordinates) to (draws,), until
    their effective size is `enough` and their Pareto k at most `good_k`, or there are too many.

    `begin` are the first proposals. These and wider copies of them keep a share of each later
    round, so that no maximum is forgotten to which a round gave no draw. There are no draws, and k
    is infinite, where none is possible.
    """
    first = _Mixture.of([*begin, *(student.wider(DEFENCE_WIDTH) for student in begin)])
    adapted = list[tuple[float, Student]]()
    from_first = 0
    fitted = list[tuple[float, Student]]()
    x = np.empty((0, begin[0].centre.size))
    score = np.empty(0)
    by_first = np.empty(0)
    by_adapted = np.empty(0)
    weights = score
    k = np.inf
    a_round = max(DRAWS_OF_ROUND, round(enough / LEAST_ROUNDS))
    for _ in range(max(IMPORTANCE_ROUNDS, round(MOST_DRAWS * enough / a_round))):
        of_first = round((DEFENCE_SHARE if fitted else 1.0) * a_round)
        of_fitted = [max(1, round(share * (a_round - of_first))) for share, _ in fitted]
        parts = [first.draw(rng, of_first)]
        parts += [
            student.draw(rng, count) for count, (_, student) in zip(of_fitted, fitted, strict=True)
        ]
        new = np.concatenate(parts)
        from_first += of_first
        added = [
            (log(count), student) for count, (_, student) in zip(of_fitted, fitted, strict=True)
        ]
        adapted += added
        by_adapted = np.concatenate(
            [np.logaddexp(by_adapted, _mixture(added, x)), _mixture(adapted, new)]
        )
        by_first = np.concatenate([by_first, first.log_density(new)])
        x = np.concatenate([x, new])
        score = np.concatenate([score, log_density(new)])
        if not np.isfinite(score).any():
            continue
        weights = _normalised(score - np.logaddexp(log(from_first) + by_first, by_adapted))
        if effective_size(weights) >= enough:
            k = pareto_smoothed(weights[np.isfinite(score)], 1.0)[1]
            if k <= good_k:
                break
        fitted = _fitted(x, weights, rng)
    possible = np.isfinite(score)
    if not possible.any():
        nowhere = np.zeros(len(begin))
        return AdaptiveDraws(x[possible], score[possible], weights, np.inf, len(x), nowhere)
    k = pareto_smoothed(weights[possible], 1.0)[1]
    centres = np.stack([student.centre for student in begin])
    proposed = np.logaddexp(
        log(from_first) + first.log_density(centres), _mixture(adapted, centres)
    )
    mean = np.logaddexp.reduce(score - np.logaddexp(log(from_first) + by_first, by_adapted)) - log(
        len(x)
    )
    of_centres = np.exp(log_density(centres) - proposed - mean)
    return AdaptiveDraws(x[possible], score[possible], weights[possible], k, len(x), of_centres)


class _Mixture(NamedTuple):
    """A mixture of proposals, each with the same share."""

    students: tuple[Student, ...]

    @classmethod
    def of(cls, students: Sequence[Student]) -> _Mixture:
        """The mixture of some proposals."""
        return cls(tuple(students))

    def draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Coordinates (draws, coordinates); numbers of draws of proposals differ by one at most."""
        edges = np.linspace(0.0, count, len(self.students) + 1) + rng.uniform()
        counts = np.diff(np.floor(edges).astype(np.int64))
        drawn = zip(self.students, counts.tolist(), strict=True)
        return np.concatenate([student.draw(rng, number) for student, number in drawn])

    def log_density(self, x: FloatArray) -> FloatArray:
        """The log density (draws,) of the mixture."""
        share = -log(len(self.students))
        return _mixture([(share, student) for student in self.students], x)


def _fitted(
    x: FloatArray,
    log_weights: FloatArray,
    rng: np.random.Generator,
) -> list[tuple[float, Student]]:
    """Proposals, with their shares, for weighted draws: a mixture where enough are effective, else
    a single one, or none where the draws do not span the space.
    """
    if effective_size(log_weights) > DRAWS_FOR_MIXTURE * x.shape[1]:
        # More than there are would only repeat them.
        count = min(DRAWS_FOR_EM, len(x))
        chosen = systematic(np.exp(log_weights), count, rng.uniform())
        return fit_mixture(x[chosen], rng)
    single = fit_student(x, log_weights)
    return [] if single is None else [(1.0, single)]


def effective_size(log_weights: Annotated[FloatArray, "draws"]) -> float:
    """The effective sample size (Kish) of draws with log weights that add up to one."""
    return float(1.0 / np.sum(np.exp(2.0 * log_weights)))


def _mixture(proposals: Sequence[tuple[float, Student]], x: FloatArray) -> FloatArray:
    """The log density (draws,) of draws from all proposals, but for their number. Each proposal has
    the logarithm of the number of its draws.
    """
    if not proposals:
        return np.full(len(x), -np.inf)
    densities = [count + student.log_density(x) for count, student in proposals]
    return np.asarray(np.logaddexp.reduce(densities, axis=0))


def _normalised(log_ratios: FloatArray) -> FloatArray:
    """Log weights that add up to one."""
    return np.asarray(log_ratios - np.logaddexp.reduce(log_ratios))


def _is_spread(tail: FloatArray) -> bool:
    """Whether a Pareto distribution can be fitted to sorted ratios: the fit divides by how far
    their first quartile lies above the lowest of them.
    """
    quartile = tail[int((tail.size - 1) / 4 + 0.5)]
    return bool(quartile > tail[0] and tail[-1] > tail[1])


def pareto_smoothed(
    log_ratios: Annotated[FloatArray, "draws"],
    efficiency: float,
) -> tuple[Annotated[FloatArray, "draws"], float]:
    """Pareto-smoothed log weights, which add up to one, and Pareto k (Vehtari et al. 2024).

    `efficiency` is the effective size of the draws over their number. k is infinite where too few
    ratios differ for a tail, and -infinite where all are equal.
    """
    count = log_ratios.size
    size = int(min(count / 5.0, 3.0 * np.sqrt(count / efficiency)))
    tail = np.sort(log_ratios)[-size - 1 :]
    if np.ptp(log_ratios) <= 0.0:
        return _normalised(log_ratios), -np.inf
    # Ratios, as the fit takes them: of logarithms far apart all but the largest are zero.
    if size < LEAST_TAIL or not _is_spread(np.exp(tail - tail[-1])):
        return _normalised(log_ratios), np.inf
    return pareto_smoothed_tail(log_ratios, size)
