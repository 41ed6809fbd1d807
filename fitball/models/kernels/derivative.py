"""Derivatives of a bounce, as kernels.

The bounce is solved once in real numbers, which finds the pieces of its contact and their durations. Then the same
closed forms are followed piece by piece without any search, in numbers that carry a derivative along several
directions at once. What ended a piece is the zero of a function `g` of the state, and a zero moves: to first order by
`-g/g'`, where what `g` carries at the logged time is what the zero must make good. The state moves along with its own
rates, so nothing is evaluated twice.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.bounce import BOUNCE, solve_alone
from fitball.models.kernels.compiled import Entry, calling, inlined, inner, inner_allocating, read_only
from fitball.models.kernels.contact import Contact, contact_of, landed
from fitball.models.kernels.dual import SLOPES, STEP, WIDTH, GradientArray, Number, NumberArray, carry, gradient_array
from fitball.models.kernels.equations import Coupling, coupling_of, free_twist, load_of, twist_at, vertical_after
from fitball.models.kernels.oscillator import (
    SERIES_LENGTH,
    Oscillators,
    basis_at,
    forced_response,
    series_free,
    series_response,
)
from fitball.models.kernels.phases import (
    EVENT,
    FORCE_ENDED,
    GRIP,
    HOLD,
    MAX_PHASES,
    PIECE_SIZE,
    RESUMED,
    SLIDE_FORWARD,
    logged_piece,
    make_scratch,
    rigid_contact,
)
from fitball.models.kernels.vertical import (
    COLUMNS,
    COR_MEASURED,
    OK,
    RESTITUTION,
    TANGENTIAL,
    TORSION,
    TORSION_RIGID,
    vertical_motion,
)
from fitball.values import FloatArray


class ReplayScratch(NamedTuple):
    """Twist and force as coefficients: scratch of one thread."""

    twist: NumberArray
    drive: NumberArray


@inlined
def replay_coupling(contact: Contact[Number]) -> Coupling[Number]:
    """`coupling_of` with one division for each relative compliance."""
    core, shell = contact.joint.core, contact.joint.shell
    gyration = shell + contact.mass * contact.radius * contact.radius
    return coupling_of(contact, gyration, (core + shell) / (core * shell), (core + gyration) / (core * gyration))


@inner
def replay_derivative(
    contact: Contact[Number], twist_at_end: bool, phase_log: FloatArray, pieces: int, scratch: ReplayScratch
) -> tuple[Number, Number, Number, Number]:
    """`(v_x, spin_sum, angle, rate)` after `pieces` rows of `phase_log`, as in `State`; `rate` that of the twist.

    Without `twist_at_end`, `angle` and `rate` are not brought to the end of a piece that slides until the force ends:
    the sum of the spins does not need them.
    """
    joint, vertical = contact.joint, contact.vertical
    coupling = replay_coupling(contact)
    v_x, omega_2, _stuck = landed(contact)
    spin_sum = joint.core * contact.omega + joint.shell * omega_2
    angle = 0.0 * contact.omega
    rate = contact.omega - omega_2
    y = 0.0 * contact.v_y
    y_rate = contact.v_y
    start = 0.0 * vertical.t_force
    for place in range(pieces):
        piece = logged_piece(phase_log, place)
        n, length = piece.series.terms, piece.series.length
        resting = piece.phase in (GRIP, HOLD)
        direction = 1.0 if piece.phase == SLIDE_FORWARD else -1.0
        if resting:
            acting = contact.eps if piece.phase == GRIP else 0.0 * contact.eps
            torsion = coupling.grip
            kappa = acting / coupling.gyration
            spinning_up = 0.0 * contact.eps
        else:
            acting = coupling.eps_slide
            torsion = coupling.slide
            spinning_up = direction * contact.mu * contact.radius - coupling.eps_slide
            kappa = -spinning_up / joint.shell

        oscillators = Oscillators(torsion, vertical.spring)
        load = load_of(vertical, y, y_rate)
        momentum = load.momentum
        force_s = load.force_rate + vertical.spring.decay * load.force
        elapsed = vertical.t_force - start if piece.ending == FORCE_ENDED else piece.time + 0.0 * start
        basis = basis_at(oscillators, elapsed)
        if resting or twist_at_end or piece.ending != FORCE_ENDED:
            if n > 0:
                series_free(load.force, force_s, vertical.spring, length, n, scratch.drive)
                series_response(torsion, kappa, scratch.drive, angle, rate, length, n, scratch.twist)
            else:
                forced_response(oscillators, kappa, load.force, force_s, angle, rate, scratch.twist)
            angle, rate = twist_at(scratch.twist, oscillators, piece.series, elapsed, basis)
        y, y_rate = vertical_after(vertical.spring, 0, y, y_rate, elapsed, basis)

        if piece.ending in (EVENT, RESUMED):
            y_accel = -2.0 * vertical.spring.decay * y_rate - vertical.spring.natural_squared * y
            load = load_of(vertical, y, y_rate)
            accel = kappa * load.force - 2.0 * torsion.decay * rate - torsion.natural_squared * angle
            if resting:
                # Margin of the friction cone on the side where it ended; for a hold, of the grip with the offset.
                offset = contact.eps if piece.ending == RESUMED else acting
                arm = piece.side * coupling.lever
                torque = joint.stiffness * angle + joint.damping * rate
                g = contact.mu * load.force - arm * (torque - offset * load.force)
                g_rate = contact.mu * load.force_rate - arm * (
                    joint.stiffness * rate + joint.damping * accel - offset * load.force_rate
                )
            else:
                impulse = momentum - load.momentum
                turned = spin_sum + spinning_up * impulse - joint.core * rate
                friction = direction * contact.mu / contact.mass
                g = v_x - friction * impulse - contact.radius * turned / coupling.inertia
                g_rate = -friction * load.force
                g_rate -= contact.radius * (spinning_up * load.force - joint.core * accel) / coupling.inertia
            late = carry(0.0, -g / g_rate.real, 1.0)
            elapsed += late
            y, y_rate = y + late * y_rate, y_rate + late * y_accel
            angle, rate = angle + late * rate, rate + late * accel

        impulse = momentum - vertical.riding_mass * y_rate
        if resting:
            # About the contact point, and with the momentum of `v_x`: slip of zero that carries something stops too.
            total = spin_sum + contact.mass * contact.radius * v_x - acting * impulse
            omega_2 = (total - joint.core * rate) / (joint.core + coupling.gyration)
            v_x = contact.radius * omega_2
            spin_sum = coupling.inertia * omega_2 + joint.core * rate
        else:
            v_x -= direction * contact.mu / contact.mass * impulse
            spin_sum += spinning_up * impulse
        start += elapsed
    return v_x, spin_sum, angle, rate


@inner
def replay_contact(
    contact: Contact[Number], phase_log: FloatArray, pieces: int, scratch: ReplayScratch
) -> tuple[Number, Number]:
    """`(v_x2, omega_2)` of the contact whose `pieces` stand in `phase_log`."""
    v_x2, spin_sum, angle, rate = replay_derivative(contact, contact.shell_spin, phase_log, pieces, scratch)
    coupling = replay_coupling(contact)
    if not contact.shell_spin:
        return v_x2, spin_sum / coupling.inertia
    flight = contact.vertical.t_contact - contact.vertical.t_force
    _angle, rate = free_twist(coupling.slide, angle, rate, flight)
    return v_x2, (spin_sum - contact.joint.core * rate) / coupling.inertia


# Derivatives with respect to an impact's own speeds, spin, and measured restitution come first.
V_X1, V_Y1, OMEGA_1, COR, INPUTS = range(5)
TWIST = max(SERIES_LENGTH, 4)


class GradientScratch(NamedTuple):
    """Numbers and their slopes, (..., WIDTH): kernel row, impact (INPUTS), rebound (4); and scratch of `replay`."""

    row: FloatArray
    impact: FloatArray
    rebound: FloatArray
    series: FloatArray


@inner_allocating
def make_gradient_scratch() -> GradientScratch:
    """Scratch for one thread."""
    return GradientScratch(
        np.zeros((len(COLUMNS), WIDTH)),
        np.zeros((INPUTS, WIDTH)),
        np.zeros((4, WIDTH)),
        np.zeros((TWIST + SERIES_LENGTH, WIDTH)),
    )


@inlined
def lay(row: FloatArray, seeds: FloatArray, draw: int, first: int, scratch: GradientScratch) -> None:
    """Write a kernel's row and what it and the impact carry along the directions from the `first`."""
    for place in range(SLOPES):
        direction = first + place
        for k in range(INPUTS):
            scratch.impact[k, 1 + place] = STEP if k == direction else 0.0
        for column in range(len(COLUMNS)):
            known = INPUTS <= direction < INPUTS + seeds.shape[0]
            seed = seeds[direction - INPUTS, draw, column] if known else 0.0
            scratch.row[column, 0], scratch.row[column, 1 + place] = row[column], STEP * seed


@inlined
def bounce_gradient(codes: NDArray[np.int64], phase_log: FloatArray, pieces: int, scratch: GradientScratch) -> None:
    """Fill in the `rebound` (v_x2, v_y2, omega_2, contact_time) of a bounce that has been solved."""
    row, impact = gradient_array(scratch.row), gradient_array(scratch.impact)
    out: GradientArray = gradient_array(scratch.rebound)
    v_x, v_y, omega = impact[V_X1], impact[V_Y1], impact[OMEGA_1]
    _status, vertical = vertical_motion(row, codes, v_y, impact[COR])
    out[1], out[3] = vertical.cor * v_y, vertical.t_contact
    if codes[TANGENTIAL] == 0:
        out[0], out[2] = v_x, omega
        return
    _status, contact = contact_of(row, codes, vertical, v_x, v_y, omega)
    if codes[TORSION] == TORSION_RIGID:
        out[0], out[2], _regime = rigid_contact(contact)
    else:
        series = ReplayScratch(gradient_array(scratch.series[:TWIST]), gradient_array(scratch.series[TWIST:]))
        out[0], out[2] = replay_contact(contact, phase_log, pieces, series)


@calling(BOUNCE)
def jacobian_batch(
    rows: FloatArray,
    seeds: FloatArray,
    codes: NDArray[np.int64],
    v_x1: FloatArray,
    v_y1: FloatArray,
    omega_1: FloatArray,
    cor: FloatArray,
    slopes: FloatArray,
) -> None:
    """Fill `slopes` (draws, impacts, 4, INPUTS + parameters): those of what `bounce_batch` gives of the same impacts.

    `seeds` (parameters, draws, columns): what each column of `rows` gains per unit of a parameter. Without a measured
    restitution among the inputs the slopes along it are zero; where the status is not OK all are NaN.
    """
    scratch, carrying = make_scratch(), make_gradient_scratch()
    phase_log = np.empty((MAX_PHASES, PIECE_SIZE))
    directions = INPUTS + seeds.shape[0]
    for i in range(rows.shape[0]):
        own = i if v_x1.shape[0] > 1 else 0
        for j in range(v_x1.shape[1]):
            v_x, v_y, omega, measured = v_x1[own, j], v_y1[own, j], omega_1[own, j], cor[own, j]
            solved = solve_alone(rows[i], codes, v_x, v_y, omega, measured, scratch, phase_log)
            if solved.status != OK:
                slopes[i, j] = math.nan
                continue
            impact = carrying.impact
            impact[V_X1, 0], impact[V_Y1, 0], impact[OMEGA_1, 0], impact[COR, 0] = v_x, v_y, omega, measured
            for first in range(0, directions, SLOPES):
                lay(rows[i], seeds, i, first, carrying)
                bounce_gradient(codes, phase_log, solved.pieces, carrying)
                for output in range(4):
                    for place in range(min(SLOPES, directions - first)):
                        slopes[i, j, output, first + place] = carrying.rebound[output, 1 + place] / STEP
            if codes[RESTITUTION] != COR_MEASURED:
                slopes[i, j, :, COR] = 0.0


JACOBIAN = Entry(
    jacobian_batch,
    (
        np.zeros((1, len(COLUMNS))), np.zeros((1, 1, len(COLUMNS))), np.zeros(TANGENTIAL + 1, dtype=np.int64),
        *(read_only((1, 1)) for _ in range(4)), np.zeros((1, 1, 4, INPUTS)),
    ),
    None,
)  # fmt: skip
