"""A comparison as rows: cells for people, full precision for machines; no drawing, no files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from fitball.inference.comparison.left_out import GROUPS, IMPACTS
from fitball.inference.comparison.results import Comparison, FixedPrediction, ModelScore
from fitball.inference.prediction.outputs import OUTPUTS, root_mean_square
from fitball.inference.results.evidence import Answer
from fitball.report.form.document import Table
from fitball.report.form.numbers import fixed, handy, output_scale
from fitball.values import FloatArray
from fitball.version import __version__

SCHEMA_VERSION = 3
SCHEMES = (IMPACTS, GROUPS, "shallowest third", "steepest third", "slowest third", "fastest third")
SHORT = {Answer.DESCRIBES: "yes", Answer.EXCEPT: "except", Answer.FAILS: "NO", Answer.UNDECIDED: "too few data"}
# Outputs shown for the schemes that leave out many impacts, as far as there is room.
SHOWN = ("v_x2", "omega_2", "v_y2", "theta_2")


def scored_outputs(comparison: Comparison) -> tuple[str, ...]:
    """Outputs that at least one model has an out-of-sample error of, in a fixed order."""
    known = {name for scored in comparison.models for missed in scored.missed for name in missed.errors}
    return tuple(name for name in OUTPUTS if name in known)


def summarised(comparison: Comparison) -> tuple[str, ...]:
    """The first outputs, for which there is room beside other columns."""
    outputs = scored_outputs(comparison)
    return tuple(name for name in SHOWN if name in outputs)[:2]


def schemes(comparison: Comparison) -> tuple[str, ...]:
    """Ways of leaving out that at least one model went through, in a fixed order."""
    known = {missed.scheme for scored in comparison.models for missed in scored.missed}
    return tuple(name for name in SCHEMES if name in known)


def published_rms(published: FixedPrediction) -> dict[str, float]:
    """Root mean square errors of a published set by output, over all impacts."""
    return {name: root_mean_square(column) for name, column in published.errors.items()}


def head(output: str) -> str:
    """Column head with the unit people read."""
    return f"{output} [{output_scale(output).unit}]"


def in_unit(output: str, value: float | None) -> str:
    """A root mean square error in the unit of `head`, to three digits or to hundredths."""
    if value is None:
        return "-"
    scaled = value * output_scale(output).factor
    return fixed(scaled, 1) if scaled >= 10.0 else fixed(scaled, 2)


def summary_table(comparison: Comparison) -> tuple[list[list[str]], tuple[str, ...]]:
    """What decides between models: elpd difference, errors of the first outputs on left-out impacts, free parameters
    and weight; and the heads of those columns that a first screen has room for.
    """
    outputs = summarised(comparison)
    heads = ["model", "elpd difference", *map(head, outputs), "free", "stacking"]
    rows = [
        [
            scored.name, _difference(comparison, scored),
            *(in_unit(output, scored.out_of_sample().get(output)) for output in outputs), str(scored.free),
            fixed(comparison.stacking[scored.name], 2),
        ]
        for scored in comparison.models
    ]  # fmt: skip
    return [heads, *rows], tuple(heads[:-2])


def _difference(comparison: Comparison, scored: ModelScore) -> str:
    """Elpd less that of the best model, with its standard error."""
    best = comparison.models[0].name
    gap = comparison.elpd_difference(scored.name, best)
    return "best" if scored.name == best else f"{fixed(gap.value, 1)} +- {fixed(gap.se, 1)}"


def score_table(comparison: Comparison) -> list[list[str]]:
    """Elpd, its difference to the best with standard error, effective parameters, Pareto k, weights, criteria."""
    heads = ("model", "free", "elpd", "elpd difference", "p_loo", "max k", "stacking", "AICc", "BIC")
    rows = [[*heads, "fits the data"]]
    for scored in comparison.models:
        criteria, mark = _criteria(scored), ""
        for word in ("refitted", "doubtful"):
            count = len(getattr(scored.loo, word))
            mark += f" ({count} {word})" * bool(count)
        rows.append(
            [scored.name, str(scored.free), fixed(scored.loo.total, 1),
             _difference(comparison, scored),
             fixed(scored.loo.p_loo, 1), fixed(float(np.max(scored.loo.pareto_k)), 2) + mark,
             fixed(comparison.stacking[scored.name], 2),
             fixed(criteria["aicc"], 1), fixed(criteria["bic"], 1), described(scored)]
        )  # fmt: skip
    return rows


def described(scored: ModelScore) -> str:
    """Whether a model fits the data, in a word."""
    return "-" if scored.fit.adequacy is None else SHORT[scored.fit.adequacy.answer]


def error_table(comparison: Comparison) -> list[list[str]]:
    """Root mean square errors of every output, each impact predicted by a fit without it; published sets below."""
    outputs = scored_outputs(comparison)
    known = [(scored.name, scored.out_of_sample()) for scored in comparison.models]
    known += [(f"({item.name})", published_rms(item)) for item in comparison.published]
    rows = [[name, *(in_unit(output, rms.get(output)) for output in outputs)] for name, rms in known]
    return [["model", *map(head, outputs)], *rows]


def extrapolation_table(comparison: Comparison) -> list[Table]:
    """Root mean square errors of the first outputs where many impacts were left out at once; none without any."""
    names = [name for name in schemes(comparison) if name != IMPACTS]
    if not names:
        return []
    outputs = summarised(comparison)
    rows = [["model", *(names * len(outputs))]]
    for scored in comparison.models:
        cells = [in_unit(output, scored.out_of_sample(name).get(output)) for output in outputs for name in names]
        rows.append([scored.name, *cells])
    over = [("", 1), *((head(output), len(names)) for output in outputs)]
    return [Table("Rms errors, many impacts left out together", rows, over=over)]


def assumption_table(comparison: Comparison) -> list[list[str]]:
    """Each quantity under the best model that has it, over those that are not surely worse than the best of all, and
    in the mixture; empty where scores mean nothing.
    """
    if not comparison.meaningful:
        return []
    rows = [["", "unit", "best model", "range", "95 % over these", "largest shift", "mixture, 95 %"]]
    for name, item in comparison.assumptions.items():
        if item.span is None:
            continue
        span, mix, scale = item.span, item.stacked, handy(name, item.unit)
        places = scale.decimals(span.own.sd)
        over = f"{scale.fixed(span.low, places)} to {scale.fixed(span.high, places)}"
        mixed = (
            "-" if mix is None else f"{scale.fixed(mix.median, places)} {scale.interval(mix.q025, mix.q975, places)}"
        )
        rows.append(
            [name, scale.unit, scale.plus_minus(span.own.median, span.own.sd), over if len(item.as_good) > 1 else "-",
             scale.interval(span.q025, span.q975, places),
             f"{span.by} ({fixed(span.shift, 1)} sd)" if span.by else "-", mixed]
        )  # fmt: skip
    return rows


def csv_rows(comparison: Comparison) -> list[dict[str, object]]:
    """One row per model and published set, numbers at full precision, errors in the units of their heads."""
    best = comparison.models[0].name
    ways, outputs = schemes(comparison), scored_outputs(comparison)
    rows: list[dict[str, object]] = []
    for scored in comparison.models:
        gap = comparison.elpd_difference(scored.name, best)
        rows.append(
            {"model": scored.name, "kind": "fitted", "free_parameters": scored.free, "elpd": scored.loo.total,
             "elpd_difference": gap.value, "elpd_difference_se": gap.se, "p_loo": scored.loo.p_loo,
             "pareto_k_max": float(np.max(scored.loo.pareto_k)), "refitted": len(scored.loo.refitted),
             "doubtful": len(scored.loo.doubtful), "stacking": comparison.stacking[scored.name],
             **_criteria(scored), "status": str(scored.fit.status),
             "describes": described(scored),
             **_errors({way: scored.out_of_sample(way) for way in ways}, ways, outputs)}
        )  # fmt: skip
    for published in comparison.published:
        blank: dict[str, object] = dict.fromkeys(rows[0])
        # Not out of sample, but the same impacts and the same errors: they stand in the column of each impact.
        errors = _errors({IMPACTS: published_rms(published)}, ways, outputs)
        rows.append(blank | {"model": published.name, "kind": "published", **errors})
    return rows


def _errors(
    by_way: Mapping[str, Mapping[str, float]], ways: tuple[str, ...], outputs: tuple[str, ...]
) -> dict[str, object]:
    known = {(way, output): by_way.get(way, {}).get(output) for way in ways for output in outputs}
    return {
        f"rms, {way}: {head(output)}": None if value is None else value * output_scale(output).factor
        for (way, output), value in known.items()
    }


def _criteria(scored: ModelScore) -> dict[str, float | int | None]:
    names = ("log_likelihood", "measurements", "aicc", "bic")
    return {name: getattr(scored.criteria, name, None) for name in names}


def json_content(comparison: Comparison, words: str) -> dict[str, Any]:
    """The content of `compare.json`: everything but draws, SI units (angles in radians)."""
    best, table = comparison.models[0].name, comparison.table
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "fitball comparison",
        "status": str(comparison.status),
        "table": {"name": table.name, "sha256": table.digest, "impacts": list(table.ids)},
        "scored_columns": list(comparison.columns),
        "meaningful": comparison.meaningful,
        "words": words,
        "notes": list(comparison.notes),
        "seed": comparison.seed,
        "quick": comparison.quick,
        "seconds": round(comparison.seconds, 1),
        "version": __version__,
        "models": [_model_content(comparison, scored, best) for scored in comparison.models],
        "assumptions": {name: asdict(item) for name, item in comparison.assumptions.items()},
        "published": [
            {"name": published.name, "source": published.source, "given_columns": list(published.given_columns),
             "rms": published_rms(published),
             "errors": _known(published.errors)}
            for published in comparison.published
        ],
    }  # fmt: skip


def _known(errors: Mapping[str, FloatArray]) -> dict[str, list[float | None]]:
    """Errors by output, None where it was not measured."""
    return {
        name: [None if math.isnan(value) else value for value in column.tolist()] for name, column in errors.items()
    }


def _model_content(comparison: Comparison, scored: ModelScore, best: str) -> dict[str, Any]:
    gap = comparison.elpd_difference(scored.name, best)
    ids = comparison.table.ids
    return {
        "name": scored.name,
        "closures": dict(scored.fit.problem.model.options),
        "given_columns": list(scored.given_columns),
        "status": str(scored.fit.status),
        "free_parameters": scored.free,
        "elpd": scored.loo.total,
        "elpd_difference": {"to": best, "value": gap.value, "se": gap.se},
        "elpd_by_impact": dict(zip(ids, scored.loo.elpd.tolist(), strict=True)),
        # No Pareto tail can be fitted where all draws give an impact the same density: JSON has no infinity.
        "pareto_k": {
            name: k if math.isfinite(k) else None for name, k in zip(ids, scored.loo.pareto_k.tolist(), strict=True)
        },
        "p_loo": scored.loo.p_loo,
        "refitted": [ids[k] for k in scored.loo.refitted],
        "refits_not_converged": [ids[k] for k in scored.loo.unsettled],
        "doubtful": [ids[k] for k in scored.loo.doubtful],
        "weights": {"stacking": comparison.stacking[scored.name]},
        "criteria": _criteria(scored),
        "rms_in_sample": scored.in_sample,
        "left_out": [
            {"scheme": missed.scheme, "parts": list(missed.labels), "impacts": [ids[k] for k in missed.rows],
             "rms": scored.out_of_sample(missed.scheme),
             "errors": _known(missed.errors)}
            for missed in scored.missed
        ],
        "point": dict(scored.fit.point.values),
        "adequacy": None if scored.fit.adequacy is None else {
            "answer": str(scored.fit.adequacy.answer), "sentence": scored.fit.adequacy.sentence
        },
        "verdicts": {one.name: str(one.verdict) for one in scored.fit.estimates},
        "notes": list(scored.notes),
        "seconds": round(scored.seconds, 1),
    }  # fmt: skip
