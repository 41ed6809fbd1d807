"""Impacts that are hard to solve against answers of fifty digits, and the ends of all ranges."""

import csv

import numpy as np
import pytest
from support import answers, taylor, taylor_series
from support.answers import IMPACT, PARAMETERS
from support.taylor import OUTPUTS

import fitball
from fitball.base.values import Ball, Impacts
from fitball.models.specs import SPECS

with answers.HARD_CASES.open(encoding="utf-8") as file:
    CASES = {row["name"]: row for row in csv.DictReader(file)}
# The ball of the cases.
BALL = Ball(*taylor.BALL)
# Of the scale of an output, besides twice what one rounding of each input makes (column
# `rounding`).
ROUNDING = 1e-15
# A free phase of 1e-8 of the contact, which may be named or not.
FLEETING = {"restitution 1 less 1e-15 of the whole mass": "5231"}


def solved(row, **changes):
    """The kernel's answers (draws, 1), without the checks of a direct call."""
    text = "two-mass"
    if row["options"]:
        text += "+" + row["options"]
    model = fitball.model(text, ball=BALL)
    columns = []
    for spec in model.parameters:
        values = changes.get(spec.name, float(row[spec.name]))
        columns.append(np.atleast_1d(values))
    draws = np.stack(np.broadcast_arrays(*columns), axis=-1)
    names = [spec.name for spec in model.parameters]
    impact = Impacts(*(np.array([float(row[name])]) for name in IMPACT))
    return model.solve(model.ball, names, draws, impact, None)


def sizes_of(row):
    """By output what its errors are relative to."""
    impact = [row[name] for name in IMPACT]
    sizes = answers.scales(impact, row["contact_time"], row["gap_time"])
    return dict(zip(OUTPUTS, sizes, strict=True))


@pytest.mark.parametrize("name", CASES)
def test_hard_case(name):
    row = CASES[name]
    rebound = solved(row)
    assert rebound.status[0, 0] == 0
    bound = ROUNDING + 2.0 * float(row["rounding"])
    for output, size in sizes_of(row).items():
        answer = getattr(rebound, output)[0, 0]
        assert abs(answer - float(row[output])) <= bound * size, output
    assert f"{rebound.regime[0, 0]:o}" in (row["regime"], FLEETING.get(name))


def test_the_answers_are_those_of_the_oracle():
    """Some of them made again: all digits."""
    assert len(CASES) == 108
    for name in list(CASES)[::12]:
        row = CASES[name]
        values = {key: float(row[key]) for key in PARAMETERS if row[key]}
        impact = [float(row[key]) for key in IMPACT]
        options = answers.options_of(row)
        answer = taylor.solve(options, values, impact, kind=taylor_series.FIFTY)
        for output in OUTPUTS:
            assert repr(float(getattr(answer, output))) == row[output]


@pytest.mark.parametrize("name", [name for name in CASES if name.endswith("1e-9 before")])
def test_marching_over_a_boundary(name):
    """At steps of 1e-12 in friction, or in what the edge is of, no output jumps."""
    row = CASES[name]
    key = "cor_10" if name.startswith("restitution") else "mu"
    edge = float(row[key]) / (1.0 - 1e-9)
    across = edge * (1.0 + np.linspace(-2e-9, 2e-9, 4001))
    rebound = solved(row, **{key: across})
    assert np.unique(rebound.regime[:, 0]).size > 1
    for output, size in sizes_of(row).items():
        # What sets in or breaks does so with the square root of the distance at worst.
        jumps = np.abs(np.diff(getattr(rebound, output)[:, 0]))
        assert jumps.max() < 1e-9 * size


def test_a_shell_of_rounding_alone_has_the_answers_of_a_light_one():
    """Its twist is so fast that a series of it would have no end."""
    rng = np.random.default_rng(4)
    ratio = 1.0 - np.array([1e-9, 1e-12, 1e-14, 1e-15])
    values = {
        "mass_ratio": ratio,
        "k_y": 2e4,
        "k_theta": 20.0,
        "mu": 0.57,
        "eps_10": 2e-3,
        "eps_slope": 0.0,
        "cor_10": 0.775,
        "cor_slope": -0.01,
    }
    draws = np.stack(np.broadcast_arrays(*values.values()), axis=1)
    angle = rng.uniform(0.2, 1.3, 200)
    spin = rng.uniform(-400.0, 400.0, 200)
    states = fitball.impacts(20.0 * np.cos(angle), 20.0 * np.sin(angle), spin)
    rebound = fitball.model("two-mass", ball=BALL).evaluate(list(values), draws, states)
    assert np.all(rebound.status == 0)
    # What a shell does to the rest goes with the root of its mass.
    *heavier, lightest = rebound.v_x2
    apart = np.abs(np.array(heavier) - lightest)
    assert np.all(apart.max(axis=1) < 100.0 * np.sqrt(1.0 - ratio[:3]))


@pytest.mark.parametrize(
    "options",
    ["", "+torsion=free", "+offset=grip", "+inertia=table", "+normal=total"],
)
def test_anything_within_bounds_is_solved_or_refused(options):
    """Over the whole range of every parameter, its edges included."""
    model = fitball.model(f"two-mass{options}", ball=BALL)
    names = [spec.name for spec in model.parameters]
    rng = np.random.default_rng(5)
    columns = [anywhere_within(SPECS[name], rng) for name in names]
    sign_of_v, sign_of_spin = rng.choice([-1.0, 1.0], (2, 4))
    v_x = sign_of_v * 10.0 ** rng.uniform(-6.0, 2.0, 4)
    v_y = 10.0 ** rng.uniform(-2.0, 2.0, 4)
    spin = sign_of_spin * 10.0 ** rng.uniform(-3.0, 4.0, 4)
    draws = np.stack(columns, axis=1)
    rebound = model.evaluate(names, draws, fitball.impacts(v_x, v_y, spin))
    good = rebound.status == 0
    assert 0.05 < good.mean() < 0.95
    for output in OUTPUTS:
        finite = np.isfinite(getattr(rebound, output))
        assert np.array_equal(finite, good)


def anywhere_within(spec, rng):
    """A thousand values within the bounds of a parameter, many of them close to one of the two."""
    if spec.lower > 0.0 and spec.upper > 50.0 * spec.lower:
        logarithms = rng.uniform(np.log(spec.lower), np.log(spec.upper), 1000)
        return np.exp(logarithms)
    distance = (spec.upper - spec.lower) * 10.0 ** rng.uniform(-16.0, 0.0, 1000)
    at_upper = rng.random(1000) < 0.5
    return np.where(at_upper, spec.upper - distance, spec.lower + distance)


@pytest.mark.parametrize("eps", [4.6e-3, -4.6e-3])
def test_an_elastic_ball_that_lands_without_slip_is_held(eps):
    """All forces begin at zero: only their rates tell that no grip with the offset is possible, and
    on which side.
    """
    model = fitball.model("two-mass+normal=total+torsion=free+offset=grip", ball=BALL)
    values = {
        "mass_ratio": 0.8,
        "k_y": 2e4,
        "k_theta": 20.0,
        "mu": 1e-3,
        "eps_10": eps,
        "eps_slope": 0.0,
        "cor_10": 1.0,
        "cor_slope": 0.0,
        "zeta_theta": 0.3,
    }
    draw = np.array([[*values.values()]])
    rebound = model.solve(model.ball, [*values], draw, fitball.impacts(0.0, 10.0), None)
    assert f"{rebound.regime[0, 0]:o}" == "4"
    assert rebound.v_x2[0, 0] == 0.0
    assert rebound.omega_2[0, 0] == 0.0
