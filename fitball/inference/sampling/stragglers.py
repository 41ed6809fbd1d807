"""Walkers that the others have left behind: found at the end of a warm-up, before any step that counts.

A walker may stay in a mode that holds next to no probability, for want of a move out of it, and then counts for far
more than the mode does. It is known by its density: in the second half of the warm-up more often than not, and at its
end, lower than all but a hundredth of what the others have. A walker that mixes is there by chance with a probability
below a hundredth for each time it forgets where it was, some times in those steps: once in many runs. That alone does
not make a mode spurious, for a wide one may hold much at a low density. So its probability is estimated as that of a
normal mode, density times volume, and must be next to nothing beside theirs. The volume follows from the walker's own
steps along the axes of the others (no smaller than that of the ellipsoid they fill, by Hadamard's inequality). Where
its density changed less than in a whole normal mode, by a variance of half the dimension, it has seen a part only,
and the mode is taken to be larger in that proportion; a walker that never moved fills nothing.

Up to a tenth of all walkers can be found so; more of them are a mode that one may not ignore, and R-hat's business.
One taken by mistake does no harm: it goes on from a draw of the others, an equally good start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitball.values import FloatArray

# Share of all walkers, the lowest, that do not count as the others; and share of the others' draws below which a
# walker is left behind.
SET_ASIDE, LOWEST = 0.1, 0.01
# Probability of a mode, beside that of all others, at which it is spurious: a walker in it, one of a hundred or so,
# would count a hundred times too much.
SPURIOUS = 1e-4


def left_behind(chains: FloatArray, log_posterior: FloatArray) -> NDArray[np.bool_]:
    """Which walkers (ensembles, walkers) are stragglers, from the second half of the warm-up: `chains` (ensembles,
    steps, walkers, free) in coordinates and `log_posterior` (ensembles, steps, walkers).
    """
    middle = np.median(log_posterior, axis=1)
    by_walker = log_posterior.transpose(0, 2, 1)
    floor = np.quantile(by_walker[middle >= np.quantile(middle, SET_ASIDE)], LOWEST)
    low = (middle < floor) & (log_posterior[:, -1] < floor)
    if not np.any(low):
        return low
    # The better half of the walkers: what others share the fate of one left behind must not stretch the axes.
    better = middle >= np.median(middle)
    axes, spread = _axes(chains.transpose(0, 2, 1, 3)[better].reshape(-1, chains.shape[-1]))
    own = chains.transpose(0, 2, 1, 3)[low]
    steps = own @ axes
    mine = by_walker[low]
    part = np.minimum(2.0 * mine.var(axis=1) / steps.shape[-1], 1.0)
    # By its own coordinates: a matrix product may round equal rows differently, by where in a block they lie.
    moved = np.any(own != own[:, :1], axis=(1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        volume = np.sum(np.log(steps.std(axis=1) / spread) - 0.5 * np.log(part)[:, None], axis=1)
    low[low] = ~moved | (mine.mean(axis=1) - by_walker[better].mean() + volume < np.log(SPURIOUS))
    return low


def relocation(
    behind: NDArray[np.bool_], steps: int, rng: np.random.Generator
) -> tuple[NDArray[np.intp], NDArray[np.int64], NDArray[np.intp]]:
    """Where the stragglers of one ensemble go on: their numbers, and for each the step (of `steps`) and the walker,
    no straggler, whose place it takes.
    """
    walkers, others = np.flatnonzero(behind), np.flatnonzero(~behind)
    return walkers, rng.integers(steps, size=walkers.size), rng.choice(others, walkers.size)


def left_behind_words(behind: NDArray[np.bool_]) -> tuple[str, ...]:
    """What was done about stragglers (ensembles, walkers), in a sentence; none where there were none."""
    count = int(np.count_nonzero(behind))
    if not count:
        return ()
    which = f"1 of {behind.size} walkers was" if count == 1 else f"{count} of {behind.size} walkers were"
    return (
        f"{which} stuck during the warm-up where the posterior has next to no mass, and restarted from draws of the "
        "others. No step before that counts",
    )


def _axes(draws: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Principal axes (free, free), one per column, of draws (draws, free) in units of their sds, and the sds along
    them (free,).
    """
    # What never changes is known by its values: their mean, and so their sd, may be off by rounding.
    scaled = np.where(np.ptp(draws, axis=0) > 0.0, draws.std(axis=0), 1.0)
    _, vectors = np.linalg.eigh(np.atleast_2d(np.cov(draws / scaled, rowvar=False)))
    axes: FloatArray = vectors / scaled[:, None]
    return axes, (draws @ axes).std(axis=0)
