"""What the likelihood of a design pins, against closed forms and what is known of the bounce."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import GRIP_SLIP, TWO_MASS, drop_table, linear_problem, problem_of
from validation.trust import BEYOND, PINNED, pinned

LINE = {"cor_10": 0.76, "cor_slope": -0.014, "velocity_sd": 0.05}


def at_speeds(speeds, **scene):
    table = drop_table(np.random.default_rng(1), count=len(speeds))
    return linear_problem(replace(table, impacts=type(table.impacts)(0.0 * speeds, speeds, 0.0 * speeds)), **scene)


@pytest.mark.parametrize("noise", [0.05, 0.5, 2.0, 5.0])
def test_a_line_is_pinned_where_least_squares_say_so(noise):
    """Uniform priors over 1 and 0.2: half of their sds against the standard errors, which do not depend on y."""
    problem = at_speeds(np.linspace(3.0, 14.0, 9))
    v = problem.impacts.v_y1
    x = np.stack([v, v * (v - 10.0)], axis=1)
    errors = noise * np.sqrt(np.diag(np.linalg.inv(x.T @ x)))
    found = pinned(problem, LINE | {"velocity_sd": noise})
    for name, error, sd in zip(("cor_10", "cor_slope"), errors, np.array([1.0, 0.2]) * 12.0**-0.5, strict=True):
        # Near the limit either may be said: a restitution ends at 0 and 1, which no formula of a line has.
        if error < 0.4 * sd:
            assert found[name] is True, name
        elif error > 0.9 * sd:
            assert found[name] is not True, name


def test_one_speed_pins_no_line_however_many_rows():
    found = pinned(at_speeds(np.full(9, 7.0)), LINE)
    assert found["cor_10"] is False
    assert found["velocity_sd"] is True
    assert pinned(at_speeds(np.array([6.9, 7.0, 7.1] * 3)), LINE | {"velocity_sd": 0.01})["cor_10"] is not False


def test_what_never_moves_a_rebound_is_not_pinned_and_what_moves_all_is():
    """Without friction no ball grips; the restitution along the court plays no part."""
    problem = problem_of("wang_all.csv", "grip-slip", without=("mu",), priors={"mu": "uniform(0, 2)"})
    found = pinned(problem, {**GRIP_SLIP, "mu": 0.0})
    assert found["e_x"] is False
    assert found["cor_10"] is found["offset"] is True
    assert pinned(problem, GRIP_SLIP)["e_x"] is True


def test_what_only_the_scene_tells_is_neither_pinned_nor_beyond_knowledge():
    timed, untimed = (problem_of("wang_all.csv", without=names) for names in ((), ("contact_time",)))
    known, unknown = (pinned(problem, TWO_MASS) for problem in (timed, untimed))
    assert known["k_y"] is None and unknown["k_y"] is False
    for name in ("mu", "mass_ratio", "eps_10", "cor_10"):
        assert known[name] is unknown[name] is True


def test_a_table_is_asked_without_its_own_noise():
    """Measurements play no part, only incidence, truth and noise."""
    problem = at_speeds(np.linspace(3.0, 14.0, 9))
    wild = replace(
        problem, observables=tuple(replace(one, observed=0.0 * one.observed) for one in problem.observables)
    )
    assert pinned(problem, LINE) == pinned(wild, LINE)
    assert PINNED > BEYOND
