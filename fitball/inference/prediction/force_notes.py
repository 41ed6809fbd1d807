"""What a fit with force records has to say of them: how much they count, and where they contradict the model."""

from __future__ import annotations

import math

import numpy as np

from fitball.inference.likelihood.force import MISFIT, SD, aligned, mean_forces, rotated
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import PointFit

# Misfit, as a share of the peak, from which it is no detail any more: over three times what its prior expects.
LARGE = 0.1
# Mean square of a standardised deviation that says the stated noise is wrong, and ratios of impulses that do.
EXCESS = 2.0
OFF = 0.25


def force_notes(problem: Problem, point: PointFit) -> tuple[str, ...]:
    """Sentences about the records at the point estimate; none without records."""
    records = problem.force
    if records is None:
        return ()
    columns = {name: np.array([value]) for name, value in point.values.items()}
    alignment = aligned(problem, records, columns)
    sd, misfit = point.values[SD], point.values[MISFIT]
    # How much the height of the pulse is known by the record, against as many independent samples of its noise.
    first = records.first - (alignment.start + alignment.move)
    force, _rate = mean_forces(problem, columns, records.rows, first, records.spacing, records.nodes)
    seen = np.where(records.mask, force, 0.0)
    information = np.sum((rotated(records, seen) / alignment.spread) ** 2)
    blocks = np.array([record.block for record in records.records])
    alone = np.sum(seen**2 * blocks[:, None] / (sd**2 + (misfit * records.peak[:, None]) ** 2))
    samples = int(np.median([record.samples for record in records.records]))
    worth = samples * information / alone
    notes = [
        f"force records: sensor noise {sd:.3g} N a sample, misfit of the model's force {100.0 * misfit:.2g} % of the "
        f"peak; {samples} samples of a record count like {worth:.2g} independent ones. The misfit is taken as "
        "independent from impact to impact: one that all share is not averaged away by more of them"
    ]
    rows = alignment.rows(records)[0, :, :-1]
    excess = math.sqrt(float(np.sum(rows**2)) / max(1, int(records.mask.sum()) - len(records.records)))
    ratios = np.array(
        [
            # Tiny where the record has none.
            max(float(np.sum(record.means) * record.spacing), 1e-12) / float(np.sum(course) * record.spacing)
            for record, course in zip(records.records, seen[0], strict=True)
        ]
    )
    typical = float(np.median(ratios))
    if misfit > LARGE:
        notes.append(
            f"MISFIT: the model's force misses the records by {100.0 * misfit:.0f} % of their peak: check units, the "
            "calibration of the sensor and the ball's mass before k_y is trusted"
        )
    if excess > EXCESS:
        notes.append(
            f"MISFIT: force records scatter {excess:.1f} times as far about the model as their stated noise allows"
        )
    if abs(math.log(typical)) > OFF:
        notes.append(
            f"MISFIT: the impulse of the force records is {typical:.2f} times the model's: check the unit of F, the "
            "calibration of the sensor and the ball's mass"
        )
    return tuple(notes)
