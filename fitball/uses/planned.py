"""What a plan is asked, in words: settings, sensors, targets."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.air import landing_speed
from fitball.base.columns import COLUMNS, REBOUND
from fitball.base.errors import ParameterError, suggestion
from fitball.base.numbers import Unit
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.text import at_level
from fitball.base.values import FloatArray, Impacts, IntArray
from fitball.data.heights import usual_braking
from fitball.data.in_words import Span, impact_grid, spans
from fitball.data.labels import spelling_key
from fitball.inference.derived import Quantity
from fitball.inference.fitted import Fitted
from fitball.inference.forward import NEW_LEVEL, Values
from fitball.models.model import Model
from fitball.uses.machine import HEIGHT, machine_units, round_steps, speeds_of_heights

# Steps of a range of which none are given.
STEPS_OF_RANGES: Mapping[str, int] = {"v_1": 6, "theta_1": 15, "omega_1": 5}
# Settings at most: beyond them a plan takes minutes.
MOST_SETTINGS = 20_000
# The sensor that measures as the table was measured.
BEFORE = "as before"
# The sensor of all gaps between the flights.
GAPS = "gaps"
# The sensor of drops, without motion along the court.
DROP_SENSOR = "drop"
# How a target that is the rebound of an impact begins.
_IMPACT = "impact="


class Settings(NamedTuple):
    """Impacts (settings,) that a machine can be set to, and the place of each among the labels of
    each of the levels; the options that were `assumed`: their ranges are those of the table.
    """

    impacts: Impacts
    levels: Annotated[IntArray, "settings levels"]
    assumed: tuple[str, ...]


class _Axis(NamedTuple):
    """An axis of the grid of settings: its `option`, the `column` that it sets, the `measured`
    values of that, and whether it `varies` in this fit.
    """

    option: str
    column: str
    measured: FloatArray
    varies: bool


class Sensor(NamedTuple):
    """A way of measuring: `sds` [SI] of columns that are read besides, or better than, before; a
    `drop` has one impact, of which the vertical speed alone is read.
    """

    name: str
    sds: Mapping[str, float]
    drop: Impacts | None = None


def settings_of(fit: Fitted, words: Mapping[str, str], level: Mapping[str, str]) -> Settings:
    """The grid of `words` (speed, angle, spin), by default over the measured range, on every
    measured surface or those of `level`.

    Raises:
        ParameterError: a range cannot be read (`impact`), or is of what was not measured
            (`not-measured`); too many settings (`too-many-settings`); no such level
            (`unknown-level`, `unknown-label`, `no-such-levels`).
    """
    axes = _axes_of(fit)
    tangential = fit.problem.forward.model.tangential
    units = machine_units(fit)
    values = [_axis_values(axis, words.get(axis.option, ""), units[axis.column]) for axis in axes]
    if HEIGHT in units and not words.get("speed") and values[0].size > 1:
        values[0] = speeds_of_heights(fit, STEPS_OF_RANGES["v_1"])
    assumed = [axis.option for axis in axes if axis.varies and not words.get(axis.option)]
    keys = measured_levels(fit, level)
    count = len(keys)
    for steps in values:
        count *= steps.size
    if count > MOST_SETTINGS:
        raise ParameterError(
            f"{count:,} settings: expected at most {MOST_SETTINGS:,}; use fewer steps",
            "too-many-settings",
        )
    grid = np.meshgrid(np.arange(float(len(keys))), *values, indexing="ij")
    key, speed, angle, spin = (coordinate.ravel() for coordinate in grid)
    along = speed * np.cos(angle) if tangential else np.zeros(speed.size)
    impacts = Impacts(along, speed * np.sin(angle), spin)
    return Settings(impacts, keys[key.astype(np.int64)], tuple(assumed))


def _axes_of(fit: Fitted) -> tuple[_Axis, _Axis, _Axis]:
    """Speed, angle and spin as the table has them; without motion along the court a vertical speed
    alone.
    """
    tangential = fit.problem.forward.model.tangential
    spun = tangential and fit.run.table.has_spin
    states = fit.problem.rows.states.forwards
    speed, angle = states.polar()
    spin = states.omega_1
    if not tangential:
        speed = states.v_y1
        angle = np.array([np.pi / 2.0])
    if not spun:
        spin = np.zeros(1)
    return (
        _Axis("speed", "v_1", speed, varies=True),
        _Axis("angle", "theta_1", angle, tangential),
        _Axis("spin", "omega_1", spin, spun),
    )


def _axis_values(axis: _Axis, text: str, unit: Unit) -> FloatArray:
    """Values (steps,) of an axis in SI, of the range in words, or else round numbers in the unit of
    the table, of that measured. Raises ParameterError (`impact`, `not-measured`).
    """
    span = Span(float(axis.measured.min()), float(axis.measured.max()))
    if text and not axis.varies:
        raise ParameterError(
            f"--{axis.option}: the fit has no {COLUMNS[axis.column].title}, since none was "
            "measured; leave it out",
            "not-measured",
        )
    if text:
        span = spans(f"{axis.column}={text}", "value range count")[axis.column]
    if not span.high > span.low:
        return np.array([span.low])
    if text:
        steps = span.count if span.count > 1 else STEPS_OF_RANGES[axis.column]
        return np.linspace(span.low, span.high, steps)
    return round_steps(span.low, span.high, STEPS_OF_RANGES[axis.column], unit)


def measured_levels(
    fit: Fitted,
    level: Mapping[str, str],
) -> Annotated[IntArray, "combinations levels"]:
    """The combinations of levels of a table, or those with the labels of `level`: places among the
    labels of each level.

    Raises:
        ParameterError: no parameter differs by such a column (`unknown-level`), a label was not
            fitted (`unknown-label`), or no impact has these labels together (`no-such-levels`).
    """
    forward = fit.problem.forward
    keys = np.unique(fit.problem.rows.index, axis=0)
    forward.check_columns(level)
    labels = {spelling_key(column): label for column, label in level.items()}
    for k, levels in enumerate(forward.levels):
        label = labels.get(spelling_key(levels.column))
        if label is None:
            continue
        index = levels.index_of(label)
        if index == NEW_LEVEL:
            fitted = ", ".join(levels.labels)
            text = f"level: a plan needs a {levels.column} that was fitted: {fitted}"
            raise ParameterError(text, "unknown-label")
        keys = keys[keys[:, k] == index]
    if not len(keys):
        text = f"level: no impact of the table has {' and '.join(level.values())} together"
        raise ParameterError(text, "no-such-levels")
    return keys


def sensors_of(fit: Fitted, words: Mapping[str, str] | None) -> list[Sensor]:
    """Measuring as before, then `COLUMN=SD`, `gaps=SHARE` of their usual errors, `drop=HEIGHT`; by
    default those that the model can answer for and the table has not: the contact time to 0.2 ms,
    gaps, a drop from 254 cm.

    Raises:
        ParameterError: a number cannot be read (`impact`); there is no such sensor, or the model
            does not predict what it reads (`sensor`).
    """
    model = fit.problem.forward.model
    measured = [observable.column.name for observable in fit.problem.observables]
    gaps = [name for name in REBOUND if COLUMNS[name].gap and model.predicts(COLUMNS[name])]
    if words is None:
        words = _usual_sensors(model, measured, gaps)
    sensors = [Sensor(BEFORE, {})]
    for name, text in words.items():
        if name == DROP_SENSOR:
            height = spans(f"drop_height={text}", "value")["drop_height"].low
            fall = landing_speed(np.array([height]), usual_braking(fit.run.scene))
            drop = Impacts(np.zeros(1), fall, np.zeros(1))
            sensors.append(Sensor(name, {}, drop))
        elif name == GAPS:
            share = _share_of_errors(text)
            every_gap = [column for column in REBOUND if COLUMNS[column].gap]
            _refuse_columns(model, gaps or every_gap, measured)
            sensors.append(Sensor(name, {gap: share * _usual_error(gap) for gap in gaps}))
        elif name in REBOUND:
            _refuse_columns(model, [name], measured)
            sd = spans(f"{name}={text}", "error")[name].low
            sensors.append(Sensor(name, {name: sd}))
        else:
            hint = suggestion(name, (*REBOUND, GAPS, DROP_SENSOR))
            raise ParameterError(
                f"sensor {name}={text}: expected COLUMN=SD such as contact_time=0.2ms, gaps=SHARE "
                f"of their usual errors, or drop=HEIGHT; {hint}",
                "sensor",
            )
    return sensors


def _usual_sensors(
    model: Model,
    measured: Sequence[str],
    gaps: Sequence[str],
) -> dict[str, str]:
    """The sensors of a plan for which none was named, in words; `gaps` are those predicted."""
    words = {}
    if model.timed and "contact_time" not in measured:
        words["contact_time"] = "0.2 ms"
    if gaps and {*gaps}.isdisjoint(measured):
        words[GAPS] = "1"
    if model.tangential and any(COLUMNS[name].vertical for name in measured):
        words[DROP_SENSOR] = "254 cm"
    return words


def _usual_error(column: str) -> float:
    """The usual error of a column in SI, the median of the prior of its noise."""
    noise = COLUMNS[column].noise
    assert noise is not None
    prior = parse_prior(noise, noise.prior)
    return float(prior.quantile(np.array([0.5]))[0])


def _share_of_errors(text: str) -> float:
    """The share of the usual errors of gaps, in words. Raises ParameterError (`sensor`)."""
    try:
        share = float(text)
    except ValueError:
        share = np.nan
    if not 0.0 < share < np.inf:
        raise ParameterError(
            f"sensor gaps={text}: expected a share of the usual errors, such as 0.5",
            "sensor",
        )
    return share


def _refuse_columns(model: Model, names: Iterable[str], measured: Sequence[str]) -> None:
    """Refuse columns of which the model says nothing, and velocities that follow from those
    measured before. Raises ParameterError (`sensor`).
    """
    for name in names:
        if not model.predicts(COLUMNS[name]):
            why = "it has vertical motion only"
            if COLUMNS[name].timed and not model.timed:
                why = "it has no time axis"
            text = f"sensor {name}: {model.text} does not predict the {COLUMNS[name].title}: {why}"
            raise ParameterError(text, "sensor")
        velocities = [column for column in measured if COLUMNS[column].of_velocity]
        if COLUMNS[name].of_velocity and name not in measured and len(velocities) > 1:
            raise ParameterError(
                f"sensor {name}: it follows from {' and '.join(velocities)}; name these",
                "sensor",
            )


def targets_of(
    fit: Fitted,
    texts: Sequence[str],
    keys: Annotated[IntArray, "combinations levels"],
) -> list[Quantity]:
    """Parameters and derived quantities by name (`mu`: on every surface), `impact=v_1=30,
    theta_1=16 deg`: its rebound; without texts all free parameters of the model. `keys` are the
    combinations of levels that count.

    Raises:
        ParameterError: there is no such quantity (`unknown-quantity`), or it is fixed (`fixed`); an
            impact cannot be read (`impact`), or has what was not measured (`not-measured`); no
            parameter is free (`nothing-free`).
    """
    summary = fit.summary
    elsewhere = _names_elsewhere(fit, keys)
    names, impacts = _names_and_impacts(texts, [*summary.index], elsewhere)
    if not texts:
        main = summary.index[summary["kind"].isin(("model", "level"))]
        names = [name for name in main if name in fit.problem.free and name not in elsewhere]
        if not names:
            raise ParameterError("no parameter of the model is free: name a target", "nothing-free")
    targets = [fit.quantity(name) for name in dict.fromkeys(names)]
    for target in targets:
        if target.spec.name not in summary.index:
            raise ParameterError(
                f"target {target.spec.name}: it is held in this fit; name one that is not",
                "fixed",
            )
    for number, text in enumerate(impacts, 1):
        ordinal = f" ({number})" if len(impacts) > 1 else ""
        targets += _rebound_quantities(fit, text, keys, ordinal)
    return targets


def _names_elsewhere(fit: Fitted, keys: IntArray) -> set[str]:
    """Names of parameters at levels that are in none of the combinations `keys` (combinations,
    levels).
    """
    names = set[str]()
    for k, level in enumerate(fit.problem.forward.levels):
        for index, label in enumerate(level.labels):
            if index not in keys[:, k]:
                names.add(level.name(label))
    return names


def _names_and_impacts(
    texts: Iterable[str],
    quantities: Sequence[str],
    elsewhere: Collection[str],
) -> tuple[list[str], list[str]]:
    """Names of targets among `quantities`, a parameter of levels at each but those `elsewhere`; and
    impacts in words.
    """
    names = list[str]()
    impacts = list[str]()
    for text in texts:
        if text.startswith(_IMPACT) and text not in quantities:
            impacts.append(text.removeprefix(_IMPACT))
        elif impacts and "=" in text and text not in quantities:
            # Commas separate targets and parts of an impact.
            impacts[-1] += f", {text}"
        else:
            at_levels = [name for name in quantities if at_level(name)[0] == text]
            at_levels = [name for name in at_levels if name not in elsewhere]
            if text in quantities or not at_levels:
                names.append(text)
            else:
                names += at_levels
    return names, impacts


def _rebound_quantities(fit: Fitted, text: str, keys: IntArray, ordinal: str) -> list[Quantity]:
    """Velocities and spin after an impact in words, at each of the combinations of levels `keys`
    (combinations, levels); `ordinal` numbers impacts, where there are several.
    """
    forward = fit.problem.forward
    impact, _ = impact_grid(spans(text, "value"), usual_braking(fit.run.scene))
    if not forward.model.tangential and (impact.v_x1[0] or impact.omega_1[0]):
        text = f"impact '{text}': the fit has vertical motion only; name v_y1 alone"
        raise ParameterError(text, "not-measured")

    def rebound(column: str, key: IntArray, values: Values) -> FloatArray:
        return forward.rebound(values, impact, key).column(column)[:, 0]

    quantities = []
    for key in keys:
        label = labels_in_words(fit, key)
        at = f"[{label}]" if label else ""
        for name in ("v_x2", "v_y2", "omega_2"):
            if not forward.model.predicts(COLUMNS[name]):
                continue
            column = COLUMNS[name]
            spec = ParameterSpec(
                f"{name}{ordinal}{at}",
                column.unit,
                -np.inf,
                np.inf,
                "",
                column.title,
                column.symbol,
                display_unit=column.display_unit,
            )
            quantities.append(Quantity(spec, partial(rebound, name, key[None])))
    return quantities


def labels_in_words(fit: Fitted, key: Annotated[IntArray, "levels"]) -> str:
    """A combination of levels as `clay, ball A`; "" where there are none."""
    pairs = zip(fit.problem.forward.levels, key.tolist(), strict=True)
    labels = {level.column: level.labels[index] for level, index in pairs}
    return ", ".join(labels.values())
