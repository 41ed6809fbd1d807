"""Akaike's and the Bayesian information criterion, from the maximised likelihood without priors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitball.inference.likelihood.residuals import default_noise
from fitball.inference.point.maximum_posterior import maximum_posterior
from fitball.inference.problem.priors import Prior
from fitball.inference.problem.problem import Problem

# Where a normal prior is unbounded its flat stand-in ends this many standard deviations from the middle.
FLAT_SDS = 12.0


@dataclass(frozen=True)
class Criteria:
    """`log_likelihood` at its maximum; `parameters` free ones, noise included, whether or not the table sees them;
    `measurements` n of the criteria. `aicc` is None where n leaves it undefined.
    """

    log_likelihood: float
    parameters: int
    measurements: int

    @property
    def aicc(self) -> float | None:
        """-2 ln L + 2 k + 2 k (k + 1) / (n - k - 1) (Hurvich and Tsai 1989)."""
        k, n = self.parameters, self.measurements
        if n - k - 1 <= 0:
            return None
        return -2.0 * self.log_likelihood + 2.0 * k + 2.0 * k * (k + 1) / (n - k - 1)

    @property
    def bic(self) -> float:
        """-2 ln L + k ln n (Schwarz 1978)."""
        return -2.0 * self.log_likelihood + self.parameters * math.log(self.measurements)


def criteria(problem: Problem, starts: Sequence[Mapping[str, float]]) -> Criteria:
    """Maximise the likelihood from `starts` (values by name), noise included, within the bounds of the parameters.

    A start on the end of a logarithmic scale, where there is no way back, is passed over.

    What the scene knows of the contact time is prior knowledge and does not enter. Raises FitError as
    `maximum_posterior` does.
    """
    bare = replace(
        problem,
        contact_time=None,
        parameters=tuple(replace(parameter, prior=_flat(parameter.prior)) for parameter in problem.parameters),
    )
    values = np.array([[start[name] for name in bare.free_names] for start in starts])
    with np.errstate(divide="ignore"):
        usable = np.all(np.isfinite(bare.to_coordinates(values)), axis=1)
    best = maximum_posterior(bare, values[usable], {name: starts[0][name] for name in default_noise(bare)})
    return Criteria(
        best.log_likelihood, bare.dimension, sum(observable.observed.size for observable in bare.observables)
    )


def _flat(prior: Prior) -> Prior:
    """A prior with the same coordinate, flat between the bounds, or within `FLAT_SDS` sds where there is none."""
    low, high = prior.ends
    if prior.normal:
        low, high = max(low, prior.a - FLAT_SDS * prior.b), min(high, prior.a + FLAT_SDS * prior.b)
    return replace(prior, normal=False, a=low, b=high)
