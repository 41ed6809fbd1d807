"""Why a film is refused, why an impact is impossible, and notes on a session."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.display_units import MM, MS, PLAIN
from fitball.base.errors import InputError, Note
from fitball.base.itf import GRAVITY, is_tennis_radius
from fitball.base.numbers import counted, percent
from fitball.base.text import listed, one_line
from fitball.data.misreading import doubts
from fitball.data.scene import CameraSection, Scene
from fitball.tracks.film import Filmed
from fitball.tracks.find import (
    GRAVITY_FACTOR,
    gravity_words,
    impacts_of_track,
    other_y,
    wrong_gravity,
)
from fitball.tracks.flight import T1, T2, VY1, VY2, Impact, measurement_of
from fitball.tracks.ids import joined
from fitball.tracks.lasting import widening
from fitball.tracks.marks import Reading, doubts_of_marks
from fitball.tracks.radii import RadiusScale, explains_gravity, scale_by_radius
from fitball.tracks.session import Session
from fitball.tracks.types import FilmAssumptions, Track

# Films of fewer frames a second may be a phone's, whose rows are read one after the other. Rates
# that round to 500 are those of other cameras.
_PHONE_RATE = 495.0
# Standard errors by which gravity is off from which on a note is due; twice as many, and a factor,
# refuse a film.
_GRAVITY_SDS = 3.0
# Sd of a scale by the radius of the ball from which on a note is due: twice that of stated scales.
_LARGE_SCALE_SD = 0.02
# Least probability of being no outlier of a frame that fits a flight.
_FITTING_PROBABILITY = 0.5
# Fewest frames of a flight that fit it.
_FEWEST_FITTING = 3


def wrong_film(
    tracks: Sequence[Track],
    impacts: Sequence[Impact],
    assumed: FilmAssumptions,
    camera: CameraSection,
) -> str:
    """The sentence on films whose balls do not fall as on earth; "" where they may."""
    if impacts:
        return wrong_gravity(impacts, assumed, camera)
    # The other way up there may be bounces.
    upside_down = list[Impact]()
    mirrored, _ = joined([replace(track, y=-track.y) for track in tracks], assumed)
    for track in mirrored:
        upside_down += impacts_of_track(track, assumed)[0]
    if upside_down and not wrong_gravity(upside_down, assumed, camera):
        return f'balls fall upwards: state y = "{other_y(camera)}" in [camera] of the scene'
    return ""


def wrong_session(session: Session, camera: CameraSection) -> str:
    """The sentence on a session whose fitted flights have a gravity that is off by a factor; ""
    where it is not.
    """
    g, sd = session.gravity.value, session.gravity.sd
    off = abs(g - GRAVITY) > 2.0 * _GRAVITY_SDS * sd
    if off and not GRAVITY / GRAVITY_FACTOR < g < GRAVITY_FACTOR * GRAVITY:
        return gravity_words(g, _frame_rate(session.impacts), camera)
    return ""


def misread_words(film: Filmed, camera: CameraSection) -> str:
    """The sentence on another reading of the impacts that fits far better; "" without one. Where
    that negates all spins, angles grow the other way: y, which gravity shows, is right.
    """
    try:
        readings = doubts(film.table, film.scene.ball_value())
    except InputError:
        return ""
    if not readings:
        return ""
    best = readings[0]
    spins = {name for name in ("omega_1", "omega_2") if name in film.table.values}
    if best.kind == "sign" and {*best.flip} == spins:
        remedy = f'angles = "{_other_direction(camera)}" in [camera]'
    else:
        remedy = "check which column is which"
    return f"{best.said}: if so, {remedy}"


def _other_direction(camera: CameraSection) -> str:
    """The direction of growing angles that a camera does not state."""
    return "counterclockwise" if camera.angles == "clockwise" else "clockwise"


def why_impossible(impact: Impact, assumed: FilmAssumptions) -> str:
    """Why a fitted impact is impossible or no frame supports it; "" where it may be right."""
    for side, where in zip(impact.sides(), ("before", "after"), strict=True):
        fitting = int(np.sum(impact.weight[side] > _FITTING_PROBABILITY))
        if fitting < _FEWEST_FITTING:
            return (
                f"{fitting} of {side.sum()} frames {where} the contact fit a flight; "
                f"{_FEWEST_FITTING} are needed"
            )
    values, covariance = measurement_of(impact)
    v_y1, v_y2, time = values[[1, 4, 6]]
    sd_1, sd_2 = np.sqrt(np.diagonal(covariance))[[1, 4]]
    if v_y2 > v_y1 + 2.0 * np.hypot(sd_1, sd_2):
        cor = f"coefficient of restitution {v_y2 / v_y1:.2f}"
        return (
            f"the ball rebounds at {v_y2:.3g} m/s after {v_y1:.3g} m/s ({cor}): it was hit, or "
            "hidden"
        )
    if impact.track.vertical:
        # Drops are used without their time of contact.
        return ""
    _, low, high = assumed.contact
    least = max(2.0 * low - high, COLUMNS["gap_time"].limits[0])
    if not least < time < 2.0 * high - low:
        return f"gap_time is {MS.factor * time:.3g} ms; {_usual_times([impact], assumed)}"
    return ""


def _usual_times(impacts: Sequence[Impact], assumed: FilmAssumptions) -> str:
    """The sentence on usual times between the flights, and by how much the height of the court
    would be off.
    """
    usual, low, high = assumed.contact
    heights = [_height_off(impact, usual) for impact in impacts]
    wrong = np.median(heights)
    side = "high" if wrong > 0.0 else "low"
    court = f"the court is taken {MM.factor * abs(wrong):.2g} mm too {side}"
    plausible = f"{MS.factor * low:.3g} to {MS.factor * high:.3g} ms"
    words = f"{plausible} are plausible: {court}, or times are off"
    return f"{words} (court in [camera]; without it the height is found from the contacts)"


def _height_off(impact: Impact, usual: float) -> float:
    """How much [m] too high the court is if the time between the flights is the usual one [s]."""
    p = impact.p
    late = p[T2] - p[T1] - usual
    return float(late / (1.0 / p[VY2] - 1.0 / p[VY1]))


def notes_of(session: Session, name: str, scene: Scene) -> Iterator[Note]:
    """The notes on a session; its `name` is "" where there is only one."""
    of_session = f" of session {one_line(name)}" if name else ""
    many = counted(len(session.good), "impact") + of_session
    yield from _gravity_notes(session, of_session)
    if not session.vertical:
        yield from _court_notes(session, of_session)
        yield from _spin_notes(session, many, of_session, scene.camera or CameraSection())
        yield from _gap_notes(session, many)
    yield from _lasting_notes(session, of_session)
    yield from _ball_notes(session, scene)
    yield from _shutter_notes(session, scene)


def _court_notes(session: Session, of_session: str) -> Iterator[Note]:
    """The note that the height of the court was found from the contacts."""
    if not session.height_sd:
        return
    usual, least, most = session.assumed.contact
    height = session.height - session.assumed.ball.radius
    court = MM.plus_minus(height, session.height_sd)
    words = (
        f"No height of the court is stated{of_session}: it is at y = {court} mm, where the median "
        "gap_time is"
    )
    plausible = f"{MS.factor * least:.2g} to {MS.factor * most:.2g} ms are plausible"
    times = f"{MS.factor * usual:.2g} ms ({plausible})"
    yield Note("court-found", f"{words} {times}. k_y depends on this assumption.")


def _gravity_notes(session: Session, of_session: str) -> Iterator[Note]:
    """The note that gravity is off by more than errors of the flights explain."""
    g, sd = session.gravity.value, session.gravity.sd
    if not abs(g - GRAVITY) > _GRAVITY_SDS * sd:
        yield from _scale_notes(session, of_session)
        return
    if g > GRAVITY:
        scale = "large"
        clock = "fast"
    else:
        scale = "small"
        clock = "slow"
    off = percent(abs(g / GRAVITY - 1.0))
    late = percent(abs(np.sqrt(max(g, 0.0) / GRAVITY) - 1.0))
    read = f"g comes out as {PLAIN.plus_minus(g, sd)} m/s^2{of_session}, expected 9.81"
    why = f"the scale is {off} too {scale}, or the clock {late} too {clock}"
    by_radius = scale_by_radius(session)
    if by_radius and explains_gravity(by_radius, g, _GRAVITY_SDS * sd):
        why = f"the scale is {off} too {scale}. {_radius_words(by_radius)}"
    yield Note("gravity-off", f"{read}: {why}.")


def _scale_notes(session: Session, of_session: str) -> Iterator[Note]:
    """The note that a scale by the radius of the ball is known to some per cent only."""
    by_radius = scale_by_radius(session)
    if by_radius and by_radius.sd > _LARGE_SCALE_SD:
        words = f"The scale{of_session} is known to {percent(by_radius.sd)} only"
        yield Note("scale-by-radius", f"{words}. {_radius_words(by_radius)}.")


def _radius_words(scale: RadiusScale) -> str:
    """The sentences on a scale by radii, which may be half a pixel small, with the remedy."""
    per_px = MM.number(scale.corrected, 4)
    return (
        f"It rests on the radius of the ball, {PLAIN.number(scale.radius, 3)} px: contours of "
        f"OpenCV are half a pixel small. If yours are, --mm-per-px {per_px} is right"
    )


def _spin_notes(
    session: Session, many: str, of_session: str, camera: CameraSection
) -> Iterator[Note]:
    """The notes that spins are ambiguous or implausible, or were not measured."""
    good = session.good
    ambiguous, implausible, reading = doubts_of_marks(session)
    if ambiguous:
        words = f"Spins are ambiguous in {len(ambiguous)} of {many}, where they are left empty"
        yield Note(
            "spins-ambiguous",
            f"{words}: a higher frame rate, or a mark of lower fold, determines them.",
        )
    if implausible:
        words = f"Spins are implausible in {len(implausible)} of {many}, where they are left empty"
        if reading is None:
            remedy = "No direction or fold of the marks helps: check their angles in spins.csv"
        else:
            remedy = _reading_words(reading, implausible, camera)
        yield Note("spins-implausible", f"{words}. {remedy}.")
    if good and not any(impact.pairs for impact in good):
        words = f"No mark was seen{of_session}: k_theta will not be determined"
        yield Note("no-spins", f"{words}, and incident spins are unknown. Put a dot on the ball.")


def _reading_words(reading: Reading, impacts: Sequence[Impact], camera: CameraSection) -> str:
    """The remedy where angles are to be read another way, and what shows it."""
    remedies = []
    reasons = []
    if reading.turned:
        remedies.append(f'angles = "{_other_direction(camera)}"')
        reasons.append("Angles of OpenCV grow clockwise in the picture")
    if reading.multiple > 1:
        folds = sorted({reading.multiple * impact.track.fold for impact in impacts})
        remedies.append(f"fold = {listed(map(str, folds), 'or')}")
        periods = listed([f"{360.0 / fold:.3g}" for fold in folds], "or")
        words = f"The angles repeat after {periods} degrees"
        reasons.append(f"{words}; state the fold in the column angle_fold, if there is one")
    return ". ".join([f"With {listed(remedies)} in [camera] they are plausible", *reasons])


def _gap_notes(session: Session, many: str) -> Iterator[Note]:
    """The note that the time between the flights is implausible in most impacts."""
    _, least, most = session.assumed.contact
    odd = [impact for impact in session.good if not least < impact.p[T2] - impact.p[T1] < most]
    if 2 * len(odd) > len(session.good):
        usual = _usual_times(odd, session.assumed)
        yield Note("gap-time", f"gap_time is implausible in {len(odd)} of {many}: {usual}.")


def lasting_words() -> str:
    """The sentences on errors that last over several frames beside the contact."""
    return (
        "Errors of positions beside the contact last over several frames, as where a motion model "
        "estimates positions: track again without it, or export what was detected"
    )


def _lasting_notes(session: Session, of_session: str) -> Iterator[Note]:
    """The note that errors last over several frames, and by how much sds are widened."""
    if session.correlation:
        factor = PLAIN.number(widening(session.correlation), 2)
        words = f"Sds of velocities{of_session} were multiplied by {factor}"
        yield Note("lasting-errors", f"{lasting_words()}. {words}.")


def _ball_notes(session: Session, scene: Scene) -> Iterator[Note]:
    """The note that drag and contact time of a tennis ball are taken for another ball."""
    is_tennis = is_tennis_radius(session.assumed.ball.radius)
    if not is_tennis and ("drag" not in scene.flight or scene.contact_time is None):
        words = "The ball is no tennis ball, but drag and contact time of one are taken"
        yield Note(
            "other-ball",
            f"{words}: state drag in [flight] and [contact_time] in the scene.",
        )


def _shutter_notes(session: Session, scene: Scene) -> Iterator[Note]:
    """The note that the camera may read its rows one after the other."""
    rate = _frame_rate(session.impacts)
    if rate < _PHONE_RATE and (scene.camera is None or scene.camera.row_time is None):
        words = (
            f"A camera at {rate:.4g} frames/s may have a rolling shutter, as phones do, which "
            "positions do not show"
        )
        changes = "the restitution by 10 %"
        if not session.vertical:
            changes = f"v_x1 by 7 % and {changes}"
        effect = f"Unstated, 4 ms over a picture move {changes}"
        yield Note(
            "shutter",
            f"{words}. {effect}: state row_time [s] of a row in [camera], 0 for a global shutter.",
        )


def _frame_rate(impacts: Sequence[Impact]) -> float:
    """Frames a second of the film of these impacts."""
    means = []
    for impact in impacts:
        steps = np.diff(impact.track.time)
        # The mean, since stamps may be rounded; longer steps miss frames.
        means.append(steps[steps < 1.5 * np.median(steps)].mean())
    return 1.0 / float(np.median(means))
