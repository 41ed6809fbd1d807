"""Expressions of a user: values, units, and what is none; nothing in them is executed."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fitball.base.errors import ParameterError
from fitball.inference.expressions import dimensions_of, expression, unit_text

UNITS = {
    "mu": "",
    "mu[clay]": "",
    "mu[hard court]": "",
    "k_y": "N/m",
    "k_theta": "N m/rad",
    "k_theta/k_y": "m^2/rad",
    "eps_10": "m",
    "eps_slope": "m/(m/s)",
    "cor_slope": "1/(m/s)",
}
DRAWS = dict(zip(UNITS, np.random.default_rng(4).uniform(0.5, 2.0, (len(UNITS), 5)), strict=True))


def value(text):
    return expression("own", text, UNITS).values(DRAWS)


@pytest.mark.parametrize(
    ("text", "expected", "unit"),
    [
        ("mu*(1 + mu[clay])", DRAWS["mu"] * (1.0 + DRAWS["mu[clay]"]), ""),
        ("mu[clay]-mu[hard court]", DRAWS["mu[clay]"] - DRAWS["mu[hard court]"], ""),
        ("-mu**2", -(DRAWS["mu"] ** 2), ""),
        ("sqrt(k_y)", np.sqrt(DRAWS["k_y"]), "N^(1/2)/m^(1/2)"),
        ("k_y**-2", DRAWS["k_y"] ** -2.0, "m^2/N^2"),
        ("k_theta/k_y", DRAWS["k_theta/k_y"], "m^2/rad"),
        ("k_theta / k_y", DRAWS["k_theta"] / DRAWS["k_y"], "m^2/rad"),
        ("eps_10 - 3*eps_slope", DRAWS["eps_10"] - 3.0 * DRAWS["eps_slope"], "m"),
        ("2*mu + 3*k_y", 2.0 * DRAWS["mu"] + 3.0 * DRAWS["k_y"], ""),
        ("2*k_y", 2.0 * DRAWS["k_y"], "N/m"),
        ("k_y - 2e4", DRAWS["k_y"] - 2e4, "N/m"),
        ("eps_slope*cor_slope", DRAWS["eps_slope"] * DRAWS["cor_slope"], "s^2/m"),
        ("log(mu) + exp(abs(-mu))", np.log(DRAWS["mu"]) + np.exp(DRAWS["mu"]), ""),
    ],
)
def test_values_and_units(text, expected, unit):
    assert value(text) == pytest.approx(expected, rel=1e-15)
    assert expression("own", text, UNITS).unit(UNITS) == unit


def test_names_are_those_used_in_order():
    assert expression("own", "mu[clay]/mu + mu", UNITS).used == ("mu[clay]", "mu")


def test_no_answer_is_no_number():
    assert np.isnan(value("log(0*mu)")).all()
    assert np.isnan(value("mu/0")).all()
    assert np.isnan(value("(-mu)**0.5")).all()


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("mu +", "derive"),
        ("", "derive"),
        ("2*3", "derive"),
        ("mu.real", "derive"),
        ("mu if mu else mu", "derive"),
        ("[mu for mu in mu]", "derive"),
        ("lambda: mu", "derive"),
        ("sqrt(mu, mu)", "derive"),
        ("sqrt(x=mu)", "derive"),
        ("mu and mu", "derive"),
        ("mu < mu", "derive"),
        ("mu @ mu", "derive"),
        ("mu % 2", "derive"),
        ("f'{mu}'", "derive"),
        ("mu*True", "derive"),
        ("mu*2j", "derive"),
        ("mu*'a'", "derive"),
        ("(mu := 3)", "derive"),
        ("__0", "derive"),
        ("mu*1" + "0" * 400, "derive"),
        ("mu + " * 200 + "mu", "derive"),
        ("__import__('os')", "derive"),
        ("open(mu)", "derive"),
        ("mu + muu", "unknown-parameter"),
        ("mu[grass]", "unknown-parameter"),
        ("cor_10*mu", "unknown-parameter"),
    ],
)
def test_what_is_none_is_refused(text, code):
    with pytest.raises(ParameterError) as caught:
        expression("own", text, UNITS)
    assert caught.value.code == code


@pytest.mark.parametrize("text", ["k_y + mu", "exp(k_y)", "k_y**mu", "mu**k_y", "log(k_y*k_y)"])
def test_units_that_do_not_agree_are_refused(text):
    with pytest.raises(ParameterError) as caught:
        expression("own", text, UNITS).unit(UNITS)
    assert caught.value.code == "derive"


def test_deep_brackets_are_no_formula():
    with pytest.raises(ParameterError):
        expression("own", "(" * 240 + "mu" + ")" * 240, UNITS)


@given(st.text("mu_ky10[]()+-*/.,'\" clay:;=", max_size=40))
def test_any_text_is_a_formula_or_refused(text):
    with suppress(ParameterError):
        assert expression("own", text, UNITS).values(DRAWS).shape == (5,)


@pytest.mark.parametrize("unit", ["", "m", "1/(m/s)", "N m/rad", "m/(m/s)", "m^2/rad"])
def test_a_unit_is_what_it_was(unit):
    assert dimensions_of(unit_text(dimensions_of(unit))) == dimensions_of(unit)
