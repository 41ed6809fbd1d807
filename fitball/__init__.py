"""fitball: what the bounce of a tennis ball says about the ball and the court.

The names below are public. They are loaded on first use, so that `fitball --help` stays quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from fitball.version import __version__

if TYPE_CHECKING:
    from fitball.api import calibrate, load_fit
    from fitball.data.read import load_table
    from fitball.data.scene import Scene, load_scene
    from fitball.data.table import ImpactTable
    from fitball.errors import FitballError
    from fitball.inference.results.results import Fit
    from fitball.models.registry import model
    from fitball.models.types import Rebound, regime_name
    from fitball.values import Ball, Impacts, impacts

_HOMES = {
    "Ball": "fitball.values",
    "Fit": "fitball.inference.results.results",
    "FitballError": "fitball.errors",
    "ImpactTable": "fitball.data.table",
    "Impacts": "fitball.values",
    "Rebound": "fitball.models.types",
    "Scene": "fitball.data.scene",
    "calibrate": "fitball.api",
    "impacts": "fitball.values",
    "load_fit": "fitball.api",
    "load_scene": "fitball.data.scene",
    "load_table": "fitball.data.read",
    "model": "fitball.models.registry",
    "regime_name": "fitball.models.types",
}

__all__ = [
    "Ball",
    "Fit",
    "FitballError",
    "ImpactTable",
    "Impacts",
    "Rebound",
    "Scene",
    "__version__",
    "calibrate",
    "impacts",
    "load_fit",
    "load_scene",
    "load_table",
    "model",
    "regime_name",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'fitball' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
