"""The court pace of laboratories, as measured and by the model: against the ITF's formulas and
Student's t.
"""

import numpy as np
import pytest
from made_tables import impact_table
from scipy.stats import t
from support.fit_by_hand import fit_by_hand, table_of
from support.near import assert_near, assert_within
from support.rows import interval_of_mean, row

from fitball.base import itf
from fitball.base.values import Ball
from fitball.data.read import load_table
from fitball.data.scene import BallSection, Scene
from fitball.report import lab as page
from fitball.uses.pace import measured_pace


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
        after = {
            "v_2": np.hypot(v_x2, v_y2),
            "theta_2": np.arctan2(v_y2, v_x2),
        }
    return impact_table(
        {
            "v_x1": v_x1,
            "v_y1": v_y1,
            "omega_1": spin,
            **after,
        },
        labels=labels,
    )


def pace_of(table):
    return measured_pace(table, Scene())


@pytest.mark.parametrize("polar", [False, True])
def test_a_court_has_the_rating_and_interval_of_its_impacts(polar):
    ratings = np.array([36.0, 38.5, 37.0, 35.5, 39.5])
    table = paced(ratings, polar=polar)
    rated = row(pace_of(table), surface="", place="")
    assert rated["impacts"] == 5
    assert_near(rated["rating"], 37.3, 1e-9)
    low, high = interval_of_mean(ratings)
    assert_within(rated["q025"], low, 0.01)
    assert_within(rated["q975"], high, 0.01)
    error = ratings.std(ddof=1) / np.sqrt(5)
    below, above = t.cdf(
        [34.5, 39.5],
        4,
        ratings.mean(),
        error,
    )
    assert_within(rated["medium"], above - below, 0.001)
    shares = [rated[name] for name in itf.PACE_CATEGORIES]
    assert_near(sum(shares), 1.0)
    # Ten kelvins colder are 4.5 points.
    cold_ball = BallSection(temperature=13.0)
    cold = measured_pace(paced(ratings), Scene(ball=cold_ball))
    assert_near(cold["rating"][0], 37.3 - 4.5, 1e-9)


def test_only_impacts_within_tolerances_of_a_tennis_ball_count():
    impact = np.arange(8)
    ratings = 37.0 + impact % 3
    speed = np.where(impact == 0, 32.1, 31.9)
    angle = np.where(impact == 1, 13.9, 14.1)
    spin = np.where(impact == 2, 6.1 * np.pi, -5.9 * np.pi)
    table = paced(
        ratings,
        speed=speed,
        angle=angle,
        spin=spin,
    )
    table.values["v_x2"][3] = np.nan
    assert pace_of(table)["impacts"].tolist() == [4]
    two = paced(ratings[:2])
    assert pace_of(two).empty
    table_tennis = BallSection(mass=0.0027, radius=0.02)
    assert measured_pace(paced(ratings), Scene(ball=table_tennis)).empty
    drops = impact_table(
        {
            "v_y1": 7.0,
            "v_y2": [5.0, 5.1, 5.2],
        }
    )
    assert pace_of(drops).empty


@pytest.mark.parametrize("polar", [False, True])
@pytest.mark.parametrize(
    "at_limit",
    [{"angle": 14.0}, {"angle": 18.0}, {"speed": 28.0}, {"speed": 32.0}, {"rpm": 180.0}],
    ids=str,
)
def test_impacts_at_the_limits_of_the_test_count(at_limit, polar):
    angle = at_limit.get("angle", 16.0)
    speed = at_limit.get("speed", 30.0)
    columns = {
        "v_1 [m/s]": [speed] * 4,
        "theta_1 [deg]": [angle] * 4,
    }
    if not polar:
        columns = {
            "v_x1 [m/s]": [speed * np.cos(np.radians(angle))] * 4,
            "v_y1 [m/s]": [speed * np.sin(np.radians(angle))] * 4,
        }
    columns["omega_1 [rpm]"] = [at_limit.get("rpm", 0.0)] * 4
    columns |= {
        "v_x2 [m/s]": [18.5, 18.55, 18.52, 18.49],
        "v_y2 [m/s]": [7.43, 7.4, 7.45, 7.41],
    }
    assert pace_of(load_table(columns))["impacts"].tolist() == [4]


def test_balls_at_the_limits_of_the_rules_are_tennis_balls():
    for mass in (56.0 * 1e-3, 59.4 * 1e-3, 59.4 / 1000.0):
        for radius in (0.0654 / 2.0, 3.27e-2, 3.43 * 0.01, 6.86e-2 / 2.0):
            assert itf.is_tennis_ball(Ball(mass, radius))
    assert not itf.is_tennis_ball(Ball(0.05941, 0.033))


def test_each_place_is_rated_and_a_surface_that_cannot_be_leaves_the_others_theirs():
    ratings = np.array([44.0, 44.4, 45.0, 40.1, 40.5, 40.9, 36.2, 36.6, 37.0, 20.0, 21.0])
    surfaces = ("hard",) * 9 + ("clay",) * 2
    places = tuple("AAABBBCCCDD")
    table = paced(ratings, surface=surfaces, location=places)
    rated = pace_of(table)
    assert rated["surface"].tolist() == ["hard"] * 4
    assert rated["place"].tolist() == ["", "A", "B", "C"]
    assert rated["impacts"].tolist() == [9, 3, 3, 3]
    # Between places 4 points, within 0.5: each is as measured, the court no better known than by
    # three places.
    assert_within(rated["rating"].tolist(), [40.53, 44.43, 40.5, 36.63], 0.5)
    width = rated["q975"] - rated["q025"]
    of_three_places = np.ptp(
        t.interval(
            0.95,
            2,
            0.0,
            3.9 / np.sqrt(3),
        )
    )
    assert 5.0 < width[0] < of_three_places
    # A pooled sd of six degrees of freedom.
    of_three_impacts = 2 * 1.96 * 0.43 / np.sqrt(3)
    assert_near(width[1], of_three_impacts, 0.25)
    # Who knows that places are alike says so.
    prior = {"rating_spread": "half-normal(0.05)"}
    alike = measured_pace(table, Scene(), prior)
    assert np.ptp(alike["rating"]) < 0.5 * np.ptp(rated["rating"])
    assert alike.equals(measured_pace(table, Scene(prior=prior)))
    assert not alike.equals(rated)


def test_the_page_names_the_surface_that_cannot_be_rated(monkeypatch):
    fit = fit_by_hand(table_of(24, ("clay", "hard")))
    summary = fit.summary.rename(index={"court_pace": "court_pace[clay]"})
    summary.loc["court_pace[hard]"] = summary.loc["court_pace[clay]"]
    numbers = ["point", "median", "q025", "q975"]
    summary.loc["court_pace[hard]", numbers] = np.nan
    fit.__dict__["summary"] = summary
    clay = fit.quantity("court_pace")
    hard = clay._replace(rule=lambda values: np.nan * clay.rule(values))

    def quantity(self, name):
        return hard if "hard" in name else clay

    monkeypatch.setattr(type(fit), "quantity", quantity)
    lines = page.sentences(fit)
    assert len(lines) == 2
    assert "clay" in lines[0]
    assert "fast" in lines[0]
    assert "hard" in lines[1]
    for category in ("slow", "medium", "fast"):
        assert category not in lines[1]
    assert len(page.section(fit).blocks[0].rows) == 2


@pytest.mark.parametrize(("column", "head"), [("surface", "surface"), ("location", "place")])
def test_ratings_by_the_model_are_called_after_what_differs(column, head, monkeypatch):
    fit = fit_by_hand(table_of(24, ("A", "B")).rename(columns={"surface": column}))
    fit.__dict__["summary"] = fit.summary.rename(index={"court_pace": "court_pace[A]"})
    pace = fit.quantity("court_pace")
    monkeypatch.setattr(type(fit), "quantity", lambda *_: pace)
    block = page.section(fit).blocks[0]
    assert block.rows[0][head] == "A"
    (line,) = page.sentences(fit)
    assert " of A, by the model" in line
    # The made fit's rating is extrapolated.
    assert "extrapolated" in line
    fit.__dict__["summary"] = fit.summary.assign(verdict="given")
    (line,) = page.sentences(fit)
    assert "extrapolated" not in line
