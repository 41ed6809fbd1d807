"""Simulated tracks: flights by other integrations, the gaps of the model in the frames, errors of the camera as a fit
has them, and each kind of flaw in the share that is asked for.
"""

import dataclasses
import functools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fitball
from fitball.errors import ParameterError
from fitball.inference.problem.camera import LEVEL, seen, true
from fitball.models.types import OUTPUTS
from fitball.tracks.frames import NINE, Air, Track
from fitball.tracks.simulate import Course, Film, ahead_at_release, simulated_tracks, truth

VALUES = {
    "mass_ratio": 0.883, "k_y": 2.0e4, "k_theta": 19.0, "mu": 0.568, "eps_10": 2.38e-3, "eps_slope": 0.0,
    "cor_10": 0.774, "cor_slope": -0.0151,
}  # fmt: skip
IMPACTS = fitball.impacts([15.0, 8.0, 18.0], [6.0, 12.0, 9.0], [0.0, -150.0, 320.0])
RADIUS = fitball.Ball().radius
CLEAN = Film(
    fps=2000.0, noise=0.0, angle_noise=0.0, outliers=0.0, angle_outliers=0.0, lost=0.0, lift_sd=0.0,
    air=Air(drag_shot_sd=0.0),
)  # fmt: skip
# No air: parabolas.
EMPTY = dataclasses.replace(CLEAN, air=Air(density=0.0, drag_shot_sd=0.0))


@functools.cache
def rebound():
    return fitball.model("two-mass").rebound(VALUES, IMPACTS)


def filmed(film, seed=1, **more):
    return simulated_tracks(IMPACTS, rebound(), film, np.random.default_rng(seed), **more)


def sides(track: Track):
    """Frames before and after the lowest, without those about it."""
    low = track.time[np.argmin(track.y)]
    return track.time < low - 8e-3, track.time > low + 8e-3


def crossing(track: Track, side, height, fold=1):
    """Time, place, angle, and rates of these where a parabola through the frames of a side is at a height."""
    t = track.time[side] - track.time[0]
    y = np.polynomial.Polynomial.fit(t, track.y[side], 2)
    x = np.polynomial.Polynomial.fit(t, track.x[side], 2)
    turn = np.unwrap(track.angle[side], period=2.0 * np.pi / fold)
    phi = np.polynomial.Polynomial.fit(t, turn, 1)
    roots = (y - height).roots().real
    at = roots[np.argmin(np.abs(roots - (t[-1] if t[0] < roots.mean() and side[0] else t[0])))]
    return at, x(at), phi(at), x.deriv()(at), y.deriv()(at), phi.deriv()(at)


def nine(track: Track, fold=1, height=RADIUS):
    """The nine by parabolas; of the turn its remainder."""
    one, two = (crossing(track, side, height, fold) for side in sides(track))
    sign = 1.0 if one[3] > 0.0 else -1.0
    turn = -sign * (two[2] - one[2])
    return np.array(
        [sign * one[3], -one[4], -sign * one[5], sign * two[3], two[4], -sign * two[5], two[0] - one[0],
         sign * (two[1] - one[1]), turn]
    )  # fmt: skip


def near(found, wanted, rtol=1e-7, fold=1):
    """The nine agree, the turn but for whole turns over the fold."""
    whole = 2.0 * np.pi / fold
    off = (found[8] - wanted[8] + 0.5 * whole) % whole - 0.5 * whole
    np.testing.assert_allclose(found[:8], wanted[:8], rtol=rtol, atol=1e-9)
    assert abs(off) < 1e-6


@pytest.mark.parametrize(("leftward", "fold"), [(False, 1), (True, 1), (False, 2)])
def test_noiseless_frames_have_the_states_and_the_gaps_of_the_model(leftward, fold):
    film = dataclasses.replace(EMPTY, leftward=leftward, fold=fold)
    for track, wanted in zip(filmed(film), truth(IMPACTS, rebound()), strict=True):
        assert (np.diff(track.x) < 0).all() == leftward
        near(nine(track, fold), wanted, fold=fold)


def test_without_air_flights_are_parabolas_and_energy_is_kept():
    for track in filmed(EMPTY):
        for side in sides(track):
            t = track.time[side] - track.time[side][0]
            fits = [np.polynomial.Polynomial.fit(t, values[side], degree) for values, degree in
                    ((track.x, 1), (track.y, 2))]  # fmt: skip
            assert np.ptp(track.x[side] - fits[0](t)) < 1e-10
            assert np.ptp(track.y[side] - fits[1](t)) < 1e-10
            assert fits[1].deriv(2)(0.0) == pytest.approx(-9.80665, rel=1e-6)


def test_with_air_flights_are_those_of_another_integration():
    ball, air = fitball.Ball(), CLEAN.air
    k = 0.5 * air.density * np.pi * ball.radius**2 / ball.mass

    def slope(_t, state, lift):
        _x, _y, v_x, v_y = state
        speed = np.hypot(v_x, v_y)
        return (
            v_x,
            v_y,
            k * speed * (-air.drag * v_x + lift * v_y),
            -9.80665 + k * speed * (-air.drag * v_y - lift * v_x),
        )

    for track, one in zip(filmed(CLEAN), truth(IMPACTS, rebound()), strict=True):
        for side, (v_x, v_y, omega) in zip(sides(track), ((one[0], -one[1], one[2]), one[3:6]), strict=True):
            ratio = ball.radius * abs(omega) / np.hypot(v_x, v_y)
            lift = np.sign(omega) / (2.022 + 0.981 / ratio) if ratio > 0.0 else 0.0
            # The clip does not say when the ball lands: by the flight itself.
            t = track.time[side]
            ends = (0.0, -0.2) if side[0] else (0.0, 0.2)
            flight = solve_ivp(
                slope, ends, (0.0, ball.radius, v_x, v_y), args=(lift,), rtol=1e-11, atol=1e-12, dense_output=True
            )
            place = 0 if side[0] else -1
            fine = np.linspace(*ends, 200_001)
            at = fine[np.argmin(np.abs(flight.sol(fine)[1] - track.y[side][place]))]
            course = flight.sol(np.clip(at + t - t[place], min(ends), max(ends)))
            assert np.abs(np.diff(course[0] - track.x[side])).max() < 2e-5
            assert np.abs(course[1] - track.y[side]).max() < 3e-5
            path = track.x[side] - course[0]
            assert path.mean() == pytest.approx(0.0 if side[0] else one[7], abs=3e-5)


@pytest.mark.parametrize(
    "errors", [{"scale": 1.02}, {"clock": 0.97}, {"tilt": 0.01}, {"court_height": 2e-3}, {}], ids=str
)
def test_errors_of_the_camera_act_as_a_fit_has_them(errors):
    """Nothing counts twice: what a film with these errors shows is what a fit with these settings expects."""
    film = dataclasses.replace(EMPTY, fps=4000.0, **errors)
    settings = {**LEVEL, **errors}
    # A ball is as large as it is: at another scale its centre is elsewhere than a radius above the court.
    settings["court_height"] += RADIUS * (1.0 / settings["scale"] - 1.0)
    truths = truth(IMPACTS, rebound())
    outputs = {name: np.atleast_2d(getattr(rebound(), name)) for name in OUTPUTS}
    wrong = np.array([nine(track) for track in filmed(film)])
    back = true(settings, tuple(wrong[:, :3].T))
    # A height that is off meets the ball a little sooner or later, where gravity has made it faster or slower.
    loose = 2e-3 if abs(settings["court_height"]) > 0.0 else 5e-4
    for k, column in enumerate(back):
        np.testing.assert_allclose(column, truths[:, k], rtol=loose, atol=1e-6)
    expected = seen(settings, tuple(wrong[:, :3].T), outputs)
    for k, name in enumerate(NINE[3:6], start=3):
        np.testing.assert_allclose(wrong[:, k], expected[name][0], rtol=loose, atol=1e-6)
    for name, small in (("gap_time", 4e-6), ("gap_path", 4e-5), ("gap_turn", 1e-3)):
        off = wrong[:, NINE.index(name)] - expected[name][0]
        if name == "gap_turn":
            off = (off + np.pi) % (2.0 * np.pi) - np.pi
        np.testing.assert_allclose(off, 0.0, atol=small * (6.0 if loose > 1e-3 else 1.0), err_msg=name)
    if errors:
        moved = np.abs(wrong - truths).max()
        assert moved > 1e-4


def test_a_wrong_sign_of_the_tilt_is_seen():
    """Negative control of the test above."""
    wrong = np.array([nine(track) for track in filmed(dataclasses.replace(EMPTY, tilt=0.01))])
    back = true({**LEVEL, "tilt": -0.01}, tuple(wrong[:, :3].T))
    assert np.abs(back[0] - truth(IMPACTS, rebound())[:, 0]).max() > 0.1


def test_frames_of_the_contact_are_on_neither_flight():
    film = dataclasses.replace(EMPTY, fps=10_000.0)
    for track, one in zip(filmed(film), truth(IMPACTS, rebound()), strict=True):
        below = track.y < RADIUS
        assert below.sum() == pytest.approx(one[6] * 1e4, abs=3)
        assert 4e-3 < RADIUS - track.y.min() < 0.9 * RADIUS
        # One course without a jump: no step is longer than the fastest velocity makes it.
        steps = np.hypot(np.diff(track.x), np.diff(track.y))
        assert steps.max() < 1.3 * np.hypot(one[0], one[1]) * 1e-4


def test_flaws_have_the_sizes_and_shares_that_are_asked_for():
    film = dataclasses.replace(
        CLEAN, fps=4000.0, noise=1e-3, angle_noise=0.05, outliers=0.1, lost=0.2, radius_noise=5e-4, jitter=2e-5,
        angle_outliers=0.1,
    )  # fmt: skip
    clean = dataclasses.replace(CLEAN, fps=4000.0)
    many = fitball.impacts(np.full(60, 12.0), np.full(60, 7.0), 100.0)
    bounced = fitball.model("two-mass").rebound(VALUES, many)
    tracks = simulated_tracks(many, bounced, film, np.random.default_rng(3))
    whole = simulated_tracks(many, bounced, clean, np.random.default_rng(3))
    frames, all_frames = sum(len(it.x) for it in tracks), sum(len(it.x) for it in whole)
    assert frames / all_frames == pytest.approx(0.8, abs=0.02)
    steps = np.concatenate([np.diff(it.time) * 4000.0 - np.diff(it.frame) for it in tracks])
    assert np.std(steps) / np.sqrt(2.0) == pytest.approx(2e-5 * 4000.0, rel=0.05)
    radii = np.concatenate([it.radius for it in tracks])
    assert radii.mean() == pytest.approx(RADIUS, abs=4e-5)
    assert radii.std() == pytest.approx(5e-4, rel=0.05)
    ups = np.concatenate([off(it, side) for it in tracks for side in sides(it)])
    far = np.abs(ups) > 4.5e-3
    assert far.mean() == pytest.approx(0.1, abs=0.015)
    assert ups[~far].std() == pytest.approx(1e-3, rel=0.06)
    assert np.median(np.abs(ups)) < 1e-3


def off(track: Track, side):
    """By how much heights are off a robust parabola."""
    t, y = track.time[side] - track.time[side][0], track.y[side]
    kept = np.ones(t.size, dtype=bool)
    for _ in range(8):
        fit = np.polynomial.Polynomial.fit(t[kept], y[kept], 2)
        kept = np.abs(y - fit(t)) < 4.5e-3
    return y - fit(t)


def test_slow_errors_last_and_repeated_frames_are_equal():
    slow = dataclasses.replace(CLEAN, noise=1e-3, slow=1.0, slow_time=0.01)
    still = dataclasses.replace(CLEAN, noise=1e-3)
    errors = [
        np.concatenate([(a.y - b.y) for a, b in zip(filmed(film), filmed(CLEAN), strict=True)])
        for film in (slow, still)
    ]
    neighbours = [np.corrcoef(part[:-1], part[1:])[0, 1] for part in errors]
    assert neighbours[0] > 0.3 > 0.15 > abs(neighbours[1])
    for track in filmed(dataclasses.replace(CLEAN, repeated=0.3)):
        again = (np.diff(track.x) == 0.0) & (np.diff(track.y) == 0.0)
        assert 0.1 < again.mean() < 0.5


def test_a_rolling_shutter_is_undone_by_its_rows():
    film = dataclasses.replace(EMPTY, row_time=4e-3 / 1080.0)
    for track, one in zip(filmed(film), truth(IMPACTS, rebound()), strict=True):
        assert abs(nine(track)[1] / one[1] - 1.0) > 0.01
        mended = dataclasses.replace(track, time=track.time + film.row_time * track.row)
        near(nine(mended), one, rtol=1e-4)


def test_the_same_seed_makes_the_same_film_and_another_another():
    one, same, other = (filmed(Film(), seed) for seed in (1, 1, 2))
    assert fitball.values.same(one, same)
    assert not fitball.values.same(one, other)


def test_impossible_films_and_models_without_gaps_are_refused():
    with pytest.raises(ParameterError, match=r"fps = 0\.0: expected a positive number"):
        Film(fps=0.0)
    with pytest.raises(ParameterError, match=r"lost = 1\.5: expected a share"):
        Film(lost=1.5)
    with pytest.raises(ParameterError, match="noise = -1"):
        Film(noise=-1)
    with pytest.raises(ParameterError, match="fold"):
        Film(fold=0)
    brody = fitball.model("brody").rebound({"mu": 0.5, "cor_10": 0.75, "cor_slope": 0.0}, IMPACTS)
    with pytest.raises(ParameterError, match="impact 1 has no rebound with gaps"):
        simulated_tracks(IMPACTS, brody, Film(), np.random.default_rng(1))


def test_the_shell_leaves_with_its_own_turn_and_swings_back_to_the_line_of_the_model():
    model, bounced = fitball.model("two-mass"), rebound()
    ahead = ahead_at_release(model, VALUES, IMPACTS, bounced)
    # As large as a shell twists at Wang's values.
    assert (np.abs(ahead) > 0.005).all() and (np.abs(ahead) < 0.15).all()
    for k, one in enumerate(truth(IMPACTS, bounced)):
        end = float(bounced.contact_time[k])
        times = np.linspace(0.0, end, 4001)
        history = model.history(VALUES, IMPACTS.take(np.array([k])), times)
        turned = np.trapezoid(history.omega_2, times)
        course = Course(one, end, float(ahead[k]), 0.5, np.zeros(2), fitball.Ball(), 1.2)
        assert course.at(np.array([end]))[0, 2] == pytest.approx(turned, abs=5e-4)
        late = np.array([0.03, 0.04])
        np.testing.assert_allclose(course.at(late)[:, 2], one[8] + one[5] * (late - one[6]), atol=1e-6)
