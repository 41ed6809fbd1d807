"""A fit for a person: one document, for terminal and page."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from fitball.inference.results.results import Fit, Verdict
from fitball.report.figures.registry import FIGURES
from fitball.report.fit.cases import case_parts
from fitball.report.fit.drop import drop_parts, lead_lines
from fitball.report.fit.judged import adequacy_parts, assumption_parts, evidence_parts
from fitball.report.fit.pace import pace_parts
from fitball.report.fit.rows import (
    balance_table,
    budget_rows,
    budget_sentence,
    diagnosis_lines,
    level_rows,
    measured_lines,
    parameter_table,
    prediction_table,
    sampler_words,
    thesis_rows,
)
from fitball.report.form.document import Document, Part, Picture, Section, Table, Words, as_page, on_terminal
from fitball.report.form.numbers import file_words
from fitball.report.form.parameters import NOT_TOLD, TOLD, told_line
from fitball.version import versions_line
from fitball.wording import speaking_to_command_line

POOLED = (
    "What is pooled between surfaces, balls or tables is told level by level with the parameters; the parameters of "
    "the pooling itself (common value, spread, places) are often known less well than the levels."
)
CONTRACTION = "Contraction: one minus posterior over prior variance, where the prior includes what the scene knows."
REPEAT = (
    "`fitball repeat FOLDER`, with the folder of this page, runs it again from `run.toml` and compares.",
    "The same seed, versions and machine give the same bytes; another machine may round differently in the last "
    "digits.",
    "`fit.json` holds the parameter set for other programs, with impacts to check a port against; `posterior.nc` the "
    "draws.",
)


def fit_document(
    fit: Fit, pictures: Collection[str] = (), command: str | None = None, folder: Path | None = None
) -> Document:
    """All that is said of a fit, with those of its figures that there are; `command` is the line that made it, None
    where none did, `folder` where its files are.
    """
    problem, sampled, table, model = fit.problem, fit.posterior is not None, fit.problem.table, fit.problem.model
    drawn = _pictures(fit, pictures)
    told, untold, fixed = (
        [told_line(item) for item in (*fit.estimates, *fit.derived.values()) if item.verdict in verdicts]
        for verdicts in (TOLD, NOT_TOLD, (Verdict.FIXED,))
    )
    balances, meanings = balance_table(fit.balances)
    half = "posterior median with half of its 68 % interval" if sampled else "point estimate"
    sampler = "" if fit.diagnostics is None else f"; {sampler_words(fit.diagnostics)}"
    sections = [
        Section("drop-test", "Drop test", drop_parts(fit.drop_test)),
        Section("adequacy", "Does the model describe the table?", adequacy_parts(fit)),
        Section("told", "What the data tell", [
            Words(told, "list"), Words([] if told else ["They identify none of the parameters."]),
        ]),
        Section("not-told", "What they do not tell", [
            Words(untold, "list"), Words([] if untold else ["Nothing: every free parameter stands above."]),
            Words([POOLED] * bool(fit.levels), only="page"),
            Words(["Not asked, since fixed:"] * bool(fixed)), Words(fixed, "list"),
        ]),
        Section("parameters", "Parameters", [
            *drawn["parameters"],
            Table.of(
                "Parameters", parameter_table(fit), ["", "unit", "meaning", "verdict"],
                aside=("", "meaning", "contraction"), rank="first",
            ),
            Words(["Point: the maximum of the posterior density."], "quiet"),
            Words([CONTRACTION] * sampled, "quiet", "page"),
            Table.of(
                "In the units of the thesis",
                [{"parameter": row.name, "unit": row.unit, **row.numbers(sampled)} for row in thesis_rows(fit)],
                ["unit"], only="page", rank="folded",
            ),
            Table.of("Level by level, pooled in part", level_rows(fit), ["unit"]),
        ]),
        Section("assumptions", "What rests on assumptions", assumption_parts(fit)),
        Section("court-pace", "Court pace", pace_parts(fit), "short"),
        Section("predictions", "Measured and predicted", [
            *drawn["predictions"],
            Words([f"Measured | {half}, without measurement noise."]),
            Table.of(
                "Measured and predicted, impact by impact", prediction_table(fit), ["contact"], count=len(table),
                rest=file_words("`predictions.csv`", len(table)), aside=("speed [m/s]",),
            ),
        ], "leaf"),
        Section("thesis", "Beside the thesis's best cases", case_parts(fit), "short"),
        Section("balances", "Model-free balances", [
            Words(["What conservation laws alone say of each impact."]), balances, Words(meanings, "list"),
        ]),
        Section("evidence", "How each parameter is known", evidence_parts(fit, drawn["evidence"]), "leaf"),
        Section("diagnosis", "Diagnosis", [Words(diagnosis_lines(fit), "list"), *drawn["diagnosis"]], "leaf"),
        Section("budget", "Error budget", [
            Words([budget_sentence(fit.error_budget)]),
            Table.of("Error budget", budget_rows(fit.error_budget), ["unit"]),
        ], "short"),
        Section("notes", "Notes on table and scene", [
            Words(fit.notes, "list", "page"),
            # The notes of the problem stood on the terminal before the fit began.
            Words([note for note in fit.notes if note not in (*table.remarks, *problem.notes)], "list", "terminal"),
        ]),
        Section("repeat", "How to repeat it", [
            Words(["This page was made from Python (`fitball.calibrate`)."] if command is None else [], only="page"),
            Words([] if command is None else [command], "code", "page"),
            Words([
                f"Table {table.name}, SHA-256 {table.digest}", f"Seed {fit.seed}{sampler}",
                f"Versions: {versions_line()}", *REPEAT,
            ], "list", "page"),
        ], "short"),
        Section("", "", [Words(_done(fit, folder), only="terminal")]),
    ]  # fmt: skip
    lead = [
        Words(_facts(fit), "quiet", "page"),
        Words([*lead_lines(fit.drop_test), *measured_lines(fit), fit.verdict], "lead", rank="first"),
        Words([
            f"{it.parameter} differs between {len(it.labels)} {it.column}s and is told for each of them."
            for it in problem.pooling
        ], rank="first"),
    ]  # fmt: skip
    return Document(f"{model.name} fitted to {table.name} ({len(table)} impacts)", lead, sections)


def render(fit: Fit, folder: Path) -> str:
    """The end of a calibration on a terminal."""
    return on_terminal(fit_document(fit, folder=folder))


def page(fit: Fit, images: Mapping[str, bytes], command: str | None = None) -> str:
    """`report.html` with the figures that there are as `images` (PNG files by name). It names options as the command
    line does, whoever writes it: the same fit gives the same page.
    """
    with speaking_to_command_line():
        return as_page(fit_document(fit, images, command), images)


def _facts(fit: Fit) -> list[str]:
    problem, ball = fit.problem, fit.problem.model.ball
    described = f": {problem.scene.description}" if problem.scene.description else ""
    cited = f" {problem.scene.citation}" if problem.scene.citation else ""
    options = ", ".join(f"{name} {option}" for name, option in problem.model.options.items())
    model = f" Model: {options}." if options else ""
    size = f"{1e3 * ball.mass:.4g} g, radius {1e3 * ball.radius:.4g} mm, I/(M R^2) = {ball.inertia_ratio:.3g}"
    return [f"{len(problem.table)} impacts{described}.{cited}", f"Ball: {size}.{model}"]


def _pictures(fit: Fit, pictures: Collection[str]) -> dict[str, list[Part]]:
    """The figures of each section."""
    sections: dict[str, list[Part]] = {text.section: [] for text in FIGURES.values()}
    if not pictures:
        return sections
    # What a figure shows is told by what draws it, which whoever wants no figures does not load.
    from fitball.report.figures.registry import alt_text

    for name, text in FIGURES.items():
        if name in pictures:
            sections[text.section].append(Picture(name, text.caption, alt_text(name, fit)))
    return sections


def _done(fit: Fit, folder: Path | None) -> list[str]:
    """How long it took, and where the files are."""
    times = ", ".join(f"{timing.stage} {timing.seconds:.1f} s" for timing in fit.timings)
    if folder is None:
        return [f"Time: {times}."]
    names = ", ".join(sorted(item.name for item in folder.iterdir())) if folder.is_dir() else ""
    return [f"Time: {times}.", f"Results: {folder}{f' ({names})' if names else ''}"]
