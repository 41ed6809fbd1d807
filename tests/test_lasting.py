"""Errors that last over several frames at a bounce, as estimates of a motion model have them, are
noticed and widen the errors of the impact; errors of each frame by itself do not.
"""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support.films import RADIUS, Camera, G, bounces, filmed

import fitball
from fitball.base.errors import InputError
from fitball.data.scene import CameraSection, Scene
from fitball.tracks.flight import T1, T2, X2, Impact
from fitball.tracks.lasting import lasting_correlation, widening
from fitball.tracks.types import Track

TRUTH = {"v_x1": 14.0, "v_y1": 6.0, "v_x2": 10.0, "v_y2": 4.8}
CONTACT_TIME = 4.7e-3
NOISE = 5e-4


def places(t, rng):
    """Positions (frames, 2) [m] of a bounce at time 0, without air, with noise."""
    before = np.minimum(t, 0.0)
    after = np.maximum(t - CONTACT_TIME, 0.0)
    x = 14.0 * before + 10.0 * after
    y = RADIUS - 6.0 * before + 4.8 * after - 0.5 * G * (before**2 + after**2)
    return np.column_stack([x, y]) + NOISE * rng.standard_normal((t.size, 2))


def estimated(measured, step, agility):
    """What a filter of Kalman makes of positions (frames, 2), whose motion model has a constant
    velocity with accelerations of the sd `agility` [m/s^2].
    """
    forward = np.array([[1.0, step], [0.0, 1.0]])
    push = agility * np.array([0.5 * step**2, step])
    estimates = np.empty_like(measured)
    for axis in range(2):
        state = np.array([measured[0, axis], 0.0])
        covariance = np.diag([NOISE**2, 30.0**2])
        for k, value in enumerate(measured[:, axis]):
            state = forward @ state
            covariance = forward @ covariance @ forward.T + np.outer(push, push)
            gain = covariance[:, 0] / (covariance[0, 0] + NOISE**2)
            state = state + gain * (value - state[0])
            covariance = covariance - np.outer(gain, covariance[0])
            estimates[k, axis] = state[0]
    return estimates


def film_of(seed, fps, agility=None, lasting=0.0):
    """Three bounces as a tracker has them, with a motion model if it has an agility, tracked."""
    rng = np.random.default_rng(seed)
    number = np.arange(76)
    clips = []
    for name in "abc":
        seen = places((number - 26.0 - rng.uniform()) / fps, rng)
        if agility is not None:
            seen = estimated(seen, 1.0 / fps, agility)
        clips.append(pd.DataFrame({"id": name, "frame": number, "x [m]": seen[:, 0]}))
        clips[-1]["y [m]"] = seen[:, 1]
    scene = Scene(
        camera=CameraSection(fps=fps, court=0.0, lasting=lasting),
        flight={"drag": 0.01, "lift": 0.0},
    )
    return fitball.track(pd.concat(clips), scene=scene, as_read=True, progress=False)


def codes_of(film):
    return {note.code for note in film.notes}


def sds_off(film):
    """By how many of their sds the speeds are off, (impacts, 4)."""
    columns = film.impacts
    off = [
        (columns[f"{name} [m/s]"] - speed) / columns[f"{name}_sd [m/s]"]
        for name, speed in TRUTH.items()
    ]
    return np.abs(np.transpose(off))


@pytest.mark.parametrize(
    ("fps", "agility"), [(240.0, 3.0), (240.0, 10.0), (240.0, 30.0), (1000.0, 30.0), (1000.0, 60.0)]
)
def test_estimates_of_a_motion_model_are_noticed_and_have_larger_errors(fps, agility):
    film = film_of(1, fps, agility)
    assert "lasting-errors" in codes_of(film)
    assert sds_off(film).max() < 3.0


def test_the_speeds_of_such_a_film_are_wrong_by_many_errors_of_single_frames():
    """The control: with errors of frames alone v_y2 would be off by more than four sds."""
    film = film_of(1, 1000.0, 60.0)
    plain = film_of(1, 1000.0)
    off = film.impacts["v_y2 [m/s]"] - TRUTH["v_y2"]
    assert (off > 4.0 * plain.impacts["v_y2_sd [m/s]"]).all()


def test_where_such_a_film_has_no_impact_the_reason_is_named():
    with pytest.raises(InputError) as caught:
        film_of(1, 1000.0, 3.0)
    assert caught.value.code == "no-impact"
    assert "motion model" in str(caught.value)


def test_errors_of_single_frames_make_no_note():
    for seed in range(4):
        for fps in (240.0, 1000.0):
            film = film_of(seed, fps)
            assert "lasting-errors" not in codes_of(film)


@pytest.mark.parametrize("camera", [Camera(240), Camera(500, outliers=0.1), Camera(2000)])
def test_films_with_air_spin_and_outliers_make_no_note(camera):
    rng = np.random.default_rng(5)
    table = filmed(bounces(4, rng), camera, rng)
    scene = Scene(camera=CameraSection(fps=camera.fps, court=0.0))
    film = fitball.track(table, scene=scene, progress=False)
    assert "lasting-errors" not in codes_of(film)


def test_errors_that_are_stated_to_last_are_not_noted():
    film = film_of(1, 240.0, 30.0, lasting=1e-3)
    assert "lasting-errors" not in codes_of(film)


# ---- the correlation itself


def impact_with(errors):
    """An impact whose frames are 30 before and 30 after the contact, off a parabola by errors
    (60, 2).
    """
    number = np.concatenate([np.arange(-30, 0), np.arange(1, 31)])
    t = number / 1000.0
    position = np.column_stack([7.0 * t, np.abs(5.0 * t) - 4.9 * t**2]) + errors
    none = np.full(60, np.nan)
    track = Track("a", number, t, *position.T, none, 1, {})
    rows = np.arange(60)
    impact = Impact("a", track, rows, rows, 0.0, t, position, none, 1.0)
    impact.p[[T1, X2, T2]] = 0.0
    return impact


def autoregressive(correlation, rng):
    """Errors (60, 2) of which neighbours have a correlation."""
    errors = rng.standard_normal((60, 2))
    for k in range(1, 60):
        errors[k] = correlation * errors[k - 1] + np.sqrt(1.0 - correlation**2) * errors[k]
    return errors


@pytest.mark.parametrize("correlation", [0.5, 0.7, 0.9])
def test_the_correlation_is_that_of_the_errors(correlation):
    rng = np.random.default_rng(2)
    impacts = [impact_with(autoregressive(correlation, rng)) for _ in range(300)]
    assert lasting_correlation(impacts) == pytest.approx(correlation, abs=0.06)


def test_independent_errors_have_none_though_residuals_of_a_fit_correlate():
    rng = np.random.default_rng(3)
    for _ in range(200):
        impacts = [impact_with(rng.standard_normal((60, 2))) for _ in range(2)]
        assert lasting_correlation(impacts) == 0.0


def test_sds_grow_as_that_of_a_mean_of_such_errors():
    assert widening(0.0) == 1.0
    count = 4000
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    for correlation in (0.3, 0.8):
        sd_of_mean = np.sqrt(np.sum(correlation**apart)) / count
        assert_allclose(widening(correlation), sd_of_mean * np.sqrt(count), rtol=0.01)


@pytest.mark.parametrize("x", [0.0, 0.5, -3.7])
def test_roundings_of_a_coordinate_that_stands_still_do_not_count(x):
    rng = np.random.default_rng(4)
    impacts = []
    for _ in range(20):
        impact = impact_with(rng.standard_normal((60, 2)))
        impact.position[:, 0] = x
        impacts.append(impact)
    assert lasting_correlation(impacts) == 0.0
