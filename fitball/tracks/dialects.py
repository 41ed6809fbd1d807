"""Tables of positions as tracking programs write them, recognised by their headers, as clips.

| program | header | rows |
|---|---|---|
| any (long table) | `id, t or frame, x, y` and what `NAMES` has | a frame of a ball |
| Tracker | names of masses above `t, x, y` | a frame of all masses |
| Kinovea | `T X Y`, behind a comment mark or not; times such as 0:00:01:23 | a frame; tracks one below the other |
| Kinovea, one table | `Time`, and `NAME/0/X, NAME/0/Y` of each object | a frame of all objects |
| DLTdv | `pt1_cam1_X, pt1_cam1_Y`, or `pt1_X, pt1_Y, pt1_Z` | a frame, from 1 |
| DeepLabCut | `scorer`, `bodyparts`, `coords` | a frame, its number first |
| none | two or three columns of numbers | a frame, from 1 |
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fitball.data.cells import (
    Findings,
    RawTable,
    Record,
    Texts,
    Vocabulary,
    find_header,
    is_number,
    laid_out,
    refusal,
)
from fitball.data.header import LONGEST, Naming, bare, is_unit, split_cell
from fitball.data.numbers import NumberColumn, plain_numbers, read_column
from fitball.data.table import FrozenMapping
from fitball.data.units import Dimension, Unit, parse_unit
from fitball.errors import TableError, UnitError
from fitball.tracks.clips import PIXELS, Clip, Reading
from fitball.values import FloatArray
from fitball.wording import spoken

# Columns of the long table, and what else people and programs call them.
NAMES: Mapping[str, str] = {
    "id": "track trackid ball ballid object objectid shot trial impact particle clip name label",
    "session": "camera cam",
    "t": "time times timestamp timestamps seconds zeit tiempo temps",
    "frame": "frames frameno framenr framenumber frameindex frameid image bild cuadro",
    "x": "posx xpos positionx xposition cx xc centerx centrex xcenter xcentre ballx xball",
    "y": "posy ypos positiony yposition cy yc centery centrey ycenter ycentre bally yball",
    "z": "posz zpos positionz zposition cz zc centerz centrez zcenter zcentre ballz zball",
    "angle": "phi theta orientation winkel markangle",
    "angle_fold": "fold anglefold",
    "radius": "r ballradius",
    "diameter": "d diam balldiameter durchmesser",
    "quality": "likelihood confidence conf score",
}
_OURS = {word: ours for ours, words in NAMES.items() for word in (bare(ours), *words.split())}
_TEXTS = ("id", "session")
_LENGTHS = ("x", "y", "z", "radius", "diameter")
_PLAIN = Unit("", Dimension.TIME, 1.0)
_PIXEL_CELL = re.compile(r"(?P<name>.*?\w)[\s_/,:]*[\[(]?\s*(?<![a-z])(?:px|pixels?)\s*[\])]?", re.IGNORECASE)
_DLTDV = re.compile(r"pt(?P<point>\d+)_(?:cam(?P<camera>\d+)_)?(?P<axis>[xyz])", re.IGNORECASE)
# A column of Kinovea's single table: object, point, axis.
_PAIRED = re.compile(r"(?P<name>.+?)(?:/0)?/(?P<axis>[xy])", re.IGNORECASE)
# Hours, minutes, seconds; then hundredths or thousandths of a second.
_TIMECODE = re.compile(r"(?:(\d+):)?(\d{1,2}):(\d{2})[:.,](\d{2,3})")
EXPECTED = (
    "expected columns x and y, and t or frame, such as 'id,t [s],x [m],y [m]', or an export of Tracker, Kinovea, "
    "DLTdv or DeepLabCut"
)
# Numbers this near to whole ones are whole; rows that go back more often than every so many are in no order.
_ROUNDED, _SHORTEST = 1e-6, 6
# Seconds between frames that no film of a bounce has.
_FILMED = 1.0
# What programs write as all coordinates of a frame in which they found no ball, in the unit of the file.
_NOT_FOUND = (-99.0, -999.0, -9999.0, -99999.0)
# What stands for a header where a file has none.
_BARE = ("x", "y", "z")


@dataclass(frozen=True)
class _Part:
    """One ball of a file: its name, the place of each column by our name, its program, and whether that writes
    pixels. Several cameras are sessions.
    """

    name: str
    places: Mapping[str, int]
    program: str
    pixels: bool = False
    session: str = ""


def positions_vocabulary(how: Reading) -> Vocabulary:
    """How a header of positions is recognised."""

    @cache
    def worth(cell: str) -> float:
        if len(cell) > LONGEST or not cell or is_number(cell):
            return 0.0
        if _DLTDV.fullmatch(cell) or _PAIRED.fullmatch(cell):
            return 1.0
        return 1.0 if _column(cell, how)[0] in NAMES or cell.casefold() == "coords" else 0.0

    return Vocabulary(worth, lambda text: is_unit(text) or text.casefold() in ("px", "pixel", "pixels"))


def clips_of(records: Sequence[Record], data: bytes, notes: Sequence[str], source: str, how: Reading) -> list[Clip]:
    """The clips of the records of a file. Raises TableError with row, column and what was expected."""
    vocabulary = positions_vocabulary(how)
    at, worth = find_header(records, vocabulary)
    if worth < 2.0:
        records, at = [_made_header(records, source), *records], 0
        notes = (*notes, "the file has no header: columns were read as x, y" + ", z" * (len(records[0][1]) > 2))
    raw = laid_out(source, records[at:], vocabulary, data, notes)
    above = [cells for _, cells in records[:at]]
    found = Findings.from_raw(raw)
    cells = {text.strip().casefold() for cell in raw.header for text in (cell, split_cell(cell, _NAMING)[0])}
    for ours, their in how.columns.items():
        if their.strip().casefold() not in cells:
            found.header_fault(f"no column '{their}' for {ours}; the header has {', '.join(raw.header[:12])}")
    found.refuse(source)
    parts = _parts(raw.header, above, Path(source).stem, how) if worth >= 2.0 else [_bare_part(raw, source)]
    if not parts:
        found.header_fault(f"read {', '.join(raw.header[:12])}; {EXPECTED}")
        raise TableError(source, found.faults)
    if not raw.rows:
        found.header_fault("no rows after the header; expected positions")
    found.refuse(source)
    clips = [clip for part in parts for clip in _read_part(part, raw, source, found, how)]
    found.refuse(source)
    return clips


def _made_header(records: Sequence[Record], source: str) -> Record:
    width = len(records[0][1]) if records else 0
    if not 2 <= width <= 3 or not all(map(is_number, records[0][1])):
        read = ", ".join(records[0][1][:8]) if records else "nothing"
        if records and {cell.partition(" ")[0] for cell in records[0][1]} & {"v_1", "v_x1"}:
            calibrate = spoken("fitball calibrate", "fitball.calibrate")
            raise refusal(source, f"read '{read}': this is a table of impacts, not of positions; {calibrate} fits it")
        raise refusal(
            source, f"read '{read}', no header of positions; {EXPECTED}", records[0][0] if records else None
        )
    return None, _BARE[:width]


def _bare_part(raw: RawTable, source: str) -> _Part:
    return _Part(Path(source).stem, {name: k for k, name in enumerate(raw.header)}, "")


def _column(cell: str, how: Reading) -> tuple[str | None, str | None]:
    """Our name of a header cell (None: not used), and its unit as written."""
    theirs = {their.casefold(): ours for ours, their in how.columns.items()}
    if cell.strip().casefold() in theirs:
        return theirs[cell.strip().casefold()], None
    pixels = _PIXEL_CELL.fullmatch(cell.strip())
    name, unit = (pixels["name"], "px") if pixels else split_cell(cell, _NAMING)
    return theirs.get(name.casefold()) or _OURS.get(bare(name)), unit


_NAMING = Naming(FrozenMapping({word: word for words in (*NAMES, *NAMES.values()) for word in words.split()}))


def _parts(header: Texts, above: Sequence[Texts], stem: str, how: Reading) -> list[_Part]:
    if any(map(_DLTDV.fullmatch, header)):
        return _dltdv(header, stem)
    if any(map(_PAIRED.fullmatch, header)):
        return _kinovea(header, how)
    if header[0].casefold() == "coords":
        return _deeplabcut(header, above)
    ours = [_column(cell, how)[0] for cell in header]
    names = above[-1] if above else ()
    if ours.count("x") > 1 or ("id" not in ours and "t" in ours and any(names)):
        return _tracker(ours, names, stem)
    if not {"x", "y"} <= {*ours}:
        return []
    return [_Part(stem, {name: k for k, name in reversed([*enumerate(ours)]) if name}, "")]


def _dltdv(header: Texts, stem: str) -> list[_Part]:
    points: dict[tuple[str, str], dict[str, int]] = {}
    for k, cell in enumerate(header):
        if found := _DLTDV.fullmatch(cell.strip()):
            points.setdefault((found["point"], found["camera"] or ""), {})[found["axis"].casefold()] = k
    several, views = len({point for point, _ in points}) > 1, len({camera for _, camera in points}) > 1
    return [
        _Part(
            stem + f"-pt{point}" * several + f"-cam{camera}" * views,
            places, "DLTdv", pixels=bool(camera),
            session=f"cam{camera}" * views,
        )
        for (point, camera), places in points.items()
        if {"x", "y"} <= places.keys()
    ]  # fmt: skip


def _kinovea(header: Texts, how: Reading) -> list[_Part]:
    times = {name: k for k, cell in enumerate(header) if (name := _column(cell, how)[0]) in ("t", "frame")}
    points: dict[str, dict[str, int]] = {}
    for k, cell in enumerate(header):
        if found := _PAIRED.fullmatch(cell.strip()):
            points.setdefault(found["name"], {**times})[found["axis"].casefold()] = k
    return [_Part(name, places, "Kinovea") for name, places in points.items() if {"x", "y"} <= places.keys()]


def _deeplabcut(header: Texts, above: Sequence[Texts]) -> list[_Part]:
    kinds = {cells[0].casefold(): cells for cells in above if cells}
    bodies, animals = kinds.get("bodyparts", ("",) * len(header)), kinds.get("individuals", ("",) * len(header))
    parts: dict[str, dict[str, int]] = {}
    for k, cell in enumerate(header[1:], start=1):
        name = "-".join(cells[k] for cells in (animals, bodies) if k < len(cells) and cells[k]) or "ball"
        parts.setdefault(name, {"frame": 0}).setdefault(_OURS.get(bare(cell), cell), k)
    return [
        _Part(name, places, "DeepLabCut", pixels=True) for name, places in parts.items() if {"x", "y"} <= {*places}
    ]


def _tracker(ours: Sequence[str | None], names: Texts, stem: str) -> list[_Part]:
    """Blocks of columns side by side: each `x` begins a mass, the time is that before it, the name is above."""
    parts, times, name = list[_Part](), dict[str, int](), ""
    starts = [k for k, column in enumerate(ours) if column == "x"]
    for k, column in enumerate(ours):
        name = names[k] if k < len(names) and names[k] else name
        if column in ("t", "frame"):
            times[column] = k
        elif column == "x":
            end = next((other for other in starts if other > k), len(ours))
            block = {
                what: j for j, what in reversed([*enumerate(ours[k:end], start=k)]) if what in (*_LENGTHS, "angle")
            }
            parts += [_Part(name, {**times, **block}, "Tracker")] if "y" in block else []
    several = len(parts) > 1
    return [
        _Part(f"{stem}-{part.name or k}" if several else stem, part.places, "Tracker")
        for k, part in enumerate(parts, 1)
    ]


def _read_part(part: _Part, raw: RawTable, source: str, found: Findings, how: Reading) -> list[Clip]:
    """The clips of a part, one for each id and session, and for each time that the clock restarts."""
    cells = {name: raw.columns[k] for name, k in part.places.items()}
    notes = list(raw.notes)
    if "t" in cells and any(map(_TIMECODE.fullmatch, cells["t"])):
        cells["t"] = tuple(map(_seconds, cells["t"]))
        notes.append("times such as 0:00:01:23 were read as hours, minutes, seconds and decimals of a second")
    plain, _told = plain_numbers({name: texts for name, texts in cells.items() if name not in _TEXTS})
    units = _units(part, raw, plain, found, how)
    columns = {name: read_column(name, units[name] or _PLAIN, plain[name], found, gaps=True) for name in plain}
    for name in {"frame", "angle_fold"} & columns.keys():
        _check_whole(columns[name], found)
    if found.faults:
        return []
    count = len(raw.rows)
    ids, sessions = cells.get("id", ("",) * count), cells.get("session", (part.session,) * count)
    groups: dict[tuple[str, str], list[int]] = {}
    for k, key in enumerate(zip(sessions, ids, strict=True)):
        groups.setdefault(key, []).append(k)
    clips = []
    for (session, name), rows in groups.items():
        chunks = [rows] if "id" in cells else _restarts(rows, columns)
        for k, chunk in enumerate(chunks, start=1):
            known = name or (f"{part.name}-{k}" if len(chunks) > 1 else part.name)
            clip = _clip(known, session, np.array(chunk), columns, units["x"], raw, source, part, how)
            if clip is not None:
                labels = _labels(part, raw, chunk, how)
                clips.append(replace(clip, labels=labels).noted(*notes))
                _check_once(clip, found)
        if (
            "angle_fold" in columns
            and len({*columns["angle_fold"].values[rows][~columns["angle_fold"].missing[rows]]}) > 1
        ):
            found.fault(f"clip '{name}' has several folds; expected one mark in a clip", "angle_fold", rows[0])
    return clips


def _labels(part: _Part, raw: RawTable, rows: Sequence[int], how: Reading) -> FrozenMapping[str]:
    """Columns of a long table that are not used, with the one text that each has in these rows; not numbers."""
    texts = {} if part.program else dict(zip(raw.header, raw.columns, strict=False))
    unused = {
        name: {cells[k] for k in rows} for name, cells in texts.items() if name and _column(name, how)[0] is None
    }
    return FrozenMapping(
        {name: text for name, (text, *more) in unused.items() if text and not more and not is_number(text)}
    )


def _check_whole(column: NumberColumn, found: Findings) -> None:
    """A fault for the first number that is not whole, or no fold of a mark."""
    values = np.where(column.missing, 1.0, column.values)
    wrong = np.abs(values - np.round(values)) > _ROUNDED
    if column.name == "angle_fold":
        wrong |= values < 1.0 - _ROUNDED
    if wrong.any():
        place = int(np.argmax(wrong))
        words = "1 for a dot, 2 for a stripe" if column.name == "angle_fold" else "a whole number"
        found.fault(f"read {values[place]:g}; expected {words}", column.name, place)


def _seconds(cell: str) -> str:
    found = _TIMECODE.fullmatch(cell.strip())
    if found is None:
        return cell
    hours, minutes, seconds, rest = found.groups()
    return f"{3600 * int(hours or 0) + 60 * int(minutes) + int(seconds)}.{rest}"


def _units(
    part: _Part, raw: RawTable, plain: Mapping[str, Texts], found: Findings, how: Reading
) -> dict[str, Unit | None]:
    """The unit of each column of numbers; None for a length of which nothing states the unit."""
    units: dict[str, Unit | None] = {}
    for name in plain:
        cell = raw.header[part.places[name]]
        text = _column(cell, how)[1]
        dimension = {"t": Dimension.TIME, "angle": Dimension.ANGLE}.get(name, Dimension.LENGTH)
        if name not in ("t", "angle", *_LENGTHS):
            units[name] = _PLAIN
        elif dimension is Dimension.LENGTH and (text or "").casefold() in ("px", "pixel", "pixels"):
            units[name] = PIXELS
        elif dimension is Dimension.LENGTH and text is None:
            units[name] = PIXELS if part.pixels else None if how.unit is None else _stated(how.unit)
        else:
            try:
                units[name] = parse_unit(text, dimension)
            except UnitError as error:
                found.header_fault(str(error), cell)
                units[name] = None
    axes = {name: units[name] for name in ("x", "y", "z") if name in units}
    if len({None if unit is None else unit.symbol for unit in axes.values()}) > 1:
        words = ", ".join(f"{name} [{'none' if unit is None else unit.symbol}]" for name, unit in axes.items())
        found.header_fault(f"read units {words}; expected one unit for all coordinates")
    for name in ("radius", "diameter"):
        if name in units and units[name] is None:
            units[name] = units["x"]
    return units


def _stated(text: str) -> Unit:
    return PIXELS if text.casefold() in ("px", "pixel", "pixels") else parse_unit(text, Dimension.LENGTH)


def _restarts(rows: Sequence[int], columns: Mapping[str, NumberColumn]) -> list[list[int]]:
    """Rows divided where time or frame number goes back, as where tracks stand one below the other."""
    column = columns.get("t") or columns.get("frame")
    if column is None or not rows:
        return [[*rows]]
    back = np.flatnonzero(np.diff(column.values[[*rows]]) < 0.0) + 1
    if _SHORTEST * (len(back) + 1) > len(rows):
        return [[*rows]]
    return [[*chunk] for chunk in np.split(np.array(rows), back)]


def _clip(
    name: str, session: str, rows: NDArray[np.int64], columns: Mapping[str, NumberColumn],
    unit: Unit | None, raw: RawTable, source: str, part: _Part, how: Reading,
) -> Clip | None:  # fmt: skip
    """The frames of one clip in which the ball was found, by time; None where there are none."""

    def values(column: str) -> FloatArray | None:
        return columns[column].values[rows] if column in columns else None

    position = np.stack([columns[axis].values[rows] for axis in "xyz" if axis in columns], axis=1)
    time, frame, quality, notes = values("t"), values("frame"), values("quality"), list[str]()
    seen: NDArray[np.bool_] = np.asarray(np.isfinite(position).all(axis=1))
    codes = np.array(_NOT_FOUND) if unit is None else np.array([unit.to_si(code) for code in _NOT_FOUND])
    lost = seen & np.isclose(position[:, :, None], codes).all(axis=1).any(axis=1)
    if lost.any():
        seen &= ~lost
        notes.append(f"{int(lost.sum())} of {len(rows)} frames left out: all coordinates are a code, such as -999")
    for needed in (time, frame):
        seen = seen if needed is None else seen & np.isfinite(needed)
    if quality is not None:
        unsure = seen & (quality < how.least_quality)
        seen &= ~unsure
        if unsure.any():
            notes.append(
                f"{int(unsure.sum())} of {len(rows)} frames with a quality below {how.least_quality:g} left out"
            )
    if not seen.any():
        return None
    radius, diameter, fold = values("radius"), values("diameter"), values("angle_fold")
    if radius is None and diameter is not None:
        radius = 0.5 * diameter
    folds = np.unique(fold[seen & np.isfinite(fold)]) if fold is not None else np.array([])
    lines = np.array([raw.rows.lines[k] or raw.rows.numbers[k] for k in rows.tolist()], dtype=np.int64)
    count = np.arange(1, len(rows) + 1) if frame is None else np.round(np.where(seen, frame, 0.0)).astype(np.int64)
    if part.program:
        notes.append(f"read as an export of {part.program}")
    if time is not None and _times_in_ms(columns["t"], raw.header[part.places["t"]], time[seen], how):
        time = 1e-3 * time
        notes.append(
            "times have no unit and were read as milliseconds: steps of a second and more are no film. If they count "
            f"frames, state the rate: {spoken('--fps N', 'fps=N')}"
        )
    clip = Clip(
        name, session, source, count, lines, position, unit,
        time=time, angle=values("angle"), fold=int(folds[0]) if folds.size else how.fold or 1, radius=radius,
        notes=tuple(notes),
    ).take(seen)  # fmt: skip
    order = clip.frame if clip.time is None else clip.time
    return clip.take(np.argsort(order, kind="stable"))


def _times_in_ms(column: NumberColumn, cell: str, time: FloatArray, how: Reading) -> bool:
    """Whether times without a unit step by too much to be seconds."""
    stated = _column(cell, how)[1] is not None or column.unit.symbol != "s"
    return not stated and len(time) > 1 and float(np.median(np.abs(np.diff(time)))) >= _FILMED


def _check_once(clip: Clip, found: Findings) -> None:
    """A fault where two positions have one time or frame."""
    order = clip.frame.astype(np.float64) if clip.time is None else clip.time
    twice = np.flatnonzero(np.diff(order) <= 0.0)
    if not twice.size:
        return
    what = f"frame {clip.frame[twice[0]]}" if clip.time is None else f"t = {order[twice[0]]:g} s"
    share = f"{twice.size} of {len(clip)} frames"
    lines = f"lines {clip.line[twice[0]]} and {clip.line[twice[0] + 1]}"
    found.fault(
        f"clip '{clip.id}' has two positions at {what} ({lines}; {share}); expected one ball in a clip: give each "
        "ball its own id, or state the frame rate if times are rounded"
    )
