"""The outcome of a fit in one sentence, and parameters by what the table says of them."""

from __future__ import annotations

from collections.abc import Sequence

from fitball.inference.results.results import Fit, RunStatus, Verdict
from fitball.report.fit.summary import ParameterRow, parameter_rows
from fitball.report.form.sentences import listed

STATUS_WORDS = {
    RunStatus.CONVERGED: "The sampler converged",
    RunStatus.NOT_CONVERGED: "The sampler has NOT converged, so all of this may change",
    RunStatus.POINT_ONLY: "A point fit without posterior",
    RunStatus.INTERRUPTED: "The run was interrupted",
}
TOLD = (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.CONDITIONAL)
NOT_TOLD = (Verdict.ONE_SIDED, Verdict.PRIOR_DOMINATED, Verdict.NOT_JUDGED)


def headline(fit: Fit) -> str:
    """Whether the model describes the table, and the verdict in one sentence."""
    pooled = _pooling(fit)
    names = {
        verdict: [
            estimate.name for estimate in fit.estimates if estimate.verdict is verdict and estimate.name not in pooled
        ]
        for verdict in Verdict
    }
    free = len(fit.problem.free_names)
    parts = []
    if names[Verdict.IDENTIFIED]:
        parts.append(f"identify {listed(names[Verdict.IDENTIFIED])}")
    if names[Verdict.GIVEN]:
        parts.append(f"identify {listed(names[Verdict.GIVEN])} only given assumptions")
    if names[Verdict.CONDITIONAL]:
        parts.append(f"would identify {listed(names[Verdict.CONDITIONAL])} if the model described them")
    if names[Verdict.ONE_SIDED]:
        parts.append(f"bound {listed(names[Verdict.ONE_SIDED])} from one side only")
    if names[Verdict.PRIOR_DOMINATED]:
        parts.append(f"do not tell {listed(names[Verdict.PRIOR_DOMINATED])}")
    if names[Verdict.NOT_JUDGED]:
        parts.append(f"leave {listed(names[Verdict.NOT_JUDGED])} without a judgement")
    if not parts:
        parts.append("judge none by itself")
    levels = "".join(
        f"; {pooled.parameter} differs between {len(pooled.labels)} {pooled.column}s and is told for each of them"
        for pooled in fit.problem.pooling
    )
    described = "" if fit.adequacy is None else f"{fit.adequacy.sentence} "
    return (
        f"{described}{STATUS_WORDS[fit.status]}: of {free} free parameters the {len(fit.problem.table)} impacts "
        f"{listed(parts)}{levels}."
    )


def _pooling(fit: Fit) -> set[str]:
    """Parameters that only serve to pool another over its levels, and that other, whose levels say more."""
    names: set[str] = set()
    for pooled in fit.problem.pooling:
        names |= {pooled.parameter, pooled.spread_name, *map(pooled.place_name, pooled.labels)}
    return names


def told_rows(fit: Fit, verdicts: Sequence[Verdict]) -> tuple[ParameterRow, ...]:
    """The parameters with one of these verdicts, in the order of the fit."""
    rows = zip(parameter_rows(fit), fit.estimates, strict=True)
    return tuple(row for row, item in rows if item.verdict in verdicts)
