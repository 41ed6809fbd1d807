"""A comparison on a terminal: plain text in columns, the words last."""

from __future__ import annotations

import textwrap
from pathlib import Path

from fitball.inference.comparison.results import Comparison, ModelScore
from fitball.inference.results.results import Verdict
from fitball.report.compare.rows import (
    assumption_table,
    error_table,
    extrapolation_table,
    score_table,
    scored_outputs,
)
from fitball.report.form.text_table import WIDTH, columns

LEGEND = (
    "elpd: log predictive density of impacts left out one at a time, summed over the scored columns (Pareto smoothed "
    "importance sampling; an impact whose Pareto k exceeds 0.7 is left out and the model sampled anew; "
    "every chain has an effective sample size of at least 400 or is named below). Difference: to the best, with "
    "sqrt(n) times the sd over impacts. p_loo: effective number of parameters. Weights: stacking and pseudo-BMA+ "
    "(Yao et al. 2018); models that predict alike share theirs. AICc, BIC: maximised likelihood without priors; all "
    "free parameters, noise included, count whether or not the table sees them, and n is the number of measurements. "
    "Describes: whether the model describes the table at all (compare.json says what is against it)."
)
ERRORS = "Root mean square errors of predictions at the maximum of the posterior of a fit without those impacts."
ANGLE = " theta_2 follows from v_x2 and v_y2 where it is not an independent column."
ASSUMED = (
    "What rests on assumptions: the median and sd of each parameter under the best model that has it; its lowest and "
    "highest median, and the outermost ends of its 95 % intervals, over the models that this table does not surely "
    "score below the best of all; and the mixture of all models by stacking weights."
)
PUBLISHED = (
    "In brackets: parameter sets published with these data, nothing fitted here and not out of sample, since they "
    "were tuned on these impacts; those of Appendix C are told each impact's v_y2."
)


def render(comparison: Comparison, words: str, folder: Path) -> str:
    """The end of a comparison as a person reads it."""
    table = comparison.table
    scored = ", ".join(comparison.columns)
    top = f"{len(comparison.models)} models on {table.name} ({len(table)} impacts), scored by {scored}"
    parts = [top, "=" * len(top), "", *columns(score_table(comparison)), "", *textwrap.wrap(LEGEND, WIDTH), ""]
    parts += [*columns(error_table(comparison)), ""]
    beyond = extrapolation_table(comparison)
    if beyond:
        parts += [*columns(beyond), ""]
    angle = ANGLE if "theta_2" in scored_outputs(comparison) else ""
    parts += textwrap.wrap(ERRORS + angle + (f" {PUBLISHED}" if comparison.published else ""), WIDTH)
    assumed = assumption_table(comparison)
    if assumed:
        parts += ["", *columns(assumed, left=2), "", *textwrap.wrap(ASSUMED, WIDTH)]
    parts += ["", "What the table does not tell of each model's parameters:"]
    for item in comparison.models:
        parts += textwrap.wrap(_unidentified(item), WIDTH, initial_indent="  ", subsequent_indent="      ")
    remarks = [
        *comparison.notes,
        *(f"{scored.name}: {note}" for scored in comparison.models for note in remarks_on(scored)),
    ]
    if remarks:
        parts += ["", "Notes:"]
    for note in remarks:
        parts += textwrap.wrap(f"{note}.", WIDTH, initial_indent="  ", subsequent_indent="      ")
    parts += [
        "",
        *textwrap.wrap(words, WIDTH, break_on_hyphens=False),
        "",
        f"Time: {comparison.seconds:.0f} s. Results: {folder}",
    ]
    return "\n".join(parts)


def remarks_on(scored: ModelScore) -> list[str]:
    """What a reader of one model's scores should know."""
    notes = list(scored.notes)
    if scored.fit.diagnostics is not None and not scored.fit.diagnostics.converged:
        notes.append("its posterior did not converge: " + "; ".join(scored.fit.diagnostics.complaints))
    ids = scored.fit.problem.table.ids
    if scored.loo.unsettled:
        notes.append(f"refits without {', '.join(ids[k] for k in scored.loo.unsettled)} did not converge")
    if scored.loo.doubtful:
        notes.append(f"elpd of {', '.join(ids[k] for k in scored.loo.doubtful)} is doubtful (Pareto k above 0.7)")
    return notes


def _unidentified(scored: ModelScore) -> str:
    open_ones = scored.unidentified
    if not open_ones:
        return f"{scored.name}: identified throughout"
    parts = []
    for verdict in (Verdict.CONDITIONAL, Verdict.PRIOR_DOMINATED, Verdict.ONE_SIDED):
        names = [name for name, one in open_ones.items() if one is verdict]
        if names:
            parts.append(f"{verdict} {', '.join(names)}")
    return f"{scored.name}: {'; '.join(parts)}"
