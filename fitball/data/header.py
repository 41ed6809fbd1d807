"""The columns of a file by our names: as they are spelled, as a user says (`--columns v_1=Vin`), or misspelt."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache

from fitball.data.columns import LABELS, MEASURED, NUMBERS, SD_SUFFIX
from fitball.data.findings import Findings, RawRow, Vocabulary
from fitball.data.names import LONGEST, bare, cell_parts, end_of, guess_of
from fitball.data.table import FrozenMapping
from fitball.data.units import Unit, parse_unit, unit_of
from fitball.errors import ParameterError, UnitError, suggestion
from fitball.visible import some, unguarded
from fitball.wording import spoken

_WITH_UNIT = re.compile(r"(?P<name>.*?\S)\s*\[(?P<unit>[^\[\]]*)\]")


@dataclass(frozen=True)
class Naming:
    """What each of our columns is called in a table (`theirs`, by our name), and in which unit, where that is said
    here (`units`, by our name).
    """

    theirs: Mapping[str, str] = field(default_factory=FrozenMapping)
    units: Mapping[str, str] = field(default_factory=FrozenMapping)

    @property
    def texts(self) -> dict[str, str]:
        """As it was stated: our names, and theirs with their units."""
        return {
            name: f"{their} [{self.units[name]}]" if name in self.units else their
            for name, their in self.theirs.items()
        }

    def ours(self, *names: str) -> str | None:
        """Our name of a column that is called by one of `names`; None where nothing was said of it."""
        wanted = {name.strip().casefold() for name in names}
        return next((ours for ours, their in self.theirs.items() if their.casefold() in wanted), None)

    def unit(self, ours: str, written: str | None, found: Findings) -> str | None:
        """The unit of a column as text, where `written` is that of the header; a fault where the two differ."""
        stated = self.units.get(ours)
        if stated is not None and written is not None and unit_of(stated) != unit_of(written):
            message = f"the header says '[{written}]' and the names that were given '[{stated}]'; expected one unit"
            found.header_fault(message, self.theirs[ours])
        return written if stated is None else stated

    def check_absent(self, present: Collection[str], read: Collection[str], found: Findings) -> None:
        """Add a fault for each name that the header has not, unless our own is `present`; `read` are the header's."""
        here, listed = {name.casefold() for name in read}, some([*read])
        for ours, their in self.theirs.items():
            if their.casefold() not in here and ours not in present:
                found.header_fault(
                    f"there is no column '{their}', which is to be {ours} as asked; columns read: {listed}"
                )


def naming(columns: Mapping[str, str], known: Collection[str]) -> Naming:
    """The naming that texts such as `Vin` or `Vin [mph]`, by our name (one of `known`), state.

    Raises ParameterError for a name that is none of ours, and for one of theirs that is to be two of ours.
    """
    theirs, units = dict[str, str](), dict[str, str]()
    for ours, text in columns.items():
        if ours not in known:
            guess = guess_of(ours)
            near = [name for name in guess.names if name in known] if guess is not None else []
            hint = f"did you mean {' or '.join(near)}?" if near else suggestion(ours, known)
            raise ParameterError(f"columns: '{ours}' is none of fitball's columns ({ours}={text}): {hint}")
        matched = _WITH_UNIT.fullmatch(text.strip())
        their = matched["name"] if matched else text.strip()
        if not their:
            raise ParameterError(f"columns: read no name for {ours}; expected {ours}=NAME or {ours}=NAME [UNIT]")
        if their.casefold() in {other.casefold() for other in theirs.values()}:
            raise ParameterError(f"columns: '{their}' is to be two columns; expected one name for each")
        theirs[ours] = their
        if matched:
            units[ours] = matched["unit"]
    return Naming(FrozenMapping(theirs), FrozenMapping(units))


def with_units(columns: Mapping[str, str], units: Mapping[str, str], known: Collection[str]) -> dict[str, str]:
    """`columns` with the `units` of columns by our name or by theirs. Raises ParameterError for another name."""
    said = naming(columns, known)
    texts = said.texts
    for name, unit in units.items():
        ours = said.ours(name) or next((item for item in known if bare(item) == bare(name)), None)
        if ours is None:
            raise ParameterError(f"units: '{name}' is no column: {suggestion(name, known)}")
        if ours in said.units:
            raise ParameterError(f"units: that of {name} stands in columns too; expected it once")
        texts[ours] = f"{said.theirs.get(ours, name)} [{unit}]"
    return texts


# High enough to pass over words that only share a few letters ("case", "temperature"), low enough
# to catch one wrong, missing or swapped character in names as short as "v_y1" (difflib ratio 0.75 and up).
_NEAR = 0.75
_BY_BARE = {bare(name): name for name in (*NUMBERS, *LABELS)}
# What people call the column that names the impacts.
_IDS = ("id", "no", "nr", "#", "number", "impactid", "impactno")
# How no name begins (an empty cell among them).
_NO_NAME = ("", *"0123456789+-.,\u2212")
# What a name that is probably meant counts for where a header is looked for.
_GUESSED = 0.5


@dataclass(frozen=True)
class Column:
    """One column: its place in the file, its `name`, its `unit` (None for text, or when not understood)."""

    index: int
    name: str
    unit: Unit | None


@dataclass(frozen=True)
class Header:
    """The columns of a table: `numbers` by name, and `texts` (labels and ignored `extras`) by name."""

    numbers: Mapping[str, Column]
    texts: Mapping[str, Column]
    extras: tuple[str, ...]

    def cells(self, name: str, rows: Iterable[RawRow]) -> tuple[str, ...]:
        """What stands in a column of texts, as it was before a file of ours guarded it."""
        index = self.texts[name].index
        return unguarded([row.cells[index] for row in rows])


def vocabulary(naming: Naming) -> Vocabulary:
    """What a header of impacts is told by, where `naming` gives some columns names of their own."""

    @cache
    def worth(cell: str) -> float:
        # Most cells are numbers; no name begins as one, nor is any so long.
        if cell[:1] in _NO_NAME or len(cell) > LONGEST:
            return 0.0
        name, _ = split_cell(cell, naming)
        if naming.ours(cell, name) is not None or _same(name) is not None:
            return 1.0
        guess = guess_of(name)
        return _GUESSED if guess is not None and guess.sure in NUMBERS else 0.0

    return Vocabulary(worth, is_unit)


def is_unit(text: str) -> bool:
    """Whether a text spells a unit that is known."""
    return unit_of(text) is not None


def split_cell(cell: str, naming: Naming | None = None, found: Findings | None = None) -> tuple[str, str | None]:
    """Name and unit (None where there is none) of a header cell; a fault where its brackets do not match."""

    def known(name: str) -> bool:
        return _same(name) is not None or (naming is not None and naming.ours(name) is not None)

    name, unit, fault = cell_parts(cell, known, is_unit)
    if fault and found is not None:
        found.header_fault(fault, cell)
    return name, unit


def _same(name: str) -> str | None:
    """Our name of which `name` differs in case, blanks and underscores only."""
    if name in NUMBERS or name in LABELS:
        return name
    plain = bare(name)
    return "id" if plain in _IDS or name.strip() == "#" else _BY_BARE.get(plain)


def read_header(cells: tuple[str, ...], found: Findings, naming: Naming | None = None) -> Header:
    """Find out what each column is.

    A name that differs from ours in case or blanks only is read as ours, with a note. A misspelt column is a fault
    and is then read as the column it resembles, so that the faults of its values come out in the same run; a name
    that probably means one of ours is an extra column until `--columns` says so.
    """
    naming, cells = naming or Naming(), unguarded(cells)
    parsed = [split_cell(cell, naming, found) for cell in cells]
    asked = [naming.ours(cell, name) for cell, (name, _) in zip(cells, parsed, strict=True)]
    names = [name for name, _ in parsed]
    taken = {*filter(None, asked), *names}
    numbers: dict[str, Column] = {}
    texts: dict[str, Column] = {}
    extras: list[str] = []
    spelled: list[str] = []
    for index, ((name, unit), named) in enumerate(zip(parsed, asked, strict=True)):
        ours = named if named is not None else _same(name)
        if named is not None:
            unit = naming.unit(named, unit, found)
        elif ours == "id" != name and "id" in names:
            ours = None
        elif ours is None and name:
            ours = _misspelt(name, taken, found)
        elif ours is not None and ours != name:
            spelled.append(f"'{name}' as {ours}")
        meant = ours or name
        taken.add(meant)
        if not name:
            extras.append(f"(column {index + 1}, without a name)")
        elif meant in numbers or meant in texts:
            message = f"read '{cells[index]}', but another column is '{meant}' already; keep one of them"
            found.header_fault(message, meant)
        elif meant in NUMBERS:
            numbers[meant] = Column(index, meant, _unit(meant, unit, found))
        else:
            texts[meant] = Column(index, meant, None)
            extras += [name] if ours is None else []
    if spelled:
        found.notice(f"columns read under other spellings: {some(spelled)}")
    naming.check_absent({*numbers, *texts}, names, found)
    return Header(numbers, texts, tuple(extras))


def _unit(name: str, text: str | None, found: Findings) -> Unit | None:
    try:
        return parse_unit(text, NUMBERS[name])
    except UnitError as error:
        found.header_fault(str(error), name)
        return None


def _misspelt(name: str, taken: Iterable[str], found: Findings) -> str | None:
    """The known column that an unknown name misspells, with a fault; None for a column of the user's own."""
    guess = guess_of(name)
    if guess is not None and guess.sure:
        return None
    near = _nearest(name, taken)
    if len(near) > 1:
        how = spoken("--columns", "columns=")
        found.header_fault(
            f"unknown column; did you mean '{near[0]}' or '{near[1]}'? Rename it, or say which by {how}", name
        )
        return None
    if near:
        found.header_fault(
            f"unknown column; did you mean '{near[0]}'? Rename it (a column of your own needs another name)", name
        )
        return near[0]
    if name.endswith(SD_SUFFIX):
        base, known = name.removesuffix(SD_SUFFIX), ", ".join(MEASURED)
        found.header_fault(f"'{base}' is no column that can have a standard deviation; known: {known}", name)
    return None


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
