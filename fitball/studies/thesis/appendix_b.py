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

from fitball.data.thesis_tables import fraction
from fitball.inference.thesis import inputs as thesis_inputs
from fitball.inference.thesis.inputs import DAMPING, INCH, INERTIA, STIFFNESS
from fitball.models.thesis.kernel import ThesisContact, stray_impulse, thesis_motion
from fitball.models.types import Status

Inputs = Mapping[str, float]
# A row of the printed table, by its heads.
Row = Mapping[Any, Any]
# The four, and the rebound angle, which was worked out after them.
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
    ratio = row["mass_ratio"]
    heads = ("v_x1 [m/s]", "v_y1 [m/s]", "v_y1 [m/s]", "omega_1 [rad/s]", "cor")
    printed = [float(row[name]) for name in heads]
    k_y, c_y, i1 = (float(row[name]) for name in ("k_y [lb/in]", "c_y [lb s/in]", "i1_over_i"))
    rest = (
        fraction(ratio),
        k_y,
        c_y,
        i1,
        1.0 - i1,
        thesis_inputs.INERTIA_OF[ratio],
        thesis_inputs.BALL_RADIUS / INCH,
    )
    return dict(zip(INPUTS, (*printed, *rest), strict=True))


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


@dataclass(frozen=True)
class Program:
    """One worksheet: its `inputs` and the complex amplitudes of `models.thesis.thesis_motion`, SI."""

    inputs: Inputs
    sign: float
    z: complex
    friction: complex
    slide: complex
    roll: complex

    def swing(self, n: float) -> complex:
        """`e^{zt}` at the dimensionless time `n = t/t_c`."""
        return complex(np.exp(self.z * n * math.pi / self.z.imag))


def program(inputs: Inputs, ball_mass: float | None = None) -> Program | None:
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
    if motion.status != int(Status.OK):
        return None
    return Program(inputs, motion.sign, motion.z, motion.friction, motion.slide, motion.roll)


def outputs(codes: Mapping[str, Inputs]) -> dict[str, float]:
    """Columns of Appendix C from the inputs of each of `CODES`; NaN where a worksheet has no solution.

    `v_y2` and `contact_time` [ms] are those of the worksheet for velocity.
    """
    first = codes["velocity"]
    distinct: dict[int, Program | None] = {}
    for inputs in codes.values():
        if id(inputs) not in distinct:
            distinct[id(inputs)] = program(inputs)
    velocity, spin, rolling = (distinct[id(codes[name])] for name in ("velocity", "spin", "rolling"))
    # The printed contact times follow the rounded mass; see `thesis_inputs`.
    timing = program(first, thesis_inputs.BALL_MASS_ROUNDED)
    if velocity is None or spin is None or rolling is None or timing is None:
        return dict.fromkeys(("v_x2", "v_y2", "omega_2", "theta_2", "contact_time"), math.nan)
    v_x2, omega_2 = _tangential(velocity, spin, rolling, codes["transition"]["radius"] * INCH)
    last = codes["angle"]
    angle = -math.degrees(math.atan2(last["cor"] * last["v_y1"], v_x2))
    time = 1e3 * math.pi / timing.z.imag
    return {
        "v_x2": v_x2,
        "v_y2": -first["cor"] * first["v_y1"],
        "omega_2": omega_2,
        "theta_2": angle,
        "contact_time": time,
    }


def _tangential(velocity: Program, spin: Program, rolling: Program, radius: float) -> tuple[float, float]:
    """`v_x2` [m/s] and `omega_2` [rad/s]; `radius` [m] is that of the search for the transition."""

    def sliding(n: float) -> tuple[float, float]:
        v_x = velocity.inputs["v_x1"] - (velocity.friction * (velocity.swing(n) - 1.0)).real
        return v_x, spin.inputs["omega_1"] + (spin.slide * (spin.swing(n) - 1.0)).real

    def slip(n: float) -> float:
        v_x, omega = sliding(n)
        return velocity.sign * (v_x - radius * omega)

    phase_v, phase_s = (np.exp(item.z * STEPS * math.pi / item.z.imag) - 1.0 for item in (velocity, spin))
    course = velocity.inputs["v_x1"] - (velocity.friction * phase_v).real
    course = velocity.sign * (course - radius * (spin.inputs["omega_1"] + (spin.slide * phase_s).real))
    gripped = np.flatnonzero(course <= 0.0)
    if gripped.size == 0:
        v_x, omega = sliding(1.0)
        core_mass = velocity.inputs["mass_ratio"] * thesis_inputs.BALL_MASS
        stray = stray_impulse(
            core_mass, -velocity.z.real, velocity.inputs["v_y1"], velocity.z, velocity.swing(1.0)
        )  # fmt: skip
        return v_x - velocity.sign * thesis_inputs.FRICTION / thesis_inputs.BALL_MASS * stray, omega
    if gripped[0] == 0:
        return math.nan, math.nan
    n = float(brentq(slip, STEPS[gripped[0] - 1], STEPS[gripped[0]], xtol=1e-14))
    omega = sliding(n)[1] + (rolling.roll * (rolling.swing(1.0) - rolling.swing(n))).real
    return rolling.inputs["radius"] * INCH * omega, omega
