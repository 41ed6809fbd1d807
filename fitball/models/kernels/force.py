"""The vertical spring's force through a contact, as its first and second time integrals, as kernels.

`F = K_y y + C_y y' = -M1 y''` (Jafri 2004, Eq. 1; `M` in place of `M1` with `normal = total`) while it is compressive
(`0 < t < t_force`), and nothing before and after: so its impulse is `P = M1 (v_y1 - y')` and the integral of that
`Q = M1 (v_y1 t - y)`. A sensor shows means of the force over a time, which are differences of these integrals; unlike
the force itself they have no step at landing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.bounce import OK, vertical_motion
from fitball.models.kernels.compiled import compiled_allocating, inner
from fitball.models.kernels.dual import Number, NumberArray
from fitball.models.kernels.oscillator import swing_at
from fitball.models.kernels.quantities import VerticalMotion
from fitball.values import FloatArray


@inner
def spring_integrals(vertical: VerticalMotion[Number], v_y: Number, t: Number) -> tuple[Number, Number]:
    """`(P, Q)` [N s, N s^2] at a time `t` during the contact."""
    swing = swing_at(vertical.spring, t)
    scale = vertical.riding_mass * v_y
    return scale * (1.0 - swing.cosine + vertical.spring.decay * swing.sine), scale * (t - swing.sine)


@compiled_allocating
def force_batch(
    rows: NumberArray,
    codes: NDArray[np.int64],
    v_y1: FloatArray,
    cor: FloatArray,
    first: NumberArray,
    spacing: FloatArray,
    out: NumberArray,
    centroid: NumberArray,
) -> None:
    """Fill `out` (2, draws, impacts, times) with P and Q, NaN for an impact without answer.

    The times are `first` (draws, impacts) after landing and every `spacing` (impacts,) from there. `centroid` (draws,
    impacts) is the mean time of the force after landing. `rows` and `codes` as in `batch.bounce_batch`; the number
    of times may be zero.
    """
    for i in range(rows.shape[0]):
        for j in range(v_y1.shape[0]):
            # Real or complex as the row is.
            zero = 0.0 * rows[i, 0]
            v_y = v_y1[j] + zero
            status, vertical = vertical_motion(rows[i], codes, v_y, cor[j] + zero)
            if status != OK:
                out[:, i, j, :] = np.nan
                centroid[i, j] = np.nan
                continue
            t_force = vertical.t_force
            whole, passed = spring_integrals(vertical, v_y, t_force)
            centroid[i, j] = t_force - passed / whole
            for k in range(out.shape[3]):
                t = first[i, j] + k * spacing[j]
                if t.real <= 0.0:
                    out[0, i, j, k], out[1, i, j, k] = zero, zero
                elif t.real >= t_force.real:
                    out[0, i, j, k], out[1, i, j, k] = whole, passed + whole * (t - t_force)
                else:
                    impulse, integral = spring_integrals(vertical, v_y, t + zero)
                    out[0, i, j, k], out[1, i, j, k] = impulse, integral
