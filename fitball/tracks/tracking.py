"""From positions on film to impacts: the computation of the verb `track`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace as changed

from fitball.base.errors import Fault, InputError, Note
from fitball.base.numbers import counted
from fitball.base.progress import Progress
from fitball.base.text import listed, one_line
from fitball.data.read import TableSource
from fitball.data.scene import CameraSection, Scene, ValueWithSd
from fitball.tracks.court import (
    DISTANCE_SD,
    CourtLine,
    camera_of_line,
    court_note,
    levelled,
    line_of_points,
    line_of_roll,
    near_court,
    unit_of,
)
from fitball.tracks.film import Filmed, film_of
from fitball.tracks.find import gravity_of, impacts_of_track
from fitball.tracks.flight import Impact
from fitball.tracks.ids import joined
from fitball.tracks.lasting import (
    lasting_correlation,
    widening,
    widening_of_discs,
    widening_of_spins,
)
from fitball.tracks.notes import (
    lasting_words,
    misread_words,
    notes_of,
    why_impossible,
    wrong_film,
    wrong_session,
)
from fitball.tracks.radii import scale_by_radius
from fitball.tracks.read import read_tracks
from fitball.tracks.ruler import (
    FilmScale,
    rescaled,
    rests_on_discs,
    scale_frame,
    scale_notes,
    scale_of_film,
    shared_scale_sd,
)
from fitball.tracks.session import PASSES, Session, fit_pass, session_of
from fitball.tracks.types import FilmAssumptions, Track

# Values and sds of the camera's errors where a film states none: the scale to 1 %, the clock to
# 0.1 %, the tilt to 0.3 degrees [rad], the height of the court to 3 mm [m].
_USUAL_ERRORS = {
    "scale": ValueWithSd(1.0, 0.01),
    "clock": ValueWithSd(1.0, 1e-3),
    "tilt": ValueWithSd(0.0, 0.005236),
    "court_height": ValueWithSd(0.0, 3e-3),
}


def track(
    sources: Sequence[TableSource],
    scene: Scene,
    columns: Mapping[str, str],
    as_read: bool,
    progress: Progress,
    ball: str = "",
    roll: TableSource = "",
    court: str = "",
) -> Filmed:
    """The impacts on films. Their velocities, spins and gaps are by two flights (gravity, drag,
    Magnus force), which end and begin at the height of contact. `columns` are the user's header
    cells by our names; `as_read` takes a film that would be refused as misread; `ball` names the
    balls among several objects. The court is that of a ball that rolls along it on the film `roll`
    by the same camera, or through two points `court`, "X1,Y1,X2,Y2", as positions are counted.

    Raises:
        InputError: a film has faults (codes of `read_tracks`), its balls do not fall as on earth
            (`gravity`), it has no impact (`no-impact`), or it is read wrong (`misread`); no ball
            rolls along a line on the film that shows the court (`roll`).
        FolderError: no such file (`not-found`).
        ParameterError: no film is passed (`no-data`), a name is no column of positions
            (`columns`), or the court is not two points (`court`).
    """
    source = listed(_names_of(sources), most=3)
    tracks, notes = read_tracks(sources, scene, columns, ball)
    line = None
    if court:
        line = line_of_points(court, scene.camera or CameraSection(), tracks[0].in_pixels)
    if not (isinstance(roll, str) and not roll):
        line = _line_of_roll(roll, scene, columns, ball, unit_of(tracks))
    ground = _ground_of(tracks, scene, line)
    notes += ground.notes
    camera = ground.camera
    tracks, notes_of_ids = joined(ground.tracks, ground.assumed)
    notes += notes_of_ids
    refused = dict[str, str]()
    impacts = list[Impact]()
    for of_clip in tracks:
        found_impacts, reason = impacts_of_track(of_clip, ground.assumed)
        impacts += found_impacts
        if reason:
            refused[of_clip.id] = reason

    def refuse_or_note(code: str, words: str) -> None:
        """Refuse the film for the reason in `words`, or note it where it is to be taken as read."""
        if not words:
            return
        if not (as_read and impacts):
            raise InputError(source, [Fault(code, f"{words}. If all is right, pass --as-read")])
        notes.append(Note(code, words))

    refuse_or_note("gravity", wrong_film(tracks, impacts, ground.assumed, camera))
    sessions = dict[str, Session]()
    for name, of_session in _by_session(impacts).items():
        session = session_of(of_session, ground.assumed, camera)
        sessions[name] = session
        camera = _with_height_sd(camera, session.height_sd)
        for number in range(PASSES):
            progress(f"Impacts {name}".strip(), number / PASSES)
            fit_pass(session, number)
        _judge(session, camera)
        if not _states_scale(scene):
            camera = _with_scale_sd(camera, session)
        refuse_or_note("gravity", wrong_session(session, camera))
        notes += notes_of(session, name, scene)
    refused |= {impact.id: impact.failed for impact in impacts if impact.failed}
    if not any(session.good for session in sessions.values()):
        words = _words_without_impact(sessions, refused, notes, len(tracks))
        raise InputError(source, [Fault("no-impact", words)])
    scene = changed(scene, camera=camera)
    film = film_of(sessions, ground.assumed, scene, refused, source)
    refuse_or_note("misread", misread_words(film, camera))
    return replace(film, notes=tuple(notes), scales=scale_frame(ground.scales))


def _line_of_roll(
    roll: TableSource,
    scene: Scene,
    columns: Mapping[str, str],
    ball: str,
    metres_per_px: float,
) -> CourtLine:
    """The line of a ball that rolls along the court, filmed as the others, with their scale."""
    stated = scene.camera or CameraSection()
    camera = changed(stated, row_time=None, mm_per_px=1e3 * metres_per_px)
    tracks, _ = read_tracks([roll], changed(scene, camera=camera), columns, ball)
    return line_of_roll(tracks, next(_names_of([roll])), scene.ball_value().radius)


class _Ground(NamedTuple):
    """Tracks in metres whose origin is on the court as far as that is known, the camera with all of
    its errors, the scales of films by id, and notes on these.
    """

    tracks: list[Track]
    camera: CameraSection
    assumed: FilmAssumptions
    scales: dict[str, FilmScale]
    notes: list[Note]


def _ground_of(tracks: list[Track], scene: Scene, line: CourtLine | None) -> _Ground:
    """The court and the scale of tracks as they were read; `line` is that of the court, if it was
    seen.
    """
    stated = scene.camera or CameraSection()
    camera = stated
    notes = list[Note]()
    unit = unit_of(tracks)
    measured = any(map(rests_on_discs, tracks))
    if line is not None:
        camera = camera_of_line(camera, line, unit)
        notes.append(court_note(line, unit))
    if isinstance(camera.row_time, ValueWithSd) and camera.row_delay is None:
        camera = changed(camera, row_delay=ValueWithSd(0.0, camera.row_time.sd / unit))
    camera = _with_usual_errors(camera)
    assumed = FilmAssumptions.of_scene(scene, camera)
    by_centres = line.of_centres if line is not None else measured and stated.court is None
    if by_centres and any(track.in_pixels for track in tracks):
        assumed = replace(assumed, court_sd=DISTANCE_SD * assumed.ball.radius)

    def on_court(seen: list[Track]) -> list[Track]:
        """Tracks whose origin is on the court, as far as it is known."""
        if line is not None:
            return [*levelled(seen, line, assumed.ball.radius)]
        return near_court(seen) if stated.court is None and measured else seen

    scales = dict[str, FilmScale]()
    if measured:
        scales = _scales_of_films(on_court(tracks), assumed, camera)
        notes += scale_notes(scales)
        if not _states_scale(scene):
            camera = changed(camera, scale=ValueWithSd(1.0, shared_scale_sd(scales)))
    return _Ground(on_court(rescaled(tracks, scales)), camera, assumed, scales, notes)


def _scales_of_films(
    tracks: Sequence[Track], assumed: FilmAssumptions, camera: CameraSection
) -> dict[str, FilmScale]:
    """The scales of films whose discs have known errors, by id, by these and by gravity."""
    by_id = {track.id: impacts_of_track(track, assumed)[0] for track in tracks}
    impacts = [impact for of_track in by_id.values() for impact in of_track]
    wider = 1.0
    if impacts:
        session = session_of(impacts, assumed, camera)
        for number in range(PASSES):
            fit_pass(session, number)
        wider = widening_of_discs(session.good)
    scales = dict[str, FilmScale]()
    for track in tracks:
        if rests_on_discs(track):
            good = [impact for impact in by_id[track.id] if not impact.failed]
            gravity = gravity_of(good, wider, assumed.row_delay_sd)
            scales[track.id] = scale_of_film(track, gravity)
    return scales


def _words_without_impact(
    sessions: Mapping[str, Session], refused: Mapping[str, str], notes: Sequence[Note], count: int
) -> str:
    """Why so many tracks have no impact, in words."""
    reasons = dict.fromkeys(map(one_line, refused.values()))
    words = listed(reasons, most=4) or "no row has a position"
    sentences = [f"no impact in {counted(count, 'track')}: {words}"]
    if any(session.correlation for session in sessions.values()):
        sentences.append(lasting_words())
    sentences += [note.text for note in notes if note.code == "frames-left-out"][:1]
    return ". ".join(sentences)


def _states_scale(scene: Scene) -> bool:
    """Whether a scene states the error of its scale."""
    return scene.camera is not None and scene.camera.scale is not None


def _judge(session: Session, camera: CameraSection) -> None:
    """Judge the fitted impacts of a session: their gravity, which are impossible, and whether their
    errors last over frames, in which case sds are widened.
    """
    if all(impact.track.is_measured for impact in session.good):
        wider = widening_of_discs(session.good)
    else:
        session.correlation = 0.0 if camera.lasting else lasting_correlation(session.good)
        wider = widening(session.correlation)
    wider_spins = widening_of_spins(session.good)
    for impact in session.good:
        impact.failed = why_impossible(impact, session.assumed)
        impact.covariance *= wider**2
        impact.pairs = [
            pair._replace(covariance=wider_spins**2 * pair.covariance) for pair in impact.pairs
        ]
    session.gravity = gravity_of(session.good, wider, session.assumed.row_delay_sd)


def _names_of(sources: Sequence[TableSource]) -> Iterator[str]:
    """The names of films in messages."""
    for source in sources:
        yield str(source) if isinstance(source, str | Path) else "a table"


def _with_usual_errors(camera: CameraSection) -> CameraSection:
    """A camera as stated, with the usual values and sds of errors that it does not state."""
    usual = {name: error for name, error in _USUAL_ERRORS.items() if getattr(camera, name) is None}
    if isinstance(camera.court, ValueWithSd) and "court_height" in usual:
        usual["court_height"] = ValueWithSd(0.0, camera.court.sd)
    return changed(camera, **usual)


def _by_session(impacts: Sequence[Impact]) -> dict[str, list[Impact]]:
    """Impacts by the session that their labels name; its name is "" without such a label."""
    sessions = dict[str, list[Impact]]()
    for impact in impacts:
        sessions.setdefault(impact.track.labels.get("session", ""), []).append(impact)
    return sessions


def _with_height_sd(camera: CameraSection, sd: float) -> CameraSection:
    """A camera whose height of the court has at least this sd [m], that of a session."""
    height = camera.court_height
    if sd > (height.sd if isinstance(height, ValueWithSd) else 0.0):
        return changed(camera, court_height=ValueWithSd(0.0, sd))
    return camera


def _with_scale_sd(camera: CameraSection, session: Session) -> CameraSection:
    """A camera whose scale has at least the sd of one that rests on radii, if that of a session
    does.
    """
    scale = camera.scale
    by_radius = scale_by_radius(session)
    if by_radius and by_radius.sd > (scale.sd if isinstance(scale, ValueWithSd) else 0.0):
        return changed(camera, scale=ValueWithSd(1.0, by_radius.sd))
    return camera
