"""What a budget of uncertainty is made of: sources, their contributions, rows of the frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.values import FloatArray

# Coverage factor of the expanded uncertainty: about 95 %.
COVERAGE = 2.0
# Share by which the Monte Carlo may differ from the budget of a result that is linear.
LINEAR_SHARE = 0.05
# Drawings of all constants together.
DRAWINGS = 64


class Budget(NamedTuple):
    """The budget of a result, with its `value` and its `sd` without constants, in SI: the
    `combined` standard uncertainty, and that of the Monte Carlo (NaN: none).
    """

    name: str
    unit: str
    value: float
    sd: float
    combined: float
    monte_carlo: float

    @property
    def linear(self) -> bool:
        """Whether the Monte Carlo confirms the budget, or there is none."""
        if not np.isfinite(self.monte_carlo):
            return True
        return abs(self.monte_carlo / self.combined - 1.0) <= LINEAR_SHARE


class Source(NamedTuple):
    """A source of uncertainty: its value and standard uncertainty with `unit`; by result the
    contribution to the standard uncertainty, in SI, with the sign of the sensitivity.
    """

    name: str
    value: float
    uncertainty: float
    unit: str
    type: str
    distribution: str
    contributions: Annotated[FloatArray, "results"]


def rows_of_result(
    budget: Budget,
    sources: Sequence[Source],
    k: int = 0,
) -> Iterator[dict[str, object]]:
    """The rows of result `k`: its sources, the largest first, and the combined uncertainty."""
    lead = {"result": budget.name, "unit": budget.unit}
    for source in sorted(sources, key=lambda source: -abs(source.contributions[k])):
        contribution = float(source.contributions[k])
        # What is less than a rounding error is no source.
        if abs(contribution) < 1e-3 * budget.sd:
            continue
        yield {
            **lead,
            "source": source.name,
            "value": source.value,
            "uncertainty": source.uncertainty,
            "source_unit": source.unit,
            "type": source.type,
            "distribution": source.distribution,
            "sensitivity": contribution / source.uncertainty,
            "contribution": abs(contribution),
            "share": (contribution / budget.combined) ** 2,
        }
    yield {
        **lead,
        "source": "combined",
        "value": budget.value,
        "uncertainty": budget.sd,
        "contribution": budget.combined,
        "share": 1.0,
        "expanded": COVERAGE * budget.combined,
        "monte_carlo": budget.monte_carlo,
        "linear": budget.linear,
    }


def combined(sources: Sequence[Source], k: int = 0) -> float:
    """The combined standard uncertainty of result `k`."""
    return float(np.sqrt(sum(source.contributions[k] ** 2 for source in sources)))


def hypercube(
    constants: int,
    drawings: int,
    rng: np.random.Generator,
) -> Annotated[FloatArray, "constants drawings"]:
    """Shares between 0 and 1 of a Latin hypercube: each constant is drawn from every stratum once,
    and constants do not go together by chance (Iman and Conover 1982, Commun. Stat. B 11, 311).
    """
    from scipy.special import ndtri

    shares = np.stack([rng.permutation(drawings) + 0.5 for _ in range(constants)]) / drawings
    scores = ndtri(shares)
    factor = np.linalg.cholesky(np.atleast_2d(np.corrcoef(scores)))
    ranks = np.linalg.solve(factor, scores).argsort(axis=1).argsort(axis=1)
    return np.asarray((ranks + 0.5) / drawings)
