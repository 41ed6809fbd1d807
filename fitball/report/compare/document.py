"""A comparison of models for a person: one document, for terminal and page; which model to use, in words."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from fitball.files import all_or_none
from fitball.inference.comparison.left_out import GROUPS, IMPACTS
from fitball.inference.comparison.results import Comparison, ModelScore
from fitball.inference.prediction.outputs import OUTPUTS, measured_outputs
from fitball.inference.results.evidence import Answer
from fitball.inference.results.results import Verdict
from fitball.models.specs import DEFAULT_MODEL
from fitball.report.compare.rows import (
    assumption_table,
    csv_rows,
    error_table,
    extrapolation_table,
    head,
    in_unit,
    json_content,
    schemes,
    score_table,
    scored_outputs,
    summary_table,
)
from fitball.report.form.document import (
    MOST_ROWS,
    Document,
    Part,
    Picture,
    Section,
    Table,
    Words,
    as_page,
    judged,
    on_terminal,
    shortened,
    term,
)
from fitball.report.form.files import csv_text, json_text, write_text
from fitball.report.form.numbers import fixed, handy, listed, output_scale
from fitball.values import FloatArray
from fitball.version import versions_line
from fitball.visible import some
from fitball.wording import Screen, option, screen, shown_on

JSON_NAME = "compare.json"
PICTURES = {"scores": "scores.png", "ranking": "compare.png", "forest": "forest.png"}
# Notes on the first screen; models that are named as not significantly worse.
MOST_NOTES, MOST_CLOSE = 3, 3
LEGEND = (
    "elpd: expected log predictive density of left-out impacts, summed over the scored columns.",
    "It is estimated by Pareto-smoothed importance sampling. An impact with Pareto k above 0.7 is left out and the "
    "model sampled again.",
    "elpd difference: to the best model, +- its standard error (sqrt(n) times the sd over impacts).",
    "p_loo: effective number of parameters. max k: largest Pareto k.",
    "stacking: weight of each model in the best mixture (Yao et al. 2018). Models with equal predictions share a "
    "weight.",
    "AICc, BIC: from the maximised likelihood, without priors. They count all free parameters, noise included, and n "
    "measurements.",
)
ANSWERS = {
    Answer.DESCRIBES: "yes, no residual test finds a misfit",
    Answer.EXCEPT: "yes, with exceptions: {}",
    Answer.FAILS: "NO: {}",
    Answer.UNDECIDED: "too few data to test it",
}
ERRORS = (
    "Root mean square errors. Each impact is predicted at the posterior maximum of a fit that leaves this impact out."
)
ANGLE = " theta_2 is computed from v_x2 and v_y2 where it is not a measured column."
ASSUMED = (
    "best model: median +- sd under the best model that has the parameter.",
    "range: lowest to highest median over the models that predict equally well (not significantly worse than the "
    "best). 95 % over these: the outermost ends of their 95 % intervals.",
    "largest shift: the model that moves the median most, in sd of the best model.",
    "mixture: all models, weighted by stacking.",
)
PUBLISHED = (
    " In brackets: parameter sets published with these data. They were tuned on these impacts, so their errors are "
    "not out of sample. The sets of Appendix C use each impact's measured v_y2."
)
SCORES = (
    "Left: elpd minus that of the best model, with its standard error. Right: rms errors on left-out impacts, one "
    "panel for each output."
)
RANKING = (
    "Left: elpd minus that of the best model, with its standard error. Right: rms errors on left-out impacts, for "
    "each way of leaving impacts out."
)
FOREST = (
    "Each parameter under each model, best model at the top: median, 95 % interval (thin), one standard deviation "
    "(thick). Pale: models that are significantly worse. Shaded: range of the medians of the others. Below the line: "
    "mixture of all models, weighted by stacking."
)


def compare_document(
    comparison: Comparison, pictures: Collection[str] = (), command: str | None = None, folder: str = ""
) -> Document:
    """The report on a comparison, with those of the pictures `scores`, `ranking` and `forest` that there are;
    `command` is the line that made it, None where none did.
    """
    table, models = comparison.table, comparison.models
    scores, errors, assumed = score_table(comparison), error_table(comparison), assumption_table(comparison)
    main, first = summary_table(comparison)
    angle = ANGLE * ("theta_2" in scored_outputs(comparison))
    ranked = "; ".join(f"{row[0]} {row[1]}" for row in main[1:])
    moved = "; ".join(
        f"{row[0]} {row[2]} {row[1]}".strip() + f", range {row[3]}" * (row[3] != "-") for row in assumed[1:]
    )
    drawn = {
        "scores": Picture("scores", SCORES, f"Models by elpd: {ranked}.", rank="first"),
        "ranking": Picture("ranking", RANKING, f"Models by elpd: {ranked}."),
        "forest": Picture("forest", FOREST, f"Each parameter under each model. Best model: {moved}."),
    }
    answers = [(scored.name, scored.fit.adequacy) for scored in models]
    described = [
        term(name, ANSWERS[it.answer].format("; ".join(it.exceptions))) for name, it in answers if it is not None
    ]
    quick = f"; {option('quick')}: no exact refits of influential impacts" * comparison.quick
    notes = [f"{note}." for note in remarks(comparison)]
    most = len(notes) if screen().full else MOST_NOTES
    lead: list[Part] = [
        Words(answer(comparison), "lead", rank="first"),
        *[drawn[name] for name in pictures if name == "scores"],
        Table("Models, best first", main, brief=first, rank="first"),
        Words(reasons(comparison), "list", rank="first"),
    ]
    sections = [
        Section("parameters", "How each parameter depends on the model", [
            *[drawn[name] for name in pictures if name == "forest"],
            Table("Each parameter over the models", assumed, ["unit", "largest shift"]),
            Words([" ".join(ASSUMED)] * bool(assumed), "quiet"),
        ]),
        Section("errors", "Errors on left-out impacts", [
            *[drawn[name] for name in pictures if name == "ranking"],
            Table("Rms errors, each impact left out", errors), *extrapolation_table(comparison),
            Words([changes(comparison)] if comparison.meaningful else []),
            Words([ERRORS + angle + PUBLISHED * bool(comparison.published)], "quiet"),
        ]),
        Section("adequacy", "Does each model fit the data?", [Words(described, "list")]),
        Section("verdicts", "Parameters that are not determined", [
            Words([term(scored.name, undetermined(scored)) for scored in models], "list"), verdict_table(comparison),
        ]),
        Section("notes", "Notes", [
            Words(shortened(notes, most, option("full")), "list", "terminal", rank="first"),
            Words(notes, "list", "page"),
        ]),
        Section("ranking", "Scores and weights", [
            Table("Scores and weights", scores, ["fits the data"]), Words([" ".join(LEGEND)], "quiet"),
        ], rank="folded"),
        Section("predictions", "Left-out impacts, measured and predicted", held_out(comparison), rank="folded"),
        Section("repeat", "How to repeat this comparison", [
            Words([command] if command else [], "code", "page"),
            Words([
                f"Table {table.name}, SHA-256 {table.digest}",
                f"Seed {comparison.seed}{quick}; {comparison.seconds:.0f} s",
                f"Versions: {versions_line()}",
                "`compare.json` holds every number of this page and more; `compare.csv` has one row for each model.",
            ], "list", "page"),
        ], rank="folded"),
        Section("", "", [
            Words([f"Report: {Path(folder, 'compare.html')}"] * bool(folder), only="terminal", rank="first"),
            Words([f"Time: {comparison.seconds:.0f} s."], only="terminal"),
        ]),
    ]  # fmt: skip
    title = f"{table.name}: {len(models)} models on {len(table):,} impacts, scored by {', '.join(comparison.columns)}"
    return Document(title, lead, sections)


def render(comparison: Comparison, folder: str = "") -> str:
    """The comparison on a terminal."""
    return on_terminal(compare_document(comparison, folder=folder))


@all_or_none()
def write_all(comparison: Comparison, folder: Path, command: str | None = None) -> None:
    """Write every file, each whole or not at all, `compare.json` last; `command` is the line that asked for it.

    Raises ResultFolderError.
    """
    from fitball.report.compare.figures import draw_all
    from fitball.report.figures.canvas import save_figure

    images = {name: save_figure(figure, folder / PICTURES[name]) for name, figure in draw_all(comparison).items()}
    write_text(folder / "compare.html", as_page(compare_document(comparison, images, command), images))
    write_text(folder / "compare.csv", csv_text(csv_rows(comparison)))
    with shown_on(Screen()):
        write_text(folder / "compare.txt", render(comparison, str(folder)) + "\n")
    write_text(folder / JSON_NAME, json_text(json_content(comparison, words(comparison))))


def remarks(comparison: Comparison) -> list[str]:
    """What a reader should know of a comparison: what was left out, what did not converge."""
    notes = []
    for scored in comparison.models:
        found, ids, own = scored.fit.diagnostics, scored.fit.problem.table.ids, [*scored.notes]
        if found is not None and not found.converged:
            own.append("sampling did not converge: " + "; ".join(found.complaints))
        if scored.loo.unsettled:
            own.append(f"refits without {some([ids[k] for k in scored.loo.unsettled])} did not converge")
        if scored.loo.doubtful:
            own.append(f"elpd of {some([ids[k] for k in scored.loo.doubtful])} is unreliable (Pareto k above 0.7)")
        notes += [f"{scored.name}: {note}" for note in own]
    return [*comparison.notes, *notes]


def undetermined(scored: ModelScore) -> str:
    """The parameters of a model that the data do not determine, by verdict."""
    parts = []
    for verdict in (Verdict.CONDITIONAL, Verdict.PRIOR_DOMINATED, Verdict.ONE_SIDED):
        names = [name for name, one in scored.unidentified.items() if one is verdict]
        parts += [f"{verdict}: {', '.join(names)}"] * bool(names)
    return "; ".join(parts) or "none, all parameters are identified"


def verdict_table(comparison: Comparison) -> Table:
    """The verdict on each parameter under each model; empty where a model does not have it."""
    verdicts = [{one.name: one.verdict for one in scored.fit.estimates} for scored in comparison.models]
    names = dict.fromkeys(name for one in verdicts for name in one)
    heads = ["parameter", *(scored.name for scored in comparison.models)]
    rows = [[name, *(judged(one[name], one[name]) if name in one else "" for one in verdicts)] for name in names]
    return Table("Verdict on each parameter under each model", [heads, *rows], heads, only="page", rank="folded")


def held_out(comparison: Comparison) -> list[Words | Table]:
    """Each impact beside its predictions by fits without it, by the best model and the simplest that is not surely
    worse (else the second); nothing where no model has any.
    """
    table, (best, second, *_), simplest = comparison.table, comparison.models, comparison.simplest
    chosen = (best, second if simplest is best else simplest)
    # Errors in the table's order, by output; NaN where a fold has no fit.
    errors: list[dict[str, FloatArray]] = [{}, {}]
    for known, scored in zip(errors, chosen, strict=True):
        for missed in scored.missed:
            for name, column in missed.errors.items() if missed.scheme == IMPACTS else ():
                known[name] = np.full(len(table), np.nan)
                known[name][missed.rows] = column
    outputs = [name for name in scored_outputs(comparison) if any(name in one for one in errors)]
    if not outputs:
        return []
    measured, impacts = measured_outputs(table), table.impacts
    columns = {"impact": list(table.ids)}
    columns |= {"angle [deg]": [f"{it:.1f}" for it in np.degrees(impacts.angle)]} if table.has_tangential else {}
    columns["speed [m/s]"] = [f"{it:.1f}" for it in impacts.speed]
    for name in outputs:
        scale, known_ones = output_scale(name), measured[name]
        # Three digits or four of the largest.
        largest = float(np.nanmax(np.abs(known_ones))) * scale.factor
        places = 0 if largest >= 100.0 else 1 if largest >= 20.0 else 2
        misses = [one.get(name, np.full(len(table), np.nan)) for one in errors]
        values = np.transpose([known_ones + miss for miss in (np.zeros(len(table)), *misses)])[:MOST_ROWS]
        columns[head(name)] = [" | ".join(scale.fixed(it, places) for it in row) for row in values.tolist()]
    columns["elpd, first minus second"] = [fixed(it, 1) for it in (chosen[0].loo.elpd - chosen[1].loo.elpd).tolist()]
    text = (
        f"Each cell: measured | {best.name} | {chosen[1].name}. Each impact is predicted by a fit without it, at the "
        f"maximum of the posterior. Last column: difference of their elpd, positive where {best.name} predicts the "
        "impact better."
    )
    rows = list(zip(*columns.values(), strict=False))
    label = "Left-out impacts, measured and predicted"
    listed = Table(label, [[*columns], *rows], count=len(table), rest="`compare.json`", only="page")
    return [Words([text], only="page"), listed]


def words(comparison: Comparison) -> str:
    """A paragraph on the comparison, its answer first; it rests on the numbers of this table alone."""
    parts = [*answer(comparison), *reasons(comparison)]
    return " ".join([*parts, changes(comparison)] if comparison.meaningful else parts).strip()


def answer(comparison: Comparison) -> list[str]:
    """Which model to use, in two or three sentences."""
    if not comparison.meaningful:
        return [
            f"{len(comparison.table)} impacts are too few to compare models: the scores describe these impacts only.",
            "Measure at least six impacts, better twenty, over the angles and spins that matter.",
        ]
    best, chosen, others = comparison.models[0], comparison.simplest, comparison.models[1:]
    close = [scored.name for scored in others if not comparison.elpd_difference(best.name, scored.name).sure]
    sentences = [f"{best.name} predicts left-out impacts best: {_errors(best.out_of_sample())} (rms errors)."]
    if not close:
        return [*sentences, "All other models are significantly worse."]
    few = f"Not significantly worse: {', '.join(close)}."
    many = f"{len(close)} of the {len(others)} other models are not significantly worse."
    sentences.append(few if len(close) <= MOST_CLOSE else many)
    if chosen is best:
        return [*sentences, f"No simpler model predicts as well: it has {best.free} free parameters, noise included."]
    gap = comparison.elpd_difference(chosen.name, best.name)
    return [
        *sentences,
        f"The simplest of these is {chosen.name}: {chosen.free} free parameters instead of {best.free}, elpd "
        f"difference {fixed(gap.value, 1)} +- {fixed(gap.se, 1)}. Use it for quick formulas or small data sets.",
    ]


def reasons(comparison: Comparison) -> list[str]:
    """What else the scores say, point by point; nothing where they mean nothing."""
    points = (_masses, _assumptions, _beyond, _time, _caution) if comparison.meaningful else ()
    return [text for point in points if (text := point(comparison))]


def _beyond(comparison: Comparison) -> str:
    """Best by group and at the ends of incidence, judged by the mean ratio of its errors to the smallest ones."""
    ways: dict[str, list[str]] = {}
    for way in schemes(comparison):
        if way == IMPACTS:
            continue
        rms = {scored.name: scored.out_of_sample(way) for scored in comparison.models}
        complete = {name: one for name, one in rms.items() if one.keys() == rms[comparison.models[0].name].keys()}
        if len(complete) < 2:
            continue
        name = min(complete, key=lambda name: _mean_ratio(name, complete))
        ways.setdefault(name, []).append("a left-out group" if way == GROUPS else f"the {way}")
    parts = [f"{name} for {listed(ends)}" for name, ends in ways.items()]
    return f"Best at extrapolation: {'; '.join(parts)}." if parts else ""


def _mean_ratio(name: str, rms: Mapping[str, Mapping[str, float]]) -> float:
    least = {output: min(one[output] for one in rms.values()) for output in rms[name]}
    return sum(math.log(max(rms[name][output], 1e-12) / max(least[output], 1e-12)) for output in least)


def _time(comparison: Comparison) -> str:
    timed = [scored for scored in comparison.models if scored.fit.problem.model.has_time]
    if not timed or len(timed) == len(comparison.models):
        return ""
    return (
        f"Only two-mass models give contact time, forces and the motion during contact (best here: {timed[0].name})."
    )


def rivals(comparison: Comparison) -> tuple[ModelScore, list[ModelScore]] | None:
    """The best model without a time axis, and the two-mass models, best first; None where the table cannot compare
    them.
    """
    others = [scored for scored in comparison.models if not scored.fit.problem.model.has_time]
    family = [scored for scored in comparison.models if scored.fit.problem.model.has_time]
    whole = comparison.table.has_spin and comparison.table.has_tangential
    return (others[0], family) if others and family and whole else None


def _masses(comparison: Comparison) -> str:
    """The two-mass ball against its strongest rival without a time axis, as composed and as chosen afterwards."""
    if (found := rivals(comparison)) is None:
        return ""
    rival, family = found
    default = comparison.by_name.get(DEFAULT_MODEL, family[0])
    text = f"Is the second mass worth its parameters? {default.name} has {_duel(comparison, default, rival)}."
    if family[0] is not default:
        text += (
            f" {family[0].name}, the best of {len(family)} such models, has {_duel(comparison, family[0], rival)}."
        )
    return text


def _duel(comparison: Comparison, one: ModelScore, other: ModelScore) -> str:
    gap = comparison.elpd_difference(one.name, other.name)
    more = one.free - other.free
    count = f"{abs(more)} {'more' if more >= 0 else 'fewer'}"
    decided = ("yes" if gap.value > 0.0 else "no") if gap.sure else "not decided"
    return f"{count} than {other.name}, elpd difference {_signed(gap.value, 1)} +- {fixed(gap.se, 1)}: {decided}"


def changes(comparison: Comparison) -> str:
    """How the errors of the default two-mass model and its rival differ, output by output; empty without a rival."""
    if (found := rivals(comparison)) is None:
        return ""
    other, family = found
    one, parts = comparison.by_name.get(DEFAULT_MODEL, family[0]), []
    for output in scored_outputs(comparison):
        change = comparison.rms_difference(one.name, other.name, output)
        if change is None:
            continue
        scale = output_scale(output)
        value, low, high = (scale.factor * x for x in (change.value, change.q05, change.q95))
        places = 1 if max(abs(low), abs(high)) >= 1.0 else 2
        ends = f"[{_signed(low, places)}, {_signed(high, places)}]"
        parts.append(f"{output} {_signed(value, places)} {ends} {scale.unit}")
    return (
        f"Rms errors of {one.name} minus those of {other.name} (90 % interval): {', '.join(parts)}." if parts else ""
    )


def _assumptions(comparison: Comparison) -> str:
    """The quantity that the choice of model moves most, over the models that predict equally well."""
    quantities = comparison.assumptions.items()
    moved = {name: one.span for name, one in quantities if one.span is not None and len(one.as_good) > 1}
    name, span = max(moved.items(), key=lambda item: item[1].shift, default=("", None))
    if span is None or not span.by:
        return ""
    scale = handy(name, comparison.assumptions[name].unit)
    low, high = (scale.fixed(end, scale.decimals(span.own.sd)) for end in (span.low, span.high))
    over = f"{low} to {high} {scale.unit}".rstrip()
    return (
        f"The choice of model moves {name} most: {over} across the models that predict equally well. The largest "
        f"shift is {fixed(span.shift, 1)} sd, with {span.by}."
    )


def _caution(comparison: Comparison) -> str:
    if len(comparison.table) >= 100:
        return ""
    return (
        f"With {len(comparison.table)} impacts the standard errors are themselves uncertain. A difference below 4, "
        "or below two standard errors, decides nothing."
    )


def _errors(rms: Mapping[str, float]) -> str:
    names = [name for name in OUTPUTS if name in rms]
    return ", ".join(f"{name} {in_unit(name, rms[name])} {output_scale(name).unit}" for name in names[:3])


def _signed(value: float, places: int) -> str:
    text = fixed(value, places)
    return text if text.startswith("-") else f"+{text}"
