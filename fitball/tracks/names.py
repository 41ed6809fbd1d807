"""What header cells of positions mean: names of the long table, and dialects of programs."""

from __future__ import annotations

import re
from collections.abc import Mapping

from fitball.base.errors import ParameterError, suggestion
from fitball.base.text import one_line
from fitball.base.units import symbol_of
from fitball.data.header import Naming, bare

# Columns of the long table with their units, and what else people and programs call them.
NAMES: Mapping[str, tuple[str, str]] = {
    "id": ("text", "track trackid object objectid shot trial impact particle clip name"),
    "session": ("text", "camera cam"),
    "t": ("s", "time times timestamp timestamps seconds zeit temps"),
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
_OURS = {word: ours for ours, (_, words) in NAMES.items() for word in (bare(ours), *words.split())}
# `x (px)`, `x_pixels`.
_PIXELS = re.compile(
    r"(?P<name>.*?\w)[\s_/,]*[\[(]?\s*(?<![a-z])(?:px|pixels?)\s*[\])]?",
    re.IGNORECASE,
)
# `pt1_cam1_X`.
_DLTDV = re.compile(r"(?P<name>pt\d+(?:_cam\d+)?)_(?P<axis>[xyz])", re.IGNORECASE)
# `NAME/0/X`.
_KINOVEA = re.compile(r"(?P<name>.+?)(?:/0)?/(?P<axis>[xy])", re.IGNORECASE)
# Of programs whose heads name point and coordinate, tried in this order.
DIALECTS = (_DLTDV, _KINOVEA)
# A longer cell is no name of ours, and patterns take time with the square of the length.
_LONGEST = 100


class FilmNaming:
    """What header cells of positions mean, with the user's names. Raises ParameterError
    (`columns`).
    """

    def __init__(self, columns: Mapping[str, str]) -> None:
        for name in columns.keys() - NAMES.keys():
            words = (
                f"columns: '{one_line(name)}' is no column of positions; {suggestion(name, NAMES)}"
            )
            raise ParameterError(words, "columns")
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
        if unit is None and bare(front) in _OURS and symbol_of(last):
            return front, last
        return name, unit

    def read(self, cell: str) -> tuple[str | None, str | None]:
        """Our name of a cell (None: not used), and its unit as written."""
        name, unit = self.split(cell[:_LONGEST])
        whole_cell = self.theirs.get(cell.strip().casefold())
        by_user = whole_cell or self.theirs.get(name.casefold())
        if by_user is None:
            return _OURS.get(bare(name)), unit
        ours, stated = by_user
        return ours, unit or stated

    def worth(self, cell: str) -> float:
        """What a cell is worth as one of a header: 1 for a name that is known, else 0."""
        point = any(dialect.fullmatch(cell) for dialect in DIALECTS)
        return float(point or self.read(cell)[0] is not None)
