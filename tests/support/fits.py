"""Fits of small problems: their maxima, points, and drops of which each speed is linear in two
parameters.
"""

from made_tables import impact_table
from support.density import near

import fitball
from fitball.data.scene import Scene
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.schema import PointFit
from fitball.inference.search.objective import Objective, descend

NOISE = {"v_x_sd": 0.2, "v_y_sd": 0.15, "spin_sd": 6.0}


def at(problem, x):
    """A point fit at coordinates (coordinates,)."""
    values = {name: float(draws[0]) for name, draws in problem.values(x[None]).items()}
    return PointFit((values,), (0.0,), 0.0, {})


def best(problem, start=None):
    """The coordinates (coordinates,) of the maximum near the truth or a start."""
    x, _, converged = descend(
        Objective(problem),
        near(problem, 1, 0.0) if start is None else start[None],
        1e-10,
    )
    assert converged.all()
    return x[0]


def line(v_x1, v_y1, omega_1, ball, a="normal(0, 10)", b="normal(0, 10)"):
    return v_x1, a * v_y1 + b * (v_y1 - 10.0), omega_1


def bounded(v_x1, v_y1, omega_1, ball, a="normal(0, 10)", b="uniform(0, 1)"):
    return v_x1, a * v_y1 + b * (v_y1 - 10.0), omega_1


def drops_of(function, speeds, y, **choices):
    """The problem of drops at vertical speeds [m/s] and rebounds y, by a function as model."""
    table = impact_table(
        {
            "v_x1": 0.0 * speeds,
            "v_y1": speeds,
            "omega_1": 0.0 * speeds,
            "v_y2": y,
        }
    )
    return build_problem(table, Scene(), Choices(**choices), fitball.model_from(function))
