"""What a plan is asked besides its target: settings of a machine, and ways of measuring."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from math import isfinite, sqrt
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import NUMBERS
from fitball.data.heights import GRAVITY
from fitball.data.lines import Range
from fitball.data.numbers import refuse_beyond
from fitball.data.units import Dimension, parse_unit
from fitball.errors import ParameterError, UnitError, suggestion
from fitball.inference.prediction.posterior_predictive import by_level, levels_of
from fitball.inference.problem.level_names import at_level, checked_label, columns_of, heads_of, labels_of
from fitball.inference.problem.noise import Sizes
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.models.types import Rebound
from fitball.observables import OBSERVABLES, ReboundColumn
from fitball.tracks.film_text import parse_film
from fitball.tracks.frames import NINE
from fitball.tracks.simulate import Film
from fitball.values import FloatArray, Impacts
from fitball.visible import some
from fitball.wording import option, spoken

# Labels of a plan by column.
Labels = Mapping[str, str]

# Incident states that a machine can be set to: a grid over speed, angle and spin, on each surface of a fit.

# Steps of a range for which no number of steps was given.
SPEEDS, ANGLES, SPINS = 6, 15, 5
# Points of a grid, beyond which it takes longer than it tells.
MOST = 20_000


@dataclass(frozen=True)
class Setting:
    """An incident state: `speed`, `angle` to the court, `spin`, and the `surface` (empty where there is one only)."""

    surface: str
    speed: float
    angle: float
    spin: float


@dataclass(frozen=True)
class Settings:
    """The grid: axes in SI, and the table's `rows` whose surface and ball are met, with their `surfaces`. `assumed`
    are the ranges that are defaults. `named` is what the labels of surfaces name: surface, place, ball.
    """

    speeds: FloatArray
    angles: FloatArray
    spins: FloatArray
    rows: tuple[int, ...]
    surfaces: tuple[str, ...]
    assumed: tuple[str, ...]
    named: str = ""

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Surfaces, speeds, angles, spins."""
        return len(self.rows), self.speeds.size, self.angles.size, self.spins.size

    @cached_property
    def _points(self) -> list[FloatArray]:
        axes = (np.arange(len(self.rows), dtype=np.float64), self.speeds, self.angles, self.spins)
        return [axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")]

    @property
    def impacts(self) -> Impacts:
        """All of them, (settings,), in the order of `shape`."""
        _surface, speed, angle, spin = self._points
        upright = np.isclose(angle, np.pi / 2.0)
        return Impacts(np.where(upright, 0.0, speed * np.cos(angle)), speed * np.sin(angle), spin)

    @property
    def like(self) -> NDArray[np.int64]:
        """The row of the table whose surface and ball each meets, (settings,)."""
        return np.array(self.rows, dtype=np.int64)[self._points[0].astype(np.int64)]

    def setting(self, place: int) -> Setting:
        """One of them."""
        surface, *state = (float(axis[place]) for axis in self._points)
        return Setting(self.surfaces[int(surface)], *state)


def build_settings(
    problem: Problem,
    speed: Range | None,
    angle: Range | None,
    spin: Range | None,
    levels: Labels | None = None,
) -> Settings:
    """The grid of the ranges asked for, those of the fitted table where nothing was, on each surface or those of
    `levels`.

    Raises ParameterError for a range of a quantity that the fit does not have, and for a grid too fine.
    """
    table = problem.table
    open_to = {"speed": True, "angle": table.has_tangential, "spin": table.has_tangential and table.has_spin}
    for name, given, words in (
        ("angle", angle, "this fit is of a drop test, with vertical motion only"),
        ("spin", spin, "this fit has no spin, because none was measured"),
    ):
        if given is not None and not open_to[name]:
            raise ParameterError(f"{option(name, '...')}: {words}; leave it out")
    impacts = problem.impacts
    assumed = []
    axes = []
    measured = (
        ("speed", speed, impacts.speed, SPEEDS),
        ("angle", angle, np.minimum(np.arctan2(impacts.v_y1, np.abs(impacts.v_x1)), np.pi / 2.0), ANGLES),
        ("spin", spin, impacts.omega_1, SPINS),
    )
    for name, given, values, steps in measured:
        chosen = given or Range(float(values.min()), float(values.max()))
        # Of a drop test there is but one angle and no spin.
        if given is None and open_to[name]:
            assumed.append(name)
        count = chosen.count or (steps if chosen.high > chosen.low else 1)
        axes.append(np.linspace(chosen.low, chosen.high, count))
    surfaces, first = surfaces_of(problem, levels)
    size = len(surfaces) * axes[0].size * axes[1].size * axes[2].size
    if size > MOST:
        raise ParameterError(f"{size:,} settings: expected {MOST:,} at most; use fewer steps")
    heads = heads_of(tuple(labels_of(problem.pooling)))
    return Settings(axes[0], axes[1], axes[2], first, surfaces, tuple(assumed), ", ".join(heads))


def surfaces_of(problem: Problem, levels: Labels | None = None) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Combinations of levels by their labels in words (empty where there are none), and the first row of each; those
    with the labels of `levels` alone. Raises ParameterError where no impact has these.
    """
    found = [(levels_of(problem, labels), rows[0]) for labels, rows in by_level(problem).items()]
    chosen = [one for one in found if not levels or levels.items() <= one[0].items()]
    if not chosen:
        asked = " and ".join(f"{column} {label}" for column, label in (levels or {}).items())
        raise ParameterError(f"no impact of the fitted table has {asked} together: a plan needs measured levels")
    return tuple(", ".join(labels.values()) for labels, _ in chosen), tuple(int(row) for _, row in chosen)


def checked_levels(problem: Problem, levels: Labels) -> dict[str, str]:
    """The labels of a plan as they were fitted. Raises ParameterError for others, `new` among them."""
    asked = columns_of(problem.pooling, levels)
    named = {column: checked_label(problem.pooling, column, label) for column, label in asked.items()}
    for column, label in named.items():
        if label not in labels_of(problem.pooling)[column]:
            raise ParameterError(
                f"{at_level(column, label)}: a plan needs a {column} that was fitted "
                f"({some(labels_of(problem.pooling)[column])})"
            )
    return named


# Ways of measuring a planned impact: the columns that are read, each with its noise; written in a line, they are
# `contact_time=0.2ms`, `camera=0.5`, `drop=254cm`, or several joined by commas.

# The name of measuring as the fitted table was measured.
AS_BEFORE = "as before"
_VALUE = re.compile(r"^\s*(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(?P<unit>.*?)\s*$")
CAMERA, GAPS, DROP, PLATE, NONE, FPS = "camera", "gaps", "drop", "force", "none", "fps"
# A camera twice as good, one that sees both flights as well as is usual, a plate of some per cent of the peak, and
# the height of the ITF's drop test (100 in).
BETTER, USUAL, GOOD_PLATE, ITF_DROP = "0.5", "1", "20N", "254cm"
SENSOR_FORMS = (
    "expected COLUMN=SD such as contact_time=0.2ms, camera=SHARE of the noise, gaps=SHARE of the usual errors, "
    "force=SD of a sample, or drop=HEIGHT; several joined by commas are one sensor; a film begins with fps=N"
)


@dataclass(frozen=True)
class PlannedColumn(Observable):
    """One column that is read, of which nothing is `observed` yet: with an error `sd` () that is known, beside which
    it scatters by the fitted parameter `noise`, if that is the scatter beyond stated errors; or with the `share` of
    that parameter where no error is known.
    """

    observed: FloatArray = field(default_factory=lambda: np.zeros(()), compare=False)
    sd: FloatArray | None = None
    noise: str | None = None
    share: float = 1.0

    def sds(self, sizes: Sizes, rebound: Rebound) -> FloatArray:
        """Standard deviation (draws, impacts) of a measurement, for parameters among `sizes` (draws,)."""
        return np.asarray(self.share * np.broadcast_to(super().sds(sizes, rebound), rebound.v_x2.shape))

    def sharper(self, share: float) -> PlannedColumn:
        """The column with this share of its error. Balls that scatter beyond stated errors go on to do so."""
        if self.sd is not None:
            return replace(self, sd=share * self.sd)
        return replace(self, share=share * self.share)


@dataclass(frozen=True)
class Sensor:
    """A way of measuring an impact, called `name` and in `words`, at a `cost` of so many ordinary impacts.

    A `drop` is the one impact that it is made with; None: any. With a `plate` force is recorded too, with that sd [N]
    of a sample. With a `film` errors are those of tracked impacts, incident ones too.
    """

    name: str
    words: str
    columns: tuple[PlannedColumn, ...]
    cost: float = 1.0
    drop: Impacts | None = None
    plate: float | None = None
    film: Film | None = None

    @property
    def sees_gaps(self) -> bool:
        """Whether it reads what is between the flights."""
        return any(item.column.gap for item in self.columns)


def as_before(problem: Problem) -> Sensor:
    """The columns of the fitted table, each as well as it was measured there (a stated sd: its median), with the
    scatter that was fitted.
    """
    columns = tuple(
        PlannedColumn(item.name, sd=None if item.sd is None else np.asarray(np.nanmedian(item.sd)), noise=item.noise)
        for item in problem.observables
    )
    return Sensor(AS_BEFORE, "measured as before", columns)


def usual_sensors(problem: Problem) -> tuple[str, ...]:
    """The default sensors: what the model can answer for and was not measured yet."""
    usual = [f"{CAMERA}={BETTER}"]
    timed = OBSERVABLES["contact_time"]
    if (
        problem.model.has_time
        and problem.force is None
        and all(item.name != timed.name for item in problem.observables)
    ):
        if problem.model.has_force:
            usual.insert(0, f"{PLATE}={GOOD_PLATE}")
        usual.insert(0, f"{timed.name}={float(timed.noise.typical) * 1e3:g}ms")
    if gap_columns(problem) and not any(item.column.gap for item in problem.observables):
        usual.append(f"{GAPS}={USUAL}")
    if problem.table.has_tangential and any(item.column.restitution for item in problem.observables):
        usual.append(f"{DROP}={ITF_DROP}")
    return tuple(usual)


def build_sensors(problem: Problem, texts: Sequence[str] | None, costs: Mapping[str, Any]) -> tuple[Sensor, ...]:
    """All ways of measuring, that of the fitted table first. Raises ParameterError that quotes a text."""
    if texts is None:
        texts = usual_sensors(problem)
    elif list(texts) == [NONE]:
        texts = ()
    sensors = [as_before(problem), *(parse_sensor(problem, text) for text in texts)]
    names = [sensor.name for sensor in sensors]
    plates = {sensor.plate for sensor in sensors if sensor.plate is not None}
    if len(plates) > 1:
        raise ParameterError(f"{asked_sensor(PLATE)}: all plates of a plan need the same sd")
    for name in names:
        if names.count(name) > 1:
            raise ParameterError(f"{asked_sensor(name)}: this sensor is given twice")
    for name, cost in costs.items():
        if name not in names:
            raise ParameterError(f"{_cost(name, cost)}: no such sensor in this plan: {suggestion(name, names)}")
        if not (isinstance(cost, Real) and isfinite(cost) and float(cost) > 0.0):
            raise ParameterError(
                f"{_cost(name, cost)}: expected a number above 0 (an impact measured as before costs 1)"
            )
    return tuple(replace(sensor, cost=costs.get(sensor.name, 1.0)) for sensor in sensors)


def asked_sensor(text: str) -> str:
    """The option that asked for a sensor."""
    return spoken(f"--{'camera' if is_film(text) else 'sensor'} {text}", f"sensors=[{text!r}]")


def _cost(name: str, cost: object) -> str:
    number = f"{cost:g}" if isinstance(cost, Real) else repr(cost)
    return spoken(f"--cost {name}={number}", f"cost={{{name!r}: {number}}}")


def parse_sensor(problem: Problem, text: str) -> Sensor:
    """The sensor that `text` names. Raises ParameterError that quotes it."""
    if is_film(text):
        try:
            return _film(problem, text)
        except ParameterError as error:
            raise ParameterError(f"{asked_sensor(text)}: {error}") from None
    before = as_before(problem)
    columns = {column.name: column for column in before.columns}
    names, words, drop, plate = [], [], None, None
    for item in text.split(","):
        key, equals, value = (part.strip() for part in item.partition("="))
        if not equals or not key or not value:
            raise ParameterError(f"{asked_sensor(text)}: {SENSOR_FORMS}")
        written = re.sub(r"(?<=[0-9])(?=[A-Za-z])(?!e[-+0-9])", " ", value)
        try:
            if key == CAMERA:
                share = _number(key, value, None)
                columns = {name: column.sharper(share) for name, column in columns.items()}
                words.append(f"noise {share:g} × as large")
            elif key == GAPS:
                share = _number(key, value, None)
                columns |= {column.name: column for column in _gaps(problem, share)}
                words.append(_gap_words(problem, share))
            elif key == DROP:
                height = _number(key, value, Dimension.LENGTH)
                refuse_beyond("drop_height", np.array([height]))
                drop = Impacts(np.zeros(1), np.array([sqrt(2.0 * GRAVITY * height)]), np.zeros(1))
                words.append(f"a ball dropped from {written}")
            elif key == PLATE:
                plate = _plate(problem, value)
                words.append(f"force within {written} per sample")
            else:
                columns[key] = _column(problem, key, value)
                words.append(f"{OBSERVABLES[key].title} within {written}")
        except (ParameterError, UnitError) as error:
            raise ParameterError(f"{asked_sensor(text)}: {error}") from None
        names.append(key)
    if drop is not None and plate is not None:
        raise ParameterError(f"{asked_sensor(text)}: plans for drop tests have no force plate")
    if drop is not None:
        columns = {name: column for name, column in columns.items() if not column.column.tangential}
        if not columns:
            raise ParameterError(f"{asked_sensor(text)}: none of these columns is measured in a drop test")
    return Sensor("+".join(names), " and ".join(words), tuple(columns.values()), drop=drop, plate=plate)


def is_film(text: str) -> bool:
    """Whether a sensor is a film, such as `fps=240, noise=1mm, view=0.8m`."""
    return text.partition("=")[0].strip() == FPS


def _film(problem: Problem, text: str) -> Sensor:
    """A film: all components, spins and gaps, with the errors that its frames leave. Raises ParameterError."""
    film = parse_film(text)
    if not problem.table.has_tangential or not problem.table.has_spin:
        raise ParameterError("a film needs a fit with motion along the court and spin")
    columns = []
    for name in NINE[3:]:
        _refuse_unpredicted(problem, OBSERVABLES[name])
        scatter = next((item.noise for item in problem.observables if item.name == name and item.scatters), None)
        columns.append(PlannedColumn(name, sd=np.zeros(()), noise=scatter))
    mark = "no mark" if film.fold is None else "a mark"
    words = f"a film: {film.fps:g} frames/s, noise {1e3 * film.noise:g} mm, view {film.width:g} m, {mark}"
    return Sensor("".join(text.split()), words, tuple(columns), film=film)


def _column(problem: Problem, name: str, value: str) -> PlannedColumn:
    if name not in OBSERVABLES:
        raise ParameterError(
            f"unknown column '{name}': {suggestion(name, (*OBSERVABLES, CAMERA, GAPS, PLATE, DROP))}; {SENSOR_FORMS}"
        )
    column = OBSERVABLES[name]
    _refuse_unpredicted(problem, column)
    if column.tangential and not problem.table.has_tangential:
        raise ParameterError("this fit is of a drop test, with vertical motion only")
    measured = [item.name for item in problem.observables]
    if column.velocity and name not in measured and sum(OBSERVABLES[item].velocity for item in measured) >= 2:
        raise ParameterError(f"{name} follows from the measured velocities and adds nothing")
    return _read_within(problem, name, _number(name, value, NUMBERS[name]))


def _refuse_unpredicted(problem: Problem, column: ReboundColumn) -> None:
    """Raise ParameterError for a column that the model does not give."""
    if not problem.model.gives(column):
        why = "" if problem.model.has_time else ": it has no time axis"
        raise ParameterError(f"model {problem.model.name} has no {column.title}{why}")


def _read_within(problem: Problem, name: str, sd: float) -> PlannedColumn:
    """A column with the error `sd`, and the scatter that was fitted, if any. Raises ParameterError for no such sd."""
    refuse_beyond(f"{name}_sd", np.array([sd]))
    scatter = next((item.noise for item in problem.observables if item.name == name and item.scatters), None)
    return PlannedColumn(name, sd=np.array(sd), noise=scatter)


def gap_columns(problem: Problem) -> tuple[ReboundColumn, ...]:
    """What a camera that sees both flights measures of the contact, as far as the model gives it."""
    return tuple(
        column
        for column in OBSERVABLES.values()
        if column.gap and problem.model.gives(column) and (problem.table.has_tangential or not column.tangential)
    )


def _gaps(problem: Problem, share: float) -> tuple[PlannedColumn, ...]:
    """Columns of the gaps, each with this share of its usual error. Raises ParameterError for models without them."""
    for column in OBSERVABLES.values():
        if column.gap:
            _refuse_unpredicted(problem, column)
    known = gap_columns(problem)
    return tuple(_read_within(problem, column.name, share * float(column.noise.typical)) for column in known)


def _gap_words(problem: Problem, share: float) -> str:
    handy = [(column, *(column.handy or (column.unit, 1.0))) for column in gap_columns(problem)]
    sds = [f"{share * float(column.noise.typical) * factor:.2g} {unit}" for column, unit, factor in handy]
    return f"gaps within {', '.join(sds)}"


def columns_read(problem: Problem, sensor: str) -> tuple[str, ...]:
    """The columns that a sensor of this name adds to those of the fitted table."""
    if is_film(sensor):
        return NINE[3:]
    added = (
        [column.name for column in gap_columns(problem)] if part == GAPS else [part]
        for part in sensor.split("+")
        if part == GAPS or part in OBSERVABLES
    )
    return tuple(dict.fromkeys(chain.from_iterable(added)))


def _plate(problem: Problem, value: str) -> float:
    """Noise of a sample. Raises ParameterError for a model without a force, and a fit with force records."""
    if not problem.model.has_force:
        raise ParameterError(f"model {problem.model.name} has no force-time course")
    if problem.force is not None:
        raise ParameterError("this fit has force records already: plans cannot add more")
    return _number(PLATE, value, Dimension.FORCE)


def _number(name: str, text: str, dimension: Dimension | None) -> float:
    """A positive number in SI, or without a unit."""
    matched = _VALUE.match(text)
    if matched is None:
        raise ParameterError(f"{name}: read '{text}', expected a positive number")
    if dimension is None and matched["unit"]:
        raise ParameterError(f"{name}: read '{text}', expected a number without a unit")
    number = float(matched["number"])
    value = number if dimension is None else parse_unit(matched["unit"] or None, dimension).to_si(number)
    if not (isfinite(value) and value > 0.0):
        raise ParameterError(f"{name}: read '{text}', expected a positive number")
    return float(value)
