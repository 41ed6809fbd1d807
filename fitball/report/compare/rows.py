"""A comparison as rows: cells for people, full precision for machines; no drawing, no files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from fitball.inference.comparison.cross_validation import GROUPS, IMPACTS
from fitball.inference.comparison.results import Comparison, FixedPrediction, ModelScore
from fitball.inference.prediction.outputs import OUTPUTS, root_mean_square
from fitball.report.form.display_units import output_scale
from fitball.report.form.rounding import fixed
from fitball.version import __version__

SCHEMA_VERSION = 1
SCHEMES = (IMPACTS, GROUPS, "shallowest third", "steepest third", "slowest third", "fastest third")
# Outputs shown for the schemes that leave out many impacts, as far as there is room.
SHOWN = ("v_x2", "omega_2", "v_y2", "theta_2")


def scored_outputs(found: Comparison) -> tuple[str, ...]:
    """Outputs that at least one model has an out-of-sample error of, in a fixed order."""
    known = {name for item in found.models for missed in item.missed for name in missed.errors}
    return tuple(name for name in OUTPUTS if name in known)


def schemes(found: Comparison) -> tuple[str, ...]:
    """Ways of leaving out that at least one model went through, in a fixed order."""
    known = {missed.scheme for item in found.models for missed in item.missed}
    return tuple(name for name in SCHEMES if name in known)


def published_rms(item: FixedPrediction) -> dict[str, float]:
    """Root mean square errors of a published set by output, over all impacts."""
    return {name: root_mean_square(column) for name, column in item.errors.items()}


def head(output: str) -> str:
    """Column head with the unit people read."""
    return f"{output} [{output_scale(output).unit}]"


def in_unit(output: str, value: float | None) -> str:
    """A root mean square error in the unit of `head`, to three digits or to hundredths."""
    if value is None:
        return "-"
    scaled = value * output_scale(output).factor
    return fixed(scaled, 1) if scaled >= 10.0 else fixed(scaled, 2)


def score_table(found: Comparison) -> list[list[str]]:
    """Elpd, its difference to the best with standard error, effective parameters, Pareto k, weights, criteria."""
    rows = [["model", "free", "elpd", "difference", "p_loo", "max k", "stacking", "pseudo-BMA+", "AICc", "BIC"]]
    best = found.models[0].name
    for item in found.models:
        gap = found.elpd_difference(item.name, best)
        worst = float(np.max(item.loo.pareto_k))
        mark = f" ({len(item.loo.refitted)} refitted)" if item.loo.refitted else ""
        mark += f" ({len(item.loo.doubtful)} doubtful)" if item.loo.doubtful else ""
        aicc = None if item.criteria is None else item.criteria.aicc
        bic = None if item.criteria is None else item.criteria.bic
        rows.append(
            [item.name, str(item.free), fixed(item.loo.total, 1),
             "best" if item.name == best else f"{fixed(gap.value, 1)} +- {fixed(gap.se, 1)}",
             fixed(item.loo.p_loo, 1), fixed(worst, 2) + mark, fixed(found.stacking[item.name], 2),
             fixed(found.pseudo_bma[item.name], 2), fixed(aicc, 1), fixed(bic, 1)]
        )  # fmt: skip
    return rows


def error_table(found: Comparison) -> list[list[str]]:
    """Root mean square errors of every output, each impact predicted by a fit without it; published sets below."""
    outputs = scored_outputs(found)
    rows = [["each impact left out", *(head(name) for name in outputs)]]
    for item in found.models:
        rms = item.out_of_sample()
        rows.append([item.name, *(in_unit(name, rms.get(name)) for name in outputs)])
    for published in found.published:
        rms = published_rms(published)
        rows.append([f"({published.name})", *(in_unit(name, rms.get(name)) for name in outputs)])
    return rows


def extrapolation_table(found: Comparison) -> list[list[str]]:
    """Root mean square errors of the first outputs where many impacts were left out at once; empty without any."""
    names = [name for name in schemes(found) if name != IMPACTS]
    if not names:
        return []
    outputs = [name for name in SHOWN if name in scored_outputs(found)][:2]
    rows = [["", *(head(output) if k == 0 else "" for output in outputs for k in range(len(names)))]]
    rows.append(["left out together", *(names * len(outputs))])
    for item in found.models:
        cells = [in_unit(output, item.out_of_sample(name).get(output)) for output in outputs for name in names]
        rows.append([item.name, *cells])
    return rows


def csv_rows(found: Comparison) -> list[dict[str, object]]:
    """One row per model and published set, numbers at full precision, errors in the units of their heads."""
    best = found.models[0].name
    ways, outputs = schemes(found), scored_outputs(found)
    rows: list[dict[str, object]] = []
    for item in found.models:
        gap = found.elpd_difference(item.name, best)
        rows.append(
            {"model": item.name, "kind": "fitted", "free_parameters": item.free, "elpd": item.loo.total,
             "elpd_difference": gap.value, "elpd_difference_se": gap.se, "p_loo": item.loo.p_loo,
             "pareto_k_max": float(np.max(item.loo.pareto_k)), "refitted": len(item.loo.refitted),
             "doubtful": len(item.loo.doubtful), "stacking": found.stacking[item.name],
             "pseudo_bma": found.pseudo_bma[item.name], **_criteria(item), "status": str(item.fit.status),
             **_errors({way: item.out_of_sample(way) for way in ways}, ways, outputs)}
        )  # fmt: skip
    for published in found.published:
        blank: dict[str, object] = dict.fromkeys(rows[0])
        # Not out of sample, but the same impacts and the same errors: they stand in the column of each impact.
        errors = _errors({IMPACTS: published_rms(published)}, ways, outputs)
        rows.append(blank | {"model": published.name, "kind": "published", **errors})
    return rows


def _errors(
    by_way: Mapping[str, Mapping[str, float]], ways: tuple[str, ...], outputs: tuple[str, ...]
) -> dict[str, object]:
    found: dict[str, object] = {}
    for way in ways:
        for output in outputs:
            value = by_way.get(way, {}).get(output)
            scale = output_scale(output)
            found[f"rms, {way}: {head(output)}"] = None if value is None else value * scale.factor
    return found


def _criteria(item: ModelScore) -> dict[str, float | int | None]:
    one = item.criteria
    if one is None:
        return dict.fromkeys(("log_likelihood", "measurements", "aicc", "bic"))
    return {"log_likelihood": one.log_likelihood, "measurements": one.measurements, "aicc": one.aicc, "bic": one.bic}


def json_content(found: Comparison, words: str) -> dict[str, Any]:
    """The content of `compare.json`: everything but draws, SI units (angles in radians)."""
    best = found.models[0].name
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "fitball comparison",
        "status": str(found.status),
        "table": {"name": found.table.name, "sha256": found.table.digest, "impacts": list(found.table.ids)},
        "scored_columns": list(found.columns),
        "meaningful": found.meaningful,
        "words": words,
        "notes": list(found.notes),
        "seed": found.seed,
        "quick": found.quick,
        "seconds": round(found.seconds, 1),
        "version": __version__,
        "models": [_model_content(found, item, best) for item in found.models],
        "published": [
            {"name": item.name, "source": item.source, "told": list(item.given_columns), "rms": published_rms(item),
             "errors": {name: column.tolist() for name, column in item.errors.items()}}
            for item in found.published
        ],
    }  # fmt: skip


def _model_content(found: Comparison, item: ModelScore, best: str) -> dict[str, Any]:
    gap = found.elpd_difference(item.name, best)
    ids = found.table.ids
    return {
        "name": item.name,
        "closures": dict(item.fit.problem.model.options),
        "told": list(item.given_columns),
        "status": str(item.fit.status),
        "free_parameters": item.free,
        "elpd": item.loo.total,
        "elpd_difference": {"to": best, "value": gap.value, "se": gap.se},
        "elpd_by_impact": dict(zip(ids, item.loo.elpd.tolist(), strict=True)),
        # No Pareto tail can be fitted where all draws give an impact the same density: JSON has no infinity.
        "pareto_k": {
            name: k if math.isfinite(k) else None for name, k in zip(ids, item.loo.pareto_k.tolist(), strict=True)
        },
        "p_loo": item.loo.p_loo,
        "refitted": [ids[k] for k in item.loo.refitted],
        "refits_not_converged": [ids[k] for k in item.loo.unsettled],
        "doubtful": [ids[k] for k in item.loo.doubtful],
        "weights": {"stacking": found.stacking[item.name], "pseudo_bma": found.pseudo_bma[item.name]},
        "criteria": _criteria(item),
        "rms_in_sample": item.in_sample,
        "left_out": [
            {"scheme": missed.scheme, "parts": list(missed.labels), "impacts": [ids[k] for k in missed.rows],
             "rms": item.out_of_sample(missed.scheme),
             "errors": {name: column.tolist() for name, column in missed.errors.items()}}
            for missed in item.missed
        ],
        "point": dict(item.fit.point.values),
        "verdicts": {one.name: str(one.verdict) for one in item.fit.estimates},
        "notes": list(item.notes),
        "seconds": round(item.seconds, 1),
    }  # fmt: skip
