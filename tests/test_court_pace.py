"""The ITF court pace rating: by hand, against the model itself, and how far it reaches."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest
from samples import search_briefly

import fitball
from fitball.data.read import load_table
from fitball.errors import FitError
from fitball.exports.parameters import certificate
from fitball.inference.design.targets import of_court_pace
from fitball.inference.prediction.court_pace import DRAWS, court_pace, pace_by_surface
from fitball.inference.results.assumptions import Constant
from fitball.inference.results.lab import apparent_friction, itf_impact, pace_categories, pace_rating
from fitball.inference.results.results import Verdict, thinned
from fitball.report.fit.court_words import pace_lines, pace_remarks
from fitball.report.fit.document import page, render
from fitball.report.fit.folder import render_json
from fitball.report.saved.fit_file import fit_text

# 30 m/s at 16 degrees, by a pocket calculator.
V_X1, V_Y1 = 28.837851, 8.269121


def write_table(place, rows, surfaces=None):
    heads = "v_x1 [m/s],v_y1 [m/s],omega_1 [rad/s],v_x2 [m/s],v_y2 [m/s],omega_2 [rad/s]"
    lines = [heads + (",surface" if surfaces else "")]
    for k, row in enumerate(rows):
        lines.append(",".join(f"{value:.4f}" for value in row) + (f",{surfaces[k]}" if surfaces else ""))
    place.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return place


def sliding_rows(mu, v_x1, v_y1, cor=0.8):
    """Balls that slide throughout: impulses by Coulomb's law, I/(M R^2) = 0.56."""
    v_x1, v_y1 = np.asarray(v_x1, float), np.asarray(v_y1, float)
    lost = mu * (1.0 + cor) * v_y1
    spin = lost / (0.56 * 0.03302)
    return np.stack([v_x1, v_y1, np.zeros_like(v_x1), v_x1 - lost, cor * v_y1, spin], axis=1)


@pytest.fixture(scope="module")
def two_surfaces(tmp_path_factory):
    """Eight sliding impacts on a slow and eight on a fast surface, near the test impact; a point fit."""
    place = tmp_path_factory.mktemp("surfaces") / "two.csv"
    speed = [26.0, 31.0, 27.5, 32.0, 28.0, 30.0, 29.0, 31.5]
    normal = [7.2, 9.4, 9.0, 7.6, 8.3, 8.8, 7.9, 8.5]
    noise = np.random.default_rng(2).normal(0.0, 1.0, (16, 6)) * np.array([0.0, 0.0, 6.0, 0.1, 0.1, 4.0])
    rows = np.concatenate([sliding_rows(0.72, speed, normal), sliding_rows(0.45, speed, normal)]) + noise
    write_table(place, rows, ["clay"] * 8 + ["grass"] * 8)
    with pytest.MonkeyPatch.context() as patch:
        search_briefly(patch)
        return fitball.calibrate(place, model="grip-slip", pool={"mu": "surface"}, point_only=True, cores=1)


def test_the_test_impact_is_the_itf_one():
    found = itf_impact()
    assert found.v_x1[0] == pytest.approx(V_X1, abs=1e-6)
    assert found.v_y1[0] == pytest.approx(V_Y1, abs=1e-6)
    assert found.omega_1[0] == 0.0


def test_rating_by_hand():
    # mu = (28 - 19.36)/(8 (1 + 0.8)) = 0.6, so 100 (1 - 0.6) + 150 (0.81 - 0.80) = 41.5.
    friction = apparent_friction(np.array([28.0]), np.array([8.0]), np.array([19.36]), np.array([6.4]))
    assert friction[0] == pytest.approx(0.6)
    assert pace_rating(friction, np.array([0.8]))[0] == pytest.approx(41.5)
    # A clay court and a grass court: 100 (1 - 0.80) + 150 (0.81 - 0.85) and 100 (1 - 0.55) + 150 (0.81 - 0.70).
    np.testing.assert_allclose(pace_rating(np.array([0.8, 0.55]), np.array([0.85, 0.7])), [14.0, 61.5])


@pytest.mark.parametrize(
    ("rating", "name"),
    [(29.0, "slow"), (29.49, "slow"), (29.5, "medium-slow"), (34.0, "medium-slow"), (35.0, "medium"),
     (39.49, "medium"), (39.5, "medium-fast"), (44.4, "medium-fast"), (44.5, "fast"), (70.0, "fast"), (-5.0, "slow")],
)  # fmt: skip
def test_categories_of_the_itf(rating, name):
    assert pace_categories(np.array([rating]))[name] == 1.0


def test_categories_are_probabilities():
    shares = pace_categories(np.array([20.0, 33.0, 33.4, 46.0]))
    assert list(shares.values()) == [0.25, 0.5, 0.0, 0.0, 0.25]


def test_rating_is_that_of_the_model_at_the_test_impact(grip_slip_fit):
    """Every draw evaluated through the public model, the rating written out anew."""
    fit = grip_slip_fit
    rows = thinned(fit.posterior, DRAWS)
    columns = dict(zip(fit.posterior.names, rows.T, strict=True))
    model = fitball.model("grip-slip")
    rebound = model.rebound({name: columns[name] for name in model.parameter_names}, fitball.impacts(V_X1, V_Y1, 0.0))
    e = rebound.v_y2[:, 0] / V_Y1
    mu = (V_X1 - rebound.v_x2[:, 0]) / (V_Y1 * (1.0 + e))
    expected = np.quantile(100.0 * (1.0 - mu) + 150.0 * (0.81 - e), (0.5, 0.025, 0.16, 0.84, 0.975))
    (found,) = fit.court_pace.ratings
    rating = found.rating
    np.testing.assert_allclose([rating.median, rating.q025, rating.q16, rating.q84, rating.q975], expected, atol=1e-4)
    assert sum(found.categories.values()) == pytest.approx(1.0)
    assert found.categories["medium-fast"] == pytest.approx(
        np.mean(np.abs(100.0 * (1.0 - mu) + 150.0 * (0.81 - e) - 42.0) < 2.5), abs=0.002
    )
    # At 16 degrees this ball slides throughout, so the apparent friction is the fitted one.
    assert found.slides == 1.0
    assert found.friction.median == pytest.approx(fit.parameters["mu"].median, abs=0.002)


def test_a_ball_that_grips_has_less_apparent_friction(brief):
    """With mu held high the test ball grips: its velocities do not show mu, and the page says so."""
    fit = fitball.calibrate("wang_all.csv", model="grip-slip", fix={"mu": 1.3}, point_only=True, cores=1)
    (found,) = fit.court_pace.ratings
    assert dict(found.regimes) == {"grip": 1.0}
    assert found.slides == 0.0
    values = {name: fit.point.values[name] for name in fitball.model("grip-slip").parameter_names}
    rebound = fitball.model("grip-slip").rebound(values, fitball.impacts(V_X1, V_Y1, 0.0))
    mu = (V_X1 - rebound.v_x2[0]) / (V_Y1 + rebound.v_y2[0])
    assert found.friction.point == pytest.approx(mu, abs=1e-6)
    assert mu < 1.2
    assert found.sliding_friction.point == 1.3
    assert found.rating.point - found.sliding_rating.point == pytest.approx(100.0 * (1.3 - mu), abs=1e-4)
    assert any("with probability 0 %" in line for line in pace_remarks(fit.court_pace))


def test_every_surface_has_its_own_rating(two_surfaces):
    fit = two_surfaces
    levels = {(item.parameter, item.label): item.point for item in fit.levels}
    assert [item.labels for item in fit.court_pace.ratings] == [("clay",), ("grass",)]
    for item in fit.court_pace.ratings:
        values = {name: fit.point.values[name] for name in ("e_x", "offset", "cor_slope")}
        values |= {name: levels[name, item.labels[0]] for name in ("mu", "cor_10")}
        rebound = fitball.model("grip-slip").rebound(values, fitball.impacts(V_X1, V_Y1, 0.0))
        e = rebound.v_y2[0] / V_Y1
        mu = (V_X1 - rebound.v_x2[0]) / (V_Y1 * (1.0 + e))
        assert item.rating.point == pytest.approx(100.0 * (1.0 - mu) + 150.0 * (0.81 - e), abs=1e-4)
        assert item.impacts == 8
        assert item.sliding_friction.point == pytest.approx(levels["mu", item.labels[0]], rel=1e-12)
    clay, grass = (item.rating.point for item in fit.court_pace.ratings)
    # The truth: 100 (1 - mu) + 150 (0.81 - 0.8) with mu of 0.72 and 0.45.
    assert (clay, grass) == (pytest.approx(29.5, abs=2.0), pytest.approx(56.5, abs=2.0))
    lines = pace_lines(fit)
    measured, model = lines[:2], lines[2:]
    assert measured[0].startswith("ITF court pace of clay as measured, without a model (3 of 8 test impacts)")
    assert len(model) == 2 and model[0].startswith("ITF court pace rating of clay: ")
    assert "extrapolated" not in model[0]
    # What is told level by level is not called unknown because the pooling is.
    said = page(fit, {})
    assert "mu differs by surface" in said and "mu[clay]" in said


def test_extrapolation_is_flagged_with_its_distance(two_surfaces, grip_slip_fit):
    for item in two_surfaces.court_pace.ratings:
        assert not item.reach.outside
    (found,) = grip_slip_fit.court_pace.ratings
    assert found.reach.outside
    # The nearest mixture is not nearer in v_x1 alone than the fastest impact allows.
    table = load_table("wang_all.csv")
    least = V_X1 - table.impacts.v_x1.max()
    points = np.stack([table.impacts.v_x1, table.impacts.v_y1, 0.03302 * table.impacts.omega_1], axis=1)
    most = np.linalg.norm(points - np.array([V_X1, V_Y1, 0.0]), axis=1).min()
    assert least <= found.reach.distance <= most
    assert f"{found.reach.distance:.1f} m/s" in pace_lines(grip_slip_fit)[0]


def test_spin_of_the_test_is_within_what_the_itf_allows(tmp_path):
    """Impacts with 10 rad/s of spin are as near to the test as the test's own spin; 40 rad/s are not."""
    for spin, outside in ((10.0, False), (40.0, True)):
        rows = sliding_rows(0.6, [26.0, 32.0, 28.0, 30.0], [9.4, 7.4, 7.8, 9.0])
        rows[:, 2] = spin + np.arange(4) * 0.1
        fit = fitball.calibrate(write_table(tmp_path / f"{spin}.csv", rows), model="brody", point_only=True, cores=1)
        reach = fit.court_pace.ratings[0].reach
        assert ("omega_1" in reach.beyond) == outside
        if outside:
            assert reach.outside
            assert reach.beyond["omega_1"] == pytest.approx(-40.0)


def test_a_point_fit_in_the_cold_is_rated_once(grip_slip_fit):
    """Its category is that of the rating that stands beside it, by the ITF's limits and 0.003 a degree."""
    point = grip_slip_fit.point
    met = set()
    for warmth in (None, -5.0, 5.0, 15.0, 35.0, 45.0):
        problem = replace(grip_slip_fit.problem, scene=replace(grip_slip_fit.problem.scene, ball_temperature=warmth))
        rating = court_pace(problem, point, None, np.random.default_rng(1)).ratings[0]
        assert rating.categories == pace_categories(np.array([rating.rating.point]))
        met |= {name for name, share in rating.categories.items() if share > 0.0}
    assert len(met) > 1


def test_the_error_of_the_thermometer_is_one_of_the_rating(grip_slip_fit):
    """0.45 points a degree, ITF CS 01/02."""
    widths = []
    for sd in (0.0, 10.0):
        scene = replace(grip_slip_fit.problem.scene, ball_temperature=23.0, ball_temperature_sd=sd)
        problem = replace(grip_slip_fit.problem, scene=scene)
        found = court_pace(problem, grip_slip_fit.point, grip_slip_fit.posterior, np.random.default_rng(1))
        widths.append((found.ratings[0].rating.q84 - found.ratings[0].rating.q16) / 2.0)
    assert widths[1] == pytest.approx(np.hypot(widths[0], 4.5), rel=0.1)


def oblique(mu, speeds, tmp_path):
    """A brody fit to impacts of a ball without spin that slides or rolls, at these speeds and 16 to 40 degrees."""
    rows = []
    for speed in speeds:
        for degrees in (14.0, 18.0, 25.0, 35.0):
            v_x1, v_y1 = speed * np.cos(np.radians(degrees)), speed * np.sin(np.radians(degrees))
            # A shell of 0.55 M R^2 rolls once friction has taken 0.55/1.55 of its speed.
            lost = min(mu * 1.8 * v_y1, v_x1 * 0.55 / 1.55)
            rows.append(f"{v_x1},{v_y1},0,{v_x1 - lost},{0.8 * v_y1}")
    (tmp_path / "t.csv").write_text("v_x1,v_y1,omega_1,v_x2,v_y2\n" + "\n".join(rows) + "\n", encoding="utf-8")
    fit = fitball.calibrate(tmp_path / "t.csv", "brody", point_only=True, seed=1)
    return fit.court_pace


def test_a_rating_at_the_grip_limit_says_so(tmp_path):
    """The limit by hand: at 16 degrees 0.55/1.55/(1.8 tan 16) = 0.69."""
    for mu, share in ((0.45, 0.0), (0.68, 1.0)):
        pace = oblique(mu, (20.0, 30.0), tmp_path)
        assert pace.ratings[0].saturated == share
        assert any("grip limit" in line for line in pace_remarks(pace)) == (share > 0.0)


def test_what_is_far_slower_than_the_test_is_not_rated(tmp_path):
    pace = oblique(0.5, (2.0, 3.0), tmp_path)
    assert not pace.ratings
    assert "0.48 to 1.7 m/s" in pace.missing
    assert oblique(0.5, (15.0, 25.0), tmp_path).ratings


def test_a_drop_test_has_no_court_pace(tmp_path, grip_slip_fit, brief):
    table = tmp_path / "drop.csv"
    table.write_text("v_y1,v_y2\n4,3.21\n6,4.68\n8,6.13\n10,7.48\n", encoding="utf-8")
    fit = fitball.calibrate(table, model="brody", point_only=True, cores=1)
    assert json.loads(fit_text(fit))["court_pace"] is None
    assert "Court pace" not in page(fit, {})
    assert pace_lines(replace(grip_slip_fit, court_pace=None)) == ()


def test_balls_of_one_rating_share_a_line_and_constants_that_move_it_are_printed(grip_slip_fit):
    pace = grip_slip_fit.court_pace
    (one,) = pace.ratings
    other = replace(one, rating=replace(one.rating, point=30.0, median=30.0, q025=29.0, q975=31.0))
    labels = (("clay", "new"), ("clay", "used"), ("hard", "new"), ("clay", "old"))
    ratings = tuple(replace(it, labels=at) for it, at in zip((one, one, other, other), labels, strict=True))
    lines = pace_lines(replace(grip_slip_fit, court_pace=replace(pace, ratings=ratings, columns=("surface", "ball"))))
    heads = [line.partition(":")[0].removeprefix("ITF court pace rating of ") for line in lines]
    assert heads == ["clay (new and used)", "hard, new", "clay, old"]
    moved = Constant("ball_radius", True, 0.033, 0.0327, 0.0343, {}, {"": (51.0, 49.0)})
    assumptions = replace(grip_slip_fit.assumptions, constants=(moved,))
    page = certificate(replace(grip_slip_fit, assumptions=assumptions))
    assert re.search(r"model goes from 51[.0]* to 49[.0]* over ball_radius 32.70 to 34.30 mm \(held at 33.00\)", page)


def test_other_balls_have_no_court_pace(grip_slip_fit):
    golf = replace(grip_slip_fit.problem.scene, ball=fitball.Ball(0.0459, 0.02135, 0.4 * 0.0459 * 0.02135**2))
    problem = replace(grip_slip_fit.problem, scene=golf)
    found = court_pace(problem, grip_slip_fit.point, None, np.random.default_rng(1))
    assert not found.ratings and found.measured == () and "45.9 g" in found.missing
    assert pace_by_surface(problem, grip_slip_fit.posterior.draws[:5]) == {}
    with pytest.raises(FitError, match="no tennis ball"):
        of_court_pace(SimpleNamespace(problem=problem))


def test_a_model_that_needs_the_measured_restitution_says_so(brief):
    fit = fitball.calibrate(
        "wang_zero_spin.csv", model="thesis-exact", closures={"cor": "measured"}, point_only=True, cores=1
    )
    found = court_pace(fit.problem, fit.point, None, np.random.default_rng(0))
    assert found.ratings == ()
    assert "measured" in found.missing
    assert "none, cor = measured" in pace_lines(fit)[-1]


def test_it_is_saved_and_shown(grip_slip_fit, grip_slip_folder, tmp_path):
    content = json.loads((grip_slip_folder / "fit.json").read_text(encoding="utf-8"))
    (found,) = grip_slip_fit.court_pace.ratings
    saved = content["court_pace"]["ratings"][0]
    assert saved["rating"] == asdict(found.rating)
    assert saved["reach"]["outside"] is True
    text = render(grip_slip_fit, tmp_path)
    assert json.loads(render_json(grip_slip_fit, tmp_path))["court_pace"] == content["court_pace"]
    rating, shares = found.rating, found.categories
    likeliest = max(shares, key=shares.get)
    assert (
        f"[{rating.q025:.1f}, {rating.q975:.1f}] (95 %), {likeliest} (probability {100.0 * shares[likeliest]:.0f} %)"
        in text
    )
    # The last digits are those of a chain: half a unit is a dozen of its standard errors.
    assert (rating.q025, rating.median, rating.q975) == pytest.approx((40.6, 44.4, 48.4), abs=0.6)
    assert "(CS 01/02)" in (grip_slip_folder / "report.html").read_text(encoding="utf-8")


def test_draws_without_a_rebound_are_told_and_most_of_them_give_no_rating(grip_slip_fit):
    """Restitutions above 1 in some of the draws: intervals of the rest, or none."""
    fit = grip_slip_fit
    column = fit.posterior.names.index("cor_10")
    for failing, rated in ((0.3, True), (0.7, False)):
        values = fit.posterior.values.copy()
        raised = np.random.default_rng(1).uniform(size=values.shape[:-1]) < failing
        values[..., column] = np.where(raised, 1.5, values[..., column])
        found = court_pace(fit.problem, fit.point, replace(fit.posterior, values=values), np.random.default_rng(0))
        if rated:
            (rating,) = found.ratings
            assert rating.failed == pytest.approx(failing, abs=0.05)
            told = pace_remarks(found)
            assert any("of the draws have no solution" in line for line in told)
        else:
            assert found.ratings == ()
            assert "% of the draws: the coefficient of restitution" in found.missing


def test_a_rating_that_rests_on_the_prior_of_friction_says_so(grip_slip_fit):
    def told(contraction):
        known = grip_slip_fit.parameters
        mu = replace(known["mu"], verdict=Verdict.PRIOR_DOMINATED, contraction=contraction)
        return replace(grip_slip_fit, parameters={**known, "mu": mu})

    assert "as uncertain as the prior of mu" in pace_lines(told(0.1))[0]
    # A prior that ends above what the table has leaves a narrow rating, which is not that of the prior either.
    assert "as uncertain" not in pace_lines(told(0.99))[0] and "prior-dominated" in pace_lines(told(0.99))[0]
    assert "prior" not in pace_lines(grip_slip_fit)[0]
    assert "The rating by the model is as uncertain as the prior of mu" in certificate(told(0.1))
