"""The law `cor = saturating`: bounded and growing at every speed, its slope, limits, walls, and a fit."""

from __future__ import annotations

import numpy as np
import pytest
from samples import TWO_MASS, problem_of
from scipy.optimize import root

import fitball
from fitball.errors import ParameterError
from fitball.inference.comparison.compare import as_container
from fitball.inference.prediction.reach import HIGHEST, LOWEST, valid_range
from fitball.inference.results.fitted_model import FittedModel
from fitball.models.kernels.vertical import saturating_restitution
from fitball.models.registry import model
from fitball.models.types import STATUS_REASON, Status

SPEEDS = np.geomspace(1e-3, 1e3, 241)
VALUES = {
    "mass_ratio": 0.874, "k_y": 1.9e4, "k_theta": 17.5, "mu": 0.567, "eps_10": 2.4e-3, "eps_slope": 0.0,
    "cor_10": 0.776, "cor_slope": -0.0157,
}  # fmt: skip


def law(cor_10, slope, cap, speeds=SPEEDS):
    return np.array([saturating_restitution(cor_10, slope, cap, float(speed)) for speed in speeds])


def test_it_is_bounded_and_the_rebound_grows_whatever_the_parameters():
    rng = np.random.default_rng(5)
    for _ in range(300):
        cap = rng.uniform(0.3, 1.0)
        cor_10 = cap * rng.uniform(0.05, 0.99)
        # The share of -cor_10/10 by which it falls at 10 m/s; a fifth of them rise.
        share = 1.0 - 10.0 ** rng.uniform(-3.0, 0.0) if rng.uniform() < 0.8 else -rng.uniform(0.0, 0.5)
        found = law(cor_10, -share * cor_10 / 10.0, cap)
        assert np.all((found > 0.0) & (found <= cap))
        rebound = found * SPEEDS
        # What has saturated grows by less than rounding.
        assert np.all(np.diff(rebound) >= -1e-14 * rebound[1:])


def test_it_has_the_value_and_the_slope_that_its_parameters_say():
    for cor_10, slope, cap in ((0.776, -0.0157, 0.874), (0.7, -0.06, 1.0), (0.7, 0.01, 0.9), (0.7, 0.0, 0.8)):
        low, at, high = law(cor_10, slope, cap, (10.0 - 1e-4, 10.0, 10.0 + 1e-4))
        assert at == pytest.approx(cor_10, rel=1e-14)
        assert (high - low) / 2e-4 == pytest.approx(slope, rel=1e-6, abs=1e-9)


def test_its_ends_are_the_cap_and_a_limit_of_the_rebound_speed():
    """By `v_0` and `q`, which the code does not use: `e = (1 + (v/v_0)^q)^(-1/q)`."""
    cor_10, slope, cap = 0.776, -0.0157, 0.874
    fall = -10.0 * slope / cor_10
    q = np.log(1.0 - fall) / np.log(cor_10 / cap)
    v_0 = 10.0 * ((1.0 - fall) / fall) ** (1.0 / q)
    found = law(cor_10, slope, cap)
    np.testing.assert_allclose(found, cap * (1.0 + (SPEEDS / v_0) ** q) ** (-1.0 / q), rtol=1e-13)
    assert found[0] == pytest.approx(cap, rel=1e-6)
    assert found[-1] * SPEEDS[-1] == pytest.approx(cap * v_0, rel=1e-3)
    # Through what is known of tennis balls, 0.75 at 6 m/s and 0.65 at 15 m/s, and on to a drop and a serve.
    through = root(lambda p: law(p[0], p[1], 1.0, (6.0, 15.0)) - [0.75, 0.65], [0.7, -0.01]).x
    slow, fast = law(*through, 1.0, (1.0, 40.0))
    assert 0.8 < slow < 0.95 and 0.4 < fast < 0.6


def test_without_a_slope_it_is_a_constant_and_continuous_there():
    flat = law(0.77, 0.0, 0.9)
    np.testing.assert_allclose(flat, 0.77, rtol=1e-15)
    for slope in (1e-15, -1e-15, -1e-300):
        np.testing.assert_allclose(law(0.77, slope, 0.9), 0.77, rtol=1e-12)
    # To first order in the slope both sides are one: 10 m/s slope ln(v/10 m/s).
    for slope in (1e-7, -1e-7):
        np.testing.assert_allclose(
            (law(0.77, slope, 0.9) - flat) / slope, 10.0 * np.log(SPEEDS / 10.0), rtol=1e-4, atol=1e-6
        )


def test_a_composition_with_it_is_solved_at_every_speed_and_the_line_is_not():
    saturating, line = model("two-mass", cor="saturating"), model("two-mass")
    assert saturating.parameter_names == line.parameter_names
    given = fitball.impacts(15.0, [0.01, 1.0, 3.0, 8.0, 40.0, 100.0], 20.0)
    solved = saturating.rebound(VALUES, given)
    assert np.all(solved.status == 0)
    assert np.all(np.diff(solved.v_y2) > 0.0)
    with pytest.raises(ParameterError, match="exceeds mass_ratio"):
        line.rebound(VALUES, given)
    # Where Wang measured the two differ by less than his noise of 0.3 m/s.
    inside = fitball.impacts(15.0, np.linspace(4.8, 16.4, 9), 20.0)
    assert np.max(np.abs(saturating.rebound(VALUES, inside).v_y2 - line.rebound(VALUES, inside).v_y2)) < 0.08
    names = tuple(VALUES)
    whole = FittedModel(
        "two-mass", {"cor": "saturating"}, fitball.Ball(), True, names, np.array(list(VALUES.values())),
        np.empty((0, len(names))), inside,
    )  # fmt: skip
    assert (valid_range(whole).low, valid_range(whole).high) == (LOWEST, HIGHEST)


def test_its_walls_are_told_and_held():
    saturating = model("two-mass", cor="saturating")
    for change, status in (
        ({"cor_slope": -0.0776}, Status.REBOUND_FALLS),
        ({"mass_ratio": 0.77}, Status.COR_EXCEEDS_MASS_RATIO),
    ):
        with pytest.raises(ParameterError) as caught:
            saturating.rebound({**VALUES, **change}, fitball.impacts(12.0, 6.0, 0.0))
        assert STATUS_REASON[status] in str(caught.value)
    impacts = fitball.impacts(12.0, [5.0, 15.0], 0.0)
    for chosen, kept, broken in (
        (saturating, {}, {"mass_ratio": 0.775}),
        (saturating, {"cor_slope": -0.0775}, {"cor_slope": -0.0777}),
        (model("two-mass", cor="saturating", normal="total"), {"mass_ratio": 0.4}, {"cor_10": 1.01}),
    ):
        for values, holds in (({**VALUES, **kept}, True), ({**VALUES, **broken}, False)):
            sides = [
                sum(factor * values[name] for name, factor in wall.coefficients.items()) <= wall.bound
                for wall in chosen.linear_constraints(impacts)
            ]
            assert all(sides) == holds
    for name in ("grip-slip", "brody"):
        chosen = model(name, cor="saturating")
        values = {key: {**VALUES, "e_x": 0.1, "offset": 0.0}[key] for key in chosen.parameter_names}
        assert np.all(
            np.diff(chosen.rebound(values, fitball.impacts(15.0, [0.01, 3.0, 40.0, 100.0], 0.0)).v_y2) > 0.0
        )
        with pytest.raises(ParameterError, match="v_y2 would fall with v_y1"):
            chosen.rebound({**values, "cor_slope": -0.0776}, fitball.impacts(12.0, 6.0, 0.0))
        assert len(chosen.linear_constraints(impacts)) == 3
        assert model(name).options == {"cor": "line"}
    with pytest.raises(fitball.FitballError, match="unknown option 'saturating' of closure cor"):
        model("thesis", cor="saturating")


def test_a_constant_restitution_is_contained_in_it():
    wide, narrow = (problem_of("wang_all.csv", closures={"cor": cor}) for cor in ("saturating", "mean"))
    values = {name: value for name, value in TWO_MASS.items() if name in narrow.free_names}
    inside = as_container(wide, narrow, values)
    assert inside == {**values, "cor_slope": 0.0}
    rows = [np.array([[found[name] for name in p.free_names]]) for p, found in ((wide, inside), (narrow, values))]
    one, other = wide.rebound(rows[0]), narrow.rebound(rows[1])
    np.testing.assert_allclose(one.v_y2, other.v_y2, rtol=1e-14)


def test_a_fit_finds_the_law_that_made_a_table(tmp_path, brief):
    """Forty drops from 1.5 to 35 m/s: the fit is as near to the truth as its noise, and the line cannot follow."""
    rng = np.random.default_rng(8)
    speeds = np.linspace(1.5, 35.0, 40)
    rebounds = law(0.72, -0.016, 1.0, speeds) * speeds + 0.1 * rng.standard_normal(40)
    place = tmp_path / "drops.csv"
    lines = [f"{speed},{rebound}" for speed, rebound in zip(speeds, rebounds, strict=True)]
    place.write_text("v_y1 [m/s],v_y2 [m/s]\n" + "\n".join(lines) + "\n", encoding="utf-8")
    noise = {}
    for cor in ("saturating", "line"):
        fit = fitball.calibrate(place, closures={"cor": cor}, point_only=True, cores=1)
        point = fit.point.values
        noise[cor] = float(np.sqrt(np.mean((fit.point.rebound.v_y2 - rebounds) ** 2)))
        if cor == "saturating":
            # Five standard errors of either, by least squares on forty rebounds.
            assert point["cor_10"] == pytest.approx(0.72, abs=0.01)
            assert point["cor_slope"] == pytest.approx(-0.016, abs=0.002)
    assert noise["saturating"] < 0.13 < 0.2 < noise["line"]
