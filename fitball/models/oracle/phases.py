"""Slide, grip, hold and free flight of the twist as linear systems, and the rules that join them.

State: (y, y', u, omega_1, omega_2, theta) with the contact slip `u = v_x - omega_2`, dimensionless as in
`oracle_setup`. Slip stands in the state so that a contact point at rest is exactly at rest. Each phase
is `z' = A z`; each event is a row `c` with `c z >= 0` for as long as the phase lasts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from fitball.models.oracle.arithmetic import Number
from fitball.models.oracle.setup import Problem
from fitball.models.types import Phase

Row = list[Any]
Matrix = list[Row]
# Sign tests look at the value and, where it vanishes, at the derivatives: starts at which force,
# torque and slip all vanish together are settled by the third at the latest.
DERIVATIVES = 4
PHASE_LIMIT = 300
# Share of the contact below which a phase is an artefact of the incident state's own rounding.
SHORTEST_PHASE = 1e-13
# A landing spin meant to cancel the speed exactly misses it by the rounding of the two.
INCIDENT_ROUNDING = 2e-15
SLIDES = {1: Phase.SLIDE_FORWARD, -1: Phase.SLIDE_BACKWARD}


class March(Protocol):
    """How a backend carries a state along one linear phase up to its first event.

    `rounding` is the relative size below which a sum counts as zero.
    """

    rounding: Number

    def __call__(self, matrix: Matrix, state: Row, guards: list[Row], duration: Number) -> tuple[Number, Row, bool]:
        """Elapsed time, state there, and whether a guard row fell below zero before `duration`."""


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
        self.force: Row = [p.riding, 2 * p.zeta * p.riding, none, none, none, none]
        self.torque: Row = [none, none, none, p.damping, -p.damping, p.stiffness]
        self.slip: Row = [none, none, none + 1, none, none, none]
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
        nothing = [self.zero] * 6
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
            [none, none + 1, none, none, none, none],
            scaled(self.force, -1 / p.riding),
            [none] * 6 if resting else added(friction, scaled(shell, -1)),
            core,
            shell,
            [none, none, none, none + 1, none - 1, none],
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


def bounce(problem: Problem, march: March) -> Outcome:
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
    return [none, none + 1, none if at_rest else travel - shell, core, shell, none], at_rest


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
