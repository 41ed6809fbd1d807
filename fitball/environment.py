"""The environment of a run: settings of numba and limits of memory that make it impossible; notes on compiled
kernels; modules that are seldom used, loaded when they are needed.

lmfit, emcee and ArviZ's statistics import `scipy.stats`, pandas and more for functions that a fit does not call.
`scipy.optimize` imports all of `scipy.spatial` and numpy's wrapper of Fortran. Together these are more than half of
the time to start.
"""

from __future__ import annotations

import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from fitball.errors import EnvironmentSettingError, MemoryShortageError

# Address space that a first run takes, kernels compiled, sampling and figures included, and what each thread of the
# two OpenBLAS libraries (of numpy and scipy) takes besides [bytes]. Measured as VmPeak of `fitball calibrate
# wang_zero_spin.csv --max-steps 300 --cores 1` with an empty NUMBA_CACHE_DIR and OPENBLAS_NUM_THREADS 1 and 2, on
# Linux 6.18 with x86-64: 0.96 and 1.04 GB; a tenth is added.
NEEDED, BY_THREAD, MOST_THREADS = 960_000_000, 84_000_000, 64


def check_environment() -> None:
    """Before libraries are loaded: raise what makes a run impossible.

    EnvironmentSettingError where the current folder was removed or holds a matplotlibrc that is no text, or Python
    drops docstrings; see `check_address_space`.
    """
    check_address_space()
    if sys.flags.optimize > 1:
        raise EnvironmentSettingError(
            "Python runs without docstrings, which packages of fitball need: unset PYTHONOPTIMIZE, or start Python "
            "without -OO"
        )
    try:
        Path.cwd()
    except OSError as error:
        raise EnvironmentSettingError(
            f"the current folder cannot be used ({error.strerror}): it may have been deleted; change to another"
        ) from None
    with suppress(OSError):
        try:
            # matplotlib looks here before anywhere else.
            Path("matplotlibrc").read_text(encoding="utf-8")
        except UnicodeDecodeError:
            raise EnvironmentSettingError(
                "matplotlibrc in the current folder is not UTF-8, so matplotlib cannot be loaded: move that file away"
            ) from None


def check_address_space() -> None:
    """Raise MemoryShortageError where a limit (`ulimit -v`) leaves less address space than a run is known to take:
    libraries then end the process, or try again for minutes.
    """
    if sys.platform == "win32":
        return
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    needed = NEEDED + BY_THREAD * _blas_threads()
    if limit != resource.RLIM_INFINITY and limit < needed:
        raise MemoryShortageError(
            f"the address space of this process is limited to {limit / 1e6:,.0f} MB, and fitball needs "
            f"{needed / 1e6:,.0f} MB of it: raise the limit (ulimit -v {-(-needed // 1024)}) or remove "
            "it (ulimit -v unlimited)"
        )


def _blas_threads() -> int:
    """As many as OpenBLAS starts: one for each core that this process may use, or OPENBLAS_NUM_THREADS if that is
    less.
    """
    cores = os.cpu_count() or 1
    if sys.platform == "linux":
        cores = len(os.sched_getaffinity(0))
    wished = os.environ.get("OPENBLAS_NUM_THREADS", "")
    return min(cores, MOST_THREADS, int(wished) if wished.isdecimal() and int(wished) > 0 else cores)


def load_numba() -> None:
    """Import numba, which reads its settings then.

    Raises as `check_address_space` does, and EnvironmentSettingError where the settings are wrong, or are such that
    nothing is compiled: fitball's kernels exist as machine code only.
    """
    check_address_space()
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "Environment variable", RuntimeWarning)
        try:
            import numba
        except (RuntimeWarning, ValueError) as error:
            raise EnvironmentSettingError(
                f"numba, which compiles fitball's kernels, refuses its settings: {str(error).splitlines()[0]} "
                f"({_set()}); unset the wrong ones"
            ) from None
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        raise EnvironmentSettingError(
            f"numba does not compile ({_set()}), but fitball's kernels must be compiled: unset NUMBA_DISABLE_JIT"
        )


def _set() -> str:
    found = (f"{name}={value}" for name, value in sorted(os.environ.items()) if name.startswith("NUMBA_"))
    return ", ".join(found) or "none of its environment variables is set"


@dataclass(frozen=True)
class Compiling:
    """The `kernel` that is being compiled with all it calls, and the `folder` that keeps it for later runs (None:
    no folder can be written to).
    """

    kernel: str
    folder: str | None


# Called when a kernel is compiled, and with None when that is done.
Tell = Callable[[Compiling | None], None]


def tell_nobody(_compiling: Compiling | None) -> None:
    """Report nothing."""


_told: list[Tell] = [tell_nobody]


def when_compiling(watch: Tell) -> None:
    """Let `watch` be called from now on, instead of the function before."""
    _told[0] = watch


def report_compiling(compiling: Compiling | None) -> None:
    """Report that a kernel is being compiled, or that it is done."""
    _told[0](compiling)


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

    Where other threads run, everything is imported as ever: they might import one of these substitutes and keep it.
    So it is where one of the `private` packages is loaded already: what the others register with it would be there
    twice.
    """
    if threading.active_count() > 1 or any(name in sys.modules for name in private):
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
