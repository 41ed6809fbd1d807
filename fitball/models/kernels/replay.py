"""A contact followed again in numbers that carry a derivative, as kernels.

`two_mass_contact` finds the pieces of a contact and their durations; here the same closed forms are followed piece
by piece without any search. What ended a piece is the zero of a function `g` of the state, and a zero moves: to first
order by `-g/g'`, where what `g` carries at the logged time is what the zero must make good. The state
moves along with its own rates, so nothing is evaluated twice.
"""

from __future__ import annotations

from typing import NamedTuple

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.dual import Number, NumberArray, carry
from fitball.models.kernels.events import basis_at
from fitball.models.kernels.landing import landed
from fitball.models.kernels.oscillator import forced_response, series_free, series_response
from fitball.models.kernels.phases import EVENT, FORCE_ENDED, GRIP, HOLD, RESUMED, SLIDE_FORWARD, logged_piece
from fitball.models.kernels.quantities import Contact, Coupling, Oscillators
from fitball.models.kernels.twist import coupling_of, free_twist, load_of, twist_at, vertical_after
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
