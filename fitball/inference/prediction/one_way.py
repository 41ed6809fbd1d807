"""Repeated measurements of several balls, or at several places: their differences apart from measurement noise.

`y = X beta + b[label] + noise`, where `b` and the noise are normal. Priors are flat in `beta`, in the standard
deviation between labels (Gelman 2006, *Bayesian Analysis* 1, 515) and in the logarithm of that of the noise. Given
the ratio of the two, everything else is known in closed form (a linear mixed model with one factor; Searle, Casella
and McCulloch 1992, *Variance Components*, ch. 3), so that the ratio alone is summed over a grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.values import FloatArray

DRAWS = 8000
# Ratios of the two standard deviations, evenly spaced in their logarithm: beyond, nothing is left of either.
RATIOS = np.exp(np.linspace(np.log(1e-4), np.log(1e4), 800))
# Below this share of the whole scatter repeats agree to the digits they are printed with.
LEAST_SCATTER = 1e-12


def lab_generator(seed: int) -> np.random.Generator:
    """The generator of what drop tests and courts are told by, a stream of a run that nothing else draws from."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(13,)))


@dataclass(frozen=True)
class OneWay:
    """Draws: `coefficients` (draws, columns of the design), standard deviations `between` labels and `within` one,
    each (draws,), and how far each label lies from the others, `shifts` (draws, labels).
    """

    coefficients: FloatArray
    between: FloatArray
    within: FloatArray
    shifts: FloatArray

    @property
    def levels(self) -> FloatArray:
        """Each label (draws, labels), where the first column of the design is one."""
        return self.coefficients[:, :1] + self.shifts


def plain_mean(values: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draws of mean and standard deviation, each (draws,), of independent `values` (at least three)."""
    count = values.size
    freedom = count - 1
    spread = np.sqrt(np.sum((values - values.mean()) ** 2) / rng.chisquare(freedom, DRAWS))
    return values.mean() + spread / np.sqrt(count) * rng.standard_normal(DRAWS), spread


def one_way(
    values: FloatArray, design: FloatArray, index: NDArray[np.int64], rng: np.random.Generator
) -> OneWay | str:
    """Draws for `values` (rows,) with `design` (rows, columns) and labels `index` (rows,), or why there are none."""
    labels = np.eye(int(index.max()) + 1)[index]
    rank = int(np.linalg.matrix_rank(np.hstack([design, labels])))
    shared = int(np.linalg.matrix_rank(design)) + labels.shape[1] - rank
    if labels.shape[1] - shared < 2:
        return "fewer than three of them"
    if values.size - rank < 2:
        return "too few repeats"
    beta: FloatArray = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], dtype=np.float64)
    rest = values - design @ beta
    pure = rest - _fitted(np.hstack([design, labels]), rest)
    if not pure @ pure > LEAST_SCATTER * (values @ values):
        return "repeats agree to the last digit"
    return _draws(rest, beta, design, labels, rng)


def _fitted(matrix: FloatArray, values: FloatArray) -> FloatArray:
    return np.asarray(matrix @ np.linalg.lstsq(matrix, values, rcond=None)[0])


def _draws(
    rest: FloatArray, beta: FloatArray, design: FloatArray, labels: FloatArray, rng: np.random.Generator
) -> OneWay:
    """Draws around the least-squares `beta`, which leaves `rest` (rows,)."""
    freedom = rest.size - design.shape[1] - 1
    count = labels.sum(axis=0)
    sums, totals = labels.T @ design, labels.T @ rest
    share = RATIOS[:, None] ** 2 / (1.0 + count * RATIOS[:, None] ** 2)
    information = design.T @ design - np.einsum("gm,mp,mq->gpq", share, sums, sums)
    right = design.T @ rest - np.einsum("gm,mp,m->gp", share, sums, totals)
    move = np.linalg.solve(information, right[..., None])[..., 0]
    square = rest @ rest - share @ totals**2 - np.einsum("gp,gp->g", right, move)
    density = (
        -0.5 * np.linalg.slogdet(information)[1]
        - 0.5 * np.log1p(count * RATIOS[:, None] ** 2).sum(axis=1)
        - 0.5 * freedom * np.log(square)
        + np.log(RATIOS)
    )
    weight = np.cumsum(np.exp(density - density.max()))
    chosen = np.searchsorted(weight, weight[-1] * (np.arange(DRAWS) + rng.uniform()) / DRAWS)
    chosen = rng.permutation(np.minimum(chosen, RATIOS.size - 1))
    within = np.sqrt(square[chosen] / rng.chisquare(freedom, DRAWS))
    roots = np.linalg.cholesky(np.linalg.inv(information))[chosen]
    moved = move[chosen] + within[:, None] * np.einsum(
        "dpq,dq->dp", roots, rng.standard_normal((DRAWS, design.shape[1]))
    )
    spread = within[:, None] * np.sqrt(share[chosen])
    shifts = share[chosen] * (totals - moved @ sums.T) + spread * rng.standard_normal((DRAWS, count.size))
    return OneWay(beta + moved, RATIOS[chosen] * within, within, shifts)
