"""A header cell -> our name, unit and role; `--columns`; one guess for an unknown name.

A column is known as it is spelled (`V1 (mph)`, `θ_1 / °`, `v_2_sd`, `corr(v_x1,gap_time)`) or by
the user's names (`--columns "v_1=Vin [mph]"`). A guess is offered, never taken, and never says
incidence for rebound.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache
from math import nan
from typing import TYPE_CHECKING

from fitball.base.columns import COLUMNS, HEIGHTS
from fitball.base.errors import ParameterError, suggestion
from fitball.base.text import listed
from fitball.base.units import assumed_symbol, factor_of, symbol_of, symbol_within

if TYPE_CHECKING:
    from fitball.data.cells import Cells

LABELS = ("id", "surface", "ball", "location", "session", "table")
NUMBERS = tuple(name + suffix for name in COLUMNS for suffix in ("", "_sd"))
# A longer cell is no name of ours, and patterns take time with the square of the length.
_LONGEST = 100
# What a name that is probably meant counts for where a header is looked for, and how alike two
# names are if one is a slip of the other: one wrong, missing or exchanged character in a name as
# short as `v_y1`.
_GUESSED = 0.5
_NEAR = 0.75
# Words of names: quantity, direction, end of the bounce, deviation, nothing.
_LEXICON = {
    (
        "quantity",
        "v",
    ): "v vel velo velocity velocities speed speeds geschwindigkeit geschw tempo vitesse",
    ("quantity", "theta"): "theta angle angles ang alpha winkel",
    ("quantity", "omega"): "omega spin spins w rot rotation drall",
    ("quantity", "contact_time"): "contacttime tcontact contactduration kontaktzeit tc",
    ("quantity", "height"): "h height heights hoehe höhe",
    ("direction", "x"): "x horizontal hor horiz tangential tan parallel",
    ("direction", "y"): "y z vertical vert normal perpendicular perp",
    (
        "end",
        "1",
    ): "1 in inc incident incoming incidence inbound impact before pre prior initial init start "
    "approach "
    "i vor vorher avant drop dropped fall ein",
    (
        "end",
        "2",
    ): "2 out outgoing outbound reb rebound rebounding exit after post final end f r bounce "
    "bounced nach "
    "nachher aus après apres",
    ("sd", "_sd"): "sd std stdev sigma",
    ("filler", ""): "ball of the mean avg average measured launch",
}
_WORDS = {word: meaning for meaning, words in _LEXICON.items() for word in words.split()}
# Words that alone, as the name of a column, mean a height.
_OF_A_DROP = {"drop", "fall", "rebound", "bounce"}

# `v_1 [m/s]`; `v_1 (m/s)`; and behind the name: `v_1 / m/s` (ISO 80000), `v_1 in m/s`, `v_1, m/s`,
# `v_1_mph`.
_SQUARE = re.compile(r"(?P<name>[^\[\]]*?)\s*/?\s*\[(?P<unit>[^\[\]]*)\]")
_ROUND = re.compile(r"(?P<name>.*?)\s*/?\s*[({](?P<unit>[^(){}]*)[)}]")
_GAP = re.compile(r"\s*/\s*|\s+in\s+|\s*[,:;]\s*|[_\s]")
_CORR = re.compile(r"\s*corr\(\s*(\w+)\s*,\s*(\w+)\s*\)\s*", re.IGNORECASE)


def bare(name: str) -> str:
    """A name without case, blanks, underscores and the like; Greek letters and indices in Latin."""
    for letter, word in {"θ": "theta", "ϑ": "theta", "ω": "omega", "σ": "sd"}.items():
        name = name.casefold().replace(letter, word)
    return re.sub(r"[\s_.\-]+", "", name.translate(str.maketrans("₁₂ₓᵧ", "12xy")))


_BY_BARE = {bare(name): name for name in (*NUMBERS, *LABELS)}
_BY_BARE |= dict.fromkeys(("no", "nr", "#", "number", "impactid", "impactno"), "id")


def known_as(name: str) -> str | None:
    """Our name of what differs from it in case, blanks and underscores only; correlations in the
    order of COLUMNS.
    """
    if len(name) > _LONGEST:
        return None
    if (pair := _CORR.fullmatch(name)) is None:
        return _BY_BARE.get(bare(name))
    both = {known_as(part) for part in pair.groups()}
    ends = [column for column in COLUMNS if column in both]
    return f"corr({','.join(ends)})" if len(ends) == 2 else None


class Naming:
    """What the user calls columns, by our name, with the unit or without: `{"v_1": "Vin [mph]"}`.
    Raises ParameterError (`columns`) for a name that is none of ours, and for one of theirs that is
    to be two of ours.
    """

    def __init__(self, columns: Mapping[str, str]) -> None:
        # On one line: a proposal may have been copied from a terminal that folds it.
        self.columns = {ours: " ".join(text.split()) for ours, text in columns.items()}
        self.theirs = dict[str, str]()
        self.units = dict[str, str]()
        for ours, text in self.columns.items():
            if ours not in NUMBERS and ours not in LABELS:
                near = listed(guess_of(ours), "or")
                hint = f"did you mean {near}?" if near else suggestion(ours, (*COLUMNS, *LABELS))
                raise ParameterError(
                    f"columns: '{ours}' is no column of fitball ({ours}={text}): {hint}",
                    "columns",
                )
            square = _SQUARE.fullmatch(text)
            their = (square["name"] if square else text).casefold()
            if not their or their in self.theirs.values():
                words = (
                    "is given for two columns"
                    if their
                    else "is empty; expected NAME or NAME [UNIT]"
                )
                raise ParameterError(f"columns: the name in '{ours}={text}' {words}", "columns")
            self.theirs[ours] = their
            if square:
                self.units[ours] = square["unit"]

    def said(self, *names: str) -> str | None:
        """Our name of a column that the user calls by one of these."""
        wanted = {" ".join(name.split()).casefold() for name in names}
        return next((ours for ours, their in self.theirs.items() if their in wanted), None)

    def worth(self, cell: str) -> float:
        """What a cell is worth as one of a header: 1 for a name that is known, 0.5 for one that is
        probably meant.
        """
        if not cell or len(cell) > _LONGEST or cell[0] in "0123456789+-.,−":
            return 0.0
        name, _ = self.split(cell)
        if self.said(cell, name) or known_as(name):
            return 1.0
        return _GUESSED if len(guess_of(name)) == 1 else 0.0

    def split(self, cell: str) -> tuple[str, str | None]:
        """Name and unit (None where there is none) of a header cell. Square brackets always hold a
        unit; round ones do behind a name that is known, or if a unit is in them; without brackets a
        unit must be one.
        """
        text = cell.strip()
        if len(text) > _LONGEST or known_as(text):
            return text, None
        if square := _SQUARE.fullmatch(text):
            return square["name"], square["unit"]
        found = _ROUND.fullmatch(text)
        if found and (
            self.said(found["name"]) or known_as(found["name"]) or symbol_of(found["unit"])
        ):
            return found["name"], found["unit"]
        for gap in _GAP.finditer(text):
            front = text[: gap.start()]
            unit = text[gap.end() :]
            if gap[0].strip(" _") or self.said(front) or known_as(front):
                for spelling in filter(symbol_of, (unit, unit.replace("_", "/", 1))):
                    return front, spelling
        return text, None


@dataclass(frozen=True)
class Header:
    """Places among `Cells.columns` by our names: `numbers` of COLUMNS, NAME_sd and corr(a,b), with
    `factors` to SI (NaN where the unit is a fault) and the symbols of their `units`, stated or
    assumed; `labels` of all others, by their own names where we know none. `guesses` are unknown
    columns by the name that each may mean, as `--columns` takes them.
    """

    numbers: Mapping[str, int]
    factors: Mapping[str, float]
    units: Mapping[str, str]
    labels: Mapping[str, int]
    guesses: Mapping[str, str]


def read_header(cells: Cells, naming: Naming, optional: Collection[str] = ()) -> Header:
    """What each column is, by its header and the user's names. With `optional` ones (ours), which
    need not be there, they are those of another table: so are names that are as we have them, and
    units are of columns without one. Notes and faults go to `cells`: `unknown-unit`,
    `ambiguous-unit`, `other-quantity`, `two-units`, `brackets`, `column-twice`, `misspelt-column`,
    `no-column`.
    """
    split = [naming.split(cell) for cell in cells.names]
    ours = [
        naming.said(cell, name) or known_as(name)
        for cell, (name, _) in zip(cells.names, split, strict=True)
    ]
    # `No.` beside `id` is a column of the user's own.
    twice = ours.count("id") > 1
    ours = [
        None if twice and n == "id" != bare(name) else n
        for n, (name, _) in zip(ours, split, strict=True)
    ]
    numbers = dict[str, int]()
    labels = dict[str, int]()
    units = dict[str, str | None]()
    for k, (cell, (name, unit), column) in enumerate(zip(cells.names, split, ours, strict=True)):
        stated = naming.units.get(column or "")
        if column is None:
            _check_unknown(cells, cell, name, ours)
            labels.setdefault(name, k)
        elif column in numbers or column in labels:
            cells.fault(
                "column-twice",
                f"'{cell}' and another column are both '{column}'; keep one of them",
                column,
            )
        elif column in LABELS:
            labels[column] = k
        else:
            numbers[column], units[column] = k, unit or stated
            if stated and unit and symbol_of(stated) != symbol_of(unit) and not optional:
                words = (
                    f"the unit is '[{unit}]' in the header and '[{stated}]' in columns; "
                    "expected one unit"
                )
                cells.fault("two-units", words, column)
    _check_named(cells, naming, [name for name, _ in split], ours, optional)
    guesses = _guesses(cells.names, split, ours)
    for column, their in guesses.items():
        cells.note("not-read", f'a column is not read; did you mean --columns "{column}={their}"?')
    factors, symbols = _units(cells, numbers, units)
    return Header(numbers, factors, symbols, labels, guesses)


def _check_named(
    cells: Cells,
    naming: Naming,
    names: Sequence[str],
    ours: Sequence[str | None],
    optional: Collection[str],
) -> None:
    """A fault where a column that the user named is not there; a note where ours is, under its own
    name.
    """
    called = {" ".join(text.split()).casefold() for text in (*cells.names, *names)}
    for column, their in naming.theirs.items():
        if column in {*ours, *optional} or (optional and their == column):
            if column in ours and not optional and their not in called:
                text = (
                    f"no column is called '{naming.columns[column]}': {column} is read from "
                    "the one of that name"
                )
                cells.note("not-read", text)
            continue
        words = f"there is no column '{naming.columns[column]}' to read as {column}"
        cells.fault(
            "no-column",
            f"{words}; columns of the table: {listed(cells.names, most=20)}",
            column,
        )


def _units(
    cells: Cells,
    numbers: Mapping[str, int],
    units: Mapping[str, str | None],
) -> tuple[dict[str, float], dict[str, str]]:
    """Factors to SI and symbols of the units, stated or assumed, of columns; a fault where a unit
    is none of its column's.
    """
    factors = dict.fromkeys(numbers, 1.0)
    symbols = dict[str, str]()
    for column in [column for column in numbers if column in NUMBERS]:
        # A standard deviation without a unit has that of its column.
        base = column.removesuffix("_sd")
        unit = units[column] or units.get(base)
        si = COLUMNS[base].unit
        symbols[column] = symbol_within(unit or "", si) or assumed_symbol(si)
        try:
            factors[column] = factor_of(unit, si)
        except ParameterError as error:
            cells.fault(error.code, str(error), column)
            factors[column] = nan
    return factors, symbols


def _check_unknown(cells: Cells, cell: str, name: str, taken: Collection[str | None]) -> None:
    """A fault where an unknown name is a slip of one of ours that is not there, or its brackets do
    not match.
    """
    if "[" in cell and known_as(cell.split("[")[0]):
        cells.fault(
            "brackets",
            "the brackets do not match; expected a name and a unit, such as 'v_x1 [m/s]'",
            cell,
        )
    if _CORR.fullmatch(cell):
        cells.fault(
            "unknown-correlation",
            f"expected corr(a,b) of two columns: {', '.join(COLUMNS)}",
            cell,
        )
    free = [item for item in NUMBERS if item not in taken and end_of(name) in (None, end_of(item))]
    near = (
        []
        if len(guess_of(name)) == 1
        else get_close_matches(name[:_LONGEST].lower(), free, n=2, cutoff=_NEAR)
    )
    if near:
        words = f"unknown column; did you mean {listed(map(repr, near), 'or')}?"
        cells.fault(
            "misspelt-column",
            f"{words} Rename it, or give a column of your own a less similar name",
            name,
        )


def _guesses(
    names: Collection[str],
    split: Collection[tuple[str, str | None]],
    ours: Collection[str | None],
) -> dict[str, str]:
    """Unknown columns by the name that each may mean: one column for one name that is not there.
    What leaves the end open means the one that no other column is.
    """
    unknown = {
        cell: guess_of(name)
        for cell, (name, _), our in zip(names, split, ours, strict=True)
        if our is None
    }
    gone = {*filter(None, ours), *(guess[0] for guess in unknown.values() if len(guess) == 1)}
    found: dict[str, list[str]] = {}
    for cell, guess in unknown.items():
        left = [item for item in guess if item not in (ours if len(guess) == 1 else gone)]
        if len(left) == 1:
            within = (
                next(filter(_is_unit, cell.split()), None)
                if "[" not in cell and "(" not in cell
                else None
            )
            found.setdefault(left[0], []).append(f"{cell} [{within}]" if within else cell)
    return {column: texts[0] for column, texts in found.items() if len(texts) == 1}


# ---- names by the lexicon


def end_of(name: str) -> str | None:
    """The end of the bounce that a name speaks of: "1" incident, "2" rebound; None where it says
    neither, or both.
    """
    ends = {value for kind, value in _meanings(name) if kind == "end"}
    ends = ends or set(re.findall(r"(?<![0-9])[12](?![0-9])", name))
    return ends.pop() if len(ends) == 1 else None


def guess_of(name: str) -> tuple[str, ...]:
    """Names of ours that `name` may mean: one where it says which, both ends where it says the
    quantity only, none where it is no name of an impact's quantity.
    """
    found = [meaning for meaning in _meanings(name) if meaning[0] != "filler"]
    kinds = dict(found)
    quantity = kinds.get("quantity", "height" if bare(name) in _OF_A_DROP else "")
    if not quantity or len(kinds) < len(found) or ("direction" in kinds and quantity != "v"):
        return ()
    sd = kinds.get("sd", "")
    direction = kinds.get("direction", "")
    if quantity == "contact_time":
        return (quantity + sd,)
    ends = kinds.get("end", "12")
    return tuple(
        (HEIGHTS[int(k) - 1] if quantity == "height" else f"{quantity}_{direction}{k}") + sd
        for k in ends
    )


def _is_unit(word: str) -> bool:
    return len(word) > 1 and bare(word) not in _WORDS and symbol_of(word) is not None


def _meanings(name: str) -> list[tuple[str, str]]:
    """The meanings of the words of a name, units left out; none if it has other words."""
    if len(name) > _LONGEST:
        return []
    words = _cut(bare("".join(word for word in name.split() if not _is_unit(word))))
    return [_WORDS[word] for word in words or []]


@lru_cache(10_000)
def _cut(text: str) -> list[str] | None:
    """The text as words, the longest first; None where no way of cutting it leaves nothing over."""
    for size in range(min(len(text), 20), 0, -1):
        if text[:size] in _WORDS and (rest := _cut(text[size:])) is not None:
            return [text[:size], *rest]
    return None if text else []
