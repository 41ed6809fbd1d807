"""What is asked: one table under one model, with priors, and the rebounds it predicts, batched over draws.

Coordinates are those in which the priors have their shape: the natural logarithm for log priors, the value in
SI for the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.problem.along import APART, runs
from fitball.inference.problem.camera import View, as_seen, incident_slopes, truly
from fitball.inference.problem.force_records import ForceRecords
from fitball.inference.problem.noise import NORMAL, NoiseKind
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.parameters import JointPrior, Parameter, Prior
from fitball.inference.problem.pooling import GroupBias, Pooling
from fitball.inference.problem.row_errors import RowErrors
from fitball.models.kernels.dual import STEP, NumberArray
from fitball.models.model import COR, LinearConstraint, Model, by_output
from fitball.models.specs import BALL_PARAMETERS
from fitball.models.types import OUTPUTS, Rebound, Status
from fitball.values import FloatArray, Impacts, OwnImpacts


@dataclass(frozen=True)
class Choices:
    """The user's choices beyond the scene, which they override.

    `noise` is one of `noise.KINDS`. `pool` maps parameters to the label column over whose levels they differ.
    `offsets` names the label column whose groups may be biased. Without `incident_errors` the incident state counts
    as exact even where its sd is stated. `velocity_noise` is "tied", "separate", "stated" or None, see
    `observables.noise_by_column`.
    """

    model: str | None = None
    closures: Mapping[str, str] = field(default_factory=dict)
    priors: Mapping[str, str] = field(default_factory=dict)
    fix: Mapping[str, float] = field(default_factory=dict)
    noise: str | None = None
    pool: Mapping[str, str] = field(default_factory=dict)
    offsets: str | None = None
    incident_errors: bool = True
    velocity_noise: str | None = None


@dataclass(frozen=True)
class Problem:
    """A table, a model and priors: all that defines a posterior.

    `contact_time` is the scene's mean contact time of the table, (value, sd) [s], or None. `notes` are sentences
    on what was left out or assumed, and why. `pooling` lists the parameters that differ between surfaces or
    balls, `spreads` are chosen priors of spreads that are no parameter of the fit (of dropped balls, of places of
    a court), `group_bias` the biases of whole groups. `errors` are those of rows whose incident state is uncertain,
    or whose errors belong together; true incident states are marginalised with a flat prior. `camera` is what the
    sessions of the table share. `force` are records of the force on the court. `noise` is that of the table,
    `threads` share large batches, and `choices` are those of the user.
    """

    table: ImpactTable
    scene: Scene
    model: Model
    parameters: tuple[Parameter, ...]
    observables: tuple[Observable, ...]
    impacts: Impacts
    contact_time: tuple[float, float] | None
    notes: tuple[str, ...]
    pooling: tuple[Pooling, ...] = ()
    spreads: Mapping[str, Prior] = field(default_factory=dict)
    group_bias: GroupBias | None = None
    errors: RowErrors | None = None
    camera: View | None = None
    force: ForceRecords | None = None
    noise: NoiseKind = NORMAL
    threads: int = 1
    choices: Choices = field(default_factory=Choices)

    @cached_property
    def free(self) -> tuple[Parameter, ...]:
        """Parameters the data may move, in order."""
        return tuple(parameter for parameter in self.parameters if parameter.free)

    @cached_property
    def free_names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(parameter.name for parameter in self.free)

    @cached_property
    def model_names(self) -> tuple[str, ...]:
        """Names of all parameters that the model itself takes."""
        return tuple(parameter.name for parameter in self.parameters if parameter.name in self.model.specs)

    @cached_property
    def known_apart(self) -> frozenset[str]:
        """Parameters of which something is known that is no prior belief: how levels and biases of groups scatter in
        the model, and constants of the ball and of the camera that the scene measured.
        """
        names = set() if self.group_bias is None else self.group_bias.names(self.observables)
        for pooling in self.pooling:
            names |= {*pooling.hidden}
        seen = set() if self.camera is None else {*self.camera.names}
        return frozenset({*names, *seen, *(item.name for item in self.free if item.name in BALL_PARAMETERS)})

    @property
    def uncertain(self) -> bool:
        """Whether incident states have errors."""
        return self.errors is not None and self.errors.uncertain

    @property
    def dimension(self) -> int:
        """Number of free parameters."""
        return len(self.free)

    @cached_property
    def prior(self) -> JointPrior:
        """The priors of all free parameters together."""
        return JointPrior(tuple(parameter.prior for parameter in self.free))

    def to_values(self, coordinates: NumberArray) -> NumberArray:
        """Values (draws, free) in SI of coordinates (draws, free)."""
        return self.prior.value(coordinates)

    def to_coordinates(self, values: FloatArray) -> FloatArray:
        """Inverse of `to_values`."""
        return self.prior.coordinate(values)

    def free_rows(self, named: Sequence[Mapping[str, float]]) -> FloatArray:
        """Free values (rows, free) of rows by name."""
        return np.array([[row[name] for name in self.free_names] for row in named])

    def all_values(self, values: NumberArray) -> Mapping[str, NumberArray]:
        """Every parameter by name, free and fixed, as (draws,)."""
        columns = {name: values[:, k] for k, name in enumerate(self.free_names)}
        for parameter in self.parameters:
            if parameter.fixed is not None:
                columns[parameter.name] = np.full(values.shape[0], parameter.fixed)
        return columns

    @cached_property
    def linear_constraints(self) -> tuple[LinearConstraint, ...]:
        """What the model demands of its parameters at the table's impacts; those that differ between levels are
        bounded by the model itself.
        """
        pooled = {pooling.parameter for pooling in self.pooling}
        constraints = self.model.linear_constraints(self.impacts)
        return tuple(constraint for constraint in constraints if not pooled & constraint.coefficients.keys())

    @cached_property
    def grouped_by(self) -> str | None:
        """The label column by which figures distinguish impacts, or None."""
        if "group" in self.table.labels:
            return "group"
        return self.pooling[0].column if self.pooling else None

    @cached_property
    def groups(self) -> tuple[str, ...] | None:
        """The label of each impact in that column, None when there is none."""
        return None if self.grouped_by is None else self.table.labels[self.grouped_by]

    def rebound(self, values: FloatArray, impacts: Impacts | None = None, like: int | None = None) -> Rebound:
        """Rebounds (draws, impacts) for free values (draws, free), by default of the table's impacts, as the camera
        shows them.

        Other `impacts` are true ones, and have the surface and ball of the table's row `like`, by default a typical
        one.
        """
        columns = self.all_values(values)
        if impacts is None:
            return self.seen_like(columns, self.impacts, np.arange(len(self.impacts)))
        if like is None or not self.pooling:
            return self._evaluate(columns, impacts)
        return self.rebound_like(columns, impacts, np.full(len(impacts), like))

    def seen_like(self, columns: Mapping[str, FloatArray], impacts: Impacts, rows: NDArray[np.int64]) -> Rebound:
        """As `rebound_like`, of measured impacts and as the camera of the session of each row shows them."""
        if self.camera is None:
            return self.rebound_like(columns, impacts, rows)
        settings = self.camera.settings(columns, rows)
        there, reaching = truly(settings, impacts)
        return as_seen(settings, impacts, reaching, self.rebound_like(columns, there, rows))

    def rebound_like(
        self, columns: Mapping[str, FloatArray], impacts: Impacts | OwnImpacts, rows: NDArray[np.int64]
    ) -> Rebound:
        """Rebounds (draws, impacts) of impacts with the surface and ball of the table's `rows` (impacts,)."""
        if not self.pooling:
            return self._evaluate(columns, impacts)
        rebounds, order = [], []
        for mine, own in self._blocks(columns, rows):
            made = self._evaluate({**columns, **own}, impacts.take(mine))
            for pooling in self.pooling:
                made.status[pooling.outside(own[pooling.parameter])] = Status.LEVEL_OUT_OF_BOUNDS
            rebounds.append(made)
            order.append(mine)
        back = np.argsort(np.concatenate(order), kind="stable")
        return Rebound.joined(rebounds, axis=1).take(back)

    def slopes_like(
        self, columns: Mapping[str, FloatArray], impacts: Impacts, rows: NDArray[np.int64]
    ) -> Mapping[str, FloatArray]:
        """Derivatives (draws, impacts, 3) of each output of `seen_like` with respect to measured incident states."""
        settings = None if self.camera is None else self.camera.settings(columns, rows)
        there = impacts if settings is None else truly(settings, impacts)[0]
        (inputs,) = self._by_level(
            columns,
            rows,
            lambda values, mine: (self.model.slopes(self.model_names, values, there.take(mine), ())[..., :COR],),
        )
        if settings is None:
            return by_output(inputs)
        return incident_slopes(settings, impacts.states()[:3], self.rebound_like(columns, there, rows), inputs)

    def differentiated(self, coordinates: FloatArray) -> tuple[Rebound, dict[str, FloatArray]]:
        """Rebounds (draws, impacts) of the table's impacts at `coordinates` (draws, free), as the camera shows them,
        and of each output the derivatives (draws, impacts, free) with respect to coordinates: exact, those of the
        regime an impact is in; NaN where it cannot be evaluated, zero for noise parameters and offsets of groups.

        The model differentiates itself; how the parameters of levels follow from coordinates is a complex step.
        """
        values = self.to_values(coordinates)
        columns = self.all_values(values)
        levelled = {pooling.parameter for pooling in self.pooling}
        acting = [name for name in self.model_names if name in self.free_names or name in levelled]
        alone = {name: self.free_names.index(name) for name in acting if name not in levelled}
        own_names = {name for pooling in self.pooling for name in (pooling.parameter, *pooling.hidden)}
        moved = {
            k: self.all_values(self.to_values(coordinates + 1j * STEP * np.eye(self.dimension)[k]))
            for k, name in enumerate(self.free_names)
            if name in own_names
        }
        rates = self.prior.rates(values)
        rebound = None
        every = np.arange(len(self.impacts))
        slopes = np.zeros((values.shape[0], every.size, len(OUTPUTS), self.dimension))
        settings, moves = None, None
        there: Impacts | OwnImpacts = self.impacts
        if self.camera is not None:
            settings = self.camera.settings(columns, every)
            there, reaching = truly(settings, self.impacts)
            moves = self.camera.moves(self.free_names, rates)
            shifts = moves.of_true(settings, self.impacts.states()[:3])
        for mine, own in self._blocks(columns, every):
            rows = self._model_rows({**columns, **own})
            impacts = there.take(mine) if self.pooling else there
            jacobian = self.model.jacobian(self.model_names, rows, impacts, acting)
            rebound = jacobian.rebound
            # Columns of a view: a table of many rows is not copied, nor one of few rows indexed row by row.
            part = np.zeros((values.shape[0], mine.size, *slopes.shape[2:])) if self.pooling else slopes
            for place, name in enumerate(acting):
                if name in alone:
                    k = alone[name]
                    np.multiply(rates[:, k, None, None], jacobian.parameters[..., place], out=part[..., k])
            for k, stepped in moved.items():
                _, levels = next(self._blocks(stepped, mine[:1]))
                for name in levelled:
                    rate = levels[name].imag / STEP
                    if np.any(rate):
                        part[..., k] += rate[:, None, None] * jacobian.parameters[..., acting.index(name)]
            if moves is not None:
                part += np.matmul(jacobian.inputs, shifts[:, mine])
            if self.pooling:
                slopes[:, mine] = part
        whole = rebound if rebound is not None and not self.pooling else self.rebound_like(columns, there, every)
        if settings is None or moves is None:
            return whole, by_output(slopes)
        made = moves.of_seen(settings, self.impacts.states()[:3], whole, by_output(slopes))
        return as_seen(settings, self.impacts, reaching, whole), made

    def paired(
        self, columns: Mapping[str, FloatArray], draws: NDArray[np.int64], rows: NDArray[np.int64]
    ) -> Mapping[str, FloatArray]:
        """The parameters of each of `draws` at its impact of the table, in `rows`."""
        values = {name: column[draws] for name, column in columns.items()}
        for pooling in self.pooling:
            by_level = np.stack([pooling.value(columns, label) for label in pooling.labels])
            values[pooling.parameter] = by_level[pooling.index[rows], draws]
        if self.camera is not None:
            values |= self.camera.paired(columns, draws, rows)
        return values

    def linearised(
        self, columns: Mapping[str, FloatArray], impacts: OwnImpacts, possible: NDArray[np.bool_]
    ) -> tuple[Rebound, Mapping[str, FloatArray]]:
        """Rebounds (pairs, impacts) for `paired` parameters, as the camera shows them, with derivatives (pairs,
        impacts, 3) of each output with respect to the measured incident state. The `impacts` of a pair are evenly
        spaced on a line, but for those that are not `possible`.
        """
        settings = None if self.camera is None else self.camera.of_pairs(columns)
        there, reaching = (impacts, possible) if settings is None else truly(settings, impacts)
        rows = self._model_rows(columns)
        rebound = self.model.evaluate(self.model_names, rows, there)
        known = possible & reaching & (rebound.status == 0)

        def inputs(pairs: NDArray[np.int64], places: NDArray[np.int64]) -> FloatArray:
            some = there.among(pairs, places)
            return self.model.slopes(self.model_names, rows[pairs], some, ())[:, 0, :, :COR]

        slopes = runs(np.where(known, rebound.regime, APART)).interpolated(inputs)
        if settings is None:
            return rebound, by_output(slopes)
        moved = incident_slopes(settings, impacts.states()[:3], rebound, slopes)
        return as_seen(settings, impacts, reaching, rebound), moved

    def force_integrals(
        self,
        columns: Mapping[str, NumberArray],
        rows: NDArray[np.int64],
        first: FloatArray,
        spacing: FloatArray,
        count: int,
    ) -> tuple[NumberArray, NumberArray, NumberArray]:
        """See `Model.force_integrals`, for the table's impacts `rows`; `columns` may be complex."""
        impulse, integral, centroid = self._by_level(
            columns,
            rows,
            lambda values, mine: self.model.force_integrals(
                self.model_names, values, self.impacts.take(rows[mine]), first[:, mine], spacing[mine], count
            ),
        )
        return impulse, integral, centroid

    def _by_level(
        self,
        columns: Mapping[str, NumberArray],
        rows: NDArray[np.int64],
        compute: Callable[[NumberArray, NDArray[np.int64]], Sequence[NumberArray]],
    ) -> list[NumberArray]:
        """Arrays (draws, rows, ...): what `compute` gives of values of the model (draws, its parameters) and places
        among `rows`, level by level.
        """
        made, order = [], []
        for mine, own in self._blocks(columns, rows):
            made.append(compute(self._model_rows({**columns, **own}), mine))
            order.append(mine)
        back = np.argsort(np.concatenate(order), kind="stable")
        return [np.concatenate(parts, axis=1)[:, back] for parts in zip(*made, strict=True)]

    def _blocks(
        self, columns: Mapping[str, FloatArray], rows: NDArray[np.int64]
    ) -> Iterator[tuple[NDArray[np.int64], dict[str, FloatArray]]]:
        """Places among `rows` that share all levels, with the parameters of those levels."""
        if not self.pooling:
            yield np.arange(len(rows)), {}
            return
        keys = np.stack([pooling.index[rows] for pooling in self.pooling])
        distinct, which = np.unique(keys, axis=1, return_inverse=True)
        for k, key in enumerate(distinct.T):
            labels = [pooling.labels[place] for pooling, place in zip(self.pooling, key, strict=True)]
            own = {
                pooling.parameter: pooling.value(columns, name)
                for pooling, name in zip(self.pooling, labels, strict=True)
            }
            yield np.flatnonzero(which.ravel() == k), own

    def _model_rows(self, columns: Mapping[str, FloatArray]) -> FloatArray:
        return np.stack([columns[name] for name in self.model_names], axis=1)

    def _evaluate(self, columns: Mapping[str, FloatArray], impacts: Impacts | OwnImpacts) -> Rebound:
        rows = self._model_rows(columns)
        if rows.shape[0] * len(impacts) <= LARGE_BATCH:
            return self.model.evaluate(self.model_names, rows, impacts)
        return evaluate_in_parts(self.model, self.model_names, rows, impacts, self.threads)

    def deviation(self, columns: Mapping[str, FloatArray], observable: Observable, rebound: Rebound) -> FloatArray:
        """Measured less predicted (draws, impacts), the bias of the impact's group taken off."""
        gap = observable.observed - observable.predict(rebound)
        if self.group_bias is None:
            return gap
        bias = self.group_bias.offset(columns, observable.name)
        return gap - (bias if observable.rows is None else bias[:, observable.rows])


# Impacts times draws above which splitting pays for the threads.
LARGE_BATCH = 100_000


def evaluate_in_parts(
    model: Model, names: Sequence[str], rows: FloatArray, impacts: Impacts | OwnImpacts, threads: int
) -> Rebound:
    """`model.evaluate`, the work shared among threads; the same numbers whatever their count."""
    if threads == 1:
        return model.evaluate(names, rows, impacts)
    if rows.shape[0] >= threads:
        split = np.array_split(np.arange(rows.shape[0]), min(rows.shape[0], 4 * threads))
        parts = [(rows[part], impacts if isinstance(impacts, Impacts) else impacts.of_draws(part)) for part in split]
        axis = 0
    else:
        parts = [(rows, impacts.take(part)) for part in np.array_split(np.arange(len(impacts)), 4 * threads)]
        axis = 1
    with ThreadPoolExecutor(threads) as pool:
        rebounds = list(pool.map(lambda part: model.evaluate(names, *part), parts))
    return Rebound.joined(rebounds, axis)
