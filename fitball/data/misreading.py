"""Finds misread tables: does another reading of the columns (signs, units, angles from the normal, swapped columns)
fit so much better than the header that the user must decide?

A hypothesis transforms the columns as they were read, in SI, so that a refused table can be examined too. A table and
its mirror image (`v_x` and `omega` of both ends negated) are equivalent. Of a choice of signs and its mirror image
only the one with fewer columns is tried, or both if they have as many.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations, product
from math import comb, log

import numpy as np
from numpy.typing import NDArray

from fitball.data.cells import Findings
from fitball.data.columns import ANGLES, COLUMNS, FLIPPABLE, FROM_NORMAL, REBOUND, SD_SUFFIX
from fitball.data.laws import (
    Columns,
    Misfit,
    Motion,
    chosen_rows,
    columns_of,
    misfit,
    missing_above,
    motion_of,
    signed,
    unsigned,
)
from fitball.data.numbers import NumberColumn
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.data.units import UNITS, Dimension
from fitball.errors import ParameterError, suggestion
from fitball.observables import OBSERVABLES
from fitball.values import Ball, FloatArray, quotient
from fitball.wording import option


def flipped(name: str, values: FloatArray) -> FloatArray:
    """The values [SI] of a column counted the other way round: angles from the normal instead of from the court, all
    others with the other sign.
    """
    other: FloatArray = np.pi / 2.0 - values if COLUMNS[name].flip == FROM_NORMAL else -values
    return other


def flip_columns(
    columns: Mapping[str, NumberColumn], flip: Sequence[str], found: Findings
) -> dict[str, NumberColumn]:
    """The columns with those named in `flip` counted the other way round, and a notice that says so.

    Raises ParameterError for a name that is no such column of the table, or that is there twice.
    """
    turned = dict(columns)
    for name in flip:
        present = [known for known in FLIPPABLE if known in columns]
        if name not in present:
            raise ParameterError(f"flip: the table has no column '{name}' to flip: {suggestion(name, present)}")
        if flip.count(name) > 1:
            raise ParameterError(f"flip: {name} is named twice")
        turned[name] = replace(columns[name], values=flipped(name, columns[name].values))
        found.notice(f"{name} is read {COLUMNS[name].flip}, on request (flip)", name)
    return turned


def named_of(named: Sequence[str], table: str) -> tuple[str, ...]:
    """Which columns of the table called `table` are named: those without a table, and those with it, as in
    `my_balls:omega_1`.
    """
    parts = [item.rpartition(":") for item in named]
    return tuple(column for place, _, column in parts if place in ("", table))


def check_named(what: str, named: Sequence[str], tables: Sequence[str]) -> None:
    """Raise ParameterError for a table that is not among `tables`; `what` is the option."""
    for item in named:
        place = item.rpartition(":")[0]
        if place and place not in tables:
            raise ParameterError(f"{what} {item}: there is no table '{place}': {suggestion(place, tables)}")


# Units that people measure balls in; a table in others says so.
_USUAL: Mapping[Dimension, tuple[str, ...]] = {
    Dimension.SPEED: ("m/s", "km/h", "mph", "ft/s"),
    Dimension.SPIN: ("rad/s", "rpm", "rev/s", "deg/s"),
    Dimension.ANGLE: ("deg", "rad"),
}
_SIGNED = ("omega_1", "omega_2", "v_x1", "v_x2")


BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Hypothesis:
    """Another reading: `words` ("with omega_1 negated"), the `columns` as they are then, what to do if that
    is meant (columns to flip, and what `edit` says); `parts` counts how many things it takes to be wrong. What
    `needs_spin` changes one end alone, which without spins cannot be distinguished from another kind of ball; what
    `scales` is another unit, which spins cannot distinguish from another radius. `cost` is that of what
    it takes from the table row by row [natural units of log likelihood].
    """

    words: str
    columns: Columns
    edit: str = ""
    parts: int = 1
    needs_spin: bool = False
    scales: bool = False
    flips: tuple[str, ...] = ()
    cost: float = 0.0

    @property
    def remedy(self) -> str:
        """What to do if that is meant."""
        flip = f"pass {option('flip', *self.flips)}" if self.flips else ""
        return "; and ".join(filter(None, (flip, self.edit)))


def hypotheses(columns: Columns, units: Mapping[str, str], ball: Ball) -> tuple[Hypothesis, ...]:
    """All that make sense of these columns, simple ones first. `units` are symbols by column, as the header says,
    those of stated sds among them.
    """
    simple = (*_signs(columns), *_from_normal(columns), *_towards(columns))
    found = (*simple, *_unsigned(columns, ball), *_unit_slips(columns, units), *_swaps(columns, units))
    return tuple(sorted(found, key=lambda item: item.parts))


def double_hypotheses(columns: Columns, units: Mapping[str, str]) -> tuple[Hypothesis, ...]:
    """Signs that are wrong together with units, angles or components."""

    def others(columns: Columns) -> Iterator[Hypothesis]:
        return chain(_from_normal(columns), _unit_slips(columns, units), _crossed(columns, units))

    return tuple(
        both(sign, other) for sign in _signs(columns) for other in others(sign.columns) if not other.needs_spin
    )


def both(one: Hypothesis, other: Hypothesis) -> Hypothesis:
    """The two together, the other of columns as the one has them."""
    return Hypothesis(
        f"{one.words} and {other.words.removeprefix('with ')}",
        other.columns,
        "; and ".join(filter(None, (one.edit, other.edit))),
        one.parts + other.parts,
        one.needs_spin or other.needs_spin,
        one.scales or other.scales,
        (*one.flips, *other.flips),
        one.cost + other.cost,
    )


def listed(names: Sequence[str]) -> str:
    """Names in a sentence."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _flip(columns: Columns, names: tuple[str, ...], words: str, parts: int = 1) -> Hypothesis:
    turned = {**columns, **{name: flipped(name, columns[name]) for name in names}}
    return Hypothesis(f"with {listed(names)} {words}", turned, parts=parts, flips=names)


def _signs(columns: Columns) -> Iterator[Hypothesis]:
    present = [name for name in _SIGNED if name in columns and np.any(columns[name])]
    for count in range(1, len(present) + 1):
        for names in combinations(present, count):
            # The mirror image of nothing is nothing.
            if len(present) < len(_SIGNED) or 2 * count <= len(_SIGNED):
                yield _flip(columns, names, "negated", count)


def _unsigned(columns: Columns, ball: Ball) -> Iterator[Hypothesis]:
    """Spins whose signs were not written, the sense of each taken from the speeds of its row."""
    for names in unsigned(columns):
        found = signed(columns, names, ball)
        if not all(np.any(found[name] != columns[name]) for name in names):
            # The same as with fewer.
            continue
        if all(np.all(found[name] * columns[name] <= 0.0) for name in names):
            # The same as all negated.
            continue
        minus = [f"{np.sum(found[name] < 0.0)} of {len(found[name])} {name}" for name in names]
        unknown = {"omega_1": "delete rows with unknown omega_1", "omega_2": "leave unknown omega_2 empty"}
        what_else = ", ".join(unknown[name] for name in names)
        yield Hypothesis(
            f"with missing signs of {listed(names)} restored (speeds show that {listed(minus)} are backspin)",
            found,
            f"write backspin with a minus sign ({what_else})",
            len(names),
            needs_spin=True,
            cost=sum(_cost_of_choice(found[name] != columns[name], columns[name] != 0.0) for name in names),
        )


def _cost_of_choice(chosen: BoolArray, rows: BoolArray) -> float:
    """Of naming which of the rows were chosen: how many, all counts as likely, and which, all sets of so many."""
    count = int(rows.sum())
    return log(comb(count, int(chosen.sum())) * (count + 1.0))


def _from_normal(columns: Columns) -> Iterator[Hypothesis]:
    present = [name for name in ANGLES if name in columns]
    for count in range(len(present), 0, -1):
        for names in combinations(present, count):
            yield _flip(columns, names, "measured from the normal")


def _towards(columns: Columns) -> Iterator[Hypothesis]:
    if "v_y1" in columns and np.all(columns["v_y1"] < 0.0):
        yield _flip(columns, ("v_y1",), "negated")


def _unit_slips(columns: Columns, units: Mapping[str, str]) -> Iterator[Hypothesis]:
    """One unit for both ends, for one of them, and for speeds and spins together."""
    of = {item: tuple(name for name in columns if COLUMNS[name].dimension is item) for item in _USUAL}
    for dimension, usual in _USUAL.items():
        for symbol in usual:
            yield from _unit(columns, of[dimension], symbol, units, 1)
        ends = [tuple(name for name in of[dimension] if name.endswith(end)) for end in ("1", "2")]
        for names, symbol in product(ends, usual) if all(ends) else ():
            yield from _unit(columns, names, symbol, units, 2)
    for symbol, other in product(_USUAL[Dimension.SPEED], _USUAL[Dimension.SPIN]):
        for speed in _unit(columns, of[Dimension.SPEED], symbol, units, 1):
            for spin in _unit(speed.columns, of[Dimension.SPIN], other, units, 1):
                yield both(speed, spin)


def _unit(
    columns: Columns, names: tuple[str, ...], symbol: str, units: Mapping[str, str], parts: int
) -> Iterator[Hypothesis]:
    """`names` read in `symbol` instead, where that changes all of them."""
    meant, before = UNITS[symbol], {name: UNITS[units[name]] for name in names}
    if names and meant not in before.values():
        read = {**columns, **{name: meant.to_si(before[name].from_si(columns[name])) for name in names}}
        was = sorted({unit.symbol for unit in before.values()})
        cells = [f"'{name} [{symbol}]'" for name in (*names, *_sds(names, units))]
        words = f"with {listed(names)} in {symbol} instead of {' and '.join(was)}"
        yield Hypothesis(words, read, f"write in the header {listed(cells)}", parts, parts > 1, scales=True)


def _sds(names: Sequence[str], units: Mapping[str, str]) -> list[str]:
    return [name + SD_SUFFIX for name in names if name + SD_SUFFIX in units]


def _swaps(columns: Columns, units: Mapping[str, str]) -> Iterator[Hypothesis]:
    ends = [(one, f"{one[:-1]}2") for one in columns if one.endswith("1") and f"{one[:-1]}2" in columns]
    if any(name.startswith("v") for pair in ends for name in pair):
        yield _swap(columns, ends, "with incidence and rebound swapped", units)
    for pair in ends:
        yield _swap(columns, [pair], f"with {pair[0]} and {pair[1]} swapped", units, needs_spin=True)
    yield from _crossed(columns, units)


def _crossed(columns: Columns, units: Mapping[str, str]) -> Iterator[Hypothesis]:
    crossed = [(f"v_x{end}", f"v_y{end}") for end in ("1", "2") if {f"v_x{end}", f"v_y{end}"} <= columns.keys()]
    for count in range(1, len(crossed) + 1):
        for pairs in combinations(crossed, count):
            yield _swap(columns, pairs, f"with {listed([f'{x} and {y}' for x, y in pairs])} swapped", units)


def _swap(
    columns: Columns,
    pairs: Sequence[tuple[str, str]],
    words: str,
    units: Mapping[str, str],
    needs_spin: bool = False,
) -> Hypothesis:
    other = dict(pairs) | {two: one for one, two in pairs}
    sds = _sds(tuple(other), units)
    exchanged = ", ".join(f"{one} and {two}" for one, two in pairs)
    also = f" (and the columns {listed(sds)} likewise)" if sds else ""
    swapped = {other.get(name, name): values for name, values in columns.items()}
    edit = f"swap the names {exchanged}{also} in the header, but not the units"
    return Hypothesis(words, swapped, edit, needs_spin=needs_spin)


# Log likelihood by which another reading must be better, in all and for each impact (as much as if all three misfits
# fell to half), and the misfit for each impact at which it still describes the table. Of good tables of thirty
# designs none comes near: `tests/test_reading.py` measures.
GAIN, GAIN_EACH, DESCRIBES = 10.0, 2.0, 6.0
# The gain of readings that choose row by row, beyond what their choice costs: all good tables lose by them.
GAIN_CHOSEN = 5.0
# The misfit for each impact that a table read well leaves seldom.
WELL = 3.0
# Rows in which all was measured that are enough to look at these alone.
LEAST_COMPLETE = 6
# Readings this much worse than the best are named beside it.
TIE, TIE_EACH, MOST_NAMED = 3.0, 0.1, 3
# Restitution that another reading may claim, and that a table as read may have without being suspect.
PLAUSIBLE, UNSUSPECTED = (0.3, 1.0), (0.25, 1.0)


@dataclass(frozen=True)
class Explanation:
    """A reading and what it leaves."""

    hypothesis: Hypothesis
    misfit: Misfit


@dataclass(frozen=True)
class Doubt:
    """A table that `found` explain much better than the header does, best first; `as_read` is what that leaves."""

    as_read: Misfit
    found: tuple[Explanation, ...]

    def lines(self, scene: Scene) -> tuple[str, ...]:
        """Each reading in a sentence: the numbers, and what to do."""
        lines = [
            f"{item.hypothesis.words}, {_fall(self.as_read, item.misfit)}: if that is right, {item.hypothesis.remedy}"
            for item in self.found
        ]
        if not scene.states_ball and any(item.hypothesis.scales for item in self.found):
            lines.append(
                f"a ball with a radius other than the assumed {1e3 * scene.ball.radius:g} mm may have the same "
                "effect: give [ball] in the scene"
            )
        return tuple(lines)


def doubt_of(columns: Columns, units: Mapping[str, str], ball: Ball) -> Doubt | None:
    """Doubts about the reading of `columns` [SI, by name, angles in rad], or None.

    `units` are the symbols by column, as the header says. Rows in which all was measured (a gap is NaN) are looked
    at; where these are too few, those that have all but what is missing most often, and so on.
    """
    columns = _moving(columns)
    gaps = {name: int(np.isnan(values).sum()) for name, values in columns.items() if name in REBOUND}
    sparsest = max(gaps, key=lambda name: gaps[name], default=None)
    if sparsest is not None and gaps[sparsest] and len(chosen_rows(columns)) < LEAST_COMPLETE:
        return doubt_of({name: values for name, values in columns.items() if name != sparsest}, units, ball)
    rows = chosen_rows(columns)
    if len(rows) < 2:
        return None
    mine = {name: values[rows] for name, values in columns.items()}
    motion = motion_of(mine)
    if motion.v_y1 is None or all(item is None for item in (motion.v_x2, motion.v_y2, motion.omega_2)):
        return None
    as_read = misfit(motion, ball)
    # The gain there can be at most, before anything else is fitted.
    if as_read.cost < GAIN_CHOSEN:
        return None
    tried = hypotheses(mine, units, ball)
    if as_read.cost < max(GAIN, GAIN_EACH * as_read.rows):
        tried = tuple(item for item in tried if item.cost)
    found = _better(mine, as_read, tried, ball)
    best = min([as_read, *(item.misfit for item in found)], key=lambda item: item.cost)
    if best.cost / best.rows > WELL:
        # Two things may be wrong; that is said only where it is much better than one.
        found = _better(mine, best, double_hypotheses(mine, units), ball) or found
    return Doubt(as_read, found) if found else None


def _better(columns: Columns, as_read: Misfit, tried: Iterable[Hypothesis], ball: Ball) -> tuple[Explanation, ...]:
    """Those of the hypotheses that explain the columns much better, the best and what equals it; none is much better
    than a good one.
    """
    motion = motion_of(columns)
    found = []
    for hypothesis in tried:
        moved = motion_of(hypothesis.columns)
        if (
            moved != motion
            and _plausible(hypothesis.columns, moved)
            and not (hypothesis.needs_spin and _untold(motion))
        ):
            left = misfit(moved, ball)
            left = replace(left, cost=left.cost + hypothesis.cost)
            found += [Explanation(hypothesis, left)] if _falls(as_read, left) else []
    if not found:
        return ()
    first = min(found, key=lambda item: item.misfit.cost)
    best, gain = first.misfit, as_read.cost - first.misfit.cost
    least = GAIN_CHOSEN if first.hypothesis.cost else max(GAIN, GAIN_EACH * best.rows)
    if gain < least or best.cost / best.rows > DESCRIBES:
        return ()
    reach = best.cost + TIE + TIE_EACH * best.rows
    equal = [item for item in found if item.misfit.cost <= reach]
    return tuple(sorted(equal, key=lambda item: (item.hypothesis.parts, item.misfit.cost))[:MOST_NAMED])


def _moving(columns: Columns) -> Columns:
    """The columns that say how the ball moves: a time does not, nor what lies between the flights."""
    return {
        name: values for name, values in columns.items() if name not in OBSERVABLES or not OBSERVABLES[name].timed
    }


def gaps_of_table(table: ImpactTable, ball: Ball) -> str | None:
    """A note on missing rebound spins, see `missing_above`."""
    return missing_above(_moving(columns_of(table)), ball)


def doubt_of_table(table: ImpactTable, ball: Ball) -> Doubt | None:
    """`doubt_of` a table that has been read."""
    return doubt_of(columns_of(table), table.units, ball)


def _restitution(motion: Motion) -> float | None:
    if motion.v_y1 is None or motion.v_y2 is None:
        return None
    # Quotients by next to nothing are infinite, of both signs: their median is no number, and nothing plausible.
    with np.errstate(invalid="ignore"):
        return float(np.median(quotient(motion.v_y2, motion.v_y1)))


def _plausible(columns: Columns, motion: Motion) -> bool:
    """Whether a reading says nothing absurd by itself."""
    restitution = _restitution(motion)
    if restitution is not None and not PLAUSIBLE[0] <= restitution <= PLAUSIBLE[1]:
        return False
    angles = [columns[name] for name in ("theta_1", "theta_2") if name in columns]
    return all(bool(np.all((angle > 0.0) & (angle < np.pi))) for angle in angles)


def _untold(motion: Motion) -> bool:
    """Whether only friction distinguishes incidence from rebound."""
    restitution = _restitution(motion)
    unsuspected = restitution is None or UNSUSPECTED[0] <= restitution <= UNSUSPECTED[1]
    return motion.omega_2 is None and unsuspected


# What a residual is called, and its unit.
_NAMES = {
    "omega_2": ("spin residual", "rad/s"),
    "v_x2": ("residual of v_x2", "m/s"),
    "v_y2": ("residual of v_y2", "m/s"),
}


def _falls(before: Misfit, after: Misfit) -> bool:
    """Whether anything that is left falls to half in its own unit: of balls that graze the court, whose restitution
    is mostly noise, shares of other motions may fall where nothing is explained.
    """
    shared = before.residuals.keys() & after.residuals.keys()
    falls = any(after.residuals[name] < 0.5 * before.residuals[name] for name in shared)
    return falls or _contradicts(before, after)


def _contradicts(before: Misfit, after: Misfit) -> bool:
    """Whether columns that say the same twice do so only after a change."""
    return before.contradiction > 0.05 and after.contradiction < 0.3 * before.contradiction


def _fall(before: Misfit, after: Misfit) -> str:
    """By how much what is left of the table falls, for the output of which that is most."""
    if _contradicts(before, after):
        return (
            f"redundant columns differ by {100.0 * after.contradiction:.2g} % instead of "
            f"{100.0 * before.contradiction:.2g} %"
        )
    shared = [name for name in _NAMES if name in before.residuals and name in after.residuals]
    name = max(shared, key=lambda item: before.residuals[item] / max(after.residuals[item], 1e-12))
    words, unit = _NAMES[name]
    return (
        f"the {words} of a quick fit falls from {_size(before.residuals[name])} to {_size(after.residuals[name])} "
        f"{unit} ({before.rows} impacts)"
    )


def _size(number: float) -> str:
    """Two digits, and no exponent where people read one badly."""
    return f"{number:.0f}" if 100.0 <= number < 1e6 else f"{number:.2g}"
