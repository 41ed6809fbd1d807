"""How often something is so, with what chance leaves open."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.stats import beta

LEVEL = 0.95


@dataclass(frozen=True)
class Rate:
    """`count` of `of`, with the ends of a 95 % interval (Clopper and Pearson 1934); empty without any."""

    count: int
    of: int

    @property
    def value(self) -> float | None:
        """The share."""
        return self.count / self.of if self.of else None

    @property
    def low(self) -> float:
        """The least rate that would give as many."""
        return float(beta.ppf(0.5 - LEVEL / 2, self.count, self.of - self.count + 1)) if self.count else 0.0

    @property
    def high(self) -> float:
        """The largest rate that would give as few."""
        return float(beta.ppf(0.5 + LEVEL / 2, self.count + 1, self.of - self.count)) if self.count < self.of else 1.0

    def agrees(self, low: float, high: float) -> bool:
        """Whether the rate may lie from `low` to `high`."""
        return not self.of or (self.low <= high and self.high >= low)
