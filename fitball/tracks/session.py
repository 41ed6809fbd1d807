"""All impacts of a session: common noise and drag, spins, court height."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from msgspec.structs import replace as changed

from fitball.base.columns import COLUMNS
from fitball.base.display_units import MM, MS, PLAIN
from fitball.base.errors import Fault, InputError, Note
from fitball.base.itf import GRAVITY
from fitball.base.numbers import counted, percent
from fitball.base.progress import Progress
from fitball.base.text import listed, one_line
from fitball.base.values import FloatArray
from fitball.data.misreading import doubts
from fitball.data.read import Source
from fitball.data.scene import CameraSection, Quantity, Scene
from fitball.tracks.film import Film, film_of
from fitball.tracks.find import FACTOR, gravity, impacts_of, of_gravity, wrong_gravity
from fitball.tracks.flight import DRAG, T1, T2, VY1, VY2, Impact, fit, nine, start
from fitball.tracks.read import read_tracks
from fitball.tracks.spins import pairs_of, weights
from fitball.tracks.types import Filming, Track

# Noise before it is known: of an angle [rad]; shares of outliers, the frames that these count as,
# and their range.
_ANGLE = 0.05
_OUTLIERS = 0.02
_ANGLE_OUTLIERS = 0.05
_OUTLIER_FRAMES = 50.0
_RANGE = (2e-3, 0.3)
_LEAST_NOISE = 1e-7
_LEAST_ANGLE = 1e-4
# Frames of a session's noise that a track's own is drawn to, where tracks are too few to show how
# much it differs between them; tracks that show it; most such frames.
_FRAMES = 6.0
_SHOWING = 10
_MOST = 1e3
# Drag from shot to shot (Cross and Lindsey 2014).
_DRAG_SHOT = 0.024
# Passes over a session, and those after which spins are looked for: twice as their noise is
# renewed, and at the end; times by which errors are widened in the first sweeps, with outliers
# among the frames.
_PASSES = 5
_MARKED = (1, 2, 4)
_WIDE = (8.0, 4.0, 2.0)
# What the height of a court begins with below the lowest frames [m].
_PRESSED = 0.01
# A film that states none of these is taken to have these sds: 1, 0.1 %, 0.3 deg, 3 mm.
_CAMERA = {
    "scale": (1.0, 0.01),
    "clock": (1.0, 1e-3),
    "tilt": (0.0, 0.005236),
    "court_height": (0.0, 3e-3),
}
# Fewer frames a second than 500, give or take rounding, may be a phone's, whose rows are read one
# after the other.
_PHONE = 495.0
# Sds by which gravity is off from which a note is due; radii of tennis balls (ITF Rules of Tennis,
# and wear) [m].
_DIFFERENT = 3.0
_TENNIS = (0.030, 0.037)


@dataclass
class Session:
    """What impacts of a session have in common: height of the centre at contact [m], its sd where
    contacts show it; noise of x and y [m], of angles [rad], shares of outliers, gravity with its
    sd.
    """

    impacts: list[Impact]
    known: Filming
    height: float
    height_sd: float = 0.0
    noise: FloatArray = field(default_factory=lambda: np.full(2, 2e-3))
    angle: float = _ANGLE
    outliers: float = _OUTLIERS
    angle_outliers: float = _ANGLE_OUTLIERS
    gravity: tuple[float, float] = (np.nan, np.nan)

    @property
    def good(self) -> list[Impact]:
        """Those that have not failed."""
        return [one for one in self.impacts if not one.failed]


def track(
    sources: Sequence[Source],
    scene: Scene,
    columns: Mapping[str, str],
    as_read: bool,
    progress: Progress,
) -> Film:
    """The impacts on films: velocities, spins and gaps are the unknowns of two flights (gravity,
    drag, Magnus force) that end and begin at the height of contact. Raises InputError (`no-rate`,
    `no-scale`, `gravity`, `no-impact`, `misread`, and what `read_tracks` does).
    """
    tracks, notes = read_tracks(sources, scene, columns)
    source = listed(
        (str(one) if isinstance(one, str | Path) else "a table" for one in sources),
        most=3,
    )
    camera = _camera(scene)
    refused = dict[str, str]()
    found = list[Impact]()
    sessions = dict[str, Session]()
    known = Filming.of(scene, camera)
    for ball in tracks:
        impacts, reason = impacts_of(ball, known)
        found += impacts
        refused |= {ball.id: reason} if reason else {}

    def doubted(code: str, words: str) -> None:
        if words and not (as_read and found):
            raise InputError(source, [Fault(code, f"{words}. If all is right, pass --as-read")])
        notes.extend([Note(code, words)] * bool(words))

    doubted("gravity", _wrong(tracks, found, known))
    for name in dict.fromkeys(one.track.labels.get("session", "") for one in found):
        own = [one for one in found if one.track.labels.get("session", "") == name]
        sessions[name] = session = _placed(own, known, camera)
        # Of several sessions the least certain one.
        if session.height_sd > (
            camera.court_height.sd if isinstance(camera.court_height, Quantity) else 0.0
        ):
            camera = changed(camera, court_height=Quantity(0.0, session.height_sd))
        for number in range(_PASSES):
            progress(f"Impacts {name}".strip(), number / _PASSES)
            _pass(session, number)
        for one in session.good:
            one.failed = _impossible(one, known)
        g, sd = session.gravity = gravity(session.good)
        far = (
            abs(g - GRAVITY) > 2.0 * _DIFFERENT * sd and not GRAVITY / FACTOR < g < FACTOR * GRAVITY
        )
        doubted("gravity", of_gravity(g, _rate(own)) if far else "")
        notes += _notes(session, name, scene)
    refused |= {one.id: one.failed for one in found if one.failed}
    if not any(session.good for session in sessions.values()):
        words = (
            listed(dict.fromkeys(map(one_line, refused.values())), most=4)
            or "no row has a position"
        )
        raise InputError(
            source,
            [Fault("no-impact", f"no impact in {counted(len(tracks), 'track')}: {words}")],
        )
    film = film_of(sessions, known, changed(scene, camera=camera), refused, source)
    doubted("misread", _misread(film))
    return replace(film, notes=tuple(notes))


def _camera(scene: Scene) -> CameraSection:
    """What the scene states, with the usual sds of what it does not."""
    camera = scene.camera or CameraSection()
    usual = {
        name: Quantity(*pair) for name, pair in _CAMERA.items() if getattr(camera, name) is None
    }
    if isinstance(camera.court, Quantity) and "court_height" in usual:
        usual["court_height"] = Quantity(0.0, camera.court.sd)
    return changed(camera, **usual)


def _wrong(tracks: Sequence[Track], found: Sequence[Impact], known: Filming) -> str:
    """What is wrong with films whose balls do not fall as on earth; "" where they may."""
    if not found:
        # The other way up there may be bounces.
        other = [
            one for track in tracks for one in impacts_of(replace(track, y=-track.y), known)[0]
        ]
        if other and not wrong_gravity(other, known):
            return (
                'balls fall upwards: expected y that grows upwards, or y = "down" in [camera] '
                "of the scene"
            )
    return wrong_gravity(found, known)


def _placed(impacts: list[Impact], known: Filming, camera: CameraSection) -> Session:
    """A session with the height of its court: as stated, or that at which the median time between
    the flights is the usual one, with its sd.
    """
    session = Session(impacts, known, known.ball.radius)
    if camera.court is not None:
        court = camera.court.value if isinstance(camera.court, Quantity) else camera.court
        session.height += -court if camera.y == "down" else court
        return session
    usual, low, high = known.contact
    # The second lowest frame: the lowest may be an outlier.
    session.height = (
        float(np.median([np.sort(one.place[:, 1])[:2].max() for one in impacts])) + _PRESSED
    )
    slope = 0.2
    for _ in range(4):
        _pass(session, 0)
        if not session.good:
            break
        p = np.array([one.p for one in session.good])
        slope = float(np.median(1.0 / p[:, VY2] - 1.0 / p[:, VY1]))
        # Of a higher court the flights end earlier and begin later.
        step = (usual - float(np.median(p[:, T2] - p[:, T1]))) / slope
        session.height += step
        if abs(step) < 1e-5:
            break
    session.height_sd = 0.25 * (high - low) / slope
    return session


def _pass(session: Session, number: int) -> None:
    """Fit all impacts with the noise, drag and spins of the pass before, then renew these; the
    first begins anew.
    """
    known = session.known
    for one in session.impacts:
        if number == 0:
            one.failed = ""
            one.pairs = ()
            start(one, known, session.height)
            one.take_prior(known, known.drag[0], np.hypot(known.drag[1], _DRAG_SHOT))
        if not one.failed:
            fit(one, known, session.height, session.outliers, _WIDE if number == 0 else ())
    if not session.good:
        return
    _renew_noise(session)
    marked = [one for one in session.good if number in _MARKED and np.isfinite(one.phi).any()]
    for one in marked:
        one.pairs = pairs_of(one, known, session.angle, session.angle_outliers)
    _renew_angles(session, [one for one in marked if one.taken])
    if number + 1 == _PASSES:
        return
    for one, (drag, sd) in zip(session.good, _drags(session), strict=True):
        one.take_prior(known, drag, sd)


def _renew_noise(session: Session) -> None:
    """Noise of a session and of each of its tracks, and the share of outliers. With s of the
    session a track has (n s^2 + sum w r^2)/(n + its degrees of freedom); n by how far tracks differ
    (Smyth, Stat. Appl. Genet. Mol. Biol. 3 (2004) 3).
    """
    good = session.good
    weight = np.array([np.nansum(one.weight) for one in good])
    spent = np.array(
        [[np.sum(one.covariance * info[:-1, :-1]) for info in one.info] for one in good]
    )
    squares = np.array([np.nansum(one.weight[:, None] * one.residual**2, axis=0) for one in good])
    free = np.maximum(weight[:, None] - spent, 0.0)
    pooled = np.maximum(squares.sum(axis=0) / np.maximum(free.sum(axis=0), 1.0), _LEAST_NOISE**2)
    for axis in (0, 1):
        count = _shared_frames(squares[:, axis], free[:, axis])
        variance = (count * pooled[axis] + squares[:, axis]) / (count + free[:, axis])
        for one, own in zip(good, variance.tolist(), strict=True):
            one.sigma[axis] = np.sqrt(own)
    session.noise = np.sqrt(pooled)
    seen = sum(np.isfinite(one.weight).sum() for one in good)
    session.outliers = _share(seen - weight.sum(), seen, _OUTLIERS)


def _share(out: float, seen: float, before: float) -> float:
    return float(np.clip((out + _OUTLIER_FRAMES * before) / (seen + _OUTLIER_FRAMES), *_RANGE))


def _shared_frames(squares: FloatArray, free: FloatArray) -> float:
    """Degrees of freedom of the distribution of variances over tracks, by the moments of their
    logarithms.
    """
    from scipy.optimize import brentq
    from scipy.special import digamma, polygamma

    use = (free > 2.0) & (squares > 0.0)
    if use.sum() < _SHOWING:
        return _FRAMES
    half = free[use] / 2.0
    logs = np.log(squares[use] / free[use]) - digamma(half) + np.log(half)
    excess = float(np.var(logs, ddof=1) - np.mean(polygamma(1, half)))
    if excess <= polygamma(1, _MOST / 2.0):
        return _MOST
    # Trigamma falls; half a degree of freedom is the least.
    return float(
        2.0
        * brentq(
            lambda n: polygamma(1, n) - min(excess, float(polygamma(1, 0.5))),
            0.5,
            _MOST / 2.0,
        )
    )


def _drags(session: Session) -> list[tuple[float, float]]:
    """Prior of each impact's drag, by what all others determine of the session's, and its sd."""
    good = session.good
    mean, sd = session.known.drag
    variance, before = np.array(
        [(one.covariance[DRAG, DRAG], one.precision[DRAG, DRAG]) for one in good]
    ).T
    found, prior = np.array([(one.p[DRAG], one.prior[DRAG]) for one in good]).T
    precision = np.maximum(1.0 / variance - before, 1e-9)
    own = (found / variance - prior * before) / precision
    weight = 1.0 / (1.0 / precision + _DRAG_SHOT**2)
    total = weight.sum() - weight + sd**-2.0
    drag = (np.sum(weight * own) - weight * own + mean * sd**-2.0) / total
    return [*zip(drag.tolist(), np.sqrt(1.0 / total + _DRAG_SHOT**2).tolist(), strict=True)]


def _renew_angles(session: Session, sure: Sequence[Impact]) -> None:
    """Noise of angles, one for the session, and the share of their outliers; an impact has four
    fitted numbers.
    """
    weight = square = seen = 0.0
    for one in sure:
        r = one.angle_residuals()
        r = r[np.isfinite(r)]
        g = weights(r, one.track.fold, session.angle, session.angle_outliers)[0]
        weight = weight + g.sum() - 4.0
        square = square + float(np.sum(g * r**2))
        seen = seen + r.size
    if weight >= 1.0:
        session.angle = max(float(np.sqrt(square / weight)), _LEAST_ANGLE)
        session.angle_outliers = _share(seen - weight - 4.0 * len(sure), seen, _ANGLE_OUTLIERS)


def _impossible(one: Impact, known: Filming) -> str:
    """Why this is no impact that a table could have; "" where it is."""
    values, covariance = nine(one)
    sds = np.sqrt(np.diagonal(covariance))
    _, low, high = known.contact
    v_y1, v_y2, time = values[[1, 4, 6]]
    for side, where in zip(one.sides(), ("before", "after"), strict=True):
        fitting = int(np.sum(one.weight[side] > 0.5))
        if fitting < 3:
            return (
                f"{fitting} of {side.sum()} frames {where} the contact fit a flight; 3 are needed"
            )
    if v_y2 > v_y1 + 2.0 * np.hypot(sds[1], sds[4]):
        cor = f"coefficient of restitution {v_y2 / v_y1:.2f}"
        return (
            f"the ball rebounds at {v_y2:.3g} m/s after {v_y1:.3g} m/s ({cor}): it was hit, or "
            "hidden"
        )
    if not max(2.0 * low - high, COLUMNS["gap_time"].limits[0]) < time < 2.0 * high - low:
        return f"gap_time is {MS.factor * time:.3g} ms; {_usual([one], known)}"
    return ""


def _usual(impacts: Sequence[Impact], known: Filming) -> str:
    """What times between the flights are usual, and by how much the height of the court would be
    off.
    """
    usual, low, high = known.contact
    wrong = np.median(
        [(one.p[T2] - one.p[T1] - usual) / (1.0 / one.p[VY2] - 1.0 / one.p[VY1]) for one in impacts]
    )
    court = (
        f"the court is taken {MM.factor * abs(wrong):.2g} mm too {'high' if wrong > 0.0 else 'low'}"
    )
    plausible = f"{MS.factor * low:.3g} to {MS.factor * high:.3g} ms"
    words = f"{plausible} are plausible: {court}, or times are off"
    return f"{words} (court in [camera]; without it the height is found from the contacts)"


def _notes(session: Session, name: str, scene: Scene) -> Iterator[Note]:
    """What to look at in a session."""
    good = session.good
    known = session.known
    of = f" of session {one_line(name)}" if name else ""
    many = counted(len(good), "impact") + of
    g, sd = session.gravity
    usual, least, most = known.contact
    if session.height_sd:
        court = MM.plus_minus(session.height - known.ball.radius, session.height_sd)
        words = (
            f"No height of the court is stated{of}: it is at y = {court} mm, where the median "
            "gap_time is"
        )
        plausible = f"{MS.factor * least:.2g} to {MS.factor * most:.2g} ms are plausible"
        more = f"{MS.factor * usual:.2g} ms ({plausible})"
        yield Note("court-found", f"{words} {more}. k_y depends on this assumption.")
    if abs(g - GRAVITY) > _DIFFERENT * sd:
        scale, clock = ("large", "fast") if g > GRAVITY else ("small", "slow")
        off = percent(abs(g / GRAVITY - 1.0))
        late = percent(abs(np.sqrt(max(g, 0.0) / GRAVITY) - 1.0))
        read = f"g comes out as {PLAIN.plus_minus(g, sd)} m/s^2{of}, expected 9.81"
        yield Note(
            "gravity-off",
            f"{read}: the scale is {off} too {scale}, or the clock {late} too {clock}.",
        )
    if unsure := sum(bool(one.pairs) and not one.taken for one in good):
        words = f"Spins are ambiguous in {unsure} of {many}, where they are left empty"
        yield Note(
            "spins-ambiguous",
            f"{words}: a higher frame rate, or a mark of lower fold, determines them.",
        )
    if good and not any(one.pairs for one in good):
        words = f"No spins were measured{of}. A fit takes incident spins as zero"
        yield Note("no-spins", f"{words}: its intervals are too narrow for balls that spin.")
    odd = [one for one in good if not least < one.p[T2] - one.p[T1] < most]
    if 2 * len(odd) > len(good):
        yield Note(
            "gap-time",
            f"gap_time is implausible in {len(odd)} of {many}: {_usual(odd, known)}.",
        )
    other = not _TENNIS[0] <= known.ball.radius <= _TENNIS[1]
    if other and ("drag" not in scene.flight or scene.contact_time is None):
        words = "The ball is no tennis ball, but drag and contact time of one are taken"
        yield Note(
            "other-ball",
            f"{words}: state drag in [flight] and [contact_time] in the scene.",
        )
    rate = _rate(session.impacts)
    if rate < _PHONE and (scene.camera is None or scene.camera.row_time is None):
        words = (
            f"At {rate:.4g} frames/s the shutter may be rolling, as phones have it, which "
            "positions do not show"
        )
        more = "Unstated, 4 ms over a picture move v_x1 by 7 % and the restitution by 10 %"
        yield Note(
            "shutter",
            f"{words}. {more}: state row_time [s] of a row in [camera], 0 for a global shutter.",
        )


def _misread(film: Film) -> str:
    """That angles grow the other way, or columns are exchanged: another reading of the impacts fits
    far better.
    """
    try:
        found = doubts(film.table, film.scene.value())
    except InputError:
        return ""
    return (
        f'{found[0].text}; of films: angles = "clockwise" or y = "down" in [camera]'
        if found
        else ""
    )


def _rate(impacts: Sequence[Impact]) -> float:
    """Frames a second."""
    steps = [np.diff(one.track.time) for one in impacts]
    # The mean, since stamps may be rounded; longer steps miss frames.
    return 1.0 / float(np.median([step[step < 1.5 * np.median(step)].mean() for step in steps]))
