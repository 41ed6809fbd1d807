"""One impact through time: at given parameters, or from a fit with the spread that its posterior leaves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.errors import ModelError, ParameterError, suggestion
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.quantiles import BAND_LEVELS, MOST_UNSOLVED
from fitball.models.history import History
from fitball.models.model import Model
from fitball.models.specs import BALL_PARAMETERS, FOLLOWED
from fitball.models.types import Rebound, regime_name
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, Impacts, numbers

# Which sequence of slip and grip an impact goes through, over angle and spin at one speed.

# Points along angle and along spin: a point a pixel of the figure.
ANGLES, SPINS = 640, 480
# What an impact without a solution has for a sequence; no packed sequence is zero.
NONE = 0
# Points along the angle from which the ends of the sequences at one spin are narrowed down, and halvings.
SCANNED, HALVINGS = 2001, 40


@dataclass(frozen=True)
class Window:
    """What a map shows: one incident `speed` [m/s], and the range of `angle` [rad] and of `spin` [rad/s]."""

    speed: float
    angle: tuple[float, float]
    spin: tuple[float, float]

    def impacts(self, angle: FloatArray, spin: FloatArray) -> Impacts:
        """Impacts at this speed, of the shape (impacts,) of both."""
        return Impacts.polar(self.speed, angle, spin)

    def grid(self, angles: int, spins: int) -> tuple[FloatArray, FloatArray]:
        """The middles of equal cells, angles (angles,) [rad] and spins (spins,) [rad/s]."""
        cells = []
        for (low, high), count in ((self.angle, angles), (self.spin, spins)):
            cells.append(low + (high - low) * (np.arange(count) + 0.5) / count)
        return cells[0], cells[1]


@dataclass(frozen=True)
class RegimeMap:
    """Sequences over angle and spin: `regime` (spins, angles) packed (`NONE`: no solution, for the reason `status`),
    `outputs` by column of the rebound in SI. `along_angle` are the sequences of an impact without spin, each with the
    angles [rad] between which it is passed through.
    """

    window: Window
    angles: FloatArray
    spins: FloatArray
    regime: NDArray[np.int64]
    status: NDArray[np.int8]
    outputs: Mapping[str, FloatArray]
    along_angle: tuple[tuple[str, float, float], ...]

    @property
    def areas(self) -> dict[str, float]:
        """The share of the map that each sequence takes, the largest first; "" has no solution."""
        codes, counts = np.unique(self.regime, return_counts=True)
        order = sorted(zip(codes, counts, strict=True), key=lambda pair: (-pair[1], pair[0]))
        return {regime_name(code): float(count) / self.regime.size for code, count in order}


def regime_map(fitted: FittedModel, window: Window) -> RegimeMap:
    """The map at the point estimate.

    Raises ModelError for a model without motion along the court, or with each impact's restitution as an input.
    """
    if not fitted.tangential:
        raise ModelError("a drop test has no motion along the court, so there are no regimes to map")
    refuse_told(fitted)
    angles, spins = window.grid(ANGLES, SPINS)
    rebound = fitted.rebound(_meshed(window, angles, spins))
    shape = (spins.size, angles.size)
    codes = _codes(rebound)[0].reshape(shape)
    return RegimeMap(
        window=window,
        angles=angles,
        spins=spins,
        regime=codes,
        status=rebound.status[0].reshape(shape),
        outputs={name: column.predict(rebound)[0].reshape(shape) for name, column in OBSERVABLES.items()},
        along_angle=_along_angle(fitted, window),
    )


def refuse_told(fitted: FittedModel) -> None:
    """Raise ModelError for a model that cannot bounce a new ball without its measured rebound."""
    if fitted.model.needs_cor:
        raise ModelError(
            "cor = measured takes the restitution of each impact as an input and predicts none: calibrate with "
            "cor = line or mean"
        )


def _meshed(window: Window, angles: FloatArray, spins: FloatArray) -> Impacts:
    angle, spin = np.meshgrid(angles, spins)
    return window.impacts(angle.ravel(), spin.ravel())


def _codes(rebound: Rebound) -> NDArray[np.int64]:
    codes: NDArray[np.int64] = np.where(rebound.status == 0, rebound.regime, NONE)
    return codes


def _along_angle(fitted: FittedModel, window: Window) -> tuple[tuple[str, float, float], ...]:
    """Sequences without spin, the angles between them found by halving."""

    def codes_at(angle: FloatArray) -> NDArray[np.int64]:
        rebound = fitted.rebound(window.impacts(angle, np.zeros_like(angle)))
        return _codes(rebound).ravel()

    scanned = np.linspace(*window.angle, SCANNED)
    codes = codes_at(scanned)
    changes = np.flatnonzero(codes[1:] != codes[:-1])
    low, high, left = scanned[changes], scanned[changes + 1], codes[changes]
    for _ in range(HALVINGS if changes.size else 0):
        middle = 0.5 * (low + high)
        same = codes_at(middle) == left
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    ends = [*map(float, low), window.angle[1]]
    starts = [window.angle[0], *ends[:-1]]
    names = [regime_name(code) for code in (codes[0], *codes[changes + 1])]
    return tuple(zip(names, starts, ends, strict=True))


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
    """The courses by posterior draws, at equal shares of each draw's own contact time.

    `quantiles` maps `COURSES` to arrays (5, POINTS) of the levels `quantiles.BAND`; `contact_time` [s] and `gaps`
    have the same levels, (5,). `regimes` maps phase sequences to their probability among the `draws` that can be
    evaluated; `failed` is the number that cannot.
    """

    quantiles: Mapping[str, FloatArray]
    contact_time: FloatArray
    gaps: Mapping[str, FloatArray]
    regimes: Mapping[str, float]
    draws: int
    failed: int


@dataclass(frozen=True)
class Simulation:
    """One impact through time: `history` at POINTS equal shares of the contact, a band where there is a posterior.

    `parameters` are those of the model in SI; `gaps` what lies between the flights before and after, by column of a
    rebound in SI, as far as the model gives it; `label` names it in a picture of several. `unsolved` is the share of
    the draws without a solution; above a half there is no band.
    """

    label: str
    model: Model
    parameters: Mapping[str, float]
    impact: Impacts
    history: History
    gaps: Mapping[str, float]
    band: Band | None = None
    unsolved: float = 0.0

    @property
    def shares(self) -> FloatArray:
        """Shares of the contact time at which the courses are given, (POINTS,)."""
        return np.linspace(0.0, 1.0, POINTS)


def simulate(model: Model, parameters: Mapping[str, float], impact: Impacts, label: str = "") -> Simulation:
    """Follow one impact at these parameters. Raises what `Model.history` raises."""
    return Simulation(label, model, dict(parameters), impact, *_followed(model, parameters, impact))


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
    drawn = [found for found in (_drawn(model, values(row), impact) for row in rows) if found is not None]
    histories, gaps = [history for history, _gaps in drawn], [gaps for _history, gaps in drawn]
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
        gaps={name: np.quantile([one[name] for one in gaps], BAND_LEVELS) for name in point.gaps},
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
        raise ParameterError(f"model {model.name} needs a value of {', '.join(missing)}, which has no default")
    return {**typical, **changed}


def _drawn(
    model: Model, parameters: Mapping[str, float], impact: Impacts
) -> tuple[History, Mapping[str, float]] | None:
    """None where the draw has no solution at this impact, as with a restitution beyond its mass ratio."""
    try:
        return _followed(model, parameters, impact)
    except ParameterError:
        return None


def _followed(model: Model, parameters: Mapping[str, float], impact: Impacts) -> tuple[History, Mapping[str, float]]:
    """The courses, and what lies between the flights."""
    if model.no_history:
        raise ModelError(f"model {model.name} {model.no_history}; models with a history: {', '.join(FOLLOWED)}")
    rebound = model.rebound(parameters, impact)
    history = model.history(parameters, impact, np.linspace(0.0, 1.0, POINTS) * float(rebound.contact_time[0]))
    known = (column for column in OBSERVABLES.values() if column.gap and model.gives(column))
    return history, {column.name: float(column.predict(rebound)[0]) for column in known}
