"""Statistics of residuals, of many tables at once, each with a probability that is about right for one table.

About is enough: `family` holds the least of them all against what tables that the model made have.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import fdtrc, kolmogorov, ndtr, stdtr

from fitball.inference.adequacy.directions import LEAST_FREEDOM, Direction, overlap
from fitball.inference.adequacy.refit import Refit
from fitball.inference.results.adequacy import FALSE_EXCEPT
from fitball.values import FloatArray

# Rows from which an order, a scatter, a correlation, a tail and a distribution can be looked at.
ORDERED, SCATTERED, LINKED, TAILED, DISTRIBUTED = 8, 10, 8, 20, 15
# What is looked for first has most of the chance of a false alarm: smooth trends and biases of groups, then what is
# less likely, then the shape of the noise.
TIERS = (
    (("trend", "group", "jointly"), 0.5),
    (("bend", "together", "regime"), 0.25),
    (("order", "scatter", "linked", "outlier", "tails", "loo-pit"), 0.25),
)
# The tail at which checks are made comparable, and a probability below which none differ.
TAIL, SMALLEST = 0.05, 1e-300
# A share of all variance, as a pattern that leaks from another column may explain it, ends below one.
WHOLE = 1.0 - 1e-12
# A share of the largest below which a direction that patterns span is rounding.
SPANNED = 1e-9


@dataclass(frozen=True)
class Look:
    """One check: its `kind`, the column's number, `over` what, in `words`; `number` is its place among those of its
    kind. `seen` (tables,) is its statistic, `p` (tables,) the probability of as much, the observed table first.
    """

    kind: str
    column: int
    over: str
    words: str
    number: int
    seen: FloatArray
    p: FloatArray


def patterns(fit: Refit, found: Sequence[Direction], residual: FloatArray) -> Iterator[Look]:
    """Trends and biases: the share of the residual variance that each explains, with its sign."""
    even = residual / fit.scales(residual)[:, fit.noise]
    taken = even @ fit.own
    for number, direction in enumerate(found):
        # A refit spreads a pattern over columns, whose noises are known to different degrees (Satterthwaite 1946).
        parts = np.bincount(fit.noise, direction.left(fit) ** 2, len(fit.noises))
        freedom = float(1.0 / np.sum(parts**2 / fit.freedom))
        z = direction.along(fit, even, taken)
        share = np.minimum(z**2 / freedom, WHOLE)
        ratio = np.sqrt(share * (freedom - 1.0) / (1.0 - share))
        p = 2.0 * np.asarray(stdtr(freedom - 1.0, -ratio), dtype=np.float64)
        about = direction.kind, direction.column, direction.over, direction.words
        yield Look(*about, number, np.copysign(share, z), p)


def together(fit: Refit, found: Sequence[Direction], residual: FloatArray) -> Iterator[Look]:
    """All patterns over one quantity, or of one kind of groups, in all columns at once: their common share."""
    even = residual / fit.scales(residual)[:, fit.noise]
    taken = even @ fit.own
    freedom = float(fit.freedom.sum())
    for number, over in enumerate(dict.fromkeys(direction.over for direction in found)):
        mine = [k for k, direction in enumerate(found) if direction.over == over]
        if not 2 <= len(mine) < freedom - 2.0:
            continue
        square, _rank = spanned(fit, [found[k] for k in mine], even, taken)
        share = np.minimum(square / freedom, WHOLE)
        ratio = share / len(mine) * (freedom - len(mine)) / (1.0 - share)
        p = np.asarray(fdtrc(len(mine), freedom - len(mine), ratio), dtype=np.float64)
        yield Look("jointly", -1, over, f"they depend on {over}", number, share, p)


def spanned(fit: Refit, mine: Sequence[Direction], even: FloatArray, taken: FloatArray) -> tuple[FloatArray, int]:
    """The squared length (tables,) of what patterns together have of residuals (tables, measurements), of which the
    basis has `taken` (tables, rank); and in how many directions these patterns differ.
    """
    products = np.array([[overlap(fit, one, other) for other in mine] for one in mine])
    sizes, axes = np.linalg.eigh(products)
    kept = sizes > SPANNED * sizes[-1]
    along = np.stack([item.along(fit, even, taken) for item in mine], axis=1)
    return np.sum((along @ axes[:, kept]) ** 2 / sizes[kept], axis=1), int(kept.sum())


def orders(fit: Refit, known: Mapping[str, FloatArray], residual: FloatArray) -> Iterator[Look]:
    """Whether neighbours along each covariate deviate alike: the correlation of one residual with the next."""
    for column, name, along in _measured_along(fit, known):
        if np.unique(along).size >= max(ORDERED, along.size // 2):
            own = residual[:, fit.rows(column)][:, np.argsort(along, kind="stable")]
            seen = np.sum(own[:, 1:] * own[:, :-1], axis=1) / np.sum(own**2, axis=1)
            yield _scored("order", column, name, f"neighbours along {name} deviate alike", seen, sides=1)


def _measured_along(fit: Refit, known: Mapping[str, FloatArray]) -> Iterator[tuple[int, str, FloatArray]]:
    """Each column with each covariate, by name, where the column was measured (measurements,)."""
    for column, places in enumerate(fit.places):
        for name, along in known.items():
            yield column, name, along[places]


def scatters(fit: Refit, known: Mapping[str, FloatArray], residual: FloatArray) -> Iterator[Look]:
    """Whether residuals scatter more at one end of each covariate: a correlation of their sizes."""
    sizes = np.abs(standardised(fit, residual))
    for column, name, along in _measured_along(fit, known):
        if along.size < SCATTERED or np.ptp(along) <= 0.0:
            continue
        size = sizes[:, fit.rows(column)]
        size = size - size.mean(axis=1, keepdims=True)
        length = np.linalg.norm(size, axis=1)
        centred = (along - along.mean()) / np.linalg.norm(along - along.mean())
        yield _scored("scatter", column, name, f"scatter that changes with {name}", size @ centred / length)


def links(fit: Refit, residual: FloatArray) -> Iterator[Look]:
    """Whether two columns deviate together, as they do where the incident state is not what the table says."""
    for one, other in combinations(range(len(fit.columns)), 2):
        both = np.isin(fit.places[one], fit.places[other]), np.isin(fit.places[other], fit.places[one])
        if both[0].sum() >= LINKED:
            a, b = residual[:, fit.rows(one)][:, both[0]], residual[:, fit.rows(other)][:, both[1]]
            seen = np.sum(a * b, axis=1) / np.sqrt(np.sum(a * a, axis=1) * np.sum(b * b, axis=1))
            words = f"it deviates together with {fit.columns[other]}"
            yield _scored("linked", one, fit.columns[other], words, seen)


def outliers(fit: Refit, residual: FloatArray) -> Iterator[Look]:
    """The largest residual of each column, and how heavy the tails are."""
    studentised = standardised(fit, residual)
    for column in range(len(fit.columns)):
        own = np.abs(studentised[:, fit.rows(column)])
        freedom = fit.freedom[fit.noise_of(column)]
        if freedom <= LEAST_FREEDOM:
            continue
        p = 2.0 * stdtr(freedom - 1.0, -_deleted(own.max(axis=1), freedom))
        any_of_all = -np.expm1(own.shape[1] * np.log1p(-p))
        words = "single impacts lie far off"
        yield Look("outlier", column, "impacts", words, column, own.max(axis=1), any_of_all)
        if own.shape[1] >= TAILED:
            z = kurtosis_score(studentised[:, fit.rows(column)])
            yield Look("tails", column, "impacts", "the tails are heavy", column, z, np.asarray(ndtr(-z)))


def distributions(fit: Refit, residual: FloatArray, left_out: FloatArray | None) -> Iterator[Look]:
    """Whether the probability that a measurement exceeds what all others predict is uniform: its largest distance
    from that. Of the made tables to first order, where a deleted residual has Student's distribution (Cook and
    Weisberg 1982); of the observed one as in `left_out` (columns, impacts), if there is that.
    """
    studentised = standardised(fit, residual)
    for column in range(len(fit.columns)):
        freedom = fit.freedom[fit.noise_of(column)]
        own = studentised[:, fit.rows(column)]
        count = own.shape[1]
        if count < DISTRIBUTED or freedom <= LEAST_FREEDOM:
            continue
        uniform = np.asarray(stdtr(freedom - 1.0, np.copysign(_deleted(np.abs(own), freedom), own)))
        if left_out is not None:
            uniform[0] = left_out[column][fit.places[column]]
        ordered = np.sort(uniform, axis=1)
        # Stephens (1970): the limiting distribution holds for few numbers as well.
        stretched = count**0.5 + 0.12 + 0.11 / count**0.5
        step = np.arange(count + 1) / count
        seen = np.maximum((step[1:] - ordered).max(axis=1), (ordered - step[:-1]).max(axis=1))
        words = "predictions from the other impacts are too wide, too narrow or off"
        yield Look("loo-pit", column, "all impacts", words, column, seen, kolmogorov(seen * stretched))


def standardised(fit: Refit, residual: FloatArray) -> FloatArray:
    """Residuals (tables, measurements) over their standard deviations."""
    spread = fit.scales(residual)[:, fit.noise] * np.sqrt(np.maximum(1.0 - fit.leverage, 1.0 - WHOLE))
    return np.asarray(residual / spread)


def _deleted(size: FloatArray, freedom: float) -> FloatArray:
    """Sizes of standardised residuals, each left out of its own noise."""
    square = np.minimum(size**2, WHOLE * freedom)
    return np.asarray(np.sqrt(square * (freedom - 1.0) / (freedom - square)), dtype=np.float64)


def _scored(kind: str, column: int, over: str, words: str, seen: FloatArray, sides: int = 2) -> Look:
    """A check whose probability is that of a normal number, as centred and wide as the made tables have it; of the
    table alone there is none.
    """
    p = scored(seen, seen[1:], sides) if seen.size > 1 else np.full(1, np.nan)
    return Look(kind, column, over, words, column, seen, p)


def scored(seen: FloatArray, made: FloatArray, sides: int, shorter: float = 1.0) -> FloatArray:
    """Probabilities of statistics `seen` (tables,) as `made` tables have them, whose rows are a share `shorter`."""
    z = (seen - shorter * made.mean()) / (shorter**0.5 * made.std())
    return np.asarray(ndtr(-z) if sides == 1 else 2.0 * ndtr(-np.abs(z)))


def family(looks: Sequence[Look]) -> tuple[FloatArray, FloatArray]:
    """Of each check the probability that a table of the model shows as much in any of them (looks,), and the level
    of each check (looks,) at which that is `FALSE_EXCEPT`.

    The least of all probabilities is held against the least of each made table (Westfall and Young 1993), each
    counted by the weight of its kind, which the checks of a kind share (Genovese, Roeder and Wasserman 2006).
    """
    kinds = [next(number for number, (kinds, _) in enumerate(TIERS) if look.kind in kinds) for look in looks]
    weight = np.array([TIERS[kind][1] / kinds.count(kind) for kind in kinds])
    logs = np.log(np.maximum(np.stack([look.p for look in looks]), SMALLEST))
    # Probabilities are about right; that one made table in 20 has less than 1/20 makes checks comparable.
    power = np.log(TAIL) / np.quantile(logs[:, 1:], TAIL, axis=1)
    weighted = np.exp(power[:, None] * logs) / weight[:, None]
    least = np.sort(weighted[:, 1:].min(axis=0))
    p = (1.0 + np.searchsorted(least, weighted[:, 0], side="right")) / (1.0 + least.size)
    level = np.minimum(np.quantile(least, FALSE_EXCEPT) * weight, 1.0)
    return p, level ** (1.0 / power)


def kurtosis_score(samples: FloatArray) -> FloatArray:
    """Standard normal scores (samples,) of the kurtosis of rows (samples, n), `n` at least 20; NaN for equal ones."""
    n = float(samples.shape[1])
    centred = samples - samples.mean(axis=1, keepdims=True)
    squares = centred**2
    with np.errstate(invalid="ignore"):
        b2 = np.mean(squares**2, axis=1) / np.mean(squares, axis=1) ** 2
    mean = 3.0 * (n - 1.0) / (n + 1.0)
    variance = 24.0 * n * (n - 2.0) * (n - 3.0) / ((n + 1.0) ** 2 * (n + 3.0) * (n + 5.0))
    x = (b2 - mean) / np.sqrt(variance)
    skewness = 6.0 * (n * n - 5.0 * n + 2.0) / ((n + 7.0) * (n + 9.0))
    skewness *= np.sqrt(6.0 * (n + 3.0) * (n + 5.0) / (n * (n - 2.0) * (n - 3.0)))
    # Degrees of freedom of the chi-square distribution with the same first three moments.
    a = 6.0 + 8.0 / skewness * (2.0 / skewness + np.sqrt(1.0 + 4.0 / skewness**2))
    ratio = (1.0 - 2.0 / a) / (1.0 + x * np.sqrt(2.0 / (a - 4.0)))
    return np.asarray((1.0 - 2.0 / (9.0 * a) - np.cbrt(ratio)) / np.sqrt(2.0 / (9.0 * a)))
