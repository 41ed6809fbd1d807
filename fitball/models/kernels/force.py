"""The vertical spring's force through a contact, as its first and second time integrals, as kernels.

`F = K_y y + C_y y' = -M1 y''` while it is compressive (`0 < t < t_force`), and nothing before and after: so its
impulse is `P = M1 (v_y1 - y')` and the integral of that `Q = M1 (v_y1 t - y)`. A sensor shows means of the force
over a time, which are differences of these integrals; unlike the force itself they have no step at landing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitball.models.kernels.bounce import OK, vertical_motion
from fitball.models.kernels.compiled import compiled, compiled_allocating
from fitball.models.kernels.dual import Number, NumberArray, size, sqrt
from fitball.models.kernels.oscillator import damped_pair
from fitball.values import FloatArray


@compiled
def spring_integrals(
    riding_mass: Number, v_y: Number, sigma: Number, w2: Number, omega2: Number, w: Number, t: Number
) -> tuple[Number, Number]:
    """`(P, Q)` [N s, N s^2] at a time `t` during the contact, `w = sqrt(|w2|)`."""
    cosine, sine, _envelope = damped_pair(sigma, w2, omega2, w, t)
    return riding_mass * v_y * (1.0 - cosine + sigma * sine), riding_mass * v_y * (t - sine)


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
    impacts) is the mean time of the force after landing. `rows` and `codes` as in `bounce.bounce_batch`; the number
    of times may be zero.
    """
    for i in range(rows.shape[0]):
        for j in range(v_y1.shape[0]):
            # Real or complex as the row is.
            zero = 0.0 * rows[i, 0]
            status, _cor, mass, omega2, sigma, w2, t_force, _t_contact = vertical_motion(
                rows[i], codes, v_y1[j] + zero, cor[j] + zero
            )
            if status != OK:
                out[:, i, j, :] = np.nan
                centroid[i, j] = np.nan
                continue
            w = sqrt(size(w2))
            whole, passed = spring_integrals(mass, v_y1[j] + zero, sigma, w2, omega2, w, t_force)
            centroid[i, j] = t_force - passed / whole
            for k in range(out.shape[3]):
                t = first[i, j] + k * spacing[j]
                if t.real <= 0.0:
                    out[0, i, j, k], out[1, i, j, k] = zero, zero
                elif t.real >= t_force.real:
                    out[0, i, j, k], out[1, i, j, k] = whole, passed + whole * (t - t_force)
                else:
                    impulse, integral = spring_integrals(mass, v_y1[j] + zero, sigma, w2, omega2, w, t + zero)
                    out[0, i, j, k], out[1, i, j, k] = impulse, integral
