"""CSV files of a fit: parameters, predictions, balances."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fitball.inference.results.quantiles import SUMMARY
from fitball.inference.results.results import Fit, Predictive
from fitball.inference.thesis.published_cases import wang_rows
from fitball.report.form.display_units import THESIS
from fitball.report.form.listed import listed_places


def summary_rows(fit: Fit) -> list[dict[str, object]]:
    """One row per parameter, SI at full precision; where the data are the thesis's with the factor to its unit."""
    rows: list[dict[str, object]] = []
    theirs = wang_rows(fit.problem.table) is not None
    for estimate in fit.estimates:
        scale = THESIS.get(estimate.name)
        rows.append(
            {
                "parameter": estimate.name,
                "unit": estimate.unit,
                **{name: getattr(estimate, name) for name in SUMMARY},
                "point": estimate.point,
                "least_squares": fit.least_squares.values[estimate.name],
                "least_squares_stderr": fit.least_squares.stderr[estimate.name],
                "prior": estimate.prior,
                "contraction": estimate.contraction,
                "verdict": estimate.verdict_words,
                "reason": estimate.reason,
                "ess_bulk": estimate.ess_bulk,
                "ess_tail": estimate.ess_tail,
                "r_hat": estimate.r_hat,
            }
        )
        if theirs:
            rows[-1] |= {
                "thesis_unit": None if scale is None else scale.unit,
                "thesis_factor": None if scale is None else scale.factor,
            }
    return rows


def prediction_rows(fit: Fit) -> Iterator[dict[str, object]]:
    """One row per impact and measured column: measured (empty where it was not), predicted, with intervals in SI
    (angles in radians).
    """
    for observable in (item.everywhere(len(fit.problem.table)) for item in fit.problem.observables):
        point = observable.predict(fit.point.rebound)[0]
        prediction = None
        if fit.predictive is not None:
            prediction = next(
                prediction for prediction in fit.predictive.observables if prediction.name == observable.name
            )
        for k in listed_places(len(fit.problem.table)):
            row: dict[str, object] = {
                "id": fit.problem.table.ids[k],
                "output": observable.name,
                "measured": float(observable.observed[k]),
                "point": float(point[k]),
            }
            for key in ("median", "mean_q025", "mean_q16", "mean_q84", "mean_q975", "data_q025", "data_q975", "sd"):
                row[key] = None if prediction is None else float(getattr(prediction, key)[k])
            yield row


def regime_rows(fit: Fit, predictive: Predictive) -> Iterator[dict[str, object]]:
    """One row per impact and phase sequence with its posterior probability."""
    for k in listed_places(len(fit.problem.table)):
        for regime, share in predictive.regimes[k].items():
            yield {"id": fit.problem.table.ids[k], "regime": regime, "probability": float(np.round(share, 6))}
