"""What each model of a comparison says of a parameter, beside the mixture of them by stacking weights.

The draws are those that the comparison has already; nothing is fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitball.inference.comparison.results import ModelScore
from fitball.inference.prediction.court_pace import pace_by_surface
from fitball.inference.results.assumptions import PACE, Quantity, Summary, span
from fitball.inference.results.results import thinned
from fitball.inference.results.score_difference import elpd_difference
from fitball.values import FloatArray

# Draws of each model.
DRAWS = 4000
# Share of a model's draws that must give a quantity for it to be told.
TOLD = 0.9
LEVELS = np.array([0.025, 0.5, 0.975])


def over_models(models: Sequence[ModelScore], stacking: Mapping[str, float]) -> dict[str, Quantity]:
    """Every quantity that at least two of the models, best first, have."""
    drawn: dict[str, dict[str, FloatArray]] = {}
    units: dict[str, str] = {}
    for score in models:
        units |= {estimate.name: estimate.unit for estimate in score.fit.estimates}
        for name, column in _quantities(score).items():
            drawn.setdefault(name, {})[score.name] = column
    best = models[0].loo.elpd
    as_good = [score.name for score in models if not elpd_difference(best, score.loo.elpd).sure]
    return {
        name: _quantity(columns, units.get(name, ""), stacking, as_good)
        for name, columns in drawn.items()
        if len(columns) > 1
    }


def _quantities(score: ModelScore) -> dict[str, FloatArray]:
    """Draws (draws,) of each quantity of a model."""
    assert score.fit.posterior is not None
    problem, values = score.fit.problem, thinned(score.fit.posterior, DRAWS)
    columns = dict(zip(problem.free_names, values.T, strict=True))
    for surface, rating in pace_by_surface(problem, values).items():
        known = rating[np.isfinite(rating)]
        if known.size >= TOLD * rating.size:
            columns[f"{PACE} of {surface}" if surface else PACE] = known
    return columns


def _quantity(
    columns: Mapping[str, FloatArray], unit: str, weights: Mapping[str, float], as_good: list[str]
) -> Quantity:
    by_model = {name: _summary(column, np.ones(column.size)) for name, column in columns.items()}
    weight = sum(weights[name] for name in columns)
    stacked = None
    if weight > 0.0:
        shares = [np.full(column.size, weights[name] / column.size) for name, column in columns.items()]
        stacked = _summary(np.concatenate(list(columns.values())), np.concatenate(shares))
    good = [name for name in columns if name in as_good]
    over = span(by_model[good[0]], [(name, name, by_model[name]) for name in good[1:]]) if good else None
    return Quantity(unit, by_model, stacked, min(weight, 1.0), tuple(good), over)


def _summary(column: FloatArray, weights: FloatArray) -> Summary:
    """Of draws (draws,) that count by `weights`."""
    low, median, high = np.quantile(column, LEVELS, weights=weights, method="inverted_cdf").tolist()
    mean = np.average(column, weights=weights)
    return Summary(median, float(np.sqrt(np.average((column - mean) ** 2, weights=weights))), low, high)
