"""Rivals from scipy: `solve_ivp` with events, as it is called carelessly and as a careful user would."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from scipy.integrate import solve_ivp

from fitball.studies.bench.integrators import END, PHASE, after_event, first_state, margin, outgoing, rates
from fitball.values import FloatArray

Method = Literal["RK45", "DOP853", "LSODA"]
# Typical sizes of the state, for absolute tolerances.
SCALE = np.array([1e-3, 10.0, 10.0, 300.0, 300.0, 0.1])
MOST_PHASES = 50
# A short first step, as a share of what is left of the contact.
FIRST = 1e-6


def adaptive(setup: FloatArray, method: Method, rtol: float, most: float = math.inf) -> tuple[float, float]:
    """`(v_x2, omega_2)` of a set-up impact; no step is longer than the share `most` of the contact.

    Events are looked for at the ends of steps: a grip that breaks and could grip again within one is stepped over.
    Who bounds steps makes the first of a phase very short too: slip begins at zero, and may end there soon.
    """
    c = setup
    z, phase, time = first_state(c), float(c[PHASE]), 0.0

    def motion(_t: float, z: FloatArray) -> tuple[float, ...]:
        return rates(c, phase, tuple(z))

    def ended(_t: float, z: FloatArray) -> float:
        return margin(c, phase, tuple(z))

    ended.terminal, ended.direction = True, -1.0  # type: ignore[attr-defined]
    for _ in range(MOST_PHASES):
        first = None if math.isinf(most) else FIRST * (c[END] - time)
        run = solve_ivp(
            motion, (time, c[END]), z, method, events=ended, rtol=rtol, atol=rtol * SCALE, max_step=most * c[END],
            first_step=first,
        )  # fmt: skip
        y, v_y, v_x, omega_1, omega_2, twist = run.y[:, -1].tolist()
        z, time = (y, v_y, v_x, omega_1, omega_2, twist), float(run.t[-1])
        if run.status != 1 or time >= c[END] * (1.0 - 1e-12):
            break
        phase, z = after_event(c, phase, z)
    return outgoing(c, z)
