"""`find_balls`: what is seen in a film. A ball is a disc of one size and colour that falls as on
earth before and after it bounces; its own width is the ruler.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fitball.base.errors import Note
from fitball.base.itf import GRAVITY
from fitball.base.numbers import counted
from fitball.base.progress import Progress
from fitball.base.values import FloatArray, IntArray
from fitball.video.bounces import Chain, balls_of, frames_of
from fitball.video.curves import smoothed, with_scatter
from fitball.video.flights import Flight, flights_of, gravity_px
from fitball.video.level import tilt_of
from fitball.video.look import dress
from fitball.video.marks import Marks, marks_of
from fitball.video.shape import CLEAR, SEEN, Discs, Fitting
from fitball.video.shutter import together
from fitball.video.spots import Spots, spots_of
from fitball.video.types import Clip, Estimate, Look, Seen, Sightings
from fitball.video.views import View, course_of, views_of

# The camera may shake by so much [px], 90 % of the time; less than the second is no shake.
_MOST_SHAKE = 8.0
_NO_SHAKE = 0.3
# Balls besides the longest one have so many of its frames, and there are so many at once at most.
_ALSO = 0.6
_MOST_AT_ONCE = 3
# Longest things that are named where there is no ball.
_NAMED = 3
# A ball is a disc in this share of its frames, with an edge of such a blur [px].
_DISC_SHARE = 0.5
_SHARPEST, _SOFTEST = 0.36, 2.9
# Gravity by the ball's own width is off by its radius; by so many sds and this share at most.
_FALL_SDS = 3.0
_RULER_ERROR = 0.3
# Fewest frames of a flight whose fall is judged.
_LEAST_FALLING = 7
# Colours of a ball differ from frame to frame by so many levels at most (robust sd), or by this
# share of what sets it apart from the background: light, reflections and prints that turn.
_ONE_COLOUR = 6.0
_COLOUR_SHARE = 0.25
# The middle of a disc, in radii, whose colour is seen; levels of a picture.
_MIDDLE = 0.6
_LEVELS = 256.0
# The disc of a ball is as large as its spots, within this factor; smaller ones show no disc [px].
_SAME_BALL = 2.0
_LEAST_RADIUS = 2.0
# A radius off the median by this share is that of something else.
_SAME_SIZE = 0.2
# A flight of so many frames that falls as on earth is named where none follows.
_LONG_FLIGHT = 10
# Rates that cameras have [1/s], and how near one is guessed.
_RATES = (24, 25, 30, 50, 60, 100, 120, 240, 480, 960)
_NEAR_RATE = 0.06
# Slow motion is played slower than filmed by this factor at least, and shows a ball in more frames
# than these.
_LEAST_STRETCH = 1.9
_LEAST_SLOW = 20
# All rows are read in this share of the time between frames, with this sd: that of 43 cameras that
# were measured. A picture shows the row time if the sd of that is below the third share.
_USUAL_READOUT = 0.8
_READOUT_SD = 0.2
_SHOWN = 0.3
# How often the look of a ball is read, each time by better places.
_DRESSINGS = 1
# A ball that rolls is seen in so many frames and falls by this share of a ball's fall at most.
_LEAST_ROLLING = 10
_ROLLING_FALL = 0.15


@dataclass(frozen=True, eq=False)
class _Ball:
    """A ball that was measured: its discs, its marks, and the rows of its flights."""

    chain: Chain
    discs: Discs
    marks: Marks


def find_balls(clip: Clip, look: Look, progress: Progress) -> Seen:
    """The balls of a clip, with what the picture shows of the camera. The film is read twice, one
    frame at a time.
    """
    spots = spots_of(clip, look, progress)
    shake = _shake(spots)
    notes = []
    if not spots.known:
        text = "the background has no structure: whether the camera moved is not known"
        notes.append(Note("film-background", text))
    if shake > _MOST_SHAKE:
        reason = f"the camera moved by {shake:.0f} px: put it on a stand"
        return _seen(clip, look, spots, [], shake, notes, reason)
    if shake < _NO_SHAKE:
        spots.shifts[:] = 0.0
        shake = 0.0
    flights = flights_of(spots.found, spots.times, look.diameter, look.rolling)
    chains = _rolling(flights, look) if look.rolling else balls_of(flights, look.diameter)
    balls, reasons = [], []
    slower = "" if look.rolling else _slow_motion(spots, chains, clip, look)
    if slower:
        return _seen(clip, look, spots, [], shake, notes, slower)
    for chain in _chosen(chains):
        ball, reason = _measured(clip, look, spots, chain, progress)
        if ball is None:
            reasons.append(reason)
        else:
            balls.append(ball)
    reason = ""
    if balls:
        notes += [Note("not-a-ball", f"left out: {text}") for text in reasons]
    else:
        reason = "; ".join(dict.fromkeys(reasons)) or _nothing(flights, clip, look)
    return _seen(clip, look, spots, balls, shake, notes, reason)


def _chosen(chains: Sequence[Chain]) -> list[Chain]:
    """Those of chains, the longest first, that are long enough for balls, in the order of time. One
    film may have many throws, but few balls fly at once.
    """
    chosen = list[Chain]()
    for chain in chains:
        if frames_of(chain) <= _ALSO * frames_of(chains[0]):
            break
        at_once = 0
        for other in chosen:
            is_later = chain[0].frames[0] > other[-1].frames[-1]
            is_earlier = chain[-1].frames[-1] < other[0].frames[0]
            at_once += not (is_later or is_earlier)
        if at_once < _MOST_AT_ONCE:
            chosen.append(chain)
    return sorted(chosen, key=lambda chain: int(chain[0].frames[0]))


def _shake(spots: Spots) -> float:
    """By how much the camera moved about its usual place [px], 90 % of the time."""
    off = spots.shifts - np.median(spots.shifts, axis=0)
    return float(np.percentile(np.hypot(off[:, 0], off[:, 1]), 90))


def _rolling(flights: Sequence[Flight], look: Look) -> list[Chain]:
    """Things that move along and do not fall, the longest first."""
    chains = []
    for flight in flights:
        fall, _ = flight.fall()
        gravity = gravity_px(flight.radius, look.diameter)
        if len(flight.frames) >= _LEAST_ROLLING and abs(fall) < _ROLLING_FALL * gravity:
            chains.append((flight,))
    return sorted(chains, key=lambda chain: -frames_of(chain))


def _slow_motion(spots: Spots, chains: Sequence[Chain], clip: Clip, look: Look) -> str:
    """What a ball says that is followed for long only as slow motion; "" of usual films. Played
    slowly it hardly falls, and a ball that should fall is lost after a few frames.
    """
    if any(np.isfinite(flight.fall()[0]) for chain in chains[:1] for flight in chain):
        return ""
    most = frames_of(chains[0]) if chains else _LEAST_SLOW
    best = 0
    for rate in (rate for rate in _RATES if rate > _LEAST_STRETCH * clip.camera_rate):
        times = spots.times * (clip.camera_rate / rate)
        slow = balls_of(flights_of(spots.found, times, look.diameter), look.diameter)
        frames = frames_of(slow[0]) if slow else 0
        if frames > most and any(len(flight.frames) >= _LONG_FLIGHT for flight in slow[0]):
            most, best = frames, rate
    if not best:
        return ""
    return (
        f"a ball falls as on earth if this is slow motion, played at {clip.camera_rate:.4g}/s and "
        f"filmed at {best}/s: pass --fps {best}"
    )


def _measured(
    clip: Clip,
    look: Look,
    spots: Spots,
    chain: Chain,
    progress: Progress,
) -> tuple[_Ball | None, str]:
    """The ball of a chain of flights, or why it is none."""
    radius = _radius_of(chain)
    course = course_of(chain, spots.times, look.diameter)
    views = views_of(clip, spots, course, radius, progress)
    fitting = Fitting(clip, course, views, radius)
    fitting.begin()
    if not fitting.sized():
        return None, "what moves is no disc of one colour: no frame fits"
    for at_rim in (False, True):
        frames, p, quality = fitting.rough()
        flights = _rows_of_flights(chain, frames)
        # The ball flies smoothly: what moves its disc off that is its look.
        p[:, :2] = smoothed(spots.times[frames], p[:, :2], flights, quality > CLEAR)
        marks = _marks(clip, spots, chain, views, frames, p)
        discs_of_frames = [fitting.discs[k] for k in frames.tolist()]
        light = fitting.upright_light()
        shown = dress(discs_of_frames, p, marks, quality > CLEAR, light, at_rim)
        # The radius is known before the look may do as it likes at the rim.
        if not shown or not (fitting.placed_again() if at_rim else fitting.sized()):
            return None, "what moves is no disc of one look: no frame fits"
    discs = fitting.measured(_rows_of_flights(chain, frames), marks.angle)
    discs = with_scatter(discs, _rows_of_flights(chain, discs.frames))
    reason = _no_ball(chain, discs, look)
    if reason:
        return None, reason
    return _Ball(chain, discs, _marks(clip, spots, chain, views, discs.frames, discs.p)), ""


def _radius_of(chain: Chain) -> float:
    """The radius that the spots of a chain have [px]."""
    return float(np.median(np.concatenate([flight.spots[:, 2] for flight in chain])))


def _marks(
    clip: Clip,
    spots: Spots,
    chain: Chain,
    views: Mapping[int, View],
    frames: IntArray,
    p: FloatArray,
) -> Marks:
    rows = _rows_of_flights(chain, frames)
    seen = [views[k] for k in frames.tolist()]
    return marks_of(seen, p[:, :3], spots.times[frames], rows, clip.camera_rate)


def _rows_of_flights(chain: Chain, frames: IntArray) -> list[IntArray]:
    """The rows of frames that belong to each flight."""
    cuts = [(a.frames[-1] + b.frames[0]) / 2.0 for a, b in pairwise(chain)]
    side = np.digitize(frames, cuts)
    return [np.flatnonzero(side == k) for k in range(len(chain))]


def _no_ball(chain: Chain, discs: Discs, look: Look) -> str:
    """Why discs are no ball; "" if they are one."""
    share = float(np.mean(discs.quality > CLEAR))
    if share < _DISC_SHARE or discs.blur < _SHARPEST:
        return (
            f"what moves is no disc ({100.0 * share:.0f} % of the frames fit, "
            f"edge {discs.blur:.1f} px)"
        )
    if discs.blur > _SOFTEST:
        return (
            f"the edge of what moves is blurred over {discs.blur:.1f} px or more: out of focus, "
            "a camera that mixes frames in poor light, or a shadow on a wall close behind"
        )
    radius = _radius_of(chain)
    if not 1.0 / _SAME_BALL < discs.radius / radius < _SAME_BALL or discs.radius < _LEAST_RADIUS:
        return f"what moves is {radius:.0f} px wide to each side, but no disc of that size"
    change, most = _change_of_colour(discs)
    if change > most:
        return (
            f"what moves is not of one colour (it changes by {change:.0f} levels of 256, "
            f"{most:.0f} at most)"
        )
    if look.rolling:
        return ""
    gravity = gravity_px(discs.radius, look.diameter)
    for rows in _rows_of_flights(chain, discs.frames):
        clear = rows[discs.quality[rows] > SEEN]
        if len(clear) < _LEAST_FALLING:
            continue
        times = discs.times[clear] - discs.times[clear].mean()
        curve, covariance = np.polyfit(times, discs.p[clear, 1], 2, cov=True)
        fall = 2.0 * float(curve[0]) / gravity
        sd = 2.0 * float(np.sqrt(covariance[0, 0])) / gravity
        if abs(fall - 1.0) > _FALL_SDS * sd + _RULER_ERROR:
            return (
                f"what moves falls at {GRAVITY * fall:.3g} m/s^2 if it is a ball of "
                f"{1e3 * look.diameter:.3g} mm (--ball-diameter): film at right angles to its "
                "flight and level, so that it comes no nearer"
            )
    return ""


def _colours(discs: Discs) -> tuple[FloatArray, FloatArray]:
    """Both colour differences (frames, 2) of the middle of the disc and of the background behind
    it, where it is seen [levels].
    """
    own, behind = [], []
    for k, p in zip(discs.frames[discs.quality > SEEN], discs.p[discs.quality > SEEN], strict=True):
        view = discs.views[int(k)]
        rows, columns = view.image.shape[1:]
        y, x = np.mgrid[:rows, :columns]
        near = np.hypot(x + view.left - p[0], y + view.top - p[1]) < _MIDDLE * p[2]
        if near.any():
            own.append(np.median(view.colours[1:, near], axis=1))
            behind.append(_LEVELS * np.median(view.back[1:, near], axis=1))
    return np.array(own), np.array(behind)


def _change_of_colour(discs: Discs) -> tuple[float, float]:
    """How much the colour of the ball changes from frame to frame (robust sd), and how much it may
    [levels].
    """
    own, behind = _colours(discs)
    off = np.median(np.abs(own - np.median(own, axis=0)), axis=0)
    contrast = np.median(np.hypot(*(own - behind).T))
    return float(1.48 * off.max()), max(_ONE_COLOUR, _COLOUR_SHARE * float(contrast))


def _nothing(flights: Sequence[Flight], clip: Clip, look: Look) -> str:
    """Why there is no ball among flights, with the longest things seen."""
    if look.rolling:
        return f"no ball that rolls along; {_longest(flights, look)}"
    for flight in flights[:_NAMED]:
        fall, sd = flight.fall()
        gravity = gravity_px(flight.radius, look.diameter)
        if not 0.0 < 4.0 * sd < fall:
            continue
        ratio = fall / gravity
        if balls_of(flights, look.diameter / ratio) and not 0.6 < ratio < 1.6:
            return _wrong_ruler(ratio, clip, look)
        if 0.7 < ratio < 1.4 and len(flight.frames) >= _LONG_FLIGHT:
            count = counted(len(flight.frames), "frame")
            return f"one flight of {count}, no bounce: start earlier or later, or show the court"
    return f"no ball that falls as on earth and bounces; {_longest(flights, look)}"


def _wrong_ruler(ratio: float, clip: Clip, look: Look) -> str:
    """What a ball that bounces but does not fall as on earth says of rate or diameter."""
    read = f"a ball falls at {GRAVITY * ratio:.3g} m/s^2"
    rate = clip.camera_rate / np.sqrt(ratio)
    nearest = min(_RATES, key=lambda usual: abs(np.log(rate / usual)))
    if abs(rate / nearest - 1.0) < _NEAR_RATE:
        return f"{read}: filmed at {nearest}/s? pass --fps {nearest}"
    return (
        f"{read}: the camera took about {rate:.0f} frames/s (--fps), or the ball is "
        f"{1e3 * look.diameter / ratio:.0f} mm wide (--ball-diameter)"
    )


def _longest(flights: Sequence[Flight], look: Look) -> str:
    """The longest things that were seen, in words."""
    if not flights:
        return "nothing small moves fast"
    words = []
    for flight in flights[:_NAMED]:
        fall, _ = flight.fall()
        metre = 2.0 * flight.radius / look.diameter
        x, y = flight.spots[len(flight.spots) // 2, :2]
        pace = f"falls at {fall / metre:.3g} m/s^2" if np.isfinite(fall) else "too short to fall"
        count = counted(len(flight.frames), "frame")
        words.append(f"{count} of radius {flight.radius:.0f} px at ({x:.0f}, {y:.0f}), {pace}")
    return f"the longest things seen: {'; '.join(words)}"


def _seen(
    clip: Clip,
    look: Look,
    spots: Spots,
    balls: Sequence[_Ball],
    shake: float,
    notes: Sequence[Note],
    nothing: str,
) -> Seen:
    names = [clip.name] if len(balls) == 1 else [f"{clip.name}-{k + 1}" for k in range(len(balls))]
    exposures = [ball.discs.exposure for ball in balls]
    return Seen(
        clip,
        tuple(_sightings(name, ball, clip, spots) for name, ball in zip(names, balls, strict=True)),
        _row_time(clip, balls, look),
        Estimate(look.tilt, 0.0) if look.tilt is not None else tilt_of(spots.background),
        shake,
        float(np.median(exposures)) if exposures else float("nan"),
        spots.background,
        tuple(notes),
        nothing,
    )


def _row_time(clip: Clip, balls: Sequence[_Ball], look: Look) -> Estimate:
    """The row time [s/px] that all balls show together; without any, unknown. Where they hardly
    show it, it is drawn to that of usual cameras.
    """
    if look.row_time is not None:
        return Estimate(look.row_time, 0.0)
    if not balls:
        return Estimate(0.0, float("inf"))
    rows = clip.height if clip.readout[1] else clip.width
    longest = 1.0 / (clip.camera_rate * rows)
    shown = together([ball.discs.row_time for ball in balls])
    if shown.sd < _SHOWN * longest:
        return shown
    return together([shown, Estimate(_USUAL_READOUT * longest, _READOUT_SD * longest)])


def _sightings(name: str, ball: _Ball, clip: Clip, spots: Spots) -> Sightings:
    """What is seen of a ball. Discs that are not whole in the picture are not used."""
    discs = ball.discs
    x, y, radius = discs.p[:, 0], discs.p[:, 1], discs.p[:, 2]
    raw = discs.p[:, :2] + spots.shifts[discs.frames]
    edge = np.array([clip.width, clip.height]) - 1.0
    whole = ((raw > radius[:, None]) & (raw < edge - radius[:, None])).all(1)
    size = np.abs(discs.radius_free / radius - 1.0) < _SAME_SIZE
    return Sightings(
        name,
        spots.numbers[discs.frames],
        discs.times,
        x,
        y,
        discs.sd[:, 0],
        discs.sd[:, 1],
        radius,
        discs.sd[:, 2],
        ball.marks.angle,
        ball.marks.fold,
        np.clip(discs.quality, 0.0, 1.0),
        (discs.quality > SEEN) & size & whole,
        tuple(discs.views[k].crop for k in discs.frames.tolist()),
    )
