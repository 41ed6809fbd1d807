"""fitball: what the bounce of a tennis ball says about the ball and the court.

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
        compare,
        export,
        load_fit,
        plan,
        plot,
        predict,
        simulate,
    )
    from fitball.batch import Batch, calibrate_many, load_batch
    from fitball.data.read import load_table
    from fitball.data.scene import Scene, load_scene
    from fitball.data.table import ImpactTable
    from fitball.errors import FitballError
    from fitball.inference.results.results import Estimate, Posterior, RunStatus, Verdict
    from fitball.models.registry import model
    from fitball.models.types import Rebound, regime_name
    from fitball.values import Ball, Impacts, impacts

_HOMES = {
    "Ball": "fitball.values",
    "Batch": "fitball.batch",
    "Checked": "fitball.api",
    "Comparison": "fitball.api",
    "Course": "fitball.api",
    "Estimate": "fitball.inference.results.results",
    "Fit": "fitball.api",
    "FitballError": "fitball.errors",
    "ImpactTable": "fitball.data.table",
    "Impacts": "fitball.values",
    "Plan": "fitball.api",
    "Posterior": "fitball.inference.results.results",
    "Rebound": "fitball.models.types",
    "RunStatus": "fitball.inference.results.results",
    "Scene": "fitball.data.scene",
    "Verdict": "fitball.inference.results.results",
    "calibrate": "fitball.api",
    "calibrate_many": "fitball.batch",
    "check": "fitball.api",
    "compare": "fitball.api",
    "export": "fitball.api",
    "impacts": "fitball.values",
    "load_batch": "fitball.batch",
    "load_fit": "fitball.api",
    "load_scene": "fitball.data.scene",
    "load_table": "fitball.data.read",
    "model": "fitball.models.registry",
    "plan": "fitball.api",
    "plot": "fitball.api",
    "predict": "fitball.api",
    "regime_name": "fitball.models.types",
    "simulate": "fitball.api",
}

__all__ = [
    "Ball",
    "Batch",
    "Checked",
    "Comparison",
    "Course",
    "Estimate",
    "Fit",
    "FitballError",
    "ImpactTable",
    "Impacts",
    "Plan",
    "Posterior",
    "Rebound",
    "RunStatus",
    "Scene",
    "Verdict",
    "__version__",
    "calibrate",
    "calibrate_many",
    "check",
    "compare",
    "export",
    "impacts",
    "load_batch",
    "load_fit",
    "load_scene",
    "load_table",
    "model",
    "plan",
    "plot",
    "predict",
    "regime_name",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'fitball' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
