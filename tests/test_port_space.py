"""A bounce in three dimensions against an integration in the plane of the surface, whose slip is
free to turn.
"""

import numba
import numpy as np
import pytest
from support import ports

from fitball.models.kernels.contact import OFFSET, OFFSET_CONTACT, ball_of, contact_of


@numba.njit
def _parts(row, flags, v_y):
    """The ball and the vertical motion, whose outside truth is in other tests."""
    _, ball = ball_of(row, flags)
    _, contact = contact_of(ball, flags, 0.0, v_y, 0.0, np.nan)
    return ball, contact.spring, contact.t_force, contact.damping, contact.eps


def _stepped(call, v, w, v_y, steps, share):
    """Velocity along the surface and spin (impacts, 2) after a contact in time steps with implicit
    friction (Moreau): in each, as much of the friction cone as stops the slip, whatever its
    direction. Exact to the first order.
    """
    ball, spring, end, damping, eps = _parts(np.array(call.row), call.flags, v_y)
    mass = ball.mass
    radius = ball.radius
    core = ball.core
    shell = ball.shell
    mu = ball.mu
    compliance = 1.0 / mass + radius**2 / shell
    travel = v / _lengths(v)
    offset_in_contact = call.flags[OFFSET] == OFFSET_CONTACT
    inner = w
    outer = w
    twist = np.zeros_like(w)

    def pushed(v, outer, normal, torque):
        limit = mu * normal
        outer = outer + torque / shell
        turned = -share * eps * normal * travel / shell
        # An offset that acts in grip does where friction can bear it.
        slip = v - radius * (outer + turned)
        grips = _lengths(slip) <= compliance * limit
        outer = outer + np.where(grips | offset_in_contact, turned, 0.0)
        slip = v - radius * outer
        size = np.maximum(_lengths(slip), 1e-300)
        friction = -slip * np.minimum(1.0 / compliance, limit / size)
        return v + friction / mass, outer - radius * friction / shell

    if ball.landing > 0.0:
        for _ in range(steps):
            v, outer = pushed(v, outer, ball.landing * v_y / steps, 0.0)
    times = np.linspace(0.0, end, steps + 1)
    dt = end / steps
    frequency = np.sqrt(spring.damped_squared)
    phase = frequency * times
    swing = np.cos(phase) - spring.decay / frequency * np.sin(phase)
    vertical = v_y * np.exp(-spring.decay * times) * swing
    impulses = -ball.riding * np.diff(vertical)
    for normal in impulses:
        before = inner - outer
        halfway = twist + 0.5 * dt * before
        torque = ball.stiffness * halfway + damping * before
        inner = inner - dt * torque / core
        v, outer = pushed(v, outer, normal, dt * torque)
        twist = twist + 0.5 * dt * (before + inner - outer)
    spin = (core * inner + shell * outer) / (core + shell)
    return v, spin


def _lengths(vectors):
    """(impacts, 1) of vectors (impacts, 2)."""
    return np.linalg.norm(vectors, axis=1, keepdims=True)


def _integrated(call, v, w, v_y, steps, share):
    """Without the error of the first order."""
    coarse_v, coarse_w = _stepped(call, v, w, v_y, steps, share)
    fine_v, fine_w = _stepped(call, v, w, v_y, 2 * steps, share)
    return 2.0 * fine_v - coarse_v, 2.0 * fine_w - coarse_w


def _rebound_3d(port, velocity, spin, normal, parameters):
    """Velocity and spin (3,) after a bounce, by the port."""
    vectors = [port.Vector(*map(float, vector)) for vector in (velocity, spin, normal)]
    found = port.rebound_3d(*vectors, parameters)
    return np.array(found.velocity), np.array(found.spin)


def _spatial(port, parameters, v, w, v_y, normal):
    """The same by the port, on a surface with this normal."""
    up = normal / np.linalg.norm(normal)
    first = np.cross(up, [0.0, 0.6, 0.8])
    second = np.cross(up, first)
    plane = np.stack([first, second]) / np.linalg.norm(first)
    velocities = v @ plane - v_y * up
    spins = np.cross(up, w @ plane)
    found_v = []
    found_w = []
    for velocity, spin in zip(velocities, spins, strict=True):
        velocity, spin = _rebound_3d(port, velocity, spin, normal, parameters)
        found_v.append(plane @ velocity)
        found_w.append(plane @ np.cross(spin, up))
    return np.array(found_v), np.array(found_w)


@pytest.mark.parametrize(
    ("text", "share", "sidespin", "speed", "spin"),
    [
        # Exact without offset, whatever the spin, and without sidespin.
        ("two-mass", 0.0, 1.0, 1e-4, 0.006),
        ("two-mass+torsion=free", 0.0, 1.0, 1e-4, 0.006),
        ("two-mass", 1.0, 0.0, 1e-4, 0.006),
        # With both, nearly: the offset turns balls by up to 60 rad/s.
        ("two-mass", 1.0, 1.0, 0.04, 2.1),
        ("two-mass+normal=total", 1.0, 1.0, 0.04, 2.1),
        ("two-mass+offset=grip", 1.0, 1.0, 0.07, 2.6),
    ],
)
def test_bounce_in_space(text, share, sidespin, speed, spin):
    port = ports.reference(text)
    rng = np.random.default_rng(1)
    v_y = 12.0
    radius = 0.03302
    typical = ports.typical(text, eps_slope=2e-4)
    call = typical.model.kernel_call(typical.values)
    along = np.array([[0.8, -0.6]])
    across = np.array([[0.6, 0.8]])
    v = v_y * rng.uniform(0.2, 4.0, (40, 1)) * along
    topspin = rng.uniform(-1.0, 1.5, (40, 1)) * along
    turned_away = sidespin * rng.uniform(-1.0, 1.0, (40, 1)) * across
    w = v_y / radius * (topspin + turned_away)
    parameters = port.BALL._replace(
        eps_10=share * port.BALL.eps_10,
        eps_slope=share * 2e-4,
    )
    normal = np.array([2.0, -1.0, 3.0])
    wanted_v, wanted_w = _integrated(call, v, w, v_y, 500, share)
    found_v, found_w = _spatial(port, parameters, v, w, v_y, normal)
    assert np.abs(found_v - wanted_v).max() < speed
    assert np.abs(found_w - wanted_w).max() < spin


@pytest.mark.parametrize("text", ["two-mass", "thesis-exact", "grip-slip"])
def test_spin_about_the_normal_stays_and_turned_axes_turn_the_answer(text):
    port = ports.reference(text)
    rng = np.random.default_rng(2)
    sizes = np.array([[9.0], [200.0], [1.0]])
    for _ in range(50):
        turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        turn *= np.linalg.det(turn)
        vectors = sizes * rng.standard_normal((3, 3))
        _, spin, normal = vectors
        v_2, omega_2 = _rebound_3d(port, *vectors, port.BALL)
        turned_v, turned_omega = _rebound_3d(port, *(vectors @ turn.T), port.BALL)
        assert v_2 == pytest.approx(turn.T @ turned_v, abs=1e-10)
        assert omega_2 == pytest.approx(turn.T @ turned_omega, abs=1e-8)
        assert omega_2 @ normal == pytest.approx(spin @ normal, abs=1e-9)


@pytest.mark.parametrize("text", ["two-mass", "thesis-exact", "grip-slip"])
@pytest.mark.parametrize("omega", [6.0 / 0.03302, 400.0, -200.0])
def test_without_sidespin_it_is_the_bounce_in_the_plane(text, omega):
    """A ball that rolls too, whose slip is rounding on a slope."""
    port = ports.reference(text)
    travel = np.array([-0.6, 0.8])
    v = 6.0 * travel[None]
    w = omega * travel[None]
    flat = port.rebound(6.0, 9.0, omega, port.BALL)
    normal = np.array([0.3, -0.5, 0.7])
    (velocity,), (spin,) = _spatial(port, port.BALL, v, w, 9.0, normal)
    assert velocity == pytest.approx(flat.v_x2 * travel, abs=1e-11)
    assert spin == pytest.approx(flat.omega_2 * travel, abs=1e-9)


def test_a_grip_of_the_rigid_ball_is_linear_in_slip_and_offset():
    port = ports.reference("grip-slip")
    rng = np.random.default_rng(3)
    v_y = 12.0
    mass = 0.0576
    a = 0.56
    radius = 0.03302
    inertia = a * mass * radius**2
    ball = port.BALL._replace(mu=3.0)
    travel = np.array([0.6, 0.8])
    v = rng.uniform(2.0, 12.0, (20, 1)) * travel
    w = rng.uniform(-300.0, 300.0, (20, 2))
    normal = np.array([0.0, 0.0, 1.0])
    found_v, found_w = _spatial(port, ball, v, w, v_y, normal)
    # Restitution has its outside truth in other tests.
    v_y2 = port.rebound(0.0, v_y, 0.0, ball).v_y2
    push = ball.offset * mass * (v_y + v_y2) * travel
    slip = v - radius * w
    turned = (1.0 + ball.e_x) * slip + push * radius / inertia
    impulse = mass * a / (1.0 + a) * turned
    wanted_w = w + (radius * impulse - push) / inertia
    assert found_v == pytest.approx(v - impulse / mass, abs=1e-11)
    assert found_w == pytest.approx(wanted_w, abs=1e-9)
