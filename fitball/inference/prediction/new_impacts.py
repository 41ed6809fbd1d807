"""Posterior prediction of new impacts: the rebound itself and, apart from it, a new measurement of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fitball.data.table import Covariance, ImpactTable
from fitball.errors import ModelError, ParameterError, check_whole
from fitball.inference.likelihood import regime_mixture
from fitball.inference.prediction.impact_levels import Asked, ImpactLevels, by_levels, is_new, levels_of_impacts
from fitball.inference.prediction.posterior_predictive import in_order, joined, regime_shares, with_noise
from fitball.inference.prediction.reach import CalibratedRange, calibrated_range, lines_of
from fitball.inference.problem.observables import Observable, build_observables, derived, noise_in
from fitball.inference.problem.row_errors import errors_from
from fitball.inference.results.assumptions import Alternative, Assumptions
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.quantiles import MOST_UNSOLVED, bands
from fitball.models.types import OUTPUTS, STATUS_REASON, Rebound, Status
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, Impacts

# New impacts whose incident state is itself uncertain: drawn anew for each draw of the posterior. Nothing is
# linearised here: the bounce of every drawn state is computed. The variance of a rebound comes from the parameters
# and from the incident state; a measurement of it adds its noise.


@dataclass(frozen=True)
class Shares:
    """Standard deviations (impacts,) of one output by source: the parameters (at the stated incident state), the
    incident state (averaged over the parameters), and a new measurement (None where its noise is not known).

    The sum of their squares is the variance of a new measurement, but for the interaction of parameters and incident
    state.
    """

    parameters: FloatArray
    incident: FloatArray
    measurement: FloatArray | None


def drawn_rebound(
    fitted: FittedModel, impacts: Impacts, covariance: FloatArray, rng: np.random.Generator
) -> tuple[Rebound, FloatArray]:
    """Rebounds (draws, impacts), each draw of the parameters with incident states of its own, and how far these are
    from those that were read (draws, impacts, 3).

    `covariance` (impacts, 3, 3) is that of `(v_x1, v_y1, omega_1)` in SI. A drawn state that does not move towards
    the court is no impact: it is NaN and marked.
    """
    draws = fitted.draws.shape[0]
    root = regime_mixture.roots(covariance)
    moves = np.einsum("kij,dkj->dki", root, rng.standard_normal((draws, len(impacts), 3)))
    possible = impacts.v_y1 + moves[..., 1] > 0.0
    # Something must be bounced in the place of what is no impact; it is struck out below.
    moves[~possible] = 0.0
    every = np.arange(len(impacts))
    made = [
        fitted.rebound(regime_mixture.shifted(impacts, moves[k], every), fitted.draws[k : k + 1])
        for k in range(draws)
    ]
    rebound = Rebound.joined(made, axis=0)
    for name in OUTPUTS:
        getattr(rebound, name)[~possible] = np.nan
    rebound.status[~possible] = Status.NO_IMPACT
    return rebound, moves


def shares(fixed: FloatArray, one: FloatArray, other: FloatArray, noise: FloatArray | None) -> Shares:
    """Where the uncertainty of one output comes from.

    All (draws, impacts), with the same parameters in a row: `fixed` at the stated incident state, `one` and `other`
    at two independent draws of it, whose half squared difference is the variance they leave given the parameters;
    `noise` of a new measurement.
    """
    incident = np.sqrt(over_draws(np.nanmean, 0.5 * (one - other) ** 2))
    return Shares(over_draws(np.nanstd, fixed), incident, None if noise is None else over_draws(np.nanstd, noise))


def over_draws(statistic: Callable[..., FloatArray], array: FloatArray) -> FloatArray:
    """A statistic (impacts,) of what is not NaN among draws (draws, impacts); NaN where no draw can be evaluated."""
    result = np.full(array.shape[1], np.nan)
    known = np.any(np.isfinite(array), axis=0)
    result[known] = statistic(array[:, known], axis=0)
    return result


# Impacts of one batch, so that memory does not grow with the table. Random numbers depend on it, so it is fixed.
BATCH = 250


@dataclass(frozen=True)
class OutputPrediction:
    """One output of every impact in SI, all (impacts,) or (5, impacts).

    `rebound` are the quantiles `quantiles.BAND` of the rebound itself (what the parameters leave open), `measured`
    those of a new measurement, `mean` and `sd` its moments. None where there is no posterior, and for `measured`,
    `mean`, `sd` where the noise is not known. `point` is at the point estimate; `observed` the measured value.
    Where the incident state is uncertain all but `point` include that, and `shares` splits the variance by source.
    `over` (2, impacts) is the range over assumptions, see `over_assumptions`; None where that was not examined.
    """

    name: str
    point: FloatArray
    rebound: FloatArray | None = None
    measured: FloatArray | None = None
    mean: FloatArray | None = None
    sd: FloatArray | None = None
    observed: FloatArray | None = None
    shares: Shares | None = None
    over: FloatArray | None = None

    @property
    def residual(self) -> FloatArray | None:
        """Observed minus predicted (the median, or the point where there is no posterior)."""
        if self.observed is None:
            return None
        return self.observed - (self.point if self.rebound is None else self.rebound[2])

    @property
    def z(self) -> FloatArray | None:
        """Observed minus the mean of a new measurement, over its sd."""
        if self.observed is None or self.mean is None or self.sd is None:
            return None
        return (self.observed - self.mean) / self.sd


@dataclass(frozen=True)
class NewPrediction:
    """Predictions of new impacts.

    `regimes[k]` maps phase sequences to their probability at impact k, among the draws that can be evaluated there
    (empty for a drop test); `failures[k]` maps each reason why others cannot to their share of all draws. `draws` is
    0 for a point fit. Where `withheld` (impacts,) more than half of the draws cannot be evaluated: all but the point
    estimate is NaN. `levels` are the surface, ball or place (impacts,) by the column that names it, where parameters
    differ between these.
    """

    impacts: Impacts
    outputs: tuple[OutputPrediction, ...]
    regimes: tuple[Mapping[str, float], ...]
    failures: tuple[Mapping[str, float], ...]
    range: CalibratedRange
    draws: int
    levels: ImpactLevels = field(default_factory=dict)

    @property
    def unsolved(self) -> FloatArray:
        """The share of the draws (of the point estimate, where there are none) without a rebound, (impacts,)."""
        return np.array([sum(shares.values()) for shares in self.failures])

    @property
    def withheld(self) -> NDArray[np.bool_]:
        """Which impacts have no intervals because too many draws have no rebound there."""
        return (self.unsolved > MOST_UNSOLVED) & (self.draws > 0)

    def output(self, name: str) -> OutputPrediction:
        """The output called `name`. Raises KeyError."""
        return {output.name: output for output in self.outputs}[name]


def predict_new(
    fitted: FittedModel,
    impacts: Impacts,
    observed: Sequence[Observable] = (),
    seed: int = 1,
    incident_covariance: FloatArray | None = None,
    levels: Asked | None = None,
    covariance: Covariance | None = None,
) -> NewPrediction:
    """Predict the rebounds of new impacts from every draw of `fitted`. `levels` are the surface and ball of each, by
    column, see `levels_of_impacts`; needed where parameters differ between these.

    `incident_covariance` (impacts, 3, 3) is that of `(v_x1, v_y1, omega_1)` in SI; None: they are exact. A point fit,
    which has no draws, takes no notice of it.

    `observed` are measured columns of the same impacts: their own sds, where stated, are part of the noise of a new
    measurement. Where their errors belong to those of the incident state `covariance` is that of their rows. Raises
    ModelError when the model needs each impact's own restitution and there is none, ParameterError for a covariance
    of another shape, or a seed that is none, and as `levels_of_impacts` does.
    """
    if fitted.model.needs_cor and impacts.cor is None:
        raise ModelError(
            f"model {fitted.model_name} with cor = measured takes the measured coefficient of restitution as an "
            "input: it predicts only tables with v_y2 of every impact"
        )
    check_whole(seed=seed)
    if incident_covariance is not None and incident_covariance.shape != (len(impacts), 3, 3):
        raise ParameterError(
            f"incident_covariance has shape {incident_covariance.shape}: expected ({len(impacts)}, 3, 3)"
        )
    observables = output_observables(fitted, len(impacts), observed)
    errors = None
    if covariance is not None and incident_covariance is not None:
        errors = errors_from(covariance, [item.name for item in observed]).chosen([item.name for item in observables])
        observables = tuple(
            replace(item, sd=np.sqrt(np.maximum(errors.rest[:, k, k], 0.0))) if item.name in errors.columns else item
            for k, item in enumerate(observables)
        )
    rng = np.random.default_rng(seed)
    # A stream of its own: the noise is the same with and without uncertainty of the incident state. The second one is
    # for levels of which nothing was measured.
    first, second = np.random.SeedSequence(seed).spawn(2)
    states = np.random.default_rng(first)
    known_levels = levels_of_impacts(fitted, len(impacts), levels or {}, {})
    parts, order = [], []
    for one, rows in by_levels(fitted, known_levels, len(impacts), second):
        for k in range(0, rows.size, BATCH):
            batch = rows[k : k + BATCH]
            cut = [replace(observable.at(batch), rows=None) for observable in observables]
            uncertain = None if incident_covariance is None else incident_covariance[batch]
            follows = None if errors is None else errors.follows[batch]
            parts.append(_batch(one, impacts.take(batch), cut, uncertain, follows, rng, states))
        order.append(rows)
    back = np.argsort(np.concatenate(order), kind="stable")
    regimes, failures = ([share for part in parts for share in part[k]] for k in (1, 2))
    known = {observable.name for observable in observed}
    outputs = tuple(
        replace(
            in_order(joined([part[0][k] for part in parts]), back),
            observed=item.observed if item.name in known else None,
        )
        for k, item in enumerate(observables)
    )
    return NewPrediction(
        impacts=impacts,
        outputs=outputs,
        # Without motion along the court there is neither slip nor grip.
        regimes=tuple(regimes[k] if fitted.model.has_regimes else {} for k in back),
        failures=tuple(failures[k] for k in back),
        range=calibrated_range(
            fitted.impacts, impacts, fitted.model.ball.radius, fitted.tangential, lines_of(fitted.names)
        ),
        draws=fitted.draws.shape[0],
        levels=known_levels,
    )


def output_observables(fitted: FittedModel, count: int, observed: Sequence[Observable]) -> tuple[Observable, ...]:
    """Every output the model has, measured or not; what is between the flights only where it is measured, or was."""
    measured = {observable.name: observable for observable in observed}
    nothing, noise_of = np.full(count, np.nan), noise_in(fitted.names)
    return tuple(
        measured.get(name, derived(Observable(name, nothing, None, noise_of[name]), fitted.names))
        for name, column in OBSERVABLES.items()
        if (fitted.tangential or not column.along)
        and fitted.model.gives(column)
        and (not column.gap or name in measured or noise_of[name] in fitted.names)
    )


_Shares = tuple[Mapping[str, float], ...]


def _batch(
    fitted: FittedModel,
    impacts: Impacts,
    observables: Sequence[Observable],
    covariance: FloatArray | None,
    follows: FloatArray | None,
    rng: np.random.Generator,
    states: np.random.Generator,
) -> tuple[list[OutputPrediction], _Shares, _Shares]:
    """Outputs, shares of regimes and of failures at some impacts; `covariance` is that of uncertain states, with
    whose errors those of each output go by `follows` (impacts, outputs, 3) (see `RowErrors`).
    """
    at_point = fitted.rebound(impacts)
    if fitted.draws.shape[0] == 0:
        alone = [OutputPrediction(observable.name, observable.predict(at_point)[0]) for observable in observables]
        return alone, regime_shares(at_point), _failures(at_point)
    fixed = fitted.rebound(impacts, fitted.draws)
    drawn, moves = [fixed], [np.zeros(())]
    if covariance is not None:
        drawn, moves = map(
            list, zip(*(drawn_rebound(fitted, impacts, covariance, states) for _ in range(2)), strict=True)
        )
    withheld = np.mean(drawn[0].status != 0, axis=0) > MOST_UNSOLVED
    for rebound in (fixed, *drawn):
        for name in OUTPUTS:
            getattr(rebound, name)[:, withheld] = np.nan
    columns = dict(zip(fitted.names, fitted.draws.T, strict=True))
    outputs = []
    for place, observable in enumerate(observables):
        predicted, known = observable.predict(drawn[0]), observable.known(columns.keys())
        # What is measured is as wrong as the incident state that was read.
        off = [0.0 if follows is None else np.sum(follows[:, place] * move, axis=-1) for move in moves]
        made = OutputPrediction(observable.name, observable.predict(at_point)[0], bands(predicted))
        if known:
            data = with_noise(fitted.noise, observable, columns, drawn[0], rng)[2] - off[0]
            mean, sd = over_draws(np.nanmean, data), over_draws(np.nanstd, data)
            made = replace(made, measured=bands(data), mean=mean, sd=sd)
        if covariance is not None:
            # The noise of a measurement at the stated incident state, from numbers of its own.
            stated, noise = observable.predict(fixed), None
            if known:
                noise = with_noise(fitted.noise, observable, columns, fixed, states)[2] - stated
            one, other = predicted - off[0], observable.predict(drawn[1]) - off[-1]
            made = replace(made, shares=shares(stated, one, other, noise))
        outputs.append(made)
    return outputs, regime_shares(drawn[0]), _failures(drawn[0])


def _failures(rebound: Rebound) -> _Shares:
    shares = []
    for status in rebound.status.T:
        counts = Counter(status[status != 0].tolist()).most_common()
        shares.append({STATUS_REASON[Status(code)]: count / status.size for code, count in counts})
    return tuple(shares)


def observed_observables(fitted: FittedModel, table: ImpactTable) -> tuple[tuple[Observable, ...], tuple[str, ...]]:
    """The measured columns of a table that `fitted` can answer for, and a sentence for each that it cannot."""
    observables, notes = build_observables(table, fitted.tangential, fitted.model, noise_in(fitted.names))
    whole = (observable.everywhere(len(table)) for observable in observables)
    return tuple(derived(observable, fitted.names) for observable in whole), tuple(notes)


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


# How far a prediction moves over assumptions that the fitted table cannot tell apart.


def with_assumptions(prediction: NewPrediction, fitted: FittedModel, found: Assumptions | None) -> NewPrediction:
    """The prediction of `fitted` with the range of each output over all alternatives that fit equally well.

    The range includes the fit itself: its median, or the point where there is none. Each alternative is taken at the
    mean of its posterior. Nothing is added where assumptions were not examined or no alternative fits equally well.
    The range is NaN for an impact on a surface or with a ball of which nothing was measured.
    """
    if found is None or not found.as_good:
        return prediction
    # What a new surface would be like under an alternative is not known: it has no draws.
    known = ~is_new(fitted, prediction.levels, len(prediction.impacts))
    levels = {column: tuple(np.array(labels)[known]) for column, labels in prediction.levels.items()}
    impacts = prediction.impacts.take(np.flatnonzero(known))
    rebounds = [_point_rebound(_alternative(fitted, item), impacts, levels) for item in found.as_good if known.any()]
    observables = {item.name: item for item in output_observables(fitted, len(impacts), ())}
    outputs = []
    for output in prediction.outputs:
        own = output.point if output.rebound is None else output.rebound[2]
        every = np.stack([own[known], *(observables[output.name].predict(rebound)[0] for rebound in rebounds)])
        over = np.full((2, known.size), np.nan)
        # What an alternative cannot answer takes no part.
        over[:, known] = np.stack([np.fmin.reduce(every), np.fmax.reduce(every)])
        outputs.append(replace(output, over=over))
    return replace(prediction, outputs=tuple(outputs))


def _point_rebound(fitted: FittedModel, impacts: Impacts, levels: ImpactLevels) -> Rebound:
    """Rebounds (1, impacts) at the point estimate, each impact at its own levels."""
    blocks = list(by_levels(fitted, levels, len(impacts), np.random.SeedSequence(0)))
    order = np.concatenate([rows for _, rows in blocks])
    made = Rebound.joined([one.rebound(impacts.take(rows)) for one, rows in blocks], axis=1)
    return made.take(np.argsort(order, kind="stable"))


def _alternative(fitted: FittedModel, item: Alternative) -> FittedModel:
    """The fitted model with one choice changed; a kind of noise changes its parameters only."""
    closure, _, option = item.name.partition("=")
    options = {**fitted.options, closure: option} if closure in fitted.options else fitted.options
    values = np.array(list(item.values.values()))
    return replace(fitted, options=options, names=tuple(item.values), point=values, draws=np.empty((0, values.size)))
