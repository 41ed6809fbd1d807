"""Gaps between the flights of a table (time, path, turn) against what its speeds and spins say of them: a wrong unit,
a wrong sign or turns that were left out show in the median row.

A tennis ball's flights are 2 to 9 ms apart. Meanwhile the ball goes on at a speed between those before and after, and
its shell turns at a rate between its spins: by about 0.6 of the way from the first to the second.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

import numpy as np

from fitball.data.laws import columns_of, motion_of
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.data.units import UNITS, Unit, symbols
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray
from fitball.wording import option

# Between what times a tennis ball's flights are apart, and what is typical [s].
SHORTEST, LONGEST, TYPICAL = 2.0e-3, 9.0e-3, 4.6e-3
# Shares of the mean speed along the court times the time that a path may be, the same where the time was not
# measured, and the path that is none yet [m].
PATHS, GUESSED_PATHS, NO_PATH = (0.3, 2.0), (0.15, 4.0), 1.5e-2
# The share of the way between the spins; from what turn on they say something, and by how much a turn may differ from
# that without a question [rad]. By what share another reading must be better.
ON_THE_WAY, TURNS, GROSS, BETTER = 0.6, 0.7, 2.0, 1.0 / 3.0


def doubt_of_gaps(table: ImpactTable, scene: Scene) -> tuple[str, ...]:
    """What is asked about the gap columns of a table, a sentence for each column; none where they are as others."""
    columns = columns_of(table)
    measured = {name: columns[name] for name, item in OBSERVABLES.items() if item.gap and name in columns}
    if not measured or not scene.tennis:
        return ()
    motion = motion_of({name: values for name, values in columns.items() if name not in measured})
    rows = len(table)
    time = measured.get("gap_time", np.full(rows, np.nan))
    asked = [_asked_time(table, time)]
    sure = bool(np.isfinite(time).any()) and asked[0] is None
    time = np.where(np.isfinite(time) if sure else False, time, TYPICAL)
    if motion.v_x1 is not None and "gap_path" in measured:
        after = motion.v_x1 if motion.v_x2 is None else motion.v_x2
        asked.append(_asked_path(table, measured["gap_path"], 0.5 * time * (motion.v_x1 + after), sure))
    if motion.omega_2 is not None and "gap_turn" in measured:
        before = np.zeros(rows) if motion.omega_1 is None else motion.omega_1
        turn = time * (before + ON_THE_WAY * (motion.omega_2 - before))
        asked.append(_asked_turn(table, measured["gap_turn"], turn))
    return tuple(item for item in asked if item is not None)


def _middle(values: FloatArray) -> float:
    """The median of what is finite; NaN without any."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else float("nan")


def _other_units(table: ImpactTable, name: str) -> tuple[Unit, Mapping[str, Unit]]:
    """The unit of a column, and the others that it might have."""
    own = UNITS[table.units.get(name, OBSERVABLES[name].unit)]
    return own, {symbol: UNITS[symbol] for symbol in symbols(own.dimension) if symbol != own.symbol}


def _did_you_mean(table: ImpactTable, name: str, fitting: list[str]) -> str:
    """The question after the unit that explains a column, if one does."""
    if not fitting:
        return ""
    also = f" (and '{name}_sd [{fitting[0]}]')" if f"{name}_sd" in table.units else ""
    return f": did you mean '{name} [{fitting[0]}]'{also} in the header?"


def _asked_time(table: ImpactTable, time: FloatArray) -> str | None:
    middle = _middle(time)
    outside = np.flatnonzero((time < SHORTEST) | (time > LONGEST))
    if not outside.size:
        return None
    own, others = _other_units(table, "gap_time")
    usual = f"the flights of a tennis ball are {1e3 * SHORTEST:g} to {1e3 * LONGEST:g} ms apart"
    if not SHORTEST <= middle <= LONGEST:
        written = own.from_si(middle)
        fitting = [symbol for symbol, unit in others.items() if SHORTEST <= unit.to_si(written) <= LONGEST]
        meant = _did_you_mean(table, "gap_time", fitting) or ": check the height of the court that was assumed"
        return f"gap_time is {1e3 * middle:.3g} ms (median), but {usual}{meant}"
    first = int(outside[0])
    more = f" and {outside.size - 1} more" if outside.size > 1 else ""
    return (
        f"gap_time is {1e3 * time[first]:.3g} ms for '{table.ids[first]}'{more}, but {usual}: check these rows and "
        "the height of the court that was assumed"
    )


def _asked_path(table: ImpactTable, path: FloatArray, said: FloatArray, sure: bool) -> str | None:
    """Whether paths are those `said` by speeds and times; less is known where the time is not `sure`."""
    moving = np.abs(said) > NO_PATH
    share = _middle(path[moving] / said[moving])
    low, high = PATHS if sure else GUESSED_PATHS
    if np.isnan(share) or low <= share <= high:
        return None
    own, others = _other_units(table, "gap_path")
    read = (
        f"gap_path is {_middle(path[moving]):.3g} m (median), but speeds and times give {_middle(said[moving]):.3g} m"
    )
    if low <= -share <= high:
        return f"{read}: if the sign is the other one, pass {option('flip', 'gap_path')}"
    written = own.from_si(share)
    fitting = [symbol for symbol, unit in others.items() if low <= unit.to_si(written) <= high]
    fitting.sort(key=lambda symbol: abs(np.log(others[symbol].to_si(written))))
    return f"{read}{_did_you_mean(table, 'gap_path', fitting) or ': check the column and the speeds'}"


def _asked_turn(table: ImpactTable, turn: FloatArray, said: FloatArray) -> str | None:
    """Whether turns are those `said` by spins and times."""

    def apart(values: FloatArray) -> float:
        return _middle(np.abs(values - said))

    as_read, size = apart(turn), _middle(np.abs(said))
    gross = as_read > GROSS + size
    if not gross and size < TURNS:
        return None
    own, others = _other_units(table, "gap_turn")
    left = {symbol: apart(other.to_si(own.from_si(turn))) for symbol, other in others.items()}
    fitting = sorted((symbol for symbol in left if left[symbol] < BETTER * as_read), key=lambda symbol: left[symbol])
    read = f"gap_turn is {_middle(turn):.3g} rad (median), but spins and times give {_middle(said):.3g} rad"
    if apart(-turn) < BETTER * as_read:
        return f"{read}: if the sign is the other one, pass {option('flip', 'gap_turn')}"
    if fitting:
        return f"{read}{_did_you_mean(table, 'gap_turn', fitting)}"
    whole = turn + 2.0 * pi * np.round((said - turn) / (2.0 * pi))
    if as_read > pi and apart(whole) < BETTER * as_read:
        return f"{read}: whole turns belong to it, add them"
    return f"{read}: check the column and the spins" if gross else None
