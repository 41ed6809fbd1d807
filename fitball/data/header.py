"""The columns of a file by our names. Reads header cells: name and unit in the ways in which people write them, and
the probable meaning of other names. Each column is known as it is spelled, by the user's names (`--columns v_1=Vin`),
or as a misspelling.

A guess is offered, never taken. It says which end of the bounce it means only where the name does, so that incidence
is never offered for rebound.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache

from fitball.data.cells import Findings, Vocabulary
from fitball.data.columns import BALL_TEMPERATURE, COLUMNS, HEIGHTS, LABELS, MEASURED, NUMBERS, SD_SUFFIX
from fitball.data.table import FrozenMapping
from fitball.data.units import Unit, parse_unit, unit_of
from fitball.errors import ParameterError, UnitError, suggestion
from fitball.visible import some, unguarded
from fitball.wording import spoken

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
UNMATCHED = "the brackets do not match; expected a name and a unit, such as 'v_x1 [m/s]'"

_GREEK = {"θ": "theta", "ω": "omega", "ϑ": "theta", "σ": "sd"}
# Words of names, by what they tell: the quantity, its direction, the end of the bounce, a deviation, nothing.
_LEXICON: Mapping[tuple[str, str], str] = {
    ("quantity", "v"): "v vel velo velocity velocities speed speeds geschwindigkeit tempo vitesse",
    ("quantity", "theta"): "theta angle angles ang alpha winkel",
    ("quantity", "omega"): "omega spin spins w rot rotation drall",
    ("quantity", "contact_time"): "contacttime tcontact contactduration kontaktzeit tc",
    ("quantity", "height"): "h height heights hoehe höhe",
    ("direction", "x"): "x horizontal hor horiz tangential tan parallel",
    ("direction", "y"): "y z vertical vert normal perpendicular perp",
    ("end", "1"): (
        "1 in inc incident incoming incidence inbound impact before pre prior initial init start approach i vor "
        "vorher avant drop dropped fall ein"
    ),
    ("end", "2"): (
        "2 out outgoing outbound reb rebound rebounding exit after post final end f r bounce bounced nach nachher "
        "aus après apres"
    ),
    ("sd", "sd"): "sd std stdev sigma",
    ("filler", ""): "ball of the mean avg average measured launch",
}
_WORDS = {word: told for told, words in _LEXICON.items() for word in words.split()}
_LONGEST_WORD = max(map(len, _WORDS))
# Words that alone, as the name of a column, mean a height.
_OF_A_DROP = ("drop", "fall", "rebound", "bounce")
_HEIGHTS = {COLUMNS[name].end: name for name in HEIGHTS}


def bare(name: str) -> str:
    """A name without case, blanks, underscores and the like; Greek letters spelled out."""
    text = name.casefold()
    for letter, word in _GREEK.items():
        text = text.replace(letter, word)
    return re.sub(r"[\s_.\-]+", "", text.translate(str.maketrans("₁₂ₓ", "12x")).replace("ᵧ", "y"))


def end_of(name: str) -> str | None:
    """The end of the bounce that a name speaks of: "1" incident, "2" rebound; None where it says neither, or both."""
    ends = {value for kind, value in _told(name) if kind == "end"}
    ends = ends or set(re.findall(r"(?<![0-9])[12](?![0-9])", name))
    return ends.pop() if len(ends) == 1 else None


def guess_of(name: str) -> tuple[str, ...]:
    """Names of ours that `name` may mean: one where it says which, both ends where it says the quantity only, none
    where it is no name of an impact's quantity.
    """
    told = _told(without_unit(name)[0])
    if any(told.count(word) > 1 for word in told if word != ("filler", "")):
        return ()
    kinds = ("quantity", "direction", "end", "sd")
    quantities, directions, ends, sds = ([value for of, value in told if of == kind] for kind in kinds)
    if not quantities and len(ends) == 1 and bare(name) in _OF_A_DROP:
        return (_HEIGHTS[ends[0]],)
    if len(quantities) != 1 or len(directions) > 1 or len(ends) > 1:
        return ()
    (quantity,), suffix = quantities, SD_SUFFIX if sds else ""
    if quantity == "contact_time":
        return (f"contact_time{suffix}",)
    if directions and quantity != "v":
        return ()
    return tuple(
        (_HEIGHTS[end] if quantity == "height" else f"{quantity}_{''.join(directions)}{end}") + suffix
        for end in ends or ("1", "2")
    )


def without_unit(name: str) -> tuple[str, str | None]:
    """A name without the first of its words that is a unit and nothing else, and that unit: `spin rpm before`."""
    words = name[:LONGEST].split()
    unit = next((word for word in words if len(word) > 1 and bare(word) not in _WORDS and is_unit(word)), None)
    return (name, None) if unit is None else (" ".join(word for word in words if word != unit), unit)


def _told(name: str) -> list[tuple[str, str]]:
    """The meanings of the words of a name, none if it has other words."""
    if len(name) > LONGEST:
        return []
    # Each part by itself first, so that "v_in" is not "vi" and "n".
    whole = [bare(part) for part in re.split(r"[\s_.\-]+|(?<=[a-z])(?=[A-Z0-9])", name) if part]
    if not whole or not all(part in _WORDS for part in whole):
        whole = _cut(bare(name))
    return [_WORDS[word] for word in whole]


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


@dataclass(frozen=True)
class Naming:
    """What each of our columns is called in a table (`theirs`, by our name), and in which unit, where that is said
    here (`units`, by our name). Of our columns, `optional` ones need not be there.
    """

    theirs: Mapping[str, str] = field(default_factory=FrozenMapping)
    units: Mapping[str, str] = field(default_factory=FrozenMapping)
    optional: tuple[str, ...] = ()

    def ours(self, *names: str) -> str | None:
        """Our name of a column that is called by one of `names`; None where nothing was said of it."""
        wanted = {name.strip().casefold() for name in names}
        return next((ours for ours, their in self.theirs.items() if their.casefold() in wanted), None)


_WITH_UNIT = re.compile(r"(?P<name>.*?\S)\s*\[(?P<unit>[^\[\]]*)\]")


def naming(columns: Mapping[str, str], known: Collection[str]) -> Naming:
    """The naming that texts such as `Vin` or `Vin [mph]`, by our name (one of `known`), state.

    Raises ParameterError for a name that is none of ours, and for one of theirs that is to be two of ours.
    """
    theirs, units = dict[str, str](), dict[str, str]()
    for ours, text in columns.items():
        if ours not in known:
            near = [name for name in guess_of(ours) if name in known]
            hint = f"did you mean {' or '.join(near)}?" if near else suggestion(ours, known)
            raise ParameterError(f"columns: '{ours}' is not a column of fitball ({ours}={text}): {hint}")
        matched = _WITH_UNIT.fullmatch(text.strip())
        their = matched["name"] if matched else text.strip()
        if not their:
            raise ParameterError(f"columns: {ours} has no name; expected {ours}=NAME or {ours}=NAME [UNIT]")
        if their.casefold() in {other.casefold() for other in theirs.values()}:
            raise ParameterError(f"columns: '{their}' is given for two columns; expected one name for each")
        theirs[ours] = their
        if matched:
            units[ours] = matched["unit"]
    return Naming(FrozenMapping(theirs), FrozenMapping(units))


def with_units(columns: Mapping[str, str], units: Mapping[str, str], known: Collection[str]) -> dict[str, str]:
    """`columns` with the `units` of columns by our name or by theirs. Raises ParameterError for another name."""
    said = naming(columns, known)
    texts = {
        ours: f"{their} [{said.units[ours]}]" if ours in said.units else their for ours, their in said.theirs.items()
    }
    for name, unit in units.items():
        ours = said.ours(name) or next((item for item in known if bare(item) == bare(name)), None)
        if ours is None:
            raise ParameterError(f"units: there is no column '{name}': {suggestion(name, known)}")
        if ours in said.units:
            raise ParameterError(f"units: the unit of {name} is given in columns too; give it once")
        texts[ours] = f"{said.theirs.get(ours, name)} [{unit}]"
    return texts


# High enough to pass over words that only share a few letters ("case", "temperature"), low enough
# to catch one wrong, missing or swapped character in names as short as "v_y1" (difflib ratio 0.75 and up).
_NEAR = 0.75
_BY_BARE = {bare(name): name for name in (*NUMBERS, *LABELS, BALL_TEMPERATURE)} | {"balltemp": BALL_TEMPERATURE}
# What people call the column that names the impacts.
_IDS = ("id", "no", "nr", "#", "number", "impactid", "impactno")
# How no name begins (an empty cell among them).
_NO_NAME = ("", *"0123456789+-.,\u2212")
# What a name that is probably meant counts for where a header is looked for.
_GUESSED = 0.5


@dataclass(frozen=True)
class Header:
    """The columns of a table: their `places` in the file by name, the `units` of those of numbers (None where one was
    not understood), and `extras`, which are neither numbers nor labels. `warmth` is the unit of ball temperatures as
    it is written, None without one.
    """

    places: Mapping[str, int]
    units: Mapping[str, Unit | None]
    extras: tuple[str, ...]
    warmth: str | None = None

    @property
    def texts(self) -> tuple[str, ...]:
        """Labels and extras."""
        return tuple(name for name in self.places if name not in self.units)


def vocabulary(naming: Naming) -> Vocabulary:
    """How a header of impacts is recognised, with the names of columns in `naming`."""

    @cache
    def worth(cell: str) -> float:
        # Most cells are numbers; no name begins as one, nor is any so long.
        if cell[:1] in _NO_NAME or len(cell) > LONGEST:
            return 0.0
        name, _ = split_cell(cell, naming)
        if naming.ours(cell, name) is not None or _same(name) is not None:
            return 1.0
        guess = guess_of(name)
        return _GUESSED if len(guess) == 1 and guess[0] in NUMBERS else 0.0

    return Vocabulary(worth, is_unit)


def is_unit(text: str) -> bool:
    """Whether a text spells a unit that is known."""
    return unit_of(text) is not None


def split_cell(cell: str, naming: Naming | None = None, found: Findings | None = None) -> tuple[str, str | None]:
    """Name and unit (None where there is none) of a header cell; a fault where its brackets do not match.

    Square brackets always hold a unit; round ones do behind a name that is known, or when what is in them is a unit;
    without brackets a unit must be one.
    """

    def known(name: str) -> bool:
        return _same(name) is not None or (naming is not None and naming.ours(name) is not None)

    text = cell.strip()
    if len(text) > LONGEST:
        return text, None
    slash = re.fullmatch(r"(.+?)\s*/\s*\[([^\[\]]*)\]", text)
    match = _SQUARE.match(text if slash is None else f"{slash[1]} [{slash[2]}]")
    if match is None:
        if found is not None:
            found.header_fault(UNMATCHED, cell)
        return text.split("[")[0].strip(), None
    name = match["name"].strip()
    if match["unit"] is not None or known(name):
        return name, match["unit"]
    # Of a quotient in round brackets the slash belongs to neither.
    bracket = _ROUND.match(re.sub(r"\s*/\s*(?=[({][^(){}]*[)}]$)", " ", name))
    if bracket and (known(bracket["name"]) or is_unit(bracket["unit"])):
        return bracket["name"].strip(), bracket["unit"]
    for pattern in _BEHIND:
        behind = pattern.match(name)
        if behind and is_unit(behind["unit"]):
            return behind["name"].strip(), behind["unit"]
    for place in _JOINED.finditer(name):
        front, unit = name[: place.start()], name[place.end() :]
        for spelling in (unit, unit.replace("_", "/", 1)):
            if known(front) and is_unit(spelling):
                return front, spelling
    return name, None


def _same(name: str) -> str | None:
    """Our name of which `name` differs in case, blanks and underscores only."""
    if name in NUMBERS or name in LABELS or name == BALL_TEMPERATURE:
        return name
    plain = bare(name)
    return "id" if plain in _IDS or name.strip() == "#" else _BY_BARE.get(plain)


def our_column(cell: str, naming: Naming) -> tuple[str | None, str, str | None]:
    """What a text that names a column of a table means: our name (None where it is none), its name, and the unit that
    it states.
    """
    name, unit = split_cell(cell, naming)
    ours = naming.ours(cell, name)
    return _same(name) if ours is None else ours, name, unit


def read_header(cells: tuple[str, ...], found: Findings, naming: Naming | None = None) -> Header:
    """Find out what each column is.

    A name that differs from ours in case or blanks only is read as ours, with a note. A misspelt column is a fault,
    and is read as the column it resembles, so that faults of its values are found in the same run. A name that
    probably means one of fitball's is an extra column unless `--columns` names it.
    """
    naming, cells = naming or Naming(), unguarded(cells)
    parsed = [split_cell(cell, naming, found) for cell in cells]
    asked = [naming.ours(cell, name) for cell, (name, _) in zip(cells, parsed, strict=True)]
    names = [name for name, _ in parsed]
    taken = {*filter(None, asked), *names}
    places, units = dict[str, int](), dict[str, Unit | None]()
    extras, spelled, warmth = list[str](), list[str](), None
    for index, ((name, unit), named) in enumerate(zip(parsed, asked, strict=True)):
        ours = named if named is not None else _same(name)
        if named is not None:
            unit = _stated_unit(naming, named, unit, found)
        elif ours == "id" != name and "id" in names:
            ours = None
        elif ours is None and name:
            ours = _misspelt(name, taken, found)
        elif ours is not None and ours != name:
            spelled.append(f"'{name}' as {ours}")
        meant = ours or name
        taken.add(meant)
        if not name:
            extras.append(f"(column {index + 1} has no name)")
        elif meant in places:
            message = f"'{cells[index]}' and another column are both '{meant}'; keep one of them"
            found.header_fault(message, meant)
        else:
            places[meant] = index
            if meant in NUMBERS:
                units[meant] = _unit(meant, unit, found)
            if meant == BALL_TEMPERATURE:
                warmth = unit
            extras += [name] if ours is None else []
    if spelled:
        found.notice(f"columns with other spellings: {some(spelled)}")
    here = {name.casefold() for name in names}
    for ours, their in naming.theirs.items():
        if their.casefold() in here or ours in places:
            continue
        if ours in naming.optional:
            found.notice(f"no column '{their}' to compare {ours} with")
        else:
            found.header_fault(f"there is no column '{their}' to read as {ours}; columns of the table: {some(names)}")
    return Header(places, units, tuple(extras), warmth)


def _stated_unit(naming: Naming, ours: str, written: str | None, found: Findings) -> str | None:
    """The unit of a column as text, where `written` is that of the header; a fault where the two differ."""
    stated = naming.units.get(ours)
    if stated is not None and written is not None and unit_of(stated) != unit_of(written):
        message = f"the unit is '[{written}]' in the header and '[{stated}]' in columns; expected one unit"
        found.header_fault(message, naming.theirs[ours])
    return written if stated is None else stated


def _unit(name: str, text: str | None, found: Findings) -> Unit | None:
    try:
        return parse_unit(text, NUMBERS[name])
    except UnitError as error:
        found.header_fault(str(error), name)
        return None


def _misspelt(name: str, taken: Iterable[str], found: Findings) -> str | None:
    """The known column that an unknown name misspells, with a fault; None for a column of the user's own."""
    if len(guess_of(name)) == 1:
        return None
    near = _nearest(name, taken)
    if near:
        hint = f"unknown column; did you mean {' or '.join(map(repr, near))}?"
        which = f"Rename it, or choose one with {spoken('--columns', 'columns=')}"
        own = "Rename it (or give your own column a less similar name)"
        found.header_fault(f"{hint} {which if len(near) > 1 else own}", name)
    elif name.endswith(SD_SUFFIX):
        base, known = name.removesuffix(SD_SUFFIX), ", ".join(MEASURED)
        found.header_fault(f"'{base}' cannot have a standard deviation; columns that can: {known}", name)
    return near[0] if len(near) == 1 else None


def _nearest(name: str, taken: Iterable[str]) -> list[str]:
    """The known name, not `taken` yet, that `name` misspells, or none. Where `name` does not say which end of the
    bounce it means, and both are free, both.

    A name that merely looks similar is one only while the name it resembles is absent, since `theta_3` beside
    `theta_1` is a column of its own.
    """
    gone, end = set(taken), end_of(name)
    free = [item for item in NUMBERS if item not in gone and (end is None or end_of(item) in (None, end))]
    near = get_close_matches(name.lower(), free, n=1, cutoff=_NEAR)
    if not near or end is not None:
        return near
    pairs = str.maketrans("12", "21")
    return sorted({*near, *(other for other in free if other == near[0].translate(pairs))})
