"""Effective sample sizes and nested R-hat (Margossian et al. 2024), computed by ArviZ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, Protocol

import numpy as np

from fitball.base.values import FloatArray

# The quantiles whose effective sizes are those of the tails: the ends of a 95 % interval, which are
# printed.
TAILS = (0.025, 0.975)


class ArrayStatistics(Protocol):
    """The statistics of ArviZ that fitball calls; those of chains `Mixing` calls by name."""

    def psislw(
        self,
        ary: FloatArray,
        r_eff: float,
        axis: int,
    ) -> tuple[FloatArray, FloatArray]:
        """Pareto-smoothed log weights, and Pareto k, of minus the log ratios `ary`."""


@dataclass(frozen=True)
class Mixing:
    """How well `chains` of the named parameters mix. Each statistic is computed when it is first
    needed. Effective sizes are those of walkers. Since walkers of the same ensemble are not
    independent, R-hat compares ensembles: they are its superchains.
    """

    names: Sequence[str]
    chains: Annotated[FloatArray, "ensembles steps walkers coordinates"]

    @cached_property
    def ess_bulk(self) -> Mapping[str, float]:
        """The effective sample size of the bulk of each parameter, by name."""
        return self._by_name("ess", method="bulk")

    @cached_property
    def ess_tail(self) -> Mapping[str, float]:
        """The effective sample size of the tails of each parameter, by name."""
        return self._by_name("ess", method="tail", prob=TAILS)

    @cached_property
    def r_hat(self) -> Mapping[str, float]:
        """The rank-normalised nested R-hat of each parameter, by name; NaN where no chain moved."""
        ensembles, _, walkers, _ = self.chains.shape
        ensemble_of_walker = np.repeat(np.arange(ensembles), walkers)
        return self._by_name("rhat_nested", superchain_ids=ensemble_of_walker)

    def _by_name(self, statistic: str, **options: object) -> Mapping[str, float]:
        """A statistic of ArviZ for each parameter, by name."""
        ensembles, steps, walkers, size = self.chains.shape
        by_walker = self.chains.transpose(3, 0, 2, 1)
        by_parameter = by_walker.reshape(size, ensembles * walkers, steps)
        function = partial(getattr(arviz(), statistic), chain_axis=0, draw_axis=1, **options)
        with np.errstate(divide="ignore", invalid="ignore"):
            return {
                name: float(function(chains))
                for name, chains in zip(self.names, by_parameter, strict=True)
            }

    @property
    def smallest_ess(self) -> float:
        """The smallest effective sample size, of bulk and tails of all parameters."""
        return min(*self.ess_bulk.values(), *self.ess_tail.values())

    def reached(self, ess: float, r_hat: float) -> bool:
        """Whether every parameter has an effective size of at least `ess` and an R-hat below
        `r_hat`. A parameter that never moved has not.
        """
        return self.smallest_ess >= ess and all(value < r_hat for value in self.r_hat.values())


def arviz() -> ArrayStatistics:
    """The statistics of ArviZ for plain arrays."""
    from arviz_stats.base.array import array_stats

    statistics: ArrayStatistics = array_stats
    return statistics
