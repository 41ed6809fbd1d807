"""Balls that are not fitball's: simulators of a bounce written from the literature.

Each takes incident motions and its own parameters, SI, and gives the motions after the bounce. None
calls code of fitball. `v_y` is towards the court before and away from it after the bounce, topspin
is positive, as in fitball.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, NamedTuple

import numpy as np
from scipy.optimize import brentq

from fitball.base.values import BoolArray, FloatArray

# A tennis ball: mass [kg], radius [m], moment of inertia over m r^2, and itself [kg m^2].
MASS = 0.0576
RADIUS = 0.03302
INERTIA_RATIO = 0.55
INERTIA = INERTIA_RATIO * MASS * RADIUS**2
# By how much an impulse along the court changes the slip of a rigid ball [1/kg].
MOBILITY = 1.0 / MASS + RADIUS**2 / INERTIA
# Steps of impulse or time.
IMPULSE_STEPS = 2_000
TIME_STEPS = 6_000
# Steps of the elastic sphere, and its rings.
SPHERE_STEPS = 240
RINGS = 16
# Rounds in which rings are sorted into those that stick and slip.
SORTING_ROUNDS = 30


class Motion(NamedTuple):
    """Velocities [m/s] along and across the court, and spin [rad/s], each (impacts,)."""

    v_x: Annotated[FloatArray, "impacts"]
    v_y: Annotated[FloatArray, "impacts"]
    spin: Annotated[FloatArray, "impacts"]

    @property
    def slip(self) -> Annotated[FloatArray, "impacts"]:
        """Velocity of the contact point along the court [m/s]."""
        return self.v_x - RADIUS * self.spin

    def pushed(self, along: FloatArray, normal: FloatArray, offset: float = 0.0) -> Motion:
        """The motion after an impulse `along` the court and one `normal` to it [kg m/s], which acts
        `offset` [m] ahead of the centre.
        """
        turn = RADIUS * along + offset * normal
        v_x = self.v_x + along / MASS
        return Motion(v_x, normal / MASS - self.v_y, self.spin - turn / INERTIA)


def grip_slip(
    incident: Motion,
    mu: float,
    tangential: float,
    offset: float,
    cor_10: float,
    cor_slope: float,
) -> Motion:
    """A ball that slides, or grips and lets go with a `tangential` restitution; restitution is a
    line in the speed (Cross 2002, Am. J. Phys. 70, 1093).
    """
    restitution = cor_10 + cor_slope * (incident.v_y - 10.0)
    normal = MASS * (1.0 + restitution) * incident.v_y
    return _struck(incident, normal, mu, tangential, offset)


def power_law(
    incident: Motion,
    mu: float,
    tangential: float,
    cor_10: float,
    power: float,
) -> Motion:
    """Coulomb friction and a restitution that falls as a power of the speed: a fourth root for
    bodies that yield (Johnson 1985, Contact Mechanics, section 11.5), less for balls.
    """
    restitution = cor_10 * (incident.v_y / 10.0) ** -power
    normal = MASS * (1.0 + restitution) * incident.v_y
    return _struck(incident, normal, mu, tangential, 0.0)


def _struck(
    incident: Motion,
    normal: FloatArray,
    mu: float,
    tangential: float,
    offset: float,
) -> Motion:
    """A rigid ball after a `normal` impulse (impacts,) [kg m/s]: friction reverses its slip but for
    a `tangential` restitution, if it can (Walton 1993).
    """
    ahead = RADIUS * offset * normal / INERTIA
    wanted = -((1.0 + tangential) * incident.slip + ahead) / MOBILITY
    return incident.pushed(np.clip(wanted, -mu * normal, mu * normal), normal, offset)


def falling_friction(
    incident: Motion,
    mu_slow: float,
    mu_fast: float,
    speed: float,
    cor_10: float,
    cor_slope: float,
) -> Motion:
    """A rigid ball whose friction goes from `mu_slow` to `mu_fast` as the slip exceeds a `speed`
    [m/s] (Stribeck's curve; Olsson et al. 1998, Eur. J. Control 4, 176). It slides until it rolls,
    as the normal impulse grows (Stronge 2000, Impact Mechanics, ch. 3).
    """
    restitution = cor_10 + cor_slope * (incident.v_y - 10.0)
    normal = MASS * (1.0 + restitution) * incident.v_y
    part = normal / IMPULSE_STEPS
    slip = incident.slip
    along = np.zeros_like(slip)
    for _ in range(IMPULSE_STEPS):
        mu = mu_fast + (mu_slow - mu_fast) * np.exp(-np.abs(slip) / speed)
        push = np.clip(-slip / MOBILITY, -mu * part, mu * part)
        slip = slip + MOBILITY * push
        along = along + push
    return incident.pushed(along, normal)


def hunt_crossley(
    incident: Motion,
    mu: float,
    stiffness: float,
    loss: float,
    ratio: float,
    damping: float,
) -> Motion:
    """A ball with the force k d^1.5 (1 + loss d') at a compression d (Hunt and Crossley 1975, J.
    Appl. Mech. 42, 440). Along the court it has a spring, with `ratio` times the normal stiffness
    at 2 mm and a share of critical `damping`, which slips at Coulomb's limit (Cundall and Strack
    1979, Geotechnique 29, 47).
    """
    spring = ratio * 1.5 * stiffness * np.sqrt(2e-3)
    damper = 2.0 * damping * np.sqrt(spring / MOBILITY)
    step = 2.5 * _hertz_time(incident.v_y, stiffness) / TIME_STEPS
    speed = incident.v_y.copy()
    compression = np.zeros_like(speed)
    stretch = np.zeros_like(speed)
    motion = incident
    for _ in range(TIME_STEPS):
        compression = compression + speed * step
        touches = compression > 0.0
        force = _hunt_crossley_force(compression, speed, stiffness, loss)
        speed = speed - force / MASS * step
        slip = motion.slip
        trial = -spring * (stretch + slip * step) - damper * slip
        along = np.clip(trial, -mu * force, mu * force)
        # Where it slips, the spring keeps what friction holds.
        stretch = np.where(touches, -(along + damper * slip) / spring, 0.0)
        motion = motion._replace(
            v_x=motion.v_x + along / MASS * step,
            spin=motion.spin - RADIUS * along / INERTIA * step,
        )
    return motion._replace(v_y=-speed)


def _hunt_crossley_force(
    compression: FloatArray,
    speed: FloatArray,
    stiffness: float,
    loss: float,
) -> FloatArray:
    """The normal force (impacts,) [N], never a pull."""
    pressed = np.maximum(compression, 0.0)
    return np.maximum(stiffness * pressed**1.5 * (1.0 + loss * speed), 0.0)


def _hertz_time(speed: FloatArray, stiffness: float) -> FloatArray:
    """The contact time (impacts,) [s] of an elastic sphere with the force k d^1.5."""
    deepest = (1.25 * MASS * speed**2 / stiffness) ** 0.4
    return 2.9432 * deepest / speed


def elastic_sphere(
    incident: Motion,
    mu: float,
    stiffness: float,
    loss: float,
    poisson: float,
) -> Motion:
    """An elastic sphere in Hertzian contact with a rigid court, of rings that stick or slip each by
    itself (Maw, Barber and Fawcett 1976, Wear 38, 101). The normal force is Hertz's with the loss
    of Hunt and Crossley.

    Tractions are sums of c_j sqrt(a_j^2 - r^2) on discs of radius a_j; lengths are in radii of the
    largest contact.
    """
    compressions, forces, step = _normal_history(incident.v_y, stiffness, loss)
    largest = np.sqrt(RADIUS * compressions.max(axis=0))
    edges = np.arange(1, RINGS + 1) / RINGS
    middles = edges - 0.5 / RINGS
    traction_of, displacement_of = _disc_matrices(middles, edges)
    pushes = 2.0 * np.pi / 3.0 * edges**3
    # Of both bodies E/(1 - nu^2) follows from Hertz's stiffness, and the shear modulus from that.
    modulus = 0.75 * stiffness / np.sqrt(RADIUS)
    shear = 0.5 * modulus * (1.0 - poisson)
    compliance = (2.0 - poisson) / (8.0 * shear) * largest[:, None]
    displacement = np.zeros((len(largest), RINGS))
    motion = incident
    for compression, force in zip(compressions, forces, strict=True):
        radius = np.sqrt(RADIUS * np.maximum(compression, 0.0)) / largest
        limit = mu * _hertz_pressure(radius, middles)
        # Scaled so that all rings together have the friction of the whole force.
        together = np.linalg.solve(traction_of, limit.T).T @ pushes * largest**2
        limit *= (mu * force / np.maximum(together, 1e-12))[:, None]
        moved = (motion.slip * step)[:, None]
        weights = _ring_weights(
            (displacement - moved) / compliance,
            limit,
            middles < radius[:, None],
            traction_of,
            displacement_of,
        )
        displacement = compliance * (weights @ displacement_of.T)
        along = weights @ pushes * largest**2
        motion = motion._replace(
            v_x=motion.v_x + along / MASS * step,
            spin=motion.spin - RADIUS * along / INERTIA * step,
        )
    normal = np.sum(forces * step, axis=0)
    return motion._replace(v_y=normal / MASS - incident.v_y)


def _normal_history(
    speed: FloatArray,
    stiffness: float,
    loss: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean compressions and forces of SPHERE_STEPS steps (steps, impacts), and the length of these
    (impacts,) [s].
    """
    inner = TIME_STEPS // SPHERE_STEPS
    fine = 1.6 * _hertz_time(speed, stiffness) / (SPHERE_STEPS * inner)
    compression = np.zeros_like(speed)
    velocity = speed.copy()
    compressions = []
    forces = []
    for _ in range(SPHERE_STEPS * inner):
        compression = compression + velocity * fine
        force = _hunt_crossley_force(compression, velocity, stiffness, loss)
        velocity = velocity - force / MASS * fine
        compressions.append(compression)
        forces.append(force)
    shape = (SPHERE_STEPS, inner, len(speed))
    means = [np.reshape(history, shape).mean(axis=1) for history in (compressions, forces)]
    return means[0], means[1], fine * inner


def _hertz_pressure(radius: FloatArray, middles: FloatArray) -> FloatArray:
    """Hertz's pressure (impacts, rings) at the middles of rings over that at the centre, for
    contacts of a `radius` (impacts,).
    """
    inside = 1.0 - (middles / np.maximum(radius, 1e-12)[:, None]) ** 2
    return np.asarray(np.sqrt(np.maximum(inside, 0.0)))


def _disc_matrices(r: FloatArray, a: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Traction and displacement (rings, discs) at r by tractions sqrt(a^2 - r^2) on discs of radius
    a. The displacement is that of a normal pressure of this form, in units of compliance (Johnson
    1985, eqs 3.41 and 3.42), as Maw, Barber and Fawcett take it.
    """
    r = r[:, None]
    inside = r < a
    traction = np.sqrt(np.where(inside, a**2 - r**2, 0.0))
    share = np.minimum(a / r, 1.0)
    bent = (2.0 * a**2 - r**2) * np.arcsin(share) + r * a * np.sqrt(1.0 - share**2)
    return traction, np.where(inside, 0.5 * np.pi * (2.0 * a**2 - r**2), bent)


def _ring_weights(
    sticking: FloatArray,
    limit: FloatArray,
    touches: BoolArray,
    traction_of: FloatArray,
    displacement_of: FloatArray,
) -> FloatArray:
    """Weights (impacts, discs) with which each ring that `touches` has the displacement of
    `sticking`, or slips at the `limit` of its traction against its motion.
    """
    slips = np.zeros(limit.shape)
    for _ in range(SORTING_ROUNDS):
        holds = touches & (slips == 0.0)
        matrices = np.where(holds[:, :, None], displacement_of, traction_of)
        wanted = np.where(holds, sticking, np.where(touches, slips * limit, 0.0))
        weights = np.linalg.solve(matrices, wanted[:, :, None])[:, :, 0]
        traction = weights @ traction_of.T
        moved = weights @ displacement_of.T - sticking
        too_much = holds & (np.abs(traction) > limit)
        # Friction that pushes along with the slip holds instead.
        along = touches & (slips != 0.0) & (moved * slips > 0.0)
        if not (too_much | along).any():
            break
        slips = np.where(too_much, np.sign(traction), np.where(along, 0.0, slips))
    return weights


def two_masses(
    incident: Motion,
    mass_ratio: float,
    k_y: float,
    k_theta: float,
    mu: float,
    eps_10: float,
    eps_slope: float,
    cor_10: float,
    cor_slope: float,
) -> Motion:
    """Jafri's ball of a core and a shell (2004) with the choices of the model `two-mass`, a second
    time: by small impulses (Moreau 1988), each of which stops the slip if friction can.
    """
    core = MASS * mass_ratio
    share = 0.4 * 0.97**2 * mass_ratio
    share = share / (share + 2.0 / 3.0 * (1.0 - mass_ratio))
    inner = share * INERTIA
    outer = INERTIA - inner
    offset = eps_10 + eps_slope * (incident.v_y - 10.0)
    restitution = _saturating(incident.v_y, mass_ratio, cor_10, cor_slope)
    half_turn = np.array([_half_turn(-np.log(e)) for e in (restitution / mass_ratio).tolist()])
    rate = np.sqrt(k_y / core)
    damping = np.cos(half_turn)
    twist_rate = np.sqrt(k_theta * (1.0 / inner + 1.0 / outer))
    twist_damping = np.sqrt(1.0 - (rate * np.sin(half_turn) / twist_rate) ** 2)
    c_theta = 2.0 * twist_damping * k_theta / twist_rate
    v_x = incident.v_x
    spin_inner = incident.spin
    spin_outer = incident.spin
    mobility = 1.0 / MASS + RADIUS**2 / outer
    twist = np.zeros_like(v_x)
    depth = np.zeros_like(v_x)
    speed = incident.v_y.copy()
    step = 2.0 * half_turn / np.sin(half_turn) / rate / TIME_STEPS
    landing = (MASS - core) * incident.v_y / IMPULSE_STEPS
    for k in range(IMPULSE_STEPS + TIME_STEPS):
        torque = np.zeros_like(v_x)
        push = landing
        if k >= IMPULSE_STEPS:
            torque = (k_theta * twist + c_theta * (spin_inner - spin_outer)) * step
            depth, before, speed = _oscillated(depth, speed, rate, damping, step)
            push = np.maximum(core * (before - speed), 0.0)
        turned = spin_outer + (torque - offset * push) / outer
        along = np.clip(-(v_x - RADIUS * turned) / mobility, -mu * push, mu * push)
        v_x = v_x + along / MASS
        spin_outer = turned - RADIUS * along / outer
        spin_inner = spin_inner - torque / inner
        if k >= IMPULSE_STEPS:
            twist = twist + (spin_inner - spin_outer) * step
    return Motion(v_x, restitution * incident.v_y, share * spin_inner + (1.0 - share) * spin_outer)


def _oscillated(
    depth: FloatArray,
    speed: FloatArray,
    rate: float,
    damping: FloatArray,
    step: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Depth, the speed before, and the speed after a step of a damped oscillator, by midpoint."""
    half_speed = speed - 0.5 * step * (rate**2 * depth + 2.0 * damping * rate * speed)
    half_depth = depth + 0.5 * step * speed
    after = speed - step * (rate**2 * half_depth + 2.0 * damping * rate * half_speed)
    return depth + step * half_speed, speed, after


def _half_turn(loss: float) -> float:
    """The beta with 2 beta cot(beta) = -ln e, which damps a contact that ends without force."""

    def excess(beta: float) -> float:
        return float(2.0 * beta / np.tan(beta) - loss)

    return float(brentq(excess, 1e-9, 0.5 * np.pi))


def _saturating(
    speed: FloatArray,
    largest: float,
    cor_10: float,
    cor_slope: float,
) -> FloatArray:
    """Restitution (impacts,) by the law [1 + (v/v0)^q]^(-1/q) of a value and slope at 10 m/s."""
    falling = -10.0 * cor_slope / cor_10
    power = np.log1p(-falling) / np.log(cor_10 / largest)
    odds = falling / (1.0 - falling) * (speed / 10.0) ** power
    return np.asarray(largest * (1.0 + odds) ** (-1.0 / power))


def restitution_at(
    simulate: Callable[[Motion], Motion],
    speed: float,
) -> float:
    """The restitution of a simulated ball straight down at a speed [m/s]."""
    still = np.zeros(1)
    after = simulate(Motion(still, np.array([speed]), still))
    return float(after.v_y[0] / speed)
