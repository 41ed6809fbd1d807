"""The slow, independent solution of the two-mass ball: what the fast solver is compared with.

No closed form of the driven torsional oscillator is used here. Each phase of the contact is one linear
autonomous system, carried on by matrix exponentials in double precision or at any number of digits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.models.oracle.arithmetic import DOUBLE, digits_arithmetic
from fitball.models.oracle.expm import STEPS_PER_POLE_TIME, ExpmMarch
from fitball.models.oracle.phases import Equations, bounce
from fitball.models.oracle.setup import arrange
from fitball.models.types import MAX_PACKED_PHASES, PHASE_BITS, Closures, Phase, Rebound, Status
from fitball.values import Ball, Impacts


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
    v_x2, v_y2, omega_2, contact_time = np.full((4, count), np.nan)
    rebound = Rebound(v_x2, v_y2, omega_2, contact_time, regime, status)
    for index in range(count):
        problem = arrange(kind, closures, ball, parameters, impacts, index)
        if isinstance(problem, Status):
            status[index] = problem
            continue
        outcome = bounce(problem, march)
        if outcome.endless:
            status[index] = Status.TOO_MANY_PHASES
            continue
        _, _, slip, core, shell, _ = outcome.state
        turn, speed = shell, float(impacts.v_y1[index])
        if closures.spin == "mean":
            turn = (problem.core * core + problem.shell * shell) / (problem.core + problem.shell)
        rebound.v_x2[index] = float((slip + shell) * speed)
        rebound.v_y2[index] = float(problem.cor * speed)
        rebound.omega_2[index] = float(turn * speed / ball.radius)
        rebound.contact_time[index] = float(problem.contact / problem.frequency)
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
