"""What cameras leave out of spins: their signs, and those that are too fast for them.

About the contact point an impulse keeps the angular momentum, `(v_x1 - v_x2) - a R (omega_2 - omega_1) = D s/R` with
`a = I/(M R^2)` and the normal impulse per mass `s` (see `impulse_laws`): speeds say what the spin gained, on any
court.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, product
from math import comb

import numpy as np

from fitball.data.reading.motion import Columns, Motion, chosen_rows, motion_of
from fitball.values import Ball, FloatArray

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
        f"omega_2 is missing where spins are large: by their speeds {above} of {gaps} that are missing are above "
        f"{limit:.0f} rad/s, the largest that was measured. A fit takes gaps as chance: measure these spins by other "
        "means (more frames, marks on the ball), or leave out all impacts of such speeds and angles"
    )
