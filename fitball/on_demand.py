"""Modules that others import at once and seldom use, loaded when they are used.

lmfit, emcee and ArviZ's statistics import `scipy.stats`, pandas and more for functions that a fit does not call, and
`scipy.optimize` all of `scipy.spatial` and, by way of array namespaces, numpy's wrapper of Fortran; that is more than
half of what starting would cost.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

HEAVY = (
    "dill",
    "matplotlib",
    "numpy.f2py",
    "pandas",
    "scipy.interpolate",
    "scipy.linalg.interpolative",
    "scipy.signal",
    "scipy.signal.windows",
    "scipy.spatial",
    "scipy.stats",
)


class _Later:
    """A function or class of a module that is loaded when it is called, asked for an attribute, or first has an
    instance.
    """

    def __init__(self, module: str, name: str) -> None:
        self._module, self._name = module, name

    def _found(self) -> Any:
        return getattr(import_module(self._module), self._name)

    def __call__(self, *args: Any, **named: Any) -> Any:
        return self._found()(*args, **named)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._found(), name)

    def __instancecheck__(self, value: object) -> bool:
        # Before its module is loaded nothing can be an instance of a class.
        return self._module in sys.modules and isinstance(value, self._found())


class _StandIn(ModuleType):
    """What is imported instead of a module; each name in it waits."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Later(self.__name__, name)


@contextmanager
def heavy_later(*private: str) -> Iterator[None]:
    """While others are imported in here, those of the `HEAVY` modules that are not loaded stay so: names taken from
    them fetch the real ones when they are used.

    The `private` packages and their parts come out of this incomplete, for they would not do with names that wait:
    what was taken from them is kept by who took it, and whoever imports them afterwards gets them whole.

    Where other threads run, everything is imported as ever: they might import what only stands in here and keep it.
    """
    if threading.active_count() > 1:
        yield
        return
    import numpy

    before = set(sys.modules)
    waiting = {name: _StandIn(name) for name in HEAVY if name not in before}
    sys.modules.update(waiting)
    # numpy looks for a part of it that is not bound to it again and again.
    bound = {name.removeprefix("numpy."): module for name, module in waiting.items() if name.startswith("numpy.")}
    for name, module in bound.items():
        setattr(numpy, name, module)
    try:
        yield
    finally:
        for name in bound:
            delattr(numpy, name)
        for name in set(sys.modules) - before:
            if name.split(".")[0] in private or sys.modules[name] is waiting.get(name):
                del sys.modules[name]
