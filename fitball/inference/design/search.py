"""The search for impacts: every setting to first order, then the best, the best after that, and so on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.errors import FitError
from fitball.inference.design.force_plate import plate_rows
from fitball.inference.design.gain import Left, nothing_measured, over_draws
from fitball.inference.design.knowledge import DIFFERENTIATED, Knowledge, solved
from fitball.inference.design.sensor import Sensor
from fitball.inference.design.settings import Setting, Settings
from fitball.inference.design.target import Target
from fitball.inference.likelihood.cells import cells_of
from fitball.inference.problem.problem import Problem
from fitball.inference.results.quantiles import MOST_UNSOLVED
from fitball.models.types import STATUS_REASON, Rebound, Status
from fitball.values import FloatArray, Impacts

# Fisher information of planned impacts, draw by draw, as rows: their squares add up to it. Rows are derivatives of
# what is measured, whitened by its noise, and of the logarithm of that noise where it is fitted, with respect to
# directions in which the posterior has the variance one.


@dataclass(frozen=True)
class Differentiated:
    """Rebounds (draws, impacts) at planned impacts of `problem` for `coordinates` (draws, free), with derivatives of
    each output with respect to coordinates (draws, impacts, free).
    """

    problem: Problem
    coordinates: FloatArray
    rebound: Rebound
    slopes: Mapping[str, FloatArray]

    @property
    def columns(self) -> Mapping[str, FloatArray]:
        """Every parameter by name, (draws,)."""
        return self.problem.all_values(self.problem.to_values(self.coordinates))

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Which draws can be evaluated at which impacts."""
        return solved(self.rebound)


def differentiated(problem: Problem, coordinates: FloatArray) -> Differentiated:
    """The planned impacts of a problem (see `Knowledge.at`) with all derivatives."""
    rebound, slopes = problem.differentiated(coordinates)
    return Differentiated(problem, coordinates, rebound, slopes)


def information_rows(made: Differentiated, sensor: Sensor, root: FloatArray) -> FloatArray:
    """Rows (draws, impacts, rows, directions) of what a `sensor` tells, in the directions of `Knowledge.root`, or of
    `Knowledge.roots` at the draws; zero where a draw cannot be evaluated.
    """
    problem, columns = made.problem, made.columns
    told = cells_of(problem, columns, made.rebound, sensor.columns, made.slopes)
    worth = np.sqrt(problem.noise.information(columns))[..., None, None]
    scale = np.sqrt(problem.noise.scale_information(columns))[..., None, None]
    parts = [worth[..., None] * told.spread_out(told.slope), scale[..., None] * told.spread_out(told.growth)]
    if problem.incident is not None:
        parts.append(scale[..., None] * told.turn)
    rows = np.concatenate(parts, axis=2)
    known = made.solved & np.isfinite(rows).all(axis=(2, 3))
    rows = np.where(known[..., None, None], rows, 0.0)
    return np.asarray(rows @ (root if root.ndim == 2 else root[:, None]))


# Impacts that are looked at together, and numbers of all rows of information that are held: fewer draws beyond.
TOGETHER, HELD = 64, 2e7
LEAST_DRAWS = 40
# Settings at which a force plate is looked at beside the chosen ones: the best without it, and others over the grid.
PLATED = 12


@dataclass(frozen=True)
class Looked:
    """Some impacts to first order at the `draws` looked at: information `rows` (draws, impacts, rows, directions) by
    sensor name, which draws are `solved` (draws, impacts), and the status of each. `only` are those looked at.
    """

    impacts: Impacts
    like: NDArray[np.int64]
    rows: Mapping[str, FloatArray]
    solved: NDArray[np.bool_]
    status: NDArray[np.int8]
    only: NDArray[np.bool_] | None = None

    @property
    def allowed(self) -> NDArray[np.bool_]:
        """Impacts at which enough draws can be evaluated, and which were looked at."""
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

    def mean_gains(self, left: Left, sensor: str, repeats: int = 1) -> FloatArray:
        """Gains (impacts,) averaged over draws, NaN where not allowed."""
        gains = over_draws(left.gains(np.sqrt(repeats) * self.rows[sensor]), self.solved)
        return np.where(self.allowed, gains, np.nan)


def look(
    known: Knowledge, draws: FloatArray, impacts: Impacts, like: NDArray[np.int64], sensors: Mapping[str, Sensor]
) -> Looked:
    """Information of impacts by each sensor."""
    rows: dict[str, list[FloatArray]] = {name: [] for name in sensors}
    status, roots = [], known.roots(draws)
    for k in range(0, len(impacts), TOGETHER):
        part = np.arange(k, min(k + TOGETHER, len(impacts)))
        made = differentiated(known.at(impacts.take(part), like[part]), draws)
        status.append(made.rebound.status)
        for name, sensor in sensors.items():
            rows[name].append(information_rows(made, sensor, roots))
    joined = np.concatenate(status, axis=1)
    together = {name: np.concatenate(parts, axis=1) for name, parts in rows.items()}
    return Looked(impacts, like, together, joined == 0, joined)


@dataclass(frozen=True)
class Search:
    """All that a search for impacts looks at: the settings as the `grid`, and `apart` from it the drop of each sensor
    that has one and the settings at which plates are looked at.
    """

    known: Knowledge
    draws: FloatArray
    target: Target
    settings: Settings
    sensors: Mapping[str, Sensor]
    grid: Looked
    apart: Mapping[str, Looked]
    start: Left

    def looked(self, sensor: str) -> Looked:
        """The impacts that a sensor may be used with."""
        return self.apart.get(sensor, self.grid)

    def setting(self, sensor: str, place: int) -> Setting:
        """The incident state of an impact that a sensor is used with."""
        if self.sensors[sensor].drop is None:
            return self.settings.setting(place)
        return Setting(
            self.settings.surfaces[place], float(self.apart[sensor].impacts.v_y1[place]), float(np.pi / 2.0), 0.0
        )


def searched(
    known: Knowledge, target: Target, settings: Settings, sensors: Mapping[str, Sensor]
) -> tuple[Search, float]:
    """Everything to first order, and the share of draws at which the target has no answer."""
    rows = max(2 * len(sensor.columns) for sensor in sensors.values())
    count = int(HELD / (len(settings.impacts) * rows * known.root.shape[1] * len(sensors)))
    draws = known.some(min(DIFFERENTIATED, max(LEAST_DRAWS, count)))
    gradients = target.gradients(draws)
    told = np.isfinite(gradients).all(axis=(1, 2))
    if np.mean(told) < 1.0 - MOST_UNSOLVED:
        raise FitError(
            f"{target.words}: {100.0 * np.mean(~told):.0f} % of the draws of the posterior cannot be evaluated "
            "there, so nothing can be planned about it"
        )
    draws, gradients = draws[told], gradients[told]
    free = {name: sensor for name, sensor in sensors.items() if sensor.drop is None and sensor.plate is None}
    grid = look(known, draws, settings.impacts, settings.like, free)
    if not grid.allowed.any():
        why = next(iter(grid.failures))
        raise FitError(f"no setting can be planned: most draws of the posterior cannot be evaluated at any; {why}")
    apart = {}
    for name, sensor in sensors.items():
        if sensor.drop is not None:
            each = np.array(settings.rows, dtype=np.int64)
            apart[name] = look(
                known, draws, sensor.drop.take(np.zeros(each.size, dtype=np.int64)), each, {name: sensor}
            )
    start = nothing_measured(gradients @ known.roots(draws))
    return Search(known, draws, target, settings, sensors, grid, apart, start), float(np.mean(~told))


def with_plates(search: Search, chosen: Sequence[int]) -> Search:
    """The search with the sensors that have a plate: at the `chosen` settings, those that are best without, and some
    others, since records take long.
    """
    plates = {name: sensor for name, sensor in search.sensors.items() if sensor.plate is not None}
    if not plates:
        return search
    grid, known, apart = search.grid, search.known, dict(search.apart)
    gains = np.nan_to_num(grid.mean_gains(search.start, next(iter(search.sensors))), nan=-1.0)
    allowed = np.flatnonzero(grid.allowed)
    even = allowed[np.linspace(0, allowed.size - 1, min(PLATED, allowed.size)).astype(np.int64)]
    some = np.unique(np.concatenate([np.argsort(-gains, kind="stable")[:PLATED], even, np.array(chosen, np.int64)]))
    some = some[grid.allowed[some]]
    planned = known.at(grid.impacts.take(some), grid.like[some])
    forces = plate_rows(planned, search.draws, grid.solved[:, some], known.roots(search.draws))
    only = np.isin(np.arange(len(grid.impacts)), some)
    beside = look(known, search.draws, grid.impacts.take(some), grid.like[some], plates)
    for name in plates:
        rows = np.concatenate([beside.rows[name], forces], axis=2)
        whole = np.zeros((rows.shape[0], len(grid.impacts), *rows.shape[2:]))
        whole[:, some] = rows
        apart[name] = Looked(grid.impacts, grid.like, {name: whole}, grid.solved, grid.status, only)
    return replace(search, apart=apart)


@dataclass(frozen=True)
class Batch:
    """Impacts chosen one after the other: (sensor, place) each, the gain that each added, and what was left after."""

    places: tuple[tuple[str, int], ...]
    gains: tuple[float, ...]
    left: tuple[Left, ...]


def greedy(search: Search, count: int, repeats: int, sensors: Sequence[str]) -> Batch:
    """The best impact, the best after that, and so on, by gain for its cost."""
    left, places, gains, lefts = search.start, [], [], []
    for _ in range(count):
        found = [search.looked(name).mean_gains(left, name, repeats) for name in sensors]
        worth = [
            np.nan_to_num(gain / search.sensors[name].cost, nan=-np.inf)
            for name, gain in zip(sensors, found, strict=True)
        ]
        best = int(np.argmax([one.max() for one in worth]))
        place = int(np.argmax(worth[best]))
        rows = np.sqrt(repeats) * search.looked(sensors[best]).rows[sensors[best]][:, place]
        left = left.after(rows)
        places.append((sensors[best], place))
        gains.append(float(found[best][place]))
        lefts.append(left)
    return Batch(tuple(places), tuple(gains), tuple(lefts))
