"""What a port does beside its kernel, in the same restricted Python: the fitted model with what stands in where it
has no solution, and the total bounce.

`kernel_source` collects these functions like kernels, with the fit's own numbers in the place of the names that are
None here (`port.make_port`): `KERNEL` is the entry of an algebraic model, `FITTED` the function of its convention.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.bounce import bounce
from fitball.models.kernels.phases import Scratch
from fitball.models.thesis import thesis_bounce
from fitball.models.types import GRIP, SLIDE_BACKWARD, SLIDE_FORWARD, Status
from fitball.values import FloatArray

Ints = NDArray[np.int64]
# Given by the port.
KERNEL: Any = None
FITTED: Any = None
TOLD_COR: Any = None
ANCHOR: Any = None
RADIUS: Any = None
V_Y1_LOW: Any = None
V_Y1_HIGH: Any = None
COR_LOW: Any = None
COR_HIGH: Any = None
GRAZING: Any = None
TINY: Any = None

OK = int(Status.OK)
BAD_INPUT = -1
# In what a bounce is extrapolated: a sum of these.
BEYOND_SPEEDS, BEYOND_RESTITUTION, WITHOUT_TWIST = 1, 2, 4
# Row of the thesis's kernel: its offset, friction and ball, and behind its columns the lines in `v_y1`.
MU, EPS, MASS, BALL_RADIUS, BALL_INERTIA = 3, 4, 7, 8, 9
COLUMNS, EPS_10, EPS_SLOPE, COR_10, COR_SLOPE = 10, 10, 11, 12, 13


class Solved(NamedTuple):
    """One impact as a port answers it: `status` is 0 or says why the rest is NaN; `regime` packed phases."""

    v_x2: float
    v_y2: float
    omega_2: float
    contact_time: float
    regime: int
    extrapolated: int
    status: int


def fitted_impulse(
    row: FloatArray, codes: Ints, rigid: Ints, v_x1: float, v_y1: float, omega_1: float, cor: float, scratch: Scratch
) -> Solved:
    """The fitted model as it is."""
    status, v_x2, v_y2, omega_2, regime = KERNEL(row, v_x1, v_y1, omega_1)
    return Solved(v_x2, v_y2, omega_2, math.nan, regime, 0, status)


def fitted_two_mass(
    row: FloatArray, codes: Ints, rigid: Ints, v_x1: float, v_y1: float, omega_1: float, cor: float, scratch: Scratch
) -> Solved:
    """The fitted model as it is, and as a ball without twist where it has no solution."""
    extrapolated = 0
    solved = bounce(row, codes, v_x1, v_y1, omega_1, cor, scratch, None)
    if solved.status != OK:
        solved = bounce(row, rigid, v_x1, v_y1, omega_1, cor, scratch, None)
        extrapolated = WITHOUT_TWIST
    return Solved(
        solved.v_x2, solved.v_y2, solved.omega_2, solved.contact_time, solved.regime, extrapolated, solved.status
    )


def fitted_thesis(
    row: FloatArray, codes: Ints, rigid: Ints, v_x1: float, v_y1: float, omega_1: float, cor: float, scratch: Scratch
) -> Solved:
    """The thesis's computation as it is, and a rigid ball, sliding or rolling, where it has no solution."""
    told = cor
    if TOLD_COR == 0:
        told = row[COR_10] + row[COR_SLOPE] * (v_y1 - ANCHOR)
    at_speed = scratch.function
    for k in range(COLUMNS):
        at_speed[k] = row[k]
    at_speed[EPS] = row[EPS_10] + row[EPS_SLOPE] * (v_y1 - ANCHOR)
    status, v_x2, v_y2, omega_2, contact_time, regime = thesis_bounce(at_speed, codes[0], told, v_x1, v_y1, omega_1)
    if status == OK:
        return Solved(v_x2, v_y2, omega_2, contact_time, regime, 0, status)
    push = (1.0 + told) * v_y1
    inertia = row[BALL_INERTIA] / (row[MASS] * row[BALL_RADIUS] * row[BALL_RADIUS])
    stop = (v_x1 - row[BALL_RADIUS] * omega_1) * inertia / (1.0 + inertia)
    limit = row[MU] * push
    lost = min(max(stop, -limit), limit)
    phase = GRIP
    if stop > limit:
        phase = SLIDE_FORWARD
    elif stop < -limit:
        phase = SLIDE_BACKWARD
    turned = omega_1 + lost / (inertia * row[BALL_RADIUS])
    return Solved(v_x1 - lost, told * v_y1, turned, math.nan, phase, WITHOUT_TWIST, OK)


def total_bounce(
    row: FloatArray, codes: Ints, rigid: Ints, v_x1: float, v_y1: float, omega_1: float, cor: float, scratch: Scratch
) -> Solved:
    """The rebound of any impact with finite numbers and `v_y1 >= 0`, see `prediction.reach.total_rebound`."""
    bad = Solved(math.nan, math.nan, math.nan, math.nan, 0, 0, BAD_INPUT)
    if not (math.isfinite(v_x1) and math.isfinite(v_y1) and math.isfinite(omega_1) and v_y1 >= 0.0):
        return bad
    extrapolated = 0
    told = cor
    if TOLD_COR != 0:
        if not math.isfinite(cor):
            return bad
        told = min(max(cor, COR_LOW), COR_HIGH)
        if told != cor:
            extrapolated += BEYOND_RESTITUTION
    at_end = min(max(v_y1, V_Y1_LOW), V_Y1_HIGH)
    scale = v_y1 / at_end
    if scale != 1.0:
        extrapolated += BEYOND_SPEEDS
    # So slow towards the court that friction changes nothing else.
    if v_y1 <= max(GRAZING * (abs(v_x1) + RADIUS * abs(omega_1)), TINY):
        grazed = FITTED(row, codes, rigid, 0.0, at_end, 0.0, told, scratch)
        return Solved(v_x1, grazed.v_y2 * scale, omega_1, grazed.contact_time, 0, extrapolated, grazed.status)
    found = FITTED(row, codes, rigid, v_x1 / scale, at_end, omega_1 / scale, told, scratch)
    v_x2, v_y2, omega_2 = found.v_x2 * scale, found.v_y2 * scale, found.omega_2 * scale
    # Numbers too large to be squared or scaled.
    if found.status == OK and not (math.isfinite(v_x2) and math.isfinite(v_y2) and math.isfinite(omega_2)):
        return bad
    extrapolated += found.extrapolated
    return Solved(v_x2, v_y2, omega_2, found.contact_time, found.regime, extrapolated, found.status)
