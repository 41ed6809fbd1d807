"""Information of planned impacts at posterior draws, as rows whose squares add up to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.errors import ParameterError
from fitball.base.priors import parse_prior
from fitball.base.selection import evenly_spread
from fitball.base.values import BoolArray, FloatArray, Impacts, IntArray
from fitball.data.scene import ValueWithSd
from fitball.inference.derived import Quantity
from fitball.inference.differences import central
from fitball.inference.effort import LONG_ROWS, STATES_AT_ONCE
from fitball.inference.fitted import Fitted
from fitball.inference.forward import Values
from fitball.inference.predictive import PredictionRequest
from fitball.inference.problem.camera import CAMERA_SPECS, CameraModel
from fitball.uses.planned import Sensor

# Steps of differences, in sds.
STEP = 1e-5
# Share of the variance of the widest direction of the posterior below which one has none.
NARROW = 1e-10
# The parameter of a camera that gaps depend on.
HEIGHT = "court_height"


class Look(NamedTuple):
    """Impacts measured by a sensor: rows (draws, impacts, rows, directions) whose squares add up to
    their Fisher information, and whether a draw has an answer (draws, impacts).
    """

    rows: FloatArray
    solved: BoolArray


class Known:
    """Coordinates `at` (draws, unknowns) of a posterior, and `root` (unknowns, directions), whose
    square is their covariance. Unknowns are the free parameters, and `height`, of the court, where
    gaps are measured for the first time: of it the scene is known, or else its prior.
    """

    def __init__(self, fit: Fitted, gaps: bool) -> None:
        problem = fit.problem
        self.fit = fit
        self.problem = problem
        self.camera = problem.camera
        self.height = 0.0
        free = [fit.draws.values[name] for name in problem.free]
        q = problem.prior.coordinate(np.stack(free, axis=1))
        prior = problem.prior
        spec = CAMERA_SPECS[HEIGHT]
        self.low = prior.low
        self.high = prior.high
        self.step = STEP * prior.width
        size = np.maximum(q.std(axis=0), np.finfo(float).tiny)
        # In sds first: units and scales of coordinates differ by many powers of ten.
        covariance = np.atleast_2d(np.cov(q / size, rowvar=False))
        values, vectors = np.linalg.eigh(covariance)
        wide = values > NARROW * values[-1]
        self.root: FloatArray = size[:, None] * vectors[:, wide] * np.sqrt(values[wide])
        seen = any(item.column.gap for item in problem.observables)
        if gaps and not seen and (problem.camera is None or HEIGHT not in problem.camera.keys):
            stated = None if problem.scene.camera is None else problem.scene.camera.court_height
            if stated is None:
                self.height = parse_prior(spec, spec.prior).width
            elif isinstance(stated, ValueWithSd):
                self.height = stated.sd
        if self.height:
            old = problem.camera or CameraModel((), ("",), np.zeros(1, np.int64))
            self.camera = old._replace(keys=(*old.keys, HEIGHT))
            q = np.column_stack([q, np.zeros(len(q))])
            wider = np.zeros(np.array(self.root.shape) + 1)
            wider[:-1, :-1] = self.root
            wider[-1, -1] = self.height
            self.root = wider
            self.low = np.append(self.low, spec.lower)
            self.high = np.append(self.high, spec.upper)
            self.step = np.append(self.step, STEP * self.height)
        self.at = q

    def thinned(self, count: int) -> None:
        """Keep so many draws, evenly spread."""
        self.at = self.at[evenly_spread(len(self.at), count, down=True)]

    def values(self, q: FloatArray) -> Values:
        """All parameters by name."""
        values = dict(self.problem.values(q[:, : len(self.problem.free)]))
        if self.height and self.camera is not None:
            for session in self.camera.sessions:
                values[self.camera.name(HEIGHT, session)] = q[:, -1]
        return values

    def gradients(self, target: Sequence[Quantity]) -> FloatArray:
        """Of the target (draws, targets, unknowns); draws that do not give it are dropped. Raises
        ParameterError (`fixed`, `no-answer`).
        """

        def values(q: FloatArray) -> FloatArray:
            parameters = self.values(q)
            return np.stack([quantity.rule(parameters) for quantity in target], axis=1)

        here, rates = central(values, self.at, self.step, self.low, self.high)
        solved = np.isfinite(here).all(axis=1)
        for k, quantity in enumerate(target):
            name = quantity.spec.name
            if 2 * np.isfinite(here[:, k]).sum() <= len(here):
                text = f"target {name}: the model has no answer there for most posterior draws"
                raise ParameterError(text, "no-answer")
            if not rates[solved][..., k].any():
                text = f"target {name}: it is fixed in this fit; name one that is not"
                raise ParameterError(text, "fixed")
        self.at = self.at[solved]
        return np.asarray(rates[solved].swapaxes(1, 2))

    def looked(
        self,
        impacts: Impacts,
        index: IntArray,
        sensors: Sequence[Sensor],
        noisy: bool,
    ) -> list[Look]:
        """Impacts by each of these sensors, each measured before as the nearest impact of the table
        was; `noisy`: information on the noises too.
        """
        columns = [item.column.name for item in self.problem.observables]
        besides = [name for sensor in sensors for name in sensor.sds if name not in columns]
        columns += dict.fromkeys(besides)
        draws, unknowns = self.at.shape
        # Two bounces for each unknown and each error of a state, and one.
        bounces = draws * (2 * unknowns + 7)
        pieces = -(-len(impacts) * bounces // STATES_AT_ONCE)
        by_sensor: list[list[Look]] = [[] for _ in sensors]
        for part in np.array_split(np.arange(len(impacts)), min(pieces, len(impacts))):
            measured = _Measured(self, impacts.take(part), index[part], columns)
            for looks, sensor in zip(by_sensor, sensors, strict=True):
                looks.append(measured.by(sensor, noisy))
        together = []
        for looks in by_sensor:
            rows = np.concatenate([look.rows for look in looks], 1)
            solved = np.concatenate([look.solved for look in looks], 1)
            together.append(Look(rows, solved))
        return together


class _Measured:
    """What `columns` show of impacts at the draws: `slopes` (draws, impacts, columns, directions),
    and `moves` (draws, impacts, columns, 3) by one sd along each axis of the errors of the state.
    """

    def __init__(
        self,
        known: Known,
        impacts: Impacts,
        index: IntArray,
        columns: Sequence[str],
    ) -> None:
        problem = known.problem
        self.known = known
        self.columns = columns
        self.size = known.at.shape[1]
        self.like = _nearest(known.fit, impacts)
        self.errors = None if problem.rows.errors is None else problem.rows.errors.take(self.like)
        # Planned impacts are filmed as the last were.
        camera = known.camera
        if camera is not None:
            camera = camera._replace(session=np.full(len(impacts), len(camera.sessions) - 1))
        request = PredictionRequest(impacts, index, tuple(columns), camera=camera)
        errors = self.errors

        def shown(rows: FloatArray) -> FloatArray:
            unknowns = rows[:, : self.size]
            states = impacts
            if errors is not None:
                along = rows[:, self.size :]
                states = impacts.moved(np.einsum("ikl,dl->dik", errors.axes, along))
            rebound = request.rebounds(problem.forward, known.values(unknowns), states)
            return np.stack([rebound.column(name) for name in columns], axis=2)

        more = 0 if errors is None else 3
        exact = np.zeros((len(known.at), more))
        here, rates = central(
            shown,
            np.column_stack([known.at, exact]),
            np.append(known.step, np.full(more, STEP)),
            np.append(known.low, np.full(more, -np.inf)),
            np.append(known.high, np.full(more, np.inf)),
        )
        self.solved: BoolArray = np.asarray(np.isfinite(here).all(axis=2))
        rates = np.where(self.solved[:, None, :, None], rates, 0.0)
        of_unknowns = rates[:, : self.size]
        self.slopes = np.einsum("dnsc,nk->dsck", of_unknowns, known.root, optimize=True)
        self.moves = rates[:, self.size :].transpose(0, 2, 3, 1)

    def by(self, sensor: Sensor, noisy: bool) -> Look:
        """As a sensor reads them."""
        known = self.known
        problem = self.known.problem
        values = known.values(known.at)
        forward = problem.forward
        rows = problem.rows
        items = {item.column.name: (k, item) for k, item in enumerate(problem.observables)}
        names = [
            name
            for name in self.columns
            if (name in items or name in sensor.sds)
            and (sensor.drop is None or COLUMNS[name].vertical)
        ]
        places = [self.columns.index(name) for name in names]
        sds = list[FloatArray]()
        shape = self.solved.shape
        seen = np.ones((len(self.like), len(names)), dtype=np.bool_)
        for k, name in enumerate(names):
            column = items.get(name)
            if name in sensor.sds:
                # What balls scatter beyond stated errors they go on to scatter.
                sd: FloatArray | float = sensor.sds[name]
                if column is not None and column[1].stated:
                    sd = forward.column_sd(name, values, sensor.sds[name])
            else:
                assert column is not None
                sd = forward.column_sd(name, values, rows.sd[self.like, column[0]])
                seen[:, k] = np.isfinite(rows.y[self.like, column[0]])
            sds.append(np.broadcast_to(sd, shape))
        of_centre, of_scale = forward.noise.information(values)
        centre_weight = np.broadcast_to(of_centre, shape[:1])[:, None, None, None]
        scale_weight = np.broadcast_to(of_scale, shape[:1])[:, None, None, None]
        slopes = self.slopes[:, :, places] * seen[..., None]
        variance = np.stack(sds, axis=2) ** 2
        if self.errors is None:
            whitened = slopes / np.sqrt(variance)[..., None]
        else:
            before = [
                items[name][0] if name in items and name not in sensor.sds else -1 for name in names
            ]
            # A column that a sensor reads has an error of its own alone.
            as_before = seen & (np.array(before) >= 0)
            both = as_before[:, :, None] & as_before[:, None, :]
            follows = self.errors.follows[:, before] * as_before[..., None]
            moves = self.moves[:, :, places] * seen[..., None]
            away = moves - follows @ self.errors.axes
            rest = self.errors.rest[:, before][:, :, before] * both
            scatter = variance[..., None] * np.eye(len(names))
            covariance = rest + away @ away.swapaxes(2, 3) + scatter
            whitened = np.linalg.solve(np.linalg.cholesky(covariance), slopes)
            variance = np.diagonal(covariance, axis1=2, axis2=3)
        parts = [np.sqrt(centre_weight) * whitened]
        if noisy:
            growth = self._growth(sensor, names, values, seen, variance)
            parts.append(np.sqrt(scale_weight) * growth)
        return Look(np.concatenate(parts, axis=2), self.solved)

    def _growth(
        self,
        sensor: Sensor,
        names: Sequence[str],
        values: Values,
        seen: BoolArray,
        variance: FloatArray,
    ) -> FloatArray:
        """Derivatives of the logarithm of the sd of each column, in directions."""
        problem = self.known.problem
        growth = np.zeros((*variance.shape, self.known.root.shape[1]))
        noises = {item.column.name: item.noise for item in problem.observables}
        for k, name in enumerate(names):
            noise = noises.get(name, "")
            if name not in sensor.sds and noise in problem.free:
                place = problem.free.index(noise)
                size = values[noise][:, None]
                # Of the logarithm of the noise with its coordinate.
                slope = problem.prior.stretch(place, size) / size
                rate = size**2 / variance[..., k] * slope
                rate = rate * seen[:, k]
                growth[:, :, k] = rate[..., None] * self.known.root[place]
        return growth


def _nearest(fit: Fitted, impacts: Impacts) -> IntArray:
    """Of each impact the nearest row of the table, among those in which most was measured."""
    rows = fit.problem.rows
    radius = fit.problem.forward.model.ball.radius
    counts = np.isfinite(rows.y).sum(axis=1)
    complete = np.flatnonzero(counts == counts.max())
    if rows.errors is None and not rows.sd.any():
        # One is like another.
        return np.full(len(impacts), complete[0])
    # Of a long table evenly spread ones.
    complete = complete[evenly_spread(len(complete), LONG_ROWS, down=True)]
    measured = rows.states.take(complete)
    away = (
        (impacts.v_x1[:, None] - measured.v_x1) ** 2
        + (impacts.v_y1[:, None] - measured.v_y1) ** 2
        + (radius * (impacts.omega_1[:, None] - measured.omega_1)) ** 2
    )
    return np.asarray(complete[away.argmin(axis=1)])
