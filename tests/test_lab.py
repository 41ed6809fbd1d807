"""What laboratories rate as measured: against the ITF's formulas, Student's t and least squares by
scipy.
"""

import numpy as np
import pandas as pd
import pytest
from made_tables import made
from scipy.stats import linregress, t
from support.made_fit import made_fit, table_of

from fitball.base import itf
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.data.read import load_table
from fitball.data.scene import BallSection, Scene
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.report import lab as page
from fitball.uses.lab import drop_test, means, measured_pace

TEST = itf.pace_impact()
SPREAD = ParameterSpec("spread", "", 0.0, np.inf, "half-t(0.1, 4)", "", "")
FALL = np.sqrt(2.0 * 9.80665 * 2.54)


def paced(ratings, friction=0.6, speed=30.0, angle=16.0, spin=0.0, polar=False, **labels):
    """Impacts of the court pace test with these ratings, all of one friction."""
    angle = np.radians(np.broadcast_to(angle, np.shape(ratings)))
    v_x1 = speed * np.cos(angle)
    v_y1 = speed * np.sin(angle)
    # CS 01/02 for the restitution.
    cor = 0.81 - (np.asarray(ratings) - 100.0 * (1.0 - friction)) / 150.0
    v_x2 = v_x1 - friction * v_y1 * (1.0 + cor)
    v_y2 = cor * v_y1
    after = {"v_x2": v_x2, "v_y2": v_y2}
    if polar:
        after = {"v_2": np.hypot(v_x2, v_y2), "theta_2": np.arctan2(v_y2, v_x2)}
    return made(
        {
            "v_x1": v_x1,
            "v_y1": v_y1,
            "omega_1": spin,
            **after,
        },
        labels=labels,
    )


def dropped(heights, fall=2.54, **labels):
    """Drops from a height [m], by speeds."""
    speeds = np.sqrt(2.0 * 9.80665 * np.broadcast_to(fall, np.shape(heights)))
    return made(
        {"v_y1": speeds, "v_y2": np.sqrt(2.0 * 9.80665 * np.asarray(heights))},
        labels=labels,
    )


def row(frame, **wanted):
    found = frame[np.all([frame[name] == value for name, value in wanted.items()], axis=0)]
    assert len(found) == 1, frame
    return found.iloc[0]


@pytest.mark.parametrize("polar", [False, True])
def test_a_court_has_the_rating_and_interval_of_its_impacts(polar):
    ratings = np.array([36.0, 38.5, 37.0, 35.5, 39.5])
    found = row(measured_pace(paced(ratings, polar=polar), Scene()), surface="", place="")
    assert found["impacts"] == 5
    assert found["rating"] == pytest.approx(37.3, rel=1e-9)
    wanted = t.interval(0.95, 4, ratings.mean(), ratings.std(ddof=1) / np.sqrt(5))
    assert (found["q025"], found["q975"]) == pytest.approx(wanted, abs=0.01)
    medium = np.diff(t.cdf([34.5, 39.5], 4, ratings.mean(), ratings.std(ddof=1) / np.sqrt(5)))
    assert found["medium"] == pytest.approx(medium[0], abs=0.001)
    assert sum(found[name] for name in itf.PACE_CATEGORIES) == pytest.approx(1.0)
    # Ten kelvins colder are 4.5 points.
    cold = measured_pace(paced(ratings), Scene(ball=BallSection(temperature=13.0)))
    assert cold["rating"][0] == pytest.approx(37.3 - 4.5, rel=1e-9)


def test_only_impacts_within_tolerances_of_a_tennis_ball_count():
    ratings = np.full(8, 37.0) + np.arange(8) % 3
    far = np.arange(8)
    speed = np.where(far == 0, 32.1, 31.9)
    angle = np.where(far == 1, 13.9, 14.1)
    spin = np.where(far == 2, 6.1 * np.pi, -5.9 * np.pi)
    table = paced(ratings, speed=speed, angle=angle, spin=spin)
    table.values["v_x2"][3] = np.nan
    assert measured_pace(table, Scene())["impacts"].tolist() == [4]
    assert not len(measured_pace(paced(ratings[:2]), Scene()))
    assert not len(measured_pace(paced(ratings), Scene(ball=BallSection(mass=0.0027, radius=0.02))))
    assert not len(measured_pace(made({"v_y1": 7.0, "v_y2": [5.0, 5.1, 5.2]}), Scene()))


def test_places_are_rated_one_by_one_and_a_surface_that_cannot_be_leaves_the_others_theirs():
    ratings = np.array([44.0, 44.4, 45.0, 40.1, 40.5, 40.9, 36.2, 36.6, 37.0, 20.0, 21.0])
    surfaces = ("hard",) * 9 + ("clay",) * 2
    table = paced(ratings, surface=surfaces, location=tuple("AAABBBCCCDD"))
    found = measured_pace(table, Scene())
    assert found["surface"].tolist() == ["hard"] * 4
    assert found["place"].tolist() == [
        "",
        "A",
        "B",
        "C",
    ]
    assert found["impacts"].tolist() == [9, 3, 3, 3]
    # Between places 4 points, within 0.5: each is as measured, the court no better known than by
    # three places.
    assert found["rating"].tolist() == pytest.approx([40.53, 44.43, 40.5, 36.63], abs=0.5)
    width = found["q975"] - found["q025"]
    assert 5.0 < width[0] < np.ptp(t.interval(0.95, 2, 0.0, 3.9 / np.sqrt(3)))
    # A pooled sd of six degrees of freedom.
    assert width[1] == pytest.approx(2 * 1.96 * 0.43 / np.sqrt(3), rel=0.25)
    # Who knows that places are alike says so.
    alike = measured_pace(table, Scene(), {"rating_spread": "half-normal(0.05)"})
    assert np.ptp(alike["rating"]) < 0.5 * np.ptp(found["rating"])
    scene = Scene(prior={"rating_spread": "half-normal(0.05)"})
    assert alike.equals(measured_pace(table, scene))
    assert not alike.equals(found)


def test_a_drop_test_of_one_ball_is_students():
    heights = np.array([1.402, 1.395, 1.413, 1.408])
    cor = np.sqrt(heights / 2.54)
    found = drop_test(dropped(heights), Scene())
    assert found["kind"].tolist() == ["mean"]
    one = found.iloc[0]
    assert (one["cor"], one["speed"], one["drops"]) == pytest.approx(
        (cor.mean(), FALL, 4),
        rel=1e-9,
    )
    wanted = t.interval(0.95, 3, cor.mean(), cor.std(ddof=1) / 2.0)
    assert (one["cor_q025"], one["cor_q975"]) == pytest.approx(wanted, abs=1e-5)
    assert one["rebound"] == pytest.approx(2.54 * cor.mean() ** 2, rel=1e-12)
    assert (one["rebound_q025"], one["rebound_q975"]) == pytest.approx(
        2.54 * np.square(wanted),
        abs=1e-4,
    )
    assert one["passes"] > 0.99
    few = drop_test(dropped(heights), Scene(ball=BallSection(type="stage-1"))).iloc[0]
    assert few["passes"] < 0.01
    # Repeats that agree to every digit say nothing of their noise.
    same = drop_test(dropped(np.full(3, 1.4)), Scene()).iloc[0]
    assert np.isnan(same[["cor_q025", "rebound_q975", "passes"]].astype(float)).all()
    assert same["rebound"] == pytest.approx(1.4, rel=1e-9)


def test_balls_of_one_make_differ_and_another_is_less_sure_than_their_mean():
    """Six balls dropped three times; intervals of the second edition's mixed model, with the noise
    as a parameter.
    """
    heights = (
        np.array(
            [
                140.9,
                140.2,
                140.8,
                142.3,
                143.1,
                141.4,
                140.1,
                140.1,
                140.5,
                141.1,
                141.2,
                142.4,
                140.8,
                142.0,
                141.4,
                140.6,
                139.5,
                138.3,
            ]
        )
        / 100.0
    )
    balls_of = tuple("AAABBBCCCDDDEEEFFF")
    found = drop_test(dropped(heights, ball=balls_of), Scene())
    mean = row(found, kind="mean")
    another = row(found, kind="another")
    assert (mean["cor"], mean["cor_q025"], mean["cor_q975"]) == pytest.approx(
        (0.74486, 0.7419, 0.74795),
        abs=4e-4,
    )
    assert another["passes"] == pytest.approx(0.998, abs=0.004)
    wide = [one["cor_q975"] - one["cor_q025"] for one in (mean, another)]
    assert wide[1] > 2.0 * wide[0]
    balls = found[found["kind"] == "ball"]
    assert balls["label"].tolist() == list("ABCDEF")
    assert (balls["drops"] == 3).all()
    own = np.sqrt(heights / 2.54).reshape(6, 3).mean(axis=1)
    pulled = (balls["cor"] - 0.74486).to_numpy() / (own - 0.74486)
    assert np.all((pulled[[1, 5]] > 0.5) & (pulled[[1, 5]] < 1.0))
    alike = drop_test(
        dropped(heights, ball=balls_of),
        Scene(),
        {"cor_10_spread": "half-normal(1e-4)"},
    )
    assert np.ptp(alike[alike["kind"] == "ball"]["cor"]) < 0.1 * np.ptp(own)


def test_balls_dropped_once_are_students_and_another_lies_among_them():
    cor = np.array([0.741, 0.747, 0.738, 0.744, 0.749])
    found = drop_test(dropped(2.54 * cor**2, ball=tuple("ABCDE")), Scene())
    assert found["kind"].tolist() == ["mean", "another"]
    for kind, error in (("mean", np.sqrt(0.2)), ("another", np.sqrt(1.2))):
        one = row(found, kind=kind)
        wanted = t.interval(0.95, 4, cor.mean(), error * cor.std(ddof=1))
        assert (one["cor_q025"], one["cor_q975"]) == pytest.approx(wanted, abs=5e-5), kind


def test_the_error_of_a_slope_is_one_for_all_groups():
    rng = np.random.default_rng(6)
    group = np.repeat(np.arange(4), 6)
    spread = parse_prior(SPREAD)
    x = np.tile(np.linspace(-1.0, 1.0, 6), 4)
    values = 0.1 * rng.standard_normal(24)
    near, far = (
        means(values, group, spread, np.random.default_rng(1), x + away) for away in (0.0, 20.0)
    )
    slopes = np.linalg.lstsq(np.column_stack([np.eye(4)[group], x]), values, rcond=None)
    error = np.sqrt(slopes[1][0] / (24 - 5) / np.sum(x**2))
    # Seen from far away the level is as sure as the slope.
    assert far.mean.std() == pytest.approx(np.hypot(20.0 * error, near.mean.std()), rel=0.04)
    assert far.point == pytest.approx(near.point - 20.0 * slopes[0][-1], abs=0.01)
    assert np.corrcoef(far.each)[0, 1] > 0.95 > np.corrcoef(near.each)[0, 1]


def test_several_speeds_make_a_line_and_have_values_of_their_own():
    rng = np.random.default_rng(5)
    fall = np.repeat([1.0, 1.75, 2.54, 3.2], 3)
    speeds = np.sqrt(2.0 * 9.80665 * fall)
    cor = 0.82 - 0.011 * speeds + 0.003 * rng.standard_normal(12)
    table = made({"v_y1": speeds, "v_y2": cor * speeds})
    found = drop_test(table, Scene())
    line = linregress(speeds, cor)
    mean = row(found, kind="mean")
    assert mean["cor"] == pytest.approx(line.intercept + line.slope * FALL, rel=1e-9)
    rest = np.sqrt(np.sum((cor - line.intercept - line.slope * speeds) ** 2) / 10)
    error = rest * np.sqrt(
        1 / 12 + (FALL - speeds.mean()) ** 2 / np.sum((speeds - speeds.mean()) ** 2)
    )
    assert mean["cor_q975"] - mean["cor_q025"] == pytest.approx(
        2 * t.ppf(0.975, 10) * error,
        rel=0.003,
    )
    own = found[found["kind"] == "speed"]
    assert own["speed"].to_numpy() == pytest.approx(speeds[::3])
    assert (own["drops"] == 3).all()
    assert own["cor"].to_numpy() == pytest.approx(cor.reshape(4, 3).mean(axis=1))
    balls = drop_test(
        made(
            {"v_y1": speeds, "v_y2": (cor + 0.01 * (np.arange(12) % 3)) * speeds},
            labels={"ball": tuple("ABC" * 4)},
        ),
        Scene(),
    )
    assert row(balls, kind="mean")["cor"] == pytest.approx(mean["cor"] + 0.01, abs=1e-3)
    assert np.diff(balls[balls["kind"] == "ball"]["cor"]) == pytest.approx([0.01, 0.01], abs=4e-3)
    low = drop_test(dropped([0.57, 0.58, 0.575], fall=1.0), Scene()).iloc[0]
    assert low["speed"] == pytest.approx(np.sqrt(2 * 9.80665))
    assert np.isnan([low["rebound"], low["passes"]]).all()


def test_each_surface_has_its_drops_and_its_ratio_to_the_rigid_one():
    heights = np.array([1.40, 1.41, 1.405, 1.20, 1.22, 1.21])
    surfaces = ("Smooth concrete",) * 3 + ("clay",) * 3
    found = drop_test(dropped(heights, surface=surfaces), Scene())
    base = row(found, surface="Smooth concrete")
    clay = row(found, surface="clay")
    cor = np.sqrt(heights / 2.54)
    assert base["passes"] > 0.99
    assert np.isnan(clay["passes"])
    assert np.isnan(base["ratio"])
    assert clay["ratio"] == pytest.approx(cor[3:].mean() / cor[:3].mean(), rel=1e-9)
    assert clay["ratio_q025"] < clay["ratio"] < clay["ratio_q975"] < 1.0
    assert np.isnan(
        drop_test(dropped(heights, surface=("hard",) * 3 + ("clay",) * 3), Scene())["ratio"]
    ).all()
    # On clay alone no ball passes or fails.
    alone = drop_test(dropped(heights[:3], surface=("clay",) * 3), Scene())
    assert np.isnan(alone["passes"][0])
    assert alone["surface"][0] == ""
    assert np.isnan(drop_test(dropped(heights[:3]), Scene(surface={"name": "clay"}))["passes"][0])
    # At another speed a ratio would be of speeds.
    fall = np.repeat([2.54, 1.0], 3)
    other = drop_test(dropped(heights * fall / 2.54, fall=fall, surface=surfaces), Scene())
    assert np.isnan(other["ratio"]).all()
    assert other["cor"].tolist() == pytest.approx([cor[:3].mean(), cor[3:].mean()])


def test_drops_are_called_after_their_surface_where_there_are_several():
    frame = pd.DataFrame(
        {"drop_height [m]": 2.54, "rebound_height [m]": [1.39, 1.40, 1.41, 1.20, 1.21, 1.22]}
    )
    assert any("Drop test, measured" in one for one in page.lines(made_fit(frame)))
    several = page.lines(made_fit(frame.assign(surface=["concrete"] * 3 + ["clay"] * 3)), most=9)
    assert (
        sum(
            f"Drop test on {name}, measured" in one
            for one in several
            for name in ("clay", "concrete")
        )
        == 2
    )


def test_what_is_no_drop_test_has_none():
    assert not len(drop_test(load_table("wang_all"), Scene()))
    assert not len(drop_test(made({"v_x1": 5.0, "v_y1": 7.0, "v_y2": [5.0, 5.1]}), Scene()))
    marble = drop_test(
        dropped([1.4, 1.41, 1.42]),
        Scene(ball=BallSection(mass=0.005, radius=0.01)),
    ).iloc[0]
    assert marble["cor"] > 0.7
    assert np.isnan(marble["rebound"])


def test_the_page_names_the_surface_that_cannot_be_rated(monkeypatch):
    fit = made_fit(table_of(24, ("clay", "hard")))
    summary = fit.summary.rename(index={"court_pace": "court_pace[clay]"})
    summary.loc["court_pace[hard]"] = summary.loc["court_pace[clay]"]
    numbers = ["point", "median", "q025", "q975"]
    summary.loc["court_pace[hard]", numbers] = np.nan
    rule = fit.quantity("court_pace").rule
    hard = fit.quantity("court_pace")._replace(rule=lambda values: np.nan * rule(values))
    fit.__dict__["summary"] = summary
    clay = hard._replace(rule=rule)
    monkeypatch.setattr(type(fit), "quantity", lambda self, name: hard if "hard" in name else clay)
    lines = page.lines(fit)
    assert len(lines) == 2
    assert "clay" in lines[0]
    assert "fast" in lines[0]
    assert "hard" in lines[1]
    assert not any(name in lines[1] for name in ("slow", "medium", "fast"))
    assert len(page.section(fit).blocks[0].rows) == 2


def test_drops_on_several_surfaces_have_a_restitution_each_in_the_model():
    heights = 1.4 + 0.005 * np.sin(np.arange(12.0)) - 0.2 * (np.arange(12) > 5)
    table = dropped(heights, surface=("concrete",) * 6 + ("clay",) * 6, ball=tuple("aaabbb" * 2))
    problem = build_problem(table, Scene(), Choices())
    assert [(level.parameter, level.labels) for level in problem.forward.levels] == [
        ("cor_10", ("concrete", "clay"))
    ]
    names = [one.spec.name for one in problem.derived]
    assert {"rebound_254cm[concrete]", "rebound_254cm[clay]"} <= {*names}
    assert "rebound_254cm" not in names


@pytest.mark.parametrize(("column", "head"), [("surface", "surface"), ("location", "place")])
def test_ratings_by_the_model_are_called_after_what_differs(column, head, monkeypatch):
    fit = made_fit(table_of(24, ("A", "B")).rename(columns={"surface": column}))
    fit.__dict__["summary"] = fit.summary.rename(index={"court_pace": "court_pace[A]"})
    own = fit.quantity("court_pace")
    monkeypatch.setattr(type(fit), "quantity", lambda *_: own)
    assert page.section(fit).blocks[0].rows[0][head] == "A"
    assert len(page.lines(fit)) == 1
    assert " of A, by the model" in page.lines(fit)[0]
    # The made fit's rating is extrapolated.
    assert "extrapolated" in page.lines(fit)[0]
    fit.__dict__["summary"] = fit.summary.assign(verdict="given")
    assert "extrapolated" not in page.lines(fit)[0]
