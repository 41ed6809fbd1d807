"""Forms in which restitution is measured: ratios, moving surfaces, and what columns may mean."""

import numpy as np
import pytest
from support.near import assert_near, assert_within
from support.reading import codes_of, notes_of

import fitball
from fitball.base.errors import InputError

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


# ---- coefficients of restitution


def test_cor_makes_the_rebound_speed():
    """The commonest published form: speed, coefficient, its error."""
    columns = {
        "v_y1 [m/s]": [2.1, 9.1],
        "cor": [0.81, 0.70],
        "cor_sd": [0.01, 0.01],
    }
    table = fitball.load_table(columns)
    assert [*table.values] == ["v_y1", "v_y2"]
    assert_near(table.values["v_y2"], [1.701, 6.37])
    assert_near(table.sd["v_y2"], [0.021, 0.091])
    assert not table.corr
    assert "cor" in notes_of(table)


@pytest.mark.parametrize("head", ["COR", "Cor (%)", "cor [%]", "C.O.R."])
def test_cor_as_people_head_it(head):
    factor = 100.0 if "%" in head else 1.0
    table = fitball.load_table(
        {
            "v_y1": [5.0, 6.0],
            head: [0.75 * factor, 0.74 * factor],
        }
    )
    assert_near(table.values["v_y2"], [3.75, 4.44])


def test_cor_in_percent_without_the_sign_is_refused():
    assert codes_of({"v_y1": [5.0, 6.0], "cor": [75, 74]}) == ["out-of-limits"] * 2


def test_an_error_of_the_speed_goes_into_both():
    """By a Monte Carlo of both errors."""
    columns = {"v_y1": ["5.0 ± 0.2"] * 2, "cor": ["0.75 ± 0.02"] * 2}
    table = fitball.load_table(columns)
    rng = np.random.default_rng(2)
    v_y1 = 5.0 + 0.2 * rng.standard_normal(200_000)
    v_y2 = v_y1 * (0.75 + 0.02 * rng.standard_normal(200_000))
    assert_near(table.sd["v_y2"], [v_y2.std()] * 2, 0.01)
    expected = np.corrcoef(v_y1, v_y2)[0, 1]
    assert_within(table.corr["v_y1,v_y2"], [expected] * 2, 0.01)


def test_cor_of_oblique_impacts_is_that_of_the_vertical_speeds():
    columns = {
        "v_1": [20.0, 20.0],
        "theta_1": [30.0, 45.0],
        "cor": [0.8, 0.75],
        "v_x2": [12, 9],
    }
    table = fitball.load_table(columns)
    expected = 20.0 * np.sin(np.radians([30.0, 45.0])) * [0.8, 0.75]
    assert_near(table.values["v_y2"], expected)


def test_cor_beside_speeds_is_compared_and_not_used():
    speeds = {
        "v_y1": [5.0, 6.0, 7.0],
        "v_y2": [3.75, 4.44, 5.11],
    }
    table = fitball.load_table({**speeds, "cor": [0.75, 0.74, 0.73]})
    assert_near(table.values["v_y2"], speeds["v_y2"])
    assert "disagreement" not in notes_of(table)
    table = fitball.load_table({**speeds, "cor": [0.75, 0.74, 0.78]})
    assert "disagreement" in notes_of(table)
    assert codes_of({**speeds, "cor": [0.75, 0.74, 0.37]}) == ["contradiction"]
    ignored = fitball.load_table({**speeds, "cor": [0.75, 0.74, 0.37]}, ignore="cor")
    assert_near(ignored.values["v_y2"], speeds["v_y2"])


@pytest.mark.parametrize("power", [0.5, 1.0])
def test_cor_beside_heights_may_be_of_heights(power):
    """People compute it without air, as a root of heights or even without the root."""
    heights = {
        "drop_height": [2.54] * 3,
        "rebound_height": [1.40, 1.42, 1.38],
    }
    ratio = np.array(heights["rebound_height"]) / 2.54
    table = fitball.load_table({**heights, "cor": ratio**power})
    assert "disagreement" not in notes_of(table)
    assert_near(table.values["v_y2"], fitball.load_table(heights).values["v_y2"])
    assert table.read[0]["heights"] == "v_y1,v_y2"


def test_cor_of_drops_is_of_speeds_unless_it_may_be_of_heights():
    drops = {"drop_height [cm]": [100, 150, 200]}
    table = fitball.load_table({**drops, "cor": [0.78, 0.77, 0.76]})
    ratio = table.values["v_y2"] / table.values["v_y1"]
    assert_near(ratio, [0.78, 0.77, 0.76])
    doubtful = {**drops, "cor": [0.57, 0.56, 0.55]}
    assert codes_of(doubtful) == ["ambiguous-cor"]
    speeds = fitball.load_table(doubtful, columns={"cor": "cor"})
    assert_near(speeds.values["v_y2"] / speeds.values["v_y1"], doubtful["cor"])
    heights = fitball.load_table(doubtful, columns={"height_ratio": "cor"})
    risen = fitball.load_table(
        {
            **drops,
            "rebound_height [cm]": [57.0, 84.0, 110.0],
        }
    )
    assert_near(heights.values["v_y2"], risen.values["v_y2"])


def test_the_size_of_cor_says_nothing_of_other_balls(tmp_path):
    """A golf ball on turf."""
    file = tmp_path / "turf.csv"
    file.write_text("drop_height,cor\n1.0,0.55\n1.5,0.54\n")
    file.with_suffix(".toml").write_text("[ball]\nmass = 0.0459\nradius = 0.02135\n")
    table = fitball.load_table(file)
    assert_near(table.values["v_y2"] / table.values["v_y1"], [0.55, 0.54])


def test_a_ratio_of_heights_needs_the_drop():
    assert "no-drop-height" in codes_of(
        {
            "v_y1": [5.0, 6.0],
            "height_ratio": [0.5, 0.5],
        }
    )


@pytest.mark.parametrize("label", ["court", "color", "corner", "core", "surface speed"])
def test_labels_of_like_names_stay_labels(label):
    columns = {
        "v_y1": [5.0, 6.0],
        "v_y2": [3.9, 4.6],
        label: ["fast", "slow"],
    }
    table = fitball.load_table(columns)
    assert table.labels[label] == ("fast", "slow")


# ---- moving surfaces


def test_a_racket_sees_the_ball_faster():
    ball_in, racket, ball_out = RACKET.T
    columns = {"v_y1": ball_in, "surface_speed": racket, "v_y2": ball_out}
    table = fitball.load_table(columns)
    assert_near(table.values["v_y1"], ball_in + racket)
    assert_near(table.values["v_y2"], ball_out - racket)
    assert "moving-surface" in notes_of(table)
    assert_within(np.median(table.values["v_y2"] / table.values["v_y1"]), 0.40, 0.02)
    flipped = fitball.load_table({**columns, "surface_speed": -racket}, flip="surface_speed")
    assert_near(flipped.values["v_y1"], table.values["v_y1"])
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
    assert_near(table.sd["v_y1"], [seen[0].std()] * 2, 0.01)
    assert_near(table.sd["v_y2"], [seen[1].std()] * 2, 0.01)
    assert_within(table.corr["v_y1,v_y2"], [np.corrcoef(seen)[0, 1]] * 2, 0.01)


def test_a_fit_to_rackets_says_whose_frame_it_is():
    """The restitution is that between ball and racket, 0.42 in the mean of its making."""
    ball_in, racket, ball_out = RACKET.T
    columns = {"v_y1": ball_in, "surface_speed": racket, "v_y2": ball_out}
    fit = fitball.calibrate(columns, point_only=True)
    assert_within(fit.summary.loc["cor_median", "point"], 0.40, 0.01)
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
    assert_near(table.values["v_x1"], [10.0, 25.0 / np.sqrt(2.0)])
    assert_near(table.values["v_y1"], down + np.array([5.0, 6.0]))
    assert_near(table.values["v_y2"], up - [5.0, 6.0])
    assert_near(table.values["omega_2"], [100.0, 150.0])
    alone = {name: columns[name] for name in ("v_1 [m/s]", "theta_1", "surface_speed", "v_2")}
    assert "moving-surface" in codes_of(alone)


def test_cor_on_a_moving_surface():
    table = fitball.load_table(
        {
            "v_y1": [20, 18],
            "surface_speed": [10, 12],
            "cor": [0.4, 0.41],
        }
    )
    assert_near(table.values["v_y2"], [12.0, 12.3])


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
    columns = {
        "drop height (cm)": [100, 150],
        "rebound ratio": [0.56, 0.55],
    }
    assert codes_of(columns)[0] == "ambiguous-cor"


def test_a_racket_that_was_not_named_is_named():
    columns = dict(
        zip(
            ("Ball in (m/s)", "Racket speed (m/s)", "Ball out"),
            RACKET.T,
            strict=True,
        )
    )
    named = {"v_y1": "Ball in (m/s)", "v_y2": "Ball out"}
    with pytest.raises(InputError) as refusal:
        fitball.load_table(columns, columns=named)
    assert {fault.code for fault in refusal.value.faults} == {"restitution"}
    assert proposed(refusal.value) == {**named, "surface_speed": "Racket speed (m/s)"}


def test_a_ball_at_rest_is_hit():
    columns = {
        "v_y1": [0.0, 0.0],
        "surface_speed": [40.0, 41.0],
        "v_y2": [57.0, 58.0],
    }
    assert_near(fitball.load_table(columns).values["v_y2"], [17.0, 17.0])


@pytest.mark.parametrize("name", ["time", "interval", "height", "e", "racket speed", "bounce"])
def test_other_columns_of_a_good_table_are_not_proposed(name):
    """A column beside velocities that are there is none of another form."""
    columns = {
        "v_y1": [5.0, 6.0, 7.0],
        "v_y2": [3.9, 4.6, 5.3],
        name: [1, 2, 3],
    }
    table = fitball.load_table(columns)
    assert [*table.values] == ["v_y1", "v_y2"]
    if name != "racket speed":
        assert "series" not in notes_of(table)


def test_a_surface_speed_of_the_other_sign_is_flipped():
    """A racket at 10 m/s: ball and racket meet at 30 m/s and part at 15."""
    columns = {"v_y1": [20.0, 22.0], "surface_speed": [-10.0, -11.0], "v_y2": [25.0, 27.0]}
    with pytest.raises(InputError) as caught:
        fitball.load_table(columns)
    assert "--flip surface_speed" in str(caught.value)
    table = fitball.load_table(columns, flip="surface_speed")
    assert table.values["v_y1"].tolist() == [30.0, 33.0]
    assert table.values["v_y2"].tolist() == [15.0, 16.0]
