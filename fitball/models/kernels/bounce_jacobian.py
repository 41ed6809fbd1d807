"""Derivatives of one bounce of any two-mass composition, and batches of them, as kernels.

The bounce is solved once in real numbers; its pieces are then followed again in numbers that carry a derivative along
several directions at once (see `replay`, `gradient`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.alone import BOUNCE
from fitball.models.kernels.bounce import (
    COLUMNS,
    COR_MEASURED,
    OK,
    RESTITUTION,
    TANGENTIAL,
    TORSION,
    TORSION_RIGID,
    contact_of,
    vertical_motion,
)
from fitball.models.kernels.compiled import calling, inlined, inner_allocating
from fitball.models.kernels.dual import STEP
from fitball.models.kernels.entry import Entry, read_only
from fitball.models.kernels.gradient import SLOPES, GradientArray, gradient_array
from fitball.models.kernels.oscillator import SERIES_LENGTH
from fitball.models.kernels.phases import PIECE_SIZE
from fitball.models.kernels.replay import ReplayScratch, replay_contact
from fitball.models.kernels.rigid import rigid_contact
from fitball.models.kernels.two_mass import MAX_PHASES, make_scratch
from fitball.models.kernels.vectors import WIDTH
from fitball.values import FloatArray

# Derivatives with respect to an impact's own speeds, spin, and measured restitution come first.
V_X1, V_Y1, OMEGA_1, COR, INPUTS = range(5)
TWIST = max(SERIES_LENGTH, 4)


class GradientScratch(NamedTuple):
    """Numbers and their slopes, (..., WIDTH): kernel row, impact (INPUTS), rebound (4); and scratch of `replay`."""

    row: FloatArray
    impact: FloatArray
    rebound: FloatArray
    series: FloatArray


@inner_allocating
def make_gradient_scratch() -> GradientScratch:
    """Scratch for one thread."""
    return GradientScratch(
        np.zeros((len(COLUMNS), WIDTH)),
        np.zeros((INPUTS, WIDTH)),
        np.zeros((4, WIDTH)),
        np.zeros((TWIST + SERIES_LENGTH, WIDTH)),
    )


@inlined
def lay(row: FloatArray, seeds: FloatArray, draw: int, first: int, scratch: GradientScratch) -> None:
    """Write a kernel's row and what it and the impact carry along the directions from the `first`."""
    for place in range(SLOPES):
        direction = first + place
        for k in range(INPUTS):
            scratch.impact[k, 1 + place] = STEP if k == direction else 0.0
        for column in range(len(COLUMNS)):
            known = INPUTS <= direction < INPUTS + seeds.shape[0]
            seed = seeds[direction - INPUTS, draw, column] if known else 0.0
            scratch.row[column, 0], scratch.row[column, 1 + place] = row[column], STEP * seed


@inlined
def bounce_gradient(codes: NDArray[np.int64], phase_log: FloatArray, pieces: int, scratch: GradientScratch) -> None:
    """Fill in the `rebound` (v_x2, v_y2, omega_2, contact_time) of a bounce that has been solved."""
    row, impact = gradient_array(scratch.row), gradient_array(scratch.impact)
    out: GradientArray = gradient_array(scratch.rebound)
    v_x, v_y, omega = impact[V_X1], impact[V_Y1], impact[OMEGA_1]
    _status, vertical = vertical_motion(row, codes, v_y, impact[COR])
    out[1], out[3] = vertical.cor * v_y, vertical.t_contact
    if codes[TANGENTIAL] == 0:
        out[0], out[2] = v_x, omega
        return
    _status, contact = contact_of(row, codes, vertical, v_x, v_y, omega)
    if codes[TORSION] == TORSION_RIGID:
        out[0], out[2], _regime = rigid_contact(contact)
    else:
        series = ReplayScratch(gradient_array(scratch.series[:TWIST]), gradient_array(scratch.series[TWIST:]))
        out[0], out[2] = replay_contact(contact, phase_log, pieces, series)


bounce_alone = BOUNCE.call


@calling(BOUNCE)
def jacobian_batch(
    rows: FloatArray,
    seeds: FloatArray,
    codes: NDArray[np.int64],
    v_x1: FloatArray,
    v_y1: FloatArray,
    omega_1: FloatArray,
    cor: FloatArray,
    slopes: FloatArray,
) -> None:
    """Fill `slopes` (draws, impacts, 4, INPUTS + parameters): those of what `bounce_batch` gives of the same impacts.

    `seeds` (parameters, draws, columns): what each column of `rows` gains per unit of a parameter. Without a measured
    restitution among the inputs the slopes along it are zero; where the status is not OK all are NaN.
    """
    scratch, carrying = make_scratch(), make_gradient_scratch()
    phase_log = np.empty((MAX_PHASES, PIECE_SIZE))
    directions = INPUTS + seeds.shape[0]
    for i in range(rows.shape[0]):
        own = i if v_x1.shape[0] > 1 else 0
        for j in range(v_x1.shape[1]):
            v_x, v_y, omega, measured = v_x1[own, j], v_y1[own, j], omega_1[own, j], cor[own, j]
            solved = bounce_alone(rows[i], codes, v_x, v_y, omega, measured, scratch, phase_log)
            if solved.status != OK:
                slopes[i, j] = math.nan
                continue
            impact = carrying.impact
            impact[V_X1, 0], impact[V_Y1, 0], impact[OMEGA_1, 0], impact[COR, 0] = v_x, v_y, omega, measured
            for first in range(0, directions, SLOPES):
                lay(rows[i], seeds, i, first, carrying)
                bounce_gradient(codes, phase_log, solved.pieces, carrying)
                for output in range(4):
                    for place in range(min(SLOPES, directions - first)):
                        slopes[i, j, output, first + place] = carrying.rebound[output, 1 + place] / STEP
            if codes[RESTITUTION] != COR_MEASURED:
                slopes[i, j, :, COR] = 0.0


JACOBIAN = Entry(
    jacobian_batch,
    (
        np.zeros((1, len(COLUMNS))), np.zeros((1, 1, len(COLUMNS))), np.zeros(TANGENTIAL + 1, dtype=np.int64),
        *(read_only((1, 1)) for _ in range(4)), np.zeros((1, 1, 4, INPUTS)),
    ),
    None,
)  # fmt: skip
