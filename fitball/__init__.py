"""fitball: fits models of a bouncing tennis ball to measured impacts.

Owns: the public names, loaded when first asked for; what is not here is not public.
"""

from importlib import import_module
from typing import Any

from fitball.version import __version__

_HOMES = {
    "fitball.verbs": "calibrate check compare predict plan plot simulate track batch export "
    "rederive bench load_fit load_batch",
    "fitball.data.force": "contact_time",
    "fitball.data.read": "load_table",
    "fitball.data.scene": "Scene load_scene",
    "fitball.data.table": "ImpactTable",
    "fitball.base.errors": "FitballError",
    "fitball.results.fit": "Fit",
    "fitball.inference.schema": "Verdict",
    "fitball.models.own": "model_from",
    "fitball.models.registry": "model",
    "fitball.models.types": "Rebound regime_name",
    "fitball.results.result": "Result",
    "fitball.base.values": "Ball Impacts impacts",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}
__all__ = ["__version__", *_HOME_OF]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'fitball' has no attribute '{name}'")
    return getattr(import_module(_HOME_OF[name]), name)
