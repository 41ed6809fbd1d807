"""Laws that every rebound keeps, whatever the parameters."""

from __future__ import annotations

import numpy as np
import pytest

from fitball.models.registry import model
from fitball.models.types import Phase
from fitball.values import Ball, Impacts, impacts

MODELS = [
    ("two-mass", {}),
    ("two-mass", {"torsion": "free"}),
    ("two-mass", {"normal": "total"}),
    ("two-mass", {"torsion": "rigid"}),
    ("two-mass", {"offset": "grip"}),
    ("thesis-exact", {}),
    ("grip-slip", {}),
    ("brody", {}),
]
DRAWS = 300


def sample(chosen, draw_priors, seed, **overrides):
    """Prior draws of a model as a mapping of columns, with some parameters replaced."""
    values = draw_priors(chosen, np.random.default_rng(seed), DRAWS)
    columns = {name: values[:, k] for k, name in enumerate(chosen.parameter_names)}
    return columns | {name: np.full(DRAWS, value) for name, value in overrides.items() if name in columns}


def offset_free(chosen):
    return {name: 0.0 for name in ("eps_10", "eps_slope", "offset") if name in chosen.parameter_names}


@pytest.mark.parametrize(("name", "closures"), MODELS)
def test_without_friction_nothing_changes_along_the_court(name, closures, wang_impacts, draw_priors):
    chosen = model(name, **closures)
    found = chosen.rebound(sample(chosen, draw_priors, 1, mu=0.0, **offset_free(chosen)), wang_impacts)
    ok = found.status == 0
    assert ok.sum() > 500
    np.testing.assert_allclose(found.v_x2[ok], np.broadcast_to(wang_impacts.v_x1, ok.shape)[ok], rtol=1e-14)
    spin = np.broadcast_to(wang_impacts.omega_1, ok.shape)[ok]
    np.testing.assert_allclose(found.omega_2[ok], spin, rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize(("name", "closures"), MODELS)
def test_mirror_symmetry(name, closures, wang_impacts, draw_priors):
    chosen = model(name, **closures)
    columns = sample(chosen, draw_priors, 2, **offset_free(chosen))
    mirrored = Impacts(-wang_impacts.v_x1, wang_impacts.v_y1, -wang_impacts.omega_1)
    one, other = chosen.rebound(columns, wang_impacts), chosen.rebound(columns, mirrored)
    ok = one.status == 0
    np.testing.assert_allclose(one.v_x2[ok], -other.v_x2[ok], rtol=0, atol=1e-12)
    np.testing.assert_allclose(one.omega_2[ok], -other.omega_2[ok], rtol=0, atol=1e-10)


@pytest.mark.parametrize(("name", "closures"), MODELS)
def test_scaling_all_speeds_scales_the_rebound(name, closures, wang_impacts, draw_priors):
    chosen = model(name, **closures)
    columns = sample(chosen, draw_priors, 3, cor_slope=0.0, eps_slope=0.0)
    factor = 1e3
    larger = Impacts(factor * wang_impacts.v_x1, factor * wang_impacts.v_y1, factor * wang_impacts.omega_1)
    one, other = chosen.rebound(columns, wang_impacts), chosen.rebound(columns, larger)
    ok = one.status == 0
    np.testing.assert_array_equal(one.regime, other.regime)
    np.testing.assert_allclose(factor * one.v_x2[ok], other.v_x2[ok], rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(factor * one.omega_2[ok], other.omega_2[ok], rtol=1e-10, atol=1e-7)


@pytest.mark.parametrize(("name", "closures"), [item for item in MODELS if item[0] not in ("thesis-exact",)])
def test_energy_never_rises(name, closures, wang_impacts, draw_priors):
    """With the spin taken as the mean, all motion left after the twist has died out; no offset."""
    chosen = model(name, **closures)
    columns = sample(chosen, draw_priors, 4, **offset_free(chosen))
    if "e_x" in columns:
        columns["e_x"] = np.clip(columns["e_x"], -1.0, 1.0)
    found = chosen.rebound(columns, wang_impacts)
    ok = found.status == 0
    ball = chosen.ball

    def along(v_x, omega):
        return 0.5 * ball.mass * v_x**2 + 0.5 * ball.inertia * omega**2

    before = np.broadcast_to(along(wang_impacts.v_x1, wang_impacts.omega_1), ok.shape)
    assert np.all(along(found.v_x2, found.omega_2)[ok] <= before[ok] * (1.0 + 1e-12))
    assert np.all(found.v_y2[ok] <= np.broadcast_to(wang_impacts.v_y1, ok.shape)[ok])


@pytest.mark.parametrize("closures", [{}, {"torsion": "free"}, {"normal": "total"}, {"torsion": "rigid"}])
def test_balance_about_the_contact_point(closures, wang_impacts, draw_priors):
    """M R (v_x1 - v_x2) - I (omega_2 - omega_1) = eps times the normal impulse M (1 + COR) v_y1."""
    chosen = model("two-mass", **closures)
    columns = sample(chosen, draw_priors, 5)
    found = chosen.rebound(columns, wang_impacts)
    ball = chosen.ball
    eps = columns["eps_10"][:, None] + columns["eps_slope"][:, None] * (wang_impacts.v_y1 - 10.0)
    turned = ball.mass * ball.radius * (wang_impacts.v_x1 - found.v_x2)
    turned = turned - ball.inertia * (found.omega_2 - wang_impacts.omega_1)
    normal = ball.mass * (wang_impacts.v_y1 + found.v_y2)
    ok = found.status == 0
    np.testing.assert_allclose(turned[ok], (eps * normal)[ok], rtol=1e-10, atol=1e-13)


def test_friction_stays_within_the_cone(wang_impacts, draw_priors):
    chosen = model("two-mass")
    columns = sample(chosen, draw_priors, 6)
    found = chosen.rebound(columns, wang_impacts)
    ok = found.status == 0
    limit = columns["mu"][:, None] * (wang_impacts.v_y1 + found.v_y2)
    assert np.all(np.abs(wang_impacts.v_x1 - found.v_x2)[ok] <= limit[ok] * (1.0 + 1e-12))


def test_infinite_torsional_stiffness_is_the_rigid_ball(wang_impacts):
    """The error of a finite stiffness falls off as 1/k_theta."""
    chosen = model("two-mass")
    parameters = {
        "mass_ratio": 0.9, "k_y": 2e4, "k_theta": 1e3, "mu": 0.55, "eps_10": 2e-3, "eps_slope": 1e-4,
        "cor_10": 0.76, "cor_slope": -0.012,
    }  # fmt: skip
    stiff = dict(parameters)
    rigid = {name: value for name, value in parameters.items() if name != "k_theta"}
    limit = model("two-mass", torsion="rigid").rebound(rigid, wang_impacts)
    errors = []
    for stiff["k_theta"] in (1e4, 1e5, 1e6):
        found = chosen.rebound(stiff, wang_impacts)
        errors.append(np.max(np.abs(found.omega_2 - limit.omega_2)))
    # The twist relaxes as a critically damped spring does: at least as the square root of the compliance.
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.15 * errors[0]


def test_total_mass_and_rigid_torsion_is_brody(wang_impacts):
    both = {"mu": 0.55, "cor_10": 0.76, "cor_slope": -0.012}
    rigid = model("two-mass", torsion="rigid", normal="total").rebound(
        both | {"k_y": 2e4, "eps_10": 0.0, "eps_slope": 0.0}, wang_impacts
    )
    brody = model("brody").rebound(both, wang_impacts)
    np.testing.assert_allclose(rigid.v_x2, brody.v_x2, rtol=1e-13)
    np.testing.assert_allclose(rigid.v_y2, brody.v_y2, rtol=1e-15)
    np.testing.assert_allclose(rigid.omega_2, brody.omega_2, rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize(("name", "closures"), [item for item in MODELS if item[0] != "brody"])
def test_outputs_are_continuous_across_regimes(name, closures, draw_priors):
    """March the incident angle through all regimes in small steps: no output jumps."""
    chosen = model(name, **closures)
    parameters = {
        "mass_ratio": 0.88, "k_y": 1.9e4, "k_theta": 18.0, "mu": 0.5, "eps_10": 1e-3, "eps_slope": 5e-5,
        "cor_10": 0.76, "cor_slope": -0.012, "zeta_theta": 0.3, "e_x": 0.1, "offset": 1e-3,
    }  # fmt: skip
    used = {key: parameters[key] for key in chosen.parameter_names}
    angle = np.linspace(0.15, 1.5, 20001)
    states = impacts(17.0 * np.cos(angle), 17.0 * np.sin(angle), 60.0)
    found = chosen.rebound(used, states)
    assert np.unique(found.regime).size >= 2
    for output, scale in ((found.v_x2, 17.0), (found.omega_2, 17.0 / 0.033)):
        second = np.abs(np.diff(output, 2)) / scale
        # A kink changes the slope, of order one per radian; a jump would show undiminished.
        assert second.max() < 20.0 * (angle[1] - angle[0])


def test_landing_on_a_massless_shell_has_no_impulse(wang_impacts):
    """As the shell's mass vanishes, the momentum closure goes over into the total one."""
    parameters = {
        "k_y": 2e4, "k_theta": 20.0, "mu": 0.55, "eps_10": 2e-3, "eps_slope": 0.0, "cor_10": 0.76,
        "cor_slope": -0.012, "mass_ratio": 1.0 - 1e-7,
    }  # fmt: skip
    one = model("two-mass").rebound(parameters, wang_impacts)
    other = model("two-mass", normal="total").rebound(parameters, wang_impacts)
    np.testing.assert_allclose(one.v_x2, other.v_x2, atol=1e-4)
    np.testing.assert_allclose(one.omega_2, other.omega_2, atol=1e-2)


def test_spin_of_a_drop_comes_from_the_offset_alone():
    """A ball dropped without spin that grips at once: the offset turns it as angular momentum demands."""
    ball = Ball()
    chosen = model("grip-slip", ball=ball)
    found = chosen.rebound(
        {"mu": 0.6, "e_x": 0.0, "offset": 2e-3, "cor_10": 0.75, "cor_slope": 0.0}, impacts(0.0, 10.0, 0.0)
    )
    assert found.regime[0] == int(Phase.GRIP)
    normal = ball.mass * 1.75 * 10.0
    expected = -2e-3 * normal / (ball.inertia + ball.mass * ball.radius**2)
    np.testing.assert_allclose(found.omega_2, expected, rtol=1e-13)
    np.testing.assert_allclose(found.v_x2, ball.radius * expected, rtol=1e-13)


def test_a_grip_that_holds_to_the_end_ends_with_the_contact(wang_impacts):
    """The twist has died out long before release: friction and its limit vanish together, without a second slip."""
    parameters = {
        "mass_ratio": 0.3549999758539091, "k_y": 77663.08836292337, "k_theta": 15586.265293157781,
        "mu": 0.1010901235690645, "eps_10": 0.012340829370667807, "eps_slope": -0.0027860229277506445,
        "cor_10": 0.7772245597385539, "cor_slope": -0.016788361283666106,
    }  # fmt: skip
    found = model("thesis-exact").rebound(parameters, wang_impacts)
    assert np.all(np.isfinite(found.omega_2))
    assert np.all(np.isfinite(found.v_x2))


@pytest.mark.parametrize("name", ["two-mass", "thesis-exact"])
def test_ok_means_finite(name, wang_impacts, draw_priors):
    """No output is NaN without a status that says why, over many prior draws."""
    chosen = model(name)
    values = draw_priors(chosen, np.random.default_rng(77), 4000)
    found = chosen.evaluate(chosen.parameter_names, values, wang_impacts)
    ok = found.status == 0
    for output in (found.v_x2, found.v_y2, found.omega_2, found.contact_time):
        assert np.all(np.isfinite(output[ok]))
        assert np.all(np.isnan(output[~ok]))
    assert 0.2 < ok.mean() < 0.95
