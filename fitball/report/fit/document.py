"""A fit for a person: one document, for terminal and page."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from fitball.inference.results.results import Fit, Verdict
from fitball.inference.thesis.published_cases import PublishedCase, compare_cases
from fitball.observables import COMPARED, OBSERVABLES
from fitball.report.figures.registry import FIGURES
from fitball.report.fit.itf_tests import drop_parts, lead_lines, pace_parts
from fitball.report.fit.judged import adequacy_parts, assumption_parts, evidence_parts
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
from fitball.report.form.numbers import (
    NOT_TOLD,
    THESIS,
    TOLD,
    Scale,
    digits,
    file_words,
    handy,
    output_scale,
    parameter_row,
    told_line,
)
from fitball.version import versions_line
from fitball.wording import speaking_to_command_line

# Parameters of the three best cases of the thesis, in SI where that has no handy multiple.
PARAMETERS = ("mass_ratio", "k_y", "k_theta", "mu", "eps_10", "eps_slope")
SI_UNITS = {"k_y": "N/m", "k_theta": "N m/rad", "eps_10": "m", "eps_slope": "m/(m/s)"}
CASES = (
    "{} The cases are those of Table 9 of Jafri (2004), with Eq. (53), and the damping and mean restitution of "
    "Chapter V, computed as the thesis does; this fit: {}. Thesis units first, SI below."
)


def case_parts(fit: Fit) -> list[Part]:
    """Fitted values and errors beside those of each case; nothing where the data are not Wang's."""
    given_columns = ("v_y2",) if fit.problem.model.needs_cor else ()
    found = compare_cases(fit.problem.table, fit.point.rebound, given_columns)
    if found is None:
        return []
    cases, mine = found.cases, found.fitted_rms
    theirs = []
    for name, unit in (("v_x2", "m/s"), ("omega_2", "rad/s")):
        texts = [digits(rms, 2) for rms in sorted(case.rms[name] for case in cases)]
        theirs.append(f"{' to '.join(dict.fromkeys((texts[0], texts[-1])))} {unit}")
    free = sum(name in fit.problem.model_names for name in fit.problem.free_names)
    sentence = (
        f"On these {len(fit.problem.table)} impacts the point estimate ({free} free parameters of the model) misses "
        f"v_x2 by {digits(mine['v_x2'], 2)} m/s and omega_2 by {digits(mine['omega_2'], 2)} rad/s, the three cases, "
        f"hand-tuned on Wang's impacts, {' and '.join(theirs)} (root mean square)."
    )
    # As the thesis prints them (m/s, rad/s, degrees), and in SI where that differs.
    errors = [
        (
            name if k == 0 else "",
            scale.unit,
            *(digits(it[name] * scale.factor, 2) if name in it else "told" for it in (mine, *(c.rms for c in cases))),
        )
        for name in COMPARED
        for k, scale in enumerate(dict.fromkeys((output_scale(name), Scale(OBSERVABLES[name].unit))))
    ]
    heads = ("quantity", "unit", "this fit", *(f"case {case.case}" for case in cases))
    values = "the point estimate" if fit.posterior is None else "median and 95 % interval"
    return [
        Words([CASES.format(sentence, values)], only="page"),
        Table("Parameters beside Table 9", [heads, *_case_values(fit, cases)], ["unit"], only="page"),
        Table("Root mean square errors on these impacts", [heads, *errors], ["unit"], only="page"),
    ]


def _case_values(fit: Fit, cases: Sequence[PublishedCase]) -> list[tuple[str, ...]]:
    """Parameters in the thesis's units, then in handy multiples of SI where these differ."""
    rows: list[tuple[str, ...]] = []
    thesis = {row.name.rpartition(" = ")[2]: row for row in thesis_rows(fit)}
    fitted = {item.name: parameter_row(item) for item in (*fit.estimates, *fit.derived.values())}
    # The algebraic models have one offset at every speed.
    if "offset" in fitted:
        fitted["eps_10"], thesis["eps_10"] = fitted["offset"], thesis["offset"]
    for name in PARAMETERS:
        own = THESIS.get(name, Scale(""))
        scales = [own] * (name in THESIS or name not in fitted)
        scales += [handy(name, SI_UNITS.get(name, ""))] * (name in fitted)
        for k, scale in enumerate(scales):
            row = (thesis if scale is own else fitted).get(name)
            known = (digits(case.values[name] * scale.factor, 3) for case in cases)
            rows.append((name if k == 0 else "", scale.unit, row.within if row else "not in this model", *known))
    means = (f"{low:.2f} to {high:.2f} by spin" for low, high in (case.restitution for case in cases))
    cor = fitted.get("cor_10") or fitted.get("cor")
    rows.append(("restitution", "", "measured" if cor is None else f"{cor.within} at 10 m/s", *means))
    return rows


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
