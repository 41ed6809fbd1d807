"""Where first order in the incident errors ends: near a change of regime the bounce has a kink.

Wherever the regime changes within three standard deviations of the incident state, the normal density of that state
is written as a mixture of narrower ones along the direction of the change,

    N(t; 0, 1) = int N(m; 0, 1 - a^2) N(t; m, a^2) dm ,

and first order only has to hold over each narrow part (a Gaussian sum: Sorenson and Alspach 1971). Its cost is that
of a Jacobian for every part.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fitball.models.types import Rebound
from fitball.values import FloatArray, Impacts, OwnImpacts

# Incident states (v_x1, v_y1, omega_1, cor) of any shape.
States = tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]

# Standard deviations within which a change of regime is looked for.
REACH = 3.0
# Width of the parts, their number, and how far out they are laid: closer together than they are wide, so that the sum
# is as good as the integral. The log density of an impact is then within hundredths, against some tenths at first
# order where the boundary lies within a standard deviation.
WIDTH = 0.2
PARTS = 35
OUTERMOST = 4.0


def roots(covariance: FloatArray) -> FloatArray:
    """Columns (impacts, 3, 3) of one standard deviation along each principal axis of the correlation."""
    scale = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    safe = np.where(scale > 0.0, scale, 1.0)
    correlation = covariance / (safe[:, :, None] * safe[:, None, :])
    eigenvalues, vectors = np.linalg.eigh(correlation)
    # Rounding of a singular correlation leaves eigenvalues of its own size on either side of zero.
    axes: FloatArray = scale[:, :, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0))[:, None, :]
    return axes


def shifted(impacts: Impacts, moves: FloatArray, rows: NDArray[np.int64]) -> Impacts:
    """Impacts `rows` moved by `moves` (rows, 3)."""
    cor = None if impacts.cor is None else impacts.cor[rows]
    return Impacts(
        impacts.v_x1[rows] + moves[:, 0], impacts.v_y1[rows] + moves[:, 1], impacts.omega_1[rows] + moves[:, 2], cor
    )


def displaced(states: States, moves: FloatArray) -> tuple[OwnImpacts, NDArray[np.bool_]]:
    """`states`, broadcastable to (draws, impacts), moved by `moves` (draws, impacts, 3), and which still reach the
    court.

    One that does not has no impact; it stands unmoved.
    """
    v_x, v_y, omega, cor = states
    possible = v_y + moves[..., 1] > 0.0
    kept = np.where(possible[..., None], moves, 0.0)
    restitution = None if cor is None else np.broadcast_to(cor, possible.shape)
    return OwnImpacts(v_x + kept[..., 0], v_y + kept[..., 1], omega + kept[..., 2], restitution), possible


def crossings(
    evaluate: Callable[[Impacts, NDArray[np.int64]], Rebound], impacts: Impacts, root: FloatArray, rebound: Rebound
) -> FloatArray:
    """Direction (draws, impacts, 3), of unit length in principal axes, in which the regime changes at `REACH`.

    Zero where it does not. `evaluate(impacts, rows)` gives the rebounds of impacts near those of the table's `rows`.
    """
    axes = REACH * np.moveaxis(root, 2, 0)
    moves = np.stack([axes, -axes])
    # A state that does not approach the court is no neighbour that could have been measured.
    sign, axis, rows = np.nonzero(impacts.v_y1 + moves[..., 1] > 0.0)
    moved = evaluate(shifted(impacts, moves[sign, axis, rows], rows), rows)
    changed = np.zeros((rebound.regime.shape[0], *moves.shape[:3]), dtype=bool)
    changed[:, sign, axis, rows] = (
        (moved.regime != rebound.regime[:, rows]) & (moved.status == 0) & (rebound.status[:, rows] == 0)
    )
    up, down = np.moveaxis(changed, (1, 2, 3), (0, 3, 2))
    direction = np.where(up, 1.0, np.where(down, -1.0, 0.0))
    length = np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.asarray(direction / np.where(length > 0.0, length, 1.0))


def parts() -> tuple[FloatArray, FloatArray]:
    """Centres of the parts in standard deviations, evenly spaced, and the logarithms of their weights."""
    spread = np.sqrt(1.0 - WIDTH * WIDTH)
    centres = np.linspace(-OUTERMOST, OUTERMOST, PARTS) * spread
    logs = -0.5 * (centres / spread) ** 2
    return centres, logs - logsumexp(logs)


def narrowed(root: FloatArray, direction: FloatArray) -> FloatArray:
    """Covariances (pairs, 3, 3) of the parts, for roots (pairs, 3, 3) and directions (pairs, 3)."""
    along = np.einsum("pij,pj->pi", root, direction)
    taken: FloatArray = (1.0 - WIDTH * WIDTH) * along[:, :, None] * along[:, None, :]
    return np.asarray(np.einsum("pij,pkj->pik", root, root) - taken)


def mixed(log_densities: FloatArray) -> FloatArray:
    """Log density of each pair from those of its parts, (pairs, parts)."""
    density: FloatArray = logsumexp(log_densities + parts()[1], axis=1)
    return density
