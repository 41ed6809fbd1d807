"""Sightings of a ball in films that show none: what a camera sees of known flights."""

import numpy as np

from fitball.video.types import Estimate, Seen, Sightings

G = 9.80665
# Metres a pixel, the radius of the ball [m], and where it lands [px].
SCALE = 1.4e-3
RADIUS = 0.033
PLACE = (640.0, 600.0)
# Speeds along and towards the court before, along and away after [m/s], contact time [s].
SPEEDS = (6.0, 5.0, 4.0, 4.0)
CONTACT = 4.7e-3
# Film of so many frames at 240/s, and when the ball lands [s].
COUNT = 90
LANDS = 0.19


def path(time):
    """Place of a ball [m] at times [s], x from the landing, y of its centre from there, upwards."""
    v_x1, v_y1, v_x2, v_y2 = SPEEDS
    before = np.minimum(time - LANDS, 0.0)
    after = np.maximum(time - LANDS - CONTACT, 0.0)
    x = v_x1 * before + v_x2 * after + 0.5 * (v_x1 + v_x2) * CONTACT * (after > 0.0)
    y = -v_y1 * before - 0.5 * G * before**2 + v_y2 * after - 0.5 * G * after**2
    return x, y


def seen_in(clip, *, row_time=0.0, tilt=0.0, noise=0.03, seed=1):
    """What is seen in a clip whose rows are read with this time [s/px], by a camera that shows
    level lines rising by the tilt [rad] to the right.
    """
    stamps = clip.filmed(clip.times)
    across, down = clip.readout
    time = stamps.copy()
    # The row at which the ball is decides when it is seen there.
    for _ in range(30):
        x, y = path(time)
        column = PLACE[0] + x / SCALE
        row = PLACE[1] - y / SCALE
        turned_x = np.cos(tilt) * column + np.sin(tilt) * row
        turned_y = np.cos(tilt) * row - np.sin(tilt) * column
        time = stamps + row_time * (across * turned_x + down * turned_y)
    rng = np.random.default_rng(seed)
    free = (time < LANDS) | (time > LANDS + CONTACT)
    count = time.size
    ball = Sightings(
        id=clip.name,
        frame=np.arange(count),
        time=stamps,
        x=turned_x + noise * rng.normal(size=count),
        y=turned_y + noise * rng.normal(size=count),
        x_sd=np.full(count, noise),
        y_sd=np.full(count, noise),
        radius=RADIUS / SCALE + noise * rng.normal(size=count),
        radius_sd=np.full(count, noise),
        angle=np.full(count, np.nan),
        fold=1,
        quality=np.full(count, 0.8),
        used=free,
    )
    return Seen(
        clip=clip,
        balls=(ball,),
        row_time=Estimate(row_time, 1e-7),
        tilt=Estimate(tilt, 1e-3),
        shake=0.0,
        exposure=5e-4,
        background=np.full((clip.height, clip.width), 90, np.uint8),
    )


def nothing_in(clip):
    """What is seen in a clip without a ball."""
    seen = seen_in(clip)
    return Seen(
        clip=clip,
        balls=(),
        row_time=seen.row_time,
        tilt=seen.tilt,
        shake=0.0,
        exposure=np.nan,
        background=seen.background,
        nothing="nothing small moves fast",
    )
