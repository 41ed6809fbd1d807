"""The result of a fit: as JSON with a schema (`parameters.schema.json`) for other programs, and as a certificate to
print and sign. For a paper it is a table in LaTeX (booktabs) and Markdown, rounded by the Particle Data Group's rule.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitball.exports.bounces import bounces_of, joined, spread_names
from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.pooling import Levels
from fitball.inference.results.evidence import Answer
from fitball.inference.results.lab import CourtPace, DropTest
from fitball.inference.results.quantiles import ESSENTIALS
from fitball.inference.results.results import Estimate, Fit, LevelEstimate, RunStatus, Verdict
from fitball.models.registry import parameter_spec
from fitball.models.types import OUTPUTS
from fitball.report.fit.circumstances import circumstance_rows
from fitball.report.fit.citations import escaped
from fitball.report.fit.court_words import (
    class_lines,
    court_lines,
    level_heads,
    pace_remarks,
    place_rows,
    rating_value,
    rest_lines,
    surface_rows,
    surface_words,
)
from fitball.report.fit.drop_words import ball_rows, drop_class, drop_lead, drop_remarks, speed_rows
from fitball.report.fit.judged import pace_moves
from fitball.report.form.document import Row, markdown_table, render_template
from fitball.report.form.files import json_text
from fitball.report.form.numbers import handy, parameter_row, row_of
from fitball.report.saved.structure import plain
from fitball.version import __version__

SCHEMA_VERSION = 1
NUMBERS = ("point", *ESSENTIALS)
# What the set has of the table.
TABLE = ("name", "file", "sha256", "impacts", "flipped", "columns")


def parameter_content(saved: Fit) -> dict[str, Any]:
    """What `parameters.schema.json` describes: SI, no nulls, absent numbers left out."""
    golden, labels = joined(bounces_of(saved))
    source, impacts, rebound = plain(saved.source), golden.impacts, golden.rebound
    # Values common to all levels are those of none: they are beside the levels.
    levels = saved.fitted.levels
    pooled = {item.parameter for item in levels} | spread_names(levels)
    columns = {name: getattr(rebound, name) for name in (*OUTPUTS, "regime")}
    parameter_set: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "kind": "fitball parameter set",
        "fitball": __version__,
        "status": str(saved.status),
        "model": {"name": saved.fitted.model_name, "closures": dict(saved.fitted.options)},
        "ball": plain(saved.fitted.ball),
        "table": {key: source[key] for key in TABLE} | {"flipped": list(saved.source.flipped)},
        "parameters": {name: _parameter(item) for name, item in saved.parameters.items() if name not in pooled},
    }
    if levels:
        parameter_set["levels"] = {item.parameter: _levels(saved, item) for item in levels}
    if saved.correlation is not None:
        parameter_set["correlation"] = {"names": list(saved.free_names), "values": saved.correlation.tolist()}
    parameter_set["golden"] = {
        "impacts": {name: column for name, column in plain(impacts).items() if column is not None},
        "rebound": {name: column.tolist() for name, column in columns.items() if not np.isnan(column).any()},
        **({"labels": {column: list(values) for column, values in labels.items()}} if labels else {}),
    }
    return parameter_set


def parameter_text(saved: Fit) -> str:
    """The parameter set as JSON."""
    return json_text(parameter_content(saved))


def _levels(saved: Fit, levels: Levels) -> dict[str, Any]:
    """Values of a parameter that differs between surfaces, balls or tables, by label, and what they follow from."""
    known = saved.parameters
    return {
        "column": levels.column,
        "values": {item.label: _known(item) for item in saved.levels if item.parameter == levels.parameter},
        "common": _parameter(known[levels.parameter]),
        "spread": _parameter(known[levels.spread_name]),
        "places": {label: _parameter(known[levels.place_name(label)]) for label in levels.labels},
    }


def _known(item: Estimate | LevelEstimate) -> dict[str, float]:
    return {name: number for name in NUMBERS if (number := getattr(item, name)) is not None}


def role(name: str) -> str:
    """Whether a parameter belongs to the bounce, to the noise of a measurement, to the camera of a session, or to a
    group of impacts.
    """
    if name.partition("[")[0] in CAMERA_SPECS:
        return "camera"
    return "noise" if name in NOISE_SPECS else "model" if parameter_spec(name) is not None else "group"


def _parameter(parameter: Estimate) -> dict[str, Any]:
    content: dict[str, Any] = {
        "role": role(parameter.name),
        "unit": parameter.unit,
        "meaning": parameter.meaning,
        "fixed": parameter.verdict is Verdict.FIXED,
        "verdict": str(parameter.verdict),
        "prior": parameter.prior,
    }
    if parameter.given:
        content["given"] = list(parameter.given)
    return content | {name: getattr(parameter, name) for name in NUMBERS if getattr(parameter, name) is not None}


@dataclass(frozen=True)
class PaperRow:
    """One parameter as text, in a handy unit; `sd` and `interval_95` are empty without a posterior.

    `mark` refers to a note where the uncertainty does not follow from the data alone.
    """

    name: str
    label: str
    meaning: str
    unit: str
    value: str
    sd: str = ""
    interval_95: str = ""
    mark: str = ""


# Letters by which rows refer to notes.
MARKS = {
    Verdict.PRIOR_DOMINATED: ("a", "prior-dominated: the data do not determine it"),
    Verdict.ONE_SIDED: ("b", "one-sided: the data give only a lower or an upper bound"),
    Verdict.GIVEN: ("c", "depends on model assumptions that the data cannot test"),
    Verdict.CONDITIONAL: (
        "d", "conditional: holds only if the model is right, which the residuals contradict"
    ),
    Verdict.UNEXAMINED: ("e", "its dependence on model assumptions could not be examined"),
}  # fmt: skip


def paper_rows(saved: Fit) -> tuple[PaperRow, ...]:
    """Every parameter: median and standard deviation, or the point estimate to four digits. One that differs between
    levels has a row for each of them and one for their spread. Last what follows from several, such as k_theta/k_y.
    """
    spreads = {item.spread_name for item in saved.fitted.levels}
    places = spread_names(saved.fitted.levels) - spreads
    at_levels = [_at_level(saved, item) for item in saved.levels]
    rows: list[PaperRow] = []
    for item in saved.parameters.values():
        own = [row for name, row in at_levels if name == item.name]
        if own or item.name in places:
            rows += own
            continue
        rows.append(_paper_row(item))
    shown = {row.name for row in rows}
    return (*rows, *(_paper_row(item) for item in saved.derived.values() if item.name not in shown))


def _paper_row(item: Estimate) -> PaperRow:
    row, spec = parameter_row(item), parameter_spec(item.name) or NOISE_SPECS.get(item.name)
    known = (row.name, "" if spec is None else spec.label, item.meaning, row.unit)
    if row.median == "-" or item.verdict is Verdict.FIXED:
        return PaperRow(*known, row.point)
    return PaperRow(*known, row.median, row.sd, row.interval_95, _mark(item))


def _mark(item: Estimate | None) -> str:
    return MARKS[item.verdict][0] if item is not None and item.verdict in MARKS else ""


def _at_level(saved: Fit, item: LevelEstimate) -> tuple[str, PaperRow]:
    """The parameter that differs, and its row for a level."""
    common, spec = saved.parameters[item.parameter], parameter_spec(item.parameter)
    row = row_of(f"{item.parameter}[{item.label}]", vars(item), handy(item.parameter, item.unit))
    symbol = "" if spec is None else f"{spec.label} {escaped(item.label)}"
    known = (row.name, symbol, f"{common.meaning}, {item.column} {item.label}", row.unit)
    if row.median == "-":
        return item.parameter, PaperRow(*known, row.point)
    mark = _mark(saved.derived.get(row.name))
    return item.parameter, PaperRow(*known, row.median, row.sd, row.interval_95, mark)


def _caption(saved: Fit) -> str:
    """One sentence without markup."""
    table = saved.source
    what = "point estimates"
    if saved.status is not RunStatus.POINT_ONLY:
        what = "posterior median, standard deviation and 95 % credible interval; values without them are fixed"
    fitted_to = f"fitted to {table.impacts} impacts ({table.name})"
    text = f"Parameters of the model {saved.fitted.model_name} {fitted_to}: {what}."
    described = saved.adequacy
    if described is not None and described.answer is Answer.FAILS:
        text += " The model does not fit these data."
    return text + (" The sampler did not converge." if saved.status is RunStatus.NOT_CONVERGED else "")


def latex_table(saved: Fit) -> str:
    """A `table` environment; needs the package booktabs."""
    lines = [
        "% needs \\usepackage{booktabs}",
        r"\begin{table}",
        r"  \centering",
        rf"  \caption{{{escaped(_caption(saved))}}}",
        r"  \small",
        r"  \begin{tabular}{@{}lp{0.28\linewidth}rll@{}}",
        r"    \toprule",
        r"    Parameter & & Value & 95\,\% interval & Unit \\",
        r"    \midrule",
    ]
    for row in paper_rows(saved):
        mark = rf"$^{{\mathrm{{{row.mark}}}}}$" if row.mark else ""
        symbol = row.label or escaped(row.name)
        value = rf"${row.value} \pm {row.sd}${mark}" if row.sd else f"${_power(row.value)}$"
        spread = f"${row.interval_95}$" if row.interval_95 else ""
        lines.append(
            rf"    {symbol} & \raggedright {escaped(row.meaning)} & {value} & {spread} & {_unit(row.unit)} \\"
        )
    lines += [r"    \bottomrule", r"  \end{tabular}"]
    lines += [rf"  \par\smallskip\footnotesize $^{{\mathrm{{{mark}}}}}$ {note}." for mark, note in _notes(saved)]
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def _notes(saved: Fit) -> list[tuple[str, str]]:
    used = {row.mark for row in paper_rows(saved)}
    return [(mark, note) for mark, note in MARKS.values() if mark in used]


def _power(number: str) -> str:
    """A number with a power of ten as LaTeX writes it."""
    return re.sub(r"e([+-])0*(\d+)$", lambda match: rf" \times 10^{{{match[1].strip('+')}{match[2]}}}", number)


def _unit(unit: str) -> str:
    if not unit:
        return ""
    text = re.sub(r"\b1e(-?\d+) ", r"10^{\1}\\,", unit).replace(" ", r"\,").replace("%", r"\%")
    return rf"$\mathrm{{{text}}}$"


def paper_markdown(saved: Fit) -> str:
    """The same as a Markdown table."""
    rows = [["parameter", "meaning", "value", "95 % interval", "unit"]]
    for row in paper_rows(saved):
        superscript = f" ({row.mark})" if row.mark else ""
        value = f"{row.value} ± {row.sd}{superscript}" if row.sd else row.value
        rows.append([f"`{row.name}`", row.meaning, value, row.interval_95, row.unit])
    notes = [f"({mark}) {note}." for mark, note in _notes(saved)]
    return "\n".join([_caption(saved), "", markdown_table(rows), *([""] if notes else []), *notes]) + "\n"


# Rows of a table that one page has room for, in two halves; and lines of remarks.
MOST_ROWS, MOST_PLACES, MOST_REMARKS, MOST_MOVES = 24, 12, 9, 3
# Title, sentences of the result, tables, remarks.
Content = tuple[str, Sequence[str], Sequence[Mapping[str, Any]], Sequence[str]]


def certificate(saved: Fit) -> str:
    """One page of self-contained HTML to print on A4 and sign: the result of a drop test, of a court pace test or of
    any other fit, its interval, whether the model fits the data, and the data's identity.
    """
    title, result, parts, found = _content(saved)
    priors = ((name, item) for name, item in saved.parameters.items() if item.prior_source)
    remarks = [*(f"Prior of {name}: {item.prior}, {item.prior_source}" for name, item in priors), *found]
    more = _left_out(len(remarks), "remarks", MOST_REMARKS)
    return render_template(
        "fitball.report",
        "certificate.html.j2",
        title=title,
        subject=f"{saved.source.impacts} impacts ({saved.source.name}); fitball {saved.versions['fitball']}",
        table=saved.source,
        result=result,
        parts=parts,
        adequacy="Not tested." if saved.adequacy is None else saved.adequacy.sentence,
        remarks=[*remarks[:MOST_REMARKS], *([more] if more else [])] or ["None besides data and scene."],
        circumstances=circumstance_rows(saved),
        facts=_facts(saved),
    )


def _left_out(count: int, what: str, most: int) -> str:
    return f"... and {count - most} more {what}: report.html" if count > most else ""


def _part(
    title: str, rows: Sequence[Row], what: str, most: int = MOST_ROWS, heads: Sequence[str] = (), narrow: bool = False
) -> Mapping[str, Any]:
    """A table of the page: the columns `heads` (default: all) of the first `most` rows, a dash for a missing cell;
    two halves side by side where the rows are many and `narrow`.
    """
    heads = heads or tuple(rows[0])
    cells = [[row.get(head, "-") for head in heads] for row in rows[:most]]
    return {"title": title, "heads": heads, "rows": cells, "narrow": narrow, "more": _left_out(len(rows), what, most)}


def _content(saved: Fit) -> Content:
    dropped, pace = saved.drop_test, saved.court_pace
    if dropped is not None and not dropped.missing:
        return _of_drops(dropped)
    if pace is not None and (pace.ratings or pace.measured):
        return _of_court(pace, [*rest_lines(saved), *pace_moves(saved)[:MOST_MOVES]])
    sure = (Verdict.IDENTIFIED, Verdict.GIVEN, Verdict.UNEXAMINED)
    rows = [parameter_row(item) for item in saved.reported if item.verdict in sure]
    known = [{"parameter": row.name, "value": row.best, "95 %": row.interval_95, "unit": row.unit} for row in rows]
    parts = [_part("Parameters that the data determine", known, "parameters", narrow=True)] if known else []
    return f"Fit of model {saved.fitted.model_name}", (saved.verdict,), parts, ()


def _of_drops(test: DropTest) -> Content:
    balls, speeds, parts = ball_rows(test), speed_rows(test), []
    if balls:
        heads = ("ball", "drops", "rebound from 254 cm [cm]", "95 %", "passes")
        parts.append(_part("Rebound from 254 cm, ball by ball", balls, "balls", heads=heads, narrow=True))
    elif len(speeds) > 1:
        heads = ("speed [m/s]", "drops", "COR", "95 %", "measured mean")
        parts.append(_part("Coefficient of restitution (COR) at the tested speeds", speeds, "speeds", heads=heads))
    title = "Drop test" if test.rebound is None else "Drop test of tennis balls"
    return title, (*drop_class(test), *drop_lead(test, stated=True)), parts, drop_remarks(test)


def _of_court(pace: CourtPace, depends: Sequence[str]) -> Content:
    parts, places, surfaces = [], place_rows(pace), surface_rows(pace)
    if places:
        parts.append(_part("Places on the court, as measured", places, "places", MOST_PLACES))
    # One page has room for one long table, not for two.
    most = MOST_PLACES - len(places)
    if surfaces and (len(surfaces) <= most or not places):
        title = "Test impact (30 m/s, 16 degrees) predicted by the model"
        heads = (*level_heads(pace), "impacts", "rating", "95 %", "mu of the test")
        parts.append(_part(title, surfaces, f"{level_heads(pace)[0]}s", most, heads))
    # One category is stated; both tests have their numbers.
    result = [*class_lines(pace), *court_lines(pace, shares=False)]
    if pace.court is None:
        result += [
            f"ITF court pace rating{f' of {surface_words(rating)}' if rating.labels else ''} by the model: "
            f"{rating_value(rating)}."
            for rating in pace.ratings[:4]
        ]
    return "Court pace", result, parts, (*depends, *pace_remarks(pace))


def _facts(saved: Fit) -> tuple[tuple[str, str], ...]:
    ball = saved.fitted.ball
    columns = ", ".join((*saved.source.incident_columns, *saved.source.measurements))
    labels = f"; labels {', '.join(saved.source.labels)}" if saved.source.labels else ""
    closures = ", ".join(f"{name} {option}" for name, option in saved.fitted.options.items())
    facts = [
        ("Data", f"{saved.source.file}, {saved.source.impacts} impacts: {columns}{labels}"),
        ("Ball", f"{1e3 * ball.mass:.4g} g, radius {1e3 * ball.radius:.4g} mm"),
        (
            "Model",
            f"{saved.fitted.model_name}{f' ({closures})' if closures else ''}; {saved.status}, seed {saved.seed}",
        ),
        ("Software", ", ".join(f"{name} {number}" for name, number in list(saved.versions.items())[:4])),
    ]
    if saved.source.flipped:
        facts.append(("Columns with reversed direction", ", ".join(saved.source.flipped)))
    return tuple(facts)
