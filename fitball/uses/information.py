"""Information of planned impacts at posterior draws, as rows whose squares add up to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.errors import ParameterError
from fitball.base.priors import parse_prior
from fitball.base.selection import evenly_spread
from fitball.base.values import BoolArray, FloatArray, Impacts, IntArray
from fitball.data.scene import Scene, ValueWithSd
from fitball.inference.derived import Quantity
from fitball.inference.differences import central
from fitball.inference.effort import LONG_ROWS, STATES_AT_ONCE
from fitball.inference.fitted import Fitted
from fitball.inference.forward import Values
from fitball.inference.predictive import PredictionRequest
from fitball.inference.problem.camera import CAMERA_SPECS, CameraModel
from fitball.uses.planned import Sensor

# Steps of differences, in widths of the prior, and in sds of the errors of a state.
DIFFERENCE_STEP = 1e-5
# Share of the variance of the widest direction of the posterior below which one has none.
NARROWEST = 1e-10
# The parameter of a camera that gaps depend on.
HEIGHT = "court_height"


class SensorInformation(NamedTuple):
    """What impacts say of the unknowns, measured by a sensor, at posterior draws: `rows` whose
    squares add up to their Fisher information, in directions of the posterior, and whether a draw
    has an answer.
    """

    rows: Annotated[FloatArray, "draws impacts measurements directions"]
    solved: Annotated[BoolArray, "draws impacts"]


class PosteriorAtDraws:
    """The posterior of a fit for a plan: coordinates `q` (draws, unknowns) of draws, and `root`
    (unknowns, directions), whose square is their covariance. Unknowns are the free parameters, and
    the height of the court with the sd `height` [m], where gaps are measured for the first time:
    the scene states it, or its prior.
    """

    def __init__(self, fit: Fitted, gaps: bool) -> None:
        problem = fit.problem
        prior = problem.prior
        self.fit = fit
        self.problem = problem
        self.camera = problem.camera
        free = [fit.draws.values[name] for name in problem.free]
        self.q: FloatArray = prior.coordinate(np.stack(free, axis=1))
        self.low = prior.low
        self.high = prior.high
        self.step = DIFFERENCE_STEP * prior.width
        self.root: FloatArray = _root_of_covariance(self.q)
        self.height = 0.0
        gap_seen = any(observable.column.gap for observable in problem.observables)
        height_fitted = problem.camera is not None and HEIGHT in problem.camera.keys
        if gaps and not gap_seen and not height_fitted:
            self.height = _sd_of_height(problem.scene)
        if self.height:
            self._add_height()

    def _add_height(self) -> None:
        """One unknown more, which no draw moves, and a direction along it."""
        spec = CAMERA_SPECS[HEIGHT]
        before = self.problem.camera or CameraModel((), ("",), np.zeros(1, np.int64))
        self.camera = before._replace(keys=(*before.keys, HEIGHT))
        self.q = np.column_stack([self.q, np.zeros(len(self.q))])
        wider = np.zeros(np.array(self.root.shape) + 1)
        wider[:-1, :-1] = self.root
        wider[-1, -1] = self.height
        self.root = wider
        self.low = np.append(self.low, spec.lower)
        self.high = np.append(self.high, spec.upper)
        self.step = np.append(self.step, DIFFERENCE_STEP * self.height)

    def thin(self, count: int) -> None:
        """Keep so many draws, evenly spread."""
        self.q = self.q[evenly_spread(len(self.q), count, down=True)]

    def values(self, q: Annotated[FloatArray, "draws unknowns"]) -> Values:
        """All parameters by name at coordinates `q`."""
        values = dict(self.problem.values(q[:, : len(self.problem.free)]))
        if self.height and self.camera is not None:
            for session in self.camera.sessions:
                values[self.camera.name(HEIGHT, session)] = q[:, -1]
        return values

    def gradients(
        self,
        target: Sequence[Quantity],
    ) -> Annotated[FloatArray, "draws targets unknowns"]:
        """Gradients of the target at the draws; draws that do not give it are dropped.

        Raises:
            ParameterError: a target is fixed (`fixed`), or most draws do not give it (`no-answer`).
        """

        def values(q: FloatArray) -> FloatArray:
            parameters = self.values(q)
            return np.stack([quantity.rule(parameters) for quantity in target], axis=1)

        targets, rates = central(values, self.q, self.step, self.low, self.high)
        solved = np.isfinite(targets).all(axis=1)
        for k, quantity in enumerate(target):
            name = quantity.spec.name
            if 2 * np.isfinite(targets[:, k]).sum() <= len(targets):
                text = f"target {name}: the model has no answer there for most posterior draws"
                raise ParameterError(text, "no-answer")
            if not rates[solved][..., k].any():
                text = f"target {name}: it is fixed in this fit; name one that is not"
                raise ParameterError(text, "fixed")
        self.q = self.q[solved]
        return np.asarray(rates[solved].swapaxes(1, 2))

    def information_of(
        self,
        impacts: Impacts,
        index: Annotated[IntArray, "impacts levels"],
        sensors: Sequence[Sensor],
        noisy: bool,
    ) -> list[SensorInformation]:
        """Information of impacts by each of these sensors. What a sensor does not read is measured
        as in the nearest impact of the table. If `noisy`, information on the noises too.
        """
        columns = [observable.column.name for observable in self.problem.observables]
        besides = [name for sensor in sensors for name in sensor.sds if name not in columns]
        columns += dict.fromkeys(besides)
        draws, unknowns = self.q.shape
        # Two bounces for each unknown and each error of a state, and one.
        bounces = draws * (2 * unknowns + 7)
        pieces = -(-len(impacts) * bounces // STATES_AT_ONCE)
        by_sensor: list[list[SensorInformation]] = [[] for _ in sensors]
        for rows in np.array_split(np.arange(len(impacts)), min(pieces, len(impacts))):
            slopes = _ColumnSlopes(self, impacts.take(rows), index[rows], columns)
            for blocks, sensor in zip(by_sensor, sensors, strict=True):
                blocks.append(slopes.read_by(sensor, noisy))
        return [_joined(blocks) for blocks in by_sensor]


def _root_of_covariance(q: FloatArray) -> FloatArray:
    """A root (unknowns, directions) of the covariance of coordinates (draws, unknowns), without
    directions that have next to no variance.
    """
    sizes = np.maximum(q.std(axis=0), np.finfo(float).tiny)
    # In sds first: units and scales of coordinates differ by many powers of ten.
    covariance = np.atleast_2d(np.cov(q / sizes, rowvar=False))
    variances, vectors = np.linalg.eigh(covariance)
    wide = variances > NARROWEST * variances[-1]
    return np.asarray(sizes[:, None] * vectors[:, wide] * np.sqrt(variances[wide]))


def _sd_of_height(scene: Scene) -> float:
    """The sd [m] of the height of the court, as stated, else of its prior; 0 where it is exact."""
    stated = None if scene.camera is None else scene.camera.court_height
    if stated is None:
        spec = CAMERA_SPECS[HEIGHT]
        return parse_prior(spec, spec.prior).width
    return stated.sd if isinstance(stated, ValueWithSd) else 0.0


def _joined(blocks: Sequence[SensorInformation]) -> SensorInformation:
    """Information of all impacts from that of blocks of them."""
    rows = np.concatenate([block.rows for block in blocks], 1)
    solved = np.concatenate([block.solved for block in blocks], 1)
    return SensorInformation(rows, solved)


class _ColumnSlopes:
    """How `columns` of impacts change at the draws of a posterior: `slopes` (draws, impacts,
    columns, directions), and `moves` (draws, impacts, columns, 3) by one sd along each axis of the
    errors of the state.
    """

    def __init__(
        self,
        posterior: PosteriorAtDraws,
        impacts: Impacts,
        index: IntArray,
        columns: Sequence[str],
    ) -> None:
        problem = posterior.problem
        self.posterior = posterior
        self.columns = columns
        unknowns = posterior.q.shape[1]
        self.nearest = _nearest_rows(posterior.fit, impacts)
        errors = None
        if problem.rows.errors is not None:
            errors = problem.rows.errors.take(self.nearest)
        self.errors = errors
        # Planned impacts are filmed, and dropped from heights, as the last were.
        last = np.full(len(impacts), len(problem.table) - 1)
        fall = None if problem.fall is None else problem.fall.take(last)
        camera = posterior.camera
        if camera is not None:
            session = np.full(len(impacts), len(camera.sessions) - 1)
            camera = camera._replace(session=session)
        request = PredictionRequest(impacts, index, tuple(columns), camera=camera, fall=fall)

        def columns_at(rows: FloatArray) -> FloatArray:
            """Columns (rows, impacts, columns) at unknowns and errors of states (rows, n)."""
            states = impacts
            if errors is not None:
                along = rows[:, unknowns:]
                states = impacts.moved(np.einsum("ikl,dl->dik", errors.axes, along))
            values = posterior.values(rows[:, :unknowns])
            rebound = request.rebounds(problem.forward, values, states)
            return np.stack([rebound.column(name) for name in columns], axis=2)

        axes = 0 if errors is None else 3
        exact = np.zeros((len(posterior.q), axes))
        middle, rates = central(
            columns_at,
            np.column_stack([posterior.q, exact]),
            np.append(posterior.step, np.full(axes, DIFFERENCE_STEP)),
            np.append(posterior.low, np.full(axes, -np.inf)),
            np.append(posterior.high, np.full(axes, np.inf)),
        )
        self.solved: BoolArray = np.asarray(np.isfinite(middle).all(axis=2))
        rates = np.where(self.solved[:, None, :, None], rates, 0.0)
        of_unknowns = rates[:, :unknowns]
        self.slopes = np.einsum("dnsc,nk->dsck", of_unknowns, posterior.root, optimize=True)
        self.moves = rates[:, unknowns:].transpose(0, 2, 3, 1)

    def read_by(self, sensor: Sensor, noisy: bool) -> SensorInformation:
        """Information of the impacts as a sensor reads them; if `noisy`, on the noises too."""
        posterior = self.posterior
        values = posterior.values(posterior.q)
        names = self._names_read(sensor)
        seen = self._seen(sensor, names)
        variance = self._variances(sensor, names, values)
        of_centre, of_scale = posterior.problem.forward.noise.information(values)
        whitened, variance = self._whitened(sensor, names, seen, variance)
        rows = [np.sqrt(self._at_draws(of_centre)) * whitened]
        if noisy:
            growth = self._growth(sensor, names, values, seen, variance)
            rows.append(np.sqrt(self._at_draws(of_scale)) * growth)
        return SensorInformation(np.concatenate(rows, axis=2), self.solved)

    def _at_draws(self, weight: FloatArray) -> FloatArray:
        """A weight, or one of each draw, (draws, 1, 1, 1)."""
        return np.broadcast_to(weight, len(self.solved))[:, None, None, None]

    def _fitted(self) -> dict[str, int]:
        """Places of the fitted columns among the observables, by name."""
        observables = self.posterior.problem.observables
        return {observable.column.name: k for k, observable in enumerate(observables)}

    def _names_read(self, sensor: Sensor) -> list[str]:
        """The columns that are read with a sensor: the fitted ones and its own, of a drop the
        vertical ones.
        """
        fitted = self._fitted()
        names = [name for name in self.columns if name in fitted or name in sensor.sds]
        if sensor.drop is None:
            return names
        return [name for name in names if COLUMNS[name].vertical]

    def _seen(self, sensor: Sensor, names: Sequence[str]) -> BoolArray:
        """Which columns (impacts, names) are read: of the sensor all, others where the nearest row
        has them.
        """
        fitted = self._fitted()
        y = self.posterior.problem.rows.y
        seen = np.ones((len(self.nearest), len(names)), dtype=np.bool_)
        for k, name in enumerate(names):
            if name not in sensor.sds:
                seen[:, k] = np.isfinite(y[self.nearest, fitted[name]])
        return seen

    def _variances(self, sensor: Sensor, names: Sequence[str], values: Values) -> FloatArray:
        """Variances of scatter and independent stated errors (draws, impacts, names)."""
        problem = self.posterior.problem
        fitted = self._fitted()
        sds = []
        for name in names:
            sd: FloatArray | float
            if name not in sensor.sds:
                stated = problem.rows.sd[self.nearest, fitted[name]]
                sd = problem.forward.column_sd(name, values, stated)
            elif name in fitted and problem.observables[fitted[name]].stated:
                # What balls scatter beyond stated errors they go on to scatter.
                sd = problem.forward.column_sd(name, values, sensor.sds[name])
            else:
                sd = sensor.sds[name]
            sds.append(np.broadcast_to(sd, self.solved.shape))
        return np.stack(sds, axis=2) ** 2

    def _whitened(
        self,
        sensor: Sensor,
        names: Sequence[str],
        seen: BoolArray,
        variance: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Slopes (draws, impacts, names, directions) in sds of independent errors, and variances
        (draws, impacts, names) with the errors of states.
        """
        places = [self.columns.index(name) for name in names]
        slopes = self.slopes[:, :, places] * seen[..., None]
        if self.errors is None:
            return slopes / np.sqrt(variance)[..., None], variance
        fitted = self._fitted()
        # A column that a sensor reads has an independent error, and is none of the fitted ones.
        before = np.array([-1 if name in sensor.sds else fitted[name] for name in names])
        as_before = seen & (before >= 0)
        both = as_before[:, :, None] & as_before[:, None, :]
        follows = self.errors.follows[:, before]
        follows = follows * as_before[..., None]
        moves = self.moves[:, :, places]
        moves = moves * seen[..., None]
        away = moves - follows @ self.errors.axes
        rest = self.errors.rest[:, before][:, :, before]
        scatter = variance[..., None] * np.eye(len(names))
        of_states = away @ away.swapaxes(2, 3)
        covariance = rest * both + of_states + scatter
        whitened = np.linalg.solve(np.linalg.cholesky(covariance), slopes)
        return whitened, np.diagonal(covariance, axis1=2, axis2=3)

    def _growth(
        self,
        sensor: Sensor,
        names: Sequence[str],
        values: Values,
        seen: BoolArray,
        variance: FloatArray,
    ) -> FloatArray:
        """Derivatives (draws, impacts, names, directions) of the logarithm of the sd of each
        column.
        """
        problem = self.posterior.problem
        root = self.posterior.root
        growth = np.zeros((*variance.shape, root.shape[1]))
        noises = {observable.column.name: observable.noise for observable in problem.observables}
        for k, name in enumerate(names):
            noise = noises.get(name, "")
            if name not in sensor.sds and noise in problem.free:
                unknown = problem.free.index(noise)
                size = values[noise][:, None]
                # Of the logarithm of the noise with its coordinate.
                slope = problem.prior.stretch(unknown, size) / size
                rate = size**2 / variance[..., k] * slope
                rate = rate * seen[:, k]
                growth[:, :, k] = rate[..., None] * root[unknown]
        return growth


def _nearest_rows(fit: Fitted, impacts: Impacts) -> IntArray:
    """Of each impact the nearest row (impacts,) of the table, among those in which most was
    measured.
    """
    rows = fit.problem.rows
    radius = fit.problem.forward.model.ball.radius
    counts = np.isfinite(rows.y).sum(axis=1)
    complete = np.flatnonzero(counts == counts.max())
    if rows.errors is None and not rows.sd.any():
        # All are measured alike.
        return np.full(len(impacts), complete[0])
    # Of a long table evenly spread ones.
    complete = complete[evenly_spread(len(complete), LONG_ROWS, down=True)]
    states = rows.states.take(complete).forwards
    impacts = impacts.forwards
    along = (impacts.v_x1[:, None] - states.v_x1) ** 2
    towards = (impacts.v_y1[:, None] - states.v_y1) ** 2
    around = (radius * (impacts.omega_1[:, None] - states.omega_1)) ** 2
    distances = along + towards + around
    return np.asarray(complete[distances.argmin(axis=1)])
