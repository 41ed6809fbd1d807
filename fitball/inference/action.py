"""In which impacts a parameter moves the rebound, from the derivative over draws, and in which the regime is in
doubt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitball.inference.force import force_slopes
from fitball.inference.force_records import ForceRecords
from fitball.inference.looks import NAMED, ActionLook
from fitball.inference.parameters import NOISE_SPECS
from fitball.inference.posterior import Problem
from fitball.inference.slopes import prediction_slopes
from fitball.inference.subsample import LOOKED_AT, thinned_problem, thinned_rows
from fitball.values import FloatArray

# Change of a rebound, in sds of its noise for the whole width of the prior, below which nothing acts: differences are
# good to about 1e-8 of it, and no table could show less than a thousandth.
ACTS = 1e-3
# Share of the draws in which a parameter must act to count as acting in an impact.
MOSTLY = 0.5
# A phase sequence with a probability between these leaves the regime of its impact in doubt.
DOUBT = (0.05, 0.95)


def action_looks(
    problem: Problem, coordinates: FloatArray, regimes: Sequence[Mapping[str, float]]
) -> dict[str, ActionLook]:
    """The look at every free parameter but noise, over `coordinates` (draws, free); `regimes` are the probabilities
    of each impact's phase sequences, none of them in doubt when empty. Of a large table a part is looked at.
    """
    kept = thinned_rows(problem, LOOKED_AT)
    problem = thinned_problem(problem, LOOKED_AT)
    regimes = [regimes[k] for k in kept] if regimes else ()
    count = len(problem.impacts)
    slopes = prediction_slopes(problem, coordinates).reshape(coordinates.shape[0], -1, count, problem.dimension)
    # A draw at the very edge of what the model can evaluate has no derivative: it says nothing.
    if problem.force is not None:
        slopes = np.concatenate([slopes, _on_records(problem, problem.force, coordinates)], axis=1)
    squares = np.nanmean(np.sum(slopes**2, axis=1), axis=0)
    acting = np.nanmean(np.nanmax(np.abs(slopes), axis=1) > ACTS, axis=0)
    ids = problem.table.ids
    doubtful = [k for k, shares in enumerate(regimes) if DOUBT[0] < max(shares.values(), default=1.0) < DOUBT[1]]
    # Without motion along the court a contact has no phases, and no name.
    usual = tuple(sorted({max(shares, key=lambda name: shares[name]) for shares in regimes} - {""}))
    looks = {}
    for column, item in enumerate(problem.free):
        if item.name in NOISE_SPECS:
            continue
        total = float(squares[:, column].sum())
        moved = np.flatnonzero(acting[:, column] >= MOSTLY)
        unsure = [k for k in doubtful if acting[k, column] > 0.0]
        looks[item.name] = ActionLook(
            impacts=tuple(ids[k] for k in moved[:NAMED]),
            acting=moved.size,
            of=count,
            regimes=usual,
            doubtful=tuple(ids[k] for k in unsure[:NAMED]),
            in_doubt=len(unsure),
            share_doubtful=float(squares[doubtful, column].sum()) / total if total > 0.0 else 0.0,
        )
    return looks


def _on_records(problem: Problem, records: ForceRecords, coordinates: FloatArray) -> FloatArray:
    """Slopes (draws, 1, impacts, free) of force records: the length of those of each, none without a record."""
    slopes = np.zeros((coordinates.shape[0], 1, len(problem.impacts), problem.dimension))
    _rows, found, _shares = force_slopes(problem, records, coordinates)
    slopes[:, 0, records.rows] = np.sqrt(np.sum(found**2, axis=2)) * problem.prior.width
    return slopes
