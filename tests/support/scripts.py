"""Scripts as modules."""

import importlib.util
import sys
from pathlib import Path

SCRIPTS = Path(__file__).resolve().parent.parent.parent / "scripts"


def script(name):
    """A script by its path below `scripts`, without ending, as a module."""
    stem = name.rpartition("/")[2]
    spec = importlib.util.spec_from_file_location(stem, SCRIPTS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    # Data classes look for their module by name.
    sys.modules[stem] = module
    spec.loader.exec_module(module)
    return module
