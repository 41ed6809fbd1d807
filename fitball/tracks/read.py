"""Long tables, Tracker, Kinovea, DLTdv -> `Track`.

| program | header | rows |
|---|---|---|
| any (long table) | `id`, `t` or `frame`, `x, y`, and others of `NAMES` | a frame of a ball |
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
from fitball.base.errors import Fault, InputError, Note, ParameterError, suggestion
from fitball.base.numbers import counted
from fitball.base.text import listed, one_line
from fitball.base.units import factor_of, symbol_of
from fitball.base.values import BoolArray, FloatArray, IntArray
from fitball.data.bundled import place_of
from fitball.data.cells import Cells, file_and_sheet, numbers, read_cells
from fitball.data.header import Naming, bare
from fitball.data.labels import role_of
from fitball.data.read import Source
from fitball.data.scene import CameraSection, Quantity, Scene, load_scene
from fitball.tracks.types import Track

# Columns of the long table with their units, and what else people and programs call them.
NAMES: Mapping[str, tuple[str, str]] = {
    "id": ("text", "track trackid object objectid shot trial impact particle clip name"),
    "session": ("text", "camera cam"),
    "t": ("s", "time times timestamp timestamps seconds zeit temps"),
    "frame": ("", "frames frameno framenumber frameindex image bild"),
    "x": ("m", "posx xpos positionx cx xc centerx centrex ballx"),
    "y": ("m", "posy ypos positiony cy yc centery centrey bally"),
    "z": ("m", "posz zpos positionz"),
    "angle": ("rad", "phi theta orientation winkel markangle"),
    "angle_fold": ("", "fold anglefold"),
    "radius": ("m", "r ballradius"),
    "diameter": ("m", "d diam balldiameter"),
    "quality": ("", "likelihood confidence conf score"),
}
_OURS = {word: ours for ours, (_, words) in NAMES.items() for word in (bare(ours), *words.split())}
_PIXELS = re.compile(
    r"(?P<name>.*?\w)[\s_/,]*[\[(]?\s*(?<![a-z])(?:px|pixels?)\s*[\])]?",
    re.IGNORECASE,
)
_DLTDV = re.compile(r"(?P<name>pt\d+(?:_cam\d+)?)_(?P<axis>[xyz])", re.IGNORECASE)
_KINOVEA = re.compile(r"(?P<name>.+?)(?:/0)?/(?P<axis>[xy])", re.IGNORECASE)
_LENGTH = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*([a-z]+)\s*", re.IGNORECASE)
_LONGEST = 100
# Coordinates without a unit that reach further [m] are none; radii that make a scale, and how far a
# stated one may be off without a note; the quality of a good frame.
_WIDEST = 30.0
_LEAST_RADII = 5
_SAME_SCALE = 0.02
_LEAST_QUALITY = 0.9
# What programs write for both coordinates of a frame in which they found no ball.
_LOST = (-99.0, -999.0, -9999.0, -99999.0)
# A step shorter than this many usual ones misses no frame.
_ONE_STEP = 1.5
# Endings of what people have beside their positions.
_FILMS = [
    "mp4",
    "mov",
    "avi",
    "mkv",
    "m4v",
    "wmv",
    "webm",
    "mts",
    "mpg",
    "mpeg",
    "cine",
    "gif",
    "trk",
    "trz",
    "kva",
]
_EXPECTED = (
    "expected x and y, t or frame, such as 'id,t [s],x [m],y [m]', or an export of "
    "Tracker, Kinovea, DLTdv"
)


class _Part(NamedTuple):
    """One ball of a file: what it adds to the file's name, the place of each column, whether it is
    in pixels.
    """

    name: str
    places: dict[str, int]
    pixels: bool = False


def scene_of(
    sources: Sequence[Source],
    scene: Scene | str | Path,
    fps: float,
    mm_per_px: float,
    ball_diameter: str,
) -> Scene:
    """The scene that is given, or that beside the first file, with what overrides it. Raises
    ParameterError (`length`), FolderError (`not-found`), InputError (`scene`).
    """
    first = sources[0] if sources and isinstance(sources[0], str | Path) else None
    beside = None if first is None else place_of(file_and_sheet(str(first))[0], "tracks")
    known = scene if isinstance(scene, Scene) else load_scene(beside, scene or None)
    stated = {name: value for name, value in (("fps", fps), ("mm_per_px", mm_per_px)) if value}
    camera = changed(known.camera or CameraSection(), **stated)
    ball = known.ball
    if ball_diameter:
        if (found := _LENGTH.fullmatch(ball_diameter)) is None:
            read = f"ball_diameter: read '{one_line(ball_diameter)}'"
            raise ParameterError(f"{read}; expected a length with its unit, such as 66mm", "length")
        ball = changed(ball, radius=0.5 * float(found[1]) * factor_of(found[2], "m"))
    return changed(known, camera=camera, ball=ball)


def read_tracks(
    sources: Sequence[Source],
    scene: Scene,
    columns: Mapping[str, str],
) -> tuple[list[Track], list[Note]]:
    """The tracks of files of positions, or of data frames with the same columns, and notes on what
    was assumed or left out. Raises InputError with every fault by row and column (`no-positions`,
    `no-column`, `no-rate`, `no-scale`, `three-coordinates`, `two-positions`, `same-table-twice`,
    `fold`, `film`, and what cells have), FolderError, ParameterError (`columns`, `no-data`).
    """
    if not sources:
        raise ParameterError("no film was given; expected tables of positions", "no-data")
    naming = _Naming({**scene.columns, **columns})
    tracks = list[Track]()
    notes = dict[Note, None]()
    digests = set[tuple[str, str]]()
    for source in sources:
        place = source
        sheet = ""
        name = str(getattr(source, "attrs", {}).get("name", "positions"))
        if isinstance(source, str | Path):
            file, sheet = file_and_sheet(str(source))
            path = place_of(file, "tracks")
            if path.suffix.lower()[1:] in _FILMS:
                words = (
                    "is no table of positions: open it in Tracker, Kinovea or DLTdv, and export one"
                )
                raise InputError(str(path), [Fault("film", words)])
            place = f"{path}#{sheet}" if sheet else path
            name = path.stem
        cells = read_cells(place, naming.worth, name)
        tracks += _Reader(cells, name, naming, scene).tracks()
        cells.refuse()
        # Sheets of one workbook are different films.
        if (cells.sha256, sheet) in digests:
            raise InputError(
                cells.source,
                [Fault("same-table-twice", "read a second time; give each film once")],
            )
        digests.add((cells.sha256, sheet))
        notes |= dict.fromkeys(cells.notes)
    count = Counter(one.id for one in tracks)
    seen = Counter[str]()
    for k, one in enumerate(tracks):
        seen[one.id] += 1
        tracks[k] = one if count[one.id] == 1 else replace(one, id=f"{one.id} ({seen[one.id]})")
    return tracks, [*notes]


class _Naming:
    """What header cells of positions mean, with the user's names. Raises ParameterError
    (`columns`).
    """

    def __init__(self, columns: Mapping[str, str]) -> None:
        for name in columns.keys() - NAMES.keys():
            words = (
                f"columns: '{one_line(name)}' is no column of positions; {suggestion(name, NAMES)}"
            )
            raise ParameterError(words, "columns")
        self.plain = Naming({})
        cells = {ours: self.split(their) for ours, their in columns.items()}
        self.theirs = {name.casefold(): (ours, unit) for ours, (name, unit) in cells.items()}

    def split(self, cell: str) -> tuple[str, str | None]:
        """Name and unit as written, `px` for pixels."""
        pixels = _PIXELS.fullmatch(cell.strip())
        if pixels:
            return pixels["name"], "px"
        name, unit = self.plain.split(cell)
        front, _, last = cell.strip().replace(" ", "_").rpartition("_")
        return (
            (front, last)
            if unit is None and bare(front) in _OURS and symbol_of(last)
            else (name, unit)
        )

    def read(self, cell: str) -> tuple[str | None, str | None]:
        """Our name of a cell (None: not used), and its unit as written."""
        name, unit = self.split(cell[:_LONGEST])
        said = self.theirs.get(cell.strip().casefold()) or self.theirs.get(name.casefold())
        return (said[0], unit or said[1]) if said else (_OURS.get(bare(name)), unit)

    def worth(self, cell: str) -> float:
        """What a cell is worth as one of a header."""
        return float(bool(_DLTDV.fullmatch(cell) or _KINOVEA.fullmatch(cell) or self.read(cell)[0]))


@dataclass
class _Reader:
    """A file on its way to tracks; faults go to its cells."""

    cells: Cells
    name: str
    naming: _Naming
    scene: Scene

    @property
    def camera(self) -> CameraSection:
        """What the scene says of it."""
        return self.scene.camera or CameraSection()

    def tracks(self) -> list[Track]:
        """The tracks; those with faults are left out."""
        cells = self.cells
        parts = self._parts()
        known = {
            name.casefold()
            for cell in cells.names
            for name in (cell.strip(), self.naming.split(cell)[0])
        }
        for their in self.naming.theirs.keys() - known:
            cells.fault(
                "no-column",
                f"columns: no column is '{one_line(their)}': {listed(cells.names, most=20)}",
            )
        if not parts:
            cells.fault("no-positions", f"read columns {listed(cells.names, most=12)}; {_EXPECTED}")
        for part in [part for part in parts if "z" in part.places]:
            words = (
                "three coordinates; expected x along the court and y upwards: project onto "
                "the plane of flight"
            )
            cells.fault("three-coordinates", words, cells.names[part.places["z"]])
        cells.refuse()
        measured = [k for part in parts for n, k in part.places.items() if NAMES[n][0] != "text"]
        values = numbers(cells, {self._key(k): k for k in measured})
        cells.refuse()
        return [one for part in parts for one in self._of_part(part, values)]

    def _key(self, place: int) -> str:
        """What a column is called in faults: its cell, with its number where cells repeat."""
        name = self.cells.names[place]
        return name if self.cells.names.count(name) == 1 else f"{name} ({place + 1})"

    def _parts(self) -> list[_Part]:
        """The balls of a file, by its dialect."""
        names = [one.strip() for one in self.cells.names]
        ours = [self.naming.read(cell)[0] for cell in names]
        shared = {name: k for k, name in reversed([*enumerate(ours)]) if name}
        clock: dict[str, int] = {name: k for name, k in shared.items() if name in ("t", "frame")}
        for pattern in (_DLTDV, _KINOVEA):
            points: dict[str, dict[str, int]] = {}
            for k, cell in enumerate(names):
                if found := pattern.fullmatch(cell):
                    points.setdefault(found["name"], {**clock})[found["axis"].casefold()] = k
            whole = {name: places for name, places in points.items() if {"x", "y"} <= {*places}}
            if whole:
                return [
                    _Part(n * (len(whole) > 1), p, "_cam" in n.casefold()) for n, p in whole.items()
                ]
        starts = [k for k, name in enumerate(ours) if name == "x"]
        if len(starts) < 2:
            return [_Part("", shared)] if {"x", "y"} <= {*shared} else []
        # Masses side by side: each x begins one, its time is the last before it.
        parts = list[_Part]()
        for first, last in pairwise([*starts, len(ours)]):
            block = {
                what: j for j, what in reversed([*enumerate(ours[:last])]) if what and j >= first
            }
            times = {what: j for j, what in enumerate(ours[:first]) if what in ("t", "frame")}
            parts += [_Part(str(len(parts) + 1), {**block, **times})] if "y" in block else []
        return parts

    def _of_part(self, part: _Part, values: Mapping[str, FloatArray]) -> Iterator[Track]:
        """The tracks of a ball, one for each id and session, or for each time that the clock starts
        again.
        """
        cells = self.cells
        columns = dict[str, FloatArray]()
        pixels = set[str]()
        own = {
            name: values[self._key(k)]
            for name, k in part.places.items()
            if NAMES[name][0] != "text"
        }
        codes = [np.isclose(own["x"], code) & np.isclose(own["y"], code) for code in _LOST]
        self._left_out(
            self.name,
            lost := np.any(codes, axis=0),
            "both coordinates are a code, such as -999",
        )
        for name, written in own.items():
            si = NAMES[name][0]
            unit = self.naming.read(cells.names[part.places[name]])[1]
            column = np.where(lost, np.nan, written)
            if si == "m" and unit is None:
                unit = (
                    "px"
                    if part.pixels
                    else self._assumed(np.where(lost, np.nan, [own["x"], own["y"]]))
                )
            if unit == "px" and si == "m":
                pixels.add(name)
            elif si:
                try:
                    column *= factor_of(unit, si)
                except ParameterError as error:
                    cells.fault(error.code, str(error), self._key(part.places[name]))
            columns[name] = column
        cells.refuse()
        ids, sessions = (
            cells.text(part.places[name]) if name in part.places else [""] * len(cells.rows)
            for name in ("id", "session")
        )
        clock = columns.get("t", columns.get("frame", np.arange(float(len(cells.rows)))))
        turns = np.zeros(len(clock), dtype=np.int64)
        timed = np.flatnonzero(np.isfinite(clock))
        if "id" not in part.places:
            turns[timed[1:]] = np.diff(clock[timed]) < 0.0
            turns = np.cumsum(turns)
        groups: dict[tuple[str, str, int], list[int]] = {}
        for k, key in enumerate(zip(sessions, ids, turns.tolist(), strict=True)):
            groups.setdefault(key, []).append(k)
        labels = {
            n: cells.text(k)
            for k, n in enumerate(cells.names)
            if role_of(n) and not self.naming.read(n)[0]
        }
        for (session, one, turn), rows in groups.items():
            # Objects of Kinovea have names of their own.
            file = "" if part.name and not re.fullmatch(r"\d+|pt\d.*", part.name) else self.name
            name = one or "-".join(
                filter(None, [file, part.name, str(turn + 1) * bool(turns.any())])
            )
            named = {n: text[rows[0]] for n, text in labels.items()} | (
                {"session": session} if session else {}
            )
            if track := self._track(name, np.array(rows), columns, pixels, named):
                yield track

    def _assumed(self, place: FloatArray) -> str:
        """The unit of lengths (2, rows) that state none: nobody films a bounce so wide that it
        could be metres.
        """
        known = np.isfinite(place).all(axis=0)
        wide = bool(known.any() and np.ptp(place[:, known], axis=1).max() > _WIDEST)
        self.cells.note(
            "no-unit",
            f"{self.name}: coordinates without a unit were read as {'px' if wide else 'm'}",
        )
        return "px" if wide else "m"

    def _track(
        self,
        name: str,
        rows: IntArray,
        columns: Mapping[str, FloatArray],
        pixels: set[str],
        labels: dict[str, str],
    ) -> Track | None:
        """The frames of a clip in which the ball was found, by time; None where there are none."""
        camera = self.camera
        fps = self.camera.fps
        own = {what: column[rows] for what, column in columns.items()}
        unsure = own.get("quality", np.ones(rows.size)) < _LEAST_QUALITY
        self._left_out(name, unsure, f"the quality is below {_LEAST_QUALITY:g}")
        frame = own.get("frame", np.arange(1.0, rows.size + 1.0))
        clock = own["t"] if "t" in own and (fps is None or "frame" not in own) else frame
        seen = np.flatnonzero(np.isfinite(own["x"] + own["y"] + clock) & ~unsure)
        order = seen[np.argsort(clock[seen], kind="stable")]
        if not order.size:
            return None
        twice = np.flatnonzero(np.diff(clock[order]) <= 0.0)
        if twice.size:
            words = (
                f"'{one_line(name)}' has two positions at one time ({twice.size} times); "
                "expected an id a ball"
            )
            self.cells.fault("two-positions", words, None, int(rows[order[twice[0] + 1]]))
        place = np.column_stack([own["x"], own["y"]])[order]
        again = np.concatenate([[False], ~np.any(np.diff(place, axis=0), axis=1)])
        self._left_out(name, again, "they repeat the one before")
        order = order[~again]
        place = place[~again]
        if fps is None and clock is frame:
            self.cells.fault(
                "no-rate",
                "frames have no time; expected the camera's rate: --fps, or fps in [camera]",
            )
        time = (
            clock[order]
            if fps is None
            else (frame[order] if clock is frame else _counted(clock[order])) / fps
        )
        size = self._metres_per_px(name, own, order, pixels)
        fold = self._fold(own, rows, order)
        x, y = (place * [size if axis in pixels else 1.0 for axis in "xy"]).T
        y = -y if camera.y == "down" else y
        if camera.row_time:
            # Rows count downwards; from which edge only moves the clock.
            time = time - camera.row_time * y / size
        angle = own.get("angle", np.full(rows.size, np.nan))[order]
        angle = -angle if camera.angles == "clockwise" else angle
        return Track(name, np.round(frame[order]).astype(np.int64), time, x, y, angle, fold, labels)

    def _left_out(self, name: str, which: BoolArray, why: str) -> None:
        if which.any():
            of = counted(which.size, "frame")
            self.cells.note(
                "frames-left-out",
                f"{one_line(name)}: {which.sum()} of {of} left out: {why}",
            )

    def _metres_per_px(
        self,
        name: str,
        own: Mapping[str, FloatArray],
        order: IntArray,
        pixels: set[str],
    ) -> float:
        """Metres a pixel, as stated or by the radius of the ball in the picture; 1 where nothing
        needs it.
        """
        camera = self.camera
        ball = self.scene.ball.radius
        stated = 1e-3 * (camera.mm_per_px or 0.0)
        by_ball = 0.0
        for what, share in (("radius", 1.0), ("diameter", 0.5)):
            sizes = own[what][order][own[what][order] > 0.0] if what in pixels else np.empty(0)
            if ball is not None and sizes.size >= _LEAST_RADII:
                by_ball = (ball.value if isinstance(ball, Quantity) else ball) / (
                    share * float(np.median(sizes))
                )
        if stated and by_ball and abs(stated / by_ball - 1.0) > _SAME_SCALE:
            scale = (
                f"{MM.number(by_ball)} mm/px, the stated scale is {MM.factor * stated:.3g} mm/px"
            )
            self.cells.note(
                "scales-differ",
                f"{one_line(name)}: the radius of the ball gives {scale}",
            )
        if not (stated or by_ball) and ({"x", "y"} & pixels or camera.row_time):
            words = (
                "positions in pixels, and row_time, need a scale: expected --mm-per-px, "
                "mm_per_px in [camera], or"
            )
            if all(fault.code != "no-scale" for fault in self.cells.faults):
                self.cells.fault("no-scale", f"{words} --ball-diameter and a column radius [px]")
        return stated or by_ball or 1.0

    def _fold(self, own: Mapping[str, FloatArray], rows: IntArray, order: IntArray) -> int:
        """After which part of a turn the mark of a clip looks the same."""
        folds = own.get("angle_fold", np.full(rows.size, float(self.camera.fold)))
        known = order[np.isfinite(folds[order])]
        first = float(folds[known[0]]) if known.size else float(self.camera.fold)
        wrong = known[(folds[known] < 1.0) | (np.abs(folds[known] - round(first)) > 0.0)]
        if wrong.size:
            words = (
                f"read {folds[wrong[0]]:g}; expected one whole number in a clip, 1 for a dot, "
                "2 for a stripe"
            )
            self.cells.fault("fold", words, "angle_fold", int(rows[wrong[0]]))
        return round(first)


def _counted(time: FloatArray) -> FloatArray:
    """Numbers of the frames to which stamps belong, those that are missing counted."""
    steps = np.diff(time)
    usual = steps[steps < _ONE_STEP * np.median(steps)].mean() if steps.size else 1.0
    return np.concatenate([[0.0], np.cumsum(np.maximum(np.round(steps / usual), 1.0))])
