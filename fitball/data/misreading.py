"""`doubts`: readings that explain a table far better; repeated rows.

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
from dataclasses import dataclass, field, replace
from itertools import combinations, product
from math import comb, log
from typing import TypeAlias

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.display_units import PLAIN
from fitball.base.errors import Note
from fitball.base.text import listed
from fitball.base.units import factor_of
from fitball.base.values import Ball, FloatArray, IntArray
from fitball.data.kinematics import Columns
from fitball.data.table import ImpactTable

# The next five are measured on 138 tables read well and 63 misread ones of 23 designs
# (tests/test_misreading.py).
# Log likelihood by which another reading must be better in all.
_LEAST_GAIN = 10.0
# Log likelihood by which it must be better for each row.
_LEAST_GAIN_OF_ROW = 2.0
# Misfit of a row up to which a reading describes a table.
_MOST_MISFIT_OF_ROW = 6.0
# Misfit of a row that is seldom exceeded where a table is read well.
_SELDOM_MISFIT_OF_ROW = 3.0
# The gain of signs chosen row by row, beyond the cost of the choice.
_LEAST_GAIN_OF_SIGNS = 5.0
# Readings are named beside the best one if they are no more than this worse in all.
_TIED_WITHIN = 3.0
# They may be worse by this for each row besides.
_TIED_WITHIN_OF_ROW = 0.1
# Most readings that are named.
_NAMED_READINGS = 3
# Share of the motion: a misfit that says nothing, since no ball obeys the laws better.
_SHARE_OF_NO_WEIGHT = 0.05
# Share of the motion across the court: motion along it that says little, as of a ball that is
# dropped.
_LEAST_SHARE_ALONG = 0.2
# Rows that are looked at: more change no answer.
_MOST_ROWS = 60
# Complete rows that are enough to look at these alone.
_LEAST_ROWS = 6
# Numbers beyond this [SI] are cut off: a table that is refused may have any number in it.
_LARGEST_NUMBER = 1e6
# A table of fewer columns may repeat rows by chance.
_REPEATING_COLUMNS = 4
# Groups of repeated rows that are named.
_NAMED_REPEATS = 4
# A possible restitution has a median from and to: of a ball in sand it is some hundredths.
_POSSIBLE_RESTITUTIONS = (0.03, 1.0)
# A usual one, of balls on courts. Golf balls on turf have 0.1 to 0.3.
_USUAL_RESTITUTIONS = (0.3, 1.0)
# Log likelihood that a reading with a lower one must make up for where that at hand is usual.
_COST_OF_UNUSUAL = 10.0
# Angles whose numbers are all below this [deg] are in radians.
_MOST_RADIANS = np.pi / 2.0
# Restitution that stands in for v_y2 where it was not measured.
_USUAL_RESTITUTION = 0.75
# The motion along the court that a misfit is a share of: this quantile over the rows.
_SIZE_QUANTILE = 0.75
# Rounds that find signs and offset: more change nothing.
_SIGN_ROUNDS = 3
# Ever finer grids about the best point.
_REFINEMENTS = 7
# By how much each grid is finer than the one before.
_FINER = 0.45
# Units that people measure balls in; a table in others says so.
_USUAL_UNITS = {
    "m/s": ("m/s", "km/h", "mph", "ft/s"),
    "rad/s": ("rad/s", "rpm", "rev/s", "deg/s"),
    "rad": ("deg", "rad"),
}

# By rebound column what a law leaves (points, impacts) [m/s], and the size of the motion [m/s] of
# which that is a share.
Residuals: TypeAlias = Mapping[str, tuple[FloatArray, FloatArray | float]]
# A misfit, and the root mean square that each law leaves [m/s].
Misfit: TypeAlias = tuple[float, dict[str, float]]


@dataclass(frozen=True, eq=False)
class Doubt:
    """Another reading of a table.

    `columns` are then in SI; `flip` names columns to flip, `swaps` those that are exchanged,
    `units` has other units by column; `remedy` says what else to do if the reading is meant; `kind`
    is what it changes, `cost` that of what it chooses row by row, `gain` its gain in log
    likelihood.
    """

    words: str
    columns: Columns
    kind: str
    flip: tuple[str, ...] = ()
    swaps: tuple[tuple[str, str], ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    remedy: str = ""
    cost: float = 0.0
    gain: float = 0.0

    @property
    def said(self) -> str:
        """The reading without its remedy."""
        gain = PLAIN.number(self.gain)
        return f"with {self.words} a quick fit is far better (log likelihood +{gain})"


def doubts(table: ImpactTable, ball: Ball) -> tuple[Doubt, ...]:
    """Readings that explain a table far better than its header does, the best first; empty if no
    reading does.
    """
    units = {}
    for read in table.read:
        for pair in filter(None, read.get("units", "").split(",")):
            name, unit = pair.split("=")
            units[name] = unit
    return better_readings(table.values, units, ball)


def better_readings(columns: Columns, units: Mapping[str, str], ball: Ball) -> tuple[Doubt, ...]:
    """Readings that explain columns [SI] far better than their header does, the best first. `units`
    are those of the header, SI where it has none. The columns may be of a table that is refused.
    """
    columns = _complete_rows(columns)
    count = len(next(iter(columns.values()))) if columns else 0
    before = misfit(columns, ball) if count > 1 else (0.0, {})
    as_read, _ = before
    if as_read < _LEAST_GAIN_OF_SIGNS:
        return ()
    least = max(_LEAST_GAIN, _LEAST_GAIN_OF_ROW * count)
    usual = _restitution_within(columns, *_USUAL_RESTITUTIONS)
    readings = _weighed(_readings(columns, units, ball), before, usual, ball)
    best = max([0.0, *(reading.gain for reading in readings)])
    if as_read - best > _SELDOM_MISFIT_OF_ROW * count:
        # Two things may be wrong; that is said only where it is much better than one.
        for pair in _weighed(_pairs_of_changes(columns, units), before, usual, ball):
            if pair.gain > best + least:
                readings.append(pair)
    if not readings:
        return ()
    readings.sort(key=lambda reading: -reading.gain)
    first = readings[0]
    needed = _LEAST_GAIN_OF_SIGNS if first.cost else least
    if first.gain < needed or as_read - first.gain > _MOST_MISFIT_OF_ROW * count:
        return ()
    tied = first.gain - _TIED_WITHIN - _TIED_WITHIN_OF_ROW * count
    return tuple(reading for reading in readings if reading.gain >= tied)[:_NAMED_READINGS]


def _complete_rows(columns: Columns) -> Columns:
    """At most 60 rows of columns that have a unit and no gaps; columns with most gaps are left out
    where too few rows are complete.
    """
    columns = {
        name: np.clip(values, -_LARGEST_NUMBER, _LARGEST_NUMBER)
        for name, values in columns.items()
        if COLUMNS[name].unit in _USUAL_UNITS and not COLUMNS[name].gap
    }
    while columns:
        finite = np.all([np.isfinite(values) for values in columns.values()], axis=0)
        complete = np.flatnonzero(finite)
        gaps = {name: int(np.isnan(values).sum()) for name, values in columns.items()}
        if len(complete) >= _LEAST_ROWS or not any(gaps.values()):
            break
        del columns[max(gaps, key=lambda name: gaps[name])]
    else:
        return {}
    if len(complete) > _MOST_ROWS:
        # Not at equal steps, which a table that repeats a pattern would answer with.
        complete = np.sort(np.random.default_rng(0).choice(complete, _MOST_ROWS, replace=False))
    return {name: values[complete] for name, values in columns.items()}


def repeated_rows(table: ImpactTable) -> tuple[Note, ...]:
    """A note on rows that are equal in every number; those of a drop test are by chance."""
    if len(table.values) < _REPEATING_COLUMNS:
        return ()
    columns = [np.nan_to_num(values, nan=np.inf) for values in table.values.values()]
    keys = np.column_stack(columns)
    _, first, group, counts = np.unique(
        keys,
        axis=0,
        return_index=True,
        return_inverse=True,
        return_counts=True,
    )
    repeats = sorted(np.flatnonzero(counts > 1).tolist(), key=lambda k: int(first[k]))
    if not repeats:
        return ()
    ids = np.array(table.labels["id"])
    copies = [listed(ids[group.reshape(-1) == k]) for k in repeats[:_NAMED_REPEATS]]
    text = (
        f"{len(keys) - len(counts)} of {len(keys)} rows repeat others in every number: "
        f"{'; '.join(copies)}"
    )
    return (Note("repeated-rows", f"{text}. If they are copies, delete them."),)


def _weighed(
    readings: Iterable[Doubt],
    before: Misfit,
    usual: bool,
    ball: Ball,
) -> list[Doubt]:
    """The readings that are possible and halve the residuals of at least one column, with gains.
    One that makes a restitution unusual that is `usual` as read has a cost.

    The gain alone is not enough: of balls that graze the court, whose restitution is mostly noise,
    shares of other motions may fall where nothing is explained.
    """
    cost_before, rms_before = before
    weighed = list[Doubt]()
    for reading in readings:
        if not _is_possible(reading.columns):
            continue
        cost, rms = misfit(reading.columns, ball)
        if usual and not _restitution_within(reading.columns, *_USUAL_RESTITUTIONS):
            if "m/s" in reading.kind.split("+"):
                # Two ends in two units are said by their restitution alone.
                continue
            cost += _COST_OF_UNUSUAL
        if any(rms[name] < 0.5 * rms_before[name] for name in rms_before if name in rms):
            weighed.append(replace(reading, gain=cost_before - reading.cost - cost))
    return weighed


# ---- other readings


def _readings(columns: Columns, units: Mapping[str, str], ball: Ball) -> Iterator[Doubt]:
    """Other readings of these columns that make sense."""
    yield from _with_other_signs(columns)
    yield from _with_topspin_positive(columns)
    yield from _in_units(columns, units)
    yield from _swapped(columns)
    unsigned = []
    for name in ("omega_1", "omega_2"):
        spins = columns.get(name)
        if spins is None or not np.any(spins):
            continue
        if np.all(spins >= 0.0) or np.all(spins <= 0.0):
            unsigned.append(name)
    for names in _singles_and_pairs(unsigned):
        yield from _signed(columns, names, ball)


def _pairs_of_changes(columns: Columns, units: Mapping[str, str]) -> Iterator[Doubt]:
    """Two changes at once: signs and something else, or units of two quantities."""
    for first in (*_with_other_signs(columns), *_in_units(columns, units)):
        for second in (*_with_other_signs(first.columns), *_in_units(first.columns, units)):
            kinds = (first.kind, second.kind)
            if first.kind < second.kind and ("sign" in kinds or "zero" not in kinds):
                words = f"{first.words} and {second.words}"
                flip = (*first.flip, *second.flip)
                other_units = {**first.units, **second.units}
                kind = "+".join(kinds)
                yield Doubt(words, second.columns, kind, flip, units=other_units)


def _singles_and_pairs(names: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Each name, then each pair of names."""
    yield from combinations(names, 1)
    yield from combinations(names, 2)


def _with_other_signs(columns: Columns) -> Iterator[Doubt]:
    """Signs, of two columns at most, since more are the mirror image of fewer; angles from the
    normal.
    """
    signed = list[str]()
    for name in ("omega_1", "omega_2", "v_x1", "v_x2"):
        if name in columns and np.any(columns[name]):
            signed.append(name)
    negated = [*_singles_and_pairs(signed)]
    if "v_y1" in columns and np.all(columns["v_y1"] < 0.0):
        negated.append(("v_y1",))
    for names in negated:
        turned = {**columns, **{name: -columns[name] for name in names}}
        yield Doubt(f"{listed(names)} negated", turned, "sign", names)
    angles = list[str]()
    for name in ("theta_1", "theta_2"):
        # Numbers that are radians would all be near the normal.
        if name in columns and np.any(np.degrees(columns[name]) > _MOST_RADIANS):
            angles.append(name)
    for names in _singles_and_pairs(angles):
        turned = {**columns, **{name: np.pi / 2.0 - columns[name] for name in names}}
        yield Doubt(f"{listed(names)} measured from the normal", turned, "zero", names)


def _with_topspin_positive(columns: Columns) -> Iterator[Doubt]:
    """Spins whose sign is that of topspin to whichever side a ball flies, where balls fly to
    both.
    """
    v_x1 = motion(columns).get("v_x1", np.zeros(1))
    names = [name for name in ("omega_1", "omega_2") if np.any(columns.get(name, 0.0))]
    if not (v_x1.min() < 0.0 < v_x1.max() and names):
        return
    side = np.where(v_x1 < 0.0, -1.0, 1.0)
    turned = {**columns, **{name: side * columns[name] for name in names}}
    words = f"topspin positive in {listed(names)} of balls that fly towards negative v_x"
    remedy = f"change the signs of {listed(names)} in these rows"
    yield Doubt(words, turned, "side", remedy=remedy)


def _in_units(columns: Columns, units: Mapping[str, str]) -> Iterator[Doubt]:
    """One quantity in another unit, at both ends or, where spins show it, at one."""
    for si, symbols in _USUAL_UNITS.items():
        every = tuple(name for name in columns if COLUMNS[name].unit == si)
        sets = [every]
        if "omega_2" in columns:
            sets.append(tuple(name for name in every if name.endswith("1")))
            sets.append(tuple(name for name in every if name.endswith("2")))
        for names, symbol in product(dict.fromkeys(sets), symbols):
            stated = {name: units.get(name, si) for name in names}
            if not names or symbol in stated.values():
                continue
            factor = factor_of(symbol, si)
            meant = dict(columns)
            for name, unit in stated.items():
                meant[name] = columns[name] * (factor / factor_of(unit, si))
            instead = listed(dict.fromkeys(stated.values()))
            words = f"{listed(names)} in {symbol} instead of {instead}"
            yield Doubt(words, meant, si, units=dict.fromkeys(names, symbol))


def _swapped(columns: Columns) -> Iterator[Doubt]:
    """Incidence and rebound, all columns or, where spins show it, one; components of one end or of
    both.
    """
    ends = list[tuple[str, str]]()
    for name in columns:
        other = f"{name[:-1]}2"
        if name[-1] == "1" and other in columns:
            ends.append((name, other))
    components = list[tuple[str, str]]()
    for end in "12":
        if f"v_x{end}" in columns and f"v_y{end}" in columns:
            components.append((f"v_x{end}", f"v_y{end}"))
    swaps: list[tuple[tuple[str, str], ...]] = [tuple(ends)]
    if "omega_2" in columns:
        swaps += combinations(ends, 1)
    swaps += [*combinations(components, 1), tuple(components)]
    for pairs in filter(None, dict.fromkeys(swaps)):
        other_of = dict(pairs) | {second: first for first, second in pairs}
        swapped = {other_of.get(name, name): values for name, values in columns.items()}
        words = f"{listed(f'{first} and {second}' for first, second in pairs)} swapped"
        yield Doubt(words, swapped, "name", swaps=pairs)


def _signed(columns: Columns, names: Sequence[str], ball: Ball) -> Iterator[Doubt]:
    """Signs of spins that were not written, chosen row by row so that angular momentum is kept
    best.
    """
    ways = list[dict[str, float]]()
    moved = []
    for signs_of_way in product((1.0, -1.0), repeat=len(names)):
        way = dict(zip(names, signs_of_way, strict=True))
        spins = {name: sign * columns[name] for name, sign in way.items()}
        ways.append(way)
        moved.append(motion({**columns, **spins}))
    if not {"v_x1", "v_y1", "v_x2", "omega_2"} <= moved[0].keys():
        return
    chosen = _best_signs(moved, ball)
    signs = {name: np.array([way[name] for way in ways])[chosen] for name in names}
    changed = [(signs[name] < 0.0)[columns[name] != 0.0] for name in names]
    any_in_each = all(rows.any() for rows in changed)
    if not any_in_each or all(rows.all() for rows in changed):
        return
    # Which rows were chosen: how many, all counts as likely, and which, all sets of so many.
    cost = 0.0
    for rows in changed:
        sets = comb(len(rows), int(rows.sum()))
        cost += log(sets * (len(rows) + 1.0))
    remedy = (
        "write backspin with a minus sign (leave unknown omega_2 empty, delete rows with "
        "unknown omega_1)"
    )
    restored = {**columns, **{name: signs[name] * columns[name] for name in names}}
    words = f"missing signs of {listed(names)} restored"
    yield Doubt(words, restored, "signs", remedy=remedy, cost=cost)


def _best_signs(moved: Sequence[Columns], ball: Ball) -> IntArray:
    """By row (impacts,) which of several motions keeps angular momentum best."""
    turn = ball.inertia_ratio * ball.radius
    lost = []
    for motion_of in moved:
        spun = turn * (motion_of["omega_2"] - motion_of["omega_1"])
        side = np.where(motion_of["v_x1"] < 0.0, -1.0, 1.0)
        lost.append(side * (motion_of["v_x1"] - motion_of["v_x2"] - spun))
    pressed = np.maximum(moved[0]["v_y1"] + moved[0].get("v_y2", 0.0), 1e-9)
    per_impulse = np.array(lost) / pressed
    offset = 0.0
    # The offset of the normal force is that of the signs found with the one before.
    for _ in range(_SIGN_ROUNDS):
        chosen = np.argmin(np.abs(per_impulse - offset), axis=0)
        offset = float(np.median(np.take_along_axis(per_impulse, chosen[None], 0)))
    return np.asarray(chosen)


# ---- the laws of an impulse


def motion(columns: Columns) -> dict[str, FloatArray]:
    """The columns and the components [m/s] that speeds and angles determine; incident spin [rad/s]
    is zero where it was not measured.
    """
    moved = {"omega_1": np.zeros(len(next(iter(columns.values())))), **columns}
    for end in "12":
        if f"v_{end}" in columns and f"theta_{end}" in columns:
            speed = columns[f"v_{end}"]
            angle = columns[f"theta_{end}"]
            moved[f"v_x{end}"] = speed * np.cos(angle)
            moved[f"v_y{end}"] = speed * np.sin(angle)
    return moved


def _restitution_within(columns: Columns, least: float, most: float) -> bool:
    """Whether the median v_y2/v_y1 is from `least` to `most`, or does not follow from the
    columns.
    """
    moved = motion(columns)
    if not {"v_y1", "v_y2"} <= moved.keys():
        return True
    # Not as quotients, which may be by zero.
    low, high = (np.median(moved["v_y2"] - share * moved["v_y1"]) for share in (least, most))
    return bool(low >= 0.0 >= high)


def _is_possible(columns: Columns) -> bool:
    """Whether a reading says nothing absurd by itself: a restitution that no ball has, an angle
    below the court.
    """
    if not _restitution_within(columns, *_POSSIBLE_RESTITUTIONS):
        return False
    angles = [values for name, values in columns.items() if name.startswith("theta")]
    return all(bool(np.all((values > 0.0) & (values < np.pi))) for values in angles)


def misfit(columns: Columns, ball: Ball) -> Misfit:
    """The misfit of the laws of an impulse at their best fit to columns [SI], in natural units of
    log likelihood, priors included; and root mean squares of the residuals by column [m/s].
    """
    moved = motion(columns)
    cost = 0.0
    rms = dict[str, float]()
    if "v_y1" in moved and "v_y2" in moved:
        of_law, rms_of_law = _restitution_misfit(moved)
        cost += of_law
        rms |= rms_of_law
    if "v_x1" in moved and "v_y1" in moved and ("v_x2" in moved or "omega_2" in moved):
        of_law, rms_of_law = _tangential_misfit(moved, ball)
        cost += of_law
        rms |= rms_of_law
    return cost, rms


def _restitution_misfit(moved: Columns) -> Misfit:
    """Misfit of v_y2/v_y1 as a line in the speed; points are its value at the median and its slope
    over the relative speed.
    """
    v_1 = moved["v_y1"]
    v_2 = moved["v_y2"]
    middle = max(float(np.median(np.abs(v_1))), 1e-12)
    from_middle = np.clip(v_1 / middle - 1.0, -2.0, 2.0)

    def law(points: FloatArray) -> Residuals:
        expected = np.clip(points[:, :1] + points[:, 1:] * from_middle, 0.02, 1.1) * v_1
        return {"v_y2": (v_2 - expected, np.abs(expected))}

    axes = [(0.05, 1.0, 15), (-0.6, 0.6, 7)]
    return _least_misfit(law, axes, usual=[_USUAL_RESTITUTION, 0.0], widths=[0.2, 0.2])


def _tangential_misfit(moved: Columns, ball: Ball) -> Misfit:
    """Misfit of grip and slip and of angular momentum; points are log mu, tangential restitution
    and offset of the normal force.
    """
    a = ball.inertia_ratio
    radius = ball.radius
    v_1 = moved["v_y1"]
    pressed = np.maximum(v_1 + moved.get("v_y2", _USUAL_RESTITUTION * v_1), 1e-9)
    ahead = np.where(moved["v_x1"] < 0.0, -pressed, pressed)
    slip = moved["v_x1"] - radius * moved["omega_1"]
    lost = None
    turned = None
    squares = []
    if "v_x2" in moved:
        lost = moved["v_x1"] - moved["v_x2"]
        squares.append(lost**2)
    if "omega_2" in moved:
        turned = a * radius * (moved["omega_2"] - moved["omega_1"])
        squares.append(turned**2)
    along = float(np.quantile(np.sqrt(np.mean(squares, axis=0)), _SIZE_QUANTILE))
    size = max(along, _LEAST_SHARE_ALONG * float(np.median(pressed)))

    def law(points: FloatArray) -> Residuals:
        most = np.exp(points[:, :1]) * pressed
        e_x = points[:, 1:2]
        # Ahead, to whichever side the ball flies.
        shift = points[:, 2:] * ahead
        grip = a / (1.0 + a) * (1.0 + e_x) * slip + shift / (1.0 + a)
        expected = np.clip(grip, -most, most)
        residuals: dict[str, tuple[FloatArray, float]] = {}
        if lost is not None:
            residuals["v_x2"] = (lost - expected, size)
        if turned is not None:
            impulse = expected if lost is None else lost
            residuals["omega_2"] = (impulse - turned - shift, size)
        return residuals

    # Of log mu, tangential restitution and offset.
    axes = [
        (log(0.01), log(1.5), 9),
        (-0.98, 0.98, 5),
        (-0.3, 0.3, 5),
    ]
    return _least_misfit(law, axes, usual=[log(0.5), 0.0, 0.0], widths=[0.8, 0.5, 0.1])


def _least_misfit(
    law: Callable[[FloatArray], Residuals],
    axes: Sequence[tuple[float, float, int]],
    usual: list[float],
    widths: list[float],
) -> Misfit:
    """The least cost of a law on a grid, then on ever finer grids about the best so far, since
    costs have kinks and many minima; root mean squares there. `axes` are least, most and count of
    each parameter, `usual` and `widths` its prior.
    """

    def cost(points: FloatArray) -> FloatArray:
        prior = 0.5 * (((points - usual) / widths) ** 2).sum(axis=1)
        penalties = sum(_penalty(rest, size) for rest, size in law(points).values())
        return np.asarray(prior + penalties)

    low, high, counts = np.array(axes).T
    points = _grid([np.linspace(*axis) for axis in axes])
    near = _grid([np.arange(-2.0, 3.0)] * len(axes))
    least = np.inf
    best = points[0]
    for k in range(_REFINEMENTS):
        values = cost(points)
        if values.min() < least:
            least = float(values.min())
            best = points[values.argmin()]
        finer = best + _FINER ** (k + 1) * (high - low) / (counts - 1.0) * near
        points = np.clip(finer, low, high)
    rms = {}
    for name, (rest, _) in law(best[None]).items():
        rms[name] = float(np.sqrt(np.mean(rest**2)))
    return least, rms


def _penalty(residuals: FloatArray, size: FloatArray | float) -> FloatArray:
    """Costs (points,) of residuals (points, impacts) beside the size of what they belong to."""
    share = np.minimum(np.abs(residuals) / np.maximum(size, 1e-12), 1e6) / _SHARE_OF_NO_WEIGHT
    return np.asarray(np.log1p(share * share).sum(axis=1))


def _grid(axes: Sequence[FloatArray]) -> FloatArray:
    """All points (points, axes) of a grid."""
    grid = np.meshgrid(*axes, indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, len(axes))
