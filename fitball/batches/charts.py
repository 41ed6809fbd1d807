"""Control charts of individual values: limits of a baseline, run rules, EWMA, and what changed.

Limits come from moving ranges of two values (Montgomery, Introduction to Statistical Quality
Control, chapter 6). Rules: Nelson, J. Qual. Technol. 16 (1984) 237, and Western Electric,
Statistical Quality Control Handbook (1956). A change is the stretch of values about an alarm whose
mean is furthest from the centre in standard errors (Samuel, Pignatiello and Calvin, Qual. Eng. 10
(1998) 521).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import pi, sqrt
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fitball.base.errors import ParameterError, suggestion
from fitball.base.values import BoolArray, FloatArray

# Mean range of two normal values, and the sd of that range, in sds of a value.
RANGE_MEAN = 2.0 / sqrt(pi)
RANGE_SD = sqrt(2.0 - 4.0 / pi)
# Sds from the centre to limits.
LIMIT = 3.0
# Weight of a new value in the EWMA, and the sds to its limits: a stable process passes them once in
# 500 values (Lucas and Saccucci, Technometrics 32 (1990) 1).
EWMA_WEIGHT = 0.2
EWMA_LIMIT = 2.962
# Stable series that are simulated for the rate of false alarms: its standard error is below 1 %.
_SIMULATED = 4000

Kind = Literal["value", "shift", "pattern"]
# Whether a rule is broken at each value, the last of its pattern, by distances from the centre in
# sds.
Test = Callable[[Annotated[FloatArray, "... values"]], Annotated[BoolArray, "... values"]]


class Rule(NamedTuple):
    """A run rule: its name, what breaks it, over how many values, its `test`; whether what breaks
    it is away from the centre (`away`), so that a shift explains it.
    """

    name: str
    text: str
    span: int
    test: Test
    away: bool


class Change(NamedTuple):
    """Values from `first` to `last` that are not as the baseline, by the `rules` that found it;
    `size` is the mean distance from the centre, with its standard error `sd`, in the values' unit.
    """

    kind: Kind
    first: int
    last: int
    size: float
    sd: float
    rules: tuple[str, ...]


class Chart(NamedTuple):
    """A chart of values: `centre` and `sd` by the first `baseline` values, moving `ranges` (the
    first is NaN) and their limit, the `ewma` with the distance of its limits from the centre, rules
    that are broken at each value, and what changed.
    """

    values: Annotated[FloatArray, "values"]
    baseline: int
    centre: float
    sd: float
    ranges: Annotated[FloatArray, "values"]
    range_limit: float
    ewma: Annotated[FloatArray, "values"]
    ewma_limit: Annotated[FloatArray, "values"]
    broken: tuple[tuple[str, ...], ...]
    changes: tuple[Change, ...]


def _last_of(windows: BoolArray, span: int) -> BoolArray:
    """What is true of windows (..., windows) of so many values, at the last value of each."""
    before = np.zeros((*windows.shape[:-1], span - 1), dtype=np.bool_)
    return np.concatenate([before, windows], axis=-1)


def _windows(marks: BoolArray, span: int) -> BoolArray:
    """Marks of values in windows (..., windows, span); no window where values are too few."""
    if marks.shape[-1] < span:
        return np.zeros((*marks.shape[:-1], 0, span), dtype=np.bool_)
    return sliding_window_view(marks, span, axis=-1)


def _run(marks: BoolArray, span: int) -> BoolArray:
    """Where so many values in a row are marked."""
    full: BoolArray = np.all(_windows(marks, span), axis=-1)
    return _last_of(full, span)[..., : marks.shape[-1]]


def _beyond(z: FloatArray) -> BoolArray:
    """Values outside of the limits."""
    return np.abs(z) > LIMIT


def _one_side(z: FloatArray, span: int) -> BoolArray:
    """So many in a row on one side of the centre."""
    return _run(z > 0.0, span) | _run(z < 0.0, span)


def _trend(z: FloatArray, span: int) -> BoolArray:
    """So many in a row that rise, or that fall: one step fewer."""
    steps = np.diff(z, axis=-1, prepend=np.nan)
    return _run(steps > 0.0, span - 1) | _run(steps < 0.0, span - 1)


def _alternating(z: FloatArray, span: int) -> BoolArray:
    """So many in a row that rise and fall in turn: two turns fewer."""
    steps = np.diff(z, axis=-1, prepend=np.nan)
    turns = steps[..., 1:] * steps[..., :-1] < 0.0
    first = np.zeros((*z.shape[:-1], 1), dtype=np.bool_)
    return _run(np.concatenate([first, turns], axis=-1), span - 2)


def _zone(z: FloatArray, least: int, span: int, sds: float) -> BoolArray:
    """At least so many of a span beyond some sds on one side, the last among them."""
    found = np.zeros(z.shape, dtype=np.bool_)
    for side in (z > sds, z < -sds):
        enough = _windows(side, span).sum(axis=-1) >= least
        found |= _last_of(enough, span)[..., : z.shape[-1]] & side
    return found


def _within(z: FloatArray, span: int) -> BoolArray:
    """So many in a row within one sd."""
    return _run(np.abs(z) < 1.0, span)


def _outside(z: FloatArray, span: int) -> BoolArray:
    """So many in a row beyond one sd, on either side."""
    return _run(np.abs(z) > 1.0, span)


NELSON = (
    Rule("Nelson 1", "beyond 3 sd", 1, _beyond, True),
    Rule("Nelson 2", "nine in a row on one side", 9, partial(_one_side, span=9), True),
    Rule("Nelson 3", "six in a row rising or falling", 6, partial(_trend, span=6), False),
    Rule("Nelson 4", "fourteen in a row alternating", 14, partial(_alternating, span=14), False),
    Rule(
        "Nelson 5",
        "two of three beyond 2 sd, one side",
        3,
        partial(_zone, least=2, span=3, sds=2.0),
        True,
    ),
    Rule(
        "Nelson 6",
        "four of five beyond 1 sd, one side",
        5,
        partial(_zone, least=4, span=5, sds=1.0),
        True,
    ),
    Rule("Nelson 7", "fifteen in a row within 1 sd", 15, partial(_within, span=15), False),
    Rule("Nelson 8", "eight in a row beyond 1 sd", 8, partial(_outside, span=8), False),
)
WESTERN_ELECTRIC = (
    NELSON[0]._replace(name="Western Electric 1"),
    NELSON[4]._replace(name="Western Electric 2"),
    NELSON[5]._replace(name="Western Electric 3"),
    Rule("Western Electric 4", "eight in a row on one side", 8, partial(_one_side, span=8), True),
)
EWMA = "EWMA"
# Rules by the name that a user gives, but for single ones of Nelson.
RULE_SETS: Mapping[str, tuple[Rule, ...]] = {
    "nelson": NELSON,
    "western-electric": WESTERN_ELECTRIC,
}


def rules_named(text: str) -> tuple[Rule, ...]:
    """Rules by name: `western-electric`, `nelson`, or single ones of Nelson such as `nelson-1-2`.

    Raises:
        ParameterError: there are no such rules (`rules`).
    """
    if text in RULE_SETS:
        return RULE_SETS[text]
    name, *numbers = text.split("-")
    singles = {str(number): rule for number, rule in enumerate(NELSON, 1)}
    if name == "nelson" and numbers and {*numbers} <= {*singles}:
        return tuple(rule for number, rule in singles.items() if number in numbers)
    expected = suggestion(text, [*RULE_SETS, "nelson-1-2"])
    raise ParameterError(f"rules: read '{text}': {expected}", "rules")


def limits(values: Annotated[FloatArray, "... values"]) -> tuple[FloatArray, FloatArray]:
    """Centre and sd (...) of values, the sd by their mean moving range."""
    ranges = np.abs(np.diff(values, axis=-1))
    return values.mean(axis=-1), ranges.mean(axis=-1) / RANGE_MEAN


def ewma_of(z: Annotated[FloatArray, "... values"]) -> tuple[FloatArray, FloatArray]:
    """Exponentially weighted means (..., values) of distances from the centre in sds, and how far
    (values,) their limits are from it.
    """
    means = np.empty(z.shape)
    mean = np.zeros(z.shape[:-1])
    for k in range(z.shape[-1]):
        mean = mean + EWMA_WEIGHT * (z[..., k] - mean)
        means[..., k] = mean
    count = np.arange(1, z.shape[-1] + 1)
    share = EWMA_WEIGHT / (2.0 - EWMA_WEIGHT)
    return means, EWMA_LIMIT * np.sqrt(share * (1.0 - (1.0 - EWMA_WEIGHT) ** (2 * count)))


def alarms(
    z: Annotated[FloatArray, "... values"],
    rules: Sequence[Rule],
) -> BoolArray:
    """Which of the rules, and the EWMA last, is broken (rules, ..., values) at each value, by
    distances from the centre in sds. Moving ranges raise no alarm: those of a stable process pass
    their limit once in 118 values.
    """
    means, limit = ewma_of(z)
    return np.stack([*(rule.test(z) for rule in rules), np.abs(means) > limit])


def false_alarms(
    count: int,
    baseline: int,
    rules: Sequence[Rule],
    rng: np.random.Generator,
) -> float:
    """Share of stable series of `count` values, with limits of their first `baseline`, in which any
    rule is broken, by simulation.
    """
    values = rng.standard_normal((_SIMULATED, count))
    centre, sd = limits(values[:, :baseline])
    z = (values - centre[:, None]) / sd[:, None]
    return float(alarms(z, rules).any(axis=(0, 2)).mean())


def chart_of(
    values: Annotated[FloatArray, "values"],
    baseline: int,
    rules: Sequence[Rule],
) -> Chart | None:
    """The chart of values with limits of the first `baseline`; None where these do not vary."""
    centre, sd = (float(number) for number in limits(values[:baseline]))
    if not sd > 0.0:
        return None
    z = (values - centre) / sd
    names = [*(rule.name for rule in rules), EWMA]
    found = alarms(z, rules)
    broken = [
        tuple(name for name, is_broken in zip(names, column, strict=True) if is_broken)
        for column in found.T
    ]
    means, limit = ewma_of(z)
    return Chart(
        values=values,
        baseline=baseline,
        centre=centre,
        sd=sd,
        ranges=np.concatenate([[np.nan], np.abs(np.diff(values))]),
        range_limit=sd * (RANGE_MEAN + LIMIT * RANGE_SD),
        ewma=centre + sd * means,
        ewma_limit=sd * limit,
        broken=tuple(broken),
        changes=tuple(
            change._replace(size=sd * change.size, sd=sd * change.sd)
            for change in _changes(z, baseline, rules, names)
        ),
    )


def _changes(
    z: FloatArray,
    baseline: int,
    rules: Sequence[Rule],
    names: Sequence[str],
) -> list[Change]:
    """What changed, in order, in sds: the stretch about the first alarm is taken out, until there
    is no alarm in what is left.
    """
    away = [*(rule.away for rule in rules), True]
    spans = [*(rule.span for rule in rules), 1]
    left = np.arange(z.size)
    changes = []
    while left.size:
        found = alarms(z[left], rules)
        if not found.any():
            break
        at = int(found.any(axis=0).argmax())
        by = np.flatnonzero(found[:, at]).tolist()
        explained = [k for k in by if away[k]]
        kind: Kind
        if explained:
            first, last = _furthest(z[left], at)
            kind = "value" if first == last else "shift"
        else:
            first, last = at - max(spans[k] for k in by) + 1, at
            kind = "pattern"
        stretch = left[first : last + 1]
        error = sqrt(1.0 / stretch.size + 1.0 / baseline)
        changes.append(
            Change(
                kind,
                int(stretch[0]),
                int(stretch[-1]),
                float(z[stretch].mean()),
                error,
                tuple(names[k] for k in explained or by),
            )
        )
        left = np.delete(left, np.arange(first, last + 1))
    return sorted(changes, key=lambda change: change.first)


def _furthest(z: FloatArray, at: int) -> tuple[int, int]:
    """First and last of the stretch of values with the value `at` whose mean is furthest from the
    centre in standard errors.
    """
    sums = np.concatenate([[0.0], np.cumsum(z)])
    first = np.arange(at + 1)[:, None]
    last = np.arange(at, z.size)[None]
    distance = (sums[last + 1] - sums[first]) ** 2 / (last + 1 - first)
    start, end = np.unravel_index(distance.argmax(), distance.shape)
    return int(start), int(at + end)
