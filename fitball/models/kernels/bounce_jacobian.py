"""Derivatives of one bounce of any two-mass composition, and batches of them, as kernels.

The bounce is solved once in real numbers; its pieces are then retraced once a derivative (see `replay`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.bounce import (
    COLUMNS,
    COR_MEASURED,
    OK,
    TORSION_RIGID,
    bounce,
    joint,
    landing_and_offset,
    rigid_impulse,
    vertical_motion,
)
from fitball.models.kernels.compiled import compiled, compiled_allocating
from fitball.models.kernels.dual import STEP
from fitball.models.kernels.events import POLES
from fitball.models.kernels.oscillator import SERIES_LENGTH
from fitball.models.kernels.replay import ReplayScratch, replay_contact
from fitball.models.kernels.rigid import rigid_contact
from fitball.models.kernels.two_mass import MAX_PHASES, PIECE_SIZE, make_scratch
from fitball.values import FloatArray

ComplexArray = NDArray[np.complex128]
# Derivatives with respect to an impact's own speeds, spin, and measured restitution come first.
V_X1, V_Y1, OMEGA_1, COR, INPUTS = range(5)


@compiled_allocating
def make_replay_scratch() -> ReplayScratch:
    """Scratch for one thread."""
    return (
        np.zeros(max(SERIES_LENGTH, 4), dtype=np.complex128),
        np.zeros(SERIES_LENGTH, dtype=np.complex128),
        np.zeros(POLES, dtype=np.complex128),
    )


@compiled
def bounce_again(
    row: ComplexArray,
    codes: NDArray[np.int64],
    v_x: complex,
    v_y: complex,
    omega: complex,
    cor_measured: complex,
    record: FloatArray,
    pieces: int,
    scratch: ReplayScratch,
) -> tuple[complex, complex, complex, complex]:
    """`(v_x2, v_y2, omega_2, contact_time)` of a bounce whose pieces stand in `record`; the rest as in `bounce`."""
    _status, cor, riding_mass, omega2, sigma, w2, t_force, t_contact = vertical_motion(row, codes, v_y, cor_measured)
    if codes[7] == 0:
        return v_x, cor * v_y, omega, t_contact
    mu, mass, radius = row[3], row[10], row[11]
    landing, eps = landing_and_offset(row, codes, v_y)
    eps_in_slide = codes[2] == 1
    if codes[5] == TORSION_RIGID:
        v_x2, omega_2, _regime = rigid_contact(
            mass, radius, row[12], mu, eps, eps_in_slide,
            landing, rigid_impulse(landing, riding_mass, v_y, sigma, t_force), False, v_x, omega,
        )  # fmt: skip
        return v_x2, cor * v_y, omega_2, t_contact
    _status, inertia_core, inertia_shell, damping, w2_slide = joint(row, codes, w2)
    v_x2, omega_2 = replay_contact(
        mass, radius, inertia_core, inertia_shell, row[2], damping, w2_slide,
        mu, eps, eps_in_slide, codes[3] == 1, riding_mass, landing, omega2, sigma, w2, t_force, t_contact,
        v_x, v_y, omega, record, pieces, scratch,
    )  # fmt: skip
    return v_x2, cor * v_y, omega_2, t_contact


@compiled_allocating
def jacobian_batch(
    rows: FloatArray,
    seeds: FloatArray,
    codes: NDArray[np.int64],
    v_x1: FloatArray,
    v_y1: FloatArray,
    omega_1: FloatArray,
    cor: FloatArray,
    out: FloatArray,
    slopes: FloatArray,
    regime: NDArray[np.int64],
    status: NDArray[np.int8],
) -> None:
    """Fill `out`, regimes and statuses as `bounce_batch` does, and `slopes` (draws, impacts, 4, INPUTS + parameters).

    `seeds` (parameters, draws, columns): what each column of `rows` gains per unit of a parameter. Without a measured
    restitution among the inputs the slopes along it are zero; where the status is not OK all are NaN.
    """
    scratch, again = make_scratch(), make_replay_scratch()
    record = np.empty((MAX_PHASES, PIECE_SIZE))
    row = np.empty(len(COLUMNS), dtype=np.complex128)
    for i in range(rows.shape[0]):
        own = i if v_x1.shape[0] > 1 else 0
        for j in range(v_x1.shape[1]):
            found, v_x2, v_y2, omega_2, time, phases, pieces = bounce(
                rows[i], codes, v_x1[own, j], v_y1[own, j], omega_1[own, j], cor[own, j], scratch, record
            )
            out[0, i, j], out[1, i, j], out[2, i, j], out[3, i, j] = v_x2, v_y2, omega_2, time
            regime[i, j] = phases
            status[i, j] = found
            for k in range(INPUTS + seeds.shape[0]):
                if found != OK:
                    slopes[i, j, :, k] = math.nan
                    continue
                if k == COR and codes[6] != COR_MEASURED:
                    slopes[i, j, :, k] = 0.0
                    continue
                for column in range(row.shape[0]):
                    seed = seeds[k - INPUTS, i, column] if k >= INPUTS else 0.0
                    row[column] = complex(rows[i, column], STEP * seed)
                moved = bounce_again(
                    row,
                    codes,
                    complex(v_x1[own, j], STEP if k == V_X1 else 0.0),
                    complex(v_y1[own, j], STEP if k == V_Y1 else 0.0),
                    complex(omega_1[own, j], STEP if k == OMEGA_1 else 0.0),
                    complex(cor[own, j], STEP if k == COR else 0.0),
                    record,
                    pieces,
                    again,
                )
                for output in range(4):
                    slopes[i, j, output, k] = moved[output].imag / STEP
