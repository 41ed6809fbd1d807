"""Derivatives of one bounce of any two-mass composition, and batches of them, as kernels.

The bounce is solved once in real numbers; its pieces are then followed again once a derivative (see `replay`).
"""

from __future__ import annotations

import math

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
from fitball.models.kernels.compiled import calling, inner, inner_allocating
from fitball.models.kernels.dual import STEP
from fitball.models.kernels.oscillator import SERIES_LENGTH
from fitball.models.kernels.phases import PIECE_SIZE
from fitball.models.kernels.replay import ReplayScratch, replay_contact
from fitball.models.kernels.rigid import rigid_contact
from fitball.models.kernels.two_mass import MAX_PHASES, make_scratch
from fitball.values import FloatArray

ComplexArray = NDArray[np.complex128]
# Derivatives with respect to an impact's own speeds, spin, and measured restitution come first.
V_X1, V_Y1, OMEGA_1, COR, INPUTS = range(5)


@inner_allocating
def make_replay_scratch() -> ReplayScratch:
    """Scratch for one thread."""
    return ReplayScratch(
        np.zeros(max(SERIES_LENGTH, 4), dtype=np.complex128), np.zeros(SERIES_LENGTH, dtype=np.complex128)
    )


@inner
def bounce_derivative(
    row: ComplexArray,
    codes: NDArray[np.int64],
    v_x: complex,
    v_y: complex,
    omega: complex,
    cor_measured: complex,
    phase_log: FloatArray,
    pieces: int,
    scratch: ReplayScratch,
) -> tuple[complex, complex, complex, complex]:
    """`(v_x2, v_y2, omega_2, contact_time)` of a bounce that has been solved; arguments as in `bounce`."""
    _status, vertical = vertical_motion(row, codes, v_y, cor_measured)
    v_y2 = vertical.cor * v_y
    if codes[TANGENTIAL] == 0:
        return v_x, v_y2, omega, vertical.t_contact
    _status, contact = contact_of(row, codes, vertical, v_x, v_y, omega)
    if codes[TORSION] == TORSION_RIGID:
        v_x2, omega_2, _regime = rigid_contact(contact)
    else:
        v_x2, omega_2 = replay_contact(contact, phase_log, pieces, scratch)
    return v_x2, v_y2, omega_2, vertical.t_contact


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
    scratch, replay_scratch = make_scratch(), make_replay_scratch()
    phase_log = np.empty((MAX_PHASES, PIECE_SIZE))
    row = np.empty(len(COLUMNS), dtype=np.complex128)
    for i in range(rows.shape[0]):
        own = i if v_x1.shape[0] > 1 else 0
        for j in range(v_x1.shape[1]):
            v_x, v_y, omega, measured = v_x1[own, j], v_y1[own, j], omega_1[own, j], cor[own, j]
            solved = bounce_alone(rows[i], codes, v_x, v_y, omega, measured, scratch, phase_log)
            for k in range(INPUTS + seeds.shape[0]):
                if solved.status != OK:
                    slopes[i, j, :, k] = math.nan
                    continue
                if k == COR and codes[RESTITUTION] != COR_MEASURED:
                    slopes[i, j, :, k] = 0.0
                    continue
                for column in range(row.shape[0]):
                    seed = seeds[k - INPUTS, i, column] if k >= INPUTS else 0.0
                    row[column] = complex(rows[i, column], STEP * seed)
                moved = bounce_derivative(
                    row,
                    codes,
                    complex(v_x, STEP if k == V_X1 else 0.0),
                    complex(v_y, STEP if k == V_Y1 else 0.0),
                    complex(omega, STEP if k == OMEGA_1 else 0.0),
                    complex(measured, STEP if k == COR else 0.0),
                    phase_log,
                    solved.pieces,
                    replay_scratch,
                )
                for output in range(4):
                    slopes[i, j, output, k] = moved[output].imag / STEP
