"""How well a film would determine an impact: the estimator's own normal equations on frames without errors.

The frames are those that a camera takes while the ball is in its view. Those of the contact count for nothing, and
drag and lift have their priors. With frames that are lost or outliers a flight has so much less information.
"""

from __future__ import annotations

import numpy as np

from fitball.errors import ParameterError
from fitball.models.types import Rebound
from fitball.tracks.estimate import FEWEST, INFO_OUTLIERS, WIDTH, Batch, Priors, Sides, evaluate, nine, sort_frames
from fitball.tracks.flight import resistance
from fitball.tracks.frames import AFTER, BEFORE, NINE
from fitball.tracks.simulate import Course, Film, frame_numbers, in_view, truth
from fitball.values import Ball, FloatArray, Impacts


def nine_covariance(impacts: Impacts, rebound: Rebound, film: Film, ball: Ball) -> FloatArray:
    """The covariance (impacts, 9, 9) of the `NINE` as `film` would determine them; NaN where a ball is seen in fewer
    than three frames on a side. Without marks spins and turn are NaN.

    Errors that last (`slow`) widen those of positions. Raises ParameterError for a film
    without noise.
    """
    if min(film.noise, film.angle_noise) <= 0.0:
        raise ParameterError("film: noise and angle_noise: expected positive numbers, for errors to be predicted")
    values, marked = truth(impacts, rebound), np.full(len(impacts), film.fold is not None)
    batch = _batch(values, rebound, film, ball)
    sides = Sides.empty(batch)
    sides.times[:, 1] = values[:, NINE.index("gap_time")]
    for o, v_x, v_y, omega, sign in ((0, 0, 1, 2, -1.0), (WIDTH, 3, 4, 5, 1.0)):
        sides.state[:, o + 1], sides.state[:, o + 3] = values[:, v_x], sign * values[:, v_y]
        sides.state[:, o + 6] = values[:, omega]
    sides.state[:, [0, 2]] = [0.0, ball.radius]
    sides.state[:, WIDTH], sides.state[:, WIDTH + 2] = values[:, NINE.index("gap_path")], ball.radius
    sides.state[:, WIDTH + 5] = values[:, NINE.index("gap_turn")]
    sides.state[:, -1] = film.air.drag
    sort_frames(batch, sides)
    evaluate(batch, sides, marked)
    air, ones = film.air, np.ones(len(impacts))
    priors = Priors(
        air.drag * ones,
        np.hypot(air.drag_sd, air.drag_shot_sd) * ones,
        np.zeros((len(impacts), 2)),
        np.where(marked, air.lift_sd, air.lift_unmarked_sd),
        marked,
    )
    # What is lost is lost from all frames alike.
    kept = (1.0 - film.lost) * (1.0 - film.outliers)
    places = sides.info[:, : INFO_OUTLIERS - 1].sum(axis=1) * kept / (1.0 + film.slow**2)
    angles = sides.info[:, INFO_OUTLIERS - 1] * (1.0 - film.lost) * (1.0 - film.angle_outliers)
    state = np.linalg.inv(places + angles + priors.precision())
    _values, slopes = nine(batch, sides, marked)
    found = np.asarray(slopes @ state @ slopes.swapaxes(1, 2))
    counts = np.stack([(sides.role == role).sum(axis=1) for role in (BEFORE, AFTER)])
    found[(counts < FEWEST).any(axis=0)] = np.nan
    if film.fold is None:
        spins = [NINE.index(name) for name in ("omega_1", "omega_2", "gap_turn")]
        found[:, spins] = found[:, :, spins] = np.nan
    return found


def _batch(values: FloatArray, rebound: Rebound, film: Film, ball: Ball) -> Batch:
    """The frames of all impacts without errors, those of an impact in a row."""
    times = np.asarray((frame_numbers(film) + 0.5) / film.fps, dtype=np.float64)
    room = np.full((3, len(values), times.size), np.nan)
    for k, (one, end) in enumerate(zip(values, np.ravel(rebound.contact_time), strict=True)):
        places = Course(one, float(end), 0.0, film.air.drag, np.zeros(2), ball, film.air.density).at(times)
        seen = in_view(times, places, film)
        room[:, k, seen] = times[seen], places[seen, 0], places[seen, 1]
    used = np.flatnonzero(np.isfinite(room[0]).any(axis=0))
    room, ones = room[:, :, used], np.ones(len(values))
    # The angle of the mark is what the state says of it.
    turned = np.where(
        room[0] < 0.0, values[:, [2]] * room[0], values[:, [8]] + values[:, [5]] * (room[0] - values[:, [6]])
    )
    sigma = np.array([film.noise, film.noise, film.angle_noise]) * ones[:, None]
    return Batch(
        room[0], room[1], room[2], turned, ones, ball.radius, resistance(ball, film.air.density), ball.radius, sigma,
        np.full(2, 1e-9), float(np.mean(values[:, 6])),
    )  # fmt: skip
