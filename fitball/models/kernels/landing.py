"""The landing impulse: the shell stops at once and friction acts with it, as kernels.

While the impulse `J` grows from 0 to `J0`, the slip obeys `du/dJ = -s mu A + R eps/I_s` with the constant
compliance `A = 1/M + R^2/I_s`: a bounce with constant force, so Coulomb's law can be followed exactly. Not in the
thesis, whose shell has mass but is not stopped. The same law carries the whole contact when shell and core turn as
one (`I_s = I`).
"""

from __future__ import annotations

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.dual import Number
from fitball.models.kernels.quantities import Contact


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
