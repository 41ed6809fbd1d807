"""Force records beside the model's force, as arrays: what the figure of them shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitball.inference.likelihood.force import MISFIT, SD, aligned, mean_forces
from fitball.inference.results.results import thinned
from fitball.report.figures.drawable import Drawable
from fitball.values import FloatArray

DRAWS = 200
PANELS = 6
# Points of the model's curve between two means.
FINE = 4
WITHIN = 1.959963984540054


@dataclass(frozen=True)
class ForcePanel:
    """One record: `times` [ms after the start of contact] and `means` [N] with their noise `sd`; the model's force
    `course` (3, points: 2.5, 50, 97.5 %) at `along`, and `expected` (2, means), 95 % of what a record would show.
    """

    title: str
    times: FloatArray
    means: FloatArray
    sd: FloatArray
    along: FloatArray
    course: FloatArray
    expected: FloatArray


def force_panels(fit: Drawable) -> tuple[ForcePanel, ...]:
    """Some records from the slowest impact to the fastest, over draws of the posterior or at the point estimate."""
    problem = fit.problem
    records = problem.force
    assert records is not None
    values = np.array([[fit.point.values[name] for name in problem.free_names]])
    if fit.posterior is not None:
        values = thinned(fit.posterior, DRAWS)
    columns = problem.all_values(values)
    alignments = aligned(problem, records, columns)
    start = alignments.start + alignments.move
    middle = np.median(start, axis=0)
    first = records.first - start
    force, _rate = mean_forces(problem, columns, records.rows, first, records.spacing, records.nodes)
    count = FINE * (records.nodes - 1) + 1
    fine, _rate = mean_forces(problem, columns, records.rows, first, records.spacing / FINE, count)
    sensor = float(np.median(columns[SD])) * np.sqrt(records.variances[0])
    slow = float(np.median(columns[MISFIT])) * records.peak[:, None] * np.sqrt(records.variances[1])
    reach = WITHIN * np.sqrt(np.var(force, axis=0) + sensor**2 + slow**2)
    order = np.argsort(problem.impacts.v_y1[records.rows], kind="stable")
    chosen = order[np.linspace(0, order.size - 1, min(PANELS, order.size)).round().astype(int)]
    panels = []
    for k in chosen:
        mine = records.mask[k]
        times = 1e3 * (records.first[k] + records.spacing[k] * np.arange(records.nodes) - middle[k])
        row = int(records.rows[k])
        centre = np.median(force[:, k], axis=0)
        panels.append(
            ForcePanel(
                title=f"{problem.table.ids[row]}: {problem.impacts.v_y1[row]:.3g} m/s",
                times=times[mine],
                means=records.means[k][mine],
                sd=sensor[k][mine],
                along=np.linspace(times[0], times[mine][-1], FINE * (int(mine.sum()) - 1) + 1),
                course=np.quantile(fine[:, k, : FINE * (int(mine.sum()) - 1) + 1], (0.025, 0.5, 0.975), axis=0),
                expected=np.stack([centre - reach[k], centre + reach[k]])[:, mine],
            )
        )
    return tuple(panels)
