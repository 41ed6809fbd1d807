"""`doubts`: readings that explain a table far better, with remedies; repeated rows.

Signs, units, angles from the normal, exchanged columns and pairs of these are held against the laws
of an impulse on a round body (Walton 1993; Cross 2002). With slip u = v_x1 - R omega_1, a = I/(M
R^2) and s = v_y1 + v_y2, the speed lost along the court is a/(1 + a) ((1 + e_x) u + d s/a) in a
grip, at most mu s; about the contact angular momentum is kept, v_x1 - v_x2 - a R (omega_2 -
omega_1) = d s; v_y2/v_y1 is a line in the speed. A misfit is a share of the motion, so that no unit
looks better because its numbers are smaller, and counts by its logarithm, as in Cauchy's
distribution, which a few outliers do not move. The mirror image (v_x and omega negated) fits
equally well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from math import comb, log

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.display_units import PLAIN
from fitball.base.errors import Note
from fitball.base.text import listed
from fitball.base.units import factor_of
from fitball.base.values import Ball, FloatArray
from fitball.data.table import ImpactTable

# Log likelihood by which another reading must be better, in all and a row; what it may leave a row,
# and what a table that is read well seldom leaves; the gain of signs chosen row by row, beyond the
# cost of the choice. Measured on 138 tables read well and 63 misread ones of 23 designs
# (tests/test_misreading.py).
_GAIN = 10.0
_GAIN_EACH = 2.0
_DESCRIBES = 6.0
_WELL = 3.0
_GAIN_CHOSEN = 5.0
# Readings this much worse than the best, in all and a row, are named beside it, as many as this.
_TIE = 3.0
_TIE_EACH = 0.1
_NAMED = 3
# Shares of the motion: a misfit that says nothing, since no ball obeys the laws better; motion
# along the court that says little beside that across it, as of a ball that is dropped.
_FLOOR = 0.05
_SMALL = 0.2
# Rows that are looked at, and complete ones that are enough to look at these alone.
_ROWS = 60
_LEAST_ROWS = 6
# Units that people measure balls in; a table in others says so.
_USUAL = {
    "m/s": ("m/s", "km/h", "mph", "ft/s"),
    "rad/s": ("rad/s", "rpm", "rev/s", "deg/s"),
    "rad": ("deg", "rad"),
}

Columns = Mapping[str, FloatArray]
# By rebound column what a law leaves (points, impacts), and the size of the motion that it belongs
# to.
Left = Mapping[str, tuple[FloatArray, FloatArray | float]]
# A misfit, and the root mean square that each law leaves [m/s].
Misfit = tuple[float, dict[str, float]]


@dataclass(frozen=True, eq=False)
class Doubt:
    """Another reading: `columns` (impacts,) as they are then [SI], columns to `flip` or what else
    to do if it is meant, what it changes (`kind`), the `cost` of what it chooses row by row, its
    `gain` in log likelihood.
    """

    words: str
    columns: Columns
    kind: str
    flip: tuple[str, ...] = ()
    remedy: str = ""
    cost: float = 0.0
    gain: float = 0.0

    @property
    def text(self) -> str:
        """As a sentence."""
        todo = [
            *([f"pass --flip {','.join(self.flip)}"] if self.flip else []),
            *filter(None, [self.remedy]),
        ]
        gain = PLAIN.number(self.gain)
        return (
            f"with {self.words} a quick fit is far better (log likelihood +{gain}): if so, "
            f"{listed(todo)}"
        )


def doubts(table: ImpactTable, ball: Ball) -> tuple[Doubt, ...]:
    """Readings that explain a table far better than its header does, the best first; none if none
    does.
    """
    units = dict(
        item.split("=") for read in table.read for item in read.get("units", "").split(",") if item
    )
    return better_readings(table.values, units, ball)


def better_readings(columns: Columns, units: Mapping[str, str], ball: Ball) -> tuple[Doubt, ...]:
    """`doubts` of columns [SI] with `units` as in the header (default: SI), also of a table that is
    refused.
    """
    names = [name for name in columns if COLUMNS[name].unit in _USUAL and not COLUMNS[name].gap]
    # A table that is refused may have any number in it.
    columns = {name: np.clip(columns[name], -1e6, 1e6) for name in names}
    complete = np.flatnonzero(
        np.all([np.isfinite(values) for values in columns.values()] or [np.empty(0)], axis=0)
    )
    gaps = {name: int(np.isnan(values).sum()) for name, values in columns.items()}
    if len(complete) < _LEAST_ROWS and any(gaps.values()):
        sparsest = max(gaps, key=lambda name: gaps[name])
        return better_readings(
            {name: columns[name] for name in columns if name != sparsest},
            units,
            ball,
        )
    if len(complete) > _ROWS:
        # Not at equal steps, which a table that repeats a pattern would answer with.
        complete = np.sort(np.random.default_rng(0).choice(complete, _ROWS, replace=False))
    columns = {name: values[complete] for name, values in columns.items()}
    count = len(complete)
    before = misfit(columns, ball) if count > 1 else (0.0, {})
    least = max(_GAIN, _GAIN_EACH * count)
    as_read = before[0]
    if as_read < _GAIN_CHOSEN:
        return ()
    tried = _weighed(_readings(columns, units, ball), before, ball)
    best = max([0.0, *(item.gain for item in tried)])
    if as_read - best > _WELL * count:
        # Two things may be wrong; that is said only where it is much better than one.
        tried += [
            item
            for item in _weighed(_pairs(columns, units), before, ball)
            if item.gain > best + least
        ]
    tried.sort(key=lambda item: -item.gain)
    if not tried or tried[0].gain < (_GAIN_CHOSEN if tried[0].cost else least):
        return ()
    if as_read - tried[0].gain > _DESCRIBES * count:
        return ()
    return tuple(item for item in tried if item.gain >= tried[0].gain - _TIE - _TIE_EACH * count)[
        :_NAMED
    ]


def repeated_rows(table: ImpactTable) -> tuple[Note, ...]:
    """A note on rows that are equal in every number; those of a drop test are by chance."""
    if len(table.values) < 4:
        return ()
    keys = np.column_stack([np.nan_to_num(values, nan=np.inf) for values in table.values.values()])
    _, first, group, counts = np.unique(
        keys,
        axis=0,
        return_index=True,
        return_inverse=True,
        return_counts=True,
    )
    named = sorted(np.flatnonzero(counts > 1).tolist(), key=lambda k: int(first[k]))[:4]
    copies = [listed(np.array(table.labels["id"])[group.reshape(-1) == k]) for k in named]
    text = (
        f"{len(keys) - len(counts)} of {len(keys)} rows repeat others in every number: "
        f"{'; '.join(copies)}"
    )
    return (Note("repeated-rows", f"{text}. If they are copies, delete them."),) if copies else ()


def _weighed(readings: Iterable[Doubt], before: Misfit, ball: Ball) -> list[Doubt]:
    """The readings that are plausible and leave half of anything in its own unit, with their gains:
    of balls that graze the court, whose restitution is mostly noise, shares of other motions may
    fall where nothing is explained.
    """
    found = list[Doubt]()
    for one in filter(lambda one: _plausible(one.columns), readings):
        cost, left = misfit(one.columns, ball)
        if any(left[name] < 0.5 * rms for name, rms in before[1].items() if name in left):
            found.append(replace(one, gain=before[0] - one.cost - cost))
    return found


def _readings(columns: Columns, units: Mapping[str, str], ball: Ball) -> Iterator[Doubt]:
    """Other readings of these columns that make sense."""
    yield from _turned(columns)
    yield from _in_units(columns, units)
    yield from _swapped(columns)
    spins = [name for name in ("omega_1", "omega_2") if name in columns and np.any(columns[name])]
    one_way = [
        name for name in spins if np.all(columns[name] >= 0.0) or np.all(columns[name] <= 0.0)
    ]
    for names in _one_or_two(one_way):
        yield from _signed(columns, names, ball)


def _pairs(columns: Columns, units: Mapping[str, str]) -> Iterator[Doubt]:
    """Two changes at once: signs and something else, or units of two quantities."""
    for one in (*_turned(columns), *_in_units(columns, units)):
        for two in (*_turned(one.columns), *_in_units(one.columns, units)):
            if one.kind < two.kind and (
                "sign" in (one.kind, two.kind) or "zero" not in (one.kind, two.kind)
            ):
                remedy = "; ".join(filter(None, (one.remedy, two.remedy)))
                yield Doubt(
                    f"{one.words} and {two.words}",
                    two.columns,
                    "two",
                    (*one.flip, *two.flip),
                    remedy,
                )


def _one_or_two(names: Sequence[str]) -> Iterator[tuple[str, ...]]:
    yield from combinations(names, 1)
    yield from combinations(names, 2)


def _turned(columns: Columns) -> Iterator[Doubt]:
    """Signs, of two columns at most, since more are the mirror image of fewer; angles from the
    normal.
    """
    signed = [
        name
        for name in ("omega_1", "omega_2", "v_x1", "v_x2")
        if name in columns and np.any(columns[name])
    ]
    towards = [("v_y1",)] if "v_y1" in columns and np.all(columns["v_y1"] < 0.0) else []
    for names in (*_one_or_two(signed), *towards):
        yield Doubt(
            f"{listed(names)} negated",
            {**columns, **{x: -columns[x] for x in names}},
            "sign",
            names,
        )
    for names in _one_or_two([name for name in ("theta_1", "theta_2") if name in columns]):
        turned = {**columns, **{name: np.pi / 2.0 - columns[name] for name in names}}
        yield Doubt(f"{listed(names)} measured from the normal", turned, "zero", names)


def _in_units(columns: Columns, units: Mapping[str, str]) -> Iterator[Doubt]:
    """One quantity in another unit, at both ends or, where spins show it, at one."""
    for si, symbols in _USUAL.items():
        every = tuple(name for name in columns if COLUMNS[name].unit == si)
        ends = (
            [tuple(name for name in every if name[-1] == end) for end in "12"]
            if "omega_2" in columns
            else []
        )
        for names, symbol in product(dict.fromkeys((every, *ends)), symbols):
            stated = {name: units.get(name, si) for name in names}
            if names and symbol not in stated.values():
                factor = factor_of(symbol, si)
                meant = {
                    name: columns[name] * (factor / factor_of(unit, si))
                    for name, unit in stated.items()
                }
                words = (
                    f"{listed(names)} in {symbol} instead of "
                    f"{listed(dict.fromkeys(stated.values()))}"
                )
                remedy = f"write {listed(f'{name} [{symbol}]' for name in names)} in the header"
                yield Doubt(words, {**columns, **meant}, si, remedy=remedy)


def _swapped(columns: Columns) -> Iterator[Doubt]:
    """Incidence and rebound, all columns or, where spins show it, one; components of one end or of
    both.
    """
    ends = tuple(
        (name, f"{name[:-1]}2")
        for name in columns
        if name[-1] == "1" and f"{name[:-1]}2" in columns
    )
    crossed = [
        (f"v_x{end}", f"v_y{end}") for end in "12" if {f"v_x{end}", f"v_y{end}"} <= columns.keys()
    ]
    single = combinations(ends, 1) if "omega_2" in columns else ()
    for pairs in dict.fromkeys((ends, *single, *combinations(crossed, 1), tuple(crossed))):
        if pairs:
            other = dict(pairs) | {two: one for one, two in pairs}
            words = f"{listed(f'{one} and {two}' for one, two in pairs)} swapped"
            swapped = {other.get(name, name): values for name, values in columns.items()}
            yield Doubt(
                words,
                swapped,
                "name",
                remedy="swap these names in the header, but not the units",
            )


def _signed(columns: Columns, names: Sequence[str], ball: Ball) -> Iterator[Doubt]:
    """Signs of spins that were not written, chosen row by row so that angular momentum is kept
    best.
    """
    ways = [
        dict(zip(names, signs, strict=True)) for signs in product((1.0, -1.0), repeat=len(names))
    ]
    moved = [
        motion({**columns, **{name: sign * columns[name] for name, sign in way.items()}})
        for way in ways
    ]
    if not {"v_x1", "v_y1", "v_x2", "omega_2"} <= moved[0].keys():
        return
    turn = ball.inertia_ratio * ball.radius
    lost = np.array(
        [one["v_x1"] - one["v_x2"] - turn * (one["omega_2"] - one["omega_1"]) for one in moved]
    )
    per_impulse = lost / np.maximum(moved[0]["v_y1"] + moved[0].get("v_y2", 0.0), 1e-9)
    offset = 0.0
    # The offset of the normal force is that of the signs found with the one before; more rounds
    # change nothing.
    for _ in range(3):
        chosen = np.argmin(np.abs(per_impulse - offset), axis=0)
        offset = float(np.median(np.take_along_axis(per_impulse, chosen[None], 0)))
    signs = {name: np.array([way[name] for way in ways])[chosen] for name in names}
    changed = [(signs[name] < 0.0)[columns[name] != 0.0] for name in names]
    if all(item.any() for item in changed) and not all(item.all() for item in changed):
        # Which rows were chosen: how many, all counts as likely, and which, all sets of so many.
        cost = sum(log(comb(len(item), int(item.sum())) * (len(item) + 1.0)) for item in changed)
        remedy = (
            "write backspin with a minus sign (leave unknown omega_2 empty, delete rows with "
            "unknown omega_1)"
        )
        restored = {**columns, **{name: signs[name] * columns[name] for name in names}}
        yield Doubt(
            f"missing signs of {listed(names)} restored",
            restored,
            "signs",
            remedy=remedy,
            cost=cost,
        )


def motion(columns: Columns) -> dict[str, FloatArray]:
    """Components and spins that columns determine; incident spin is zero where it was not
    measured.
    """
    moved = {"omega_1": np.zeros(len(next(iter(columns.values())))), **columns}
    for end in "12":
        if {f"v_{end}", f"theta_{end}"} <= columns.keys():
            speed = columns[f"v_{end}"]
            angle = columns[f"theta_{end}"]
            moved |= {f"v_x{end}": speed * np.cos(angle), f"v_y{end}": speed * np.sin(angle)}
    return moved


def _plausible(columns: Columns) -> bool:
    """Whether a reading says nothing absurd by itself, such as a restitution above 1 or below
    0.3.
    """
    moved = motion(columns)
    if {"v_y1", "v_y2"} <= moved.keys():
        # Not as quotients, which may be by zero.
        low, high = (np.median(moved["v_y2"] - share * moved["v_y1"]) for share in (0.3, 1.0))
        if low < 0.0 or high > 0.0:
            return False
    angles = [values for name, values in columns.items() if name[:5] == "theta"]
    return all(bool(np.all((values > 0.0) & (values < np.pi))) for values in angles)


def misfit(columns: Columns, ball: Ball) -> Misfit:
    """What the best fit of the laws leaves [natural units of log likelihood], priors included."""
    moved = motion(columns)
    found = list[Misfit]()
    if {"v_y1", "v_y2"} <= moved.keys():
        found.append(_restitution(moved))
    if {"v_x1", "v_y1"} <= moved.keys() and ("v_x2" in moved or "omega_2" in moved):
        found.append(_tangential(moved, ball))
    return sum(cost for cost, _ in found), {
        name: rms for _, left in found for name, rms in left.items()
    }


def _restitution(moved: Columns) -> Misfit:
    v_1 = moved["v_y1"]
    v_2 = moved["v_y2"]
    from_middle = np.clip(v_1 / max(float(np.median(np.abs(v_1))), 1e-12) - 1.0, -2.0, 2.0)

    def law(points: FloatArray) -> Left:
        expected = np.clip(points[:, :1] + points[:, 1:] * from_middle, 0.02, 1.1) * v_1
        return {"v_y2": (v_2 - expected, np.abs(expected))}

    return _fitted(law, [(0.05, 1.0, 15), (-0.6, 0.6, 7)], [0.75, 0.0], [0.2, 0.2])


def _tangential(moved: Columns, ball: Ball) -> Misfit:
    a = ball.inertia_ratio
    radius = ball.radius
    v_1 = moved["v_y1"]
    pressed = np.maximum(v_1 + moved.get("v_y2", 0.75 * v_1), 1e-9)
    slip = moved["v_x1"] - radius * moved["omega_1"]
    lost = moved["v_x1"] - moved["v_x2"] if "v_x2" in moved else None
    turned = a * radius * (moved["omega_2"] - moved["omega_1"]) if "omega_2" in moved else None
    parts = [item**2 for item in (lost, turned) if item is not None]
    size = max(
        float(np.quantile(np.sqrt(np.mean(parts, axis=0)), 0.75)),
        _SMALL * float(np.median(pressed)),
    )

    def law(points: FloatArray) -> Left:
        mu = np.exp(points[:, :1])
        e_x = points[:, 1:2]
        shift = points[:, 2:] * pressed
        along = np.clip(
            a / (1.0 + a) * (1.0 + e_x) * slip + shift / (1.0 + a),
            -mu * pressed,
            mu * pressed,
        )
        left = {} if lost is None else {"v_x2": (lost - along, size)}
        if turned is not None:
            left["omega_2"] = ((along if lost is None else lost) - turned - shift, size)
        return left

    axes = [(log(0.01), log(1.5), 9), (-0.98, 0.98, 5), (-0.3, 0.3, 5)]
    return _fitted(law, axes, [log(0.5), 0.0, 0.0], [0.8, 0.5, 0.1])


def _fitted(
    law: Callable[[FloatArray], Left],
    axes: Sequence[tuple[float, float, int]],
    usual: list[float],
    widths: list[float],
) -> Misfit:
    """The least on a grid, then on ever finer grids about the best so far, since costs have kinks
    and many minima; root mean squares there.
    """

    def cost(points: FloatArray) -> FloatArray:
        prior = 0.5 * (((points - usual) / widths) ** 2).sum(axis=1)
        return np.asarray(prior + sum(_penalty(left, size) for left, size in law(points).values()))

    low, high, counts = np.array(axes).T
    points = _grid([np.linspace(*axis) for axis in axes])
    near = _grid([np.arange(-2.0, 3.0)] * len(axes))
    least = np.inf
    best = points[0]
    for k in range(7):
        values = cost(points)
        if values.min() < least:
            least = float(values.min())
            best = points[values.argmin()]
        points = np.clip(best + 0.45 ** (k + 1) * (high - low) / (counts - 1.0) * near, low, high)
    return least, {
        name: float(np.sqrt(np.mean(left**2))) for name, (left, _) in law(best[None]).items()
    }


def _penalty(left: FloatArray, size: FloatArray | float) -> FloatArray:
    """Of residuals (points, impacts) beside the size of what they belong to, (points,)."""
    share = np.minimum(np.abs(left) / np.maximum(size, 1e-12), 1e6) / _FLOOR
    return np.asarray(np.log1p(share * share).sum(axis=1))


def _grid(axes: Sequence[FloatArray]) -> FloatArray:
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
