"""The noise of force records: which parameters a problem gets for it."""

from __future__ import annotations

from pathlib import Path

from fitball.data.scene import Scene
from fitball.inference.problem.force_records import ForceRecords
from fitball.inference.problem.parameters import FORCE_NOISE
from fitball.models.model import Model

# Noise of a sample that is expected, as a share of the records' mean peak.
EXPECTED = 0.01


def records_for(chosen: Model, scene: Scene, records: ForceRecords | None, notes: list[str]) -> ForceRecords | None:
    """The records, told in `notes`; None, with a note, where the model has no force to compare."""
    if records is None:
        if scene.force_file is not None:
            notes.append(f"the force records of {scene.force_file} are not used here")
        return None
    if not chosen.has_force:
        notes.append(f"{Path(records.source).name} is not used: model {chosen.name} has no force-time course")
        return None
    counts = [record.samples for record in records.records]
    notes.append(
        f"force records of {len(counts)} impacts ({Path(records.source).name}): {min(counts)} to {max(counts)} "
        f"samples each, averaged to {records.nodes} means; sensor noise is independent, what the model's force "
        "misses is taken as a slow course that counts once, not once a sample"
    )
    notes.append(
        f"t = 0 of a force record is taken as the start of contact within {1e3 * scene.force_start_sd:g} ms"
        if scene.force_start_sd is not None
        else "the start of contact in a force record is found from the record, one nuisance each, integrated out"
    )
    if chosen.force_remark:
        notes.append(chosen.force_remark)
    return records


def force_noise(
    records: ForceRecords, scene: Scene, priors: dict[str, str], fixed: dict[str, tuple[float, str]]
) -> tuple[str, ...]:
    """Names of the noise parameters of records; an sd known to the scene fixes that of a sample."""
    if scene.force_sd is not None:
        fixed[FORCE_NOISE[0]] = (scene.force_sd, "known from the scene")
    else:
        priors[FORCE_NOISE[0]] = f"lognormal({EXPECTED * float(records.peak.mean()):.6g}, 1.0)"
    return FORCE_NOISE
