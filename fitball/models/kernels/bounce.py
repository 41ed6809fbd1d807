"""One bounce of any two-mass composition, and batches over draws and impacts, as kernels.

A parameter set is a row whose columns are `COLUMNS`; closures are passed as integers so that one compiled
kernel serves every composition.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import compiled, compiled_allocating, inlined
from fitball.models.kernels.contact import vertical_contact
from fitball.models.kernels.dual import Number, NumberArray, exp, sqrt
from fitball.models.kernels.rigid import rigid_contact
from fitball.models.kernels.two_mass import Scratch, make_scratch, two_mass_contact
from fitball.models.types import Status
from fitball.values import FloatArray

COLUMNS = (
    "mass_ratio",
    "k_y",
    "k_theta",
    "mu",
    "eps_10",
    "eps_slope",
    "cor_10",
    "cor_slope",
    "zeta_theta",
    "inertia_split",
    "ball_mass",
    "ball_radius",
    "ball_inertia",
)
# Speed at which the lines of `eps` and of the coefficient of restitution are anchored [m/s].
ANCHOR_SPEED = 10.0
# Inner radius of the shell in units of the outer one, for the split of inertia (Jafri 2004, Appendix B).
CORE_RADIUS_RATIO = 0.97

NORMAL_INNER, NORMAL_MOMENTUM, NORMAL_TOTAL = 0, 1, 2
TORSION_MATCHED, TORSION_FREE, TORSION_RIGID = 0, 1, 2
COR_LINE, COR_MEAN, COR_MEASURED = 0, 1, 2

OK = int(Status.OK)
TORSION_TOO_SOFT = int(Status.TORSION_TOO_SOFT)
NO_INERTIA = int(Status.NO_INERTIA)


@compiled
def tied_inertia_split(mass_ratio: Number) -> Number:
    """`I1/I` of a solid core in a thin shell (Eqs 67 and 69 with their fractions in the right order)."""
    core = 0.4 * CORE_RADIUS_RATIO * CORE_RADIUS_RATIO * mass_ratio
    return core / (core + 2.0 / 3.0 * (1.0 - mass_ratio))


@compiled
def tied_shell_share(mass_ratio: Number) -> Number:
    """`1 - I1/I` of `tied_inertia_split`, to full precision where the shell is light."""
    shell = 2.0 / 3.0 * (1.0 - mass_ratio)
    return shell / (0.4 * CORE_RADIUS_RATIO * CORE_RADIUS_RATIO * mass_ratio + shell)


@inlined
def vertical_motion(
    row: NumberArray, codes: NDArray[np.int64], v_y: Number, cor_measured: Number
) -> tuple[int, Number, Number, Number, Number, Number, Number, Number]:
    """Return `(status, cor, riding_mass, omega2, sigma, w2, t_force, t_contact)` of one impact.

    `riding_mass` [kg] is that on the vertical spring, the rest as in `vertical_contact`.
    """
    mass_ratio, mass, normal = row[0], row[10], codes[1]
    cor = row[6]
    if codes[6] == COR_LINE:
        cor += row[7] * (v_y - ANCHOR_SPEED)
    elif codes[6] == COR_MEASURED:
        cor = cor_measured
    riding_mass = mass if normal == NORMAL_TOTAL else mass_ratio * mass
    omega2 = row[1] / riding_mass
    status, sigma, w2, t_force, t_contact = vertical_contact(
        cor, mass_ratio if normal == NORMAL_MOMENTUM else 1.0 + 0.0 * cor, omega2, codes[0] == 1
    )
    return status, cor, riding_mass, omega2, sigma, w2, t_force, t_contact


@inlined
def landing_and_offset(row: NumberArray, codes: NDArray[np.int64], v_y: Number) -> tuple[Number, Number]:
    """Landing impulse that stops the shell [N s], and the offset of the normal force [m] at this speed."""
    mass_ratio = row[0]
    landing = (1.0 - mass_ratio) * row[10] * v_y if codes[1] == NORMAL_MOMENTUM else 0.0 * v_y
    return landing, row[4] + row[5] * (v_y - ANCHOR_SPEED)


@inlined
def joint(row: NumberArray, codes: NDArray[np.int64], w2: Number) -> tuple[int, Number, Number, Number, Number]:
    """Return `(status, inertia_core, inertia_shell, damping, w2_slide)` of the torsional joint.

    `w2` is the damped vertical frequency squared, which `torsion = matched` repeats.
    """
    mass_ratio, inertia = row[0], row[12]
    tied = codes[4] == 1
    inertia_core = inertia * (tied_inertia_split(mass_ratio) if tied else row[9])
    inertia_shell = inertia * (tied_shell_share(mass_ratio) if tied else 1.0 - row[9])
    if not (inertia_core.real > 0.0 and inertia_shell.real > 0.0):
        return NO_INERTIA, inertia_core, inertia_shell, inertia, w2
    compliance = 1.0 / inertia_core + 1.0 / inertia_shell
    natural2 = row[2] * compliance
    if codes[5] == TORSION_MATCHED:
        if natural2.real < w2.real:
            return TORSION_TOO_SOFT, inertia_core, inertia_shell, inertia, w2
        decay = sqrt(natural2 - w2)
        return OK, inertia_core, inertia_shell, 2.0 * decay / compliance, w2
    zeta = row[8]
    decay = zeta * sqrt(natural2)
    return OK, inertia_core, inertia_shell, 2.0 * decay / compliance, natural2 * (1.0 - zeta) * (1.0 + zeta)


@inlined
def rigid_impulse(landing: Number, riding_mass: Number, v_y: Number, sigma: Number, t_force: Number) -> Number:
    """Normal impulse of a contact [N s]: what the core's momentum loses by the time the compressive force ends."""
    return landing + riding_mass * v_y * (1.0 + exp(-sigma * t_force))


@compiled
def bounce(
    row: FloatArray,
    codes: NDArray[np.int64],
    v_x: float,
    v_y: float,
    omega: float,
    cor_measured: float,
    scratch: Scratch,
    record: FloatArray | None,
) -> tuple[int, float, float, float, float, int, int]:
    """Return `(status, v_x2, v_y2, omega_2, contact_time, regime, pieces)` of one impact.

    `codes` are (release is zero_force, normal, offset is contact, spin is shell, inertia is tied, torsion,
    cor, tangential motion wanted). `record` and `pieces` as in `two_mass_contact`.
    """
    status, cor, riding_mass, omega2, sigma, w2, t_force, t_contact = vertical_motion(row, codes, v_y, cor_measured)
    if status != OK:
        return status, math.nan, math.nan, math.nan, math.nan, 0, 0
    if codes[7] == 0:
        return OK, v_x, cor * v_y, omega, t_contact, 0, 0
    mu, mass, radius = row[3], row[10], row[11]
    landing, eps = landing_and_offset(row, codes, v_y)
    eps_in_slide = codes[2] == 1
    if codes[5] == TORSION_RIGID:
        v_x2, omega_2, regime = rigid_contact(
            mass, radius, row[12], mu, eps, eps_in_slide,
            landing, rigid_impulse(landing, riding_mass, v_y, sigma, t_force), t_contact > t_force, v_x, omega,
        )  # fmt: skip
        return OK, v_x2, cor * v_y, omega_2, t_contact, regime, 0
    status, inertia_core, inertia_shell, damping, w2_slide = joint(row, codes, w2)
    if status != OK:
        return status, math.nan, math.nan, math.nan, math.nan, 0, 0
    status, v_x2, omega_2, regime, pieces = two_mass_contact(
        mass, radius, inertia_core, inertia_shell, row[2], damping, w2_slide,
        mu, eps, eps_in_slide, codes[3] == 1, riding_mass, landing, omega2, sigma, w2, t_force, t_contact,
        v_x, v_y, omega, scratch, record,
    )  # fmt: skip
    if status != OK:
        return status, math.nan, math.nan, math.nan, math.nan, regime, 0
    return OK, v_x2, cor * v_y, omega_2, t_contact, regime, pieces


@compiled_allocating
def bounce_batch(
    rows: FloatArray,
    codes: NDArray[np.int64],
    v_x1: FloatArray,
    v_y1: FloatArray,
    omega_1: FloatArray,
    cor: FloatArray,
    out: FloatArray,
    regime: NDArray[np.int64],
    status: NDArray[np.int8],
) -> None:
    """Fill `out` (4, draws, impacts) with v_x2, v_y2, omega_2, contact_time, and regimes and statuses.

    The incident columns are (1, impacts), shared by all draws, or (draws, impacts).
    """
    scratch = make_scratch()
    for i in range(rows.shape[0]):
        row = rows[i]
        own = i if v_x1.shape[0] > 1 else 0
        for j in range(v_x1.shape[1]):
            found, v_x2, v_y2, omega_2, time, phases, _pieces = bounce(
                row, codes, v_x1[own, j], v_y1[own, j], omega_1[own, j], cor[own, j], scratch, None
            )
            out[0, i, j] = v_x2
            out[1, i, j] = v_y2
            out[2, i, j] = omega_2
            out[3, i, j] = time
            regime[i, j] = phases
            status[i, j] = found
