"""`compare.html`: a comparison as one page that needs nothing but itself, in the words of the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.inference.comparison.cross_validation import IMPACTS
from fitball.inference.comparison.results import Comparison, ModelScore
from fitball.inference.prediction.outputs import measured_outputs
from fitball.report.compare.rows import (
    assumption_table,
    error_table,
    extrapolation_table,
    head,
    score_table,
    scored_outputs,
)
from fitball.report.compare.text import (
    ASSUMED,
    LEGEND,
    adequacy_lines,
    errors_legend,
    heading,
    remarks,
    untold,
)
from fitball.report.compare.words import sentences
from fitball.report.figures.embed import embed
from fitball.report.form.display_units import output_scale
from fitball.report.form.palette import verdict_html
from fitball.report.form.rounding import fixed
from fitball.report.form.template import render_template
from fitball.values import FloatArray
from fitball.version import versions_line

# Impacts listed one by one; compare.json holds them all.
MOST_ROWS = 300
SECTIONS = {
    "ranking": "Which model predicts best",
    "adequacy": "Does each model describe the table?",
    "errors": "Errors on impacts left out",
    "parameters": "Each parameter over the models",
    "verdicts": "What the table tells of each model's parameters",
    "predictions": "Impacts left out, predicted",
    "notes": "Notes, and what was left out",
    "repeat": "How to repeat it",
}
RANKING_CAPTION = (
    "Left: log predictive density of impacts left out, less that of the best model, with the standard error of the "
    "difference. Right: root mean square errors on impacts left out, one panel an output."
)
FOREST_CAPTION = (
    "Each quantity under each model, best model at the top: median, 95 % interval (thin) and within it one standard "
    "deviation (thick); pale under models that the table surely scores below the best. Shaded: lowest to highest "
    "median over those that are not pale. Below the line: the mixture of all by stacking weights."
)


@dataclass(frozen=True)
class HeldOut:
    """Impacts that took no part in the fit that predicts them: text `rows` under `heads`, for the models `names`;
    `left` are not shown.
    """

    names: tuple[str, ...]
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    left: int


def compare_page(comparison: Comparison, images: Mapping[str, bytes], command: str | None = None) -> str:
    """The page as text; `images` are the PNG files `ranking` and, where there is something to draw, `forest`;
    `command` is the line that made it, None where none did.
    """
    said, held_out, known = sentences(comparison), held_out_table(comparison), remarks(comparison)
    beyond = extrapolation_table(comparison)
    adequate, assumed = adequacy_lines(comparison), assumption_table(comparison)
    there = {
        "adequacy": adequate,
        "parameters": assumed or "forest" in images,
        "predictions": held_out,
        "notes": known,
    }
    figures = {"ranking": embed(images["ranking"], RANKING_CAPTION, _ranking_alt(comparison))}
    if "forest" in images:
        figures["forest"] = embed(images["forest"], FOREST_CAPTION, _forest_alt(comparison))
    return render_template(
        "fitball.report",
        "compare.html.j2",
        comparison=comparison,
        heading=heading(comparison),
        headline=said[0],
        points=said[1:],
        contents=[(name, title) for name, title in SECTIONS.items() if there.get(name, True)],
        sections=SECTIONS,
        figures=figures,
        scores=score_table(comparison),
        legend=LEGEND,
        adequacy=adequate,
        errors=error_table(comparison),
        errors_legend=errors_legend(comparison),
        beyond=beyond,
        over=_over(beyond),
        assumed=assumed,
        assumed_legend=ASSUMED,
        verdicts=verdict_table(comparison),
        untold=[(scored.name, untold(scored)) for scored in comparison.models],
        held_out=held_out,
        notes=known,
        command=command,
        versions=versions_line(),
    )


def _over(rows: list[list[str]]) -> list[tuple[str, int]]:
    """The upper heads of a table with two rows of them, each with the number of columns it stands over."""
    heads: list[tuple[str, int]] = []
    for text in rows[0] if rows else ():
        if text or not heads:
            heads.append((text, 1))
        else:
            heads[-1] = (heads[-1][0], heads[-1][1] + 1)
    return heads


def verdict_table(comparison: Comparison) -> list[list[str]]:
    """What each model's fit says of each parameter; empty where a model has it not."""
    told = [{one.name: one.verdict for one in scored.fit.estimates} for scored in comparison.models]
    names = dict.fromkeys(name for one in told for name in one)
    rows = [["parameter", *(scored.name for scored in comparison.models)]]
    rows += [[name, *(verdict_html(one[name], one[name]) if name in one else "" for one in told)] for name in names]
    return rows


def held_out_table(comparison: Comparison) -> HeldOut | None:
    """Each impact beside its predictions by fits without it, by the best model and the simplest that is not surely
    worse (else the second); None where no model has any.
    """
    best, simplest = comparison.models[0], comparison.simplest
    chosen = [best, simplest] if simplest is not best else [*comparison.models[:2]]
    errors = [_by_impact(comparison, scored) for scored in chosen]
    outputs = [name for name in scored_outputs(comparison) if any(name in one for one in errors)]
    if not outputs:
        return None
    measured, table = measured_outputs(comparison.table), comparison.table
    impacts = table.impacts
    places = {name: _places(name, measured[name]) for name in outputs}
    incident = ["angle [deg]"] if table.has_tangential else []
    gap = chosen[0].loo.elpd - chosen[-1].loo.elpd
    rows = []
    for k in range(min(len(table), MOST_ROWS)):
        row = [table.ids[k]]
        if incident:
            row.append(f"{np.degrees(np.arctan2(impacts.v_y1[k], impacts.v_x1[k])):.1f}")
        row.append(f"{np.hypot(impacts.v_x1[k], impacts.v_y1[k]):.1f}")
        for name in outputs:
            misses = [0.0, *(one[name][k] if name in one else np.nan for one in errors)]
            row.append(" | ".join(_cell(name, float(measured[name][k] + miss), places[name]) for miss in misses))
        rows.append((*row, fixed(float(gap[k]), 1)) if len(chosen) > 1 else tuple(row))
    heads = ("impact", *incident, "speed [m/s]", *(head(name) for name in outputs))
    heads += ("elpd, first less second",) if len(chosen) > 1 else ()
    return HeldOut(tuple(scored.name for scored in chosen), heads, tuple(rows), len(table) - len(rows))


def _by_impact(comparison: Comparison, scored: ModelScore) -> dict[str, FloatArray]:
    """Errors on left-out impacts in the table's order, by output; NaN where a fold has no fit."""
    known = {}
    for missed in scored.missed:
        if missed.scheme == IMPACTS:
            for name, column in missed.errors.items():
                known[name] = np.full(len(comparison.table), np.nan)
                known[name][missed.rows] = column
    return known


def _cell(name: str, value: float, places: int) -> str:
    """A value in the unit of its head."""
    return fixed(value * output_scale(name).factor, places) if np.isfinite(value) else "-"


def _places(name: str, measured: FloatArray) -> int:
    """Decimals for a column: three digits or four of its largest value."""
    largest = float(np.nanmax(np.abs(measured))) * output_scale(name).factor
    return 0 if largest >= 100.0 else 1 if largest >= 20.0 else 2


def _ranking_alt(comparison: Comparison) -> str:
    rows = score_table(comparison)
    difference = rows[0].index("difference")
    return "Models by predictive density: " + "; ".join(f"{row[0]} {row[difference]}" for row in rows[1:]) + "."


def _forest_alt(comparison: Comparison) -> str:
    rows = assumption_table(comparison)
    parts = [f"{row[0]} {row[2]} {row[1]}".strip() + f", over as good {row[3]}" * (row[3] != "-") for row in rows[1:]]
    return "Each quantity under each model. By the best model: " + "; ".join(parts) + "."
