"""Test statistics of residuals, of the data and of many simulated data sets, each with a probability that is about
right for a single one; about is enough: `family` compares the least of them all with those of the simulated sets.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, fdtr, fdtrc, gammaln, kolmogorov, ndtr, stdtr

from fitball.inference.adequacy.refit import (
    EVERY,
    LEAST_FREEDOM,
    WHOLE_TABLE,
    Pattern,
    Refit,
    covariates,
    overlap,
)
from fitball.inference.problem.problem import Problem
from fitball.inference.results import sentences
from fitball.inference.results.evidence import FALSE_EXCEPT
from fitball.values import FloatArray

# Rows from which an order, a scatter, a correlation, a tail and a distribution can be looked at.
ORDERED, SCATTERED, LINKED, TAILED, DISTRIBUTED = 8, 10, 8, 20, 15


@dataclass(frozen=True)
class Kind:
    """A kind of check: the `tier` that it shares the chance of a false alarm with, and how its statistic falls with
    rows, of a table that means nothing: as this power of their number. `smooth` patterns count as the model's own,
    where a group may be biased for reasons of its own. `scored` ones get their probability from simulated data sets
    only, `shaped` ones where the noise has a shape of its own.
    """

    tier: int
    falls: float = 1.0
    smooth: bool = False
    scored: bool = False
    shaped: bool = False


# What is looked for first has most of the chance of a false alarm: smooth trends and biases of groups, then what is
# less likely, then the shape of the noise.
TIERS = (0.35, 0.15, 0.1, 0.1, 0.1, 0.2)
KINDS: Mapping[str, Kind] = {
    "trend": Kind(0, smooth=True),
    "row": Kind(0, smooth=True),
    "group": Kind(0),
    "jointly": Kind(0),
    "drift": Kind(1, smooth=True),
    "level": Kind(1),
    "bias": Kind(2, smooth=True),
    "uneven": Kind(2, falls=0.5),
    "spread": Kind(3, falls=0.0),
    "bend": Kind(4, smooth=True),
    "together": Kind(4, smooth=True),
    "regime": Kind(4, smooth=True),
    "order": Kind(5, falls=0.5, scored=True),
    "scatter": Kind(5, falls=0.5, scored=True),
    "linked": Kind(5, falls=0.5, scored=True),
    "outlier": Kind(5, falls=0.0, shaped=True),
    "tails": Kind(5, falls=0.0, shaped=True),
    "loo-pit": Kind(5),
}
# A share of a column's residuals, one in so many, and a number up to which they may lie far off together.
FEWER, MOST_FAR = 6, 20
# Covariates with which a noise may grow as a power, and the Newton steps that find it, each so long at most.
SPEEDS, NEWTON, LONGEST = ("v_1", "v_y1"), 8, 1.0
# The tail at which checks are made comparable, and a probability below which none differ.
TAIL, SMALLEST = 0.05, 1e-300
# A share of all variance, as a pattern that leaks from another column may explain it, ends below one.
WHOLE = 1.0 - 1e-12
# A share of the largest below which a direction that patterns span is rounding, as is what differs by less.
SPANNED = 1e-9


@dataclass(frozen=True)
class Look:
    """One check: its `kind`, the column's number, `over` what, in `words`. `seen` (tables,) is its statistic, `p`
    (tables,) the probability of as much, the observed table first; of a pattern `found` is that.
    """

    kind: str
    column: int
    over: str
    words: str
    seen: FloatArray
    p: FloatArray
    found: Pattern | None = None

    @property
    def key(self) -> tuple[str, int, str, str]:
        """What is looked for."""
        return self.kind, self.column, self.over, self.words


@dataclass(frozen=True)
class Tables:
    """Residuals (tables, measurements) of tables that are fitted alike, the observed one first."""

    fit: Refit
    residual: FloatArray

    @cached_property
    def even(self) -> FloatArray:
        """In units of the noise that they show, (tables, measurements)."""
        return np.asarray(self.residual / self.fit.scales(self.residual)[:, self.fit.noise])

    @cached_property
    def taken(self) -> FloatArray:
        """What the basis has of these, (tables, rank)."""
        return np.asarray(self.even @ self.fit.own)

    @cached_property
    def standardised(self) -> FloatArray:
        """Over their standard deviations, (tables, measurements)."""
        return np.asarray(self.even / np.sqrt(np.maximum(1.0 - self.fit.leverage, 1.0 - WHOLE)))

    def along(self, found: Pattern) -> FloatArray:
        """How much of a pattern is in each, (tables,)."""
        return found.along(self.fit, self.even, self.taken)

    def spanned(self, mine: Sequence[Pattern]) -> tuple[FloatArray, int]:
        """The squared length (tables,) of what patterns together have of them; and in how many directions these
        patterns differ.
        """
        products = np.array([[overlap(self.fit, one, other) for other in mine] for one in mine])
        sizes, axes = np.linalg.eigh(products)
        kept = sizes > SPANNED * sizes[-1]
        along = np.stack([self.along(item) for item in mine], axis=1)
        return np.sum((along @ axes[:, kept]) ** 2 / sizes[kept], axis=1), int(kept.sum())


def single(tables: Tables, found: Sequence[Pattern]) -> Iterator[Look]:
    """Trends and biases: the share of the residual variance that each explains, with its sign."""
    fit = tables.fit
    for item in found:
        # A refit spreads a pattern over columns, whose noises are known to different degrees (Satterthwaite 1946).
        parts = np.bincount(fit.noise, item.left(fit) ** 2, len(fit.noises))
        freedom = float(1.0 / np.sum(parts**2 / fit.freedom))
        z = tables.along(item)
        share = np.minimum(z**2 / freedom, WHOLE)
        ratio = np.sqrt(share * (freedom - 1.0) / (1.0 - share))
        p = 2.0 * np.asarray(stdtr(freedom - 1.0, -ratio), dtype=np.float64)
        yield Look(item.kind, item.column, item.over, item.words, np.copysign(share, z), p, item)


def together(tables: Tables, found: Sequence[Pattern]) -> Iterator[Look]:
    """All patterns over one quantity, or of one kind of groups, in all columns at once: their common share."""
    freedom = float(tables.fit.freedom.sum())
    for over in dict.fromkeys(item.over for item in found):
        mine = [item for item in found if item.over == over]
        if not 2 <= len(mine) < freedom - 2.0:
            continue
        square, _rank = tables.spanned(mine)
        share = np.minimum(square / freedom, WHOLE)
        ratio = share / len(mine) * (freedom - len(mine)) / (1.0 - share)
        p = np.asarray(fdtrc(len(mine), freedom - len(mine), ratio), dtype=np.float64)
        biased = over == WHOLE_TABLE
        words = sentences.ALL_BIASED.format(rows=over) if biased else sentences.ALL_DEPEND.format(quantity=over)
        yield Look("jointly", EVERY, over, words, share, p)


def along_covariates(tables: Tables, known: Mapping[str, FloatArray]) -> Iterator[Look]:
    """Whether neighbours along each covariate deviate alike, by the correlation of one residual with the next; and
    whether residuals scatter more at one end of it, by one with their sizes.
    """
    fit, sizes = tables.fit, np.abs(tables.standardised)
    for column, places in enumerate(fit.places):
        rows = fit.rows(column)
        for name, whole in known.items():
            along = whole[places]
            if np.unique(along).size >= max(ORDERED, along.size // 2):
                own = tables.residual[:, rows][:, np.argsort(along, kind="stable")]
                seen = np.sum(own[:, 1:] * own[:, :-1], axis=1) / np.sum(own**2, axis=1)
                words = sentences.NEIGHBOURS.format(quantity=name)
                yield _scored("order", column, name, words, seen, sides=1)
            if along.size >= SCATTERED and np.ptp(along) > 0.0:
                size = sizes[:, rows] - sizes[:, rows].mean(axis=1, keepdims=True)
                centred = (along - along.mean()) / np.linalg.norm(along - along.mean())
                seen = size @ centred / np.linalg.norm(size, axis=1)
                yield _scored("scatter", column, name, sentences.SCATTER.format(quantity=name), seen)


def spreads(tables: Tables, known: Mapping[str, FloatArray]) -> Iterator[Look]:
    """Whether the noise of all columns grows or falls together: the likelihood ratio of one exponent by which all sds
    go with the speed, or as an exponential with the angle or the predicted size, as its signed root.
    """
    fit = tables.fit
    if fit.impacts < SCATTERED:
        return
    squares = tables.standardised**2
    rows = np.concatenate(fit.places)
    along = {name: np.log(column)[rows] for name, column in known.items() if name in SPEEDS}
    along |= {name: column[rows] for name, column in known.items() if name == "theta_1"}
    for name, shape in {**along, "predicted size": fit.predicted}.items():
        means = np.bincount(fit.noise, shape) / np.bincount(fit.noise)
        centred = shape - means[fit.noise]
        if np.abs(centred).max() <= SPANNED:
            continue
        seen = _exponent(fit, squares, centred)
        words = sentences.SPREAD.format(quantity=name)
        yield Look("spread", EVERY, name, words, seen, 2.0 * ndtr(-np.abs(seen)))


def _exponent(fit: Refit, squares: FloatArray, along: FloatArray) -> FloatArray:
    """Signed roots (tables,) of the likelihood ratio of noises that go as `exp(p along)` to constant ones; `along`
    (measurements,) has no mean in any noise.
    """
    groups = [np.flatnonzero(fit.noise == number) for number in range(len(fit.noises))]
    shapes = [along[mine] for mine in groups]
    parts = [squares[:, mine] for mine in groups]
    p, gain = np.zeros(len(squares)), np.zeros(len(squares))
    for turn in range(NEWTON + 1):
        value, slope, curve = np.zeros((3, len(squares)))
        for own, shape, freedom in zip(parts, shapes, fit.freedom, strict=True):
            weight = own * np.exp(-2.0 * p[:, None] * shape)
            whole = weight.sum(axis=1)
            mean = weight @ shape / whole
            value -= 0.5 * freedom * np.log(whole)
            slope += freedom * mean
            curve += 2.0 * freedom * (weight @ shape**2 / whole - mean**2)
        if turn == 0:
            gain = -value
        if turn < NEWTON:
            step = slope / curve
            p += np.clip(step, -LONGEST, LONGEST)
    return np.asarray(np.sign(p) * np.sqrt(2.0 * np.maximum(value + gain, 0.0)))


def links(tables: Tables) -> Iterator[Look]:
    """Whether two columns deviate together, as they do where the incident state differs from the one in the table."""
    fit, residual = tables.fit, tables.residual
    for one, other in combinations(range(len(fit.columns)), 2):
        both = np.isin(fit.places[one], fit.places[other]), np.isin(fit.places[other], fit.places[one])
        if both[0].sum() >= LINKED:
            a, b = residual[:, fit.rows(one)][:, both[0]], residual[:, fit.rows(other)][:, both[1]]
            seen = np.sum(a * b, axis=1) / np.sqrt(np.sum(a * a, axis=1) * np.sum(b * b, axis=1))
            words = sentences.LINKED.format(column=fit.columns[other])
            yield _scored("linked", one, fit.columns[other], words, seen)


def uneven(tables: Tables) -> Iterator[Look]:
    """Whether a column scatters more than another that shares its noise: the ratio of their variances (Fisher's F),
    in logarithms.
    """
    fit, residual = tables.fit, tables.residual
    freedom = np.array([np.sum(1.0 - fit.leverage[fit.rows(column)]) for column in range(len(fit.columns))])
    for one, other in combinations(range(len(fit.columns)), 2):
        if fit.noise_of(one) == fit.noise_of(other) and min(freedom[one], freedom[other]) > 1.0:
            sizes = [np.sum(residual[:, fit.rows(k)] ** 2, axis=1) / freedom[k] for k in (one, other)]
            ratio = sizes[0] / sizes[1]
            tails = [tail(freedom[one], freedom[other], ratio) for tail in (fdtr, fdtrc)]
            p = 2.0 * np.minimum(*tails)
            words = sentences.UNEVEN.format(column=fit.columns[other])
            yield Look("uneven", one, fit.columns[other], words, np.log(ratio), p)


def outliers(tables: Tables) -> Iterator[Look]:
    """The largest residual of each column, and how heavy the tails are."""
    fit = tables.fit
    for column in range(len(fit.columns)):
        own, freedom = tables.standardised[:, fit.rows(column)], fit.freedom[fit.noise_of(column)]
        if freedom <= LEAST_FREEDOM:
            continue
        _count, p = farthest(own, freedom)
        yield Look("outlier", column, "impacts", sentences.OUTLIERS, -np.log10(p), p)
        if own.shape[1] >= TAILED:
            z = kurtosis_score(own)
            yield Look("tails", column, "impacts", sentences.TAILS, z, np.asarray(ndtr(-z)))


def farthest(studentised: FloatArray, freedom: float) -> tuple[NDArray[np.int64], FloatArray]:
    """How many (tables,) of a column's residuals (tables, n) lie farthest off together, and how probable that is:
    the least bound, over their number, on the probability that any so many have as large a share of the variance.

    Looked at together they do not hide each other behind the noise that they make (Rosner 1983).
    """
    count = studentised.shape[1]
    most = int(np.clip(count // FEWER, 1, min(MOST_FAR, freedom - 1.0)))
    largest = -np.partition(-(studentised**2), range(most), axis=1)[:, :most]
    share = np.minimum(np.cumsum(largest, axis=1) / freedom, WHOLE)
    k = np.arange(1, most + 1)
    ways = gammaln(count + 1) - gammaln(k + 1) - gammaln(count - k + 1)
    logs = ways + np.log(np.maximum(betainc(0.5 * (freedom - k), 0.5 * k, 1.0 - share), SMALLEST))
    best = np.argmin(logs, axis=1)
    return best + 1, np.exp(np.minimum(logs[np.arange(len(logs)), best], 0.0))


def distributions(tables: Tables, left_out: FloatArray | None) -> Iterator[Look]:
    """Whether the probability that a measurement exceeds what all others predict is uniform: its largest distance
    from that. Of simulated data sets to first order, where a deleted residual has Student's distribution (Cook and
    Weisberg 1982); of the observed one as in `left_out` (columns, impacts), if there is that.
    """
    fit = tables.fit
    for column in range(len(fit.columns)):
        own, freedom = tables.standardised[:, fit.rows(column)], fit.freedom[fit.noise_of(column)]
        count = own.shape[1]
        if count < DISTRIBUTED or freedom <= LEAST_FREEDOM:
            continue
        # Each left out of its own noise.
        square = np.minimum(own**2, WHOLE * freedom)
        deleted = np.sqrt(square * (freedom - 1.0) / (freedom - square))
        uniform = np.asarray(stdtr(freedom - 1.0, np.copysign(deleted, own)))
        if left_out is not None:
            uniform[0] = left_out[column][fit.places[column]]
        ordered = np.sort(uniform, axis=1)
        # Stephens (1970): the limiting distribution holds for few numbers as well.
        stretched = count**0.5 + 0.12 + 0.11 / count**0.5
        step = np.arange(count + 1) / count
        seen = np.maximum((step[1:] - ordered).max(axis=1), (ordered - step[:-1]).max(axis=1))
        yield Look("loo-pit", column, "all impacts", sentences.LOO_PIT, seen, kolmogorov(seen * stretched))


def _scored(kind: str, column: int, over: str, words: str, seen: FloatArray, sides: int = 2) -> Look:
    """A check whose probability is that of a normal number, with the mean and sd of the simulated ones; of the
    table alone there is none.
    """
    p = scored(seen, seen[1:], sides) if seen.size > 1 else np.full(1, np.nan)
    return Look(kind, column, over, words, seen, p)


def scored(seen: FloatArray, simulated: FloatArray, sides: int, shorter: float = 1.0) -> FloatArray:
    """Probabilities of statistics `seen` (tables,) given those of `simulated` ones, a share `shorter` in rows."""
    z = (seen - shorter * simulated.mean()) / (shorter**0.5 * simulated.std())
    return np.asarray(ndtr(-z) if sides == 1 else 2.0 * ndtr(-np.abs(z)))


def family(looks: Sequence[Look]) -> tuple[FloatArray, FloatArray]:
    """Of each check the probability that a table of the model shows as much in any of them (looks,), and the level
    of each check (looks,) at which that is `FALSE_EXCEPT`.

    The least of all probabilities is compared with the least of each simulated data set (Westfall and Young 1993),
    each counted by the weight of its kind, which the checks of a kind share (Genovese, Roeder and Wasserman 2006).
    """
    tiers = [KINDS[look.kind].tier for look in looks]
    weight = np.array([TIERS[tier] / tiers.count(tier) for tier in tiers])
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


def looks_of(problem: Problem, tables: Tables, found: Sequence[Pattern]) -> list[Look]:
    """All checks but that of the distribution."""
    if not np.all(tables.fit.freedom > 1.0):
        return []
    known = covariates(problem)
    return [
        *single(tables, found),
        *together(tables, found),
        *sorted(along_covariates(tables, known), key=lambda look: look.kind),
        *spreads(tables, known),
        *links(tables),
        *uneven(tables),
        *outliers(tables),
    ]
