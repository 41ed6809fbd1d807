"""Simulators of the study of foreign balls: each against a limit in closed form or a conservation
law.
"""

import numpy as np
import pytest
from scipy.optimize import brentq
from support.scripts import script

import fitball

balls = script("validation/foreign_balls")
RESTITUTION = {"cor_10": 0.76, "cor_slope": -0.012}
SOFT = {"stiffness": 4e5, "loss": 0.02}
# Each simulator without an offset of the normal force, friction last.
SIMULATORS = {
    "grip_slip": {"tangential": 0.15, "offset": 0.0, **RESTITUTION},
    "power_law": {"tangential": 0.1, "cor_10": 0.76, "power": 0.25},
    "hunt_crossley": {"ratio": 0.7, "damping": 0.2, **SOFT},
    "elastic_sphere": {"poisson": 0.4, **SOFT},
    "two_masses": {
        "mass_ratio": 0.88,
        "k_y": 2e4,
        "k_theta": 18.0,
        "eps_10": 0.0,
        "eps_slope": 0.0,
        **RESTITUTION,
    },
}


def impacts(count=12, angles=(12.0, 75.0)):
    rng = np.random.default_rng(3)
    speed = rng.uniform(10.0, 30.0, count)
    angle = np.radians(rng.uniform(*angles, count))
    spin = rng.uniform(-300.0, 300.0, count)
    return balls.Motion(speed * np.cos(angle), speed * np.sin(angle), spin)


def rebound(name, incident, mu):
    return getattr(balls, name)(incident, mu=mu, **SIMULATORS[name])


@pytest.mark.parametrize("name", SIMULATORS)
def test_angular_momentum_is_kept_and_energy_is_not_made(name):
    """About the point of contact only the normal force could turn the ball, and it has no lever."""
    incident = impacts()
    after = rebound(name, incident, 0.6)

    def momentum(motion):
        return balls.MASS * balls.RADIUS * motion.v_x + balls.INERTIA * motion.spin

    def energy(motion):
        of_speed = 0.5 * balls.MASS * (motion.v_x**2 + motion.v_y**2)
        return of_speed + 0.5 * balls.INERTIA * motion.spin**2

    assert momentum(after) == pytest.approx(momentum(incident), rel=1e-9, abs=1e-9)
    assert np.all(energy(after) < energy(incident))


@pytest.mark.parametrize("name", SIMULATORS)
def test_a_ball_that_slides_throughout_loses_friction_times_the_normal_impulse(name):
    every = impacts(40)
    fast = np.abs(every.slip) > 8.0
    incident = balls.Motion(*(column[fast] for column in every))
    after = rebound(name, incident, 0.02)
    push = np.sign(incident.slip) * 0.02 * (incident.v_y + after.v_y)
    assert after.v_x == pytest.approx(incident.v_x - push, abs=2e-4)


def test_a_friction_that_does_not_fall_is_coulombs():
    """The ball slides or leaves rolling: v_x2 = (v_x1 + a R omega_1)/(1 + a) (Brody 1984)."""
    incident = impacts(40)
    after = balls.falling_friction(incident, 0.3, 0.3, 5.0, **RESTITUTION)
    a = balls.INERTIA_RATIO
    rolling = (incident.v_x + a * balls.RADIUS * incident.spin) / (1.0 + a)
    push = np.sign(incident.slip) * 0.3 * (incident.v_y + after.v_y)
    slides = np.abs(incident.v_x - rolling) > np.abs(push)
    assert 5 < slides.sum() < 35
    assert after.v_x == pytest.approx(np.where(slides, incident.v_x - push, rolling), abs=1e-9)
    # A ball that slides throughout at speeds far above 0.1 m/s has the friction of fast balls.
    fast = balls.falling_friction(incident, 0.9, 0.05, 0.1, **RESTITUTION)
    shares = (incident.v_x - fast.v_x) / (incident.v_y + fast.v_y)
    assert np.median(np.abs(shares)) == pytest.approx(0.05, abs=1e-6)


@pytest.mark.parametrize("name", ["hunt_crossley", "elastic_sphere"])
def test_the_loss_of_hunt_and_crossley_is_that_of_its_integral(name):
    """M v dv = -k d^n (1 + c v) dd, from v1 to zero and from zero to -v2, over the same d."""
    incident = impacts()
    after = rebound(name, incident, 0.5)
    loss = SOFT["loss"]
    for v_1, v_2 in zip(incident.v_y, after.v_y, strict=True):
        pressed = v_1 / loss - np.log1p(loss * v_1) / loss**2

        def excess(speed, pressed=pressed):
            return -speed / loss - np.log1p(-loss * speed) / loss**2 - pressed

        assert v_2 == pytest.approx(brentq(excess, 1e-9, v_1), rel=1e-5)


@pytest.mark.parametrize("poisson", [0.3, 0.5])
def test_an_elastic_sphere_slips_throughout_from_the_limit_of_maw_barber_and_fawcett(poisson):
    """Without losses from u/(mu v_y) = (4 chi - 1)/kappa on, kappa = 2(1 - nu)/(2 - nu) and chi =
    kappa (1 + 1/a)/2.
    """
    kappa = 2.0 * (1.0 - poisson) / (2.0 - poisson)
    chi = 0.5 * kappa * (1.0 + 1.0 / balls.INERTIA_RATIO)
    limit = (4.0 * chi - 1.0) / kappa
    mu = 0.4
    v_y = np.full(3, 8.0)
    slip = np.array([0.9, 0.97, 1.02]) * limit * mu * v_y
    still = np.zeros(3)
    after = balls.elastic_sphere(balls.Motion(slip, v_y, still), mu, 4e5, 0.0, poisson)
    assert after.v_y == pytest.approx(v_y, rel=1e-5)
    shares = (slip - after.v_x) / (mu * (v_y + after.v_y))
    assert shares[2] == pytest.approx(1.0, abs=5e-4)
    assert shares[0] < 0.985
    assert shares[1] < 0.9985


def test_an_undamped_ball_that_grips_keeps_its_energy():
    """Both springs give back what they took, but for what is left in that along the court."""
    incident = impacts(60, angles=(60.0, 75.0))
    soft = {"stiffness": 4e5, "loss": 0.0, "ratio": 1.0}
    after = balls.hunt_crossley(incident, 1e6, damping=0.0, **soft)
    assert after.v_y == pytest.approx(incident.v_y, rel=1e-5)
    assert np.all(np.abs(after.slip) < 1.001 * np.abs(incident.slip))
    # Its slip turns round as cos(w T) does, T being Hertz's time, w that of spring and mobility.
    spring = 1.5 * 4e5 * np.sqrt(2e-3)
    time = 2.9432 * (1.25 * balls.MASS * incident.v_y**2 / 4e5) ** 0.4 / incident.v_y
    turned = incident.slip * np.cos(np.sqrt(spring * balls.MOBILITY) * time)
    assert after.slip == pytest.approx(turned, abs=0.02)


def test_the_second_code_of_the_two_mass_ball_agrees_with_the_first():
    incident = impacts(30)
    values = SIMULATORS["two_masses"] | {"mu": 0.56, "eps_10": 2.4e-3, "eps_slope": 1e-4}
    after = balls.two_masses(incident, **values)
    ball = fitball.Ball(balls.MASS, balls.RADIUS, balls.INERTIA_RATIO)
    states = fitball.impacts(incident.v_x, incident.v_y, incident.spin)
    expected = fitball.model("two-mass", ball=ball).rebound(values, states)
    assert after.v_x == pytest.approx(expected.v_x2, abs=2e-3)
    assert after.v_y == pytest.approx(expected.v_y2, abs=1e-9)
    assert after.spin == pytest.approx(expected.omega_2, abs=0.1)


def test_restitutions_are_those_of_their_laws():
    def power(motion):
        return balls.power_law(motion, 0.6, 0.1, 0.7, 0.25)

    assert balls.restitution_at(power, 10.0) == pytest.approx(0.7)
    assert balls.restitution_at(power, 20.0) == pytest.approx(0.7 / 2.0**0.25)

    def two_masses(motion):
        return rebound("two_masses", motion, 0.5)

    slope = balls.restitution_at(two_masses, 10.01) - balls.restitution_at(two_masses, 9.99)
    assert balls.restitution_at(two_masses, 10.0) == pytest.approx(0.76)
    assert slope / 0.02 == pytest.approx(-0.012, rel=1e-4)
