"""A parameter over many tables: their centre and spread, which lie outside, and whether it drifts. Arrays in and out.

Each table gives an estimate and its standard error. Estimates scatter about a line (or a constant) with variance
`sd^2 + tau^2`, `tau` the spread of the tables themselves, by restricted maximum likelihood: the random-effects
model of meta-analysis (Viechtbauer 2005, J. Educ. Behav. Stat. 30, 261), with the intervals of Knapp and Hartung
(2003, Stat. Med. 22, 2693).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import median_abs_deviation as mad
from scipy.stats import t

from fitball.values import FloatArray

LEAST_TABLES = 3
# Chance that among tables of which none differs any is called an outlier.
FALSE_OUTLIER = 0.05
# Of the median absolute deviation against the standard deviation, on normal numbers.
EFFICIENCY = 0.37


@dataclass(frozen=True)
class Line:
    """`coefficients` (constant, and slope where there is one) with `low` and `high` ends of their 95 % intervals and
    `p` of each against zero; `spread` of the tables about it, beyond their own uncertainty.
    """

    coefficients: FloatArray
    low: FloatArray
    high: FloatArray
    p: FloatArray
    spread: float


def random_effects(estimates: FloatArray, sds: FloatArray, along: FloatArray | None = None) -> Line | None:
    """The constant, or the line over `along`, about which estimates (tables,) with standard errors `sds` scatter;
    None for too few tables, or where `along` is the same for all.
    """
    columns = [np.ones(len(estimates))] if along is None else [np.ones(len(estimates)), along - np.mean(along)]
    design = np.stack(columns, axis=1)
    free = len(estimates) - design.shape[1]
    if free < LEAST_TABLES - 1 or np.linalg.matrix_rank(design) < design.shape[1]:
        return None
    typical = float(np.std(estimates))
    if typical <= 0.0:
        return None

    def cost(log_tau: float) -> float:
        return _restricted(design, estimates, sds**2 + np.exp(2.0 * log_tau))

    found = minimize_scalar(cost, bounds=(np.log(1e-4 * typical), np.log(10.0 * typical)), method="bounded")
    none = _restricted(design, estimates, sds**2) if np.all(sds > 0.0) else np.inf
    tau = 0.0 if none <= found.fun else float(np.exp(found.x))
    weights = 1.0 / (sds**2 + tau**2)
    covariance = np.linalg.inv(design.T @ (weights[:, None] * design))
    coefficients = covariance @ (design.T @ (weights * estimates))
    left = estimates - design @ coefficients
    # Never below one: with few tables that agree by chance intervals would be too narrow.
    scale = max(1.0, float(weights @ left**2) / free)
    errors = np.sqrt(scale * np.diag(covariance))
    reach = float(t.ppf(0.975, free)) * errors
    p = 2.0 * t.sf(np.abs(coefficients) / errors, free)
    return Line(coefficients, coefficients - reach, coefficients + reach, p, tau)


def _restricted(design: FloatArray, estimates: FloatArray, variances: FloatArray) -> float:
    """Minus twice the restricted log likelihood, up to a constant."""
    weights = 1.0 / variances
    information = design.T @ (weights[:, None] * design)
    left = estimates - design @ np.linalg.solve(information, design.T @ (weights * estimates))
    return float(np.sum(np.log(variances)) + np.linalg.slogdet(information)[1] + weights @ left**2)


def outliers(estimates: FloatArray, sds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How many standard deviations each estimate (tables,) lies from the bulk, and the distance that none of so many
    tables of one population exceeds, nominally but for one time in twenty.

    Median and median absolute deviation, so that those outside do not hide themselves; the bulk's own spread is what
    its scatter has beyond the typical `sd`. That is known as well as from `EFFICIENCY` times as many tables by an
    ordinary standard deviation, so that limits are Student's, with the degrees of freedom of a sum of a known and an
    estimated variance (Satterthwaite 1946, Biometrics Bull. 2, 110).

    A table that is known much better than most lies from their median as far as that errs: its variance is
    `pi s^2/(2 n)` for `n` of typical sd `s`, its covariance with one of them `s` times that one's sd over `n`.
    """
    count = len(estimates)
    centre = float(np.median(estimates))
    scatter = float(mad(estimates, scale="normal"))
    spread = max(0.0, scatter**2 - float(np.median(sds)) ** 2)
    whole = sds**2 + spread
    usual = float(np.median(np.sqrt(whole)))
    whole += np.maximum(0.0, 0.5 * np.pi * usual**2 - 2.0 * np.sqrt(whole) * usual) / count
    distance = np.divide(estimates - centre, np.sqrt(whole), out=np.zeros_like(estimates), where=whole > 0.0)
    share = np.divide(spread, whole, out=np.zeros_like(whole), where=whole > 0.0)
    freedom = np.minimum(EFFICIENCY * (count - 1) / np.maximum(share, 1e-3) ** 2, 1e6)
    return distance, np.asarray(t.isf(FALSE_OUTLIER / (2.0 * count), freedom))
