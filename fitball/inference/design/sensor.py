"""Ways of measuring a planned impact: the columns that are read, each with its noise; written in a line, they are
`contact_time=0.2ms`, `camera=0.5`, `drop=254cm`, or several joined by commas.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite, sqrt
from numbers import Real
from typing import Any

import numpy as np

from fitball.data.columns import NUMBERS
from fitball.data.heights import GRAVITY
from fitball.data.numbers import refuse_beyond
from fitball.data.units import Dimension, parse_unit
from fitball.errors import ParameterError, UnitError, suggestion
from fitball.inference.problem.noise import Sizes
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.models.types import Rebound
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, Impacts
from fitball.wording import spoken

# The name of measuring as the fitted table was measured.
AS_BEFORE = "as before"
_VALUE = re.compile(r"^\s*(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(?P<unit>.*?)\s*$")
CAMERA, DROP, PLATE, NONE = "camera", "drop", "force", "none"
# A camera twice as good, a plate of some per cent of the peak, and the height of the ITF's drop test (100 in).
BETTER, GOOD_PLATE, ITF_DROP = "0.5", "20N", "254cm"
FORMS = (
    "expected COLUMN=SD such as contact_time=0.2ms, camera=SHARE of the noise, force=SD of a sample, or drop=HEIGHT; "
    "several joined by commas are one sensor"
)


@dataclass(frozen=True)
class PlannedColumn(Observable):
    """One column that is read, of which nothing is `observed` yet: its noise is `share` of the fitted parameter
    `noise`, or of `sd` () where that is known.
    """

    observed: FloatArray = field(default_factory=lambda: np.zeros(()), compare=False)
    sd: FloatArray | None = None
    noise: str | None = None
    share: float = 1.0

    def sds(self, sizes: Sizes, rebound: Rebound) -> FloatArray:
        """Standard deviation (draws, impacts) of a measurement, for parameters among `sizes` (draws,)."""
        return np.asarray(self.share * np.broadcast_to(super().sds(sizes, rebound), rebound.v_x2.shape))


@dataclass(frozen=True)
class Sensor:
    """A way of measuring an impact, called `name` and in `words`, at a `cost` of so many ordinary impacts.

    A `drop` is the one impact that it is made with; None: any. With a `plate` force is recorded too, with that sd [N]
    of a sample.
    """

    name: str
    words: str
    columns: tuple[PlannedColumn, ...]
    cost: float = 1.0
    drop: Impacts | None = None
    plate: float | None = None


def as_before(problem: Problem) -> Sensor:
    """The columns of the fitted table, each as well as it was measured there (a stated sd: its median)."""
    columns = tuple(
        PlannedColumn(item.name, sd=None if item.sd is None else np.asarray(np.nanmedian(item.sd)), noise=item.noise)
        for item in problem.observables
    )
    return Sensor(AS_BEFORE, "measured as before", columns)


def usual_sensors(problem: Problem) -> tuple[str, ...]:
    """What is looked at where nothing was asked for: what the model can answer for and was not measured yet."""
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
        raise ParameterError(f"{said(PLATE)}: all plates of a plan need the same sd")
    for name in names:
        if names.count(name) > 1:
            raise ParameterError(f"{said(name)}: this sensor is given twice")
    for name, cost in costs.items():
        if name not in names:
            raise ParameterError(f"{_cost(name, cost)}: no such sensor is looked at: {suggestion(name, names)}")
        if not (isinstance(cost, Real) and isfinite(cost) and float(cost) > 0.0):
            raise ParameterError(
                f"{_cost(name, cost)}: expected a number above 0, an impact measured as before being 1"
            )
    return tuple(replace(sensor, cost=costs.get(sensor.name, 1.0)) for sensor in sensors)


def said(text: str) -> str:
    """How a sensor was asked for."""
    return spoken(f"--sensor {text}", f"sensors=[{text!r}]")


def _cost(name: str, cost: object) -> str:
    number = f"{cost:g}" if isinstance(cost, Real) else repr(cost)
    return spoken(f"--cost {name}={number}", f"cost={{{name!r}: {number}}}")


def parse_sensor(problem: Problem, text: str) -> Sensor:
    """The sensor that `text` names. Raises ParameterError that quotes it."""
    before = as_before(problem)
    columns = {column.name: column for column in before.columns}
    names, words, drop, plate = [], [], None, None
    for item in text.split(","):
        key, equals, value = (part.strip() for part in item.partition("="))
        if not equals or not key or not value:
            raise ParameterError(f"{said(text)}: {FORMS}")
        try:
            if key == CAMERA:
                share = _number(key, value, None)
                columns = {name: replace(column, share=share * column.share) for name, column in columns.items()}
                words.append(f"noise {share:g} times as large")
            elif key == DROP:
                drop = _dropped(_number(key, value, Dimension.LENGTH))
                words.append(f"a ball dropped from {value}")
            elif key == PLATE:
                plate = _plate(problem, value)
                words.append(f"force within {value} a sample")
            else:
                columns[key] = _column(problem, key, value)
                words.append(f"{OBSERVABLES[key].title} within {value}")
        except (ParameterError, UnitError) as error:
            raise ParameterError(f"{said(text)}: {error}") from None
        names.append(key)
    if drop is not None and plate is not None:
        raise ParameterError(f"{said(text)}: a plate under a drop test is not looked at")
    if drop is not None:
        columns = {name: column for name, column in columns.items() if not column.column.tangential}
        if not columns:
            raise ParameterError(f"{said(text)}: no column that is read shows a rebound from a drop")
    return Sensor("+".join(names), " and ".join(words), tuple(columns.values()), drop=drop, plate=plate)


def _column(problem: Problem, name: str, value: str) -> PlannedColumn:
    if name not in OBSERVABLES:
        raise ParameterError(
            f"unknown column '{name}': {suggestion(name, (*OBSERVABLES, CAMERA, PLATE, DROP))}; {FORMS}"
        )
    column = OBSERVABLES[name]
    if column.timed and not problem.model.has_time:
        raise ParameterError(f"model {problem.model.name} has no contact time")
    if column.tangential and not problem.table.has_tangential:
        raise ParameterError("this fit of a drop test knows the vertical motion only")
    measured = [item.name for item in problem.observables]
    if column.velocity and name not in measured and sum(OBSERVABLES[item].velocity for item in measured) >= 2:
        raise ParameterError(f"{name} follows from the velocities that are measured already")
    sd = _number(name, value, NUMBERS[name])
    refuse_beyond(f"{name}_sd", np.array([sd]))
    return PlannedColumn(name, sd=np.array(sd))


def _plate(problem: Problem, value: str) -> float:
    """Noise of a sample. Raises ParameterError for a model without a force, and a fit that knows a plate already."""
    if not problem.model.has_force:
        raise ParameterError(f"model {problem.model.name} has no force-time course")
    if problem.force is not None:
        raise ParameterError("this fit has force records: further ones are not planned")
    return _number(PLATE, value, Dimension.FORCE)


def _dropped(height: float) -> Impacts:
    refuse_beyond("drop_height", np.array([height]))
    return Impacts(np.zeros(1), np.array([sqrt(2.0 * GRAVITY * height)]), np.zeros(1))


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
