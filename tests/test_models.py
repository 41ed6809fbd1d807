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

import fitball
from fitball.base import environment
from fitball.base.errors import FitballError
from fitball.base.values import Ball, Impacts
from fitball.models.registry import MODELS, candidates, variants
from fitball.models.specs import BALL_PARAMETERS, NAMES
from fitball.models.types import REASONS, Status

# Bounces of the edition before, held there against an event-driven integration to 1e-12.
with (Path(__file__).parent / "data" / "bounces.csv").open(encoding="utf-8") as file:
    BOUNCES = list(csv.DictReader(file))
TEXTS = list(dict.fromkeys(row["text"] for row in BOUNCES))
DROP = {"k_y": 2.0e4, "cor_10": 0.776, "cor_slope": -0.0158}
IMPACT = fitball.impacts(15.0, 8.0, -100.0)
STATES = fitball.impacts([15.0, 20.0, 5.0, 0.0], [8.0, 6.0, 11.0, 4.0], [-100.0, 200.0, 400.0, 0.0])


def typical(text, **changes):
    return {spec.name: spec.typical for spec in fitball.model(text).parameters} | changes


def arrays(rebound):
    return list(vars(rebound).values())


@pytest.mark.parametrize("text", TEXTS)
def test_bounces_are_those_of_an_event_driven_integration(text):
    rows = [row for row in BOUNCES if row["text"] == text]

    def column(name):
        return np.array([float(row[name] or "nan") for row in rows])

    model = fitball.model(text)
    names = [spec.name for spec in model.parameters]
    states = Impacts(*(column(name)[:, None] for name in ("v_x1", "v_y1", "omega_1")))
    found = model.evaluate(names, np.stack([column(name) for name in names], axis=1), states)
    speed = np.hypot(column("v_x1"), column("v_y1")) + 0.033 * abs(column("omega_1"))
    time = column("contact_time")
    scales = {"v_x2": speed, "v_y2": speed, "omega_2": speed / 0.033}
    if model.timed:
        scales |= {
            "contact_time": time,
            "gap_time": time,
            "gap_path": speed * time,
            "gap_turn": speed * time / 0.033,
        }
    else:
        assert np.isnan([found.contact_time, found.gap_time, found.gap_path, found.gap_turn]).all()
    for name, scale in scales.items():
        assert_array_less(
            abs(getattr(found, name)[:, 0] - column(name)) / scale,
            1e-12,
            err_msg=name,
        )
    regimes = [fitball.regime_name(regime).replace(", ", "-") for regime in found.regime[:, 0]]
    assert regimes == [row["regime"] for row in rows]


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
    ],
)
def test_a_composition_takes_what_acts_in_it(text, tangential, names):
    model = fitball.model(text, tangential=tangential)
    assert [spec.name for spec in model.parameters] == names.split()
    assert model.timed == ("mass" in text or "thesis" in text)
    assert model.text == text
    assert model.below == (
        (("cor_10", "mass_ratio"),) if model.options.get("normal") == "momentum" else ()
    )


def test_texts_name_what_differs_from_the_default():
    assert tuple(MODELS) == NAMES
    assert (
        fitball.model("two-mass", offset="grip", normal="momentum").text == "two-mass+offset=grip"
    )
    assert (
        fitball.model("two-mass+spin=shell+offset=grip").text == "two-mass+offset=grip+spin=shell"
    )
    for text in ("two-mass", "two-mass+normal=total+offset=grip"):
        chosen = fitball.model(text)
        others = [fitball.model(other) for other in variants(chosen)]
        assert len(others) == 7 == len({other.text for other in others})
        for other in others:
            assert sum(other.options[key] != value for key, value in chosen.options.items()) == 1
    assert variants(fitball.model("thesis-exact")) == variants(fitball.model("brody")) == ()
    assert len(variants(fitball.model(tangential=False))) == 3


def test_a_comparison_tries_what_can_differ_there():
    every = candidates(tangential=True, spin=True)
    assert every[-1] == "two-mass"
    assert len(set(every)) == len(every) == 10
    assert not any("inner" in text for text in every)
    assert set(candidates(tangential=True, spin=True, quick=True)) == set(NAMES)
    assert candidates(tangential=True, spin=False)[-1] == "brody"
    assert candidates(tangential=False, spin=False)[-1] == "two-mass+normal=total"


def rebound(**changes):
    return fitball.model().rebound(typical("two-mass", **changes), IMPACT)


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
        (
            lambda: fitball.model().rebound(
                typical("two-mass", mu=[0.5, 0.6]),
                Impacts(*np.ones((3, 3, 1))),
            ),
            "parameters",
        ),
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
    values = typical(text)
    draws = {name: [value, changes.get(name, value)] for name, value in values.items()}
    found = model.rebound(draws, STATES)
    assert found.status[0].tolist() == [0] * 4
    assert found.status[1].tolist() == [status] * 4
    assert np.isnan([found.v_x2[1], found.v_y2[1], found.omega_2[1], found.contact_time[1]]).all()
    assert np.isfinite([found.v_x2[0], found.v_y2[0], found.omega_2[0]]).all()


@pytest.mark.parametrize("text", ["two-mass", "grip-slip"])
def test_no_impact_away_from_the_court(text):
    # A restitution that is constant has a logarithm of no speed: it must be refused all the same.
    for slope in (0.0, -0.01):
        values = typical(text, cor_slope=slope)
        away = fitball.model(text).evaluate(
            list(values),
            np.array([[*values.values()]]),
            Impacts(np.full(2, 9.0), np.array([0.0, -3.0]), np.zeros(2)),
        )
        assert away.status.tolist() == [[Status.NO_IMPACT] * 2]
        assert np.isnan(away.v_y2).all()
    assert set(REASONS) == set(Status)
    assert all(REASONS[status] for status in Status if status)


@pytest.mark.parametrize("text", ["two-mass", "thesis-exact", "grip-slip", "brody"])
def test_shapes_of_numbers_draws_and_states_of_draws(text):
    model = fitball.model(text)
    values = typical(text)
    one = model.rebound(values, STATES)
    draws = model.rebound(
        dict.fromkeys(values) | {name: np.full(3, value) for name, value in values.items()},
        STATES,
    )
    mixed = model.rebound(values | {"mu": np.array([0.3, values["mu"]])}, STATES)
    own = model.rebound(
        values,
        Impacts(*(np.stack([c, c[::-1]]) for c in (STATES.v_x1, STATES.v_y1, STATES.omega_1))),
    )
    raw = model.evaluate(list(values), np.array([[*values.values()]]), STATES)
    for a, b, c, d, e in zip(*map(arrays, (one, draws, mixed, own, raw)), strict=True):
        assert a.shape == (4,)
        assert b.shape == (3, 4)
        assert c.shape == (2, 4)
        assert d.shape == (2, 4)
        assert e.shape == (1, 4)
        for other in (b[2], c[1], d[0], d[1][::-1], e[0]):
            assert_array_equal(a, other)
    assert_array_equal(one.column("v_2"), np.hypot(one.v_x2, one.v_y2))
    assert one.column("omega_2") is one.omega_2


@pytest.mark.parametrize("text", ["two-mass", "brody"])
def test_one_and_many_threads_give_the_same_bytes(text):
    rng = np.random.default_rng(1)
    values = typical(text)
    draws = np.array([*values.values()]) * (1.0 + 0.02 * rng.standard_normal((400, len(values))))
    states = fitball.impacts(
        rng.uniform(2, 30, 21),
        rng.uniform(3, 20, 21),
        rng.uniform(-400, 400, 21),
    )
    found = []
    for count in (1, 2, 3):
        with environment.threads(count):
            found.append(arrays(fitball.model(text).evaluate(list(values), draws, states)))
    assert np.isfinite(found[0][0]).mean() > 0.9
    for other in found[1:]:
        assert [array.tobytes() for array in other] == [array.tobytes() for array in found[0]]


def test_the_ball_is_the_models_or_a_parameter():
    heavy = Ball(0.0594, 0.0343, 0.54)
    for text in ("two-mass", "grip-slip"):
        values = typical(text)
        given = dict(
            zip(BALL_PARAMETERS, (heavy.mass, heavy.radius, heavy.inertia_ratio), strict=True)
        )
        model = fitball.model(text)
        found = model.rebound(values | given, STATES)
        for other in (fitball.model(text, ball=heavy), replace(model, ball=heavy)):
            for a, b in zip(arrays(found), arrays(other.rebound(values, STATES)), strict=True):
                assert_array_equal(a, b)
        assert abs(found.v_x2 - model.rebound(values, STATES).v_x2).max() > 1e-3


def test_a_measured_restitution_replaces_the_law():
    measured = np.array([0.7, 0.75, 0.8, np.nan])
    for text in ("thesis-exact", "grip-slip"):
        model = fitball.model(text)
        values = typical(text)
        names = list(values)
        row = np.array([[*values.values()]])
        found = model.evaluate(names, row, STATES, measured)
        law = model.evaluate(names, row, STATES)
        assert_allclose(found.v_y2[0, :3], measured[:3] * STATES.v_y1[:3], rtol=1e-15)
        assert found.v_y2[0, 3] == law.v_y2[0, 3]
        same = model.evaluate(names, row, STATES, law.v_y2[0] / STATES.v_y1)
        assert_allclose(same.v_x2, law.v_x2, rtol=1e-12, atol=1e-12)


def test_a_drop_moves_vertically_alone():
    model = fitball.model("two-mass+normal=total+release=zero_displacement", tangential=False)
    found = model.rebound(DROP, STATES)
    assert_array_equal(found.v_x2, STATES.v_x1)
    assert_allclose(found.omega_2, STATES.omega_1, rtol=1e-15)
    assert found.regime.tolist() == [0] * 4
    assert model.history(DROP, IMPACT, np.array([0.0, 1e-3])).phase.tolist() == [0, 0]
    # A damped half period of the whole mass: e = exp(-pi zeta/sqrt(1 - zeta^2)).
    log_e = np.log(found.v_y2 / STATES.v_y1)
    zeta = -log_e / np.hypot(math.pi, log_e)
    frequency = np.sqrt(2.0e4 / Ball().mass)
    assert_allclose(
        found.contact_time,
        math.pi / (frequency * np.sqrt(1.0 - zeta**2)),
        rtol=1e-14,
    )
