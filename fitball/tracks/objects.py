"""The objects of a file of positions, by its header: balls, and what else was tracked beside them.

Where names of objects say which is the ball (`ball` and `racket`), it is read. Where they do not,
`--ball` chooses it. A table of heights over time alone, by a motion sensor or a camera beside the
ball, is of a ball that moves up and down.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence, Set
from itertools import pairwise
from typing import NamedTuple

from fitball.data.cells import TableCells
from fitball.data.lexicon import bare_name, without_data_set
from fitball.tracks.names import (
    DIALECTS,
    LISTED,
    NAMED_DIALECTS,
    Column,
    FilmNaming,
)

# Points of Tracker and DLTdv have numbers, no names.
_NUMBERED = re.compile(r"\d+|pt\d.*")
# Columns that the points of a header share.
_SHARED = ("id", "session", "part", "t", "frame", "quality", "visibility")
# Columns that may be clocks, and by how much the rank of one that stands still rises.
_CLOCKS = ("t", "frame")
_IDLE = 2 * LISTED
# Columns whose texts name clips and objects.
_NAMING_ROWS = ("id", "part")
# Fewest rows of which a column whose texts are all different names none.
_FEWEST_ROWS = 7
# Names of columns as motmetrics writes boxes of MOTChallenge, in which x and y are a corner.
_MOT = frozenset(["frameid", "id", "x", "y", "width", "height"])
# Names of columns of TrackMate, whose quality is no share of 1.
_TRACKMATE = frozenset(["positionx", "positiony", "trackid", "quality"])
# Names that the only coordinate of a ball may have, the likeliest first: ours, then others.
_HEIGHTS = ("y", "z", "height")
_SENSOR_HEIGHTS = ("position", "distance", "altitude", "hauteur", "höhe", "abstand", "weg")
# Names of a ball in some languages, alone or behind the game's: `ball`, `Tennisball 2`.
_BALL = re.compile(
    r"(?<![^\W\d_])(?:[^\W\d_]*ball|ballon|balle|balón|balon|bola|pelota|palla|pallina|boll|bold|"
    r"piłka|pilka|míč|мяч)s?(?![^\W\d_])",
    re.IGNORECASE,
)
# What parts a name of several levels: `animal.part`.
_LEVELS = re.compile(r"[.\s_/|:-]+")


class FilmedBall(NamedTuple):
    """A ball of a file: what it adds to the file's name, the index of each of its columns in the
    header, whether its coordinates are in pixels, and whether its name is one that people gave.
    """

    name: str
    indices: dict[str, int]
    pixels: bool = False
    is_named: bool = False

    @property
    def names_itself(self) -> bool:
        """Whether the name says more than a number, so that no file's name stands before it."""
        return bool(self.name) and not _NUMBERED.fullmatch(self.name)

    @property
    def vertical(self) -> bool:
        """Whether its heights are its only coordinate."""
        return "x" not in self.indices and "left" not in self.indices


def is_ball(name: str) -> bool:
    """Whether the name of an object says that it is a ball."""
    return bool(_BALL.search(name))


def chosen_names(names: Iterable[str], wanted: str) -> list[str]:
    """The names of objects that are balls: those that are wanted, whole or as one of their levels,
    else those that say so, else all.
    """
    every = [*dict.fromkeys(names)]
    if wanted:
        their = bare_name(wanted)
        whole = [name for name in every if bare_name(name) == their]
        return whole or [
            name for name in every if their in map(bare_name, _LEVELS.split(name.strip()))
        ]
    return [name for name in every if is_ball(name)] or every


def balls_of_header(cells: TableCells, naming: FilmNaming) -> list[FilmedBall]:
    """The balls of a file, by its dialect; empty where no column has positions."""
    names = [name.strip() for name in cells.names]
    columns = [_counting(cells, k, naming.read(name)) for k, name in enumerate(names)]
    indices = _likeliest(columns)
    bare = {bare_name(naming.split(name)[0]) for name in names}
    if bare >= _TRACKMATE:
        indices.pop("quality", None)
    if bare >= _MOT:
        indices |= {"left": indices.pop("x"), "top": indices.pop("y")}
    shared = {name: index for name, index in indices.items() if name in _SHARED}
    if {"x", "y"} <= {*indices}:
        # The ball beside other objects is one of these.
        points = _points(names, naming, NAMED_DIALECTS, shared)
        if any(is_ball(ball.name) and ball.indices["x"] == indices["x"] for ball in points):
            return points
        return _balls_of_masses(cells, columns) or [FilmedBall("", indices)]
    if _has_box({*indices}):
        return [FilmedBall("", indices)]
    return _points(names, naming, DIALECTS, shared) or _balls_of_heights(names, naming, indices)


def _balls_of_heights(
    names: Sequence[str],
    naming: FilmNaming,
    indices: Mapping[str, int],
) -> list[FilmedBall]:
    """The ball of a table of heights over time alone, which are its y; empty of another table."""
    if not {"t", "frame"} & indices.keys() or "x" in indices:
        return []
    bare = [bare_name(naming.split(without_data_set(name))[0]) for name in names]
    heights = [indices[name] for name in _HEIGHTS if name in indices]
    heights = heights or [bare.index(name) for name in _SENSOR_HEIGHTS if name in bare]
    if len(heights) != 1:
        return []
    others = {name: index for name, index in indices.items() if name not in _HEIGHTS}
    return [FilmedBall("", {**others, "y": heights[0]})]


def _points(
    names: Sequence[str],
    naming: FilmNaming,
    dialects: Iterable[re.Pattern[str]],
    shared: Mapping[str, int],
) -> list[FilmedBall]:
    """The points of the first of some dialects that a header has, empty without one."""
    for dialect in dialects:
        if points := _balls_of_points(names, naming, dialect, shared):
            return points
    return []


def _counting(cells: TableCells, index: int, column: Column) -> Column:
    """What a column means by its texts too. One whose texts are all different names no clip, and a
    file of several frames is no frame. A clock that is empty or stands still goes behind others.
    """
    is_file = column.ours == "frame" and column.rank >= LISTED
    is_clock = column.ours in _CLOCKS and not is_file
    if column.rank < 0 or not (is_clock or is_file or column.ours in _NAMING_ROWS):
        return column
    texts = cells.text(index)
    count = len({*texts} - {""})
    is_of_rows = count == len(texts) >= _FEWEST_ROWS
    if is_clock:
        return column if count > 1 else column._replace(rank=column.rank + _IDLE)
    if is_file:
        return column if is_of_rows else Column("id", None, column.rank)
    return Column(None, None, 0) if is_of_rows else column


def _likeliest(columns: Sequence[Column]) -> dict[str, int]:
    """The index of the likeliest column of each name, of equal ones the first."""
    indices = dict[str, int]()
    for index, column in enumerate(columns):
        if column.ours is None:
            continue
        if column.ours in indices and columns[indices[column.ours]].rank <= column.rank:
            continue
        indices[column.ours] = index
    return indices


def _has_box(names: Set[str]) -> bool:
    """Whether columns have a corner of a box, and its size or the opposite corner."""
    size = {"right", "bottom"} <= names or {"width", "height"} <= names
    return size and {"left", "top"} <= names


def _balls_of_points(
    names: Sequence[str],
    naming: FilmNaming,
    dialect: re.Pattern[str],
    shared: Mapping[str, int],
) -> list[FilmedBall]:
    """The points of a dialect that names them in the header, with the columns that they share;
    those without x or y are left out.
    """
    points: dict[str, dict[str, int]] = {}
    for index, cell in enumerate(names):
        if point := naming.point(cell, dialect):
            points.setdefault(point.name, {**shared})[point.ours] = index
    complete = {name: indices for name, indices in points.items() if {"x", "y"} <= {*indices}}
    is_named = dialect in NAMED_DIALECTS
    alone = len(complete) == 1
    return [
        FilmedBall(
            "" if alone and not is_named else name,
            indices,
            "_cam" in name.casefold() and not is_named,
            is_named,
        )
        for name, indices in complete.items()
    ]


def _balls_of_masses(cells: TableCells, columns: Sequence[Column]) -> list[FilmedBall]:
    """The masses of Tracker, side by side: each x begins a mass, whose time is the last before it,
    and whose name may stand above. Empty where there is one x.
    """
    least = min(column.rank for column in columns if column.ours == "x")
    starts = [
        index for index, column in enumerate(columns) if column.ours == "x" and column.rank == least
    ]
    names = {bare_name(cells.names[index]) for index in starts}
    if len(starts) == 1 or len(names) > 1:
        return []
    balls = list[FilmedBall]()
    for first, last in pairwise([*starts, len(columns)]):
        block = {name: first + k for name, k in _likeliest(columns[first:last]).items()}
        if "y" not in block:
            continue
        clocks = [
            (column.ours, index)
            for index, column in enumerate(columns[:first])
            if column.ours in ("t", "frame")
        ]
        balls.append(FilmedBall(str(len(balls) + 1), block | dict(clocks)))
    return balls


def names_of_masses(cells: TableCells, balls: Sequence[FilmedBall]) -> list[str]:
    """What stands above the x of each ball, or above the time before it, else its own name."""
    above = cells.above[-1] if cells.above else [""] * len(cells.names)
    names = []
    for ball in balls:
        first = ball.indices["x"]
        before = above[first - 1] if first else ""
        names.append(above[first] or before or ball.name)
    return names
