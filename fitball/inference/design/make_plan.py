"""From a posterior to a plan: look at every setting to first order, choose a batch, say what it is worth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral

import numpy as np

from fitball.data.lines import Range
from fitball.errors import ParameterError, check_whole
from fitball.inference.design.force_plate import with_plate
from fitball.inference.design.gain import Left, over_draws
from fitball.inference.design.knowledge import knowledge
from fitball.inference.design.results import Chosen, Plan, Worth
from fitball.inference.design.search import Batch, Search, greedy, look, searched, with_plates
from fitball.inference.design.sensor import build_sensors
from fitball.inference.design.settings import build_settings
from fitball.inference.design.target import parse_target
from fitball.inference.prediction.posterior_predictive import regime_shares
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Posterior
from fitball.values import FloatArray
from fitball.wording import option

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
        check_whole(seed=self.seed)
        if self.target is not None and len(self.target) == 0:
            raise ParameterError(f"target = {self.target!r}: expected one name or more, or None for all parameters")
        for name, most in (("impacts", MOST_IMPACTS), ("repeats", MOST_REPEATS)):
            value = getattr(self, name)
            if not (isinstance(value, Integral) and 1 <= int(value) <= most):
                raise ParameterError(f"{option(name, value)}: expected a number from 1 to {most:,}")


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
    chance = np.random.default_rng(np.random.SeedSequence(asked.seed).spawn(1)[0])
    known = knowledge(problem, posterior, chance)
    settings = build_settings(problem, asked.speed, asked.angle, asked.spin)
    sensors = {sensor.name: sensor for sensor in build_sensors(problem, asked.sensors, asked.cost)}
    plate = next((sensor.plate for sensor in sensors.values() if sensor.plate is not None), None)
    if plate is not None:
        known = with_plate(known, plate, chance)
    target = parse_target(asked.target, known)
    report("every setting to first order")
    search, lost = searched(known, target, settings, sensors)
    by_cost = bool(asked.cost)
    search = with_plates(search, ()) if by_cost else search
    batch = greedy(search, asked.impacts, asked.repeats, tuple(sensors) if by_cost else tuple(sensors)[:1])
    search = search if by_cost else with_plates(search, [place for _name, place in batch.places])
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
        again=again[0],
        again_sds=now * again[1],
        worths=tuple(_worth(search, name, batch, asked.repeats, now) for name in sensors),
        measured=problem.impacts,
        by_cost=by_cost,
        failed=search.grid.failures,
        draws=len(search.draws),
        lost=lost,
        seed=asked.seed,
        notes=cautions,
    )


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


def _worth(search: Search, name: str, batch: Batch, repeats: int, now: FloatArray) -> Worth:
    """The best impact by one sensor, and the whole batch read by it (a sensor with a drop: as many drops)."""
    looked, sensor = search.looked(name), search.sensors[name]
    gains = looked.mean_gains(search.start, name)
    if not np.any(np.isfinite(gains)):
        unknown, none = np.full(now.shape, np.nan), float("nan")
        return Worth(name, sensor.words, sensor.cost, search.setting(name, 0), none, none, unknown)
    best = int(np.nanargmax(gains))
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
        name, sensor.words, sensor.cost, search.setting(name, best), float(gains[best]), total,
        now * shrunk(search.start, left),
    )  # fmt: skip


def _table_again(search: Search, problem: Problem, count: int) -> tuple[float, FloatArray]:
    """What `count` impacts of the fitted table, all of it alike, would tell, and by what factor sds would fall."""
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
