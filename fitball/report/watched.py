"""What a page says of films that were looked at: a line of each, and the picture to check it by."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from fitball.base.display_units import DEG, MICROSECONDS, MS
from fitball.base.numbers import counted
from fitball.base.text import one_line
from fitball.base.values import Figure
from fitball.report.blocks import Block, Mark, Picture, Report, Section, Table, Text
from fitball.report.own_folder import FOLDER
from fitball.report.strip import draw_strip
from fitball.tracks.film import Filmed
from fitball.tracks.watch import Watched
from fitball.video.types import Clip, Seen, Sightings

# Films that a first screen has a line of, and balls that a page has a picture of.
_LINES = 12
_MOST_PICTURES = 12
# What says the rate of the camera.
_BY = {"option": "as stated", "android tag": "by its tag", "stamps": "by its stamps"}
_STRIP = (
    "the ball of every sixth frame, circles of all frames (red ones are left out), strokes for "
    "the angle, the level line through the court; below, the ball with the circle that was fitted."
)
_NEXT = (
    f"Next: look at the pictures; then `fitball track {FOLDER}/positions.csv`, or of the films "
    "without `--film-only`."
)


def lines(watched: Watched) -> list[str]:
    """A line of each film: frames, rate, size of the ball, shutter, tilt, shake, exposure."""
    texts = [_line(seen) for seen in watched.seen[:_LINES]]
    texts += [f"{one_line(name)}: {why}" for name, why in watched.refused.items()]
    return texts


def _line(seen: Seen) -> str:
    """The line of a film."""
    clip = seen.clip
    used = sum(int(ball.used.sum()) for ball in seen.balls)
    width = listed_widths(seen)
    parts = [
        f"{one_line(clip.name)}: {used} of {counted(clip.count, 'frame')} {_rate(clip)}",
        f"ball {width} px wide",
        f"row time {MICROSECONDS.plus_minus(*seen.row_time)} us",
        f"court {DEG.plus_minus(*seen.tilt)} deg from level",
    ]
    if seen.shake > 0.0:
        parts.append(f"a shake of {seen.shake:.1f} px was taken out")
    if np.isfinite(seen.exposure):
        parts.append(f"exposure {MS.number(seen.exposure, 2)} ms")
    return "; ".join(parts)


def listed_widths(seen: Seen) -> str:
    """The widths [px] of the balls of a film."""
    widths = [f"{2.0 * float(np.median(ball.radius[ball.used])):.1f}" for ball in seen.balls]
    return " and ".join(widths)


def _rate(clip: Clip) -> str:
    """At which rate a film was taken and is played."""
    taken = f"at {clip.camera_rate:.5g}/s {_BY[clip.rate_source]}"
    if round(clip.stretch, 2) == 1.0:
        return taken
    return f"{taken} (plays at {clip.played_rate:.4g}/s)"


def _balls(watched: Watched) -> Iterator[tuple[str, Seen, Sightings]]:
    """The balls that a page has a picture of, with the names of these."""
    balls = [(seen, ball) for seen in watched.seen for ball in seen.balls]
    for seen, ball in balls[:_MOST_PICTURES]:
        safe = "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in ball.id)
        yield f"strip-{safe}", seen, ball


def pictures(watched: Watched) -> list[Picture]:
    """The pictures of what was seen."""
    return [Picture(name, f"{one_line(ball.id)}: {_STRIP}") for name, _, ball in _balls(watched)]


def figures(watched: Watched) -> Mapping[str, Callable[[], Figure]]:
    """Functions that draw these pictures, by name."""
    return {name: partial(draw_strip, seen, ball) for name, seen, ball in _balls(watched)}


def report(film: Filmed, watched: Watched) -> Report:
    """The report of films whose positions alone were wanted."""
    count = sum(len(seen.balls) for seen in watched.seen)
    films = counted(len(watched.seen), "film")
    answer = Mark(f"{counted(count, 'ball')} in {films}.", "good")
    summary: list[Block] = [
        Text([answer], "lead"),
        Text(lines(watched), "list"),
        Text([note.text for note in film.notes], "list"),
        Text([_NEXT]),
        *pictures(watched),
    ]
    return Report(f"Positions in {films}", summary, [section_of_positions(watched)])


def section_of_positions(watched: Watched) -> Section:
    """Which rows of `positions.csv` belong to which ball."""
    rows = [
        {
            "ball": one_line(ball.id),
            "frames": f"{ball.frame[0]} to {ball.frame[-1]}",
            "found": str(ball.frame.size),
            "used": str(int(ball.used.sum())),
            "with an angle": str(int(np.isfinite(ball.angle[ball.used]).sum())),
        }
        for seen in watched.seen
        for ball in seen.balls
    ]
    words = (
        "`positions.csv` has a row a frame, with sds in pixels; `positions.toml` has the camera. "
        "`fitball track positions.csv` gives the same impacts."
    )
    return Section("Positions", [Text([words], "quiet"), Table("", rows)])
