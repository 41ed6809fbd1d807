"""Does a table hold positions over time, which `fitball track` reads, in place of impacts?"""

from __future__ import annotations

import re

from fitball.data.cells import TableCells
from fitball.data.lexicon import without_data_set, without_unit

# Words of a name, without its digits: `frame` of `frame_idx`.
_WORDS = re.compile(r"[^\W_]+")
# A word that is a coordinate: `x`, `Xpos`, `bally`.
_AXIS = re.compile(
    r"(?:pos|position|coord|coordinate|loc|location|center|centre|c|ball)?(?P<axis>[xyz])"
    r"(?:pos|position|coord|coordinate|center|centre)?"
)
# Words of clocks beside a height alone.
_CLOCKS = frozenset(["t", "time", "times", "timestamp", "elapsed", "frame", "frames"])
# What motion sensors call a height.
_SENSOR_HEIGHTS = frozenset(["position", "distance", "altitude"])
# Words of components of something else than a position: `v.x`, `sd_y`.
_NO_POSITIONS = frozenset(
    [
        *"vaf",
        "vel",
        "velocity",
        "speed",
        "acc",
        "force",
        "omega",
        "spin",
        "err",
        "error",
        "sd",
        "corr",
    ]
)


def are_positions(cells: TableCells) -> bool:
    """Whether names of columns, those above the header, or those that stand in the first row of
    data as trackers write them, are coordinates in a plane, or a height over time.
    """
    first = []
    if cells.rows.size:
        first = [cells.text(k)[0] for k in range(len(cells.names))]
    axes = set[str]()
    has_clock = False
    for name in (*cells.names, *(cell for row in (*cells.above, first) for cell in row)):
        bare, unit = without_unit(without_data_set(name))
        words = _WORDS.findall(bare.casefold())
        if "/" in unit or not _NO_POSITIONS.isdisjoint(words):
            continue
        has_clock |= not _CLOCKS.isdisjoint(words)
        if not _SENSOR_HEIGHTS.isdisjoint(words[-1:]):
            axes.add("y")
        axes |= {match["axis"] for word in words if (match := _AXIS.fullmatch(word))}
    return {"x", "y"} <= axes or (has_clock and not axes.isdisjoint("yz"))
