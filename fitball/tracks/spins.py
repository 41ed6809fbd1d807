"""Spins that marks allow, pairs weighed by what a bounce can do.

Frames at equal times determine a spin modulo 2 pi f/m (f frames/s, fold m). Each side has
candidates, lines through the angles at optima of the periodogram; of pairs of them one is taken
only where it is sure.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from fitball.base.values import Ball, FloatArray
from fitball.tracks.flight import T1, T2, VX1, VX2, VY1, VY2, Impact
from fitball.tracks.types import Filming, SpinPair, unwrapped

# Probability among pairs from which one is kept; before any data that angles say nothing, and that
# they are on lines, but not of the ball's spin as read: of something else, or the other way.
_LEAST = 1e-6
_UNREADABLE = 0.01
_OTHER = 1e-6
# Spins are looked for to so many sds of incident spins.
_REACH = 4.0
# Most optima that are refined, how high they must be; log likelihood below the best to which lines
# are candidates.
_MOST = 40
_LOW = 0.4
_WITHIN = 10.0
# Widening of the sd in the first sweeps of a line, of which there are so many, and least sd then:
# as far as angles [rad] of the whole turn are off by the steps of the periodogram.
_APART = 0.13
_WIDE = (4.0, 4.0, 2.0, 2.0, *[1.0] * 10)
# What bounces on courts have: offset of the normal force [m]; tangential restitution from, to, and
# the sds beyond; friction along the slip and its sd; the turn [rad] at a spin so much of the way
# from the first to the second.
_OFFSET = 1.5e-3
_OFFSET_SD = 3e-3
_E_X = (-1.0, 0.5)
_E_X_SD = (0.1, 0.15)
_PUSH = 0.05
_TURNED = 0.6
_TURN_SD = 0.25
# Slip [m/s] below which its sign and its restitution are unknown.
_ROLLING = 0.3


class Line(NamedTuple):
    """Angle at time zero and spin, their covariance (2, 2), log likelihood, and that integrated
    over the line.
    """

    phi: float
    omega: float
    covariance: FloatArray
    log: float
    evidence: float


def weights(
    residual: FloatArray,
    fold: int,
    sd: float,
    outliers: float,
) -> tuple[FloatArray, FloatArray]:
    """Probability of each residual of an angle of being no outlier, and its likelihood."""
    like = (1.0 - outliers) * np.exp(-0.5 * (residual / sd) ** 2) / (sd * np.sqrt(2.0 * np.pi))
    whole = like + outliers * fold / (2.0 * np.pi)
    return like / whole, whole


def lines(
    d: FloatArray,
    phi: FloatArray,
    fold: int,
    sd: float,
    outliers: float,
    spin_sd: float,
) -> list[Line]:
    """Lines through angles (frames,) at times `d` from the contact, best first; none of fewer than
    three frames.
    """
    if d.size < 3:
        return []
    middle = float(d.mean())
    most = _REACH * spin_sd
    e = d - middle
    step = 0.5 / (fold * max(float(np.ptp(d)), 1e-6))
    grid = np.arange(-most, most + step, step)
    waves = np.exp(1j * fold * (phi - np.multiply.outer(grid, e))).sum(axis=1)
    power = np.abs(waves)
    edge = np.concatenate([[-1.0], power, [-1.0]])
    peaks = np.flatnonzero((power >= edge[:-2]) & (power > edge[2:]) & (power > _LOW * power.max()))
    peaks = peaks[np.argsort(-power[peaks], kind="stable")][:_MOST]
    phase = np.angle(waves[peaks]) / fold
    omega = grid[peaks]
    for wide in _WIDE:
        r = unwrapped(phi - phase[:, None] - np.multiply.outer(omega, e), fold)
        g, whole = weights(r, fold, max(wide * sd, _APART * (wide > 1.0) / fold), outliers)
        one = g.sum(axis=1)
        slope = g @ e
        square = g @ e**2
        determinant = np.maximum(one * square - slope**2, 1e-9 * one * square + 1e-300)
        up = (g * r).sum(axis=1)
        turning = (g * r) @ e
        last = phase, omega
        phase = phase + (square * up - slope * turning) / determinant
        omega = omega + (one * turning - slope * up) / determinant
    phase, omega = last
    logs = np.log(whole).sum(axis=1)
    shift = np.array([[1.0, -middle], [0.0, 1.0]])
    found = list[Line]()
    for k in np.argsort(-logs, kind="stable").tolist():
        near = any(abs(omega[k] - other.omega) < 0.2 * step for other in found)
        # Angles of one frame show no spin.
        flat = not one[k] * square[k] - slope[k] ** 2 > 1e-9 * one[k] * square[k]
        if near or flat or abs(omega[k]) > 1.02 * most or logs[k] < logs.max() - _WITHIN:
            continue
        inverse = sd**2 / determinant[k] * np.array([[square[k], -slope[k]], [-slope[k], one[k]]])
        # From the mean time to the contact.
        covariance = shift @ inverse @ shift.T
        evidence = float(logs[k] + 0.5 * np.linalg.slogdet(covariance)[1])
        found.append(
            Line(
                float(phase[k] - omega[k] * middle),
                float(omega[k]),
                covariance,
                float(logs[k]),
                evidence,
            )
        )
    return found


def _plausible(
    seen: Impact,
    one: float,
    two: float,
    turn: float,
    turn_sd: float,
    ball: Ball,
) -> float:
    """Log weight, at most zero, of what a bounce with these spins would be: the offset of the
    normal force by the balance of angular momentum about the contact, friction against the slip,
    tangential restitution, and a turn between both spins.
    """
    p = seen.p
    sds = np.sqrt(np.diagonal(seen.covariance))
    radius = ball.radius
    pressed = p[VY2] - p[VY1]
    lost = p[VX1] - p[VX2]
    time = p[T2] - p[T1]
    offset = (radius * lost - ball.inertia_ratio * radius**2 * (two - one)) / pressed
    offset_sd = np.hypot(_OFFSET_SD, radius * np.hypot(*sds[[VX1, VX2]]) / pressed)
    log = -0.5 * ((offset - _OFFSET) / offset_sd) ** 2
    slip_1 = p[VX1] - radius * one
    slip_2 = p[VX2] - radius * two
    if abs(slip_1) > _ROLLING:
        e_x = -slip_2 / slip_1
        log -= (
            0.5 * (max(0.0, e_x - _E_X[1]) / _E_X_SD[1]) ** 2
            + 0.5 * (max(0.0, _E_X[0] - e_x) / _E_X_SD[0]) ** 2
        )
    log -= 0.5 * (max(0.0, -lost / pressed * np.sign(slip_1) - _PUSH) / _PUSH) ** 2
    spin = one + _TURNED * (two - one)
    sd = np.sqrt(_TURN_SD**2 + turn_sd**2 + (np.hypot(*sds[[T1, T2]]) * spin) ** 2)
    return float(log - 0.5 * ((turn - time * spin) / sd) ** 2 - np.log(sd / _TURN_SD))


def pairs_of(seen: Impact, known: Filming, sd: float, outliers: float) -> list[SpinPair]:
    """Pairs of lines through the angles of an impact with their probabilities, most probable first.
    What these lack to one is the probability that angles say nothing, or not what was read.
    """
    p = seen.p
    fold = seen.track.fold
    spin_sd = known.spin_sd
    uses = seen.turning()
    before, after = (
        lines(seen.t[use] - p[time], seen.phi[use], fold, sd, outliers, spin_sd)
        for use, time in zip(uses, (T1, T2), strict=True)
    )
    made: list[tuple[float, float, SpinPair]] = []
    for one, two in product(before, after):
        c_1 = one.covariance
        c_2 = two.covariance
        covariance = np.diag([c_1[1, 1], c_2[1, 1], c_1[0, 0] + c_2[0, 0]])
        covariance[0, 2] = covariance[2, 0] = -c_1[0, 1]
        covariance[1, 2] = covariance[2, 1] = c_2[0, 1]
        between = (p[T2] - p[T1]) * (one.omega + _TURNED * (two.omega - one.omega))
        nearest = between + float(unwrapped(np.array(two.phi - one.phi - between), fold))
        for turn in nearest + 2.0 * np.pi / fold * np.arange(-1, 2):
            fits = _plausible(
                seen,
                one.omega,
                two.omega,
                turn,
                np.sqrt(covariance[2, 2]),
                known.ball,
            )
            log = one.evidence + two.evidence - 0.5 * (one.omega / spin_sd) ** 2 + fits
            pair = SpinPair(one.omega, two.omega, float(turn), covariance, 0.0, (one.phi, two.phi))
            made.append((log, fits, pair))
    if not made:
        return []
    logs = np.array([log for log, _, _ in made])
    shares = np.exp(logs - logs.max()) / np.exp(logs - logs.max()).sum()
    order = [k for k in np.argsort(-shares, kind="stable").tolist() if shares[k] > _LEAST]
    chance = _readable(before, uses[0].sum(), fold, spin_sd) * _readable(
        after,
        uses[1].sum(),
        fold,
        spin_sd,
    )
    chance /= 1.0 + _OTHER * np.exp(min(-made[order[0]][1], 50.0))
    return [made[k][2]._replace(probability=float(chance * shares[k])) for k in order]


def _readable(side: list[Line], frames: int, fold: int, spin_sd: float) -> float:
    """Probability that the angles of a side show its spin at all: few of them, or many outliers,
    fit any line.
    """
    logs = np.array([one.evidence for one in side])
    # Of a phase over a turn of the mark and a spin up to the largest of either sign.
    found = float(
        np.log(np.exp(logs - logs.max()).sum())
        + logs.max()
        + np.log(fold / (2.0 * _REACH * spin_sd))
    )
    nothing = frames * float(np.log(fold / (2.0 * np.pi)))
    return float(
        1.0 / (1.0 + _UNREADABLE / (1.0 - _UNREADABLE) * np.exp(min(nothing - found, 50.0)))
    )
