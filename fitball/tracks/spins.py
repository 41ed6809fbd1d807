"""Spins from marks on the ball: angles known modulo a turn over the fold of the mark.

Equally spaced frames determine a spin modulo `2 pi f/m` (f frames/s, fold m). Each side has candidates: optima of
the periodogram, refined by a robust line, of which all are kept whose log likelihood is within `WITHIN` of the best.
Pairs of candidates of both sides are weighed by what a bounce can do (`plausible`). Nothing is chosen here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitball.tracks.frames import SpinPair
from fitball.tracks.kernels import compiled
from fitball.values import Ball, FloatArray

# Largest spin [rad/s] that is looked for, and how far below the best a candidate's log likelihood may be.
LARGEST, WITHIN = 900.0, 10.0
# Most optima of a periodogram that are refined, the lowest over the highest, and least probability of a pair that is
# kept.
MOST, LOW, LEAST = 24, 0.4, 1e-6
# Probability, before there are data, that the angles of a side say nothing.
UNREADABLE = 0.01
# A pair of spins above this probability is sure.
SURE = 0.999
# What bounces of balls on courts have: offset of the normal force [m], tangential restitution, friction along the
# slip, and the turn over the contact, at a spin that is `TURNED` of the way from the first to the second.
OFFSET, OFFSET_SD = 1.5e-3, 3e-3
RESTITUTION, RESTITUTION_SD = (-1.0, 0.5), (0.1, 0.15)
PUSH, PUSH_SD = 0.05, 0.05
TURNED, TURN_SD = 0.6, 0.25
# Slip [m/s] below which its sign and its restitution are unknown.
ROLLING = 0.3


@dataclass(frozen=True)
class Candidate:
    """A line `phi + omega d` through the angles of one side, with its covariance (2, 2) and log likelihood;
    `unreadable` is that of angles which say nothing of the spin.
    """

    phi: float
    omega: float
    covariance: FloatArray
    log_likelihood: float
    unreadable: float = -np.inf

    @property
    def log_evidence(self) -> float:
        """Log likelihood, integrated over the line, but for a constant."""
        return self.log_likelihood + 0.5 * float(np.linalg.slogdet(self.covariance)[1])


@dataclass(frozen=True)
class Bounce:
    """What the positions say of an impact: velocities as in the tables [m/s] and the time over contact [s], with the
    sds of the offset of the normal force [m] and of the time that follow from their errors.
    """

    v_x1: float
    v_y1: float
    v_x2: float
    v_y2: float
    time: float
    velocity_sd: float
    time_sd: float


@compiled
def _periodogram(d: FloatArray, phi: FloatArray, known: FloatArray, real: FloatArray, imaginary: FloatArray) -> None:
    """Sums of `exp(i m (phi - omega d))` at equally spaced spins; `known` has fold, first spin and step."""
    fold, low, step = known[0], known[1], known[2]
    for f in range(d.size):
        angle, turn = fold * (phi[f] - low * d[f]), -fold * step * d[f]
        a, b = np.cos(angle), np.sin(angle)
        c, s = np.cos(turn), np.sin(turn)
        for i in range(real.size):
            real[i] += a
            imaginary[i] += b
            a, b = a * c - b * s, a * s + b * c


@compiled
def _line(d: FloatArray, phi: FloatArray, known: FloatArray, out: FloatArray) -> None:
    """Robust line from `out[:2]`, phase and spin; `known` has fold, sd and share of outliers. Then `out` has phase,
    spin, log likelihood and the information of both (EM weights).
    """
    fold, sigma, share = known[0], known[1], known[2]
    turn = 2.0 * np.pi / fold
    for sweep in range(14):
        scale = sigma * (4.0 if sweep < 2 else 2.0 if sweep < 4 else 1.0)
        p_p = p_w = w_w = up = uw = like = 0.0
        for f in range(d.size):
            r = phi[f] - out[0] - out[1] * d[f]
            r -= turn * np.round(r / turn)
            q = (1.0 - share) * np.exp(-0.5 * (r / scale) ** 2) / (scale * np.sqrt(2.0 * np.pi))
            whole = q + share / turn
            g = q / whole / sigma**2
            like += np.log(whole)
            p_p += g
            p_w += g * d[f]
            w_w += g * d[f] * d[f]
            up += g * r
            uw += g * r * d[f]
        out[2], out[3], out[4], out[5] = like, p_p, p_w, w_w
        det = p_p * w_w - p_w * p_w
        if not det > 1e-9 * p_p * w_w or sweep == 13:
            return
        out[0] += (w_w * up - p_w * uw) / det
        out[1] += (p_p * uw - p_w * up) / det


def candidates(d: FloatArray, phi: FloatArray, fold: int, sigma: float, share: float) -> list[Candidate]:
    """Lines through angles `phi` [rad] at times `d` [s] from the contact, best first; none for fewer than three.

    `sigma` [rad] is the sd of an angle, `share` that of outliers.
    """
    if d.size < 3:
        return []
    span = max(float(np.ptp(d)), 1e-6)
    step = 0.5 / (fold * span)
    count = int(2.0 * LARGEST / step) + 2
    real, imaginary = np.zeros(count), np.zeros(count)
    middle = float(np.mean(d))
    _periodogram(d - middle, phi, np.array([float(fold), -LARGEST, step]), real, imaginary)
    power = np.hypot(real, imaginary)
    edge = np.concatenate([[-1.0], power, [-1.0]])
    peaks = np.flatnonzero((power >= edge[:-2]) & (power > edge[2:]))
    peaks = peaks[power[peaks] > LOW * power.max()]
    peaks = peaks[np.argsort(-power[peaks], kind="stable")][:MOST]
    starts = [
        (float(np.arctan2(imaginary[peak], real[peak]) / fold), float(-LARGEST + peak * step)) for peak in peaks
    ]
    # What one optimum is refined to, its aliases have to be as well.
    alias = 2.0 * np.pi / (fold * float(np.median(np.diff(np.sort(d)))))
    found: list[Candidate] = []
    while starts:
        phase, spin = starts.pop(0)
        if any(abs(spin - one.omega) < 0.02 * step for one in found):
            continue
        out = np.array([phase, spin, 0.0, 0.0, 0.0, 0.0])
        _line(d - middle, phi, np.array([float(fold), sigma, share]), out)
        information = np.array([[out[3], out[4]], [out[4], out[5]]])
        if not np.linalg.det(information) > 1e-9 * out[3] * out[5] or abs(out[1]) > 1.02 * LARGEST:
            continue
        if any(abs(out[1] - one.omega) < 0.2 * step for one in found):
            continue
        # From the mean time to the contact.
        shift = np.array([[1.0, -middle], [0.0, 1.0]])
        covariance = shift @ np.linalg.inv(information) @ shift.T
        unreadable = d.size * float(np.log(fold / (2.0 * np.pi)))
        found.append(Candidate(float(out[0] - out[1] * middle), float(out[1]), covariance, float(out[2]), unreadable))
        if out[2] > max(one.log_likelihood for one in found) - WITHIN:
            turns = range(int(np.ceil((-LARGEST - out[1]) / alias)), int(np.floor((LARGEST - out[1]) / alias)) + 1)
            first = float(d[0] - middle)
            starts += [(float(out[0] - n * alias * first), float(out[1] + n * alias)) for n in turns if n]
    found.sort(key=lambda one: -one.log_likelihood)
    return [one for one in found if one.log_likelihood > found[0].log_likelihood - WITHIN]


def plausible(bounce: Bounce, omega_1: float, omega_2: float, turn: float, turn_sd: float, ball: Ball) -> float:
    """Log weight of what a bounce with these spins would be, apart from the spread of incident spins.

    The offset of the normal force follows from the balance of angular momentum about the contact, friction opposes
    the slip, the tangential restitution is within its range, and the turn is that of spins between both.
    """
    radius, inertia = ball.radius, ball.inertia_ratio * ball.radius**2
    pressed = bounce.v_y1 + bounce.v_y2
    lost = bounce.v_x1 - bounce.v_x2
    offset = (radius * lost - inertia * (omega_2 - omega_1)) / pressed
    offset_sd = np.hypot(OFFSET_SD, radius * bounce.velocity_sd / pressed)
    log = -0.5 * ((offset - OFFSET) / offset_sd) ** 2 - np.log(offset_sd)
    slip_1, slip_2 = bounce.v_x1 - radius * omega_1, bounce.v_x2 - radius * omega_2
    if abs(slip_1) > ROLLING:
        lowest, highest = RESTITUTION
        restitution = -slip_2 / slip_1
        log -= 0.5 * (max(0.0, restitution - highest) / RESTITUTION_SD[1]) ** 2
        log -= 0.5 * (max(0.0, lowest - restitution) / RESTITUTION_SD[0]) ** 2
    push = -lost / pressed * np.sign(slip_1)
    log -= 0.5 * (max(0.0, push - PUSH) / PUSH_SD) ** 2
    between = bounce.time * (omega_1 + TURNED * (omega_2 - omega_1))
    between_sd = np.sqrt(TURN_SD**2 + turn_sd**2 + (bounce.time_sd * (omega_1 + TURNED * (omega_2 - omega_1))) ** 2)
    return float(log - 0.5 * ((turn - between) / between_sd) ** 2 - np.log(between_sd))


def _readable(side: list[Candidate], fold: int) -> float:
    """Probability that the angles of a side show its spin at all: few of them, or many outliers, fit any line."""
    logs = np.array([one.log_evidence for one in side])
    # Of a phase over a turn of the mark and a spin up to the largest of either sign.
    lines = np.log(np.sum(np.exp(logs - logs.max()))) + logs.max() + np.log(fold / (2.0 * LARGEST))
    return float(1.0 / (1.0 + UNREADABLE / (1.0 - UNREADABLE) * np.exp(min(side[0].unreadable - lines, 50.0))))


def pairs_of(
    before: list[Candidate], after: list[Candidate], bounce: Bounce, fold: int, ball: Ball, spin_sd: float
) -> tuple[SpinPair, ...]:
    """Pairs of candidates with their probabilities, most probable first. What these lack to one is the probability
    that the angles of a side say nothing.

    Candidates weigh by their likelihood, integrated over the line, and by `spin_sd` [rad/s] of incident spins.
    """
    whole = 2.0 * np.pi / fold
    made, logs = [], []
    for one in before:
        for two in after:
            between = bounce.time * (one.omega + TURNED * (two.omega - one.omega))
            raw = two.phi - one.phi
            nearest = raw - whole * np.round((raw - between) / whole)
            covariance = np.array(
                [
                    [one.covariance[1, 1], 0.0, -one.covariance[0, 1]],
                    [0.0, two.covariance[1, 1], two.covariance[0, 1]],
                    [-one.covariance[0, 1], two.covariance[0, 1], one.covariance[0, 0] + two.covariance[0, 0]],
                ]
            )
            marks = one.log_evidence + two.log_evidence
            for more in (-1, 0, 1):
                turn = nearest + more * whole
                log = plausible(bounce, one.omega, two.omega, turn, float(np.sqrt(covariance[2, 2])), ball)
                log += marks - 0.5 * (one.omega / spin_sd) ** 2
                made.append((one, two, turn, covariance))
                logs.append(log)
    if not made:
        return ()
    probabilities = np.exp(np.array(logs) - max(logs))
    probabilities *= _readable(before, fold) * _readable(after, fold) / probabilities.sum()
    order = [i for i in np.argsort(-probabilities, kind="stable") if probabilities[i] >= LEAST]
    return tuple(
        SpinPair(one.omega, two.omega, float(turn), float(probabilities[i]), covariance, one.phi)
        for i in order
        for one, two, turn, covariance in (made[i],)
    )
