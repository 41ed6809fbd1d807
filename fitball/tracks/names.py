"""What header cells of positions mean: names of the long table, and dialects of programs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

from fitball.base.errors import ParameterError, suggestion
from fitball.base.text import one_line
from fitball.base.units import symbol_of
from fitball.data.header import Naming
from fitball.data.lexicon import bare_name, without_data_set

# What an index, or a first column, without a name is called.
INDEX = "(index)"
# Columns of the long table with their SI units (`text` of labels), and other names that people and
# programs give them, the likeliest first: where several are there, it is read.
POSITION_COLUMNS: Mapping[str, tuple[str, str]] = {
    "id": (
        "text",
        "trackid track trackerid tracknumber trackno tracknr tracknum track# trackidx trackn° tid "
        "objectid object objid particle particleid ballid trajectory trajectoryid instanceid id "
        "clip clipid shot trial impact name video videopath videoname",
    ),
    "session": ("text", "camera cam"),
    "part": (
        "text",
        "nodename node bodypart bodyparts keypoint keypointname landmark classname class cls "
        "categoryname category objectclass label classid categoryid",
    ),
    "t": (
        "s",
        "time times timestamp timestamps ts seconds secs sec zeit zeitstempel temps horodatage "
        "tiempo tempo tijd elapsed elapsedtime relativetime videotime positiont xvalue ptstime "
        "pktptstime pktdtstime besteffortptstime besteffortdtstime bestefforttimestamptime",
    ),
    "frame": ("", ""),
    "x": (
        "m",
        "posx xpos positionx xposition cx xc centerx centrex xcenter xcentre ballx xball "
        "xcoordinate xcoord coordx coordinatex locationx locx column col centroidx xcentroid "
        "centroid1 xm",
    ),
    "y": (
        "m",
        "posy ypos positiony yposition cy yc centery centrey ycenter ycentre bally yball "
        "ycoordinate ycoord coordy coordinatey locationy locy row centroidy ycentroid "
        "centroid0 ym",
    ),
    "z": ("m", "posz zpos positionz zposition zcoordinate zcoord coordz ballz zball"),
    "left": ("m", "xmin minx bbleft bboxleft bbxmin bboxxmin bboxx1 boxx1 bbx1 x1"),
    "top": ("m", "ymin miny bbtop bboxtop bbymin bboxymin bboxy1 boxy1 bby1 y1"),
    "right": ("m", "xmax maxx bbright bboxright bbxmax bboxxmax bboxx2 boxx2 bbx2 x2"),
    "bottom": ("m", "ymax maxy bbbottom bboxbottom bbymax bboxymax bboxy2 boxy2 bby2 y2"),
    "width": ("m", "bbwidth bboxwidth boxwidth bbw bboxw w"),
    "height": ("m", "bbheight bboxheight boxheight bbh bboxh h"),
    "angle": ("rad", "phi theta orientation winkel markangle"),
    "angle_fold": ("", "fold anglefold"),
    "radius": ("m", "r ballradius"),
    "radius_sd": ("m", "radiussd"),
    "diameter": ("m", "d diam balldiameter"),
    "quality": (
        "",
        "likelihood confidence conf score certainty probability prob pointscore detectionscore",
    ),
    "visibility": (
        "text",
        "visible vis isvisible visibilityclass detected isdetected found isfound valid isvalid "
        "inframe ballvisible balldetected seen",
    ),
}
# Columns of the corners and sizes of boxes around a ball.
BOX_COLUMNS = ("left", "top", "right", "bottom", "width", "height")


class _Meaning(NamedTuple):
    """What a name means: our name, and the place among names of that meaning, the likeliest at
    0.
    """

    ours: str
    rank: int


# The meaning of each of these words.
_MEANINGS = {
    word: _Meaning(ours, rank)
    for ours, (_, words) in POSITION_COLUMNS.items()
    for rank, word in enumerate((bare_name(ours), *words.split()))
}
# The number of the spot, of which each has its own, goes behind that of the track.
_MEANINGS["id"] = _Meaning("id", POSITION_COLUMNS["id"][1].split().index("id"))
# Numbers of frames, as people and programs call them: `frame_idx`, `Frame #`, `Slice n°`.
_FRAME = re.compile(
    r"(?:n°|nº|no|nr|num|number|#)?(?:of)?(?:the)?"
    r"(?:video|movie|film|camera|cam|current|cur|source|src|original|orig|absolute|abs)?"
    r"(?:frames?|images?|imgs?|bild|slices?|pictures?|pics?|photo|frm|fotogramma|fotograma|cuadro|"
    r"quadro|trame|kader)"
    r"(?:#|n°|nº|no|nr|num|numbers?|nummer|numero|número|indices|index|idx|ids?|counter|count|i|n)?"
)
# Names of the files of frames, in which their numbers stand.
_FILE = re.compile(r"(?:video)?(?:frame|image|img|bild|picture|pic)?(?:file)?(?:name|path|file)")
# Times in a unit that is part of the name: `time_ns`, `elapsedMs`, `msec`, `POS_MSEC`.
_TIME = re.compile(
    r"(?:t|ts|times?|timestamps?|elapsed|elapsedtime|clock|epoch|unixtime|unix|pos|capproppos|zeit|"
    r"temps|tiempo|tempo|tijd)?(?:in)?(?P<unit>ns|nsecs?|nanos|nanoseconds?|us|µs|usecs?|micros|"
    r"microseconds?|ms|msecs?|millis|milliseconds?|s|secs?|seconds?)"
)
# Stamps of a film in ticks, whose length the film has.
_TICKS = frozenset(["pts", "dts", "pktpts", "pktdts", "besteffortts", "ticks", "tick"])
# The unit of those.
TICK = "tick"
# Units of time that a name ends with, by their beginnings.
_UNIT_OF_WORD = {"n": "ns", "u": "us", "µ": "us", "mic": "us", "m": "ms", "s": "s"}
# Ranks of names behind all those that are listed.
LISTED = 100
# A name with pixels as its unit: `x (px)`, `x_pixels`.
_PIXELS = re.compile(
    r"(?P<name>.*?\w)[\s_/,]*[\[(]?\s*(?<![a-z])(?:px|pixels?)\s*[\])]?",
    re.IGNORECASE,
)
# A name with percent as its unit: `conf (%)`, `confidence %`.
_PERCENT = re.compile(r"(?P<name>.*?\w)\s*[\[(]?\s*%\s*[\])]?")
# A coordinate of a point of DLTdv: `pt1_cam1_X`.
_DLTDV = re.compile(r"(?P<name>pt\d+(?:_cam\d+)?)_(?P<axis>[xyz])", re.IGNORECASE)
# A coordinate of an object of Kinovea: `NAME/0/X`.
_KINOVEA = re.compile(r"(?P<name>.+?)(?:/0)?/(?P<axis>[xy])", re.IGNORECASE)
# A coordinate, or the score, of a part or object: `ball.x` (SLEAP), `ball X` (Qualisys), `x_ball`.
_PART = re.compile(
    r"(?P<name>.*[^\s._:|-])[\s._:|-]+(?P<axis>x|y|z|score|likelihood|confidence|conf)",
    re.IGNORECASE,
)
_PART_BEHIND = re.compile(r"(?P<axis>x|y|z)[\s._:|-]+(?P<name>[^\W\d].*)", re.IGNORECASE)
# Patterns of programs whose heads name point and coordinate, tried in this order.
DIALECTS = (_DLTDV, _KINOVEA, _PART, _PART_BEHIND)
# Of these, patterns whose names say what a point is; those of others are numbers and the like.
NAMED_DIALECTS = (_PART, _PART_BEHIND)
# Names with coordinates that are no position: `v.x`, `sd_y`.
_NO_PARTS = re.compile(
    r"(?:.*[^a-z])?(?:v|vel|velo|velocity|velocities|speed|acc|accel|acceleration|force|delta|diff|"
    r"err|error|sd|std|sigma|omega|spin|instance|norm|normali[sz]ed)(?:\d*)",
    re.IGNORECASE,
)
# A point whose head is only like one of a program counts less than a name for a header.
_WORTH_OF_PART = 0.9
# Letters of a cell that are read: longer ones are no name of ours, and patterns take time with the
# square of the length.
_MOST_LETTERS = 100


class Column(NamedTuple):
    """What a header cell means: our name (None: not used), the unit as written, and the place among
    names of that meaning, the likeliest at 0.
    """

    ours: str | None
    unit: str | None
    rank: int


class PointCell(NamedTuple):
    """A header cell of a point: its name, and which of x, y, z or quality it is."""

    name: str
    ours: str


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
        percent = _PERCENT.fullmatch(cell.strip())
        if percent:
            return percent["name"], "%"
        name, unit = self.plain.split(cell)
        front, _, last = cell.strip().replace(" ", "_").rpartition("_")
        if unit is None and _meaning(bare_name(front)) and symbol_of(last):
            return front, last
        return name, unit

    def read(self, cell: str) -> Column:
        """What a cell means."""
        name, unit = self.split(cell[:_MOST_LETTERS])
        by_cell = self.theirs.get(cell.strip().casefold())
        by_user = by_cell or self.theirs.get(name.casefold())
        if by_user is not None:
            ours, stated = by_user
            return Column(ours, unit or stated, -1)
        bare = bare_name(name)
        meaning = _meaning(bare)
        if meaning is None:
            inner = without_data_set(cell)
            return Column(None, unit, 0) if inner == cell else self.read(inner)
        if meaning.ours == "t" and unit is None:
            unit = _unit_of_time(bare)
        return Column(meaning.ours, unit, meaning.rank)

    def point(self, cell: str, dialect: re.Pattern[str]) -> PointCell | None:
        """The point that a cell of a dialect names, None of another cell."""
        cell = without_data_set(cell[:_MOST_LETTERS]).strip()
        if dialect in NAMED_DIALECTS:
            cell, _ = self.split(cell)
        match = dialect.fullmatch(cell)
        if match is None or (dialect in NAMED_DIALECTS and _NO_PARTS.fullmatch(match["name"])):
            return None
        axis = match["axis"].casefold()
        return PointCell(match["name"], axis if axis in ("x", "y", "z") else "quality")

    def worth(self, cell: str) -> float:
        """How much a cell speaks for its row being the header: 1 for a name that is read, less for
        one that names a point, else 0.
        """
        # DeepLabCut calls so what stands before its last row of names.
        if self.read(cell).ours is not None or cell == "coords":
            return 1.0
        points = [dialect for dialect in DIALECTS if self.point(cell, dialect)]
        if not points:
            return 0.0
        return _WORTH_OF_PART if points[0] in NAMED_DIALECTS else 1.0


def _meaning(bare: str) -> _Meaning | None:
    """The meaning of a bare name, None where it is none of ours."""
    if bare in _MEANINGS:
        return _MEANINGS[bare]
    if bare and _FRAME.fullmatch(bare):
        return _Meaning("frame", 1)
    if bare and _FILE.fullmatch(bare):
        return _Meaning("frame", LISTED)
    if bare in _TICKS or _TIME.fullmatch(bare):
        # A single letter may be the length of a path.
        return None if bare == "s" else _Meaning("t", LISTED + (bare in _TICKS))
    return None


def _unit_of_time(bare: str) -> str | None:
    """The unit that the name of a time has in itself, None where it has none."""
    if bare in _TICKS:
        return TICK
    match = None if bare in _MEANINGS else _TIME.fullmatch(bare)
    if match is None:
        return None
    beginnings = sorted(_UNIT_OF_WORD, key=len, reverse=True)
    return _UNIT_OF_WORD[next(word for word in beginnings if match["unit"].startswith(word))]
