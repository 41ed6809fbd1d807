"""A fit as one document, for terminal and page."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from fitball.inference.results.results import Fit, Verdict
from fitball.inference.thesis.published_cases import PublishedCase, compare_cases
from fitball.observables import COMPARED, OBSERVABLES
from fitball.report.figures.registry import FIGURES
from fitball.report.fit.circumstances import circumstance_line
from fitball.report.fit.court_words import pace_lines, pace_parts
from fitball.report.fit.differences import difference_lines, difference_rows, scatter_rows
from fitball.report.fit.drop_words import drop_parts, lead_lines
from fitball.report.fit.judged import (
    adequacy_parts,
    assumption_line,
    assumption_parts,
    brief_answer,
    evidence_parts,
    next_line,
)
from fitball.report.fit.methods import methods_text
from fitball.report.fit.rows import (
    balance_table,
    budget_rows,
    budget_sentence,
    diagnosis_lines,
    measured_lines,
    parameter_table,
    prediction_table,
    sampler_words,
    thesis_rows,
    warning_lines,
)
from fitball.report.form.document import Document, Part, Picture, Section, Table, Words, as_page, on_terminal
from fitball.report.form.numbers import (
    DETERMINED,
    NOT_DETERMINED,
    THESIS,
    Scale,
    digits,
    file_words,
    handy,
    listed,
    output_scale,
    parameter_line,
    parameter_row,
)
from fitball.version import versions_line
from fitball.wording import speaking_to_command_line, spoken

# Parameters of the three best cases of the thesis, in SI where that has no handy multiple.
PARAMETERS = ("mass_ratio", "k_y", "k_theta", "mu", "eps_10", "eps_slope")
SI_UNITS = {"k_y": "N/m", "k_theta": "N m/rad", "eps_10": "m", "eps_slope": "m/(m/s)"}
CASES = (
    "{} The cases are those of Table 9 of Jafri (2004), computed as in the thesis: with Eq. (53), and with the "
    "damping and mean restitution of Chapter V. This fit: {}. Units of the thesis first, SI below."
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
        f"Root mean square errors on these {len(fit.problem.table)} impacts: {digits(mine['v_x2'], 2)} m/s in v_x2 "
        f"and {digits(mine['omega_2'], 2)} rad/s in omega_2 for this fit ({free} free parameters). The three cases "
        f"of the thesis, tuned by hand on Wang's impacts, have {' and '.join(theirs)}."
    )
    # As the thesis prints them (m/s, rad/s, degrees), and in SI where that differs.
    errors = [
        (
            name if k == 0 else "",
            scale.unit,
            *(
                digits(it[name] * scale.factor, 2) if name in it else "given"
                for it in (mine, *(c.rms for c in cases))
            ),
        )
        for name in COMPARED
        for k, scale in enumerate(dict.fromkeys((output_scale(name), Scale(OBSERVABLES[name].unit))))
    ]
    heads = ("quantity", "unit", "this fit", *(f"case {case.case}" for case in cases))
    values = "the point estimate" if fit.posterior is None else "median and 95 % interval"
    return [
        Words([CASES.format(sentence, values)], only="page"),
        Table("Parameters of this fit and of Table 9", [heads, *_case_values(fit, cases)], ["unit"], only="page"),
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


LEVELS = (
    "Each parameter has its largest difference between two levels of a label. Where it is fitted to each level, the "
    "difference is that of the posterior. Else it is of first order: the score of a value for each level. "
    "Probabilities are those of as large a difference by chance, adjusted for the number of pairs or scores."
)
POOLED = (
    "A parameter at a level is the common value plus a place times the spread. The common value belongs to no level. "
    "It and the spread are often less certain than the levels."
)
REPEAT = (
    "`fitball repeat FOLDER`, with the folder of this page, repeats the fit from `run.toml` and compares.",
    "The same seed, versions and machine give the same bytes. On another machine the last digits may differ.",
    "`fit.json` has the parameter set for other programs and impacts to check a port with; `posterior.nc` has the "
    "draws.",
)
# Lines of results and warnings on the first screen.
MOST_RESULTS, MOST_WARNINGS = 7, 3


def fit_document(
    fit: Fit, pictures: Collection[str] = (), command: str | None = None, folder: Path | None = None
) -> Document:
    """The report of a fit, with those of its figures that exist; `command` is the line that made it, None where none
    did, `folder` where its files are.
    """
    drawn = _pictures(fit, pictures)
    determined, undetermined, fixed = (
        [parameter_line(item) for item in fit.reported if item.verdict in verdicts]
        for verdicts in (DETERMINED, NOT_DETERMINED, (Verdict.FIXED,))
    )
    sections = [
        Section("drop-test", "Drop test", drop_parts(fit.drop_test)),
        Section("determined", "Determined", [
            Words(determined, "list"), Words([] if determined else ["The data determine none of the parameters."]),
        ]),
        Section("not-determined", "Not determined", [
            Words(undetermined, "list"), Words([] if undetermined else ["No parameter."]),
            Words(["Fixed, and not fitted:"] * bool(fixed)), Words(fixed, "list"),
        ]),
        Section("levels", "Differences between surfaces, balls and groups", [
            Words(difference_lines(fit), "list"),
            Words([LEVELS] * bool(fit.differences), "quiet"),
            Table.from_rows("Differences by label", difference_rows(fit), ["unit", "from", "to", "", "fitted"]),
            Words([POOLED] * bool(fit.scatter), "quiet", "page"),
            Table.from_rows("Scatter between levels", scatter_rows(fit), ["unit"], only="page", rank="folded"),
        ]),
        Section("posterior", "Posterior", drawn["posterior"]),
        Section(
            "assumptions", "How results depend on model assumptions", assumption_parts(fit, drawn["assumptions"]),
        ),
        Section("predictions", "Measured and predicted", drawn["predictions"]),
        Section("court-pace", "Court pace", pace_parts(fit), "short"),
        Section("methods", "Methods text", [Words([methods_text(fit)], only="page")], "short"),
        *_folded_sections(fit, drawn, command),
        Section("", "", [Words(_done(fit, folder), only="terminal")]),
    ]  # fmt: skip
    table, model = fit.problem.table, fit.problem.model.name
    title = f"{table.name}: {len(table):,} impact{'s' * (len(table) > 1)}, {model} model"
    return Document(title, _lead(fit, drawn[""], folder), sections)


def _lead(fit: Fit, curves: Sequence[Part], folder: Path | None) -> list[Part]:
    """The first screen, and the top of the page."""
    answer = "" if fit.adequacy is None else fit.adequacy.sentence
    results = [*lead_lines(fit.drop_test), *measured_lines(fit), *pace_lines(fit)]
    left = len(results) - MOST_RESULTS
    brief = results if left <= 0 else [*results[:4], f"... and {left + 1} more: report.html", *results[-2:]]
    warnings = [f"Warning: {line}" for line in warning_lines(fit)]
    pooled = difference_lines(fit)
    sentences = [brief_answer(answer), fit.verdict.removeprefix(answer).strip(), *pooled, *next_line(fit)]
    found: list[Part] = [Words(results, "list", "page"), Words(brief, "lead", "terminal", "first")]
    # The coefficient of restitution is what a drop test is for.
    dropped = fit.drop_test is not None
    return [
        Words(_facts(fit)[:1], "quiet", "page"),
        *(found if dropped else ()),
        Words([text for text in sentences if text], "lead", rank="first"),
        *curves,
        Table.from_rows(
            "Parameters", parameter_table(fit, brief=True), ["meaning", "unit", "verdict"], rest="`report.html`",
            spare="meaning", rank="first",
        ),
        *(() if dropped else found),
        Words(warnings[:MOST_WARNINGS], "list", "page"),
        Words(warnings[:MOST_WARNINGS], "lead", "terminal", "first"),
        Words(assumption_line(fit), "list", "page"),
        Words([*assumption_line(fit), *_where(folder)], "lead", "terminal", "first"),
    ]  # fmt: skip


def _where(folder: Path | None) -> list[str]:
    here = spoken(" (print it here: --full)", "")
    return [] if folder is None else [f"Report: {folder / 'report.html'}{here}."]


def _folded_sections(fit: Fit, drawn: Mapping[str, list[Part]], command: str | None) -> list[Section]:
    """What few readers need."""
    balances, meanings = balance_table(fit.balances)
    sampled, table = fit.posterior is not None, fit.problem.table
    half = "posterior median +- half of its 68 % interval" if sampled else "point estimate"
    sampler = "" if fit.diagnostics is None else f"; {sampler_words(fit.diagnostics)}"
    own_units = [{"parameter": row.name, "unit": row.unit, **row.numbers(sampled)} for row in thesis_rows(fit)]
    return [
        Section("impacts", "Impact by impact", [
            Words([f"Measured | {half}, without measurement noise."]),
            Table.from_rows(
                "Measured and predicted", prediction_table(fit), ["contact"], count=len(table),
                rest=file_words("`predictions.csv`", len(table)), aside=("speed [m/s]",),
            ),
        ], rank="folded"),
        Section("adequacy", "Residual tests", [*adequacy_parts(fit), *drawn["adequacy"]], rank="folded"),
        Section("regimes", "Sequences of slip and grip", drawn["regimes"], rank="folded"),
        Section("parameters", "Parameters in full, with priors", [
            Table.from_rows(
                "Parameters in full", parameter_table(fit), ["", "unit", "meaning"], aside=("", "meaning"),
            ),
            Words(["Point: the maximum of the posterior density. Priors in SI units."], "quiet"),
            Table.from_rows("In the units of the thesis", own_units, ["unit"], only="page"),
            *drawn["parameters"],
        ], rank="folded"),
        Section("evidence", "Evidence on each parameter", evidence_parts(fit, drawn["evidence"]), rank="folded"),
        Section(
            "diagnosis", "Least squares and sampler", [Words(diagnosis_lines(fit), "list"), *drawn["diagnosis"]],
            rank="folded",
        ),
        Section("budget", "Error budget", [
            Words([budget_sentence(fit.error_budget)]),
            Table.from_rows("Error budget", budget_rows(fit.error_budget), ["unit"]),
        ], rank="folded"),
        Section("thesis", "Comparison with the cases of the thesis", case_parts(fit), rank="folded"),
        Section("balances", "Model-free balances", [
            Words(["From conservation laws alone, for each impact."]), balances, Words(meanings, "list"),
        ], rank="folded"),
        Section("notes", "Notes on data and scene", [
            Words([*_facts(fit)[1:], *fit.notes], "list"),
        ], rank="folded"),
        Section("repeat", "How to repeat this fit", [
            Words(["Made from Python (`fitball.calibrate`)."] if command is None else [], only="page"),
            Words([] if command is None else [command], "code", "page"),
            Words([
                f"Table {table.name}, SHA-256 {table.digest}", f"Seed {fit.seed}{sampler}",
                f"Versions: {versions_line()}", *REPEAT,
            ], "list", "page"),
        ], "short", "folded"),
    ]  # fmt: skip


def render(fit: Fit, folder: Path) -> str:
    """The end of a calibration on a terminal."""
    return on_terminal(fit_document(fit, folder=folder))


def page(fit: Fit, images: Mapping[str, bytes], command: str | None = None) -> str:
    """`report.html` with those figures that are among `images` (PNG files by name). It names options as the command
    line does, also when it is written from Python: the same fit gives the same page.
    """
    with speaking_to_command_line():
        return as_page(fit_document(fit, images, command), images)


def _facts(fit: Fit) -> list[str]:
    """The data in a line; where they are from; ball and model."""
    problem, ball = fit.problem, fit.problem.model.ball
    scene = problem.scene
    measured = listed([item.name for item in problem.observables if item.name in OBSERVABLES])
    description = f" {scene.description.rstrip('.')}." if scene.description else ""
    options = ", ".join(f"{name}={option}" for name, option in problem.model.options.items())
    size = f"{1e3 * ball.mass:.4g} g, radius {1e3 * ball.radius:.4g} mm, I/(M R^2) = {ball.inertia_ratio:.3g}"
    return [
        f"{len(problem.table)} impacts with {measured}.{description}",
        *([f"Source: {scene.citation}"] if scene.citation else []),
        *([measured_by] if (measured_by := circumstance_line(fit)) else []),
        f"Ball: {size}.",
        *([f"Model assumptions: {options}."] if options else []),
    ]


def _pictures(fit: Fit, pictures: Collection[str]) -> dict[str, list[Part]]:
    """The figures of each section."""
    sections: dict[str, list[Part]] = {text.section: [] for text in FIGURES.values()}
    if not pictures:
        return sections
    # What draws them has their words; it is not loaded for a fit without figures.
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
