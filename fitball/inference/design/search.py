"""The search for impacts: every setting to first order, then the best, the best after that, and so on.

Expected information gain to first order is how far a normal posterior narrows, draw by draw. With the posterior
covariance as the unit, `B` the covariance that is left after what was chosen so far, and `R` the rows of a further
impact (their squares add up to its Fisher information), the measurement has the covariance `1 + R B R^T`. Its gain
about a target is its entropy less that at given target, `ln det(1 + R B R^T)/2 - ln det(1 + R B' R^T)/2`, `B'` being
what is left of `B` where the target is known: a determinant of a few columns instead of one of all parameters
(Chaloner and Verdinelli 1995 for the criterion; the identity is that of mutual information).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitball.errors import FitError
from fitball.inference.design.asked import Sensor, Setting, Settings
from fitball.inference.design.films import as_filmed
from fitball.inference.design.knowledge import Knowledge, in_directions, plate_rows
from fitball.inference.design.targets import Target
from fitball.inference.likelihood.cells import Cells, cells_of
from fitball.inference.problem.problem import Problem
from fitball.inference.results.quantiles import MOST_UNSOLVED
from fitball.models.types import STATUS_REASON, Status
from fitball.values import FloatArray, Impacts

# Directions of a target below this share of its variance are combinations of the others, such as a spin that follows
# from the velocities of a sliding ball.
DEPENDENT = 1e-9
# Draws at which derivatives are formed; impacts that are looked at together, and numbers of all rows of information
# that are held: fewer draws beyond.
DIFFERENTIATED, TOGETHER, HELD = 160, 64, 2e7
LEAST_DRAWS = 40
# Settings at which a force plate is looked at beside the chosen ones: the best without it, and others over the grid.
PLATED = 12


@dataclass(frozen=True)
class Left:
    """What is left open after planned impacts, by draw: covariance `whole` (draws, directions, directions) in units
    of the posterior, for a target whose gradients are `towards` (draws, targets, directions).
    """

    whole: FloatArray
    towards: FloatArray

    def gains(self, rows: FloatArray) -> FloatArray:
        """Gains (draws, impacts) [nats] about the target of `rows` (draws, impacts, rows, directions)."""
        return np.asarray(0.5 * (_log_det(rows, self.whole) - _log_det(rows, self._given)))

    def after(self, rows: FloatArray) -> Left:
        """What is left after impacts with `rows` (draws, rows, directions) were measured."""
        across = rows @ self.whole
        inner = np.eye(rows.shape[1]) + across @ rows.transpose(0, 2, 1)
        whole = self.whole - across.transpose(0, 2, 1) @ np.linalg.solve(inner, across)
        return Left(0.5 * (whole + whole.transpose(0, 2, 1)), self.towards)

    def after_all(self, impacts: Iterable[tuple[FloatArray, NDArray[np.bool_]]]) -> tuple[float, Left]:
        """Gain [nats] of impacts one after the other, each by its rows (draws, rows, directions) and which draws can
        be evaluated there (draws,), and what is left then.
        """
        total, left = 0.0, self
        for rows, known in impacts:
            total += float(over_draws(left.gains(rows[:, None]), known[:, None])[0])
            left = left.after(rows)
        return total, left

    @property
    def _given(self) -> FloatArray:
        """The covariance that is left where the target is known."""
        across = self.towards @ self.whole
        size = np.sqrt(np.einsum("dtk,dtk->dt", across, self.towards).clip(np.finfo(np.float64).tiny))
        across = across / size[..., None]
        inner = across @ (self.towards / size[..., None]).transpose(0, 2, 1)
        return np.asarray(
            self.whole - across.transpose(0, 2, 1) @ np.linalg.pinv(inner, DEPENDENT, hermitian=True) @ across
        )

    @property
    def sds(self) -> FloatArray:
        """Standard deviations (draws, targets) of each part of the target."""
        return np.asarray(np.sqrt(np.einsum("dtk,dkl,dtl->dt", self.towards, self.whole, self.towards).clip(0.0)))


def nothing_measured(towards: FloatArray) -> Left:
    """The posterior itself, for gradients (draws, targets, directions)."""
    draws, _targets, directions = towards.shape
    return Left(np.broadcast_to(np.eye(directions), (draws, directions, directions)).copy(), towards)


def _log_det(rows: FloatArray, covariance: FloatArray) -> FloatArray:
    spread = (rows @ covariance[:, None]) @ rows.transpose(0, 1, 3, 2)
    determinants: FloatArray = np.linalg.slogdet(np.eye(rows.shape[2]) + spread)[1]
    return determinants


def over_draws(gains: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    """Mean (impacts,) over the draws that can be evaluated; NaN where none can."""
    counts = known.sum(axis=0)
    total = np.where(known, gains, 0.0).sum(axis=0)
    return np.where(counts > 0, total / np.maximum(counts, 1), np.nan)


def read(planned: Problem, draws: FloatArray, sensors: Iterable[Sensor]) -> list[Cells]:
    """What each sensor reads of planned impacts (see `Knowledge.at`) at draws (draws, free), with derivatives."""
    rebound, slopes = planned.differentiated(draws)
    columns = planned.all_values(planned.to_values(draws))
    made = []
    for sensor in sensors:
        own = planned if sensor.film is None else as_filmed(planned, sensor.film, rebound)
        made.append(cells_of(own, columns, rebound, sensor.columns, slopes))
    return made


def information_rows(planned: Problem, cells: Cells, roots: FloatArray) -> FloatArray:
    """Fisher information of what is read, as rows (draws, impacts, rows, directions) whose squares add up to it:
    derivatives of what is measured, whitened by its noise, and of the logarithm of that noise where it is fitted, in
    the directions of `Knowledge.roots` at the draws; zero where a draw cannot be evaluated.
    """
    worth = np.sqrt(planned.noise.information(cells.columns))[..., None, None]
    scale = np.sqrt(planned.noise.scale_information(cells.columns))[..., None, None]
    parts = [worth[..., None] * cells.spread_out(cells.slope), scale[..., None] * cells.spread_out(cells.growth)]
    # Of whitened cells alone.
    parts.append(scale[..., None] * cells.turn)
    return in_directions(np.concatenate(parts, axis=2), cells.rebound.status == 0, roots)


@dataclass(frozen=True)
class Looked:
    """Impacts to first order at some draws, measured by one sensor: information `rows` (draws, impacts, rows,
    directions) and the `status` (draws, impacts) of each draw. `only` are those evaluated.
    """

    impacts: Impacts
    like: NDArray[np.int64]
    rows: FloatArray
    status: NDArray[np.int8]
    only: NDArray[np.bool_] | None = None

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Which draws can be evaluated at which impacts, (draws, impacts)."""
        return np.asarray(self.status == 0)

    @cached_property
    def allowed(self) -> NDArray[np.bool_]:
        """Impacts that were evaluated, at enough draws."""
        enough = np.asarray(self.solved.mean(axis=0) >= 1.0 - MOST_UNSOLVED)
        return enough if self.only is None else enough & self.only

    @property
    def failures(self) -> dict[str, int]:
        """Of impacts that are not allowed why most draws fail there, and how many."""
        reasons: Counter[str] = Counter()
        for column in self.status[:, ~self.allowed].T:
            code = Counter(column[column != 0].tolist()).most_common(1)[0][0]
            reasons[STATUS_REASON[Status(code)]] += 1
        return dict(reasons.most_common())

    def gains(self, left: Left, repeats: int = 1) -> FloatArray:
        """Gains (impacts,) of impacts made so often, averaged over draws, NaN where not allowed."""
        gains = over_draws(left.gains(np.sqrt(repeats) * self.rows), self.solved)
        return np.where(self.allowed, gains, np.nan)

    def rows_at(self, place: int, times: float) -> tuple[FloatArray, NDArray[np.bool_]]:
        """One impact made so often: its rows, and which draws can be evaluated."""
        return np.sqrt(times) * self.rows[:, place], self.solved[:, place]


def look(
    known: Knowledge, draws: FloatArray, impacts: Impacts, like: NDArray[np.int64], sensors: Mapping[str, Sensor]
) -> dict[str, Looked]:
    """Information of impacts, with the surface and ball of the rows `like` them, by each sensor."""
    rows: dict[str, list[FloatArray]] = {name: [] for name in sensors}
    status, roots = [], known.roots(draws)
    for k in range(0, len(impacts), TOGETHER):
        part = np.arange(k, min(k + TOGETHER, len(impacts)))
        planned = known.at(impacts.take(part), like[part])
        every = read(planned, draws, sensors.values())
        status.append(every[0].rebound.status)
        for name, cells in zip(sensors, every, strict=True):
            rows[name].append(information_rows(planned, cells, roots))
    whole = np.concatenate(status, axis=1)
    return {name: Looked(impacts, like, np.concatenate(parts, axis=1), whole) for name, parts in rows.items()}


@dataclass(frozen=True)
class Search:
    """All that a search for impacts looks at: `looks` by sensor name are over the settings, of a sensor with a drop
    at that drop; sensors with a plate are among them after `with_plates`. `lost` is the share of draws at which the
    target has no answer, which are not among the `draws`.
    """

    known: Knowledge
    draws: FloatArray
    settings: Settings
    sensors: Mapping[str, Sensor]
    looks: Mapping[str, Looked]
    start: Left
    lost: float

    @property
    def grid(self) -> Looked:
        """All settings, measured as before."""
        return self.looks[next(iter(self.sensors))]

    def setting(self, sensor: str, place: int) -> Setting:
        """The incident state of an impact that a sensor is used with."""
        drop = self.sensors[sensor].drop
        if drop is None:
            return self.settings.setting(place)
        return Setting(self.settings.surfaces[place], float(drop.v_y1[0]), float(np.pi / 2.0), 0.0)


def searched(known: Knowledge, target: Target, settings: Settings, sensors: Mapping[str, Sensor]) -> Search:
    """Everything to first order, but for sensors with a plate."""
    rows = sum(2 * len(sensor.columns) for sensor in sensors.values())
    count = int(HELD / (len(settings.impacts) * rows * known.root.shape[1]))
    draws = known.some(min(DIFFERENTIATED, max(LEAST_DRAWS, count)))
    gradients = target.gradients(draws)
    told = np.isfinite(gradients).all(axis=(1, 2))
    lost = float(np.mean(~told))
    if lost > MOST_UNSOLVED:
        raise FitError(
            f"{target.words}: the model cannot be evaluated there for {100.0 * lost:.0f} % of the posterior "
            "draws, so no plan is possible for it"
        )
    draws, gradients = draws[told], gradients[told]
    free = {name: sensor for name, sensor in sensors.items() if sensor.drop is None and sensor.plate is None}
    looks = look(known, draws, settings.impacts, settings.like, free)
    grid = next(iter(looks.values()))
    if not grid.allowed.any():
        why = next(iter(grid.failures))
        raise FitError(
            f"no plan is possible: at every setting the model cannot be evaluated for most posterior draws; {why}"
        )
    each = np.array(settings.rows, dtype=np.int64)
    for name, sensor in sensors.items():
        if sensor.drop is not None:
            looks |= look(known, draws, sensor.drop.take(np.zeros_like(each)), each, {name: sensor})
    start = nothing_measured(gradients @ known.roots(draws))
    return Search(known, draws, settings, sensors, looks, start, lost)


def with_plates(search: Search, chosen: Sequence[int]) -> Search:
    """The search with the sensors that have a plate: at the `chosen` settings, those that are best without, and some
    others, since records take long.
    """
    plates = {name: sensor for name, sensor in search.sensors.items() if sensor.plate is not None}
    if not plates:
        return search
    grid, known, draws = search.grid, search.known, search.draws
    gains = np.nan_to_num(grid.gains(search.start), nan=-1.0)
    allowed = np.flatnonzero(grid.allowed)
    even = allowed[np.linspace(0, allowed.size - 1, min(PLATED, allowed.size)).astype(np.int64)]
    some = np.unique(np.concatenate([np.argsort(-gains, kind="stable")[:PLATED], even, np.array(chosen, np.int64)]))
    some = some[grid.allowed[some]]
    impacts, like = grid.impacts.take(some), grid.like[some]
    forces = plate_rows(known.at(impacts, like), draws, grid.solved[:, some], known.roots(draws))
    only = np.isin(np.arange(len(grid.impacts)), some)
    looks = dict(search.looks)
    for name, beside in look(known, draws, impacts, like, plates).items():
        rows = np.concatenate([beside.rows, forces], axis=2)
        whole = np.zeros((rows.shape[0], len(grid.impacts), *rows.shape[2:]))
        whole[:, some] = rows
        looks[name] = replace(grid, rows=whole, only=only)
    return replace(search, looks=looks)


@dataclass(frozen=True)
class Pick:
    """An impact that was chosen: its sensor, its place among the evaluated ones, the gain that it added, and what was
    left after it.
    """

    sensor: str
    place: int
    gain: float
    left: Left


def greedy(search: Search, count: int, repeats: int, sensors: Sequence[str]) -> list[Pick]:
    """The best impact, the best after that, and so on, by gain for its cost."""
    left, picks = search.start, []
    for _ in range(count):
        found = {name: search.looks[name].gains(left, repeats) for name in sensors}
        worth = {name: np.nan_to_num(found[name] / search.sensors[name].cost, nan=-np.inf) for name in sensors}
        best = max(sensors, key=lambda name: float(worth[name].max()))
        place = int(np.argmax(worth[best]))
        left = left.after(search.looks[best].rows_at(place, repeats)[0])
        picks.append(Pick(best, place, float(found[best][place]), left))
    return picks
