"""What a port says of how far an impact lies from measured ones is what `predict` says of it."""

import numpy as np
import pytest
from support import engines, ports
from support.fit_by_hand import table_of

import fitball
from fitball.base.values import Impacts
from fitball.exports.parameter_set import sets_of_fit
from fitball.exports.ports import port
from fitball.inference.forward import CalibratedRange


def said_by_predict(impacts, radius, new):
    """The flags of extrapolation that predictions have."""
    index = np.zeros((len(impacts), 0), np.int64)
    measured = CalibratedRange(impacts, index, radius)
    return measured.extrapolation(new, np.zeros((len(new), 0), np.int64))[0]


def near_and_far(impacts, radius, seed, count):
    """Impacts between, near and far from measured ones, either way, straight down too."""
    rng = np.random.default_rng(seed)
    forwards = impacts.forwards
    points = np.stack([forwards.v_x1, forwards.v_y1, forwards.omega_1], axis=1)
    weights = rng.dirichlet(np.full(len(points), 0.3), count)
    spread = np.array([1.5, 1.5, 1.5 / radius])
    new = weights @ points + spread * rng.standard_normal((count, 3)) * rng.choice(
        [0, 1], (count, 1)
    )
    new[: len(points)] = points
    new[-20:, 0] = 0.0
    new[:, 1] = np.maximum(np.abs(new[:, 1]), 1e-3)
    side = rng.choice([-1.0, 1.0], count)
    return Impacts(side * new[:, 0], new[:, 1], side * new[:, 2])


def flags_of(module, new):
    """What a port says, in the plane and in space."""
    plane = []
    space = []
    up = module.Vector(0.0, 1.0, 0.0)
    for v_x, v_y, omega in zip(new.v_x1, new.v_y1, new.omega_1, strict=True):
        plane.append(module.rebound(float(v_x), float(v_y), float(omega), module.BALL).extrapolated)
        velocity = module.Vector(float(v_x), -float(v_y), 0.0)
        spin = module.Vector(0.0, 0.0, -float(omega))
        space.append(module.rebound_3d(velocity, spin, up, module.BALL).extrapolated)
    return np.array(plane), np.array(space)


def table(kind):
    """Measured impacts: of all directions, in a plane, on a line, one alone."""
    rng = np.random.default_rng(3)
    v_x, v_y, omega = rng.uniform([8, 4, -200], [20, 14, 200], (14, 3)).T
    if kind == "plane":
        return Impacts(v_x, v_y, 0.0 * omega)
    if kind == "line":
        return Impacts(1.5 * v_y, v_y, 10.0 * v_y)
    if kind == "one":
        return Impacts(v_x[:1], v_y[:1], omega[:1])
    return Impacts(v_x, v_y, omega)


@pytest.mark.parametrize("kind", ["wang", "all", "plane", "line", "one"])
def test_a_port_says_extrapolated_where_predict_does(kind):
    parameters = engines.wang_set()
    if kind != "wang":
        parameters = type(parameters)("", parameters.model, parameters.values, "", {}, table(kind))
    impacts = parameters.impacts
    new = near_and_far(impacts, 0.03302, 4, 400)
    wanted = said_by_predict(impacts, 0.03302, new)
    plane, space = flags_of(ports.module(port([parameters], "python")), new)
    assert np.array_equal(plane, wanted)
    assert np.array_equal(space, wanted)
    assert 20 < wanted.sum() < 400


def test_each_surface_has_its_own_range():
    fit = fitball.calibrate(
        table_of(24, surfaces=("clay", "hard")), model="grip-slip", point_only=True
    )
    sets = sets_of_fit(fit, {})
    module = ports.module(port(sets, "python"))
    for parameters, row in zip(sets, (module.CLAY, module.HARD), strict=True):
        new = near_and_far(parameters.impacts, row.ball_radius, 5, 100)
        wanted = said_by_predict(parameters.impacts, row.ball_radius, new)
        module.BALL = row
        plane, _ = flags_of(module, new)
        assert np.array_equal(plane, wanted)


def test_without_measurements_all_is_extrapolated():
    module = ports.reference("two-mass")
    assert module.rebound(15.0, 8.0, 0.0, module.BALL).extrapolated
