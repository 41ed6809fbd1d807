"""fitball: fits models of a bouncing tennis ball to measured impacts.

Owns: the public names, loaded when first asked for; what is not here is not public.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

from fitball.version import __version__

_HOMES = {
    "fitball.verbs": "calibrate check compare predict plan plot simulate track batch export "
    "rederive bench load_fit "
    "load_batch",
    "fitball.data.read": "load_table contact_time",
    "fitball.data.scene": "Scene load_scene",
    "fitball.data.table": "ImpactTable",
    "fitball.errors": "FitballError",
    "fitball.inference.fit": "Fit",
    "fitball.inference.results": "Verdict",
    "fitball.models.own": "model_from",
    "fitball.models.registry": "model",
    "fitball.models.types": "Rebound regime_name",
    "fitball.result": "Result",
    "fitball.values": "Ball Impacts impacts",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}
__all__ = ["__version__", *_HOME_OF]


class _Package(ModuleType):
    """Of this package: importing the room `fitball.batch` or `fitball.bench` does not hide the verb
    of that name.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _HOME_OF and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        # Functions that travel to other processes may name it.
        return import_module, (self.__name__,)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'fitball' has no attribute '{name}'")
    return getattr(import_module(_HOME_OF[name]), name)
