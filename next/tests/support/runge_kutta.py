"""One bounce by scipy: the equations of motion in SI, integrated by DOP853 with its own search for every event.

No line, unit or formula of restitution, damping or landing is the Taylor oracle's or the kernels'.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

MASS, RADIUS, INERTIA = 0.0576, 0.03302, 0.56 * 0.0576 * 0.03302**2
SLIDE, BACK, GRIP, HOLD, FREE = 1, 2, 3, 4, 5


def damping_of(e, zero_force):
    """e = exp(-pi zeta/sqrt(1 - zeta^2)), or where the force vanishes -ln e = 2 b cot b, zeta = cos b."""
    loss = -math.log(e)
    if zero_force:
        return math.cos(brentq(lambda b: 2.0 * b / math.tan(b) - loss, 1e-9, 0.5 * math.pi, xtol=1e-15))
    return loss / math.hypot(loss, math.pi)


def bounce(o, p, impact, cor):
    """`v_x2, omega_2`, the share of its speed that the core keeps, contact time, path and turn, and the phases."""
    v_x, v_y, omega = impact
    m, mu, in_slide = p["mass_ratio"], p["mu"], o["offset"] == "contact"
    eps = p["eps_10"] + p["eps_slope"] * (v_y - 10.0)
    riding = MASS * (1.0 if o["normal"] == "total" else m)
    solid, thin = 0.4 * 0.97**2 * m, 2.0 / 3.0 * (1.0 - m)
    core = INERTIA * (p["inertia_split"] if o["inertia"] == "table" else solid / (solid + thin))
    shell = INERTIA - core
    zeta = damping_of(cor / m if o["normal"] == "momentum" else cor, o["release"] == "zero_force")
    k_y, c_y = p["k_y"], 2.0 * zeta * math.sqrt(p["k_y"] * riding)
    natural = math.sqrt(p["k_theta"] * INERTIA / (core * shell))
    damped = math.sqrt(k_y / riding) * math.sqrt(1.0 - zeta**2)
    zeta_theta = p["zeta_theta"] if o["torsion"] == "free" else math.sqrt(1.0 - (damped / natural) ** 2)
    k, c = p["k_theta"], 2.0 * zeta_theta * p["k_theta"] / natural
    gyration = shell + MASS * RADIUS**2

    def forces(z):
        return k_y * z[0] + c_y * z[1], k * z[5] + c * (z[3] - z[4])

    def needed(z, lever):
        force, torque = forces(z)
        return MASS * RADIUS * (torque - lever * force) / gyration

    def rates(phase, z):
        force, torque = forces(z)
        ground = 0.0 if phase == FREE else force
        lever = {GRIP: eps, HOLD: 0.0, FREE: 0.0}.get(phase, eps if in_slide else 0.0)
        push = {GRIP: needed(z, eps), HOLD: needed(z, 0.0), SLIDE: -mu * ground, BACK: mu * ground, FREE: 0.0}[phase]
        turn = (core * z[3] + shell * z[4]) / INERTIA
        spin = (torque - RADIUS * push - lever * ground) / shell
        return [z[1], -force / riding, push / MASS, -torque / core, spin, z[3] - z[4], z[2], turn]

    def endings(phase):
        """What falls through zero where a phase ends: the normal force first."""
        ends = [lambda z: forces(z)[0]]
        if phase in (GRIP, HOLD):
            lever = eps if phase == GRIP else 0.0
            ends += [lambda z, s=s: mu * forces(z)[0] - s * needed(z, lever) for s in (1, -1)]
            if phase == HOLD:
                ends.append(lambda z: abs(needed(z, eps)) - mu * forces(z)[0])
        elif phase != FREE:
            ends.append(lambda z: (1.0 if phase == SLIDE else -1.0) * (z[2] - RADIUS * z[4]))
        else:
            ends = [lambda z: z[0]]
        return ends

    def run(phase, time, z):
        events = []
        for end in endings(phase):
            event = lambda _t, z, end=end: end(z)  # noqa: E731
            event.terminal, event.direction = True, -1.0
            events.append(event)
        return solve_ivp(
            lambda _t, z: rates(phase, z), (time, 1.0), z, "DOP853", rtol=1e-12, atol=1e-15, events=events,
            max_step=0.2 / max(damped, natural, 2.0 * zeta_theta * natural),
        )  # fmt: skip

    def at_rest(z, phase, ending):
        limit = mu * forces(z)[0]
        if phase == HOLD and ending == 3:
            return GRIP
        if phase not in (GRIP, HOLD) and abs(needed(z, eps)) <= limit:
            return GRIP
        if phase != HOLD and not in_slide and abs(needed(z, 0.0)) <= limit:
            return HOLD
        return BACK if needed(z, eps if in_slide else 0.0) > 0.0 else SLIDE

    z = np.array([0.0, v_y, v_x, omega, omega, 0.0, 0.0, 0.0])
    if o["normal"] == "momentum":
        _land(z, (1.0 - m) * MASS * v_y, mu, eps, in_slide, shell)
    slip, time, phases = z[2] - RADIUS * z[4], 0.0, []
    phase = SLIDE if slip > 0.0 else BACK
    if abs(slip) < 1e-12 * v_y:
        phase = at_rest(z, 0, 0)
    while phase:
        phases.append(phase)
        found = run(phase, time, z)
        z, time = found.y[:, -1], found.t[-1]
        ending = next(place for place, times in enumerate(found.t_events) if times.size)
        if ending == 0:
            phase = FREE if phase != FREE and o["release"] == "zero_displacement" else 0
        else:
            phase = at_rest(z, phase, ending)
    spin = z[4] if o["spin"] == "shell" else (core * z[3] + shell * z[4]) / INERTIA
    late = z[0] / (cor * v_y)
    return z[2], spin, -z[1] / v_y, time, z[6] + z[2] * late, z[7] + spin * late, phases


def _land(z, impulse, mu, eps, in_slide, shell):
    """The landing impulse: slip until it is used up, then what keeps it away, by trial."""
    yielding = 1.0 / MASS + RADIUS**2 / shell
    slip = z[2] - RADIUS * z[4]
    acting = eps if in_slide else 0.0
    rate = -math.copysign(mu, slip) * yielding + RADIUS * acting / shell
    first = 0.0 if slip == 0.0 else impulse if rate * slip >= 0.0 else min(impulse, -slip / rate)
    shares = [(first, -math.copysign(mu, slip), acting)]
    for lever in (eps, acting):
        # Friction per normal force that keeps the contact point from slipping.
        friction = -RADIUS * lever / shell / yielding
        if abs(friction) <= mu:
            break
    shares.append((impulse - first, min(max(friction, -mu), mu), lever))
    for part, push, lever in shares:
        z[2] += push * part / MASS
        z[4] -= (RADIUS * push + lever) * part / shell
