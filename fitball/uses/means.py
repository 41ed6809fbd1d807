"""Means of values that differ between groups, weighted by their stated errors.

A value is that of its group, on a line in x, with an error of variance tau^2 + s^2: s is stated,
zero where nothing is, tau the scatter beyond it. With weights 1/(tau^2 + s^2) the error of a mean
is scaled by the rms of weighted residuals, and Student's t of their degrees of freedom holds
(Hartung and Knapp 2001, Stat. Med. 20, 1771). Where all stated errors are equal, or none is stated,
that is exact.

The scatter is that of largest restricted likelihood times a gamma density of shape 3/2, which keeps
it off zero (Chung et al. 2013, Stat. Med. 32, 4071): weights of stated errors alone trust the
smallest of them too far.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.prior_families import Prior
from fitball.base.values import FloatArray, IntArray
from fitball.inference.effort import PREDICTION_DRAWS
from fitball.uses.hierarchy import DRAWS_OF_EACH, hierarchy, limited, measured_group

# Repeats, beyond one a group, by which groups are known from noise.
REPEATS = 2
# Share of a value below which repeats agree to the digits that they are written with.
NEGLIGIBLE = 1e-9
# Values of the noise over which the means of groups with repeats are averaged.
_NOISES = 10
# Scatters beyond stated errors that are tried, before the best is looked for between its
# neighbours.
_SCATTERS = 48
# The largest scatter that is tried, over the rms residual without weights.
_LARGEST_SCATTER = 4.0
# The smallest scatter that is tried, over the smallest stated error: less adds nothing to it.
_SMALLEST_SCATTER = 1e-2
# Shape of the gamma density of the scatter, less one. At one half intervals hold in simulations,
# with scatter and without: at zero they are too short with, at one too long without.
_SHAPE = 0.5


class Means(NamedTuple):
    """A `point` and draws of the mean of all groups; draws of `another` group, and of `each` group;
    `levels` of the groups by least squares. Variance components: draws of the sd `between` groups,
    and of the sd of `repeats`; `by_chance` the probability that groups which are alike differ as
    much (F test). No draws where nothing is known of the noise, or there are no groups; NaN where
    there are no repeats.
    """

    point: float
    mean: Annotated[FloatArray, "draws"]
    another: Annotated[FloatArray, "draws_of_another"]
    each: Annotated[FloatArray, "groups group_draws"]
    levels: Annotated[FloatArray, "groups"]
    between: Annotated[FloatArray, "draws_of_spread"]
    repeats: Annotated[FloatArray, "draws_of_noise"]
    by_chance: float

    def within(self, low: float, high: float, rng: np.random.Generator) -> Means:
        """The same, given that all groups lie between these ends: draws that do not are replaced by
        others that do.
        """
        each = [limited(draws, low, high, rng) for draws in self.each]
        return self._replace(
            mean=limited(self.mean, low, high, rng),
            another=limited(self.another, low, high, rng),
            each=np.array(each) if each else self.each,
        )


class _Values(NamedTuple):
    """Values with the number of their `group`, a place `x`, and a stated error `sd`, zero where
    none is stated; each is (rows,).
    """

    y: FloatArray
    group: IntArray
    x: FloatArray
    sd: FloatArray

    @property
    def stated(self) -> bool:
        """Whether every value has a stated error."""
        return bool(np.all(self.sd > 0.0))

    def as_one_group(self) -> _Values:
        """The same values, all of one group."""
        return self._replace(group=np.zeros(len(self.y), np.int64))


class _Line(NamedTuple):
    """Values on a line in x, of one slope, that differ between groups: by weighted least squares
    `levels` (groups,) of the groups where x is zero, their `mean_x` (groups,) and `weight`
    (groups,), that of one value being at most `largest`; `squares` of x about these, infinite where
    it does not vary; the rms `sd` of weighted residuals, by which errors are scaled, and its
    degrees of `freedom`; the `scatter` beyond stated errors, before it is scaled.
    """

    levels: FloatArray
    mean_x: FloatArray
    weight: FloatArray
    largest: float
    squares: float
    sd: float
    freedom: int
    scatter: float

    @property
    def noiseless(self) -> bool:
        """Whether the values agree to the digits that they are written with."""
        size = abs(float(self.weight @ self.levels)) / self.weight.sum()
        return not self.sd / np.sqrt(self.largest) > NEGLIGIBLE * size


def means(
    values: Annotated[FloatArray, "rows"],
    group: Annotated[IntArray, "rows"],
    spread: Prior,
    rng: np.random.Generator,
    x: Annotated[FloatArray, "rows"],
    sd: Annotated[FloatArray, "rows"] | None = None,
) -> Means:
    """The mean, where `x` is zero, of values that lie on a line in x and differ between groups and
    by noise, of which `sd` is stated. With repeats groups are a hierarchy with the prior `spread`,
    about the pooled noise of these, which is at least as stated, and no better known than by its
    degrees of freedom; else Student's t holds of all values.
    """
    measured = _Values(values, group, x, np.zeros(len(values)) if sd is None else sd)
    if not group.any():
        return _students_means(measured, rng, several=False)
    line = _fitted(measured)
    if line.freedom < REPEATS or line.noiseless:
        pooled = _students_means(measured.as_one_group(), rng, several=True)
        # The scatter of groups, with that of the one value of each.
        between = _noises(_plain(measured.as_one_group())) if pooled.mean.size else pooled.mean
        return pooled._replace(levels=line.levels, between=between)
    noises = _noises(line)
    if measured.stated:
        noises = np.maximum(noises, 1.0)
    parts = [_hierarchy_means(line, noise, spread, rng) for noise in noises.tolist()]
    centre = np.concatenate([part.mean for part in parts])
    return Means(
        point=float(np.median(centre)),
        mean=centre,
        another=np.concatenate([part.another for part in parts]),
        each=np.concatenate([part.each for part in parts], axis=1),
        levels=line.levels,
        between=np.concatenate([part.between for part in parts]),
        repeats=_noises(_plain(measured)),
        by_chance=_by_chance(measured),
    )


def _by_chance(measured: _Values) -> float:
    """The probability that groups which are alike differ as much as these: the F test of one line
    for all of them against a level for each, by the scatter of the plain values.
    """
    from scipy.special import fdtrc

    apart = _plain(measured)
    alike = _plain(measured.as_one_group())
    noise = apart.freedom * apart.sd**2
    more = max(alike.freedom * alike.sd**2 - noise, 0.0)
    groups = alike.freedom - apart.freedom
    if not noise > 0.0 or groups < 1:
        return np.nan
    return float(fdtrc(groups, apart.freedom, more / groups / apart.sd**2))


def _noises(line: _Line) -> FloatArray:
    """Evenly likely values of the noise of values of which the pooled sd is known: its variance is
    that of the sample times freedom over chi-square (Gelman et al. 2013, Bayesian Data Analysis,
    section 3.2).
    """
    from scipy.special import chdtri

    probabilities = (np.arange(_NOISES) + 0.5) / _NOISES
    return np.asarray(line.sd * np.sqrt(line.freedom / chdtri(line.freedom, probabilities)))


def _hierarchy_means(
    line: _Line,
    noise: float,
    spread: Prior,
    rng: np.random.Generator,
) -> Means:
    """Means of groups with repeats if their `noise` is this: one of _NOISES shares of the draws."""
    errors = noise / np.sqrt(line.weight)
    groups = [
        measured_group(value, error)
        for value, error in zip(line.levels.tolist(), errors.tolist(), strict=True)
    ]
    count = PREDICTION_DRAWS // _NOISES
    pooled = hierarchy(groups, spread, rng)
    # The error of the slope is one for all groups.
    error_of_slope = noise / np.sqrt(line.squares)
    shift = error_of_slope * line.mean_x.mean() * rng.standard_normal(count)
    of_each = DRAWS_OF_EACH // _NOISES
    return Means(
        point=float(np.median(pooled.centre)),
        mean=pooled.centre[:count] + shift,
        another=pooled.new[:count] + shift,
        each=pooled.each[:, :of_each] + shift[:of_each],
        levels=line.levels,
        between=pooled.spread[:count],
        repeats=np.array([noise]),
        by_chance=np.nan,
    )


def _students_means(measured: _Values, rng: np.random.Generator, several: bool) -> Means:
    """Means of values of one group by Student's t; another value, but for its stated error, where
    there are `several`. Values that agree in all digits have the errors that they state.
    """
    from scipy.special import ndtri, stdtrit

    no_draws = np.empty(0)
    no_groups = np.empty((0, 0))
    line = _fitted(measured)
    mean = float(line.levels[0])
    if line.freedom < 1 or (line.noiseless and not measured.stated):
        return Means(mean, no_draws, no_draws, no_groups, line.levels, no_draws, no_draws, np.nan)
    # Evenly spread: the interval is that of tables.
    probabilities = (rng.permutation(PREDICTION_DRAWS) + 0.5) / PREDICTION_DRAWS
    noise = line.sd
    away = stdtrit(line.freedom, probabilities)
    if line.noiseless:
        noise = 1.0
        away = ndtri(probabilities)
    error = noise * np.sqrt(1.0 / line.weight[0] + line.mean_x[0] ** 2 / line.squares)
    another = no_draws
    if several:
        another = mean + np.hypot(error, noise * line.scatter) * away
    # Without groups their spread is none of its own: it is that of the values.
    repeats = no_draws if several or line.noiseless else _noises(_plain(measured))
    draws = mean + error * away
    return Means(mean, draws, another, no_groups, line.levels, no_draws, repeats, np.nan)


def _fitted(measured: _Values) -> _Line:
    """The line of values with the weights of their stated errors and of the scatter beyond these;
    all weights are one where an error is not stated.
    """
    plain = _plain(measured)
    if not measured.stated or plain.freedom < 1:
        return plain
    smallest = _SMALLEST_SCATTER * float(measured.sd.min())
    largest = max(_LARGEST_SCATTER * plain.sd, 2.0 * smallest)
    scatters = np.geomspace(smallest, largest, _SCATTERS).tolist()
    best = int(np.argmax([_log_density(measured, scatter) for scatter in scatters]))
    low = scatters[max(best - 1, 0)]
    high = scatters[min(best + 1, _SCATTERS - 1)]
    scatter = _best_scatter(measured, low, high)
    return _line(measured, measured.sd**2 + scatter**2, scatter)


def _best_scatter(measured: _Values, low: float, high: float) -> float:
    """The most probable scatter between two."""
    from scipy.optimize import minimize_scalar

    def minus(scatter: float) -> float:
        return -_log_density(measured, scatter)

    optimum = minimize_scalar(minus, bounds=(low, high), method="bounded")
    return float(optimum.x)


def _log_density(measured: _Values, scatter: float) -> float:
    """The logarithm of the density of a scatter, up to a constant. With V the variances, X the
    groups and the slope, r the residuals, its restricted likelihood is the exponential of -(ln|V| +
    ln|X' V^-1 X| + r' V^-1 r)/2 (Patterson and Thompson 1971, Biometrika 58, 545).
    """
    variances = measured.sd**2 + scatter**2
    line = _line(measured, variances, scatter)
    terms = np.log(variances).sum() + np.log(line.weight).sum() + line.freedom * line.sd**2
    if np.isfinite(line.squares):
        terms += np.log(line.squares)
    return float(_SHAPE * np.log(scatter) - 0.5 * terms)


def _plain(measured: _Values) -> _Line:
    """The line of values that all weigh the same."""
    return _line(measured, np.ones(len(measured.y)), 1.0)


def _line(measured: _Values, variances: FloatArray, scatter: float) -> _Line:
    """The line of values with errors of these variances (rows,), which have the `scatter`."""
    values, group, x, _ = measured
    weights = 1.0 / variances
    weight = np.bincount(group, weights).astype(np.float64)
    mean_x = np.bincount(group, weights * x) / weight
    away = x - mean_x[group]
    squares = float(weights @ away**2)
    slope = 0.0
    if squares > 0.0:
        slope = float((weights * away) @ values) / squares
    rest = values - slope * x
    levels = np.bincount(group, weights * rest) / weight
    freedom = len(values) - len(weight) - int(squares > 0.0)
    residual = rest - levels[group]
    sd = float(np.sqrt(np.sum(weights * residual**2) / max(freedom, 1)))
    return _Line(
        levels=levels,
        mean_x=mean_x,
        weight=weight,
        largest=float(weights.max()),
        squares=squares or np.inf,
        sd=sd,
        freedom=freedom,
        scatter=scatter,
    )
