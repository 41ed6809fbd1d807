"""Rows that repeat to the last printed digit: copies, where rounding and scatter do not explain them.

Two impacts of one incident state, as printed, have the same rebound when each measured column falls into the same
unit of its last digit: by chance with a probability of at most `u/s` for a unit `u` and a scatter `s` (the density of
the difference of two normal variates is at most `0.28/s`; the rest is a margin). The pairs of rows with one incident
state, were all rows impacts of their own, make so many repeats: few in tracked impacts, many in drop tests.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import exp

import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import LABELS
from fitball.data.laws import chosen_rows, misfit, motion_of
from fitball.data.misreading import columns_of
from fitball.data.table import ImpactTable
from fitball.values import Ball, FloatArray

# Chance of so many repeated rows below which they are copies.
UNLIKELY = 1e-4
# Different rows by which a scatter is judged, at least; and rows of one kind that are named, groups of them.
LEAST, NAMED = 4, 3
# Units of the last digit within which rows are nearly the same.
NEAR = 10.0


def repeats_of(table: ImpactTable, ball: Ball) -> tuple[str | None, str | None]:
    """What there is to say of rows that are copies of others, and of rows that nearly are; None where chance explains
    them, or where the table does not say how it was printed.
    """
    exact = _said(table, ball, 1.0)
    if exact is not None:
        return f"{exact}: delete the copies", None
    near = _said(table, ball, NEAR)
    return None, None if near is None else f"{near}; are they the same impacts?"


def _said(table: ImpactTable, ball: Ball, units: float) -> str | None:
    columns = columns_of(table)
    # A table that was put together from another, and not read, may have rows of it twice on purpose.
    if not columns.keys() <= table.resolution.keys() or len(table.rows) != len(table):
        return None
    steps = {name: 2.0 * units * table.resolution[name] for name in columns}
    labels = [np.unique(table.labels[name], return_inverse=True)[1] for name in LABELS if name in table.labels]
    near = steps if units > 1.0 else dict.fromkeys(steps)
    keys = np.column_stack([*(_step(values, near[name]) for name, values in columns.items()), *labels])
    before = [k for k, name in enumerate(columns) if name.endswith("1")]
    before += range(len(columns), keys.shape[1])
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    group = group.reshape(-1)
    count = len(table) - len(first)
    if not count or len(first) < LEAST:
        return None
    once = {name: values[first] for name, values in columns.items()}
    _, alike = np.unique(keys[:, before], axis=0, return_counts=True)
    pairs = max(1.0, float(np.sum(alike * (alike - 1.0)) / 2.0))
    expected = pairs * _chance(once, steps, ball)
    if _at_least(count, expected) >= UNLIKELY:
        return None
    sizes = np.bincount(group)
    shared = [k for k in group[np.sort(first)].tolist() if sizes[k] > 1]
    places = [np.flatnonzero(group == k) for k in shared[:NAMED]]
    named = "; ".join(_rows(table, place) for place in places)
    more = len(shared) - len(places)
    how = "to the last printed digit" if units == 1.0 else f"to {units:g} units of the last printed digit"
    return (
        f"{count} of {len(table)} rows repeat others {how}; by rounding and scatter {_few(expected)} would. Rows "
        f"{named}{f'; and {more} more groups' if more else ''}"
    )


def _few(expected: float) -> str:
    return f"{expected:.1g}" if expected >= 1e-3 else "fewer than 0.001"


def _rows(table: ImpactTable, places: NDArray[np.int64]) -> str:
    rows = [str(table.rows[k]) for k in places[:6].tolist()]
    return f"{', '.join(rows)}{', ...' if len(places) > len(rows) else ''}"


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
    if len(rows) < LEAST:
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
