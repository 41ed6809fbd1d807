"""The version, and those of what a result depends on, in a file of its own that imports nothing else of fitball."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

__version__ = "0.1.0"
PACKAGES = ("numpy", "scipy", "numba", "lmfit", "emcee", "arviz-stats", "h5py")


@cache
def package_versions() -> Mapping[str, str]:
    """What a result depends on, with its version."""
    import platform
    from importlib.metadata import version

    return {"fitball": __version__, "python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def versions_line() -> str:
    """The same in a line, with system and machine."""
    import platform

    versions = ", ".join(f"{name} {number}" for name, number in package_versions().items())
    return f"{versions}; {platform.system()} {platform.machine()}"
