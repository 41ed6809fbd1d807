"""Where first order in the incident errors ends: near a change of regime the bounce has a kink.

Wherever the regime changes within three standard deviations of the incident state, the normal density of that state
is written as a mixture of narrower ones along the direction of the change,

    N(t; 0, 1) = int N(m; 0, 1 - a^2) N(t; m, a^2) dm ,

and first order only has to hold over each narrow part (a Gaussian sum: Sorenson and Alspach 1971). Its cost is that
of a rebound for every part, and of three Jacobians for every regime among them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fitball.inference.likelihood.cells import UNKNOWN, Columns, joint_root, solved, spread_by_input
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.row_errors import RowErrors
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
# Angle [rad] by which a velocity noise of 1 m/s turns a rebound of some 10 m/s.
TURN = 0.1
# Pairs of draw and impact that are split at once: more only take more memory.
PAIRS = 2000


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


@dataclass(frozen=True)
class Pairs:
    """Pairs of a draw and an impact of the table near a change of regime.

    `columns` parameters (pairs,), `measured` what was seen, (pairs, 1) or, where nothing was, NaN, with the `bias` of
    its group; `errors` those of each impact's row, and `states` its incident states (pairs, 1); `root` (pairs, 3, 3)
    as in `roots`, `towards` (pairs, 3) a direction, in principal axes, in which the regime changes.
    """

    columns: Columns
    measured: Sequence[Observable]
    bias: Sequence[FloatArray | float]
    errors: RowErrors
    states: States
    root: FloatArray
    towards: FloatArray


def mixtures(
    problem: Problem, columns: Columns, rebound: Rebound
) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Draws and rows (pairs,) whose impact is near a change of regime, and the log density of each of its
    measurements there given those before it, (pairs, columns).
    """
    assert problem.errors is not None
    root = roots(problem.errors.incident)
    towards = crossings(
        lambda impacts, rows: problem.seen_like(columns, impacts, rows), problem.impacts, root, rebound
    )
    draws, rows = np.nonzero(np.any(np.abs(towards) > 0.0, axis=-1))
    density = np.empty((draws.size, len(problem.observables)))
    for start in range(0, draws.size, PAIRS):
        some = slice(start, start + PAIRS)
        density[some] = _mixture(problem, _pairs(problem, columns, draws[some], rows[some], root, towards))
    return draws, rows, density


def _pairs(
    problem: Problem,
    columns: Columns,
    draws: NDArray[np.int64],
    rows: NDArray[np.int64],
    root: FloatArray,
    towards: FloatArray,
) -> Pairs:
    assert problem.errors is not None
    errors = problem.errors.chosen([item.name for item in problem.observables])
    whole, bias = [item.everywhere(len(problem.impacts)) for item in problem.observables], problem.group_bias
    v_x1, v_y1, omega_1, cor = problem.impacts.take(rows).states()
    return Pairs(
        problem.paired(columns, draws, rows),
        [
            replace(
                item, observed=item.observed[rows][:, None], sd=None if item.sd is None else item.sd[rows][:, None]
            )
            for item in whole
        ],
        [0.0 if bias is None else bias.offset(columns, item.name)[draws, rows][:, None] for item in whole],
        errors.take(rows),
        (v_x1.T, v_y1.T, omega_1.T, None if cor is None else cor.T),
        root[rows],
        towards[draws, rows],
    )


def _mixture(problem: Problem, pairs: Pairs) -> FloatArray:
    """Log density (pairs, columns) of each measurement of an impact given those before it, its incident errors
    split.
    """
    across = _across(problem, pairs)
    along = np.einsum("pij,pj->pi", pairs.root, across)
    moves = parts()[0][:, None] * along[:, None, :]
    states, possible = displaced(pairs.states, moves)
    rebound, slopes = problem.linearised(pairs.columns, states, possible)
    # A true state that far from the one that was read is an error of that, with which those of the rebound go.
    followed = -np.einsum("pci,pmi->pmc", pairs.errors.follows, moves)
    gaps, sds, by_input = [], [], []
    for place, (item, bias) in enumerate(zip(pairs.measured, pairs.bias, strict=True)):
        gap = item.observed - item.predict(rebound) - bias - followed[..., place]
        missing = np.broadcast_to(np.isnan(item.observed), gap.shape)
        gaps.append(np.where(missing, 0.0, gap))
        spread = pairs.errors.own(item).sds(pairs.columns, rebound)
        sds.append(np.where(missing, UNKNOWN, np.broadcast_to(spread, gap.shape)))
        by_input.append(item.column.slopes(rebound, slopes))
    own = np.stack(sds, axis=2)
    apart = np.stack(by_input, axis=2) - pairs.errors.follows[:, None]
    shared = spread_by_input(apart, narrowed(pairs.root, across)[:, None]) + pairs.errors.rest[:, None]
    root = joint_root(shared, own)
    z = solved(root, np.stack(gaps, axis=2)[..., None])[..., 0]
    flat = problem.noise.log_density(z.reshape(len(z), -1), pairs.columns).reshape(z.shape)
    terms = np.where(own < UNKNOWN, flat - np.log(np.diagonal(root, axis1=2, axis2=3)), 0.0)
    whole = np.cumsum(terms, axis=2) + parts()[1][:, None]
    whole[~(possible & (rebound.status == 0))] = -np.inf
    peak = whole.max(axis=1, keepdims=True)
    # Where no part is possible there is no density; the difference of two infinities would be none either.
    whole -= np.where(np.isfinite(peak), peak, 0.0)
    with np.errstate(divide="ignore"):
        return _given_those_before(np.log(np.exp(whole).sum(axis=1)) + peak[:, 0])


def _given_those_before(whole: FloatArray) -> FloatArray:
    """Terms (pairs, columns) that add up to `whole`, the log densities of all columns up to each: none where the
    first of them has no density.
    """
    terms = whole.copy()
    known = np.isfinite(whole[:, 0])
    terms[known, 1:] -= whole[known, :-1]
    terms[~known, 1:] = 0.0
    return terms


def _across(problem: Problem, pairs: Pairs) -> FloatArray:
    """Directions (pairs, 3), in principal axes, across the boundaries that lie `towards` somewhere.

    The rebound is continuous, so that its derivative jumps by a matrix of rank one whose rows point across.
    """
    moves = REACH * np.einsum("pij,pj->pi", pairs.root, pairs.towards)
    states, possible = displaced(pairs.states, np.stack([np.zeros_like(moves), moves], axis=1))
    rebound, slopes = problem.linearised(pairs.columns, states, possible)
    # In units of any noise: only the direction of the jump is wanted.
    by_observable = np.stack(
        [
            item.column.slopes(rebound, slopes) / _typical_noise(problem, item, pairs.columns)
            for item in pairs.measured
        ],
        axis=2,
    )
    jump = np.matmul(by_observable[:, 1] - by_observable[:, 0], pairs.root)
    # Where the other side has no derivative the way that was looked is all that is known.
    known = np.isfinite(jump).all(axis=(1, 2)) & possible[:, 1]
    across = pairs.towards.copy()
    across[known] = np.linalg.svd(jump[known])[2][:, 0]
    return across


def _typical_noise(problem: Problem, item: Observable, columns: Columns) -> FloatArray | float:
    """A noise of a measured column, (pairs, 1, 1) or one number."""
    if item.sd is not None:
        stated = next(one.sd for one in problem.observables if one.name == item.name)
        return float(np.nanmedian(np.asarray(stated)))
    size = columns[str(item.noise)][:, None, None]
    return TURN * size if item.turned else size
