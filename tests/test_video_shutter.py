"""The row time of a rolling shutter by the shapes of discs."""

import numpy as np
import pytest

from fitball.video.shutter import Shapes, shutter_of, together
from fitball.video.types import Estimate

ROW_TIME = 6e-6
# What light makes of stretch and lean, and what marks make of them when the ball is upright.
LIGHT = np.array([0.008, -0.004])
MARKS = np.array([0.010, 0.006])
NOISE = 0.0005
# That of real films: flights are hardly seen to change their velocity.
ROUGH = 0.01
# Velocities along the rows' readout and across [px/s] before and after a bounce.
BEFORE, AFTER = (1300.0, 1800.0), (-900.0, 700.0)
FRAMES_EACH = 30


def turned_shape(shape, angle):
    """Stretch and lean of an ellipse whose matrix of second moments is turned."""
    stretch, lean = shape
    # The disc x^2 + y^2 = 1 sheared by lean, longer by stretch: (x, y) -> (x + lean y', y').
    move = np.array([[1.0, lean], [0.0, 1.0 + stretch]])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moments = turn @ move @ move.T @ turn.T
    # Back: x-width, and the slope of the line of centres of rows.
    height = moments[1, 1]
    slope = moments[0, 1] / height
    width = moments[0, 0] - slope * moments[0, 1]
    return np.array([np.sqrt(height / width) - 1.0, slope])


def shapes_of(spins, noise=NOISE, known=True):
    """Shapes of a ball that turns with these spins [rad/s] before and after a bounce."""
    rng = np.random.default_rng(1)
    times = np.arange(FRAMES_EACH) / 240.0
    # The mark is nowhere upright, so that the sense of turning matters.
    angle = 0.7 + np.concatenate([spin * times for spin in spins])
    velocity = np.repeat([BEFORE, AFTER], FRAMES_EACH, axis=0)
    velocity[:, 0] += 9.81 / 2.8e-3 * np.tile(times, 2)
    shape = np.array([turned_shape(MARKS, a) for a in angle]) + LIGHT + ROW_TIME * velocity
    return Shapes(
        radius=12.0,
        frames=np.arange(2 * FRAMES_EACH),
        flight=np.repeat([0, 1], FRAMES_EACH),
        velocity=velocity,
        angle=angle if known else np.full(angle.size, np.nan),
        shape=shape + rng.normal(0.0, noise, shape.shape),
        sd=np.full(shape.shape, noise),
    )


def test_marks_that_turn_in_one_flight_alone_are_no_row_time():
    # Before the bounce the ball does not turn: its marks lean all the time, as a shutter would.
    shutter = shutter_of(shapes_of((0.0, 130.0)))
    assert shutter.row_time.value == pytest.approx(ROW_TIME, abs=0.3e-6)


@pytest.mark.parametrize("spins", [(-60.0, 80.0), (150.0, -40.0), (0.0, 0.0)])
def test_the_row_time_holds_the_truth(spins):
    found = shutter_of(shapes_of(spins)).row_time
    assert abs(found.value - ROW_TIME) < 3.0 * found.sd


def test_light_that_stands_still_is_told_apart():
    shutter = shutter_of(shapes_of((-60.0, 80.0)))
    assert shutter.light == pytest.approx(LIGHT, abs=0.001)


def test_marks_that_turn_make_the_row_time_no_less_sure():
    seen = shutter_of(shapes_of((-60.0, 80.0))).row_time
    blind = shutter_of(shapes_of((-60.0, 80.0), known=False)).row_time
    assert seen.sd < 0.5 * blind.sd


def test_an_error_of_a_whole_flight_is_within_the_sd():
    shapes = shapes_of((-60.0, 80.0), noise=ROUGH)
    # A twentieth of a pixel, in both flights against each other.
    off = np.where(shapes.flight == 0, 1.0, -1.0)[:, None] * [0.05 / 12.0, -0.05 / 12.0]
    right = shutter_of(shapes).row_time
    wrong = shutter_of(shapes._replace(shape=shapes.shape + off)).row_time
    assert abs(wrong.value - right.value) < right.sd


def test_a_larger_ball_shows_the_row_time_better():
    shapes = shapes_of((-60.0, 80.0), noise=0.3 * ROUGH)
    larger = shutter_of(shapes._replace(radius=48.0)).row_time
    assert larger.sd < 0.7 * shutter_of(shapes).row_time.sd


def test_estimates_that_disagree_are_less_sure_together():
    alike = together([Estimate(5.0, 0.3), Estimate(5.1, 0.4)])
    assert alike.sd == pytest.approx((0.3**-2 + 0.4**-2) ** -0.5)
    apart = together([Estimate(4.0, 0.3), Estimate(6.0, 0.4)])
    # By the root of chi squared over its freedom: 2^2 / (0.3^2 + 0.4^2).
    assert apart.sd == pytest.approx(alike.sd * 4.0)
    assert apart.value == pytest.approx((4.0 / 0.09 + 6.0 / 0.16) / (1 / 0.09 + 1 / 0.16))
