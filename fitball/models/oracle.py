"""The slow, independent solution of the two-mass ball: what the fast solver is compared with.

No closed form of the driven torsional oscillator is used here. Each phase of the contact is one linear autonomous
system `z' = A z`, carried on by matrix exponentials in double precision or at any number of digits; each event is a
row `c` with `c z >= 0` for as long as the phase lasts. State: (y, y', u, omega_1, omega_2, theta, x, phi_2) with the
contact slip `u = v_x - omega_2`, which is in the state so that a contact point at rest is exactly at rest, and the
path and the turn of the shell since landing.

Units inside: the core's undamped vertical frequency sets the time, the approach speed the velocities, the ball's mass
and radius the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from fitball.errors import ParameterError
from fitball.models.march import (
    DOUBLE,
    STEPS_PER_POLE_TIME,
    Arithmetic,
    ExpmMarch,
    Matrix,
    Number,
    Row,
    digits_arithmetic,
)
from fitball.models.types import MAX_PACKED_PHASES, OUTPUTS, PHASE_BITS, Closures, Phase, Rebound, Status
from fitball.values import Ball, Impacts

NEWTON_STEPS = 400
# A COR and a mass_ratio meant to be equal differ by the rounding of the line COR(v) at most.
RATIO_ROUNDING = 1e-14


@dataclass(frozen=True)
class Problem:
    """One impact in dimensionless numbers.

    `zeta` vertical damping ratio; `riding` the mass on the spring over M; `core` and `shell` inertias and
    `stiffness` and `damping` of the torsion over M R^2 (with a `rigid` torsion the shell is the whole
    ball); `eps` over R; `landing` impulse over M v_y1; `travel` v_x1 and `spin` R omega_1 over v_y1;
    `loaded` and `contact` the times at which the ground force and the contact end, apart by a free flight
    if `released_free`; `frequency` [rad/s] the unit of inverse time; `cor` that of the whole ball.
    """

    zeta: Number
    riding: Number
    core: Number
    shell: Number
    stiffness: Number
    damping: Number
    rigid: bool
    mu: Number
    eps: Number
    eps_while_sliding: bool
    landing: Number
    travel: Number
    spin: Number
    loaded: Number
    contact: Number
    released_free: bool
    frequency: Number
    cor: Number


def arrange(
    kind: Arithmetic,
    closures: Closures,
    ball: Ball,
    parameters: Mapping[str, float],
    impacts: Impacts,
    index: int,
) -> Problem | Status:
    """The dimensionless problem of impact `index`, or the status that says why there is none.

    Raises ParameterError when a parameter the closures need is missing or splits the ball into
    nothing, or when `cor = "measured"` finds no measured coefficient of restitution.
    """

    def read(name: str) -> Number:
        if name not in parameters:
            raise ParameterError(
                f"parameter {name} is missing: these model assumptions need it; given: {sorted(parameters)}"
            )
        return kind.number(float(parameters[name]))

    speed = kind.number(float(impacts.v_y1[index]))
    above_ten = speed - 10
    if closures.cor == "saturating" and 10 * read("cor_slope") <= -read("cor_10"):
        return Status.REBOUND_FALLS
    cor = _coefficient_of_restitution(kind, closures, read, impacts, index, above_ten)
    if not 0 < cor <= 1:
        return Status.COR_OUT_OF_RANGE
    core_return = cor
    riding = kind.number(1.0)
    landing = kind.number(0.0)
    if closures.normal != "total":
        riding = read("mass_ratio")
    if closures.normal == "momentum":
        core_return = cor / riding
        landing = 1 - riding
        if core_return > 1 + RATIO_ROUNDING:
            return Status.COR_EXCEEDS_MASS_RATIO
        core_return = min(core_return, kind.number(1.0))
    zeta, loaded, contact = release(kind, closures, core_return)

    mass, radius = kind.number(ball.mass), kind.number(ball.radius)
    inertia = kind.number(ball.inertia) / (mass * radius * radius)
    frequency = kind.sqrt(read("k_y") / (riding * mass))
    core, shell, stiffness, damping = kind.number(0.0), inertia, kind.number(0.0), kind.number(0.0)
    if closures.torsion != "rigid":
        core, shell = (inertia * share for share in _shares_of_inertia(kind, closures, read))
        if not (core > 0 and shell > 0):
            raise ParameterError("core or shell has no inertia: mass_ratio or inertia_split must lie in (0, 1)")
        stiffness = read("k_theta") / (mass * radius * radius * frequency * frequency)
        compliance = 1 / core + 1 / shell
        natural_squared = stiffness * compliance
        if closures.torsion == "free":
            zeta_theta = read("zeta_theta")
        else:
            remainder = 1 - (1 - zeta * zeta) / natural_squared
            if remainder < 0:
                return Status.TORSION_TOO_SOFT
            zeta_theta = kind.sqrt(remainder)
        damping = 2 * zeta_theta * kind.sqrt(natural_squared) / compliance
    return Problem(
        zeta=zeta,
        riding=riding,
        core=core,
        shell=shell,
        stiffness=stiffness,
        damping=damping,
        rigid=closures.torsion == "rigid",
        mu=read("mu"),
        eps=(read("eps_10") + read("eps_slope") * above_ten) / radius,
        eps_while_sliding=closures.offset == "contact",
        landing=landing,
        travel=kind.number(float(impacts.v_x1[index])) / speed,
        spin=kind.number(float(impacts.omega_1[index])) * radius / speed,
        loaded=loaded,
        contact=contact,
        released_free=contact - loaded > 8 * kind.unit_roundoff * contact,
        frequency=frequency,
        cor=cor,
    )


def release(kind: Arithmetic, closures: Closures, core_return: Number) -> tuple[Number, Number, Number]:
    """Damping ratio, end of the ground force and end of contact for the core's own restitution.

    The ground force returns to zero at `2 h(zeta)`, `h(z) = acos(z)/sqrt(1 - z^2)`, which as the
    hypergeometric function 2F1(1, 1; 3/2; (1-z)/2) runs smoothly through critical damping.
    """
    loss = -kind.log(core_return)
    if closures.release == "zero_displacement":
        zeta = loss / kind.sqrt(kind.pi**2 + loss * loss)
        contact = kind.pi / kind.sqrt((1 - zeta) * (1 + zeta))
        return zeta, 2 * _angle_over_sine(kind, zeta), contact
    zeta = _damping_for_loss(kind, loss)
    loaded = 2 * _angle_over_sine(kind, zeta)
    return zeta, loaded, loaded


def _damping_for_loss(kind: Arithmetic, loss: Number) -> Number:
    """Root of `2 z h(z) = loss`; concave and rising, so Newton from 0 climbs to it without a bracket."""
    zeta = kind.number(0.0)
    for _ in range(NEWTON_STEPS):
        angle = _angle_over_sine(kind, zeta)
        slope = -kind.hyp2f1(2, 2, kind.number(2.5), (1 - zeta) / 2) / 3
        step = (loss - 2 * zeta * angle) / (2 * (angle + zeta * slope))
        zeta = zeta + step
        if abs(step) <= 8 * kind.unit_roundoff * zeta:
            return zeta
    raise ParameterError(f"no damping ratio returns the core with exp(-{loss}) of its speed")


def _angle_over_sine(kind: Arithmetic, zeta: Number) -> Number:
    return kind.hyp2f1(1, 1, kind.number(1.5), (1 - zeta) / 2)


def _coefficient_of_restitution(
    kind: Arithmetic,
    closures: Closures,
    read: Callable[[str], Number],
    impacts: Impacts,
    index: int,
    above_ten: Number,
) -> Number:
    if closures.cor == "measured":
        if impacts.cor is None:
            raise ParameterError("cor = measured needs the measured coefficient of restitution of each impact")
        return kind.number(float(impacts.cor[index]))
    if closures.cor == "mean":
        return read("cor_10")
    if closures.cor == "saturating":
        cap = read("mass_ratio") if closures.normal == "momentum" else kind.number(1.0)
        return cap * _saturating_share(kind, read("cor_10") / cap, read("cor_10"), read("cor_slope"), above_ten)
    return read("cor_10") + read("cor_slope") * above_ten


def _saturating_share(kind: Arithmetic, share: Number, cor: Number, slope: Number, above_ten: Number) -> Number:
    """COR over its cap, from its value and slope at 10 m/s: by powers of what it is there, or,
    where it rises, by its odds.
    """
    speed = (above_ten + 10) / 10
    fall = -10 * slope / cor
    if fall <= 0:
        odds = share / (1 - share) * speed ** (-fall / (1 - share))
        return odds / (1 + odds)
    if share >= 1:
        return share
    # 1/(1 - fall) = 1 + fall/(1 - fall) at 10 m/s, and the share is a power of what that is at another speed.
    power = kind.log1p(-fall) / kind.log(share)
    return share ** (kind.log1p(fall / (1 - fall) * speed**power) / -kind.log1p(-fall))


def _shares_of_inertia(kind: Arithmetic, closures: Closures, read: Callable[[str], Number]) -> tuple[Number, Number]:
    """I1/I and I2/I: given, or those of a solid core of radius 0.97 R inside a thin shell (Eqs 67 and 69)."""
    if closures.inertia == "table":
        return read("inertia_split"), 1 - read("inertia_split")
    mass_ratio = read("mass_ratio")
    solid = kind.number(2.0) / 5 * (kind.number(97.0) / 100) ** 2 * mass_ratio
    thin = kind.number(2.0) / 3 * (1 - mass_ratio)
    return solid / (solid + thin), thin / (solid + thin)


# Sign tests look at the value and, where it vanishes, at the derivatives: starts at which force,
# torque and slip all vanish together are settled by the third at the latest.
DERIVATIVES = 4
PHASE_LIMIT = 300
# Share of the contact below which a phase is an artefact of the incident state's own rounding.
SHORTEST_PHASE = 1e-13
# A landing spin meant to cancel the speed exactly misses it by the rounding of the two.
INCIDENT_ROUNDING = 2e-15
SIZE = 8
SLIDES = {1: Phase.SLIDE_FORWARD, -1: Phase.SLIDE_BACKWARD}


@dataclass(frozen=True)
class Outcome:
    """State at the end of contact, the phases passed through, and whether they were too many."""

    state: Row
    phases: tuple[Phase, ...]
    endless: bool


class Equations:
    """Rows and matrices of one problem."""

    def __init__(self, problem: Problem) -> None:
        p = self.problem = problem
        self.zero = p.mu * 0
        none = self.zero
        self.force: Row = [p.riding, 2 * p.zeta * p.riding, none, none, none, none, none, none]
        self.torque: Row = [none, none, none, p.damping, -p.damping, p.stiffness, none, none]
        self.slip: Row = [none, none, none + 1, none, none, none, none, none]
        # Friction that keeps the contact point at rest: without the offset of the ground force, and with it.
        self.hold_friction = scaled(self.torque, 1 / (1 + p.shell))
        self.grip_friction = added(self.hold_friction, scaled(self.force, -p.eps / (1 + p.shell)))
        self.slide_friction = self.grip_friction if p.eps_while_sliding else self.hold_friction

    def cone(self, friction: Row) -> list[Row]:
        """Rows that are not negative while `friction` stays within the friction cone."""
        limit = scaled(self.force, self.problem.mu)
        return [added(limit, scaled(friction, -1)), added(limit, friction)]

    def matrix(self, phase: Phase) -> Matrix:
        """`A` of the phase."""
        p = self.problem
        nothing = [self.zero] * SIZE
        if phase is Phase.FREE:
            return self._assemble(nothing, nothing, resting=False)
        offset = scaled(self.force, p.eps)
        if phase is Phase.GRIP:
            return self._assemble(self.grip_friction, offset, resting=True)
        if phase is Phase.HOLD:
            return self._assemble(self.hold_friction, nothing, resting=True)
        direction = 1 if phase is Phase.SLIDE_FORWARD else -1
        friction = scaled(self.force, -direction * p.mu)
        return self._assemble(friction, offset if p.eps_while_sliding else nothing, resting=False)

    def _assemble(self, friction: Row, offset_torque: Row, resting: bool) -> Matrix:
        p, none = self.problem, self.zero
        ground = scaled(added(friction, offset_torque), -1)
        if p.rigid:
            shell = core = scaled(ground, 1 / p.shell)
        else:
            shell = scaled(added(self.torque, ground), 1 / p.shell)
            core = scaled(self.torque, -1 / p.core)
        return [
            [none, none + 1, none, none, none, none, none, none],
            scaled(self.force, -1 / p.riding),
            [none] * SIZE if resting else added(friction, scaled(shell, -1)),
            core,
            shell,
            [none, none, none, none + 1, none - 1, none, none, none],
            [none, none, none + 1, none, none + 1, none, none, none],
            [none, none, none, none, none + 1, none, none, none],
        ]

    def guards(self, phase: Phase) -> list[Row]:
        """Rows that are not negative while the phase lasts."""
        if phase is Phase.GRIP:
            return self.cone(self.grip_friction)
        if phase is Phase.HOLD:
            # A hold also ends where the grip with offset begins to fit into the cone: on the side
            # to which the offset has carried the required friction.
            against = 1 if self.problem.eps > 0 else -1
            outside = scaled(added(scaled(self.force, self.problem.mu), scaled(self.grip_friction, against)), -1)
            return [*self.cone(self.hold_friction), outside]
        if phase is Phase.FREE:
            return []
        return [scaled(self.slip, 1 if phase is Phase.SLIDE_FORWARD else -1)]


def bounce(problem: Problem, march: ExpmMarch) -> Outcome:
    """Carry one impact from landing to release."""
    equations = Equations(problem)
    state, at_rest = land(problem, march.rounding)
    phase = decide(equations, state, march.rounding) if at_rest else SLIDES[1 if state[2] > 0 else -1]
    phases: list[Phase] = []
    time = equations.zero
    shortest = march.rounding * problem.contact
    for _ in range(PHASE_LIMIT):
        elapsed, state, ended = march(equations.matrix(phase), state, equations.guards(phase), problem.loaded - time)
        time = time + elapsed
        if elapsed > SHORTEST_PHASE * problem.contact and phases[-1:] != [phase]:
            phases.append(phase)
        if not ended:
            break
        if problem.loaded - time <= shortest:
            # What is left of the ground force is rounding, and no ground to decide on.
            _, state, _ = march(equations.matrix(phase), state, [], problem.loaded - time)
            break
        state = [*state[:2], equations.zero, *state[3:]]
        phase = decide(equations, state, march.rounding)
    else:
        return Outcome(state, tuple(phases), endless=True)
    if problem.released_free:
        _, state, _ = march(equations.matrix(Phase.FREE), state, [], problem.contact - problem.loaded)
        phases.append(Phase.FREE)
    return Outcome(state, tuple(phases), endless=False)


def land(problem: Problem, rounding: Number) -> tuple[Row, bool]:
    """State just after the landing impulse, and whether the contact point is at rest then.

    The impulse is resolved along itself: as it grows, friction and the offset of the ground force
    change the slip at constant rates until the slip is used up or the impulse is.
    """
    p = problem
    none = p.mu * 0
    travel, shell = p.travel, p.spin

    def push(impulse: Number, friction: Number, offset: Number) -> None:
        nonlocal travel, shell
        travel = travel + friction * impulse
        shell = shell - (friction + offset) * impulse / p.shell

    def rate(direction: int) -> Number:
        return -direction * p.mu * (1 + 1 / p.shell) + sliding_offset / p.shell

    sliding_offset = p.eps if p.eps_while_sliding else none
    slip = travel - shell
    at_rest = abs(slip) <= min(rounding, INCIDENT_ROUNDING) * (abs(travel) + abs(shell))
    left = p.landing
    if not at_rest and left > 0:
        direction = 1 if slip > 0 else -1
        change = direction * rate(direction)
        at_rest = change < 0 and abs(slip) <= -change * left
        spent = -abs(slip) / change if at_rest else left
        push(spent, -direction * p.mu, sliding_offset)
        left = left - spent
    if at_rest and left > 0:
        needed = -p.eps / (1 + p.shell)
        if abs(needed) <= p.mu:
            push(left, needed, p.eps)
        elif p.eps_while_sliding:
            push(left, -p.mu if p.eps > 0 else p.mu, p.eps)
            at_rest = False
    core = shell if p.rigid else p.spin
    return [none, none + 1, none if at_rest else travel - shell, core, shell, none, none, none], at_rest


def decide(equations: Equations, state: Row, rounding: Number) -> Phase:
    """The phase that a contact point at rest goes on with."""

    def fits(phase: Phase, friction: Row) -> bool:
        matrix = equations.matrix(phase)
        return all(leading_sign(row, matrix, state, rounding) >= 0 for row in equations.cone(friction))

    if fits(Phase.GRIP, equations.grip_friction):
        return Phase.GRIP
    if not equations.problem.eps_while_sliding and fits(Phase.HOLD, equations.hold_friction):
        return Phase.HOLD
    resting = Phase.GRIP if equations.problem.eps_while_sliding else Phase.HOLD
    needed = leading_sign(equations.slide_friction, equations.matrix(resting), state, rounding)
    return SLIDES[-1 if needed > 0 else 1]


def leading_sign(row: Row, matrix: Matrix, state: Row, rounding: Number) -> int:
    """Sign of `row z(t)` just after now: of the first of its derivatives that does not vanish, or 0."""
    vector, size = state, [abs(value) for value in state]
    for _ in range(DERIVATIVES):
        value = dot(row, vector)
        if abs(value) > rounding * dot([abs(weight) for weight in row], size):
            return 1 if value > 0 else -1
        size = [dot([abs(weight) for weight in line], size) for line in matrix]
        vector = [dot(line, vector) for line in matrix]
    return 0


def dot(row: Row, vector: Row) -> Number:
    """Sum of products."""
    return sum(weight * value for weight, value in zip(row, vector, strict=True))


def scaled(row: Row, factor: Number) -> Row:
    """`factor` times the row."""
    return [factor * value for value in row]


def added(left: Row, right: Row) -> Row:
    """Sum of two rows."""
    return [a + b for a, b in zip(left, right, strict=True)]


def oracle_rebound(
    closures: Closures, ball: Ball, parameters: Mapping[str, float], impacts: Impacts, digits: int | None = None
) -> Rebound:
    """Rebound of each impact, arrays of shape (impacts,): in double precision, some milliseconds per impact, or with
    so many decimal `digits` and rounded to doubles at the end, inputs being the exact values of theirs: seconds.

    `parameters` are in SI units by name; those that the closures do not need are ignored. Impacts
    without a solution hold NaN and their `Status`. Raises ParameterError for a missing parameter.
    """
    kind = DOUBLE if digits is None else digits_arithmetic(digits)
    march = ExpmMarch(kind)
    count = len(impacts)
    regime, status = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int8)
    rebound = Rebound(*(*np.full((len(OUTPUTS), count), np.nan), regime, status))
    for index in range(count):
        problem = arrange(kind, closures, ball, parameters, impacts, index)
        if isinstance(problem, Status):
            status[index] = problem
            continue
        outcome = bounce(problem, march)
        if outcome.endless:
            status[index] = Status.TOO_MANY_PHASES
            continue
        y, _, slip, core, shell, twist, path, angle = outcome.state
        spin, speed, whole = shell, float(impacts.v_y1[index]), problem.core + problem.shell
        if closures.spin == "mean":
            spin = (problem.core * core + problem.shell * shell) / whole
        rebound.v_x2[index] = float((slip + shell) * speed)
        rebound.v_y2[index] = float(problem.cor * speed)
        rebound.omega_2[index] = float(spin * speed / ball.radius)
        rebound.contact_time[index] = float(problem.contact / problem.frequency)
        # From release on the ball rises to the height at which it landed; its shell swings back by the twist's share.
        late, length = y / problem.cor, speed / problem.frequency
        angle = angle + problem.core / whole * twist + spin * late
        rebound.gap_time[index] = float((problem.contact + late) / problem.frequency)
        rebound.gap_path[index] = float((path + (slip + shell) * late) * length)
        rebound.gap_turn[index] = float(angle * length / ball.radius)
        packed = enumerate(outcome.phases[:MAX_PACKED_PHASES])
        regime[index] = sum(int(phase) << (PHASE_BITS * place) for place, phase in packed)
    return rebound


@dataclass(frozen=True)
class TwoMassOracle:
    """The independent integration of one composition of a two-mass ball."""

    closures: Closures
    ball: Ball

    def steps(self, parameters: Mapping[str, float], impacts: Impacts) -> float:
        """See `Oracle.steps`: so many times the time of the fastest pole."""
        most = 0.0
        for index in range(len(impacts)):
            arranged = arrange(DOUBLE, self.closures, self.ball, parameters, impacts, index)
            if isinstance(arranged, Status):
                continue
            for phase in (Phase.SLIDE_FORWARD, Phase.GRIP):
                poles = np.linalg.eigvals(np.array(Equations(arranged).matrix(phase), dtype=np.float64))
                most = max(most, float(np.max(np.abs(poles))) * float(arranged.loaded) * STEPS_PER_POLE_TIME)
        return most

    def rebound(self, parameters: Mapping[str, float], impacts: Impacts, digits: int | None = None) -> Rebound:
        """See `Oracle.rebound`."""
        return oracle_rebound(self.closures, self.ball, parameters, impacts, digits)
