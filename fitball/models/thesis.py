"""The bounce as Jafri (2004) computed it, mistakes included: for reproduction, never as physics.

Every departure from the thesis's own equations is marked `SLIP` where it happens. All were found by recomputing
Appendix C; none contains a fitted number. In complex form: with `z = -sigma + i omega_dy` a pole of the vertical
motion the normal force is `F = Re(g e^{zt})`, and so is every course of the contact but for constants. A derivative
needs a second imaginary unit: a complex quantity is held as its real and imaginary part, each a number that carries a
derivative (`kernels.dual`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Generic, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import compiled, inner
from fitball.models.kernels.contact import ANCHOR_SPEED, tied_inertia_split
from fitball.models.kernels.dual import Number, NumberArray, carry, cos, exp, log, sin, sqrt
from fitball.models.kernels.phases import append_phase, slide_phase
from fitball.models.model import Bounced, States, SteppedModel
from fitball.models.specs import specs
from fitball.models.types import GRIP, Damping, Status, ThesisClosures
from fitball.values import Ball, FloatArray, Impacts

COLUMNS = (
    "mass_ratio", "k_y", "k_theta", "mu", "eps_10", "eps_slope", "cor_10", "cor_slope", "c_y", "inertia_split",
    "ball_mass", "ball_radius", "ball_inertia",
)  # fmt: skip
(
    MASS_RATIO, K_Y, K_THETA, MU, EPS_10, EPS_SLOPE, COR_10, COR_SLOPE, C_Y, INERTIA_SPLIT,
    BALL_MASS, BALL_RADIUS, BALL_INERTIA,
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


class Pair(NamedTuple, Generic[Number]):
    """A complex number: real and imaginary part, each with what it carries."""

    re: Number
    im: Number


class ThesisContact(NamedTuple, Generic[Number]):
    """All that decides one contact, SI; `sigma` is the decay of the vertical motion [1/s], `eps` the offset [m]."""

    mass: Number
    radius: Number
    inertia_core: Number
    inertia_shell: Number
    core_mass: Number
    k_y: Number
    sigma: Number
    k_theta: Number
    mu: Number
    eps: Number
    v_x: Number
    v_y: Number
    omega: Number


class ThesisMotion(NamedTuple, Generic[Number]):
    """What describes one contact, NaN or 0 where `status` is not OK.

    While sliding `v_x(t) = v_x - Re(friction (e^{zt} - 1))`, `omega(t) = omega + Re(slide (e^{zt} - 1))`; from
    `t_r` (NaN: never) the ball rolls with `omega(t) = omega(t_r) + Re(roll (e^{zt} - e^{z t_r}))`, `v_x = R omega`,
    until `t_c` [s]. `sign` is the direction of the slip.
    """

    status: int
    sign: float
    z: Pair[Number]
    friction: Pair[Number]
    slide: Pair[Number]
    roll: Pair[Number]
    t_r: Number
    t_c: Number


@inner
def times(x: Pair[Number], y: Pair[Number]) -> Pair[Number]:
    """Product."""
    return Pair(x.re * y.re - x.im * y.im, x.re * y.im + x.im * y.re)


@inner
def over(x: Pair[Number], y: Pair[Number]) -> Pair[Number]:
    """Quotient."""
    square = y.re * y.re + y.im * y.im
    return Pair((x.re * y.re + x.im * y.im) / square, (x.im * y.re - x.re * y.im) / square)


@inner
def scaled(factor: Number, x: Pair[Number]) -> Pair[Number]:
    """A real multiple."""
    return Pair(factor * x.re, factor * x.im)


@inner
def power(z: Pair[Number], t: Number) -> Pair[Number]:
    """`e^{zt}`."""
    envelope = exp(z.re * t)
    return Pair(envelope * cos(z.im * t), envelope * sin(z.im * t))


@inner
def gained(amplitude: Pair[Number], early: Pair[Number], late: Pair[Number]) -> Number:
    """`Re(amplitude (late - early))`."""
    return amplitude.re * (late.re - early.re) - amplitude.im * (late.im - early.im)


@inner
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


@inner
def driven_spin(
    inertia_core: Number,
    inertia_shell: Number,
    k_theta: Number,
    damped_squared: Number,
    drive: Number,
    z: Pair[Number],
    g: Pair[Number],
) -> tuple[int, Pair[Number]]:
    """Status and amplitude `q` of the shell's spin, `omega = const + Re(q e^{zt})`, under a torque `drive * F`.

    There is none if the joint is too soft for its damped frequency to equal the vertical one, or if `z` is its pole.
    `inertia_shell` is `I2` while sliding and `I2 + M R^2` while rolling.

    SLIP: only the particular solution of Eqs (32) and (46) is kept although it does not vanish at the start
    (Eq. 36 and the rolling restart), and its sign is that of the torque on the shell instead of the opposite.
    SLIP: the torque itself, which drives the shell most, is not among its terms (see `thesis_motion`).
    """
    reduced = inertia_core * inertia_shell / (inertia_core + inertia_shell)
    natural_squared = k_theta / reduced
    if not natural_squared.real >= damped_squared.real:
        return TORSION_TOO_SOFT, g
    damping = 2.0 * reduced * sqrt(natural_squared - damped_squared)
    square = times(z, z)
    pole = Pair(reduced * square.re + damping * z.re + k_theta, reduced * square.im + damping * z.im)
    if not abs(pole.re.real) + abs(pole.im.real) > 0.0:
        return RESONANCE, g
    stiffness = over(Pair(k_theta, 0.0 * k_theta), z)
    twist = times(over(g, pole), Pair(damping + stiffness.re, stiffness.im))
    return OK, scaled(reduced * drive / (inertia_shell * inertia_shell), twist)


@inner
def first_sign_change(u0: float, h: Pair[float], z: Pair[float], end: float) -> float:
    """First `t` in (0, end] at which `u0 + Re(h (e^{zt} - 1))`, positive at 0, reaches zero; -1 if it does not.

    Within half a period the function has one extremum at most, in closed form; between it and the ends the function
    is monotone, and Newton's steps are kept inside the bracket by bisection.
    """
    hz, one, nothing = times(h, z), Pair(1.0, 0.0), Pair(0.0, 0.0)
    w = z.im
    extremum = (0.5 * math.pi - math.atan2(hz.im, hz.re)) / w
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
        if u0 + gained(h, one, power(z, right)) <= 0.0:
            low, high = left, right
            t = 0.5 * (low + high)
            for _ in range(100):
                e = power(z, t)
                value = u0 + gained(h, one, e)
                if value > 0.0:
                    low = t
                else:
                    high = t
                slope = gained(hz, nothing, e)
                step = t - value / slope if slope < 0.0 else high
                if not low < step < high:
                    step = 0.5 * (low + high)
                if abs(step - t) <= 2.3e-16 * end or not low < step < high:
                    break
                t = step
            return t
        left = right
    return -1.0


@inner
def first_stop(u0: Number, h: Pair[Number], z: Pair[Number], end: Number) -> Number:
    """`first_sign_change` with what its arguments carry; NaN where there is none."""
    t = first_sign_change(u0.real, Pair(h.re.real, h.im.real), Pair(z.re.real, z.im.real), end.real)
    if t < 0.0:
        return math.nan + 0.0 * u0
    e = power(z, t + 0.0 * u0)
    value = u0 + gained(h, Pair(1.0 + 0.0 * u0, 0.0 * u0), e)
    slope = gained(times(h, z), Pair(0.0 * u0, 0.0 * u0), e)
    return carry(t, value, -1.0 / slope.real)


@inner
def thesis_contact(row: NumberArray, sigma: Number, v_x: Number, v_y: Number, omega: Number) -> ThesisContact[Number]:
    """The contact of one impact for a row of `COLUMNS`."""
    inertia, split = row[BALL_INERTIA], row[INERTIA_SPLIT]
    eps = row[EPS_10] + row[EPS_SLOPE] * (v_y - ANCHOR_SPEED)
    return ThesisContact(
        row[BALL_MASS], row[BALL_RADIUS], split * inertia, (1.0 - split) * inertia, row[MASS_RATIO] * row[BALL_MASS],
        row[K_Y], sigma, row[K_THETA], row[MU], eps, v_x, v_y, omega,
    )  # fmt: skip


@compiled
def thesis_motion(c: ThesisContact[Number]) -> ThesisMotion[Number]:
    """Amplitudes and times of one contact.

    SLIP: the friction torque enters the shell's spin multiplied by the reduced moment of inertia in lbf s^2 in, so
    that all but 0.02 % of it is lost; rolling has no such term at all.
    SLIP: rolling lasts to the end; the friction it needs is never compared with `mu F`.
    SLIP: rolling restarts without relative spin of core and shell, and with the clock still counting from landing.
    """
    damped_squared = c.k_y / c.core_mass - c.sigma * c.sigma
    frequency = sqrt(damped_squared)
    z = Pair(-c.sigma, frequency)
    damping = 2.0 * c.core_mass * c.sigma
    g = Pair(damping * c.v_y, -(c.k_y - damping * c.sigma) * c.v_y / frequency)
    t_c = math.pi / frequency
    slip = c.v_x - c.radius * c.omega
    sign = 1.0 if slip.real > 0.0 else -1.0
    impulse = over(g, z)
    friction = scaled(sign * c.mu / c.mass, impulse)
    drive = sign * c.mu * c.radius
    status, slide = driven_spin(c.inertia_core, c.inertia_shell, c.k_theta, damped_squared, drive, z, g)
    gyration = c.inertia_shell + c.mass * c.radius * c.radius
    rolling, roll = driven_spin(c.inertia_core, gyration, c.k_theta, damped_squared, -c.eps, z, g)
    if status == OK or rolling == TORSION_TOO_SOFT:
        status = rolling
    if status != OK:
        nothing, none = Pair(0.0 * slip, 0.0 * slip), math.nan + 0.0 * slip
        return ThesisMotion(status, sign, nothing, nothing, nothing, nothing, none, none)
    leak = scaled(c.inertia_core / (c.inertia_core + c.inertia_shell) / INERTIA_UNIT * drive, impulse)
    slide = Pair(slide.re + leak.re, slide.im + leak.im)
    slipping = Pair(friction.re + c.radius * slide.re, friction.im + c.radius * slide.im)
    t_r = first_stop(sign * slip, scaled(-sign + 0.0 * slip, slipping), z, t_c)
    return ThesisMotion(OK, sign, z, friction, slide, roll, t_r, t_c)


@inner
def stray_impulse(core_mass: Number, v_y: Number, z: Pair[Number], end: Pair[Number]) -> Number:
    """Impulse that no force made, `end` being `e^{z t_c}`.

    SLIP: at the end of a contact that slides throughout, not on the way to it, the damper's share of Eq. (73) has a
    cosine beside its sine; `c_y` times displacement should be zero there.
    """
    return -2.0 * core_mass * z.re * z.re * v_y / (z.im * z.im) * end.re


@inner
def unsolved(status: int, like: Number) -> tuple[int, Number, Number, Number, Number, int]:
    """The bounce of an impact that cannot be evaluated."""
    none = math.nan + 0.0 * like
    return status, none, none, none, none, 0


@inner
def thesis_bounce(
    row: NumberArray, damping_formula: int, cor: Number, v_x: Number, v_y: Number, omega: Number
) -> tuple[int, Number, Number, Number, Number, int]:
    """Return `(status, v_x2, v_y2, omega_2, contact_time, regime)`; `row` as in `thesis_batch`."""
    if not 0.0 < cor.real <= 1.0:
        return unsolved(COR_OUT_OF_RANGE, v_y)
    core_mass = row[MASS_RATIO] * row[BALL_MASS]
    sigma = thesis_damping(damping_formula, row[C_Y], core_mass, row[K_Y], row[MASS_RATIO], cor)
    if math.isnan(sigma.real):
        return unsolved(DAMPING_OUT_OF_RANGE, v_y)
    if not 0.0 < row[INERTIA_SPLIT].real < 1.0:
        return unsolved(NO_INERTIA, v_y)
    motion = thesis_motion(thesis_contact(row, sigma, v_x, v_y, omega))
    if motion.status != OK:
        return unsolved(motion.status, v_y)
    regime = append_phase(0, 0, slide_phase(motion.sign))
    one, end = Pair(1.0 + 0.0 * v_y, 0.0 * v_y), power(motion.z, motion.t_c)
    # SLIP: the rebound velocity is not that of Eqs (5)-(7) but each impact's measured restitution.
    v_y2 = cor * v_y
    if math.isnan(motion.t_r.real):
        stray = motion.sign * row[MU] / row[BALL_MASS] * stray_impulse(core_mass, v_y, motion.z, end)
        v_x2 = v_x - gained(motion.friction, one, end) - stray
        return OK, v_x2, v_y2, omega + gained(motion.slide, one, end), motion.t_c, regime
    start = power(motion.z, motion.t_r)
    omega_2 = omega + gained(motion.slide, one, start) + gained(motion.roll, start, end)
    return OK, row[BALL_RADIUS] * omega_2, v_y2, omega_2, motion.t_c, append_phase(regime, 1, GRIP)


@compiled
def thesis_batch(
    rows: NumberArray,
    codes: NDArray[np.int64],
    v_x1: NumberArray,
    v_y1: NumberArray,
    omega_1: NumberArray,
    cor: NumberArray,
    out: NumberArray,
    regime: NDArray[np.int64],
    status: NDArray[np.int8],
) -> None:
    """Fill `out` (4, draws, impacts) with v_x2, v_y2, omega_2, contact_time, and regimes and statuses.

    All are one kind of number, real or complex. `rows` (draws, columns) as named by `COLUMNS`; the incident columns
    are (draws, impacts), or (1, impacts), shared by all draws. `codes`: the formula of the damping, and whether `cor`
    is each impact's restitution, instead of the line.
    """
    for i in range(rows.shape[0]):
        row = rows[i]
        own = i if v_x1.shape[0] > 1 else 0
        for j in range(v_x1.shape[1]):
            v_y = v_y1[own, j]
            told = cor[own, j] if codes[1] != 0 else row[COR_10] + row[COR_SLOPE] * (v_y - ANCHOR_SPEED)
            status[i, j], v_x2, v_y2, omega_2, time, phases = thesis_bounce(
                row, codes[0], told, v_x1[own, j], v_y, omega_1[own, j]
            )
            out[0, i, j], out[1, i, j], out[2, i, j], out[3, i, j] = v_x2, v_y2, omega_2, time
            regime[i, j] = phases


# By its place among the options.
DAMPINGS = get_args(Damping)
ALWAYS = ("mass_ratio", "k_y", "k_theta", "mu", "eps_10", "eps_slope")


def thesis_parameters(closures: ThesisClosures) -> tuple[str, ...]:
    """Names of the parameters of a composition."""
    wanted = {
        "cor_10": closures.cor != "measured",
        "cor_slope": closures.cor == "line",
        "inertia_split": closures.inertia == "table",
        "c_y": closures.damping == "given",
    }
    return (*ALWAYS, *(name for name, present in wanted.items() if present))


@dataclass(frozen=True)
class ThesisCourse:
    """Horizontal velocity, surface velocity `R omega_2` [m/s] and shell spin [rad/s] at `times` (times,) [s].

    `transition` [s] is when rolling begins, NaN if it does not.
    """

    times: FloatArray
    v_x: FloatArray
    surface: FloatArray
    omega_2: FloatArray
    transition: float
    contact_time: float


@dataclass(frozen=True)
class ThesisModel(SteppedModel):
    """The bounce as the thesis computed it: the printed numbers, which violate balances, so it is not ranked."""

    has_time = True
    no_history = (
        "has no history: forces and spins of the printed computation violate its own equations; `course` gives the "
        "computed velocities"
    )
    remark = (
        "model thesis reproduces a printed computation with its mistakes, which violate the balances of the ball: do "
        "not compare it with the other models"
    )
    unranked = (
        "model thesis reproduces a printed computation with its mistakes and is not ranked. Its published parameter "
        "sets are scored on Wang's tables; thesis-exact solves its equations"
    )

    convention = "thesis"
    kernel = staticmethod(thesis_bounce)
    columns = COLUMNS

    closures: ThesisClosures = field(kw_only=True)

    @property
    def codes(self) -> NDArray[np.int64]:
        """See `thesis_batch`."""
        return np.array([DAMPINGS.index(self.closures.damping), self.needs_cor], dtype=np.int64)

    def rows(self, names: Sequence[str], values: NumberArray) -> NumberArray:
        """See `Model.rows`."""
        rows = super().rows(names, values)
        if self.closures.inertia == "tied":
            rows[:, INERTIA_SPLIT] = [tied_inertia_split(m) for m in rows[:, MASS_RATIO]]
        return rows

    def bounce(self, names: Sequence[str], values: NumberArray, states: States) -> Bounced:
        """See `SteppedModel.bounce`."""
        v_x1, v_y1, omega_1, cor = states
        shape = (values.shape[0], v_y1.shape[1])
        out = np.empty((4, *shape), dtype=values.dtype)
        regime, status = np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.int8)
        told = v_y1 if cor is None else cor
        thesis_batch(self.rows(names, values), self.codes, v_x1, v_y1, omega_1, told, out, regime, status)
        return out, regime, status

    def course(self, parameters: Mapping[str, float], impact: Impacts, times: FloatArray) -> ThesisCourse:
        """Velocities of one impact (the first) at `times` [s]; raises what `rebound` raises."""
        self.rebound(parameters, impact)
        names = tuple(parameters)
        row = self.rows(names, np.array([[float(parameters[name]) for name in names]]))[0]
        v_x, v_y, omega = (float(column[0]) for column in (impact.v_x1, impact.v_y1, impact.omega_1))
        told = impact.cor if self.needs_cor else None
        cor = row[COR_10] + row[COR_SLOPE] * (v_y - ANCHOR_SPEED) if told is None else float(told[0])
        mass_ratio, k_y = row[MASS_RATIO], row[K_Y]
        sigma = thesis_damping(
            DAMPINGS.index(self.closures.damping), row[C_Y], mass_ratio * row[BALL_MASS], k_y, mass_ratio, cor
        )
        motion = thesis_motion(thesis_contact(row, sigma, v_x, v_y, omega))
        z, friction, slide, roll = (complex(*pair) for pair in (motion.z, motion.friction, motion.slide, motion.roll))
        t_r, t_c = motion.t_r, motion.t_c
        slip_end = t_r if np.isfinite(t_r) else t_c
        sliding = np.exp(z * np.minimum(times, slip_end)) - 1.0
        rolling = np.exp(z * np.maximum(times, slip_end)) - np.exp(z * slip_end)
        spin = omega + (slide * sliding).real + (roll * rolling).real
        surface = row[BALL_RADIUS] * spin
        velocity = np.where(times <= slip_end, v_x - (friction * sliding).real, surface)
        return ThesisCourse(times, velocity, surface, spin, t_r, t_c)


def compose_thesis(name: str, ball: Ball, tangential: bool, closures: ThesisClosures) -> ThesisModel:
    """The model of a composition with its parameters; it has no vertical motion alone."""
    parameters = specs(*thesis_parameters(closures))
    return ThesisModel(name, ball, asdict(closures), parameters, closures=closures, tangential=tangential)
