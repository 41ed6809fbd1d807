"""Files of positions as people and programs write them, read to `Track`.

| program | header | rows |
|---|---|---|
| any (long table) | `id`, `t` or `frame`, `x, y`, `names.POSITION_COLUMNS` | a frame of a ball |
| detectors | `frame`, `x_min, y_min, x_max, y_max`, `class_name` | a box of an object |
| Tracker | `t, x, y`, or `t, x, y, x, y` of several masses | a frame of all masses |
| Kinovea | `Time`, and `NAME/0/X, NAME/0/Y` of each object | a frame of all objects |
| DLTdv | `pt1_cam1_X, pt1_cam1_Y` of each point, in pixels | a frame, from 1 |
| DeepLabCut | three or four rows of names (`levels`), or `.h5` (`hdf5`) | a frame of all parts |
| SLEAP | `frame_idx`, `track`, `NODE.x, NODE.y`, or `.h5` | a frame of an instance |
| MTrack2, MOTChallenge | `Frame, X1, Y1, Flag1, X2`, or none (`plain_texts`) | a frame, or a box |
| VGG Image Annotator | `filename, region_shape_attributes` (`plain_texts`) | a region of a frame |
| movement | a dataset in `.nc` (`hdf5`) | a frame of all individuals |
| recordings of markers | `NAME X, NAME Y, NAME Z`, or `.c3d` (`c3d`) | a frame of all markers |
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from msgspec.structs import replace as changed

from fitball.base.errors import Fault, InputError, Note, ParameterError
from fitball.base.text import one_line
from fitball.base.units import factor_of
from fitball.data.bundled import path_of_source
from fitball.data.cells import TableCells
from fitball.data.foreign import HDF5
from fitball.data.read import TableSource
from fitball.data.scene import CameraSection, Scene, load_scene
from fitball.data.sources import bytes_of, file_and_sheet, read_cells
from fitball.tracks.c3d import cells_of_c3d, is_c3d
from fitball.tracks.hdf5 import cells_of_hdf5
from fitball.tracks.levels import with_one_header
from fitball.tracks.names import INDEX, FilmNaming
from fitball.tracks.plain_texts import cells_of_plain_text
from fitball.tracks.reader import Reader
from fitball.tracks.types import Track

# The ending of recordings of markers.
_C3D = ".c3d"
# Endings of files that are no text and may have positions.
_BINARY = (".h5", ".hdf5", ".hdf", ".nc", _C3D)
# Endings of texts that may be no table with a header.
_TEXTS = (".txt", ".csv", ".tsv", ".xls")
# Left and upper edge, width and height: `100,50,640,400`.
_RECTANGLE = re.compile(",".join([r"\s*(\d{1,6})\s*"] * 4))
# A length with its unit: `66mm`.
_LENGTH_WITH_UNIT = re.compile(r"\s*(\d+\.?\d*|\.\d+)\s*([a-z]+)\s*", re.IGNORECASE)


def scene_of(
    sources: Sequence[TableSource],
    scene: Scene | str | Path,
    fps: float,
    mm_per_px: float,
    ball_diameter: str,
    min_confidence: float | None = None,
    row_time: float | None = None,
) -> Scene:
    """The scene of films: that which is passed, or the file beside the first film. Frames a second,
    millimetres a pixel and a diameter with its unit override it where they are not 0 or empty, and
    the least confidence of a frame and the time of a row [s/px] where they are passed.

    Raises:
        ParameterError: the diameter is no length with a unit (`length`), or its unit is unknown.
        FolderError: no such file (`not-found`).
        InputError: the file of the scene has faults (`scene`).
    """
    beside = None
    if sources and isinstance(sources[0], str | Path):
        file, _ = file_and_sheet(str(sources[0]))
        beside = path_of_source(file, "tracks")
    if not isinstance(scene, Scene):
        scene = load_scene(beside, scene or None)
    camera = scene.camera or CameraSection()
    if fps:
        camera = changed(camera, fps=fps)
    if mm_per_px:
        camera = changed(camera, mm_per_px=mm_per_px)
    if min_confidence is not None:
        camera = changed(camera, min_confidence=min_confidence)
    if row_time is not None:
        camera = changed(camera, row_time=row_time)
    ball = scene.ball
    if ball_diameter:
        length = _LENGTH_WITH_UNIT.fullmatch(ball_diameter)
        if length is None:
            read = f"ball_diameter: read '{one_line(ball_diameter)}'"
            raise ParameterError(f"{read}; expected a length with its unit, such as 66mm", "length")
        diameter = float(length[1]) * factor_of(length[2], "m")
        ball = changed(ball, radius=0.5 * diameter)
    return changed(scene, camera=camera, ball=ball)


def region_of(text: str) -> tuple[int, int, int, int] | None:
    """The rectangle X,Y,W,H [px] of a text, None of an empty one.

    Raises:
        ParameterError: it is no four whole numbers, or encloses nothing (`region`).
    """
    if not text:
        return None
    match = _RECTANGLE.fullmatch(text)
    x, y, width, height = (int(number) for number in match.groups()) if match else (0, 0, 0, 0)
    if not (width and height):
        words = f"region: read '{one_line(text)}'; expected X,Y,W,H in whole pixels"
        raise ParameterError(words, "region")
    return x, y, width, height


def read_tracks(
    sources: Sequence[TableSource],
    scene: Scene,
    columns: Mapping[str, str],
    ball: str = "",
) -> tuple[list[Track], list[Note]]:
    """The tracks of files of positions, or of data frames with the same columns, and notes on what
    was assumed or left out. `columns` are the user's header cells by our names; `ball` names the
    balls among several objects, parts or animals of a file.

    Raises:
        InputError: all faults of a file by row and column (`no-positions`, `no-column`, `no-rate`,
            `no-scale`, `three-coordinates`, `two-positions`, `same-table-twice`, `fold`, `film`,
            `several-objects`, `no-object`, `unread-clock`, `clocks-differ`, `low-confidence`, and
            those of cells).
        FolderError: no such file (`not-found`).
        ParameterError: no film is passed (`no-data`), or a name is no column of positions
            (`columns`).
    """
    if not sources:
        raise ParameterError("no film was given; expected tables of positions", "no-data")
    naming = FilmNaming({**scene.columns, **columns})
    tracks = list[Track]()
    notes = dict[Note, None]()
    digests = set[tuple[str, str]]()
    for source in sources:
        file_or_table, sheet, name = _file_sheet_and_name(source)
        cells = with_one_header(_cells(file_or_table, naming, name))
        tracks += Reader(cells, name, naming, scene, ball).tracks()
        cells.refuse()
        # Sheets of one workbook are different films.
        if (cells.sha256, sheet) in digests:
            fault = Fault("same-table-twice", "read a second time; give each film once")
            raise InputError(cells.source, [fault])
        digests.add((cells.sha256, sheet))
        notes |= dict.fromkeys(cells.notes)
    return [*_with_unique_ids(tracks)], [*notes]


def _cells(source: TableSource, naming: FilmNaming, name: str) -> TableCells:
    """The cells of a source. Raises InputError (codes of `read_cells`)."""
    cells = None
    ending = source.suffix.lower() if isinstance(source, Path) else ""
    if ending in (*_BINARY, *_TEXTS):
        data = bytes_of(str(source), str(source))
        if ending in _TEXTS:
            cells = cells_of_plain_text(str(source), data)
        elif ending == _C3D and is_c3d(data):
            cells = cells_of_c3d(str(source), data)
        elif data.startswith(HDF5):
            cells = cells_of_hdf5(str(source), data)
    return cells or read_cells(source, naming.worth, name, INDEX)


def _file_sheet_and_name(source: TableSource) -> tuple[TableSource, str, str]:
    """The path of a film with its sheet, or a table in memory; the sheet alone, "" without; the
    film's name. Raises FolderError (`not-found`).
    """
    if not isinstance(source, str | Path):
        return source, "", str(getattr(source, "attrs", {}).get("name", "positions"))
    file, sheet = file_and_sheet(str(source))
    path = path_of_source(file, "tracks")
    return (f"{path}#{sheet}" if sheet else path), sheet, path.stem


def _with_unique_ids(tracks: Sequence[Track]) -> Iterator[Track]:
    """The same tracks, with numbers behind ids that repeat."""
    count = Counter(track.id for track in tracks)
    number = Counter[str]()
    for track in tracks:
        number[track.id] += 1
        if count[track.id] == 1:
            yield track
        else:
            yield replace(track, id=f"{track.id} ({number[track.id]})")
