"""Eight contacts along the court at once, each through its own phases; see `two_mass`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.dual import choose
from fitball.models.kernels.events import SIZE
from fitball.models.kernels.lanes.elementary import LARGEST_ANGLE, LARGEST_EXPONENT
from fitball.models.kernels.lanes.pieces import LaneMode, piece_lanes
from fitball.models.kernels.lanes.start import ROUNDING, contact_lanes, landed_lanes
from fitball.models.kernels.lanes.swings import BASIS, swing_of_any
from fitball.models.kernels.lanes.vector import LaneArray, Lanes, Mask, any_of, lane_array
from fitball.models.kernels.lanes.zeros import MAX_DEPTH, NODE, LaneScratch
from fitball.models.kernels.oscillator import SERIES_LENGTH
from fitball.models.kernels.phases import FREE, GRIP, SLIDE_BACKWARD, SLIDE_FORWARD
from fitball.models.kernels.quantities import Contact, Coupling, Load, State
from fitball.models.kernels.twist import coupling_of, load_of, swung_freely
from fitball.models.types import PHASE_BITS
from fitball.values import FloatArray

# Pieces after which a lane is left to the scalar kernel.
MAX_PIECES = 8
# Rows of what is written for eight impacts; `PLAIN` is 1 where it is their answer.
V_X2, V_Y2, OMEGA_2, CONTACT_TIME, REGIME, PLAIN, OUTPUTS = range(7)


# Rows of scratch that one thread needs, and where its parts begin.
FUNCTION = 0
TWIST = FUNCTION + max(SERIES_LENGTH, SIZE)
DRIVE = TWIST + SERIES_LENGTH
STACK = DRIVE + SERIES_LENGTH
HALVES = STACK + NODE * MAX_DEPTH
MARKS = HALVES + BASIS * (MAX_DEPTH + 1)
SCRATCH = MARKS + MAX_DEPTH + 1


@inner
def lane_scratch(room: FloatArray) -> LaneScratch:
    """The scratch in an array (SCRATCH, WIDTH)."""
    return LaneScratch(
        lane_array(room[FUNCTION:TWIST]),
        lane_array(room[TWIST:DRIVE]),
        lane_array(room[DRIVE:STACK]),
        lane_array(room[STACK:HALVES]),
        lane_array(room[HALVES:MARKS]),
        room[MARKS:],
    )


@inlined
def decide_lanes(
    contact: Contact[Lanes], coupling: Coupling[Lanes], state: State, mode: LaneMode, load: Load[Lanes], active: Mask
) -> tuple[LaneMode, Mask]:
    """`two_mass.decide` of the lanes without slip; and those that hold, or are at the edge of the cone."""
    joint, lever, force = contact.joint, coupling.lever, load.force
    free = lever * (joint.stiffness * state.angle + joint.damping * (state.omega_1 - state.omega_2))
    full = free - lever * contact.eps * force
    limit = contact.mu * force
    margin, noise = limit - abs(full), ROUNDING * (limit + abs(full))
    deciding = active & mode.undecided & ~mode.broke
    lost = deciding & ~(abs(margin) > noise)
    grips = deciding & (margin > noise)
    deciding = (deciding & ~grips) | (active & mode.broke)
    needed = full
    if not contact.eps_in_slide:
        needed = free
        lost = lost | (deciding & ~(abs(free) - limit > ROUNDING * (limit + abs(free))))
    side = choose(deciding, choose(needed > 0.0, -1.0, 1.0), mode.side)
    none = active & ~active
    return LaneMode(
        none, (mode.gripping & ~deciding) | grips, none, (mode.once & ~grips) | deciding, mode.twice & ~deciding, side
    ), lost


@inner
def bounce_lanes(given: LaneArray, codes: NDArray[np.int64], out: LaneArray, room: FloatArray) -> None:
    """Solve eight impacts: `given` (INPUTS) to `out` (OUTPUTS), rows as named in `start` and here.

    Only lanes that are plain have an answer, and each has the one that it would have among any neighbours.
    """
    scratch = lane_scratch(room)
    plain, contact = contact_lanes(given, codes)
    joint, vertical, radius = contact.joint, contact.vertical, contact.radius
    gyration = joint.shell + contact.mass * radius * radius
    coupling = coupling_of(contact, gyration, 1.0 / joint.core + 1.0 / joint.shell, 1.0 / joint.core + 1.0 / gyration)
    time = vertical.t_contact
    for o in (coupling.slide, coupling.grip, vertical.spring):
        plain = plain & (abs(o.damped_squared) > 0.0)
        plain = plain & (o.frequency * time <= LARGEST_ANGLE) & ((o.decay + o.frequency) * time <= LARGEST_EXPONENT)
    none = plain & ~plain
    v_x, omega_2, stuck = contact.v_x, contact.omega, none
    if any_of(contact.landing > 0.0):
        v_x, omega_2, stuck, landed = landed_lanes(contact)
        plain = plain & landed
    slip = v_x - radius * omega_2
    plain = plain & (stuck | (abs(slip) > ROUNDING * (abs(v_x) + abs(radius * omega_2))))
    zero = 0.0 * v_x
    spin_sum = joint.core * contact.omega + joint.shell * omega_2
    state = State(zero, zero, contact.v_y, zero, v_x, contact.omega, omega_2, spin_sum)
    mode = LaneMode(stuck, none, none, none, none, choose(slip > 0.0, 1.0, -1.0))
    active = plain
    v_x2, spin, angle, rate, regime, place, done = zero, zero, zero, zero, zero, zero + 1.0, none
    for _ in range(MAX_PIECES):
        if not any_of(active):
            break
        load = load_of(vertical, state.y, state.y_rate)
        if any_of(active & mode.undecided):
            mode, lost = decide_lanes(contact, coupling, state, mode, load, active)
            active = active & ~lost
        phase = choose(mode.side > 0.0, SLIDE_FORWARD, SLIDE_BACKWARD)
        phase = choose(mode.gripping, GRIP, phase)
        state, mode, finished, lost = piece_lanes(contact, coupling, state, mode, load, active, scratch)
        regime = choose(active, regime + place * phase, regime)
        place = choose(active, place * (1 << PHASE_BITS), place)
        v_x2, spin = choose(finished, state.v_x, v_x2), choose(finished, state.spin_sum, spin)
        if contact.shell_spin:
            angle = choose(finished, state.angle, angle)
            rate = choose(finished, state.omega_1 - state.omega_2, rate)
        done = done | finished
        active = active & ~finished & ~lost
    free = vertical.t_contact > vertical.t_force
    regime = choose(free, regime + place * FREE, regime)
    if contact.shell_spin:
        swing = swing_of_any(coupling.slide, vertical.t_contact - vertical.t_force)
        _angle, rate = swung_freely(coupling.slide, swing, angle, rate)
        spin = spin - joint.core * rate
    out[V_X2], out[V_Y2], out[OMEGA_2] = v_x2, vertical.cor * contact.v_y, spin / coupling.inertia
    out[CONTACT_TIME], out[REGIME], out[PLAIN] = vertical.t_contact, regime, choose(done, 1.0, zero)
