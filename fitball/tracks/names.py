"""What header cells of positions mean: names of the long table, and dialects of programs."""

from __future__ import annotations

import re
from collections.abc import Mapping

from fitball.base.errors import ParameterError, suggestion
from fitball.base.text import one_line
from fitball.base.units import symbol_of
from fitball.data.header import Naming
from fitball.data.lexicon import bare_name, without_data_set

# Columns of the long table with their SI units (`text` of labels), and other names that people and
# programs give them.
POSITION_COLUMNS: Mapping[str, tuple[str, str]] = {
    "id": ("text", "track trackid object objectid shot trial impact particle clip name"),
    "session": ("text", "camera cam"),
    "t": ("s", "time times timestamp timestamps seconds zeit temps xvalue"),
    "frame": ("", "frames frameno framenumber frameindex image bild"),
    "x": ("m", "posx xpos positionx cx xc centerx centrex ballx"),
    "y": ("m", "posy ypos positiony cy yc centery centrey bally"),
    "z": ("m", "posz zpos positionz"),
    "angle": ("rad", "phi theta orientation winkel markangle"),
    "angle_fold": ("", "fold anglefold"),
    "radius": ("m", "r ballradius"),
    "diameter": ("m", "d diam balldiameter"),
    "quality": ("", "likelihood confidence conf score"),
}
# Our name of each of these words.
_OUR_NAMES = {
    word: ours
    for ours, (_, words) in POSITION_COLUMNS.items()
    for word in (bare_name(ours), *words.split())
}
# A name with pixels as its unit: `x (px)`, `x_pixels`.
_PIXELS = re.compile(
    r"(?P<name>.*?\w)[\s_/,]*[\[(]?\s*(?<![a-z])(?:px|pixels?)\s*[\])]?",
    re.IGNORECASE,
)
# A coordinate of a point of DLTdv: `pt1_cam1_X`.
_DLTDV = re.compile(r"(?P<name>pt\d+(?:_cam\d+)?)_(?P<axis>[xyz])", re.IGNORECASE)
# A coordinate of an object of Kinovea: `NAME/0/X`.
_KINOVEA = re.compile(r"(?P<name>.+?)(?:/0)?/(?P<axis>[xy])", re.IGNORECASE)
# Patterns of programs whose heads name point and coordinate, tried in this order.
DIALECTS = (_DLTDV, _KINOVEA)
# Letters of a cell that are read: longer ones are no name of ours, and patterns take time with the
# square of the length.
_MOST_LETTERS = 100


class FilmNaming:
    """The meaning of header cells of positions, with the user's names for columns."""

    def __init__(self, columns: Mapping[str, str]) -> None:
        """Take the user's cells by our names.

        Raises:
            ParameterError: a key is no column of positions (`columns`).
        """
        for name in columns.keys() - POSITION_COLUMNS.keys():
            read = f"columns: '{one_line(name)}' is no column of positions"
            raise ParameterError(f"{read}; {suggestion(name, POSITION_COLUMNS)}", "columns")
        self.plain = Naming({})
        cells = {ours: self.split(their) for ours, their in columns.items()}
        self.theirs = {name.casefold(): (ours, unit) for ours, (name, unit) in cells.items()}

    def split(self, cell: str) -> tuple[str, str | None]:
        """Name and unit of a header cell as written, `px` for pixels, None without a unit."""
        pixels = _PIXELS.fullmatch(cell.strip())
        if pixels:
            return pixels["name"], "px"
        name, unit = self.plain.split(cell)
        front, _, last = cell.strip().replace(" ", "_").rpartition("_")
        if unit is None and bare_name(front) in _OUR_NAMES and symbol_of(last):
            return front, last
        return name, unit

    def read(self, cell: str) -> tuple[str | None, str | None]:
        """Our name of a cell (None: not used), and its unit as written."""
        name, unit = self.split(cell[:_MOST_LETTERS])
        by_cell = self.theirs.get(cell.strip().casefold())
        by_user = by_cell or self.theirs.get(name.casefold())
        if by_user is None:
            ours = _OUR_NAMES.get(bare_name(name))
            inner = without_data_set(cell)
            return (ours, unit) if ours or inner == cell else self.read(inner)
        ours, stated = by_user
        return ours, unit or stated

    def worth(self, cell: str) -> float:
        """How much a cell speaks for its row being the header: 1 for a name that is read, else
        0.
        """
        point = any(dialect.fullmatch(cell) for dialect in DIALECTS)
        return float(point or self.read(cell)[0] is not None)
