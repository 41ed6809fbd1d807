"""The noise of force records: which parameters a problem gets for it, their best size, and holding them there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitball.data.force_file import ForceFile
from fitball.data.scene import Scene
from fitball.inference.likelihood.force import MISFIT, SD, aligned, spread
from fitball.inference.problem.force_records import ForceRecords, build_records
from fitball.inference.problem.parameters import FORCE_NOISE
from fitball.inference.problem.problem import Problem
from fitball.models.model import Model
from fitball.models.two_mass_model import TwoMassModel
from fitball.values import FloatArray

# Noise of a sample that is expected, as a share of the records' mean peak.
EXPECTED = 0.01
# The grid on which the best noise is looked for, and how often each takes its turn.
GRID, TURNS = 401, 4


def records_for(chosen: Model, scene: Scene, force: ForceFile | None, notes: list[str]) -> ForceRecords | None:
    """The records as the likelihood takes them; None, with a note, where the model has no force to compare."""
    if force is None:
        if scene.force_file is not None:
            notes.append(f"the force records of {scene.force_file} are not used here")
        return None
    if not isinstance(chosen, TwoMassModel):
        notes.append(f"{Path(force.source).name} is not used: model {chosen.name} has no force-time course")
        return None
    records = build_records(force, scene.force_start_sd)
    counts = [item.samples for item in records.records]
    notes.append(
        f"force records of {len(counts)} impacts ({Path(force.source).name}): {min(counts)} to {max(counts)} samples "
        f"each, averaged to {records.nodes} means; sensor noise is independent, what the model's force misses is "
        "taken as a slow course that counts once, not once a sample"
    )
    notes.append(
        f"t = 0 of a force record is taken as the start of contact within {1e3 * scene.force_start_sd:g} ms"
        if scene.force_start_sd is not None
        else "the start of contact in a force record is found from the record, one nuisance each, integrated out"
    )
    if chosen.options.get("normal") == "momentum":
        notes.append(
            "the blow that stops the shell at landing takes no time and is in no force record: records are compared "
            "with the spring's force alone"
        )
    return records


def force_noise(
    records: ForceRecords, scene: Scene, priors: dict[str, str], fixed: dict[str, tuple[float, str]]
) -> tuple[str, ...]:
    """Names of the noise parameters of records; an sd known to the scene fixes that of a sample."""
    if scene.force_sd is not None:
        fixed[SD] = (scene.force_sd, "known from the scene")
    else:
        priors[SD] = f"lognormal({EXPECTED * float(records.peak.mean()):.6g}, 1.0)"
    return FORCE_NOISE


def best_force_noise(
    problem: Problem, records: ForceRecords, columns: Mapping[str, FloatArray], current: Mapping[str, float]
) -> dict[str, float]:
    """Noise that maximises the posterior for the deviations at `columns` (1,), starting from `current`."""
    best = {name: current[name] for name in FORCE_NOISE}
    found = aligned(problem, records, {**columns, **{name: np.array([value]) for name, value in best.items()}})
    rest = (found.z - found.slope * found.move[..., None]) * found.spread
    # Each start that the record itself decides leaves that much less to scatter.
    freedom = 1.0 - np.mean(1.0 - 1.0 / (found.information * records.start[1] ** 2)) / records.nodes
    free = [item for item in problem.free if item.name in FORCE_NOISE]
    for _ in range(TURNS):
        for item in free:
            values = item.prior.value(np.linspace(*item.prior.support, GRID))
            tried = {name: np.full(GRID, value) for name, value in best.items()} | {item.name: values}
            spreads = spread(records, tried[SD], tried[MISFIT])
            cost = np.where(records.mask, 0.5 * (rest / spreads) ** 2 + freedom * np.log(spreads), 0.0).sum(
                axis=(1, 2)
            )
            density = item.prior.log_density(item.prior.coordinate(values))
            best[item.name] = float(values[np.argmax(density - cost)])
    return best


def noise_held(problem: Problem, values: Mapping[str, float]) -> Problem:
    """The same problem with the noise of its records fixed at `values`: so profiles of the likelihood are made, whose
    search knows the best size of independent noise only. The problem itself without records.
    """
    if problem.force is None:
        return problem
    held = tuple(
        replace(item, fixed=values[item.name], fixed_because="held at its most probable size")
        if item.name in FORCE_NOISE and item.free
        else item
        for item in problem.parameters
    )
    return replace(problem, parameters=held)
