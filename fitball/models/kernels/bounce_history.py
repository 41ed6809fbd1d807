"""The courses of one bounce of any two-mass composition at given times, as kernels.

The bounce is solved once; its pieces are then retraced (see `replay`) up to each time, so that a course consists of
the closed forms of the rebound and of nothing else.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.bounce import TORSION_RIGID, bounce, joint, landing_and_offset, vertical_motion
from fitball.models.kernels.bounce_jacobian import make_replay_scratch
from fitball.models.kernels.compiled import compiled, compiled_allocating
from fitball.models.kernels.events import POLES, TORSION
from fitball.models.kernels.landing import friction_impulse, landed
from fitball.models.kernels.oscillator import damped_pair
from fitball.models.kernels.phases import FREE, GRIP, HOLD, SLIDE_FORWARD, slide_phase
from fitball.models.kernels.replay import retrace
from fitball.models.kernels.twist import set_torsion
from fitball.models.kernels.two_mass import (
    EVENT,
    FORCE_ENDED,
    MAX_PHASES,
    PIECE_ENDING,
    PIECE_PHASE,
    PIECE_SIZE,
    PIECE_TIME,
    UNFINISHED,
    make_scratch,
)
from fitball.values import FloatArray

# Rows of the courses.
Y, V_Y, V_X, OMEGA_CORE, OMEGA_SHELL, TWIST, SLIP, NORMAL, FRICTION, COURSES = range(10)
# What the kernel tells of the contact as a whole.
RIDING, LANDING, OMEGA2, SIGMA, W2, T_FORCE, T_CONTACT, LANDED_V_X, LANDED_OMEGA, FACTS = range(10)
# Halvings that bring a bracket of the size of the contact to the rounding of its ends.
BISECTIONS = 60
# An impulse that stops no slip that a float can hold [N s].
FIRST_IMPULSE = 1e-300


@compiled
def vertical_at(sigma: float, omega2: float, w2: float, v_y: float, t: float) -> tuple[float, float]:
    """Compression and its rate `t` seconds after landing at `v_y` (Jafri 2004, Eqs 2 and 4)."""
    r, s, _envelope = damped_pair(sigma, w2, omega2, math.sqrt(abs(w2)), t)
    return v_y * s, v_y * (r - sigma * s)


@compiled
def _rigid_phase(
    slip: float, impulse: float, direction: float, mu: float, drive: float, need: float, compliance: float
) -> tuple[int, float, float]:
    friction, slipped, held, onward = friction_impulse(slip, impulse, mu, drive, need, compliance)
    acting = impulse - slipped - held
    if abs(onward) > 0.5:
        return slide_phase(onward), friction, acting
    if slipped >= impulse and abs(slip) > 0.0:
        return slide_phase(direction), friction, acting
    return (HOLD if held > 0.0 else GRIP), friction, acting


@compiled
def rigid_phase(
    slip: float, impulse: float, mu: float, drive: float, need: float, compliance: float
) -> tuple[int, float, float]:
    """`(phase, friction, acting)` once the normal impulse has grown to `impulse`, core and shell turning as one.

    `friction` [N s] retards the ball; `acting` is the share of the impulse during which the offset of a grip acted.
    """
    direction = 1.0 if slip > 0.0 else -1.0
    if not mu > 0.0:
        return slide_phase(direction), 0.0, 0.0
    if not impulse > 0.0:
        # Nothing has happened yet; what is about to shows with the first impulse.
        phase, _friction, _acting = _rigid_phase(slip, FIRST_IMPULSE, direction, mu, drive, need, compliance)
        return phase, 0.0, 0.0
    return _rigid_phase(slip, impulse, direction, mu, drive, need, compliance)


@compiled
def rigid_phase_at(
    t: float, facts: FloatArray, v_y: float, slip: float, mu: float, drive: float, need: float, compliance: float
) -> int:
    """The phase of a rigid contact at time `t`."""
    _y, y_rate = vertical_at(facts[SIGMA], facts[OMEGA2], facts[W2], v_y, t)
    impulse = facts[LANDING] + facts[RIDING] * (v_y - y_rate)
    return rigid_phase(slip, impulse, mu, drive, need, compliance)[0]


@compiled
def rigid_courses(
    row: FloatArray,
    eps_in_slide: bool,
    eps: float,
    facts: FloatArray,
    v_x: float,
    v_y: float,
    omega: float,
    times: FloatArray,
    courses: FloatArray,
    phases: NDArray[np.int64],
    record: FloatArray,
) -> int:
    """Courses along the court of a ball whose core and shell turn as one; returns the number of pieces.

    Friction follows the impulse that the normal force has given so far (see `rigid`), and so does the end of slip.
    """
    mu, mass, radius, inertia = row[3], row[10], row[11], row[12]
    riding, landing, omega2, sigma, w2 = facts[RIDING], facts[LANDING], facts[OMEGA2], facts[SIGMA], facts[W2]
    t_force = facts[T_FORCE]
    compliance = 1.0 / mass + radius * radius / inertia
    need = radius * eps / (inertia * compliance)
    drive = need if eps_in_slide else 0.0
    slip = v_x - radius * omega
    for k in range(-1, times.shape[0]):
        # The first round, before the times, is the state that landing leaves.
        t = 0.0 if k < 0 else min(times[k], t_force)
        _y, y_rate = vertical_at(sigma, omega2, w2, v_y, t)
        impulse = landing + riding * (v_y - y_rate)
        phase, friction, acting = rigid_phase(slip, impulse, mu, drive, need, compliance)
        turned = omega + (radius * friction - eps * (impulse if eps_in_slide else acting)) / inertia
        if k < 0:
            facts[LANDED_V_X], facts[LANDED_OMEGA] = v_x - friction / mass, turned
            continue
        courses[V_X, k] = v_x - friction / mass
        courses[OMEGA_CORE, k], courses[OMEGA_SHELL, k], courses[TWIST, k] = turned, turned, 0.0
        if times[k] > t_force:
            phase = FREE
        phases[k] = phase
        resting = phase in (GRIP, HOLD)
        courses[SLIP, k] = 0.0 if resting else courses[V_X, k] - radius * turned
        share = 0.0
        if phase == GRIP:
            share = -need
        elif not resting and phase != FREE:
            share = -mu if phase == SLIDE_FORWARD else mu
        courses[FRICTION, k] = share * courses[NORMAL, k]
    return rigid_pieces(facts, v_y, slip, mu, drive, need, compliance, record)


@compiled
def rigid_pieces(
    facts: FloatArray,
    v_y: float,
    slip: float,
    mu: float,
    drive: float,
    need: float,
    compliance: float,
    record: FloatArray,
) -> int:
    """Write the phases of a rigid contact as pieces into `record`; returns their number, one or two."""
    t_force = facts[T_FORCE]
    first = rigid_phase_at(0.0, facts, v_y, slip, mu, drive, need, compliance)
    last = rigid_phase_at(t_force, facts, v_y, slip, mu, drive, need, compliance)
    left, right = 0.0, t_force
    if last != first:
        for _ in range(BISECTIONS):
            t = 0.5 * (left + right)
            if rigid_phase_at(t, facts, v_y, slip, mu, drive, need, compliance) == first:
                left = t
            else:
                right = t
    record[0, PIECE_PHASE], record[0, PIECE_TIME] = first, right
    record[0, PIECE_ENDING] = FORCE_ENDED if last == first else EVENT
    if last == first:
        return 1
    record[1, PIECE_PHASE], record[1, PIECE_TIME], record[1, PIECE_ENDING] = last, t_force - right, FORCE_ENDED
    return 2


@compiled_allocating
def sprung_courses(
    row: FloatArray,
    codes: NDArray[np.int64],
    eps: float,
    facts: FloatArray,
    v_x: float,
    v_y: float,
    omega: float,
    times: FloatArray,
    courses: FloatArray,
    phases: NDArray[np.int64],
    record: FloatArray,
    pieces: int,
) -> None:
    """Courses along the court of core and shell on their torsional joint; `record` holds the contact's pieces."""
    mu, mass, radius = row[3], row[10], row[11]
    riding, t_force = facts[RIDING], facts[T_FORCE]
    _status, core, shell, damping, w2_slide = joint(row, codes, facts[W2])
    inertia = core + shell
    relative = 1.0 / core + 1.0 / shell
    lever = mass * radius / (shell + mass * radius * radius)
    again = make_replay_scratch()
    poles = np.zeros(POLES)
    set_torsion(poles, row[2], damping, relative, w2_slide)
    facts[LANDED_V_X], facts[LANDED_OMEGA], _stuck = landed(
        mass, radius, shell, mu, eps, codes[2] == 1, facts[LANDING], v_x, omega
    )
    shortened = record[:pieces].copy()
    for k in range(times.shape[0]):
        # The piece a time belongs to: the last that starts at or before it and takes any time.
        piece, start, begun = 0, 0.0, 0.0
        for j in range(pieces):
            if start <= min(times[k], t_force) and (record[j, PIECE_TIME] > 0.0 or j == 0):
                piece, begun = j, start
            start += record[j, PIECE_TIME]
        shortened[piece, PIECE_TIME] = min(times[k], t_force) - begun
        shortened[piece, PIECE_ENDING] = UNFINISHED
        found = retrace(
            complex(mass, 0.0), complex(radius, 0.0), complex(core, 0.0), complex(shell, 0.0), complex(row[2], 0.0),
            complex(damping, 0.0), complex(w2_slide, 0.0), complex(mu, 0.0), complex(eps, 0.0), codes[2] == 1, True,
            complex(riding, 0.0), complex(facts[LANDING], 0.0), complex(facts[OMEGA2], 0.0),
            complex(facts[SIGMA], 0.0), complex(facts[W2], 0.0), complex(t_force, 0.0),
            complex(v_x, 0.0), complex(v_y, 0.0), complex(omega, 0.0), shortened, piece + 1, again,
        )  # fmt: skip
        shortened[piece, PIECE_TIME], shortened[piece, PIECE_ENDING] = (
            record[piece, PIECE_TIME],
            record[piece, PIECE_ENDING],
        )
        travel, spin_sum, th, rate = found[0].real, found[1].real, found[2].real, found[3].real
        phase = int(record[piece, PIECE_PHASE])
        normal = courses[NORMAL, k]
        friction = 0.0
        if times[k] > t_force:
            phase = FREE
            p, q, _e = damped_pair(
                poles[TORSION], poles[TORSION + 1], poles[TORSION + 2], poles[TORSION + 3], times[k] - t_force
            )
            swing = rate + poles[TORSION] * th
            th, rate = th * p + swing * q, rate * p - (poles[TORSION + 1] * th + poles[TORSION] * swing) * q
        elif phase in (GRIP, HOLD):
            friction = lever * (row[2] * th + damping * rate - (eps if phase == GRIP else 0.0) * normal)
        else:
            friction = -mu * normal if phase == SLIDE_FORWARD else mu * normal
        turned = (spin_sum - core * rate) / inertia
        resting = phase in (GRIP, HOLD)
        phases[k] = phase
        courses[V_X, k], courses[OMEGA_CORE, k], courses[OMEGA_SHELL, k] = travel, turned + rate, turned
        courses[TWIST, k], courses[FRICTION, k] = th, friction
        courses[SLIP, k] = 0.0 if resting else travel - radius * turned


@compiled
def vertical_courses(
    row: FloatArray,
    codes: NDArray[np.int64],
    v_y: float,
    cor: float,
    times: FloatArray,
    courses: FloatArray,
    facts: FloatArray,
) -> float:
    """Courses of the vertical motion, and `facts` (FACTS,) but for the landed state; returns the offset [m]."""
    _status, _cor, riding, omega2, sigma, w2, t_force, t_contact = vertical_motion(row, codes, v_y, cor)
    landing, eps = landing_and_offset(row, codes, v_y)
    facts[RIDING], facts[LANDING], facts[OMEGA2], facts[SIGMA], facts[W2] = riding, landing, omega2, sigma, w2
    facts[T_FORCE], facts[T_CONTACT] = t_force, t_contact
    for k in range(times.shape[0]):
        y, y_rate = vertical_at(sigma, omega2, w2, v_y, times[k])
        courses[Y, k], courses[V_Y, k] = y, y_rate
        # The ground cannot pull: once the force has turned tensile there is none. Where it ends, rounding may have
        # either sign.
        courses[NORMAL, k] = 0.0 if times[k] > t_force else max(riding * (2.0 * sigma * y_rate + omega2 * y), 0.0)
    return eps


def bounce_history(
    row: FloatArray, codes: NDArray[np.int64], v_x: float, v_y: float, omega: float, cor: float, times: FloatArray
) -> tuple[FloatArray, NDArray[np.int64], FloatArray, FloatArray]:
    """Courses (COURSES, times), phases (times,), facts (FACTS,), and the pieces of a contact that has a solution.

    `times` [s] lie within the contact. Phase 0 means that the motion along the court is not followed. The kernels are
    called one by one: in one they would be compiled all over again.
    """
    courses, facts = np.zeros((COURSES, times.shape[0])), np.zeros(FACTS)
    phases, record = np.zeros(times.shape[0], dtype=np.int64), np.zeros((MAX_PHASES, PIECE_SIZE))
    eps = vertical_courses(row, codes, v_y, cor, times, courses, facts)
    if codes[7] == 0:
        courses[[V_X, OMEGA_CORE, OMEGA_SHELL]] = [[v_x], [omega], [omega]]
        courses[SLIP] = v_x - row[11] * omega
        facts[[LANDED_V_X, LANDED_OMEGA]] = v_x, omega
        return courses, phases, facts, record[:0]
    if codes[5] == TORSION_RIGID:
        pieces = rigid_courses(row, bool(codes[2]), eps, facts, v_x, v_y, omega, times, courses, phases, record)
    else:
        *_rebound, pieces = bounce(row, codes, v_x, v_y, omega, cor, make_scratch(), record)
        sprung_courses(row, codes, eps, facts, v_x, v_y, omega, times, courses, phases, record, pieces)
    return courses, phases, facts, record[:pieces]
