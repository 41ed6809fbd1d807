"""What a contact starts with, for eight impacts: vertical motion, joint, and the ball just after the landing impulse.

The equations are those of `contact`, `bounce` and `landing`; a lane for which they do not have their plainest answer
(restitution out of range or near critical damping, soft or overdamped joint, no friction, slip that is rounding) is
not `plain` and left to the scalar kernel, which knows why.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.contact import (
    ANCHOR_SPEED,
    BALL_INERTIA,
    BALL_MASS,
    BALL_RADIUS,
    COLUMNS,
    COR_10,
    COR_MEASURED,
    COR_SATURATING,
    COR_SLOPE,
    EPS_10,
    EPS_SLOPE,
    INERTIA,
    INERTIA_SPLIT,
    INERTIA_TIED,
    K_THETA,
    K_Y,
    MASS_RATIO,
    MU,
    NEAR_UNDAMPED,
    NORMAL,
    NORMAL_MOMENTUM,
    NORMAL_TOTAL,
    OFFSET,
    OFFSET_CONTACT,
    RELEASE,
    RELEASE_ZERO_FORCE,
    RESTITUTION,
    SPIN,
    SPIN_SHELL,
    TORSION,
    TORSION_MATCHED,
    ZETA_THETA,
    Contact,
    Joint,
    VerticalMotion,
    tied_inertia_split,
    tied_shell_share,
)
from fitball.models.kernels.dual import choose
from fitball.models.kernels.lanes.number import LaneArray, Lanes, Mask, log, sin_cos
from fitball.models.kernels.oscillator import oscillator

# Rows of what the bounce of eight impacts takes: their parameters, the impacts themselves, and, for closures whose
# vertical motion is found impact by impact, what that is.
V_X, V_Y, OMEGA, COR, DECAY, DAMPED_SQUARED, T_FORCE, T_CONTACT, T_FLIGHT = range(len(COLUMNS), len(COLUMNS) + 9)
INPUTS = len(COLUMNS) + 9
# Share of two terms below which their difference is left to the scalar kernel: it may be their rounding.
ROUNDING = 1e-13


@inlined
def zero_force_lanes(e: Lanes) -> tuple[Lanes, Lanes, Lanes, Mask]:
    """`contact.zero_force_release` where it solves `(pi/2 - d) tan(d) = x`; and whether it does."""
    x = -0.5 * log(e)
    # With b = pi/2 - d, pi^2/4 - b^2 is nearly linear in x: a cubic gives d to 2e-6, one step of Halley to rounding.
    fall = x * (2.000003486864854 + x * (0.40516162568421166 + x * (0.05897951467165539 + x * 0.0032864792961968276)))
    d = fall / (0.5 * math.pi + math.sqrt(0.25 * math.pi * math.pi - fall))
    sine, cosine = sin_cos(d)
    arm = 0.5 * math.pi - d
    f = arm * sine - x * cosine
    f1 = arm * cosine - (1.0 - x) * sine
    f2 = (x - 2.0) * cosine - arm * sine
    step = f * f1 / (f1 * f1 - 0.5 * f * f2)
    d = d - step
    turn = 0.5 * step * step
    sine, cosine = sine - (step * cosine + turn * sine), cosine + (step * sine - turn * cosine)
    return sine, cosine * cosine, (math.pi - 2.0 * d) / cosine, x < NEAR_UNDAMPED


@inner
def vertical_in_lanes(codes: NDArray[np.int64]) -> bool:
    """Whether `vertical_lanes` solves for the vertical motion; else each impact brings its own."""
    return bool(codes[RELEASE] == RELEASE_ZERO_FORCE and codes[RESTITUTION] != COR_SATURATING)


@inlined
def vertical_lanes(given: LaneArray, codes: NDArray[np.int64]) -> tuple[Mask, VerticalMotion[Lanes]]:
    """`bounce.vertical_motion`, and of which lanes."""
    ratio = given[MASS_RATIO]
    riding_mass = given[BALL_MASS] if codes[NORMAL] == NORMAL_TOTAL else ratio * given[BALL_MASS]
    natural_squared = given[K_Y] / riding_mass
    cor, decay, damped_squared = given[COR], given[DECAY], given[DAMPED_SQUARED]
    t_force, t_contact, t_flight = given[T_FORCE], given[T_CONTACT], given[T_FLIGHT]
    plain = damped_squared > 0.0
    if vertical_in_lanes(codes):
        if codes[RESTITUTION] != COR_MEASURED:
            cor = given[COR_10] + given[COR_SLOPE] * (given[V_Y] - ANCHOR_SPEED)
        share_kept = ratio if codes[NORMAL] == NORMAL_MOMENTUM else 1.0 + 0.0 * ratio
        e = cor / share_kept
        plain = (natural_squared > 0.0) & (cor > 0.0) & (cor <= 1.0) & (e > 0.0) & (e <= 1.0)
        zeta, share, angle, under = zero_force_lanes(choose(plain, e, 0.5))
        plain = plain & under
        omega_y = math.sqrt(natural_squared)
        decay, damped_squared, t_force = zeta * omega_y, share * natural_squared, angle / omega_y
        t_contact, t_flight = t_force, t_force + 2.0 * zeta / (share_kept * omega_y)
    return plain, VerticalMotion(
        cor, riding_mass, oscillator(decay, damped_squared, natural_squared), t_force, t_contact, t_flight
    )


@inlined
def joint_lanes(given: LaneArray, codes: NDArray[np.int64], vertical_squared: Lanes) -> tuple[Mask, Joint[Lanes]]:
    """`bounce.joint_of` of an elastic joint, and of which lanes."""
    inertia, stiffness = given[BALL_INERTIA], given[K_THETA]
    if codes[INERTIA] == INERTIA_TIED:
        core = inertia * tied_inertia_split(given[MASS_RATIO])
        shell = inertia * tied_shell_share(given[MASS_RATIO])
    else:
        core, shell = inertia * given[INERTIA_SPLIT], inertia * (1.0 - given[INERTIA_SPLIT])
    compliance = 1.0 / core + 1.0 / shell
    natural_squared = stiffness * compliance
    if codes[TORSION] == TORSION_MATCHED:
        gap = natural_squared - vertical_squared
        decay = math.sqrt(max(gap, 0.0))
        plain, slide_squared = gap >= 0.0, vertical_squared
    else:
        zeta = given[ZETA_THETA]
        decay = zeta * math.sqrt(natural_squared)
        slide_squared = natural_squared * (1.0 - zeta) * (1.0 + zeta)
        plain = natural_squared > 0.0
    plain = plain & (core > 0.0) & (shell > 0.0)
    return plain, Joint(core, shell, stiffness, 2.0 * decay / compliance, slide_squared)


@inlined
def contact_lanes(given: LaneArray, codes: NDArray[np.int64]) -> tuple[Mask, Contact[Lanes]]:
    """The contacts of eight impacts, and which of them are plain."""
    plain, vertical = vertical_lanes(given, codes)
    elastic, joint = joint_lanes(given, codes, vertical.spring.damped_squared)
    v_y, mass = given[V_Y], given[BALL_MASS]
    landing = 0.0 * v_y
    if codes[NORMAL] == NORMAL_MOMENTUM:
        landing = (1.0 - given[MASS_RATIO]) * mass * v_y
    eps = given[EPS_10] + given[EPS_SLOPE] * (v_y - ANCHOR_SPEED)
    return plain & elastic & (given[MU] > 0.0), Contact(
        mass, given[BALL_RADIUS], joint, given[MU], eps, codes[OFFSET] == OFFSET_CONTACT, codes[SPIN] == SPIN_SHELL,
        landing, vertical, given[V_X], v_y, given[OMEGA],
    )  # fmt: skip


@inlined
def landed_lanes(contact: Contact[Lanes]) -> tuple[Lanes, Lanes, Mask, Mask]:
    """`landing.landed`: `(v_x, omega_2, stuck, plain)`, where no slip turns round and none is rounding."""
    impulse, mu, inertia, radius = contact.landing, contact.mu, contact.joint.shell, contact.radius
    compliance = 1.0 / contact.mass + radius * radius / inertia
    need = radius * contact.eps / (inertia * compliance)
    need_slide = need if contact.eps_in_slide else 0.0 * need
    slip = contact.v_x - radius * contact.omega
    side = choose(slip > 0.0, 1.0, -1.0)
    rate = compliance * (mu - side * need_slide)
    through = rate * impulse <= abs(slip)
    left = choose(through, 0.0, impulse - abs(slip) / rate)
    # Slip stopped early: friction then balances the offset, or holds without it where it acts in a grip alone.
    grips = abs(need) <= mu
    friction = side * mu * (impulse - left) + choose(grips, need, 0.0) * left
    acting = impulse if contact.eps_in_slide else choose(through, 0.0, choose(grips, left, 0.0))
    omega_2 = contact.omega + (radius * friction - contact.eps * acting) / inertia
    v_x = contact.v_x - friction / contact.mass
    plain = through | (left > 0.0)
    if contact.eps_in_slide:
        plain = plain & (through | grips)
    return v_x, omega_2, ~through, plain & (abs(slip) > ROUNDING * (abs(contact.v_x) + abs(radius * contact.omega)))
