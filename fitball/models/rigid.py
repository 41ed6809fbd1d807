"""The rigid limit of the two-mass ball (shell and core turn as one), as a kernel.

With `K_theta` infinite the friction a grip needs is a constant share of the normal force, so the whole contact,
landing impulse included, is one bounce at constant force ratio and needs no search in time.
"""

from __future__ import annotations

from fitball.models.compiled import compiled
from fitball.models.landing import friction_impulse
from fitball.models.phases import FREE, GRIP, HOLD, append_phase, slide_phase


@compiled
def rigid_contact(
    mass: float,
    radius: float,
    inertia: float,
    mu: float,
    eps: float,
    eps_in_slide: bool,
    landing: float,
    impulse: float,
    free_at_end: bool,
    v_x: float,
    omega: float,
) -> tuple[float, float, int]:
    """Return `(v_x2, omega_2, regime)` after a normal impulse [N s], of which `landing` comes all at once.

    Slip that ends within the landing impulse takes no time and is no phase of the contact.
    """
    compliance = 1.0 / mass + radius * radius / inertia
    need = radius * eps / (inertia * compliance)
    slip = v_x - radius * omega
    drive = need if eps_in_slide else 0.0
    friction, slipped, held, onward = 0.0, impulse, 0.0, 0.0
    direction = 1.0 if slip > 0.0 else -1.0
    if mu > 0.0:
        friction, slipped, held, onward = friction_impulse(slip, impulse, mu, drive, need, compliance)
    acting = impulse if eps_in_slide else impulse - slipped - held
    regime = 0
    count = 0
    if slipped > landing and (abs(slip) > 0.0 or abs(onward) < 0.5):
        regime = append_phase(regime, count, slide_phase(direction))
        count += 1
    if onward * direction < 0.0 or (onward > 0.5 and count == 0):
        regime = append_phase(regime, count, slide_phase(onward))
        count += 1
    elif slipped < impulse:
        regime = append_phase(regime, count, HOLD if held > 0.0 else GRIP)
        count += 1
    if free_at_end:
        regime = append_phase(regime, count, FREE)
    return v_x - friction / mass, omega + (radius * friction - eps * acting) / inertia, regime
