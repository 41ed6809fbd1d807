"""`report.html`: one page that needs nothing but itself."""

from __future__ import annotations

from collections.abc import Mapping

from fitball.inference.results.results import Fit, Verdict
from fitball.report.figures.embed import PageFigure, embed
from fitball.report.figures.names import FIGURES
from fitball.report.fit.adequacy_rows import check_row, misfit_row, noise_row, remarks, surest
from fitball.report.fit.assumption_rows import assumption_table
from fitball.report.fit.balance_table import balance_table
from fitball.report.fit.budget_rows import budget_rows, budget_sentence
from fitball.report.fit.drop_rows import drop_table
from fitball.report.fit.evidence_rows import direction_rows, evidence_remarks, evidence_rows
from fitball.report.fit.headline import NOT_TOLD, TOLD, headline, told_rows
from fitball.report.fit.pace_rows import pace_table
from fitball.report.fit.published_rows import case_table
from fitball.report.fit.summary import (
    diagnosis_lines,
    level_rows,
    measured_lines,
    notes,
    numbers_of,
    parameter_table,
    prediction_table,
    sampler_words,
    thesis_rows,
)
from fitball.report.form.listed import file_words
from fitball.report.form.template import render_template
from fitball.version import versions_line
from fitball.wording import speaking_to_command_line

# Impacts listed one by one; the files beside the page hold them all.
MOST_ROWS = 300


SECTIONS = {
    "drop-test": "Drop test",
    "adequacy": "Does the model describe the table?",
    "told": "What the data tell",
    "not-told": "What they do not tell",
    "parameters": "Parameters",
    "assumptions": "What rests on assumptions",
    "court-pace": "Court pace",
    "predictions": "Measured and predicted",
    "thesis": "Beside the thesis's best cases",
    "balances": "Model-free balances",
    "evidence": "How each parameter is known",
    "diagnosis": "Diagnosis",
    "budget": "Error budget",
    "notes": "Notes on table and scene",
    "repeat": "How to repeat it",
}


def page(fit: Fit, images: Mapping[str, bytes], command: str | None = None) -> str:
    """The page as text with the figures that there are as `images` (PNG files by name); `command` is the line that
    made the fit, None where none did. It names options as the command line does, whoever writes it: the same fit
    gives the same page.
    """
    with speaking_to_command_line():
        return _page(fit, images, command)


def page_figures(fit: Fit, images: Mapping[str, bytes]) -> dict[str, list[PageFigure]]:
    """The figures of each section of the page."""
    sections: dict[str, list[PageFigure]] = {text.section: [] for text in FIGURES.values()}
    if not images:
        return sections
    # What a figure shows is told by what draws it, which whoever wants no figures does not load.
    from fitball.report.fit.alt_texts import alt_text

    for name, text in FIGURES.items():
        if name in images:
            sections[text.section].append(embed(images[name], text.caption, alt_text(name, fit)))
    return sections


def _page(fit: Fit, images: Mapping[str, bytes], command: str | None) -> str:
    problem, sampled = fit.problem, fit.posterior is not None
    pace, assumed = pace_table(fit), assumption_table(fit)
    dropped = None if fit.drop_test is None else drop_table(fit.drop_test)
    cases = case_table(fit)
    sections = {
        "drop-test": dropped,
        "assumptions": assumed,
        "court-pace": pace,
        "thesis": cases,
        "notes": notes(fit),
    }
    assert fit.adequacy is not None
    return render_template(
        "fitball.report",
        "report.html.j2",
        fit=fit,
        table=problem.table,
        scene=problem.scene,
        model=problem.model,
        sampled=sampled,
        phases=problem.table.has_tangential,
        headline=headline(fit),
        sampler=None if fit.diagnostics is None else sampler_words(fit.diagnostics),
        contents=[(name, title) for name, title in SECTIONS.items() if sections.get(name, True)],
        remarks=remarks(fit),
        noise=[noise_row(check) for check in fit.adequacy.noise],
        checks=[check_row(check) for check in surest(fit.adequacy.checks)],
        misfits=[misfit_row(misfit) for misfit in fit.adequacy.misfits],
        told=told_rows(fit, TOLD),
        not_told=told_rows(fit, NOT_TOLD),
        fixed=told_rows(fit, (Verdict.FIXED,)),
        parameters=parameter_table(fit),
        thesis=[{"parameter": row.name, "unit": row.unit, **numbers_of(row, sampled)} for row in thesis_rows(fit)],
        levels=level_rows(fit),
        assumed=assumed,
        pace=pace,
        dropped=dropped,
        measured=measured_lines(fit),
        cases=cases,
        predictions=prediction_table(fit, MOST_ROWS),
        balances=balance_table(fit.balances, MOST_ROWS),
        not_shown=max(0, len(problem.table) - MOST_ROWS),
        listed=file_words("", len(problem.table)),
        diagnosis=diagnosis_lines(fit, budget=False),
        budget=budget_rows(fit.error_budget),
        budget_sentence=budget_sentence(fit.error_budget),
        notes=sections["notes"],
        evidence=evidence_rows(fit),
        evidence_remarks=evidence_remarks(fit),
        told_by_scene=problem.contact_time is not None,
        eigendirections=direction_rows(fit),
        figures=page_figures(fit, images),
        command=command,
        versions=versions_line(),
    )
