"""What is said of impacts and sessions: why a track has no impact, and what to look at where one is doubtful."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitball.tracks.find import frames_in_words
from fitball.tracks.flight import GRAVITY
from fitball.tracks.frames import CONTACT, NINE, Check, Filmed, SessionNoise, TrackedImpact
from fitball.tracks.spins import LARGEST, TURNED, Bounce, plausible
from fitball.wording import option, spoken

# Share of outliers in a track, and flattest angle of incidence [deg], from which a note is due.
MANY, FLAT = 0.25, 6.0
# A check differs from what it should be by this many sds; the share that is said of scale and clock.
DIFFERENT = 3.0
# Outlines of balls are this good.
RADIUS_OFF = 0.02
# Ratio of measured gravity to the usual one from which a playback rate was taken for the capture rate.
PLAYBACK = 2.5
# Odds from which marks turn the other way than their angles, and the most that one impact adds (logarithms).
OTHER_WAY, MOST_ODDS = float(np.log(1000.0)), 10.0


def wrong_rate(falls: Check | None) -> str:
    """Why no impact of a session can be: its gravity is far from that of the earth; "" where it is not."""
    if falls is None or abs(falls.value - GRAVITY) < 2.0 * DIFFERENT * falls.sd:
        return ""
    ratio = falls.value / GRAVITY
    return "" if 1.0 / PLAYBACK < ratio < PLAYBACK else gravity_words(falls)


def refusal(impact: TrackedImpact, filmed: Filmed) -> str:
    """Why this is no impact that a table could have; "" where it is."""
    v_y1, v_y2, time = impact.values[1], impact.values[4], impact.values[6]
    low, high = filmed.contact_time[1:]
    if v_y2 > v_y1 + 2.0 * float(np.hypot(impact.sd("v_y1"), impact.sd("v_y2"))):
        contact = np.flatnonzero(impact.role == CONTACT)
        where = f" about {frames_in_words(impact.track, contact)}" if contact.size else ""
        return (
            f"the ball rebounds at {v_y2:.3g} m/s after {v_y1:.3g} m/s (coefficient of restitution {v_y2 / v_y1:.2f})"
            f"{where}: it was hit, or frames are not in order of time"
        )
    wide = high - low
    if not low - wide < time < high + wide:
        return (
            f"gap_time is {1e3 * time:.3g} ms, but {1e3 * low:.3g} to {1e3 * high:.3g} ms are plausible; "
            f"{_height_error([impact], filmed)}"
        )
    if not np.isfinite(np.delete(impact.values, [2, 5, 8])).all() or not np.isfinite(impact.covariance).all():
        return "no flight fits the positions before and after the contact"
    return ""


def _height_error(impacts: Sequence[TrackedImpact], filmed: Filmed) -> str:
    """By how much the height of the court would be off (median) if it alone were the reason."""
    late = [it.values[6] - filmed.contact_time[0] for it in impacts]
    slow = [1.0 / it.values[1] + 1.0 / it.values[4] for it in impacts]
    wrong = 1e3 * float(np.median(np.divide(late, slow)))
    return f"the court would be taken {abs(wrong):.2g} mm too {'high' if wrong > 0.0 else 'low'}, or times are off"


def impact_notes(impact: TrackedImpact, filmed: Filmed) -> list[str]:
    """Sentences on one impact."""
    notes = []
    v_x1, v_y1, time = impact.values[0], impact.values[1], impact.values[6]
    low, high = filmed.contact_time[1:]
    if not low < time < high:
        notes.append(
            f"gap_time is {1e3 * time:.3g} ms, but {1e3 * low:.3g} to {1e3 * high:.3g} ms are plausible: "
            f"{_height_error([impact], filmed)}"
        )
    angle = float(np.degrees(np.arctan2(v_y1, v_x1)))
    if angle < FLAT:
        notes.append(f"incidence is grazing ({angle:.2g} deg): height and tilt of the court change the result most")
    outliers = np.flatnonzero(impact.weight < 0.5)
    used = int(np.isfinite(impact.weight).sum())
    if used and outliers.size > MANY * used:
        notes.append(f"{outliers.size} of {used} frames are outliers ({frames_in_words(impact.track, outliers)})")
    if impact.pairs and not impact.sure:
        shown = " or ".join(
            f"{pair.omega_1:.0f} and {pair.omega_2:.0f} rad/s ({100.0 * pair.probability:.3g} %)"
            for pair in impact.pairs[:2]
        )
        notes.append(f"spins are ambiguous: {shown} before and after; spins and turn are left empty")
    elif impact.track.angle is not None and np.isfinite(impact.track.angle).any() and not impact.pairs:
        notes.append("too few angles on one side to determine spins: spins and turn are left empty")
    return notes


def mark_words(impacts: Sequence[TrackedImpact], filmed: Filmed) -> str:
    """That angles of a session grow the other way in the picture than was read; "" where they do not.

    All aliases of a spin are compared with those of its opposite, by what a bounce can do (`spins.plausible`).
    """
    odds = [_odds_of_other_way(impact, filmed) for impact in impacts if impact.pairs]
    if not sum(odds) > OTHER_WAY:
        return ""
    found = sum(one > 1.0 for one in odds)
    return (
        f"the marks turn the other way than was read: {found} of {len(odds)} impacts fit a bounce better with "
        "opposite spins (friction, offset of the normal force); expected angles that grow counterclockwise in the "
        f"picture; if they grow clockwise, as with y downwards, pass {option('clockwise')}, otherwise leave it out"
    )


def _odds_of_other_way(impact: TrackedImpact, filmed: Filmed) -> float:
    """Log of the odds that the spins of an impact have the opposite sign."""
    v_x1, v_y1, v_x2, v_y2, time = (float(impact.values[k]) for k in (0, 1, 3, 4, NINE.index("gap_time")))
    speed_sd = float(np.hypot(impact.sd("v_x1"), impact.sd("v_x2")))
    bounce = Bounce(v_x1, v_y1, v_x2, v_y2, time, speed_sd, 0.0)
    alias = 2.0 * np.pi / (impact.track.fold * float(np.median(np.diff(impact.track.time))))
    best, evidence = impact.pairs[0], []
    for sign in (-1.0, 1.0):
        first, second = (
            sign * spin + alias * np.arange(-np.ceil(2.0 * LARGEST / alias), np.ceil(2.0 * LARGEST / alias) + 1.0)
            for spin in (best.omega_1, best.omega_2)
        )
        logs = [
            plausible(bounce, one, two, time * (one + TURNED * (two - one)), 0.0, filmed.ball)
            - 0.5 * (one / filmed.spin_sd) ** 2
            for one in first[np.abs(first) <= LARGEST].tolist()
            for two in second[np.abs(second) <= LARGEST].tolist()
        ]
        evidence.append(float(np.logaddexp.reduce(logs)) if logs else 0.0)
    return float(np.clip(evidence[0] - evidence[1], -MOST_ODDS, MOST_ODDS))


def height_notes(height: float, sd: float, usual: float, between: tuple[float, float]) -> str:
    """That the height of the court was assumed, by the time over contact."""
    return (
        f"The court is at y = {1e3 * height:.1f} ± {1e3 * sd:.1f} mm, where the median gap_time is "
        f"{1e3 * usual:.2g} ms "
        f"({1e3 * between[0]:.2g} to {1e3 * between[1]:.2g} ms are plausible). No height was stated: "
        "k_y then depends on this assumption"
    )


def session_notes(
    name: str,
    impacts: Sequence[TrackedImpact],
    noise: SessionNoise,
    gravity: Check | None,
    scale: Check | None,
    filmed: Filmed,
) -> list[str]:
    """Sentences on a session."""
    of = f" of session {name}" if name else ""
    notes = []
    if gravity is not None and abs(gravity.value - GRAVITY) > DIFFERENT * gravity.sd:
        notes.append(gravity_words(gravity, of))
    if scale is not None and abs(scale.value - 1.0) > max(DIFFERENT * scale.sd, RADIUS_OFF):
        notes.append(scale_words(scale, of))
    unsure = [made.id for made in impacts if made.pairs and not made.sure]
    if unsure:
        notes.append(
            f"Spins are ambiguous in {len(unsure)} of {len(impacts)} impacts{of}: "
            "a higher frame rate or a mark of lower fold determines them"
        )
    low, high = filmed.contact_time[1:]
    off = [made for made in impacts if not low < made.values[6] < high]
    if filmed.court is not None and 2 * len(off) > len(impacts):
        notes.append(
            f"gap_time is implausible in {len(off)} of {len(impacts)} impacts{of}: {_height_error(off, filmed)}. "
            f"Correct {spoken('--court', 'court')}, or leave it out"
        )
    if noise.outliers > MANY:
        notes.append(f"{100.0 * noise.outliers:.0f} % of all frames{of} are outliers: check the tracking")
    if filmed.row_time is not None and any(made.track.row is None for made in impacts):
        notes.append(f"Rows of frames{of} are not known: row_time of the rolling shutter was not used")
    return notes


def scale_words(scale: Check, where: str = "") -> str:
    """That the radius in the picture is not that of the ball."""
    off = 100.0 * (1.0 / scale.value - 1.0)
    kind = "large" if off > 0.0 else "small"
    return (
        f"The radius of the ball in the picture gives a scale of {scale.value:.4g} ± {scale.sd:.2g}{where}: "
        f"lengths are {abs(off):.2g} % too {kind}, or its outline is"
    )


def gravity_words(gravity: Check, where: str = "") -> str:
    """That gravity is off, and what that says of scale and clock."""
    ratio = gravity.value / GRAVITY
    said = f"g comes out as {gravity.value:.3g} ± {gravity.sd:.2g} m/s2{where}"
    if ratio > PLAYBACK or ratio < 1.0 / PLAYBACK:
        if ratio > 0.0:
            faster = ratio**0.5
            rate = f"{faster:.2g} × too high" if faster > 1.0 else f"{1.0 / faster:.2g} × too low"
            return (
                f"{said}: if the scale is right, the frame rate is {rate}. "
                "The rate of playback may differ from that of capture"
            )
        return f"{said}: y may point downwards, or the track does not show a flight"
    scale = 100.0 * (ratio - 1.0)
    clock = 100.0 * (ratio**0.5 - 1.0)
    if scale > 0.0:
        return f"{said}: the scale is {scale:.0f} % too large or the clock {clock:.0f} % too fast"
    return f"{said}: the scale is {-scale:.0f} % too small or the clock {-clock:.0f} % too slow"
