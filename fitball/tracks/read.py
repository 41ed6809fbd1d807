"""Files of positions as people and programs write them, read to `Track`.

| program | header | rows |
|---|---|---|
| any (long table) | `id`, `t` or `frame`, `x, y`, `names.POSITION_COLUMNS` | a frame of a ball |
| Tracker | `t, x, y`, or `t, x, y, x, y` of several masses | a frame of all masses |
| Kinovea | `Time`, and `NAME/0/X, NAME/0/Y` of each object | a frame of all objects |
| DLTdv | `pt1_cam1_X, pt1_cam1_Y` of each point, in pixels | a frame, from 1 |
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace as changed

from fitball.base.display_units import MM
from fitball.base.errors import Fault, InputError, Note, ParameterError
from fitball.base.numbers import counted
from fitball.base.text import listed, one_line
from fitball.base.units import factor_of
from fitball.base.values import BoolArray, FloatArray, IntArray
from fitball.data.bundled import path_of_source
from fitball.data.cells import TableCells, numbers
from fitball.data.labels import role_of
from fitball.data.read import TableSource
from fitball.data.scene import CameraSection, Scene, ValueWithSd, load_scene
from fitball.data.sources import file_and_sheet, read_cells
from fitball.tracks.names import DIALECTS, POSITION_COLUMNS, FilmNaming
from fitball.tracks.polar import polar_columns
from fitball.tracks.types import Track

# Points of Tracker and DLTdv have numbers, no names.
_NUMBERED = re.compile(r"\d+|pt\d.*")
# A length with its unit: `66mm`.
_LENGTH_WITH_UNIT = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*([a-z]+)\s*", re.IGNORECASE)
# Coordinates without a unit that reach further [m] are in pixels.
_MOST_METRES = 30.0
# Fewest frames with a radius of the ball that make a scale.
_FEWEST_RADII = 5
# Relative difference of a stated scale from that of the radii up to which no note is due.
_MOST_SCALE_DIFFERENCE = 0.02
# Least quality of a frame that is used: below it programs guess the position.
_LEAST_QUALITY = 0.9
# Codes that programs write for both coordinates of a frame in which they found no ball.
_LOST_CODES = (-99.0, -999.0, -9999.0, -99999.0)
# A step in time of fewer than this many usual ones misses no frame.
_MOST_STEPS_APART = 1.5
_EXPECTED = (
    "expected x and y, t or frame, such as 'id,t [s],x [m],y [m]', or an export of "
    "Tracker, Kinovea, DLTdv"
)


class _FilmedBall(NamedTuple):
    """A ball of a file: what it adds to the file's name, the index of each of its columns in the
    header, and whether its coordinates are in pixels.
    """

    name: str
    indices: dict[str, int]
    pixels: bool = False


class _Columns(NamedTuple):
    """Numbers (frames,) of one ball by column, in SI but those named in `pixels`; NaN where the
    ball was lost.
    """

    values: Mapping[str, FloatArray]
    pixels: set[str]


class _Clip(NamedTuple):
    """Numbers (frames,) of one clip by column; its `rows` among those of the file; `order`, the
    frames in which the ball was found, by time.
    """

    name: str
    rows: IntArray
    values: Mapping[str, FloatArray]
    order: IntArray

    def column(self, name: str, usual: float) -> FloatArray:
        """The numbers (frames,) of a column, or the usual number in all frames without one."""
        return self.values.get(name, np.full(self.rows.size, usual))


def scene_of(
    sources: Sequence[TableSource],
    scene: Scene | str | Path,
    fps: float,
    mm_per_px: float,
    ball_diameter: str,
) -> Scene:
    """The scene of films: that which is passed, or the file beside the first film. Frames a second,
    millimetres a pixel, and a diameter with its unit override it where they are not 0 or empty.

    Raises:
        ParameterError: the diameter is no length with a unit (`length`), or its unit is unknown.
        FolderError: no such file (`not-found`).
        InputError: the file of the scene has faults (`scene`).
    """
    beside = None
    if sources and isinstance(sources[0], str | Path):
        file, _ = file_and_sheet(str(sources[0]))
        beside = path_of_source(file, "tracks")
    if not isinstance(scene, Scene):
        scene = load_scene(beside, scene or None)
    camera = scene.camera or CameraSection()
    if fps:
        camera = changed(camera, fps=fps)
    if mm_per_px:
        camera = changed(camera, mm_per_px=mm_per_px)
    ball = scene.ball
    if ball_diameter:
        length = _LENGTH_WITH_UNIT.fullmatch(ball_diameter)
        if length is None:
            read = f"ball_diameter: read '{one_line(ball_diameter)}'"
            raise ParameterError(f"{read}; expected a length with its unit, such as 66mm", "length")
        diameter = float(length[1]) * factor_of(length[2], "m")
        ball = changed(ball, radius=0.5 * diameter)
    return changed(scene, camera=camera, ball=ball)


def read_tracks(
    sources: Sequence[TableSource],
    scene: Scene,
    columns: Mapping[str, str],
) -> tuple[list[Track], list[Note]]:
    """The tracks of files of positions, or of data frames with the same columns, and notes on what
    was assumed or left out. `columns` are the user's header cells by our names.

    Raises:
        InputError: all faults of a file by row and column (`no-positions`, `no-column`, `no-rate`,
            `no-scale`, `three-coordinates`, `two-positions`, `same-table-twice`, `fold`, `film`,
            and those of cells).
        FolderError: no such file (`not-found`).
        ParameterError: no film is passed (`no-data`), or a name is no column of positions
            (`columns`).
    """
    if not sources:
        raise ParameterError("no film was given; expected tables of positions", "no-data")
    naming = FilmNaming({**scene.columns, **columns})
    tracks = list[Track]()
    notes = dict[Note, None]()
    digests = set[tuple[str, str]]()
    for source in sources:
        file_or_table, sheet, name = _file_sheet_and_name(source)
        cells = read_cells(file_or_table, naming.worth, name)
        tracks += _Reader(cells, name, naming, scene).tracks()
        cells.refuse()
        # Sheets of one workbook are different films.
        if (cells.sha256, sheet) in digests:
            fault = Fault("same-table-twice", "read a second time; give each film once")
            raise InputError(cells.source, [fault])
        digests.add((cells.sha256, sheet))
        notes |= dict.fromkeys(cells.notes)
    return [*_with_unique_ids(tracks)], [*notes]


def _file_sheet_and_name(source: TableSource) -> tuple[TableSource, str, str]:
    """The path of a film with its sheet, or a table in memory; the sheet alone, "" without; the
    film's name. Raises FolderError (`not-found`).
    """
    if not isinstance(source, str | Path):
        return source, "", str(getattr(source, "attrs", {}).get("name", "positions"))
    file, sheet = file_and_sheet(str(source))
    path = path_of_source(file, "tracks")
    return (f"{path}#{sheet}" if sheet else path), sheet, path.stem


def _with_unique_ids(tracks: Sequence[Track]) -> Iterator[Track]:
    """The same tracks, with numbers behind ids that repeat."""
    count = Counter(track.id for track in tracks)
    number = Counter[str]()
    for track in tracks:
        number[track.id] += 1
        if count[track.id] == 1:
            yield track
        else:
            yield replace(track, id=f"{track.id} ({number[track.id]})")


@dataclass
class _Reader:
    """Reads the tracks of a file; faults are added to its cells."""

    cells: TableCells
    name: str
    naming: FilmNaming
    scene: Scene

    @property
    def camera(self) -> CameraSection:
        """The camera of the scene, or one without any statement."""
        return self.scene.camera or CameraSection()

    def tracks(self) -> list[Track]:
        """The tracks of all balls of the file.

        Raises:
            InputError: all faults of the header, or of the numbers.
        """
        cells = self.cells
        balls = self._balls_of_header()
        self._check_names(balls)
        cells.refuse()
        measured = dict[str, int]()
        for ball in balls:
            for name, index in ball.indices.items():
                if POSITION_COLUMNS[name][0] != "text":
                    measured[self._key(index)] = index
        values = numbers(cells, measured)
        cells.refuse()
        return [track for ball in balls for track in self._tracks_of(ball, values)]

    def _check_names(self, balls: Sequence[_FilmedBall]) -> None:
        """Add faults of user's columns that the header lacks, and of a third coordinate."""
        cells = self.cells
        headers = set[str]()
        for cell in cells.names:
            name, _ = self.naming.split(cell)
            headers |= {cell.strip().casefold(), name.casefold()}
        for their in self.naming.theirs.keys() - headers:
            columns = listed(cells.names, most=20)
            cells.fault("no-column", f"columns: no column is '{one_line(their)}': {columns}")
        if not balls:
            cells.fault("no-positions", f"read columns {listed(cells.names, most=12)}; {_EXPECTED}")
        for ball in balls:
            if "z" in ball.indices:
                words = (
                    "three coordinates; expected x along the court and y upwards: project onto "
                    "the plane of flight"
                )
                cells.fault("three-coordinates", words, cells.names[ball.indices["z"]])

    def _key(self, index: int) -> str:
        """The name of a column in faults: its cell, with its number where cells repeat."""
        name = self.cells.names[index]
        return name if self.cells.names.count(name) == 1 else f"{name} ({index + 1})"

    def _balls_of_header(self) -> list[_FilmedBall]:
        """The balls of a file, by its dialect."""
        names = [name.strip() for name in self.cells.names]
        ours = [self.naming.read(name)[0] for name in names]
        indices = _first_indices(ours)
        clock = {name: index for name, index in indices.items() if name in ("t", "frame")}
        for pattern in DIALECTS:
            points = _balls_of_points(names, pattern, clock)
            if points:
                return points
        if ours.count("x") > 1:
            return _balls_of_masses(ours)
        return [_FilmedBall("", indices)] if {"x", "y"} <= {*indices} else []

    def _tracks_of(self, ball: _FilmedBall, values: Mapping[str, FloatArray]) -> Iterator[Track]:
        """The tracks of a ball, one for each id and session, or for each time that the clock starts
        again.
        """
        cells = self.cells
        columns = self._in_si(ball, values)
        cells.refuse()
        count = len(cells.rows)
        clock = columns.values.get("t", columns.values.get("frame", np.arange(float(count))))
        restarts = np.zeros(count, dtype=np.int64)
        if "id" not in ball.indices:
            timed = np.flatnonzero(np.isfinite(clock))
            restarts[timed[1:]] = np.diff(clock[timed]) < 0.0
            restarts = np.cumsum(restarts)
        groups: dict[tuple[str, str, int], list[int]] = {}
        sessions = self._texts(ball, "session")
        ids = self._texts(ball, "id")
        for row, key in enumerate(zip(sessions, ids, restarts.tolist(), strict=True)):
            groups.setdefault(key, []).append(row)
        all_labels = self._labels()
        # Objects of Kinovea have names of their own.
        named = ball.name and not _NUMBERED.fullmatch(ball.name)
        file = "" if named else self.name
        for (session, track_id, restart), rows in groups.items():
            number = str(restart + 1) if restarts.any() else ""
            name = track_id or "-".join(filter(None, [file, ball.name, number]))
            labels = {column: texts[rows[0]] for column, texts in all_labels.items()}
            if session:
                labels["session"] = session
            track = self._track(name, np.array(rows), columns, labels)
            if track is not None:
                yield track

    def _in_si(self, ball: _FilmedBall, values: Mapping[str, FloatArray]) -> _Columns:
        """The numbers of a ball in SI or pixels, NaN where it was lost. Faults of units go to the
        cells.
        """
        written = dict[str, FloatArray]()
        for name, index in ball.indices.items():
            if POSITION_COLUMNS[name][0] != "text":
                written[name] = values[self._key(index)]
        x = written["x"]
        y = written["y"]
        lost = np.zeros(x.size, dtype=np.bool_)
        for code in _LOST_CODES:
            lost |= np.isclose(x, code) & np.isclose(y, code)
        self._note_omitted(self.name, lost, "both coordinates are a code, such as -999")
        columns = dict[str, FloatArray]()
        pixels = set[str]()
        for name, numbers_of in written.items():
            si, _ = POSITION_COLUMNS[name]
            _, unit = self.naming.read(self.cells.names[ball.indices[name]])
            column = np.where(lost, np.nan, numbers_of)
            if si == "m" and unit is None:
                unit = "px" if ball.pixels else self._likely_unit(np.where(lost, np.nan, [x, y]))
            if unit == "px" and si == "m":
                pixels.add(name)
            elif si:
                try:
                    column *= factor_of(unit, si)
                except ParameterError as error:
                    self.cells.fault(error.code, str(error), self._key(ball.indices[name]))
            columns[name] = column
        for name, what in polar_columns(columns).items():
            del columns[name]
            pixels.discard(name)
            head = one_line(self._key(ball.indices[name]))
            words = f"{self.name}: '{head}' is {what}, no {name} of the ball: it is not used"
            self.cells.note("polar-column", words)
        return _Columns(columns, pixels)

    def _texts(self, ball: _FilmedBall, name: str) -> list[str]:
        """The texts (rows,) of a column of a ball, empty without one."""
        if name in ball.indices:
            return self.cells.text(ball.indices[name])
        return [""] * len(self.cells.rows)

    def _labels(self) -> dict[str, list[str]]:
        """Texts (rows,) of columns of labels that have no meaning for a film, by head."""
        labels = dict[str, list[str]]()
        for index, name in enumerate(self.cells.names):
            if role_of(name) and not self.naming.read(name)[0]:
                labels[name] = self.cells.text(index)
        return labels

    def _likely_unit(self, positions: FloatArray) -> str:
        """The unit of positions (2, rows) without one: pixels where they are too far apart for
        metres, since nobody films so wide a bounce.
        """
        finite = np.isfinite(positions).all(axis=0)
        unit = "m"
        if finite.any() and np.ptp(positions[:, finite], axis=1).max() > _MOST_METRES:
            unit = "px"
        words = f"{self.name}: coordinates without a unit were read as {unit}"
        self.cells.note("no-unit", words)
        return unit

    def _track(
        self,
        name: str,
        rows: IntArray,
        columns: _Columns,
        labels: dict[str, str],
    ) -> Track | None:
        """The track of a clip: frames in which the ball was found, by time; None without any."""
        camera = self.camera
        values = {column: numbers_of[rows] for column, numbers_of in columns.values.items()}
        unsure = values.get("quality", np.ones(rows.size)) < _LEAST_QUALITY
        self._note_omitted(name, unsure, f"the quality is below {_LEAST_QUALITY:g}")
        frame = values.get("frame", np.arange(1.0, rows.size + 1.0))
        timed = "t" in values and (camera.fps is None or "frame" not in values)
        clock = values["t"] if timed else frame
        measured = np.flatnonzero(np.isfinite(values["x"] + values["y"] + clock) & ~unsure)
        order = measured[np.argsort(clock[measured], kind="stable")]
        if not order.size:
            return None
        self._check_times(name, rows, clock, order)
        positions = np.column_stack([values["x"], values["y"]])[order]
        moved = np.any(np.diff(positions, axis=0), axis=1)
        repeated = np.concatenate([[False], ~moved])
        self._note_omitted(name, repeated, "they repeat the one before")
        clip = _Clip(name, rows, values, order[~repeated])
        order = clip.order
        if camera.fps is not None:
            count = _frame_numbers(clock[order]) if timed else frame[order]
            time = count / camera.fps
        else:
            if not timed:
                words = "frames have no time; expected the camera's rate: --fps, or fps in [camera]"
                self.cells.fault("no-rate", words)
            time = clock[order]
        scale = self._metres_per_px(clip, columns.pixels)
        fold = self._fold(clip)
        x = values["x"][order] * (scale if "x" in columns.pixels else 1.0)
        y = values["y"][order] * (scale if "y" in columns.pixels else 1.0)
        if camera.y == "down":
            y = -y
        if camera.row_time:
            # Rows count downwards; from which edge only moves the clock.
            time = time - camera.row_time * y / scale
        angle = clip.column("angle", np.nan)[order]
        if camera.angles == "clockwise":
            angle = -angle
        number = np.round(frame[order]).astype(np.int64)
        return Track(name, number, time, x, y, angle, fold, labels)

    def _check_times(self, name: str, rows: IntArray, clock: FloatArray, order: IntArray) -> None:
        """Add a fault where a ball is at two places at one time."""
        twice = np.flatnonzero(np.diff(clock[order]) <= 0.0)
        if twice.size:
            words = (
                f"'{one_line(name)}' has two positions at one time ({twice.size} times); "
                "expected an id a ball"
            )
            self.cells.fault("two-positions", words, None, int(rows[order[twice[0] + 1]]))

    def _note_omitted(self, name: str, which: BoolArray, why: str) -> None:
        """Note how many frames are left out, if any."""
        if which.any():
            of = counted(which.size, "frame")
            words = f"{one_line(name)}: {which.sum()} of {of} left out: {why}"
            self.cells.note("frames-left-out", words)

    def _metres_per_px(self, clip: _Clip, pixels: set[str]) -> float:
        """Metres a pixel of a clip, as stated or by the radius of the ball in the picture; 1 where
        no column needs it. A missing scale is a fault.
        """
        stated = 1e-3 * (self.camera.mm_per_px or 0.0)
        by_ball = self._scale_of_ball(clip, pixels)
        if stated and by_ball and abs(stated / by_ball - 1.0) > _MOST_SCALE_DIFFERENCE:
            measured = f"{MM.number(by_ball)} mm/px"
            words = (
                f"the radius of the ball gives {measured}, the stated scale is "
                f"{MM.factor * stated:.3g} mm/px"
            )
            self.cells.note("scales-differ", f"{one_line(clip.name)}: {words}")
        scale = stated or by_ball
        if scale:
            return scale
        if "x" in pixels or "y" in pixels or self.camera.row_time:
            words = (
                "positions in pixels, and row_time, need a scale: expected --mm-per-px, "
                "mm_per_px in [camera], or --ball-diameter and a column radius [px]"
            )
            if all(fault.code != "no-scale" for fault in self.cells.faults):
                self.cells.fault("no-scale", words)
        return 1.0

    def _scale_of_ball(self, clip: _Clip, pixels: set[str]) -> float:
        """Metres a pixel by the radius of the ball, if the scene states it and enough frames show
        it; else 0.
        """
        radius = self.scene.ball.radius
        if isinstance(radius, ValueWithSd):
            radius = radius.value
        scale = 0.0
        if radius is None:
            return scale
        for name, share in (("radius", 1.0), ("diameter", 0.5)):
            if name in pixels:
                sizes = clip.values[name][clip.order]
                sizes = sizes[sizes > 0.0]
                if sizes.size >= _FEWEST_RADII:
                    scale = radius / (share * float(np.median(sizes)))
        return scale

    def _fold(self, clip: _Clip) -> int:
        """Number of times that the mark of a clip looks the same in a turn."""
        usual = float(self.camera.fold)
        folds = clip.column("angle_fold", usual)
        stated = clip.order[np.isfinite(folds[clip.order])]
        first = float(folds[stated[0]]) if stated.size else usual
        other = np.abs(folds[stated] - round(first)) > 0.0
        wrong = stated[other | (folds[stated] < 1.0)]
        if wrong.size:
            words = (
                f"read {folds[wrong[0]]:g}; expected one whole number in a clip, 1 for a dot, "
                "2 for a stripe"
            )
            self.cells.fault("fold", words, "angle_fold", int(clip.rows[wrong[0]]))
        return round(first)


def _first_indices(names: Sequence[str | None]) -> dict[str, int]:
    """The first index of each name, in the order of the last ones."""
    indices = dict[str, int]()
    for index, name in reversed([*enumerate(names)]):
        if name:
            indices[name] = index
    return indices


def _balls_of_points(
    names: Sequence[str], pattern: re.Pattern[str], clock: dict[str, int]
) -> list[_FilmedBall]:
    """The points of a dialect that names them in the header, with the clock that they share; those
    without x or y are left out.
    """
    points: dict[str, dict[str, int]] = {}
    for index, cell in enumerate(names):
        if match := pattern.fullmatch(cell):
            point = points.setdefault(match["name"], {**clock})
            point[match["axis"].casefold()] = index
    complete = {name: indices for name, indices in points.items() if {"x", "y"} <= {*indices}}
    return [
        _FilmedBall(name if len(complete) > 1 else "", indices, "_cam" in name.casefold())
        for name, indices in complete.items()
    ]


def _balls_of_masses(ours: Sequence[str | None]) -> list[_FilmedBall]:
    """The masses of Tracker, side by side: each x begins a mass, whose time is the last before
    it.
    """
    starts = [index for index, name in enumerate(ours) if name == "x"]
    balls = list[_FilmedBall]()
    for first, last in pairwise([*starts, len(ours)]):
        block = {name: first + k for name, k in _first_indices(ours[first:last]).items()}
        if "y" not in block:
            continue
        clock = {name: index for index, name in enumerate(ours[:first]) if name in ("t", "frame")}
        balls.append(_FilmedBall(str(len(balls) + 1), block | clock))
    return balls


def _frame_numbers(time: FloatArray) -> FloatArray:
    """Numbers (frames,), from 0, of the frames to which time stamps [s] belong; missing frames
    count.
    """
    steps = np.diff(time)
    if not steps.size:
        return np.zeros(1)
    usual = steps[steps < _MOST_STEPS_APART * np.median(steps)].mean()
    frames = np.maximum(np.round(steps / usual), 1.0)
    return np.concatenate([[0.0], np.cumsum(frames)])
