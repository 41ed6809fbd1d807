"""What is asked of every table of a batch."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from fitball.inference.calibrate import fingerprint
from fitball.inference.effort import Effort
from fitball.inference.problem.problem import Choices, Problem

# What marks a folder as that of a batch.
RECORD_NAME = "batch.json"
# What marks the folder of a table that is done.
ROW_NAME = "row.json"


@dataclass(frozen=True)
class Plan:
    """How each table is read and fitted, and where its folder lies: below `folder`, by name.

    `full` results are those of `calibrate`, the others `fit.json` alone. `config` is the scene of all (None: each
    its own, beside it).
    """

    folder: Path
    choices: Choices = field(default_factory=Choices)
    effort: Effort = field(default_factory=lambda: Effort(cores=1))
    config: str | None = None
    flip: tuple[str, ...] = ()
    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    as_read: bool = False
    full: bool = False
    overwrite: bool = False

    def mark(self, problem: Problem) -> str:
        """SHA-256 over all that the result of a table depends on."""
        effort = self.effort
        parts = [fingerprint(problem, effort), *map(repr, (self.choices, effort.max_steps, effort.point_only))]
        # What is told of a fit depends on the scene beyond its parameters: surface, type of ball, temperature.
        scene = replace(problem.scene, source=None)
        parts += map(repr, (self.full, self.as_read, sorted(self.units.items()), problem.notes, scene))
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()
