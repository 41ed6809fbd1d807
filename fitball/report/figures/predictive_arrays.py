"""What the figure of measured against predicted shows, computed before anything is drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.inference.problem.observables import Observable
from fitball.report.figures.drawable import Drawable
from fitball.report.figures.measured import measured_part, measured_rows, noise_sd, prediction_of
from fitball.report.form.display_units import output_scale
from fitball.values import FloatArray

SHARE = 0.95
# Bins of a band that stands for more intervals than can be told apart.
BINS = 24


@dataclass(frozen=True)
class Agreement:
    """One output at the impacts `rows` where it was measured, in the unit in which people read it.

    `predicted` is the posterior median without noise, or the point estimate; 95 % intervals (2, rows) of the model,
    which is what its parameters leave open (None for a point fit), and of a new `measurement`, which noise widens.
    """

    name: str
    rows: NDArray[np.int64]
    measured: FloatArray
    predicted: FloatArray
    model: FloatArray | None
    measurement: FloatArray

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Which measurements lie in the interval of a new one."""
        return np.asarray((self.measured >= self.measurement[0]) & (self.measured <= self.measurement[1]))

    @property
    def rms(self) -> float:
        """Root mean square difference of measured and predicted."""
        return float(np.sqrt(np.mean((self.measured - self.predicted) ** 2)))

    @property
    def words(self) -> str:
        """How many measurements lie inside."""
        return f"{np.count_nonzero(self.inside):,} of {self.inside.size:,} within 95 %"


def agreements(fit: Drawable) -> tuple[Agreement, ...]:
    """Every measured column that the fit answers for."""
    return tuple(_agreement(fit, item) for item in fit.problem.observables)


def _agreement(fit: Drawable, observable: Observable) -> Agreement:
    factor = output_scale(observable.name).factor
    rows, measured = measured_rows(observable), measured_part(observable, observable.observed)
    prediction = prediction_of(fit, observable)
    if prediction is None:
        predicted = measured_part(observable, observable.predict(fit.point.rebound)[0])
        away = fit.problem.noise.reach(SHARE, fit.point.values) * noise_sd(fit, observable)
        centre = predicted + _bias(fit, observable)
        ends = np.stack([centre - away, centre + away])
        return Agreement(observable.name, rows, factor * measured, factor * predicted, None, factor * ends)

    def both(low: FloatArray, high: FloatArray) -> FloatArray:
        return factor * np.stack([measured_part(observable, low), measured_part(observable, high)])

    return Agreement(
        observable.name,
        rows,
        factor * measured,
        factor * measured_part(observable, prediction.median),
        both(prediction.mean_q025, prediction.mean_q975),
        both(prediction.data_q025, prediction.data_q975),
    )


def _bias(fit: Drawable, observable: Observable) -> FloatArray:
    """The bias of each impact's group at the point estimate."""
    if fit.problem.group_bias is None:
        return np.zeros(1)
    columns = {name: np.array([value]) for name, value in fit.point.values.items()}
    return measured_part(observable, fit.problem.group_bias.offset(columns, observable.name)[0])


def interval_band(item: Agreement, interval: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (bins,) and ends (2, bins) of the interval about the 1:1 line: medians over bins of equal count."""
    order = np.argsort(item.predicted, kind="stable")
    parts = [part for part in np.array_split(order, BINS) if part.size]
    places = np.array([np.median(item.predicted[part]) for part in parts])
    ends = np.stack([[np.median(side[part] - item.predicted[part]) for part in parts] for side in interval])
    return places, places + ends
