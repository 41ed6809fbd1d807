"""The courses of one bounce of any two-mass composition at given times, as kernels.

The bounce is solved once; its pieces are then followed again (see `replay`) up to each time, so that a course
consists of the closed forms of the rebound and of nothing else: `y = v S(t)` and its rate (Jafri 2004, Eqs 2 and 4),
the twist and what follows from it (`twist`, `two_mass`), or the impulse law of a ball that turns as one (`landing`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import compiled, compiled_allocating, inlined
from fitball.models.kernels.contact import Contact, contact_of, impulsive_friction, landed
from fitball.models.kernels.derivative import ReplayScratch, replay_derivative
from fitball.models.kernels.equations import coupling_of, free_twist
from fitball.models.kernels.oscillator import Oscillator, swing_at
from fitball.models.kernels.phases import (
    EVENT,
    FORCE_ENDED,
    FREE,
    GRIP,
    HOLD,
    MAX_PHASES,
    PIECE_ENDING,
    PIECE_PHASE,
    PIECE_SIZE,
    PIECE_TIME,
    SLIDE_FORWARD,
    UNFINISHED,
    make_scratch,
    slide_phase,
    two_mass_contact,
)
from fitball.models.kernels.vertical import (
    BALL_RADIUS,
    TANGENTIAL,
    TORSION,
    TORSION_RIGID,
    VerticalMotion,
    vertical_motion,
)
from fitball.values import FloatArray

# Rows of the courses.
Y, V_Y, V_X, OMEGA_CORE, OMEGA_SHELL, TWIST, SLIP, NORMAL_FORCE, FRICTION_FORCE, COURSES = range(10)
# Halvings that bring a bracket of the size of the contact to the rounding of its ends.
BISECTIONS = 60
# An impulse that stops no slip that a float can hold [N s].
FIRST_IMPULSE = 1e-300


class Courses(NamedTuple):
    """Courses (COURSES, times), phases (times,), the vertical motion, the landing impulse [N s] and the velocity and
    shell spin it leaves, and the pieces of the contact.

    Phase 0 means that the motion along the court is not followed; there are no pieces then.
    """

    courses: FloatArray
    phases: NDArray[np.int64]
    vertical: VerticalMotion[float]
    landing: float
    landed_v_x: float
    landed_omega: float
    phase_log: FloatArray


@inlined
def solvable_contact(
    row: FloatArray, codes: NDArray[np.int64], v_x: float, v_y: float, omega: float, cor: float
) -> Contact[float]:
    """The contact of an impact that is known to have a solution."""
    _status, vertical = vertical_motion(row, codes, v_y, cor)
    _status, contact = contact_of(row, codes, vertical, v_x, v_y, omega)
    return contact


@compiled
def vertical_at(spring: Oscillator[float], v_y: float, t: float) -> tuple[float, float]:
    """Compression and its rate `t` seconds after landing at `v_y`."""
    swing = swing_at(spring, t)
    return v_y * swing.sine, v_y * (swing.cosine - spring.decay * swing.sine)


@compiled
def impulse_at(contact: Contact[float], t: float) -> float:
    """Normal impulse since landing, that of landing included [N s]."""
    _y, y_rate = vertical_at(contact.vertical.spring, contact.v_y, t)
    return contact.landing + contact.vertical.riding_mass * (contact.v_y - y_rate)


@compiled
def rigid_phase(contact: Contact[float], impulse: float) -> tuple[int, float, float]:
    """`(phase, friction, acting)` once the normal impulse has grown to `impulse`, core and shell turning as one.

    `friction` [N s] retards the ball; `acting` is the share of the impulse during which the offset of a grip acted.
    """
    slip = contact.v_x - contact.radius * contact.omega
    direction = 1.0 if slip > 0.0 else -1.0
    if not contact.mu > 0.0:
        return slide_phase(direction), 0.0, 0.0
    # Where nothing has happened yet, what is about to shows with the first impulse.
    begun = impulse > 0.0
    grown = impulse if begun else FIRST_IMPULSE
    friction, slipped, held, onward = impulsive_friction(contact, grown)
    if abs(onward) > 0.5:
        phase = slide_phase(onward)
    elif slipped >= grown and abs(slip) > 0.0:
        phase = slide_phase(direction)
    else:
        phase = HOLD if held > 0.0 else GRIP
    return (phase, friction, grown - slipped - held) if begun else (phase, 0.0, 0.0)


@compiled_allocating
def rigid_courses(
    row: FloatArray,
    codes: NDArray[np.int64],
    v_x: float,
    v_y: float,
    omega: float,
    cor: float,
    times: FloatArray,
    courses: FloatArray,
    phases: NDArray[np.int64],
    phase_log: FloatArray,
) -> tuple[float, float, int]:
    """Courses along the court of a ball whose core and shell turn as one; returns the velocity and the spin that
    landing leaves, and the number of pieces.

    Friction follows the impulse that the normal force has given so far (see `rigid`), and so does the end of slip.
    """
    contact = solvable_contact(row, codes, v_x, v_y, omega, cor)
    mu, mass, radius, eps = contact.mu, contact.mass, contact.radius, contact.eps
    inertia, t_force = contact.joint.shell, contact.vertical.t_force
    need = radius * eps / (inertia * (1.0 / mass + radius * radius / inertia))
    landed_v_x = landed_omega = 0.0
    for k in range(-1, times.shape[0]):
        # The first round, before the times, is the state that landing leaves.
        impulse = impulse_at(contact, 0.0 if k < 0 else min(times[k], t_force))
        phase, friction, acting = rigid_phase(contact, impulse)
        turned = omega + (radius * friction - eps * (impulse if contact.eps_in_slide else acting)) / inertia
        if k < 0:
            landed_v_x, landed_omega = v_x - friction / mass, turned
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
        courses[FRICTION_FORCE, k] = share * courses[NORMAL_FORCE, k]
    return landed_v_x, landed_omega, rigid_pieces(contact, phase_log)


@compiled
def rigid_pieces(contact: Contact[float], phase_log: FloatArray) -> int:
    """Write the phases of a rigid contact as pieces into `phase_log`; returns their number, one or two."""
    t_force = contact.vertical.t_force
    first, _friction, _acting = rigid_phase(contact, impulse_at(contact, 0.0))
    last, _friction, _acting = rigid_phase(contact, impulse_at(contact, t_force))
    left, right = 0.0, t_force
    if last != first:
        for _ in range(BISECTIONS):
            t = 0.5 * (left + right)
            if rigid_phase(contact, impulse_at(contact, t))[0] == first:
                left = t
            else:
                right = t
    phase_log[0, PIECE_PHASE], phase_log[0, PIECE_TIME] = first, right
    phase_log[0, PIECE_ENDING] = FORCE_ENDED if last == first else EVENT
    if last == first:
        return 1
    phase_log[1, PIECE_PHASE], phase_log[1, PIECE_TIME] = last, t_force - right
    phase_log[1, PIECE_ENDING] = FORCE_ENDED
    return 2


@compiled_allocating
def sprung_courses(
    row: FloatArray,
    codes: NDArray[np.int64],
    v_x: float,
    v_y: float,
    omega: float,
    cor: float,
    times: FloatArray,
    courses: FloatArray,
    phases: NDArray[np.int64],
    phase_log: FloatArray,
) -> tuple[float, float, int]:
    """Courses along the court of core and shell on their torsional joint; fills in and returns as `rigid_courses`."""
    contact, scratch = solvable_contact(row, codes, v_x, v_y, omega, cor), make_scratch()
    _status, _v_x2, _omega_2, _regime, pieces = two_mass_contact(contact, scratch, phase_log)
    joint, t_force = contact.joint, contact.vertical.t_force
    gyration = joint.shell + contact.mass * contact.radius * contact.radius
    coupling = coupling_of(contact, gyration, 1.0 / joint.core + 1.0 / joint.shell, 1.0 / joint.core + 1.0 / gyration)
    shortened, again = phase_log[:pieces].copy(), ReplayScratch(scratch.twist, scratch.drive)
    for k in range(times.shape[0]):
        # The piece a time belongs to: the last that starts at or before it and takes any time.
        piece, start, begun = 0, 0.0, 0.0
        for j in range(pieces):
            if start <= min(times[k], t_force) and (phase_log[j, PIECE_TIME] > 0.0 or j == 0):
                piece, begun = j, start
            start += phase_log[j, PIECE_TIME]
        shortened[piece, PIECE_TIME] = min(times[k], t_force) - begun
        shortened[piece, PIECE_ENDING] = UNFINISHED
        travel, spin_sum, angle, rate = replay_derivative(contact, True, shortened, piece + 1, again)
        shortened[piece] = phase_log[piece]
        phase = int(phase_log[piece, PIECE_PHASE])
        normal = courses[NORMAL_FORCE, k]
        if times[k] > t_force:
            phase, friction = FREE, 0.0
            angle, rate = free_twist(coupling.slide, angle, rate, times[k] - t_force)
        elif phase in (GRIP, HOLD):
            torque = joint.stiffness * angle + joint.damping * rate
            friction = coupling.lever * (torque - (contact.eps if phase == GRIP else 0.0) * normal)
        else:
            friction = -contact.mu * normal if phase == SLIDE_FORWARD else contact.mu * normal
        turned = (spin_sum - joint.core * rate) / coupling.inertia
        resting = phase in (GRIP, HOLD)
        phases[k] = phase
        courses[V_X, k], courses[OMEGA_CORE, k], courses[OMEGA_SHELL, k] = travel, turned + rate, turned
        courses[TWIST, k], courses[FRICTION_FORCE, k] = angle, friction
        courses[SLIP, k] = 0.0 if resting else travel - contact.radius * turned
    landed_v_x, landed_omega, _stuck = landed(contact)
    return landed_v_x, landed_omega, pieces


@compiled
def vertical_courses(
    row: FloatArray, codes: NDArray[np.int64], v_y: float, cor: float, times: FloatArray, courses: FloatArray
) -> tuple[VerticalMotion[float], float]:
    """Courses of the vertical motion; returns that motion and the landing impulse [N s]."""
    contact = solvable_contact(row, codes, 0.0, v_y, 0.0, cor)
    vertical = contact.vertical
    for k in range(times.shape[0]):
        y, y_rate = vertical_at(vertical.spring, v_y, times[k])
        courses[Y, k], courses[V_Y, k] = y, y_rate
        # The ground cannot pull: once the force has turned tensile there is none. Where it ends, rounding may have
        # either sign.
        force = vertical.riding_mass * (2.0 * vertical.spring.decay * y_rate + vertical.spring.natural_squared * y)
        courses[NORMAL_FORCE, k] = 0.0 if times[k] > vertical.t_force else max(force, 0.0)
    return vertical, contact.landing


def bounce_history(
    row: FloatArray, codes: NDArray[np.int64], v_x: float, v_y: float, omega: float, cor: float, times: FloatArray
) -> Courses:
    """Courses of a contact that has a solution; `times` [s] lie within it.

    The kernels are called one by one: in one they would be compiled all over again.
    """
    courses, phases = np.zeros((COURSES, times.shape[0])), np.zeros(times.shape[0], dtype=np.int64)
    phase_log = np.zeros((MAX_PHASES, PIECE_SIZE))
    vertical, landing = vertical_courses(row, codes, v_y, cor, times, courses)
    # A contact solved in lanes may last a rounding longer.
    times = np.minimum(times, vertical.t_contact)
    if codes[TANGENTIAL] == 0:
        courses[[V_X, OMEGA_CORE, OMEGA_SHELL]] = [[v_x], [omega], [omega]]
        courses[SLIP] = v_x - row[BALL_RADIUS] * omega
        return Courses(courses, phases, vertical, landing, v_x, omega, phase_log[:0])
    along = rigid_courses if codes[TORSION] == TORSION_RIGID else sprung_courses
    landed_v_x, landed_omega, pieces = along(row, codes, v_x, v_y, omega, cor, times, courses, phases, phase_log)
    return Courses(courses, phases, vertical, landing, landed_v_x, landed_omega, phase_log[:pieces])
