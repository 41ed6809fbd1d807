"""Spins that marks allow, pairs weighed by what a bounce can do.

Frames at equal times determine a spin modulo 2 pi f/m (f frames/s, fold m). Each side has
candidates, lines through the angles at optima of the periodogram; of pairs of them one is taken
only where it is sure.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.values import Ball, FloatArray
from fitball.tracks.flight import T1, T2, VX1, VX2, VY1, VY2, Impact
from fitball.tracks.types import FilmAssumptions, SpinPair, unwrap

# Fewest frames with an angle that show a spin: two are on a line whatever they are.
FEWEST_ANGLES = 3
# Least probability of a pair that is listed.
_LEAST_PROBABILITY = 1e-6
# Prior probability that the angles of a flight show no spin.
_UNREADABLE_PROBABILITY = 0.01
# Prior probability that angles are on lines, but not of the ball's spin as read: of something else,
# or the other way round.
_MISREAD_PROBABILITY = 1e-6
# Spins are searched up to so many sds of incident spins.
_SPIN_SDS = 4.0
# Most optima of the periodogram that are refined.
_MOST_OPTIMA = 40
# An optimum that is refined is at least this share of the highest one.
_LEAST_POWER = 0.4
# Lines whose log likelihood is more than this below that of the best are no candidates.
_MOST_LOG_BELOW = 10.0
# Least sd of angles, as a share of a turn of the mark in radians, in the first sweeps of a line: as
# far as angles are off by the steps of the periodogram.
_FIRST_ANGLE_SD = 0.13
# Factors of the sd of angles in the sweeps of a line, wide ones first.
_WIDENING = (4.0, 4.0, 2.0, 2.0, *[1.0] * 10)
# Lines whose spins differ by less than this share of a step of the periodogram are one.
_SAME_SPIN = 0.2
# Factor by which a refined line may leave the range of spins.
_MOST_BEYOND_REACH = 1.02
# Makes a matrix of normal equations regular, as a share of the product of its diagonal.
_RIDGE = 1e-9
# Offset of the normal force [m] that is expected of a bounce on a court.
_OFFSET = 1.5e-3
# Sd of the offset [m] over bounces.
_OFFSET_SD = 3e-3
# Least and most tangential restitution that cost no probability.
_E_X = (-1.0, 0.5)
# Sds of tangential restitution below the least and above the most.
_E_X_SD = (0.1, 0.15)
# Ratio of friction along the slip, where it should be against it, to the normal force: up to this
# it costs nothing, and beyond it this is the sd.
_PUSH_SD = 0.05
# In contact the ball turns as at a spin this share of the way from the first to the second.
_TURNED_SHARE = 0.6
# Sd of the turn in contact [rad] about that.
_TURN_SD = 0.25
# Slip [m/s] below which its sign and its restitution are unknown.
_LEAST_SLIP = 0.3
# Most that a log likelihood ratio counts, so that its exponential is finite.
_MOST_LOG = 50.0


class Line(NamedTuple):
    """A line through angles: angle [rad] at time zero and spin [rad/s] with their covariance, the
    log of its likelihood, and `evidence`, the log of the likelihood integrated over angle and spin.
    """

    phi: float
    omega: float
    covariance: Annotated[FloatArray, "2 2"]
    log_likelihood: float
    evidence: float


class _Candidate(NamedTuple):
    """A pair of spins with the log of its posterior density, and of how plausible its bounce is."""

    log: float
    fits: float
    pair: SpinPair


class _Refined(NamedTuple):
    """Lines refined at once: angles [rad] at the mean time and spins [rad/s], sums of weights,
    of weights times time and times its square, their determinant, and log likelihoods (lines,).
    """

    phase: FloatArray
    omega: FloatArray
    total: FloatArray
    moment: FloatArray
    square: FloatArray
    determinant: FloatArray
    logs: FloatArray


def weights(
    residual: Annotated[FloatArray, "... frames"],
    fold: int,
    sd: float,
    outliers: float,
) -> tuple[Annotated[FloatArray, "... frames"], Annotated[FloatArray, "... frames"]]:
    """For each residual [rad] of an angle the probability of being no outlier, and its likelihood.
    Residuals are normal with an `sd` [rad], or, with the share `outliers`, anywhere in a period.
    """
    normal = np.exp(-0.5 * (residual / sd) ** 2)
    good = (1.0 - outliers) * normal / (sd * np.sqrt(2.0 * np.pi))
    likelihood = good + outliers * fold / (2.0 * np.pi)
    return good / likelihood, likelihood


def lines_of_angles(
    d: Annotated[FloatArray, "frames"],
    phi: Annotated[FloatArray, "frames"],
    fold: int,
    sd: float,
    outliers: float,
    spin_sd: float,
) -> list[Line]:
    """Lines through angles `phi` [rad], with noise of this `sd` [rad], at times `d` [s] from the
    contact, best first; none of fewer than three frames. Spins are searched up to four `spin_sd`
    [rad/s].
    """
    if d.size < FEWEST_ANGLES:
        return []
    middle = float(d.mean())
    most = _SPIN_SDS * spin_sd
    from_middle = d - middle
    step = 0.5 / (fold * max(float(np.ptp(d)), 1e-6))
    grid = np.arange(-most, most + step, step)
    phase, omega = _optima(from_middle, phi, fold, grid)
    refined = _refine(phase, omega, from_middle, phi, fold, sd, outliers)
    from_mean_time = np.array([[1.0, -middle], [0.0, 1.0]])
    best = refined.logs.max()
    accepted = list[Line]()
    for k in np.argsort(-refined.logs, kind="stable").tolist():
        spin = float(refined.omega[k])
        total = refined.total[k]
        moment = refined.moment[k]
        square = refined.square[k]
        near = any(abs(spin - line.omega) < _SAME_SPIN * step for line in accepted)
        # Angles of one frame show no spin.
        flat = not total * square - moment**2 > _RIDGE * total * square
        far = abs(spin) > _MOST_BEYOND_REACH * most
        if near or flat or far or refined.logs[k] < best - _MOST_LOG_BELOW:
            continue
        scale = sd**2 / refined.determinant[k]
        at_mean_time = scale * np.array([[square, -moment], [-moment, total]])
        # From the mean time to the contact.
        covariance = from_mean_time @ at_mean_time @ from_mean_time.T
        log = float(refined.logs[k])
        evidence = float(log + 0.5 * np.linalg.slogdet(covariance)[1])
        accepted.append(
            Line(float(refined.phase[k]) - spin * middle, spin, covariance, log, evidence)
        )
    return accepted


def _optima(
    time: FloatArray,
    phi: FloatArray,
    fold: int,
    grid: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Angles at time zero and spins of the highest optima of the periodogram of angles (frames,) on
    a grid of spins, the highest first.
    """
    unturned = phi - np.multiply.outer(grid, time)
    waves = np.exp(1j * fold * unturned).sum(axis=1)
    power = np.abs(waves)
    edge = np.concatenate([[-1.0], power, [-1.0]])
    is_peak = (power >= edge[:-2]) & (power > edge[2:])
    is_peak &= power > _LEAST_POWER * power.max()
    peaks = np.flatnonzero(is_peak)
    peaks = peaks[np.argsort(-power[peaks], kind="stable")][:_MOST_OPTIMA]
    return np.angle(waves[peaks]) / fold, grid[peaks]


def _refine(
    phase: FloatArray,
    omega: FloatArray,
    time: FloatArray,
    phi: FloatArray,
    fold: int,
    sd: float,
    outliers: float,
) -> _Refined:
    """Lines refined from angles `phase` and spins `omega` (lines,), by weighed least squares of
    angles `phi` (frames,) [rad] at times [s], a step a sweep.
    """
    for wide in _WIDENING:
        residual = unwrap(phi - phase[:, None] - np.multiply.outer(omega, time), fold)
        least_sd = _FIRST_ANGLE_SD * (wide > 1.0) / fold
        weight, likelihood = weights(residual, fold, max(wide * sd, least_sd), outliers)
        total = weight.sum(axis=1)
        moment = weight @ time
        square = weight @ time**2
        ridge = _RIDGE * total * square + 1e-300
        determinant = np.maximum(total * square - moment**2, ridge)
        weighed = weight * residual
        up = weighed.sum(axis=1)
        turning = weighed @ time
        # Sums and likelihoods are those before the last step.
        last_phase = phase
        last_omega = omega
        phase = phase + (square * up - moment * turning) / determinant
        omega = omega + (total * turning - moment * up) / determinant
    logs = np.log(likelihood).sum(axis=1)
    return _Refined(last_phase, last_omega, total, moment, square, determinant, logs)


def _log_plausibility(
    impact: Impact,
    spins: tuple[float, float],
    turn: float,
    turn_sd: float,
    ball: Ball,
) -> float:
    """Log of how plausible a bounce with these spins [rad/s] is, at most zero: by the offset of the
    normal force, from the balance of angular momentum about the contact; by friction, which is
    against the slip; by tangential restitution; and by the turn [rad] between both flights.
    """
    omega_1, omega_2 = spins
    p = impact.p
    sds = np.sqrt(np.diagonal(impact.covariance))
    radius = ball.radius
    # Changes of velocity across and along the court.
    pressed = p[VY2] - p[VY1]
    lost = p[VX1] - p[VX2]
    time = p[T2] - p[T1]
    offset = (radius * lost - ball.inertia_ratio * radius**2 * (omega_2 - omega_1)) / pressed
    lost_sd = np.hypot(sds[VX1], sds[VX2])
    offset_sd = np.hypot(_OFFSET_SD, radius * lost_sd / pressed)
    log = -0.5 * ((offset - _OFFSET) / offset_sd) ** 2
    slip_1 = p[VX1] - radius * omega_1
    slip_2 = p[VX2] - radius * omega_2
    if abs(slip_1) > _LEAST_SLIP:
        e_x = -slip_2 / slip_1
        above = max(0.0, e_x - _E_X[1]) / _E_X_SD[1]
        below = max(0.0, _E_X[0] - e_x) / _E_X_SD[0]
        log -= 0.5 * above**2 + 0.5 * below**2
    push = -lost / pressed * np.sign(slip_1)
    log -= 0.5 * (max(0.0, push - _PUSH_SD) / _PUSH_SD) ** 2
    spin = omega_1 + _TURNED_SHARE * (omega_2 - omega_1)
    time_sd = np.hypot(sds[T1], sds[T2])
    sd = np.sqrt(_TURN_SD**2 + turn_sd**2 + (time_sd * spin) ** 2)
    off = (turn - time * spin) / sd
    return float(log - 0.5 * off**2 - np.log(sd / _TURN_SD))


def pairs_of(
    impact: Impact,
    assumed: FilmAssumptions,
    sd: float,
    outliers: float,
) -> list[SpinPair]:
    """Pairs of spins that the angles of an impact allow, with their probabilities, most probable
    first. `sd` [rad] is the noise of angles, `outliers` the share of theirs. What the probabilities
    lack to one is the probability that angles show no spin, or another one than was read.
    """
    fold = impact.track.fold
    spin_sd = assumed.spin_sd
    before, after = _lines_of_sides(impact, spin_sd, sd, outliers)
    candidates = _candidates(impact, assumed, before, after)
    if not candidates:
        return []
    logs = np.array([candidate.log for candidate in candidates])
    relative = np.exp(logs - logs.max())
    shares = relative / relative.sum()
    order = np.argsort(-shares, kind="stable").tolist()
    use_1, use_2 = impact.turning()
    readable_1 = _readable(before, use_1.sum(), fold, spin_sd)
    readable_2 = _readable(after, use_2.sum(), fold, spin_sd)
    best_fits = candidates[order[0]].fits
    chance = readable_1 * readable_2
    chance /= 1.0 + _MISREAD_PROBABILITY * np.exp(min(-best_fits, _MOST_LOG))
    pairs = []
    for k in order:
        if shares[k] > _LEAST_PROBABILITY:
            probability = float(chance * shares[k])
            pairs.append(candidates[k].pair._replace(probability=probability))
    return pairs


def log_evidence(
    impact: Impact,
    assumed: FilmAssumptions,
    sd: float,
    outliers: float,
) -> float:
    """Log likelihood of the angles of an impact over all spins that a bounce can have, or that they
    show none. Arguments are those of `pairs_of`.
    """
    fold = impact.track.fold
    before, after = _lines_of_sides(impact, assumed.spin_sd, sd, outliers)
    logs = [candidate.log for candidate in _candidates(impact, assumed, before, after)]
    spinning = np.logaddexp.reduce([-np.inf, *logs]) + 2.0 * _log_density(fold, assumed.spin_sd)
    angles = sum(int(use.sum()) for use in impact.turning())
    nothing = np.log(_UNREADABLE_PROBABILITY) + angles * np.log(fold / (2.0 * np.pi))
    return float(np.logaddexp(spinning, nothing))


def _lines_of_sides(
    impact: Impact,
    spin_sd: float,
    sd: float,
    outliers: float,
) -> tuple[list[Line], list[Line]]:
    """The lines through the angles of an impact, before and after the contact."""
    fold = impact.track.fold
    use_1, use_2 = impact.turning()
    t_1 = impact.t[use_1] - impact.p[T1]
    t_2 = impact.t[use_2] - impact.p[T2]
    before = lines_of_angles(t_1, impact.phi[use_1], fold, sd, outliers, spin_sd)
    after = lines_of_angles(t_2, impact.phi[use_2], fold, sd, outliers, spin_sd)
    return before, after


def _candidates(
    impact: Impact,
    assumed: FilmAssumptions,
    before: Sequence[Line],
    after: Sequence[Line],
) -> list[_Candidate]:
    """All pairs of lines `before` and `after` the contact of an impact, weighed."""
    time = float(impact.p[T2] - impact.p[T1])
    candidates = list[_Candidate]()
    for line_1, line_2 in product(before, after):
        for pair in _turns(line_1, line_2, time, impact.track.fold):
            fits = _log_plausibility(
                impact,
                (pair.omega_1, pair.omega_2),
                pair.turn,
                np.sqrt(pair.covariance[2, 2]),
                assumed.ball,
            )
            log_prior = 0.5 * (line_1.omega / assumed.spin_sd) ** 2
            log = line_1.evidence + line_2.evidence - log_prior + fits
            candidates.append(_Candidate(log, fits, pair))
    return candidates


def _turns(line_1: Line, line_2: Line, time: float, fold: int) -> Iterator[SpinPair]:
    """Pairs of the spins of two lines, with each of the three turns nearest to that of the ball in
    the `time` [s] between the flights; probabilities are zero yet.
    """
    c_1 = line_1.covariance
    c_2 = line_2.covariance
    turn_variance = c_1[0, 0] + c_2[0, 0]
    covariance = np.diag([c_1[1, 1], c_2[1, 1], turn_variance])
    covariance[0, 2] = covariance[2, 0] = -c_1[0, 1]
    covariance[1, 2] = covariance[2, 1] = c_2[0, 1]
    between = time * (line_1.omega + _TURNED_SHARE * (line_2.omega - line_1.omega))
    off = np.array(line_2.phi - line_1.phi - between)
    nearest = between + float(unwrap(off, fold))
    phases = (line_1.phi, line_2.phi)
    for turn in nearest + 2.0 * np.pi / fold * np.arange(-1, 2):
        yield SpinPair(line_1.omega, line_2.omega, float(turn), covariance, 0.0, phases)


def _readable(lines: list[Line], frames: int, fold: int, spin_sd: float) -> float:
    """Probability that the angles of a flight show its spin at all, by its `lines`: few angles, or
    many outliers, fit any line.
    """
    logs = np.array([line.evidence for line in lines])
    best = logs.max()
    density = _log_density(fold, spin_sd)
    spinning = float(np.log(np.exp(logs - best).sum()) + best + density)
    nothing = frames * float(np.log(fold / (2.0 * np.pi)))
    odds = _UNREADABLE_PROBABILITY / (1.0 - _UNREADABLE_PROBABILITY)
    return float(1.0 / (1.0 + odds * np.exp(min(nothing - spinning, _MOST_LOG))))


def _log_density(fold: int, spin_sd: float) -> float:
    """Log prior density of a phase within a period, and of a spin up to the largest of either sign,
    as it belongs to the evidence of a line.
    """
    return float(np.log(fold / (2.0 * _SPIN_SDS * spin_sd)))
