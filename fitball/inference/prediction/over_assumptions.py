"""How far a prediction moves over assumptions that the fitted table cannot tell apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitball.inference.prediction.new_impacts import NewPrediction, output_observables
from fitball.inference.results.assumptions import Alternative, Assumptions
from fitball.inference.results.fitted_model import FittedModel


def with_assumptions(prediction: NewPrediction, fitted: FittedModel, found: Assumptions | None) -> NewPrediction:
    """The prediction of `fitted` with, for each output, its lowest and highest value over the fit itself (its median,
    or the point where there is none) and all alternatives that are as good, each at the mean of its posterior.

    Nothing is added where there was no look at assumptions or no alternative is as good.
    """
    if found is None or not found.as_good:
        return prediction
    impacts = prediction.impacts
    rebounds = [_alternative(fitted, item).rebound(impacts) for item in found.as_good]
    observables = {item.name: item for item in output_observables(fitted, len(impacts), ())}
    outputs = []
    for output in prediction.outputs:
        own = output.point if output.rebound is None else output.rebound[2]
        every = np.stack([own, *(observables[output.name].predict(rebound)[0] for rebound in rebounds)])
        # What an alternative cannot answer takes no part.
        over = np.stack([np.fmin.reduce(every), np.fmax.reduce(every)])
        outputs.append(replace(output, over=over))
    return replace(prediction, outputs=tuple(outputs))


def _alternative(fitted: FittedModel, item: Alternative) -> FittedModel:
    """The fitted model with one choice changed; a kind of noise changes its parameters only."""
    closure, _, option = item.name.partition("=")
    options = {**fitted.options, closure: option} if closure in fitted.options else fitted.options
    values = np.array(list(item.values.values()))
    return replace(fitted, options=options, names=tuple(item.values), point=values, draws=np.empty((0, values.size)))
