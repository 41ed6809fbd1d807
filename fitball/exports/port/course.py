"""One bounce through its contact, in the restricted Python of the kernels: what a page draws.

A contact that is cut at a time is the contact up to there: its pieces are the same closed forms. So the state at a
time is what `two_mass_contact` finds when the normal force ends then; `models.history` follows the
pieces instead, and tests hold the two against each other.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from fitball.exports.port.face import OK, Ints
from fitball.models.kernels.contact import (
    TANGENTIAL,
    TORSION,
    TORSION_RIGID,
    Contact,
    VerticalMotion,
    contact_of,
    impulse_at,
    vertical_at,
    vertical_motion,
)
from fitball.models.kernels.phases import Scratch, rigid_phase, two_mass_contact
from fitball.models.types import FREE, MAX_PACKED_PHASES, PHASE_BITS, SLIDE_BACKWARD, SLIDE_FORWARD
from fitball.values import FloatArray

# Given by the port.
V_Y1_LOW: Any = None
V_Y1_HIGH: Any = None

# Step of the one difference that is taken, that of `v_x` in a grip, as a share of the time the force lasts.
STEP = 1e-6


class Moment(NamedTuple):
    """The ball at one time of the contact: `phase` as `types.Phase`, 0 where the motion along the court is not
    followed or `status` is not OK; else as `models.history.History`.
    """

    status: int
    time: float
    y: float
    v_y: float
    v_x: float
    omega_core: float
    omega_shell: float
    normal_force: float
    friction_force: float
    phase: int


def cut_contact(contact: Contact[float], time: float, shell_spin: bool) -> Contact[float]:
    """The contact as if it ended at `time`."""
    whole = contact.vertical
    vertical = VerticalMotion(whole.cor, whole.riding_mass, whole.spring, min(time, whole.t_force), time)
    return Contact(
        contact.mass, contact.radius, contact.joint, contact.mu, contact.eps, contact.eps_in_slide, shell_spin,
        contact.landing, vertical, contact.v_x, contact.v_y, contact.omega,
    )  # fmt: skip


def last_phase(regime: int) -> int:
    """The last of a packed sequence of phases, of a very long one the last that is packed."""
    last = 0
    for k in range(MAX_PACKED_PHASES):
        place = PHASE_BITS * k
        here = regime & (7 << place)
        # Shifted too, so that both sides are of one kind in every language.
        if here == (0 << place):
            break
        for phase in range(1, 8):
            if here == (phase << place):
                last = phase
    return last


def moment_of(
    row: FloatArray, codes: Ints, v_x: float, v_y: float, omega: float, cor: float, share: float, scratch: Scratch
) -> Moment:
    """The ball after a `share` (above 0) of the contact time."""
    status, vertical = vertical_motion(row, codes, v_y, cor)
    if status != OK:
        return Moment(status, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
    time = share * vertical.t_contact
    y, y_rate = vertical_at(vertical.spring, v_y, time)
    force = 0.0
    if time <= vertical.t_force:
        force = vertical.riding_mass * (2.0 * vertical.spring.decay * y_rate + vertical.spring.natural_squared * y)
        force = max(force, 0.0)
    if codes[TANGENTIAL] == 0:
        return Moment(OK, time, y, y_rate, v_x, omega, omega, force, 0.0, 0)
    status, contact = contact_of(row, codes, vertical, v_x, v_y, omega)
    if status != OK:
        return Moment(status, time, y, y_rate, 0.0, 0.0, 0.0, force, 0.0, 0)
    found = along_court(contact, codes[TORSION] == TORSION_RIGID, time, scratch)
    if found.status != OK:
        return Moment(found.status, time, y, y_rate, 0.0, 0.0, 0.0, force, 0.0, 0)
    friction = 0.0
    if found.phase == SLIDE_FORWARD:
        friction = -contact.mu * force
    elif found.phase == SLIDE_BACKWARD:
        friction = contact.mu * force
    elif found.phase != FREE:
        step = STEP * vertical.t_force
        other = time + step if time + step < vertical.t_force else time - step
        moved = along_court(contact, codes[TORSION] == TORSION_RIGID, other, scratch)
        friction = contact.mass * (moved.v_x - found.v_x) / (other - time)
    return Moment(OK, time, y, y_rate, found.v_x, found.omega_core, found.omega_shell, force, friction, found.phase)


def along_court(contact: Contact[float], rigid: bool, time: float, scratch: Scratch) -> Moment:
    """Velocity along the court, spins and phase at `time`; the rest zero."""
    if rigid:
        impulse = impulse_at(contact, min(time, contact.vertical.t_force))
        phase, friction, acting = rigid_phase(contact, impulse)
        turned = contact.omega + (contact.radius * friction - contact.eps * acting) / contact.joint.shell
        v_x = contact.v_x - friction / contact.mass
        if time > contact.vertical.t_force:
            phase = FREE
        return Moment(OK, time, 0.0, 0.0, v_x, turned, turned, 0.0, 0.0, phase)
    status, v_x, shell, regime, _pieces = two_mass_contact(cut_contact(contact, time, True), scratch, None)
    _status, _v_x, mean, _regime, _pieces = two_mass_contact(cut_contact(contact, time, False), scratch, None)
    joint = contact.joint
    core = ((joint.core + joint.shell) * mean - joint.shell * shell) / joint.core
    return Moment(status, time, 0.0, 0.0, v_x, core, shell, 0.0, 0.0, last_phase(regime))


def total_moment(
    row: FloatArray, codes: Ints, v_x1: float, v_y1: float, omega_1: float, cor: float, share: float, scratch: Scratch
) -> Moment:
    """`moment_of` any impact that moves towards the court: outside the valid range that at its nearer end, scaled."""
    at_end = min(max(v_y1, V_Y1_LOW), V_Y1_HIGH)
    scale = v_y1 / at_end
    found = moment_of(row, codes, v_x1 / scale, at_end, omega_1 / scale, cor, share, scratch)
    return Moment(
        found.status, found.time, found.y * scale, found.v_y * scale, found.v_x * scale, found.omega_core * scale,
        found.omega_shell * scale, found.normal_force * scale, found.friction_force * scale, found.phase,
    )  # fmt: skip
