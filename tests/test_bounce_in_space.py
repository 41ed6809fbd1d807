"""The bounce in three dimensions of the tutorial for games, against a rigid ball followed by impulses."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from snippets import snippets

import fitball
from fitball.values import Ball

PAGE = Path(__file__).parents[1] / "docs" / "tutorials" / "game.md"
BALL = Ball()
RADIUS, RATIO, COR, OFFSET = BALL.radius, BALL.inertia_ratio, 0.77, 2.4e-3
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def code(tmp_path_factory):
    """What the page defines, with the port of a rigid ball: it slides or rolls, with an offset."""
    values = {"mu": 0.57, "e_x": 0.0, "offset": OFFSET, "cor_10": COR, "cor_slope": 0.0}
    folder = tmp_path_factory.mktemp("game")
    (folder / "bounce.py").write_text(fitball.port("grip-slip", "python", values=values)[".py"])
    (text,) = (item.code for item in snippets(PAGE.read_text()) if "def bounce_3d" in item.code)
    names = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        patch.delitem(sys.modules, "bounce", raising=False)
        exec(text, names)
        patch.delitem(sys.modules, "bounce", raising=False)
    return names


def followed(v, omega, mu, steps=1500):
    """Velocity and spin of a rigid ball: friction against the slip, or what holds the contact point, for each share
    of the normal impulse, which acts ahead of the centre in the direction of travel.
    """
    level, down = v * (1.0 - UP), -v @ UP
    ahead = level / np.linalg.norm(level)
    rolling = np.cross(omega, UP)
    share = down * (1.0 + COR) / steps
    for _ in range(steps):
        slip = level - RADIUS * rolling
        hold = slip / share / (1.0 + 1.0 / RATIO) + OFFSET / (RADIUS * (1.0 + RATIO)) * ahead
        friction = hold if np.linalg.norm(hold) <= mu else mu * slip / max(np.linalg.norm(slip), 1e-12)
        level = level - friction * share
        rolling = rolling + (friction / (RATIO * RADIUS) - OFFSET / (RATIO * RADIUS**2) * ahead) * share
    return level + COR * down * UP, np.cross(UP, rolling) + (omega @ UP) * UP


def shots(count, seed, around=200.0):
    """Velocities and spins of play."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        speed, angle, way = (
            rng.uniform(15.0, 40.0),
            np.radians(rng.uniform(10.0, 35.0)),
            rng.uniform(0.0, 2.0 * np.pi),
        )
        ahead = np.array([np.cos(way), np.sin(way), 0.0])
        top, about, side = rng.uniform(-250.0, 450.0), rng.uniform(-around, around), rng.uniform(-300.0, 300.0)
        v = speed * (np.cos(angle) * ahead - np.sin(angle) * UP)
        yield v, top * np.cross(UP, ahead) + about * ahead + side * UP, ahead


def test_in_the_plane_of_flight_it_is_the_bounce_itself(code):
    for v, omega, ahead in shots(20, 1, around=0.0):
        found_v, found_omega = code["bounce_3d"](v, omega, UP)
        true_v, true_omega = followed(v, omega, code["MU"])
        np.testing.assert_allclose(found_v, true_v, atol=0.02)
        np.testing.assert_allclose(RADIUS * found_omega, RADIUS * true_omega, atol=0.03)
        assert found_omega @ UP == pytest.approx(omega @ UP)
        assert abs(found_v @ np.cross(UP, ahead)) < 1e-9


def test_the_deflection_by_spin_about_the_direction_of_travel_is_as_the_page_says(code):
    across = []
    for v, omega, ahead in shots(200, 2):
        side = np.cross(UP, ahead)
        across.append((code["bounce_3d"](v, omega, UP)[0] @ side, followed(v, omega, code["MU"])[0] @ side))
    found, true = np.transpose(across)
    assert np.sqrt(np.mean(true**2)) > 1.0
    assert np.sqrt(np.mean((found - true) ** 2)) < 0.04
    assert "RMS" in PAGE.read_text() and "by 0.03 m/s" in " ".join(PAGE.read_text().split())


def test_no_bounce_gains_energy_and_a_straight_fall_stays_straight(code):
    def energy(v, omega):
        return v @ v + RATIO * RADIUS**2 * omega @ omega

    rng = np.random.default_rng(3)
    for _ in range(2000):
        v, omega = rng.normal(0.0, 15.0, 3), rng.normal(0.0, 250.0, 3)
        v[2] = -abs(v[2]) - 1.0
        assert energy(*code["bounce_3d"](v, omega, UP)) < energy(v, omega)
    v, omega = code["bounce_3d"]([0.0, 0.0, -10.0], [0.0, 0.0, 50.0], UP)
    np.testing.assert_allclose(v, [0.0, 0.0, 7.7], atol=1e-9)
    np.testing.assert_allclose(omega, [0.0, 0.0, 50.0], atol=1e-9)
    # Topspin of a ball without direction has one.
    still, moving = (code["bounce_3d"]([speed, 0.0, -10.0], [0.0, 200.0, 0.0], UP)[0] for speed in (0.0, 1e-3))
    np.testing.assert_allclose(still, moving, atol=2e-3)
    assert still[0] > 1.0


def test_left_handed_axes_with_left_handed_rotation_give_the_mirror_image(code):
    mirror = np.array([1.0, -1.0, 1.0])
    for v, omega, _ahead in shots(20, 4):
        found_v, found_omega = code["bounce_3d"](v, omega, UP)
        other_v, other_omega = code["bounce_3d"](mirror * v, -mirror * omega, UP)
        np.testing.assert_allclose(other_v, mirror * found_v, atol=1e-9)
        np.testing.assert_allclose(other_omega, -mirror * found_omega, atol=1e-6)
