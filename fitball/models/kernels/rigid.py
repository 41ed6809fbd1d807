"""The rigid limit of the two-mass ball (shell and core turn as one), as a kernel.

With `K_theta` infinite the friction a grip needs is a constant share of the normal force, so the whole contact,
landing impulse included, is one bounce at constant force ratio and needs no search in time.
"""

from __future__ import annotations

from fitball.models.kernels.compiled import compiled
from fitball.models.kernels.dual import Number
from fitball.models.kernels.landing import friction_impulse
from fitball.models.kernels.phases import FREE, GRIP, HOLD, append_phase, slide_phase


@compiled
def rigid_contact(
    mass: Number,
    radius: Number,
    inertia: Number,
    mu: Number,
    eps: Number,
    eps_in_slide: bool,
    landing: Number,
    impulse: Number,
    free_at_end: bool,
    v_x: Number,
    omega: Number,
) -> tuple[Number, Number, int]:
    """Return `(v_x2, omega_2, regime)` after a normal impulse [N s], of which `landing` comes all at once.

    Slip that ends within the landing impulse takes no time and is no phase of the contact.
    """
    compliance = 1.0 / mass + radius * radius / inertia
    need = radius * eps / (inertia * compliance)
    slip = v_x - radius * omega
    drive = need if eps_in_slide else 0.0 * need
    direction = 1.0 if slip.real > 0.0 else -1.0
    friction, slipped, held, onward = direction * mu * impulse, impulse, 0.0 * impulse, 0.0
    if mu.real > 0.0:
        friction, slipped, held, onward = friction_impulse(slip, impulse, mu, drive, need, compliance)
    acting = impulse if eps_in_slide else impulse - slipped - held
    regime = 0
    count = 0
    turned = 0.0
    if mu.real > 0.0 and abs(onward) > 0.5:
        # Slip that turns round is slip all along; it may have turned while landing.
        _friction, _slipped, _held, turned = friction_impulse(slip, landing, mu, drive, need, compliance)
    if slipped.real > landing.real and abs(turned) < 0.5 and (abs(slip.real) > 0.0 or abs(onward) < 0.5):
        regime = append_phase(regime, count, slide_phase(direction))
        count += 1
    if abs(onward) > 0.5:
        regime = append_phase(regime, count, slide_phase(onward))
        count += 1
    elif slipped.real < impulse.real:
        regime = append_phase(regime, count, HOLD if held.real > 0.0 else GRIP)
        count += 1
    if free_at_end:
        regime = append_phase(regime, count, FREE)
    return v_x - friction / mass, omega + (radius * friction - eps * acting) / inertia, regime
