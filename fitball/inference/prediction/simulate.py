"""One impact through time: at given parameters, or from a fit with the spread that its posterior leaves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitball.errors import ModelError, ParameterError, suggestion
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.quantiles import BAND_LEVELS, MOST_UNSOLVED
from fitball.models.history import History
from fitball.models.model import Model
from fitball.models.specs import BALL_PARAMETERS, FOLLOWED
from fitball.models.types import regime_name
from fitball.values import FloatArray, Impacts, numbers

# Points of a course: a thousandth of the contact would not show in a picture.
POINTS = 401
# Posterior draws of a band: its 95 % ends then lie within about a tenth of its width.
DRAWS = 200
# Courses that a band is made of.
COURSES = (
    "y", "v_y", "v_x", "omega_1", "omega_2", "twist", "slip", "normal_force", "friction_force",
)  # fmt: skip


@dataclass(frozen=True)
class Band:
    """What posterior draws say of the courses, at equal shares of each draw's own contact time.

    `quantiles` maps `COURSES` to arrays (5, POINTS) of the levels `quantiles.BAND`; `contact_time` [s] has the same
    levels, (5,). `regimes` maps phase sequences to their probability among the `draws` that can be evaluated;
    `failed` is the number that cannot.
    """

    quantiles: Mapping[str, FloatArray]
    contact_time: FloatArray
    regimes: Mapping[str, float]
    draws: int
    failed: int


@dataclass(frozen=True)
class Simulation:
    """One impact through time: `history` at POINTS equal shares of the contact, a band where there is a posterior.

    `parameters` are those of the model in SI; `label` tells it from others in the same picture. `unsolved` is the
    share of the draws without a solution; above a half there is no band.
    """

    label: str
    model: Model
    parameters: Mapping[str, float]
    impact: Impacts
    history: History
    band: Band | None = None
    unsolved: float = 0.0

    @property
    def shares(self) -> FloatArray:
        """Shares of the contact time at which the courses are given, (POINTS,)."""
        return np.linspace(0.0, 1.0, POINTS)


def simulate(model: Model, parameters: Mapping[str, float], impact: Impacts, label: str = "") -> Simulation:
    """Follow one impact at these parameters. Raises what `Model.history` raises."""
    return Simulation(label, model, dict(parameters), impact, _history(model, parameters, impact))


def simulate_fit(fitted: FittedModel, impact: Impacts, draws: int = DRAWS) -> Simulation:
    """Follow one impact at the point estimate of a fit, with a band from `draws` of its posterior, evenly spaced.

    Without a band where more than half of them cannot be evaluated. Raises what `Model.history` raises at the point.
    """
    model = fitted.model
    kept = fitted.model_columns

    def values(row: FloatArray) -> dict[str, float]:
        return {fitted.names[k]: float(row[k]) for k in kept}

    point = simulate(model, values(fitted.point), impact, "point estimate")
    count = fitted.draws.shape[0]
    if count == 0:
        return point
    rows = fitted.draws[np.linspace(0, count - 1, min(draws, count)).astype(int)]
    histories = [history for history in (_drawn(model, values(row), impact) for row in rows) if history is not None]
    failed = len(rows) - len(histories)
    if failed > MOST_UNSOLVED * len(rows):
        return replace(point, unsolved=failed / len(rows))
    quantiles = {
        name: np.quantile([getattr(history, name) for history in histories], BAND_LEVELS, axis=0) for name in COURSES
    }
    counts = Counter(history.regime for history in histories).most_common()
    band = Band(
        quantiles=quantiles,
        contact_time=np.quantile([history.contact_time for history in histories], BAND_LEVELS),
        regimes={regime_name(code): number / len(histories) for code, number in counts},
        draws=len(histories),
        failed=failed,
    )
    return replace(point, band=band, unsolved=failed / len(rows))


def chosen_parameters(model: Model, changed: Mapping[str, float]) -> dict[str, float]:
    """Typical values of the model's parameters with some changed.

    Raises ParameterError for an unknown name, and for a parameter that has no typical value and is given none.
    """
    allowed = (*model.parameter_names, *BALL_PARAMETERS)
    for name in changed:
        if name not in allowed:
            raise ParameterError(f"unknown parameter '{name}' of model {model.name}: {suggestion(name, allowed)}")
        if numbers(name, changed[name]).ndim:
            raise ParameterError(f"{name} = {changed[name]!r}: expected one number")
    typical = {spec.name: spec.typical for spec in model.parameters if spec.typical is not None}
    missing = [name for name in model.parameter_names if name not in typical and name not in changed]
    if missing:
        raise ParameterError(
            f"model {model.name} needs a value of {', '.join(missing)}, for which there is no default"
        )
    return {**typical, **changed}


def _drawn(model: Model, parameters: Mapping[str, float], impact: Impacts) -> History | None:
    """None where the draw has no solution at this impact, as with a restitution beyond its mass ratio."""
    try:
        return _history(model, parameters, impact)
    except ParameterError:
        return None


def _history(model: Model, parameters: Mapping[str, float], impact: Impacts) -> History:
    if model.no_history:
        raise ModelError(f"model {model.name} {model.no_history}; models with a history: {', '.join(FOLLOWED)}")
    contact_time = float(model.rebound(parameters, impact).contact_time[0])
    return model.history(parameters, impact, np.linspace(0.0, 1.0, POINTS) * contact_time)
