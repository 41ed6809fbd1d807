"""The table of columns: the properties of each column of a table of impacts.

Properties of a rebound column in a fit (its noise, its title, whether it has a sign) are in `observables`; those for
reading are here: the end of the bounce, the quantity, its limits, its opposite convention.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, pi

from fitball.data.units import UNITS, Dimension
from fitball.observables import OBSERVABLES

LABELS = ("id", "surface", "ball", "group", "location", "session")
# Printed in certificates, in no fit.
BALL_TEMPERATURE = "ball_temperature"
SD_SUFFIX = "_sd"
NEGATED, FROM_NORMAL = "with the other sign", "from the normal"


@dataclass(frozen=True)
class Limit:
    """A quantity is `least` to `most` [SI] in size; `words` say so in units that people use."""

    least: float
    most: float
    words: str


# Ten times the fastest serve and the fastest spins of any ball game, and more; contacts last from a fifth of a
# millisecond (hard spheres of some centimetres) to some tens (soft balls); higher up a ball falls at its terminal
# speed; too large an angle is no matter of units alone, and the check of ranges tells.
_LIMITS: Mapping[Dimension, Limit] = {
    Dimension.SPEED: Limit(0.0, 1000.0, "at most 1000 m/s"),
    Dimension.SPIN: Limit(0.0, 1.0e5, "at most 1e5 rad/s"),
    Dimension.ANGLE: Limit(0.0, inf, ""),
    Dimension.TIME: Limit(1.0e-4, 0.1, "0.1 to 100 ms"),
    Dimension.LENGTH: Limit(1.0e-3, 50.0, "1 mm to 50 m"),
}
# Of standard deviations: no instrument is as good as the least.
_SD_LIMITS: Mapping[Dimension, Limit] = {
    Dimension.SPEED: Limit(1.0e-9, 1000.0, "1e-9 to 1000 m/s"),
    Dimension.SPIN: Limit(1.0e-9, 1.0e5, "1e-9 to 1e5 rad/s"),
    Dimension.ANGLE: Limit(1.0e-9, pi, "1e-9 rad to 180 deg"),
    Dimension.TIME: Limit(1.0e-12, 0.1, "1e-12 s to 100 ms"),
    Dimension.LENGTH: Limit(1.0e-9, 50.0, "1e-9 to 50 m"),
}
# Between its flights a ball goes and turns less than in a tenth of a second at the largest speeds.
_BETWEEN = {"gap_path": Limit(0.0, 10.0, "at most 10 m"), "gap_turn": Limit(0.0, 1.0e3, "at most 1000 rad")}
# A ball that does not come says nothing of a bounce.
_COMING, _RISING = Limit(1.0e-3, 1000.0, "0.001 to 1000 m/s"), Limit(1.0e-4, inf, "at least 0.006 deg")


@dataclass(frozen=True)
class TableColumn:
    """One column: its `end` of the bounce ("1" incident, "2" rebound) and its `dimension`. `positive` is its meaning
    where it has no sign, `flip` its opposite convention, "" if there is none. Tables that count along one fixed axis
    print a `turned` one negative throughout. `said` is what it is called in a line, besides its name; `own_limit`
    goes before that of its dimension.
    """

    name: str
    end: str
    dimension: Dimension
    positive: str = ""
    flip: str = ""
    turned: bool = False
    short: tuple[str, ...] = ()
    own_limit: Limit | None = None


def _rebound() -> tuple[TableColumn, ...]:
    """A component or a spin has another sign, an angle another zero; a speed and a time have neither."""
    return tuple(
        TableColumn(
            name, "2", UNITS[item.unit].dimension, item.positive,
            flip=FROM_NORMAL if item.angle else NEGATED if name == "v_y2" or not item.positive else "",
            turned=item.angle or name == "v_y2", own_limit=_BETWEEN.get(name),
        )
        for name, item in OBSERVABLES.items()
    )  # fmt: skip


_ALL = (
    TableColumn("v_x1", "1", Dimension.SPEED, flip=NEGATED, short=("v_x",)),
    TableColumn(
        "v_y1", "1", Dimension.SPEED, "a positive speed towards the court", NEGATED, short=("v_y",), own_limit=_COMING
    ),
    TableColumn("v_1", "1", Dimension.SPEED, "a positive speed", short=("v",), own_limit=_COMING),
    TableColumn("theta_1", "1", Dimension.ANGLE, flip=FROM_NORMAL, turned=True, short=("theta",), own_limit=_RISING),
    TableColumn("omega_1", "1", Dimension.SPIN, flip=NEGATED, short=("omega", "spin")),
    *_rebound(),
    # What labs write instead of v_y1 and v_y2 of a drop test (`data.heights`).
    TableColumn("drop_height", "1", Dimension.LENGTH),
    TableColumn("rebound_height", "2", Dimension.LENGTH),
)
COLUMNS: Mapping[str, TableColumn] = {item.name: item for item in _ALL}
HEIGHTS = ("drop_height", "rebound_height")
MEASURED = tuple(name for name in COLUMNS if name not in HEIGHTS)
INCIDENT = tuple(name for name in MEASURED if COLUMNS[name].end == "1")
REBOUND = tuple(name for name in MEASURED if COLUMNS[name].end == "2")
# Every column of numbers, those of standard deviations among them.
NUMBERS: Mapping[str, Dimension] = {
    name + suffix: item.dimension for suffix in ("", SD_SUFFIX) for name, item in COLUMNS.items()
}
ANGLES = tuple(name for name in MEASURED if COLUMNS[name].turned and COLUMNS[name].dimension is Dimension.ANGLE)
# Angles last.
FLIPPABLE = tuple(sorted((name for name in MEASURED if COLUMNS[name].flip), key=lambda name: name in ANGLES))


def limit_of(name: str) -> Limit:
    """Between what numbers a column of `NUMBERS` is."""
    if name.endswith(SD_SUFFIX):
        return _SD_LIMITS[NUMBERS[name]]
    return COLUMNS[name].own_limit or _LIMITS[NUMBERS[name]]
