"""How well a prediction met measurements it had not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitball.inference.prediction.new_impacts import NewPrediction, OutputPrediction
from fitball.values import Impacts


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
