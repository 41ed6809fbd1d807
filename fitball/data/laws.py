"""A quick fit of the laws of an impulse on a round body to a table, for any ball, and its misfit. These laws also
find missing signs of spins, spins too fast for a camera, and rows that are copies.

With slip `u = v_x1 - R omega_1`, `a = I/(M R^2)` and the measured normal impulse per mass `s = v_y1 + v_y2`, the
speed lost along the court is `a/(1 + a) ((1 + e_x) u + D s/(a R))` in a grip, at most `mu s` (Walton 1993; Foerster
et al. 1994; Cross 2002); about the contact point angular momentum is kept, `(v_x1 - v_x2) - a R (omega_2 - omega_1) =
D s/R` (see `data.balances`): speeds say what the spin gained, on any court; and `v_y2/v_y1` is a line in the speed.
Three laws, five numbers: `mu`, `e_x`, `D/R`, and the line. Misfits are shares of the motion that they are compared
with, so that no unit looks better than another because its numbers are smaller. No noise is known before a fit: a
misfit counts by its logarithm, as in the density of Cauchy's distribution, which a few outliers do not move.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from itertools import combinations, product
from math import comb, exp

import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import LABELS
from fitball.data.kinematics import Uncertain, velocity
from fitball.data.table import ImpactTable
from fitball.values import Ball, FloatArray

Columns = Mapping[str, FloatArray]
# Rows that are looked at: as many show any error of a whole column, and the time stays a fraction of a second.
MOST_ROWS = 60
_ABSURD = 1e9


@dataclass(frozen=True)
class Motion:
    """Incident (1) and rebound (2) motion, each (impacts,) in m/s and rad/s; None if undetermined.

    `contradictions` (impacts,) are differences between columns that say the same thing twice, as shares of the speed.
    """

    v_x1: FloatArray | None
    v_y1: FloatArray | None
    omega_1: FloatArray | None
    v_x2: FloatArray | None
    v_y2: FloatArray | None
    omega_2: FloatArray | None
    contradictions: tuple[FloatArray, ...] = ()

    def __eq__(self, other: object) -> bool:
        """Whether all numbers are the same."""
        if not isinstance(other, Motion):
            return NotImplemented
        mine, theirs = ([getattr(item, field.name) for field in fields(Motion)[:-1]] for item in (self, other))
        pairs = [*zip(mine, theirs, strict=True), *zip(self.contradictions, other.contradictions, strict=True)]
        return all(
            (one is None and two is None)
            or (one is not None and two is not None and np.allclose(one, two, rtol=1e-9, atol=1e-12))
            for one, two in pairs
        )

    __hash__ = None  # type: ignore[assignment]


def chosen_rows(columns: Columns) -> NDArray[np.int64]:
    """Rows to look at: those in which every number is finite, evenly picked where there are many."""
    finite = np.flatnonzero(np.all([np.isfinite(values) for values in columns.values()], axis=0))
    if len(finite) <= MOST_ROWS:
        return finite
    # Not at equal steps, which a table that repeats a pattern would answer with.
    return np.sort(np.random.default_rng(0).choice(finite, MOST_ROWS, replace=False))


def motion_of(columns: Columns) -> Motion:
    """The motion that columns [SI] of whole tables describe."""
    known = {name: Uncertain.exact(values) for name, values in columns.items()}
    before, after = velocity(known, "1"), velocity(known, "2")
    incident, rebound = ([_finite(item) for item in (end.x, end.y)] for end in (before, after))
    doubled = tuple(item for end in ("1", "2") for item in _contradictions(columns, end))
    return Motion(
        incident[0], incident[1], columns.get("omega_1"), rebound[0], rebound[1], columns.get("omega_2"), doubled
    )


def _finite(quantity: Uncertain | None) -> FloatArray | None:
    """Numbers, those that the columns do not determine (a speed from a component at right angles) absurdly large."""
    if quantity is None:
        return None
    return np.nan_to_num(quantity.value, nan=_ABSURD, posinf=_ABSURD, neginf=-_ABSURD)


def _contradictions(columns: Columns, end: str) -> list[FloatArray]:
    x, y, speed, angle = (columns.get(f"{name}{end}") for name in ("v_x", "v_y", "v_", "theta_"))
    if x is None or y is None:
        return []
    own = np.hypot(x, y)
    size = np.maximum(own, 1e-12)
    found = [] if speed is None else [(speed - own) / size]
    if angle is not None:
        along, across = np.cos(angle), np.sin(angle)
        found.append((x * across - y * along) / size)
    return found


# Misfit, as a share of the motion it is compared with, below which it says nothing: no ball obeys the laws better.
FLOOR = 0.05
# Motion along the court, as a share of that across it, with which misfits along it are compared at least.
LEAST = 0.2
# What balls and courts are like: medians or means, and widths, of the priors; far looser than any one ball's.
_FRICTION, _FRICTION_WIDTH, _FRICTION_RANGE = 0.5, 0.8, (0.01, 1.5)
_TANGENTIAL_WIDTH, _TANGENTIAL_RANGE = 0.5, (-0.98, 0.98)
_OFFSET_WIDTH, _OFFSET_RANGE = 0.1, (-0.3, 0.3)
_RESTITUTION, _RESTITUTION_WIDTH, _RESTITUTION_RANGE = 0.75, 0.2, (0.05, 1.0)
_SLOPE_WIDTH, _SLOPE_RANGE = 0.2, (-0.6, 0.6)
# Restitution where the rebound speed was not measured.
_TYPICAL_RESTITUTION = 0.75
_ROUNDS, _SHRINK = 6, 0.45


@dataclass(frozen=True)
class Misfit:
    """What the best fit leaves: `cost` in natural units of log likelihood, priors included, over `rows` impacts.

    `residuals` maps `v_x2`, `v_y2` [m/s] and `omega_2` [rad/s] to root mean squares, where the table has them;
    `contradiction` is that of columns which say the same twice, as a share of the speed.
    """

    cost: float
    rows: int
    residuals: Mapping[str, float]
    contradiction: float


def misfit(motion: Motion, ball: Ball) -> Misfit:
    """Fit the laws to a motion; returns the residuals."""
    rows = next(len(item) for item in (motion.v_y1, motion.v_y2, motion.v_x1, motion.v_x2) if item is not None)
    residuals = dict[str, float]()
    cost = sum((float(np.sum(_penalty(share))) for share in motion.contradictions), 0.0)
    if motion.v_y1 is not None and motion.v_y2 is not None:
        cost += _restitution(motion.v_y1, motion.v_y2, residuals)
    if motion.v_x1 is not None and not (motion.v_x2 is None and motion.omega_2 is None):
        cost += _tangential(motion, ball, residuals)
    return Misfit(cost, rows, residuals, max(map(_rms, motion.contradictions), default=0.0))


def _penalty(share: FloatArray) -> FloatArray:
    with np.errstate(over="ignore"):
        logarithm: FloatArray = np.log1p(np.minimum((share / FLOOR) ** 2, 1e12))
    return logarithm


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _restitution(v_y1: FloatArray, v_y2: FloatArray, residuals: dict[str, float]) -> float:
    size = max(float(np.median(np.abs(v_y1))), 1e-12)
    from_middle = np.clip(v_y1 / size - 1.0, -2.0, 2.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(v_y2 / v_y1, nan=1e3, posinf=1e3, neginf=-1e3)

    def line(points: FloatArray) -> FloatArray:
        return np.clip(points[:, :1] + points[:, 1:] * from_middle, 0.02, 1.1)

    def cost(points: FloatArray) -> FloatArray:
        predicted = line(points)
        prior = ((points[:, 0] - _RESTITUTION) / _RESTITUTION_WIDTH) ** 2 + (points[:, 1] / _SLOPE_WIDTH) ** 2
        total: FloatArray = _penalty((ratio - predicted) / predicted).sum(axis=1) + 0.5 * prior
        return total

    best, least = _search(cost, (_RESTITUTION_RANGE, _SLOPE_RANGE), (15, 7))
    residuals["v_y2"] = _rms(v_y2 - line(best[None])[0] * v_y1)
    return least


def _tangential(motion: Motion, ball: Ball, residuals: dict[str, float]) -> float:
    assert motion.v_x1 is not None and motion.v_y1 is not None
    a, radius = ball.inertia_ratio, ball.radius
    zero = np.zeros_like(motion.v_x1)
    rebound = _TYPICAL_RESTITUTION * motion.v_y1 if motion.v_y2 is None else motion.v_y2
    pressed = np.maximum(motion.v_y1 + rebound, 1e-9)
    spin = zero if motion.omega_1 is None else motion.omega_1
    slip = motion.v_x1 - radius * spin
    lost = None if motion.v_x2 is None else motion.v_x1 - motion.v_x2
    turned = None if motion.omega_2 is None else a * radius * (motion.omega_2 - spin)
    parts = [item**2 for item in (lost, turned) if item is not None]
    # Motion along the court that is small beside that across it says little: a dropped ball's is noise.
    size = max(float(np.quantile(np.sqrt(np.mean(parts, axis=0)), 0.75)), LEAST * float(np.median(pressed)), 1e-9)

    def predicted(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Speed lost, and what of it does not turn the ball."""
        friction, e_x, offset = (np.exp(points[:, :1]), points[:, 1:2], points[:, 2:])
        grip = a / (1.0 + a) * (1.0 + e_x) * slip + offset / (1.0 + a) * pressed
        limit = friction * pressed
        return np.clip(grip, -limit, limit), offset * pressed

    def cost(points: FloatArray) -> FloatArray:
        loss, shift = predicted(points)
        total = np.zeros(len(points))
        if lost is not None:
            total += _penalty((lost - loss) / size).sum(axis=1)
            if turned is not None:
                total += _penalty((lost - turned - shift) / size).sum(axis=1)
        elif turned is not None:
            total += _penalty((turned + shift - loss) / size).sum(axis=1)
        prior = ((points[:, 0] - np.log(_FRICTION)) / _FRICTION_WIDTH) ** 2
        prior += (points[:, 1] / _TANGENTIAL_WIDTH) ** 2 + (points[:, 2] / _OFFSET_WIDTH) ** 2
        whole: FloatArray = total + 0.5 * prior
        return whole

    low, high = _FRICTION_RANGE
    ends = ((float(np.log(low)), float(np.log(high))), _TANGENTIAL_RANGE, _OFFSET_RANGE)
    best, least = _search(cost, ends, (13, 7, 7))
    loss, shift = (item[0] for item in predicted(best[None]))
    if lost is not None:
        residuals["v_x2"] = _rms(lost - loss)
    if turned is not None:
        residuals["omega_2"] = _rms(turned - loss + shift) / (a * radius)
    return least


def _search(
    cost: Callable[[FloatArray], FloatArray], ends: Sequence[tuple[float, float]], counts: Sequence[int]
) -> tuple[FloatArray, float]:
    """The best point of a grid, then of ever finer grids about the best so far: costs have kinks and many minima."""
    axes = [np.linspace(low, high, count) for (low, high), count in zip(ends, counts, strict=True)]
    steps = np.array([axis[1] - axis[0] for axis in axes])
    points = _grid(axes)
    values = cost(points)
    best, least = points[np.argmin(values)], float(np.min(values))
    low, high = np.array(ends).T
    for _ in range(_ROUNDS):
        steps = steps * _SHRINK
        near = _grid([np.arange(-2, 3) * step for step in steps]) + best
        near = np.clip(near, low, high)
        values = cost(near)
        if values.min() < least:
            best, least = near[np.argmin(values)], float(values.min())
    return best, least


def _grid(axes: Sequence[FloatArray]) -> FloatArray:
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


SPINS = ("omega_1", "omega_2")
# Chance of spins that are missing at random to be the largest so often, from which on it is said.
UNLIKELY = 1e-3


def unsigned(columns: Columns) -> Iterator[tuple[str, ...]]:
    """The spins, one or both, of which no sign may have been written: all that are not zero have the same."""
    one_way = [name for name in SPINS if name in columns and np.any(columns[name])]
    one_way = [name for name in one_way if not (np.any(columns[name] > 0.0) and np.any(columns[name] < 0.0))]
    for count in range(1, len(one_way) + 1):
        yield from combinations(one_way, count)


def signed(columns: Columns, names: Sequence[str], ball: Ball) -> Columns:
    """The columns with the signs, row by row, of the spins called `names` that keep the angular momentum best."""
    choices = [
        {**columns, **{name: sign * columns[name] for name, sign in zip(names, signs, strict=True)}}
        for signs in product((1.0, -1.0), repeat=len(names))
    ]
    offset, best = 0.0, columns
    # The offset of the normal force is that of the signs found with the one before; more rounds change nothing.
    for _ in range(3):
        motions = [motion_of(choice) for choice in choices]
        misses = [_lost(motion, ball) for motion in motions]
        pressed = _pressed(motions[0])
        if misses[0] is None or pressed is None:
            return columns
        left = np.array([np.abs(miss - offset * pressed) for miss in misses if miss is not None])
        chosen = left.argmin(axis=0)
        best = {**columns, **{name: np.choose(chosen, [choice[name] for choice in choices]) for name in names}}
        kept = np.choose(chosen, [miss for miss in misses if miss is not None])
        offset = float(np.median(kept / pressed))
    return best


def _lost(motion: Motion, ball: Ball) -> FloatArray | None:
    """Speed along the court that was lost and did not turn the ball, (impacts,) [m/s]."""
    if motion.v_x1 is None or motion.v_x2 is None or motion.omega_2 is None:
        return None
    gained = motion.omega_2 if motion.omega_1 is None else motion.omega_2 - motion.omega_1
    lost: FloatArray = motion.v_x1 - motion.v_x2 - ball.inertia_ratio * ball.radius * gained
    return lost


def _pressed(motion: Motion) -> FloatArray | None:
    """The normal impulse per mass, up to a factor where the rebound speed was not measured."""
    if motion.v_y1 is None:
        return None
    return np.maximum(motion.v_y1 if motion.v_y2 is None else motion.v_y1 + motion.v_y2, 1e-9)


def missing_above(columns: Columns, ball: Ball) -> str | None:
    """A sentence where rebound spins (NaN: not measured) are missing where speeds say that they are large; None where
    they are not, or where nobody can know.
    """
    spin = columns.get("omega_2")
    known = {name: values for name, values in columns.items() if name != "omega_2"}
    if spin is None or not np.isnan(spin).any():
        return None
    rows = chosen_rows(known)
    # Without its own column: what the ball gained in spin by the speed it lost.
    motion = motion_of({**{name: values[rows] for name, values in known.items()}, "omega_2": np.zeros(len(rows))})
    lost, pressed, measured = _lost(motion, ball), _pressed(motion), spin[rows]
    gap = np.isnan(measured)
    if lost is None or pressed is None or not gap.any() or gap.all():
        return None
    turn = ball.inertia_ratio * ball.radius
    offset = float(np.median((lost - turn * measured)[~gap] / pressed[~gap]))
    size = np.abs(lost - offset * pressed) / turn
    gaps = int(gap.sum())
    largest = int(gap[np.argsort(-size, kind="stable")[:gaps]].sum())
    ways = sum(comb(gaps, k) * comb(gap.size - gaps, gaps - k) for k in range(largest, gaps + 1))
    if ways > UNLIKELY * comb(gap.size, gaps):
        return None
    limit = float(np.max(np.abs(measured[~gap])))
    above = int((size[gap] > limit).sum())
    return (
        f"omega_2 is missing where spins are large. Speeds show that {above} of {gaps} missing spins are above "
        f"{limit:.0f} rad/s, the largest measured one. A fit assumes that values are missing at random. "
        "Measure these spins by other means (more frames, marks on the ball), or leave out all impacts with such "
        "speeds and angles"
    )


def columns_of(table: ImpactTable) -> dict[str, FloatArray]:
    """The columns of a table; of the incident ones those that it was read from."""
    impacts = table.impacts
    state = {
        "v_x1": impacts.v_x1, "v_y1": impacts.v_y1, "omega_1": impacts.omega_1,
        "v_1": impacts.speed, "theta_1": impacts.angle,
    }  # fmt: skip
    if {"v_x1", "v_y1"} <= table.units.keys():
        state = {name: state[name] for name in ("v_x1", "v_y1", "omega_1")}
    found = {name: values for name, values in state.items() if name in table.units}
    return found | {item.name: item.values for item in (*table.measurements, *table.redundant)}


# Two impacts of one incident state, as printed, have the same rebound when each measured column falls into the same
# unit of its last digit: by chance with a probability of at most `u/s` for a unit `u` and a scatter `s` (the density
# of the difference of two normal variates is at most `0.28/s`; the rest is a margin). The pairs of rows with one
# incident state, were all rows impacts of their own, make so many repeats: few in tracked impacts, many in drop
# tests. Where the chance of so many is below this, rows that repeat to the last printed digit are copies.
COPIED = 1e-4
# Different rows by which a scatter is judged, at least; and rows of one kind that are named, groups of them.
LEAST_ROWS, NAMED = 4, 3
# Units of the last digit within which rows are nearly the same.
NEAR = 10.0


def repeats_of(table: ImpactTable, ball: Ball) -> tuple[str | None, str | None]:
    """Notes on rows that are copies of others, and on rows that nearly are; None if chance explains them, or if the
    printed digits are unknown.
    """
    exact = _said([table], ball, 1.0)
    if exact is not None:
        return f"{exact}: delete the copies", None
    near = _said([table], ball, NEAR)
    return None, None if near is None else f"{near}; check whether they are the same impacts"


def copies_between(tables: Sequence[ImpactTable], ball: Ball) -> str | None:
    """A note on rows of one table that are copies of those of another, whatever their labels; None as above."""
    for one, other in combinations(tables, 2):
        # Sheets of a workbook share its digest.
        same = map(partial(np.array_equal, equal_nan=True), columns_of(one).values(), columns_of(other).values())
        if one.digest == other.digest and all(same):
            return f"{other.name} has the content of {one.name}: leave out one of them"
    found = _said(tables, ball, 1.0)
    return None if found is None else f"{found}: leave out the copies"


def _said(tables: Sequence[ImpactTable], ball: Ball, units: float) -> str | None:
    """What repeats within a table, or, of several, between them."""
    read = [(table, columns_of(table)) for table in tables]
    # A table that was put together from another, and not read, may have rows of it twice on purpose.
    read = [it for it in read if it[1].keys() <= it[0].resolution.keys() and len(it[0].rows) == len(it[0])]
    if len(read) < min(len(tables), 2):
        return None
    shared = [name for name in read[0][1] if all(name in columns for _, columns in read)]
    steps = {name: 2.0 * units * max(table.resolution[name] for table, _ in read) for name in shared}
    near = steps if units > 1.0 else dict.fromkeys(steps)
    several, parts, named = len(tables) > 1, [], []
    for table, columns in read:
        own = [np.unique(table.labels[name], return_inverse=True)[1] for name in LABELS if name in table.labels]
        labels = [] if several else own
        part = np.column_stack([*(_step(columns[name], near[name]) for name in shared), *labels])
        kept = np.sort(np.unique(part, axis=0, return_index=True)[1]) if several else np.arange(len(table))
        parts.append((part[kept], {name: columns[name][kept] for name in shared}))
        named += [f"{table.name}:{table.rows[k]}" if several else str(table.rows[k]) for k in kept.tolist()]
    keys = np.concatenate([part for part, _ in parts])
    columns = {name: np.concatenate([own[name] for _, own in parts]) for name in shared}
    before = [k for k, name in enumerate(shared) if name.endswith("1")]
    before += range(len(shared), keys.shape[1])
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    group = group.reshape(-1)
    count = len(keys) - len(first)
    if not count or len(first) < LEAST_ROWS:
        return None
    once = {name: values[first] for name, values in columns.items()}
    _, alike = np.unique(keys[:, before], axis=0, return_counts=True)
    pairs = max(1.0, float(np.sum(alike * (alike - 1.0)) / 2.0))
    expected = pairs * _chance(once, steps, ball)
    if _at_least(count, expected) >= COPIED:
        return None
    sizes = np.bincount(group)
    repeated = [k for k in group[np.sort(first)].tolist() if sizes[k] > 1]
    places = [[named[row] for row in np.flatnonzero(group == k).tolist()] for k in repeated[:NAMED]]
    groups = "; ".join(f"{', '.join(rows[:6])}{', ...' if len(rows) > 6 else ''}" for rows in places)
    more = len(repeated) - len(places)
    how = "to the last printed digit" if units == 1.0 else f"to {units:g} units of the last printed digit"
    return (
        f"{count} of {len(keys)} rows repeat others {how}; by chance {_few(expected)} would. Rows "
        f"{groups}{f'; and {more} more groups' if more else ''}"
    )


def _few(expected: float) -> str:
    return f"{expected:.1g}" if expected >= 1e-3 else "fewer than 0.001"


def _step(values: FloatArray, step: float | None) -> FloatArray:
    """Which step each value is, or the value itself; a gap is a step of its own."""
    # Digits beyond those of a double tell no more than its value.
    least = np.finfo(np.float64).eps * np.max(np.abs(np.nan_to_num(values)), initial=0.0)
    return np.nan_to_num(values if step is None or step < least else np.rint(values / step), nan=np.inf)


def _chance(columns: Mapping[str, FloatArray], steps: Mapping[str, float], ball: Ball) -> float:
    """That a rebound falls into the steps of another from the same incident state, by the scatter about the laws of
    an impulse; 1 for each column that has no such law.
    """
    rows = chosen_rows(columns)
    if len(rows) < LEAST_ROWS:
        return 1.0
    mine = {name: values[rows] for name, values in columns.items()}
    motion, widths = motion_of(mine), dict(steps)
    if motion.v_y1 is None:
        return 1.0
    if not {"v_x2", "v_y2"} & mine.keys() and {"v_2", "theta_2"} <= mine.keys():
        along, across = np.abs(np.cos(mine["theta_2"])), np.abs(np.sin(mine["theta_2"]))
        turned = mine["v_2"] * steps["theta_2"]
        widths["v_x2"] = float(np.median(along * steps["v_2"] + across * turned))
        widths["v_y2"] = float(np.median(across * steps["v_2"] + along * turned))
    left = misfit(motion, ball).residuals
    shares = [widths[name] / scatter for name, scatter in left.items() if name in widths and scatter > widths[name]]
    return float(np.prod(shares)) if shares else 1.0


def _at_least(count: int, expected: float) -> float:
    """Probability of a Poisson variate of this mean to be `count` or more; by Chernoff's bound, from above."""
    if count <= expected:
        return 1.0
    return exp(count - expected + count * float(np.log(expected / count))) if expected > 0.0 else 0.0
