"""Impacts that are hard to solve against answers of fifty digits, and the ends of all ranges."""

import csv

import numpy as np
import pytest
from support import answers, taylor
from support.answers import IMPACT, PARAMETERS
from support.taylor import OUTPUTS

import fitball
from fitball.base.values import Impacts
from fitball.models.specs import SPECS

with answers.PLACE.open(encoding="utf-8") as file:
    CASES = {row["name"]: row for row in csv.DictReader(file)}
# Of the scale of an output, besides twice what one rounding of each input makes (column
# `rounding`).
ROUNDING = 1e-15
# A free phase of 1e-8 of the contact, which may be named or not.
FLEETING = {"restitution 1 less 1e-15 of the whole mass": "5231"}


def solved(row, **changes):
    """The kernel's answers (draws, 1), without the checks of a direct call."""
    chosen = fitball.model("+".join(["two-mass", *filter(None, [row["options"]])]))
    values = {
        spec.name: changes.get(spec.name, float(row[spec.name])) for spec in chosen.parameters
    }
    draws = np.stack(np.broadcast_arrays(*map(np.atleast_1d, values.values())), axis=-1)
    return chosen.evaluate(
        list(values),
        draws,
        Impacts(*(np.array([float(row[name])]) for name in IMPACT)),
    )


@pytest.mark.parametrize("name", CASES)
def test_hard_case(name):
    row = CASES[name]
    found = solved(CASES[name])
    assert found.status[0, 0] == 0
    bound = ROUNDING + 2.0 * float(row["rounding"])
    sizes = answers.scales([row[k] for k in IMPACT], row["contact_time"], row["gap_time"])
    for output, size in zip(OUTPUTS, sizes, strict=True):
        assert abs(getattr(found, output)[0, 0] - float(row[output])) <= bound * size, output
    assert f"{found.regime[0, 0]:o}" in (row["regime"], FLEETING.get(name))


def test_the_answers_are_those_of_the_oracle():
    """Some of them made again: all digits."""
    assert len(CASES) == 108
    for name in list(CASES)[::12]:
        row = CASES[name]
        values = {key: float(row[key]) for key in PARAMETERS if row[key]}
        impact = [float(row[key]) for key in IMPACT]
        made = taylor.solve(answers.options_of(row), values, impact, kind=taylor.FIFTY)
        assert [repr(float(getattr(made, output))) for output in OUTPUTS] == [
            row[output] for output in OUTPUTS
        ]


@pytest.mark.parametrize("name", [name for name in CASES if name.endswith("1e-9 before")])
def test_marching_over_a_boundary(name):
    """At steps of 1e-12 in friction, or in what the edge is of, no output jumps."""
    row = CASES[name]
    key = "cor_10" if name.startswith("restitution") else "mu"
    edge = float(row[key]) / (1.0 - 1e-9)
    found = solved(row, **{key: edge * (1.0 + np.linspace(-2e-9, 2e-9, 4001))})
    assert len(set(found.regime[:, 0].tolist())) > 1
    sizes = answers.scales([row[k] for k in IMPACT], row["contact_time"], row["gap_time"])
    for output, size in zip(OUTPUTS, sizes, strict=True):
        # What sets in or breaks does so with the square root of the distance at worst.
        assert np.max(np.abs(np.diff(getattr(found, output)[:, 0]))) < 1e-9 * size


def test_a_shell_of_rounding_alone_has_the_answers_of_a_light_one():
    """Its twist is so fast that a series of it would have no end."""
    rng = np.random.default_rng(4)
    chosen = fitball.model("two-mass")
    values = {
        "k_y": 2e4,
        "k_theta": 20.0,
        "mu": 0.57,
        "eps_10": 2e-3,
        "eps_slope": 0.0,
        "cor_10": 0.775,
    }
    names = ["mass_ratio", *values, "cor_slope"]
    ratio = 1.0 - np.array([1e-9, 1e-12, 1e-14, 1e-15])
    sets = np.stack([ratio, *(np.full(4, one) for one in (*values.values(), -0.01))], axis=1)
    angle = rng.uniform(0.2, 1.3, 200)
    states = fitball.impacts(
        20.0 * np.cos(angle),
        20.0 * np.sin(angle),
        rng.uniform(-400.0, 400.0, 200),
    )
    found = chosen.evaluate(names, sets, states)
    assert np.all(found.status == 0)
    # What a shell does to the rest goes with the root of its mass.
    apart = np.max(np.abs(found.v_x2[:3] - found.v_x2[3]), axis=1)
    assert np.all(apart < 100.0 * np.sqrt(1.0 - ratio[:3]))


@pytest.mark.parametrize(
    "options",
    ["", "+torsion=free", "+offset=grip", "+inertia=table", "+normal=total"],
)
def test_anything_within_bounds_is_solved_or_refused(options):
    """Over the whole range of every parameter, its edges included."""
    chosen = fitball.model(f"two-mass{options}")
    rng = np.random.default_rng(5)
    columns = []
    for spec in (SPECS[one.name] for one in chosen.parameters):
        if spec.lower > 0.0 and spec.upper > 50.0 * spec.lower:
            columns.append(np.exp(rng.uniform(np.log(spec.lower), np.log(spec.upper), 1000)))
        else:
            near = (spec.upper - spec.lower) * 10.0 ** rng.uniform(-16.0, 0.0, 1000)
            columns.append(np.where(rng.random(1000) < 0.5, spec.upper - near, spec.lower + near))
    sign = rng.choice([-1.0, 1.0], (2, 4))
    speeds = fitball.impacts(
        sign[0] * 10.0 ** rng.uniform(-6.0, 2.0, 4),
        10.0 ** rng.uniform(-2.0, 2.0, 4),
        sign[1] * 10.0 ** rng.uniform(-3.0, 4.0, 4),
    )
    found = chosen.evaluate(
        [spec.name for spec in chosen.parameters],
        np.stack(columns, axis=1),
        speeds,
    )
    good = found.status == 0
    assert 0.05 < good.mean() < 0.95
    for output in OUTPUTS:
        assert np.array_equal(np.isfinite(getattr(found, output)), good)


@pytest.mark.parametrize("eps", [4.6e-3, -4.6e-3])
def test_an_elastic_ball_that_lands_without_slip_is_held(eps):
    """All forces begin at zero: only their rates tell that no grip with the offset is possible, and
    on which side.
    """
    chosen = fitball.model("two-mass+normal=total+torsion=free+offset=grip")
    values = {
        "mass_ratio": 0.8,
        "k_y": 2e4,
        "k_theta": 20.0,
        "mu": 1e-3,
        "eps_10": eps,
        "eps_slope": 0.0,
    }
    values |= {"cor_10": 1.0, "cor_slope": 0.0, "zeta_theta": 0.3}
    found = chosen.rebound(values, fitball.impacts(0.0, 10.0))
    assert f"{found.regime[0]:o}" == "4"
    assert found.v_x2[0] == 0.0
    assert found.omega_2[0] == 0.0
