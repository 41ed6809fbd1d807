"""From tracks to impacts, session by session: passes over all impacts, what they share, checks and notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.data.scene import Camera, Quantity
from fitball.data.table import FrozenMapping
from fitball.tracks import pooled, spins
from fitball.tracks.estimate import (
    DRAG,
    GUARD,
    OMEGA,
    PHI,
    TWISTED,
    V_X,
    V_Y,
    WIDTH,
    Batch,
    C,
    Priors,
    Sides,
    X,
    Y,
    leave_out_thin,
    lifts,
    nine,
    refine,
    start,
)
from fitball.tracks.find import Piece, falling, pieces_of
from fitball.tracks.flight import GRAVITY, lift_of, resistance
from fitball.tracks.frames import (
    AFTER,
    BEFORE,
    NINE,
    UNUSED,
    Check,
    Filmed,
    Flight,
    Refused,
    SessionNoise,
    SpinPair,
    Track,
    TrackedImpact,
    Tracks,
)
from fitball.tracks.judged import height_notes, impact_notes, refusal, session_notes, wrong_rate
from fitball.values import FloatArray

# Noise of an angle [rad] before it is known, and what the height of the court begins with below the lowest frames.
ANGLE_NOISE, PRESSED = np.radians(3.0), 0.01
# What a film that states nothing of these is taken to have: scale, clock, tilt [rad] and height of the court [m].
CAMERA_SDS = {"scale": 0.01, "clock": 1e-3, "tilt": float(np.radians(0.3)), "court_height": 3e-3}
# Spin of a ball of unknown spin that leaves a court, over that of a ball that rolls.
ROLLING = 1.0
# Share of frames of a side that fit, below which another start is tried.
FITTING = 0.75
# The quantities whose sign a mirrored picture changes.
MIRRORED = np.array([-1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0, -1.0])
# The part of the `NINE` that marks determine.
OF_MARKS = [NINE.index(name) for name in ("omega_1", "omega_2", "gap_turn")]


@dataclass
class _Session:
    """The impacts of a session while they are fitted."""

    filmed: Filmed
    pieces: list[Piece]
    batch: Batch
    sides: Sides
    priors: Priors
    pairs: list[tuple[SpinPair, ...]]
    noise: SessionNoise
    gravity: Check | None


def estimate(tracks: Sequence[Track], filmed: Filmed) -> Tracks:
    """The impacts of all tracks, with noise and checks of each session, and what goes into `[camera]`.

    Tracks without an impact are in `refused`, with the reason. Nothing is raised for tracks that do not fit.
    """
    found: list[Piece] = []
    refused: list[Refused] = []
    for track in tracks:
        pieces, none = pieces_of(track, filmed)
        found += pieces
        refused += none
    found = _of_right_rate(found, filmed, refused)
    notes: list[str] = []
    height_sds: list[float] = []
    impacts: list[TrackedImpact] = []
    noise: dict[str, SessionNoise] = {}
    gravity: dict[str, Check] = {}
    scale: dict[str, Check] = {}
    for name in dict.fromkeys(piece.track.session for piece in found):
        own = [piece for piece in found if piece.track.session == name]
        height, height_sd, words = (filmed.court, None, "") if filmed.court is not None else _height(own, filmed)
        session = _fit_session(own, filmed, height)
        good = []
        for k, piece in enumerate(own):
            reason = session.sides.failed[k]
            if not reason:
                made = _impact(session, k, piece)
                reason = refusal(made, filmed)
            if reason:
                refused.append(Refused(piece.id, piece.track.source, reason))
            else:
                good.append(replace(made, notes=(*made.notes, *impact_notes(made, filmed))))
        impacts += _on_tilted_court(good, filmed.camera.tilt or Quantity(0.0, CAMERA_SDS["tilt"]))
        if not good:
            continue
        noise[name] = session.noise
        if height_sd is not None:
            height_sds.append(height_sd)
            notes.append(f"Session {name}: {words[0].lower()}{words[1:]}" if name else words)
        if session.gravity is not None:
            gravity[name] = session.gravity
        by_radius = pooled.scale_by_radius([piece.track for piece in own], filmed.ball.radius)
        if by_radius is not None:
            scale[name] = by_radius
        notes += session_notes(name, good, session.noise, session.gravity, by_radius, filmed)
    order = {piece.id: place for place, piece in enumerate(found)}
    impacts.sort(key=lambda made: order[made.id])
    return Tracks(
        filmed, tuple(impacts), tuple(refused), FrozenMapping(noise), FrozenMapping(gravity), FrozenMapping(scale),
        _camera(filmed, max(height_sds, default=None)), tuple(notes),
    )  # fmt: skip


def _of_right_rate(found: list[Piece], filmed: Filmed, refused: list[Refused]) -> list[Piece]:
    """Pieces of sessions whose balls fall about as they do on earth; all others are `refused`."""
    kept: list[Piece] = []
    for name in dict.fromkeys(piece.track.session for piece in found):
        own = [piece for piece in found if piece.track.session == name]
        reason = wrong_rate(falling(own, filmed))
        if reason:
            refused += [Refused(piece.id, piece.track.source, reason) for piece in own]
        else:
            kept += own
    return kept


def _camera(filmed: Filmed, height_sd: float | None) -> Camera:
    """What the fit of the table takes as shared: as stated, else the usual sds."""
    stated = filmed.camera
    height = Quantity(0.0, CAMERA_SDS["court_height"] if height_sd is None else height_sd)
    return replace(
        stated,
        scale=stated.scale or Quantity(1.0, CAMERA_SDS["scale"]),
        clock=stated.clock or Quantity(1.0, CAMERA_SDS["clock"]),
        tilt=stated.tilt or Quantity(0.0, CAMERA_SDS["tilt"]),
        court_height=stated.court_height or height,
    )


def _on_tilted_court(impacts: Sequence[TrackedImpact], tilt: Quantity) -> list[TrackedImpact]:
    """Impacts with the errors of the height at the place of their landing, where the tilt of the court is uncertain
    and balls land apart in the picture. They count as each impact's own; what all have in common is `court_height`.
    """
    places = np.array([-one.before.x if one.mirrored else one.before.x for one in impacts])
    heights = (places - np.median(places)) * (tilt.sd or 0.0) if len(impacts) else places
    made = []
    for one, height in zip(impacts, heights, strict=True):
        v_x1, v_y1, omega_1, v_x2, v_y2, omega_2 = one.values[:6]
        slope = np.zeros(len(NINE))
        slope[6:] = 1.0 / v_y1 + 1.0 / v_y2, v_x1 / v_y1 + v_x2 / v_y2, omega_1 / v_y1 + omega_2 / v_y2
        slope = height * np.nan_to_num(slope)
        made.append(replace(one, covariance=one.covariance + np.outer(slope, slope)))
    return made


def _batch(pieces: Sequence[Piece], filmed: Filmed, height: float) -> Batch:
    """Pieces side by side, filled up with NaN."""
    count, most = len(pieces), max(piece.t.size for piece in pieces)

    def filled(arrays: Sequence[FloatArray]) -> FloatArray:
        made = np.full((count, most), np.nan)
        for row, array in zip(made, arrays, strict=True):
            row[: array.size] = array
        return made

    ball = filmed.ball
    batch = Batch(
        filled([piece.t for piece in pieces]), filled([piece.x for piece in pieces]),
        filled([piece.y for piece in pieces]), filled([piece.phi for piece in pieces]),
        np.array([float(piece.track.fold) for piece in pieces]), height + ball.radius,
        resistance(ball, filmed.air.density), ball.radius, np.full((count, 3), ANGLE_NOISE),
        np.array([pooled.OUTLIERS, pooled.ANGLE_OUTLIERS]), filmed.contact_time[0],
    )  # fmt: skip
    pooled.first_noise(batch)
    return batch


def _unmarked(count: int, filmed: Filmed) -> Priors:
    air = filmed.air
    return Priors(
        np.full(count, air.drag), np.full(count, np.hypot(air.drag_sd, air.drag_shot_sd)),
        np.zeros((count, 2)), np.full(count, air.lift_unmarked_sd), np.zeros(count, dtype=bool),
    )  # fmt: skip


def _positions(pieces: Sequence[Piece], filmed: Filmed, height: float) -> tuple[Batch, Sides, Priors]:
    """Fits by positions alone, lift unknown, with noise and drag pooled."""
    batch = _batch(pieces, filmed, height)
    priors = _unmarked(len(pieces), filmed)
    sides = Sides.empty(batch)
    start(batch, sides, filmed.air.drag)
    refine(batch, sides, priors, first=True)
    for _ in range(2):
        pooled.pool_noise(batch, sides)
        _start_again(pieces, filmed, batch, sides)
        priors.lift[:, 1] = _lift_after(sides, filmed)
        refine(batch, sides, priors, first=False, sweeps=3)
    return batch, sides, priors


def _start_again(pieces: Sequence[Piece], filmed: Filmed, batch: Batch, sides: Sides) -> None:
    """Try other starts, from frames farther from the contact, where a side has many outliers; keep what fits more."""

    def fitting(some: Sides) -> FloatArray:
        counts = [np.where(some.role == role, some.weight > 0.5, False).sum(axis=1) for role in (BEFORE, AFTER)]
        used = [np.maximum((some.role == role).sum(axis=1), 1) for role in (BEFORE, AFTER)]
        shares = np.minimum(counts[0] / used[0], counts[1] / used[1])
        return np.where(some.good, shares, 0.0)

    doubtful = np.flatnonzero(sides.good & (fitting(sides) < FITTING))
    for frames in (1.0, 2.0):
        if not doubtful.size:
            return
        own = batch.take(doubtful)
        other = Sides.empty(own)
        step = float(np.median([np.median(np.diff(pieces[k].t)) for k in doubtful.tolist()]))
        start(own, other, filmed.air.drag, frames * step)
        refine(own, other, _unmarked(doubtful.size, filmed), first=True)
        better = fitting(other) > fitting(_of(sides, doubtful))
        for name, value in vars(sides).items():
            if name == "failed":
                continue
            value[doubtful[better]] = vars(other)[name][better]
        doubtful = doubtful[~better]


def _lift_after(sides: Sides, filmed: Filmed) -> FloatArray:
    """Lift coefficients (impacts,) of balls of unknown spin that leave a court, nearly rolling."""
    v_x, v_y = sides.state[:, WIDTH + V_X], sides.state[:, WIDTH + V_Y]
    radius = filmed.ball.radius
    return np.asarray(lift_of(ROLLING * v_x / radius, np.maximum(np.hypot(v_x, v_y), 0.1), radius))


def _height(pieces: Sequence[Piece], filmed: Filmed) -> tuple[float, float, str]:
    """Height of the court at which the median time over contact is the ball's plausible one; its sd, and a note."""
    usual, low, high = filmed.contact_time
    # The second lowest frame: the lowest may be an outlier.
    lowest = [float(np.sort(piece.y)[:2][-1]) for piece in pieces]
    height, slope = float(np.median(lowest)) + PRESSED - filmed.ball.radius, 0.2
    for _ in range(4):
        _batch_of, sides, _priors = _positions(pieces, filmed, height)
        state, use = sides.state, sides.good
        if not use.any():
            break
        slope = float(np.median(1.0 / state[use, WIDTH + V_Y] - 1.0 / state[use, V_Y]))
        step = (usual - float(np.median(sides.times[use, 1] - sides.times[use, 0]))) / slope
        height += step
        if abs(step) < 1e-5:
            break
    sd = 0.25 * (high - low) / slope
    return height, sd, height_notes(height, sd, usual, (low, high))


def _fit_session(pieces: list[Piece], filmed: Filmed, height: float) -> _Session:
    """All passes: positions, spins, both together with noise and drag of the session, slow errors."""
    batch, sides, priors = _positions(pieces, filmed, height)
    count = len(pieces)
    pairs: list[tuple[SpinPair, ...]] = [()] * count
    marked = np.array([bool(np.isfinite(piece.phi).any()) for piece in pieces])
    for _ in range(2):
        if not marked.any():
            break
        pairs = _spins(filmed, batch, sides, marked)
        _take_spins(sides, priors, pairs, filmed)
        refine(batch, sides, priors, first=False, sweeps=3)
        pooled.pool_angle_noise(batch, sides, priors.marked)
    noise_x = noise_y = 0.0
    for _ in range(2):
        noise_x, noise_y = pooled.pool_noise(batch, sides)
        pooled.pool_angle_noise(batch, sides, priors.marked)
        pooled.session_drag(sides, priors, filmed.air)
        refine(batch, sides, priors, first=False, sweeps=4)
    leave_out_thin(sides)
    slow, halves = pooled.slow_errors(batch, sides)
    gravity = pooled.gravity(batch, sides, priors, GRAVITY, slow)
    refine(batch, sides, priors, first=False, sweeps=1, inflate=slow)
    angle = float(batch.sigma[0, 2]) if priors.marked.any() else float("nan")
    noise = SessionNoise(noise_x, noise_y, angle, float(batch.outliers[0]), slow, halves)
    return _Session(filmed, pieces, batch, sides, priors, pairs, noise, gravity)


def _spins(filmed: Filmed, batch: Batch, sides: Sides, marked: NDArray[np.bool_]) -> list[tuple[SpinPair, ...]]:
    """Pairs of spins of each impact that has marks."""
    made: list[tuple[SpinPair, ...]] = []
    for i in range(len(sides.failed)):
        if sides.failed[i] or not marked[i]:
            made.append(())
            continue
        first, last = sides.times[i]
        known = np.isfinite(batch.phi[i])
        lines = []
        for time, use in (
            (first, known & (batch.t[i] < first - GUARD)),
            (last, known & (batch.t[i] > last + TWISTED)),
        ):
            lines.append(
                spins.candidates(
                    batch.t[i, use] - time,
                    batch.phi[i, use],
                    int(batch.fold[i]),
                    float(batch.sigma[i, 2]),
                    float(batch.outliers[1]),
                )
            )
        state, errors = sides.state[i], np.sqrt(np.diagonal(sides.covariance[i]))
        speed = np.hypot(errors[V_X], errors[WIDTH + V_X])
        late = np.hypot(errors[Y] / state[V_Y], errors[WIDTH + Y] / state[WIDTH + V_Y])
        bounce = spins.Bounce(
            state[V_X], -state[V_Y], state[WIDTH + V_X], state[WIDTH + V_Y], last - first, float(speed), float(late)
        )
        made.append(spins.pairs_of(lines[0], lines[1], bounce, int(batch.fold[i]), filmed.ball, filmed.spin_sd))
    return made


def _take_spins(sides: Sides, priors: Priors, pairs: list[tuple[SpinPair, ...]], filmed: Filmed) -> None:
    """Let spins that are sure act in the fits; lift is unknown where none are."""
    lift_after = _lift_after(sides, filmed)
    for i, own in enumerate(pairs):
        sure = bool(own) and own[0].probability > spins.SURE
        priors.marked[i] = sure
        if sure:
            priors.lift[i] = 0.0
        else:
            priors.lift[i] = 0.0, lift_after[i]
        priors.lift_sd[i] = filmed.air.lift_sd if sure else filmed.air.lift_unmarked_sd
        if sure:
            one, state = own[0], sides.state[i]
            state[OMEGA], state[WIDTH + OMEGA] = one.omega_1, one.omega_2
            state[PHI], state[WIDTH + PHI] = one.phi_1, one.phi_1 + one.turn
            state[C] = state[WIDTH + C] = 0.0


def _impact(session: _Session, k: int, piece: Piece) -> TrackedImpact:
    """One impact as it is handed on, in metres and seconds of its track."""
    batch, sides, marked = session.batch, session.sides, bool(session.priors.marked[k])
    one = np.array([k])
    batch, sides = batch.take(one), _of(sides, one)
    values, slopes = nine(batch, sides, session.priors.marked[one])
    covariance = slopes[0] @ sides.covariance[0] @ slopes[0].T
    value = values[0]
    if not marked:
        value[OF_MARKS] = np.nan
        covariance[OF_MARKS, :] = covariance[:, OF_MARKS] = 0.0
    pairs, sign = session.pairs[k], 1.0
    if value[0] < 0.0:
        sign = -1.0
        value, covariance = value * MIRRORED, covariance * np.outer(MIRRORED, MIRRORED)
        pairs = tuple(
            replace(pair, omega_1=-pair.omega_1, omega_2=-pair.omega_2, turn=-pair.turn, phi_1=-pair.phi_1)
            for pair in pairs
        )
    count = piece.t.size
    role = np.full(piece.track.time.size, UNUSED, dtype=np.int64)
    weight, angle_residual = np.full(role.size, np.nan), np.full(role.size, np.nan)
    residual = np.full((role.size, 2), np.nan)
    role[piece.rows] = sides.role[0, :count]
    weight[piece.rows] = sides.weight[0, :count]
    residual[piece.rows, 0], residual[piece.rows, 1] = sign * sides.r_x[0, :count], sides.r_y[0, :count]
    angle_residual[piece.rows] = sign * sides.r_phi[0, :count]
    flights = []
    for side in (0, 1):
        state = sides.state[0, side * WIDTH : (side + 1) * WIDTH]
        lift = float(lifts(batch, sides, session.priors.marked[one], side)[0])
        angle, omega = (sign * state[PHI], sign * state[OMEGA]) if marked else (np.nan, np.nan)
        flights.append(
            Flight(
                float(sides.times[0, side] + piece.origin), float(sign * state[X]), float(state[Y]),
                float(sign * state[V_X]), float(state[V_Y]), float(sides.state[0, DRAG]), sign * lift,
                float(angle), float(omega),
            )
        )  # fmt: skip
    return TrackedImpact(
        piece.id, piece.track, value, 0.5 * (covariance + covariance.T), flights[0], flights[1], role, weight,
        residual, angle_residual, pairs, marked, piece.mirrored != (sign < 0.0), piece.notes,
    )  # fmt: skip


def _of(sides: Sides, rows: NDArray[np.int64]) -> Sides:
    arrays = {name: value[rows] for name, value in vars(sides).items() if name != "failed"}
    return Sides(**arrays, failed=[sides.failed[int(k)] for k in rows])
