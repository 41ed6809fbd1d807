"""The ways in which a table can be misread: one registry, each with what a user does about it.

A hypothesis is a transformation of the columns as they were read, in SI, so that a table that a check refuses can be
looked at too. A table and its mirror image (`v_x` and `omega` of both ends negated) say the same: of a choice of
signs and its mirror image only that with fewer columns is tried, both where they have as many.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from math import comb, log

import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import MEASURED, SD_SUFFIX
from fitball.data.reading.flip import ANGLES, flipped
from fitball.data.reading.motion import Columns
from fitball.data.reading.spins import signed, unsigned
from fitball.data.units import UNITS, Dimension
from fitball.values import Ball
from fitball.wording import option

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
    """Another reading: `words` ("with omega_1 and omega_2 negated"), what to do if that is meant (columns to `flip`,
    and what `edit` says), and how it changes the columns; `parts` counts how many things it takes to be wrong. What
    `needs_spin` changes one end alone, which a table without spins cannot tell from a ball of its own kind; what
    `scales` is another unit, which spins cannot tell from another radius. `cost` is that of what
    it takes from the table row by row [natural units of log likelihood].
    """

    words: str
    edit: str
    apply: Callable[[Columns], Columns]
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
    others = [*_from_normal(columns), *_unit_slips(columns, units), *_crossed(columns, units)]
    return tuple(both(sign, other) for sign in _signs(columns) for other in others if not other.needs_spin)


def both(one: Hypothesis, other: Hypothesis) -> Hypothesis:
    """The two together."""
    return Hypothesis(
        f"{one.words} and {other.words.removeprefix('with ')}",
        "; and ".join(filter(None, (one.edit, other.edit))),
        lambda columns: other.apply(one.apply(columns)),
        one.parts + other.parts,
        one.needs_spin or other.needs_spin,
        one.scales or other.scales,
        (*one.flips, *other.flips),
        one.cost + other.cost,
    )


def listed(names: Sequence[str]) -> str:
    """Names in a sentence."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _flip(names: tuple[str, ...], words: str, parts: int) -> Hypothesis:
    return Hypothesis(
        f"with {listed(names)} {words}",
        "",
        lambda columns: {**columns, **{name: flipped(name, columns[name]) for name in names}},
        parts,
        flips=names,
    )


def _signs(columns: Columns) -> Iterator[Hypothesis]:
    present = [name for name in _SIGNED if name in columns and np.any(columns[name])]
    for count in range(1, len(present) + 1):
        for names in combinations(present, count):
            # The mirror image of nothing is nothing.
            if len(present) < len(_SIGNED) or 2 * count <= len(_SIGNED):
                yield _flip(names, "negated", count)


def _unsigned(columns: Columns, ball: Ball) -> Iterator[Hypothesis]:
    """Spins whose signs were not written, the sense of each taken from the speeds of its row."""
    for names in unsigned(columns):
        found = signed(columns, names, ball)
        if not all(np.any(found[name] != columns[name]) for name in names):
            # The same as with fewer.
            continue
        minus = [f"{np.sum(found[name] < 0.0)} of {len(found[name])} {name}" for name in names]
        unknown = {"omega_1": "without a row of unknown omega_1", "omega_2": "an unknown omega_2 left empty"}
        what_else = ", ".join(unknown[name] for name in names)
        yield Hypothesis(
            f"with the signs of {listed(names)} missing (the speeds make {listed(minus)} backspin)",
            f"write backspin with a minus ({what_else})",
            # Of other columns the signs would be others.
            lambda other, found=found, names=names: {**other, **{name: found[name] for name in names}},  # type: ignore[misc]
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
            yield _flip(names, "measured from the normal", 1)


def _towards(columns: Columns) -> Iterator[Hypothesis]:
    if "v_y1" in columns and np.all(columns["v_y1"] < 0.0):
        yield _flip(("v_y1",), "negated", 1)


def _unit_slips(columns: Columns, units: Mapping[str, str]) -> Iterator[Hypothesis]:
    """One unit for both ends, for one of them, and for speeds and spins together."""
    whole: dict[Dimension, list[Hypothesis]] = {Dimension.SPEED: [], Dimension.SPIN: [], Dimension.ANGLE: []}
    for dimension, usual in _USUAL.items():
        present = tuple(name for name in columns if MEASURED[name] is dimension)
        ends = [tuple(name for name in present if name.endswith(end)) for end in ("1", "2")]
        for symbol in usual:
            whole[dimension] += _unit(present, symbol, units, 1)
        yield from whole[dimension]
        if all(ends):
            for names, symbol in product(ends, usual):
                yield from _unit(names, symbol, units, 2)
    for speed, spin in product(whole[Dimension.SPEED], whole[Dimension.SPIN]):
        yield both(speed, spin)


def _unit(names: tuple[str, ...], symbol: str, units: Mapping[str, str], parts: int) -> list[Hypothesis]:
    """`names` read in `symbol` instead, where that changes all of them."""
    meant = UNITS[symbol]
    before = {name: UNITS[units[name]] for name in names}
    if not names or any(unit is meant for unit in before.values()):
        return []

    def apply(columns: Columns) -> Columns:
        return {**columns, **{name: meant.to_si(before[name].from_si(columns[name])) for name in names}}

    was = sorted({unit.symbol for unit in before.values()})
    cells = [f"'{name} [{symbol}]'" for name in (*names, *_sds(names, units))]
    words = f"with {listed(names)} in {symbol} instead of {' and '.join(was)}"
    return [Hypothesis(words, f"write in the header {listed(cells)}", apply, parts, parts > 1, scales=True)]


def _sds(names: Sequence[str], units: Mapping[str, str]) -> list[str]:
    return [name + SD_SUFFIX for name in names if name + SD_SUFFIX in units]


def _swaps(columns: Columns, units: Mapping[str, str]) -> Iterator[Hypothesis]:
    ends = [(one, f"{one[:-1]}2") for one in columns if one.endswith("1") and f"{one[:-1]}2" in columns]
    if any(name.startswith("v") for pair in ends for name in pair):
        yield _swap(ends, "with incidence and rebound swapped", units)
    for pair in ends:
        yield _swap([pair], f"with {pair[0]} and {pair[1]} swapped", units, needs_spin=True)
    yield from _crossed(columns, units)


def _crossed(columns: Columns, units: Mapping[str, str]) -> Iterator[Hypothesis]:
    crossed = [(f"v_x{end}", f"v_y{end}") for end in ("1", "2") if {f"v_x{end}", f"v_y{end}"} <= columns.keys()]
    for count in range(1, len(crossed) + 1):
        for pairs in combinations(crossed, count):
            yield _swap(pairs, f"with {listed([f'{x} and {y}' for x, y in pairs])} swapped", units)


def _swap(
    pairs: Sequence[tuple[str, str]], words: str, units: Mapping[str, str], needs_spin: bool = False
) -> Hypothesis:
    other = dict(pairs) | {two: one for one, two in pairs}
    sds = _sds(tuple(other), units)
    exchanged = ", ".join(f"{one} and {two}" for one, two in pairs)
    also = f" (and the columns {listed(sds)} likewise)" if sds else ""
    return Hypothesis(
        words,
        f"exchange in the header the names {exchanged}{also}, not the units,",
        lambda columns: {other.get(name, name): values for name, values in columns.items()},
        needs_spin=needs_spin,
    )
