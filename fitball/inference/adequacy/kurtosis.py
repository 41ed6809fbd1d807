"""How heavy the tails of a sample are (Anscombe and Glynn 1983, Biometrika 70, 227)."""

from __future__ import annotations

import numpy as np

from fitball.values import FloatArray


def kurtosis_score(samples: FloatArray) -> FloatArray:
    """Standard normal scores (samples,) of the kurtosis of rows (samples, n), `n` at least 20; NaN for equal ones."""
    n = float(samples.shape[1])
    centred = samples - samples.mean(axis=1, keepdims=True)
    squares = centred**2
    with np.errstate(invalid="ignore"):
        b2 = np.mean(squares**2, axis=1) / np.mean(squares, axis=1) ** 2
    mean = 3.0 * (n - 1.0) / (n + 1.0)
    variance = 24.0 * n * (n - 2.0) * (n - 3.0) / ((n + 1.0) ** 2 * (n + 3.0) * (n + 5.0))
    x = (b2 - mean) / np.sqrt(variance)
    skewness = 6.0 * (n * n - 5.0 * n + 2.0) / ((n + 7.0) * (n + 9.0))
    skewness *= np.sqrt(6.0 * (n + 3.0) * (n + 5.0) / (n * (n - 2.0) * (n - 3.0)))
    # Degrees of freedom of the chi-square distribution with the same first three moments.
    a = 6.0 + 8.0 / skewness * (2.0 / skewness + np.sqrt(1.0 + 4.0 / skewness**2))
    ratio = (1.0 - 2.0 / a) / (1.0 + x * np.sqrt(2.0 / (a - 4.0)))
    return np.asarray((1.0 - 2.0 / (9.0 * a) - np.cbrt(ratio)) / np.sqrt(2.0 / (9.0 * a)))
