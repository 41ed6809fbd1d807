"""The looks at every parameter as plain content for `fit.json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from fitball.inference.results.evidence import End, Identifiability


def evidence_content(identifiability: Identifiability) -> dict[str, Any]:
    """Every look with its fields by name; arrays and tuples become lists."""
    found: dict[str, Any] = _plain(asdict(identifiability))
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, End) else value
