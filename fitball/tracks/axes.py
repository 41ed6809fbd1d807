"""Which way is up, and the plane of a flight in three dimensions.

A bounce changes the velocity of a ball mostly along the normal of the court, away from it: friction changes that
along the court by mu times as much at most. So the axis along which velocity jumps most points upwards. Gravity
decides where there is no bounce.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import replace
from math import degrees

import numpy as np

from fitball.data.cells import refusal
from fitball.tracks.clips import Clip, Reading, some_of
from fitball.tracks.motion import SURE, bounces, gravity, kink
from fitball.values import FloatArray
from fitball.wording import spoken

_AXES = "xyz"
# A bounce jumps along one axis by this factor more than along others, or no axis is that of the court's normal.
_CLEAR = 1.25


def upright(clips: Sequence[Clip], mixed: Set[str], how: Reading) -> list[Clip]:
    """The clips of a session in metres with the last coordinate upwards, and notes on what was changed. Clips in
    `mixed` show two objects, and no direction.

    Raises TableError where what is stated contradicts the bounces, and where bounces jump along x of a picture.
    """
    widths = sorted({clip.position.shape[1] for clip in clips})
    alike = [[clip for clip in clips if clip.position.shape[1] == width] for width in widths]
    return [clip for some in alike for clip in _upright(some, [one for one in some if one.id not in mixed], how)]


def _upright(clips: Sequence[Clip], evidence: Sequence[Clip], how: Reading) -> list[Clip]:
    flat = clips[0].position.shape[1] == 2
    axis, sign, reason, bounced = _found(evidence) or (None, 1.0, "", False)
    stated = _stated(flat, how)
    if flat and axis == 0:
        raise refusal(
            clips[0].source,
            f"the ball bounces along x ({reason}); expected bounces along y: turn the picture, or "
            "exchange the columns: " + spoken("--columns x=y,y=x", "columns={'x': 'y', 'y': 'x'}"),
        )
    if stated is not None:
        if axis is not None and stated != (axis, sign) and bounced and not how.as_read:
            words = f"{'-' if stated[1] < 0.0 else ''}{_AXES[stated[0]]}"
            raise refusal(
                clips[0].source,
                f"{words} is stated to point upwards, but {'-' if sign < 0.0 else ''}{_AXES[axis]} does by the "
                f"motion of the ball ({reason}); expected the direction away from the court: correct "
                f"{spoken('--y-down or --up', 'y_down or up')}",
            )
        doubt = "" if axis is None or stated == (axis, sign) else f", although {reason}"
        (axis, sign), reason = stated, f"as stated{doubt}"
    if axis is None:
        if not flat:
            raise refusal(
                clips[0].source,
                "no bounce and no gravity shows which axis points upwards; state it: " + spoken("--up z", "up='z'"),
            )
        return [clip.noted("y was read as upwards: no bounce or gravity shows its direction") for clip in clips]
    note = f"{'-' if sign < 0.0 else ''}{_AXES[axis]} points upwards ({reason})"
    note = f"y was read as downwards ({reason})" if flat and sign < 0.0 else note
    others = [k for k in range(clips[0].position.shape[1]) if k != axis]
    turned = []
    for clip in clips:
        height = sign * clip.position[:, axis]
        # Of a rolling shutter rows count downwards; from which edge only moves the clock.
        rows = -height / clip.metres_per_px if flat and clip.metres_per_px is not None else None
        moved = replace(clip, position=np.column_stack([clip.position[:, others], height]), row=rows)
        turned.append(moved if flat and sign > 0.0 and "although" not in reason else moved.noted(note))
    return turned


def _stated(flat: bool, how: Reading) -> tuple[int, float] | None:
    if how.up is not None:
        return _AXES.index(how.up[-1]), -1.0 if how.up.startswith("-") else 1.0
    if flat and how.y_down is not None:
        return 1, -1.0 if how.y_down else 1.0
    return None


def _found(clips: Sequence[Clip]) -> tuple[int, float, str, bool] | None:
    """Axis and direction upwards, the reason in words, and whether that is a bounce, else gravity; None without."""
    if not clips:
        return None
    jumps, pulls, sideways, flat = [], [], 0, clips[0].position.shape[1] == 2
    for clip in some_of(clips):
        assert clip.time is not None
        bend = kink(clip.time, clip.position)
        if bend is not None and bend.score > 2.0 * SURE:
            turned = bend.before * bend.after < 0.0
            # A picture stands upright, if the ball turns round along y, here or elsewhere.
            upward = flat and (turned[1] or any(len(bounces(clip.time, s * clip.position[:, 1])) for s in (1, -1)))
            axis = 1 if upward else int(np.argmax(np.abs(bend.jump)))
            # The ball turns round along the normal.
            if bend.before[axis] * bend.after[axis] < 0.0:
                jumps.append(bend.jump)
                sideways += axis != 1
                if flat:
                    continue
        breaks = [] if bend is None else [bend.time]
        values = [gravity(clip.time, column, breaks) for column in clip.position.T]
        pulls.append([0.0 if flat and k == 0 else value / sd for k, (value, sd) in enumerate(values)])
    if jumps:
        jump = np.median(jumps, axis=0)
        axis = int(2 * sideways <= len(jumps)) if flat else int(np.argmax(np.abs(jump)))
        rest = np.delete(np.abs(jump), axis)
        if flat or np.abs(jump[axis]) > _CLEAR * rest.max():
            words = (
                f"the bounce changes the velocity along it by {abs(jump[axis]):.3g} and across by {rest.max():.3g}"
            )
            return axis, float(np.sign(jump[axis])), words + " m/s", True
    if not pulls:
        return None
    pull = np.median(np.nan_to_num(pulls), axis=0)
    axis = int(np.argmax(np.abs(pull)))
    if np.abs(pull[axis]) > SURE:
        words = f"the flight bends the other way, by {abs(pull[axis]):.0f} sd: gravity"
        return axis, -float(np.sign(pull[axis])), words, False
    return None


def in_plane(clip: Clip) -> Clip:
    """A clip in three dimensions, its last axis upwards, with one bounce, as (frames, 2): along the horizontal
    direction of the incident flight, and upwards. A note says by how much the flight turns in the bounce.
    """
    assert clip.time is not None
    bend = kink(clip.time, clip.position)
    level = clip.position[:, :2]
    spread = level - level.mean(axis=0)
    along = np.linalg.svd(spread, full_matrices=False)[2][0]
    notes = ["three coordinates reduced to the vertical plane of the incident flight"]
    if bend is not None and np.hypot(*bend.before[:2]) > SURE * np.hypot(*bend.before_sd[:2]):
        along = bend.before[:2] / np.hypot(*bend.before[:2])
        turn, sd = _turn(bend.before[:2], bend.after[:2], bend.before_sd[:2], bend.after_sd[:2])
        if abs(turn) > 3.0 * sd:
            notes.append(
                f"the plane of flight turns by {degrees(turn):.1f} ± {degrees(sd):.1f} deg in the bounce; what is "
                "across the incident plane is left out"
            )
    elif spread[-1] @ along < spread[0] @ along:
        along = -along
    reduced = np.column_stack([spread @ along, clip.position[:, 2]])
    return replace(clip, position=reduced).noted(*notes)


def _turn(before: FloatArray, after: FloatArray, before_sd: FloatArray, after_sd: FloatArray) -> tuple[float, float]:
    """Angle from one horizontal velocity to another [rad], and its standard error."""
    cross = before[0] * after[1] - before[1] * after[0]
    angle = float(np.arctan2(cross, before @ after))
    parts = [
        np.hypot(*sd) / np.sqrt(2.0) / max(np.hypot(*v), 1e-9) for v, sd in ((before, before_sd), (after, after_sd))
    ]
    return angle, float(np.hypot(*parts))
