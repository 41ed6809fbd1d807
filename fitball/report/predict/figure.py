"""The figure of predictions: each output of every impact with its interval, beside what was measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitball.inference.prediction.new_impacts import NewPrediction, OutputPrediction
from fitball.observables import COMPARED
from fitball.report.figures.canvas import new_figure, own_style, verbatim
from fitball.report.figures.quantities import output_label
from fitball.report.form.numbers import output_scale
from fitball.report.form.palette import MEASURED, MODEL, pale
from fitball.report.predict.rows import level_of

# Impacts whose names are written at the axis, and from which on intervals are drawn thinner.
MOST_NAMED, MANY = 24, 60


@own_style()
def predict_figure(prediction: NewPrediction, ids: Sequence[str]) -> Figure:
    """A panel for each output, impacts in their order: median, 68 and 95 % interval, measured value."""
    outputs = [output for output in prediction.outputs if output.name in COMPARED]
    named = len(ids) <= MOST_NAMED
    places = [level_of(prediction, k) for k in range(len(ids))]
    names = [f"{name} ({place})" if place else name for name, place in zip(ids, places, strict=True)]
    figure = new_figure(3.2 * len(outputs) + 0.4, 2.9 + 0.5 * named)
    for axis, output in zip(np.atleast_1d(figure.subplots(1, len(outputs))), outputs, strict=True):
        _draw(axis, output, np.arange(len(ids)))
        axis.set_title(output_label(output.name), fontsize=9)
        if named:
            axis.set_xticks(range(len(ids)), [verbatim(name) for name in names], rotation=90, fontsize=7)
        else:
            axis.set_xlabel("impact")
    return figure


def _draw(axis: Axes, output: OutputPrediction, places: np.ndarray) -> None:
    factor = output_scale(output.name).factor
    levels = output.rebound if output.measured is None else output.measured
    width = 1.0 if len(places) <= MANY else 0.5
    if levels is not None:
        axis.vlines(places, levels[0] * factor, levels[4] * factor, color=MODEL, linewidth=width)
        axis.vlines(places, levels[1] * factor, levels[3] * factor, color=pale(MODEL, 0.6), linewidth=4.0 * width)
    middle = output.point if output.rebound is None else output.rebound[2]
    axis.plot(places, middle * factor, "_", color=MODEL, markersize=6.0 * width)
    if output.observed is not None:
        axis.plot(places, output.observed * factor, "o", color=MEASURED, markersize=3.5 * width)
    axis.set_xlim(-0.5, len(places) - 0.5)
    axis.grid(axis="y")
