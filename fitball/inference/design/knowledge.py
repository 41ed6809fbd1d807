"""What a plan starts from: draws of a posterior, and the unknowns of a planned impact that no draw has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitball.data.force import ForceFile, ForceRecord
from fitball.errors import FitError
from fitball.inference.likelihood.force import force_information_rows, mean_forces
from fitball.inference.problem.camera import HEIGHT, View
from fitball.inference.problem.force_records import ForceRecords, build_records
from fitball.inference.problem.parameters import FORCE_NOISE, NOISE_SPECS, Parameter, parse_prior
from fitball.inference.problem.pooling import GroupBias
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.row_errors import RowErrors
from fitball.inference.results.results import Posterior, thinned
from fitball.values import FloatArray, Impacts
from fitball.wording import option

# Draws that stand for the posterior.
DRAWS = 4000
# The label of the group that planned impacts make where groups are biased: a new one.
NEXT = "planned impacts"
# Directions that the posterior leaves this much narrower than the widest one are held to be known.
NARROW = 1e-10


@dataclass(frozen=True)
class Knowledge:
    """Draws `coordinates` (draws, free) of the posterior of `problem`, with a bias of the planned impacts, as one
    more group, where groups have biases.
    """

    problem: Problem
    coordinates: FloatArray

    def some(self, count: int) -> FloatArray:
        """So many draws (count, free), evenly spread over all."""
        whole = len(self.coordinates)
        rows: FloatArray = self.coordinates[np.linspace(0, whole - 1, min(whole, count)).astype(np.int64)]
        return rows

    @cached_property
    def root(self) -> FloatArray:
        """A matrix (free, directions) whose product with its transpose is the covariance of the coordinates, where
        coordinates at each level of a pooled parameter stand for the places of levels.
        """
        drawn = self._levelled
        # In standard deviations first: units and scales of the coordinates differ by many powers of ten.
        scale = np.maximum(np.std(drawn, axis=0), np.finfo(np.float64).tiny)
        correlation = np.atleast_2d(np.cov(drawn / scale, rowvar=False))
        values, vectors = np.linalg.eigh(correlation)
        wide = values > NARROW * values[-1]
        return np.asarray(scale[:, None] * vectors[:, wide] * np.sqrt(values[wide]))

    @property
    def _pooled(self) -> list[tuple[int, int, list[int]]]:
        """Of each pooled parameter its place among the free ones, that of its spread, and those of its levels."""
        names = self.problem.free_names
        return [
            (
                names.index(item.parameter),
                names.index(item.spread_name),
                [names.index(item.place_name(label)) for label in item.labels],
            )
            for item in self.problem.pooling
            if {item.parameter, item.spread_name, *map(item.place_name, item.labels)} <= set(names)
        ]

    @property
    def _levelled(self) -> FloatArray:
        """The draws with coordinates at levels for their places: where a spread is not known the one is nearly normal
        and the other is not.
        """
        drawn = self.coordinates.copy()
        for common, spread, places in self._pooled:
            drawn[:, places] = drawn[:, [common]] + drawn[:, [spread]] * drawn[:, places]
        return drawn

    def roots(self, draws: FloatArray) -> FloatArray:
        """`root` for derivatives with respect to the coordinates themselves at draws (draws, free): (draws, free,
        directions).
        """
        back = np.broadcast_to(np.eye(draws.shape[1]), (len(draws), draws.shape[1], draws.shape[1])).copy()
        for common, spread, places in self._pooled:
            size = draws[:, spread]
            for place in places:
                # A place is the level less the common coordinate, over the spread.
                back[:, place, place] = 1.0 / size
                back[:, place, common] = -1.0 / size
                back[:, place, spread] = -draws[:, place] / size
        return np.asarray(back @ self.root)

    def at(self, impacts: Impacts, rows: NDArray[np.int64]) -> Problem:
        """The problem at planned impacts, with the surface and ball of the table's `rows` (impacts,). Its table
        and observables are still those of the fit.
        """
        problem, bias = self.problem, self.problem.group_bias
        if bias is not None:
            bias = replace(bias, index=np.full(len(impacts), len(bias.labels) - 1))
        # Planned impacts are filmed as the last were.
        camera = problem.camera
        if camera is not None:
            camera = replace(camera, index=np.full(len(impacts), len(camera.sessions) - 1))
        return replace(
            problem,
            impacts=impacts,
            pooling=tuple(pooling.take(rows) for pooling in problem.pooling),
            group_bias=bias,
            camera=camera,
            errors=None if problem.errors is None else _alike(problem, impacts),
        )


def knowledge(problem: Problem, posterior: Posterior | None, rng: np.random.Generator) -> Knowledge:
    """The knowledge of a fit. Raises FitError for one that cannot be planned from, with the reason."""
    if posterior is None:
        raise FitError(
            f"a plan needs a posterior, and a point fit has none: fit again without {option('point_only')}"
        )
    if problem.model.needs_cor:
        raise FitError(
            "cor = measured needs the measured restitution of each impact, which a planned impact does not have. "
            "Fit again with cor = line, mean or saturating"
        )
    if problem.dimension == 0:
        raise FitError("no parameter of this fit is free: there is nothing to plan for")
    known = Knowledge(problem, problem.to_coordinates(thinned(posterior, DRAWS)))
    return known if problem.group_bias is None else _with_group(known, problem.group_bias, rng)


def _with_group(known: Knowledge, bias: GroupBias, rng: np.random.Generator) -> Knowledge:
    """What is known with the biases of planned impacts."""
    problem = known.problem
    # A further group, whose biases have the prior of all others.
    by_name = {parameter.name: parameter for parameter in problem.parameters}
    added = []
    for observable in problem.observables:
        like = by_name[bias.name(observable.name, bias.labels[0])]
        spec = replace(like.spec, name=bias.name(observable.name, NEXT))
        added.append(replace(like, spec=spec, fixed=None))
    wider = replace(problem, group_bias=replace(bias, labels=(*bias.labels, NEXT)))
    return _with_parameters(Knowledge(wider, known.coordinates), added, rng)


def with_height(known: Knowledge, rng: np.random.Generator) -> Knowledge:
    """What is known where a camera sees the gaps of planned impacts: of the height of the court what the scene states
    or else its prior, unless the fit has it, or used gaps and took it as known.
    """
    problem = known.problem
    view = problem.camera or View((), ("",), np.zeros(len(problem.impacts), dtype=np.int64))
    if HEIGHT in view.keys or any(item.column.gap for item in problem.observables):
        return known
    specs, held = replace(view, keys=(HEIGHT,)).specs(problem.scene)
    fixed = {name: value for name, (value, _why) in held.items()}
    added = [
        Parameter(spec, parse_prior(name, spec.prior, spec.lower, spec.upper, spec.unit), fixed.get(name))
        for name, spec in specs.items()
    ]
    seen = replace(problem, camera=replace(view, keys=(*view.keys, HEIGHT)))
    return _with_parameters(Knowledge(seen, known.coordinates), added, rng)


def _with_parameters(known: Knowledge, added: Sequence[Parameter], rng: np.random.Generator) -> Knowledge:
    """What is known with parameters of which nothing is but their priors."""
    problem = replace(known.problem, parameters=(*known.problem.parameters, *added))
    priors = [parameter.prior for parameter in added if parameter.free]
    drawn = [prior.coordinate(prior.draw(rng, len(known.coordinates))) for prior in priors]
    return Knowledge(problem, np.column_stack([known.coordinates, *drawn]))


def _alike(problem: Problem, planned: Impacts) -> RowErrors:
    """Errors of planned rows: of the incident states the median sds of speed, direction and spin of those that were
    measured. Those of the rebound, which a sensor states, are taken to be independent of them.
    """
    assert problem.errors is not None
    known, measured = problem.errors.incident, problem.impacts
    turned = _turn(measured)
    sds = np.sqrt(np.diagonal(turned @ known @ turned.transpose(0, 2, 1), axis1=1, axis2=2).clip(0.0))
    sds[:, 1] /= measured.speed
    typical = np.tile(np.median(sds, axis=0), (len(planned), 1))
    typical[:, 1] *= planned.speed
    back, count = _turn(planned).transpose(0, 2, 1), len(planned)
    incident = (back * typical[:, None, :] ** 2) @ back.transpose(0, 2, 1)
    return RowErrors(np.asarray(incident), (), np.zeros((count, 0, 3)), np.zeros((count, 0, 0)))


def _turn(impacts: Impacts) -> FloatArray:
    """Rotations (impacts, 3, 3) of `(v_x1, v_y1, omega_1)` to speed, across the path, and spin."""
    speed = impacts.speed
    cosine, sine = impacts.v_x1 / speed, impacts.v_y1 / speed
    turn = np.zeros((len(impacts), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = cosine, sine, -sine, cosine, 1.0
    return turn


# A force plate under planned impacts. Its records are those of the fitted model itself, reduced as measured ones are.
# What they tell of parameters is the information of the likelihood of records: the start of contact is found from
# each, the sensor's noise is independent from sample to sample, and a slow misfit of the model's force, a nuisance,
# counts once and not once a sample.

# Time between samples [s], and shares of the contact that are recorded before and after it.
STEP = 5.0e-5
BEFORE, AFTER = 0.3, 0.3


def with_plate(known: Knowledge, sd: float, rng: np.random.Generator) -> Knowledge:
    """What is known where a plate with that noise `sd` [N] a sample is at hand: its misfit has its prior.

    A fit with records has both already.
    """
    names = {parameter.name for parameter in known.problem.parameters}
    if names.issuperset(FORCE_NOISE):
        return known
    added = []
    for name, fixed in zip(FORCE_NOISE, (sd, None), strict=True):
        spec = NOISE_SPECS[name]
        added.append(Parameter(spec, parse_prior(name, spec.prior, spec.lower, spec.upper, spec.unit), fixed))
    return _with_parameters(known, added, rng)


def in_directions(rows: FloatArray, solved: NDArray[np.bool_], roots: FloatArray) -> FloatArray:
    """Derivatives `rows` (draws, impacts, rows, free) in the directions of `Knowledge.roots`; zero where a draw is
    not `solved` (draws, impacts).
    """
    known = solved & np.isfinite(rows).all(axis=(2, 3))
    return np.asarray(np.where(known[..., None, None], rows, 0.0) @ roots[:, None])


def plate_rows(planned: Problem, draws: FloatArray, solved: NDArray[np.bool_], roots: FloatArray) -> FloatArray:
    """Rows (draws, impacts, directions, directions) whose squares add up to the information of records of the planned
    impacts, as in `in_directions`.
    """
    records = _records(planned, draws, solved)
    slopes, growth = force_information_rows(planned, records, draws)
    rows = in_directions(np.concatenate([slopes, np.sqrt(2.0) * growth], axis=2), solved, roots)
    # As many rows as there are directions say the same.
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _records(planned: Problem, draws: FloatArray, solved: NDArray[np.bool_]) -> ForceRecords:
    """The record of each impact by the draw of the middle contact time."""
    times = np.where(solved, planned.rebound(planned.to_values(draws)).contact_time, np.nan)
    made = []
    for k in range(times.shape[1]):
        order = np.argsort(times[:, k])
        middle = int(order[np.count_nonzero(solved[:, k]) // 2])
        length = float(times[middle, k])
        columns = planned.all_values(planned.to_values(draws[middle : middle + 1]))
        count = int((1.0 + BEFORE + AFTER) * length / STEP)
        first, row = np.array([[-BEFORE * length]]), np.array([k])
        force, _rate = mean_forces(planned, columns, row, first, np.array([STEP]), count)
        made.append(ForceRecord(str(k), k, -BEFORE * length, STEP, np.real(force[0, 0])))
    return build_records(ForceFile("planned", "", tuple(made)), None)
