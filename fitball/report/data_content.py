"""The measurements a fit was made from, as plain content for `fit.json`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from fitball.inference.force_records import ForceRecords
from fitball.inference.posterior import Problem


def data_content(problem: Problem) -> dict[str, Any]:
    """The measurements of a problem and what the scene knows of its contact time, for `fit.json`; SI units."""
    table = problem.table
    force = {} if problem.force is None else {"force": _force(problem.force)}
    return {
        "ids": list(table.ids),
        "labels": {name: list(column) for name, column in table.labels.items()},
        "incident_columns": list(table.incident_columns),
        "impacts": {name: getattr(table.impacts, name).tolist() for name in ("v_x1", "v_y1", "omega_1")},
        "measurements": [
            {"name": item.name, "values": item.values.tolist(), "sd": None if item.sd is None else item.sd.tolist()}
            for item in table.measurements
        ],
        "contact_time": None if problem.contact_time is None else list(problem.contact_time),
        **force,
    }


def _force(records: ForceRecords) -> dict[str, Any]:
    """Force records as averaged; the samples themselves stay in their file."""
    return {
        "file": Path(records.source).name,
        "sha256": records.digest,
        "start_sd": records.start_sd,
        "records": [asdict(item) | {"means": list(item.means)} for item in records.records],
    }
