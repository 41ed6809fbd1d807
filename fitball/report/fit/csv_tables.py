"""CSV files of a fit: parameters, predictions, balances."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fitball.inference.results.quantiles import SUMMARY
from fitball.inference.results.results import Fit, Predictive
from fitball.report.form.display_units import THESIS


def summary_rows(fit: Fit) -> list[dict[str, object]]:
    """One row per parameter, SI at full precision, with the factor to the thesis's unit."""
    rows: list[dict[str, object]] = []
    for item in fit.estimates:
        scale = THESIS.get(item.name)
        rows.append(
            {
                "parameter": item.name,
                "unit": item.unit,
                **{name: getattr(item, name) for name in SUMMARY},
                "point": item.point,
                "least_squares": fit.least_squares.values[item.name],
                "least_squares_stderr": fit.least_squares.stderr[item.name],
                "prior": item.prior,
                "contraction": item.contraction,
                "verdict": str(item.verdict),
                "reason": item.reason,
                "ess_bulk": item.ess_bulk,
                "ess_tail": item.ess_tail,
                "r_hat": item.r_hat,
                "thesis_unit": None if scale is None else scale.unit,
                "thesis_factor": None if scale is None else scale.factor,
            }
        )
    return rows


def prediction_rows(fit: Fit) -> Iterator[dict[str, object]]:
    """One row per impact and measured column: measured, predicted, with intervals in SI (angles in radians)."""
    for observable in fit.problem.observables:
        point = observable.predict(fit.point.rebound)[0]
        found = None
        if fit.predictive is not None:
            found = next(item for item in fit.predictive.observables if item.name == observable.name)
        for k, name in enumerate(fit.problem.table.ids):
            row: dict[str, object] = {
                "id": name,
                "output": observable.name,
                "measured": float(observable.observed[k]),
                "point": float(point[k]),
            }
            for key in ("median", "mean_q025", "mean_q16", "mean_q84", "mean_q975", "data_q025", "data_q975", "sd"):
                row[key] = None if found is None else float(getattr(found, key)[k])
            yield row


def regime_rows(fit: Fit, found: Predictive) -> Iterator[dict[str, object]]:
    """One row per impact and phase sequence with its posterior probability."""
    for name, shares in zip(fit.problem.table.ids, found.regimes, strict=True):
        for regime, share in shares.items():
            yield {"id": name, "regime": regime, "probability": float(np.round(share, 6))}
