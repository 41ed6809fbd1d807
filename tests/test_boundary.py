"""The distance to the next regime against a plane in closed form and against clouds of impacts."""

from __future__ import annotations

import numpy as np
import pytest

import fitball
from fitball.errors import ParameterError
from fitball.models.boundary import boundary_margin
from fitball.studies.bench.hard_cases import BASE
from fitball.values import Ball, Impacts


def test_margin_to_a_plane():
    """Cross's bounce with constant restitution slips beyond a plane in the speeds: its distance in closed form."""
    chosen = fitball.model("grip-slip")
    mu, e_x, offset, cor = 0.5, 0.1, 2e-3, 0.75
    values = np.array([[mu, e_x, offset, cor, 0.0]])
    impacts = fitball.impacts([17.0, 17.5, 17.0], [8.0, 8.5, 9.0], [50.0, 0.0, -80.0])
    root = np.array([[0.3, 0.0, 0.0], [0.1, 0.2, 0.0], [2.0, -4.0, 10.0]])
    ball = Ball()
    a = ball.inertia_ratio
    normal = np.array(
        [
            a / (1.0 + a) * (1.0 + e_x),
            (1.0 + cor) * (offset / (1.0 + a) / ball.radius - mu),
            -a / (1.0 + a) * (1.0 + e_x) * ball.radius,
        ]
    )
    states = np.stack([impacts.v_x1, impacts.v_y1, impacts.omega_1], axis=-1)
    expected = np.abs(states @ normal) / np.linalg.norm(root.T @ normal)
    found = boundary_margin(chosen, chosen.parameter_names, values, impacts, root @ root.T)[0]
    assert np.all(expected < 3.0)
    # Two axes at most meet the plane beyond the end of the search, 5.5 standard deviations, and count as met there.
    assert np.all(found < 1.01 * expected)
    assert np.all(found > 0.99 / np.sqrt(1.0 / expected**2 + 2.0 / 5.5**2))
    steep = boundary_margin(chosen, chosen.parameter_names, values, impacts, 25.0 * root @ root.T)[0]
    np.testing.assert_allclose(steep, expected / 5.0, atol=0.01)
    nothing = boundary_margin(chosen, chosen.parameter_names, values, impacts, np.zeros((3, 3)))
    assert np.isinf(nothing).all()
    with pytest.raises(ParameterError, match="positive semidefinite"):
        boundary_margin(chosen, chosen.parameter_names, values, impacts, np.diag([1.0, -1.0, 1.0]))


def test_margin_holds_for_the_two_mass_ball(wang_impacts):
    """Within nine tenths of the margin no regime changes; without one within reach, none changes within it."""
    chosen = fitball.model("two-mass")
    names = chosen.parameter_names
    centre = np.array([{**BASE, "eps_slope": 1e-4, "cor_slope": -0.0145}[key] for key in names])
    values = centre * (1.0 + 0.02 * np.random.default_rng(2).standard_normal((4, centre.size)))
    covariance = np.diag([0.25, 0.25, 10.0]) ** 2
    margins = boundary_margin(chosen, names, values, wang_impacts, covariance)
    assert np.isfinite(margins).any()
    assert (margins > 3.0).any()
    rng = np.random.default_rng(1)
    along = rng.standard_normal((200, 3))
    along /= np.linalg.norm(along, axis=1)[:, None]
    for draw, row in enumerate(margins):
        start = chosen.evaluate(names, values[draw : draw + 1], wang_impacts).regime[0]
        for j, margin in enumerate(row):
            moves = along * 0.9 * min(margin, 3.0) @ np.diag([0.25, 0.25, 10.0])
            cloud = Impacts(
                wang_impacts.v_x1[j] + moves[:, 0], wang_impacts.v_y1[j] + moves[:, 1],
                wang_impacts.omega_1[j] + moves[:, 2],
            )  # fmt: skip
            assert np.all(chosen.evaluate(names, values[draw : draw + 1], cloud).regime[0] == start[j])
