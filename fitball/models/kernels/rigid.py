"""The rigid limit of the two-mass ball (shell and core turn as one), as a kernel.

With `K_theta` infinite the friction a grip needs is a constant share of the normal force, so the whole contact,
landing impulse included, is one bounce at constant force ratio (`landing`: `du/dJ = -s mu A + R eps/I`,
`A = 1/M + R^2/I`) and needs no search in time. Not in the thesis, whose joint is elastic.
"""

from __future__ import annotations

from fitball.models.kernels.compiled import inner
from fitball.models.kernels.dual import Number, exp
from fitball.models.kernels.landing import impulsive_friction
from fitball.models.kernels.phases import FREE, GRIP, HOLD, append_phase, slide_phase
from fitball.models.kernels.quantities import Contact


@inner
def rigid_contact(contact: Contact[Number]) -> tuple[Number, Number, int]:
    """Return `(v_x2, omega_2, regime)`; the shell of `contact` is the whole ball.

    Slip that ends within the landing impulse takes no time and is no phase of the contact.
    """
    landing, vertical, radius = contact.landing, contact.vertical, contact.radius
    # What the core's momentum loses by the time the compressive force ends.
    impulse = landing + vertical.riding_mass * contact.v_y * (1.0 + exp(-vertical.spring.decay * vertical.t_force))
    slip = contact.v_x - radius * contact.omega
    direction = 1.0 if slip.real > 0.0 else -1.0
    friction, slipped, held, onward = direction * contact.mu * impulse, impulse, 0.0 * impulse, 0.0
    if contact.mu.real > 0.0:
        friction, slipped, held, onward = impulsive_friction(contact, impulse)
    acting = impulse if contact.eps_in_slide else impulse - slipped - held
    regime = 0
    count = 0
    turned = 0.0
    if contact.mu.real > 0.0 and abs(onward) > 0.5:
        # Slip that turns round is slip all along; it may have turned while landing.
        _friction, _slipped, _held, turned = impulsive_friction(contact, landing)
    if slipped.real > landing.real and abs(turned) < 0.5 and (abs(slip.real) > 0.0 or abs(onward) < 0.5):
        regime = append_phase(regime, count, slide_phase(direction))
        count += 1
    if abs(onward) > 0.5:
        regime = append_phase(regime, count, slide_phase(onward))
        count += 1
    elif slipped.real < impulse.real:
        regime = append_phase(regime, count, HOLD if held.real > 0.0 else GRIP)
        count += 1
    if vertical.t_contact.real > vertical.t_force.real:
        regime = append_phase(regime, count, FREE)
    spin = contact.omega + (radius * friction - contact.eps * acting) / contact.joint.shell
    return contact.v_x - friction / contact.mass, spin, regime
