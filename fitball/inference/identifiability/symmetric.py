"""Inverses of information matrices, which may be blind in some directions and may lack some rows."""

from __future__ import annotations

import numpy as np

from fitball.values import FloatArray


def inverse(information: FloatArray, ridge: float) -> FloatArray:
    """Inverse (n, n) of a symmetric matrix without negative eigenvalues, `ridge` added to its diagonal.

    Eigenvalues that rounding left below zero count as zero. Rows that are not finite stand for parameters of which
    there is no derivative: the inverse is that of the others, with NaN in those rows and columns.
    """
    inverted = np.full(information.shape, np.nan)
    finite = np.flatnonzero(np.isfinite(np.diag(information)))
    if finite.size:
        eigenvalues, vectors = np.linalg.eigh(information[np.ix_(finite, finite)])
        inverted[np.ix_(finite, finite)] = (vectors / (np.maximum(eigenvalues, 0.0) + ridge)) @ vectors.T
    return inverted
