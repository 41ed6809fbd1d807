"""Rebounds as people compare them: each measured output of a table, its prediction by a model, and the difference."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.data.table import ImpactTable
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import Golden
from fitball.models.types import Rebound, regime_name
from fitball.observables import COMPARED, OBSERVABLES
from fitball.values import FloatArray, Impacts

# Golden rebounds, and how far the outputs of a port are from them.

# Golden impacts.
COUNT = 12


def golden_impacts(impacts: Impacts) -> Impacts:
    """Half of them spread over the table; the others inside its range with spins from back to top."""
    rows = np.unique(np.linspace(0, len(impacts) - 1, min(COUNT // 2, len(impacts))).astype(int))
    count = COUNT - rows.size
    share = (np.arange(count) + 0.5) / count

    def across(column: np.ndarray, order: np.ndarray) -> np.ndarray:
        return np.concatenate([column[rows], column.min() + (column.max() - column.min()) * order])

    # Golden-ratio steps cover the square evenly without a random generator.
    other = np.modf(share * count * 0.6180339887498949)[0]
    v_x1, v_y1 = across(impacts.v_x1, other), across(impacts.v_y1, share)
    omega = np.concatenate([impacts.omega_1[rows], np.linspace(-200.0, 400.0, count)])
    if np.ptp(impacts.v_x1) + np.max(np.abs(impacts.v_x1)) <= 0.0:
        omega = np.zeros(COUNT)
    # Ports mirror a ball that flies the other way.
    way = np.where(v_x1 < 0.0, -1.0, 1.0)
    return Impacts(way * v_x1, v_y1, way * omega, None if impacts.cor is None else across(impacts.cor, share))


def golden(fitted: FittedModel, impacts: Impacts) -> Golden:
    """Rebounds of those impacts at the point estimate; impacts the model cannot evaluate are left out."""
    chosen = golden_impacts(impacts)
    rebound = fitted.rebound(chosen)
    kept = np.flatnonzero(rebound.status[0] == 0)
    names = dict(zip(fitted.names, map(float, fitted.point), strict=True))
    return Golden(names, chosen.take(kept), rebound.each(lambda array: array[0][kept]))


@dataclass(frozen=True)
class OutputCheck:
    """One output: largest absolute difference [SI], largest relative one, and its impact.

    Relative: speeds to the incident speed `sqrt(v_x1^2 + v_y1^2 + (R omega_1)^2)`, spins times `R` likewise, times to
    themselves, angles [rad] as they are; path and turn between the flights to that speed times the time between them.
    """

    name: str
    absolute: float
    relative: float
    worst: int


@dataclass(frozen=True)
class PortCheck:
    """All golden impacts (in their order): `relative` (impacts,) is the largest over outputs, `regimes` the model's.

    `regimes_wrong` are the impacts whose regime the port names differently.
    """

    outputs: tuple[OutputCheck, ...]
    relative: FloatArray
    regimes: tuple[str, ...]
    regimes_wrong: tuple[int, ...]
    tolerance: float

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Which impacts fail, (impacts,)."""
        failed = ~(self.relative <= self.tolerance)
        failed[list(self.regimes_wrong)] = True
        return failed

    @property
    def passed(self) -> bool:
        """Whether no impact fails."""
        return not bool(np.any(self.failed))


def expected_outputs(fitted: FittedModel, golden: Golden) -> dict[str, FloatArray]:
    """Every output that the model gives of the golden impacts, (impacts,), in SI."""
    return {
        name: np.asarray(column.predict(golden.rebound), dtype=np.float64)
        for name, column in OBSERVABLES.items()
        if fitted.model.gives(column)
    }


def check_port(
    fitted: FittedModel,
    golden: Golden,
    outputs: Mapping[str, FloatArray],
    regimes: tuple[str, ...] | None,
    tolerance: float,
) -> PortCheck:
    """Compare `outputs` (impacts,), in SI and in the order of the golden impacts, with what the model gives."""
    expected = expected_outputs(fitted, golden)
    scales = _scales(fitted, golden, expected)
    errors = {name: np.abs(values - expected[name]) for name, values in outputs.items()}
    relative = {name: errors[name] / scales[name] for name in errors}
    checks = tuple(
        OutputCheck(name, float(errors[name].max()), float(relative[name].max()), int(np.argmax(relative[name])))
        for name in errors
    )
    names = tuple(regime_name(code) for code in golden.rebound.regime)
    codes = [str(int(code)) for code in golden.rebound.regime]
    said = regimes if regimes is not None else names
    wrong = tuple(k for k, text in enumerate(said) if text not in (names[k], codes[k]))
    largest = np.max(np.stack(list(relative.values())), axis=0)
    return PortCheck(checks, largest, names, wrong, tolerance)


def _scales(fitted: FittedModel, golden: Golden, expected: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    given, radius = golden.impacts, fitted.ball.radius
    speed = np.sqrt(given.v_x1**2 + given.v_y1**2 + (radius * given.omega_1) ** 2)
    by_unit = {"m/s": speed, "rad/s": speed / radius, "rad": np.ones_like(speed)}
    # Path and turn may be zero: what the ball goes, and its surface turns, between the flights.
    between = golden.rebound.gap_time
    by_name = {"gap_path": speed * between, "gap_turn": speed * between / radius}
    return {name: by_name.get(name, by_unit.get(OBSERVABLES[name].unit, values)) for name, values in expected.items()}


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
