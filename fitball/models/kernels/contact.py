"""What a contact along the court starts with: the joint of core and shell, and the landing impulse, as kernels.

The shell stops at once and friction acts with it: while the impulse `J` grows from 0 to `J0`, the slip obeys `du/dJ =
-s mu A + R eps/I_s` with the constant compliance `A = 1/M + R^2/I_s`: a bounce with constant force ratio, so
Coulomb's law can be followed exactly. Not in the thesis, whose shell has mass but is not stopped.

The same law carries the whole contact, landing impulse included and without a search in time, when shell and core
turn as one (`I_s = I`): with `K_theta` infinite the friction a grip needs is a constant share of the normal force.
Not in the thesis, whose joint is elastic.

Here stand also the line `eps(v_y1)` (Jafri 2004, Eq. 51: `eps = C1 v_y1 + C2`) and the share of the core in the
ball's inertia (Eqs 67 and 69).
"""

from __future__ import annotations

from typing import Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.dual import Number, NumberArray, sqrt
from fitball.models.kernels.vertical import (
    ANCHOR_SPEED,
    BALL_INERTIA,
    BALL_MASS,
    BALL_RADIUS,
    EPS_10,
    EPS_SLOPE,
    INERTIA,
    INERTIA_SPLIT,
    INERTIA_TIED,
    K_THETA,
    MASS_RATIO,
    MU,
    NORMAL,
    NORMAL_MOMENTUM,
    OFFSET,
    OFFSET_CONTACT,
    OK,
    SPIN,
    SPIN_SHELL,
    TORSION,
    TORSION_MATCHED,
    TORSION_RIGID,
    ZETA_THETA,
    VerticalMotion,
    vertical_at,
)
from fitball.models.types import Status


class Joint(NamedTuple, Generic[Number]):
    """Moments of inertia [kg m^2] and the torsional spring [N m] and damper [N m s] between them;
    `slide_squared` is its damped frequency squared while the contact slides.
    """

    core: Number
    shell: Number
    stiffness: Number
    damping: Number
    slide_squared: Number


class Contact(NamedTuple, Generic[Number]):
    """All that decides one contact: ball, joint, court, and the state just before landing.

    `eps` [m] is the offset of the normal force, acting during slip too if `eps_in_slide`; `landing` [N s] the impulse
    that stops the shell; `shell_spin` whether the shell's spin is the ball's, instead of the mean of both.
    """

    mass: Number
    radius: Number
    joint: Joint[Number]
    mu: Number
    eps: Number
    eps_in_slide: bool
    shell_spin: bool
    landing: Number
    vertical: VerticalMotion[Number]
    v_x: Number
    v_y: Number
    omega: Number


# Inner radius of the shell in units of the outer one, for the split of inertia (Jafri 2004, Appendix B).
CORE_RADIUS_RATIO = 0.97
TORSION_TOO_SOFT = int(Status.TORSION_TOO_SOFT)
NO_INERTIA = int(Status.NO_INERTIA)


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
def friction_impulse(
    slip: Number, impulse: Number, mu: Number, drive_slide: Number, drive_grip: Number, compliance: Number
) -> tuple[Number, Number, Number, float]:
    """Friction impulse that goes with a normal impulse `impulse` at constant force ratio.

    `drive_slide`, `drive_grip` are `R eps/(I_s A)`: the friction, as a share of the normal force, needed to
    balance the offset while it acts. Returns `(friction, slipped, held, onward)`: the impulse that retards the
    ball [N s], the part of `impulse` spent slipping, the part spent at zero slip without offset (hold), and
    the direction (+1, -1, or 0) in which an overpowered contact slips on from zero slip.
    """
    friction = 0.0 * impulse
    # Slip of zero has nothing to stop but what it may carry.
    stopped = 0.0 * impulse
    left = impulse
    direction = 0.0
    if slip.real > 0.0:
        direction = 1.0
    elif slip.real < 0.0:
        direction = -1.0
    if direction != 0.0:
        # Rate at which the slip, counted in its own direction, is worn down per impulse.
        rate = compliance * (mu - direction * drive_slide)
        if rate.real * impulse.real <= direction * slip.real:
            return direction * mu * impulse, impulse, 0.0, 0.0
        spent = direction * slip / rate
        friction = direction * mu * spent
        left = impulse - spent
    elif mu.real > 0.0:
        stopped = slip / compliance
    if abs(drive_grip.real) <= mu.real:
        return friction + stopped + drive_grip * left, impulse - left, 0.0, 0.0
    if abs(drive_slide.real) <= mu.real:
        return friction + stopped, impulse - left, left, 0.0
    # The offset overcomes friction: the contact slips on in the direction it drives.
    onward = 1.0 if drive_slide.real > 0.0 else -1.0
    return friction + onward * mu * left, impulse, 0.0, onward


@inlined
def impulsive_friction(contact: Contact[Number], impulse: Number) -> tuple[Number, Number, Number, float]:
    """`friction_impulse` of a contact whose shell alone turns with the court."""
    inertia, radius = contact.joint.shell, contact.radius
    compliance = 1.0 / contact.mass + radius * radius / inertia
    need = radius * contact.eps / (inertia * compliance)
    return friction_impulse(
        contact.v_x - radius * contact.omega,
        impulse,
        contact.mu,
        need if contact.eps_in_slide else 0.0 * need,
        need,
        compliance,
    )


@inlined
def landed(contact: Contact[Number]) -> tuple[Number, Number, bool]:
    """`(v_x, omega_2, stuck)` just after the landing impulse: `stuck` if it has used up the slip."""
    impulse = contact.landing
    friction, slipped, held, _onward = impulsive_friction(contact, impulse)
    acting = impulse if contact.eps_in_slide else impulse - slipped - held
    turned = contact.omega + (contact.radius * friction - contact.eps * acting) / contact.joint.shell
    return contact.v_x - friction / contact.mass, turned, slipped.real < impulse.real


@inner
def impulse_at(contact: Contact[float], t: float) -> float:
    """Normal impulse since landing, that of landing included [N s]."""
    _y, y_rate = vertical_at(contact.vertical.spring, contact.v_y, t)
    return contact.landing + contact.vertical.riding_mass * (contact.v_y - y_rate)
