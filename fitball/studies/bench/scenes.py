"""Impacts on which solvers are compared, with answers to fifty digits (the hard set: to sixteen)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.data.read import load_table
from fitball.models.capabilities import Oracle
from fitball.models.model import Model
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
    chosen = default_model()
    names = chosen.parameter_names
    base = np.array([BASE[name] for name in names])
    wang = load_table("wang_all.csv").impacts
    hard = [case for case in hard_cases() if not case.closures and "mass_ratio 1" not in case.name]
    return (
        _scene("sliding", names, base,
               impacts([16.0, 17.0, 25.0, 30.0], [4.0, 4.5, 4.0, 6.0], [0.0, -150.0, 0.0, 1e2]), engine),
        _scene("slide-grip-slide", names, base,
               impacts([12.0, 9.0, 14.0, 10.0], [13.0, 15.0, 12.0, 10.0], [0.0, 100.0, 140.0, -100.0]), engine),
        _scene("grip from the start", names, base,
               impacts([5.0, 4.0, 3.0, 6.0], [16.0, 15.0, 12.0, 14.0], [145.0, 120.0, 90.0, 180.0]), engine),
        _scene("Wang's 21", names, base, wang, engine),
        _scene(
            HARD,
            names,
            np.array([[case.parameters[name] for name in names] for case in hard]),
            impacts(*np.array([case.impact for case in hard]).T),
            engine,
        ),
    )  # fmt: skip


def _scene(name: str, names: tuple[str, ...], values: FloatArray, given: Impacts, engine: Engine) -> Scene:
    rows = np.broadcast_to(values, (len(given), len(names))).copy()
    singles = [impacts(given.v_x1[k], given.v_y1[k], given.omega_1[k]) for k in range(len(given))]
    parameters = [dict(zip(names, row.tolist(), strict=True)) for row in rows]
    solve = _exact_to_sixteen if name == HARD else _exact_to_fifty
    exact = list(in_order(engine, solve, list(zip(parameters, singles, strict=True))))
    v_x2, omega_2 = np.array(exact).T
    # Two events closer than rounding leave double precision without an answer, and the bench without a rival.
    kept = np.flatnonzero(np.isfinite(v_x2))
    return Scene(name, names, rows[kept], given.take(kept), v_x2[kept], omega_2[kept])


def _exact_to_fifty(bounce: tuple[Mapping[str, float], Impacts]) -> tuple[float, float]:
    exact = oracle().rebound(*bounce, digits=50)
    return float(exact.v_x2[0]), float(exact.omega_2[0])


def _exact_to_sixteen(bounce: tuple[Mapping[str, float], Impacts]) -> tuple[float, float]:
    exact = oracle().rebound(*bounce)
    return float(exact.v_x2[0]), float(exact.omega_2[0])
