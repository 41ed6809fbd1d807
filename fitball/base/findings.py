"""What a computation returns: numbers and notes, without any page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitball.base.errors import Note
from fitball.base.values import DataFrame


@dataclass(frozen=True, eq=False)
class Findings:
    """The `frames` of a computation by name, in SI, and its `notes`; `failed` if it finished and
    its own checks did not hold. A verb binds it to the page that lays it out.
    """

    frames: Mapping[str, DataFrame]
    notes: tuple[Note, ...] = ()
    failed: bool = False
