"""What unknown columns may mean where restitution is measured in another form than two velocities.

`header` guesses a column by the words of its name. Here the whole table says more: a count of
bounces beside a time makes a series, speeds without angles are vertical, a racket's speed is that
of the surface. Proposals are offered with `--columns`, never taken.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan

import numpy as np

from fitball.base.columns import COLUMNS, FLIGHTS, HEIGHTS, RATIOS, REBOUND, SERIES
from fitball.base.errors import ParameterError
from fitball.base.units import factor_of
from fitball.base.values import FloatArray
from fitball.data.cells import TableCells
from fitball.data.header import LABELS, Header, Naming
from fitball.data.lexicon import bare_name, guess_of, without_unit
from fitball.data.repeats import Mark, are_counted, mark_of
from fitball.data.series import is_count

# What people call columns, by ours, without blanks and signs; a `ratio` may be two of them.
_NAMES = {
    "cor": "e ey en ez en restitution coefficientofrestitution coeffofrestitution "
    "coefofrestitution restitutioncoefficient restitutioncoeff normalrestitution corvalue meancor "
    "coraverage avgcor averagecor stosszahl stoßzahl stossziffer restitutionskoeffizient "
    "coefficientderestitution coefficientedirestituzione coeficientederestitución "
    "coeficientederestitucion",
    "height_ratio": "heightratio ratioofheights h2/h1 h1/h0 reboundresilience resilience "
    "reboundheightratio relativereboundheight bounceheightratio",
    "ratio": "ratio reboundratio bounceratio ratioofrebound rebound% bounce% reboundpercent "
    "reboundpercentage bouncepercent bouncepercentage percentrebound percentbounce %rebound "
    "%bounce relativerebound bounciness",
    "bounce_interval": "interval intervals bounceintervals timeinterval timeintervals timebetween "
    "timebetweenbounces timebetweenbounce timebetweenimpacts timebetweenhits timetonextbounce "
    "interbouncetime interbounceinterval dt deltat δt tn flighttime timeofflight airtime hangtime "
    "flightduration duration period intervall intervalle zeitabstand zeitintervall flugzeit "
    "intervallo intervalo intervalodetiempo intervalledetemps",
    "bounce_time": "time t times timestamp bouncetimes timeofbounce timesofbounces impacttime "
    "timeofimpact hittime eventtime soundtime onset peaktime zeit zeitpunkt temps instant tempo "
    "tiempo",
    "peak_height": "height h heights peakheight peakheights peak maxheight maximumheight hmax "
    "bounceheight reboundheight heightofbounce heightafterbounce apex apexheight ymax topheight "
    "höhe hoehe hauteur altura altezza",
    "surface_speed": "surfacevelocity movingsurfacespeed wallspeed platespeed plattenspeed",
}
_OURS = {name: ours for ours, names in _NAMES.items() for name in names.split()}
# Words of the names of what may move towards a ball, and of its speed.
_WORDS_OF_MOVERS = {
    "mover": "racket racquet raquet bat club clubhead paddle plate wall platform piston hammer "
    "surface head schläger schlaeger raquette raqueta racchetta",
    "speed": "speed velocity vel v vs geschwindigkeit vitesse velocidad velocità of the in before "
    "impact initial incoming at",
}
_MOVERS, _SPEEDS = (frozenset(words.split()) for words in _WORDS_OF_MOVERS.values())
# Share of the steps from an interval or a peak to the next that go down: all but those to the next
# series, of which each has two intervals or more.
_LEAST_FALLING = 0.4
# What names of columns side by side mean beside those of the lexicon.
_REPEATED = {"bounce": "height", "peak": "height", "apex": "height", "rebound": "rebound height"}
# What is heard of a bounce, where columns side by side have a unit of time.
_HEARD = frozenset({"bounce", "impact", "hit", "sound", "click", "aufprall", "rebond"})
# What is repeated where columns are called `Trial 1` and so on, by what is known of the fall.
_AFTER = {"drop_height": "rebound_height", "v_y1": "v_y2", "v_1": "v_2"}
# Share of a height, or of a time, up to which the next bounce may come; repeats differ less.
_MOST_KEPT = 0.93
# Share of the steps from column to column that show successive bounces.
_NEARLY_ALL = 0.9
# Heights side by side that are successive bounces, the drop height among them.
_LEAST_BOUNCES = 3
# Vertical velocities by the speeds that they are where a ball comes straight down.
_VERTICAL = {"v_1": "v_y1", "v_2": "v_y2"}
# Columns that say how a ball came.
_INCIDENTS = ("v_y1", "v_1", HEIGHTS[0], FLIGHTS[0])


@dataclass(frozen=True, eq=False)
class _Unknown:
    """A column of numbers of which no name is known: its `cell` of the header, name and unit, and
    its numbers (rows,), NaN where a cell is none.
    """

    cell: str
    name: str
    unit: str
    values: FloatArray


def with_proposals(cells: TableCells, header: Header, naming: Naming) -> Header:
    """The header with what its unknown columns may mean in view of the whole table."""
    unknown = _unknown_columns(cells, header, naming)
    in_series = not header.numbers.keys().isdisjoint(SERIES)
    counts = [column for column in unknown if is_count(column.name, column.values, in_series)]
    others = [column for column in unknown if column not in counts]
    guesses = dict(header.guesses)
    for count in counts:
        guesses = _without(guesses, count)
    for column in others:
        if guesses == _without(guesses, column):
            guesses |= _of_end(column, {*header.numbers, *guesses})
    guesses = _of_repeats(others, header, guesses)
    guesses |= _beside_a_ratio(others, header, guesses)
    # The speed of a surface is none without both of the ball.
    for column in sorted(others, key=_is_of_mover):
        ours = _other_form(column, header, _without(guesses, column), counted=bool(counts))
        if ours == "ratio":
            _refuse_ratio(cells, column)
        elif ours and ours not in (*header.numbers, *guesses):
            guesses = {**_without(guesses, column), ours: column.cell}
    guesses = _vertical(cells, header, guesses)
    meant = {_name_of(their) for their in guesses.values()}
    named = {ours: their for ours, their in naming.columns.items() if _name_of(their) not in meant}
    return replace(header, guesses=guesses, named=named)


def note_unread(cells: TableCells, header: Header) -> None:
    """Note each unknown column of which a meaning is proposed."""
    cells_of_known = [cells.names[index] for index in header.numbers.values()]
    for ours, their in header.guesses.items():
        if their not in cells_of_known:
            words = f'a column is not read; did you mean --columns "{ours}={their}"?'
            cells.note("not-read", words)


def _without(guesses: Mapping[str, str], column: _Unknown) -> dict[str, str]:
    """The guesses but that of a column, whose cell may have a unit added."""
    return {
        ours: their
        for ours, their in guesses.items()
        if their != column.cell and not their.startswith(f"{column.cell} [")
    }


def _name_of(their: str) -> str:
    """The name of a column without its unit in brackets."""
    return their.partition("[")[0].strip().casefold()


def _unknown_columns(cells: TableCells, header: Header, naming: Naming) -> list[_Unknown]:
    """The columns with numbers whose names are none of ours."""
    columns = []
    for name, index in header.labels.items():
        if name in LABELS or not cells.has_numbers(index):
            continue
        short, unit = naming.split(cells.names[index])
        values = np.array([_number(text) for text in cells.text(index)])
        columns.append(_Unknown(cells.names[index], short, unit or "", values))
    return columns


def _number(text: str) -> float:
    """The number of a cell, NaN where it is none."""
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return nan


def _of_end(column: _Unknown, known: Collection[str]) -> dict[str, str]:
    """What a column means whose name says which end of the bounce, and whose unit says that it is a
    speed, such as `Ball in (m/s)`.
    """
    if column.unit and _measures(column.unit, "v_1"):
        meant = guess_of(f"{column.name} speed")
        if len(meant) == 1 and meant[0] not in known:
            return {meant[0]: column.cell}
    return {}


def _measures(unit: str, ours: str) -> bool:
    """Whether a unit, which may be empty, is one of a column of ours."""
    try:
        factor_of(unit or None, COLUMNS[ours].unit)
    except ParameterError:
        return False
    return True


def _of_repeats(
    columns: Sequence[_Unknown],
    header: Header,
    guesses: Mapping[str, str],
) -> dict[str, str]:
    """The guesses with those of columns side by side whose names differ in a mark: repeats, or the
    successive bounces of each row. `--columns` takes them with `*` for the mark.
    """
    with_repeats = dict(guesses)
    groups: dict[tuple[str, str], list[tuple[_Unknown, Mark]]] = {}
    for column in columns:
        mark = mark_of(without_unit(column.cell)[0])
        if mark is not None:
            groups.setdefault((mark.name.casefold(), column.unit), []).append((column, mark))
    counted = {key: group for key, group in groups.items() if are_counted([m for _, m in group])}
    for group in counted.values():
        for column, _ in group if len(group) >= _LEAST_BOUNCES else ():
            # One of many is no drop height.
            with_repeats = _without(with_repeats, column)
    for (name, _), group in counted.items():
        alone = with_repeats
        for column, _ in group:
            alone = _without(alone, column)
        known = {*header.numbers, *alone}
        ours = _repeated(name, [column for column, _ in group], known, word=group[0][1].word)
        beside_times = ours == "peak_height" and not known.isdisjoint(SERIES)
        if ours and ours not in known and not beside_times:
            starred = _starred([column.cell for column, _ in group])
            unit = group[0][0].unit or _unit_of_fall(columns, header, alone, ours)
            has_unit = not unit or group[0][0].unit
            with_repeats = {**alone, ours: starred if has_unit else f"{starred} [{unit}]"}
    if not with_repeats.keys().isdisjoint(("bounce_time", "bounce_interval")):
        # Heights beside times are computed from them, as by phyphox.
        with_repeats.pop("peak_height", None)
    return with_repeats


def _unit_of_fall(
    columns: Sequence[_Unknown],
    header: Header,
    guesses: Mapping[str, str],
    ours: str,
) -> str:
    """The unit of the height or speed before the impact, which rebounds without a unit have too;
    empty where it has none.
    """
    for before, after in _AFTER.items():
        if after == ours and before in header.numbers:
            return header.units.get(before, "")
        if after == ours and before in guesses:
            units = [column.unit for column in columns if column.cell == guesses[before]]
            return units[0] if units else ""
    return ""


def _repeated(name: str, group: Sequence[_Unknown], known: Collection[str], word: bool) -> str:
    """What columns side by side are, by the name that they share, whether a `word` such as `trial`
    stands behind it, and their numbers; empty where that is nothing known.
    """
    sides = np.stack([column.values for column in group])
    falls = _falls_throughout(sides, _MOST_KEPT)
    if group[0].unit and _measures(group[0].unit, "bounce_time") and bare_name(name) in _HEARD:
        return _side_by_side("bounce_time", falls, HEIGHTS[0] in known)
    meant = _REPEATED.get(bare_name(name), name)
    candidates = [ours for ours in guess_of(meant) if ours not in known]
    if len(candidates) == 2 and not word and not (falls and len(group) >= _LEAST_BOUNCES):
        return ""
    ours = candidates[-1] if candidates else _OURS.get(bare_name(name), "")
    if not name and word:
        ours = next((after for before, after in _AFTER.items() if before in known), "")
    if falls and ours in HEIGHTS and len(group) >= _LEAST_BOUNCES - (HEIGHTS[0] in known):
        ours = "peak_height"
    elif ours in {"bounce_time", "bounce_interval"}:
        ours = _side_by_side(ours, falls, HEIGHTS[0] in known)
    return ours if ours and all(_measures(column.unit, ours) for column in group) else ""


def _side_by_side(ours: str, falls: bool, dropped: bool) -> str:
    """What times or intervals side by side are: intervals of successive bounces become shorter;
    others repeat the flight after a drop, where the table has that.
    """
    if falls:
        return "bounce_interval"
    if dropped:
        return FLIGHTS[1] if ours == "bounce_interval" else ""
    return "bounce_time"


def _falls_throughout(sides: FloatArray, most: float) -> bool:
    """Whether numbers (columns, rows) fall from column to column to at most this share, as what
    bounces does, in nearly all rows.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = sides[1:] / sides[:-1]
    return float(np.mean(shares < most)) > _NEARLY_ALL


def _starred(cells: Sequence[str]) -> str:
    """Header cells that differ in a mark, with `*` for it."""
    start = _shared(cells)
    end = _shared([cell[len(start) :][::-1] for cell in cells])[::-1]
    return f"{start}*{end}"


def _shared(texts: Sequence[str]) -> str:
    """The characters with which all of these texts begin."""
    first = texts[0]
    alike = [all(text.startswith(first[:size]) for text in texts) for size in range(len(first) + 1)]
    return first[: sum(alike) - 1]


def _beside_a_ratio(
    columns: Sequence[_Unknown],
    header: Header,
    guesses: Mapping[str, str],
) -> dict[str, str]:
    """What the only speed or height is whose name leaves the end open, beside a coefficient of
    restitution: that before the impact.
    """
    ratios = [column for column in columns if _OURS.get(bare_name(column.name)) in RATIOS]
    known = {*header.numbers, *guesses}
    if not ratios and known.isdisjoint(RATIOS):
        return {}
    if not known.isdisjoint((*_INCIDENTS, *REBOUND, HEIGHTS[1])):
        return {}
    open_ended = [column for column in columns if len(guess_of(column.name)) == 2]
    meant = {guess_of(column.name)[0]: column.cell for column in open_ended}
    return meant if len(open_ended) == 1 and meant.keys() <= {*_INCIDENTS} else {}


def _refuse_ratio(cells: TableCells, column: _Unknown) -> None:
    """Add a fault of a column that may be a ratio of speeds or of heights by its name."""
    words = (
        f"'{column.cell}' may be a ratio of speeds or of heights; expected which: --columns "
        f'"cor={column.cell}" for speeds, --columns "height_ratio={column.cell}" for heights'
    )
    cells.fault("ambiguous-cor", words, column.cell)


def _other_form(
    column: _Unknown,
    header: Header,
    guesses: Mapping[str, str],
    counted: bool,
) -> str:
    """The other form of restitution that a column may be beside `guesses` of others, empty where
    none; `counted`: a column counts the bounces of a series.
    """
    ours = _OURS.get(bare_name(column.name), "")
    if _is_of_mover(column):
        ours = "surface_speed"
    if not ours or not _measures(column.unit, "cor" if ours == "ratio" else ours):
        return ""
    known = {*guesses, *header.numbers}
    has_incident = not known.isdisjoint(_INCIDENTS)
    has_rebound = not known.isdisjoint((*REBOUND, HEIGHTS[1], FLIGHTS[1]))
    dropped = HEIGHTS[0] in known
    fits = {
        "cor": has_incident and not has_rebound,
        "height_ratio": dropped and not has_rebound,
        "ratio": dropped and not has_rebound,
        "bounce_interval": not has_rebound and (dropped or not has_incident),
        "bounce_time": not has_rebound
        and not has_incident
        and ours == "bounce_time"
        and _are_bounces(column),
        "peak_height": counted and not has_rebound and (dropped or not has_incident),
        "surface_speed": has_incident and has_rebound,
    }
    if ours == "bounce_time" and not has_incident and counted and _fall(column.values):
        # Times of flights, which become shorter.
        ours = "bounce_interval"
    known_forms = {*SERIES, *RATIOS} if ours not in {"surface_speed"} else {ours}
    return ours if fits[ours] and known.isdisjoint(known_forms) else ""


def _is_of_mover(column: _Unknown) -> bool:
    """Whether a column is the speed of a racket or of another thing that moves towards the ball."""
    words = {*re.split(r"[\s_.\-]+", column.name.casefold())}
    is_speed = bool(words & _SPEEDS) or bool(column.unit)
    return bool(words & _MOVERS) and is_speed and len(words - _MOVERS - _SPEEDS) == 0


def _are_bounces(column: _Unknown) -> bool:
    """Whether times are those of bounces, whose intervals become shorter; samples of a record or
    frames of a film are at equal steps.
    """
    steps = np.diff(column.values) * factor_of(column.unit or None, "s")
    low, high = COLUMNS["bounce_interval"].limits
    intervals = steps[(low <= steps) & (steps <= high)]
    return 2 * len(intervals) > len(steps) and _fall(intervals)


def _fall(values: FloatArray) -> bool:
    """Whether numbers (rows,) fall from row to row, but where a series begins anew."""
    steps = np.diff(values)
    return len(steps) > 0 and float(np.mean(steps < 0.0)) > _LEAST_FALLING


def _vertical(cells: TableCells, header: Header, guesses: dict[str, str]) -> dict[str, str]:
    """The guesses with vertical velocities in place of speeds without angles: those of a ball that
    comes straight down.
    """
    known = {*header.numbers, *guesses}
    if "v_1" not in known or known & {"theta_1", "v_x1", "v_y1", "theta_2", "v_x2"}:
        return guesses
    vertical = {}
    for ours, their in guesses.items():
        vertical[_VERTICAL.get(ours, ours)] = their
    for speed, ours in _VERTICAL.items():
        if speed in header.numbers and ours not in known:
            vertical[ours] = cells.names[header.numbers[speed]]
    return vertical
