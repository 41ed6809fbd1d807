"""The house: sizes against their ceilings."""

import importlib.util
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_spec = importlib.util.spec_from_file_location("size", ROOT / "scripts" / "size.py")
assert _spec is not None and _spec.loader is not None
size = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(size)


def test_sizes_stay_below_their_ceilings():
    found = size.sizes().values()
    assert sum(lines for lines, _ in found) <= size.LINES
    assert sum(modules for _, modules in found) <= size.MODULES
    assert size.total("tests") <= size.TEST_LINES
    assert size.total("scripts") <= size.SCRIPT_LINES
