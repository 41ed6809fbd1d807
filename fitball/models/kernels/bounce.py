"""One bounce of any two-mass composition, as kernels; batches of them in `batch`.

A parameter set is a row whose columns are `COLUMNS`; closures are passed as integers so that one compiled kernel
serves every composition. Here stand the lines `COR(v_y1)` (another law of it in `restitution`) and `eps(v_y1)`
(Jafri 2004, Eq. 51: `eps = C1 v_y1 + C2`), the share of the core in the ball's inertia (Eqs 67 and 69) and `v_y2 =
COR v_y1` (Eq. 7); the motions themselves stand in `contact` (vertical), `two_mass` and `rigid`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.contact import vertical_contact
from fitball.models.kernels.dual import Number, NumberArray, sqrt
from fitball.models.kernels.oscillator import oscillator
from fitball.models.kernels.quantities import Bounce, Contact, Joint, Scratch, VerticalMotion
from fitball.models.kernels.restitution import ANCHOR_SPEED, saturating_restitution
from fitball.models.kernels.rigid import rigid_contact
from fitball.models.kernels.two_mass import two_mass_contact
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
(
    MASS_RATIO, K_Y, K_THETA, MU, EPS_10, EPS_SLOPE, COR_10, COR_SLOPE, ZETA_THETA, INERTIA_SPLIT,
    BALL_MASS, BALL_RADIUS, BALL_INERTIA,
) = range(len(COLUMNS))  # fmt: skip
# Inner radius of the shell in units of the outer one, for the split of inertia (Jafri 2004, Appendix B).
CORE_RADIUS_RATIO = 0.97

# What the integers of `codes` choose, and their values.
RELEASE, NORMAL, OFFSET, SPIN, INERTIA, TORSION, RESTITUTION, TANGENTIAL = range(8)
RELEASE_ZERO_FORCE, OFFSET_CONTACT, SPIN_SHELL, INERTIA_TIED = 1, 1, 1, 1
NORMAL_INNER, NORMAL_MOMENTUM, NORMAL_TOTAL = 0, 1, 2
TORSION_MATCHED, TORSION_FREE, TORSION_RIGID = 0, 1, 2
COR_LINE, COR_MEAN, COR_MEASURED, COR_SATURATING = 0, 1, 2, 3

OK = int(Status.OK)
TORSION_TOO_SOFT = int(Status.TORSION_TOO_SOFT)
NO_INERTIA = int(Status.NO_INERTIA)
REBOUND_FALLS = int(Status.REBOUND_FALLS)


@inner
def tied_inertia_split(mass_ratio: Number) -> Number:
    """`I1/I` of a solid core in a thin shell (Eqs 67 and 69 with their fractions in the right order)."""
    core = 0.4 * CORE_RADIUS_RATIO * CORE_RADIUS_RATIO * mass_ratio
    return core / (core + 2.0 / 3.0 * (1.0 - mass_ratio))


@inner
def tied_shell_share(mass_ratio: Number) -> Number:
    """`1 - I1/I` of `tied_inertia_split`, to full precision where the shell is light."""
    shell = 2.0 / 3.0 * (1.0 - mass_ratio)
    return shell / (0.4 * CORE_RADIUS_RATIO * CORE_RADIUS_RATIO * mass_ratio + shell)


@inlined
def vertical_motion(
    row: NumberArray, codes: NDArray[np.int64], v_y: Number, cor_measured: Number
) -> tuple[int, VerticalMotion[Number]]:
    """Status and vertical motion of one impact."""
    mass_ratio, normal = row[MASS_RATIO], codes[NORMAL]
    cor = row[COR_10]
    cap = mass_ratio if normal == NORMAL_MOMENTUM else 1.0 + 0.0 * cor
    if codes[RESTITUTION] == COR_LINE:
        cor += row[COR_SLOPE] * (v_y - ANCHOR_SPEED)
    elif codes[RESTITUTION] == COR_MEASURED:
        cor = cor_measured
    elif codes[RESTITUTION] == COR_SATURATING:
        cor = saturating_restitution(cor, row[COR_SLOPE], cap, v_y)
    riding_mass = row[BALL_MASS] if normal == NORMAL_TOTAL else mass_ratio * row[BALL_MASS]
    natural_squared = row[K_Y] / riding_mass
    status, decay, damped_squared, t_force, t_contact = vertical_contact(
        cor,
        cap,
        natural_squared,
        codes[RELEASE] == RELEASE_ZERO_FORCE,
    )
    if codes[RESTITUTION] == COR_SATURATING and ANCHOR_SPEED * row[COR_SLOPE].real <= -row[COR_10].real:
        status = REBOUND_FALLS
    spring = oscillator(decay, damped_squared, natural_squared)
    return status, VerticalMotion(cor, riding_mass, spring, t_force, t_contact)


@inlined
def joint_of(row: NumberArray, codes: NDArray[np.int64], vertical_squared: Number) -> tuple[int, Joint[Number]]:
    """Status and torsional joint; with `torsion = matched` its damped frequency squared is the vertical one,
    `vertical_squared`, with `rigid` the shell is the whole ball.
    """
    mass_ratio, stiffness, inertia = row[MASS_RATIO], row[K_THETA], row[BALL_INERTIA]
    nothing = 0.0 * inertia
    if codes[TORSION] == TORSION_RIGID:
        return OK, Joint(nothing, inertia, nothing, nothing, nothing)
    tied = codes[INERTIA] == INERTIA_TIED
    core = inertia * (tied_inertia_split(mass_ratio) if tied else row[INERTIA_SPLIT])
    shell = inertia * (tied_shell_share(mass_ratio) if tied else 1.0 - row[INERTIA_SPLIT])
    if not (core.real > 0.0 and shell.real > 0.0):
        return NO_INERTIA, Joint(core, shell, nothing, nothing, nothing)
    compliance = 1.0 / core + 1.0 / shell
    natural_squared = stiffness * compliance
    if codes[TORSION] == TORSION_MATCHED:
        if natural_squared.real < vertical_squared.real:
            return TORSION_TOO_SOFT, Joint(core, shell, nothing, nothing, nothing)
        decay = sqrt(natural_squared - vertical_squared)
        return OK, Joint(core, shell, stiffness, 2.0 * decay / compliance, vertical_squared)
    zeta = row[ZETA_THETA]
    decay = zeta * sqrt(natural_squared)
    slide_squared = natural_squared * (1.0 - zeta) * (1.0 + zeta)
    return OK, Joint(core, shell, stiffness, 2.0 * decay / compliance, slide_squared)


@inlined
def contact_of(
    row: NumberArray,
    codes: NDArray[np.int64],
    vertical: VerticalMotion[Number],
    v_x: Number,
    v_y: Number,
    omega: Number,
) -> tuple[int, Contact[Number]]:
    """Status and contact of one impact whose vertical motion is known."""
    status, joint = joint_of(row, codes, vertical.spring.damped_squared)
    landing = 0.0 * v_y
    if codes[NORMAL] == NORMAL_MOMENTUM:
        landing = (1.0 - row[MASS_RATIO]) * row[BALL_MASS] * v_y
    eps = row[EPS_10] + row[EPS_SLOPE] * (v_y - ANCHOR_SPEED)
    return status, Contact(
        row[BALL_MASS], row[BALL_RADIUS], joint, row[MU], eps, codes[OFFSET] == OFFSET_CONTACT,
        codes[SPIN] == SPIN_SHELL, landing, vertical, v_x, v_y, omega,
    )  # fmt: skip


@inner
def unsolved(status: int, regime: int) -> Bounce:
    """The bounce of an impact that cannot be evaluated."""
    return Bounce(status, math.nan, math.nan, math.nan, math.nan, regime, 0)


@inner
def bounce(
    row: FloatArray,
    codes: NDArray[np.int64],
    v_x: float,
    v_y: float,
    omega: float,
    cor_measured: float,
    scratch: Scratch,
    phase_log: FloatArray | None,
) -> Bounce:
    """Solve one impact; `codes` as named above, `phase_log` as in `two_mass_contact`."""
    status, vertical = vertical_motion(row, codes, v_y, cor_measured)
    if status != OK:
        return unsolved(status, 0)
    v_y2 = vertical.cor * v_y
    if codes[TANGENTIAL] == 0:
        return Bounce(OK, v_x, v_y2, omega, vertical.t_contact, 0, 0)
    status, contact = contact_of(row, codes, vertical, v_x, v_y, omega)
    if status != OK:
        return unsolved(status, 0)
    if codes[TORSION] == TORSION_RIGID:
        v_x2, omega_2, regime = rigid_contact(contact)
        return Bounce(OK, v_x2, v_y2, omega_2, vertical.t_contact, regime, 0)
    status, v_x2, omega_2, regime, pieces = two_mass_contact(contact, scratch, phase_log)
    if status != OK:
        return unsolved(status, regime)
    return Bounce(OK, v_x2, v_y2, omega_2, vertical.t_contact, regime, pieces)
