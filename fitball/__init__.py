"""fitball: fits models of a bouncing tennis ball to measured impacts.

The names below are public. They are loaded on first use, so that `fitball --help` stays quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from fitball.version import __version__

if TYPE_CHECKING:
    from fitball.api import (
        Checked,
        Comparison,
        Course,
        Fit,
        Plan,
        calibrate,
        check,
        cite,
        compare,
        export,
        load_fit,
        plan,
        plot,
        port,
        predict,
        simulate,
    )
    from fitball.api.tracking import TrackResult, track
    from fitball.batch import Batch, calibrate_many, load_batch
    from fitball.data.read import load_table
    from fitball.data.scene import Scene, load_scene
    from fitball.data.table import ImpactTable
    from fitball.errors import FitballError
    from fitball.inference.results.results import Estimate, Posterior, RunStatus, Verdict
    from fitball.models.registry import model
    from fitball.models.types import Rebound, regime_name
    from fitball.values import Ball, Impacts, impacts

# Where each name is when it is first asked for.
_HOMES = {
    "fitball.api": "Checked Comparison Course Fit Plan calibrate check cite compare export load_fit plan "
    "plot port predict simulate",
    "fitball.api.tracking": "TrackResult track",
    "fitball.batch": "Batch calibrate_many load_batch",
    "fitball.data.read": "load_table",
    "fitball.data.scene": "Scene load_scene",
    "fitball.data.table": "ImpactTable",
    "fitball.errors": "FitballError",
    "fitball.inference.results.results": "Estimate Posterior RunStatus Verdict",
    "fitball.models.registry": "model",
    "fitball.models.types": "Rebound regime_name",
    "fitball.values": "Ball Impacts impacts",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}

__all__ = [
    "Ball", "Batch", "Checked", "Comparison", "Course", "Estimate", "Fit", "FitballError", "ImpactTable", "Impacts",
    "Plan", "Posterior", "Rebound", "RunStatus", "Scene", "TrackResult", "Verdict", "__version__", "calibrate",
    "calibrate_many", "check", "cite", "compare", "export", "impacts", "load_batch", "load_fit", "load_scene",
    "load_table", "model", "plan", "plot", "port", "predict", "regime_name", "simulate", "track",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'fitball' has no attribute '{name}'")
    return getattr(import_module(_HOME_OF[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
