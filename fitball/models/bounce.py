"""One bounce of any two-mass composition, and batches over draws and impacts, as kernels.

A parameter set is a row whose columns are `COLUMNS`; closures are passed as integers so that one compiled
kernel serves every composition.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fitball.models.compiled import compiled, compiled_allocating
from fitball.models.contact import vertical_contact
from fitball.models.rigid import rigid_contact
from fitball.models.two_mass import Scratch, make_scratch, two_mass_contact
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
def tied_inertia_split(mass_ratio: float) -> float:
    """`I1/I` of a solid core in a thin shell (Eqs 67 and 69 with their fractions in the right order)."""
    core = 0.4 * CORE_RADIUS_RATIO * CORE_RADIUS_RATIO * mass_ratio
    return core / (core + 2.0 / 3.0 * (1.0 - mass_ratio))


@compiled
def tied_shell_share(mass_ratio: float) -> float:
    """`1 - I1/I` of `tied_inertia_split`, to full precision where the shell is light."""
    shell = 2.0 / 3.0 * (1.0 - mass_ratio)
    return shell / (0.4 * CORE_RADIUS_RATIO * CORE_RADIUS_RATIO * mass_ratio + shell)


@compiled
def bounce(
    row: FloatArray,
    codes: NDArray[np.int64],
    v_x: float,
    v_y: float,
    omega: float,
    cor_measured: float,
    scratch: Scratch,
) -> tuple[int, float, float, float, float, int]:
    """Return `(status, v_x2, v_y2, omega_2, contact_time, regime)` of one impact.

    `codes` are (release is zero_force, normal, offset is contact, spin is shell, inertia is tied, torsion,
    cor, tangential motion wanted).
    """
    mass_ratio, k_y, mu = row[0], row[1], row[3]
    mass, radius, inertia = row[10], row[11], row[12]
    normal, torsion = codes[1], codes[5]
    cor = row[6]
    if codes[6] == COR_LINE:
        cor += row[7] * (v_y - ANCHOR_SPEED)
    elif codes[6] == COR_MEASURED:
        cor = cor_measured
    riding_mass = mass if normal == NORMAL_TOTAL else mass_ratio * mass
    omega2 = k_y / riding_mass
    status, sigma, w2, t_force, t_contact = vertical_contact(
        cor, mass_ratio if normal == NORMAL_MOMENTUM else 1.0, omega2, codes[0] == 1
    )
    if status != OK:
        return status, math.nan, math.nan, math.nan, math.nan, 0
    if codes[7] == 0:
        return OK, v_x, cor * v_y, omega, t_contact, 0
    landing = (1.0 - mass_ratio) * mass * v_y if normal == NORMAL_MOMENTUM else 0.0
    eps = row[4] + row[5] * (v_y - ANCHOR_SPEED)
    eps_in_slide = codes[2] == 1
    if torsion == TORSION_RIGID:
        # Impulse of the compressive force: what the core's momentum loses by the time it ends.
        e_force = math.exp(-sigma * t_force)
        v_x2, omega_2, regime = rigid_contact(
            mass, radius, inertia, mu, eps, eps_in_slide,
            landing, landing + riding_mass * v_y * (1.0 + e_force), t_contact > t_force, v_x, omega,
        )  # fmt: skip
        return OK, v_x2, cor * v_y, omega_2, t_contact, regime
    tied = codes[4] == 1
    inertia_core = inertia * (tied_inertia_split(mass_ratio) if tied else row[9])
    inertia_shell = inertia * (tied_shell_share(mass_ratio) if tied else 1.0 - row[9])
    if not (inertia_core > 0.0 and inertia_shell > 0.0):
        return NO_INERTIA, math.nan, math.nan, math.nan, math.nan, 0
    compliance = 1.0 / inertia_core + 1.0 / inertia_shell
    natural2 = row[2] * compliance
    if torsion == TORSION_MATCHED:
        if natural2 < w2:
            return TORSION_TOO_SOFT, math.nan, math.nan, math.nan, math.nan, 0
        decay = math.sqrt(natural2 - w2)
        w2_slide = w2
    else:
        zeta = row[8]
        decay = zeta * math.sqrt(natural2)
        w2_slide = natural2 * (1.0 - zeta) * (1.0 + zeta)
    status, v_x2, omega_2, regime = two_mass_contact(
        mass, radius, inertia_core, inertia_shell, row[2], 2.0 * decay / compliance, w2_slide,
        mu, eps, eps_in_slide, codes[3] == 1, riding_mass, landing, omega2, sigma, w2, t_force, t_contact,
        v_x, v_y, omega, scratch,
    )  # fmt: skip
    if status != OK:
        return status, math.nan, math.nan, math.nan, math.nan, regime
    return OK, v_x2, cor * v_y, omega_2, t_contact, regime


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
    """Fill `out` (4, draws, impacts) with v_x2, v_y2, omega_2, contact_time, and regimes and statuses."""
    scratch = make_scratch()
    for i in range(rows.shape[0]):
        row = rows[i]
        for j in range(v_x1.shape[0]):
            found, v_x2, v_y2, omega_2, time, phases = bounce(
                row, codes, v_x1[j], v_y1[j], omega_1[j], cor[j], scratch
            )
            out[0, i, j] = v_x2
            out[1, i, j] = v_y2
            out[2, i, j] = omega_2
            out[3, i, j] = time
            regime[i, j] = phases
            status[i, j] = found
