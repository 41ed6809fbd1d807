"""What surrounds a run and can make it impossible: settings of numba, a limit on the address space."""

from __future__ import annotations

import os
import sys
import warnings
from contextlib import suppress
from pathlib import Path

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
            "Python is told to drop docstrings, which packages that fitball uses need: unset PYTHONOPTIMIZE, or "
            "start it without -OO"
        )
    try:
        Path.cwd()
    except OSError as error:
        raise EnvironmentSettingError(
            f"the current folder cannot be used ({error.strerror}): it may have been removed; change into another"
        ) from None
    with suppress(OSError):
        try:
            # matplotlib looks here before anywhere else.
            Path("matplotlibrc").read_text(encoding="utf-8")
        except UnicodeDecodeError:
            raise EnvironmentSettingError(
                "matplotlibrc in the current folder is not UTF-8, and matplotlib cannot be loaded beside it: move it "
                "away"
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
            f"{needed / 1e6:,.0f} MB of it: raise the limit (ulimit -v {-(-needed // 1024)}) or lift it "
            "(ulimit -v unlimited)"
        )


def _blas_threads() -> int:
    """As many as OpenBLAS starts: one for each core that this process may use, or fewer where it was told so."""
    cores = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
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
                f"({_set()}); unset what is wrong"
            ) from None
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        raise EnvironmentSettingError(
            f"numba is told to compile nothing ({_set()}), and fitball's kernels run compiled only: unset "
            "NUMBA_DISABLE_JIT"
        )


def _set() -> str:
    found = (f"{name}={value}" for name, value in sorted(os.environ.items()) if name.startswith("NUMBA_"))
    return ", ".join(found) or "none of its environment variables is set"
