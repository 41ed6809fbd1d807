"""Impacts in tracks: where a ball turns from falling to rising, and the frames about each of these.

A track may hold many impacts. The frames of one reach to `REACH` before and after it, and not into another contact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.tracks.flight import GRAVITY, resistance
from fitball.tracks.frames import Check, Filmed, Refused, Track
from fitball.values import FloatArray

# How far [s] frames are used from an impact, and over how long [s] heights are smoothed by medians to find it.
REACH, SMOOTH = 0.15, 4e-3
# A ball that bounces falls and rises again by this many radii at least. It comes within so many radii, and so many
# steps between frames, of the lowest place.
DEEP, NEAR, NEAR_STEPS = 0.3, 0.5, 2.5
# Another object, or a wrong outline: the radius in the picture is off by this factor.
RADIUS_JUMP = 1.5
FEWEST_FRAMES = 7
# A maximum is sharp where the slope changes by so many times what free fall makes of it.
SHARP = 4.0


@dataclass(frozen=True)
class Piece:
    """Frames of one impact: `rows` (frames,) of the track, times `t` [s] from `origin`, the time of its lowest frame;
    `x` mirrored where the ball flies to the left, `phi` topspin positive [rad, NaN where not measured].
    """

    id: str
    track: Track
    rows: NDArray[np.int64]
    origin: float
    t: FloatArray
    x: FloatArray
    y: FloatArray
    phi: FloatArray
    mirrored: bool
    notes: tuple[str, ...] = ()


def frames_in_words(track: Track, rows: NDArray[np.int64], most: int = 5) -> str:
    """The numbers of some frames in the film."""
    shown = ", ".join(str(int(k)) for k in track.frame[rows[:most]])
    more = f" and {rows.size - most} more" if rows.size > most else ""
    return f"frame{'s' if rows.size > 1 else ''} {shown}{more}"


def frame_times(track: Track, filmed: Filmed) -> FloatArray:
    """Times of frames [s]; a rolling shutter sees a ball that is lower in the picture later."""
    if filmed.row_time is None or track.row is None:
        return track.time
    return track.time + filmed.row_time * track.row


def pieces_of(track: Track, filmed: Filmed) -> tuple[list[Piece], list[Refused]]:
    """The impacts of a track, in order of time, and what has none, with the reason."""
    # Half a second, which only tracks need.
    from scipy.ndimage import median_filter
    from scipy.signal import find_peaks

    def refused(reason: str) -> tuple[list[Piece], list[Refused]]:
        return [], [Refused(track.id, track.source, reason)]

    if track.in_px and track.metres_per_px is None:
        return refused("positions are in pixels and there is no scale: state metres per pixel, or measure the radius")
    radius, time = filmed.ball.radius, frame_times(track, filmed)
    whole = np.flatnonzero(np.isfinite(time) & np.isfinite(track.x) & np.isfinite(track.y))
    whole = whole[np.argsort(time[whole], kind="stable")]
    notes: list[str] = []
    if track.radius is not None and np.isfinite(track.radius[whole]).sum() > 2:
        ratio = track.radius[whole] / np.nanmedian(track.radius[whole])
        jumps = whole[(ratio > RADIUS_JUMP) | (ratio < 1.0 / RADIUS_JUMP)]
        if 3 * jumps.size > whole.size:
            return refused(
                f"the radius changes by more than {RADIUS_JUMP} × in {jumps.size} of {whole.size} frames "
                f"({frames_in_words(track, jumps)}): the track follows more than one object"
            )
        if jumps.size:
            notes.append(
                f"{frames_in_words(track, jumps)}: the radius differs by more than {RADIUS_JUMP} × from the others; "
                "these frames are left out as another object"
            )
            whole = np.setdiff1d(whole, jumps, assume_unique=True)
            whole = whole[np.argsort(time[whole], kind="stable")]
    whole = whole[np.diff(time[whole], prepend=-np.inf) > 0.0]
    if whole.size < FEWEST_FRAMES:
        return refused(
            f"{whole.size} frames with a position; an impact needs at least {FEWEST_FRAMES}, three on each side"
        )
    t, y = time[whole], track.y[whole]
    size = max(3, int(SMOOTH / float(np.median(np.diff(t)))) | 1)
    smooth = median_filter(y, size=min(size, whole.size | 1), mode="nearest")
    lows, _ = find_peaks(-smooth, prominence=DEEP * radius)
    near = NEAR * radius + NEAR_STEPS * float(np.median(np.abs(np.diff(smooth))))
    lows = _apart(lows[smooth[lows] < smooth.min() + near], t, smooth, 2.0 * filmed.contact_time[2])
    if not lows.size:
        tops, _ = find_peaks(smooth, prominence=DEEP * radius)
        if tops.size:
            top = int(tops[0])
            said = f"no bounce: the height has a maximum at {frames_in_words(track, whole[[top]])} and no minimum"
            return refused(f"{said}. If y grows downwards in the file, say so" if _sharp(t, y, top) else said)
        moves = "falls" if smooth[-1] < smooth[0] else "rises"
        return refused(f"no bounce: the ball only {moves} from {_ends(track, whole)}")
    found = []
    contact = filmed.contact_time[2]
    for number, low in enumerate(lows):
        start = t[lows[number - 1]] + contact if number else -np.inf
        end = t[lows[number + 1]] - contact if number + 1 < lows.size else np.inf
        use = (t > max(start, t[low] - REACH)) & (t < min(end, t[low] + REACH))
        rows = whole[use]
        own = t[use] - t[low]
        before = own < 0.0
        lag = max(1, int(before.sum()) // 2)
        x = track.x[rows]
        early = x[before]
        mirrored = bool(early.size > lag and np.median(early[lag:] - early[:-lag]) < 0.0)
        angle = np.full(rows.size, np.nan) if track.angle is None else track.angle[rows]
        found.append(
            Piece(
                track.id if lows.size == 1 else f"{track.id}-{number + 1}",
                track, rows, float(t[low]), own, -x if mirrored else x, track.y[rows],
                angle if mirrored else -angle, mirrored, tuple(notes),
            )
        )  # fmt: skip
    return found, []


def _sharp(t: FloatArray, y: FloatArray, top: int) -> bool:
    """Whether the slope changes at a maximum by more than free fall could over the frames beside it."""
    before, after = slice(max(0, top - 4), top + 1), slice(top, top + 5)
    if min(t[before].size, t[after].size) < 3:
        return False
    change = np.polyfit(t[after], y[after], 1)[0] - np.polyfit(t[before], y[before], 1)[0]
    return bool(-change > SHARP * GRAVITY * (t[after][-1] - t[before][0]))


def falling(pieces: Sequence[Piece], filmed: Filmed) -> Check | None:
    """Gravity [m/s^2] by parabolas through all heights of a track well away from the contact, with its sd.

    It finds wrong rates of frames, and so takes nothing for granted that depends on time: drag is that of the
    speeds as they seem to be, lift unknown. None where flights are too short.
    """
    weights = values = 0.0
    k = resistance(filmed.ball, filmed.air.density)
    for piece in pieces:
        time = frame_times(piece.track, filmed) - piece.origin
        whole = np.isfinite(time) & np.isfinite(piece.track.x) & np.isfinite(piece.track.y)
        away = max(filmed.contact_time[2], 3.5 * float(np.median(np.diff(np.sort(time[whole])))))
        alone = piece.id == piece.track.id
        whole &= alone | ((time >= piece.t[0]) & (time <= piece.t[-1]))
        for side in (whole & (time < -away), whole & (time > away)):
            t, x, y = time[side], piece.track.x[side], piece.track.y[side]
            if np.unique(t).size < 6:
                continue
            t = t - np.mean(t)
            residual = np.abs(y - np.polyval(np.polyfit(t, y, 2), t))
            kept = residual <= 4.0 * np.median(residual) + 1e-12
            if np.unique(t[kept]).size < 6:
                continue
            t, x, y = t[kept] - np.mean(t[kept]), x[kept], y[kept]
            curve = np.polyfit(t, y, 2)
            rest, bend = np.polyval(curve, t) - y, t * t - np.mean(t * t)
            error = 2.0 * float(np.sqrt(np.sum(rest**2) / (t.size - 3) / np.sum(bend**2)))
            v_x, v_y = float(np.polyfit(t, x, 1)[0]), float(curve[1])
            speed = float(np.hypot(v_x, v_y))
            value = -2.0 * float(curve[0]) - k * speed * filmed.air.drag * v_y
            variance = error**2 + (k * speed * (0.3 * abs(v_x) + 0.2 * abs(v_y))) ** 2 + 1e-12
            values += value / variance
            weights += 1.0 / variance
    return Check(values / weights, float(weights**-0.5)) if weights else None


def _apart(lows: NDArray[np.int64], t: FloatArray, y: FloatArray, least: float) -> NDArray[np.int64]:
    """Those of which no lower one is nearer than `least` [s]: outliers near a contact make more than one."""
    kept: list[int] = []
    for low in lows[np.argsort(y[lows], kind="stable")].tolist():
        if all(abs(t[low] - t[other]) > least for other in kept):
            kept.append(low)
    return np.array(sorted(kept), dtype=np.int64)


def _ends(track: Track, rows: NDArray[np.int64]) -> str:
    return f"frame {int(track.frame[rows[0]])} to frame {int(track.frame[rows[-1]])}"
