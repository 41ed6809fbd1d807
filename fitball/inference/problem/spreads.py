"""How far levels lie apart before anything was measured: the prior of the spread of a parameter between surfaces,
balls, places or tables. One for pooled parameters of a fit, populations of tables, balls of drop tests, and places.

Few levels hardly determine their spread, and with a flat or vague prior all intervals are absurdly wide. Half of a
Student's t with few degrees of freedom is weak where the data determine the spread, and keeps it plausible where
they do not (Gelman 2006, Bayesian Analysis 1, 515). Its scale is what is known of tennis balls and courts: rows of
`datasets/literature/priors.csv` with their source, or a share of the parameter where nothing was published.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.data.header import bare
from fitball.data.labels import Role, role_of
from fitball.data.published import published_priors
from fitball.inference.problem.parameters import Prior, parse_prior

# Degrees of freedom of the half-t prior of a spread.
FREEDOM = 4.0
# Kinds of levels of which something is known: what columns name, and makes of balls.
MAKE = "make"
_MAKES = frozenset({"make", "brand", "manufacturer", "balltype", "ballbrand", "ballmodel", "ballmake"})
# Where nothing was published: spread of a logarithm, and of a value as a share of its prior's median. Balls of a
# make, makes of one approval and places of one court are more alike than surfaces or tables.
EXPECTED_SPREAD, EXPECTED_OF_ALIKE = 0.3, 0.1
# Share of a prior's width within which its median is as good as zero.
ABOUT_ZERO = 0.1
# Spreads in drop tests and on courts that need no parameter of the fit, and between what they are.
LAB_SPREADS: Mapping[str, str] = {"cor_10_spread": Role.BALL, "rating_spread": Role.PLACE}


@dataclass(frozen=True)
class SpreadPrior:
    """The prior of a spread as it is written, and where it was published (empty where nothing was)."""

    text: str
    source: str

    @property
    def prior(self) -> Prior:
        """The density."""
        return parse_prior("spread", self.text, 0.0, math.inf)


def general_spread(log: bool, prior: Prior) -> float:
    """What is expected of the spread of a parameter between levels of any kind, of its logarithm where `log`: a share
    of the median of its `prior`, or the width of that where it is centred about zero.
    """
    if log:
        return EXPECTED_SPREAD
    median = abs(float(prior.quantile(np.array([0.5]))[0]))
    return EXPECTED_SPREAD * median if median > ABOUT_ZERO * prior.width else prior.width


def kind_of(column: str) -> str | None:
    """What the levels of a column are; None where that is unknown."""
    return MAKE if bare(column) in _MAKES else role_of(column)


def published_spread(parameter: str, kind: str | None) -> SpreadPrior | None:
    """That of the literature for levels of a `kind`; None where it has none."""
    name = f"{parameter}_spread"
    row = next((row for row in published_priors() if (row.parameter, row.key) == (name, kind)), None)
    return None if row is None else SpreadPrior(row.text, row.provenance)


def spread_prior(parameter: str, kind: str | None, log: bool, prior: Prior, tennis: bool = True) -> SpreadPrior:
    """The prior of the spread of a `parameter` over levels of a `kind`: of `tennis` balls as published, else half-t
    with a share of the parameter for its scale. `prior` is that of the parameter, whose coordinate is the logarithm
    where `log`.
    """
    found = published_spread(parameter, kind) if tennis else None
    if found is not None:
        return found
    size = general_spread(log, prior)
    if kind in (Role.PLACE, Role.BALL, MAKE):
        size *= EXPECTED_OF_ALIKE / EXPECTED_SPREAD
    return SpreadPrior(f"half-t({size:.6g}, {FREEDOM:g})", "")
