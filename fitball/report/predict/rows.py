"""Predictions of new impacts as rows: remarks on each, every number for CSV and JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from fitball.inference.prediction.new_impacts import NewPrediction, ObservableScore, OutputPrediction
from fitball.inference.results.quantiles import BAND
from fitball.observables import OBSERVABLES
from fitball.report.form.numbers import INCIDENT, output_scale, percent
from fitball.values import FloatArray


def remarks_on(prediction: NewPrediction, row: int) -> list[str]:
    """What limits the prediction of one impact: its incident state is outside the range of the fitted data, or the
    model has no solution there for some draws.
    """
    reach = prediction.range
    parts = []
    for name, beyond in reach.beyond.items():
        if beyond[row] != 0.0:
            scale = INCIDENT[name]
            low, high = (end * scale.factor for end in reach.limits[name])
            word = "above" if beyond[row] > 0.0 else "below"
            amount = abs(beyond[row]) * scale.factor
            parts.append(f"{name} is {amount:.3g} {scale.unit} {word} {low:.4g} to {high:.4g} {scale.unit}")
    if reach.hull_distance is not None and reach.new_combination[row]:
        parts.append(
            f"its combination of velocity and spin is {reach.hull_distance[row]:.2g} m/s outside those of the data "
            f"(flagged from {reach.slack:.2g} m/s)"
        )
    remarks = ["outside the range of the fitted data: " + "; ".join(parts) + "."] if parts else []
    if reach.lines and reach.beyond["v_y1"][row] != 0.0:
        word = "line is" if len(reach.lines) == 1 else "lines are"
        amount = abs(float(reach.beyond["v_y1"][row]))
        remarks.append(f"the {' and '.join(reach.lines)} {word} extrapolated by {amount:.3g} m/s in v_y1.")
    reasons = "; ".join(prediction.failures[row])
    if reasons and prediction.draws == 0:
        remarks.append(f"the model has no solution there at the best-fit parameters: {reasons}.")
    elif reasons:
        rest = "There are no intervals" if prediction.withheld[row] else "Intervals are those of the other draws"
        remarks.append(
            f"{percent(prediction.unsolved[row], fine=True)} of the draws have no solution there ({reasons}). {rest}."
        )
    return remarks


def level_of(prediction: NewPrediction, row: int) -> str:
    """The surface, ball or place of one impact in words; empty where no parameter differs between these."""
    return ", ".join(f"{column} {labels[row]}" for column, labels in prediction.levels.items())


def _columns(output: OutputPrediction) -> dict[str, FloatArray]:
    """Every column of one output in SI, by its kind; those that do not exist are absent."""
    columns: dict[str, FloatArray] = {"point": output.point}
    if output.rebound is not None:
        columns["median"] = output.rebound[2]
        columns |= {f"mean_{name}": output.rebound[k] for k, name in enumerate(BAND) if name != "median"}
    if output.measured is not None:
        columns |= {f"data_{name}": output.measured[k] for k, name in enumerate(BAND) if name != "median"}
    if output.shares is not None:
        columns |= {"sd_parameters": output.shares.parameters, "sd_incident": output.shares.incident}
        if output.shares.measurement is not None:
            columns["sd_measurement"] = output.shares.measurement
    if output.over is not None:
        columns |= {"over_low": output.over[0], "over_high": output.over[1]}
    if output.observed is not None and output.residual is not None:
        columns |= {"measured": output.observed, "residual": output.residual}
    return columns


def _number(value: float) -> float | None:
    """None where there is no number."""
    return None if math.isnan(value) else float(value)


def prediction_csv_rows(prediction: NewPrediction, ids: Sequence[str]) -> list[dict[str, object]]:
    """One row for each impact; headers carry units. Intervals `mean_*` are of the rebound itself, `data_*` of a new
    measurement of it.
    """
    impacts, reach = prediction.impacts, prediction.range
    columns: dict[str, Sequence[object]] = {
        "id": ids,
        "v_x1 [m/s]": impacts.v_x1.tolist(),
        "v_y1 [m/s]": impacts.v_y1.tolist(),
        "omega_1 [rad/s]": impacts.omega_1.tolist(),
        **prediction.levels,
    }
    for output in prediction.outputs:
        scale = output_scale(output.name)
        for kind, column in _columns(output).items():
            columns[f"{output.name}_{kind} [{scale.unit}]"] = [_number(value) for value in column * scale.factor]
        if output.z is not None:
            columns[f"{output.name}_z"] = [_number(value) for value in output.z]
    columns["regimes"] = [
        "; ".join(f"{name} {share:.4g}" for name, share in row.items()) for row in prediction.regimes
    ]
    columns["failed"] = [sum(row.values()) for row in prediction.failures]
    columns["failed_because"] = ["; ".join(row) for row in prediction.failures]
    columns["intervals"] = [intervals_of(prediction, k) for k in range(len(impacts))]
    columns["outside"] = ["yes" if flag else "no" for flag in reach.outside]
    for name, beyond in reach.beyond.items():
        scale = INCIDENT[name]
        columns[f"{name}_beyond [{scale.unit}]"] = (beyond * scale.factor).tolist()
    if reach.hull_distance is not None:
        columns["hull_distance [m/s]"] = reach.hull_distance.tolist()
    columns["extrapolated"] = [_extrapolated(prediction, k) for k in range(len(impacts))]
    return [{name: column[k] for name, column in columns.items()} for k in range(len(impacts))]


def intervals_of(prediction: NewPrediction, row: int) -> str:
    """Which draws the intervals of one impact are made of."""
    if prediction.draws == 0:
        return "none"
    if prediction.withheld[row]:
        return "withheld"
    return "the draws that can be solved" if prediction.failures[row] else "all draws"


def _extrapolated(prediction: NewPrediction, row: int) -> str:
    return " ".join(prediction.range.lines) if prediction.range.beyond["v_y1"][row] != 0.0 else ""


def prediction_json(
    prediction: NewPrediction, ids: Sequence[str], scores: Sequence[ObservableScore], notes: Sequence[str]
) -> dict[str, Any]:
    """The whole prediction in SI (angles in radians), one object for each impact."""
    reach = prediction.range
    impacts: list[dict[str, Any]] = []
    for k, name in enumerate(ids):
        outputs = {
            output.name: {kind: _number(column[k]) for kind, column in _columns(output).items()}
            | ({} if output.z is None else {"z": _number(output.z[k])})
            for output in prediction.outputs
        }
        state = {axis: float(getattr(prediction.impacts, axis)[k]) for axis in ("v_x1", "v_y1", "omega_1")}
        impacts.append(
            {"id": name}
            | (
                {"levels": {column: labels[k] for column, labels in prediction.levels.items()}}
                if prediction.levels
                else {}
            )
            | state
            | {
                "outputs": outputs,
                "regimes": dict(prediction.regimes[k]),
                "failed": dict(prediction.failures[k]),
                "intervals": intervals_of(prediction, k),
                "outside": bool(reach.outside[k]),
                "beyond": {quantity: float(column[k]) for quantity, column in reach.beyond.items()},
                "hull_distance": None if reach.hull_distance is None else float(reach.hull_distance[k]),
                "extrapolated": _extrapolated(prediction, k).split(),
            }
        )
    return {
        "units": {output.name: OBSERVABLES[output.name].unit for output in prediction.outputs},
        "draws": prediction.draws,
        "calibrated": {name: list(ends) for name, ends in reach.limits.items()},
        "hull_slack": reach.slack,
        "impacts": impacts,
        "validation": [asdict(score) for score in scores],
        "outside": int(np.count_nonzero(reach.outside)),
        "notes": list(notes),
    }
