"""How chains of named parameters mix: effective sample sizes and nested R-hat."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated

from fitball.base.values import FloatArray
from fitball.inference.diagnostics import Chains, bulk_size, nested_r_hat, tail_size

# The quantiles whose effective sizes are those of the tails: the ends of a 95 % interval, which are
# printed.
TAILS = (0.025, 0.975)


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
        return self._by_name(bulk_size)

    @cached_property
    def ess_tail(self) -> Mapping[str, float]:
        """The effective sample size of the tails of each parameter, by name."""
        return self._by_name(partial(tail_size, ends=TAILS))

    @cached_property
    def r_hat(self) -> Mapping[str, float]:
        """The rank-normalised nested R-hat of each parameter, by name; NaN where no chain moved."""
        return self._by_name(partial(nested_r_hat, ensembles=len(self.chains)))

    def _by_name(self, statistic: Callable[[Chains], float]) -> Mapping[str, float]:
        """A statistic of the walkers of each parameter, by name."""
        ensembles, steps, walkers, size = self.chains.shape
        by_walker = self.chains.transpose(3, 0, 2, 1)
        by_parameter = by_walker.reshape(size, ensembles * walkers, steps)
        return {
            name: statistic(chains) for name, chains in zip(self.names, by_parameter, strict=True)
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
