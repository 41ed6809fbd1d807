"""The scale of films whose ball is measured in each frame: by the size of its disc and by gravity
together, each with its sd.

The disc is seen anew in each film, and is off by another amount in each; gravity is seen by the
curvature of the flights. Both are independent. What all films share, since the ball, the air and
the shutter are the same, is an error of the session; the rest is one of each film.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fitball.base.display_units import MM, PERCENT
from fitball.base.errors import Note
from fitball.base.itf import GRAVITY
from fitball.base.numbers import counted
from fitball.base.text import one_line
from fitball.base.values import DataFrame
from fitball.tracks.find import Gravity
from fitball.tracks.types import Track

# Relative sd of the radius of a disc in a film: light, felt and blur move its edge; by the same in
# all frames of a film,
_DISC_SD = 0.01
# which counts more of a small ball [px]: of nine films that `scripts/validation/detector.py` draws
# seven were off by less than 0.15 px, two whose seam runs along the rim by 0.35 and 0.63 px.
_DISC_SD_PX = 0.2
# and partly in all films alike.
_SHARED_DISC_SD = 0.005
# Films that a note tells apart.
_FILMS_NOTED = 3


class FilmScale(NamedTuple):
    """The scale of a film [m/px] with relative sds: `own_sd` of this film, `shared_sd` of all of a
    session. It is the mean of that `by_ball` and that `by_gravity`, NaN where no flight shows it.
    """

    metres_per_px: float
    own_sd: float
    shared_sd: float
    by_ball: float
    ball_sd: float
    by_gravity: float
    gravity_sd: float

    @property
    def sd(self) -> float:
        """The relative sd of the scale."""
        return float(np.hypot(self.own_sd, self.shared_sd))


def scale_of_film(track: Track, gravity: Gravity) -> FilmScale:
    """The scale of a film by the disc of its ball, on which its track rests, and by gravity as its
    flights show it at that scale: the mean by inverse variances.
    """
    by_ball = track.metres_per_px
    ball_own = float(np.linalg.norm([_DISC_SD, _DISC_SD_PX / track.radius_px, track.radius_sd]))
    ball = ball_own**2 + _SHARED_DISC_SD**2
    by_gravity = by_ball * GRAVITY / gravity.value
    relative = np.array([gravity.own_sd, gravity.shared_sd]) / gravity.value
    own, shared = (relative**2).tolist()
    if not np.isfinite(by_gravity + own + shared) or gravity.value <= 0.0:
        return FilmScale(by_ball, ball_own, _SHARED_DISC_SD, by_ball, ball**0.5, np.nan, np.nan)
    weight = ball / (ball + own + shared)
    rest = 1.0 - weight
    return FilmScale(
        metres_per_px=rest * by_ball + weight * by_gravity,
        own_sd=float(np.hypot(rest * ball_own, weight * own**0.5)),
        shared_sd=float(np.hypot(rest * _SHARED_DISC_SD, weight * shared**0.5)),
        by_ball=by_ball,
        ball_sd=ball**0.5,
        by_gravity=by_gravity,
        gravity_sd=(own + shared) ** 0.5,
    )


def rescaled(tracks: Iterable[Track], scales: Mapping[str, FilmScale]) -> list[Track]:
    """Tracks with the scales of their films, by id; others as they are."""
    moved = list[Track]()
    for track in tracks:
        if track.id in scales:
            scale = scales[track.id]
            factor = scale.metres_per_px / track.metres_per_px
            track = replace(
                track,
                x=factor * track.x,
                y=factor * track.y,
                metres_per_px=scale.metres_per_px,
                radius_px=np.nan,
                scale_sd=scale.own_sd,
            )
        moved.append(track)
    return moved


def shared_scale_sd(scales: Mapping[str, FilmScale]) -> float:
    """The relative sd of the scale that all films of a session share, 0 without any."""
    return float(np.median([scale.shared_sd for scale in scales.values()])) if scales else 0.0


def scale_frame(scales: Mapping[str, FilmScale]) -> DataFrame:
    """A row for each film: its scale, and that by the ball and by gravity, with relative sds."""
    import pandas as pd

    rows = [
        {
            "id": name,
            "scale [mm/px]": MM.factor * scale.metres_per_px,
            "scale_sd": scale.sd,
            "by_ball [mm/px]": MM.factor * scale.by_ball,
            "by_ball_sd": scale.ball_sd,
            "by_gravity [mm/px]": MM.factor * scale.by_gravity,
            "by_gravity_sd": scale.gravity_sd,
        }
        for name, scale in scales.items()
    ]
    return pd.DataFrame(rows)


def scale_notes(scales: Mapping[str, FilmScale]) -> list[Note]:
    """Notes on the scale of each film, of many on their median."""
    notes = list[Note]()
    named = [*scales.items()]
    if len(named) > _FILMS_NOTED:
        middle = FilmScale(*np.nanmedian(np.array([*scales.values()]), axis=0).tolist())
        named = [(f"median of {counted(len(named), 'film')}", middle)]
    for name, scale in named:
        parts = [f"ball {_scale_words(scale.by_ball, scale.ball_sd)}"]
        if np.isfinite(scale.by_gravity):
            parts.append(f"gravity {_scale_words(scale.by_gravity, scale.gravity_sd)}")
        whole = f"{_scale_words(scale.metres_per_px, scale.sd)} by {' and '.join(parts)}"
        notes.append(Note("scale", f"Scale, {one_line(name)}: {whole}."))
    return notes


def _scale_words(metres_per_px: float, sd: float) -> str:
    """A scale with its relative sd in words."""
    return f"{MM.number(metres_per_px, 4)} mm/px ± {PERCENT.number(sd, 2)} %"


def rests_on_discs(track: Track) -> bool:
    """Whether the scale of a track rests on discs whose errors are known."""
    return track.is_measured and bool(np.isfinite(track.radius_px))
