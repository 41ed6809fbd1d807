"""The programs of Appendix B run apart from each other, each with inputs of its own, in the units of the thesis.

Velocity while sliding, spin while sliding, transition and rolling were four worksheets into which every input was
typed anew, so that one could hold another's value; model `thesis` is the case where all hold the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from fitball.data.published import fraction
from fitball.inference.thesis import published_cases as thesis_inputs
from fitball.inference.thesis.published_cases import DAMPING, INCH, INERTIA, STIFFNESS
from fitball.models.thesis import Pair, ThesisContact, ThesisMotion, stray_impulse, thesis_motion
from fitball.models.types import Status
from fitball.thesis.appendix_c import COLUMNS

Inputs = Mapping[str, float]
# A row of the printed table, by its heads.
Row = Mapping[Any, Any]
# The programs, the search for the transition, and the rebound angle, which was worked out after them.
PROGRAMS = ("velocity", "spin", "rolling")
CODES = ("velocity", "spin", "transition", "rolling", "angle")
INPUTS = (
    *("v_x1", "v_y1", "offset_v_y1", "omega_1", "cor", "mass_ratio"),
    *("k_y", "c_y", "i1_over_i", "i2_over_i", "inertia", "radius"),
)
# Steps of `n := 0, 0.001 .. 1`, between which the transition is sought.
STEPS = np.linspace(0.0, 1.0, 1001)


def row_inputs(row: Row) -> dict[str, float]:
    """Inputs of a row of Appendix C by name, SI for velocities and spin, else inch, pound and second.

    `offset_v_y1` is the vertical velocity put into Eq. (53), which was worked out apart.
    """
    heads = ("v_x1 [m/s]", "v_y1 [m/s]", "v_y1 [m/s]", "omega_1 [rad/s]", "cor")
    incident = [float(row[name]) for name in heads]
    k_y, c_y, i1 = (float(row[name]) for name in ("k_y [lb/in]", "c_y [lb s/in]", "i1_over_i"))
    inertia, radius = thesis_inputs.INERTIA_OF[row["mass_ratio"]], thesis_inputs.BALL_RADIUS / INCH
    ball = (fraction(row["mass_ratio"]), k_y, c_y, i1, 1.0 - i1, inertia, radius)
    return dict(zip(INPUTS, (*incident, *ball), strict=True))


@dataclass(frozen=True)
class Clause:
    """`inputs` that stood in the worksheets `codes` instead of the row's own."""

    codes: tuple[str, ...]
    inputs: Inputs


def filled_in(own: Inputs, clauses: Iterable[Clause]) -> dict[str, Inputs]:
    """Inputs of every worksheet: `own` but for the clauses, of which a later one goes before an earlier one."""
    made = dict.fromkeys(CODES, own)
    for clause in clauses:
        changed: dict[int, Inputs] = {}
        for code in clause.codes:
            made[code] = changed.setdefault(id(made[code]), {**made[code], **clause.inputs})
    return made


def program(inputs: Inputs, ball_mass: float | None = None) -> ThesisMotion[float] | None:
    """A worksheet filled in, or None where its formulas have no solution."""
    mass = thesis_inputs.BALL_MASS if ball_mass is None else ball_mass
    core_mass = inputs["mass_ratio"] * mass
    sigma = 0.5 * inputs["c_y"] * DAMPING / core_mass
    if not sigma**2 < inputs["k_y"] * STIFFNESS / core_mass:
        return None
    moment = inputs["inertia"] * INERTIA
    contact = ThesisContact(
        mass=mass,
        radius=inputs["radius"] * INCH,
        inertia_core=inputs["i1_over_i"] * moment,
        inertia_shell=inputs["i2_over_i"] * moment,
        core_mass=core_mass,
        k_y=inputs["k_y"] * STIFFNESS,
        sigma=sigma,
        k_theta=thesis_inputs.K_THETA,
        mu=thesis_inputs.FRICTION,
        eps=(thesis_inputs.C1 * inputs["offset_v_y1"] + thesis_inputs.C2) * INCH,
        v_x=inputs["v_x1"],
        v_y=inputs["v_y1"],
        omega=inputs["omega_1"],
    )
    motion = thesis_motion(contact)
    return motion if motion.status == int(Status.OK) else None


def swing(motion: ThesisMotion[float], n: Any) -> Any:
    """`e^{zt}` at the dimensionless time `n = t/t_c`."""
    return np.exp(complex(*motion.z) * n * math.pi / motion.z.im)


def outputs(codes: Mapping[str, Inputs]) -> dict[str, float]:
    """Columns of Appendix C from the inputs of each of `CODES`; NaN where a worksheet has no solution.

    `v_y2` and `contact_time` [ms] are those of the worksheet for velocity.
    """
    first, last = codes["velocity"], codes["angle"]
    sheets = {id(codes[name]): codes[name] for name in PROGRAMS}
    solved = {key: program(inputs) for key, inputs in sheets.items()}
    velocity, spin, rolling = (solved[id(codes[name])] for name in PROGRAMS)
    # The printed contact times follow the rounded mass; see `thesis_inputs`.
    timing = program(first, thesis_inputs.BALL_MASS_ROUNDED)
    if velocity is None or spin is None or rolling is None or timing is None:
        return dict.fromkeys(COLUMNS, math.nan)
    v_x2, omega_2 = _tangential(codes, velocity, spin, rolling)
    angle = -math.degrees(math.atan2(last["cor"] * last["v_y1"], v_x2))
    return dict(zip(COLUMNS, (v_x2, -first["cor"] * first["v_y1"], omega_2, angle, 1e3 * timing.t_c), strict=True))


def _tangential(
    codes: Mapping[str, Inputs],
    velocity: ThesisMotion[float],
    spin: ThesisMotion[float],
    rolling: ThesisMotion[float],
) -> tuple[float, float]:
    """`v_x2` [m/s] and `omega_2` [rad/s]; the search for the transition has a radius of its own."""
    first, radius = codes["velocity"], codes["transition"]["radius"] * INCH

    def sliding(n: Any) -> tuple[Any, Any]:
        v_x = first["v_x1"] - (complex(*velocity.friction) * (swing(velocity, n) - 1.0)).real
        return v_x, codes["spin"]["omega_1"] + (complex(*spin.slide) * (swing(spin, n) - 1.0)).real

    def slip(n: Any) -> Any:
        v_x, omega = sliding(n)
        return velocity.sign * (v_x - radius * omega)

    gripped = np.flatnonzero(slip(STEPS) <= 0.0)
    if gripped.size == 0:
        v_x, omega = map(float, sliding(1.0))
        core_mass, end = first["mass_ratio"] * thesis_inputs.BALL_MASS, complex(swing(velocity, 1.0))
        stray = stray_impulse(core_mass, first["v_y1"], velocity.z, Pair(end.real, end.imag))
        return v_x - velocity.sign * thesis_inputs.FRICTION / thesis_inputs.BALL_MASS * stray, omega
    if gripped[0] == 0:
        return math.nan, math.nan
    n = float(brentq(slip, STEPS[gripped[0] - 1], STEPS[gripped[0]], xtol=1e-14))
    omega = float(sliding(n)[1] + (complex(*rolling.roll) * (swing(rolling, 1.0) - swing(rolling, n))).real)
    return codes["rolling"]["radius"] * INCH * omega, omega
