"""The tracks of one table of positions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fitball.base.errors import ParameterError
from fitball.base.numbers import counted
from fitball.base.text import listed, one_line
from fitball.base.units import factor_of
from fitball.base.values import BoolArray, FloatArray, IntArray
from fitball.data.cells import TableCells, numbers
from fitball.data.idle import idle_note, stated_of_camera
from fitball.data.labels import role_of
from fitball.data.records import NUMBER
from fitball.data.scene import CameraSection, Scene
from fitball.tracks.choice import Choice
from fitball.tracks.clock import (
    ClipClock,
    clock_of_clip,
    is_idle,
    numbers_in_names,
    seconds_of_texts,
)
from fitball.tracks.find import FEWEST_FRAMES
from fitball.tracks.names import BOX_COLUMNS, POSITION_COLUMNS, TICK, FilmNaming
from fitball.tracks.objects import FilmedBall, balls_of_header
from fitball.tracks.omitted import (
    coded,
    is_share,
    least_confidence,
    proposed_confidence,
    unseen,
)
from fitball.tracks.polar import polar_columns
from fitball.tracks.scale import Clip, relative_sd_of_radius, row_time_of, scale_of_clip
from fitball.tracks.space import MOST_FLAT, in_plane, is_flat
from fitball.tracks.types import Track

# Coordinates without a unit that reach further [m] are in pixels.
_MOST_METRES = 30.0
_EXPECTED = (
    "expected x and y, t or frame, such as 'id,t [s],x [m],y [m]', or an export of "
    "Tracker, Kinovea, DLTdv, DeepLabCut, SLEAP"
)
# Keys of [camera] that are used where a film has one of these.
_USED_WITH = {
    "mm_per_px": ("x [px]", "y [px]", "row_time"),
    "angles": ("angle",),
    "fold": ("angle",),
    "min_confidence": ("quality",),
}
# The centre of a box along each axis: the near edge, the far one, or else the size.
_BOXES = (("x", "left", "right", "width"), ("y", "top", "bottom", "height"))


class _Columns(NamedTuple):
    """Numbers (frames,) of one ball by column, in SI but those named in `pixels`; NaN where the
    ball was lost.
    """

    values: Mapping[str, FloatArray]
    pixels: set[str]


@dataclass
class Reader:
    """Reads the tracks of a file; faults are added to its cells. `unsure` holds the confidences of
    clips in which none is high enough, `read` the columns of clips that were read.
    """

    cells: TableCells
    name: str
    naming: FilmNaming
    scene: Scene
    wanted: str = ""
    unsure: list[FloatArray] = field(default_factory=list)
    read: set[str] = field(default_factory=set)

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
        objects = balls_of_header(cells, self.naming)
        self._check_names(objects)
        cells.refuse()
        choice = Choice(cells, self.name, self.wanted)
        choice.check_wanted(objects)
        balls = choice.balls(objects)
        cells.refuse()
        values = self._numbers(balls)
        cells.refuse()
        tracks = [track for ball in balls for track in self._tracks_of(ball, values)]
        if self.unsure and not tracks:
            self._refuse_unsure()
        idle = [key for key, columns in _USED_WITH.items() if self.read.isdisjoint(columns)]
        cells.notes += idle_note(stated_of_camera(self.scene, idle), f"the track of {self.name}")
        return tracks

    def _check_names(self, balls: Sequence[FilmedBall]) -> None:
        """Add faults of user's columns that the header lacks, and of a header without positions."""
        cells = self.cells
        headers = set[str]()
        for cell in cells.names:
            name, _ = self.naming.split(cell)
            headers |= {cell.strip().casefold(), name.casefold()}
        for their in self.naming.theirs.keys() - headers:
            columns = listed(cells.names, most=20)
            cells.fault("no-column", f"columns: no column is '{one_line(their)}': {columns}")
        if balls:
            return
        expected = _EXPECTED
        if all(map(NUMBER.fullmatch, cells.names)):
            expected = f"the first row has no names: write a header above it; {_EXPECTED}"
        cells.fault("no-positions", f"read columns {listed(cells.names, most=12)}; {expected}")

    def _key(self, index: int) -> str:
        """The name of a column in faults: its cell, with its number where cells repeat."""
        name = self.cells.names[index]
        return name if self.cells.names.count(name) == 1 else f"{name} ({index + 1})"

    def _numbers(self, balls: Sequence[FilmedBall]) -> dict[str, FloatArray]:
        """The numbers (rows,) of all columns of balls as they are written, by key. Frames may be
        named by files, and times be written in hours, minutes and seconds.
        """
        measured = dict[str, int]()
        special = dict[str, FloatArray]()
        for ball in balls:
            for name, index in ball.indices.items():
                if POSITION_COLUMNS[name][0] == "text":
                    continue
                key = self._key(index)
                written = None
                if name in ("frame", "t") and np.isnan(self.cells.plain_numbers(index)).any():
                    texts = self.cells.text(index)
                    if name == "frame":
                        written = numbers_in_names(texts, self._texts(ball, "id"))
                    else:
                        written = seconds_of_texts(texts)
                if written is None:
                    measured[key] = index
                else:
                    special[key] = written
        return {**numbers(self.cells, measured), **special}

    def _tracks_of(self, ball: FilmedBall, values: Mapping[str, FloatArray]) -> Iterator[Track]:
        """The tracks of a ball, one for each id and session, or for each time that the clock starts
        again.
        """
        clips = self._clips(ball, values)
        columns = self._in_si(ball, values, [*clips.values()])
        self.cells.refuse()
        all_labels = self._labels()
        file = "" if ball.names_itself else self.name
        restarted = len({restart for *_, restart in clips}) > 1
        for (session, track_id, restart), rows in clips.items():
            number = str(restart + 1) if restarted else ""
            name = track_id or "-".join(filter(None, [file, ball.name, number]))
            labels = {column: texts[rows[0]] for column, texts in all_labels.items()}
            if session:
                labels["session"] = session
            track = self._track(name, ball, rows, columns, labels)
            if track is not None:
                yield track

    def _clips(
        self, ball: FilmedBall, values: Mapping[str, FloatArray]
    ) -> dict[tuple[str, str, int], IntArray]:
        """The rows of each clip, by session, id, and how often the clock started again before;
        those of parts and ids that are no ball are left out.
        """
        count = len(self.cells.rows)
        clock = np.arange(float(count))
        for name in ("frame", "t"):
            if name in ball.indices and not is_idle(values[self._key(ball.indices[name])]):
                clock = values[self._key(ball.indices[name])]
        sessions = self._texts(ball, "session")
        ids = self._texts(ball, "id")
        parts = self._texts(ball, "part")
        used = Choice(self.cells, self.name, self.wanted).rows(parts, ids, clock)
        several_parts = len({parts[row] for row in used}) > 1
        restarts = np.zeros(count, dtype=np.int64)
        if "id" not in ball.indices and not several_parts:
            timed = used[np.isfinite(clock[used])]
            restarts[timed[1:]] = np.diff(clock[timed]) < 0.0
            # Rows in another order than that of time begin no clips.
            in_order = restarts.sum() * FEWEST_FRAMES <= timed.size
            restarts = np.cumsum(restarts) * in_order
        groups: dict[tuple[str, str, int], list[int]] = {}
        for row in used.tolist():
            names = [ids[row], parts[row] if several_parts else ""]
            key = (sessions[row], "-".join(filter(None, names)), int(restarts[row]))
            groups.setdefault(key, []).append(row)
        return {key: np.array(rows) for key, rows in groups.items()}

    def _in_si(
        self,
        ball: FilmedBall,
        values: Mapping[str, FloatArray],
        clips: Sequence[IntArray],
    ) -> _Columns:
        """The numbers of a ball in SI or pixels, NaN where it was lost. Faults of units go to the
        cells.
        """
        written = dict[str, FloatArray]()
        for name, index in ball.indices.items():
            if POSITION_COLUMNS[name][0] != "text":
                written[name] = values[self._key(index)]
        y = written["y"] if "y" in written else written["top"]
        # Heights alone have the codes of positions, too.
        x = written.get("x", written.get("left", y))
        lost = self._lost(ball, x, y, clips)
        columns = dict[str, FloatArray]()
        pixels = set[str]()
        for name, numbers_of in written.items():
            si, _ = POSITION_COLUMNS[name]
            unit = self.naming.read(self.cells.names[ball.indices[name]]).unit
            column = np.where(lost, np.nan, numbers_of)
            if si == "m" and unit is None:
                unit = "px" if ball.pixels else self._likely_unit(np.where(lost, np.nan, [x, y]))
            if unit == "px" and si == "m":
                pixels.add(name)
            elif unit == TICK and si == "s":
                self._check_ticks(ball.indices[name])
            elif si or unit == "%":
                try:
                    column *= factor_of(unit, si)
                except ParameterError as error:
                    self.cells.fault(error.code, str(error), self._key(ball.indices[name]))
            columns[name] = column
        if ball.vertical:
            columns["x"] = np.zeros(y.size)
        self._put_centres(columns, pixels)
        self._drop_what_is_none(ball, columns, pixels)
        return _Columns(columns, pixels)

    def _lost(
        self, ball: FilmedBall, x: FloatArray, y: FloatArray, clips: Sequence[IntArray]
    ) -> BoolArray:
        """In which rows (rows,) the ball was not found, by codes for positions and by visibility;
        their numbers are noted.
        """
        clip_of_row = np.full(x.size, -1)
        for number, rows in enumerate(clips):
            clip_of_row[rows] = number
        is_coded = coded(x, y, clip_of_row)
        is_unseen = unseen(self._texts(ball, "visibility"))
        rows = np.flatnonzero(clip_of_row >= 0)
        self._note_omitted(self.name, is_unseen[rows], "the ball is not visible")
        words = "both coordinates are a code, such as -999 or 0"
        self._note_omitted(self.name, (is_coded & ~is_unseen)[rows], words)
        return is_coded | is_unseen

    def _check_ticks(self, index: int) -> None:
        """Add a fault where stamps are in ticks of an unknown length, and no rate is stated."""
        if self.camera.fps is None:
            words = (
                "counts ticks, whose length is unknown; expected the camera's rate: --fps, or fps "
                "in [camera]"
            )
            self.cells.fault("no-rate", words, self._key(index))

    def _put_centres(self, columns: dict[str, FloatArray], pixels: set[str]) -> None:
        """Put the centres of boxes in place of their corners and sizes. Fault: corners are not
        those of boxes.
        """
        for axis, near, far, size in _BOXES:
            if axis in columns:
                continue
            extent = columns[far] - columns[near] if far in columns else columns[size]
            if (extent <= 0.0).any():
                words = f"{near} and {far} are no edges of boxes: one has no {size}; {_EXPECTED}"
                self.cells.fault("no-positions", words)
            columns[axis] = columns[near] + 0.5 * extent
            if near in pixels:
                pixels.add(axis)
        for name in BOX_COLUMNS:
            columns.pop(name, None)
            pixels.discard(name)

    def _drop_what_is_none(
        self, ball: FilmedBall, columns: dict[str, FloatArray], pixels: set[str]
    ) -> None:
        """Leave out columns that are not what their names say: polar coordinates, confidences
        beyond 1, a third coordinate that hardly moves.
        """
        for name, what in polar_columns(columns).items():
            del columns[name]
            pixels.discard(name)
            head = one_line(self._key(ball.indices[name]))
            words = f"{self.name}: '{head}' is {what}, no {name} of the ball: it is not used"
            self.cells.note("polar-column", words)
        if "quality" in columns and not is_share(columns["quality"]):
            head = one_line(self._key(ball.indices["quality"]))
            del columns["quality"]
            words = f"{self.name}: '{head}' is no confidence from 0 to 1: it is not used"
            self.cells.note("no-confidence", words)
        if "z" in columns and is_flat(columns["x"], columns["y"], columns["z"]):
            head = one_line(self._key(ball.indices["z"]))
            if np.unique(columns["z"][np.isfinite(columns["z"])]).size > 1:
                words = f"moves by less than {MOST_FLAT:.0%} of the others: it is not used"
                self.cells.note("flat-coordinate", f"{self.name}: '{head}' {words}")
            del columns["z"]
            pixels.discard("z")

    def _texts(self, ball: FilmedBall, name: str) -> list[str]:
        """The texts (rows,) of a column of a ball, empty without one."""
        if name in ball.indices:
            return self.cells.text(ball.indices[name])
        return [""] * len(self.cells.rows)

    def _labels(self) -> dict[str, list[str]]:
        """Texts (rows,) of columns of labels that have no meaning for a film, by head."""
        labels = dict[str, list[str]]()
        for index, name in enumerate(self.cells.names):
            if role_of(name) and not self.naming.read(name).ours:
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
        ball: FilmedBall,
        rows: IntArray,
        columns: _Columns,
        labels: dict[str, str],
    ) -> Track | None:
        """The track of a clip: frames in which the ball was found, by time; None without any."""
        camera = self.camera
        values = {column: numbers_of[rows] for column, numbers_of in columns.values.items()}
        unsure = self._unsure(name, values, rows)
        clock = clock_of_clip(self.cells, name, values, rows, camera.fps, self._read_columns(ball))
        self._put_in_plane(ball, values, clock)
        measured = np.flatnonzero(np.isfinite(values["x"] + values["y"] + clock.clock) & ~unsure)
        order = measured[np.argsort(clock.clock[measured], kind="stable")]
        if not order.size:
            if unsure.any():
                self.unsure.append(values["quality"])
            return None
        if not self._is_at_one_place(name, rows, clock.clock, order):
            return None
        positions = np.column_stack([values["x"], values["y"]])[order]
        moved = np.any(np.diff(positions, axis=0), axis=1)
        # A ball whose x stands still was dropped: it has one height twice where it turns around.
        stands_still = order.size >= FEWEST_FRAMES and not np.ptp(positions[:, 0]) > 0.0
        vertical = ball.vertical or stands_still
        repeated = np.concatenate([[False], ~moved & (not vertical)])
        self._note_omitted(name, repeated, "they repeat the one before")
        if vertical:
            words = "no x, or one that stands still: the ball moves straight up and down"
            self.cells.note("heights-alone", f"{self.name}: {words}")
        clip = Clip(name, rows, values, order[~repeated])
        order = clip.order
        time = clock.seconds(order)
        scale, radius_px = scale_of_clip(self.cells, self.scene, clip, columns.pixels)
        self.read |= {*ball.indices, *(f"{column} [px]" for column in columns.pixels)}
        fold = self._fold(clip)
        x = values["x"][order] * (scale if "x" in columns.pixels else 1.0)
        upwards = -1.0 if camera.y == "down" else 1.0
        y = upwards * values["y"][order] * (scale if "y" in columns.pixels else 1.0)
        if row_time := row_time_of(camera):
            self.read.add("row_time")
            # Rows count downwards; from which edge only moves the clock.
            time = time - row_time * y / scale
        angle = clip.column("angle", np.nan)[order]
        if camera.angles == "clockwise":
            angle = -angle
        number = np.round(clock.frame[order]).astype(np.int64)
        return Track(
            id=name,
            frame=number,
            time=time,
            x=x,
            y=y,
            angle=angle,
            fold=fold,
            labels=labels,
            radius_px=radius_px,
            vertical=vertical,
            radius_sd=relative_sd_of_radius(clip, columns.pixels, radius_px),
            metres_per_px=scale if "y" in columns.pixels else np.nan,
        )

    def _read_columns(self, ball: FilmedBall) -> set[int]:
        """The indices of columns that are read, for a ball or as labels."""
        named = enumerate(self.cells.names)
        labels = {k for k, name in named if role_of(name) or self.naming.read(name).ours}
        return labels | {*ball.indices.values()}

    def _unsure(self, name: str, values: Mapping[str, FloatArray], rows: IntArray) -> BoolArray:
        """In which frames (frames,) of a clip the confidence is too low; their number is noted."""
        least = least_confidence(self.camera)
        unsure = values.get("quality", np.ones(rows.size)) < least
        self._note_omitted(name, unsure, f"the confidence is below {least:g} (--min-confidence)")
        return unsure

    def _refuse_unsure(self) -> None:
        """Refuse a film of which all frames have too low a confidence."""
        confidence = np.concatenate(self.unsure)
        low, high = np.nanmin(confidence), np.nanmax(confidence)
        read = f"all {counted(confidence.size, 'frame')} have a confidence below"
        words = f"{read} {least_confidence(self.camera):g}: {low:.3g} to {high:.3g}"
        remedy = f"use them with --min-confidence {proposed_confidence(confidence):g}"
        self.cells.fault("low-confidence", f"{words}; {remedy}")

    def _put_in_plane(
        self, ball: FilmedBall, values: dict[str, FloatArray], clock: ClipClock
    ) -> None:
        """Put positions in the plane of flight in place of three coordinates, which are a fault
        where the ball leaves the plane.
        """
        if "z" not in values:
            return
        positions = np.column_stack([values["x"], values["y"], values.pop("z")])
        plane = in_plane(positions, clock.clock)
        if plane is not None and plane.off_plane <= MOST_FLAT:
            values["x"], values["y"] = plane.x, plane.y
            words = f"{self.name}: three coordinates were projected onto the plane of flight"
            self.cells.note("projected", words)
            return
        what = "no coordinate turns around, as heights do in a bounce"
        if plane is not None:
            what = f"the ball moves sideways by {plane.off_plane:.0%} of its way along"
        words = f"three coordinates, and {what}; expected x along the court and y upwards"
        remedy = "project onto the plane of flight"
        self.cells.fault("three-coordinates", f"{words}: {remedy}", self._key(ball.indices["z"]))

    def _is_at_one_place(
        self, name: str, rows: IntArray, clock: FloatArray, order: IntArray
    ) -> bool:
        """Whether a ball is at one place at each time; a fault where it is not."""
        twice = np.flatnonzero(np.diff(clock[order]) <= 0.0)
        if twice.size:
            words = (
                f"'{one_line(name)}' has two positions at one time ({twice.size} times); "
                "expected an id a ball, or a column frame where times are too coarse"
            )
            self.cells.fault("two-positions", words, None, int(rows[order[twice[0] + 1]]))
        return not twice.size

    def _note_omitted(self, name: str, which: BoolArray, why: str) -> None:
        """Note how many frames are left out, if any."""
        if which.any():
            of = counted(which.size, "frame")
            words = f"{one_line(name)}: {which.sum()} of {of} left out: {why}"
            self.cells.note("frames-left-out", words)

    def _fold(self, clip: Clip) -> int:
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
