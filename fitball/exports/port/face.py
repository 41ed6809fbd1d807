"""The functions of a port beside its kernel, in restricted Python too: the fitted model with a substitute where it
has no solution, the total bounce, its check on golden impacts, functions that a language may not have, and one bounce
through its contact, which a page draws.

`kernel_source` collects these functions like kernels, with the fit's own numbers in the place of the names that are
None here (`port.make_port`): `KERNEL` is the entry of an algebraic model, `FITTED` the function of its convention.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.bounce import bounce
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
from fitball.models.thesis import BALL_INERTIA, BALL_MASS, BALL_RADIUS, COR_10, COR_SLOPE, MU, thesis_bounce
from fitball.models.types import (
    FREE,
    GRIP,
    MAX_PACKED_PHASES,
    PHASE_BITS,
    SLIDE_BACKWARD,
    SLIDE_FORWARD,
    Status,
)
from fitball.values import FloatArray

Ints = NDArray[np.int64]
# Given by the port.
KERNEL: Any = None
FITTED: Any = None
TOLD_COR: Any = None
ANCHOR: Any = None
RADIUS: Any = None
V_Y1_LOW: Any = None
V_Y1_HIGH: Any = None
COR_LOW: Any = None
COR_HIGH: Any = None
GRAZING: Any = None
TINY: Any = None

OK = int(Status.OK)
BAD_INPUT = -1
# In what a bounce is extrapolated: a sum of these.
BEYOND_SPEEDS, BEYOND_RESTITUTION, WITHOUT_TWIST = 1, 2, 4


class Solved(NamedTuple):
    """One impact as a port answers it: `status` is 0 or says why the rest is NaN; `regime` packed phases. The times
    are NaN for models without them, and so are path and turn between the flights.
    """

    v_x2: float
    v_y2: float
    omega_2: float
    contact_time: float
    gap_time: float
    gap_path: float
    gap_turn: float
    regime: int
    extrapolated: int
    status: int


def fitted_impulse(
    row: FloatArray, codes: Ints, rigid: Ints, v_x1: float, v_y1: float, omega_1: float, cor: float, scratch: Scratch
) -> Solved:
    """The fitted model as it is."""
    status, v_x2, v_y2, omega_2, regime = KERNEL(row, v_x1, v_y1, omega_1)
    return Solved(v_x2, v_y2, omega_2, math.nan, math.nan, math.nan, math.nan, regime, 0, status)


def fitted_two_mass(
    row: FloatArray, codes: Ints, rigid: Ints, v_x1: float, v_y1: float, omega_1: float, cor: float, scratch: Scratch
) -> Solved:
    """The fitted model as it is, and as a ball without twist where it has no solution."""
    extrapolated = 0
    solved = bounce(row, codes, v_x1, v_y1, omega_1, cor, scratch, None)
    if solved.status != OK:
        solved = bounce(row, rigid, v_x1, v_y1, omega_1, cor, scratch, None)
        extrapolated = WITHOUT_TWIST
    return Solved(
        solved.v_x2, solved.v_y2, solved.omega_2, solved.contact_time, solved.gap_time, solved.gap_path,
        solved.gap_turn, solved.regime, extrapolated, solved.status,
    )  # fmt: skip


def fitted_thesis(
    row: FloatArray, codes: Ints, rigid: Ints, v_x1: float, v_y1: float, omega_1: float, cor: float, scratch: Scratch
) -> Solved:
    """The thesis's computation as it is, and a rigid ball, sliding or rolling, where it has no solution."""
    told = cor
    if TOLD_COR == 0:
        told = row[COR_10] + row[COR_SLOPE] * (v_y1 - ANCHOR)
    status, v_x2, v_y2, omega_2, contact_time, regime = thesis_bounce(row, codes[0], told, v_x1, v_y1, omega_1)
    if status == OK:
        return Solved(v_x2, v_y2, omega_2, contact_time, math.nan, math.nan, math.nan, regime, 0, status)
    push = (1.0 + told) * v_y1
    inertia = row[BALL_INERTIA] / (row[BALL_MASS] * row[BALL_RADIUS] * row[BALL_RADIUS])
    stop = (v_x1 - row[BALL_RADIUS] * omega_1) * inertia / (1.0 + inertia)
    limit = row[MU] * push
    lost = min(max(stop, -limit), limit)
    phase = GRIP
    if stop > limit:
        phase = SLIDE_FORWARD
    elif stop < -limit:
        phase = SLIDE_BACKWARD
    turned = omega_1 + lost / (inertia * row[BALL_RADIUS])
    return Solved(
        v_x1 - lost, told * v_y1, turned, math.nan, math.nan, math.nan, math.nan, phase, WITHOUT_TWIST, OK
    )  # fmt: skip


def total_bounce(
    row: FloatArray, codes: Ints, rigid: Ints, v_x1: float, v_y1: float, omega_1: float, cor: float, scratch: Scratch
) -> Solved:
    """The rebound of any impact with finite numbers and `v_y1 >= 0`, see `prediction.reach.total_rebound`."""
    bad = Solved(math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, 0, 0, BAD_INPUT)
    if not (math.isfinite(v_x1) and math.isfinite(v_y1) and math.isfinite(omega_1) and v_y1 >= 0.0):
        return bad
    extrapolated = 0
    told = cor
    if TOLD_COR != 0:
        if not math.isfinite(cor):
            return bad
        told = min(max(cor, COR_LOW), COR_HIGH)
        if told != cor:
            extrapolated += BEYOND_RESTITUTION
    at_end = min(max(v_y1, V_Y1_LOW), V_Y1_HIGH)
    scale = v_y1 / at_end
    if scale != 1.0:
        extrapolated += BEYOND_SPEEDS
    # So slow towards the court that friction changes nothing else.
    if v_y1 <= max(GRAZING * (abs(v_x1) + RADIUS * abs(omega_1)), TINY):
        grazed = FITTED(row, codes, rigid, 0.0, at_end, 0.0, told, scratch)
        time = grazed.gap_time
        return Solved(
            v_x1, grazed.v_y2 * scale, omega_1, grazed.contact_time, time, v_x1 * time, omega_1 * time, 0,
            extrapolated, grazed.status,
        )  # fmt: skip
    found = FITTED(row, codes, rigid, v_x1 / scale, at_end, omega_1 / scale, told, scratch)
    v_x2, v_y2, omega_2 = found.v_x2 * scale, found.v_y2 * scale, found.omega_2 * scale
    # Numbers too large to be squared or scaled.
    if found.status == OK and not (math.isfinite(v_x2) and math.isfinite(v_y2) and math.isfinite(omega_2)):
        return bad
    extrapolated += found.extrapolated
    # Times stay, so that paths and turns go with the speeds.
    return Solved(
        v_x2, v_y2, omega_2, found.contact_time, found.gap_time, found.gap_path * scale, found.gap_turn * scale,
        found.regime, extrapolated, found.status,
    )  # fmt: skip


def either_way(
    row: FloatArray, codes: Ints, rigid: Ints, v_x1: float, v_y1: float, omega_1: float, cor: float, scratch: Scratch
) -> Solved:
    """The total bounce of a ball that flies either way: with `v_x1 < 0` the mirror image, its offset ahead too."""
    if not v_x1 < 0.0:
        return total_bounce(row, codes, rigid, v_x1, v_y1, omega_1, cor, scratch)
    found = total_bounce(row, codes, rigid, -v_x1, v_y1, -omega_1, cor, scratch)
    return Solved(
        -found.v_x2, found.v_y2, -found.omega_2, found.contact_time, found.gap_time, -found.gap_path, -found.gap_turn,
        found.regime, found.extrapolated, found.status,
    )  # fmt: skip


# Numbers of a golden impact: `(v_x1, v_y1, omega_1, cor)`, `models.types.OUTPUTS` of its rebound, and in what it is
# extrapolated.
GOLDEN_NUMBERS = 12


class Agreement(NamedTuple):
    """How far a port is from the model: its `worst` difference, relative, and whether every impact has a rebound
    with the phases that it has in the model, extrapolated in what it is to be.
    """

    worst: float
    same: bool


def golden_agreement(
    golden: FloatArray, regimes: Ints, count: int, row: FloatArray, codes: Ints, rigid: Ints, scratch: Scratch
) -> Agreement:
    """The port on its golden impacts: speeds and R*omega relative to the incident speed of the ball and its surface,
    times to themselves, path and R*turn between the flights to what that speed goes in the time between them.
    """
    worst = 0.0
    same = True
    for k in range(count):
        at = GOLDEN_NUMBERS * k
        v_x, v_y, omega, time, gap = golden[at], golden[at + 1], golden[at + 2], golden[at + 7], golden[at + 8]
        found = total_bounce(row, codes, rigid, v_x, v_y, omega, golden[at + 3], scratch)
        speed = math.sqrt(v_x * v_x + v_y * v_y + RADIUS * omega * RADIUS * omega)
        along, away = abs(found.v_x2 - golden[at + 4]) / speed, abs(found.v_y2 - golden[at + 5]) / speed
        turned = RADIUS * abs(found.omega_2 - golden[at + 6]) / speed
        late = 0.0
        if not math.isnan(time):
            late = abs(found.contact_time - time) / time
        between = 0.0
        if not math.isnan(gap):
            path, turn = abs(found.gap_path - golden[at + 9]), RADIUS * abs(found.gap_turn - golden[at + 10])
            between = max(abs(found.gap_time - gap), max(path, turn) / speed) / gap
        if found.status != OK or found.extrapolated != golden[at + 11]:
            same = False
        if math.isnan(along + away + turned + late + between):
            same = False
        # Joined with nothing, so that both sides are of one kind in every language.
        if (found.regime | 0) != (regimes[k] | 0):
            same = False
        worst = max(max(worst, along), max(max(away, turned), max(late, between)))
    return Agreement(worst, same)


def min_real(a: float, b: float) -> float:
    """The lesser: of equal numbers the first, of NaN and a number the first, as in Python."""
    return b if b < a else a


def max_real(a: float, b: float) -> float:
    """The greater, likewise."""
    return b if b > a else a


def min_whole(a: int, b: int) -> int:
    """The lesser of whole numbers."""
    return b if b < a else a


def max_whole(a: int, b: int) -> int:
    """The greater of whole numbers."""
    return b if b > a else a


def hypot(a: float, b: float) -> float:
    """The hypotenuse, for languages without one, or with one that is off in its last digits."""
    large, small = max(abs(a), abs(b)), min(abs(a), abs(b))
    return large * math.sqrt(1.0 + (small / large) * (small / large)) if large > 0.0 else large


def log1p(x: float) -> float:
    """The logarithm of 1 + x, whose rounding is undone (Kahan)."""
    step = (1.0 + x) - 1.0
    return math.log(1.0 + x) * x / step if abs(step) > 0.0 else x


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
    """The contact as if it ended at `time`: its pieces are the same closed forms, so that the state at a time is what
    `two_mass_contact` finds when the normal force ends then. `models.history` follows the pieces instead, and tests
    hold the two against each other.
    """
    whole = contact.vertical
    vertical = VerticalMotion(whole.cor, whole.riding_mass, whole.spring, min(time, whole.t_force), time, time)
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
    one, both = cut_contact(contact, time, True), cut_contact(contact, time, False)
    status, v_x, shell, _path, _turn, regime, _pieces = two_mass_contact(one, scratch, None)
    _status, _v_x, mean, _path, _turn, _regime, _pieces = two_mass_contact(both, scratch, None)
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
