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
    travel = v / np.linalg.norm(v, axis=1, keepdims=True)
    inner = w
    outer = w
    twist = np.zeros_like(w)

    def pushed(v, outer, normal, torque):
        outer = outer + torque / shell
        turned = -share * eps * normal * travel / shell
        # An offset that acts in grip does where friction can bear it.
        grips = (
            np.linalg.norm(v - radius * (outer + turned), axis=1, keepdims=True)
            <= compliance * mu * normal
        )
        outer = outer + np.where(grips | (call.flags[OFFSET] == OFFSET_CONTACT), turned, 0.0)
        slip = v - radius * outer
        size = np.maximum(np.linalg.norm(slip, axis=1, keepdims=True), 1e-300)
        friction = -slip * np.minimum(1.0 / compliance, mu * normal / size)
        return v + friction / mass, outer - radius * friction / shell

    for _ in range(steps if ball.landing > 0.0 else 0):
        v, outer = pushed(v, outer, ball.landing * v_y / steps, 0.0)
    times = np.linspace(0.0, end, steps + 1)
    dt = end / steps
    frequency = np.sqrt(spring.damped_squared)
    swing = np.cos(frequency * times) - spring.decay / frequency * np.sin(frequency * times)
    impulses = -ball.riding * np.diff(v_y * np.exp(-spring.decay * times) * swing)
    for normal in impulses:
        torque = ball.stiffness * (twist + 0.5 * dt * (inner - outer)) + damping * (inner - outer)
        before = inner - outer
        inner = inner - dt * torque / core
        v, outer = pushed(v, outer, normal, dt * torque)
        twist = twist + 0.5 * dt * (before + inner - outer)
    return v, (core * inner + shell * outer) / (core + shell)


def _integrated(*given):
    """Without the error of the first order."""
    *known, steps, share = given
    coarse = _stepped(*known, steps, share)
    fine = _stepped(*known, 2 * steps, share)
    return [2.0 * one - other for one, other in zip(fine, coarse, strict=True)]


def _spatial(made, parameters, v, w, v_y, normal):
    """The same by the port, on a surface with this normal."""
    up = normal / np.linalg.norm(normal)
    first = np.cross(up, [0.0, 0.6, 0.8])
    plane = np.stack([first, np.cross(up, first)]) / np.linalg.norm(first)
    found = []
    for velocity, spin in zip(v @ plane - v_y * up, np.cross(up, w @ plane), strict=True):
        vectors = (made.Vector(*map(float, one)) for one in (velocity, spin, normal))
        one = made.rebound_3d(*vectors, parameters)
        found.append([plane @ np.array(one.velocity), plane @ np.cross(one.spin, up)])
    return np.swapaxes(found, 0, 1)


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
    made = ports.reference(text)
    rng = np.random.default_rng(1)
    v_y = 12.0
    radius = 0.03302
    one = ports.typical(text, eps_slope=2e-4)
    call = one.model.kernel_call(one.values)
    v = v_y * rng.uniform(0.2, 4.0, (40, 1)) * np.array([[0.8, -0.6]])
    along = v / np.linalg.norm(v, axis=1, keepdims=True)
    across = np.array([[0.6, 0.8]])
    w = (
        v_y
        / radius
        * (
            rng.uniform(-1.0, 1.5, (40, 1)) * along
            + sidespin * rng.uniform(-1.0, 1.0, (40, 1)) * across
        )
    )
    parameters = made.BALL._replace(eps_10=share * made.BALL.eps_10, eps_slope=share * 2e-4)
    wanted = _integrated(call, v, w, v_y, 500, share)
    found = _spatial(made, parameters, v, w, v_y, np.array([2.0, -1.0, 3.0]))
    assert np.abs(found[0] - wanted[0]).max() < speed
    assert np.abs(found[1] - wanted[1]).max() < spin


@pytest.mark.parametrize("text", ["two-mass", "thesis-exact", "grip-slip"])
def test_spin_about_the_normal_stays_and_turned_axes_turn_the_answer(text):
    made = ports.reference(text)
    rng = np.random.default_rng(2)
    for _ in range(50):
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        turn *= np.linalg.det(turn)
        velocity, spin, normal = np.array([[9.0], [200.0], [1.0]]) * rng.standard_normal((3, 3))
        answers = []
        for axes in (np.eye(3), turn):
            vectors = (made.Vector(*map(float, axes @ one)) for one in (velocity, spin, normal))
            found = made.rebound_3d(*vectors, made.BALL)
            answers.append((axes.T @ np.array(found.velocity), axes.T @ np.array(found.spin)))
        assert answers[0][0] == pytest.approx(answers[1][0], abs=1e-10)
        assert answers[0][1] == pytest.approx(answers[1][1], abs=1e-8)
        assert answers[0][1] @ normal == pytest.approx(spin @ normal, abs=1e-9)


@pytest.mark.parametrize("text", ["two-mass", "thesis-exact", "grip-slip"])
@pytest.mark.parametrize("omega", [6.0 / 0.03302, 400.0, -200.0])
def test_without_sidespin_it_is_the_bounce_in_the_plane(text, omega):
    """A ball that rolls too, whose slip is rounding on a slope."""
    made = ports.reference(text)
    v = np.array([[-3.6, 4.8]])
    w = omega * np.array([[-0.6, 0.8]])
    flat = made.rebound(6.0, 9.0, omega, made.BALL)
    normal = np.array([0.3, -0.5, 0.7])
    (velocity,), (spin,) = _spatial(made, made.BALL, v, w, 9.0, normal)
    assert velocity == pytest.approx(flat.v_x2 * v[0] / 6.0, abs=1e-11)
    assert spin == pytest.approx(flat.omega_2 * v[0] / 6.0, abs=1e-9)


def test_a_grip_of_the_rigid_ball_is_linear_in_slip_and_offset():
    made = ports.reference("grip-slip")
    rng = np.random.default_rng(3)
    v_y = 12.0
    mass = 0.0576
    a = 0.56
    radius = 0.03302
    ball = made.BALL._replace(mu=3.0)
    travel = np.array([0.6, 0.8])
    v = rng.uniform(2.0, 12.0, (20, 1)) * travel
    w = rng.uniform(-300.0, 300.0, (20, 2))
    found = _spatial(made, ball, v, w, v_y, np.array([0.0, 0.0, 1.0]))
    # Restitution has its outside truth in other tests.
    push = ball.offset * mass * (v_y + made.rebound(0.0, v_y, 0.0, ball).v_y2) * travel
    impulse = (
        mass * a / (1.0 + a) * ((1.0 + ball.e_x) * (v - radius * w) + push / (a * mass * radius))
    )
    assert found[0] == pytest.approx(v - impulse / mass, abs=1e-11)
    assert found[1] == pytest.approx(
        w + (radius * impulse - push) / (a * mass * radius**2),
        abs=1e-9,
    )
