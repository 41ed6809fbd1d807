"""What the figure of curves shows: predictions at one speed and spin each, and the impacts near them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.inference.prediction.curves import curves
from fitball.inference.results.results import Curve
from fitball.report.figures.drawable import Drawable
from fitball.report.figures.measured import measured_outputs
from fitball.report.form.display_units import output_scale
from fitball.values import FloatArray


@dataclass(frozen=True)
class CurveColumn:
    """Predictions at one speed and spin, in the units in which people read them.

    `along` (points,) is the angle of incidence [deg], or the speed of a drop test [m/s]; `bands` hold by output
    quantiles (2.5, 16, 50, 84, 97.5 %) of shape (5, points), or (1, points) of a point fit. `rows` are the impacts
    near that speed and spin, and `within` the range of `along` that they span.
    """

    title: str
    along: FloatArray
    bands: Mapping[str, FloatArray]
    rows: NDArray[np.int64]
    within: tuple[float, float]


def impacts_along(fit: Drawable) -> FloatArray:
    """Where impacts stand on the axis of the curves (impacts,)."""
    impacts = fit.problem.impacts
    if fit.problem.table.has_tangential:
        return np.degrees(np.arctan2(impacts.v_y1, impacts.v_x1))
    return impacts.v_y1


def along_label(fit: Drawable) -> str:
    """What is on that axis."""
    return r"incidence $\theta_1$ [deg]" if fit.problem.table.has_tangential else "vertical incident speed [m/s]"


def curve_columns(fit: Drawable) -> tuple[CurveColumn, ...]:
    """A column for each curve of the fit, with the outputs that were measured or follow from such."""
    if fit.predictive is not None:
        found = fit.predictive.curves
    else:
        found = curves(fit.problem, np.array([[fit.point.values[name] for name in fit.problem.free_names]]))
    names = list(measured_outputs(fit))
    place = impacts_along(fit)
    return tuple(_column(fit, item, names, place) for item in found)


def _column(fit: Drawable, item: Curve, names: list[str], place: FloatArray) -> CurveColumn:
    kept = slice(None) if fit.predictive is not None else slice(0, 1)
    near = place[item.rows]
    return CurveColumn(
        title=_title(item, fit.problem.model.needs_cor),
        along=item.along if item.speed is None else np.degrees(item.along),
        bands={name: item.outputs[name][kept] * output_scale(name).factor for name in names},
        rows=item.rows,
        within=(float(near.min()), float(near.max())),
    )


def _title(item: Curve, needs_cor: bool) -> str:
    if item.speed is None:
        return item.label
    words = f"{item.speed:g} m/s, {item.spin:+g} rad/s".replace("+0 ", "0 ").replace("-0 ", "0 ")
    cor = item.impacts.cor
    given = f", COR {cor[0]:.2f}" if needs_cor and cor is not None else ""
    return f"{item.label}: {words}{given}" if item.label else f"{words}{given}"
