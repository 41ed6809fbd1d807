"""Parts of a problem: some rows of a large table for a search, all but some whose measurements are left out, and how
many are evaluated at once, so that memory does not grow with draws times impacts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fitball.errors import FitError
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.values import FloatArray

# Rows beyond which a table is long, some ten thousand cells. What is of first order looks at so many: sums over the
# others are alike. Searches begin from few places, and the posterior is nearly normal: its draws are weighed.
LOOKED_AT = 3000
# Impacts with a force record, or a measurement of a column with gaps, that are kept in any part of a table.
RECORDED = 20
# Rows whose derivatives are taken at once.
PART = 20_000
# Draws times impacts that are evaluated at once: some twenty arrays of as many numbers live at a time (80 MB).
CELLS = 500_000
# With errors of the incident state a cell has Jacobians too.
INCIDENT_COST = 8


def thinned_rows(problem: Problem, rows: int) -> NDArray[np.int64]:
    """About `rows` row numbers, spread evenly over incidence angle; all of a problem that has no more.

    Some impacts with a force record are always among them, and some with each column that was not always measured:
    they may be all that determines a parameter.
    """
    count = len(problem.impacts)
    if count <= rows:
        return np.arange(count)
    order = np.argsort(problem.impacts.angle, kind="stable")
    chosen = np.sort(order[np.linspace(0, count - 1, rows).round().astype(np.int64)])
    rare = [] if problem.force is None else [problem.force.rows]
    rare += [
        observable.rows
        for observable in problem.observables
        if observable.rows is not None and np.isin(observable.rows, chosen).sum() < RECORDED
    ]
    for places in rare:
        some = places[np.linspace(0, places.size - 1, min(RECORDED, places.size)).round().astype(np.int64)]
        chosen = np.union1d(chosen, some)
    return chosen


def thinned_problem(problem: Problem, rows: int) -> Problem:
    """The same problem on its `thinned_rows`; the problem itself if it has no more."""
    return problem if len(problem.impacts) <= rows else part_of(problem, thinned_rows(problem, rows))


def spanning_part(problem: Problem, rows: int) -> Problem:
    """The `thinned_problem` with the impacts that are farthest out in speed along and away from the court, or in
    spin: what a model cannot evaluate lies beyond them.
    """
    if len(problem.impacts) <= rows:
        return problem
    given = problem.impacts
    ends = [end for column in (given.v_x1, given.v_y1, given.omega_1) for end in (column.argmin(), column.argmax())]
    return part_of(problem, np.union1d(thinned_rows(problem, rows), ends))


def part_of(problem: Problem, kept: NDArray[np.int64]) -> Problem:
    """The same problem on the impacts `kept` (sorted) alone."""
    impacts = problem.impacts.take(kept)
    observables = tuple(_renumbered(observable, kept) for observable in problem.observables)
    covariance = problem.table.covariance
    table = replace(
        problem.table,
        impacts=problem.table.impacts.take(kept),
        ids=tuple(problem.table.ids[k] for k in kept),
        incident_sd={name: column[kept] for name, column in problem.table.incident_sd.items()},
        measurements=tuple(
            replace(
                measurement,
                values=measurement.values[kept],
                sd=None if measurement.sd is None else measurement.sd[kept],
            )
            for measurement in problem.table.measurements
        ),
        redundant=(),
        labels={name: tuple(column[k] for k in kept) for name, column in problem.table.labels.items()},
        notices=(),
        incident_covariance=(
            None if problem.table.incident_covariance is None else problem.table.incident_covariance[kept]
        ),
        covariance=None if covariance is None else replace(covariance, values=covariance.values[kept]),
    )
    return replace(
        problem,
        table=table,
        impacts=impacts,
        observables=observables,
        errors=None if problem.errors is None else problem.errors.take(kept),
        camera=None if problem.camera is None else problem.camera.take(kept),
        force=None if problem.force is None else problem.force.take(kept),
        pooling=tuple(pooling.take(kept) for pooling in problem.pooling),
        group_bias=None if problem.group_bias is None else problem.group_bias.take(kept),
    )


def _renumbered(observable: Observable, kept: NDArray[np.int64]) -> Observable:
    """The observable of a table that consists of the impacts `kept` (sorted) alone."""
    if observable.rows is None:
        return replace(observable.at(kept), rows=None)
    left = observable.at(np.flatnonzero(np.isin(observable.rows, kept)))
    assert left.rows is not None
    return replace(left, rows=np.searchsorted(kept, left.rows))


def withheld(problem: Problem, rows: NDArray[np.int64]) -> Problem:
    """The same problem without the measurements at `rows`.

    The incident conditions of those impacts stay known: the scene's contact time, and the condition that the model
    can evaluate every impact, hold as in the full problem. So the posterior is that of the full problem but for the
    likelihood of `rows`, which is what importance sampling of left-out impacts assumes. A column that was measured
    there alone is left out; raises FitError when none is left.
    """
    observables = []
    for observable in problem.observables:
        entries = np.flatnonzero(~np.isin(observable.places(len(problem.impacts)), rows))
        if entries.size:
            observables.append(observable.at(entries))
    if not observables:
        raise FitError(f"{problem.table.source}: no measurement is left to fit without those impacts")
    force = None if problem.force is None else problem.force.without(rows)
    return replace(problem, observables=tuple(observables), force=force)


def whole_of_parts(problem: Problem, compute: Callable[[Problem], FloatArray]) -> FloatArray:
    """What weighted residuals of a problem are (residuals, ...), from those that `compute` gives of its parts, some
    rows at a time.

    The measurements come first, column by column; what follows is the mean over the rows of what each part has
    there, as a mean over impacts is, and what concerns no impact at all.
    """
    count = len(problem.impacts)
    if count <= PART:
        return compute(problem)
    sizes = np.array([observable.observed.size for observable in problem.observables])
    starts = np.cumsum([0, *sizes])
    whole: FloatArray | None = None
    for rows in np.array_split(np.arange(count), -(-count // PART)):
        part = part_of(problem, rows)
        made = compute(part)
        own = np.cumsum([0, *(observable.observed.size for observable in part.observables)])
        if whole is None:
            whole = np.zeros((int(starts[-1]) + len(made) - int(own[-1]), *made.shape[1:]))
        for k in range(len(sizes)):
            whole[starts[k] : starts[k] + own[k + 1] - own[k]] = made[own[k] : own[k + 1]]
        starts[:-1] += np.diff(own)
        whole[starts[-1] :] += made[own[-1] :] * (rows.size / count)
    assert whole is not None
    return whole


def cells(problem: Problem) -> int:
    """Draws times impacts of a problem that are evaluated at once."""
    cost = INCIDENT_COST if problem.uncertain else 1
    return CELLS // (cost if problem.force is None else cost * problem.force.nodes)


def batches(problem: Problem, draws: int, cost: int = 1) -> Iterator[slice]:
    """Draws that are evaluated at once; `cost` is how many rebounds each needs. There is one batch at least."""
    size = max(1, cells(problem) // (cost * len(problem.impacts)))
    return (slice(start, start + size) for start in range(0, max(draws, 1), size))


def impacts_in_parts(problem: Problem, draws: int) -> Iterator[tuple[NDArray[np.int64], Problem]]:
    """Rows that are evaluated at once at so many draws, each with the problem on these rows alone."""
    count, size = len(problem.impacts), max(1, cells(problem) // draws)
    for rows in (np.arange(k, min(k + size, count)) for k in range(0, count, size)):
        yield rows, problem if rows.size == count else part_of(problem, rows)
