"""A comparison of models for a person: one document, for terminal and page; in words, which model for which use."""

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
)
from fitball.report.form.document import (
    MOST_ROWS,
    Document,
    Picture,
    Section,
    Table,
    Words,
    as_page,
    judged,
    on_terminal,
    term,
)
from fitball.report.form.files import csv_text, json_text, write_text
from fitball.report.form.numbers import fixed, output_scale
from fitball.values import FloatArray
from fitball.version import versions_line
from fitball.wording import Screen, option, shown_on

JSON_NAME = "compare.json"
PICTURES = {"ranking": "compare.png", "forest": "forest.png"}
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
    " In brackets: parameter sets published with these data, nothing fitted here and not out of sample, since they "
    "were tuned on these impacts; those of Appendix C are told each impact's v_y2."
)
RANKING = (
    "Left: log predictive density of impacts left out, less that of the best model, with the standard error of the "
    "difference. Right: root mean square errors on impacts left out, one panel an output."
)
FOREST = (
    "Each quantity under each model, best model at the top: median, 95 % interval (thin) and within it one standard "
    "deviation (thick); pale under models that the table surely scores below the best. Shaded: lowest to highest "
    "median over those that are not pale. Below the line: the mixture of all by stacking weights."
)


def compare_document(
    comparison: Comparison, pictures: Collection[str] = (), command: str | None = None, folder: str = ""
) -> Document:
    """All that is said of a comparison, with those of the pictures `ranking` and `forest` that there are; `command`
    is the line that made it, None where none did.
    """
    table, models, said = comparison.table, comparison.models, sentences(comparison)
    scores, errors, assumed = score_table(comparison), error_table(comparison), assumption_table(comparison)
    angle = ANGLE * ("theta_2" in scored_outputs(comparison))
    ranked = "; ".join(f"{row[0]} {row[scores[0].index('difference')]}" for row in scores[1:])
    moved = "; ".join(
        f"{row[0]} {row[2]} {row[1]}".strip() + f", over as good {row[3]}" * (row[3] != "-") for row in assumed[1:]
    )
    drawn = {
        "ranking": Picture("ranking", RANKING, f"Models by predictive density: {ranked}."),
        "forest": Picture("forest", FOREST, f"Each quantity under each model. By the best model: {moved}."),
    }
    looked = [(scored.name, scored.fit.adequacy) for scored in models]
    described = [
        term(name, ANSWERS[it.answer].format("; ".join(it.exceptions))) for name, it in looked if it is not None
    ]
    done = f"{comparison.seconds:.0f} s"
    quick = f"; {option('quick')}: no exact refits of influential impacts" * comparison.quick
    sections = [
        Section("ranking", "Which model predicts best", [
            *[drawn[name] for name in pictures if name == "ranking"],
            Table("Scores and weights", scores, ["describes"]), Words([LEGEND], "quiet"),
        ]),
        Section("adequacy", "Does each model describe the table?", [Words(described, "list")]),
        Section("errors", "Errors on impacts left out", [
            Table("Errors, each impact left out", errors), *extrapolation_table(comparison),
            Words([ERRORS + angle + PUBLISHED * bool(comparison.published)], "quiet"),
        ]),
        Section("parameters", "Each parameter over the models", [
            *[drawn[name] for name in pictures if name == "forest"],
            Table("Each quantity over the models", assumed, ["unit", "most moved by"]),
            Words([ASSUMED] * bool(assumed), "quiet"),
        ]),
        Section("verdicts", "What the table does not tell of each model's parameters", [
            Words([term(scored.name, untold(scored)) for scored in models], "list"), verdict_table(comparison),
        ]),
        Section("predictions", "Impacts left out, predicted", held_out(comparison)),
        Section("notes", "Notes, and what was left out", [
            Words([f"{note}." for note in remarks(comparison)], "list"),
        ]),
        Section("repeat", "How to repeat it", [
            Words([command] if command else [], "code", "page"),
            Words([
                f"Table {table.name}, SHA-256 {table.digest}",
                f"Seed {comparison.seed}{quick}; {done}",
                f"Versions: {versions_line()}",
                "`compare.json` holds every number of this page and more; `compare.csv` a row a model.",
            ], "list", "page"),
        ]),
        Section("", "", [Words([f"Time: {done}.{f' Results: {folder}' * bool(folder)}"], only="terminal")]),
    ]  # fmt: skip
    title = f"{len(models)} models on {table.name} ({len(table)} impacts), scored by {', '.join(comparison.columns)}"
    return Document(title, [Words(said[:1], "lead", rank="first"), Words(said[1:], rank="first")], sections)


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
    """What a reader of the whole should know: what was left out, what did not settle."""
    notes = [*comparison.notes]
    for scored in comparison.models:
        found, ids, own = scored.fit.diagnostics, scored.fit.problem.table.ids, [*scored.notes]
        if found is not None and not found.converged:
            own.append("its posterior did not converge: " + "; ".join(found.complaints))
        if scored.loo.unsettled:
            own.append(f"refits without {', '.join(ids[k] for k in scored.loo.unsettled)} did not converge")
        if scored.loo.doubtful:
            own.append(f"elpd of {', '.join(ids[k] for k in scored.loo.doubtful)} is doubtful (Pareto k above 0.7)")
        notes += [f"{scored.name}: {note}" for note in own]
    return notes


def untold(scored: ModelScore) -> str:
    """The parameters of a model that the table leaves open, by verdict."""
    parts = []
    for verdict in (Verdict.CONDITIONAL, Verdict.PRIOR_DOMINATED, Verdict.ONE_SIDED):
        names = [name for name, one in scored.unidentified.items() if one is verdict]
        parts += [f"{verdict} {', '.join(names)}"] * bool(names)
    return "; ".join(parts) if scored.unidentified else "identified throughout"


def verdict_table(comparison: Comparison) -> Table:
    """What each model's fit says of each parameter; empty where a model has it not."""
    told = [{one.name: one.verdict for one in scored.fit.estimates} for scored in comparison.models]
    names = dict.fromkeys(name for one in told for name in one)
    heads = ["parameter", *(scored.name for scored in comparison.models)]
    rows = [[name, *(judged(one[name], one[name]) if name in one else "" for one in told)] for name in names]
    return Table("Verdict on each parameter under each model", [heads, *rows], heads, only="page")


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
        told = np.transpose([known_ones + miss for miss in (np.zeros(len(table)), *misses)])[:MOST_ROWS]
        columns[head(name)] = [" | ".join(scale.fixed(it, places) for it in row) for row in told.tolist()]
    columns["elpd, first less second"] = [fixed(it, 1) for it in (chosen[0].loo.elpd - chosen[1].loo.elpd).tolist()]
    text = (
        f"Measured | {best.name} | {chosen[1].name}, each impact predicted at the maximum of the posterior of a fit "
        "without it. Last column: its share in the difference of scores, positive where "
        f"{best.name} foresees it better."
    )
    rows = list(zip(*columns.values(), strict=False))
    label = "Impacts left out, measured and predicted"
    listed = Table(label, [[*columns], *rows], count=len(table), rest="`compare.json`", only="page")
    return [Words([text], only="page"), listed]


def words(comparison: Comparison) -> str:
    """A paragraph; what it recommends rests on the numbers of this table alone."""
    return " ".join(sentences(comparison))


def sentences(comparison: Comparison) -> list[str]:
    """What the words say, point by point, the best model first."""
    if not comparison.meaningful:
        return [
            f"{len(comparison.table)} impacts are too few: the numbers describe these impacts and recommend no "
            "model. Measure at least six, better twenty, over the angles and spins that matter."
        ]
    points = (_best, _simplest, _beyond, _time, _masses, _caution)
    return [text for point in points if (text := point(comparison))]


def _best(comparison: Comparison) -> str:
    best = comparison.models[0]
    close = [
        scored.name for scored in comparison.models[1:] if not comparison.elpd_difference(best.name, scored.name).sure
    ]
    text = f"For impacts like these {best.name} predicts best ({_errors(best.out_of_sample())})"
    if not close:
        return text + ", ahead of every other by more than luck."
    return f"{text}; not told apart from it with certainty: {', '.join(close)}."


def _simplest(comparison: Comparison) -> str:
    chosen, best = comparison.simplest, comparison.models[0]
    if chosen is best:
        return f"None with fewer parameters comes up to it ({best.free} free, noise included)."
    gap = comparison.elpd_difference(chosen.name, best.name)
    return (
        f"The fewest parameters among those has {chosen.name} ({chosen.free} free against {best.free}, elpd "
        f"{fixed(gap.value, 1)} +- {fixed(gap.se, 1)}; {_errors(chosen.out_of_sample())}): take it where a quick "
        "formula or a sparse table is all there is."
    )


def _beyond(comparison: Comparison) -> str:
    """Best by group and at the ends of incidence, judged by the mean ratio of its errors to the smallest ones."""
    parts = []
    for way in schemes(comparison):
        if way == IMPACTS:
            continue
        rms = {scored.name: scored.out_of_sample(way) for scored in comparison.models}
        complete = {name: one for name, one in rms.items() if one.keys() == rms[comparison.models[0].name].keys()}
        if len(complete) < 2:
            continue
        name = min(complete, key=lambda item: _mean_ratio(item, complete))
        place = "a group it has not seen" if way == GROUPS else f"the {way}"
        parts.append(f"{place}: {name} ({_errors(complete[name])})")
    return f"Best where the table ends, predicting {'; '.join(parts)}." if parts else ""


def _mean_ratio(name: str, rms: Mapping[str, Mapping[str, float]]) -> float:
    least = {output: min(one[output] for one in rms.values()) for output in rms[name]}
    return sum(math.log(max(rms[name][output], 1e-12) / max(least[output], 1e-12)) for output in least)


def _time(comparison: Comparison) -> str:
    timed = [scored for scored in comparison.models if scored.fit.problem.model.has_time]
    if not timed or len(timed) == len(comparison.models):
        return ""
    return (
        "Contact time, forces and the course of the contact come from the two-mass family alone; of it "
        f"{timed[0].name} scores best here."
    )


def _masses(comparison: Comparison) -> str:
    """The two-mass ball against its strongest rival without a time axis, as composed and as chosen afterwards."""
    rivals = [scored for scored in comparison.models if not scored.fit.problem.model.has_time]
    family = [scored for scored in comparison.models if scored.fit.problem.model.has_time]
    if not rivals or not family or not comparison.table.has_spin or not comparison.table.has_tangential:
        return ""
    default = comparison.by_name.get(DEFAULT_MODEL, family[0])
    text = f"Do two masses earn their parameters? {_duel(comparison, default, rivals[0])}."
    if family[0] is not default:
        text += f" {_duel(comparison, family[0], rivals[0])}, though chosen afterwards as the best of {len(family)}."
    return text


def _duel(comparison: Comparison, one: ModelScore, other: ModelScore) -> str:
    gap = comparison.elpd_difference(one.name, other.name)
    more = one.free - other.free
    decided = "they do" if gap.value > 0.0 else "they do not, the rival predicts better"
    decided = decided if gap.sure else "this table does not decide it"
    changes = []
    for output in scored_outputs(comparison):
        change = comparison.rms_difference(one.name, other.name, output)
        if change is None:
            continue
        scale = output_scale(output)
        value, low, high = (scale.factor * x for x in (change.value, change.q05, change.q95))
        places = 1 if max(abs(low), abs(high)) >= 1.0 else 2
        if max(abs(value), abs(low), abs(high)) < 0.5 * 10.0**-places:
            continue
        ends = f"[{_signed(low, places)}, {_signed(high, places)}]"
        changes.append(f"{output} {_signed(value, places)} {ends} {scale.unit}")
    return (
        f"{one.name} against {other.name}, {abs(more)} {'more' if more >= 0 else 'fewer'} free: elpd "
        f"{_signed(gap.value, 1)} +- {fixed(gap.se, 1)}; rms error left out (with 90 % of the bootstrap) "
        f"{', '.join(changes)}: {decided}"
    )


def _caution(comparison: Comparison) -> str:
    if len(comparison.table) >= 100:
        return ""
    return (
        f"With {len(comparison.table)} impacts a standard error of a difference is itself uncertain: below 4, or "
        "below two standard errors, nothing is decided."
    )


def _errors(rms: Mapping[str, float]) -> str:
    shown = [name for name in OUTPUTS if name in rms]
    return ", ".join(f"{name} {in_unit(name, rms[name])} {output_scale(name).unit}" for name in shown[:3])


def _signed(value: float, places: int) -> str:
    text = fixed(value, places)
    return text if text.startswith("-") else f"+{text}"
