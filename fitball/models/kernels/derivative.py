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

from fitball.models.kernels.compiled import compiled, inlined, inner
from fitball.models.kernels.contact import (
    COLUMNS,
    COR_MEASURED,
    OK,
    RESTITUTION,
    TANGENTIAL,
    TORSION,
    TORSION_RIGID,
    Contact,
    contact_of,
    landed,
    vertical_motion,
)
from fitball.models.kernels.dual import SLOPES, STEP, WIDTH, GradientArray, Number, NumberArray, carry, gradient_array
from fitball.models.kernels.equations import (
    Coupling,
    Drive,
    Load,
    State,
    advance,
    coupling_of,
    drive_of,
    free_twist,
    gaps_of,
    load_of,
    solve_twist,
    swung_to,
)
from fitball.models.kernels.oscillator import SERIES_LENGTH, Oscillators, basis_at
from fitball.models.kernels.phases import (
    EVENT,
    FORCE_ENDED,
    RESUMED,
    Piece,
    logged_piece,
    rigid_contact,
)
from fitball.values import FloatArray


@inner
def followed_again(
    contact: Contact[Number], phase_log: FloatArray, pieces: int, twist: NumberArray, force: NumberArray
) -> tuple[Number, Number, Number, Number]:
    """`(v_x2, omega_2, gap_path, gap_turn)` of the contact whose `pieces` are in `phase_log`.

    `twist` and `force` are scratch.
    """
    joint, vertical, spring = contact.joint, contact.vertical, contact.vertical.spring
    core, shell = joint.core, joint.shell
    gyration = shell + contact.mass * contact.radius * contact.radius
    # One division for each relative compliance.
    coupling = coupling_of(contact, gyration, (core + shell) / (core * shell), (core + gyration) / (core * gyration))
    v_x, omega_2, _stuck = landed(contact)
    nothing = 0.0 * contact.v_y
    state = State(
        nothing, nothing, contact.v_y, nothing, contact.omega - omega_2, v_x, core * contact.omega + shell * omega_2,
        nothing, nothing,
    )  # fmt: skip
    for place in range(pieces):
        piece = logged_piece(phase_log, place)
        drive = drive_of(contact, coupling, piece.phase)
        oscillators = Oscillators(drive.torsion, spring)
        load = load_of(vertical, state.y, state.y_rate)
        elapsed = vertical.t_force - state.time if piece.ending == FORCE_ENDED else piece.time + nothing
        basis = basis_at(oscillators, elapsed)
        # The sum of the spins at the end does not need the twist that slip leaves.
        twisting = contact.shell_spin or drive.resting or piece.ending != FORCE_ENDED
        if twisting:
            solve_twist(drive, oscillators, state, load, piece.series, twist, force)
        moved = swung_to(oscillators, piece.series, twist, state, elapsed, basis, twisting)
        if piece.ending == EVENT or piece.ending == RESUMED:
            moved = on_time(contact, coupling, drive, state, load, moved, piece)
        state = advance(contact, coupling, drive, state, load, moved)
    spin_2 = state.spin_sum / coupling.inertia
    if contact.shell_spin:
        _angle, rate = free_twist(coupling.slide, state.angle, state.rate, vertical.t_contact - vertical.t_force)
        spin_2 = (state.spin_sum - core * rate) / coupling.inertia
    path, turn = gaps_of(contact, coupling, state, spin_2)
    return state.v_x, spin_2, path, turn


@inlined
def on_time(
    contact: Contact[Number],
    coupling: Coupling[Number],
    drive: Drive[Number],
    start: State[Number],
    load: Load[Number],
    moved: State[Number],
    piece: Piece,
) -> State[Number]:
    """`moved`, which is at the logged time, at the time of the event that ended the piece."""
    joint, spring = contact.joint, contact.vertical.spring
    there = load_of(contact.vertical, moved.y, moved.y_rate)
    y_accel = -2.0 * spring.decay * moved.y_rate - spring.natural_squared * moved.y
    torsion = drive.torsion
    accel = drive.kappa * there.force - 2.0 * torsion.decay * moved.rate - torsion.natural_squared * moved.angle
    if drive.resting:
        # Margin of the friction cone on the side where it ended; for a hold that grips, of the grip with the offset.
        offset = contact.eps if piece.ending == RESUMED else drive.eps
        arm = piece.side * coupling.lever
        torque = joint.stiffness * moved.angle + joint.damping * moved.rate
        g = contact.mu * there.force - arm * (torque - offset * there.force)
        g_rate = contact.mu * there.force_rate - arm * (
            joint.stiffness * moved.rate + joint.damping * accel - offset * there.force_rate
        )
    else:
        impulse = load.momentum - there.momentum
        turned = start.spin_sum + drive.spinning_up * impulse - joint.core * moved.rate
        g = start.v_x - drive.braking * impulse - contact.radius * turned / coupling.inertia
        g_rate = -drive.braking * there.force
        g_rate -= contact.radius * (drive.spinning_up * there.force - joint.core * accel) / coupling.inertia
    late = carry(0.0, -g / g_rate.real, 1.0)
    return State(
        moved.time + late,
        moved.y + late * moved.y_rate,
        moved.y_rate + late * y_accel,
        moved.angle + late * moved.rate,
        moved.rate + late * accel,
        moved.v_x,
        moved.spin_sum,
        moved.path,
        moved.turn,
    )


# Derivatives with respect to an impact's own speeds, spin, and measured restitution come first.
V_X1, V_Y1, OMEGA_1, COR, INPUTS = range(5)
TWIST = max(SERIES_LENGTH, 4)
# Those of a bounce: velocity, spin, contact time, and gaps between the flights.
OUTPUT_COUNT = 7
# Rows of scratch that one thread needs: numbers and their slopes.
IMPACT = len(COLUMNS)
REBOUND = IMPACT + INPUTS
SERIES = REBOUND + OUTPUT_COUNT
ROOM = (SERIES + TWIST + SERIES_LENGTH, WIDTH)


class GradientScratch(NamedTuple):
    """Numbers and their slopes, (..., WIDTH): kernel row, impact (INPUTS), rebound (OUTPUT_COUNT); and the
    coefficients of twist and force.
    """

    row: FloatArray
    impact: FloatArray
    rebound: FloatArray
    series: FloatArray


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
    """Fill in the `rebound`, in the order of `Rebound`, of a bounce that has been solved."""
    row, impact = gradient_array(scratch.row), gradient_array(scratch.impact)
    out: GradientArray = gradient_array(scratch.rebound)
    v_x, v_y, omega = impact[V_X1], impact[V_Y1], impact[OMEGA_1]
    _status, vertical = vertical_motion(row, codes, v_y, impact[COR])
    out[1], out[3], out[4] = vertical.cor * v_y, vertical.t_contact, vertical.t_flight
    if codes[TANGENTIAL] == 0:
        out[0], out[2] = v_x, omega
        out[5], out[6] = v_x * vertical.t_flight, omega * vertical.t_flight
        return
    _status, contact = contact_of(row, codes, vertical, v_x, v_y, omega)
    if codes[TORSION] == TORSION_RIGID:
        out[0], out[2], out[5], out[6], _regime = rigid_contact(contact)
    else:
        twist, force = gradient_array(scratch.series[:TWIST]), gradient_array(scratch.series[TWIST:])
        out[0], out[2], out[5], out[6] = followed_again(contact, phase_log, pieces, twist, force)


@compiled
def jacobian_batch(
    rows: FloatArray,
    seeds: FloatArray,
    codes: NDArray[np.int64],
    v_x1: FloatArray,
    v_y1: FloatArray,
    omega_1: FloatArray,
    cor: FloatArray,
    first: int,
    stop: int,
    status: NDArray[np.int8],
    log: FloatArray,
    ends: NDArray[np.int64],
    slopes: FloatArray,
    room: FloatArray,
) -> None:
    """Fill `slopes` (draws, impacts, OUTPUT_COUNT, INPUTS + parameters): those of what `bounce_each` gave of the
    places from `first` to `stop`, each draw's impacts in turn, with their `status`, `log` and `ends`.

    `seeds` (parameters, draws, columns): what each column of `rows` gains per unit of a parameter. Without a measured
    restitution among the inputs the slopes along it are zero; where the status is not OK all are NaN. `room` is
    scratch of the shape ROOM.
    """
    carrying = GradientScratch(room[:IMPACT], room[IMPACT:REBOUND], room[REBOUND:SERIES], room[SERIES:])
    directions = INPUTS + seeds.shape[0]
    used = 0
    for place in range(first, stop):
        i = place // v_x1.shape[1]
        j = place - i * v_x1.shape[1]
        own = i if v_x1.shape[0] > 1 else 0
        begin, used = used, ends[place]
        if status[i, j] != OK:
            slopes[i, j] = math.nan
            continue
        impact = carrying.impact
        impact[V_X1, 0], impact[V_Y1, 0] = v_x1[own, j], v_y1[own, j]
        impact[OMEGA_1, 0], impact[COR, 0] = omega_1[own, j], cor[own, j]
        for along in range(0, directions, SLOPES):
            lay(rows[i], seeds, i, along, carrying)
            bounce_gradient(codes, log[begin:], used - begin, carrying)
            for output in range(OUTPUT_COUNT):
                for k in range(along, directions if directions < along + SLOPES else along + SLOPES):
                    slopes[i, j, output, k] = carrying.rebound[output, 1 + k - along] / STEP
        if codes[RESTITUTION] != COR_MEASURED:
            slopes[i, j, :, COR] = 0.0
