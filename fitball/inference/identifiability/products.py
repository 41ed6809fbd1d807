"""Products of powers that are better known than what they are made of, found among all free positive parameters.

Where parameters trade against each other their product may be known although none of them is. A monomial is a
direction in the logarithms; its standard error follows from their covariance. Sparse ones come first: pairs, then
triples, with small whole exponents; a triple has to beat every pair in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from itertools import product as cartesian
from math import gcd

import numpy as np

from fitball.inference.identifiability.fisher import fisher_information, inverse, prior_sds
from fitball.inference.problem.parameters import NOISE_SPECS, Parameter
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Posterior
from fitball.values import FloatArray

# Standard error, as a share of the smallest among its parts, from which a product deserves a name.
BETTER = 0.8
# Largest exponent, and how many products are named at most.
LARGEST_POWER, PRODUCTS_NAMED = 2, 3
# Share of its prior's sd below which a value is zero but for rounding: a slope of its logarithm has no meaning.
VANISHED = 1e-12


@dataclass(frozen=True)
class Known:
    """A monomial: `exponents` (parameters,), the standard error of its logarithm, and that of its best part."""

    exponents: FloatArray
    error: float
    part: float


def positive(parameter: Parameter) -> bool:
    """Whether a parameter is free, no noise, and has a logarithm everywhere."""
    prior = parameter.prior
    return parameter.free and parameter.name not in NOISE_SPECS and (prior.log or prior.support[0] >= 0.0)


def log_covariance(problem: Problem, coordinates: FloatArray, posterior: Posterior | None) -> FloatArray:
    """Covariance (positive, positive) of the logarithms of the `positive` free parameters: of the draws, or without
    a posterior to first order at `coordinates` (free,), NaN for parameters without a derivative there.
    """
    columns = [k for k, parameter in enumerate(problem.free) if positive(parameter)]
    if posterior is not None:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.atleast_2d(np.cov(np.log(posterior.draws[:, columns]), rowvar=False))
    to_logs = log_steps(problem, coordinates, columns)
    covariance = inverse(fisher_information(problem, coordinates, scene=True), 1.0)[np.ix_(columns, columns)]
    return np.asarray(covariance * np.outer(to_logs, to_logs))


def log_steps(problem: Problem, coordinates: FloatArray, columns: Sequence[int]) -> FloatArray:
    """Change (columns,) of the logarithm of each parameter for one sd of its prior, NaN for those not `positive`."""
    values = problem.to_values(coordinates[None, :])[0]
    sds = prior_sds(problem) * problem.prior.width
    steps = np.full(len(columns), np.nan)
    for place, k in enumerate(columns):
        parameter = problem.free[k]
        if positive(parameter) and parameter.prior.log:
            steps[place] = sds[k]
        elif positive(parameter) and values[k] > VANISHED * sds[k]:
            steps[place] = sds[k] / values[k]
    return steps


def known_products(covariance: FloatArray) -> list[Known]:
    """Monomials appreciably better known than any part of them, sparse ones first and of those the better."""
    usable = [k for k, variance in enumerate(np.diag(covariance)) if np.isfinite(variance) and variance > 0.0]
    products: list[Known] = []
    for size in (2, 3):
        best: dict[tuple[int, ...], Known] = {}
        for support in combinations(usable, size):
            for powers in _exponents(size):
                exponents = np.zeros(len(covariance))
                exponents[list(support)] = powers
                error, part = monomial_error(exponents, covariance), _best_part(support, powers, covariance)
                rival = best.get(support)
                if error <= BETTER * part and (rival is None or error * rival.part < rival.error * part):
                    best[support] = Known(exponents, error, part)
        products += sorted(best.values(), key=lambda known: known.error / known.part)
    return products[:PRODUCTS_NAMED]


def monomial_error(exponents: FloatArray, covariance: FloatArray) -> float:
    """Standard error of the logarithm of a monomial; NaN among unused parameters does not matter."""
    used = np.flatnonzero(exponents)
    part = exponents[used] @ covariance[np.ix_(used, used)] @ exponents[used]
    return float(np.sqrt(max(float(part), 0.0)))


def _exponents(size: int) -> Iterator[tuple[int, ...]]:
    """Whole exponents without a common divisor, the first above zero, the smallest first."""
    signed = [power for power in range(-LARGEST_POWER, LARGEST_POWER + 1) if power]
    every = (powers for powers in cartesian(signed, repeat=size) if powers[0] > 0 and gcd(*powers) == 1)
    yield from sorted(every, key=lambda powers: (sum(map(abs, powers)), [-power for power in powers]))


def _best_part(support: Sequence[int], powers: Sequence[int], covariance: FloatArray) -> float:
    """The smallest standard error among the parts of a monomial: its factors, and of three their pairs."""
    errors = []
    for size in range(1, len(support)):
        for places in combinations(range(len(support)), size):
            exponents = np.zeros(len(covariance))
            for place in places:
                exponents[support[place]] = powers[place]
            errors.append(monomial_error(exponents, covariance))
    return min(errors)
