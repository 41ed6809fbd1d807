"""Successive bounces of a ball, as intervals, times or peaks, and the drop before them: against an
integration in time.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.near import assert_near, assert_within
from support.reading import codes_of, notes_of

import fitball
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices

GRAVITY = 9.80665
# What a drag coefficient of one brakes: rho pi R^2/m [1/m].
AREA = np.pi * 0.03302**2
PER_DRAG = 1.2 * AREA / 0.0576


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


def test_intervals_between_sounds_are_speeds():
    """v_y1 = g T_n/2 and v_y2 = g T_(n+1)/2 without air; the ratios are printed ones."""
    intervals = [0.55204, 0.41544, 0.31810, 0.24087, 0.18304, 0.13924]
    vacuum = fitball.Scene(flight={"drag": 0.01})
    columns = {"bounce": range(1, 7), "bounce_interval [s]": intervals}
    table = fitball.load_table(columns, scene=vacuum)
    assert_near(table.values["v_y1"], np.array(intervals[:-1]) * GRAVITY / 2, 2e-4)
    ratios = table.values["v_y2"] / table.values["v_y1"]
    assert_within(ratios, [0.753, 0.766, 0.757, 0.760, 0.761], 6e-4)
    assert table.labels["bounce"] == ("2", "3", "4", "5", "6")
    assert {"series", "flights"} <= {*notes_of(table)}


@pytest.mark.parametrize("form", ["bounce_interval", "bounce_time", "peak_height"])
def test_series_through_air_have_the_restitution_of_the_ball(form):
    times, peaks, landings = bounced(0.76, 0.55)
    columns = {
        "bounce_interval": {
            "bounce": range(1, 7),
            "bounce_interval [ms]": np.diff(times) * 1e3,
        },
        "bounce_time": {"bounce": range(1, 8), "bounce_time": times + 2.5},
        "peak_height": {"bounce": range(6), "peak_height [cm]": peaks * 100.0},
    }[form]
    table = fitball.load_table(columns)
    assert_near(table.values["v_y1"], landings[:5])
    assert_near(table.values["v_y2"] / table.values["v_y1"], [0.76] * 5)


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
        assert_near(table.values["v_y1"], expected)
    order = [3, 0, 5, 1, 4, 2]
    shuffled = {
        "bounce": [number[k] for k in order],
        "run": [run[k] for k in order],
        "bounce_interval": intervals[order],
    }
    table = fitball.load_table(shuffled)
    assert_near(np.sort(table.values["v_y1"]), np.sort(expected))
    assert codes_of(
        {
            "bounce": [1, 1, 2, 2],
            "bounce_interval": [0.55, 0.5, 0.42, 0.38],
        }
    ) == ["bounce-order"]


def test_a_bounce_that_was_not_heard_makes_no_pair():
    columns = {
        "bounce": [1, 2, 4, 5, 6],
        "bounce_interval": [0.55, 0.42, 0.24, 0.18, 0.14],
    }
    table = fitball.load_table(columns)
    assert table.labels["bounce"] == ("2", "5", "6")
    columns = {
        "bounce": [1, 2, 3, 4],
        "bounce_interval": [0.55, 0.42, np.nan, 0.24],
    }
    assert (
        len(
            fitball.load_table(
                {
                    **columns,
                    "bounce_interval": [0.55, 0.42, 0.32, ""],
                }
            )
        )
        == 2
    )


def test_a_drop_beside_the_first_peak():
    """Bounce 1 of a series falls from the drop height, the others from the peak before."""
    columns = {
        "bounce": [1, 2, 3],
        "drop_height": [1.0] * 3,
        "peak_height": [0.55, 0.31, 0.17],
    }
    table = fitball.load_table(columns)
    expected = fitball.load_table(
        {
            "drop_height": [1.0, 0.55, 0.31],
            "rebound_height": [0.55, 0.31, 0.17],
        }
    )
    for name in ("v_y1", "v_y2"):
        assert_near(table.values[name], expected.values[name])


def test_a_drop_and_the_interval_after_it():
    columns = {
        "drop_height": [1.0, 1.0, 1.5],
        "bounce_interval": [0.66, 0.67, 0.80],
    }
    table = fitball.load_table(columns)
    same = {"drop_height": columns["drop_height"], "flight_time_2": columns["bounce_interval"]}
    assert_near(table.values["v_y2"], fitball.load_table(same).values["v_y2"])
    assert_near(table.values["v_y2"][0], 0.66 * GRAVITY / 2, 0.01)
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
    table = fitball.load_table(
        {
            "bounce": numbers,
            "drop_height": drops,
            **heard,
        }
    )
    assert_near(table.values["v_y1"], landings)
    assert_near(table.values["v_y2"], 0.76 * landings)
    assert "not-read" not in notes_of(table)


def test_a_drop_beside_numbered_intervals():
    """A row a series: the drop height, then t1, t2, t3."""
    height, intervals, landings = dropped_and_heard()
    columns = {"drop_height": [height, height]}
    for number in (1, 2, 3):
        columns[f"t{number} (s)"] = [intervals[number - 1]] * 2
    table = fitball.load_table(columns, columns={"bounce_interval": "t* (s)"})
    assert_near(table.values["v_y1"], [*landings[:3]] * 2)
    assert_near(table.values["v_y2"], [*(0.76 * landings[:3])] * 2)


@pytest.mark.parametrize("form", ["intervals", "peaks"])
def test_a_drop_height_begins_a_series_that_is_not_numbered(form):
    """Though the ball that is dropped from 0.32 m rises less than the one before had at last."""
    drops = []
    values = []
    landings = []
    for speed in (5.0, 2.5, 4.0):
        times, peaks, landed = bounced(0.76, 0.55, first=0.76 * speed, count=2)
        terminal = 2.0 * GRAVITY / (0.55 * PER_DRAG)
        drops += [-np.log(1.0 - speed**2 / terminal) * terminal / (2.0 * GRAVITY), ""]
        values += [*(np.diff(times) if form == "intervals" else peaks)]
        landings += [speed, landed[0]]
    name = "bounce_interval" if form == "intervals" else "peak_height"
    table = fitball.load_table({"drop_height": drops, name: values})
    assert_near(table.values["v_y1"], landings)
    assert_near(table.values["v_y2"], 0.76 * np.array(landings))


def test_a_drop_is_none_of_a_bounce_that_was_not_the_first():
    height, intervals, landings = dropped_and_heard()
    columns = {
        "bounce": [2, 3, 4],
        "drop_height": [height] * 3,
        "bounce_interval": intervals[1:4],
    }
    table = fitball.load_table(columns)
    assert_near(table.values["v_y1"], landings[2:4])


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
    assert_near(table.sd["v_y1"][0], falls.std(), 0.02)
    assert_near(table.sd["v_y2"], [2e-3 * GRAVITY / 2] * 3, 0.03)
    assert_near(table.corr["v_y1,v_y2"], [0.0, -0.5, -0.5])


def test_another_drag_moves_a_drop_as_its_formula_says():
    """The first bounce is kept as a flight: with a drag of 0.63 it lands as the fall does."""
    height, intervals, _ = dropped_and_heard()
    columns = {
        "bounce": [1, 2],
        "drop_height": [height, ""],
        "bounce_interval": intervals[:2],
    }
    speeds = {}
    for drag in (0.55, 0.63):
        scene = fitball.Scene(flight={"drag": drag})
        speeds[drag] = fitball.load_table(columns, scene=scene).values["v_y1"][0]
    problem = build_problem(
        fitball.load_table(columns),
        fitball.Scene(),
        Choices(),
    )
    measured = problem.table.impacts
    moved = problem.fall.true_states({"drag": np.array([0.63])}, measured).v_y1[0, 0]
    shift = speeds[0.63] - speeds[0.55]
    assert_near(moved - measured.v_y1[0], shift, 0.03)
    assert shift < -0.005


def test_neighbouring_intervals_share_the_error_of_a_time():
    """By a Monte Carlo of times with errors of 1 ms."""
    times, _, _ = bounced(0.76, 0.55, count=3)
    sd = np.full(4, 1e-3)
    table = fitball.load_table({"bounce_time": times, "bounce_time_sd": sd})
    rng = np.random.default_rng(1)
    drawn = times + 1e-3 * rng.standard_normal((4000, 4))
    speeds = np.diff(drawn, axis=1) * GRAVITY / 2
    assert_near(table.sd["v_y1"], speeds[:, :2].std(axis=0), 0.05)
    assert_near(table.sd["v_y2"], speeds[:, 1:].std(axis=0), 0.05)
    expected = np.corrcoef(speeds[:, 0], speeds[:, 1])[0, 1]
    assert_within(table.corr["v_y1,v_y2"], [expected] * 2, 0.05)
    intervals = {
        "bounce_interval": np.diff(times),
        "bounce_interval_sd": [1.4e-3] * 3,
    }
    assert_near(fitball.load_table(intervals).corr["v_y1,v_y2"], [-0.5, -0.5])


def test_what_is_no_series_is_refused():
    assert codes_of({"bounce_time": [0.0, 552.0, 967.0, 1285.0]})[0] == "out-of-limits"
    both = {
        "bounce_time": [0.0, 0.55, 0.97],
        "bounce_interval": [0.55, 0.42, 0.32],
    }
    assert "two-series" in codes_of(both)
    numbers = {
        "bounce": ["1", "second", "3"],
        "bounce_interval": [0.55, 0.42, 0.32],
    }
    assert "bounce-number" in codes_of(numbers)


def test_flights_of_a_fit_depend_on_the_drag():
    """Flown with a drag of 0.45, read at the usual one: the truth is within. At the true drag the
    restitution is the true one.
    """
    times, _, _ = bounced(
        0.76,
        0.45,
        first=6.0,
        count=8,
    )
    noise = 2e-4 * np.random.default_rng(3).standard_normal(9)
    columns = {"bounce_time": times + noise}
    stated = fitball.Scene(flight={"drag": 0.45})
    known = fitball.calibrate(
        columns,
        scene=stated,
        max_steps=600,
        cores=1,
    )
    assert_within(known.summary.loc["cor_median", "median"], 0.76, 0.002)
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
    assert_near(seen["median"].to_numpy(), seen["observed"].to_numpy(), 0.01)


@pytest.mark.parametrize("numbers", [[3, 2, 1, 0], [0, 1, 2, 4], [1, 0, 3, 2]])
def test_numbers_of_bounces_in_any_order_are_no_rebound_heights(numbers):
    peaks = {0: 1.0, 1: 0.56, 2: 0.31, 3: 0.18, 4: 0.1}
    columns = {"bounce": numbers, "peak_height": [peaks[number] for number in numbers]}
    assert "not-read" not in notes_of(fitball.load_table(columns))


def test_two_forms_of_one_series_are_one_fault():
    columns = {"bounce": [1, 2, 3], "bounce_time": [0.0, 0.66, 1.16]}
    both = {**columns, "bounce_interval": [0.66, 0.5, 0.38]}
    assert codes_of(both) == ["two-series"]
