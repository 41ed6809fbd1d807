"""The equations of motion of one contact in SI units, integrated by scipy with its own search for every event: what
oracle and courses are held against. No line, unit or formula for release or damping is theirs.
"""

from __future__ import annotations

import math

import numpy as np
from oracle_case import BALL
from scipy.integrate import solve_ivp

from fitball.models.types import Phase

MASS, RADIUS = BALL.mass, BALL.radius


class Contact:
    """A ball from landing on; its state is `(y, y', v_x, omega_1, omega_2, twist)`.

    `core_return` is the share of its speed that the core keeps.
    """

    def __init__(self, closures, p, at, core_return, contact_time):
        m, self.mu, self.in_slide = p["mass_ratio"], p["mu"], closures.offset == "contact"
        self.eps = p["eps_10"] + p["eps_slope"] * (float(at.v_y1[0]) - 10.0)
        self.rigid, self.duration = closures.torsion == "rigid", contact_time
        self.riding = MASS * (1.0 if closures.normal == "total" else m)
        solid, thin = 0.4 * 0.97**2 * m, 2.0 / 3.0 * (1.0 - m)
        self.core = BALL.inertia * (p["inertia_split"] if closures.inertia == "table" else solid / (solid + thin))
        if self.rigid:
            self.core = 0.0
        self.shell = BALL.inertia - self.core
        # Either release leaves exp(-sigma t_c) of the core's speed, whatever its formula.
        sigma = -math.log(core_return) / contact_time
        self.k_y, self.c_y = p["k_y"], 2.0 * sigma * self.riding
        self.k = self.c = 0.0
        if not self.rigid:
            compliance = 1.0 / self.core + 1.0 / self.shell
            natural = math.sqrt(p["k_theta"] * compliance)
            w2 = p["k_y"] / self.riding - sigma**2
            zeta = p["zeta_theta"] if closures.torsion == "free" else math.sqrt(1.0 - w2 / natural**2)
            self.k, self.c = p["k_theta"], 2.0 * zeta * natural / compliance

    def forces(self, z):
        """Normal force and torque of the joint."""
        return self.k_y * z[0] + self.c_y * z[1], self.k * z[5] + self.c * (z[3] - z[4])

    def needed(self, z, eps):
        """Friction at zero slip."""
        force, torque = self.forces(z)
        return MASS * RADIUS * (torque - eps * force) / (self.shell + MASS * RADIUS**2)

    def ground(self, phase, z):
        """Normal force, friction, and the lever of the normal force."""
        force = self.forces(z)[0]
        if phase is Phase.FREE:
            return 0.0, 0.0, 0.0
        if phase is Phase.GRIP:
            return force, self.needed(z, self.eps), self.eps
        if phase is Phase.HOLD:
            return force, self.needed(z, 0.0), 0.0
        sign = 1.0 if phase is Phase.SLIDE_FORWARD else -1.0
        return force, -sign * self.mu * force, self.eps if self.in_slide else 0.0

    def rates(self, phase, z):
        force, torque = self.forces(z)
        normal, friction, lever = self.ground(phase, z)
        shell = (torque - RADIUS * friction - lever * normal) / self.shell
        core = shell if self.rigid else -torque / self.core
        return [z[1], -force / self.riding, friction / MASS, core, shell, z[3] - z[4]]

    def endings(self, phase):
        """What falls through zero where a phase ends: the normal force first."""
        if phase is Phase.FREE:
            return []
        ends = [lambda z: self.forces(z)[0]]
        if phase in (Phase.GRIP, Phase.HOLD):
            eps = self.eps if phase is Phase.GRIP else 0.0
            ends += [lambda z, s=s: self.mu * self.forces(z)[0] - s * self.needed(z, eps) for s in (1, -1)]
            if phase is Phase.HOLD:
                ends.append(lambda z: abs(self.needed(z, self.eps)) - self.mu * self.forces(z)[0])
        else:
            sign = 1.0 if phase is Phase.SLIDE_FORWARD else -1.0
            ends.append(lambda z: sign * (z[2] - RADIUS * z[4]))
        return ends

    def run(self, phase, time, z, until, ends, rtol, atol):
        """The solution from `time` to the first of `ends`, or `until`."""
        events = []
        for end in ends:
            # A zero that the phase starts on is not its end: an event needs a fall through zero.
            event = lambda _t, z, end=end: end(z)  # noqa: E731
            event.terminal, event.direction = True, -1.0
            events.append(event)
        return solve_ivp(
            lambda _t, z: self.rates(phase, z), (time, until), np.array(z), method="DOP853", rtol=rtol, atol=atol,
            events=events, dense_output=True, max_step=self.duration / 100.0,
        )  # fmt: skip
