"""Time courses of one impact: against an independent integration, the laws every contact obeys, and misuse."""

from __future__ import annotations

import math
from itertools import pairwise, product

import numpy as np
import pytest
from integrated import Contact

import fitball
from fitball.errors import FitballError, ModelError, ParameterError
from fitball.models.registry import MODELS
from fitball.models.specs import FOLLOWED, RANKED
from fitball.models.types import Phase, unpack_regime

BALL = fitball.Ball()
PARAMETERS = {
    "mass_ratio": 0.9, "k_y": 2.0e4, "k_theta": 20.0, "mu": 0.56, "eps_10": 2.4e-3, "eps_slope": 1e-4,
    "cor_10": 0.776, "cor_slope": -0.0158, "zeta_theta": 0.3, "inertia_split": 0.5,
}  # fmt: skip
# Name, closures changed, parameters changed, impact, phases it must pass through.
CASES = [
    ("two-mass", {}, {}, (20.0, 6.0, -100.0), "slide"),
    ("two-mass", {}, {}, (12.0, 10.0, 50.0), "slide-grip-slide back"),
    ("two-mass", {}, {"k_theta": 103.8, "mu": 0.95, "eps_10": -0.0039, "eps_slope": 0.0, "mass_ratio": 0.84},
     (13.5, 11.9, -125.0), "slide-grip-slide"),
    ("two-mass", {}, {"k_theta": 206.1, "mu": 0.23, "eps_10": 0.0106, "eps_slope": 0.0, "mass_ratio": 0.81},
     (12.9, 10.2, 481.0), "slide-slide back-grip-slide-grip-slide back"),
    ("two-mass", {"torsion": "free"},
     {"k_theta": 94.2, "mu": 0.69, "eps_10": 0.0022, "eps_slope": 0.0, "mass_ratio": 0.94, "zeta_theta": 0.324},
     (8.1, 8.6, 185.0), "grip-slide-grip-slide back"),
    # Near resonance and strongly damped: two series, one phase.
    ("two-mass", {}, {"cor_10": 0.02, "cor_slope": 0.0, "k_theta": 2.0}, (25.0, 6.0, -100.0), "slide"),
    ("two-mass", {"torsion": "rigid"}, {}, (12.0, 10.0, 50.0), "slide-grip"),
    ("two-mass", {"torsion": "rigid", "offset": "grip", "normal": "inner", "release": "zero_displacement"},
     {"mu": 0.2, "eps_10": 0.031, "eps_slope": 0.0}, (3.0, 10.0, 50.0), "slide-hold-free"),
    ("two-mass", {"torsion": "rigid"}, {"mu": 0.5, "eps_10": 0.031, "eps_slope": 0.0}, (3.0, 10.0, 180.0),
     "slide"),
    ("two-mass", {"torsion": "rigid"}, {"mu": 0.5, "eps_10": 0.031, "eps_slope": 0.0}, (3.0, 10.0, 280.0),
     "slide back-slide"),
    ("two-mass", {"torsion": "rigid"}, {"mu": 0.05, "eps_10": -0.01, "eps_slope": 0.0}, (0.0, 10.0, 0.0),
     "slide back"),
    ("thesis-exact", {}, {"k_theta": 26.2, "mu": 0.59, "eps_10": 0.0117, "eps_slope": 0.0}, (16.0, 10.4, -204.0),
     "slide-hold-grip-slide back-free"),
    ("two-mass", {"normal": "total", "offset": "grip", "torsion": "free", "spin": "shell"},
     {"k_theta": 161.4, "mu": 0.7, "eps_10": 0.0108, "eps_slope": 0.0, "zeta_theta": 0.222}, (18.6, 13.9, 356.0),
     "slide-hold-grip-hold-slide"),
]  # fmt: skip
IDS = [f"{name} {' '.join(f'{k}={v}' for k, v in options.items())} {impact}" for name, options, _, impact, _ in CASES]


def set_up(case):
    name, options, changes, impact, _ = case
    model = fitball.model(name, **options)
    values = {key: {**PARAMETERS, **changes}[key] for key in model.parameter_names}
    return model, values, fitball.impacts(*impact)


def history(case, points=301):
    model, values, impact = set_up(case)
    contact = float(model.rebound(values, impact).contact_time[0])
    return model, values, impact, model.history(values, impact, np.linspace(0.0, 1.0, points) * contact)


def followed(contact, landed, phases):
    """Dense solutions phase by phase, `(start, end, phase, solution)`; `phases` says only which comes next."""
    pieces, time, z = [], 0.0, [0.0, landed.v_y, landed.v_x, landed.omega_1, landed.omega_2, 0.0]
    for place, phase in enumerate(phases):
        last = place == len(phases) - 1
        ends = [] if last else contact.endings(phase)
        found = contact.run(phase, time, z, contact.duration, ends, 1e-11, 1e-13)
        pieces.append((time, float(found.t[-1]), phase, found.sol))
        time, z = float(found.t[-1]), found.y[:, -1].copy()
        if phase not in (Phase.GRIP, Phase.HOLD, Phase.FREE) and not last and phases[place + 1] is not Phase.FREE:
            # What is left of the slip is the tolerance of the integration.
            z[2] = BALL.radius * z[4]
    return pieces


@pytest.mark.parametrize("case", CASES, ids=IDS)
def test_courses_against_an_independent_integration(case):
    model, values, impact, found = history(case)
    assert found.regime_name == case[4]
    core_return = -found.release.before.v_y / found.landing.after.v_y
    told = unpack_regime(found.regime)
    integrated = Contact(model.closures, values, impact, core_return, found.contact_time)
    pieces = followed(integrated, found.landing.after, told)
    assert [span.phase for span in found.spans] == list(told)
    ends = [piece[1] for piece in pieces[:-1]]
    np.testing.assert_allclose([span.start for span in found.spans[1:]], ends, atol=1e-7 * found.contact_time)
    np.testing.assert_allclose(found.transition_shares, np.array(ends) / found.contact_time, atol=1e-7)
    speed, spin = 20.0, 20.0 / BALL.radius
    for start, end, phase, solution in pieces:
        inside = (found.times > start + 1e-6 * end) & (found.times < end * (1.0 - 1e-6))
        if not inside.any():
            continue
        z = solution(found.times[inside])
        columns = (found.y, found.v_y, found.v_x, found.omega_1, found.omega_2, found.twist)
        for course, exact, scale in zip(columns, z, (1e-2, speed, speed, spin, spin, 0.3), strict=True):
            np.testing.assert_allclose(course[inside], exact, atol=2e-8 * scale)
        np.testing.assert_allclose(found.slip[inside], z[2] - BALL.radius * z[4], atol=2e-8 * speed)
        assert set(found.phase[inside]) <= {int(phase)}
        pushes = np.array([integrated.ground(phase, column)[:2] for column in z.T])
        np.testing.assert_allclose(found.normal_force[inside], pushes[:, 0], atol=1e-5)
        np.testing.assert_allclose(found.friction_force[inside], pushes[:, 1], atol=1e-5)


@pytest.mark.parametrize("case", CASES, ids=IDS)
def test_release_is_the_rebound_and_impulses_are_momentum(case):
    model, values, impact, found = history(case)
    rebound = model.rebound(values, impact)
    after, before = found.release.after, found.release.before
    assert (after.v_x, -after.v_y, after.omega_2) == (rebound.v_x2[0], rebound.v_y2[0], rebound.omega_2[0])
    assert found.regime == rebound.regime[0]
    assert before.v_x == pytest.approx(after.v_x, rel=1e-12, abs=1e-12)
    assert (found.v_x[-1], found.v_y[-1], found.omega_2[-1]) == (before.v_x, before.v_y, before.omega_2)
    # Core and shell share what they have when their twist dies out; a shell that keeps its spin is the rebound.
    chosen = model.closures
    if chosen.spin == "shell" and chosen.torsion != "rigid":
        assert before.omega_2 == pytest.approx(after.omega_2, rel=1e-11)
    mass, share = BALL.mass, values["mass_ratio"]
    assert found.landing.normal_impulse == (
        pytest.approx((1.0 - share) * mass * float(impact.v_y1[0])) if chosen.normal == "momentum" else 0.0
    )
    # Gauss's rule between the transitions, where the courses are smooth; landing's own impulse beside it.
    nodes, weights = np.polynomial.legendre.leggauss(40)
    edges = [*(span.start for span in found.spans), found.contact_time]
    normal = found.landing.normal_impulse
    along = found.landing.friction_impulse
    for left, right in pairwise(edges):
        part = model.history(values, impact, left + 0.5 * (right - left) * (nodes + 1.0))
        normal += 0.5 * (right - left) * weights @ part.normal_force
        along += 0.5 * (right - left) * weights @ part.friction_force
    assert along == pytest.approx(mass * (rebound.v_x2[0] - impact.v_x1[0]), rel=1e-9, abs=1e-10)
    if chosen.normal != "inner" and chosen.release == "zero_force":
        assert normal == pytest.approx(mass * (rebound.v_y2[0] + impact.v_y1[0]), rel=1e-9)


@pytest.mark.parametrize("case", CASES, ids=IDS)
def test_friction_stays_in_its_cone_and_the_ground_never_pulls(case):
    _model, values, _impact, found = history(case, 2001)
    limit = values["mu"] * found.normal_force
    assert np.all(found.normal_force >= 0.0)
    assert np.all(np.abs(found.friction_force) <= limit + 1e-9 * limit.max())
    sliding = np.isin(found.phase, (Phase.SLIDE_FORWARD, Phase.SLIDE_BACKWARD))
    np.testing.assert_allclose(np.abs(found.friction_force[sliding]), limit[sliding], rtol=1e-12)
    assert np.all(found.friction_force[sliding] * found.slip[sliding] <= 1e-12)
    assert np.all(found.slip[np.isin(found.phase, (Phase.GRIP, Phase.HOLD))] == 0.0)
    landing = found.landing
    assert abs(landing.friction_impulse) <= values["mu"] * landing.normal_impulse * (1.0 + 1e-12)
    assert found.y.max() <= found.peak_compression.value * (1.0 + 1e-12)
    assert found.normal_force.max() <= found.peak_force.value * (1.0 + 1e-12)
    assert found.y.max() == pytest.approx(found.peak_compression.value, rel=1e-5)
    assert found.normal_force.max() == pytest.approx(found.peak_force.value, rel=1e-5)


CLOSURES = list(
    product(
        ("zero_force", "zero_displacement"), ("inner", "momentum", "total"), ("grip", "contact"), ("shell", "mean"),
        ("matched", "free", "rigid"),
    )
)  # fmt: skip


def test_every_composition_at_odd_values():
    """Phases are those of the rebound, the end is the rebound, friction keeps its cone: also where things touch."""
    rng = np.random.default_rng(8)
    followed = 0
    for chosen in CLOSURES:
        model = fitball.model(
            "two-mass", **dict(zip(("release", "normal", "offset", "spin", "torsion"), chosen, strict=True))
        )
        for _ in range(12):
            values = {
                **PARAMETERS,
                "eps_slope": 0.0,
                "k_theta": math.exp(rng.uniform(1.0, 9.0)),
                "mu": rng.choice([0.0, rng.uniform(0.0, 1.2), rng.uniform(0.0, 0.2)]),
                "eps_10": rng.choice([0.0, rng.uniform(-0.01, 0.015)]),
                "zeta_theta": rng.choice([0.0, 1.0, rng.uniform(0.0, 2.0)]),
                "mass_ratio": rng.uniform(0.6, 0.98),
                "cor_10": rng.uniform(0.1, 0.95),
            }
            values = {name: float(values[name]) for name in model.parameter_names}
            spin = rng.choice([0.0, rng.uniform(-400.0, 600.0)])
            # At rest, without slip to rounding, or in flight.
            speed = rng.choice([0.0, spin * BALL.radius, rng.uniform(-5.0, 25.0)])
            impact = fitball.impacts(speed, rng.uniform(3.0, 16.0), spin)
            try:
                rebound = model.rebound(values, impact)
            except ParameterError:
                continue
            followed += 1
            found = model.history(values, impact, np.linspace(0.0, 1.0, 41) * rebound.contact_time[0])
            assert tuple(span.phase for span in found.spans) == unpack_regime(int(rebound.regime[0]))
            assert found.v_x[-1] == pytest.approx(rebound.v_x2[0], abs=1e-10)
            if chosen[3] == "shell":
                assert found.omega_2[-1] == pytest.approx(rebound.omega_2[0], abs=1e-8)
            limit = values["mu"] * found.normal_force
            assert np.all(np.abs(found.friction_force) <= limit + 1e-9 * found.peak_force.value)
    assert followed > 600


def test_drop_without_motion_along_the_court():
    model = fitball.model("two-mass", tangential=False)
    values = {name: PARAMETERS[name] for name in model.parameter_names}
    found = model.history(values, fitball.impacts(0.0, 8.0), [0.0, 1e-3])
    assert found.spans == () and found.regime_name == "" and set(found.phase) == {0}
    assert found.normal_force[1] > 0.0 and np.all(found.friction_force == 0.0)


def test_misuse_is_named():
    model = fitball.model("two-mass")
    values = {name: PARAMETERS[name] for name in model.parameter_names}
    impact = fitball.impacts(12.0, 10.0, 50.0)
    contact = float(model.rebound(values, impact).contact_time[0])
    assert model.history(values, impact, contact).times.shape == (1,)
    for times, word in (
        (math.nan, "nan"),
        (-1e-9, "-1e-09"),
        (contact * 1.01, "within the contact"),
        ([[0.0]], "shape"),
    ):
        with pytest.raises(ParameterError, match=word):
            model.history(values, impact, times)
    with pytest.raises(ParameterError, match="one value of each parameter"):
        model.history({**values, "mu": [0.5, 0.6]}, impact, 0.0)
    with pytest.raises(ParameterError, match="one impact: read 2"):
        model.history(values, fitball.impacts([12.0, 13.0], 10.0), 0.0)
    with pytest.raises(ParameterError, match="exceeds mass_ratio"):
        model.history({**values, "mass_ratio": 0.5}, impact, 0.0)
    for name in ("grip-slip", "brody", "thesis"):
        with pytest.raises(ModelError, match=f"model {name} has no (history|time axis)") as caught:
            fitball.model(name).history({}, impact, 0.0)
        assert isinstance(caught.value, FitballError)


def test_help_names_the_models_that_have_a_history_and_those_that_are_compared():
    composed = [fitball.model(name) for name in MODELS]
    assert tuple(one.name for one in composed if not one.no_history) == FOLLOWED
    assert tuple(one.name for one in composed if not one.unranked) == RANKED
