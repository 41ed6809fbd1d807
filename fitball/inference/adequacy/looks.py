"""Statistics of residuals, of many tables at once, each with a probability that is about right for one table.

About is enough: `family` holds the least of them all against what tables that the model made have.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, fdtr, fdtrc, gammaln, kolmogorov, ndtr, stdtr

from fitball.inference.adequacy.directions import LEAST_FREEDOM, WHOLE_TABLE, Direction, overlap
from fitball.inference.adequacy.refit import EVERY, Refit
from fitball.inference.results.evidence import FALSE_EXCEPT
from fitball.values import FloatArray

# Rows from which an order, a scatter, a correlation, a tail and a distribution can be looked at.
ORDERED, SCATTERED, LINKED, TAILED, DISTRIBUTED = 8, 10, 8, 20, 15
# What is looked for first has most of the chance of a false alarm: smooth trends and biases of groups, then what is
# less likely, then the shape of the noise.
TIERS = (
    (("trend", "row", "group", "jointly"), 0.35),
    (("drift", "level"), 0.15),
    (("bias", "uneven"), 0.1),
    (("spread",), 0.1),
    (("bend", "together", "regime"), 0.1),
    (("order", "scatter", "linked", "outlier", "tails", "loo-pit"), 0.2),
)
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
        words = f"they are biased in {over}" if over == WHOLE_TABLE else f"they depend on {over}"
        yield Look("jointly", EVERY, over, words, number, share, p)


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


def spreads(fit: Refit, known: Mapping[str, FloatArray], residual: FloatArray) -> Iterator[Look]:
    """Whether the noise of all columns grows or falls together: the likelihood ratio of one exponent by which all sds
    go with the speed, or as an exponential with the angle or the predicted size, as its signed root.
    """
    if fit.impacts < SCATTERED:
        return
    squares = standardised(fit, residual) ** 2
    rows = np.concatenate(fit.places)
    along = {name: np.log(column)[rows] for name, column in known.items() if name in SPEEDS}
    along |= {name: column[rows] for name, column in known.items() if name == "theta_1"}
    for number, (name, shape) in enumerate({**along, "predicted size": fit.predicted}.items()):
        means = np.bincount(fit.noise, shape) / np.bincount(fit.noise)
        centred = shape - means[fit.noise]
        if np.abs(centred).max() <= SPANNED:
            continue
        seen = _exponent(fit, squares, centred)
        yield Look("spread", EVERY, name, f"the noise changes with {name}", number, seen, 2.0 * ndtr(-np.abs(seen)))


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


def links(fit: Refit, residual: FloatArray) -> Iterator[Look]:
    """Whether two columns deviate together, as they do where the incident state is not what the table says."""
    for one, other in combinations(range(len(fit.columns)), 2):
        both = np.isin(fit.places[one], fit.places[other]), np.isin(fit.places[other], fit.places[one])
        if both[0].sum() >= LINKED:
            a, b = residual[:, fit.rows(one)][:, both[0]], residual[:, fit.rows(other)][:, both[1]]
            seen = np.sum(a * b, axis=1) / np.sqrt(np.sum(a * a, axis=1) * np.sum(b * b, axis=1))
            words = f"it deviates together with {fit.columns[other]}"
            yield _scored("linked", one, fit.columns[other], words, seen)


def uneven(fit: Refit, residual: FloatArray) -> Iterator[Look]:
    """Whether a column scatters more than another that shares its noise: the ratio of their variances (Fisher's F),
    in logarithms.
    """
    freedom = np.array([np.sum(1.0 - fit.leverage[fit.rows(column)]) for column in range(len(fit.columns))])
    for one, other in combinations(range(len(fit.columns)), 2):
        if fit.noise_of(one) == fit.noise_of(other) and min(freedom[one], freedom[other]) > 1.0:
            sizes = [np.sum(residual[:, fit.rows(k)] ** 2, axis=1) / freedom[k] for k in (one, other)]
            ratio = sizes[0] / sizes[1]
            tails = [tail(freedom[one], freedom[other], ratio) for tail in (fdtr, fdtrc)]
            p = 2.0 * np.minimum(*tails)
            words = f"its scatter is not that of {fit.columns[other]}, which shares its noise"
            yield Look("uneven", one, fit.columns[other], words, one, np.log(ratio), p)


def outliers(fit: Refit, residual: FloatArray) -> Iterator[Look]:
    """The largest residual of each column, and how heavy the tails are."""
    studentised = standardised(fit, residual)
    for column in range(len(fit.columns)):
        own = studentised[:, fit.rows(column)]
        freedom = fit.freedom[fit.noise_of(column)]
        if freedom <= LEAST_FREEDOM:
            continue
        _count, p = farthest(own, freedom)
        words = "single impacts lie far off"
        yield Look("outlier", column, "impacts", words, column, -np.log10(p), p)
        if own.shape[1] >= TAILED:
            z = kurtosis_score(studentised[:, fit.rows(column)])
            yield Look("tails", column, "impacts", "the tails are heavy", column, z, np.asarray(ndtr(-z)))


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
