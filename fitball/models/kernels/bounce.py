"""One bounce of any two-mass composition, and batches over draws and impacts: eight at once where they are plain."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import Entry, apart, calling, inner, read_only
from fitball.models.kernels.contact import contact_of
from fitball.models.kernels.dual import WIDTH
from fitball.models.kernels.lanes.number import lane_array
from fitball.models.kernels.lanes.phases import (
    CONTACT_TIME,
    OMEGA_2,
    OUTPUTS,
    PLAIN,
    REGIME,
    SCRATCH,
    V_X2,
    V_Y2,
    bounce_lanes,
)
from fitball.models.kernels.lanes.start import (
    COR,
    DAMPED_SQUARED,
    DECAY,
    INPUTS,
    OMEGA,
    T_CONTACT,
    T_FORCE,
    V_X,
    V_Y,
    vertical_in_lanes,
)
from fitball.models.kernels.phases import (
    MAX_PHASES,
    PIECE_SIZE,
    Scratch,
    make_scratch,
    rigid_contact,
    two_mass_contact,
)
from fitball.models.kernels.vertical import (
    COLUMNS,
    OK,
    TANGENTIAL,
    TORSION,
    TORSION_RIGID,
    vertical_motion,
)
from fitball.values import FloatArray


class Bounce(NamedTuple):
    """One impact solved; `pieces` of it stand in the phase log. All but `status` NaN or 0 where that is not OK."""

    status: int
    v_x2: float
    v_y2: float
    omega_2: float
    contact_time: float
    regime: int
    pieces: int


@inner
def unsolved(status: int, regime: int) -> Bounce:
    """The bounce of an impact that cannot be evaluated."""
    return Bounce(status, math.nan, math.nan, math.nan, math.nan, regime, 0)


@apart
def bounce(
    row: FloatArray,
    codes: NDArray[np.int64],
    v_x: float,
    v_y: float,
    omega: float,
    cor_measured: float,
    scratch: Scratch,
    phase_log: FloatArray | None,
) -> Bounce:
    """Solve one impact; `codes` as named in `vertical`, `phase_log` as in `two_mass_contact`."""
    status, vertical = vertical_motion(row, codes, v_y, cor_measured)
    if status != OK:
        return unsolved(status, 0)
    v_y2 = vertical.cor * v_y
    if codes[TANGENTIAL] == 0:
        return Bounce(OK, v_x, v_y2, omega, vertical.t_contact, 0, 0)
    status, contact = contact_of(row, codes, vertical, v_x, v_y, omega)
    if status != OK:
        return unsolved(status, 0)
    if codes[TORSION] == TORSION_RIGID:
        v_x2, omega_2, regime = rigid_contact(contact)
        return Bounce(OK, v_x2, v_y2, omega_2, vertical.t_contact, regime, 0)
    status, v_x2, omega_2, regime, pieces = two_mass_contact(contact, scratch, phase_log)
    if status != OK:
        return unsolved(status, regime)
    return Bounce(OK, v_x2, v_y2, omega_2, vertical.t_contact, regime, pieces)


BOUNCE = Entry(
    bounce,
    (
        np.zeros(len(COLUMNS)), np.zeros(TANGENTIAL + 1, dtype=np.int64), 0.0, 0.0, 0.0, 0.0,
        Scratch(np.zeros(1), np.zeros(1), np.zeros(1), np.zeros((1, 5))), np.zeros((MAX_PHASES, PIECE_SIZE)),
    ),
    Bounce(0, 0.0, 0.0, 0.0, 0.0, 0, 0),
)  # fmt: skip
solve_alone = BOUNCE.call


@inner
def give_vertical(row: FloatArray, codes: NDArray[np.int64], lane: int, given: FloatArray) -> None:
    """Fill in the vertical motion of one lane, NaN where it has none."""
    status, vertical = vertical_motion(row, codes, given[V_Y, lane], given[COR, lane])
    given[COR, lane] = vertical.cor if status == OK else math.nan
    given[DECAY, lane] = vertical.spring.decay
    given[DAMPED_SQUARED, lane] = vertical.spring.damped_squared
    given[T_FORCE, lane], given[T_CONTACT, lane] = vertical.t_force, vertical.t_contact


@calling(BOUNCE)
def bounce_batch(
    rows: FloatArray,
    codes: NDArray[np.int64],
    v_x1: FloatArray,
    v_y1: FloatArray,
    omega_1: FloatArray,
    cor: FloatArray,
    out: FloatArray,
    regime: NDArray[np.int64],
    status: NDArray[np.int8],
) -> int:
    """Fill `out` (4, draws, impacts) with v_x2, v_y2, omega_2, contact_time, and regimes and statuses.

    The incident columns are (1, impacts), shared by all draws, or (draws, impacts). No impact's answer depends on
    which others there are. Returns how many were not plain and solved one by one.
    """
    scratch, phase_log = make_scratch(), np.empty((MAX_PHASES, PIECE_SIZE))
    draws, impacts = rows.shape[0], v_x1.shape[1]
    in_lanes = codes[TANGENTIAL] != 0 and codes[TORSION] != TORSION_RIGID
    given, solved, room = np.zeros((INPUTS, WIDTH)), np.zeros((OUTPUTS, WIDTH)), np.zeros((SCRATCH, WIDTH))
    alone = not vertical_in_lanes(codes)
    count = draws * impacts
    careful = 0
    for first in range(0, count, WIDTH):
        filled = min(WIDTH, count - first)
        if in_lanes:
            # Draws of one impact lie side by side: they go through the same phases. The last lanes repeat.
            for lane in range(WIDTH):
                j, i = divmod(first + min(lane, filled - 1), draws)
                own = i if v_x1.shape[0] > 1 else 0
                for column in range(len(COLUMNS)):
                    given[column, lane] = rows[i, column]
                given[V_X, lane], given[V_Y, lane] = v_x1[own, j], v_y1[own, j]
                given[OMEGA, lane], given[COR, lane] = omega_1[own, j], cor[own, j]
                if alone:
                    give_vertical(rows[i], codes, lane, given)
            bounce_lanes(lane_array(given), codes, lane_array(solved), room)
        for lane in range(filled):
            j, i = divmod(first + lane, draws)
            if solved[PLAIN, lane] > 0.5:
                out[0, i, j], out[1, i, j] = solved[V_X2, lane], solved[V_Y2, lane]
                out[2, i, j], out[3, i, j] = solved[OMEGA_2, lane], solved[CONTACT_TIME, lane]
                regime[i, j], status[i, j] = int(solved[REGIME, lane]), OK
                continue
            careful += 1
            own = i if v_x1.shape[0] > 1 else 0
            one = solve_alone(
                rows[i], codes, v_x1[own, j], v_y1[own, j], omega_1[own, j], cor[own, j], scratch, phase_log
            )
            out[0, i, j], out[1, i, j], out[2, i, j] = one.v_x2, one.v_y2, one.omega_2
            out[3, i, j], regime[i, j], status[i, j] = one.contact_time, one.regime, one.status
    return careful


BATCH = Entry(
    bounce_batch,
    (
        np.zeros((1, len(COLUMNS))), np.zeros(TANGENTIAL + 1, dtype=np.int64), *(read_only((1, 1)) for _ in range(4)),
        np.zeros((4, 1, 1)), np.zeros((1, 1), dtype=np.int64), np.zeros((1, 1), dtype=np.int8),
    ),
    0,
)  # fmt: skip
