"""What all impacts of a session determine together: noise of frames, drag, slow errors, gravity.

All are linear statistics of the residuals of the fits. With the derivatives `J` of the frames by the unknowns, the
covariance `C` of these and the noise `S` of frames, residuals have the covariance `S - J C J'`, also with priors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma

from fitball.tracks.estimate import (
    COUNT,
    DRAG,
    INFO_ANGLE,
    INFO_X,
    INFO_Y,
    PHI,
    WIDTH,
    Batch,
    C,
    Priors,
    Sides,
    shares,
)
from fitball.tracks.frames import AFTER, BEFORE, Air, Check, Track
from fitball.values import FloatArray

# A track's own noise counts as this many frames of the session's noise, where tracks are too few to show how much
# noise differs between them.
FRAMES_OF_SESSION = 6.0
# Fewest tracks that show it, and most frames that the session's noise counts as.
TRACKS_THAT_SHOW, MOST_FRAMES = 10, 1e3
# Shares of outliers before there are data, the number of frames these count as, and their range.
OUTLIERS, ANGLE_OUTLIERS, OUTLIER_FRAMES, OUTLIER_RANGE = 0.02, 0.05, 50.0, (2e-3, 0.3)
# Spread that the square of the factor of slow errors is expected to have about one.
SLOW_SPREAD = 0.5
# Fewest frames in the near and in the far half of a flight.
HALF = 3
LEAST_NOISE, LEAST_ANGLE_NOISE = 1e-7, 1e-4


def first_noise(batch: Batch) -> None:
    """Noise before any fit, from third differences of positions away from the contact."""
    for axis, values in enumerate((batch.x, batch.y)):
        spread: list[FloatArray] = []
        for t, row in zip(batch.t, values, strict=True):
            sides = (t < -batch.contact_time, t > batch.contact_time)
            spread += [np.abs(np.diff(row[side], 3)) for side in sides]
        found = np.concatenate(spread)
        found = found[np.isfinite(found)]
        sd = float(np.median(found)) / (0.6745 * np.sqrt(20.0)) if found.size else 1e-3
        batch.sigma[:, axis] = max(sd, LEAST_NOISE)


def pool_noise(batch: Batch, sides: Sides) -> tuple[float, float]:
    """Renew the noise of each track and the shares of outliers; the session's noise of x and y.

    With `s0` of the session, a track has `(n0 s0^2 + sum w r^2)/(n0 + n - p)`. The number of frames `n0` that the
    session counts as follows from how far noise differs between tracks (Smyth 2004), or is `FRAMES_OF_SESSION`.
    """
    good, pooled = sides.good, []
    for axis, residual in ((INFO_X, sides.r_x), (INFO_Y, sides.r_y)):
        frames, used = shares(sides, axis)
        squares = np.nansum(sides.weight * residual**2, axis=1)
        free = np.maximum(frames - used, 0.0)
        total = max(float(free[good].sum()), 1.0)
        session = max(float(squares[good].sum()) / total, LEAST_NOISE**2)
        count = _frames_of_session(squares[good], free[good])
        batch.sigma[:, axis] = np.sqrt((count * session + squares) / (count + free))
        pooled.append(float(np.sqrt(session)))
    out, seen = np.nansum(1.0 - sides.weight[good]), np.isfinite(sides.weight[good]).sum()
    batch.outliers[0] = _share(out, seen, OUTLIERS)
    return pooled[0], pooled[1]


def pool_angle_noise(batch: Batch, sides: Sides, marked: NDArray[np.bool_]) -> float:
    """Renew the noise of angles [rad], one for the session, and the share of their outliers."""
    use = sides.good & marked
    frames, used = shares(sides, INFO_ANGLE)
    squares = np.nansum(sides.angle_weight * sides.r_phi**2, axis=1)
    free = float(np.sum(frames[use] - used[use]))
    if free >= 1.0:
        batch.sigma[:, 2] = max(float(np.sqrt(squares[use].sum() / free)), LEAST_ANGLE_NOISE)
        out, seen = np.nansum(1.0 - sides.angle_weight[use]), np.isfinite(sides.angle_weight[use]).sum()
        batch.outliers[1] = _share(out, seen, ANGLE_OUTLIERS)
    return float(batch.sigma[0, 2])


def _share(out: float, seen: float, before: float) -> float:
    low, high = OUTLIER_RANGE
    return float(np.clip((out + OUTLIER_FRAMES * before) / (seen + OUTLIER_FRAMES), low, high))


def _frames_of_session(squares: FloatArray, free: FloatArray) -> float:
    """Degrees of freedom of the distribution of variances over tracks, by the moments of their logarithms."""
    use = (free > 2.0) & (squares > 0.0)
    if use.sum() < TRACKS_THAT_SHOW:
        return FRAMES_OF_SESSION
    half = free[use] / 2.0
    logs = np.log(squares[use] / free[use]) - digamma(half) + np.log(half)
    excess = float(np.var(logs, ddof=1) - np.mean(polygamma(1, half)))
    # trigamma(n0/2) = excess; trigamma falls.
    low, high = 0.5, MOST_FRAMES / 2.0
    if excess <= polygamma(1, high):
        return MOST_FRAMES
    for _ in range(60):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if polygamma(1, middle) > excess else (low, middle)
    return float(2.0 * np.sqrt(low * high))


def session_drag(sides: Sides, priors: Priors, air: Air) -> None:
    """Renew the prior of each impact's drag by what all others determine of the session's drag."""
    good = sides.good
    precision = np.maximum(1.0 / sides.covariance[:, DRAG, DRAG] - priors.drag_sd**-2, 1e-9)
    own = (sides.state[:, DRAG] / sides.covariance[:, DRAG, DRAG] - priors.drag * priors.drag_sd**-2) / precision
    weight = np.where(good, 1.0 / (1.0 / precision + air.drag_shot_sd**2), 0.0)
    total = weight.sum() + air.drag_sd**-2 - weight
    mean = (
        np.sum(weight * np.where(good, own, 0.0)) + air.drag * air.drag_sd**-2 - weight * np.where(good, own, 0.0)
    ) / total
    priors.drag = mean
    priors.drag_sd = np.sqrt(1.0 / total + air.drag_shot_sd**2)


def _rows(sides: Sides, i: int, use: NDArray[Any], side: int, axis: int) -> FloatArray:
    """Derivatives (frames, COUNT) of x (axis 0) or y of some frames of a side."""
    own = sides.rows[i, use, axis].copy()
    own[:, PHI] = 0.0
    made = np.zeros((own.shape[0], COUNT))
    made[:, side * WIDTH : (side + 1) * WIDTH] = own[:, :WIDTH]
    made[:, DRAG] = own[:, WIDTH]
    return made


def slow_errors(batch: Batch, sides: Sides) -> tuple[float, int]:
    """Factor by which errors that last widen all sds of positions, and the number of differences behind it.

    Its square is the mean square of what near and far frames differ by (`near_and_far`). It is drawn to one as far as
    there are few, and not taken below.
    """
    total, pairs = near_and_far(batch, sides)
    if not pairs:
        return 1.0, 0
    sure = SLOW_SPREAD**2 / (SLOW_SPREAD**2 + 2.0 / pairs)
    return float(np.sqrt(1.0 + max(0.0, (total / pairs - 1.0) * sure))), pairs


def near_and_far(batch: Batch, sides: Sides) -> tuple[float, int]:
    """Sum of squares of differences between near and far frames, in units of their sds, and their number.

    Lines through the residuals of the near and of the far half of a flight differ in place and slope at the contact.
    With noise of frames alone the mean square is one.
    """
    total, pairs = 0.0, 0
    for i in np.flatnonzero(sides.good).tolist():
        for side, role in enumerate((BEFORE, AFTER)):
            use = (sides.role[i] == role) & (sides.weight[i] > 0.5)
            places = np.flatnonzero(use)
            d = np.abs(batch.t[i, places] - sides.times[i, side])
            order = places[np.argsort(d, kind="stable")]
            if order.size < 2 * HALF:
                continue
            halves = order[: order.size // 2], order[order.size // 2 :]
            span = max(float(d.max()), 1e-9)
            for axis, residual in ((0, sides.r_x), (1, sides.r_y)):
                whole = np.concatenate(halves)
                lines = []
                for sign, half in zip((1.0, -1.0), halves, strict=True):
                    line = np.column_stack([np.ones(half.size), (batch.t[i, half] - sides.times[i, side]) / span])
                    lines.append(sign * np.linalg.pinv(line))
                contrast: FloatArray = np.hstack(lines)
                difference = contrast @ residual[i, whole]
                seen = contrast @ _rows(sides, i, whole, side, axis)
                noise = batch.sigma[i, axis] ** 2 * contrast @ contrast.T
                covariance = noise - seen @ sides.covariance[i] @ seen.T
                # What the fit takes up whole shows nothing.
                values, vectors = np.linalg.eigh(covariance)
                shown = values > 0.02 * np.trace(noise) / 2.0
                parts = (vectors.T @ difference)[shown] ** 2 / values[shown]
                total += float(parts.sum())
                pairs += int(shown.sum())
    return total, pairs


def gravity(batch: Batch, sides: Sides, priors: Priors, usual: float, slow: float) -> Check | None:
    """Gravity [m/s^2] as the flights show it, with its sd; None without impacts.

    One step of Gauss and Newton by gravity from the fits with the `usual` one, over all impacts together. What is
    unknown of lift and drag may be common to all of them, and counts as such.
    """
    score = information = 0.0
    common = np.zeros(3)
    precision = priors.precision()
    for i in np.flatnonzero(sides.good).tolist():
        pull, gain = np.zeros(COUNT), 0.0
        for side, role in enumerate((BEFORE, AFTER)):
            use = sides.role[i] == role
            d = batch.t[i, use] - sides.times[i, side]
            weight = sides.weight[i, use] / batch.sigma[i, 1] ** 2
            falls = -0.5 * d * d
            gain += float(np.sum(weight * falls**2))
            score += float(np.sum(weight * falls * sides.r_y[i, use]))
            pull += (weight * falls) @ _rows(sides, i, use, side, 1)
        information += gain - float(pull @ sides.covariance[i] @ pull)
        moved = precision[i] @ sides.covariance[i] @ pull
        common += [moved[place] * sd for place, sd in _shared(priors, i)]
    if not information > 0.0:
        return None
    variance = slow**2 / information + float(np.sum((common / information) ** 2))
    return Check(usual + score / information, float(np.sqrt(variance)))


def _shared(priors: Priors, i: int) -> list[tuple[int, float]]:
    return [(C, priors.lift_sd[i]), (WIDTH + C, priors.lift_sd[i]), (DRAG, priors.drag_sd[i])]


def scale_by_radius(tracks: Sequence[Track], radius: float) -> Check | None:
    """True lengths over those of the tracks, by the radius of the ball in the picture; None where tracks have none.

    The sd is that of the mean of tracks, or of frames where there is one track: outlines err in common in a track.
    """
    found = [track.radius[np.isfinite(track.radius)] for track in tracks if track.radius is not None]
    found = [radii for radii in found if radii.size > 2]
    if not found:
        return None
    middles = np.array([float(np.median(radii)) for radii in found])
    values = middles if middles.size > 1 else found[0]
    spread = float(np.std(values, ddof=1)) / float(np.sqrt(values.size))
    mean = float(np.mean(middles))
    return Check(radius / mean, radius * spread / mean**2)
