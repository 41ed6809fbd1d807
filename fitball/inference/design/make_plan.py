"""From a posterior to a plan: evaluate every setting to first order, choose a batch, compute its gain.

Of a plan gains are in nats, everything else in SI, angles in radians.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral

import numpy as np

from fitball.data.lines import Range
from fitball.errors import ParameterError, check_whole
from fitball.inference.design.asked import Setting, Settings, build_sensors, build_settings, checked_levels
from fitball.inference.design.knowledge import knowledge, with_height, with_plate
from fitball.inference.design.search import Left, Pick, Search, greedy, look, searched, with_plates
from fitball.inference.design.targets import Part, parse_target
from fitball.inference.prediction.posterior_predictive import regime_shares
from fitball.inference.problem.camera import HEIGHT
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Posterior
from fitball.values import FloatArray, Impacts
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
    levels: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise ParameterError for numbers that cannot work."""
        check_whole(seed=self.seed)
        if self.target is not None and len(self.target) == 0:
            raise ParameterError(f"target = {self.target!r}: expected one or more names, or None for all parameters")
        for name, most in (("impacts", MOST_IMPACTS), ("repeats", MOST_REPEATS)):
            value = getattr(self, name)
            if not (isinstance(value, Integral) and 1 <= int(value) <= most):
                raise ParameterError(f"{option(name, value)}: expected a number from 1 to {most:,}")


@dataclass(frozen=True)
class Chosen:
    """A recommended impact, measured by the `sensor`, after those before it.

    `gain` is what it adds with all its repeats. Beside it are the standard deviations (parts,) of the target expected
    then, the share of draws without an answer there, and phase sequences with their probabilities.
    """

    setting: Setting
    sensor: str
    gain: float
    sds: FloatArray
    unsolved: float
    regimes: Mapping[str, float]


@dataclass(frozen=True)
class Worth:
    """The gain of one way of measuring, to first order: its best single impact with its `gain`; of the whole batch
    read that way the gain `batch` and the expected sds (parts,) after it.
    """

    sensor: str
    words: str
    cost: float
    best: Setting
    gain: float
    batch: float
    sds: FloatArray


@dataclass(frozen=True)
class Height:
    """What is known of the height of the court, which gaps depend on: its `sd` [m], by how much `gap_time` changes
    with it at the first chosen impact [s/m], and the names of the `sensors` that see gaps.
    """

    sd: float
    gap_time: float
    sensors: tuple[str, ...]


@dataclass(frozen=True)
class Plan:
    """What to measure next.

    `sds` (parts,) are those of the posterior, of the target's `parts` in coordinates (of `log` parts those of the
    logarithm). `gains` (surfaces, speeds, angles, spins) are those of one impact measured as before, NaN where too
    many draws cannot be evaluated. `chosen` are in the order of choice, each made `repeats` times. `again` and
    `again_sds` are the gain of repeating as many impacts of the fitted table, to first order, and the sds after it.
    `worths` begin with measuring as before. `failed` maps reasons why draws cannot be evaluated to the number of
    settings withheld for it. `draws` were averaged over, `lost` of them without the target. `height` is None where no
    sensor sees gaps, and where it is known from the fit or fixed.
    """

    target: str
    parts: tuple[Part, ...]
    sds: FloatArray
    settings: Settings
    gains: FloatArray
    chosen: tuple[Chosen, ...]
    repeats: int
    again: float
    again_sds: FloatArray
    worths: tuple[Worth, ...]
    measured: Impacts
    by_cost: bool
    failed: Mapping[str, int]
    draws: int
    lost: float
    seed: int
    notes: tuple[str, ...]
    height: Height | None = None

    @property
    def gain(self) -> float:
        """Expected gain of all chosen impacts [nats], to first order."""
        return float(sum(one.gain for one in self.chosen))


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
    levels = checked_levels(problem, asked.levels)
    settings = build_settings(problem, asked.speed, asked.angle, asked.spin, levels)
    sensors = {sensor.name: sensor for sensor in build_sensors(problem, asked.sensors, asked.cost)}
    plate = next((sensor.plate for sensor in sensors.values() if sensor.plate is not None), None)
    if plate is not None:
        known = with_plate(known, plate, chance)
    fitted = known
    if any(sensor.sees_gaps for sensor in sensors.values()):
        known = with_height(known, chance)
    target = parse_target(asked.target, known, levels)
    report("gains of all settings, to first order")
    search = searched(known, target, settings, sensors)
    by_cost = bool(asked.cost)
    search = with_plates(search, ()) if by_cost else search
    picks = greedy(search, asked.impacts, asked.repeats, tuple(sensors) if by_cost else tuple(sensors)[:1])
    search = search if by_cost else with_plates(search, [pick.place for pick in picks])
    now = np.nanstd(target.values(known.coordinates), axis=0)
    again, again_left = _table_again(search, problem, asked.impacts * asked.repeats, levels)
    return Plan(
        target=target.words,
        parts=target.parts,
        sds=now,
        settings=settings,
        gains=search.grid.gains(search.start).reshape(settings.shape),
        chosen=tuple(_chosen(search, pick, now) for pick in picks),
        repeats=asked.repeats,
        again=again,
        again_sds=now * shrunk(search.start, again_left),
        worths=tuple(_worth(search, name, picks, asked.repeats, now) for name in sensors),
        measured=problem.impacts,
        by_cost=by_cost,
        failed=search.grid.failures,
        draws=len(search.draws),
        lost=search.lost,
        seed=asked.seed,
        notes=cautions,
        height=None if known is fitted else _height(search, picks[0]),
    )


def shrunk(start: Left, left: Left) -> FloatArray:
    """By what factor (parts,) standard deviations are expected to fall: the geometric mean over draws, which is minus
    the gain about that part alone.
    """
    before, after = start.sds, left.sds
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.where(before > 0.0, np.log(after / before), 0.0)
    return np.asarray(np.exp(logs.mean(axis=0)))


def _chosen(search: Search, pick: Pick, now: FloatArray) -> Chosen:
    looked, one = search.looks[pick.sensor], np.array([pick.place])
    at = search.known.at(looked.impacts.take(one), looked.like[one])
    return Chosen(
        search.setting(pick.sensor, pick.place), pick.sensor, pick.gain, now * shrunk(search.start, pick.left),
        float(1.0 - looked.solved[:, pick.place].mean()),
        regime_shares(at.rebound(at.to_values(search.draws)))[0] if search.known.problem.model.has_regimes else {},
    )  # fmt: skip


def _height(search: Search, pick: Pick) -> Height | None:
    """What a plan takes as known of the height of the court, None where the scene fixes it."""
    known, looked = search.known, search.looks[pick.sensor]
    camera, free = known.problem.camera, known.problem.free_names
    assert camera is not None
    name = camera.name(HEIGHT, camera.sessions[-1])
    if name not in free:
        return None
    one = np.array([pick.place])
    at = known.at(looked.impacts.take(one), looked.like[one])
    upwards = np.nanmedian(at.rebound(at.to_values(search.draws)).v_y2)
    heights = known.problem.to_values(known.coordinates)[:, free.index(name)]
    seeing = tuple(name for name, sensor in search.sensors.items() if sensor.sees_gaps)
    return Height(float(np.std(heights)), float(1.0 / at.impacts.v_y1[0] + 1.0 / upwards), seeing)


def _worth(search: Search, name: str, picks: Sequence[Pick], repeats: int, now: FloatArray) -> Worth:
    """The best impact by one sensor, and the whole batch read by it (a sensor with a drop: as many drops)."""
    looked, sensor = search.looks[name], search.sensors[name]
    gains = looked.gains(search.start)
    if not np.any(np.isfinite(gains)):
        unknown, none = np.full(now.shape, np.nan), float("nan")
        return Worth(name, sensor.words, sensor.cost, search.setting(name, 0), none, none, unknown)
    best = int(np.nanargmax(gains))

    def place(pick: Pick) -> int:
        # A drop has no other impact; a setting that was chosen for a drop is none for other sensors, nor one at which
        # no plate was looked at.
        shared = sensor.drop is None and search.sensors[pick.sensor].drop is None and looked.allowed[pick.place]
        return pick.place if shared or pick.sensor == name else best

    total, left = search.start.after_all(looked.rows_at(place(pick), repeats) for pick in picks)
    return Worth(
        name, sensor.words, sensor.cost, search.setting(name, best), float(gains[best]), total,
        now * shrunk(search.start, left),
    )  # fmt: skip


def _table_again(search: Search, problem: Problem, count: int, levels: Mapping[str, str]) -> tuple[float, Left]:
    """The gain of `count` impacts of the fitted table with these labels, repeated evenly, and what they would leave
    open.
    """
    among = np.ones(len(problem.impacts), dtype=np.bool_)
    for pooling in problem.pooling:
        if pooling.column in levels:
            among &= pooling.index == pooling.labels.index(levels[pooling.column])
    measured = np.flatnonzero(among)
    rows = measured[np.linspace(0, measured.size - 1, min(measured.size, OF_TABLE)).round().astype(np.int64)]
    name, sensor = next(iter(search.sensors.items()))
    looked = look(search.known, search.draws, problem.impacts.take(rows), rows, {name: sensor})[name]
    return search.start.after_all(looked.rows_at(k, count / rows.size) for k in range(rows.size))
