"""Rebounds as people compare them: each measured output of a table, what a model says of it, and the difference."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from fitball.data.table import ImpactTable
from fitball.inference.prediction.new_impacts import NewPrediction, OutputPrediction
from fitball.models.types import Rebound
from fitball.observables import COMPARED, OBSERVABLES
from fitball.values import FloatArray, Impacts

# How well a prediction met measurements it had not seen.


@dataclass(frozen=True)
class ObservableScore:
    """One measured column against its prediction, in SI, over the `impacts` that could be predicted.

    `bias` and `rms` are those of the residuals; `rms_z` (1 expected) and the shares of measurements within the 68 and
    95 % intervals of a new measurement are None where the noise is not known.
    """

    output: str
    impacts: int
    bias: float
    rms: float
    rms_z: float | None
    within_68: float | None
    within_95: float | None


def scores(prediction: NewPrediction) -> tuple[ObservableScore, ...]:
    """One score for each output that was measured and could be predicted at some impact."""
    scored = [_score(output) for output in prediction.outputs if output.observed is not None]
    return tuple(score for score in scored if score is not None)


def impacts_seen(calibrated: Impacts, impacts: Impacts) -> int:
    """How many of the impacts, to the last digit, are among those a model was calibrated on."""
    known = set(_states(calibrated))
    return sum(state in known for state in _states(impacts))


def _states(impacts: Impacts) -> list[tuple[float, ...]]:
    return list(zip(impacts.v_x1.tolist(), impacts.v_y1.tolist(), impacts.omega_1.tolist(), strict=True))


def _score(output: OutputPrediction) -> ObservableScore | None:
    residual = output.residual
    if residual is None or output.observed is None or np.all(np.isnan(residual)):
        return None
    known = ~np.isnan(residual)
    left = residual[known]
    rms_z = within_68 = within_95 = None
    z = output.z
    if z is not None and output.measured is not None:
        rms_z = float(np.sqrt(np.mean(z[known] ** 2)))
        levels, observed = output.measured[:, known], output.observed[known]
        within_68 = float(np.mean((observed >= levels[1]) & (observed <= levels[3])))
        within_95 = float(np.mean((observed >= levels[0]) & (observed <= levels[4])))
    return ObservableScore(
        output.name, left.size, float(left.mean()), float(np.sqrt(np.mean(left**2))), rms_z, within_68, within_95
    )


OUTPUTS = (*COMPARED, *(name for name in OBSERVABLES if name not in COMPARED))


def measured_outputs(table: ImpactTable) -> dict[str, FloatArray]:
    """Outputs (impacts,) in SI that the table measures, with velocity and angle also where they follow from the
    independent columns; NaN where an impact has none.
    """
    outputs = {measurement.name: measurement.values for measurement in table.measurements}
    if "v_2" in outputs and "theta_2" in outputs:
        outputs["v_x2"] = outputs["v_2"] * np.cos(outputs["theta_2"])
        outputs["v_y2"] = outputs["v_2"] * np.sin(outputs["theta_2"])
    if "v_x2" in outputs and "v_y2" in outputs and "theta_2" not in outputs:
        outputs["theta_2"] = np.arctan2(outputs["v_y2"], outputs["v_x2"])
    return {name: outputs[name] for name in OUTPUTS if name in outputs and not np.isnan(outputs[name]).all()}


def predicted_outputs(rebound: Rebound, given_columns: Collection[str]) -> dict[str, FloatArray]:
    """Outputs of one parameter set (impacts,), from rebounds (1, impacts); those given to a model, and a contact time
    it does not have, are left out.
    """
    outputs = {}
    for name in OUTPUTS:
        column = OBSERVABLES[name]
        # Who is given the restitution knows it of the speed as well.
        given = name in given_columns or (column.restitution and "v_y2" in given_columns)
        values = column.predict(rebound)[0]
        if not given and not (column.timed and np.any(np.isnan(values))):
            outputs[name] = values
    return outputs


def output_errors(measured: Mapping[str, FloatArray], predicted: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Predicted minus measured for every output both have, (impacts,); angles by the short way round."""
    return {
        name: difference(name, predicted[name], measured[name])
        for name in OUTPUTS
        if name in measured and name in predicted
    }


def difference(name: str, one: FloatArray, other: FloatArray) -> FloatArray:
    """How much more `one` is of an output than `other`; angles by the short way round."""
    gap = one - other
    return np.asarray(np.angle(np.exp(1j * gap))) if OBSERVABLES[name].angle else gap


def root_mean_square(errors: FloatArray) -> float:
    """Root mean square of errors (impacts,), of those that are known; NaN where none is."""
    known = errors[~np.isnan(errors)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
