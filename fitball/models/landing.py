"""The landing impulse: the shell stops at once and friction acts with it, as kernels.

While the impulse `J` grows from 0 to `J0`, the slip obeys `du/dJ = -s mu A + R eps/I_s` with the constant
compliance `A = 1/M + R^2/I_s`: a bounce with constant force, so Coulomb's law can be followed exactly.
The same law carries the whole contact when shell and core turn as one (`I_s = I`).
"""

from __future__ import annotations

from fitball.models.compiled import compiled


@compiled
def friction_impulse(
    slip: float, impulse: float, mu: float, drive_slide: float, drive_grip: float, compliance: float
) -> tuple[float, float, float, float]:
    """Friction impulse that goes with a normal impulse `impulse` at constant force ratio.

    `drive_slide`, `drive_grip` are `R eps/(I_s A)`: the friction, as a share of the normal force, needed to
    balance the offset while it acts. Returns `(friction, slipped, held, onward)`: the impulse that retards the
    ball [N s], the part of `impulse` spent slipping, the part spent at zero slip without offset (hold), and
    the direction (+1, -1, or 0) in which an overpowered contact slips on from zero slip.
    """
    friction = 0.0
    left = impulse
    direction = 0.0
    if slip > 0.0:
        direction = 1.0
    elif slip < 0.0:
        direction = -1.0
    if direction != 0.0:
        # Rate at which the slip, counted in its own direction, is worn down per impulse.
        rate = compliance * (mu - direction * drive_slide)
        if rate * impulse <= direction * slip:
            return direction * mu * impulse, impulse, 0.0, 0.0
        spent = direction * slip / rate
        friction = direction * mu * spent
        left = impulse - spent
    if abs(drive_grip) <= mu:
        return friction + drive_grip * left, impulse - left, 0.0, 0.0
    if abs(drive_slide) <= mu:
        return friction, impulse - left, left, 0.0
    # The offset overcomes friction: the contact slips on in the direction it drives.
    onward = 1.0 if drive_slide > 0.0 else -1.0
    return friction + onward * mu * left, impulse, 0.0, onward
