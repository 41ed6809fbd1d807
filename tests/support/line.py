"""A problem whose posterior is known: a model that is linear in its parameters, normal noise of
known size.
"""

import numpy as np

import fitball
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices

SD = 0.2


def line(v_x1, v_y1, omega_1, ball, slope="normal(0.5, 0.3)", shift="normal(0, 2)"):
    """v_x2 is a straight line in v_x1; v_y2 is 0.7 v_y1, and omega_2 is omega_1."""
    return slope * v_x1 + shift, 0.7 * v_y1, omega_1


def line_problem(count=12, seed=0, noise=SD, copies=1, **choices):
    """A problem of `count` measured v_x2 on a line with slope 0.6 and shift 1, each `copies` times.
    Its `noise` is fixed, or free where that is None.
    """
    rng = np.random.default_rng(seed)
    v_x1 = rng.uniform(5.0, 20.0, count)
    errors = SD * rng.standard_normal(count)
    values = {
        "v_x1": v_x1,
        "v_y1": np.full(count, 8.0),
        "omega_1": np.zeros(count),
        "v_x2": 0.6 * v_x1 + 1.0 + errors,
    }
    for name, column in values.items():
        values[name] = np.tile(column, copies)
    ids = tuple(map(str, range(count * copies)))
    table = ImpactTable("line", values, {}, {}, {"id": ids})
    choices.setdefault("fix", {"v_x_sd": noise} if noise else {})
    return build_problem(
        table,
        Scene(),
        Choices("", **choices),
        user_model=fitball.model_from(line),
    )


def exact(problem):
    """Mean (2,) and covariance (2, 2) of the posterior of slope and shift."""
    v_x1 = problem.rows.states.v_x1
    y = problem.rows.y[:, 0]
    # Of the priors of `line`: means 0.5 and 0, sds 0.3 and 2.
    prior_mean = np.array([0.5, 0.0])
    prior_precision = np.diag([0.3**-2, 2.0**-2])
    design = np.column_stack([v_x1, np.ones(y.size)])
    precision = design.T @ design / SD**2 + prior_precision
    weighted = design.T @ y / SD**2 + prior_precision @ prior_mean
    mean = np.linalg.solve(precision, weighted)
    return mean, np.linalg.inv(precision)
