"""The slow, independent solution of the two-mass ball: what the fast solver is compared with.

No closed form of the driven torsional oscillator is used here. Each phase of the contact is one linear
autonomous system, carried on by matrix exponentials in double precision (`oracle_rebound`) or by Taylor
series at any number of digits (`oracle_rebound_mp`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.special import hyp2f1

from fitball.models.oracle.expm import ExpmMarch
from fitball.models.oracle.phases import March, Outcome, bounce
from fitball.models.oracle.setup import Arithmetic, Problem, arrange
from fitball.models.oracle.taylor import TaylorMarch, digits_arithmetic
from fitball.models.types import (
    MAX_PACKED_PHASES,
    PHASE_BITS,
    Closures,
    Phase,
    Rebound,
    Spin,
    Status,
)
from fitball.values import Ball, Impacts

DOUBLE = Arithmetic(
    number=float,
    sqrt=math.sqrt,
    log=math.log,
    log1p=math.log1p,
    hyp2f1=hyp2f1,
    pi=math.pi,
    unit_roundoff=float(np.finfo(float).eps),
)


def oracle_rebound(closures: Closures, ball: Ball, parameters: Mapping[str, float], impacts: Impacts) -> Rebound:
    """Rebound of each impact, arrays of shape (impacts,), some milliseconds per impact.

    `parameters` are in SI units by name; those that the closures do not need are ignored. Impacts
    without a solution hold NaN and their `Status`. Raises ParameterError for a missing parameter.
    """
    return _rebound(DOUBLE, ExpmMarch(), closures, ball, parameters, impacts)


def oracle_rebound_mp(
    closures: Closures, ball: Ball, parameters: Mapping[str, float], impacts: Impacts, digits: int = 50
) -> Rebound:
    """As `oracle_rebound`, computed with `digits` decimal digits and rounded to doubles at the end.

    Takes the inputs as the exact values of their doubles. Seconds per impact.
    """
    kind = digits_arithmetic(digits)
    return _rebound(kind, TaylorMarch(kind, digits), closures, ball, parameters, impacts)


def _rebound(
    kind: Arithmetic,
    march: March,
    closures: Closures,
    ball: Ball,
    parameters: Mapping[str, float],
    impacts: Impacts,
) -> Rebound:
    count = len(impacts)
    v_x2, v_y2, omega_2, contact_time = np.full((4, count), np.nan)
    rebound = Rebound(
        v_x2=v_x2,
        v_y2=v_y2,
        omega_2=omega_2,
        contact_time=contact_time,
        regime=np.zeros(count, dtype=np.int64),
        status=np.zeros(count, dtype=np.int8),
    )
    for index in range(count):
        problem = arrange(kind, closures, ball, parameters, impacts, index)
        if isinstance(problem, Status):
            rebound.status[index] = problem
            continue
        outcome = bounce(problem, march)
        if outcome.endless:
            rebound.status[index] = Status.TOO_MANY_PHASES
            continue
        _store(rebound, index, problem, outcome, closures.spin, ball, float(impacts.v_y1[index]))
    return rebound


def _store(
    rebound: Rebound, index: int, problem: Problem, outcome: Outcome, spin: Spin, ball: Ball, speed: float
) -> None:
    _, _, slip, core, shell, _ = outcome.state
    turn = shell
    if spin == "mean":
        turn = (problem.core * core + problem.shell * shell) / (problem.core + problem.shell)
    rebound.v_x2[index] = float((slip + shell) * speed)
    rebound.v_y2[index] = float(problem.cor * speed)
    rebound.omega_2[index] = float(turn * speed / ball.radius)
    rebound.contact_time[index] = float(problem.contact / problem.frequency)
    rebound.regime[index] = _packed(outcome.phases)


def _packed(phases: tuple[Phase, ...]) -> int:
    return sum(int(phase) << (PHASE_BITS * place) for place, phase in enumerate(phases[:MAX_PACKED_PHASES]))
