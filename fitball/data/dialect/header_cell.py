"""Name and unit of a header cell, in the ways in which people write both into one."""

from __future__ import annotations

import re
from collections.abc import Callable

_SQUARE = re.compile(r"^(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?$")
_ROUND = re.compile(r"^(?P<name>.*?)\s*[({](?P<unit>[^(){}]*)[)}]$")
# Behind the name: "v_1 / m/s" (ISO 80000), "v_1 in m/s", "v_1, m/s", "v_1: m/s", "v_1_mph", "v_1 mph".
_BEHIND = (
    re.compile(r"^(?P<name>.+?)\s*/\s*[({\[]?(?P<unit>.+?)[)}\]]?$"),
    re.compile(r"^(?P<name>.+?)\s+in\s+(?P<unit>.+)$"),
    re.compile(r"^(?P<name>.+?)\s*[,:;]\s*(?P<unit>.+)$"),
)
_JOINED = re.compile(r"(?<=[0-9A-Za-z])[_ ](?=[A-Za-z°])")

# Characters of a cell that may hold name and unit; a longer one is all name. No name of ours and no unit is near it,
# and the patterns above take time with the square of the length.
LONGEST = 100

Known = Callable[[str], bool]
UNMATCHED = "the brackets do not match; expected a name and a unit, such as 'v_x1 [m/s]'"


def split_cell(cell: str, known: Known, is_unit: Known) -> tuple[str, str | None, str]:
    """Name and unit (None where there is none) of a header cell, and what is wrong with it.

    Square brackets always hold a unit; round ones do behind a name that is `known`, or when what is in them
    `is_unit`; without brackets a unit must be one.
    """
    text = cell.strip()
    if len(text) > LONGEST:
        return text, None, ""
    slash = re.fullmatch(r"(.+?)\s*/\s*\[([^\[\]]*)\]", text)
    match = _SQUARE.match(text if slash is None else f"{slash[1]} [{slash[2]}]")
    if match is None:
        return text.split("[")[0].strip(), None, UNMATCHED
    name = match["name"].strip()
    if match["unit"] is not None or known(name):
        return name, match["unit"], ""
    # Of a quotient in round brackets the slash belongs to neither.
    bracket = _ROUND.match(re.sub(r"\s*/\s*(?=[({][^(){}]*[)}]$)", " ", name))
    if bracket and (known(bracket["name"]) or is_unit(bracket["unit"])):
        return bracket["name"].strip(), bracket["unit"], ""
    for pattern in _BEHIND:
        behind = pattern.match(name)
        if behind and is_unit(behind["unit"]):
            return behind["name"].strip(), behind["unit"], ""
    for place in _JOINED.finditer(name):
        front, unit = name[: place.start()], name[place.end() :]
        for spelling in (unit, unit.replace("_", "/", 1)):
            if known(front) and is_unit(spelling):
                return front, spelling, ""
    return name, None, ""
