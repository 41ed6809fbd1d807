"""From positions on film to impacts: the computation of the verb `track`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from msgspec.structs import replace as changed

from fitball.base.errors import Fault, InputError, Note
from fitball.base.numbers import counted
from fitball.base.progress import Progress
from fitball.base.text import listed, one_line
from fitball.data.read import TableSource
from fitball.data.scene import CameraSection, Scene, ValueWithSd
from fitball.tracks.film import Filmed, film_of
from fitball.tracks.find import gravity_of, impacts_of_track
from fitball.tracks.flight import Impact
from fitball.tracks.ids import joined
from fitball.tracks.lasting import lasting_correlation, widening
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
from fitball.tracks.session import PASSES, Session, fit_pass, session_of
from fitball.tracks.types import FilmAssumptions

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
) -> Filmed:
    """The impacts on films. Their velocities, spins and gaps are by two flights (gravity, drag,
    Magnus force), which end and begin at the height of contact. `columns` are the user's header
    cells by our names; `as_read` takes a film that would be refused as misread; `ball` names the
    balls among several objects.

    Raises:
        InputError: a film has faults (codes of `read_tracks`), its balls do not fall as on earth
            (`gravity`), it has no impact (`no-impact`), or it is read wrong (`misread`).
        FolderError: no such file (`not-found`).
        ParameterError: no film is passed (`no-data`), or a name is no column of positions
            (`columns`).
    """
    tracks, notes = read_tracks(sources, scene, columns, ball)
    source = listed(_names_of(sources), most=3)
    camera = _with_usual_errors(scene.camera or CameraSection())
    assumed = FilmAssumptions.of_scene(scene, camera)
    tracks, notes_of_ids = joined(tracks, assumed)
    notes += notes_of_ids
    refused = dict[str, str]()
    impacts = list[Impact]()
    for of_clip in tracks:
        found_impacts, reason = impacts_of_track(of_clip, assumed)
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

    refuse_or_note("gravity", wrong_film(tracks, impacts, assumed, camera))
    sessions = dict[str, Session]()
    for name, of_session in _by_session(impacts).items():
        session = session_of(of_session, assumed, camera)
        sessions[name] = session
        camera = _with_height_sd(camera, session.height_sd)
        for number in range(PASSES):
            progress(f"Impacts {name}".strip(), number / PASSES)
            fit_pass(session, number)
        _judge(session, camera)
        if scene.camera is None or scene.camera.scale is None:
            camera = _with_scale_sd(camera, session)
        refuse_or_note("gravity", wrong_session(session, camera))
        notes += notes_of(session, name, scene)
    refused |= {impact.id: impact.failed for impact in impacts if impact.failed}
    if not any(session.good for session in sessions.values()):
        reasons = dict.fromkeys(map(one_line, refused.values()))
        words = listed(reasons, most=4) or "no row has a position"
        sentences = [f"no impact in {counted(len(tracks), 'track')}: {words}"]
        if any(session.correlation for session in sessions.values()):
            sentences.append(lasting_words())
        sentences += [note.text for note in notes if note.code == "frames-left-out"][:1]
        raise InputError(source, [Fault("no-impact", ". ".join(sentences))])
    film = film_of(sessions, assumed, changed(scene, camera=camera), refused, source)
    refuse_or_note("misread", misread_words(film, camera))
    return replace(film, notes=tuple(notes))


def _judge(session: Session, camera: CameraSection) -> None:
    """Judge the fitted impacts of a session: their gravity, which are impossible, and whether their
    errors last over frames, in which case sds are widened.
    """
    if not camera.lasting:
        session.correlation = lasting_correlation(session.good)
    for impact in session.good:
        impact.failed = why_impossible(impact, session.assumed)
        impact.covariance *= widening(session.correlation) ** 2
    session.gravity = gravity_of(session.good)


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
