"""What `track` notices in positions as programs write them: angles that are no marks, or mean
something else, ids that change at a bounce. Controls are films that are right.
"""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support.films import DRAG, RADIUS, Camera, G, bounces, filmed, scores
from support.near import assert_within

import fitball
from fitball.base.errors import InputError
from fitball.data.scene import CameraSection, Scene, ValueWithSd
from fitball.tracks.polar import polar_columns

X = "x [m]"
Y = "y [m]"
MARKS = ["angle [rad]", "angle_fold"]
SPEEDS = [0, 1, 3, 4]


def codes_of(film):
    return {note.code for note in film.notes}


def tracked(table, fps, as_read=False, **camera):
    """A film as `track` measures it, with a court at zero if nothing else is passed."""
    scene = Scene(camera=CameraSection(**{"fps": fps, "court": 0.0, **camera}))
    return fitball.track(
        table,
        scene=scene,
        as_read=as_read,
        progress=False,
    )


def film_of(seed, count=1, **camera):
    """Positions of impacts and their truth."""
    rng = np.random.default_rng(seed)
    truth = bounces(count, rng)
    filming = Camera(**{"outliers": 0.0, **camera})
    return filmed(truth, filming, rng), truth


# ---- angles and radii of the position


def polar_angles(x, y):
    """Angles of the position and of the motion as programs have them, by what they are."""
    angle = np.arctan2(y, x)
    motion = np.arctan2(np.gradient(y), np.gradient(x))
    return {
        "rad": angle,
        "deg": np.degrees(angle).round(1),
        "whole deg": np.degrees(angle).round(),
        "0 to 360 deg": np.degrees(angle) % 360.0,
        "atan": np.arctan(y / x),
        "clockwise": -angle,
        "from the vertical": np.arctan2(x, y),
        "about a point": np.arctan2(y - 0.4, x - 0.3),
        "motion": motion,
        "motion, y down": np.degrees(-motion),
    }


@pytest.mark.parametrize("kind", [*polar_angles(np.arange(1.0, 3.0), np.arange(1.0, 3.0))])
def test_an_angle_of_the_position_or_of_the_motion_is_no_mark(kind):
    table, truth = film_of(1, fps=240, noise=5e-4)
    plain = table.drop(columns=MARKS)
    theta = polar_angles(plain[X].to_numpy(), plain[Y].to_numpy())[kind]
    film = tracked(plain.assign(theta=theta), 240)
    # Spins are not measured, and all else is as without the column.
    assert_allclose(film.impacts, tracked(plain, 240).impacts)
    assert "omega_1 [rad/s]" not in film.impacts
    assert {"polar-column", "no-spins"} <= codes_of(film)
    speed_errors = scores(film, truth)[0][:, [0, 1, 3, 4]]
    assert np.abs(speed_errors).max() < 4.0


def test_a_distance_from_the_origin_is_no_radius_of_the_ball():
    x, y = film_of(2, fps=240)[0][[X, Y]].to_numpy().T
    px = {
        "x [px]": 900.0 + 500.0 * x,
        "y [px]": 600.0 + 500.0 * y,
    }
    distance = np.hypot(*px.values())
    table = pd.DataFrame(
        {
            "frame": np.arange(x.size),
            **px,
            "r [px]": distance.round(1),
        }
    )
    scene = Scene(
        camera=CameraSection(
            fps=240.0,
            court=1.2,
            mm_per_px=2.0,
        )
    )
    scene = replace_ball(scene, 0.03302)
    film = fitball.track(table, scene=scene, progress=False)
    # As a radius it would make another scale.
    assert "polar-column" in codes_of(film)
    assert "scales-differ" not in codes_of(film)


def replace_ball(scene, radius):
    """A scene with a ball of this radius [m]."""
    from msgspec.structs import replace as changed

    return changed(scene, ball=changed(scene.ball, radius=radius))


def test_marks_of_balls_are_never_read_as_angles_of_the_position():
    marks = 0
    for seed in range(24):
        table, truth = film_of(
            seed,
            3,
            fps=[240, 1000][seed % 2],
            fold=[1, 2, 4][seed % 3],
        )
        if seed % 4 == 0:
            # A ball that does not turn at all: its mark is at one angle.
            table["angle [rad]"] = 0.5 * np.pi
        columns = {
            "x": table[X],
            "y": table[Y],
            "angle": table["angle [rad]"],
        }
        columns |= {
            "radius": 0.033 + 1e-4 * np.random.default_rng(seed).standard_normal(len(table))
        }
        assert not polar_columns({name: np.asarray(values) for name, values in columns.items()})
        marks += len(truth)
    assert marks == 72
    # A ball that is dropped without spin, beside a vertical stripe.
    t = np.linspace(-0.15, 0.15, 60)
    height = np.where(t < 0.0, -6.0 * t, 5.0 * t) - 4.9 * t**2
    noise = 1e-3 * np.random.default_rng(1).standard_normal((2, t.size))
    for angle in (np.full(t.size, 0.5 * np.pi), 0.5 * np.pi + 0.01 * np.sin(50.0 * t)):
        assert not polar_columns(
            {
                "x": noise[0],
                "y": height + noise[1],
                "angle": angle,
            }
        )


# ---- ids that change


def lowest_of(table):
    """Row in which the ball is lowest."""
    windows = table[Y].rolling(3, center=True, min_periods=1)
    return int(windows.median().idxmin())


def with_ids(table, last):
    """The table with another id behind the row `last`."""
    return table.assign(id=np.where(table.index <= last, "7", "12"))


@pytest.mark.parametrize("late", [-1, 0, 1, 2])
@pytest.mark.parametrize("fps", [240, 1000])
def test_an_id_that_changes_at_the_bounce_is_joined(late, fps):
    table, _ = film_of(
        3,
        fps=fps,
        noise=5e-4,
        leftward=late == 1,
    )
    plain = table.drop(columns=MARKS)
    lowest = lowest_of(plain)
    film = tracked(with_ids(plain, lowest + late), fps)
    assert "ids-joined" in codes_of(film)
    assert [*film.impacts.index] == ["7+12"]
    whole = tracked(plain, fps)
    assert_allclose(film.impacts, whole.impacts)
    assert "ids-joined" not in codes_of(whole)


def test_an_id_that_goes_on_without_the_ball_is_cut_where_the_ball_bounces():
    """As motion models predict it, while the next id waits for seven frames."""
    table, truth = film_of(4, fps=1000, noise=5e-4)
    plain = table.drop(columns=MARKS)
    lowest = lowest_of(plain)
    falling = plain.loc[:lowest].assign(id="1")
    rising = plain.loc[lowest + 8 :].assign(id="2")
    last = falling.iloc[-1]
    steps = np.arange(1, 13)[:, None]
    ahead = last[[X, Y]].to_numpy(float) + steps * falling[[X, Y]].diff().tail(5).mean().to_numpy()
    numbers = last["frame"] + steps[:, 0]
    predicted = pd.DataFrame(
        {
            "id": "1",
            "frame": numbers,
            X: ahead[:, 0],
            Y: ahead[:, 1],
        }
    )
    film = tracked(pd.concat([falling, predicted, rising]), 1000)
    errors, _ = scores(replace_index(film), truth)
    assert np.abs(errors[:, [0, 1, 3, 4]]).max() < 4.0


def replace_index(film):
    """The film, its only impact called 1 as in the truth."""
    return replace(film, impacts=film.impacts.set_axis(["1"]))


def test_an_id_that_changes_in_flight_too_is_joined():
    table, _ = film_of(5, fps=500, noise=5e-4)
    plain = table.drop(columns=MARKS)
    lowest = lowest_of(plain)
    number = np.digitize(plain.index, [lowest // 2, lowest + 1, (lowest + len(plain)) // 2])
    film = tracked(plain.assign(id=number.astype(str)), 500)
    assert [*film.impacts.index] == ["0+1+2+3"]
    assert_allclose(film.impacts, tracked(plain, 500).impacts)
    # The other way up it is said that the balls fall upwards.
    with pytest.raises(InputError) as caught:
        tracked(
            plain.assign(id=number.astype(str), **{Y: 1.0 - plain[Y]}),
            500,
            court=None,
        )
    assert caught.value.code == "gravity"
    assert 'y = "down"' in str(caught.value)


def test_tracks_of_different_balls_are_not_joined():
    table, _ = film_of(6, 8, fps=240)
    plain = table.drop(columns=MARKS)
    halves = []
    clock = 0
    for number, (_, clip) in enumerate(plain.groupby("id")):
        lowest = clip[Y].idxmin()
        # Falling and rising in turns, some frames apart, each at a place of its own.
        half = clip.loc[:lowest] if number % 2 == 0 else clip.loc[lowest:]
        frames = half["frame"] - half["frame"].iloc[0] + clock
        halves.append(half.assign(frame=frames, **{X: half[X] + 0.2 * number}))
        clock = frames.iloc[-1] + 3
    with pytest.raises(InputError) as caught:
        tracked(pd.concat(halves), 240)
    assert caught.value.code == "no-impact"
    # Whole clips, one after the other, stay what they are.
    film = tracked(plain, 240)
    assert "ids-joined" not in codes_of(film)
    assert len(film.impacts) == 8


# ---- angles that grow the other way, or repeat more often

# What a table says of a dot or stripe, and how a scene says it: fold of the mark on the ball, fold
# as stated, whether angles grow clockwise, and what the note names.
OTHERWISE = {
    "clockwise": (2, 2, True, ['angles = "clockwise"']),
    "clockwise dot": (1, 1, True, ['angles = "clockwise"']),
    "stripe as a dot": (2, 1, False, ["fold = 2"]),
    "box as a stripe": (4, 2, False, ["fold = 4"]),
    "ellipse of OpenCV as a dot": (2, 1, True, ['angles = "clockwise"', "fold = 2"]),
    "box of OpenCV as a dot": (4, 1, True, ['angles = "clockwise"', "fold = 4"]),
    "three spokes": (3, 1, False, ["fold = 3"]),
}


def with_angles(table, fold, stated, clockwise):
    """The table with its angles as such a mark has them: a box of OpenCV from -90 to 0 degrees."""
    period = 360.0 / fold
    angle = np.degrees(table["angle [rad]"]) * (-1.0 if clockwise else 1.0)
    columns = {
        "angle [deg]": angle % period - (90.0 if fold == 4 else 0.0),
        "angle_fold": stated,
    }
    return table.drop(columns=MARKS).assign(**columns)


@pytest.mark.parametrize("count", [1, 6])
@pytest.mark.parametrize("kind", [*OTHERWISE])
def test_angles_of_another_direction_or_fold_are_named(kind, count):
    fold, stated, clockwise, expected = OTHERWISE[kind]
    table, truth = film_of(
        10,
        count,
        fps=1000,
        fold=1,
        angle_noise=0.01,
    )
    odd = with_angles(table, fold, stated, clockwise)
    film = tracked(odd, 1000, as_read=True)
    (note,) = [note for note in film.notes if note.code == "spins-implausible"]
    named = [words for words in ('angles = "clockwise"', "fold = ") if words in note.text]
    assert len(named) == len(expected)
    assert all(words in note.text for words in expected)
    assert "spins-ambiguous" not in codes_of(film)
    # What the note says to do gives the spins.
    column_left_out = odd.drop(columns="angle_fold")
    direction = "clockwise" if clockwise else "counterclockwise"
    right = tracked(column_left_out, 1000, fold=fold, angles=direction)
    assert codes_of(right).isdisjoint({"spins-implausible", "spins-ambiguous"})
    _, errors = scores(right, truth)
    assert np.abs(errors[:, [2, 5]]).max() < 8.0


def test_a_stated_direction_that_is_wrong_is_named_the_other_way():
    table, _ = film_of(11, 5, fps=1000, fold=2)
    film = tracked(table, 1000, angles="clockwise")
    (note,) = [note for note in film.notes if note.code == "spins-implausible"]
    assert 'angles = "counterclockwise"' in note.text


def test_spins_that_are_ambiguous_are_no_fault_of_the_angles():
    for seed in range(6):
        table, _ = film_of(
            30 + seed,
            6,
            fps=240,
            fold=2,
            outliers=0.02,
        )
        codes = codes_of(tracked(table, 240))
        assert "spins-ambiguous" in codes
        assert "spins-implausible" not in codes


def test_marks_that_show_nothing_have_no_reading():
    table, _ = film_of(12, 4, fps=1000)
    anywhere = 2.0 * np.pi * np.random.default_rng(1).uniform(size=len(table))
    film = tracked(table.assign(**{"angle [rad]": anywhere}), 1000)
    (note,) = [note for note in film.notes if note.code == "spins-implausible"]
    assert "clockwise" not in note.text
    assert "fold =" not in note.text


# ---- scales that rest on the radius of the ball

# A contour of OpenCV is that much [px] small.
CONTOUR = -0.48


def filmed_in_px(radius, bias, seed=1, noise=5e-4):
    """Three bounces of 14, 6, 10, 4.8 m/s without air at 240 frames/s, and the radius [px] of the
    ball as it is measured.
    """
    rng = np.random.default_rng(seed)
    clips = []
    number = np.arange(76)
    per_px = RADIUS / radius
    for name in "abc":
        t = (number - 26.0 - rng.uniform()) / 240.0
        before = np.minimum(t, 0.0)
        after = np.maximum(t - 4.7e-3, 0.0)
        x = 14.0 * before + 10.0 * after
        fall = 0.5 * G * (before**2 + after**2)
        y = RADIUS - 6.0 * before + 4.8 * after - fall
        x_px, y_px = (np.stack([x, y]) + noise * rng.standard_normal((2, 76))) / per_px
        measured = radius + bias + 0.05 * rng.standard_normal(76)
        clip = {"id": name, "frame": number, "x [px]": x_px, "y [px]": y_px}
        clips.append(pd.DataFrame({**clip, "radius [px]": measured}))
    return pd.concat(clips)


def scene_by_radius(**camera):
    scene = Scene(
        camera=CameraSection(
            fps=240.0,
            court=0.0,
            **camera,
        )
    )
    scene = Scene(camera=scene.camera, flight={"drag": 0.01, "lift": 0.0})
    return replace_ball(scene, RADIUS)


@pytest.mark.parametrize(("noise", "code"), [(2e-4, "gravity-off"), (2e-3, "scale-by-radius")])
def test_radii_half_a_pixel_small_are_named_as_the_cause_of_a_wrong_scale(noise, code):
    table = filmed_in_px(8.0, CONTOUR, noise=noise)
    film = fitball.track(
        table,
        scene=scene_by_radius(),
        progress=False,
    )
    assert_allclose(
        film.impacts["v_x1 [m/s]"],
        14.0 * 8.0 / 7.52,
        rtol=0.01,
    )
    (note,) = [note for note in film.notes if "--mm-per-px" in note.text]
    assert note.code == code
    # The scale is off by 6.4 %, which the fit has to know.
    assert 0.04 < film.scene.camera.scale.sd < 0.07
    # What the note says to do gives the speeds.
    per_px = float(re.search(r"--mm-per-px ([0-9.]+)", note.text)[1])
    right = fitball.track(
        table,
        scene=scene_by_radius(mm_per_px=per_px),
        progress=False,
    )
    assert "gravity-off" not in codes_of(right)
    assert right.scene.camera.scale.sd == 0.01
    truth = {
        "v_x1": 14.0,
        "v_y1": 6.0,
        "v_x2": 10.0,
        "v_y2": 4.8,
    }
    for name, speed in truth.items():
        assert_allclose(right.impacts[f"{name} [m/s]"], speed, rtol=0.015)


def test_a_scale_by_radii_is_known_as_well_as_gravity_or_half_a_pixel_shows():
    # Of 40 px half a pixel is 1.25 %; gravity shows less than 3 % of these films.
    for radius, most in ((8.0, 0.03), (16.5, 0.03), (40.0, 0.0126)):
        film = fitball.track(
            filmed_in_px(radius, 0.0),
            scene=scene_by_radius(),
            progress=False,
        )
        assert 0.01 <= film.scene.camera.scale.sd < most
        assert "gravity-off" not in codes_of(film)
    # With marks and air unknown, gravity says little: 0.5 px of 8.
    table, truth = film_of(1, 3, fps=240, noise=5e-4)
    per_px = RADIUS / 8.0
    px = {
        "x [px]": table[X] / per_px,
        "y [px]": table[Y] / per_px,
        "radius [px]": 8.0 + CONTOUR,
    }
    table = table.drop(columns=[X, Y, *MARKS]).assign(**px)
    scene = replace_ball(Scene(camera=CameraSection(fps=240.0, court=0.0)), RADIUS)
    film = fitball.track(table, scene=scene, progress=False)
    _, errors = scores(film, truth)
    off = np.mean(errors[:, SPEEDS] / truth[:, SPEEDS])
    assert_within(off, 0.064, 0.005)
    assert off < 2.0 * film.scene.camera.scale.sd
    assert "scale-by-radius" in codes_of(film)


def test_a_stated_scale_keeps_its_error():
    scale = ValueWithSd(1.0, 0.002)
    table = filmed_in_px(8.0, CONTOUR)
    film = fitball.track(
        table,
        scene=scene_by_radius(scale=scale),
        progress=False,
    )
    assert film.scene.camera.scale == scale
    plain = fitball.track(
        table,
        scene=scene_by_radius(mm_per_px=4.1275),
        progress=False,
    )
    assert plain.scene.camera.scale == ValueWithSd(1.0, 0.01)


# Cameras of films whose marks are hard to read, though as stated; and films of these, of one impact
# each, that were noted: by few angles on a line of another fold, and by angles with large errors.
HARD_MARKS = [
    Camera(240, fold=2),
    Camera(240, fold=2, angle_outliers=0.2),
    Camera(240, angle_noise=np.radians(5.0)),
    Camera(240, angle_outliers=0.2),
]
ONCE_NOTED = [
    ((132, 2), HARD_MARKS[0]),
    ((13, 8), HARD_MARKS[2]),
    ((2011, 5), HARD_MARKS[3]),
]


def codes_of_one_impact(camera, seed):
    """Codes of notes on a film of one impact, of a ball with a drag of its own."""
    rng = np.random.default_rng(seed)
    truth = bounces(1, rng)
    drag = DRAG + 0.05 * rng.standard_normal()
    table = filmed(
        truth,
        replace(camera, drag=drag),
        rng,
    )
    return codes_of(tracked(table, camera.fps, as_read=True))


@pytest.mark.parametrize(("seed", "camera"), ONCE_NOTED)
def test_films_that_were_noted_as_implausible_are_not(seed, camera):
    assert "spins-implausible" not in codes_of_one_impact(camera, seed)


def test_at_most_one_good_film_in_a_hundred_is_noted_as_implausible():
    noted = sum(
        "spins-implausible" in codes_of_one_impact(camera, (seed, number))
        for seed in range(12)
        for number, camera in enumerate(HARD_MARKS)
    )
    # Of 48 films; of one in a hundred, two or more would be noted in 8 of 100 studies.
    assert noted <= 1
