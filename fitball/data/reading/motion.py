"""What a bounce is judged by: velocities and spins before and after, from whichever columns a table has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from fitball.data.propagation import Uncertain
from fitball.data.velocity import velocity
from fitball.values import FloatArray

Columns = Mapping[str, FloatArray]
# Rows that are looked at: as many show any error of a whole column, and the time stays a fraction of a second.
MOST_ROWS = 60
_ABSURD = 1e9


@dataclass(frozen=True)
class Motion:
    """Incident (1) and rebound (2) motion, each (impacts,) in m/s and rad/s; None where the columns do not tell.

    `contradictions` (impacts,) are differences between columns that say the same thing twice, as shares of the speed.
    """

    v_x1: FloatArray | None
    v_y1: FloatArray | None
    omega_1: FloatArray | None
    v_x2: FloatArray | None
    v_y2: FloatArray | None
    omega_2: FloatArray | None
    contradictions: tuple[FloatArray, ...] = ()

    def __eq__(self, other: object) -> bool:
        """Whether all numbers are the same."""
        if not isinstance(other, Motion):
            return NotImplemented
        mine, theirs = ([getattr(item, field.name) for field in fields(Motion)[:-1]] for item in (self, other))
        pairs = [*zip(mine, theirs, strict=True), *zip(self.contradictions, other.contradictions, strict=True)]
        return all(
            (one is None and two is None)
            or (one is not None and two is not None and np.allclose(one, two, rtol=1e-9, atol=1e-12))
            for one, two in pairs
        )

    __hash__ = None  # type: ignore[assignment]


def chosen_rows(columns: Columns) -> NDArray[np.int64]:
    """Rows to look at: those in which every number is finite, evenly picked where there are many."""
    finite = np.flatnonzero(np.all([np.isfinite(values) for values in columns.values()], axis=0))
    if len(finite) <= MOST_ROWS:
        return finite
    # Not at equal steps, which a table that repeats a pattern would answer with.
    return np.sort(np.random.default_rng(0).choice(finite, MOST_ROWS, replace=False))


def motion_of(columns: Columns) -> Motion:
    """The motion that columns [SI] of whole tables describe."""
    known = {name: Uncertain.exact(values) for name, values in columns.items()}
    before, after = velocity(known, "1"), velocity(known, "2")
    incident, rebound = ([_finite(item) for item in (end.x, end.y)] for end in (before, after))
    doubled = tuple(item for end in ("1", "2") for item in _contradictions(columns, end))
    return Motion(
        incident[0], incident[1], columns.get("omega_1"), rebound[0], rebound[1], columns.get("omega_2"), doubled
    )


def _finite(quantity: Uncertain | None) -> FloatArray | None:
    """Numbers, those that the columns do not determine (a speed from a component at right angles) absurdly large."""
    if quantity is None:
        return None
    return np.nan_to_num(quantity.value, nan=_ABSURD, posinf=_ABSURD, neginf=-_ABSURD)


def _contradictions(columns: Columns, end: str) -> list[FloatArray]:
    x, y, speed, angle = (columns.get(f"{name}{end}") for name in ("v_x", "v_y", "v_", "theta_"))
    if x is None or y is None:
        return []
    own = np.hypot(x, y)
    size = np.maximum(own, 1e-12)
    found = [] if speed is None else [(speed - own) / size]
    if angle is not None:
        along, across = np.cos(angle), np.sin(angle)
        found.append((x * across - y * along) / size)
    return found
