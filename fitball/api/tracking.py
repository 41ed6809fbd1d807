"""From positions of a ball on film to a table of impacts with their errors, for Python and the command line."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fitball.data.bundled import resolve_tracks
from fitball.data.heights import like_tennis
from fitball.data.read import PATHS, load_table
from fitball.data.scene import Camera, Quantity, Scene, load_scene
from fitball.data.table import FrozenMapping, ImpactTable
from fitball.data.units import Dimension, parse_unit
from fitball.errors import ParameterError, TrackError, UnitError
from fitball.kinds import checked
from fitball.report.form.folders import clear_folder, held
from fitball.report.tracks.document import render, track_json
from fitball.tracks.clips import Reading
from fitball.tracks.dialects import NAMES
from fitball.tracks.filmed import assumptions_of, filmed_from, reading_from
from fitball.tracks.frames import Refused, Track, Tracks
from fitball.tracks.impacts import covariance_rows, frame_rows, impact_rows
from fitball.tracks.judged import mark_words
from fitball.tracks.read import Source, read_tracks
from fitball.tracks.session import estimate
from fitball.tracks.split import bounces_of
from fitball.values import Ball
from fitball.wording import option

if TYPE_CHECKING:
    import pandas as pd

    from fitball.report.figures.canvas import Figure

PathLike = str | os.PathLike[str]
# A number with its unit, as in 0.8mm/px.
_LENGTH = re.compile(r"\s*(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(?P<unit>.*?)\s*")
PX = ("px", "pixel", "pixels")


@dataclass(frozen=True, repr=False)
class TrackResult:
    """Impacts found on film: `tracks` with all that was found, the names of the `sources`, and the `scene`, whose
    camera has what the session shares.
    """

    tracks: Tracks
    sources: tuple[str, ...]
    scene: Scene

    def __repr__(self) -> str:
        return f"<TrackResult: {len(self.tracks.impacts)} impacts, {len(self.tracks.refused)} tracks without one>"

    def _repr_html_(self) -> str:
        """The impacts, for a notebook."""
        return f"<p>{repr(self)[1:-1]}</p>{self.frame.to_html(max_rows=20, notebook=True)}"

    @property
    def frame(self) -> pd.DataFrame:
        """One row for each impact, as in `impacts.csv`."""
        import pandas as pd

        return pd.DataFrame(impact_rows(self.tracks)).set_index("id")

    @property
    def frames(self) -> pd.DataFrame:
        """One row for each frame of each impact, as in `tracks.csv`."""
        import pandas as pd

        return pd.DataFrame(frame_rows(self.tracks))

    @property
    def table(self) -> ImpactTable:
        """The impacts as a table with its covariances: `fitball.calibrate(result.table, scene=result.scene)`.

        Raises TableError where there are too few for a table.
        """
        covariances: dict[str, dict[tuple[str, str], float]] = {}
        for row in covariance_rows(self.tracks):
            pair = str(row["column_1"]), str(row["column_2"])
            covariances.setdefault(str(row["id"]), {})[pair] = float(row["value"])  # type: ignore[arg-type]
        return load_table(self.frame, scene=self.scene, name="tracks", covariance=covariances)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was decided and doubted, and why tracks have no impact."""
        own = [f"impact {impact.id}: {note}" for impact in self.tracks.impacts for note in impact.notes]
        files = [f"{impact.track.id}: {note}" for impact in self.tracks.impacts for note in impact.track.notes]
        refused = [f"{item.id}: {item.reason}" for item in self.tracks.refused]
        return tuple(dict.fromkeys([*refused, *self.tracks.notes, *own, *files]))

    @checked
    def report(self, folder: Path | None = None) -> str:
        """The result as text, with the `folder` that it was saved in."""
        return render(self.tracks, self.sources, folder)

    def json(self) -> Mapping[str, object]:
        """Impacts, session, refusals and notes in SI."""
        return track_json(self.tracks)

    @checked
    def plot(self, impact: str | None = None) -> Figure:
        """One impact by its id, or COR and gaps of all, as a matplotlib Figure that is not registered with pyplot.

        Raises ParameterError for an unknown id.
        """
        from fitball.report.tracks.figure import impact_figure, session_figure

        if impact is None:
            return session_figure(self.tracks)
        found = [one for one in self.tracks.impacts if one.id == impact]
        if not found:
            some = ", ".join(one.id for one in self.tracks.impacts[:5])
            raise ParameterError(f"impact = {impact!r}: no impact has this id; ids begin with {some}")
        return impact_figure(found[0], self.tracks)

    @checked
    def save(
        self, folder: PathLike, *, overwrite: bool = False, figures: bool = True, command: str | None = None
    ) -> tuple[Path, ...]:
        """Write `impacts.csv` with its covariances and scene, `tracks.csv`, `spins.csv` and `tracks.html`; returns
        their places. Raises ResultFolderError.
        """
        from fitball.report.tracks.folder import OTHERS, TABLE, write_all

        path = Path(folder)
        with held(path):
            clear_folder(path, TABLE, *OTHERS, overwrite=overwrite)
            return write_all(self.tracks, self.sources, self.scene.source, path, command, figures)


@checked
def track(
    data: Any,
    *,
    fps: float | None = None,
    scene: Scene | PathLike | None = None,
    ball: Ball | None = None,
    scale: str | float | None = None,
    ball_diameter: str | float | None = None,
    court: str | float | None = None,
    y_down: bool | None = None,
    up: str | None = None,
    unit: str | None = None,
    fold: int | None = None,
    clockwise: bool = False,
    columns: Mapping[str, str] | None = None,
    as_read: bool = False,
) -> TrackResult:
    """Find impacts in positions of a ball on film, with the errors of the states before and after.

    `data` is a file of positions, a DataFrame, or several: long tables (`id, t [s] | frame, x [m], y [m]`, and
    `angle [deg], angle_fold, radius, quality` where known) and exports of tracking programs. `fps` are frames per
    second where a file counts frames. Pixels need a `scale`, as "0.8mm/px" or a number [m/px], or a column `radius`
    with `ball_diameter` ("66mm" or [m]). `court` is the height of the court in the coordinates of the file (a text
    with a unit, or [m]); without it, the height is found from the contacts. `scene` has ball, contact time and
    `[camera]`; `ball` replaces its ball. `y_down`, `up` and `unit` say what a file does not, `fold` after which part
    of a turn a mark looks the same (1: a dot, 2: a stripe), and `columns` how its columns are named. Angles of marks
    grow counterclockwise in the picture, or `clockwise`.

    Raises TableError for a file that cannot be read, with what was expected; TrackError where no track has an impact;
    ParameterError, SceneError.

    >>> fitball.track("table_tennis_topspin")
    <TrackResult: ... impacts, ... tracks without one>
    """
    sources = [data] if isinstance(data, PATHS) or hasattr(data, "columns") else list(data)
    known = _scene_of(scene, sources)
    diameter = None if ball_diameter is None else _length("ball_diameter", ball_diameter)
    if ball is None and diameter is not None and not known.states_ball:
        ball = _ball(diameter)
    used = replace(known, ball=ball) if ball is not None else known
    camera = used.camera or Camera()
    fps = camera.fps if fps is None else fps
    if fps is not None and not (math.isfinite(fps) and fps > 0.0):
        raise ParameterError(f"{option('fps', f'{fps:g}')}: expected a positive number of frames per second")
    _check_stated(up, unit, fold, columns or {})
    given = Reading(
        fps=fps,
        metres_per_px=None if scale is None else _per_px(scale),
        ball_diameter=diameter,
        states_ball=ball is not None,
        y_down=y_down,
        up=up,
        unit=unit,
        fold=fold,
        clockwise=clockwise,
        columns=FrozenMapping(columns or {}),
        as_read=as_read,
    )
    how = reading_from(used, given)
    read = read_tracks(sources, how)
    whole, refused = bounces_of(read)
    height = camera.court.value if court is None and camera.court is not None else court
    if court is None and camera.court is not None and camera.court.sd is not None and camera.court_height is None:
        used = replace(used, camera=replace(camera, court_height=Quantity(0.0, camera.court.sd)))
    filmed = filmed_from(used, None if height is None else _court(height, read, used.ball))
    tracks = estimate(whole, filmed)
    by_radius = how.metres_per_px is None and any(track.metres_per_px is not None for track in read)
    tracks = replace(
        tracks,
        refused=(*refused, *tracks.refused),
        notes=(*tracks.notes, *assumptions_of(used)),
        # A scale that was made of the radius is not checked by it.
        scale=FrozenMapping() if by_radius else tracks.scale,
        camera=replace(tracks.camera, fps=tracks.camera.fps or fps),
    )
    if not tracks.impacts:
        raise TrackError(_without_impact(read, tracks.refused))
    for session in tracks.noise:
        words = mark_words([it for it in tracks.impacts if it.track.session == session], filmed)
        words = f"session {session}: {words}" if session and words else words
        if words and not as_read:
            raise TrackError(words)
        tracks = replace(tracks, notes=(*tracks.notes, words)) if words else tracks
    names = tuple(os.fspath(it) if isinstance(it, PATHS) else "DataFrame" for it in sources)
    return TrackResult(tracks, names, replace(used, camera=tracks.camera))


def _without_impact(read: Sequence[Track], refused: Sequence[Refused]) -> str:
    """Why there is none: each reason once, and how all files were read."""
    by_reason: dict[str, list[str]] = {}
    for item in refused:
        by_reason.setdefault(item.reason, []).append(f"{item.id} ({item.source})")
    lines = [
        f"{', '.join(names[:3])}{f' and {len(names) - 3} more' if len(names) > 3 else ''}: {reason}"
        for reason, names in [*by_reason.items()][:10]
    ]
    shared = [note for note in read[0].notes if all(note in track.notes for track in read)]
    lines += [f"how all were read: {note}" for note in shared]
    return f"no impact in {len(read)} track{'s' if len(read) != 1 else ''}:" + "".join(f"\n  - {it}" for it in lines)


def _check_stated(up: str | None, unit: str | None, fold: int | None, columns: Mapping[str, str]) -> None:
    """Raise ParameterError for an axis, a unit, a fold or a name of a column that there is not."""
    if up is not None and up.removeprefix("-") not in ("x", "y", "z"):
        raise ParameterError(f"{option('up', up)}: expected an axis: x, y or z, or -x, -y or -z")
    if fold is not None and fold < 1:
        raise ParameterError(f"{option('fold', fold)}: expected 1 for a dot, 2 for a stripe")
    if unit is not None and unit.casefold() not in PX:
        try:
            parse_unit(unit, Dimension.LENGTH)
        except UnitError as error:
            raise ParameterError(f"{option('unit', unit)}: {error}") from None
    for name in columns.keys() - NAMES.keys():
        raise ParameterError(f"columns: unknown name '{name}': expected one of {', '.join(NAMES)}")


def _scene_of(scene: Scene | PathLike | None, sources: Sequence[Source]) -> Scene:
    """The scene that is given, or the one beside the first file, or none."""
    if isinstance(scene, Scene):
        return scene
    if scene is not None:
        return load_scene(None, scene)
    first = sources[0] if sources else None
    beside = None if not isinstance(first, PATHS) else resolve_tracks(first).with_suffix(".toml")
    return load_scene(None, beside if beside is not None and beside.exists() else None)


def _ball(diameter: float) -> Ball:
    """A tennis ball of this diameter [m]. Raises ParameterError for another ball, whose mass is not known."""
    usual, radius = Ball(), 0.5 * diameter
    moment = usual.inertia_ratio * usual.mass * radius**2
    made = None if radius <= 0.0 else replace(usual, radius=radius, inertia=moment)
    if made is None or not like_tennis(made):
        raise ParameterError(
            f"{option('ball_diameter', f'{diameter:g}')}: not the diameter of a tennis ball; state mass and radius "
            "in [ball] of a scene"
        )
    return made


def _length(name: str, given: str | float, dimension: str = "a length") -> float:
    """A length [m] from a number or a text with its unit. Raises ParameterError."""
    if not isinstance(given, str):
        return float(given)
    matched = _LENGTH.fullmatch(given)
    if matched is not None and not any(digit in matched["number"] for digit in "123456789"):
        # Zero needs no unit.
        return 0.0
    if matched is not None and matched["unit"]:
        with suppress(UnitError):
            return float(parse_unit(matched["unit"], Dimension.LENGTH).to_si(float(matched["number"])))
    raise ParameterError(f"{option(name, given)}: expected {dimension} with its unit, such as 66mm")


def _per_px(given: str | float) -> float:
    """Metres a pixel. Raises ParameterError."""
    if isinstance(given, str):
        length, slash, px = given.partition("/")
        if not slash or px.strip() not in PX:
            raise ParameterError(f"{option('scale', given)}: expected the size of a pixel, such as 0.8mm/px")
        given = _length("scale", length)
    if not (math.isfinite(given) and given > 0.0):
        raise ParameterError(f"{option('scale', str(given))}: expected a positive size of a pixel, such as 0.8mm/px")
    return given


def _court(given: str | float, tracks: Sequence[Track], ball: Ball) -> float:
    """The height of the court [m], upwards, in the coordinates of tracks: of a picture whose y points downwards the
    sign is turned, as that of the tracks was. Raises ParameterError.
    """
    matched = _LENGTH.fullmatch(given) if isinstance(given, str) else None
    if matched is not None and matched["unit"] in PX:
        sizes = [track.metres_per_px for track in tracks if track.metres_per_px is not None]
        if not sizes:
            raise ParameterError(f"{option('court', str(given))}: pixels need a scale; state the height in metres")
        height = float(matched["number"]) * float(np.median(sizes))
    else:
        height = _length("court", given, "a height")
    lowest = float(np.median([track.y.min() for track in tracks]))
    # Centres come as low as a radius above the court.
    return min((height, -height), key=lambda court: abs(lowest - ball.radius - court))
