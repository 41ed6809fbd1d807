"""CSV files of a fit: parameters, predictions, balances."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fitball.inference.results.quantiles import SUMMARY
from fitball.inference.results.results import Fit, Predictive
from fitball.report.figures.measured import prediction_of
from fitball.report.form.listed import listed_places


def summary_rows(fit: Fit) -> list[dict[str, object]]:
    """One row per parameter, SI at full precision."""
    rows: list[dict[str, object]] = []
    for item in fit.estimates:
        squares = fit.least_squares
        row: dict[str, object] = {"parameter": item.name}
        row |= {name: getattr(item, name) for name in ("unit", *SUMMARY, "point")}
        row |= {"least_squares": squares.values[item.name], "least_squares_stderr": squares.stderr[item.name]}
        row |= {"prior": item.prior, "contraction": item.contraction, "verdict": item.verdict_words}
        row |= {name: getattr(item, name) for name in ("reason", "ess_bulk", "ess_tail", "r_hat")}
        rows.append(row)
    return rows


def prediction_rows(fit: Fit) -> Iterator[dict[str, object]]:
    """One row per impact and measured column: measured (empty where it was not), predicted, with intervals in SI
    (angles in radians).
    """
    for observable in (item.everywhere(len(fit.problem.table)) for item in fit.problem.observables):
        point, prediction = observable.predict(fit.point.rebound)[0], prediction_of(fit, observable)
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
