"""A force plate under planned impacts: records that it would make, and what they would tell to first order.

The records are those of the fitted model itself, reduced as measured ones are. What they tell of parameters is the
information of the likelihood of records: the start of contact is found from each, the sensor's noise is independent
from sample to sample, and a slow misfit of the model's force, a nuisance, counts once and not once a sample.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fitball.data.force import ForceRecord
from fitball.inference.design.knowledge import Knowledge
from fitball.inference.likelihood.force import force_information_rows, mean_forces
from fitball.inference.problem.force_records import ForceRecords, averaged
from fitball.inference.problem.parameters import FORCE_NOISE, NOISE_SPECS, Parameter
from fitball.inference.problem.priors import parse_prior
from fitball.inference.problem.problem import Problem
from fitball.values import FloatArray

# Time between samples [s], and shares of the contact that are recorded before and after it.
STEP = 5.0e-5
BEFORE, AFTER = 0.3, 0.3


def with_plate(known: Knowledge, sd: float, rng: np.random.Generator) -> Knowledge:
    """What is known where a plate with that noise `sd` [N] a sample is at hand: its misfit has its prior.

    A fit that has records knows both already.
    """
    names = {parameter.name for parameter in known.problem.parameters}
    if names.issuperset(FORCE_NOISE):
        return known
    added = [_noise(FORCE_NOISE[0], sd), _noise(FORCE_NOISE[1], None)]
    problem = replace(known.problem, parameters=(*known.problem.parameters, *added))
    prior = added[1].prior
    drawn = prior.coordinate(prior.draw(rng, len(known.coordinates)))
    return Knowledge(problem, np.column_stack([known.coordinates, drawn]))


def _noise(name: str, fixed: float | None) -> Parameter:
    spec = NOISE_SPECS[name]
    return Parameter(spec, parse_prior(name, spec.prior, spec.lower, spec.upper, spec.unit), fixed)


def plate_rows(planned: Problem, draws: FloatArray, solved: NDArray[np.bool_], root: FloatArray) -> FloatArray:
    """Rows (draws, impacts, directions, directions) whose squares add up to what records of the planned impacts tell,
    in the directions of `Knowledge.root`; zero where a draw is not `solved` (draws, impacts).
    """
    records = _records(planned, draws, solved)
    slopes, growth = force_information_rows(planned, records, draws)
    rows = np.concatenate([slopes, np.sqrt(2.0) * growth], axis=2)
    known = solved & np.isfinite(rows).all(axis=(2, 3))
    rows = np.where(known[..., None, None], rows, 0.0) @ (root if root.ndim == 2 else root[:, None])
    # As many rows as there are directions say the same.
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _records(planned: Problem, draws: FloatArray, solved: NDArray[np.bool_]) -> ForceRecords:
    """The record of each impact by the draw of the middle contact time."""
    times = np.where(solved, planned.rebound(planned.to_values(draws)).contact_time, np.nan)
    made = []
    for k in range(times.shape[1]):
        order = np.argsort(times[:, k])
        middle = int(order[np.count_nonzero(solved[:, k]) // 2])
        length = float(times[middle, k])
        columns = planned.all_values(planned.to_values(draws[middle : middle + 1]))
        count = int((1.0 + BEFORE + AFTER) * length / STEP)
        first, row = np.array([[-BEFORE * length]]), np.array([k])
        force, _rate = mean_forces(planned, columns, row, first, np.array([STEP]), count)
        made.append(averaged(ForceRecord(str(k), k, -BEFORE * length, STEP, np.real(force[0, 0]))))
    return ForceRecords("planned", "", None, tuple(made))
