"""How much of a problem is evaluated at once, so that memory does not grow with draws times impacts."""

from __future__ import annotations

from collections.abc import Iterator

from fitball.inference.problem.problem import Problem

# Draws times impacts that are evaluated at once: some twenty arrays of as many numbers live at a time (150 MB).
CELLS = 1_000_000
# With errors of the incident state a cell has Jacobians too.
INCIDENT_COST = 8


def cells(problem: Problem) -> int:
    """Draws times impacts of a problem that are evaluated at once."""
    cost = 1 if problem.incident is None else INCIDENT_COST
    return CELLS // (cost if problem.force is None else cost * problem.force.nodes)


def batches(problem: Problem, draws: int, cost: int = 1) -> Iterator[slice]:
    """Draws that are evaluated at once; `cost` is how many rebounds each needs. There is one batch at least."""
    size = max(1, cells(problem) // (cost * len(problem.impacts)))
    return (slice(start, start + size) for start in range(0, max(draws, 1), size))
