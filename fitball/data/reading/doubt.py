"""Whether another reading explains a table so much better than what its header says that somebody has to decide."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitball.data.columns import MEASURED, REBOUND
from fitball.data.reading.hypotheses import Hypothesis, double_hypotheses, hypotheses
from fitball.data.reading.impulse_laws import Misfit, misfit
from fitball.data.reading.motion import Columns, Motion, chosen_rows, motion_of
from fitball.data.reading.spins import missing_above
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.data.units import Dimension
from fitball.values import Ball, FloatArray, quotient

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
        said = [
            f"{item.hypothesis.words} {_fall(self.as_read, item.misfit)}: {item.hypothesis.remedy} if that is meant"
            for item in self.found
        ]
        if not scene.states_ball and any(item.hypothesis.scales for item in self.found):
            said.append(
                f"a ball of another radius than {1e3 * scene.ball.radius:g} mm, which is assumed, may look alike: "
                "state [ball] in the scene"
            )
        return tuple(said)


def doubt_of(columns: Columns, units: Mapping[str, str], ball: Ball) -> Doubt | None:
    """What there is to say against the reading of `columns` [SI, by name, angles in rad], or None.

    `units` are the symbols by column, as the header says. Rows in which all was measured (a gap is NaN) are looked
    at; where these are too few, those that have all but what is missing most often, and so on.
    """
    columns = {name: values for name, values in columns.items() if MEASURED[name] is not Dimension.TIME}
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
        other = hypothesis.apply(columns)
        moved = motion_of(other)
        if moved != motion and _plausible(other, moved) and not (hypothesis.needs_spin and _untold(motion)):
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


def gaps_of_table(table: ImpactTable, ball: Ball) -> str | None:
    """What there is to say of rebound spins that are missing, see `missing_above`."""
    columns = {name: values for name, values in columns_of(table).items() if MEASURED[name] is not Dimension.TIME}
    return missing_above(columns, ball)


def doubt_of_table(table: ImpactTable, ball: Ball) -> Doubt | None:
    """`doubt_of` a table that has been read."""
    return doubt_of(columns_of(table), table.units, ball)


def columns_of(table: ImpactTable) -> dict[str, FloatArray]:
    """The columns of a table; of the incident ones those that it was read from."""
    impacts = table.impacts
    state = {
        "v_x1": impacts.v_x1, "v_y1": impacts.v_y1, "omega_1": impacts.omega_1,
        "v_1": np.hypot(impacts.v_x1, impacts.v_y1), "theta_1": np.arctan2(impacts.v_y1, impacts.v_x1),
    }  # fmt: skip
    if {"v_x1", "v_y1"} <= table.units.keys():
        state = {name: state[name] for name in ("v_x1", "v_y1", "omega_1")}
    found = {name: values for name, values in state.items() if name in table.units}
    return found | {item.name: item.values for item in (*table.measurements, *table.redundant)}


def _restitution(motion: Motion) -> float | None:
    if motion.v_y1 is None or motion.v_y2 is None:
        return None
    return float(np.median(quotient(motion.v_y2, motion.v_y1)))


def _plausible(columns: Columns, motion: Motion) -> bool:
    """Whether a reading says nothing absurd by itself."""
    restitution = _restitution(motion)
    if restitution is not None and not PLAUSIBLE[0] <= restitution <= PLAUSIBLE[1]:
        return False
    angles = [columns[name] for name in ("theta_1", "theta_2") if name in columns]
    return all(bool(np.all((angle > 0.0) & (angle < np.pi))) for angle in angles)


def _untold(motion: Motion) -> bool:
    """Whether nothing but friction tells one end of the table from the other."""
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
            f"columns that say the same twice differ by {100.0 * after.contradiction:.2g} % instead of "
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
