"""A bounce in three dimensions against an integration in the plane of the surface, whose slip is
free to turn.
"""

import warnings
from typing import NamedTuple

import numba
import numpy as np
import pytest
from support import ports
from support.travel import acting

from fitball.base.values import FloatArray
from fitball.models.kernels.contact import OFFSET, OFFSET_CONTACT, ball_of, contact_of
from fitball.models.model import KernelCall

RADIUS = 0.03302


class Case(NamedTuple):
    """Balls that hit a surface at the same vertical speed `v_y`, by a kernel's `call`: velocities
    along the surface and spins (impacts, 2), and the share (impacts, 1) of the model's offset that
    acts.
    """

    call: KernelCall
    velocities: FloatArray
    spins: FloatArray
    v_y: float
    share: FloatArray


@numba.njit
def _parts(row, flags, v_y):
    """The ball and the vertical motion, which other tests compare with oracles from outside."""
    _, ball = ball_of(row, flags)
    _, contact = contact_of(ball, flags, 0.0, v_y, 0.0, np.nan)
    return ball, contact.spring, contact.t_force, contact.damping, contact.eps


def _lengths(vectors):
    """The lengths (impacts, 1) of vectors (impacts, 2)."""
    return np.linalg.norm(vectors, axis=1, keepdims=True)


class _Shell:
    """The shell on the surface: velocities `v` and spins `w`, (impacts, 2), which impulses of the
    normal force change, with implicit friction (Moreau): in each time step as much of the friction
    cone acts as stops the slip, whatever its direction.
    """

    def __init__(self, case, ball, eps):
        self.ball = ball
        self.v = case.velocities
        self.w = case.spins
        travel = self.v / _lengths(self.v)
        self.lever = case.share * eps * travel
        self.offset_in_contact = case.call.flags[OFFSET] == OFFSET_CONTACT
        self.compliance = 1.0 / ball.mass + ball.radius**2 / ball.shell

    def push(self, normal, torque):
        """A time step with this impulse of the normal force and of the joint's torque."""
        ball = self.ball
        limit = ball.mu * normal
        w = self.w + torque / ball.shell
        turned = -normal * self.lever / ball.shell
        # An offset that acts in grip acts where friction can hold the contact point.
        slip = self.v - ball.radius * (w + turned)
        grips = _lengths(slip) <= self.compliance * limit
        acts = grips | self.offset_in_contact
        w = w + np.where(acts, turned, 0.0)
        slip = self.v - ball.radius * w
        size = np.maximum(_lengths(slip), 1e-300)
        most = limit / size
        friction = -slip * np.minimum(1.0 / self.compliance, most)
        self.v = self.v + friction / ball.mass
        self.w = w - ball.radius * friction / ball.shell


def _normal_impulses(case, ball, spring, times):
    """The impulses of the normal force between these times."""
    frequency = np.sqrt(spring.damped_squared)
    phase = frequency * times
    swing = np.cos(phase) - spring.decay / frequency * np.sin(phase)
    decay = np.exp(-spring.decay * times)
    vertical = case.v_y * decay * swing
    return -ball.riding * np.diff(vertical)


def _stepped(case, steps):
    """Velocities along the surface and spins (impacts, 2) after a contact in time steps, exact to
    the first order.
    """
    row = np.array(case.call.row)
    ball, spring, end, damping, eps = _parts(row, case.call.flags, case.v_y)
    shell = _Shell(case, ball, eps)
    if ball.landing > 0.0:
        impulse = ball.landing * case.v_y / steps
        for _ in range(steps):
            shell.push(impulse, 0.0)
    times = np.linspace(0.0, end, steps + 1)
    half_step = 0.5 * end / steps
    inner = case.spins
    twist = np.zeros_like(inner)
    for normal in _normal_impulses(case, ball, spring, times):
        before = inner - shell.w
        halfway = twist + half_step * before
        torque = ball.stiffness * halfway + damping * before
        impulse = 2.0 * half_step * torque
        inner = inner - impulse / ball.core
        shell.push(normal, impulse)
        after = inner - shell.w
        twist = twist + half_step * (before + after)
    total = ball.core * inner + ball.shell * shell.w
    spin = total / (ball.core + ball.shell)
    return shell.v, spin


def _integrated(case, steps):
    """Velocities along the surface and spins (impacts, 2) after a contact, without the error of the
    first order.
    """
    coarse_v, coarse_w = _stepped(case, steps)
    fine_v, fine_w = _stepped(case, 2 * steps)
    return 2.0 * fine_v - coarse_v, 2.0 * fine_w - coarse_w


def _rebound_3d(port, velocity, spin, normal, parameters):
    """Velocity and spin (3,) after a bounce, by the port."""
    arrays = (velocity, spin, normal)
    vectors = [port.Vector(*map(float, array)) for array in arrays]
    with warnings.catch_warnings():
        # Balls that move away are among them.
        warnings.simplefilter("ignore", RuntimeWarning)
        rebound = port.rebound_3d(*vectors, parameters)
    return np.array(rebound.velocity), np.array(rebound.spin)


def _spatial(port, parameters, v, w, v_y, normal):
    """Velocities along the surface and spins (impacts, 2) after bounces by the port, on a surface
    with this normal.
    """
    up = normal / np.linalg.norm(normal)
    first = np.cross(up, [0.0, 0.6, 0.8])
    second = np.cross(up, first)
    plane = np.stack([first, second])
    plane = plane / np.linalg.norm(first)
    velocities = v @ plane - v_y * up
    spins = np.cross(up, w @ plane)
    after_v = []
    after_w = []
    for velocity, spin in zip(velocities, spins, strict=True):
        velocity_2, spin_2 = _rebound_3d(port, velocity, spin, normal, parameters)
        after_v.append(plane @ velocity_2)
        after_w.append(plane @ np.cross(spin_2, up))
    return np.array(after_v), np.array(after_w)


FLAT = (0.2, 4.0)
# Within 2 degrees of the vertical.
STEEP = (0.003, 0.034)


@pytest.mark.parametrize(
    ("text", "share", "sidespin", "slopes", "speed", "spin"),
    [
        # Exact without offset, whatever the spin, and without sidespin.
        ("two-mass", 0.0, 1.0, FLAT, 1e-4, 0.006),
        ("two-mass+torsion=free", 0.0, 1.0, FLAT, 1e-4, 0.006),
        ("two-mass", 1.0, 0.0, FLAT, 1e-4, 0.006),
        ("two-mass", 1.0, 0.0, STEEP, 1e-4, 0.006),
        # With both, nearly: the offset turns balls by up to 60 rad/s.
        ("two-mass", 1.0, 1.0, FLAT, 0.04, 2.1),
        ("two-mass", 1.0, 1.0, STEEP, 0.04, 2.1),
        ("two-mass+normal=total", 1.0, 1.0, FLAT, 0.04, 2.1),
        ("two-mass+offset=grip", 1.0, 1.0, FLAT, 0.07, 2.6),
    ],
)
def test_bounce_in_space(text, share, sidespin, slopes, speed, spin):
    port = ports.reference(text)
    rng = np.random.default_rng(1)
    v_y = 12.0
    typical = ports.typical(text, eps_slope=2e-4)
    along = np.array([[0.8, -0.6]])
    across = np.array([[0.6, 0.8]])
    speeds = v_y * rng.uniform(*slopes, (40, 1))
    topspin = rng.uniform(-1.0, 1.5, (40, 1))
    turned_away = sidespin * rng.uniform(-1.0, 1.0, (40, 1))
    case = Case(
        call=typical.model.kernel_call(typical.values),
        velocities=speeds * along,
        spins=v_y / RADIUS * (topspin * along + turned_away * across),
        v_y=v_y,
        share=share * acting(speeds, v_y),
    )
    parameters = port.BALL._replace(
        eps_10=share * port.BALL.eps_10,
        eps_slope=share * 2e-4,
    )
    normal = np.array([2.0, -1.0, 3.0])
    wanted_v, wanted_w = _integrated(case, 500)
    after_v, after_w = _spatial(
        port,
        parameters,
        case.velocities,
        case.spins,
        v_y,
        normal,
    )
    assert np.abs(after_v - wanted_v).max() < speed
    assert np.abs(after_w - wanted_w).max() < spin


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
def test_mirror_images_bounce_as_mirror_images_to_the_last_digit(text):
    """In the plane, and in space of every plane of the axes; straight down, with and without
    spin.
    """
    port = ports.reference(text)
    rng = np.random.default_rng(4)
    for _ in range(200):
        v_x = float(rng.choice([0.0, 0.01, 0.1, 10.0]) * rng.uniform(-1.0, 1.0))
        v_y = float(rng.uniform(3.0, 20.0))
        omega = float(rng.choice([0.0, 300.0]) * rng.uniform(-1.0, 1.0))
        right = port.rebound(v_x, v_y, omega, port.BALL)
        left = port.rebound(-v_x, v_y, -omega, port.BALL)
        turned = left._replace(
            v_x2=-left.v_x2,
            omega_2=-left.omega_2,
            gap_path=-left.gap_path,
            gap_turn=-left.gap_turn,
        )
        assert repr(turned).replace("-0.0,", "0.0,") == repr(right).replace("-0.0,", "0.0,")
    for _ in range(200):
        velocity, spin, normal = rng.standard_normal((3, 3))
        velocity = velocity * [9.0, 9.0, 9.0] - 12.0 * normal
        # Nearly along the normal, or just along it.
        steep = rng.choice([1.0, 0.01, 0.0])
        velocity = steep * velocity - (1.0 - steep) * 12.0 * normal
        spin = spin * rng.choice([0.0, 200.0])
        v_2, omega_2 = _rebound_3d(port, velocity, spin, normal, port.BALL)
        for axis in range(3):
            mirror = np.ones(3)
            mirror[axis] = -1.0
            # Spin is an axial vector.
            images = (mirror * velocity, -mirror * spin, mirror * normal)
            v_image, omega_image = _rebound_3d(port, *images, port.BALL)
            assert np.array_equal(mirror * v_image, v_2)
            assert np.array_equal(-mirror * omega_image, omega_2)


@pytest.mark.parametrize("text", ["two-mass", "thesis-exact", "grip-slip"])
@pytest.mark.parametrize("slope", [0.0, 1e-3, -0.02, 0.4])
def test_straight_down_is_one_rule_in_the_plane_and_in_space(text, slope):
    """A small speed along the surface has a small effect, whatever its direction."""
    port = ports.reference(text)
    travel = np.array([-0.6, 0.8])
    flat = port.rebound(9.0 * slope, 9.0, 0.0, port.BALL)
    normal = np.array([0.0, 0.0, 1.0])
    v = 9.0 * slope * travel[None]
    (velocity,), (spin,) = _spatial(port, port.BALL, v, 0.0 * v, 9.0, normal)
    assert velocity == pytest.approx(flat.v_x2 * travel, abs=1e-12)
    assert spin == pytest.approx(flat.omega_2 * travel, abs=1e-10)
    if abs(slope) < 0.01:
        assert abs(flat.v_x2) <= 60.0 * abs(slope)


@pytest.mark.parametrize("text", ["two-mass", "thesis-exact", "grip-slip"])
@pytest.mark.parametrize("omega", [6.0 / RADIUS, 400.0, -200.0])
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
    inertia = a * mass * RADIUS**2
    ball = port.BALL._replace(mu=3.0)
    travel = np.array([0.6, 0.8])
    v = rng.uniform(2.0, 12.0, (20, 1)) * travel
    w = rng.uniform(-300.0, 300.0, (20, 2))
    normal = np.array([0.0, 0.0, 1.0])
    after_v, after_w = _spatial(port, ball, v, w, v_y, normal)
    # Restitution has its outside truth in other tests.
    v_y2 = port.rebound(0.0, v_y, 0.0, ball).v_y2
    normal_impulse = mass * (v_y + v_y2)
    push = ball.offset * normal_impulse * travel
    slip = v - RADIUS * w
    turned = (1.0 + ball.e_x) * slip + push * RADIUS / inertia
    impulse = mass * a / (1.0 + a) * turned
    torque = RADIUS * impulse - push
    wanted_w = w + torque / inertia
    assert after_v == pytest.approx(v - impulse / mass, abs=1e-11)
    assert after_w == pytest.approx(wanted_w, abs=1e-9)
