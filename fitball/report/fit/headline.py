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
# What the impacts do to parameters with a verdict.
VERDICT_WORDS = {
    Verdict.IDENTIFIED: "identify {}",
    Verdict.GIVEN: "identify {} only given assumptions",
    Verdict.UNEXAMINED: "identify {} where assumptions could not be examined",
    Verdict.EXTRAPOLATED: "give {} by extrapolation only",
    Verdict.CONDITIONAL: "would identify {} if the model described them",
    Verdict.ONE_SIDED: "bound {} from one side only",
    Verdict.PRIOR_DOMINATED: "do not tell {}",
    Verdict.NOT_JUDGED: "leave {} without a judgement",
}
TOLD = (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.UNEXAMINED, Verdict.CONDITIONAL)
NOT_TOLD = (Verdict.EXTRAPOLATED, Verdict.ONE_SIDED, Verdict.PRIOR_DOMINATED, Verdict.NOT_JUDGED)


def headline(fit: Fit) -> str:
    """Whether the model describes the table, and the verdict in one sentence."""
    pooled = _pooling(fit)
    free, parts = len(fit.problem.free_names), []
    for verdict, words in VERDICT_WORDS.items():
        names = [
            item.name
            for item in (*fit.derived.values(), *fit.estimates)
            if item.verdict is verdict and item.name not in pooled
        ]
        if names:
            parts.append(words.format(listed(names)))
    levels = "".join(
        f"; {pooled.parameter} differs between {len(pooled.labels)} {pooled.column}s and is told for each of them"
        for pooled in fit.problem.pooling
    )
    described = "" if fit.adequacy is None else f"{fit.adequacy.sentence} "
    return (
        f"{described}{STATUS_WORDS[fit.status]}: of {free} free parameters the {len(fit.problem.table)} impacts "
        f"{listed(parts or ['judge none by itself'])}{levels}."
        f"{f' {fit.identifiability.several}' if fit.identifiability.several else ''}"
    )


def _pooling(fit: Fit) -> set[str]:
    """Parameters that only serve to pool another over its levels, and that other, whose levels say more."""
    names: set[str] = set()
    for pooled in fit.problem.pooling:
        names |= {pooled.parameter, pooled.spread_name, *map(pooled.place_name, pooled.labels)}
    return names


def told_rows(fit: Fit, verdicts: Sequence[Verdict]) -> tuple[ParameterRow, ...]:
    """The parameters with one of these verdicts, in the order of the fit."""
    rows = zip(parameter_rows(fit), (*fit.estimates, *fit.derived.values()), strict=True)
    return tuple(row for row, item in rows if item.verdict in verdicts)
