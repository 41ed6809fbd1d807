"""Part of a problem, for searches that need not see every row of a large table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitball.inference.posterior import Problem


def thinned_problem(problem: Problem, rows: int) -> Problem:
    """The same problem on about `rows` impacts, spread evenly over incidence angle; the problem itself if smaller."""
    count = len(problem.impacts)
    if count <= rows:
        return problem
    given = problem.impacts
    order = np.argsort(np.arctan2(given.v_y1, given.v_x1), kind="stable")
    kept = np.sort(order[np.linspace(0, count - 1, rows).round().astype(np.int64)])
    impacts = given.take(kept)
    channels = tuple(
        replace(item, observed=item.observed[kept], sd=None if item.sd is None else item.sd[kept])
        for item in problem.channels
    )
    table = replace(
        problem.table,
        impacts=problem.table.impacts.take(kept),
        ids=tuple(problem.table.ids[k] for k in kept),
        incident_sd={name: column[kept] for name, column in problem.table.incident_sd.items()},
        measurements=tuple(
            replace(item, values=item.values[kept], sd=None if item.sd is None else item.sd[kept])
            for item in problem.table.measurements
        ),
        redundant=(),
        labels={name: tuple(column[k] for k in kept) for name, column in problem.table.labels.items()},
        notices=(),
        incident_covariance=(
            None if problem.table.incident_covariance is None else problem.table.incident_covariance[kept]
        ),
    )
    return replace(
        problem,
        table=table,
        impacts=impacts,
        channels=channels,
        incident=None if problem.incident is None else problem.incident.take(kept),
        levels=tuple(item.take(kept) for item in problem.levels),
        offsets=None if problem.offsets is None else problem.offsets.take(kept),
    )
