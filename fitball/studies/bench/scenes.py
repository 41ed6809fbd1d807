"""Impacts on which solvers are compared, with answers to fifty digits (the hard set: to sixteen)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from fitball.data.read import load_table
from fitball.models.model import Model, Oracle
from fitball.models.registry import model
from fitball.scheduling.engine import Engine, in_order
from fitball.studies.bench.hard_cases import BASE, hard_cases
from fitball.values import FloatArray, Impacts, impacts

# The hard set holds joints that take minutes at fifty digits; there the double-precision oracle answers, which agrees
# with fifty digits to 1e-15 wherever both have been run.
HARD = "hard"


@dataclass(frozen=True)
class Scene:
    """Impacts of one kind with one parameter set each (rows, parameters), and the exact `v_x2`, `omega_2`."""

    name: str
    names: tuple[str, ...]
    values: FloatArray
    impacts: Impacts
    v_x2: FloatArray
    omega_2: FloatArray

    @property
    def speed(self) -> FloatArray:
        """Incident speed of the ball's surface, at most, (impacts,): what errors are relative to."""
        spin = default_model().ball.radius * np.abs(self.impacts.omega_1)
        return np.asarray(np.hypot(self.impacts.v_x1, self.impacts.v_y1) + spin)


def default_model() -> Model:
    """The model whose solvers are compared."""
    return model("two-mass")


def oracle() -> Oracle:
    """Its independent solution."""
    solution = default_model().oracle
    assert solution is not None
    return solution


def scenes(engine: Engine) -> tuple[Scene, ...]:
    """Sliding throughout, slide-grip-slide, grip from the start, Wang's 21, and the hard set of the default model.

    `engine` shares the exact answers, half a second per impact.
    """
    names = default_model().parameter_names
    base = np.array([BASE[name] for name in names])
    hard = [case for case in hard_cases() if not case.closures and "mass_ratio 1" not in case.name]
    kinds = {
        "sliding": impacts([16.0, 17.0, 25.0, 30.0], [4.0, 4.5, 4.0, 6.0], [0.0, -150.0, 0.0, 1e2]),
        "slide-grip-slide": impacts([12.0, 9.0, 14.0, 10.0], [13.0, 15.0, 12.0, 10.0], [0.0, 100.0, 140.0, -100.0]),
        "grip from the start": impacts([5.0, 4.0, 3.0, 6.0], [16.0, 15.0, 12.0, 14.0], [145.0, 120.0, 90.0, 180.0]),
        "Wang's 21": load_table("wang_all.csv").impacts,
        HARD: impacts(*np.array([case.impact for case in hard]).T),
    }
    values = dict.fromkeys(kinds, base) | {
        HARD: np.array([[case.parameters[name] for name in names] for case in hard])
    }
    return tuple(_scene(kind, names, values[kind], given, engine) for kind, given in kinds.items())


def _scene(name: str, names: tuple[str, ...], values: FloatArray, given: Impacts, engine: Engine) -> Scene:
    rows = np.broadcast_to(values, (len(given), len(names))).copy()
    bounces = [(dict(zip(names, row.tolist(), strict=True)), given.take(np.array([k]))) for k, row in enumerate(rows)]
    v_x2, omega_2 = np.array(list(in_order(engine, partial(_exact, None if name == HARD else 50), bounces))).T
    # Two events closer than rounding leave double precision without an answer, and the bench without a rival.
    kept = np.flatnonzero(np.isfinite(v_x2))
    return Scene(name, names, rows[kept], given.take(kept), v_x2[kept], omega_2[kept])


def _exact(digits: int | None, bounce: tuple[Mapping[str, float], Impacts]) -> tuple[float, float]:
    exact = oracle().rebound(*bounce, digits=digits)
    return float(exact.v_x2[0]), float(exact.omega_2[0])
