"""Models by name: bounces of an event-driven integration, options, errors by code, statuses,
shapes, threads.
"""

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal, assert_array_less
from support import taylor

import fitball
from fitball.base import environment
from fitball.base.errors import FitballError
from fitball.base.values import Ball, Impacts
from fitball.models.registry import MODELS, candidates, option_variants
from fitball.models.specs import BALL_PARAMETERS, MODEL_NAMES
from fitball.models.types import REASONS, Status

# Bounces of the edition before, held there against an event-driven integration to 1e-12.
with (Path(__file__).parent / "data" / "bounces.csv").open(encoding="utf-8") as file:
    BOUNCES = list(csv.DictReader(file))
TEXTS = list(dict.fromkeys(row["text"] for row in BOUNCES))
DROP = {"k_y": 2.0e4, "cor_10": 0.776, "cor_slope": -0.0158}
IMPACT = fitball.impacts(15.0, 8.0, -100.0)
STATES = fitball.impacts([15.0, 20.0, 5.0, 0.0], [8.0, 6.0, 11.0, 4.0], [-100.0, 200.0, 400.0, 0.0])


def typical(text, **changes):
    parameters = fitball.model(text).parameters
    return {spec.name: spec.typical for spec in parameters} | changes


def arrays(rebound):
    return list(vars(rebound).values())


def single_draw(values):
    """Values of a single draw as `evaluate` takes them, (1, names)."""
    return np.array([[*values.values()]])


@pytest.mark.parametrize("text", TEXTS)
def test_bounces_are_those_of_an_event_driven_integration(text):
    rows = [row for row in BOUNCES if row["text"] == text]

    def column(name):
        return np.array([float(row[name] or "nan") for row in rows])

    model = fitball.model(text, ball=Ball(*taylor.BALL))
    names = [spec.name for spec in model.parameters]
    values = np.stack([column(name) for name in names], axis=1)
    v_x1 = column("v_x1")
    v_y1 = column("v_y1")
    omega_1 = column("omega_1")
    states = Impacts(v_x1[:, None], v_y1[:, None], omega_1[:, None])
    rebounds = model.evaluate(names, values, states)
    speed = np.hypot(v_x1, v_y1) + 0.033 * abs(omega_1)
    time = column("contact_time")
    scales = {
        "v_x2": speed,
        "v_y2": speed,
        "omega_2": speed / 0.033,
    }
    of_contact = {
        "contact_time": time,
        "gap_time": time,
        "gap_path": speed * time,
        "gap_turn": speed * time / 0.033,
    }
    if model.timed:
        scales |= of_contact
    else:
        for name in of_contact:
            assert np.isnan(getattr(rebounds, name)).all(), name
    for name, scale in scales.items():
        error = abs(getattr(rebounds, name)[:, 0] - column(name))
        assert_array_less(error / scale, 1e-12, err_msg=name)
    for regime, row in zip(rebounds.regime[:, 0], rows, strict=True):
        assert fitball.regime_name(regime).replace(", ", "-") == row["regime"]


@pytest.mark.parametrize(
    ("text", "tangential", "names"),
    [
        ("two-mass", True, "mass_ratio k_y k_theta mu eps_10 eps_slope cor_10 cor_slope"),
        (
            "two-mass+torsion=free",
            True,
            "mass_ratio k_y k_theta mu eps_10 eps_slope cor_10 cor_slope zeta_theta",
        ),
        (
            "two-mass+normal=total+inertia=table",
            True,
            "k_y k_theta mu eps_10 eps_slope cor_10 cor_slope inertia_split",
        ),
        ("two-mass+torsion=free+inertia=table", False, "mass_ratio k_y cor_10 cor_slope"),
        ("two-mass+normal=total", False, "k_y cor_10 cor_slope"),
        ("thesis-exact", True, "mass_ratio k_y k_theta mu eps_10 eps_slope cor_10 cor_slope"),
        ("grip-slip", True, "mu e_x offset cor_10 cor_slope"),
        ("brody", False, "cor_10 cor_slope"),
        ("brody+cor=power", True, "mu cor_10 cor_slope"),
        ("grip-slip+cor=root", True, "mu e_x offset cor_10"),
        ("two-mass+normal=total+cor=root", False, "k_y cor_10"),
    ],
)
def test_a_composition_takes_what_acts_in_it(text, tangential, names):
    model = fitball.model(text, tangential=tangential)
    assert [spec.name for spec in model.parameters] == names.split()
    assert model.timed == ("mass" in text or "thesis" in text)
    assert model.text == text
    if model.options.get("normal") == "momentum":
        assert model.below == (("cor_10", "mass_ratio"),)
    else:
        assert model.below == ()


def test_texts_name_what_differs_from_the_default():
    assert tuple(MODELS) == MODEL_NAMES
    by_options = fitball.model("two-mass", offset="grip", normal="momentum")
    assert by_options.text == "two-mass+offset=grip"
    unordered = fitball.model("two-mass+spin=shell+offset=grip")
    assert unordered.text == "two-mass+offset=grip+spin=shell"
    for text in ("two-mass", "two-mass+normal=total+offset=grip"):
        chosen = fitball.model(text)
        others = [fitball.model(other) for other in option_variants(chosen)]
        assert len(others) == 10
        assert len({other.text for other in others}) == 10
        for other in others:
            different = [key for key in chosen.options if other.options[key] != chosen.options[key]]
            assert len(different) == 1
    assert option_variants(fitball.model("thesis-exact")) == ()
    laws = tuple(f"brody+cor={law}" for law in ("power", "line", "root"))
    assert option_variants(fitball.model("brody")) == laws
    assert len(option_variants(fitball.model(tangential=False))) == 6


def test_a_comparison_tries_what_can_differ_there():
    every = candidates(tangential=True, spin=True)
    assert every[-1] == "two-mass"
    # All models, and what differs from the default in one option, but normal=inner and cor=root.
    assert len(every) == len(MODEL_NAMES) + 8
    assert len(set(every)) == len(every)
    assert not any("inner" in text for text in every)
    quick = candidates(tangential=True, spin=True, quick=True)
    assert set(quick) == set(MODEL_NAMES)
    assert candidates(tangential=True, spin=False)[-1] == "brody"
    assert candidates(tangential=False, spin=False)[-1] == "two-mass+normal=total"


def rebound(impact=IMPACT, **changes):
    return fitball.model().rebound(typical("two-mass", **changes), impact)


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (lambda: fitball.model("nobody"), "unknown-model"),
        (lambda: fitball.model("two-mass+offsett=grip"), "unknown-option"),
        (lambda: fitball.model("two-mass+offset=grab"), "unknown-option"),
        (lambda: fitball.model("two-mass+offset"), "unknown-option"),
        (lambda: fitball.model("thesis-exact", offset="contact"), "unknown-option"),
        (lambda: fitball.model().rebound({}, IMPACT), "parameters"),
        (lambda: rebound(e_x=0.1), "parameters"),
        (lambda: rebound(mu="much"), "parameters"),
        (lambda: rebound(mu=[[0.5]]), "parameters"),
        (lambda: rebound(mu=[0.5, 0.6], k_y=[1e4] * 3), "parameters"),
        (lambda: rebound(Impacts(*np.ones((3, 3, 1))), mu=[0.5, 0.6]), "parameters"),
        (lambda: rebound(mu=-0.1), "out-of-bounds"),
        (lambda: rebound(mu=[0.5, 5.1]), "out-of-bounds"),
        (lambda: rebound(mu=np.nan), "out-of-bounds"),
        (lambda: rebound(ball_mass=0.0), "out-of-bounds"),
        (lambda: rebound(cor_10=0.9), "no-answer"),
        (lambda: fitball.regime_name(6), "regime"),
        (lambda: fitball.regime_name(-1), "regime"),
    ],
)
def test_misuse_has_a_code(call, code):
    with pytest.raises(FitballError) as caught:
        call()
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("text", "changes", "status"),
    [
        ("two-mass", {"cor_10": 0.88}, Status.COR_EXCEEDS_MASS_RATIO),
        ("two-mass+normal=total", {"cor_10": 0.0}, Status.COR_OUT_OF_RANGE),
        ("grip-slip", {"cor_10": 0.0}, Status.COR_OUT_OF_RANGE),
        ("two-mass", {"k_theta": 0.1}, Status.TORSION_TOO_SOFT),
        ("two-mass", {"mass_ratio": 1.0}, Status.NO_INERTIA),
        ("two-mass", {"cor_slope": -0.08}, Status.REBOUND_FALLS),
        ("brody", {"cor_slope": -0.08}, Status.REBOUND_FALLS),
    ],
)
def test_what_has_no_answer_is_nan_with_a_status(text, changes, status):
    model = fitball.model(text)
    draws = typical(text)
    for name, value in changes.items():
        draws[name] = [draws[name], value]
    rebounds = model.rebound(draws, STATES)
    assert rebounds.status[0].tolist() == [0] * 4
    assert rebounds.status[1].tolist() == [status] * 4
    for name in ("v_x2", "v_y2", "omega_2"):
        assert np.isfinite(getattr(rebounds, name)[0]).all()
        assert np.isnan(getattr(rebounds, name)[1]).all()
    assert np.isnan(rebounds.contact_time[1]).all()


@pytest.mark.parametrize("text", ["two-mass", "grip-slip"])
def test_no_impact_away_from_the_court(text):
    # A restitution that is constant has a logarithm of no speed: it must be refused all the same.
    impacts = Impacts(np.full(2, 9.0), np.array([0.0, -3.0]), np.zeros(2))
    for slope in (0.0, -0.01):
        values = typical(text, cor_slope=slope)
        away = fitball.model(text).evaluate(list(values), single_draw(values), impacts)
        assert away.status.tolist() == [[Status.NO_IMPACT] * 2]
        assert np.isnan(away.v_y2).all()
    assert set(REASONS) == set(Status)
    assert all(REASONS[status] for status in Status if status)


@pytest.mark.parametrize("text", ["two-mass", "thesis-exact", "grip-slip", "brody"])
def test_shapes_of_numbers_draws_and_states_of_draws(text):
    model = fitball.model(text)
    values = typical(text)
    of_numbers = model.rebound(values, STATES)
    three_draws = {name: np.full(3, value) for name, value in values.items()}
    of_draws = model.rebound(three_draws, STATES)
    two_frictions = values | {"mu": np.array([0.3, values["mu"]])}
    of_both = model.rebound(two_frictions, STATES)
    # Each draw has states of its own.
    states = Impacts(
        np.stack([STATES.v_x1, STATES.v_x1[::-1]]),
        np.stack([STATES.v_y1, STATES.v_y1[::-1]]),
        np.stack([STATES.omega_1, STATES.omega_1[::-1]]),
    )
    of_states = model.rebound(values, states)
    raw = model.evaluate(list(values), single_draw(values), STATES)
    for name, wanted in vars(of_numbers).items():
        assert wanted.shape == (4,)
        assert getattr(of_draws, name).shape == (3, 4)
        assert getattr(of_both, name).shape == (2, 4)
        assert getattr(of_states, name).shape == (2, 4)
        assert getattr(raw, name).shape == (1, 4)
        assert_array_equal(getattr(of_draws, name)[2], wanted)
        assert_array_equal(getattr(of_both, name)[1], wanted)
        assert_array_equal(getattr(of_states, name)[0], wanted)
        assert_array_equal(getattr(of_states, name)[1], wanted[::-1])
        assert_array_equal(getattr(raw, name)[0], wanted)
    speed = np.hypot(of_numbers.v_x2, of_numbers.v_y2)
    assert_array_equal(of_numbers.column("v_2"), speed)
    assert of_numbers.column("omega_2") is of_numbers.omega_2


@pytest.mark.parametrize("text", ["two-mass", "brody"])
def test_one_and_many_threads_give_the_same_bytes(text):
    rng = np.random.default_rng(1)
    values = typical(text)
    scatter = 1.0 + 0.02 * rng.standard_normal((400, len(values)))
    draws = single_draw(values) * scatter
    states = fitball.impacts(
        rng.uniform(2, 30, 21),
        rng.uniform(3, 20, 21),
        rng.uniform(-400, 400, 21),
    )
    model = fitball.model(text)

    def with_threads(count):
        with environment.threads(count):
            return arrays(model.evaluate(list(values), draws, states))

    with_single_thread = with_threads(1)
    assert np.isfinite(with_single_thread[0]).mean() > 0.9
    for count in (2, 3):
        for array, wanted in zip(with_threads(count), with_single_thread, strict=True):
            assert array.tobytes() == wanted.tobytes()


def test_the_ball_is_the_models_or_a_parameter():
    heavy = Ball(0.0594, 0.0343, 0.54)
    for text in ("two-mass", "grip-slip"):
        values = typical(text)
        model = fitball.model(text)
        constants = (heavy.mass, heavy.radius, heavy.inertia_ratio)
        as_parameters = dict(zip(BALL_PARAMETERS, constants, strict=True))
        rebounds = model.rebound(values | as_parameters, STATES)
        for other in (fitball.model(text, ball=heavy), replace(model, ball=heavy)):
            wanted = other.rebound(values, STATES)
            for first, second in zip(arrays(rebounds), arrays(wanted), strict=True):
                assert_array_equal(first, second)
        usual = model.rebound(values, STATES)
        assert abs(rebounds.v_x2 - usual.v_x2).max() > 1e-3


def test_a_measured_restitution_replaces_the_law():
    measured = np.array([0.7, 0.75, 0.8, np.nan])
    for text in ("thesis-exact", "grip-slip"):
        model = fitball.model(text)
        values = typical(text)
        names = list(values)
        row = single_draw(values)
        rebounds = model.evaluate(names, row, STATES, measured)
        law = model.evaluate(names, row, STATES)
        assert_allclose(rebounds.v_y2[0, :3], measured[:3] * STATES.v_y1[:3], rtol=1e-15)
        assert rebounds.v_y2[0, 3] == law.v_y2[0, 3]
        same = model.evaluate(names, row, STATES, law.v_y2[0] / STATES.v_y1)
        assert_allclose(same.v_x2, law.v_x2, rtol=1e-12, atol=1e-12)


def test_a_drop_moves_vertically_alone():
    model = fitball.model("two-mass+normal=total+release=zero_displacement", tangential=False)
    rebounds = model.rebound(DROP, STATES)
    assert_array_equal(rebounds.v_x2, STATES.v_x1)
    assert_allclose(rebounds.omega_2, STATES.omega_1, rtol=1e-15)
    assert rebounds.regime.tolist() == [0] * 4
    assert model.history(DROP, IMPACT, np.array([0.0, 1e-3])).phase.tolist() == [0, 0]
    # A damped half period of the whole mass: e = exp(-pi zeta/sqrt(1 - zeta^2)).
    log_e = np.log(rebounds.v_y2 / STATES.v_y1)
    zeta = -log_e / np.hypot(math.pi, log_e)
    frequency = np.sqrt(2.0e4 / Ball().mass)
    half_period = math.pi / (frequency * np.sqrt(1.0 - zeta**2))
    assert_allclose(rebounds.contact_time, half_period, rtol=1e-14)
