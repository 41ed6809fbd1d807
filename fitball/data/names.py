"""What a header cell says: name and unit, in the ways in which people write both into one, and what a name that is
not ours probably means: which quantity, and before or after the bounce.

A guess is offered, never taken. It says which end of the bounce it means only where the name does, so that incidence
is never offered for rebound.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from fitball.data.columns import COLUMNS, HEIGHTS

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


def cell_parts(cell: str, known: Known, is_unit: Known) -> tuple[str, str | None, str]:
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


_GREEK = {"θ": "theta", "ω": "omega", "ϑ": "theta", "σ": "sd"}
# Words of names, by what they tell: the quantity, its direction, the end of the bounce, a deviation, nothing.
_LEXICON: Mapping[tuple[str, str], str] = {
    ("quantity", "v"): "v vel velo velocity velocities speed speeds geschwindigkeit tempo",
    ("quantity", "theta"): "theta angle angles ang alpha winkel",
    ("quantity", "omega"): "omega spin spins w rot rotation drall",
    ("quantity", "contact_time"): "contacttime tcontact contactduration kontaktzeit tc",
    ("quantity", "height"): "h height heights hoehe höhe",
    ("direction", "x"): "x horizontal hor horiz tangential tan parallel",
    ("direction", "y"): "y z vertical vert normal perpendicular perp",
    ("end", "1"): (
        "1 in inc incident incoming incidence inbound impact before pre prior initial init start approach i vor "
        "drop dropped fall ein"
    ),
    (
        "end",
        "2",
    ): "2 out outgoing outbound reb rebound rebounding exit after post final end f r bounce bounced nach aus",
    ("sd", "sd"): "sd std stdev sigma",
    ("filler", ""): "ball of the mean avg average measured launch",
}
_WORDS = {word: told for told, words in _LEXICON.items() for word in words.split()}
_LONGEST_WORD = max(map(len, _WORDS))
_HEIGHTS = {COLUMNS[name].end: name for name in HEIGHTS}


@dataclass(frozen=True)
class Guess:
    """`names` of ours that a name may mean: one where it says which, both ends where it says the quantity only."""

    names: tuple[str, ...]

    @property
    def sure(self) -> str | None:
        """The one name, or None."""
        return self.names[0] if len(self.names) == 1 else None


def bare(name: str) -> str:
    """A name without case, blanks, underscores and the like; Greek letters spelled out."""
    text = name.casefold()
    for letter, word in _GREEK.items():
        text = text.replace(letter, word)
    return re.sub(r"[\s_.\-]+", "", text.translate(str.maketrans("₁₂ₓ", "12x")).replace("ᵧ", "y"))


def end_of(name: str) -> str | None:
    """The end of the bounce that a name speaks of: "1" incident, "2" rebound; None where it says neither, or both."""
    ends = {value for kind, value in _told(name) if kind == "end"}
    if not ends:
        ends = set(re.findall(r"(?<![0-9])[12](?![0-9])", name))
    return ends.pop() if len(ends) == 1 else None


def guess_of(name: str) -> Guess | None:
    """What `name` may mean, None where it is no name of an impact's quantity."""
    told = _told(name)
    if any(told.count(word) > 1 for word in told if word != ("filler", "")):
        return None
    by_kind: dict[str, set[str]] = {}
    for kind, value in told:
        by_kind.setdefault(kind, set()).add(value)
    quantities, directions = by_kind.get("quantity", set()), by_kind.get("direction", set())
    ends = by_kind.get("end", set())
    if len(quantities) != 1 or len(directions) > 1 or len(ends) > 1:
        return None
    (quantity,) = quantities
    suffix = "_sd" if "sd" in by_kind else ""
    if quantity == "contact_time":
        return Guess((f"contact_time{suffix}",))
    if directions and quantity != "v":
        return None
    names = tuple(
        (_HEIGHTS[end] if quantity == "height" else f"{quantity}_{''.join(directions)}{end}") + suffix
        for end in sorted(ends or {"1", "2"})
    )
    return Guess(names)


def _told(name: str) -> list[tuple[str, str]]:
    """What the words of a name tell, none where it has others."""
    if len(name) > LONGEST:
        return []
    # Each part by itself first, so that "v_in" is not "vi" and "n".
    parts = [part for part in re.split(r"[\s_.\-]+|(?<=[a-z])(?=[A-Z0-9])", name) if part]
    whole = [bare(part) for part in parts]
    if whole and all(part in _WORDS for part in whole):
        return [_WORDS[part] for part in whole]
    return [_WORDS[word] for word in _cut(bare(name))]


def _cut(text: str) -> list[str]:
    """The text as words, the longest first; [] where no way of cutting it leaves nothing over.

    From the end on, so that what follows each place is known: a step for each place and length of a word, where
    trying one way after the other takes exponentially many (`"horiz" * 26 + "!"`).
    """
    end = len(text)
    sizes = [0] * end + [1]
    for place in reversed(range(end)):
        for size in range(min(_LONGEST_WORD, end - place), 0, -1):
            if sizes[place + size] and text[place : place + size] in _WORDS:
                sizes[place] = size
                break
    found, place = list[str](), 0
    while place < end and sizes[0]:
        found.append(text[place : place + sizes[place]])
        place += sizes[place]
    return found
