"""Drop tests of laboratories, as measured: against Student's t and least squares by scipy."""

import re

import numpy as np
import pandas as pd
import pytest
from made_tables import impact_table
from scipy.stats import linregress, t
from support.fit_by_hand import fit_by_hand
from support.near import assert_near, assert_within
from support.rows import interval_of_mean, row

from fitball.base.priors import ParameterSpec, parse_prior
from fitball.data.read import load_table
from fitball.data.scene import BallSection, Scene
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.report import lab as page
from fitball.report.lab_lines import measured_lines
from fitball.uses.drops import drop_test
from fitball.uses.means import means
from fitball.uses.measured import lab_tests, outcome, with_measured
from fitball.uses.outlying import outlying

SPREAD = ParameterSpec("spread", "", 0.0, np.inf, "half-t(0.1, 4)", "", "")
TWICE_G = 2.0 * 9.80665
# Of a tennis ball in air of 1.2 kg/m^3, with a drag coefficient that is held: 2 g/V^2 [1/m].
HELD_DRAG = Scene(flight={"drag": 0.55})
AREA = np.pi * 0.03302**2
BRAKING = 0.55 * 1.2 * AREA / 0.0576
# V^2, the square of the terminal speed.
TERMINAL = TWICE_G / BRAKING


def landing(height):
    """Speed of a fall: V^2 (1 - exp(-2 g h/V^2)), squared."""
    share = 1.0 - np.exp(-BRAKING * np.asarray(height))
    return np.sqrt(TERMINAL * share)


def launch(height):
    """Speed of a rise: V^2 (exp(2 g r/V^2) - 1), squared."""
    share = np.exp(BRAKING * np.asarray(height)) - 1.0
    return np.sqrt(TERMINAL * share)


def rise(speed):
    """Height of a rise at that speed."""
    share = np.asarray(speed) ** 2 / TERMINAL
    return np.log(1.0 + share) / BRAKING


FALL = landing(2.54)


def dropped(heights, fall=2.54, scene=HELD_DRAG, **labels):
    """Drops from a height [m] and rebounds, a table of heights."""
    columns = {
        "drop_height": np.full(len(heights), fall),
        "rebound_height": heights,
    }
    return load_table({**columns, **labels}, scene=scene)


def drop_test_of(heights, **choices):
    return drop_test(dropped(heights, **choices), HELD_DRAG)


def test_drops_of_a_single_ball_are_students():
    heights = np.array([1.402, 1.395, 1.413, 1.408])
    cor = launch(heights) / FALL
    frame = drop_test_of(heights)
    assert frame["kind"].tolist() == ["mean"]
    mean = frame.iloc[0]
    assert_near(mean["cor"], cor.mean(), 1e-9)
    assert_near(mean["speed"], FALL, 1e-9)
    assert mean["drops"] == 4
    low, high = interval_of_mean(cor)
    assert_within(mean["cor_q025"], low, 1e-5)
    assert_within(mean["cor_q975"], high, 1e-5)
    # What was dropped from 254 cm comes back as its own heights.
    assert_near(mean["rebound"], heights.mean(), 1e-4)
    assert_near(mean["rebound"], rise(cor.mean() * FALL), 1e-12)
    assert_within(mean["rebound_q025"], rise(low * FALL), 1e-4)
    assert_within(mean["rebound_q975"], rise(high * FALL), 1e-4)
    assert mean["passes"] > 0.99
    stage_1 = Scene(ball=BallSection(type="stage-1"), flight={"drag": 0.55})
    assert drop_test(dropped(heights), stage_1)["passes"][0] < 0.01
    # Repeats that agree to every digit say nothing of their noise.
    same = drop_test_of(np.full(3, 1.4)).iloc[0]
    for name in ("cor_q025", "rebound_q975", "passes"):
        assert np.isnan(same[name]), name
    assert_near(same["rebound"], 1.4, 1e-9)


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
    assert_within(np.sqrt(wide["usual"] ** 2 - wide["held"] ** 2), 0.0043, 4e-4)
    for name in ("rebound", "rebound_q025", "rebound_q975"):
        assert_near(usual[name], held[name], 1e-12)
    by_speeds = impact_table(
        {
            "v_y1": np.full(20, FALL),
            "v_y2": launch(heights),
        }
    )
    rated = drop_test(by_speeds, Scene()).iloc[0]
    assert_near(rated["cor_q975"] - rated["cor_q025"], 3.92 * wide["held"], 1e-3)
    assert_within(rated["rebound"], 1.41, 1e-3)
    # Of speeds the heights are as sure as the drag: 0.6 % for 0.05 (6.6 to 7.2 % of 0.50 to 0.55).
    width = (rated["rebound_q975"] - rated["rebound_q025"]) / 3.92
    assert_near(width / 1.41, 0.08 * 0.006 / 0.05, 0.35)
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
    assert_within(mean["rebound"], 2.54 * 0.74486**2, 1.5e-3)
    assert_within(mean["rebound_q025"], 2.54 * 0.7419**2, 1.5e-3)
    assert_within(mean["rebound_q975"], 2.54 * 0.74795**2, 1.5e-3)
    assert_within(another["passes"], 0.998, 0.004)
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
    assert frame["kind"].tolist() == ["mean", "another", *["ball"] * 5]
    balls = frame[frame["kind"] == "ball"]
    assert_near(balls["cor"].to_numpy(), cor, 1e-9)
    assert np.isnan(balls["cor_q025"]).all()
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
    near = means(
        values,
        group,
        spread,
        np.random.default_rng(1),
        x,
    )
    far = means(
        values,
        group,
        spread,
        np.random.default_rng(1),
        x + 20.0,
    )
    design = np.column_stack([np.eye(4)[group], x])
    coefficients, (squares,), *_ = np.linalg.lstsq(
        design,
        values,
        rcond=None,
    )
    slope = coefficients[-1]
    error = np.sqrt(squares / (24 - 5) / np.sum(x**2))
    # Seen from far away the level is as sure as the slope, by Student's t of 19 degrees of freedom.
    wanted = np.hypot(20.0 * error * np.sqrt(19 / 17), near.mean.std())
    assert_near(far.mean.std(), wanted, 0.04)
    assert_within(far.point, near.point - 20.0 * slope, 0.01)
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
    assert_near(mean["cor"], line.intercept + line.slope * FALL, 1e-9)
    # The error of a regression at the speed of the test.
    residuals = cor - line.intercept - line.slope * speeds
    scatter = np.sqrt(np.sum(residuals**2) / 10)
    centred = speeds - speeds.mean()
    leverage = 1 / 12 + (FALL - speeds.mean()) ** 2 / np.sum(centred**2)
    width = 2 * t.ppf(0.975, 10) * scatter * np.sqrt(leverage)
    assert_near(mean["cor_q975"] - mean["cor_q025"], width, 0.003)
    by_speed = frame[frame["kind"] == "speed"]
    assert_near(by_speed["speed"].to_numpy(), speeds[::3])
    assert (by_speed["drops"] == 3).all()
    means_by_speed = cor.reshape(4, 3).mean(axis=1)
    assert_near(by_speed["cor"].to_numpy(), means_by_speed)
    of_balls = cor + 0.01 * (np.arange(12) % 3)
    table = impact_table(
        {"v_y1": speeds, "v_y2": of_balls * speeds},
        labels={"ball": tuple("ABC" * 4)},
    )
    frame = drop_test(table, Scene())
    assert_within(row(frame, kind="mean")["cor"], mean["cor"] + 0.01, 1e-3)
    balls = frame[frame["kind"] == "ball"]
    assert_within(np.diff(balls["cor"]), [0.01, 0.01], 4e-3)
    low = drop_test_of([0.57, 0.58, 0.575], fall=1.0).iloc[0]
    assert_near(low["speed"], landing(1.0))
    assert np.isnan(low["rebound"])
    assert np.isnan(low["passes"])


@pytest.mark.parametrize(("count", "stated"), [(3, 9), (2, 0)])
def test_many_speeds_are_settings_where_each_was_repeated(count, stated):
    """Restitution is 0.39 + 0.257 v - 0.044 v^2 at nine speeds."""
    speed = np.repeat(np.linspace(0.5, 4.5, 9), count)
    cor = 0.39 + 0.257 * speed - 0.044 * speed**2
    frame = drop_test(impact_table({"v_y1": speed, "v_y2": cor * speed}), Scene())
    by_speed = frame[frame["kind"] == "speed"]
    assert_near(by_speed["speed"].to_numpy(), speed[::count][:stated])
    assert_near(by_speed["cor"].to_numpy(), cor[::count][:stated])


@pytest.mark.parametrize(
    "slowest", [0.8 * FALL, 1.035 * FALL, 1.06 * FALL, FALL - 3.24, FALL - 3.41]
)
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
    if slowest > FALL + 0.3 or slowest + steps[-1] < FALL - 0.3:
        assert np.isnan(mean["rebound"])
        assert_near(mean["speed"], np.median(speeds))
        return
    at_test = line.intercept + line.slope * FALL
    assert_near(mean["speed"], FALL, 1e-9)
    assert_near(mean["cor"], at_test, 1e-9)
    assert_near(mean["rebound"], rise(at_test * FALL), 1e-9)
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
    # Of heights, as the ITF's relative rebound.
    assert_near(clay["ratio"], rise(on_clay * FALL) / rise(on_concrete * FALL), 1e-9)
    assert_within(clay["ratio"], 1.21 / 1.405, 1e-4)
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
    table = dropped(
        rise(cor * landing(fall)),
        fall=fall,
        surface=surfaces,
    )
    other = drop_test(table, HELD_DRAG)
    assert np.isnan(other["ratio"]).all()
    assert_near(other["cor"].tolist(), [on_concrete, on_clay])


def test_drops_are_called_after_their_surface_where_there_are_several():
    frame = pd.DataFrame(
        {
            "drop_height [m]": 2.54,
            "rebound_height [m]": [1.39, 1.40, 1.41, 1.20, 1.21, 1.22],
        }
    )
    surfaces = ["concrete"] * 3 + ["clay"] * 3
    lines = measured_lines(fit_by_hand(frame.assign(surface=surfaces)))
    text = "\n".join(lines)
    assert text.count("Drop test on clay: ") == 1
    assert text.count("Drop test on concrete: ") == 1
    assert "on clay" not in "\n".join(measured_lines(fit_by_hand(frame)))


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
    """Of balls that are not of one type there is no mean, and far from 254 cm no standard."""
    truth = {"A": 0.93, "B": 0.88, "C": 0.73, "D": 0.89}
    fit = fit_by_hand(balls_dropped(truth), scene=HELD_DRAG)
    text = "\n".join(measured_lines(fit))
    by_ball = dict(re.findall(r"Ball (\w): COR ([\d.]+)", text))
    shown = {ball: float(cor) for ball, cor in by_ball.items()}
    assert shown == pytest.approx(truth, abs=0.003)
    assert not re.search(r"mean of 4 balls", text)
    apart = re.search(r"balls differ in COR by ([\d.]+)", text)
    assert float(apart[1]) == pytest.approx(0.20, abs=0.006)
    assert "ITF" not in text + str(page.section(fit))
    rows = with_measured(fit)
    assert not rows["median"][:1].isna().any()
    assert "cor_measured" not in rows.index
    assert_within(rows["median"]["cor_measured[C]"], 0.73, 0.003)
    # Of many balls the lowest and the highest.
    many = {f"ball{k}": 0.70 + 0.01 * ((5 * k) % 8) for k in range(8)}
    text = "\n".join(measured_lines(fit_by_hand(balls_dropped(many), scene=HELD_DRAG)))
    ends = [float(cor) for cor in re.findall(r"([\d.]+) \(ball\d\)", text)]
    assert_within(ends, [0.70, 0.77], 0.003)


def test_variance_components_are_those_of_balls_and_repeats():
    """Simulated lots of 24 balls with four drops each: the sds are those that were put in."""
    rng = np.random.default_rng(8)
    balls, repeats = [], []
    for _ in range(12):
        of_ball = 0.004 * rng.standard_normal(24)
        cor = 0.77 + np.repeat(of_ball, 4) + 0.002 * rng.standard_normal(96)
        names = tuple(f"B{k}" for k in range(24) for _ in range(4))
        mean = drop_test_of(rise(cor * FALL), ball=names).iloc[0]
        assert mean["balls"] == 24
        assert mean["agree"]
        assert mean["sd_balls_q025"] < mean["sd_balls"] < mean["sd_balls_q975"]
        assert mean["by_chance"] < 1e-3
        balls.append(mean["sd_balls"])
        repeats.append(mean["sd_repeats"])
    # 0.01 of COR are 3.6 cm here.
    per_cor = (rise(0.775 * FALL) - rise(0.765 * FALL)) / 0.01
    assert_near(np.mean(balls), 0.004 * per_cor, 0.12)
    assert_near(np.mean(repeats), 0.002 * per_cor, 0.05)
    # Balls that are alike differ by chance.
    alike = drop_test_of(rise((0.77 + 0.002 * rng.standard_normal(96)) * FALL), ball=names)
    assert alike["by_chance"][0] > 0.01
    assert alike["sd_balls"][0] < 0.5 * np.mean(balls)


@pytest.mark.parametrize(
    ("passes", "words"),
    [
        (np.nan, ""),
        (0.0, "fails"),
        (0.05, "fails"),
        (0.06, "undecided"),
        (0.94, "undecided"),
        (0.95, "passes"),
        (1.0, "passes"),
    ],
)
def test_balls_pass_or_fail_from_95_percent_on(passes, words):
    assert outcome(passes) == words


def test_lines_of_a_lot_have_the_numbers_of_its_frame():
    """Two balls that fail among six, of which one lies apart."""
    heights = np.repeat([141.0, 142.0, 140.0, 141.5, 133.0, 120.0], 4)
    heights = heights + np.tile([0.1, -0.1, 0.2, -0.2], 6)
    names = tuple("ABCDEF"[k // 4] for k in range(24))
    frame = pd.DataFrame({"drop_height [cm]": 254.0, "rebound_height [cm]": heights, "ball": names})
    fit = fit_by_hand(frame)
    text = "\n".join(measured_lines(fit))
    rows = lab_tests(fit).drops
    assert re.search(r"(\d) pass, (\d) fail \(E and F\), (\d) undecided", text).groups() == (
        "4",
        "2",
        "0",
    )
    ends = re.search(r"Balls: ([\d.]+) cm \(F\) to ([\d.]+) cm \(B\)", text)
    balls = rows[rows["kind"] == "ball"].set_index("label")["rebound"]
    assert_within([float(end) for end in ends.groups()], 100.0 * balls[["F", "B"]], 0.06)
    spreads = re.search(r"balls ([\d.]+) .* and repeats ([\d.]+) ", text)
    sds = [float(sd) for sd in spreads.groups()]
    assert sds == pytest.approx(
        100.0 * rows.loc[0, ["sd_balls", "sd_repeats"]].astype(float), rel=0.1
    )
    assert sds[0] > 10.0 * sds[1]
    mean = re.search(r"Drop test: ([\d.]+) ", text)
    assert float(mean[1]) == pytest.approx(100.0 * rows["rebound"][0], rel=2e-3)


def test_a_ball_that_lies_apart_is_named_and_the_mean_is_given():
    heights = (
        np.array([141.0, 141.4, 140.8, 141.1, 140.6, 141.3, 124.0, 124.5, 141.2, 140.9]) / 100.0
    )
    names = tuple("AABBCCDDEE")
    frame = drop_test_of(heights, ball=names)
    balls = frame[frame["kind"] == "ball"]
    assert balls["label"][balls["outlying"]].tolist() == ["D"]
    assert frame["agree"][0]
    # One of six among four is no outlier of a test: too few.
    assert not drop_test_of(heights[:8], ball=names[:8])["outlying"].any()


def test_outliers_are_those_of_grubbs_and_rosner():
    """The critical values of Grubbs' test at 5 %, two-sided: 1.715 of five, 2.290 of ten; the data
    and the three outliers of Rosner (1983).
    """
    for count, limit in ((5, 1.715), (10, 2.290)):
        # One value away from others that alternate, at so many sds.
        def sample(away, count=count):
            return np.append(np.resize([-1.0, 1.0], count - 1), away)

        def deviation(values):
            return abs(values[-1] - values.mean()) / values.std(ddof=1)

        aways = np.linspace(0.0, 60.0, 20_001)
        sizes = np.array([deviation(sample(away)) for away in aways])
        near = aways[np.argmax(sizes > limit + 0.002)]
        assert outlying(sample(near))[-1]
        below = aways[np.flatnonzero(sizes < limit - 0.002)[-1]]
        assert not outlying(sample(below)).any()
    rosner = [-0.25, 0.68, 0.94, 1.15, 1.20, 1.26, 1.26, 1.34, 1.38, 1.43, 1.49, 1.49, 1.55, 1.56]
    rosner += [1.58, 1.65, 1.69, 1.70, 1.76, 1.77, 1.81, 1.91, 1.94, 1.96, 1.99, 2.06, 2.09, 2.10]
    rosner += [2.14, 2.15, 2.23, 2.24, 2.26, 2.35, 2.37, 2.40, 2.47, 2.54, 2.62, 2.64, 2.90, 2.92]
    rosner += [2.92, 2.93, 3.21, 3.26, 3.30, 3.59, 3.68, 4.30, 4.64, 5.34, 5.42, 6.01]
    found = outlying(np.array(rosner))
    assert np.array(rosner)[found].tolist() == [5.34, 5.42, 6.01]


def test_types_are_judged_by_their_own_limits():
    heights = [1.40, 1.41, 1.405, 1.402]
    large = Scene(ball=BallSection(type="type-3", radius=0.0358), flight={"drag": 0.55})
    assert drop_test(dropped(heights, scene=large), large)["passes"][0] > 0.99
    small = Scene(ball=BallSection(type="type-3", radius=0.033), flight={"drag": 0.55})
    assert np.isnan(drop_test(dropped(heights, scene=small), small)["passes"][0])
    unstated = Scene(ball=BallSection(type="type-3"))
    assert unstated.ball_value().radius == pytest.approx(0.03575)
    stage = Scene(ball=BallSection(type="stage-1", mass=0.049), flight={"drag": 0.55})
    low = [1.26, 1.27, 1.265, 1.268]
    assert drop_test(dropped(low, scene=stage), stage)["passes"][0] > 0.99
    assert drop_test(dropped(heights, scene=stage), stage)["passes"][0] < 0.01


def test_restitutions_of_another_ball_are_at_most_one():
    truth = {"A": 0.98, "B": 0.60, "C": 0.97, "D": 0.90}
    table = load_table(balls_dropped(truth), scene=HELD_DRAG)
    frame = drop_test(table, HELD_DRAG)
    another = row(frame, kind="another")
    assert another["cor_q975"] <= 1.0
    assert row(frame, kind="mean")["cor_q975"] <= 1.0


def test_one_restitution_for_several_balls_is_noted():
    table = load_table(balls_dropped({"A": 0.8, "B": 0.7}), scene=HELD_DRAG)
    problem = build_problem(table, HELD_DRAG, Choices())
    assert problem.forward.levels == ()
    assert [note.code for note in problem.notes].count("balls-as-one") == 1
    by_ball = build_problem(
        table,
        HELD_DRAG,
        Choices(pool={"cor_10": "ball"}),
    )
    assert "balls-as-one" not in {note.code for note in by_ball.notes}
    one_ball = load_table(balls_dropped({"A": 0.8}), scene=HELD_DRAG)
    problem = build_problem(one_ball, HELD_DRAG, Choices())
    assert "balls-as-one" not in {note.code for note in problem.notes}


def test_what_is_no_drop_test_has_none():
    assert drop_test(load_table("wang_all"), Scene()).empty
    oblique = impact_table(
        {
            "v_x1": 5.0,
            "v_y1": 7.0,
            "v_y2": [5.0, 5.1],
        }
    )
    assert drop_test(oblique, Scene()).empty
    scene = Scene(ball=BallSection(mass=0.005, radius=0.01))
    marble = drop_test(dropped([1.4, 1.41, 1.42]), scene).iloc[0]
    assert marble["cor"] > 0.7
    assert np.isnan(marble["rebound"])


def test_drops_on_several_surfaces_have_a_restitution_each_in_the_model():
    drop = np.arange(12)
    heights = 1.4 + 0.005 * np.sin(drop) - 0.2 * (drop > 5)
    surfaces = ("concrete",) * 6 + ("clay",) * 6
    table = dropped(
        heights,
        surface=surfaces,
        ball=tuple("aaabbb" * 2),
    )
    problem = build_problem(table, Scene(), Choices())
    (level,) = problem.forward.levels
    assert level.parameter == "cor_10"
    assert level.labels == ("concrete", "clay")
    names = {quantity.spec.name for quantity in problem.derived}
    assert "rebound_254cm[concrete]" in names
    assert "rebound_254cm[clay]" in names
    assert "rebound_254cm" not in names
