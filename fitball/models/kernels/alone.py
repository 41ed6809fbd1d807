"""The bounce of one impact with machine code of its own: batches and derivatives call it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.bounce import COLUMNS, TANGENTIAL, bounce
from fitball.models.kernels.compiled import apart
from fitball.models.kernels.entry import Entry
from fitball.models.kernels.phases import PIECE_SIZE
from fitball.models.kernels.quantities import Bounce, Scratch
from fitball.models.kernels.two_mass import MAX_PHASES
from fitball.values import FloatArray


@apart
def bounce_alone(
    row: FloatArray,
    codes: NDArray[np.int64],
    v_x: float,
    v_y: float,
    omega: float,
    cor_measured: float,
    scratch: Scratch,
    phase_log: FloatArray,
) -> Bounce:
    """See `bounce`."""
    return bounce(row, codes, v_x, v_y, omega, cor_measured, scratch, phase_log)


BOUNCE = Entry(
    bounce_alone,
    (
        np.zeros(len(COLUMNS)), np.zeros(TANGENTIAL + 1, dtype=np.int64), 0.0, 0.0, 0.0, 0.0,
        Scratch(np.zeros(1), np.zeros(1), np.zeros(1), np.zeros((1, 5))), np.zeros((MAX_PHASES, PIECE_SIZE)),
    ),
    Bounce(0, 0.0, 0.0, 0.0, 0.0, 0, 0),
)  # fmt: skip
