"""The figure of force records against the posterior prediction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from fitball.inference.likelihood.force import MISFIT, SD, aligned, mean_forces
from fitball.inference.results.results import Fit, thinned
from fitball.report.figures.canvas import Margins, drawn_handles, filled, fit_heading, legend_below, verbatim
from fitball.report.form.palette import MEASURED, MODEL, NOISE
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


def force_panels(fit: Fit) -> tuple[ForcePanel, ...]:
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


COLUMNS = 3
CELL = (2.9, 2.1)


def figure(fit: Fit) -> Figure:
    """Measured means with the sensor's noise, the model's force, and what a record is expected to show."""
    shown = force_panels(fit)
    figure, axes = filled(len(shown), COLUMNS, CELL, Margins(across=0.6, down=0.75, top=0.75, bottom=1.15))
    for axis, panel in zip(axes.ravel(), shown, strict=False):
        axis.fill_between(
            panel.times, *panel.expected, color=NOISE, alpha=0.45, linewidth=0, label="95 % of a record, with noise"
        )
        axis.fill_between(panel.along, panel.course[0], panel.course[2], color=MODEL, alpha=0.4, linewidth=0)
        axis.plot(panel.along, panel.course[1], color=MODEL, linewidth=1.2, label="model's force, 95 % band")
        axis.errorbar(
            panel.times, panel.means, panel.sd, fmt="o", color=MEASURED, markersize=2.5, linewidth=0.8,
            label="measured (means of samples)",
        )  # fmt: skip
        axis.set_title(verbatim(panel.title))
        axis.set_xlabel("time after landing [ms]")
        axis.grid()
    for axis in axes[:, 0]:
        axis.set_ylabel("force on the court [N]")
    legend_below(figure, drawn_handles(axes[0, 0]), min(COLUMNS, len(shown)))
    fit_heading(figure, fit, "force records", narrow=len(shown) == 1)
    return figure


def missing(fit: Fit) -> str:
    """Why a fit has no such figure, "" where it has."""
    return "" if fit.problem.force is not None else "there are no force records in this fit"


def words(fit: Fit) -> str:
    """The figure in words and numbers, for who does not see it."""
    parts = []
    for panel in force_panels(fit):
        inside = np.sum((panel.means >= panel.expected[0]) & (panel.means <= panel.expected[1]))
        parts.append(
            f"{panel.title}: measured up to {panel.means.max():.0f} N, "
            f"the model up to {panel.course[1].max():.0f} N, "
            f"{inside} of {panel.means.size} means within the 95 % range of a record"
        )
    return "Force records beside the model's force. " + "; ".join(parts) + "."
