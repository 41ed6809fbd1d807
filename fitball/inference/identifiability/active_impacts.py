"""In which impacts a parameter moves the rebound, from the derivative over draws, and in which the regime is in
doubt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitball.inference.likelihood.cells import prediction_slopes
from fitball.inference.likelihood.force import force_slopes
from fitball.inference.problem.force_records import ForceRecords
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import LOOKED_AT, batches, thinned_problem, thinned_rows
from fitball.inference.results.evidence import NAMED, ActiveImpacts
from fitball.values import FloatArray

# Change of a rebound, in sds of its noise for the whole width of the prior, below which nothing acts: differences are
# good to about 1e-8 of it, and no table could show less than a thousandth.
ACTS = 1e-3
# Share of the draws in which a parameter must act to count as acting in an impact.
MOSTLY = 0.5
# A phase sequence with a probability between these leaves the regime of its impact in doubt.
DOUBT = (0.05, 0.95)


def active_impacts(
    problem: Problem, coordinates: FloatArray, regimes: Sequence[Mapping[str, float]]
) -> dict[str, ActiveImpacts]:
    """The evidence on every free parameter but noise, over `coordinates` (draws, free); `regimes` are the
    probabilities of each impact's phase sequences, none of them in doubt when empty. Of a large table a part
    is looked at.
    """
    kept = thinned_rows(problem, LOOKED_AT)
    problem = thinned_problem(problem, LOOKED_AT)
    regimes = [regimes[k] for k in kept] if regimes else ()
    count = len(problem.impacts)
    squares, acting, known = (np.zeros((count, problem.dimension)) for _ in range(3))
    for some in batches(problem, coordinates.shape[0], cost=2 * problem.dimension + 1):
        mine = coordinates[some]
        slopes = prediction_slopes(problem, mine)
        if problem.force is not None:
            slopes = np.concatenate([slopes, _on_records(problem, problem.force, mine)], axis=2)
        # A draw at the very edge of what the model can evaluate has no derivative: it says nothing.
        square = np.sum(slopes**2, axis=2)
        known += np.isfinite(square).sum(axis=0)
        squares += np.where(np.isfinite(square), square, 0.0).sum(axis=0)
        acting += np.sum(np.max(np.where(np.isfinite(slopes), np.abs(slopes), 0.0), axis=2) > ACTS, axis=0)
    squares, acting = squares / np.maximum(known, 1.0), acting / coordinates.shape[0]
    ids = problem.table.ids
    doubtful = [k for k, shares in enumerate(regimes) if DOUBT[0] < max(shares.values(), default=1.0) < DOUBT[1]]
    # Without motion along the court a contact has no phases, and no name.
    usual = tuple(sorted({max(shares, key=lambda name: shares[name]) for shares in regimes} - {""}))
    evidence = {}
    for column, parameter in enumerate(problem.free):
        if parameter.name in NOISE_SPECS:
            continue
        total = float(squares[:, column].sum())
        moved = np.flatnonzero(acting[:, column] >= MOSTLY)
        unsure = [k for k in doubtful if acting[k, column] > 0.0]
        evidence[parameter.name] = ActiveImpacts(
            impacts=tuple(ids[k] for k in moved[:NAMED]),
            acting=moved.size,
            of=count,
            regimes=usual,
            doubtful=tuple(ids[k] for k in unsure[:NAMED]),
            in_doubt=len(unsure),
            share_doubtful=float(squares[doubtful, column].sum()) / total if total > 0.0 else 0.0,
        )
    return evidence


def _on_records(problem: Problem, records: ForceRecords, coordinates: FloatArray) -> FloatArray:
    """Slopes (draws, impacts, 1, free) of force records: the length of those of each, none without a record."""
    slopes = np.zeros((coordinates.shape[0], len(problem.impacts), 1, problem.dimension))
    _rows, by_record, _shares = force_slopes(problem, records, coordinates)
    slopes[:, records.rows, 0] = np.sqrt(np.sum(by_record**2, axis=2)) * problem.prior.width
    return slopes
