"""What a plan is asked, in words: settings, sensors, targets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from fitball.base import itf
from fitball.base.columns import COLUMNS, REBOUND
from fitball.base.errors import ParameterError, suggestion
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.values import FloatArray, Impacts, IntArray
from fitball.data.in_words import Span, impact_grid, spans
from fitball.data.labels import spelling_key
from fitball.inference.derived import Quantity
from fitball.inference.fitted import Fitted
from fitball.inference.forward import NEW_LEVEL, Values
from fitball.models.model import Model

# Steps of a range of which none are given.
STEPS: Mapping[str, int] = {"v_1": 6, "theta_1": 15, "omega_1": 5}
# Settings at most: beyond them a plan takes minutes.
MOST = 20_000
# The sensor that measures as the table was measured.
BEFORE = "as before"
# The sensor of all gaps between the flights.
GAPS = "gaps"
# The sensor of drops, without motion along the court.
DROP = "drop"
# How a target that is the rebound of an impact begins.
_IMPACT = "impact="


class Settings(NamedTuple):
    """Impacts (settings,) that a machine can be set to, their levels (settings, levels), the
    options that were not given: their ranges are those of the table.
    """

    impacts: Impacts
    levels: IntArray
    assumed: tuple[str, ...]


class Sensor(NamedTuple):
    """A way of measuring: `sds` [SI] of columns that are read besides, or better than, before; a
    `drop` has one impact, of which the vertical speed alone is read.
    """

    name: str
    sds: Mapping[str, float]
    drop: Impacts | None = None


def settings_of(fit: Fitted, words: Mapping[str, str], level: Mapping[str, str]) -> Settings:
    """The grid of `words` (speed, angle, spin), by default over the measured range, on every
    measured surface or those of `level`. Raises ParameterError (`impact`, `not-measured`,
    `too-many-settings`, those of `levels_of`).
    """
    model = fit.problem.forward.model
    states = fit.problem.rows.states
    speed, angle = states.polar()
    spun = model.tangential and fit.run.table.has_spin
    axes = list[FloatArray]()
    assumed = list[str]()
    for option, column, values, varies in (
        ("speed", "v_1", speed if model.tangential else states.v_y1, True),
        (
            "angle",
            "theta_1",
            angle if model.tangential else np.array([np.pi / 2.0]),
            model.tangential,
        ),
        ("spin", "omega_1", states.omega_1 if spun else np.zeros(1), spun),
    ):
        span = Span(float(values.min()), float(values.max()))
        text = words.get(option, "")
        if text and not varies:
            raise ParameterError(
                f"--{option}: the fit has no {COLUMNS[column].title}, since none was measured; "
                "leave it out",
                "not-measured",
            )
        if text:
            span = spans(f"{column}={text}", "value range count")[column]
        elif varies:
            assumed.append(option)
        steps = 1
        if span.high > span.low:
            steps = span.count if span.count > 1 else STEPS[column]
        axes.append(np.linspace(span.low, span.high, steps))
    keys = measured_levels(fit, level)
    count = len(keys)
    for axis in axes:
        count *= axis.size
    if count > MOST:
        raise ParameterError(
            f"{count:,} settings: expected at most {MOST:,}; use fewer steps",
            "too-many-settings",
        )
    grid = np.meshgrid(np.arange(float(len(keys))), *axes, indexing="ij")
    place, fast, steep, spin = (coordinate.ravel() for coordinate in grid)
    along = fast * np.cos(steep) if model.tangential else np.zeros(fast.size)
    impacts = Impacts(along, fast * np.sin(steep), spin)
    return Settings(impacts, keys[place.astype(np.int64)], tuple(assumed))


def measured_levels(fit: Fitted, level: Mapping[str, str]) -> IntArray:
    """The combinations (combinations, levels) of a table, or those with the labels of `level`.
    Raises ParameterError (`unknown-level`, `unknown-label`, `no-such-levels`).
    """
    forward = fit.problem.forward
    keys = np.unique(fit.problem.rows.index, axis=0)
    forward.check_columns(level)
    labels = {spelling_key(column): label for column, label in level.items()}
    for k, levels in enumerate(forward.levels):
        label = labels.get(spelling_key(levels.column))
        if label is None:
            continue
        place = levels.index_of(label)
        if place == NEW_LEVEL:
            known = ", ".join(levels.labels)
            text = f"level: a plan needs a {levels.column} that was fitted: {known}"
            raise ParameterError(text, "unknown-label")
        keys = keys[keys[:, k] == place]
    if not len(keys):
        text = f"level: no impact of the table has {' and '.join(level.values())} together"
        raise ParameterError(text, "no-such-levels")
    return keys


def sensors_of(fit: Fitted, words: Mapping[str, str] | None) -> list[Sensor]:
    """Measuring as before, then `COLUMN=SD`, `gaps=SHARE` of their usual errors, `drop=HEIGHT`; by
    default those that the model can answer for and the table has not: the contact time to 0.2 ms,
    gaps, a drop from 254 cm. Raises ParameterError (`impact`, `sensor`).
    """
    model = fit.problem.forward.model
    measured = [item.column.name for item in fit.problem.observables]
    gaps = [name for name in REBOUND if COLUMNS[name].gap and model.predicts(COLUMNS[name])]
    if words is None:
        vertical = any(COLUMNS[name].vertical for name in measured)
        usual = {
            "contact_time": ("0.2 ms", model.timed and "contact_time" not in measured),
            GAPS: ("1", bool(gaps) and not {*gaps} & {*measured}),
            DROP: ("254 cm", model.tangential and vertical),
        }
        words = {name: text for name, (text, good) in usual.items() if good}
    sensors = [Sensor(BEFORE, {})]
    for name, text in words.items():
        if name == DROP:
            height = spans(f"drop_height={text}", "value")["drop_height"].low
            fall = np.array([itf.fall_speed(height)])
            drop = Impacts(np.zeros(1), fall, np.zeros(1))
            sensors.append(Sensor(name, {}, drop))
        elif name == GAPS:
            share = _share(text)
            every_gap = [column for column in REBOUND if COLUMNS[column].gap]
            _refuse(model, gaps or every_gap, measured)
            sensors.append(Sensor(name, {gap: share * _usual(gap) for gap in gaps}))
        elif name in REBOUND:
            _refuse(model, [name], measured)
            sd = spans(f"{name}={text}", "error")[name].low
            sensors.append(Sensor(name, {name: sd}))
        else:
            hint = suggestion(name, (*REBOUND, GAPS, DROP))
            raise ParameterError(
                f"sensor {name}={text}: expected COLUMN=SD such as contact_time=0.2ms, gaps=SHARE "
                f"of their usual errors, or drop=HEIGHT; {hint}",
                "sensor",
            )
    return sensors


def _usual(gap: str) -> float:
    """The usual error of a column, the median of the prior of its noise."""
    noise = COLUMNS[gap].noise
    assert noise is not None
    prior = parse_prior(noise, noise.prior)
    return float(prior.quantile(np.array([0.5]))[0])


def _share(text: str) -> float:
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


def _refuse(model: Model, names: Iterable[str], measured: Sequence[str]) -> None:
    """Refuse columns of which the model says nothing, and velocities that follow from those
    measured before.
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


def targets_of(fit: Fitted, asked: Sequence[str], keys: IntArray) -> list[Quantity]:
    """Parameters and derived quantities by name (`mu`: on every surface), `impact=v_1=30,
    theta_1=16 deg`: its rebound; none: all free parameters of the model. `keys` are the
    combinations of levels that count. Raises ParameterError (`unknown-quantity`, `fixed`, `impact`,
    `not-measured`, `nothing-free`).
    """
    summary = fit.summary
    levels = fit.problem.forward.levels
    left_out = {
        level.name(label)
        for k, level in enumerate(levels)
        for place, label in enumerate(level.labels)
        if place not in keys[:, k]
    }
    names = list[str]()
    words = list[str]()
    for item in asked:
        if item.startswith(_IMPACT) and item not in summary.index:
            words.append(item.removeprefix(_IMPACT))
        elif words and "=" in item and item not in summary.index:
            # Commas separate targets and parts of an impact.
            words[-1] += f", {item}"
        else:
            at_levels = [
                name
                for name in summary.index
                if name.partition("[")[0] == item and name not in left_out
            ]
            if item in summary.index or not at_levels:
                names.append(item)
            else:
                names += at_levels
    if not asked:
        main = summary.index[summary["kind"].isin(("model", "level"))]
        names = [name for name in main if name in fit.problem.free and name not in left_out]
        if not names:
            raise ParameterError("no parameter of the model is free: name a target", "nothing-free")
    targets = [fit.quantity(name) for name in dict.fromkeys(names)]
    for target in targets:
        if target.spec.name not in summary.index:
            raise ParameterError(
                f"target {target.spec.name}: it is held in this fit; name one that is not",
                "fixed",
            )
    for number, text in enumerate(words, 1):
        targets += _rebounds(fit, text, keys, f" ({number})" if len(words) > 1 else "")
    return targets


def _rebounds(fit: Fitted, text: str, keys: IntArray, number: str) -> list[Quantity]:
    """Velocities and spin after one impact, on each surface."""
    forward = fit.problem.forward
    impact, _ = impact_grid(spans(text, "value"))
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
                f"{name}{number}{at}",
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


def labels_in_words(fit: Fitted, key: IntArray) -> str:
    """Levels (levels,) as `clay, ball A`; "" where there are none."""
    pairs = zip(fit.problem.forward.levels, key.tolist(), strict=True)
    labels = {level.column: level.labels[place] for level, place in pairs}
    return ", ".join(labels.values())
