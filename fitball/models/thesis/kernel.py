"""The bounce as Jafri (2004) computed it, slips included, as kernels: for reproduction, never as physics.

Every departure from the thesis's own equations is marked `SLIP` where it happens. All were found by recomputing
Appendix C; none contains a fitted number. In complex form: with `z = -sigma + i omega_dy` a pole of the vertical
motion the normal force is `F = Re(g e^{zt})`, and so is every course of the contact but for constants.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import compiled, compiled_allocating
from fitball.models.kernels.dual import Number, log, sqrt
from fitball.models.kernels.phases import append_phase, slide_phase
from fitball.models.types import GRIP, Status
from fitball.values import FloatArray

IntArray = NDArray[np.int64]
ByteArray = NDArray[np.int8]

COLUMNS = (
    "mass_ratio", "k_y", "k_theta", "mu", "eps", "c_y", "inertia_split", "ball_mass", "ball_radius", "ball_inertia"
)  # fmt: skip
(
    MASS_RATIO, K_Y, K_THETA, MU, EPS, C_Y, INERTIA_SPLIT, BALL_MASS, BALL_RADIUS, BALL_INERTIA,
) = range(len(COLUMNS))  # fmt: skip

OK = int(Status.OK)
COR_OUT_OF_RANGE = int(Status.COR_OUT_OF_RANGE)
TORSION_TOO_SOFT = int(Status.TORSION_TOO_SOFT)
DAMPING_OUT_OF_RANGE = int(Status.DAMPING_OUT_OF_RANGE)
RESONANCE = int(Status.RESONANCE)
NO_INERTIA = int(Status.NO_INERTIA)

DAMPING_GIVEN, DAMPING_CHAPTER_THREE, DAMPING_CHAPTER_FIVE = 0, 1, 2
# One lbf s^2 in in kg m^2, the unit in which a moment of inertia stands where a pure number should.
INERTIA_UNIT = 4.4482216152605 * 0.0254


class ThesisContact(NamedTuple):
    """All that decides one contact, SI; `sigma` is the decay of the vertical motion [1/s], `eps` the offset [m]."""

    mass: float
    radius: float
    inertia_core: float
    inertia_shell: float
    core_mass: float
    k_y: float
    sigma: float
    k_theta: float
    mu: float
    eps: float
    v_x: float
    v_y: float
    omega: float


class ThesisMotion(NamedTuple):
    """What describes one contact, NaN or 0 where `status` is not OK.

    While sliding `v_x(t) = v_x - Re(friction (e^{zt} - 1))`, `omega(t) = omega + Re(slide (e^{zt} - 1))`; from
    `t_r` (NaN: never) the ball rolls with `omega(t) = omega(t_r) + Re(roll (e^{zt} - e^{z t_r}))`, `v_x = R omega`,
    until `t_c` [s]. `sign` is the direction of the slip.
    """

    status: int
    sign: float
    z: complex
    friction: complex
    slide: complex
    roll: complex
    t_r: float
    t_c: float


@compiled
def thesis_damping(
    formula: int, c_y: Number, core_mass: Number, k_y: Number, mass_ratio: Number, cor: Number
) -> Number:
    """Decay rate `sigma = c_y/(2 M1)` of the vertical motion [1/s]; NaN where the formula has no solution.

    SLIP: by Eqs (5)-(7) the core leaves with `COR M/M1` of its speed, which exceeds 1 for nearly every impact.
    Chapter III and Appendix C took the inverse ratio, `(M1/M)/COR`; Chapter V `COR` itself.
    """
    natural_squared = k_y / core_mass
    if formula == DAMPING_GIVEN:
        sigma = 0.5 * c_y / core_mass
        return sigma if sigma.real * sigma.real < natural_squared.real else math.nan + 0.0 * sigma
    left = mass_ratio / cor if formula == DAMPING_CHAPTER_THREE else cor
    if not 0.0 < left.real <= 1.0:
        return math.nan + 0.0 * left
    decrement = -log(left) / math.pi
    return decrement * sqrt(natural_squared / (1.0 + decrement * decrement))


@compiled
def driven_spin(
    inertia_core: float,
    inertia_shell: float,
    k_theta: float,
    damped_squared: float,
    drive: float,
    z: complex,
    g: complex,
) -> complex:
    """Amplitude `q` of the shell's spin, `omega = const + Re(q e^{zt})`, under a torque `drive * F`; NaN if the
    joint is too soft for its damped frequency to equal the vertical one.

    `inertia_shell` is `I2` while sliding and `I2 + M R^2` while rolling.

    SLIP: only the particular solution of Eqs (32) and (46) is kept although it does not vanish at the start
    (Eq. 36 and the rolling restart), and its sign is that of the torque on the shell instead of the opposite.
    SLIP: the torque itself, which drives the shell most, is not among its terms (see `thesis_motion`).
    """
    reduced = inertia_core * inertia_shell / (inertia_core + inertia_shell)
    natural_squared = k_theta / reduced
    if not natural_squared >= damped_squared:
        return complex(math.nan, math.nan)
    damping = 2.0 * reduced * math.sqrt(natural_squared - damped_squared)
    pole = (reduced * z + damping) * z + k_theta
    # On the pole itself the amplitude is infinite; dividing by it would raise.
    if not abs(pole.real) + abs(pole.imag) > 0.0:
        return complex(math.inf, math.inf)
    twist = reduced * drive / inertia_shell * g / pole
    return twist * (damping + k_theta / z) / inertia_shell


@compiled
def first_sign_change(u0: float, h: complex, z: complex, end: float) -> float:
    """First `t` in (0, end] at which `u0 + Re(h (e^{zt} - 1))`, positive at 0, reaches zero; -1 if it does not.

    Within half a period the function has one extremum at most, in closed form; between it and the ends the function
    is monotone, and Newton's steps are kept inside the bracket by bisection.
    """
    hz = h * z
    w = z.imag
    extremum = (0.5 * math.pi - math.atan2(hz.imag, hz.real)) / w
    half = math.pi / w
    while extremum < 0.0:
        extremum += half
    while extremum > half:
        extremum -= half
    left = 0.0
    for k in range(2):
        right = extremum if k == 0 else end
        if right > end or right <= left:
            continue
        if u0 + (h * (exponential(z, right) - 1.0)).real <= 0.0:
            low, high = left, right
            t = 0.5 * (low + high)
            for _ in range(100):
                e = exponential(z, t)
                value = u0 + (h * (e - 1.0)).real
                if value > 0.0:
                    low = t
                else:
                    high = t
                slope = (hz * e).real
                step = t - value / slope if slope < 0.0 else high
                if not low < step < high:
                    step = 0.5 * (low + high)
                if abs(step - t) <= 2.3e-16 * end or not low < step < high:
                    break
                t = step
            return t
        left = right
    return -1.0


@compiled
def exponential(z: complex, t: float) -> complex:
    """`e^{zt}`."""
    magnitude = math.exp(z.real * t)
    return complex(magnitude * math.cos(z.imag * t), magnitude * math.sin(z.imag * t))


@compiled
def contact_of(row: FloatArray, sigma: float, v_x: float, v_y: float, omega: float) -> ThesisContact:
    """The contact of one impact for a row of `COLUMNS`."""
    inertia, split = row[BALL_INERTIA], row[INERTIA_SPLIT]
    return ThesisContact(
        row[BALL_MASS], row[BALL_RADIUS], split * inertia, (1.0 - split) * inertia, row[MASS_RATIO] * row[BALL_MASS],
        row[K_Y], sigma, row[K_THETA], row[MU], row[EPS], v_x, v_y, omega,
    )  # fmt: skip


@compiled
def thesis_motion(c: ThesisContact) -> ThesisMotion:
    """Amplitudes and times of one contact.

    SLIP: the friction torque enters the shell's spin multiplied by the reduced moment of inertia in lbf s^2 in, so
    that all but 0.02 % of it is lost; rolling has no such term at all.
    SLIP: rolling lasts to the end; the friction it needs is never compared with `mu F`.
    SLIP: rolling restarts without relative spin of core and shell, and with the clock still counting from landing.
    """
    nothing = complex(0.0, 0.0)
    damped_squared = c.k_y / c.core_mass - c.sigma * c.sigma
    frequency = math.sqrt(damped_squared)
    z = complex(-c.sigma, frequency)
    damping = 2.0 * c.core_mass * c.sigma
    g = complex(damping * c.v_y, -(c.k_y - damping * c.sigma) * c.v_y / frequency)
    t_c = math.pi / frequency
    slip = c.v_x - c.radius * c.omega
    sign = 1.0 if slip > 0.0 else -1.0
    friction = sign * c.mu / c.mass * g / z
    slide = driven_spin(c.inertia_core, c.inertia_shell, c.k_theta, damped_squared, sign * c.mu * c.radius, z, g)
    gyration = c.inertia_shell + c.mass * c.radius * c.radius
    roll = driven_spin(c.inertia_core, gyration, c.k_theta, damped_squared, -c.eps, z, g)
    if math.isnan(slide.real) or math.isnan(roll.real):
        return ThesisMotion(TORSION_TOO_SOFT, sign, nothing, nothing, nothing, nothing, math.nan, math.nan)
    if not (math.isfinite(slide.real) and math.isfinite(roll.real)):
        return ThesisMotion(RESONANCE, sign, nothing, nothing, nothing, nothing, math.nan, math.nan)
    reduced = c.inertia_core * c.inertia_shell / (c.inertia_core + c.inertia_shell)
    slide += reduced / INERTIA_UNIT * sign * c.mu * c.radius / c.inertia_shell * g / z
    t_r = first_sign_change(sign * slip, -sign * (friction + c.radius * slide), z, t_c)
    return ThesisMotion(OK, sign, z, friction, slide, roll, t_r if t_r >= 0.0 else math.nan, t_c)


@compiled
def stray_impulse(core_mass: float, sigma: float, v_y: float, z: complex, end: complex) -> float:
    """Impulse that no force made, `end` being `e^{z t_c}`.

    SLIP: at the end of a contact that slides throughout, not on the way to it, the damper's share of Eq. (73) has a
    cosine beside its sine; `c_y` times displacement should be zero there.
    """
    return 2.0 * core_mass * sigma * v_y * sigma / (z.imag * z.imag) * -end.real


@compiled
def thesis_bounce(
    row: FloatArray, damping_formula: int, cor: float, v_x: float, v_y: float, omega: float
) -> tuple[int, float, float, float, float, int]:
    """Return `(status, v_x2, v_y2, omega_2, contact_time, regime)`; `row` as in `thesis_batch`."""
    if not 0.0 < cor <= 1.0:
        return COR_OUT_OF_RANGE, math.nan, math.nan, math.nan, math.nan, 0
    core_mass = row[MASS_RATIO] * row[BALL_MASS]
    sigma = thesis_damping(damping_formula, row[C_Y], core_mass, row[K_Y], row[MASS_RATIO], cor)
    if math.isnan(sigma):
        return DAMPING_OUT_OF_RANGE, math.nan, math.nan, math.nan, math.nan, 0
    if not 0.0 < row[INERTIA_SPLIT] < 1.0:
        return NO_INERTIA, math.nan, math.nan, math.nan, math.nan, 0
    motion = thesis_motion(contact_of(row, sigma, v_x, v_y, omega))
    if motion.status != OK:
        return motion.status, math.nan, math.nan, math.nan, math.nan, 0
    regime = append_phase(0, 0, slide_phase(motion.sign))
    end = exponential(motion.z, motion.t_c)
    # SLIP: the rebound velocity is not that of Eqs (5)-(7) but each impact's measured restitution.
    v_y2 = cor * v_y
    if math.isnan(motion.t_r):
        stray = motion.sign * row[MU] / row[BALL_MASS] * stray_impulse(core_mass, sigma, v_y, motion.z, end)
        v_x2 = v_x - (motion.friction * (end - 1.0)).real - stray
        return OK, v_x2, v_y2, omega + (motion.slide * (end - 1.0)).real, motion.t_c, regime
    start = exponential(motion.z, motion.t_r)
    omega_2 = omega + (motion.slide * (start - 1.0)).real + (motion.roll * (end - start)).real
    return OK, row[BALL_RADIUS] * omega_2, v_y2, omega_2, motion.t_c, append_phase(regime, 1, GRIP)


@compiled_allocating
def thesis_batch(
    rows: FloatArray,
    eps: FloatArray,
    damping_formula: int,
    cor: FloatArray,
    v_x1: FloatArray,
    v_y1: FloatArray,
    omega_1: FloatArray,
    out: FloatArray,
    regime: IntArray,
    status: ByteArray,
) -> None:
    """Fill `out` (4, draws, impacts) with v_x2, v_y2, omega_2, contact_time, and regimes and statuses.

    `rows` (draws, columns) as named by `COLUMNS`, of which EPS is set here; `eps`, `cor` (draws, impacts); the
    incident columns the same or (1, impacts), shared by all draws.
    """
    row = np.empty(rows.shape[1])
    for i in range(rows.shape[0]):
        row[:] = rows[i]
        own = i if v_x1.shape[0] > 1 else 0
        for j in range(v_x1.shape[1]):
            row[EPS] = eps[i, j]
            status[i, j], v_x2, v_y2, omega_2, time, phases = thesis_bounce(
                row, damping_formula, cor[i, j], v_x1[own, j], v_y1[own, j], omega_1[own, j]
            )
            out[0, i, j] = v_x2
            out[1, i, j] = v_y2
            out[2, i, j] = omega_2
            out[3, i, j] = time
            regime[i, j] = phases
