"""Scatter integrated out: what a normal likelihood says of it depends on the sum of squares alone.

With n residuals r of scatter sigma = exp(s), and L the logarithm of their sum of squares, the
density of s and the data is p(s) (2 pi)^(-n/2) exp(-n s - exp(L - 2 s)/2). Its integral over s is
a function of L, and given L the scatter is independent of all else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from fitball.base.prior_families import LogNormal
from fitball.base.values import FloatArray
from fitball.inference.noise import LOG_TAU

# Points of Gauss and Legendre: twice as many move no integral by 1e-12.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(96)
# Depth below the peak at which an integrand ends: e^-42 is below the last digit of a double.
DEPTH = 42.0
# Steps of Newton at most for peaks, and for the places at that depth: both converge from one side.
PEAK_STEPS = 40
END_STEPS = 40
# Step in s from which they have converged: the next is below the last digit.
LAST_STEP = 1e-9
# Step of the table in L, over the width in s of what blurs its sharpest bend, and its largest:
# Hermite's cubic is then exact to 1e-9.
TABLE_STEP = 0.05
LARGEST_STEP = 0.02
# Intervals of the table at most, a guard: next to a bound it may then be exact to 1e-6 only.
MOST_INTERVALS = 20_000
# Widths of the prior within which the table holds; beyond it each integral is computed.
TABLE_REACH = 6.0
# Draws of a gamma density that may be refused before a scatter is drawn between places. Of usual
# priors one in twenty is; of a prior much narrower than the likelihood nearly all are.
MOST_REFUSED = 4
# Places between which the density of a scatter is drawn as constant, some 15 sds in all.
PLACES = 128


@dataclass(frozen=True)
class ScatterIntegral:
    """The scatter of `count` residuals under a lognormal prior, integrated over its coordinate, the
    logarithm s. Log sums of squares L of residuals in SI are -infinite where all are zero.
    """

    prior: LogNormal
    count: int

    def joint(
        self,
        s: Annotated[FloatArray, "... places"],
        log_squares: Annotated[FloatArray, "..."],
    ) -> Annotated[FloatArray, "... places"]:
        """The log density of coordinates and of the residuals."""
        squares = np.exp(log_squares[..., None] - 2.0 * s)
        return self.prior.log_density(s) - self.count * (s + 0.5 * LOG_TAU) - 0.5 * squares

    def log_marginal(
        self, log_squares: Annotated[FloatArray, "draws"]
    ) -> Annotated[FloatArray, "draws"]:
        """The log density of the residuals, the scatter integrated out."""
        grid, height, slope = self._table
        step = (grid[-1] - grid[0]) / (len(grid) - 1)
        within = (log_squares >= grid[0]) & (log_squares <= grid[-1])
        marginal = np.empty(len(log_squares))
        if not within.all():
            marginal[~within] = self._integrals(log_squares[~within])[0]
        at = log_squares[within]
        k = np.minimum(((at - grid[0]) / step).astype(np.int64), len(grid) - 2)
        t = (at - grid[k]) / step
        # Hermite's cubic between two points.
        rise = height[k + 1] - height[k]
        begins = step * slope[k] - rise
        ends = rise - step * slope[k + 1]
        bend = t * (1.0 - t) * ((1.0 - t) * begins + t * ends)
        marginal[within] = height[k] + t * rise + bend - 0.5 * self.count * at
        return marginal

    def draw(
        self,
        log_squares: Annotated[FloatArray, "draws"],
        rng: np.random.Generator,
    ) -> Annotated[FloatArray, "draws"]:
        """A coordinate for each log sum of squares, from its density given that.

        Its logarithm is that of a gamma density of exp(-2 s), with the slope of the prior at the
        peak, less `(rate (s - peak))^2/2`. So draws of this gamma density are taken with that
        probability, and those that are refused MOST_REFUSED times are drawn between places.
        """
        drawn = np.empty(len(log_squares))
        peak = self._peak(log_squares)
        shape = 0.5 * np.exp(log_squares - 2.0 * peak)
        left = np.arange(len(drawn))
        for _ in range(MOST_REFUSED):
            # Without any residual the gamma density has no shape: all is left to places.
            with np.errstate(divide="ignore", invalid="ignore"):
                away = np.log(shape[left] / rng.standard_gamma(shape[left]))
            s = peak[left] + 0.5 * away
            chance = np.exp(-0.125 * (self.prior.rate * away) ** 2)
            taken = rng.uniform(size=len(left)) < chance
            taken &= (s >= self.prior.lower) & (s <= self.prior.upper)
            drawn[left[taken]] = s[taken]
            left = left[~taken]
        drawn[left] = self._draw_between_places(log_squares[left], rng)
        return drawn

    def _draw_between_places(self, log_squares: FloatArray, rng: np.random.Generator) -> FloatArray:
        """As `draw`, from a density that is constant between places an eighth of an sd apart, which
        adds 0.1 % to the variance.
        """
        low, whole = self._span(log_squares)
        width = whole / PLACES
        middles = low[:, None] + width[:, None] * (np.arange(PLACES) + 0.5)
        density = self.joint(middles, log_squares)
        below = np.cumsum(np.exp(density - density.max(axis=1, keepdims=True)), axis=1)
        share = rng.uniform(size=len(low)) * below[:, -1]
        k = np.sum(below < share[:, None], axis=1)
        return np.asarray(low + width * (k + rng.uniform(size=len(low))))

    @cached_property
    def _table(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Log sums of squares, evenly spaced, and how far log marginals lie above those of a flat
        prior, `-n L/2`, with slopes: they change little from point to point.
        """
        prior = self.prior
        reach = TABLE_REACH * prior.width
        # How sharply the marginal may bend: a bound is blurred by the likelihood alone.
        blur = prior.width
        if prior.lower > prior.location - reach or prior.upper < prior.location + reach:
            blur = min(blur, 1.0 / math.sqrt(2.0 * self.count))
        step = min(LARGEST_STEP, TABLE_STEP * blur)
        middle = 2.0 * prior.location + math.log(self.count)
        half_range = 2.0 * reach + 2.0
        intervals = min(2 * math.ceil(half_range / step), MOST_INTERVALS)
        grid = middle + np.linspace(-half_range, half_range, intervals + 1)
        marginal, slope = self._integrals(grid)
        half = 0.5 * self.count
        return grid, marginal + half * grid, slope + half

    def _integrals(self, log_squares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log marginals (draws,), and their slopes with the log sums of squares."""
        low, width = self._span(log_squares)
        half = 0.5 * width
        s = low[:, None] + half[:, None] * (NODES + 1.0)
        density = self.joint(s, log_squares)
        peak = density.max(axis=1)
        shares = np.exp(density - peak[:, None]) * WEIGHTS
        area = shares.sum(axis=1)
        squares = np.exp(log_squares[:, None] - 2.0 * s)
        slope = -0.5 * np.sum(shares * squares, axis=1) / area
        return peak + np.log(half * area), slope

    def _peak(self, log_squares: FloatArray) -> FloatArray:
        """Where the density of the scatter has its peak, without bounds (draws,)."""
        prior = self.prior
        precision = prior.rate**2
        # Where likelihood and prior are steepest the slope of the log density is not negative.
        s = np.maximum(
            0.5 * (log_squares - math.log(self.count)),
            prior.location - self.count / precision,
        )
        for _ in range(PEAK_STEPS):
            squares = np.exp(log_squares - 2.0 * s)
            slope = squares - self.count - precision * (s - prior.location)
            step = slope / (2.0 * squares + precision)
            s = s + step
            if np.abs(step).max(initial=0.0) < LAST_STEP:
                break
        return s

    def _span(self, log_squares: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where the density of the scatter lies: the lowest coordinate (draws,), and the width from
        there. At the ends its logarithm, which is concave, is DEPTH below its peak, or they are
        bounds of the prior.
        """
        prior = self.prior
        precision = prior.rate**2
        s = self._peak(log_squares)
        # Of a truncated density the peak may be at a bound, with a slope.
        peak = np.clip(s, prior.lower, prior.upper)
        squares = np.exp(log_squares - 2.0 * peak)
        slope = squares - self.count - precision * (peak - prior.location)
        slope = np.where(peak == s, 0.0, slope)
        curvature = 2.0 * squares + precision
        # To the left curvature grows.
        left = _nearer(np.sqrt(2.0 * DEPTH / curvature), slope)
        right = _nearer(np.full(len(peak), np.sqrt(2.0 * DEPTH / precision)), -slope)
        for _ in range(END_STEPS):
            fall = -np.expm1(-2.0 * right)
            drop = (0.5 * precision * right - np.minimum(slope, 0.0)) * right
            drop = drop + squares * (right - 0.5 * fall)
            rate = precision * right - np.minimum(slope, 0.0) + squares * fall
            step = (drop - DEPTH) / rate
            right = right - step
            if np.abs(step).max(initial=0.0) < LAST_STEP:
                break
        left = np.minimum(left, peak - prior.lower)
        right = np.minimum(right, prior.upper - peak)
        return peak - left, left + right


def _nearer(distance: FloatArray, slope: FloatArray) -> FloatArray:
    """Distances (draws,), or where a line of that positive slope falls by DEPTH, if that is
    nearer.
    """
    steep = np.maximum(slope, DEPTH / distance)
    return np.asarray(DEPTH / steep)
