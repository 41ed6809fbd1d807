"""One bounce of any two-mass composition, and batches over draws and impacts: one by one, and eight at once where
they are plain.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.compiled import compiled, inner
from fitball.models.kernels.contact import (
    COLUMNS,
    OK,
    TANGENTIAL,
    TORSION,
    TORSION_RIGID,
    contact_of,
    vertical_motion,
)
from fitball.models.kernels.dual import WIDTH
from fitball.models.kernels.lanes.number import lane_array
from fitball.models.kernels.lanes.phases import (
    CONTACT_TIME,
    GAP_PATH,
    GAP_TIME,
    GAP_TURN,
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
    T_FLIGHT,
    T_FORCE,
    V_X,
    V_Y,
    vertical_in_lanes,
)
from fitball.models.kernels.oscillator import MAX_DEPTH, SERIES_LENGTH, SIZE, Stack
from fitball.models.kernels.phases import MAX_PHASES, Scratch, rigid_contact, two_mass_contact
from fitball.values import FloatArray


class Bounce(NamedTuple):
    """One impact solved; `pieces` of it are in the phase log. All but `status` NaN or 0 where that is not OK."""

    status: int
    v_x2: float
    v_y2: float
    omega_2: float
    contact_time: float
    gap_time: float
    gap_path: float
    gap_turn: float
    regime: int
    pieces: int


@inner
def unsolved(status: int, regime: int) -> Bounce:
    """The bounce of an impact that cannot be evaluated."""
    return Bounce(status, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, regime, 0)


@inner
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
    v_y2, time, flight = vertical.cor * v_y, vertical.t_contact, vertical.t_flight
    if codes[TANGENTIAL] == 0:
        return Bounce(OK, v_x, v_y2, omega, time, flight, v_x * flight, omega * flight, 0, 0)
    status, contact = contact_of(row, codes, vertical, v_x, v_y, omega)
    if status != OK:
        return unsolved(status, 0)
    if codes[TORSION] == TORSION_RIGID:
        v_x2, omega_2, path, turn, regime = rigid_contact(contact)
        return Bounce(OK, v_x2, v_y2, omega_2, time, flight, path, turn, regime, 0)
    status, v_x2, omega_2, path, turn, regime, pieces = two_mass_contact(contact, scratch, phase_log)
    if status != OK:
        return unsolved(status, regime)
    return Bounce(OK, v_x2, v_y2, omega_2, time, flight, path, turn, regime, pieces)


# Sizes of the scratch of one contact, and of the rows of lanes that eight take.
FUNCTION, ROOM = max(SERIES_LENGTH, SIZE), max(SERIES_LENGTH, SIZE) + 2 * SERIES_LENGTH
STACK = (MAX_DEPTH + 1, 5)
LANE_ROOM = (INPUTS + OUTPUTS + SCRATCH, WIDTH)


@inner
def scratch_in(room: FloatArray, stack: Stack) -> Scratch:
    """Scratch for one contact, in arrays (ROOM,) and `STACK`."""
    return Scratch(
        room[:FUNCTION], room[FUNCTION : FUNCTION + SERIES_LENGTH], room[FUNCTION + SERIES_LENGTH : ROOM], stack
    )


@compiled
def bounce_each(
    rows: FloatArray,
    codes: NDArray[np.int64],
    v_x1: FloatArray,
    v_y1: FloatArray,
    omega_1: FloatArray,
    cor: FloatArray,
    places: NDArray[np.int64],
    first: int,
    out: FloatArray,
    regime: NDArray[np.int64],
    status: NDArray[np.int8],
    log: FloatArray,
    ends: NDArray[np.int64],
    room: FloatArray,
    stack: Stack,
) -> int:
    """As `bounce_batch`, one by one and of any composition: those at `places` from the `first` on, counted draw by
    draw.

    Their pieces are in the `log` (at least MAX_PHASES, PIECE_SIZE) one behind the other, those of each up to its
    row in `ends` (places,). Returns how many places are done: not all of them where the log is full.
    """
    scratch = scratch_in(room, stack)
    used, stop = 0, len(places)
    for place in range(first, stop):
        if used + MAX_PHASES > log.shape[0]:
            return place
        i = places[place] // v_x1.shape[1]
        j = places[place] - i * v_x1.shape[1]
        own = i if v_x1.shape[0] > 1 else 0
        one = bounce(rows[i], codes, v_x1[own, j], v_y1[own, j], omega_1[own, j], cor[own, j], scratch, log[used:])
        out[0, i, j], out[1, i, j], out[2, i, j] = one.v_x2, one.v_y2, one.omega_2
        out[3, i, j], out[4, i, j], out[5, i, j] = one.contact_time, one.gap_time, one.gap_path
        out[6, i, j], regime[i, j], status[i, j] = one.gap_turn, one.regime, one.status
        used += one.pieces
        ends[place] = used
    return stop


@inner
def give_vertical(row: FloatArray, codes: NDArray[np.int64], lane: int, given: FloatArray) -> None:
    """Fill in the vertical motion of one lane, NaN where it has none."""
    status, vertical = vertical_motion(row, codes, given[V_Y, lane], given[COR, lane])
    given[COR, lane] = vertical.cor if status == OK else math.nan
    given[DECAY, lane] = vertical.spring.decay
    given[DAMPED_SQUARED, lane] = vertical.spring.damped_squared
    given[T_FORCE, lane], given[T_CONTACT, lane] = vertical.t_force, vertical.t_contact
    given[T_FLIGHT, lane] = vertical.t_flight


# Of an impact that is not plain.
LEFT = -1


@compiled
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
    room: FloatArray,
) -> int:
    """Fill `out` (outputs of `Rebound`, draws, impacts), regimes and statuses, eight at once.

    The incident columns are (1, impacts), shared by all draws, or (draws, impacts). No impact's answer depends on
    which others there are. Those that are not plain have the status LEFT; returns how many. `room` is scratch of the
    shape LANE_ROOM. The composition has a joint and motion along the court.
    """
    draws, impacts = rows.shape[0], v_x1.shape[1]
    given, solved, rest = room[:INPUTS], room[INPUTS : INPUTS + OUTPUTS], room[INPUTS + OUTPUTS :]
    alone = not vertical_in_lanes(codes)
    count = draws * impacts
    left = 0
    for first in range(0, count, WIDTH):
        filled = WIDTH if first + WIDTH <= count else count - first
        for lane in range(WIDTH):
            # Draws of one impact lie side by side: they go through the same phases. The last lanes repeat.
            place = first + (lane if lane < filled else filled - 1)
            j = place // draws
            i = place - j * draws
            own = i if v_x1.shape[0] > 1 else 0
            for column in range(len(COLUMNS)):
                given[column, lane] = rows[i, column]
            given[V_X, lane], given[V_Y, lane] = v_x1[own, j], v_y1[own, j]
            given[OMEGA, lane], given[COR, lane] = omega_1[own, j], cor[own, j]
            if alone:
                give_vertical(rows[i], codes, lane, given)
        bounce_lanes(lane_array(given), codes, lane_array(solved), rest)
        for lane in range(filled):
            j = (first + lane) // draws
            i = first + lane - j * draws
            status[i, j] = LEFT
            if solved[PLAIN, lane] > 0.5:
                out[0, i, j], out[1, i, j] = solved[V_X2, lane], solved[V_Y2, lane]
                out[2, i, j], out[3, i, j] = solved[OMEGA_2, lane], solved[CONTACT_TIME, lane]
                out[4, i, j], out[5, i, j] = solved[GAP_TIME, lane], solved[GAP_PATH, lane]
                out[6, i, j] = solved[GAP_TURN, lane]
                regime[i, j], status[i, j] = int(solved[REGIME, lane]), OK
            else:
                left += 1
    return left
