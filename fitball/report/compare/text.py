"""A comparison on a terminal: plain text in columns, the words last."""

from __future__ import annotations

import textwrap
from pathlib import Path

from fitball.inference.comparison.results import Comparison, ModelScore
from fitball.inference.results.adequacy import Answer
from fitball.inference.results.results import Verdict
from fitball.report.compare.rows import (
    assumption_table,
    error_table,
    extrapolation_table,
    score_table,
    scored_outputs,
)
from fitball.report.form.text_table import WIDTH, columns, wrapped

LEGEND = (
    "elpd: log predictive density of impacts left out one at a time, summed over the scored columns (Pareto smoothed "
    "importance sampling; an impact whose Pareto k exceeds 0.7 is left out and the model sampled anew; "
    "every chain has an effective sample size of at least 400 or is named below). Difference: to the best, with "
    "sqrt(n) times the sd over impacts. p_loo: effective number of parameters. Stacking: weights of models "
    "(Yao et al. 2018); those that predict alike share theirs. AICc, BIC: maximised likelihood without priors; all "
    "free parameters, noise included, count whether or not the table sees them, and n is the number of measurements. "
    "Describes: whether the model describes the table at all; below stands what is against it."
)
ANSWERS = {
    Answer.DESCRIBES: "yes, no check of the residuals finds a pattern",
    Answer.EXCEPT: "yes, with exceptions: {}",
    Answer.FAILS: "NO: {}",
    Answer.UNTOLD: "this table cannot tell",
}
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


def render(comparison: Comparison, words: str, folder: Path | None = None) -> str:
    """The end of a comparison as a person reads it."""
    top = heading(comparison)
    parts = [top, "=" * len(top), "", *columns(score_table(comparison)), "", *wrapped([LEGEND]), ""]
    parts += [*columns(error_table(comparison)), ""]
    beyond = extrapolation_table(comparison)
    if beyond:
        parts += [*columns(beyond), ""]
    parts += wrapped([errors_legend(comparison)])
    assumed = assumption_table(comparison)
    if assumed:
        parts += ["", *columns(assumed, left=2), "", *wrapped([ASSUMED])]
    for title, lines in (
        ("Does each model describe the table?", [f"{name}: {line}" for name, line in adequacy_lines(comparison)]),
        ("What the table does not tell of each model's parameters:",
         [f"{scored.name}: {untold(scored)}" for scored in comparison.models]),
        ("Notes:", [f"{note}." for note in remarks(comparison)]),
    ):  # fmt: skip
        if lines:
            parts += ["", title, *wrapped(lines, "  ", " " * 6)]
    parts += [
        "",
        *textwrap.wrap(words, WIDTH, break_on_hyphens=False),
        "",
        f"Time: {comparison.seconds:.0f} s." + ("" if folder is None else f" Results: {folder}"),
    ]
    return "\n".join(parts)


def heading(comparison: Comparison) -> str:
    """What was compared, on what."""
    table, scored = comparison.table, ", ".join(comparison.columns)
    return f"{len(comparison.models)} models on {table.name} ({len(table)} impacts), scored by {scored}"


def errors_legend(comparison: Comparison) -> str:
    """What the errors are."""
    angle = ANGLE if "theta_2" in scored_outputs(comparison) else ""
    return ERRORS + angle + (f" {PUBLISHED}" if comparison.published else "")


def adequacy_lines(comparison: Comparison) -> list[tuple[str, str]]:
    """Whether each model describes the table, in a line, where that was looked at."""
    looked = [(scored.name, scored.fit.adequacy) for scored in comparison.models]
    return [
        (name, ANSWERS[found.answer].format("; ".join(found.exceptions)))
        for name, found in looked
        if found is not None
    ]


def remarks(comparison: Comparison) -> list[str]:
    """What a reader of the whole should know: what was left out, what did not settle."""
    return [
        *comparison.notes,
        *(f"{scored.name}: {note}" for scored in comparison.models for note in remarks_on(scored)),
    ]


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


def untold(scored: ModelScore) -> str:
    """The parameters of a model that the table leaves open, by verdict."""
    open_ones = scored.unidentified
    if not open_ones:
        return "identified throughout"
    parts = []
    for verdict in (Verdict.CONDITIONAL, Verdict.PRIOR_DOMINATED, Verdict.ONE_SIDED):
        names = [name for name, one in open_ones.items() if one is verdict]
        if names:
            parts.append(f"{verdict} {', '.join(names)}")
    return "; ".join(parts)
