"""A contact retraced in numbers that carry a derivative, as kernels.

`two_mass_contact` finds the pieces of a contact and their durations; here the same closed forms are followed piece
by piece without any search. What ended a piece is the zero of a function `g` of the state, and a zero moves: to first
order by `-g/g'`, where the imaginary part of `g` at the recorded time is what the zero must make good. The state
moves along with its own rates, so nothing is evaluated twice.
"""

from __future__ import annotations

from fitball.models.kernels.compiled import compiled, inlined
from fitball.models.kernels.dual import NumberArray, size, sqrt
from fitball.models.kernels.events import TORSION, VERTICAL, basis_at
from fitball.models.kernels.landing import landed
from fitball.models.kernels.oscillator import forced_response, series_free, series_response
from fitball.models.kernels.phases import GRIP, HOLD, SLIDE_FORWARD
from fitball.models.kernels.twist import free_twist_rate, set_torsion, twist_at, vertical_after
from fitball.models.kernels.two_mass import (
    EVENT,
    FORCE_ENDED,
    PIECE_ENDING,
    PIECE_PHASE,
    PIECE_SCALE,
    PIECE_SIDE,
    PIECE_TERMS,
    PIECE_TIME,
    RESUMED,
)
from fitball.values import FloatArray

# Twist, force, poles: scratch of one thread.
ReplayScratch = tuple[NumberArray, NumberArray, NumberArray]


@inlined
def moved_by(g: complex, g_rate: complex) -> complex:
    """What the time of a zero of `g` carries."""
    return complex(0.0, -g.imag / g_rate.real)


@compiled
def retrace(
    mass: complex,
    radius: complex,
    inertia_core: complex,
    inertia_shell: complex,
    stiffness: complex,
    damping: complex,
    w2_slide: complex,
    mu: complex,
    eps: complex,
    eps_in_slide: bool,
    twist_at_end: bool,
    riding_mass: complex,
    landing_impulse: complex,
    omega2: complex,
    sigma: complex,
    w2_force: complex,
    t_force: complex,
    v_x: complex,
    v_y: complex,
    omega: complex,
    record: FloatArray,
    pieces: int,
    scratch: ReplayScratch,
) -> tuple[complex, complex, complex, complex, complex, complex]:
    """`(v_x, spin_sum, th, rate, y, y_rate)` after `pieces` rows of `record`; arguments as in `two_mass_contact`.

    `spin_sum` is the angular momentum of core and shell together. Without `twist_at_end`, `th` and `rate` are not
    brought to the end of a piece that slides until the force ends: the sum of the spins does not need them.
    """
    twist, drive, poles = scratch
    inertia = inertia_core + inertia_shell
    gyration = inertia_shell + mass * radius * radius
    relative_slide = inertia / (inertia_core * inertia_shell)
    relative_grip = (inertia_core + gyration) / (inertia_core * gyration)
    decay_slide = 0.5 * damping * relative_slide
    decay_grip = 0.5 * damping * relative_grip
    w2_grip = stiffness * relative_grip - decay_grip * decay_grip
    eps_slide = eps if eps_in_slide else 0.0 * eps
    lever = mass * radius / gyration
    poles[VERTICAL], poles[VERTICAL + 1], poles[VERTICAL + 2] = sigma, w2_force, omega2
    poles[VERTICAL + 3] = sqrt(size(w2_force))

    v_x, shell, _stuck = landed(mass, radius, inertia_shell, mu, eps, eps_in_slide, landing_impulse, v_x, omega)
    spin_sum = inertia_core * omega + inertia_shell * shell
    th = 0.0 * omega
    rate = omega - shell
    y = 0.0 * v_y
    y_rate = v_y
    start = 0.0 * t_force
    for row in range(pieces):
        phase, ending, side = int(record[row, PIECE_PHASE]), int(record[row, PIECE_ENDING]), record[row, PIECE_SIDE]
        n, length = int(record[row, PIECE_TERMS]), record[row, PIECE_SCALE]
        resting = phase in (GRIP, HOLD)
        if resting:
            acting = eps if phase == GRIP else 0.0 * eps
            set_torsion(poles, stiffness, damping, relative_grip, w2_grip)
            kappa = acting / gyration
            decay, natural2 = decay_grip, stiffness * relative_grip
            spinning_up = 0.0 * eps
        else:
            direction = 1.0 if phase == SLIDE_FORWARD else -1.0
            acting = eps_slide
            set_torsion(poles, stiffness, damping, relative_slide, w2_slide)
            spinning_up = direction * mu * radius - eps_slide
            kappa = -spinning_up / inertia_shell
            decay, natural2 = decay_slide, stiffness * relative_slide

        y_accel = -2.0 * sigma * y_rate - omega2 * y
        force = -riding_mass * y_accel
        force_s = riding_mass * (omega2 * y_rate + 2.0 * sigma * y_accel) + sigma * force
        elapsed = t_force - start if ending == FORCE_ENDED else complex(record[row, PIECE_TIME], 0.0)
        basis = basis_at(poles, elapsed)
        momentum = riding_mass * y_rate
        if resting or twist_at_end or ending != FORCE_ENDED:
            if n > 0:
                series_free(force, force_s, sigma, omega2, length, n, drive)
                series_response(decay, natural2, kappa, drive, th, rate, length, n, twist)
            else:
                twist[0], twist[1], twist[2], twist[3] = forced_response(
                    poles[TORSION], poles[TORSION + 1], sigma, w2_force, kappa, force, force_s, th, rate
                )
            th, rate = twist_at(twist, poles, n, length, elapsed, basis)
        y, y_rate = vertical_after(poles, 0, y, y_rate, elapsed, basis)

        if ending in (EVENT, RESUMED):
            y_accel = -2.0 * sigma * y_rate - omega2 * y
            force = -riding_mass * y_accel
            force_rate = riding_mass * (omega2 * y_rate + 2.0 * sigma * y_accel)
            th_accel = kappa * force - 2.0 * decay * rate - natural2 * th
            if resting:
                # Margin of the friction cone on the side where it ended; for a hold, of the grip with the offset.
                offset = eps if ending == RESUMED else acting
                g = mu * force - side * lever * (stiffness * th + damping * rate - offset * force)
                g_rate = mu * force_rate - side * lever * (
                    stiffness * rate + damping * th_accel - offset * force_rate
                )
            else:
                impulse = momentum - riding_mass * y_rate
                turned = spin_sum + spinning_up * impulse - inertia_core * rate
                g = v_x - direction * mu / mass * impulse - radius * turned / inertia
                g_rate = -direction * mu / mass * force
                g_rate -= radius * (spinning_up * force - inertia_core * th_accel) / inertia
            late = moved_by(g, g_rate)
            elapsed += late
            y, y_rate = y + late * y_rate, y_rate + late * y_accel
            th, rate = th + late * rate, rate + late * th_accel

        impulse = momentum - riding_mass * y_rate
        if resting:
            # About the contact point, and with the momentum of `v_x`: slip of zero that carries something stops too.
            total = spin_sum + mass * radius * v_x - acting * impulse
            shell = (total - inertia_core * rate) / (inertia_core + gyration)
            v_x = radius * shell
            spin_sum = inertia * shell + inertia_core * rate
        else:
            v_x -= direction * mu / mass * impulse
            spin_sum += spinning_up * impulse
        start += elapsed
    return v_x, spin_sum, th, rate, y, y_rate


@compiled
def replay_contact(
    mass: complex,
    radius: complex,
    inertia_core: complex,
    inertia_shell: complex,
    stiffness: complex,
    damping: complex,
    w2_slide: complex,
    mu: complex,
    eps: complex,
    eps_in_slide: bool,
    shell_spin: bool,
    riding_mass: complex,
    landing_impulse: complex,
    omega2: complex,
    sigma: complex,
    w2_force: complex,
    t_force: complex,
    t_contact: complex,
    v_x: complex,
    v_y: complex,
    omega: complex,
    record: FloatArray,
    pieces: int,
    scratch: ReplayScratch,
) -> tuple[complex, complex]:
    """`(v_x2, omega_2)` of the contact whose `pieces` stand in `record`; arguments as in `two_mass_contact`."""
    v_x2, spin_sum, th, rate, _y, _y_rate = retrace(
        mass, radius, inertia_core, inertia_shell, stiffness, damping, w2_slide, mu, eps, eps_in_slide, shell_spin,
        riding_mass, landing_impulse, omega2, sigma, w2_force, t_force, v_x, v_y, omega, record, pieces, scratch,
    )  # fmt: skip
    inertia = inertia_core + inertia_shell
    if not shell_spin:
        return v_x2, spin_sum / inertia
    relative_slide = inertia / (inertia_core * inertia_shell)
    rate = free_twist_rate(scratch[2], stiffness, damping, relative_slide, w2_slide, th, rate, t_contact - t_force)
    return v_x2, (spin_sum - inertia_core * rate) / inertia
