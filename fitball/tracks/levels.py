"""Layouts in which one header row does not name a column: names in several rows (DeepLabCut), and
instances side by side (SLEAP), as tables with one header row.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitball.data.cells import CellArray, TableCells, texts_of
from fitball.data.records import cell_text
from fitball.tracks.names import INDEX

# What rows of names begin with in DeepLabCut. The first one says nothing of a part.
_ROWS_OF_NAMES = ("scorer", "individuals", "bodyparts")
# The row of names of columns begins so, and its first column has the frames.
_LAST_ROW = "coords"
# Names of animals where there is one.
_NO_ANIMAL = ("single",)
# A column of an instance of SLEAP: `inst0.ball.x`, `inst0.track`.
_INSTANCE = re.compile(r"inst(?P<number>\d+)\.(?P<column>.+)")
# The column that names an instance.
_TRACK = "track"


def with_one_header(cells: TableCells) -> TableCells:
    """The same table with one header row; tables of other programs stay as they are."""
    if cells.names and cells.names[0].casefold() == _LAST_ROW:
        return _of_deeplabcut(cells)
    if sum(bool(_INSTANCE.fullmatch(name)) for name in cells.names) > 1:
        return _of_sleap(cells)
    return cells


def _of_deeplabcut(cells: TableCells) -> TableCells:
    """A table whose columns are called `animal.part.x`, of which the first has the frames; of
    several first ones, as those of pictures in folders, the last, and that before it the video.
    """
    levels = [
        record for record in cells.above if record and record[0].casefold() in _ROWS_OF_NAMES[1:]
    ]
    of_index = 1
    while of_index < len(cells.names) and cells.names[of_index].startswith((INDEX, _LAST_ROW)):
        of_index += 1
    names = [*[f"folder {k}" for k in range(of_index - 2)], "video", "frame"][-of_index:]
    for k, axis in enumerate(cells.names[of_index:], of_index):
        of_column = [record[k] for record in levels if record[k] not in ("", *_NO_ANIMAL)]
        names.append(".".join([*of_column, axis]))
    notes = [note for note in cells.notes if note.code != "above-header"]
    return replace(cells, names=names, notes=notes)


def _of_sleap(cells: TableCells) -> TableCells:
    """A table with a row for each instance of a frame, whose track names it."""
    of_instance: dict[str, dict[str, int]] = {}
    shared = list[int]()
    for index, name in enumerate(cells.names):
        if match := _INSTANCE.fullmatch(name):
            of_instance.setdefault(match["number"], {})[match["column"]] = index
        else:
            shared.append(index)
    every = dict.fromkeys(name for columns in of_instance.values() for name in columns)
    names = [name for name in every if name != _TRACK]
    blocks = list[list[CellArray]]()
    for number, columns in of_instance.items():
        tracks = cells.text(columns[_TRACK]) if _TRACK in columns else [""] * len(cells.rows)
        block = {name: cells.columns[index] for name, index in columns.items()}
        block[_TRACK] = texts_of([track or f"inst{number}" for track in tracks])
        missing = texts_of([""] * len(cells.rows))
        blocks.append(
            [
                *(cells.columns[index] for index in shared),
                *(block.get(name, missing) for name in (_TRACK, *names)),
            ]
        )
    return replace(
        cells,
        names=[*(cells.names[index] for index in shared), _TRACK, *names],
        columns=[_stacked(columns) for columns in zip(*blocks, strict=True)],
        rows=np.tile(cells.rows, len(blocks)),
        lines=None if cells.lines is None else np.tile(cells.lines, len(blocks)),
        above=[],
    )


def _stacked(columns: Sequence[CellArray]) -> CellArray:
    """Columns (rows,) below each other, as texts where one of them is."""
    if all(column.dtype.kind != "T" for column in columns):
        return np.concatenate(columns)
    return texts_of([cell_text(cell) for column in columns for cell in column.tolist()])
