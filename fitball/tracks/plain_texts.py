"""Texts of trackers that are no table with a header of columns: MTrack2 of ImageJ, whose tracks
stand side by side in blocks with a summary below them, boxes of MOTChallenge, which have no header,
and regions of the VGG Image Annotator (VIA), whose shapes are written in JSON.
"""

from __future__ import annotations

import csv
import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from fitball.base.errors import Note
from fitball.base.text import one_line
from fitball.data.cells import TableCells, texts_of
from fitball.data.records import NUMBER, check_shape, refusal

# The header of MTrack2, with the sign between its cells.
_MTRACK2 = re.compile(r"Frame(?P<sign>[\t,;]| +)\s*X1(?P=sign)\s*Y1(?P=sign)\s*Flag1\b(?P<more>.*)")
# The line above each of its blocks, with the number of the first track there; spreadsheets put its
# words into cells.
_BLOCK = re.compile(r"Tracks\W+(?P<first>\d+)\W+to\W+\d+\W*")
# Cells of a track in a row of MTrack2: x, y, flag.
_CELLS_OF_TRACK = 3
# How the header of VIA begins, and the columns with the shape of a region and what else is said of
# it.
_VIA = "filename,file_size,file_attributes,"
_SHAPE = "region_shape_attributes"
_ATTRIBUTES = "region_attributes"
# Columns of boxes, in all files of MOTChallenge.
_BOX = ("frame", "id", "left", "top", "width", "height", "confidence")
# What stands behind them, by the number of cells: nothing, class and visibility as in files of the
# truth, or places in space.
_WIDTH_OF_TRUTH = 9
_BEHIND: Mapping[int, Sequence[str]] = {
    7: (),
    _WIDTH_OF_TRUTH: ("class", "visibility"),
    10: ("x in space", "y in space", "z in space"),
}
# What stands for no number.
_NONE = -1.0
# Bytes in which the first line ends, if it is one of these.
_MOST_OF_HEAD = 10_000
# Signs that may separate cells of boxes.
_SIGNS = re.compile(r"[,;\t ]\s*")
_WHOLE = re.compile(r"-?\d+(?:\.0*)?")


def cells_of_plain_text(source: str, data: bytes) -> TableCells | None:
    """The cells of positions of MTrack2 or MOTChallenge, None of another text.

    Raises:
        InputError: the text is too large (`too-large`), tracks of MTrack2 have no sign between
            their cells (`row-length`), or a region of VIA has no place (`no-positions`).
    """
    head, _, _ = data[:_MOST_OF_HEAD].strip().decode("utf-8-sig", "replace").partition("\n")
    mtrack2 = _MTRACK2.fullmatch(head.strip())
    is_via = head.startswith(_VIA) and {_SHAPE, _ATTRIBUTES} <= {*head.strip().split(",")}
    if not (is_via or mtrack2 or _is_box(_SIGNS.split(head.strip()))):
        return None
    lines = data.decode("utf-8-sig", "replace").splitlines()
    filled = [(number, line) for number, line in enumerate(lines, 1) if line.strip()]
    sha256 = hashlib.sha256(data).hexdigest()
    if is_via:
        columns, numbers = _of_via(source, lines)
        return _cells(source, sha256, columns, numbers)
    if mtrack2:
        sign = mtrack2["sign"].strip(" ")
        if not sign and mtrack2["more"].strip():
            words = (
                "is of MTrack2, but has blanks between its cells, so that the tracks of places are "
                "lost; expected tabs or commas, as it writes them"
            )
            raise refusal(source, "row-length", words, filled[0][0])
        columns, numbers = _of_mtrack2(filled[1:], sign)
        return _cells(source, sha256, columns, numbers)
    boxes = [_SIGNS.split(line.strip()) for _, line in filled]
    if not all(len(box) == len(boxes[0]) and _is_box(box) for box in boxes):
        return None
    names = [*_BOX, *_BEHIND[len(boxes[0])]]
    columns = dict(zip(names, map(list, zip(*boxes, strict=True)), strict=True))
    cells = _cells(source, sha256, columns, [number for number, _ in filled])
    words = (
        f"line {filled[0][0]} is no header: read as {', '.join(_BOX)}, the boxes of MOTChallenge"
    )
    cells.notes.append(Note("no-header", words))
    return cells


def _cells(
    source: str, sha256: str, columns: Mapping[str, list[str]], lines: Sequence[int]
) -> TableCells:
    """The cells of columns by name, whose rows are from these lines. Raises InputError
    (`too-large`).
    """
    check_shape(source, len(lines), len(columns))
    arrays = [texts_of(column) for column in columns.values()]
    rows = np.arange(len(lines)) + 1
    return TableCells(source, sha256, [*columns], arrays, rows, np.array(lines, dtype=np.int64))


def _of_mtrack2(
    lines: Sequence[tuple[int, str]], sign: str
) -> tuple[dict[str, list[str]], list[int]]:
    """The columns of tracks below each other, and the numbers of their lines; frames in which a
    track has no place are left out.
    """
    columns: dict[str, list[str]] = {"frame": [], "track": [], "x": [], "y": []}
    numbers = list[int]()
    first = 1
    for number, line in lines:
        if match := _BLOCK.fullmatch(line.strip()):
            first = int(match["first"])
            continue
        frame, *cells = (cell.strip() for cell in line.split(sign or None))
        if not NUMBER.fullmatch(frame):
            # The summary of the tracks.
            break
        for track, x, y in _places(cells, first):
            for name, text in zip(columns, (frame, track, x, y), strict=True):
                columns[name].append(text)
            numbers.append(number)
    return columns, numbers


def _places(cells: Sequence[str], first: int) -> Iterator[tuple[str, str, str]]:
    """The number of each track that a row of cells has, from the `first`, with its place."""
    for k in range(0, len(cells) - 1, _CELLS_OF_TRACK):
        x, y = cells[k : k + 2]
        if x or y:
            yield str(first + k // _CELLS_OF_TRACK), x, y


def _of_via(source: str, lines: Sequence[str]) -> tuple[dict[str, list[str]], list[int]]:
    """The columns of regions, their centres, and the numbers of their lines. Raises InputError
    (`no-positions`).
    """
    columns: dict[str, list[str]] = {"frame": [], "track": [], "x": [], "y": [], "confidence": []}
    numbers = list[int]()
    reader = csv.DictReader(lines)
    for row in reader:
        try:
            shape = json.loads(row[_SHAPE] or "{}")
            attributes = json.loads(row[_ATTRIBUTES] or "{}")
            if not shape:
                continue
            x = shape["cx"] if "cx" in shape else shape["x"] + 0.5 * shape["width"]
            y = shape["cy"] if "cy" in shape else shape["y"] + 0.5 * shape["height"]
        except (ValueError, LookupError, TypeError):
            words = f"read the region '{one_line(str(row[_SHAPE]))}' of VIA; expected a rectangle"
            words = f"{words}, circle, ellipse or point in JSON"
            raise refusal(source, "no-positions", words, reader.line_num) from None
        texts = (
            row["filename"],
            attributes.get("track", ""),
            x,
            y,
            attributes.get("confidence", ""),
        )
        for name, text in zip(columns, texts, strict=True):
            columns[name].append(str(text))
        numbers.append(reader.line_num)
    if not any(columns["confidence"]):
        del columns["confidence"]
    return columns, numbers


def _is_box(row: Sequence[str]) -> bool:
    """Whether cells are a row of MOTChallenge: whole numbers of a frame and an id, a box that has a
    size, and behind it what its files have there.
    """
    if len(row) not in _BEHIND or not all(map(NUMBER.fullmatch, row)):
        return False
    *_, width, height, confidence = map(float, row[: len(_BOX)])
    behind = [*map(float, row[len(_BOX) :])]
    is_whole = all(map(_WHOLE.fullmatch, row[:2]))
    if not is_whole or min(width, height) <= 0.0:
        return False
    if len(row) == len(_BOX):
        return confidence == _NONE or 0.0 <= confidence <= 1.0
    if len(row) == _WIDTH_OF_TRUTH:
        return behind[-1] == _NONE or 0.0 <= behind[-1] <= 1.0
    return {*behind} == {_NONE}
