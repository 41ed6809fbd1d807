"""Forms in which restitution is measured: ratios, series of bounces, moving surfaces."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fitball
from fitball.base.errors import InputError
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices

GRAVITY = 9.80665
PER_DRAG = 1.2 * np.pi * 0.03302**2 / 0.0576
RACKET = np.array(
    [
        [23.3, 13.7, 28.9],
        [13.0, 15.3, 27.4],
        [21.6, 8.0, 19.8],
        [18.5, 20.3, 35.9],
        [17.2, 18.4, 32.0],
        [16.4, 21.5, 36.6],
    ]
)


def codes_of(columns, **reading):
    with pytest.raises(InputError) as refusal:
        fitball.load_table(columns, **reading)
    return [fault.code for fault in refusal.value.faults]


def notes_of(table):
    return [note.code for note in table.notices]


def bounced(cor, drag, first=3.0, count=6):
    """Times and peaks of a ball that bounces with a restitution in such a drag, and the landing
    speeds, by an integration in time.
    """
    braking = drag * PER_DRAG

    def slope(_, state):
        return [state[1], -GRAVITY - 0.5 * braking * abs(state[1]) * state[1]]

    def lands(_, state):
        return state[0]

    def turns(_, state):
        return state[1]

    lands.terminal = True
    lands.direction = -1.0
    times = [0.0]
    peaks = []
    landings = []
    speed = first
    for _ in range(count):
        flight = solve_ivp(
            slope, (0.0, 5.0), [0.0, speed], events=[lands, turns], rtol=1e-10, atol=1e-12
        )
        times.append(times[-1] + flight.t_events[0][-1])
        peaks.append(flight.y_events[1][-1, 0])
        landings.append(-flight.y_events[0][-1, 1])
        speed = cor * landings[-1]
    return np.array(times), np.array(peaks), np.array(landings)


# ---- coefficients of restitution


def test_cor_makes_the_rebound_speed():
    """The commonest published form: speed, coefficient, its error."""
    columns = {"v_y1 [m/s]": [2.1, 9.1], "cor": [0.81, 0.70], "cor_sd": [0.01, 0.01]}
    table = fitball.load_table(columns)
    assert [*table.values] == ["v_y1", "v_y2"]
    assert table.values["v_y2"] == pytest.approx([1.701, 6.37])
    assert table.sd["v_y2"] == pytest.approx([0.021, 0.091])
    assert not table.corr
    assert "cor" in notes_of(table)


@pytest.mark.parametrize("head", ["COR", "Cor (%)", "cor [%]", "C.O.R."])
def test_cor_as_people_head_it(head):
    factor = 100.0 if "%" in head else 1.0
    table = fitball.load_table({"v_y1": [5.0, 6.0], head: [0.75 * factor, 0.74 * factor]})
    assert table.values["v_y2"] == pytest.approx([3.75, 4.44])


def test_cor_in_percent_without_the_sign_is_refused():
    assert codes_of({"v_y1": [5.0, 6.0], "cor": [75, 74]}) == ["out-of-limits"] * 2


def test_an_error_of_the_speed_goes_into_both():
    """By a Monte Carlo of both errors."""
    columns = {"v_y1": ["5.0 ± 0.2"] * 2, "cor": ["0.75 ± 0.02"] * 2}
    table = fitball.load_table(columns)
    rng = np.random.default_rng(2)
    v_y1 = 5.0 + 0.2 * rng.standard_normal(200_000)
    v_y2 = v_y1 * (0.75 + 0.02 * rng.standard_normal(200_000))
    assert table.sd["v_y2"] == pytest.approx([v_y2.std()] * 2, rel=0.01)
    expected = np.corrcoef(v_y1, v_y2)[0, 1]
    assert table.corr["v_y1,v_y2"] == pytest.approx([expected] * 2, abs=0.01)


def test_cor_of_oblique_impacts_is_that_of_the_vertical_speeds():
    columns = {"v_1": [20.0, 20.0], "theta_1": [30.0, 45.0], "cor": [0.8, 0.75], "v_x2": [12, 9]}
    table = fitball.load_table(columns)
    expected = 20.0 * np.sin(np.radians([30.0, 45.0])) * [0.8, 0.75]
    assert table.values["v_y2"] == pytest.approx(expected)


def test_cor_beside_speeds_is_compared_and_not_used():
    speeds = {"v_y1": [5.0, 6.0, 7.0], "v_y2": [3.75, 4.44, 5.11]}
    table = fitball.load_table({**speeds, "cor": [0.75, 0.74, 0.73]})
    assert table.values["v_y2"] == pytest.approx(speeds["v_y2"])
    assert "disagreement" not in notes_of(table)
    table = fitball.load_table({**speeds, "cor": [0.75, 0.74, 0.78]})
    assert "disagreement" in notes_of(table)
    assert codes_of({**speeds, "cor": [0.75, 0.74, 0.37]}) == ["contradiction"]
    ignored = fitball.load_table({**speeds, "cor": [0.75, 0.74, 0.37]}, ignore="cor")
    assert ignored.values["v_y2"] == pytest.approx(speeds["v_y2"])


@pytest.mark.parametrize("power", [0.5, 1.0])
def test_cor_beside_heights_may_be_of_heights(power):
    """People compute it without air, as a root of heights or even without the root."""
    heights = {"drop_height": [2.54] * 3, "rebound_height": [1.40, 1.42, 1.38]}
    ratio = np.array(heights["rebound_height"]) / 2.54
    table = fitball.load_table({**heights, "cor": ratio**power})
    assert "disagreement" not in notes_of(table)
    assert table.values["v_y2"] == pytest.approx(fitball.load_table(heights).values["v_y2"])
    assert table.read[0]["heights"] == "v_y1,v_y2"


def test_cor_of_drops_is_of_speeds_unless_it_may_be_of_heights():
    drops = {"drop_height [cm]": [100, 150, 200]}
    table = fitball.load_table({**drops, "cor": [0.78, 0.77, 0.76]})
    ratio = table.values["v_y2"] / table.values["v_y1"]
    assert ratio == pytest.approx([0.78, 0.77, 0.76])
    doubtful = {**drops, "cor": [0.57, 0.56, 0.55]}
    assert codes_of(doubtful) == ["ambiguous-cor"]
    speeds = fitball.load_table(doubtful, columns={"cor": "cor"})
    assert speeds.values["v_y2"] / speeds.values["v_y1"] == pytest.approx(doubtful["cor"])
    heights = fitball.load_table(doubtful, columns={"height_ratio": "cor"})
    risen = fitball.load_table({**drops, "rebound_height [cm]": [57.0, 84.0, 110.0]})
    assert heights.values["v_y2"] == pytest.approx(risen.values["v_y2"])


def test_the_size_of_cor_says_nothing_of_other_balls(tmp_path):
    """A golf ball on turf."""
    file = tmp_path / "turf.csv"
    file.write_text("drop_height,cor\n1.0,0.55\n1.5,0.54\n")
    file.with_suffix(".toml").write_text("[ball]\nmass = 0.0459\nradius = 0.02135\n")
    table = fitball.load_table(file)
    assert table.values["v_y2"] / table.values["v_y1"] == pytest.approx([0.55, 0.54])


def test_a_ratio_of_heights_needs_the_drop():
    assert "no-drop-height" in codes_of({"v_y1": [5.0, 6.0], "height_ratio": [0.5, 0.5]})


@pytest.mark.parametrize("label", ["court", "color", "corner", "core", "surface speed"])
def test_labels_of_like_names_stay_labels(label):
    columns = {"v_y1": [5.0, 6.0], "v_y2": [3.9, 4.6], label: ["fast", "slow"]}
    table = fitball.load_table(columns)
    assert table.labels[label] == ("fast", "slow")


# ---- successive bounces


def test_intervals_between_sounds_are_speeds():
    """v_y1 = g T_n/2 and v_y2 = g T_(n+1)/2 without air; the ratios are printed ones."""
    intervals = [0.55204, 0.41544, 0.31810, 0.24087, 0.18304, 0.13924]
    vacuum = fitball.Scene(flight={"drag": 0.01})
    columns = {"bounce": range(1, 7), "bounce_interval [s]": intervals}
    table = fitball.load_table(columns, scene=vacuum)
    assert table.values["v_y1"] == pytest.approx(np.array(intervals[:-1]) * GRAVITY / 2, rel=2e-4)
    ratios = table.values["v_y2"] / table.values["v_y1"]
    assert ratios == pytest.approx([0.753, 0.766, 0.757, 0.760, 0.761], abs=6e-4)
    assert table.labels["bounce"] == ("2", "3", "4", "5", "6")
    assert {"series", "flights"} <= {*notes_of(table)}


@pytest.mark.parametrize("form", ["bounce_interval", "bounce_time", "peak_height"])
def test_series_through_air_have_the_restitution_of_the_ball(form):
    times, peaks, landings = bounced(0.76, 0.55)
    columns = {
        "bounce_interval": {"bounce": range(1, 7), "bounce_interval [ms]": np.diff(times) * 1e3},
        "bounce_time": {"bounce": range(1, 8), "bounce_time": times + 2.5},
        "peak_height": {"bounce": range(6), "peak_height [cm]": peaks * 100.0},
    }[form]
    table = fitball.load_table(columns)
    assert table.values["v_y1"] == pytest.approx(landings[:5], rel=1e-6)
    assert table.values["v_y2"] / table.values["v_y1"] == pytest.approx([0.76] * 5, rel=1e-6)


def test_series_one_after_the_other_are_told_apart():
    """By a column, by the number of the bounce, by an interval that is longer than the one before;
    in any order where numbers and runs say it.
    """
    intervals = np.array([0.55, 0.42, 0.32, 0.5, 0.38, 0.29])
    number = [1, 2, 3, 1, 2, 3]
    run = ["a", "a", "a", "b", "b", "b"]
    plain = fitball.load_table({"bounce_interval": intervals})
    expected = plain.values["v_y1"]
    assert len(plain) == 4
    for labels in ({"bounce": number}, {"run": run}, {"Bounce #": number, "Trial": run}):
        table = fitball.load_table({**labels, "bounce_interval": intervals})
        assert table.values["v_y1"] == pytest.approx(expected)
    order = [3, 0, 5, 1, 4, 2]
    shuffled = {
        "bounce": [number[k] for k in order],
        "run": [run[k] for k in order],
        "bounce_interval": intervals[order],
    }
    table = fitball.load_table(shuffled)
    assert np.sort(table.values["v_y1"]) == pytest.approx(np.sort(expected))
    assert codes_of({"bounce": [1, 1, 2, 2], "bounce_interval": [0.55, 0.5, 0.42, 0.38]}) == [
        "bounce-order"
    ]


def test_a_bounce_that_was_not_heard_makes_no_pair():
    columns = {"bounce": [1, 2, 4, 5, 6], "bounce_interval": [0.55, 0.42, 0.24, 0.18, 0.14]}
    table = fitball.load_table(columns)
    assert table.labels["bounce"] == ("2", "5", "6")
    columns = {"bounce": [1, 2, 3, 4], "bounce_interval": [0.55, 0.42, np.nan, 0.24]}
    assert len(fitball.load_table({**columns, "bounce_interval": [0.55, 0.42, 0.32, ""]})) == 2


def test_a_drop_beside_the_first_peak():
    """Bounce 1 of a series falls from the drop height, the others from the peak before."""
    columns = {"bounce": [1, 2, 3], "drop_height": [1.0] * 3, "peak_height": [0.55, 0.31, 0.17]}
    table = fitball.load_table(columns)
    expected = fitball.load_table(
        {"drop_height": [1.0, 0.55, 0.31], "rebound_height": [0.55, 0.31, 0.17]}
    )
    for name in ("v_y1", "v_y2"):
        assert table.values[name] == pytest.approx(expected.values[name])


def test_a_drop_and_the_interval_after_it():
    columns = {"drop_height": [1.0, 1.0, 1.5], "bounce_interval": [0.66, 0.67, 0.80]}
    table = fitball.load_table(columns)
    same = {"drop_height": columns["drop_height"], "flight_time_2": columns["bounce_interval"]}
    assert table.values["v_y2"] == pytest.approx(fitball.load_table(same).values["v_y2"])
    assert table.values["v_y2"][0] == pytest.approx(0.66 * GRAVITY / 2, rel=0.01)
    assert len(table) == 3


def dropped_and_heard(drag=0.55):
    """The height from which a ball falls that bounces five times, and the intervals that are heard.
    It falls by v^2 = V^2 (1 - exp(-2 g h/V^2)).
    """
    times, _, landings = bounced(0.76, drag, first=0.76 * 5.0)
    terminal = 2.0 * GRAVITY / (drag * PER_DRAG)
    height = -np.log(1.0 - 25.0 / terminal) * terminal / (2.0 * GRAVITY)
    return height, np.diff(times), np.array([5.0, *landings[:5]])


@pytest.mark.parametrize("everywhere", [False, True])
@pytest.mark.parametrize("form", ["intervals", "times"])
def test_a_drop_before_the_first_interval(form, everywhere):
    """The first bounce falls from the drop height, the others from the flight before."""
    height, intervals, landings = dropped_and_heard()
    numbers = np.arange(1, len(intervals) + 1)
    heard = {"bounce_interval": intervals}
    if form == "times":
        numbers = np.arange(1, len(intervals) + 2)
        heard = {"bounce_time": 1.3 + np.array([0.0, *np.cumsum(intervals)])}
    drops = [height] + [height if everywhere else ""] * (len(numbers) - 1)
    table = fitball.load_table({"bounce": numbers, "drop_height": drops, **heard})
    assert table.values["v_y1"] == pytest.approx(landings, rel=1e-6)
    assert table.values["v_y2"] == pytest.approx(0.76 * landings, rel=1e-6)
    assert "not-read" not in notes_of(table)


def test_a_drop_beside_numbered_intervals():
    """A row a series: the drop height, then t1, t2, t3."""
    height, intervals, landings = dropped_and_heard()
    columns = {"drop_height": [height, height]}
    for number in (1, 2, 3):
        columns[f"t{number} (s)"] = [intervals[number - 1]] * 2
    table = fitball.load_table(columns, columns={"bounce_interval": "t* (s)"})
    assert table.values["v_y1"] == pytest.approx([*landings[:3]] * 2, rel=1e-6)
    assert table.values["v_y2"] == pytest.approx([*(0.76 * landings[:3])] * 2, rel=1e-6)


def test_a_drop_is_none_of_a_bounce_that_was_not_the_first():
    height, intervals, landings = dropped_and_heard()
    columns = {"bounce": [2, 3, 4], "drop_height": [height] * 3, "bounce_interval": intervals[1:4]}
    table = fitball.load_table(columns)
    assert table.values["v_y1"] == pytest.approx(landings[2:4], rel=1e-6)


def test_errors_of_a_drop_and_of_intervals_are_independent():
    """By a Monte Carlo of a height with an error of 1 cm and intervals with one of 2 ms."""
    height, intervals, _ = dropped_and_heard()
    columns = {
        "bounce": [1, 2, 3],
        "drop_height": [f"{height} ± 0.01", "", ""],
        "bounce_interval": intervals[:3],
        "bounce_interval_sd": [2e-3] * 3,
    }
    table = fitball.load_table(columns)
    rng = np.random.default_rng(5)
    terminal = 2.0 * GRAVITY / (0.55 * PER_DRAG)
    drawn = height + 0.01 * rng.standard_normal(100_000)
    falls = np.sqrt(terminal * (1.0 - np.exp(-2.0 * GRAVITY * drawn / terminal)))
    assert table.sd["v_y1"][0] == pytest.approx(falls.std(), rel=0.02)
    assert table.sd["v_y2"] == pytest.approx([2e-3 * GRAVITY / 2] * 3, rel=0.03)
    assert table.corr["v_y1,v_y2"] == pytest.approx([0.0, -0.5, -0.5])


def test_another_drag_moves_a_drop_as_its_formula_says():
    """The first bounce is kept as a flight: with a drag of 0.63 it lands as the fall does."""
    height, intervals, _ = dropped_and_heard()
    columns = {"bounce": [1, 2], "drop_height": [height, ""], "bounce_interval": intervals[:2]}
    speeds = {}
    for drag in (0.55, 0.63):
        scene = fitball.Scene(flight={"drag": drag})
        speeds[drag] = fitball.load_table(columns, scene=scene).values["v_y1"][0]
    problem = build_problem(fitball.load_table(columns), fitball.Scene(), Choices())
    measured = problem.table.impacts
    moved = problem.fall.true_states({"drag": np.array([0.63])}, measured).v_y1[0, 0]
    shift = speeds[0.63] - speeds[0.55]
    assert moved - measured.v_y1[0] == pytest.approx(shift, rel=0.03)
    assert shift < -0.005


def test_neighbouring_intervals_share_the_error_of_a_time():
    """By a Monte Carlo of times with errors of 1 ms."""
    times, _, _ = bounced(0.76, 0.55, count=3)
    sd = np.full(4, 1e-3)
    table = fitball.load_table({"bounce_time": times, "bounce_time_sd": sd})
    rng = np.random.default_rng(1)
    drawn = times + 1e-3 * rng.standard_normal((4000, 4))
    speeds = np.diff(drawn, axis=1) * GRAVITY / 2
    assert table.sd["v_y1"] == pytest.approx(speeds[:, :2].std(axis=0), rel=0.05)
    assert table.sd["v_y2"] == pytest.approx(speeds[:, 1:].std(axis=0), rel=0.05)
    expected = np.corrcoef(speeds[:, 0], speeds[:, 1])[0, 1]
    assert table.corr["v_y1,v_y2"] == pytest.approx([expected] * 2, abs=0.05)
    intervals = {"bounce_interval": np.diff(times), "bounce_interval_sd": [1.4e-3] * 3}
    assert fitball.load_table(intervals).corr["v_y1,v_y2"] == pytest.approx([-0.5, -0.5])


def test_what_is_no_series_is_refused():
    assert codes_of({"bounce_time": [0.0, 552.0, 967.0, 1285.0]})[0] == "out-of-limits"
    both = {"bounce_time": [0.0, 0.55, 0.97], "bounce_interval": [0.55, 0.42, 0.32]}
    assert "two-series" in codes_of(both)
    numbers = {"bounce": ["1", "second", "3"], "bounce_interval": [0.55, 0.42, 0.32]}
    assert "bounce-number" in codes_of(numbers)


def test_flights_of_a_fit_depend_on_the_drag():
    """Flown with a drag of 0.45, read at the usual one: the truth is within. At the true drag the
    restitution is the true one.
    """
    times, _, _ = bounced(0.76, 0.45, first=6.0, count=8)
    noise = 2e-4 * np.random.default_rng(3).standard_normal(9)
    columns = {"bounce_time": times + noise}
    stated = fitball.Scene(flight={"drag": 0.45})
    known = fitball.calibrate(columns, scene=stated, max_steps=600, cores=1)
    assert known.summary.loc["cor_median", "median"] == pytest.approx(0.76, abs=0.002)
    fit = fitball.calibrate(columns, max_steps=600, cores=1)
    low, high = fit.summary.loc["cor_median", ["q025", "q975"]]
    assert low < 0.76 < high
    fall = fit.problem.fall
    assert fall.flown_in.all()
    assert fall.flown_out.all()
    assert not fall.dropped.any()
    predictions = fit.predict(columns).frames["predictions"]
    seen = predictions[(predictions["column"] == "v_y2") & predictions["observed"].notna()]
    assert len(seen) == len(fit.run.table)
    assert seen["median"].to_numpy() == pytest.approx(seen["observed"].to_numpy(), rel=0.01)


# ---- moving surfaces


def test_a_racket_sees_the_ball_faster():
    ball_in, racket, ball_out = RACKET.T
    columns = {"v_y1": ball_in, "surface_speed": racket, "v_y2": ball_out}
    table = fitball.load_table(columns)
    assert table.values["v_y1"] == pytest.approx(ball_in + racket)
    assert table.values["v_y2"] == pytest.approx(ball_out - racket)
    assert "moving-surface" in notes_of(table)
    assert np.median(table.values["v_y2"] / table.values["v_y1"]) == pytest.approx(0.40, abs=0.02)
    flipped = fitball.load_table({**columns, "surface_speed": -racket}, flip="surface_speed")
    assert flipped.values["v_y1"] == pytest.approx(table.values["v_y1"])
    assert {*codes_of({**columns, "surface_speed": -racket})} >= {"moving-surface"}


def test_an_error_of_the_surface_moves_both_velocities():
    """By a Monte Carlo of all three errors."""
    columns = {
        "v_y1": ["20 ± 0.3"] * 2,
        "surface_speed": ["10 ± 0.2"] * 2,
        "v_y2": ["24 ± 0.4"] * 2,
    }
    table = fitball.load_table(columns)
    rng = np.random.default_rng(4)
    draws = [20, 10, 24] + [0.3, 0.2, 0.4] * rng.standard_normal((200_000, 3))
    before, racket, after = draws.T
    seen = np.array([before + racket, after - racket])
    assert table.sd["v_y1"] == pytest.approx([seen[0].std()] * 2, rel=0.01)
    assert table.sd["v_y2"] == pytest.approx([seen[1].std()] * 2, rel=0.01)
    assert table.corr["v_y1,v_y2"] == pytest.approx([np.corrcoef(seen)[0, 1]] * 2, abs=0.01)


def test_a_fit_to_rackets_says_whose_frame_it_is():
    """The restitution is that between ball and racket, 0.42 in the mean of its making."""
    ball_in, racket, ball_out = RACKET.T
    columns = {"v_y1": ball_in, "surface_speed": racket, "v_y2": ball_out}
    fit = fitball.calibrate(columns, point_only=True)
    assert fit.summary.loc["cor_median", "point"] == pytest.approx(0.40, abs=0.01)
    [line] = [line for line in fit.report().splitlines()[:8] if "moving surface" in line]
    assert line


def test_oblique_impacts_on_a_moving_surface():
    columns = {
        "v_1 [m/s]": [20.0, 25.0],
        "theta_1": [60.0, 45.0],
        "surface_speed": [5.0, 6.0],
        "v_2": [15.0, 16.0],
        "theta_2": [50.0, 60.0],
        "omega_2": [100.0, 150.0],
    }
    table = fitball.load_table(columns)
    down = np.array([20.0, 25.0]) * np.sin(np.radians([60.0, 45.0]))
    up = np.array([15.0, 16.0]) * np.sin(np.radians([50.0, 60.0]))
    assert table.values["v_x1"] == pytest.approx([10.0, 25.0 / np.sqrt(2.0)])
    assert table.values["v_y1"] == pytest.approx(down + np.array([5.0, 6.0]))
    assert table.values["v_y2"] == pytest.approx(up - [5.0, 6.0])
    assert table.values["omega_2"] == pytest.approx([100.0, 150.0])
    alone = {name: columns[name] for name in ("v_1 [m/s]", "theta_1", "surface_speed", "v_2")}
    assert "moving-surface" in codes_of(alone)


def test_cor_on_a_moving_surface():
    table = fitball.load_table({"v_y1": [20, 18], "surface_speed": [10, 12], "cor": [0.4, 0.41]})
    assert table.values["v_y2"] == pytest.approx([12.0, 12.3])


# ---- what unknown columns may mean

# A table as people write it, and what its columns are.
PROPOSED = {
    "V1 (m/s),V2 (m/s)\n5,4\n6,4.5\n": ["v_y1", "v_y2"],
    "v_in,v_out\n5,4\n6,4.5\n": ["v_y1", "v_y2"],
    "impact speed [m/s];rebound speed [m/s]\n5;4\n6;4,5\n": ["v_y1", "v_y2"],
    "v_in,v_out,angle_in\n5,4,30\n6,4.5,30\n": ["v_1", "v_2", "theta_1"],
    "Impact velocity (m/s),e\n5,0.8\n6,0.75\n": ["v_y1", "cor"],
    "speed (mph),COR\n5,0.8\n6,0.75\n": ["v_y1"],
    "v [m/s],coefficient of restitution\n5,0.8\n6,0.75\n": ["v_y1", "cor"],
    "Drop height (cm),Restitution\n50,0.8\n100,0.75\n": ["cor"],
    "Drop height (cm),h2/h1\n50,0.6\n100,0.59\n": ["height_ratio"],
    "bounce,interval [s]\n1,0.55\n2,0.42\n3,0.32\n": ["bounce_interval"],
    "run,Bounce #,T (ms)\n1,1,0\n1,2,550\n1,3,1000\n1,4,1320\n": ["bounce_time"],
    "run,Bounce #,T (ms)\n1,1,550\n1,2,420\n1,3,320\n": ["bounce_interval"],
    "Aufprall-Nr.;Zeit in s\n1;0,13\n2;0,68\n3;1,1\n4;1,42\n": ["bounce_time"],
    "drop height (m),time of flight (s)\n1,0.66\n1,0.67\n1.5,0.8\n": ["bounce_interval"],
    "Bounce number,Height (cm)\n0,100\n1,56\n2,32\n3,18\n": ["peak_height"],
    "bounce,bounce height (m)\n0,1.00\n1,.56\n2,.32\n3,.18\n": ["peak_height"],
    "shot,Ball in (m/s),Racket speed (m/s),Ball out (m/s)\n1,23.3,13.7,28.9\n2,13,15.3,27.4\n": [
        "v_y1",
        "v_y2",
        "surface_speed",
    ],
    "pitch speed (mph),bat speed (mph),exit speed (mph)\n80,60,90\n82,61,91\n": [
        "v_y1",
        "v_y2",
        "surface_speed",
    ],
}


def proposed(error):
    """The columns that a refusal proposes, as `--columns` takes them."""
    [text] = {fault.message.split('--columns "')[1].split('"')[0] for fault in error.faults[:1]}
    return dict(pair.split("=", 1) for pair in text.split(","))


@pytest.mark.parametrize("text", PROPOSED)
def test_what_is_proposed_can_be_read(text, tmp_path):
    file = tmp_path / "bounces.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refusal:
        fitball.load_table(file)
    columns = proposed(refusal.value)
    assert [*columns] == PROPOSED[text]
    table = fitball.load_table(file, columns=columns)
    assert len(table) >= 1
    assert not {note.code for note in table.notices} & {"not-read"}


def test_a_ratio_is_proposed_as_neither():
    columns = {"drop height (cm)": [100, 150], "rebound ratio": [0.56, 0.55]}
    assert codes_of(columns)[0] == "ambiguous-cor"


def test_a_racket_that_was_not_named_is_named():
    columns = dict(zip(("Ball in (m/s)", "Racket speed (m/s)", "Ball out"), RACKET.T, strict=True))
    named = {"v_y1": "Ball in (m/s)", "v_y2": "Ball out"}
    with pytest.raises(InputError) as refusal:
        fitball.load_table(columns, columns=named)
    assert {fault.code for fault in refusal.value.faults} == {"restitution"}
    assert proposed(refusal.value) == {**named, "surface_speed": "Racket speed (m/s)"}


def test_a_ball_at_rest_is_hit():
    columns = {"v_y1": [0.0, 0.0], "surface_speed": [40.0, 41.0], "v_y2": [57.0, 58.0]}
    assert fitball.load_table(columns).values["v_y2"] == pytest.approx([17.0, 17.0])


@pytest.mark.parametrize("name", ["time", "interval", "height", "e", "racket speed", "bounce"])
def test_other_columns_of_a_good_table_are_not_proposed(name):
    """A column beside velocities that are there is none of another form."""
    columns = {"v_y1": [5.0, 6.0, 7.0], "v_y2": [3.9, 4.6, 5.3], name: [1, 2, 3]}
    table = fitball.load_table(columns)
    assert [*table.values] == ["v_y1", "v_y2"]
    if name != "racket speed":
        assert "series" not in notes_of(table)
