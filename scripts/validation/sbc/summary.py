"""What the ranks of many replicates say: one finding a quantity, one verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from validation.sbc.replicate import RANKED, Ranked
from validation.sbc.uniformity import (
    COVERAGES,
    Coverage,
    IntArray,
    chi_square,
    coverage,
    holm,
    null_distribution,
)

VALUES = RANKED + 1
# Probability that correct fits fail: of any test on any quantity of any model, by Holm's adjustment.
FAMILY_ERROR = 0.01
# Share of replicates without a trustworthy chain above which the ranks prove nothing.
MOST_UNCONVERGED = 0.05
# Below this even grossly wrong intervals may pass.
FEWEST = 20


@dataclass(frozen=True)
class QuantityFinding:
    """Ranks of one quantity: chi-square and empirical distribution, each with its probability for correct fits
    alone (`p`) and among all tests of the run (`adjusted`), and the coverage of central intervals.
    """

    model: str
    name: str
    ranks: IntArray
    chi_square: float
    chi_square_p: float
    chi_square_adjusted: float
    ecdf_p: float
    ecdf_adjusted: float
    coverages: tuple[Coverage, ...]

    @property
    def adjusted(self) -> float:
        """The lesser of both adjusted probabilities."""
        return min(self.chi_square_adjusted, self.ecdf_adjusted)

    @property
    def holds(self) -> bool:
        """Whether the ranks look uniform."""
        return self.adjusted >= FAMILY_ERROR


@dataclass(frozen=True)
class ModelFinding:
    """Replicates of one model: how many, how many without convergence, how many without any fit."""

    model: str
    replicates: int
    unconverged: int
    failed: int
    quantities: tuple[QuantityFinding, ...]

    @property
    def complaints(self) -> tuple[str, ...]:
        """What speaks against the fits, in words; empty when nothing does."""
        faults = []
        if self.replicates < FEWEST:
            faults.append(f"{self.replicates} replicates prove nothing: at least {FEWEST} are needed")
        if self.unconverged + self.failed > MOST_UNCONVERGED * self.replicates:
            faults.append(
                f"{self.unconverged} of {self.replicates} replicates did not converge and {self.failed} had no fit"
            )
        faults += [
            f"{quantity.name}: ranks are not uniform (adjusted p = {quantity.adjusted:.2g})"
            for quantity in self.quantities
            if not quantity.holds
        ]
        return tuple(faults)


def summarise(models: Mapping[str, tuple[tuple[str, ...], Sequence[Ranked]]]) -> tuple[ModelFinding, ...]:
    """Findings from the replicates of each model, name -> (quantities, replicates).

    Replicates that did not converge are ranked like the others: leaving them out would hide what they miss.
    """
    raw = []
    for model, (names, replicates) in models.items():
        fitted = [item for item in replicates if not item.failed]
        for name in names if fitted else ():
            ranks = np.array([item.ranks[name] for item in fitted], dtype=np.int64)
            raw.append((model, name, ranks, *chi_square(ranks, VALUES)))
    nulls = {count: null_distribution(count, VALUES) for count in {item[2].size for item in raw}}
    ecdf = [nulls[item[2].size].p_value(item[2]) for item in raw]
    adjusted = holm([item[4] for item in raw] + ecdf)
    quantities = []
    for k, (model, name, ranks, statistic, p) in enumerate(raw):
        covered = tuple(coverage(ranks, VALUES, nominal) for nominal in COVERAGES)
        tests = (statistic, p, adjusted[k], ecdf[k], adjusted[len(raw) + k])
        quantities.append(QuantityFinding(model, name, ranks, *tests, covered))
    return tuple(
        ModelFinding(
            model,
            len(replicates),
            sum(not item.converged and not item.failed for item in replicates),
            sum(bool(item.failed) for item in replicates),
            tuple(quantity for quantity in quantities if quantity.model == model),
        )
        for model, (_, replicates) in models.items()
    )


def summary_rows(findings: Sequence[ModelFinding]) -> list[dict[str, object]]:
    """One row per quantity."""
    rows: list[dict[str, object]] = []
    for finding in findings:
        for quantity in finding.quantities:
            row: dict[str, object] = {
                "model": quantity.model,
                "quantity": quantity.name,
                "replicates": quantity.ranks.size,
                "chi_square": round(quantity.chi_square, 3),
                "chi_square_p": float(f"{quantity.chi_square_p:.4g}"),
                "ecdf_p": float(f"{quantity.ecdf_p:.4g}"),
                "adjusted_p": float(f"{quantity.adjusted:.4g}"),
            }
            for part in quantity.coverages:
                percent = f"{100 * part.nominal:.0f}"
                row |= {
                    f"within_{percent}": round(part.observed, 4),
                    f"within_{percent}_low": round(part.low, 4),
                    f"within_{percent}_high": round(part.high, 4),
                }
            rows.append(row | {"holds": "yes" if quantity.holds else "no"})
    return rows


def summary_json(findings: Sequence[ModelFinding], seed: int) -> dict[str, object]:
    """Verdict and counts."""
    return {
        "holds": not any(finding.complaints for finding in findings),
        "seed": seed,
        "family_error": FAMILY_ERROR,
        "ranked_draws": RANKED,
        "models": {
            finding.model: {
                "replicates": finding.replicates,
                "unconverged": finding.unconverged,
                "failed": finding.failed,
                "complaints": list(finding.complaints),
            }
            for finding in findings
        },
    }
