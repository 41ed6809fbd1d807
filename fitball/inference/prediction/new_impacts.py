"""Posterior prediction of new impacts: the rebound itself and a new measurement of it, told apart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.data.table import ImpactTable
from fitball.errors import ModelError
from fitball.inference.prediction.curves import bands
from fitball.inference.prediction.extrapolation import CalibratedRange, calibrated_range
from fitball.inference.prediction.posterior_predictive import regime_shares, with_noise
from fitball.inference.prediction.uncertain_incidence import Shares, drawn_rebound, shares
from fitball.inference.problem.measurement_noise import derived, noise_in
from fitball.inference.problem.noise import NoiseKind
from fitball.inference.problem.observables import Observable, build_observables
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.quantiles import MOST_UNSOLVED
from fitball.models.types import STATUS_REASON, Rebound, Status
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, Impacts

# Impacts of one batch, so that memory does not grow with the table. Random numbers depend on it, so it is fixed.
BATCH = 250
LINES = {"cor_slope": "COR", "eps_slope": "eps"}


@dataclass(frozen=True)
class OutputPrediction:
    """One output of every impact in SI, all (impacts,) or (5, impacts).

    `rebound` are the quantiles `quantiles.BAND` of the rebound itself (what the parameters leave open), `measured`
    those of a new measurement, `mean` and `sd` its moments. None where there is no posterior, and for `measured`,
    `mean`, `sd` where the noise is not known. `point` is at the point estimate; `observed` what the table says.
    Where the incident state is uncertain all but `point` contain that, and `shares` says what comes from where.
    `over` (2, impacts) is the range over assumptions, see `over_assumptions`; None where nothing was looked at.
    """

    name: str
    point: FloatArray
    rebound: FloatArray | None
    measured: FloatArray | None
    mean: FloatArray | None
    sd: FloatArray | None
    observed: FloatArray | None
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
    estimate is NaN.
    """

    impacts: Impacts
    outputs: tuple[OutputPrediction, ...]
    regimes: tuple[Mapping[str, float], ...]
    failures: tuple[Mapping[str, float], ...]
    range: CalibratedRange
    draws: int

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
) -> NewPrediction:
    """Predict the rebounds of new impacts from every draw of `fitted`.

    `incident_covariance` (impacts, 3, 3) is that of `(v_x1, v_y1, omega_1)` in SI; None: they are exact. A point fit,
    which has no draws, takes no notice of it.

    `observed` are measured columns of the same impacts: their own sds, where stated, are the noise of a new
    measurement. Raises ModelError when the model needs each impact's own restitution and there is none.
    """
    if fitted.model.needs_cor and impacts.cor is None:
        raise ModelError(
            f"model {fitted.model_name} with cor = measured takes each impact's own coefficient of restitution as "
            "an input: it predicts tables with v_y2 of every impact only"
        )
    observables = output_observables(fitted, len(impacts), observed)
    rng = np.random.default_rng(seed)
    # A stream of its own: the noise is the same with and without uncertainty of the incident state.
    states = np.random.default_rng(np.random.SeedSequence(seed).spawn(1)[0])
    parts = []
    for rows in (slice(k, k + BATCH) for k in range(0, len(impacts), BATCH)):
        mine, cut = _part(impacts, rows), [_rows_of(observable, rows) for observable in observables]
        if incident_covariance is None or fitted.draws.shape[0] == 0:
            parts.append(_batch(fitted, mine, cut, rng))
        else:
            parts.append(_uncertain_batch(fitted, mine, cut, incident_covariance[rows], rng, states))
    known = {observable.name for observable in observed}
    failures = tuple(share for part in parts for share in part[2])
    too_many = np.array([sum(shares.values()) > MOST_UNSOLVED for shares in failures])
    outputs = tuple(
        _withheld(_joined([part[0][k] for part in parts], item.observed if item.name in known else None), too_many)
        for k, item in enumerate(observables)
    )
    return NewPrediction(
        impacts=impacts,
        outputs=outputs,
        # Without motion along the court there is neither slip nor grip.
        regimes=tuple(share if fitted.tangential else {} for part in parts for share in part[1]),
        failures=failures,
        range=calibrated_range(
            fitted.impacts,
            impacts,
            fitted.model.ball.radius,
            fitted.tangential,
            tuple(word for name, word in LINES.items() if name in fitted.names),
        ),
        draws=fitted.draws.shape[0],
    )


def output_observables(fitted: FittedModel, count: int, observed: Sequence[Observable]) -> tuple[Observable, ...]:
    """Every output the model has, measured or not."""
    measured = {observable.name: observable for observable in observed}
    nothing, noise_of = np.full(count, np.nan), noise_in(fitted.names)
    return tuple(
        measured.get(name, derived(Observable(name, nothing, None, noise_of[name]), fitted.names))
        for name, column in OBSERVABLES.items()
        if (fitted.tangential or not column.along) and (fitted.model.has_time or not column.timed)
    )


def _part(impacts: Impacts, rows: slice) -> Impacts:
    cor = None if impacts.cor is None else impacts.cor[rows]
    return Impacts(impacts.v_x1[rows], impacts.v_y1[rows], impacts.omega_1[rows], cor)


def _rows_of(observable: Observable, rows: slice) -> Observable:
    return replace(
        observable, observed=observable.observed[rows], sd=None if observable.sd is None else observable.sd[rows]
    )


_Part = tuple[list[OutputPrediction], tuple[Mapping[str, float], ...], tuple[Mapping[str, float], ...]]


def _batch(
    fitted: FittedModel, impacts: Impacts, observables: Sequence[Observable], rng: np.random.Generator
) -> _Part:
    at_point = fitted.rebound(impacts)
    if fitted.draws.shape[0] == 0:
        alone = [
            OutputPrediction(observable.name, observable.predict(at_point)[0], None, None, None, None, None)
            for observable in observables
        ]
        return alone, regime_shares(at_point), _failures(at_point)
    drawn = fitted.rebound(impacts, fitted.draws)
    columns = dict(zip(fitted.names, fitted.draws.T, strict=True))
    outputs = [
        _output(fitted.noise, observable, observable.predict(at_point)[0], columns, drawn, rng)
        for observable in observables
    ]
    return outputs, regime_shares(drawn), _failures(drawn)


def _uncertain_batch(
    fitted: FittedModel,
    impacts: Impacts,
    observables: Sequence[Observable],
    covariance: FloatArray,
    rng: np.random.Generator,
    states: np.random.Generator,
) -> _Part:
    at_point, fixed = fitted.rebound(impacts), fitted.rebound(impacts, fitted.draws)
    one, other = (drawn_rebound(fitted, impacts, covariance, states) for _ in range(2))
    columns = dict(zip(fitted.names, fitted.draws.T, strict=True))
    outputs = []
    for observable in observables:
        made = _output(fitted.noise, observable, observable.predict(at_point)[0], columns, one, rng)
        noise = None
        if made.measured is not None:
            # The noise of a measurement at the stated incident state, from numbers of its own.
            predicted, _spread, data = with_noise(fitted.noise, observable, columns, fixed, states)
            noise = data - predicted
        split = shares(observable.predict(fixed), observable.predict(one), observable.predict(other), noise)
        outputs.append(replace(made, shares=split))
    return outputs, regime_shares(one), _failures(one)


def _output(
    noise: NoiseKind,
    observable: Observable,
    point: FloatArray,
    columns: Mapping[str, FloatArray],
    drawn: Rebound,
    rng: np.random.Generator,
) -> OutputPrediction:
    if not observable.known(columns.keys()):
        return OutputPrediction(observable.name, point, bands(observable.predict(drawn)), None, None, None, None)
    predicted, _spread, data = with_noise(noise, observable, columns, drawn, rng)
    # Impacts that no draw can evaluate have no moments either.
    solved = np.any(drawn.status == 0, axis=0)
    mean, sd = np.full(solved.shape, np.nan), np.full(solved.shape, np.nan)
    mean[solved], sd[solved] = np.nanmean(data[:, solved], axis=0), np.nanstd(data[:, solved], axis=0)
    return OutputPrediction(observable.name, point, bands(predicted), bands(data), mean, sd, None)


def _failures(rebound: Rebound) -> tuple[Mapping[str, float], ...]:
    shares = []
    for status in rebound.status.T:
        counts = Counter(status[status != 0].tolist()).most_common()
        shares.append({STATUS_REASON[Status(code)]: count / status.size for code, count in counts})
    return tuple(shares)


def _joined(parts: Sequence[OutputPrediction], observed: FloatArray | None) -> OutputPrediction:
    def together(name: str) -> FloatArray | None:
        arrays = [getattr(part, name) for part in parts]
        return None if arrays[0] is None else np.concatenate(arrays, axis=-1)

    point: FloatArray = np.concatenate([part.point for part in parts])
    return OutputPrediction(
        parts[0].name,
        point,
        together("rebound"),
        together("measured"),
        together("mean"),
        together("sd"),
        observed,
        _joined_shares([part.shares for part in parts if part.shares is not None]),
    )


def _withheld(output: OutputPrediction, rows: NDArray[np.bool_]) -> OutputPrediction:
    """The output without what its draws say of some impacts."""
    if output.rebound is None or not np.any(rows):
        return output

    def hidden(array: FloatArray | None) -> FloatArray | None:
        return None if array is None else np.where(rows, np.nan, array)

    split = output.shares
    if split is not None:
        parameters, incident = hidden(split.parameters), hidden(split.incident)
        assert parameters is not None and incident is not None
        split = Shares(parameters, incident, hidden(split.measurement))
    return replace(
        output,
        rebound=hidden(output.rebound),
        measured=hidden(output.measured),
        mean=hidden(output.mean),
        sd=hidden(output.sd),
        shares=split,
    )


def _joined_shares(parts: Sequence[Shares]) -> Shares | None:
    if not parts:
        return None
    measured = [part.measurement for part in parts if part.measurement is not None]
    return Shares(
        np.concatenate([part.parameters for part in parts]),
        np.concatenate([part.incident for part in parts]),
        np.concatenate(measured) if measured else None,
    )


def observed_observables(fitted: FittedModel, table: ImpactTable) -> tuple[tuple[Observable, ...], tuple[str, ...]]:
    """The measured columns of a table that `fitted` can answer for, and a sentence for each that it cannot."""
    observables, notes = build_observables(
        table, fitted.tangential, fitted.model.has_time, fitted.model.needs_cor, noise_in(fitted.names)
    )
    whole = (observable.everywhere(len(table)) for observable in observables)
    return tuple(derived(observable, fitted.names) for observable in whole), tuple(notes)
