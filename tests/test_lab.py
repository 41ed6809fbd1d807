"""What laboratories rate as measured: against the ITF's formulas, Student's t and least squares by
scipy.
"""

import re

import numpy as np
import pandas as pd
import pytest
from made_tables import impact_table
from scipy.stats import linregress, t
from support.fit_by_hand import fit_by_hand, table_of

from fitball.base import itf
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.values import Ball
from fitball.data.read import load_table
from fitball.data.scene import BallSection, Scene
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.report import lab as page
from fitball.uses.lab import drop_test, measured_pace
from fitball.uses.means import means

TEST = itf.pace_impact()
SPREAD = ParameterSpec("spread", "", 0.0, np.inf, "half-t(0.1, 4)", "", "")
TWICE_G = 2.0 * 9.80665
# Of a tennis ball in air of 1.2 kg/m^3, with a drag coefficient that is held: 2 g/V^2 [1/m].
HELD_DRAG = Scene(flight={"drag": 0.55})
BRAKING = 0.55 * 1.2 * np.pi * 0.03302**2 / 0.0576


def landing(height):
    """Speed of a fall: V^2 (1 - exp(-2 g h/V^2)), squared."""
    return np.sqrt(TWICE_G / BRAKING * (1.0 - np.exp(-BRAKING * np.asarray(height))))


def launch(height):
    """Speed of a rise: V^2 (exp(2 g r/V^2) - 1), squared."""
    return np.sqrt(TWICE_G / BRAKING * (np.exp(BRAKING * np.asarray(height)) - 1.0))


def rise(speed):
    """Height of a rise at that speed."""
    return np.log(1.0 + BRAKING * np.asarray(speed) ** 2 / TWICE_G) / BRAKING


FALL = landing(2.54)


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
    return impact_table(
        {
            "v_x1": v_x1,
            "v_y1": v_y1,
            "omega_1": spin,
            **after,
        },
        labels=labels,
    )


def dropped(heights, fall=2.54, scene=HELD_DRAG, **labels):
    """Drops from a height [m] and rebounds, a table of heights."""
    columns = {"drop_height": np.full(len(heights), fall), "rebound_height": heights}
    return load_table({**columns, **labels}, scene=scene)


def drop_test_of(heights, **choices):
    return drop_test(dropped(heights, **choices), HELD_DRAG)


def pace_of(table):
    return measured_pace(table, Scene())


def row(frame, **wanted):
    """The only row with these values."""
    for name, value in wanted.items():
        frame = frame[frame[name] == value]
    assert len(frame) == 1, frame
    return frame.iloc[0]


def interval_of_mean(values, error=None):
    """Student's interval of 95 %; the error is a share of the sd, 1/sqrt(n) of a mean."""
    count = len(values)
    if error is None:
        error = 1.0 / np.sqrt(count)
    return t.interval(0.95, count - 1, values.mean(), error * values.std(ddof=1))


@pytest.mark.parametrize("polar", [False, True])
def test_a_court_has_the_rating_and_interval_of_its_impacts(polar):
    ratings = np.array([36.0, 38.5, 37.0, 35.5, 39.5])
    table = paced(ratings, polar=polar)
    rated = row(pace_of(table), surface="", place="")
    assert rated["impacts"] == 5
    assert rated["rating"] == pytest.approx(37.3, rel=1e-9)
    low, high = interval_of_mean(ratings)
    assert rated["q025"] == pytest.approx(low, abs=0.01)
    assert rated["q975"] == pytest.approx(high, abs=0.01)
    error = ratings.std(ddof=1) / np.sqrt(5)
    below, above = t.cdf([34.5, 39.5], 4, ratings.mean(), error)
    assert rated["medium"] == pytest.approx(above - below, abs=0.001)
    shares = [rated[name] for name in itf.PACE_CATEGORIES]
    assert sum(shares) == pytest.approx(1.0)
    # Ten kelvins colder are 4.5 points.
    cold_ball = BallSection(temperature=13.0)
    cold = measured_pace(paced(ratings), Scene(ball=cold_ball))
    assert cold["rating"][0] == pytest.approx(37.3 - 4.5, rel=1e-9)


def test_only_impacts_within_tolerances_of_a_tennis_ball_count():
    impact = np.arange(8)
    ratings = 37.0 + impact % 3
    speed = np.where(impact == 0, 32.1, 31.9)
    angle = np.where(impact == 1, 13.9, 14.1)
    spin = np.where(impact == 2, 6.1 * np.pi, -5.9 * np.pi)
    table = paced(ratings, speed=speed, angle=angle, spin=spin)
    table.values["v_x2"][3] = np.nan
    assert pace_of(table)["impacts"].tolist() == [4]
    two = paced(ratings[:2])
    assert pace_of(two).empty
    table_tennis = BallSection(mass=0.0027, radius=0.02)
    assert measured_pace(paced(ratings), Scene(ball=table_tennis)).empty
    drops = impact_table({"v_y1": 7.0, "v_y2": [5.0, 5.1, 5.2]})
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
    columns = {"v_1 [m/s]": [speed] * 4, "theta_1 [deg]": [angle] * 4}
    if not polar:
        columns = {
            "v_x1 [m/s]": [speed * np.cos(np.radians(angle))] * 4,
            "v_y1 [m/s]": [speed * np.sin(np.radians(angle))] * 4,
        }
    columns["omega_1 [rpm]"] = [at_limit.get("rpm", 0.0)] * 4
    columns |= {"v_x2 [m/s]": [18.5, 18.55, 18.52, 18.49], "v_y2 [m/s]": [7.43, 7.4, 7.45, 7.41]}
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
    assert rated["rating"].tolist() == pytest.approx([40.53, 44.43, 40.5, 36.63], abs=0.5)
    width = rated["q975"] - rated["q025"]
    of_three_places = np.ptp(t.interval(0.95, 2, 0.0, 3.9 / np.sqrt(3)))
    assert 5.0 < width[0] < of_three_places
    # A pooled sd of six degrees of freedom.
    of_three_impacts = 2 * 1.96 * 0.43 / np.sqrt(3)
    assert width[1] == pytest.approx(of_three_impacts, rel=0.25)
    # Who knows that places are alike says so.
    prior = {"rating_spread": "half-normal(0.05)"}
    alike = measured_pace(table, Scene(), prior)
    assert np.ptp(alike["rating"]) < 0.5 * np.ptp(rated["rating"])
    assert alike.equals(measured_pace(table, Scene(prior=prior)))
    assert not alike.equals(rated)


def test_drops_of_a_single_ball_are_students():
    heights = np.array([1.402, 1.395, 1.413, 1.408])
    cor = launch(heights) / FALL
    frame = drop_test_of(heights)
    assert frame["kind"].tolist() == ["mean"]
    mean = frame.iloc[0]
    assert mean["cor"] == pytest.approx(cor.mean(), rel=1e-9)
    assert mean["speed"] == pytest.approx(FALL, rel=1e-9)
    assert mean["drops"] == 4
    low, high = interval_of_mean(cor)
    assert mean["cor_q025"] == pytest.approx(low, abs=1e-5)
    assert mean["cor_q975"] == pytest.approx(high, abs=1e-5)
    # What was dropped from 254 cm comes back as its own heights.
    assert mean["rebound"] == pytest.approx(heights.mean(), rel=1e-4)
    assert mean["rebound"] == pytest.approx(rise(cor.mean() * FALL), rel=1e-12)
    assert mean["rebound_q025"] == pytest.approx(rise(low * FALL), abs=1e-4)
    assert mean["rebound_q975"] == pytest.approx(rise(high * FALL), abs=1e-4)
    assert mean["passes"] > 0.99
    stage_1 = Scene(ball=BallSection(type="stage-1"), flight={"drag": 0.55})
    assert drop_test(dropped(heights), stage_1)["passes"][0] < 0.01
    # Repeats that agree to every digit say nothing of their noise.
    same = drop_test_of(np.full(3, 1.4)).iloc[0]
    for name in ("cor_q025", "rebound_q975", "passes"):
        assert np.isnan(same[name]), name
    assert same["rebound"] == pytest.approx(1.4, rel=1e-9)


def test_the_drag_is_an_error_that_heights_share():
    """0.0043 of COR at 254 cm for 0.08 of the drag; rebounds from 254 cm are heights all the same.
    Speeds have no such error, but where they lead does: 141 cm are 141 cm.
    """
    heights = 1.41 + 0.002 * np.array([-1.0, 0.0, 1.0, 0.5, -0.5] * 4)
    held = drop_test_of(heights).iloc[0]
    usual = drop_test(dropped(heights, scene=Scene()), Scene()).iloc[0]
    wide = {
        name: (frame["cor_q975"] - frame["cor_q025"]) / 3.92
        for name, frame in {"held": held, "usual": usual}.items()
    }
    assert np.sqrt(wide["usual"] ** 2 - wide["held"] ** 2) == pytest.approx(0.0043, abs=4e-4)
    for name in ("rebound", "rebound_q025", "rebound_q975"):
        assert usual[name] == pytest.approx(held[name], rel=1e-12)
    by_speeds = impact_table({"v_y1": np.full(20, FALL), "v_y2": launch(heights)})
    rated = drop_test(by_speeds, Scene()).iloc[0]
    assert rated["cor_q975"] - rated["cor_q025"] == pytest.approx(3.92 * wide["held"], rel=1e-3)
    assert rated["rebound"] == pytest.approx(1.41, abs=1e-3)
    # Of speeds the heights are as sure as the drag: 0.6 % for 0.05 (6.6 to 7.2 % of 0.50 to 0.55).
    width = (rated["rebound_q975"] - rated["rebound_q025"]) / 3.92
    assert width / 1.41 == pytest.approx(0.08 * 0.006 / 0.05, rel=0.35)
    assert rated["passes"] > 0.99


def test_balls_of_a_make_differ_and_another_is_less_sure_than_their_mean():
    """Six balls dropped three times; intervals of the rebound by the second edition's mixed model,
    with the noise as a parameter.
    """
    by_ball = np.array(
        [
            [140.9, 140.2, 140.8],
            [142.3, 143.1, 141.4],
            [140.1, 140.1, 140.5],
            [141.1, 141.2, 142.4],
            [140.8, 142.0, 141.4],
            [140.6, 139.5, 138.3],
        ]
    )
    heights = by_ball.ravel() / 100.0
    table = dropped(heights, ball=tuple("AAABBBCCCDDDEEEFFF"))
    frame = drop_test(table, HELD_DRAG)
    mean = row(frame, kind="mean")
    another = row(frame, kind="another")
    # Heights over 254 cm are the squares of these.
    assert mean["rebound"] == pytest.approx(2.54 * 0.74486**2, abs=1.5e-3)
    assert mean["rebound_q025"] == pytest.approx(2.54 * 0.7419**2, abs=1.5e-3)
    assert mean["rebound_q975"] == pytest.approx(2.54 * 0.74795**2, abs=1.5e-3)
    assert another["passes"] == pytest.approx(0.998, abs=0.004)
    width_of_mean = mean["cor_q975"] - mean["cor_q025"]
    width_of_another = another["cor_q975"] - another["cor_q025"]
    assert width_of_another > 2.0 * width_of_mean
    balls = frame[frame["kind"] == "ball"]
    assert balls["label"].tolist() == list("ABCDEF")
    assert (balls["drops"] == 3).all()
    measured = (launch(heights) / FALL).reshape(6, 3).mean(axis=1)
    centre = mean["cor"]
    # The highest and the lowest ball are drawn to the mean, by less than half.
    shares = (balls["cor"].to_numpy() - centre) / (measured - centre)
    assert 0.5 < shares[1] < 1.0
    assert 0.5 < shares[5] < 1.0
    alike = drop_test(table, Scene(), {"cor_10_spread": "half-normal(1e-4)"})
    balls_alike = alike[alike["kind"] == "ball"]
    assert np.ptp(balls_alike["cor"]) < 0.1 * np.ptp(measured)


def test_balls_dropped_once_are_students_and_another_lies_among_them():
    cor = np.array([0.741, 0.747, 0.738, 0.744, 0.749])
    frame = drop_test_of(rise(cor * FALL), ball=tuple("ABCDE"))
    assert frame["kind"].tolist() == ["mean", "another"]
    for kind, error in (("mean", np.sqrt(0.2)), ("another", np.sqrt(1.2))):
        answer = row(frame, kind=kind)
        low, high = interval_of_mean(cor, error)
        assert answer["cor_q025"] == pytest.approx(low, abs=5e-5), kind
        assert answer["cor_q975"] == pytest.approx(high, abs=5e-5), kind


def test_the_error_of_a_slope_is_one_for_all_groups():
    rng = np.random.default_rng(6)
    group = np.repeat(np.arange(4), 6)
    spread = parse_prior(SPREAD)
    x = np.tile(np.linspace(-1.0, 1.0, 6), 4)
    values = 0.1 * rng.standard_normal(24)
    near = means(values, group, spread, np.random.default_rng(1), x)
    far = means(values, group, spread, np.random.default_rng(1), x + 20.0)
    design = np.column_stack([np.eye(4)[group], x])
    coefficients, (squares,), *_ = np.linalg.lstsq(design, values, rcond=None)
    slope = coefficients[-1]
    error = np.sqrt(squares / (24 - 5) / np.sum(x**2))
    # Seen from far away the level is as sure as the slope, by Student's t of 19 degrees of freedom.
    wanted = np.hypot(20.0 * error * np.sqrt(19 / 17), near.mean.std())
    assert far.mean.std() == pytest.approx(wanted, rel=0.04)
    assert far.point == pytest.approx(near.point - 20.0 * slope, abs=0.01)
    assert np.corrcoef(far.each)[0, 1] > 0.95
    assert np.corrcoef(near.each)[0, 1] < 0.95


def test_several_speeds_make_a_line_and_have_values_of_their_own():
    rng = np.random.default_rng(5)
    fall = np.repeat([1.0, 1.75, 2.54, 3.2], 3)
    speeds = np.sqrt(TWICE_G * fall)
    noise = 0.003 * rng.standard_normal(12)
    cor = 0.82 - 0.011 * speeds + noise
    table = impact_table({"v_y1": speeds, "v_y2": cor * speeds})
    frame = drop_test(table, Scene())
    line = linregress(speeds, cor)
    mean = row(frame, kind="mean")
    assert mean["cor"] == pytest.approx(line.intercept + line.slope * FALL, rel=1e-9)
    # The error of a regression at the speed of the test.
    residuals = cor - line.intercept - line.slope * speeds
    scatter = np.sqrt(np.sum(residuals**2) / 10)
    centred = speeds - speeds.mean()
    leverage = 1 / 12 + (FALL - speeds.mean()) ** 2 / np.sum(centred**2)
    width = 2 * t.ppf(0.975, 10) * scatter * np.sqrt(leverage)
    assert mean["cor_q975"] - mean["cor_q025"] == pytest.approx(width, rel=0.003)
    by_speed = frame[frame["kind"] == "speed"]
    assert by_speed["speed"].to_numpy() == pytest.approx(speeds[::3])
    assert (by_speed["drops"] == 3).all()
    means_by_speed = cor.reshape(4, 3).mean(axis=1)
    assert by_speed["cor"].to_numpy() == pytest.approx(means_by_speed)
    of_balls = cor + 0.01 * (np.arange(12) % 3)
    table = impact_table(
        {"v_y1": speeds, "v_y2": of_balls * speeds},
        labels={"ball": tuple("ABC" * 4)},
    )
    frame = drop_test(table, Scene())
    assert row(frame, kind="mean")["cor"] == pytest.approx(mean["cor"] + 0.01, abs=1e-3)
    balls = frame[frame["kind"] == "ball"]
    assert np.diff(balls["cor"]) == pytest.approx([0.01, 0.01], abs=4e-3)
    low = drop_test_of([0.57, 0.58, 0.575], fall=1.0).iloc[0]
    assert low["speed"] == pytest.approx(landing(1.0))
    assert np.isnan(low["rebound"])
    assert np.isnan(low["passes"])


@pytest.mark.parametrize("slowest", [0.8 * FALL, 1.035 * FALL, 1.06 * FALL])
def test_a_range_of_speeds_leads_to_the_test_by_a_line_where_it_is_near(slowest):
    """Speeds 0.33 m/s apart on average: the test is near at 0.24 m/s, and far at 0.41."""
    rng = np.random.default_rng(2)
    # Far from even, so that no speeds are the settings of a machine.
    steps = np.array([0.0, 0.1, 0.5, 0.8, 1.6, 1.8, 2.2, 2.5, 2.6, 3.0])
    speeds = slowest + steps
    cor = 0.80 - 0.01 * speeds + 0.002 * rng.standard_normal(10)
    table = impact_table({"v_y1": speeds, "v_y2": cor * speeds})
    (mean,) = drop_test(table, HELD_DRAG).to_dict("records")
    assert mean["kind"] == "mean"
    line = linregress(speeds, cor)
    if slowest > FALL + 0.3:
        assert np.isnan(mean["rebound"])
        assert mean["speed"] == pytest.approx(np.median(speeds))
        return
    at_test = line.intercept + line.slope * FALL
    assert mean["speed"] == pytest.approx(FALL, rel=1e-9)
    assert mean["cor"] == pytest.approx(at_test, rel=1e-9)
    assert mean["rebound"] == pytest.approx(rise(at_test * FALL), rel=1e-9)
    assert mean["rebound_q025"] < mean["rebound"] < mean["rebound_q975"]


def test_each_surface_has_its_drops_and_its_ratio_to_the_rigid_one():
    heights = np.array([1.40, 1.41, 1.405, 1.20, 1.22, 1.21])
    surfaces = ("Smooth concrete",) * 3 + ("clay",) * 3
    frame = drop_test_of(heights, surface=surfaces)
    base = row(frame, surface="Smooth concrete")
    clay = row(frame, surface="clay")
    cor = launch(heights) / FALL
    assert base["passes"] > 0.99
    assert np.isnan(clay["passes"])
    assert np.isnan(base["ratio"])
    on_concrete = cor[:3].mean()
    on_clay = cor[3:].mean()
    assert clay["ratio"] == pytest.approx(on_clay / on_concrete, rel=1e-9)
    assert clay["ratio_q025"] < clay["ratio"] < clay["ratio_q975"] < 1.0
    not_rigid = ("hard",) * 3 + ("clay",) * 3
    frame = drop_test_of(heights, surface=not_rigid)
    assert np.isnan(frame["ratio"]).all()
    # On clay alone no ball passes or fails.
    alone = drop_test_of(heights[:3], surface=("clay",) * 3)
    assert np.isnan(alone["passes"][0])
    assert alone["surface"][0] == ""
    clay_court = Scene(surface={"name": "clay"}, flight={"drag": 0.55})
    by_scene = drop_test(dropped(heights[:3]), clay_court)
    assert np.isnan(by_scene["passes"][0])
    # At another speed a ratio would be of speeds.
    fall = np.repeat([2.54, 1.0], 3)
    table = dropped(rise(cor * landing(fall)), fall=fall, surface=surfaces)
    other = drop_test(table, HELD_DRAG)
    assert np.isnan(other["ratio"]).all()
    assert other["cor"].tolist() == pytest.approx([on_concrete, on_clay])


def test_drops_are_called_after_their_surface_where_there_are_several():
    frame = pd.DataFrame(
        {"drop_height [m]": 2.54, "rebound_height [m]": [1.39, 1.40, 1.41, 1.20, 1.21, 1.22]}
    )
    lines = page.sentences(fit_by_hand(frame))
    assert any("Drop test, measured" in line for line in lines)
    surfaces = ["concrete"] * 3 + ["clay"] * 3
    text = "\n".join(page.sentences(fit_by_hand(frame.assign(surface=surfaces)), most=9))
    assert text.count("Drop test on clay, measured") == 1
    assert text.count("Drop test on concrete, measured") == 1


def balls_dropped(restitutions):
    """Five drops of each ball from four heights, of restitutions that scatter by 0.002."""
    heights = np.repeat([0.5, 1.0, 1.5, 2.0], 5)
    scatter = 0.002 * np.sin(7.0 * np.arange(20))
    tables = [
        pd.DataFrame(
            {
                "ball": ball,
                "drop_height [m]": heights,
                "rebound_height [m]": rise((cor + scatter) * landing(heights)),
            }
        )
        for ball, cor in restitutions.items()
    ]
    return pd.concat(tables, ignore_index=True)


def test_each_ball_stands_on_the_first_screen():
    truth = {"A": 0.93, "B": 0.88, "C": 0.73, "D": 0.89}
    fit = fit_by_hand(balls_dropped(truth), scene=HELD_DRAG)
    (line,) = page.sentences(fit)
    by_ball = dict(re.findall(r"([\d.]+) \((\w)\)", line))
    shown = {ball: float(cor) for cor, ball in by_ball.items()}
    assert shown == pytest.approx(truth, abs=0.003)
    # Of many balls the lowest and the highest.
    many = {f"ball{k}": 0.70 + 0.01 * ((5 * k) % 8) for k in range(8)}
    (line,) = page.sentences(fit_by_hand(balls_dropped(many), scene=HELD_DRAG))
    ends = [float(cor) for cor in re.findall(r"([\d.]+) \(ball\d\)", line)]
    assert ends == pytest.approx([0.70, 0.77], abs=0.003)


def test_one_restitution_for_several_balls_is_noted():
    table = load_table(balls_dropped({"A": 0.8, "B": 0.7}), scene=HELD_DRAG)
    problem = build_problem(table, HELD_DRAG, Choices())
    assert problem.forward.levels == ()
    assert [note.code for note in problem.notes].count("balls-as-one") == 1
    by_ball = build_problem(table, HELD_DRAG, Choices(pool={"cor_10": "ball"}))
    assert "balls-as-one" not in {note.code for note in by_ball.notes}
    one_ball = load_table(balls_dropped({"A": 0.8}), scene=HELD_DRAG)
    problem = build_problem(one_ball, HELD_DRAG, Choices())
    assert "balls-as-one" not in {note.code for note in problem.notes}


def test_what_is_no_drop_test_has_none():
    assert drop_test(load_table("wang_all"), Scene()).empty
    oblique = impact_table({"v_x1": 5.0, "v_y1": 7.0, "v_y2": [5.0, 5.1]})
    assert drop_test(oblique, Scene()).empty
    scene = Scene(ball=BallSection(mass=0.005, radius=0.01))
    marble = drop_test(dropped([1.4, 1.41, 1.42]), scene).iloc[0]
    assert marble["cor"] > 0.7
    assert np.isnan(marble["rebound"])


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


def test_drops_on_several_surfaces_have_a_restitution_each_in_the_model():
    drop = np.arange(12)
    heights = 1.4 + 0.005 * np.sin(drop) - 0.2 * (drop > 5)
    surfaces = ("concrete",) * 6 + ("clay",) * 6
    table = dropped(heights, surface=surfaces, ball=tuple("aaabbb" * 2))
    problem = build_problem(table, Scene(), Choices())
    (level,) = problem.forward.levels
    assert level.parameter == "cor_10"
    assert level.labels == ("concrete", "clay")
    names = {quantity.spec.name for quantity in problem.derived}
    assert "rebound_254cm[concrete]" in names
    assert "rebound_254cm[clay]" in names
    assert "rebound_254cm" not in names


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
