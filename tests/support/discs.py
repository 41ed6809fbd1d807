"""Films of a phone as a detector of discs reads them: positions in pixels with the radius of the
ball, whose errors last while felt and mark turn. Nothing of fitball.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from support.films import RADIUS, filmed, waves


class Noise(NamedTuple):
    """How positions of a detected ball err: `lasting` [px] while the ball turns, for about `time`
    [s], and `frame` [px] in each frame; the same of angles [rad]. Relative sds of the radius and of
    the distance from film to film.
    """

    lasting: float = 0.065
    frame: float = 0.067
    time: float = 0.006
    angle_lasting: float = 0.009
    angle_frame: float = 0.0065
    radius: float = 0.012
    distance: float = 0.01


def disc_films(truth, camera, noise, rng, contact=None, ahead=None):
    """The long table of films of impacts (impacts, 9) by a camera with a rolling shutter; each film
    has a distance and a radius of its own.
    """
    unit = 1e-3 * camera.mm_per_px
    seen = replace(
        camera,
        noise=unit * noise.frame,
        outliers=0.005,
        angle_noise=noise.angle_frame,
        angle_outliers=0.02,
        lasting=unit * noise.lasting,
        lasting_time=noise.time,
    )
    pieces = []
    for k in range(len(truth)):
        of_film = replace(seen, scale=seen.scale * (1.0 + noise.distance * rng.standard_normal()))
        one = slice(k, k + 1)
        ends = (None, None) if contact is None else (contact[one], ahead[one])
        piece = filmed(truth[one], of_film, rng, *ends)
        piece["id"] = str(k + 1)
        t = piece["frame"].to_numpy() / camera.fps
        piece["angle [rad]"] += noise.angle_lasting * waves(t, noise.time, rng)[:, 0]
        size = RADIUS / of_film.scale / unit
        piece["radius [px]"] = size * (1.0 + noise.radius * rng.standard_normal())
        piece["radius_sd [px]"] = noise.frame
        pieces.append(piece)
    return pd.concat(pieces, ignore_index=True)


def rolled(camera, noise, rng):
    """Positions of a ball that rolls along the court through the landing place, at 1.5 m/s."""
    unit = 1e-3 * camera.mm_per_px
    t = np.arange(-0.3, 0.3, 1.0 / camera.fps)
    along = 1.5 * t
    above = RADIUS / camera.scale / (1.0 + noise.distance * rng.standard_normal())
    x = np.cos(camera.tilt) * along - np.sin(camera.tilt) * above
    y = np.sin(camera.tilt) * along + np.cos(camera.tilt) * above
    seen = np.stack([x, y + camera.court_height], axis=1) / unit
    seen += noise.lasting * waves(t, noise.time, rng)
    seen += noise.frame * rng.standard_normal(seen.shape)
    columns = {"id": "roll", "t [s]": t, "x [px]": seen[:, 0], "y [px]": seen[:, 1]}
    return pd.DataFrame(columns)
