"""Effective sizes and nested R-hat, ensembles as superchains (Margossian et al. 2024), by ArviZ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from fitball.base.values import FloatArray

# Quantiles whose effective size is that of the tails.
TAILS = (0.05, 0.95)


@dataclass(frozen=True)
class Mixing:
    """Effective sizes of bulk and tails, and rank-normalised nested R-hat, by name, of `chains`
    (ensembles, steps, walkers, names); each is found when it is asked for. Walkers are the chains
    of effective sizes; since those of one ensemble are not independent, R-hat compares ensembles.
    """

    names: Sequence[str]
    chains: FloatArray

    @cached_property
    def ess_bulk(self) -> Mapping[str, float]:
        """By name."""
        return self._each("ess", method="bulk")

    @cached_property
    def ess_tail(self) -> Mapping[str, float]:
        """By name."""
        return self._each("ess", method="tail", prob=TAILS)

    @cached_property
    def r_hat(self) -> Mapping[str, float]:
        """By name; NaN of what never moved."""
        return self._each(
            "rhat_nested",
            superchain_ids=np.repeat(np.arange(len(self.chains)), self.chains.shape[2]),
        )

    def _each(self, statistic: str, **options: Any) -> Mapping[str, float]:
        ensembles, steps, walkers, free = self.chains.shape
        columns = self.chains.transpose(3, 0, 2, 1).reshape(free, ensembles * walkers, steps)
        function = partial(getattr(arviz(), statistic), chain_axis=0, draw_axis=1, **options)
        with np.errstate(divide="ignore", invalid="ignore"):
            return {
                name: float(function(own)) for name, own in zip(self.names, columns, strict=True)
            }

    @property
    def least(self) -> float:
        """The smallest effective size."""
        return min(*self.ess_bulk.values(), *self.ess_tail.values())

    def reached(self, ess: float, r_hat: float) -> bool:
        """Whether every parameter has these; one that never moved has not."""
        return self.least >= ess and all(one < r_hat for one in self.r_hat.values())


def arviz() -> Any:
    """Its statistics of plain arrays."""
    from arviz_stats.base.array import array_stats

    return array_stats
