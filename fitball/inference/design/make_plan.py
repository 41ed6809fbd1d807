"""From a posterior to a plan: look at every setting to first order, choose a batch, check finalists without that."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fitball.data.range_text import Range
from fitball.errors import FitError, ParameterError
from fitball.inference.design.force_plate import plate_rows, with_plate
from fitball.inference.design.gain import Left, nothing_measured, over_draws
from fitball.inference.design.information import differentiated, information_rows
from fitball.inference.design.knowledge import DIFFERENTIATED, Knowledge, knowledge
from fitball.inference.design.nested import NestedGain, Planned, nested_gain
from fitball.inference.design.results import Chosen, Plan, Setting, Worth
from fitball.inference.design.sensor import Sensor
from fitball.inference.design.sensor_text import build_sensors
from fitball.inference.design.settings import Settings, build_settings
from fitball.inference.design.target import Target, parse_target
from fitball.inference.prediction.posterior_predictive import regime_shares
from fitball.inference.problem.problem import Problem
from fitball.inference.results.quantiles import MOST_UNSOLVED
from fitball.inference.results.results import Posterior
from fitball.models.types import STATUS_REASON, Status
from fitball.values import FloatArray, Impacts
from fitball.wording import option

# Impacts that are looked at together, and numbers of all rows of information that are held: fewer draws beyond.
TOGETHER, HELD = 64, 2e7
LEAST_DRAWS = 40
# Settings at which a force plate is looked at beside the chosen ones: the best without it, and others over the grid.
PLATED = 12
# Impacts of the fitted table that stand for all of it, measured again.
OF_TABLE = 60
MOST_IMPACTS, MOST_REPEATS = 100, 1000


@dataclass(frozen=True)
class Asked:
    """What a user asks for: see `fitball.plan`."""

    target: str | Sequence[str] | None = None
    speed: Range | None = None
    angle: Range | None = None
    spin: Range | None = None
    impacts: int = 5
    repeats: int = 1
    sensors: Sequence[str] | None = None
    cost: Mapping[str, float] = field(default_factory=dict)
    seed: int = 1

    def __post_init__(self) -> None:
        """Raise ParameterError for numbers that cannot work."""
        for name, most in (("impacts", MOST_IMPACTS), ("repeats", MOST_REPEATS)):
            if not 1 <= getattr(self, name) <= most:
                raise ParameterError(f"{option(name, getattr(self, name))}: expected a number from 1 to {most:,}")
        if self.seed < 0:
            raise ParameterError(f"seed = {self.seed}: expected a number not below 0")


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

    def mean_gains(self, left: Left, sensor: str, repeats: int = 1) -> FloatArray:
        """Gains (impacts,) averaged over draws, NaN where not allowed."""
        gains = over_draws(left.gains(np.sqrt(repeats) * self.rows[sensor]), self.solved)
        return np.where(self.allowed, gains, np.nan)


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
            return Setting(*self.settings.state(place))
        return Setting(
            self.settings.surfaces[place], float(self.apart[sensor].impacts.v_y1[place]), float(np.pi / 2.0), 0.0
        )

    def planned(self, sensor: str, places: Sequence[int]) -> Planned:
        """Impacts that a sensor reads."""
        looked, rows = self.looked(sensor), np.array(places, dtype=np.int64)
        return Planned(self.known.at(looked.impacts.take(rows), looked.like[rows]), self.sensors[sensor])


def make_plan(
    problem: Problem,
    posterior: Posterior | None,
    asked: Asked,
    cautions: tuple[str, ...] = (),
    report: Callable[[str], None] = lambda _stage: None,
) -> Plan:
    """What to measure next; `cautions` are what to know of the fit.

    Raises FitError for a fit that cannot be planned from, ParameterError for what cannot be asked of it.
    """
    first, *streams = np.random.SeedSequence(asked.seed).spawn(2)
    chance = np.random.default_rng(first)
    known = knowledge(problem, posterior, chance)
    settings = build_settings(problem, asked.speed, asked.angle, asked.spin)
    sensors = {sensor.name: sensor for sensor in build_sensors(problem, asked.sensors, asked.cost)}
    plate = next((sensor.plate for sensor in sensors.values() if sensor.plate is not None), None)
    if plate is not None:
        known = with_plate(known, plate, chance)
    target = parse_target(asked.target, known)
    report("every setting to first order")
    search, lost = _searched(known, target, settings, sensors)
    by_cost = bool(asked.cost)
    search = _with_plates(search, ()) if by_cost else search
    batch = _greedy(search, asked.impacts, asked.repeats, tuple(sensors) if by_cost else tuple(sensors)[:1])
    search = search if by_cost else _with_plates(search, [place for _name, place in batch.places])
    rng = np.random.default_rng(streams[0])
    report("finalists by nested Monte Carlo")
    by_sensor: dict[str, list[int]] = {}
    for sensor, place in batch.places:
        by_sensor.setdefault(sensor, []).extend([place] * asked.repeats)
    nested = _checked(search, by_sensor, rng)
    quantities = target.values(known.coordinates)
    now = np.nanstd(quantities, axis=0)
    again = _table_again(search, problem, asked.impacts * asked.repeats)
    return Plan(
        target=target.words,
        parts=target.parts,
        sds=now,
        settings=settings,
        gains=search.grid.mean_gains(search.start, next(iter(sensors))).reshape(settings.shape),
        chosen=tuple(_chosen(search, batch, k, now) for k in range(len(batch.places))),
        repeats=asked.repeats,
        batch=nested,
        again=again[0],
        again_sds=now * again[1],
        worths=tuple(_worth(search, name, batch, asked.repeats, now, rng) for name in sensors),
        measured=problem.impacts,
        by_cost=by_cost,
        failed=_failures(search.grid),
        draws=len(search.draws),
        lost=lost,
        seed=asked.seed,
        notes=cautions,
    )


def _searched(
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
        why = next(iter(_failures(grid)))
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


def _with_plates(search: Search, chosen: Sequence[int]) -> Search:
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


def _checked(search: Search, places: Mapping[str, Sequence[int]], rng: np.random.Generator) -> NestedGain:
    """Nested Monte Carlo of impacts by sensor; of a plate's records there is none."""
    if any(search.sensors[name].plate is not None for name in places):
        return NestedGain(float("nan"), float("nan"), 0.0, 1.0)
    return nested_gain(search.known, [search.planned(*one) for one in places.items()], search.target, rng)


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
class Batch:
    """Impacts chosen one after the other: (sensor, place) each, the gain that each added, and what was left after."""

    places: tuple[tuple[str, int], ...]
    gains: tuple[float, ...]
    left: tuple[Left, ...]


def _greedy(search: Search, count: int, repeats: int, sensors: Sequence[str]) -> Batch:
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


def shrunk(start: Left, left: Left) -> FloatArray:
    """By what factor (parts,) standard deviations are expected to fall: the geometric mean over draws, which is minus
    the gain about that part alone.
    """
    before, after = start.sds, left.sds
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.where(before > 0.0, np.log(after / before), 0.0)
    return np.asarray(np.exp(logs.mean(axis=0)))


def _chosen(search: Search, batch: Batch, k: int, now: FloatArray) -> Chosen:
    sensor, place = batch.places[k]
    looked = search.looked(sensor)
    one = np.array([place])
    at = search.known.at(looked.impacts.take(one), looked.like[one])
    return Chosen(
        search.setting(sensor, place), sensor, batch.gains[k], now * shrunk(search.start, batch.left[k]),
        float(1.0 - looked.solved[:, place].mean()),
        regime_shares(at.rebound(at.to_values(search.draws)))[0] if search.known.problem.table.has_tangential else {},
    )  # fmt: skip


def _worth(search: Search, name: str, batch: Batch, repeats: int, now: FloatArray, rng: np.random.Generator) -> Worth:
    """The best impact by one sensor, and the whole batch read by it (a sensor with a drop: as many drops)."""
    looked, sensor = search.looked(name), search.sensors[name]
    gains = looked.mean_gains(search.start, name)
    if not np.any(np.isfinite(gains)):
        nothing = NestedGain(float("nan"), float("nan"), 0.0, 1.0)
        unknown = np.full(now.shape, np.nan)
        return Worth(
            name, sensor.words, sensor.cost, search.setting(name, 0), float("nan"), nothing, float("nan"), unknown
        )
    best = int(np.nanargmax(gains))
    nested = _checked(search, {name: [best]}, rng)
    left, total = search.start, 0.0
    for other, place in batch.places:
        # A drop has no other impact; a setting that was chosen for a drop is none for other sensors, nor one at which
        # no plate was looked at.
        shared = sensor.drop is None and search.sensors[other].drop is None and looked.allowed[place]
        mine = place if shared or other == name else best
        rows = np.sqrt(repeats) * looked.rows[name][:, mine]
        total += float(over_draws(left.gains(rows[:, None]), looked.solved[:, [mine]])[0])
        left = left.after(rows)
    return Worth(
        name, sensor.words, sensor.cost, search.setting(name, best), float(gains[best]), nested, total,
        now * shrunk(search.start, left),
    )  # fmt: skip


def _table_again(search: Search, problem: Problem, count: int) -> tuple[float, FloatArray]:
    """What `count` impacts of the fitted table would tell, each of its impacts as often as any other, and by what
    factor sds would fall.
    """
    total = len(problem.impacts)
    rows = np.linspace(0, total - 1, min(total, OF_TABLE)).round().astype(np.int64)
    sensor = next(iter(search.sensors.values()))
    looked = look(search.known, search.draws, problem.impacts.take(rows), rows, {sensor.name: sensor})
    left, gained = search.start, 0.0
    for k in range(rows.size):
        one = np.sqrt(count / rows.size) * looked.rows[sensor.name][:, k]
        gained += float(left.gains(one[:, None]).mean())
        left = left.after(one)
    return gained, shrunk(search.start, left)


def _failures(looked: Looked) -> dict[str, int]:
    """Of settings that are withheld why most draws fail there, and how many."""
    reasons: Counter[str] = Counter()
    for column in looked.status[:, ~looked.allowed].T:
        code = Counter(column[column != 0].tolist()).most_common(1)[0][0]
        reasons[STATUS_REASON[Status(code)]] += 1
    return dict(reasons.most_common())
