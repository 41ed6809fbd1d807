"""Problems of the simulated drop test with force records."""

from __future__ import annotations

from pathlib import Path

from fitball.data.force_file import load_force
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.inference.problem.build import Choices, build_problem


def problem_of(table: Path, *, records=True, scene=None, **choices):
    """The problem of a case, its closures left to the drop test."""
    loaded = load_table(table)
    force = load_force(table.with_name("drops_force.csv"), loaded) if records else None
    return build_problem(loaded, scene or Scene(), Choices(**choices), force)
