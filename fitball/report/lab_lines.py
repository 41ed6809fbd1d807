"""The first lines of a fit of laboratory tests: what was measured, and whether it passes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fitball.base import itf
from fitball.base.display_units import CM, PLAIN
from fitball.base.numbers import Unit, counted, fixed
from fitball.base.text import listed
from fitball.data.scene import Scene
from fitball.inference.effort import PREDICTION_DRAWS
from fitball.inference.fitted import Fitted
from fitball.report.blocks import Mark
from fitball.report.frame_rows import FrameRow, frame_rows
from fitball.report.quantities import chance
from fitball.uses.measured import lab_tests, outcome, rule_of

# Balls, places or surfaces with a line or a value of their own; of more the lowest and the highest.
MOST_LISTED = 4
# Surfaces with lines on a first screen.
_MOST_SURFACES = 3
# The probability by chance below which places differ.
_SIGNIFICANT = 0.05
_TONES = {"passes": "good", "fails": "poor", "undecided": "part", "": ""}
_OUTCOMES = {
    "passes": "passes as {rule} (probability {chance})",
    "fails": "fails as {rule} (probability to pass {chance})",
    "undecided": "undecided as {rule} (probability to pass {chance})",
}


def measured_lines(fit: Fitted) -> list[Mark]:
    """Lines on drop tests and court pace as measured; none where neither was."""
    tests = lab_tests(fit)
    scene = fit.run.scene
    lines = list[Mark]()
    drops = frame_rows(tests.drops)
    surfaces = [row for row in drops if row.text("kind") == "mean"]
    for mean in surfaces[:_MOST_SURFACES]:
        surface = mean.text("surface")
        balls = [
            row for row in drops if row.text("kind") == "ball" and row.text("surface") == surface
        ]
        lines += _drop_lines(mean, balls, scene)
    paced = frame_rows(tests.pace)
    courts = [row for row in paced if not row.text("place")]
    for court in courts[:_MOST_SURFACES]:
        surface = court.text("surface")
        places = [row for row in paced if row.text("place") and row.text("surface") == surface]
        lines += _pace_lines(court, places)
    more = max(len(surfaces), len(courts)) - _MOST_SURFACES
    if more > 0:
        lines.append(Mark(f"{counted(more, 'more surface')} below."))
    return [*lines, *_drop_conditions(surfaces, drops, scene), *_pace_conditions(paced, fit)]


def _drop_lines(mean: FrameRow, balls: Sequence[FrameRow], scene: Scene) -> Iterator[Mark]:
    """The mean of the drops on a surface, what balls and repeats scatter, the balls."""
    where = f" on {mean.text('surface')}" if mean.text("surface") else ""
    of = _value_of(mean)
    lead = f"Drop test{where}" if of == "rebound" else f"Drops{where}"
    agree = mean.flag("agree")
    sample = counted(mean.count("drops"), "drop")
    if mean.count("balls") > 1:
        sample = f"mean of {counted(mean.count('balls'), 'ball')}, {sample}"
    verdict = outcome(mean.number("passes"))
    if agree:
        passes = _passes(verdict, mean.number("passes"), scene)
        text = ": ".join(filter(None, (f"{lead}: {_value(mean, of)} ({sample})", passes)))
        yield Mark(f"{text}.", _TONES[verdict])
    else:
        values = [row.number(of) for row in balls]
        unit = _unit(of)
        size = unit.with_unit(unit.number(max(values) - min(values), 2))
        what = "in COR " if of == "cor" else ""
        text = f"{lead}: balls differ {what}by {size}, more than those of one type may"
        yield Mark(f"{text}: no mean is given.", "part")
    if np.isfinite(mean.number("ratio")):
        ratio = _interval(mean, PLAIN, "ratio", "ratio_q025", "ratio_q975")
        yield Mark(f"Rebound{where}: {ratio} × that on the reference surface (ITF: heights).")
    yield from _ball_lines(balls, of)
    parts = [
        f"{words} {_value(mean, name, _unit(of))}"
        for name, words in (("sd_balls", "balls"), ("sd_repeats", "repeats"))
        if np.isfinite(mean.number(name))
    ]
    if parts:
        yield Mark(f"Standard deviation{where}: {listed(parts)}.")


def _passes(verdict: str, passes: float, scene: Scene) -> str:
    """A verdict in words, with the rule; empty without one."""
    if not verdict:
        return ""
    return _OUTCOMES[verdict].format(rule=rule_of(scene), chance=chance(passes))


def _ball_lines(balls: Sequence[FrameRow], of: str) -> Iterator[Mark]:
    """A line a ball, of many one on the lowest and the highest, how many pass, which lie apart."""
    if len(balls) <= MOST_LISTED:
        for row in balls:
            verdict = outcome(row.number("passes"))
            passes = f": {verdict} ({chance(row.number('passes'))})" if verdict else ""
            text = f"Ball {row.text('label')}: {_value(row, of)}{passes}."
            yield Mark(text, _TONES[verdict])
        return
    unit = _unit(of)
    ascending = sorted(balls, key=lambda row: row.number(of))
    ends = [
        f"{unit.with_unit(unit.number(row.number(of), 4))} ({row.text('label')})"
        for row in (ascending[0], ascending[-1])
    ]
    texts = [f"Balls: {listed(ends, 'to')}"]
    outcomes = [outcome(row.number("passes")) for row in balls]
    if any(outcomes):
        failing = [
            row.text("label")
            for row, verdict in zip(balls, outcomes, strict=True)
            if verdict == "fails"
        ]
        named = f" ({listed(failing)})" if failing else ""
        texts.append(
            f"{outcomes.count('passes')} pass, {len(failing)} fail{named}, "
            f"{outcomes.count('undecided')} undecided"
        )
    apart = [row.text("label") for row in balls if row.flag("outlying")]
    texts.append(f"outlying: {listed(apart) if apart else 'none'}")
    yield Mark(f"{'; '.join(texts)}.", "part" if apart else "")


def _pace_lines(court: FrameRow, places: Sequence[FrameRow]) -> Iterator[Mark]:
    """The rating of a surface, and of its places, and whether these differ."""
    where = f" of {court.text('surface')}" if court.text("surface") else ""
    category = max(itf.PACE_CATEGORIES, key=court.number)
    likely = ""
    # A rating without an interval has no probability.
    if np.isfinite(court.number("q025")):
        likely = f" (probability {chance(court.number(category))})"
    rating = _interval(court, PLAIN, "rating", "q025", "q975")
    yield Mark(f"Court pace{where}, as measured: {rating}, {category}{likely} by ITF CS 01/02.")
    if not places:
        return
    shown = places
    if len(places) > MOST_LISTED:
        ascending = sorted(places, key=lambda row: row.number("rating"))
        shown = [ascending[0], ascending[-1]]
    each = [
        f"{row.text('place')} {_interval(row, PLAIN, 'rating', 'q025', 'q975')}" for row in shown
    ]
    joined = listed(each, "to" if len(places) > MOST_LISTED else "and")
    by_chance = court.number("by_chance")
    size = f"largest difference of unpooled means {fixed(court.number('variation'), 1)}"
    if not np.isfinite(by_chance):
        yield Mark(f"Places: {joined}; {size}, without repeats it may be noise.")
        return
    # Values of places are drawn towards each other, their difference is not.
    compared = f"Places, partially pooled: {joined}; {size}"
    if by_chance < _SIGNIFICANT:
        even = f"the court is uneven (by chance {chance(by_chance)})"
        yield Mark(f"{compared}: {even}.", "part")
    else:
        yield Mark(f"{compared}, not more than by chance ({chance(by_chance)}).")


def _drop_conditions(
    surfaces: Sequence[FrameRow],
    drops: Sequence[FrameRow],
    scene: Scene,
) -> Iterator[Mark]:
    """What TB 04/01 asks besides, where drops are those of the test."""
    judged = [row for row in surfaces if np.isfinite(row.number("rebound"))]
    if not judged:
        return
    wanted = itf.tested_balls(scene.ball_type())
    balls = min(row.count("balls") for row in judged)
    each = [row.count("drops") for row in drops if row.text("kind") == "ball"]
    fewest = min(each) if each else min(row.count("drops") for row in judged)
    asked = list[str]()
    if balls < wanted:
        asked.append(f"{wanted} balls (here {balls})")
    if fewest < itf.DROPS_OF_A_BALL:
        asked.append(f"{itf.DROPS_OF_A_BALL} drops of each ball ({fewest})")
    usual, tolerance = itf.ROOM_TEMPERATURE
    warmth = scene.ball.temperature
    if warmth is None or abs(warmth - usual) > tolerance:
        here = "not stated" if warmth is None else f"{warmth:g}"
        asked.append(f"{usual:g} ± {tolerance:g} degrees Celsius ({here})")
    if asked:
        yield Mark(f"TB 04/01 asks besides for {listed(asked)}.", "quiet")


def _pace_conditions(paced: Sequence[FrameRow], fit: Fitted) -> Iterator[Mark]:
    """What CS 01/02 asks besides, where a court was tested."""
    if not paced:
        return
    places = [row for row in paced if row.text("place")] or paced
    fewest = min(row.count("impacts") for row in places)
    asked = list[str]()
    if fewest < itf.PACE_IMPACTS:
        asked.append(f"{itf.PACE_IMPACTS} impacts a location (here {fewest})")
    balls = len({*fit.run.table.labels.get("ball", ())})
    if balls < itf.PACE_BALLS:
        asked.append(f"{itf.PACE_BALLS} balls ({balls or 'not stated'})")
    low, high = itf.PACE_BALL_TEMPERATURES
    warmth = fit.run.scene.ball.temperature
    if warmth is None or not low <= warmth <= high:
        here = "not stated" if warmth is None else f"{warmth:g}"
        asked.append(f"balls of {low:g} to {high:g} degrees Celsius ({here})")
    asked.append("a mean without impacts on markings (not checked)")
    yield Mark(f"CS 01/02 asks besides for {listed(asked)}.", "quiet")


def _value_of(row: FrameRow) -> str:
    """What is shown of a row of drops: the rebound where it is that of the test, else the COR."""
    return "rebound" if np.isfinite(row.number("rebound")) else "cor"


def _unit(of: str) -> Unit:
    """The unit in which that is shown."""
    return CM if of == "rebound" else PLAIN


def _value(row: FrameRow, name: str, unit: Unit | None = None) -> str:
    """A value of a row with its 95 % interval, such as `141.2 [140.1, 142.3] cm from 254 cm`."""
    shown = unit or _unit(name)
    text = shown.with_unit(_interval(row, shown, name, f"{name}_q025", f"{name}_q975"))
    if name == "rebound":
        return f"{text} from 254 cm"
    return f"COR {text} at {fixed(row.number('speed'), 1)} m/s" if name == "cor" else text


def _interval(row: FrameRow, unit: Unit, name: str, low: str, high: str) -> str:
    """A value with its 95 % interval, of independent draws, by the names of three columns."""
    ends = row.number(low), row.number(high)
    return unit.with_interval(row.number(name), *ends, PREDICTION_DRAWS)
