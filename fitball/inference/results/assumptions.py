"""What rests on an assumption that the table cannot test, as frozen values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Assumptions:
    """`given` holds, by parameter, the choices (such as `offset=contact`) that its value rests on."""

    given: Mapping[str, tuple[str, ...]]
